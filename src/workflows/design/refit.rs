//! Validation of an identified stiffness by simulation: does the scene with it move as the markers do?
//!
//! Moment balances treat each joint separately, so that a wrong fluid or mass may appear as a wrong stiffness. The simulation has
//! the residual r = markers − x. With S = ∂x/∂EI, noise of σ per coordinate, and deviations D of the stiffness, the best fit of
//! both changes the stiffness by δ = (SᵀS/σ² + D⁻²)⁻¹ Sᵀr/σ² (Bard, Nonlinear Parameter Estimation, 1974, section 7). The actuation
//! gain, if it was also identified, has no D. The remaining residual should be noise.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::design_vector::DesignVector;
use super::markers::Markers;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Trajectory};

/// A simulation does not fit if its mean square residual exceeds that of noise and step error by more than this.
const MAX_MISFIT: f64 = 1.3;

/// The largest root mean square residual over noise for `count` coordinates, including its statistical uncertainty.
pub(super) fn max_misfit(count: f64) -> f64 {
    (MAX_MISFIT + 4.0 * (2.0 / count).sqrt()).sqrt()
}

/// The step is halved at most this often, until halving moves the rod by less than this fraction of the noise.
const MAX_HALVINGS: usize = 4;
const MAX_STEP_ERROR: f64 = 0.3;

/// Maximum number of stored derivatives: of all nodes with respect to all joints, at as many times as this allows.
const MAX_DERIVATIVES: usize = 10_000_000;

/// Positions of all nodes at the times of the markers, m; `None` beyond the simulation.
type Positions = Vec<Option<Vec<f64>>>;

/// Comparison of a simulation with the markers.
#[derive(Debug, Clone, Serialize)]
pub struct Refit {
    /// Time step of the simulation, s.
    pub step_s: f64,
    /// Root mean square change by halving the step, m per coordinate.
    pub step_error_m: f64,
    /// Root mean square residual, m per coordinate.
    pub residual_m: f64,
    /// The residual over noise and step error, after the stiffness has moved within its deviations.
    pub residual_over_noise: f64,
    /// The change of the stiffness of each joint, within its deviations, that fits the markers best, N m².
    pub stiffer_n_m2: Vec<f64>,
    /// The largest `residual_over_noise` that noise explains.
    pub allowed: f64,
}

impl Refit {
    /// True if the residual is noise.
    pub fn fits(&self) -> bool {
        self.residual_over_noise <= self.allowed
    }

    /// Simulates the scene that `scene` returns for a time step (s), first `step`, with `profile`. The markers have `noise` (m) per
    /// coordinate, and the stiffness of the joints has these `deviations` (N m²); the flag says whether the actuation gain is also
    /// unknown.
    ///
    /// # Errors
    /// [`Error::Design`] if no markers are within the simulation; those of scene and simulation.
    pub fn of(
        scene: impl Fn(f64) -> Result<Scene>,
        step: f64,
        profile: &DesignVector,
        (markers, noise): (&Markers, f64),
        (deviations, actuation_gain): (&[f64], bool),
    ) -> Result<Self> {
        let problem = |step: f64| {
            let mut problem = Problem::of(&scene(step)?)?;
            problem.set_stiffness(&profile.stiffness_n_m2)?;
            problem.set_actuation(&profile.amplitude, &profile.phase_rad)?;
            Ok::<_, Error>(problem)
        };
        let at_markers =
            |trajectory: &Trajectory| -> Positions { markers.times.iter().map(|time| trajectory.at(*time)).collect() };
        let mut best: Option<(f64, f64, Positions)> = None;
        let (mut step_error, mut last): (f64, Option<Positions>) = (f64::INFINITY, None);
        for halved in 0..=MAX_HALVINGS {
            let step = step * 0.5_f64.powi(halved as i32);
            let positions = at_markers(&problem(step)?.simulate()?);
            let residual = rms(&positions, |i| Some(&markers.positions[i]));
            if let Some(last) = &last {
                step_error = rms(&positions, |i| last[i].as_ref());
            }
            last = Some(positions.clone());
            if best.as_ref().is_none_or(|(least, ..)| residual < *least) {
                best = Some((residual, step, positions));
            }
            if step_error <= MAX_STEP_ERROR * noise {
                break;
            }
        }
        let Some((residual, step, positions)) = best.filter(|(residual, ..)| residual.is_finite()) else {
            return Err(Error::Design { reason: "no markers are within the simulation".to_string() });
        };
        let off: Vec<(usize, Vec<f64>)> = positions
            .iter()
            .enumerate()
            .filter_map(|(i, x)| {
                let off = markers.positions[i].iter().zip(x.as_ref()?).map(|(marker, x)| marker - x);
                Some((i, off.collect()))
            })
            .collect();
        let variance = noise * noise + step_error * step_error;
        let problem = problem(step)?;
        let length = problem.model().rod.length;
        let (matrix, rhs, squares) = normal(problem, markers, &off, actuation_gain)?;
        let joints = deviations.len();
        let all = matrix.nrows();
        let count = off.iter().map(|(_, off)| off.len()).sum::<usize>() as f64;
        // In units of the deviations; joints without information are fixed. The strength of the actuation is free: its unit is the
        // change that moves the rod by its length.
        let unit = |i: usize| match deviations.get(i) {
            Some(deviation) => Some(*deviation).filter(|deviation| deviation.is_finite()).unwrap_or(0.0),
            None => length * (count / matrix[(i, i)].max(f64::MIN_POSITIVE)).sqrt(),
        };
        let scaled = DMatrix::from_fn(all, all, |i, j| {
            matrix[(i, j)] * unit(i) * unit(j) / variance + f64::from(u8::from(i == j))
        });
        let right = DVector::from_fn(all, |i, _| rhs[i] * unit(i) / variance);
        let moved = scaled.cholesky().map_or_else(|| DVector::zeros(all), |factors| factors.solve(&right));
        let change = DVector::from_fn(all, |i, _| moved[i] * unit(i));
        let left = (squares - 2.0 * change.dot(&rhs) + change.dot(&(&matrix * &change))).max(0.0) / count;
        Ok(Self {
            step_s: step,
            step_error_m: step_error,
            residual_m: residual,
            residual_over_noise: (left / variance.max(f64::MIN_POSITIVE)).sqrt(),
            stiffer_n_m2: change.as_slice()[..joints].to_vec(),
            allowed: max_misfit(count),
        })
    }
}

/// Root mean square distance between `positions` and `others` at their common times.
fn rms<'a>(positions: &'a [Option<Vec<f64>>], others: impl Fn(usize) -> Option<&'a Vec<f64>>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (i, x) in positions.iter().enumerate() {
        let (Some(x), Some(other)) = (x, others(i)) else { continue };
        sum += x.iter().zip(other).map(|(x, other)| (x - other).powi(2)).sum::<f64>();
        count += x.len();
    }
    (sum / count as f64).sqrt()
}

/// SᵀS, Sᵀr and rᵀr of the residual `off`; S contains derivatives with respect to the stiffness of the joints (N m²), and to the
/// actuation gain if it is unknown.
fn normal(
    mut problem: Problem,
    markers: &Markers,
    off: &[(usize, Vec<f64>)],
    actuation_gain: bool,
) -> Result<(DMatrix<f64>, DVector<f64>, f64)> {
    let (joints, nodes) = (problem.model().rod.joints(), problem.model().rod.nodes);
    let mut parameters: Vec<Parameter> = joints.map(Parameter::Stiffness).collect();
    parameters.extend(actuation_gain.then_some(Parameter::Amplitude));
    let outputs: Vec<Output> = (0..2 * nodes).map(|i| Quantity::Position(i / 2, i % 2).into()).collect();
    let size = parameters.len() * outputs.len();
    let every = (problem.times().len() * size).div_ceil(MAX_DERIVATIVES).max(1);
    let found = problem.forward(&parameters, &outputs, every, |_| {})?;
    let width = parameters.len();
    let (mut matrix, mut rhs, mut squares) = (DMatrix::zeros(width, width), DVector::zeros(width), 0.0);
    for (i, off) in off {
        let time = markers.times[*i];
        let n = found.times.partition_point(|t| *t <= time).clamp(1, found.times.len() - 1);
        let [from, to] = [found.times[n - 1], found.times[n]];
        let part = ((time - from) / (to - from)).clamp(0.0, 1.0);
        for (o, off) in off.iter().enumerate() {
            let rows = found.row(n - 1, o).iter().zip(found.row(n, o));
            let row = DVector::from_iterator(width, rows.map(|(from, to)| from + part * (to - from)));
            matrix.ger(1.0, &row, &row, 1.0);
            rhs.axpy(*off, &row, 1.0);
            squares += off * off;
        }
    }
    Ok((matrix, rhs, squares))
}
