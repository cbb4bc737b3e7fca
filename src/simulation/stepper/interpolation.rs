//! Interpolation of the state within a step from the states at its ends, as accurate as those states for any stiffness of the
//! rod.
//!
//! Motions are smooth, so cubics of values and rates give the positions. Forces are not computed from such positions: the error
//! of a cubic, however small, stretches and bends a stiff rod by far more than the forces that act on it. Instead, forces are
//! interpolated linearly between the ends and corrected by balance, from inertia, drag and loads alone: N and M of the edges and
//! joints for which M a − F vanishes on all nodes beyond them. If the rod is so soft that moments are small differences of large
//! ones, the correction of the linear moment from the directions at the joint itself is as accurate; the smaller of the two is
//! used. The links of the state hold these forces, and its edges have the lengths that follow from their tensions.

use nalgebra::Vector2;

use crate::error::Result;
use crate::fluid::FluidRuns;
use crate::model::{Dynamics, Mechanics};
use crate::rod::damping::{KelvinVoigt, StrainRates};
use crate::rod::{Edge, bend, node};
use crate::system::{Link, State, System};
use crate::tendons::MAX_TENDONS;

/// Largest deviation of the rates at the ends of a step from the mean rate, as rotations (rad) and lengths over L over the step;
/// larger rates are not representative of the step. Where a step resolves the motion the deviation is about (ωh)²/2.
const MAX_RATE_DEVIATION: f64 = 0.5;

/// The same for accelerations, as changes of velocity relative to the largest velocity at the ends; for a rod that starts from
/// rest with v ∝ tⁿ the deviation is n − 1.
const MAX_ACCELERATION_DEVIATION: f64 = 4.0;

/// Fraction of an edge's EA above which a compression is not computed from balance.
const MAX_COMPRESSION: f64 = 0.5;

/// A time within a step, for cubic Hermite interpolation between its ends.
#[derive(Debug, Clone, Copy)]
struct StepFraction {
    /// Fraction of the step before this time.
    z: f64,
    /// Size of the step, s.
    h: f64,
}

impl StepFraction {
    /// Linear interpolation between the values at the ends.
    fn linear(self, from: f64, to: f64) -> f64 {
        from + self.z * (to - from)
    }

    /// The cubic with these values and rates at the ends, and its rate; the rates times h are limited to within `limit` of the
    /// change.
    fn cubic(self, [from, to]: [f64; 2], rates: [f64; 2], limit: f64) -> [f64; 2] {
        let Self { z, h } = self;
        let change = to - from;
        let [a, b] = rates.map(|rate| (rate * h - change).max(-limit).min(limit));
        let rest = 1.0 - z;
        let value = from + z * (change + rest * (rest * a - z * b));
        [value, (change + rest * (1.0 - 3.0 * z) * a - z * (2.0 - 3.0 * z) * b) / h]
    }
}

/// Tension and shear (N) of every edge and m_k (N m) of every joint.
#[derive(Debug, Default)]
struct InternalForces {
    tension: Vec<f64>,
    /// F·n, to the left of the edge.
    shear: Vec<f64>,
    moment: Vec<f64>,
    runs: FluidRuns,
}

impl InternalForces {
    /// Computes the forces of a rod with these `edges` and curvatures `bent` that moves as in `state`: from balance, independent
    /// of EA and EI.
    fn balance(&mut self, dynamics: &Dynamics, edges: &[Edge], bent: &[f64], state: &State, applied: &mut Vec<f64>) {
        let rod = &dynamics.model.rod;
        applied.resize(state.q.len(), 0.0);
        let State { t, q, v, a, .. } = state;
        dynamics.write_applied(&dynamics.kinematics_of(*t, edges, [q, v, a]).found(&mut self.runs), applied);
        self.tension.resize(edges.len(), 0.0);
        self.shear.resize(edges.len(), 0.0);
        self.moment.resize(rod.nodes, 0.0);
        let (mut force, mut couple) = (Vector2::zeros(), 0.0);
        for k in (0..rod.nodes).rev() {
            if let Some(edge) = edges.get(k) {
                (self.tension[k], self.shear[k]) = (edge.t.dot(&force), edge.n().dot(&force));
                couple += edge.length * self.shear[k];
            }
            let joint = rod.joints().contains(&k);
            self.moment[k] = if joint { couple / bend::curvature_per_turning(bent[k]) } else { 0.0 };
            force -= node(&state.a, k) * rod.mass[k] + node(applied, k);
        }
    }
}

/// The geometry of a rod at one time.
#[derive(Debug, Default)]
struct InterpolatedRod {
    edges: Vec<Edge>,
    /// Natural curvature κ̄_k.
    natural: Vec<f64>,
    /// Curvature κ_k from the directions of the edges.
    bent: Vec<f64>,
    /// Rates of strain of a damped rod.
    rates: Option<StrainRates>,
    /// Internal forces by balance alone.
    balance: InternalForces,
}

impl InterpolatedRod {
    /// Copies κ̄ from `dynamics`, which must be at the same time, and computes the curvatures of the edges.
    fn bend(&mut self, dynamics: &Dynamics) {
        self.natural.clone_from(&dynamics.natural);
        self.bent.resize(dynamics.model.rod.nodes, 0.0);
        let mut before = dynamics.held.map(|[_, _, angle]| Vector2::new(angle.value.cos(), angle.value.sin()));
        for (bent, edge) in self.bent.iter_mut().zip(&self.edges) {
            *bent = before.map_or(0.0, |before| bend::curvature(before, edge.t));
            before = Some(edge.t);
        }
    }
}

/// An end of a step, with the internal forces of its state.
#[derive(Debug, Default)]
struct StepEnd {
    rod: InterpolatedRod,
    /// Internal forces of its state.
    forces: InternalForces,
    /// Tensions of the tendons, N.
    tensions: [f64; MAX_TENDONS],
}

impl StepEnd {
    fn read(&mut self, dynamics: &mut Dynamics, state: &State, applied: &mut Vec<f64>) -> Result<()> {
        dynamics.evaluate_at(state.t);
        let bent = dynamics.shape(state)?;
        let (dynamics, kappa) = (bent.dynamics, bent.kappa());
        let Self { rod, forces, tensions } = self;
        *tensions = dynamics.tensions[0];
        rod.edges.clear();
        rod.edges.extend_from_slice(bent.edges());
        rod.bend(dynamics);
        let of = &dynamics.model.rod;
        let deviations = kappa.iter().zip(&rod.natural).map(|(kappa, natural)| kappa - natural);
        forces.moment.clear();
        forces.moment.extend(deviations.zip(&of.joint).map(|(deviation, stiffness)| stiffness * deviation));
        if let Some(damped) = dynamics.damped() {
            of.joints().for_each(|k| forces.moment[k] += damped.moment_of_rate(of, k));
        }
        let couple = |k: usize| forces.moment[k] * bend::curvature_per_turning(kappa[k]);
        forces.tension.clear();
        forces.shear.clear();
        for (k, edge) in rod.edges.iter().enumerate() {
            let [along, across] = match state.links.get(k) {
                Some(link) => [edge.t, edge.n()].map(|axis| axis.dot(&Vector2::from(link.force))),
                None => {
                    let shear = (couple(k) - couple(k + 1)) * edge.per_length;
                    [bent.tension(k), shear]
                }
            };
            forces.tension.push(along);
            forces.shear.push(across);
        }
        rod.balance.balance(dynamics, &rod.edges, &rod.bent, state, applied);
        Ok(())
    }
}

/// The ends of the last step, for interpolation.
#[derive(Debug, Default)]
pub(super) struct StepInterpolation {
    ends: [StepEnd; 2],
    /// True if the ends are those of the last step.
    known: bool,
    now: InterpolatedRod,
    applied: Vec<f64>,
}

impl StepInterpolation {
    /// Discards the step, because another one is made.
    pub(super) fn forget(&mut self) {
        self.known = false;
    }

    /// Writes the state at time `t` (s) of the step from `from` to `to`, with links, to `out`; leaves `dynamics` at `t`.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`], but never for an accepted step.
    pub(super) fn write(
        &mut self,
        dynamics: &mut Dynamics,
        [from, to]: [&State; 2],
        t: f64,
        out: &mut State,
    ) -> Result<()> {
        let Self { ends, known, now, applied } = self;
        if !*known {
            ends[0].read(dynamics, from, applied)?;
            ends[1].read(dynamics, to, applied)?;
            *known = true;
        }
        let [first, last] = &*ends;
        let h = to.t - from.t;
        let fraction = StepFraction { z: (t - from.t) / h, h };
        out.q.resize(from.q.len(), 0.0);
        interpolate_motion(dynamics, [from, to], fraction, out);
        dynamics.move_to(t, out);
        now.edges.clear();
        for (k, (a, b)) in first.rod.edges.iter().zip(&last.rod.edges).enumerate() {
            let spin = |edge: &Edge, v: &[f64]| edge.n().dot(&(node(v, k + 1) - node(v, k))) * edge.per_length;
            let turn = a.t.perp(&b.t).atan2(a.t.dot(&b.t));
            let [angle, _] = fraction.cubic([0.0, turn], [spin(a, &from.v), spin(b, &to.v)], MAX_RATE_DEVIATION);
            let (sin, cos) = angle.sin_cos();
            now.edges.push(Edge::along(a.t * cos + a.n() * sin, fraction.linear(a.length, b.length)));
        }
        now.bend(dynamics);
        let tensions = std::array::from_fn(|i| fraction.linear(first.tensions[i], last.tensions[i]));
        if dynamics.give_tensions(tensions) {
            now.natural.clone_from(&dynamics.natural);
        }
        place_nodes(dynamics, &now.edges, [from, to], fraction, out);
        now.balance.balance(dynamics, &now.edges, &now.bent, out, applied);
        let rod = &dynamics.model.rod;
        // The correction of linear interpolation is bounded by the values at the ends.
        let pull = |forces: &InternalForces| super::largest(&forces.tension).max(super::largest(&forces.shear));
        let pulls = [pull(&first.forces), pull(&last.forces)];
        let couples = [&first.forces, &last.forces].map(|forces| super::largest(&forces.moment));
        let [pull, couple] = [pulls, couples].map(|[a, b]| a.max(b));
        if let Some(damping) = &rod.damping {
            let rates = now.rates.get_or_insert_with(|| StrainRates::zeros(rod.nodes, 0.0));
            rates.read_edges(&now.edges, out.v.as_chunks().0);
            rates.clamp_spin = dynamics.held.map_or(0.0, |[_, _, angle]| angle.rate);
            rates.read_joints(rod.joints(), &rod.joint, damping, &now.bent, &dynamics.natural_rate);
        }
        let damped = || KelvinVoigt::of(rod.damping.as_ref(), now.rates.as_ref());
        out.links.clear();
        out.links.resize(rod.nodes, Link::default());
        for k in rod.joints() {
            let line = |of: fn(&StepEnd) -> &[f64]| fraction.linear(of(first)[k], of(last)[k]);
            let stiffness = rod.joint[k];
            let by_balance = now.balance.moment[k] - line(|end| &end.rod.balance.moment);
            let by_natural = now.natural[k] - line(|end| &end.rod.natural);
            let by_shape = stiffness * (now.bent[k] - line(|end| &end.rod.bent) - by_natural);
            let more = if by_shape.abs() < by_balance.abs() { by_shape } else { by_balance };
            let moment = line(|end| &end.forces.moment) + more.max(-couple).min(couple);
            let bending = damped().map_or(moment, |damped| moment - damped.moment_of_rate(rod, k));
            let curvature = now.natural[k] + bending / stiffness;
            let link = &mut out.links[k];
            (link.curvature, link.moment) = (curvature, moment * bend::curvature_per_turning(curvature));
        }
        let stretching =
            |tension: f64, k: usize| damped().map_or(tension, |damped| tension - damped.tension_of_rate(rod, k));
        for (k, edge) in now.edges.iter_mut().enumerate() {
            let line = |of: fn(&StepEnd) -> &[f64]| fraction.linear(of(first)[k], of(last)[k]);
            let sound = line(|end| &end.forces.tension);
            let more = now.balance.tension[k] - line(|end| &end.rod.balance.tension);
            let sum = sound + more.max(-pull).min(pull);
            let cell = &rod.cells[k];
            let tension = if sum > -MAX_COMPRESSION * cell.axial * cell.rest { sum } else { sound };
            *edge = Edge::along(edge.t, cell.length(stretching(tension, k)));
            let more = now.balance.shear[k] - line(|end| &end.rod.balance.shear);
            let shear = line(|end| &end.forces.shear) + more.max(-pull).min(pull);
            let link = &mut out.links[k];
            link.force = (edge.t * tension + edge.n() * shear).into();
            link.angle = edge.t.y.atan2(edge.t.x);
        }
        place_nodes(dynamics, &now.edges, [from, to], fraction, out);
        Ok(())
    }
}

/// Writes the nodes of these `edges` to `out`. The position of a held head, or of the centre of mass of a free rod, is the cubic
/// of its positions and velocities at the ends.
fn place_nodes(dynamics: &Dynamics, edges: &[Edge], ends: [&State; 2], fraction: StepFraction, out: &mut State) {
    let rod = &dynamics.model.rod;
    let mut here = node(&out.q, 0);
    for (q, edge) in out.q.as_chunks_mut().0.iter_mut().skip(1).zip(edges) {
        here += edge.t * edge.length;
        *q = here.into();
    }
    if dynamics.held.is_none() {
        let [x, v] = [ends.map(|end| rod.mean(&end.q)), ends.map(|end| rod.mean(&end.v))];
        let mean = rod.mean(&out.q);
        let shift = [0, 1].map(|i| {
            let [value, _] = fraction.cubic(x.map(|x| x[i]), v.map(|v| v[i]), MAX_RATE_DEVIATION * rod.length);
            value - mean[i]
        });
        for q in out.q.as_chunks_mut::<2>().0 {
            *q = [q[0] + shift[0], q[1] + shift[1]];
        }
    }
}

/// Writes velocities and accelerations, and the arc of a hinge, to `out`: the cubic of velocities and accelerations, and its
/// rate. Without inertia, where velocities follow from positions: the rate of the cubic of positions and velocities, and zero.
fn interpolate_motion(dynamics: &Dynamics, [from, to]: [&State; 2], fraction: StepFraction, out: &mut State) {
    let inertia = dynamics.mechanics != Mechanics::Overdamped;
    let limit = if inertia {
        MAX_ACCELERATION_DEVIATION * super::largest(&from.v).max(super::largest(&to.v))
    } else {
        MAX_RATE_DEVIATION * dynamics.model.rod.length
    };
    for i in 0..from.q.len() {
        let [v, a] = if inertia {
            fraction.cubic([from.v[i], to.v[i]], [from.a[i], to.a[i]], limit)
        } else {
            [fraction.cubic([from.q[i], to.q[i]], [from.v[i], to.v[i]], limit)[1], 0.0]
        };
        (out.v[i], out.a[i]) = (v, a);
    }
    // The arc of a hinge is not a position of a node, which would follow from the edges.
    for i in 2 * dynamics.model.rod.nodes..from.q.len() {
        let limit = MAX_RATE_DEVIATION * dynamics.model.rod.length;
        out.q[i] = fraction.cubic([from.q[i], to.q[i]], [from.v[i], to.v[i]], limit)[0];
    }
}
