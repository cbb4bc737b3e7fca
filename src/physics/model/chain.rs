//! The chain form: the same discrete rod with moments, forces and edge directions as unknowns of their own.
//!
//! Newton's method in nodal positions adds EI/ΔL³ to m/Δt², and reads curvature off positions of size L: its relative
//! rounding error is about 16ε(λ/ΔL)⁴ ([`rounding`]), and on the finest meshes it fails. Here EI/ΔL³ is never formed. The
//! energy with multipliers F_k, E = Σ ½B(κ−κ̄)² + Σ F·(Δx − ℓt) + Σ ½ΔL (F·t)²/EA with ℓ = ΔL(1 + F·t/EA), is stationary
//! where
//!
//! - at node k, m a + ΣF − W − F_k + F_{k−1} = 0;
//! - at its joint, M = B(κ−κ̄)s with κ = 2 tan(φ/2), φ = θ_k − θ_{k−1}, s = dκ/dφ = 1 + κ²/4; M = 0 where there is none;
//! - along edge k, ℓ t = x_{k+1} − x_k;
//! - around it, M_{k+1} − M_k + ℓ F·n = 0.
//!
//! Eliminating M, F and θ gives back the equations in positions, so the results are the same but for rounding. Rounding of
//! x and θ is absorbed within one unit in the last place of them, while M and F stay smooth: curvature is read from M,
//! stretching from F·t, directions from θ, nothing from differences of positions.
//!
//! The rows are scaled to forces by EI and L, so that sizes can be compared and pivots are the same in any units. Along a direction that
//! moves no position (c_q = 0: the accelerations at the start) the edges keep direction and stretch, the joints curvature.

use nalgebra::{Matrix2, Vector2};

use super::{COLLAPSED, Dynamics};
use crate::error::{Error, Result};
use crate::linear::{ChainMatrix, ChainRow, ChainTerms, Direction};
use crate::rod::{Edge, Rod, bend, node};
use crate::system::{Form, Link, State};

/// Largest bound [`rounding`] of one solve up to which positions are taken. Newton's method refines: at this value positions
/// and steps agree with the chain form to about 1e-15, moments to 1e-5, and no iteration is lost; from ten times it on
/// iterations are.
pub const ACCURACY: f64 = 1e-3;

/// Below this half-turning its tangent is summed from its series, the next term of which is below ε/8.
const SMALL: f64 = 0.01;

/// The length λ = min((EI Δt²/ρA)^¼, L/2) (m) that a step of `time_step` (s) bends.
pub fn bent_length(rod: &Rod, time_step: f64) -> f64 {
    let line_density = rod.mass[rod.front + 1] / rod.spacing;
    (rod.ei * time_step * time_step / line_density).powf(0.25).min(0.5 * rod.length)
}

/// Bound on the relative rounding error of one solve of Newton's method in positions, 16ε(λ/ΔL)⁴, times (ΔL/b)² where a
/// neck's length b is less than ΔL. Further iterations
/// refine a time step as long as this is below about 1e-2: then curvature is off by about ε(L/ΔL)² only, and moments by
/// that times κ/(κ−κ̄) (measured at 129 … 8193 nodes: 1e-14 … 3e-9 and 1e-14 … 1e-4).
pub fn rounding(rod: &Rod, time_step: f64) -> f64 {
    let lever = rod.spacing / rod.shortest();
    16.0 * f64::EPSILON * (bent_length(rod, time_step) / rod.spacing).powi(4) * lever * lever
}

/// The form that is accurate for steps of `time_step` (s).
pub fn form(rod: &Rod, time_step: f64) -> Form {
    if rounding(rod, time_step) > ACCURACY { Form::Chain } else { Form::Positions }
}

/// κ = 2 tan(φ/2).
#[inline]
fn curvature(turning: f64) -> f64 {
    let half = 0.5 * turning;
    if half.abs() < SMALL {
        let square = half * half;
        turning * (1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0 + square * (17.0 / 315.0))))
    } else {
        2.0 * half.tan()
    }
}

/// The κ near `kappa` that solves B(κ−κ̄)(1+κ²/4) = M, by one Newton iteration: exact where `kappa` is off by rounding.
#[inline]
fn from_moment(moment: f64, stiffness: f64, natural: f64, kappa: f64) -> f64 {
    let s = bend::curvature_per_turning(kappa);
    let deviation = kappa - natural;
    kappa - (deviation * s - moment / stiffness) / (s + 0.5 * deviation * kappa)
}

/// Nodes whose rows are written before forces join them: 64 · 128 bytes of matrix.
const BLOCK: usize = 64;

/// Adds `values` to `sums`.
#[inline(always)]
fn add<const N: usize>(sums: &mut [f64; N], values: [f64; N]) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
}

impl Dynamics {
    /// The first state of a run in `form`; its links are exact where positions are rounded.
    pub fn first_state_in(&mut self, form: Form) -> State {
        let mut state = State::zeros(2 * self.model.rod.nodes);
        if form == Form::Chain {
            state.links = vec![Link::default(); self.model.rod.nodes];
        }
        self.place(&mut state);
        state
    }

    /// Edges of `links`: their directions, and lengths ℓ = ΔL(1 + F·t/EA).
    pub(super) fn shape_edges_of(&mut self, links: &[Link], t: f64) -> Result<()> {
        let rod = &self.model.rod;
        for (k, (edge, link)) in self.edges.iter_mut().zip(links).enumerate() {
            let (sin, cos) = link.angle.sin_cos();
            let t_k = Vector2::new(cos, sin);
            let cell = &rod.cells[k];
            *edge = Edge::along(t_k, cell.length(t_k.dot(&Vector2::from(link.force))));
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

    /// Turning of the joint at node `k` by the links' directions.
    #[inline]
    fn turning(&self, links: &[Link], k: usize) -> f64 {
        let before = match (&self.held, k) {
            (Some([_, _, angle]), 0) => angle.value,
            _ => links[k - 1].angle,
        };
        links[k].angle - before
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
        self.shape_edges_of(links, state.t)?;
        self.look_around(&state.q);
        let rod = &self.model.rod;
        let (nodes, joints) = (rod.nodes, rod.joints());
        let (per_radian, per_metre) = (rod.ei / rod.length.powi(2), rod.ei / rod.length.powi(3));
        let around = 1.0 / rod.length;
        let Direction { q: c_q, a: c_a, .. } = direction;
        let (moves, loaded) = (c_q != 0.0, self.is_loaded());
        matrix.terms = ChainTerms { moves: c_q, scale: [per_radian, per_metre, around], held: self.held.is_some() };
        let rows = matrix.rows_mut();
        let mut pull_before = Vector2::zeros(); // of the edge before
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
                    let kappa = if moves { curvature(self.turning(links, k)) } else { link.curvature };
                    let s = bend::curvature_per_turning(kappa);
                    if s * bend::FOLD >= 2.0 {
                        return Err(Error::FoldOver { time_s: state.t, node: k }); // s = 2/(1 + cos φ)
                    }
                    let deviation = kappa - self.natural[k];
                    row.flexibility = 1.0 / rod.joint[k];
                    row.slope = s * (s + 0.5 * deviation * kappa);
                    residual[at + 2] = per_radian * (deviation * s - row.flexibility * link.moment);
                } else {
                    row.flexibility = -around / per_radian;
                    residual[at + 2] = link.moment * around;
                }
                if let (Some(edge), Some(next)) = (self.edges.get(k), links.get(k + 1)) {
                    let t = edge.t;
                    row.compliance = 1.0 / rod.cells[k].axial;
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
            // Forces join the rows while they are in the cache: those of an edge, once the rows of both its nodes are there.
            // What a force changes with the stretch of an edge is left out of the matrix: it is as small as the stretch.
            let edges = first.saturating_sub(1)..last - 1;
            let moving = self.moving(state);
            self.model.forces.on_edges(&moving, Some(direction), edges, |e, on| {
                let edge = &moving.edges[e];
                // The edge vector moves by ℓ n δθ, which is c_q times what its ends differ by.
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
                // The last edge but one is out of reach of the rows: it turns as the last does, but for the joint between.
                let [before, last] = tip.edges;
                let edge = &moving.edges[nodes - 2];
                add(&mut rows[k].before, ((before + last) * (edge.n() * (edge.length / c_q))).into());
            }
        }
        if self.held.is_some() {
            residual[..2].fill(0.0);
            rows[0].own = [per_metre, 0.0, 0.0, per_metre];
            (rows[0].before, rows[0].after) = ([0.0; 2], [0.0; 2]);
        }
        Ok(())
    }

    /// See [`System::move_links`](crate::system::System::move_links).
    pub(super) fn move_links_back(&self, increment: &[f64], links: &mut [Link]) {
        for (link, d) in links.iter_mut().zip(increment.chunks(6)) {
            link.moment -= d[2];
            if let [_, _, _, fx, fy, turn] = d {
                link.force[0] -= fx;
                link.force[1] -= fy;
                link.angle -= turn;
            }
        }
        let rod = &self.model.rod;
        for k in rod.joints() {
            let guess = curvature(self.turning(links, k));
            links[k].curvature = from_moment(links[k].moment, rod.joint[k], self.natural[k], guess);
        }
    }
}
