//! Drag of the fluid on the rod, one law a file: force and exact derivatives, never a step size.

pub mod stokes_like;

use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::rod::elastic::Deformed;
use crate::rod::{Edge, HalfEdge, add};
use crate::system::Linearisation;
pub use stokes_like::StokesLike;

/// A local drag law: the force a length of rod feels depends on its tangent and its velocity against the fluid.
pub trait Law {
    /// Force per unit length (N/m) that *opposes* the relative velocity `w` (m/s) on an edge of tangent `t`.
    fn traction(&self, t: Vector2<f64>, w: Vector2<f64>) -> Vector2<f64>;

    /// ∂(traction)/∂w, N s/m².
    fn by_velocity(&self, t: Vector2<f64>, w: Vector2<f64>) -> Matrix2<f64>;

    /// ∂(traction)/∂φ with φ the direction of the tangent, N/m.
    fn by_direction(&self, t: Vector2<f64>, w: Vector2<f64>) -> Vector2<f64>;
}

/// Drag on a rod: each half-edge loads its own node with ½ΔL·w̄ times the law's traction.
pub trait Drag: std::fmt::Debug + Send + Sync {
    /// Writes what opposes the motion of `rod` with node velocities `v` (m/s), inertia, elasticity and this drag, to
    /// `residual` (N) and its linearisation, if asked for, to that matrix.
    fn assemble(
        &self,
        rod: Deformed<'_>,
        v: &[f64],
        fluid: Fluid,
        residual: &mut [f64],
        jacobian: Option<Linearisation<'_>>,
    );

    /// Adds the opposing force (N) to `out`, two entries a node.
    fn add_force(&self, edges: &[Edge], v: &[f64], fluid: Fluid, out: &mut [f64]);

    /// Visits both halves of the edges in `which`: node, edge, and what acts on that node.
    fn for_half_edges(
        &self,
        which: Range<usize>,
        edges: &[Edge],
        v: &[f64],
        fluid: Fluid,
        visit: &mut dyn FnMut(usize, usize, HalfEdge),
    );

    /// Adds ∂(opposing force)/∂μ, N/(Pa s), to `out`, two entries a node.
    fn add_force_by_viscosity(&self, edges: &[Edge], v: &[f64], fluid: Fluid, out: &mut [f64]);

    /// Viscous power (v−u)ᵀC(v−u) ≥ 0 and the flow's power uᵀC(u−v), W.
    fn power(&self, edges: &[Edge], v: &[f64], fluid: Fluid) -> [f64; 2];

    /// Drag per unit length and speed (N s/m²) where the weight is 1, along and across the rod.
    fn coefficients(&self, fluid: Fluid) -> [f64; 2];

    /// The weighted length ∫w ds, m.
    fn weighted_length(&self) -> f64;
}

/// What the host may change of the fluid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fluid {
    /// Dynamic viscosity μ, Pa s.
    pub viscosity: f64,
    /// Uniform background velocity u, m/s.
    pub flow: Vector2<f64>,
}

/// A local law spread over the rod's half-edges with their weights.
#[derive(Debug, Clone, PartialEq)]
pub struct HalfEdges<L> {
    /// The law for each fluid.
    law: L,
    /// ½ΔL times the mean drag weight over the first and second half of every edge, m.
    weights: Vec<[f64; 2]>,
}

impl<L> HalfEdges<L> {
    /// Spreads `law` over `edges` edges of length `spacing` (m) with the weight `head_weight` up to arc length
    /// `head_length` (m) and 1 after; each half-edge takes the exact mean over itself.
    pub fn new(law: L, edges: usize, spacing: f64, head_weight: f64, head_length: f64) -> Self {
        let half = 0.5 * spacing;
        let weight = |start: f64| {
            let inside = (head_length - start).clamp(0.0, half);
            half + (head_weight - 1.0) * inside
        };
        let weights = (0..edges).map(|e| e as f64 * spacing).map(|s| [weight(s), weight(s + half)]).collect();
        Self { law, weights }
    }

    /// Every edge in `which` with its number and, for both of its ends, the end's velocity (m/s) against the fluid and its
    /// weight (m).
    #[inline]
    fn walk<'a>(
        &'a self,
        which: Range<usize>,
        edges: &'a [Edge],
        v: &'a [f64],
        fluid: Fluid,
    ) -> impl Iterator<Item = (usize, &'a Edge, Ends)> {
        let velocities = v.as_chunks().0[which.start..].windows(2);
        let edges = edges[which.clone()].iter().zip(&self.weights[which.clone()]).zip(velocities);
        which.zip(edges).map(move |(e, ((edge, weights), v))| {
            let (start, end) = (Vector2::from(v[0]) - fluid.flow, Vector2::from(v[1]) - fluid.flow);
            (e, edge, [(start, weights[0]), (end, weights[1])])
        })
    }
}

/// Velocity (m/s) against the fluid, and weight (m), of the half-edges at the start and the end of an edge.
type Ends = [(Vector2<f64>, f64); 2];

/// A law that needs the fluid before it is a [`Law`].
pub trait InFluid: std::fmt::Debug + Send + Sync {
    /// The law at a given viscosity.
    type Law: Law;

    /// The law for `fluid`.
    fn in_fluid(&self, fluid: Fluid) -> Self::Law;

    /// Its derivative by viscosity, as a law.
    fn by_viscosity(&self, fluid: Fluid) -> Self::Law;
}

impl<L: InFluid> HalfEdges<L> {
    /// Adds the force of `law` to `out`.
    fn add(&self, law: &L::Law, edges: &[Edge], v: &[f64], fluid: Fluid, out: &mut [f64]) {
        for (e, edge, ends) in self.walk(0..edges.len(), edges, v, fluid) {
            let [(start, start_weight), (end, end_weight)] = ends;
            add(out, e, law.traction(edge.t, start) * start_weight);
            add(out, e + 1, law.traction(edge.t, end) * end_weight);
        }
    }
}

/// What `law` does to half of `edge`.
#[inline(always)]
fn half_edge(law: &impl Law, edge: &Edge, (w, weight): (Vector2<f64>, f64)) -> HalfEdge {
    HalfEdge {
        force: law.traction(edge.t, w) * weight,
        by_velocity: law.by_velocity(edge.t, w) * weight,
        by_direction: law.by_direction(edge.t, w) * weight,
    }
}

impl<L: InFluid> Drag for HalfEdges<L> {
    fn assemble(
        &self,
        rod: Deformed<'_>,
        v: &[f64],
        fluid: Fluid,
        residual: &mut [f64],
        jacobian: Option<Linearisation<'_>>,
    ) {
        let law = self.law.in_fluid(fluid);
        let around = self
            .walk(0..rod.edges.len(), rod.edges, v, fluid)
            .map(|(_, edge, [start, end])| Some([half_edge(&law, edge, start), half_edge(&law, edge, end)]));
        rod.assemble(around, residual, jacobian);
    }

    fn add_force(&self, edges: &[Edge], v: &[f64], fluid: Fluid, out: &mut [f64]) {
        self.add(&self.law.in_fluid(fluid), edges, v, fluid, out);
    }

    fn for_half_edges(
        &self,
        which: Range<usize>,
        edges: &[Edge],
        v: &[f64],
        fluid: Fluid,
        visit: &mut dyn FnMut(usize, usize, HalfEdge),
    ) {
        let law = self.law.in_fluid(fluid);
        for (e, edge, ends) in self.walk(which, edges, v, fluid) {
            for (k, end) in (e..).zip(ends) {
                visit(k, e, half_edge(&law, edge, end));
            }
        }
    }

    fn add_force_by_viscosity(&self, edges: &[Edge], v: &[f64], fluid: Fluid, out: &mut [f64]) {
        self.add(&self.law.by_viscosity(fluid), edges, v, fluid, out);
    }

    fn power(&self, edges: &[Edge], v: &[f64], fluid: Fluid) -> [f64; 2] {
        let law = self.law.in_fluid(fluid);
        let (mut viscous, mut force) = (0.0, Vector2::zeros());
        for (_, edge, ends) in self.walk(0..edges.len(), edges, v, fluid) {
            let [(start, start_weight), (end, end_weight)] = ends;
            let (at_start, at_end) =
                (law.traction(edge.t, start) * start_weight, law.traction(edge.t, end) * end_weight);
            viscous += at_start.dot(&start) + at_end.dot(&end);
            force += at_start + at_end;
        }
        [viscous, -force.dot(&fluid.flow)]
    }

    fn coefficients(&self, fluid: Fluid) -> [f64; 2] {
        let law = self.law.in_fluid(fluid);
        let x = Vector2::x();
        [law.traction(x, x).x, law.traction(x, Vector2::y()).y]
    }

    fn weighted_length(&self) -> f64 {
        self.weights.iter().flatten().sum()
    }
}
