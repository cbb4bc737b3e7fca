//! Identification judged by simulation: the scene with what was found moves as the markers do, or it is not that of the data.
//!
//! Balances look at each joint by itself, and a wrong fluid or mass can pass there as another stiffness. The simulation is left with
//! the residual r = markers − x at all markers; with S = ∂x/∂EI, noise of σ in each coordinate, and deviations D of the stiffness,
//! the stiffness that meets both best is off by δ = (SᵀS/σ² + D⁻²)⁻¹ Sᵀr/σ² (Bard, Nonlinear Parameter Estimation, 1974, section 7).
//! The strength of the actuation, where it was found too, takes part and has no D. What is left of r then should be noise.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::design_vector::DesignVector;
use super::markers::Markers;
use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Trajectory};

/// Mean square of what is left over that of noise and of the steps, from which on a simulation is not the motion of the markers.
const MAX_MISFIT: f64 = 1.3;

/// The largest root of that mean over so many coordinates, of which it is uncertain.
pub(super) fn max_misfit(count: f64) -> f64 {
    (MAX_MISFIT + 4.0 * (2.0 / count).sqrt()).sqrt()
}

/// Steps are halved at most so often, until that moves the rod by less than this part of the noise.
const MAX_HALVINGS: usize = 4;
const MAX_STEP_ERROR: f64 = 0.3;

/// Most derivatives that are kept: of all nodes by all joints at as many times as that allows.
const MAX_DERIVATIVES: usize = 10_000_000;

/// Those of all nodes at the times of the markers, m; none beyond the simulation.
type Positions = Vec<Option<Vec<f64>>>;

/// How the simulation with what was found meets the markers.
#[derive(Debug, Clone, Serialize)]
pub struct Refit {
    /// The step that it is simulated with, s.
    pub step_s: f64,
    /// Root mean square of what steps of half the length change, m in each coordinate.
    pub step_error_m: f64,
    /// Root mean square of what is left between it and the markers, m in each coordinate.
    pub residual_m: f64,
    /// The same, once the stiffness of the joints has moved within its deviations, over noise and error of the steps.
    pub residual_over_noise: f64,
    /// How much stiffer each joint would meet the markers better, within its deviations, N m².
    pub stiffer_n_m2: Vec<f64>,
    /// The largest `residual_over_noise` of a simulation of this scene.
    pub allowed: f64,
}

impl Refit {
    /// True if what is left is noise.
    pub fn fits(&self) -> bool {
        self.residual_over_noise <= self.allowed
    }

    /// Of the scene that `scene` makes with steps of a length (s), `step` first, with `profile` and markers with noise of `noise` (m) in
    /// each coordinate, where the stiffness of the joints has these `deviations` (N m²), and the strength of the actuation is unknown as
    /// well or not.
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
        // In units of the deviations; joints that nothing is known of stay. The strength of the actuation is free: its unit is what
        // moves the rod by its length.
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

/// Root mean square of the distance between `positions` and `others` where there are both.
fn rms<'a>(positions: &'a [Option<Vec<f64>>], others: impl Fn(usize) -> Option<&'a Vec<f64>>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (i, x) in positions.iter().enumerate() {
        let (Some(x), Some(other)) = (x, others(i)) else { continue };
        sum += x.iter().zip(other).map(|(x, other)| (x - other).powi(2)).sum::<f64>();
        count += x.len();
    }
    (sum / count as f64).sqrt()
}

/// SᵀS, Sᵀr and rᵀr of what is `off` the markers, S by the stiffness of the joints (N m²), and by the amplitude of the actuation where that is
/// unknown.
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
