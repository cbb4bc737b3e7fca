//! Small motions about a steady state, in flow and with damping: M ẍ + C ẋ + K x = 0 with x = φ e^{λt}.
//!
//! The matrices are the model's own derivatives by accelerations, velocities and positions where the rod rests, so added mass,
//! drag, Coriolis and centrifugal force of the flow, wake and tension are all in them, and none need be symmetric. λ = σ ± iω: a
//! motion that grows (σ > 0) while it swings is flutter, one that grows without is divergence. The quadratic problem is solved as
//! the eigenvalues of its companion matrix in the unknowns (x, ẋ/Ω), Ω of the size of the highest frequency, so that rounding is
//! ε Ω and not ε Ω². Source: F. Tisseur & K. Meerbergen, SIAM Review 43 (2001).

use std::sync::Arc;

use faer::linalg::solvers::Solve;
use faer::{Mat, c64};
use nalgebra::Vector2;

use crate::error::{Error, Result};
use crate::head::Signal;
use crate::linear::BandMatrix;
use crate::model::{Dynamics, Model};
use crate::newton::Newton;
use crate::rod::node;
use crate::start::Start;
use crate::system::{Direction, Linearisation, State, System};

/// Parts in which flow and loads grow, where the rod does not come to rest from its straight shape at once.
const PARTS: u32 = 16;

/// Convergence of the rest, relative to the length.
pub(crate) const RESTED: f64 = 1e-11;

/// Eigenvalues below this part of the highest are those of motions that nothing holds, and rounding.
const ZERO: f64 = 1e-7;

/// Matrix entries of this part of the largest couple nothing.
const DECOUPLED: f64 = 1e-14;

/// Why a model has no steady state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Unsteady {
    /// The key of the scene that is to blame.
    pub key: &'static str,
    /// What is wrong, and what can be done.
    pub problem: String,
}

/// A rod at rest, in its flow and under its loads.
#[derive(Debug)]
pub struct SteadyState {
    dynamics: Dynamics,
    state: State,
}

/// A motion x = Re(φ e^{λt}) about the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenmode {
    /// σ, 1/s: it grows where this is above zero.
    pub growth: f64,
    /// ω ≥ 0, rad/s.
    pub frequency: f64,
    /// Real and imaginary part of φ, x and y of every node; the largest modulus is 1.
    pub shape: Vec<[[f64; 2]; 2]>,
}

impl Eigenmode {
    /// Damping ratio ζ = −σ/|λ|.
    pub fn damping_ratio(&self) -> f64 {
        -self.growth / self.growth.hypot(self.frequency)
    }

    /// True where it moves the rod across the x axis more than along it.
    pub fn bends(&self) -> bool {
        let size = |axis: usize| self.shape.iter().map(|[re, im]| re[axis].powi(2) + im[axis].powi(2)).sum::<f64>();
        size(1) >= size(0)
    }
}

/// M, C and K over the free unknowns of one group.
struct Group {
    unknowns: Vec<usize>,
    matrices: [Mat<f64>; 3],
}

impl SteadyState {
    /// The rest of `model` without its actuation, its head held where it is at time zero. A free rod goes with the flow: it is
    /// seen from there.
    ///
    /// # Errors
    /// [`Unsteady`] where there is no rest, or none is found.
    pub fn of(mut model: Model) -> std::result::Result<Self, Unsteady> {
        let unsteady = |key: &'static str, problem: &str| Unsteady { key, problem: problem.to_string() };
        if let Some(law) = model.forces.whole() {
            let found = law.name();
            let problem = format!(
                "{found:?} has no matrix of a band, which eigenvalues are found from; allowed here: a law for each edge, as \"cox\""
            );
            return Err(unsteady("drag.law", &problem));
        }
        if model.flow.is_some() {
            let problem = "the flow changes in time; allowed: a steady one, as [1.0, 0.0]";
            return Err(unsteady("medium.flow_m_s", problem));
        }
        (model.actuation, model.start, model.spin) = (None, Start::Jump, 0.0);
        match &mut model.head {
            Some(motion) => *motion = motion.each_ref().map(|signal| Signal::Constant(signal.at(0.0).value)),
            None => model.fluid.flow = Vector2::zeros(),
        }
        let held = model.head.is_some();
        let mut dynamics = Dynamics::new(Arc::new(model));
        let nodes = dynamics.nodes();
        let load: Vec<f64> = (0..nodes).flat_map(|k| <[f64; 2]>::from(dynamics.load(k))).collect();
        if !held && load.iter().any(|force| *force != 0.0) {
            let problem =
                "a free rod under loads does not rest; hold its head (kind = \"clamped\"), or take the loads away";
            return Err(unsteady("head.kind", problem));
        }
        let failed = |error: Error| {
            unsteady("medium.flow_m_s", &format!("no rest is found in this flow and under these loads: {error}"))
        };
        let mut newton = Newton::new(nodes, RESTED).map_err(failed)?;
        let straight = dynamics.first_state();
        let mut state = straight.clone();
        if held && newton.solve(&mut dynamics, &mut state, Direction::POSITIONS).is_err() {
            state.copy_from(&straight);
            let flow = dynamics.inputs.fluid.flow;
            for part in 1..=PARTS {
                let part = f64::from(part) / f64::from(PARTS);
                dynamics.inputs.fluid.flow = flow * part;
                dynamics.inputs.force = (part < 1.0).then(|| load.iter().map(|force| (part - 1.0) * force).collect());
                newton.solve(&mut dynamics, &mut state, Direction::POSITIONS).map_err(failed)?;
            }
        }
        Ok(Self { dynamics, state })
    }

    /// The model, without what moves it.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The load on node `k`, N.
    pub fn load(&self, k: usize) -> Vector2<f64> {
        self.dynamics.load(k)
    }

    /// The mass (kg) of the fluid that every node moves along with itself, whichever way that is.
    ///
    /// # Errors
    /// Those of [`matrices`](Self::matrices).
    pub fn added_mass(&mut self) -> Result<Vec<f64>> {
        let [inertia, ..] = self.matrices()?;
        let own = &self.dynamics.model.rod.mass;
        Ok(own
            .iter()
            .enumerate()
            .map(|(k, m)| inertia.entry(2 * k, 2 * k) + inertia.entry(2 * k + 1, 2 * k + 1) - 2.0 * m)
            .collect())
    }

    /// Positions at rest, m, two entries per node.
    pub fn positions(&self) -> &[f64] {
        &self.state.q
    }

    /// Largest displacement of a node from the straight rod, m.
    pub fn bend(&mut self) -> f64 {
        let straight = self.dynamics.first_state();
        let nodes = self.dynamics.nodes();
        (0..nodes).map(|k| (node(&self.state.q, k) - node(&straight.q, k)).norm()).fold(0.0, f64::max)
    }

    /// M, C and K of all nodes, that of a held head too.
    ///
    /// # Errors
    /// Those of [`System::assemble`].
    pub fn matrices(&mut self) -> Result<[BandMatrix; 3]> {
        let nodes = self.dynamics.nodes();
        let mut residual = vec![0.0; 2 * nodes];
        let mut along = |direction: Direction| {
            let mut matrix = BandMatrix::new(nodes);
            let linearisation = Linearisation { matrix: &mut matrix, direction };
            self.dynamics.unconstrained(&self.state, &mut residual, Some(linearisation))?;
            Ok::<_, Error>(matrix)
        };
        Ok([along(Direction::ACCELERATIONS)?, along(Direction::VELOCITIES)?, along(Direction::POSITIONS)?])
    }

    /// The free unknowns in groups that do not touch each other: x and y of a straight rod along an axis, else one.
    fn groups(&mut self) -> Result<Vec<Group>> {
        let nodes = self.dynamics.nodes();
        let first = usize::from(self.dynamics.model.head.is_some());
        let bands = self.matrices()?;
        let entry = |matrix: &BandMatrix, i: usize, j: usize| {
            if matrix.coupled(i / 2).contains(&(j / 2)) { matrix.entry(i, j) } else { 0.0 }
        };
        let coupled = |matrix: &BandMatrix| {
            let (mut across, mut all) = (0.0_f64, 0.0_f64);
            for i in 2 * first..2 * nodes {
                for j in matrix.coupled(i / 2).flat_map(|k| [2 * k, 2 * k + 1]).filter(|j| *j >= 2 * first) {
                    let size = matrix.entry(i, j).abs();
                    all = all.max(size);
                    across = if i % 2 == j % 2 { across } else { across.max(size) };
                }
            }
            across > DECOUPLED * all
        };
        let unknowns: Vec<usize> = (2 * first..2 * nodes).collect();
        let groups = if bands.iter().any(coupled) {
            vec![unknowns]
        } else {
            let axis = |axis: usize| unknowns.iter().copied().filter(|i| i % 2 == axis).collect();
            vec![axis(1), axis(0)]
        };
        let group = |unknowns: Vec<usize>| {
            let dense = |matrix: &BandMatrix| {
                Mat::from_fn(unknowns.len(), unknowns.len(), |i, j| entry(matrix, unknowns[i], unknowns[j]))
            };
            Group { matrices: bands.each_ref().map(dense), unknowns }
        };
        Ok(groups.into_iter().map(group).collect())
    }

    fn failed(&self, reason: &impl std::fmt::Debug) -> Error {
        Error::Linear { unknowns: 2 * self.state.q.len(), reason: format!("its eigenvalues: {reason:?}") }
    }

    /// λ = σ + iω with ω ≥ 0 of every motion that something holds or damps; unsorted.
    ///
    /// # Errors
    /// [`Error::Linear`] where the iteration does not converge; those of [`matrices`](Self::matrices).
    pub fn eigenvalues(&mut self) -> Result<Vec<c64>> {
        let mut found = Vec::new();
        for group in self.groups()? {
            let (companion, scale) = companion(&group.matrices);
            let values: Vec<c64> = companion.eigenvalues().map_err(|e| self.failed(&e))?;
            found.extend(values.into_iter().filter(|value| is_kept(*value)).map(|value| value * scale));
        }
        Ok(found)
    }

    /// All motions that something holds or damps, the slowest first.
    ///
    /// # Errors
    /// Those of [`eigenvalues`](Self::eigenvalues).
    pub fn eigenmodes(&mut self) -> Result<Vec<Eigenmode>> {
        let nodes = self.dynamics.nodes();
        let mut found = Vec::new();
        for group in self.groups()? {
            let (companion, scale) = companion(&group.matrices);
            let pairs = companion.eigen().map_err(|e| self.failed(&e))?;
            for j in 0..companion.nrows() {
                let value: c64 = pairs.S()[j];
                if !is_kept(value) {
                    continue;
                }
                let entry = |i: usize| -> c64 { pairs.U()[(i, j)] };
                // The largest entry becomes 1.
                let largest = (0..group.unknowns.len())
                    .map(entry)
                    .fold(c64::new(0.0, 0.0), |max: c64, x| if x.norm() > max.norm() { x } else { max });
                let mut shape = vec![[[0.0; 2]; 2]; nodes];
                for (i, unknown) in group.unknowns.iter().enumerate() {
                    let x = entry(i) / largest;
                    shape[unknown / 2][0][unknown % 2] = x.re;
                    shape[unknown / 2][1][unknown % 2] = x.im;
                }
                found.push(Eigenmode { growth: value.re * scale, frequency: value.im * scale, shape });
            }
        }
        found.sort_by(|a, b| a.growth.hypot(a.frequency).total_cmp(&b.growth.hypot(b.frequency)));
        Ok(found)
    }
}

/// One of a conjugate pair, or a real one that is not zero; `value` is over the scale of all.
fn is_kept(value: c64) -> bool {
    value.norm() > ZERO && value.im > -f64::MIN_POSITIVE
}

/// The matrix of x and ẋ/Ω whose eigenvalues are λ/Ω, and Ω, 1/s.
fn companion([mass, damping, stiffness]: &[Mat<f64>; 3]) -> (Mat<f64>, f64) {
    let n = mass.nrows();
    let factors = mass.partial_piv_lu();
    let (held, damped) = (factors.solve(stiffness), factors.solve(damping));
    let row = |i: usize| (0..n).map(|j| held[(i, j)].abs()).sum::<f64>();
    let scale = (0..n).map(row).fold(f64::MIN_POSITIVE, f64::max).sqrt();
    let companion = Mat::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, true) => 0.0,
        (true, false) => f64::from(u8::from(i == j - n)),
        (false, true) => -held[(i - n, j)] / (scale * scale),
        (false, false) => -damped[(i - n, j - n)] / scale,
    });
    (companion, scale)
}
