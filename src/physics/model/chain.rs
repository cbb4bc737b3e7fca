//! The chain form: the same discrete rod with moments, forces and edge directions as additional unknowns.
//!
//! Newton's method in nodal positions adds EI/ΔL³ to m/Δt², and computes curvature from positions of size L. Its
//! relative rounding error is about 16ε(λ/ΔL)⁴ ([`rounding`]), and on the finest meshes it fails. The chain form never
//! computes EI/ΔL³. The energy with multipliers F_k, E = Σ ½B(κ−κ̄)² + Σ F·(Δx − ℓt) + Σ ½ΔL (F·t)²/EA with
//! ℓ = ΔL(1 + F·t/EA), is stationary if
//!
//! - at node k, m a + ΣF − W − F_k + F_{k−1} = 0;
//! - at its joint, M = B(κ−κ̄)s with κ = 2 tan(φ/2), φ = θ_k − θ_{k−1}, s = dκ/dφ = 1 + κ²/4; M = 0 where there is
//!   none;
//! - along edge k, ℓ t = x_{k+1} − x_k;
//! - for the moments on edge k, M_{k+1} − M_k + ℓ F·n = 0.
//!
//! Eliminating M, F and θ recovers the equations in positions, so the results are identical except for rounding.
//! Rounding of x and θ is absorbed within one unit in their last place, while M and F stay smooth: curvature is
//! computed from M, stretching from F·t, directions from θ, and nothing from differences of positions.
//!
//! A damped material adds τ times the rates: ℓ = ΔL(1 + F·t/EA) − τ ℓ̇ and M = (B(κ−κ̄) + Bτ r)s. Along a direction, ℓ̇
//! and the angular velocities are computed from ė + (c_v/c_q)(ℓt − Δx), which is ė if the edge is closed. The rotation
//! of edges is thus computed from their directions, not from differences of rounded positions. The matrix omits the
//! effects of a turning edge on ℓ̇ and of a stretching edge on ω, which are as small as the turning within a step.
//!
//! The rows are scaled to forces by EI and L, so that sizes are comparable and pivots do not depend on the units. Along
//! a direction that moves no position (c_q = 0: the accelerations at the start) the edges keep direction and stretch,
//! and the joints curvature.

use nalgebra::{Matrix2, Rotation2, Vector2};

use super::{COLLAPSED, Dynamics, Model, move_arc_back};
use crate::error::{Error, Result};
use crate::head::hinge::HingeResidual;
use crate::linear::{ChainMatrix, ChainRow, ChainTerms, Direction};
use crate::rod::damping::{EdgeRate, KelvinVoigt};
use crate::rod::{Edge, Rod, bend, node};
use crate::system::{Form, Link, RankOne, State};
use crate::tendons::MAX_TENDONS;

/// Largest bound [`rounding`] of one solve for which positions are used. Newton's method refines: at this value
/// positions and steps agree with the chain form to about 1e-15, moments to 1e-5, without additional iterations; from
/// ten times this value on, more iterations are needed.
pub const ACCURACY: f64 = 1e-3;

/// Newton's method in nodal positions contracts while ΔL is above the first fraction of the length λ that a step bends, and is
/// meaningless below the second (measured, for steps of 1e-5 … 1e-3 s and at rest).
const MIN_SPACING: [f64; 2] = [2e-4, 5e-5];

/// Below this half of a turning angle, its tangent is summed from its series; the first omitted term is below ε/8.
const MAX_SERIES_HALF_TURNING: f64 = 0.01;

/// The length λ = min((EI Δt²/ρA)^¼, L/2) (m) over which the rod bends in a step of `time_step` (s).
pub fn bent_length(rod: &Rod, time_step: f64) -> f64 {
    let line_density = rod.mass[rod.front + 1] / rod.spacing;
    (rod.ei * time_step * time_step / line_density).powf(0.25).min(0.5 * rod.length)
}

/// Bound on the relative rounding error of one solve of Newton's method in positions: 16ε(λ/ΔL)⁴, times (ΔL/b)² if the
/// length b of a neck is less than ΔL. Further iterations refine a time step as long as this is below about 1e-2. Then
/// the error of curvature is only about ε(L/ΔL)², and that of moments is κ/(κ−κ̄) times as large (measured at 129 …
/// 8193 nodes: 1e-14 … 3e-9 and 1e-14 … 1e-4).
pub fn rounding(rod: &Rod, time_step: f64) -> f64 {
    let lever = rod.spacing / rod.shortest();
    16.0 * f64::EPSILON * (bent_length(rod, time_step) / rod.spacing).powi(4) * lever * lever
}

/// True if Newton's method in nodal positions contracts for steps of `time_step` (s) of `rod`.
pub fn contracts(rod: &Rod, time_step: f64) -> bool {
    rod.spacing >= MIN_SPACING[0] * bent_length(rod, time_step)
}

/// True if Newton's method in nodal positions finds only rounding errors for such steps.
pub fn is_meaningless(rod: &Rod, time_step: f64) -> bool {
    rod.spacing < MIN_SPACING[1] * bent_length(rod, time_step)
}

/// The reason why such steps cannot be solved in nodal positions; `None` if they [contract](contracts).
pub fn too_fine(rod: &Rod, time_step: f64) -> Option<String> {
    let bent = bent_length(rod, time_step);
    (!contracts(rod, time_step)).then(|| {
        format!(
            "found {}; the mesh is too fine to solve for positions: its spacing is {:.1e} of the length that a step bends, and Newton's method requires at least {:e}; allowed: at most {:.0} nodes at steps of {time_step:.1e} s, or solver.form = \"auto\"",
            rod.nodes,
            rod.spacing / bent,
            MIN_SPACING[0],
            (rod.length / (MIN_SPACING[0] * bent)).floor()
        )
    })
}

/// The form that is accurate for steps of `time_step` (s).
pub fn form(rod: &Rod, time_step: f64) -> Form {
    if rounding(rod, time_step) > ACCURACY { Form::Chain } else { Form::Positions }
}

/// κ = 2 tan(φ/2).
#[inline]
fn curvature(turning: f64) -> f64 {
    let half = 0.5 * turning;
    if half.abs() < MAX_SERIES_HALF_TURNING {
        let square = half * half;
        turning * (1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0 + square * (17.0 / 315.0))))
    } else {
        2.0 * half.tan()
    }
}

/// The κ near `kappa` that solves B(κ−κ̄)(1+κ²/4) = M, by one Newton iteration: exact if the error of `kappa` is
/// rounding.
#[inline]
pub(super) fn from_moment(moment: f64, stiffness: f64, natural: f64, kappa: f64) -> f64 {
    let s = bend::curvature_per_turning(kappa);
    let deviation = kappa - natural;
    kappa - (deviation * s - moment / stiffness) / (s + 0.5 * deviation * kappa)
}

/// Number of nodes whose rows are written before forces are added: 64 · 128 bytes of matrix.
const BLOCK: usize = 64;

/// Adds `values` to `sums`.
#[inline(always)]
fn add<const N: usize>(sums: &mut [f64; N], values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

impl Dynamics {
    /// The initial state of a run in `form`. Its links are exact, while positions are rounded.
    pub fn first_state_in(&mut self, form: Form) -> State {
        let mut state = State::zeros(self.model.unknowns());
        if form == Form::Chain {
            state.links = vec![Link::default(); self.model.rod.nodes];
        }
        self.place(&mut state);
        state
    }

    /// Computes the edges from the links of `state`: directions, and lengths ℓ = ΔL(1 + F·t/EA) − τ ℓ̇. Their rates are
    /// those of a motion along `direction`, if that is given.
    pub(super) fn shape_edges_of(&mut self, state: &State, direction: Option<Direction>) -> Result<()> {
        let Self { model, edges, rates, held, .. } = self;
        let (rod, t) = (&model.rod, state.t);
        let mut damped = rod.damping.as_ref().zip(rates.as_mut());
        if let Some((_, rates)) = &mut damped {
            rates.clamp_spin = held.map_or(0.0, |[_, _, angle]| angle.rate);
        }
        let per_move =
            direction.filter(|direction| direction.q != 0.0).map_or(0.0, |direction| direction.v / direction.q);
        for (k, (edge, link)) in edges.iter_mut().zip(&state.links).enumerate() {
            let (sin, cos) = link.angle.sin_cos();
            let t_k = Vector2::new(cos, sin);
            let cell = &rod.cells[k];
            let elastic = cell.length(t_k.dot(&Vector2::from(link.force)));
            *edge = Edge::along(t_k, elastic);
            if let Some((damping, rates)) = &mut damped {
                let ends = |values: &[f64]| node(values, k + 1) - node(values, k);
                // ė + (c_v/c_q)(ℓt − Δx), first without and then with the term ℓt.
                let open = ends(&state.v) - ends(&state.q) * per_move;
                let time = damping.stretching[k];
                *edge = Edge::along(t_k, (elastic - time * t_k.dot(&open)) / (1.0 + time * per_move));
                rates.edges[k] = EdgeRate::new(edge, open + t_k * (per_move * edge.length));
            }
            let shortest = COLLAPSED * cell.rest;
            if !(shortest..f64::INFINITY).contains(&edge.length) {
                return Err(if edge.length < shortest {
                    Error::EdgeCollapse { time_s: t, node: k, length_m: edge.length }
                } else {
                    Error::NotFinite { time_s: t, node: k, what: "force or direction" }
                });
            }
        }
        Ok(())
    }

    /// Turning angle of the joint at node `k` from the links' directions; `head` is the direction of a held head.
    #[inline]
    fn turning(&self, links: &[Link], k: usize, head: f64) -> f64 {
        links[k].angle - if k == 0 { head } else { links[k - 1].angle }
    }

    /// For a damped joint at node `k` with dκ/dθ = `s`, at the present rates of the edges: τ (s), the damped rate r
    /// (1/s), and the part of its rate of curvature that is not damped (1/s).
    fn joint_rate(&self, k: usize, s: f64) -> Option<(f64, f64, f64)> {
        let KelvinVoigt { damping, rates } = self.damped()?;
        let given = damping.given(self.natural_rate[k]);
        Some((damping.bending[k], s * rates.turning(k) - given, given))
    }

    /// See [`System::assemble_chain`](crate::system::System::assemble_chain).
    pub(super) fn assemble_links(
        &mut self,
        state: &State,
        direction: Direction,
        residual: &mut [f64],
        matrix: &mut ChainMatrix,
    ) -> Result<()> {
        let links = &state.links;
        self.follow_hinge(state);
        let head = self.held.map_or(0.0, |[_, _, angle]| angle.value);
        self.shape_edges_of(state, Some(direction))?;
        self.locate_fluid(&state.q);
        if self.winches.is_some() {
            for k in self.model.rod.joints() {
                let moves = direction.q != 0.0;
                self.kappa[k] = if moves { curvature(self.turning(links, k, head)) } else { links[k].curvature };
            }
            self.pull_winches();
        }
        let rod = &self.model.rod;
        let (nodes, joints) = (rod.nodes, rod.joints());
        let (per_radian, per_metre) = (rod.ei / rod.length.powi(2), rod.ei / rod.length.powi(3));
        let around = 1.0 / rod.length;
        let Direction { q: c_q, a: c_a, .. } = direction;
        let (moves, loaded) = (c_q != 0.0, self.is_loaded());
        let per_move = if moves { direction.v / c_q } else { 0.0 };
        matrix.terms = ChainTerms { moves: c_q, scale: [per_radian, per_metre, around], held: self.held.is_some() };
        let rows = matrix.rows_mut();
        let mut pull_before = Vector2::zeros(); // of the previous edge
        for first in (0..nodes).step_by(BLOCK) {
            let last = (first + BLOCK).min(nodes);
            for (k, link) in links.iter().enumerate().take(last).skip(first) {
                let at = 6 * k;
                let pull = Vector2::from(link.force);
                let inertia = rod.mass[k];
                let load = if loaded { self.load(k) } else { Vector2::zeros() };
                let force = node(&state.a, k) * inertia - load - pull + pull_before;
                residual[at] = force.x;
                residual[at + 1] = force.y;
                pull_before = pull;
                let mut row = ChainRow { own: [inertia * c_a, 0.0, 0.0, inertia * c_a], ..ChainRow::default() };
                if joints.contains(&k) {
                    let kappa = if moves { curvature(self.turning(links, k, head)) } else { link.curvature };
                    let s = bend::curvature_per_turning(kappa);
                    if s * bend::FOLD >= 2.0 {
                        return Err(Error::FoldOver { time_s: state.t, node: k }); // s = 2/(1 + cos φ)
                    }
                    let deviation = kappa - self.natural[k];
                    row.flexibility = 1.0 / rod.joint[k];
                    row.slope = s * (s + 0.5 * deviation * kappa);
                    let mut borne = deviation * s;
                    if let Some((time, rate, given)) = self.joint_rate(k, s) {
                        borne += time * rate * s;
                        row.slope += time * s * (0.5 * kappa * (2.0 * rate + given) + s * per_move);
                    }
                    residual[at + 2] = per_radian * (borne - row.flexibility * link.moment);
                } else {
                    row.flexibility = -around / per_radian;
                    residual[at + 2] = link.moment * around;
                }
                if let (Some(edge), Some(next)) = (self.edges.get(k), links.get(k + 1)) {
                    let t = edge.t;
                    row.compliance = 1.0 / rod.cells[k].axial;
                    if let Some(damping) = &rod.damping {
                        row.compliance /= 1.0 + damping.stretching[k] * per_move;
                    }
                    let (along, across) = (pull.dot(&t), pull.dot(&edge.n()));
                    (row.t, row.lever) = (t.into(), [row.compliance * across, edge.length]);
                    row.by_angle = row.compliance * across * across - edge.length * along;
                    let gap = if moves {
                        (t * edge.length - (node(&state.q, k + 1) - node(&state.q, k))) * per_metre
                    } else {
                        Vector2::zeros()
                    };
                    residual[at + 3] = gap.x;
                    residual[at + 4] = gap.y;
                    residual[at + 5] = (next.moment - link.moment + edge.length * across) * around;
                }
                rows[k] = row;
            }
            // Forces are added to the rows while these are in the cache; those of an edge, once the rows of both its
            // nodes are written. The matrix omits the change of a force with the stretch of an edge, which is as small
            // as the stretch.
            let edges = first.saturating_sub(1)..last - 1;
            let moving = self.moving(state);
            self.model.forces.on_edges(&moving, Some(direction), edges, |e, on| {
                let edge = &moving.edges[e];
                // The edge vector moves by ℓ n δθ, which is c_q times the difference of the changes of its ends.
                let turned = if moves { edge.n() * (edge.length / c_q) } else { Vector2::zeros() };
                for (i, k) in [e, e + 1].into_iter().enumerate() {
                    let force = on.force(i);
                    residual[6 * k] += force.x;
                    residual[6 * k + 1] += force.y;
                    let row = &mut rows[k];
                    add(&mut row.own, on.own(i).into());
                    add(
                        if i == 0 { &mut row.after } else { &mut row.before },
                        (Matrix2::from(on.edge(i)) * turned).into(),
                    );
                }
            });
        }
        let moving = self.moving(state);
        for tip in self.model.forces.on_tip(&moving, Some(direction)) {
            let k = nodes - 1;
            residual[6 * k] += tip.force.x;
            residual[6 * k + 1] += tip.force.y;
            let own = tip.own;
            add(&mut rows[k].own, [own.m11, own.m12, own.m21, own.m22]);
            if moves {
                // The rows do not reach the last edge but one. It turns like the last one, except for the joint between
                // them.
                let [before, last] = tip.edges;
                let edge = &moving.edges[nodes - 2];
                add(&mut rows[k].before, ((before + last) * (edge.n() * (edge.length / c_q))).into());
            }
        }
        self.hinge_residual = None;
        if let (Some(hinge), Some([_, _, angle])) = (&self.model.hinge, &self.held) {
            // The angle of the hinge follows from the moment of its joint, D δφ − δM = r, so that the joint is that
            // much more flexible.
            let own = hinge.residual(self.command, *angle, links[0].moment, direction);
            if moves {
                let flexibility = rows[0].slope * c_q / own.slope;
                rows[0].flexibility += flexibility;
                residual[2] += per_radian * flexibility * own.moment;
            }
            self.hinge_residual = Some(own);
        }
        if self.held.is_some() {
            residual[..2].fill(0.0);
            rows[0].own = [per_metre, 0.0, 0.0, per_metre];
            (rows[0].before, rows[0].after) = ([0.0; 2], [0.0; 2]);
        }
        self.couple_winches_by_links(moves, per_radian, rows);
        Ok(())
    }

    /// Computes the rank-one terms of the winches in the chain form with these `rows`; `scale` is that of the joint
    /// equations. The tension pulls the nodes and bends the joints, and depends on the lengths of edges and the
    /// curvatures of joints.
    fn couple_winches_by_links(&mut self, moves: bool, scale: f64, rows: &[ChainRow]) {
        let Some(winches) = &mut self.winches else { return };
        let Model { rod, tendons, .. } = &*self.model;
        winches.count = 0;
        for (i, tendon) in tendons.iter().enumerate() {
            let slope = winches.slopes[i];
            if slope == 0.0 || !moves {
                continue;
            }
            // The last node has no edge.
            let RankOne { column, row } = winches.couple(i, 6 * rod.nodes - 3);
            tendon.visit_slopes(&self.edges, |k, pull| {
                (0..2).for_each(|axis| column[6 * k + axis] += pull[axis]);
            });
            if self.held.is_some() {
                column[..2].fill(0.0);
            }
            for e in tendon.edges.clone() {
                // ℓ = ΔL (1 + F·t/EA), where t depends on the direction.
                let ChainRow { compliance, t, lever, .. } = &rows[e];
                row[6 * e + 3] += slope * compliance * t[0];
                row[6 * e + 4] += slope * compliance * t[1];
                row[6 * e + 5] += slope * lever[0];
            }
            for k in tendon.joints.clone() {
                let s = bend::curvature_per_turning(self.kappa[k]);
                column[6 * k + 2] -= scale * s * tendon.offset * rows[k].flexibility;
                row[6 * k + 5] -= slope * tendon.offset * s;
                if let Some(before) = k.checked_sub(1) {
                    row[6 * before + 5] += slope * tendon.offset * s;
                }
            }
        }
    }

    /// Subtracts Newton's `increment` from the arc of a hinge in `state`, which follows from the moment of its joint.
    /// Returns the distance moved, m.
    pub(super) fn move_hinge_back(&self, increment: &[f64], state: &mut State) -> f64 {
        let Some(HingeResidual { moment, slope, direction }) = self.hinge_residual else { return 0.0 };
        let rod = &self.model.rod;
        let arc = rod.length * (moment + increment[2]) / slope;
        move_arc_back(rod.nodes, direction, arc, state);
        (direction.q * arc).abs()
    }

    /// Updates the links of `state`, copied from `from`, for a small change of positions and velocities since `from`:
    /// edges turn and stretch, and joints turn. Moments follow with the next iteration of Newton's method.
    pub(crate) fn carry_links(&self, from: &State, state: &mut State) {
        let rod = &self.model.rod;
        let head = self.head_angle(state).unwrap_or_default().value;
        let State { q, v, links, .. } = state;
        for (e, link) in links.iter_mut().enumerate().take(rod.nodes - 1) {
            let along = |values: &[f64]| node(values, e + 1) - node(values, e);
            let (before, after) = (along(&from.q), along(q));
            let turned = Rotation2::new(before.perp(&after).atan2(before.dot(&after)));
            let damping = rod.damping.as_ref().map_or(0.0, |damping| damping.stretching[e]);
            let rates = after.normalize().dot(&along(v)) - before.normalize().dot(&along(&from.v));
            let pulled = rod.cells[e].axial * (after.norm() - before.norm() + damping * rates);
            link.angle += turned.angle();
            link.force = (turned * Vector2::from(link.force) + after.normalize() * pulled).into();
        }
        for k in rod.joints().take(links.len()) {
            links[k].curvature = curvature(self.turning(links, k, head));
        }
    }

    /// See [`System::move_links`](crate::system::System::move_links).
    pub(super) fn move_links_back(&self, increment: &[f64], state: &mut State) {
        let head = self.head_angle(state).unwrap_or_default();
        let State { v, links, .. } = state;
        for (link, d) in links.iter_mut().zip(increment.chunks(6)) {
            link.moment -= d[2];
            if let [_, _, _, fx, fy, turn] = d {
                link.force[0] -= fx;
                link.force[1] -= fy;
                link.angle -= turn;
            }
        }
        let Model { rod, tendons, .. } = &*self.model;
        let mut pulled = [0.0; MAX_TENDONS];
        for (i, change) in self.winches.iter().flat_map(|winches| winches.tension_changes(increment)) {
            pulled[i] = change;
        }
        // The curvature without moment, at the updated tensions of the winches.
        let natural = |k: usize| {
            let passing =
                tendons.iter().zip(pulled).filter(|(tendon, pull)| *pull != 0.0 && tendon.joints.contains(&k));
            self.natural[k] - passing.map(|(tendon, pull)| pull * tendon.offset / rod.joint[k]).sum::<f64>()
        };
        // The angular velocity of an edge at the updated velocities of its nodes; only damped joints need it.
        let spin = |e: usize, links: &[Link]| {
            let (sin, cos) = links[e].angle.sin_cos();
            (node(v, e + 1) - node(v, e)).dot(&Vector2::new(-sin, cos)) * self.edges[e].per_length
        };
        let mut before = head.rate;
        for k in rod.joints() {
            let guess = curvature(self.turning(links, k, head.value));
            let mut resisting = 0.0;
            if let Some(damping) = &rod.damping {
                if k == rod.joints().start && k > 0 {
                    before = spin(k - 1, links);
                }
                let after = spin(k, links);
                let s = bend::curvature_per_turning(guess);
                resisting = damping.moment(rod, k, s * (after - before) - damping.given(self.natural_rate[k])) * s;
                before = after;
            }
            links[k].curvature = from_moment(links[k].moment - resisting, rod.joint[k], natural(k), guess);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{MAX_SERIES_HALF_TURNING, curvature};

    #[test]
    fn the_curvature_of_a_small_turning_is_summed_to_rounding() {
        for part in [1e-3, 0.1, 0.5, 0.9, 1.0 - 1e-15, 1.0 + 1e-15] {
            for half in [part, -part].map(|part| part * MAX_SERIES_HALF_TURNING) {
                let exact = 2.0 * half.tan();
                let error = curvature(2.0 * half) / exact - 1.0;
                assert!(error.abs() <= 2.0 * f64::EPSILON, "half a turning of {half}: {error:e}"); // measured: 2.2e-16
            }
        }
    }
}
