//! Local drag: the force on a length of rod depends on its own tangent and its own velocity against the fluid.
//!
//! Every half of an edge loads its own node with its length times the traction of the law there: second order in the mesh.

use std::ops::Range;

use nalgebra::Vector2;
use wide::f64x2;

use super::force::{ActingOn, Force, InPass, Kinematics, OnEdge, Powers, TOGETHER, Tally, Validity};
use super::medium::{DENSITY, Fluid, Here, Key, Property, VISCOSITY};
use crate::linear::{Block, lanes};
use crate::rod::elastic::Deformed;
use crate::rod::{Alike, Edge, Half, Rod, add, node};
use crate::system::{Direction, Linearisation};

/// Force per unit length (N/m) that opposes a velocity with the components `along` and `across` the rod.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Traction {
    /// Its component along the tangent, N/m.
    pub along: f64,
    /// Its component along the normal, N/m.
    pub across: f64,
}

/// The derivatives of a traction by the velocity's components, N s/m².
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TractionSlopes {
    /// ∂(along)/∂(velocity along).
    pub along: f64,
    /// ∂(across)/∂(velocity across).
    pub across: f64,
    /// ∂(along)/∂(velocity across) and ∂(across)/∂(velocity along), of a law where the components are not independent.
    pub mixed: Option<[f64; 2]>,
}

/// A local drag law.
pub trait Law: std::fmt::Debug + Send + Sync {
    /// What it knows of half an edge.
    type Half: std::fmt::Debug + Copy + Default + PartialEq + Send + Sync;
    /// What it makes of the fluid, once for all halves.
    type Fluid: Copy;

    /// Its name in a scene.
    fn name(&self) -> &'static str;

    /// Where it holds, and its source.
    fn validity(&self) -> Validity;

    /// True where it is linear in the velocity.
    fn is_linear(&self) -> bool;

    /// The law for a fluid.
    fn in_fluid(&self, fluid: Fluid) -> Self::Fluid;

    /// The traction where the velocity against the fluid is `along` and `across` (m/s) the rod.
    fn traction(&self, half: &Self::Half, fluid: Self::Fluid, along: f64, across: f64) -> Traction;

    /// The same, with its derivatives.
    fn with_slopes(&self, half: &Self::Half, fluid: Self::Fluid, along: f64, across: f64)
    -> (Traction, TractionSlopes);

    /// The parameters that it depends on, by their keys in a scene.
    fn parameters(&self) -> &[Key];

    /// ∂(traction)/∂p for one of its parameters.
    fn by_parameter(&self, key: Key, half: &Self::Half, fluid: Fluid, along: f64, across: f64) -> Traction;
}

/// How the drag on the head differs from that on the rest: `weight` times it up to arc length `length` (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadWeight {
    /// The factor.
    pub weight: f64,
    /// Up to where it holds, m.
    pub length: f64,
}

impl HeadWeight {
    /// None.
    pub const NONE: Self = Self { weight: 1.0, length: 0.0 };
}

/// A local law on every half of every edge.
#[derive(Debug)]
pub struct LocalDrag<L: Law> {
    law: L,
    /// Whether the law depends on viscosity and density.
    depends: [bool; 2],
    /// For both halves of every edge: its weighted length, m, and what the law knows of it.
    halves: Alike<[(f64, L::Half); 2]>,
}

impl<L: Law> LocalDrag<L> {
    /// Spreads `law` over `rod`; `half` tells the law of each half of an edge. Each half takes the exact mean of the weight
    /// over itself.
    pub fn new(law: L, rod: &Rod, head: HeadWeight, half: impl Fn(&Half) -> L::Half) -> Self {
        let weighted = |h: &Half| {
            let inside = (head.length - (h.middle - 0.5 * h.length)).clamp(0.0, h.length);
            (h.length + (head.weight - 1.0) * inside, half(h))
        };
        let halves: Vec<_> = rod.halves().map(|both| both.map(|h| weighted(&h))).collect();
        let depends = [VISCOSITY, DENSITY].map(|key| law.parameters().contains(&key));
        Self { law, depends, halves: halves.into() }
    }

    /// The change (N) of what opposes an end that moves at `w` (m/s) against `fluid`, where that fluid changes by `change`.
    #[inline(always)]
    fn by_fluid(
        &self,
        (length, half): &(f64, L::Half),
        fluid: Fluid,
        edge: &Edge,
        w: Vector2<f64>,
        change: &Fluid,
    ) -> Vector2<f64> {
        let (t, n) = (edge.t, edge.n());
        let (u, v) = (w.dot(&t), w.dot(&n));
        let mut sum = Vector2::zeros();
        let changes = [(VISCOSITY, change.viscosity), (DENSITY, change.density)];
        for ((key, change), depends) in changes.into_iter().zip(self.depends) {
            if depends && change != 0.0 {
                let by = self.law.by_parameter(key, half, fluid, u, v);
                sum += (t * by.along + n * by.across) * change;
            }
        }
        if change.flow != Vector2::zeros() {
            let (_, by) = self.law.with_slopes(half, self.law.in_fluid(fluid), u, v);
            let (du, dv) = (-change.flow.dot(&t), -change.flow.dot(&n));
            let [along, across] = by.mixed.unwrap_or_default();
            sum += t * (by.along * du + along * dv) + n * (across * du + by.across * dv);
        }
        sum * *length
    }

    /// Visits every end with its edge, its half and its node.
    fn each_end(&self, rod: &Kinematics<'_>, mut visit: impl FnMut(usize, &Edge, &(f64, L::Half))) {
        for (e, edge) in rod.edges.iter().enumerate() {
            self.halves[e].iter().enumerate().for_each(|(i, half)| visit(e + i, edge, half));
        }
    }

    /// What opposes `edges` in `fluid`, the same along all of them.
    #[inline(always)]
    fn evaluate_in(
        &self,
        fluid: Fluid,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut Tally<'_>,
    ) {
        let flow = fluid.flow;
        let fluid = self.law.in_fluid(fluid);
        let v = rod.v.as_chunks::<2>().0;
        let first = edges.start;
        let some = &rod.edges[edges.clone()];
        let v = &v[first..=edges.end];
        let here = edges.map(|e| &self.halves[e]).zip(some).zip(v.windows(2));
        let against = |v: &[f64; 2]| Vector2::from(*v) - flow;
        match along {
            Some(direction) => sums.each(here, |((halves, edge), v)| {
                on_edge(&self.law, halves, fluid, edge, [against(&v[0]), against(&v[1])], direction)
            }),
            None => sums.each(here, |((halves, edge), v)| {
                let force = |i: usize| push(&self.law, &halves[i], fluid, edge, against(&v[i]));
                OnEdge { force: [force(0), force(1)], ..OnEdge::ZERO }
            }),
        }
    }

    /// The same where the fluid changes along them.
    fn evaluate_across(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut Tally<'_>,
    ) {
        let normal = lanes(rod.normal());
        let mut next = self.place(rod, edges.start);
        sums.each(edges, |e| {
            let ends = [std::mem::replace(&mut next, self.place(rod, e + 1)), next];
            let (halves, edge) = (&self.halves[e], &rod.edges[e]);
            match along {
                Some(direction) => self.on_edge_at([&ends[0], &ends[1]], halves, edge, normal, direction),
                None => {
                    let force = |i: usize| push(&self.law, &halves[i], ends[i].fluid, edge, ends[i].against);
                    OnEdge { force: [force(0), force(1)], ..OnEdge::ZERO }
                }
            }
        });
    }

    /// The place where node `k` is.
    #[inline(always)]
    fn place(&self, rod: &Kinematics<'_>, k: usize) -> Place<L::Fluid> {
        let here = rod.here(k);
        Place { here, fluid: self.law.in_fluid(here.fluid), against: node(rod.v, k) - here.fluid.flow }
    }

    /// What opposes both ends of `edge`, which are at different `places`.
    #[inline(always)]
    fn on_edge_at(
        &self,
        places: [&Place<L::Fluid>; 2],
        halves: &[(f64, L::Half); 2],
        edge: &Edge,
        normal: f64x2,
        direction: Direction,
    ) -> OnEdge {
        let [(f0, own0, edge0), (f1, own1, edge1)] = [0, 1].map(|i| {
            let Place { here, fluid, against } = places[i];
            let (force, mut own, by_edge) = end(&self.law, &halves[i], *fluid, edge, *against, direction);
            if direction.q != 0.0 && here.slope != Fluid::NONE {
                let by_height = self.by_fluid(&halves[i], here.fluid, edge, *against, &here.slope);
                own += Block::outer(by_height * direction.q, normal);
            }
            (force, own, by_edge)
        });
        OnEdge { force: [f0, f1], own: [own0, own1], edge: [edge0, edge1] }
    }
}

/// A node of the rod in a medium that is not the same everywhere.
#[derive(Debug, Clone, Copy)]
struct Place<F> {
    here: Here,
    /// What the law makes of the fluid there.
    fluid: F,
    /// The node's velocity against it, m/s.
    against: Vector2<f64>,
}

/// What a law opposes an end of `edge` with that moves at `w` (m/s) against the fluid, N.
#[inline(always)]
fn push<L: Law>(law: &L, (length, half): &(f64, L::Half), fluid: L::Fluid, edge: &Edge, w: Vector2<f64>) -> f64x2 {
    let Traction { along, across } = law.traction(half, fluid, w.dot(&edge.t), w.dot(&edge.n()));
    lanes(edge.t) * (along * length) + lanes(edge.n()) * (across * length)
}

/// What a law does to an end of `edge` that moves at `w` (m/s) against the fluid: force (N), and its derivatives along
/// `direction` where the end moves and where the edge changes.
#[inline(always)]
fn end<L: Law>(
    law: &L,
    (length, half): &(f64, L::Half),
    fluid: L::Fluid,
    edge: &Edge,
    w: Vector2<f64>,
    direction: Direction,
) -> (f64x2, Block, Block) {
    let (t, n) = (lanes(edge.t), lanes(edge.n()));
    let (u, v) = (w.dot(&edge.t), w.dot(&edge.n()));
    let (Traction { along, across }, by) = law.with_slopes(half, fluid, u, v);
    let force = t * (along * length) + n * (across * length);
    // a t tᵀ + b n nᵀ = b I + (a − b) t tᵀ.
    let by_velocity = length * direction.v;
    let mut own =
        Block::outer(edge.t, t) * ((by.along - by.across) * by_velocity) + Block::diagonal(by.across * by_velocity);
    // The edge turns by n·δe/ℓ; the velocity's components turn with it, and so does the traction.
    let turn = length * direction.q * edge.per_length;
    let mut turned = [by.along * v - across, along - by.across * u];
    if let Some([along, across]) = by.mixed {
        own += Block::outer(edge.t, n * (along * by_velocity)) + Block::outer(edge.n(), t * (across * by_velocity));
        turned = [turned[0] - along * u, turned[1] + across * v];
    }
    let by_turning = edge.t * (turned[0] * turn) + edge.n() * (turned[1] * turn);
    (force, own, Block::outer(by_turning, n))
}

/// What a law does to both ends of `edge`, which move at `w` (m/s) against the fluid.
#[inline(always)]
fn on_edge<L: Law>(
    law: &L,
    [first, second]: &[(f64, L::Half); 2],
    fluid: L::Fluid,
    edge: &Edge,
    w: [Vector2<f64>; 2],
    direction: Direction,
) -> OnEdge {
    let (f0, own0, edge0) = end(law, first, fluid, edge, w[0], direction);
    let (f1, own1, edge1) = end(law, second, fluid, edge, w[1], direction);
    OnEdge { force: [f0, f1], own: [own0, own1], edge: [edge0, edge1] }
}

impl<L: Law> InPass for LocalDrag<L> {
    fn assemble(
        &self,
        rod: Deformed<'_>,
        mut others: ActingOn<'_>,
        residual: &mut [f64],
        jacobian: Option<Linearisation<'_>>,
    ) {
        let (Self { law, halves, .. }, Kinematics { edges, v, .. }) = (self, others.rod);
        let alone = others.are_none();
        let direction = others.along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 });
        let Some(fluid) = others.rod.everywhere() else {
            let (medium, normal) = (others.rod, lanes(others.rod.normal()));
            // Edges that are looked at together lie in one fluid, or every node of them at its own place.
            let (mut one, mut next) = (None, self.place(&medium, 0));
            let around = edges.iter().enumerate().map(|(e, edge)| {
                if e % TOGETHER == 0 {
                    let together = e..edges.len().min(e + TOGETHER);
                    one = medium.throughout(&together).map(|fluid| (law.in_fluid(fluid), fluid.flow));
                    if one.is_none() {
                        next = self.place(&medium, e);
                    }
                }
                let mut on = match &one {
                    Some((fluid, flow)) => {
                        let w = [node(v, e) - flow, node(v, e + 1) - flow];
                        on_edge(law, &halves[e], *fluid, edge, w, direction)
                    }
                    None => {
                        let ends = [std::mem::replace(&mut next, self.place(&medium, e + 1)), next];
                        self.on_edge_at([&ends[0], &ends[1]], &halves[e], edge, normal, direction)
                    }
                };
                if !alone {
                    on.add(&others.on(e));
                }
                Some(on)
            });
            return rod.assemble(around, residual, jacobian);
        };
        let (flow, fluid) = (fluid.flow, law.in_fluid(fluid));
        let ends = v.as_chunks::<2>().0.windows(2);
        let around = edges.iter().zip(ends).enumerate().map(|(e, (edge, v))| {
            let w = [Vector2::from(v[0]) - flow, Vector2::from(v[1]) - flow];
            let mut on = on_edge(law, &halves[e], fluid, edge, w, direction);
            if !alone {
                on.add(&others.on(e));
            }
            Some(on)
        });
        rod.assemble(around, residual, jacobian);
    }

    fn powers(&self, rod: &Kinematics<'_>, fluid: Fluid) -> Powers {
        let (law, flow, fluid) = (&self.law, fluid.flow, self.law.in_fluid(fluid));
        let (mut opposing, mut against_fluid) = (f64x2::ZERO, 0.0);
        let ends = rod.v.as_chunks::<2>().0.windows(2);
        for (e, (edge, v)) in rod.edges.iter().zip(ends).enumerate() {
            for (i, (length, half)) in self.halves[e].iter().enumerate() {
                let w = Vector2::from(v[i]) - flow;
                let (u, w) = (w.dot(&edge.t), w.dot(&edge.n()));
                let Traction { along, across } = law.traction(half, fluid, u, w);
                against_fluid += length * (along * u + across * w);
                opposing += lanes(edge.t) * (along * length) + lanes(edge.n()) * (across * length);
            }
        }
        let opposing = Vector2::from(opposing.to_array());
        Powers { opposing, against_fluid, of_flow: -opposing.dot(&flow) }
    }
}

impl<L: Law> Force for LocalDrag<L> {
    fn name(&self) -> &'static str {
        self.law.name()
    }

    fn validity(&self) -> Validity {
        self.law.validity()
    }

    fn is_linear(&self) -> bool {
        self.law.is_linear()
    }

    fn evaluate(&self, rod: &Kinematics<'_>, along: Option<Direction>, edges: Range<usize>, sums: &mut Tally<'_>) {
        match rod.throughout(&edges) {
            Some(fluid) => self.evaluate_in(fluid, rod, along, edges, sums),
            None => self.evaluate_across(rod, along, edges, sums),
        }
    }

    fn in_pass(&self) -> Option<&dyn InPass> {
        Some(self)
    }

    fn parameters(&self) -> &[Key] {
        self.law.parameters()
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let property = Property::of(key);
        if property.is_none() && !self.law.parameters().contains(&key) {
            return [0.0; 2];
        }
        self.each_end(rod, |k, edge, half| {
            let (fluid, w) = (rod.here(k).fluid, rod.against_fluid(k));
            let force = match property {
                Some(property) => self.by_fluid(half, fluid, edge, w, &rod.by_property(property, k).fluid),
                None => {
                    let (length, half) = half;
                    let by = self.law.by_parameter(key, half, fluid, w.dot(&edge.t), w.dot(&edge.n()));
                    (edge.t * by.along + edge.n() * by.across) * *length
                }
            };
            add(out, k, force);
        });
        [0.0; 2]
    }
}
