//! Linear stability about a steady state, in flow and with damping: M ẍ + C ẋ + K x = 0 with x = φ e^{λt}.
//!
//! The matrices are the model's own derivatives with respect to accelerations, velocities and positions in the steady state. They
//! therefore include added mass, drag, Coriolis and centrifugal force of the flow, wake and tension, and none need be symmetric.
//! λ = σ ± iω: growth (σ > 0) with oscillation is flutter, growth without oscillation is divergence. The quadratic problem is
//! that of the matrix A of the unknowns (x, ẋ/Ω). Rounding errors in the eigenvalues of A are relative to the largest eigenvalue,
//! so those below the geometric mean of the largest and the smallest are computed as inverses of the eigenvalues of A⁻¹, whose
//! rounding errors are relative to the slowest motion: growth in viscous fluids is 10¹² times slower than stretching. Rigid
//! motions without restoring forces are projected out: exact rigid motions R with K R = 0, and those with C R = 0, which are
//! undamped too. A rod with a held head has none, unless it turns about a hinge. Source: F. Tisseur & K. Meerbergen, SIAM Review
//! 43 (2001).

use std::sync::Arc;

use faer::linalg::solvers::{Eigen, Solve};
use faer::{Mat, MatRef, c64};
use nalgebra::Vector2;

use super::rest::{self, FreeUnknowns};
use crate::error::{Error, Result};
use crate::fluid::force::resultant;
use crate::linear::{BandMatrix, Direction};
use crate::model::{Dynamics, Model};
use crate::newton::Newton;
use crate::rod::node;
use crate::system::{State, System};

/// The smallest fraction of the holding forces that is removed in one step on the way to rest.
const LEAST_PART: f64 = 1.0 / 4096.0;

/// Convergence tolerance of the rest state, relative to the length.
pub(crate) const REST_TOLERANCE: f64 = 1e-11;

/// Products below this fraction of the sum of the moduli of their terms count as zero.
const ZERO_TOLERANCE: f64 = 1e-12;

/// Eigenvalues above this fraction of the largest are resolved.
const LEAST_RESOLVED_RATIO: f64 = 1e-6;

/// Rounding error of eigenvalues, relative to the size of the matrix times its number of unknowns.
const ROUNDING: f64 = 1e-15;

/// Matrix entries below this fraction of the largest count as uncoupled.
const DECOUPLED: f64 = 1e-14;

/// The reason why a model has no steady state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NoSteadyState {
    /// The key of the scene that is at fault.
    pub key: &'static str,
    /// The problem, and a remedy.
    pub problem: String,
}

/// A rod at rest, in its flow and under its loads.
#[derive(Debug)]
pub struct SteadyState {
    dynamics: Dynamics,
    state: State,
}

/// A motion x = Re(φ e^{λt}) about the steady state.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenmode {
    /// Growth rate σ, 1/s: the motion grows if this is positive. It is zero within the bound of rounding.
    pub growth: f64,
    /// ω ≥ 0, rad/s.
    pub frequency: f64,
    /// Bound of the rounding error of λ, 1/s.
    pub uncertainty: f64,
    /// Real and imaginary part of φ, x and y of every node; the largest modulus is 1.
    pub shape: Vec<[[f64; 2]; 2]>,
    /// Real and imaginary part of the arc φL of a hinge; zero without one.
    pub arc: [f64; 2],
}

impl Eigenmode {
    /// Damping ratio ζ = −σ/|λ|.
    pub fn damping_ratio(&self) -> f64 {
        0.0 - self.growth / self.growth.hypot(self.frequency) // no −0
    }

    /// True if the motion grows, beyond rounding.
    pub fn grows(&self) -> bool {
        self.growth > 0.0
    }

    /// True if the mode moves the rod across the x axis more than along it.
    pub fn bends(&self) -> bool {
        let size = |axis: usize| self.shape.iter().map(|[re, im]| re[axis].powi(2) + im[axis].powi(2)).sum::<f64>();
        size(1) >= size(0)
    }
}

/// M, C and K over the free unknowns of one group that is decoupled from the others.
struct DecoupledGroup {
    unknowns: Vec<usize>,
    matrices: [Mat<f64>; 3],
    /// The rigid motions in these unknowns: of a free rod along x, along y, and rotation; of a rod on a hinge, rotation about it.
    rigid: Vec<Vec<f64>>,
}

/// Moves `state` to the rest state of `dynamics` that is reached by continuation: the forces that hold the rod in place are
/// removed in fractions, as large as Newton's method can follow, f(q) = (1 − s) f(q₀) with s from 0 to 1.
///
/// # Errors
/// [`Error::NotConverged`] if the continuation ends before the rest state; errors of [`System::assemble`].
pub(crate) fn continue_to_rest(dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
    let mut holding = vec![0.0; 2 * dynamics.nodes()];
    dynamics.assemble(state, &mut holding, None)?;
    let hinged = dynamics.model.hinge.is_some();
    // Without loads, a rod on a hinge without a servo rests at any angle.
    if hinged && holding.iter().all(|force| force.abs() <= dynamics.residual_floor(state)) {
        return Ok(());
    }
    // The angle of a hinge is held by a torque.
    let torque = if hinged { std::mem::take(&mut holding[0]) * dynamics.length() } else { 0.0 };
    let (own, own_torque) = (dynamics.inputs.force.take(), dynamics.inputs.hinge.torque);
    let mut from = state.clone();
    let (mut gone, mut part) = (0.0, 1.0);
    let ended = loop {
        let to = gone + part;
        let held = |(i, force): (usize, &f64)| own.as_ref().map_or(0.0, |own| own[i]) + (1.0 - to) * force;
        dynamics.inputs.force =
            if to < 1.0 { Some(holding.iter().enumerate().map(held).collect()) } else { own.clone() };
        if hinged {
            dynamics.inputs.hinge.torque = own_torque + (1.0 - to) * torque;
            dynamics.evaluate_at(state.t);
        }
        match newton.solve(dynamics, state, Direction::POSITIONS) {
            Ok(_) if to >= 1.0 => break Ok(()),
            Ok(_) => {
                from.copy_from(state);
                (gone, part) = (to, (2.0 * part).min(1.0 - to));
            }
            Err(error) if part <= LEAST_PART => break Err(error),
            Err(_) => {
                state.copy_from(&from);
                part *= 0.5;
            }
        }
    };
    dynamics.inputs.force = own;
    dynamics.inputs.hinge.torque = own_torque;
    ended
}

impl SteadyState {
    /// The steady state of `model` without its actuation, with its head held at its pose at time zero. A free rod moves with the
    /// flow and is described in its frame.
    ///
    /// # Errors
    /// [`NoSteadyState`] if there is no steady state, or none is found.
    pub fn of(model: Model) -> std::result::Result<Self, NoSteadyState> {
        Self::found(model, None)
    }

    /// The steady state next to `positions` (m, two entries per node).
    ///
    /// # Errors
    /// [`NoSteadyState`] if there is no steady state, or none is found.
    pub fn near(model: Model, positions: &[f64]) -> std::result::Result<Self, NoSteadyState> {
        Self::found(model, Some(positions))
    }

    fn found(model: Model, near: Option<&[f64]>) -> std::result::Result<Self, NoSteadyState> {
        let unsteady = |key: &'static str, problem: &str| NoSteadyState { key, problem: problem.to_string() };
        if let Some(law) = model.forces.global() {
            let found = law.name();
            let problem = format!(
                "{found:?} is nonlocal, and its matrix is not banded, as the eigenvalue solver requires; allowed: a local law, such as \"cox\""
            );
            return Err(unsteady("drag.law", &problem));
        }
        if model.tendons.iter().any(|tendon| tendon.winch().is_some()) {
            let problem = "a winch pulls a tendon, which couples all nodes along it; allowed: a constant tension_n";
            return Err(unsteady("tendons", problem));
        }
        let mut tensions = model.tendons.iter().map(|tendon| tendon.signal().constant());
        if tensions.clone().any(|tension| tension.is_none()) {
            return Err(unsteady("tendons", "a tension changes in time; allowed: constant ones"));
        }
        if model.head.is_none() && tensions.any(|tension| tension != Some(0.0)) {
            let problem = "tendons pull a free rod, whose equilibrium this analysis does not find; allowed: a held head, or no tension";
            return Err(unsteady("tendons", problem));
        }
        if model.flow.is_some() {
            let problem = "the flow changes in time; allowed: a steady one, as [1.0, 0.0]";
            return Err(unsteady("medium.flow_m_s", problem));
        }
        let mut model = rest::held_still(model);
        if model.head.is_none() {
            // A free rod moves with the flow, which must be uniform along it, or it does not rest.
            model.fluid.flow = Vector2::zeros();
            if let Some(layers) = &model.layers {
                let first = layers.at(model.fluid, layers.height(Vector2::zeros())).fluid.flow;
                model.fluid.flow = -first;
            }
        }
        let held = model.head.is_some();
        let mut dynamics = Dynamics::new(Arc::new(model));
        let nodes = dynamics.nodes();
        let load: Vec<f64> = (0..nodes).flat_map(|k| <[f64; 2]>::from(dynamics.load(k))).collect();
        let is_carried = |dynamics: &mut Dynamics| {
            let state = dynamics.first_state();
            let Ok(rod) = dynamics.shape(&state) else { return true };
            let mut others = rod.dynamics.model.forces.iter().filter(|force| !force.is_of_fluid());
            others.any(|force| resultant(force, &rod.kinematics()) != Vector2::zeros())
        };
        if !held && (load.iter().any(|force| *force != 0.0) || is_carried(&mut dynamics)) {
            let problem =
                "a free rod under loads has no equilibrium; hold its head (kind = \"clamped\"), or remove the loads";
            return Err(unsteady("head.kind", problem));
        }
        let torque =
            dynamics.model.hinge.as_ref().and_then(|hinge| hinge.torque.constant()).filter(|torque| *torque != 0.0);
        let key = if torque.is_some() { "head.torque_n_m" } else { "medium.flow_m_s" };
        let failed = |error: Error| {
            let problem = match torque {
                None => format!("no equilibrium is found in this flow and under these loads: {error}"),
                Some(torque) => format!(
                    "found {torque} N m, under which no equilibrium of the hinge is found: {error}; allowed: a torque that its servo, the flow or the loads hold, well below its limit"
                ),
            };
            unsteady(key, &problem)
        };
        let mut newton = Newton::new(nodes, REST_TOLERANCE).map_err(failed)?;
        let mut state = dynamics.first_state();
        if let Some(near) = near {
            state.q[..2 * nodes].copy_from_slice(near);
            continue_to_rest(&mut dynamics, &mut newton, &mut state).map_err(failed)?;
            return Ok(Self { dynamics, state });
        }
        if let (Some(layers), false) = (&dynamics.inputs.layers, held || dynamics.model.forces.is_empty()) {
            let flow = |k: usize| layers.at(dynamics.inputs.fluid, layers.height(node(&state.q, k))).fluid.flow.norm();
            let size = dynamics.inputs.fluid.flow.norm() + layers.shear.abs() * dynamics.model.rod.length;
            if (0..nodes).any(|k| flow(k) > ZERO_TOLERANCE * size) {
                let problem = "a free rod has no equilibrium in a flow that varies along it; hold its head (kind = \"clamped\"), or lay it along the flow";
                return Err(unsteady("medium", problem));
            }
        }
        if held {
            continue_to_rest(&mut dynamics, &mut newton, &mut state).map_err(failed)?;
        }
        Ok(Self { dynamics, state })
    }

    /// The model, without its drives.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The load on node `k`, N.
    pub fn load(&self, k: usize) -> Vector2<f64> {
        self.dynamics.load(k)
    }

    /// The trace of the added-mass block (kg) of every node, which does not depend on the direction of the rod.
    ///
    /// # Errors
    /// Errors of [`matrices`](Self::matrices).
    pub fn added_mass(&mut self) -> Result<Vec<f64>> {
        let [inertia, ..] = self.matrices()?;
        let Model { rod, hinge, .. } = &*self.dynamics.model;
        // The node held by a hinge has no rows.
        let has_rows = |k: usize| k > 0 || hinge.is_none();
        let added = |(k, m): (usize, &f64)| {
            let moved = inertia.entry(2 * k, 2 * k) + inertia.entry(2 * k + 1, 2 * k + 1) - 2.0 * m;
            if has_rows(k) { moved } else { 0.0 }
        };
        Ok(rod.mass.iter().enumerate().map(added).collect())
    }

    /// Positions at rest, m, two entries per node.
    pub fn positions(&self) -> &[f64] {
        &self.state.q[..2 * self.dynamics.nodes()]
    }

    /// Largest displacement of a node from the straight rod, m.
    pub fn bend(&mut self) -> f64 {
        let straight = self.dynamics.first_state();
        let nodes = self.dynamics.nodes();
        (0..nodes).map(|k| (node(&self.state.q, k) - node(&straight.q, k)).norm()).fold(0.0, f64::max)
    }

    /// M, C and K of all nodes, including that of a held head; for a hinge, the arc takes the place of the node.
    ///
    /// # Errors
    /// Errors of [`System::assemble`].
    pub fn matrices(&mut self) -> Result<[BandMatrix; 3]> {
        let mut along = |direction: Direction| rest::derivative(&mut self.dynamics, &self.state, direction);
        Ok([along(Direction::ACCELERATIONS)?, along(Direction::VELOCITIES)?, along(Direction::POSITIONS)?])
    }

    /// The free unknowns in groups without coupling: x and y for a straight rod along an axis, otherwise one group.
    fn groups(&mut self) -> Result<Vec<DecoupledGroup>> {
        let nodes = self.dynamics.nodes();
        let free = FreeUnknowns::of(&self.dynamics.model);
        let bands = self.matrices()?;
        let entry = |matrix: &BandMatrix, i: usize, j: usize| {
            if matrix.coupled(i / 2).contains(&(j / 2)) { matrix.entry(i, j) } else { 0.0 }
        };
        let coupled = |matrix: &BandMatrix| {
            let (mut across, mut all) = (0.0_f64, 0.0_f64);
            for i in free.all() {
                for j in matrix.coupled(i / 2).flat_map(|k| [2 * k, 2 * k + 1]).filter(|j| free.contains(*j)) {
                    let size = matrix.entry(i, j).abs();
                    all = all.max(size);
                    across = if free.axis(i) == free.axis(j) { across } else { across.max(size) };
                }
            }
            across > DECOUPLED * all
        };
        let groups = if bands.iter().any(coupled) {
            vec![free.all().collect()]
        } else {
            [1, 0].map(|axis| free.along(axis).collect()).to_vec()
        };
        // About the middle, so that rotation is as far from translation as possible; about the hinge if there is one.
        let model = &self.dynamics.model;
        let centre = if free.hinged { node(&self.state.q, 0) } else { model.rod.mean(&self.state.q) };
        let q: Vec<f64> = self.state.q[..2 * nodes].iter().enumerate().map(|(i, x)| x - centre[i % 2]).collect();
        let group = |unknowns: Vec<usize>| {
            let dense = |matrix: &BandMatrix| {
                Mat::from_fn(unknowns.len(), unknowns.len(), |i, j| entry(matrix, unknowns[i], unknowns[j]))
            };
            let motion = |of: &dyn Fn(usize) -> f64| unknowns.iter().map(|i| of(*i)).collect::<Vec<f64>>();
            let along = |axis: usize| motion(&|i| f64::from(u8::from(i % 2 == axis)));
            let turning = motion(&|i| match i {
                _ if free.is_arc(i) => model.rod.length,
                _ if i % 2 == 0 => -q[i + 1],
                _ => q[i - 1],
            });
            let mut rigid = match free.first {
                0 => vec![along(0), along(1), turning],
                _ if free.turns_freely => vec![turning],
                _ => Vec::new(),
            };
            rigid.retain(|motion| motion.iter().any(|x| *x != 0.0));
            DecoupledGroup { matrices: bands.each_ref().map(dense), unknowns, rigid }
        };
        Ok(groups.into_iter().map(group).collect())
    }

    fn failed(&self, reason: &impl std::fmt::Debug) -> Error {
        Error::Linear { unknowns: 2 * self.state.q.len(), reason: format!("its eigenvalues: {reason:?}") }
    }

    /// λ = σ + iω with ω ≥ 0 of every motion that is restored or damped, each with the bound of its rounding error (1/s);
    /// unsorted.
    ///
    /// # Errors
    /// [`Error::Linear`] if the iteration does not converge; errors of [`matrices`](Self::matrices).
    pub fn eigenvalues(&mut self) -> Result<Vec<(c64, f64)>> {
        let mut found = Vec::new();
        for group in self.groups()? {
            let pencil = Pencil::of(&group);
            let values = |matrix: &Mat<f64>| matrix.eigenvalues().map_err(|e| self.failed(&e));
            let fast = values(&pencil.direct)?;
            let slow = pencil.inverse_for_slow_motions(&fast).map(values).transpose()?;
            found.extend(
                pencil.joined(&fast, slow.as_deref()).into_iter().map(|(value, uncertainty, _)| (value, uncertainty)),
            );
        }
        Ok(found)
    }

    /// All motions that are restored or damped, the slowest first.
    ///
    /// # Errors
    /// Errors of [`eigenvalues`](Self::eigenvalues).
    pub fn eigenmodes(&mut self) -> Result<Vec<Eigenmode>> {
        let (nodes, free) = (self.dynamics.nodes(), FreeUnknowns::of(&self.dynamics.model));
        let mut found = Vec::new();
        for group in self.groups()? {
            let pencil = Pencil::of(&group);
            let pairs = |matrix: &Mat<f64>| matrix.eigen().map_err(|e| self.failed(&e));
            let fast = pairs(&pencil.direct)?;
            let values = |pairs: &Eigen<f64>| (0..pairs.S().dim()).map(|j| pairs.S()[j]).collect::<Vec<c64>>();
            let slow = pencil.inverse_for_slow_motions(&values(&fast)).map(pairs).transpose()?;
            for (value, uncertainty, from) in pencil.joined(&values(&fast), slow.as_ref().map(values).as_deref()) {
                let vectors = match (from, &slow) {
                    (From::Inverse(j), Some(slow)) => (slow.U(), j),
                    (From::Direct(j) | From::Inverse(j), _) => (fast.U(), j),
                };
                let entries: Vec<c64> = (0..pencil.places.ncols()).map(|i| vectors.0[(i, vectors.1)]).collect();
                // Positions of the unknowns: those without rigid motion; for a motion that is purely rigid, from its rate.
                let place = |i: usize| (0..entries.len()).map(|j| entries[j] * pencil.places[(i, j)]).sum::<c64>();
                let mut places: Vec<c64> = (0..group.unknowns.len()).map(place).collect();
                if let Some(rates) = pencil.rates_of(&vectors.0, vectors.1) {
                    // With rigid motion: x = ẋ/λ.
                    places = rates.into_iter().map(|rate| rate / value).collect();
                }
                let largest =
                    places.iter().fold(c64::new(0.0, 0.0), |max, x| if x.norm() > max.norm() { *x } else { max });
                let (mut shape, mut arc) = (vec![[[0.0; 2]; 2]; nodes], [0.0; 2]);
                for (x, unknown) in places.iter().zip(&group.unknowns) {
                    let x = x / largest;
                    if free.is_arc(*unknown) {
                        arc = [x.re, x.im];
                    } else {
                        shape[unknown / 2][0][unknown % 2] = x.re;
                        shape[unknown / 2][1][unknown % 2] = x.im;
                    }
                }
                let growth = if value.re.abs() <= uncertainty { 0.0 } else { value.re };
                found.push(Eigenmode { growth, frequency: value.im, uncertainty, shape, arc });
            }
        }
        found.sort_by(|a, b| a.growth.hypot(a.frequency).total_cmp(&b.growth.hypot(b.frequency)));
        Ok(found)
    }
}

/// True if a motion with λ = `value` grows, for a rounding error of `uncertainty` (1/s).
pub fn grows(value: c64, uncertainty: f64) -> bool {
    value.re > uncertainty
}

/// The matrix and the index of an eigenvalue.
#[derive(Debug, Clone, Copy)]
enum From {
    Direct(usize),
    Inverse(usize),
}

/// The first-order form of M ẍ + C ẋ + K x = 0 without unrestored motions: x = Q z and ẋ = P w.
struct Pencil {
    /// Q: positions orthogonal to rigid motions without restoring force.
    places: Mat<f64>,
    /// P: velocities orthogonal to rigid motions without damping force either.
    velocities: Mat<f64>,
    /// A/Ω in the unknowns (z, w/Ω).
    direct: Mat<f64>,
    /// Ω, 1/s.
    scale: f64,
    /// A⁻¹ω in the unknowns (z, w/ω), and ω, 1/s, if no unrestored motion is left.
    inverse: Option<Mat<f64>>,
    inverse_scale: f64,
}

impl Pencil {
    fn of(group: &DecoupledGroup) -> Self {
        let DecoupledGroup { matrices: [mass, damping, stiffness], rigid, .. } = group;
        let n = mass.nrows();
        let free: Vec<&Vec<f64>> = rigid.iter().filter(|motion| vanishes(stiffness, motion)).collect();
        let undamped: Vec<&Vec<f64>> = free.iter().copied().filter(|motion| vanishes(damping, motion)).collect();
        let places = complement(n, &free.iter().map(|motion| motion.to_vec()).collect::<Vec<_>>());
        // Without drag momentum is conserved: velocities are restricted to zero momentum, Rᵀ M ẋ = 0.
        let momenta: Vec<Vec<f64>> = undamped
            .iter()
            .map(|motion| (0..n).map(|j| (0..n).map(|i| motion[i] * mass[(i, j)]).sum()).collect())
            .collect();
        let velocities = complement(n, &momenta);
        let (p, q) = (places.ncols(), velocities.ncols());
        let factors = mass.partial_piv_lu();
        let held = velocities.transpose() * factors.solve(stiffness * &places);
        let damped = velocities.transpose() * factors.solve(damping * &velocities);
        let carried = places.transpose() * &velocities;
        let row = |matrix: &Mat<f64>, i: usize| (0..matrix.ncols()).map(|j| matrix[(i, j)].abs()).sum::<f64>();
        let norm = |matrix: &Mat<f64>| (0..matrix.nrows()).map(|i| row(matrix, i)).fold(f64::MIN_POSITIVE, f64::max);
        let scale = norm(&held).sqrt();
        let direct = Mat::from_fn(p + q, p + q, |i, j| match (i < p, j < p) {
            (true, true) => 0.0,
            (true, false) => carried[(i, j - p)],
            (false, true) => -held[(i - p, j)] / (scale * scale),
            (false, false) => -damped[(i - p, j - p)] / scale,
        });
        // A⁻¹ from K and not from M⁻¹K: K Q z' + C P w' = −M P w, Qᵀ P w' = z, in the range of both.
        let project = if undamped.is_empty() { Mat::identity(n, n) } else { velocities.transpose().to_owned() };
        let rows = project.nrows();
        let inverse = (rows + p == p + q).then(|| {
            let (k, c, m) =
                (&project * stiffness * &places, &project * damping * &velocities, &project * mass * &velocities);
            let size = [norm(&k), norm(&c), norm(&m)];
            let [k_size, ..] = size;
            let m_scale = (norm(&m) / k_size).sqrt().max(f64::MIN_POSITIVE);
            // Rows scaled by the size of K, velocities by ω = √(K/M).
            let system = Mat::from_fn(rows + p, p + q, |i, j| match (i < rows, j < p) {
                (true, true) => k[(i, j)] / k_size,
                (true, false) => c[(i, j - p)] / (k_size * m_scale),
                (false, true) => 0.0,
                (false, false) => carried[(i - rows, j - p)],
            });
            let right = Mat::from_fn(rows + p, p + q, |i, j| match (i < rows, j < p) {
                (true, true) => 0.0,
                (true, false) => -m[(i, j - p)] / (k_size * m_scale * m_scale),
                (false, true) => f64::from(u8::from(i - rows == j)),
                (false, false) => 0.0,
            });
            (system.partial_piv_lu().solve(&right), m_scale.recip())
        });
        let inverse = inverse.filter(|(matrix, _)| (0..p + q).all(|j| (0..p + q).all(|i| matrix[(i, j)].is_finite())));
        let inverse_scale = inverse.as_ref().map_or(1.0, |(_, scale)| *scale);
        Self { places, velocities, direct, scale, inverse: inverse.map(|(matrix, _)| matrix), inverse_scale }
    }

    /// The matrix for the slow motions, if some eigenvalues of A/Ω are so small that rounding errors may matter.
    fn inverse_for_slow_motions(&self, fast: &[c64]) -> Option<&Mat<f64>> {
        let sizes = || fast.iter().map(|value| value.norm());
        let wide = sizes().fold(f64::INFINITY, f64::min) < LEAST_RESOLVED_RATIO * sizes().fold(0.0, f64::max);
        self.inverse.as_ref().filter(|_| wide)
    }

    /// All eigenvalues λ with ω ≥ 0, from those of A/Ω and of A⁻¹ω, each with the bound of its rounding error.
    fn joined(&self, fast: &[c64], slow: Option<&[c64]>) -> Vec<(c64, f64, From)> {
        let count = fast.len();
        let part = ROUNDING * count as f64;
        let mut direct: Vec<(c64, f64, From)> =
            fast.iter().enumerate().map(|(j, value)| (value * self.scale, 0.0, From::Direct(j))).collect();
        direct.sort_by(|a, b| a.0.norm().total_cmp(&b.0.norm()));
        let largest = direct.last().map_or(0.0, |last| last.0.norm());
        direct.iter_mut().for_each(|(_, uncertainty, _)| *uncertainty = part * largest);
        let mut inverse: Vec<(c64, f64, From)> = slow
            .unwrap_or_default()
            .iter()
            .enumerate()
            .map(|(j, value)| (c64::new(self.inverse_scale, 0.0) / value, 0.0, From::Inverse(j)))
            .collect();
        inverse.sort_by(|a, b| a.0.norm().total_cmp(&b.0.norm()));
        let least = inverse.first().map_or(0.0, |first| first.0.norm());
        for (value, uncertainty, _) in &mut inverse {
            *uncertainty = part * value.norm_sqr() / least;
        }
        // Switches where both are equally uncertain, and keeps conjugates together.
        let middle = (largest * least).sqrt();
        let mut taken = inverse.iter().take_while(|(value, ..)| value.norm() < middle).count();
        let conjugate = |i: usize| {
            let [a, b] = [inverse.get(i.wrapping_sub(1)), inverse.get(i)];
            a.zip(b).is_some_and(|(a, b)| {
                a.0.im != 0.0 && a.0.im * b.0.im < 0.0 && (a.0 - b.0.conj()).norm() <= 1e-6 * a.0.norm()
            })
        };
        if conjugate(taken) && inverse[..taken].iter().filter(|(value, ..)| value.im != 0.0).count() % 2 == 1 {
            taken += 1;
        }
        let all = inverse.into_iter().take(taken).chain(direct.into_iter().skip(taken));
        // Without the inverse, eigenvalues that cannot be distinguished from zero count as unrestored motions.
        let kept = |(value, uncertainty, _): &(c64, f64, From)| {
            value.im > -f64::MIN_POSITIVE && (slow.is_some() || value.norm() > *uncertainty)
        };
        all.filter(kept).collect()
    }

    /// The velocities of eigenvector `j`, if rigid motion is excluded from the positions.
    fn rates_of(&self, vectors: &MatRef<'_, c64>, j: usize) -> Option<Vec<c64>> {
        let (n, p) = (self.places.nrows(), self.places.ncols());
        (p < n).then(|| {
            let rate =
                |i: usize| (0..self.velocities.ncols()).map(|k| vectors[(p + k, j)] * self.velocities[(i, k)]).sum();
            (0..n).map(rate).collect()
        })
    }
}

/// True if `matrix` times a rigid `motion` is zero to rounding.
fn vanishes(matrix: &Mat<f64>, motion: &[f64]) -> bool {
    (0..matrix.nrows()).all(|i| {
        let terms = || (0..matrix.ncols()).map(|j| matrix[(i, j)] * motion[j]);
        terms().sum::<f64>().abs() <= ZERO_TOLERANCE * terms().map(f64::abs).sum::<f64>()
    })
}

/// An orthonormal basis of the orthogonal complement of `vectors`; the identity if there are none.
fn complement(n: usize, vectors: &[Vec<f64>]) -> Mat<f64> {
    if vectors.is_empty() {
        return Mat::identity(n, n);
    }
    let spanned = Mat::from_fn(n, vectors.len(), |i, j| {
        let norm = vectors[j].iter().map(|x| x * x).sum::<f64>().sqrt();
        vectors[j][i] / norm
    });
    let q = spanned.qr().compute_Q();
    Mat::from_fn(n, n - vectors.len(), |i, j| q[(i, vectors.len() + j)])
}
