//! Local drag: the force on a piece of the rod depends only on its own tangent and its own velocity relative to the
//! fluid.
//!
//! Each half of an edge acts on its own node with its length times the traction of the law there, which is of second
//! order in the mesh. A law is evaluated for both halves of an edge at once, one per SIMD lane, so that roots and
//! quotients of both take the time of one.

use std::ops::Range;

use nalgebra::Vector2;
use wide::f64x2;

use super::force::{EdgeForce, ExternalForces, Force, ForceAccumulator, FusedForce, Kinematics, PowerSums, Powers};
use super::medium::{DENSITY, Fluid, Key, Property, VISCOSITY};
use super::validity::Validity;
use crate::linear::{Block, BlockRow, Direction, Pair, Real, pair};
use crate::rod::damping::{Elastic, KelvinVoigt, MaterialLaw};
use crate::rod::elastic::Deformed;
use crate::rod::{Edge, EdgeValues, HalfEdge, Rod, add, node};

/// Force per unit length (N/m) that opposes velocities with components along and across the rod, on both halves of an
/// edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traction<T: Real = f64> {
    /// Its component along the tangent, N/m.
    pub along: T::Pair,
    /// Its component along the normal, N/m.
    pub across: T::Pair,
}

/// The derivatives of a traction with respect to the velocity's components, N s/m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TractionSlopes<T: Real = f64> {
    /// ∂(along)/∂(velocity along).
    pub along: T::Pair,
    /// ∂(across)/∂(velocity across).
    pub across: T::Pair,
    /// ∂(along)/∂(velocity across) and ∂(across)/∂(velocity along), if the components of the law are coupled.
    pub mixed: Option<[T::Pair; 2]>,
}

impl Default for Traction {
    fn default() -> Self {
        Self { along: f64x2::ZERO, across: f64x2::ZERO }
    }
}

impl<T: Real> Traction<T> {
    /// The traction of a linear law with the coefficients `along` and `across` (N s/m²) at the velocity components `u`
    /// and `w` (m/s), and its derivatives.
    #[inline(always)]
    pub fn linear([along, across]: [T::Pair; 2], u: T::Pair, w: T::Pair) -> (Self, TractionSlopes<T>) {
        (Self { along: along * u, across: across * w }, TractionSlopes { along, across, mixed: None })
    }
}

/// A local drag law.
pub trait Law: std::fmt::Debug + Send + Sync + 'static {
    /// The data of the law for both halves of an edge.
    type Halves: std::fmt::Debug + Copy + Default + PartialEq + Send + Sync;
    /// The data of the law for the fluids at both ends of an edge, computed once for all edges in a uniform fluid.
    type Fluids: Copy;

    /// Its name in a scene.
    fn name(&self) -> &'static str;

    /// The range of validity, and its source.
    fn validity(&self) -> Validity;

    /// True if it is linear in the velocity.
    fn is_linear(&self) -> bool;

    /// The law for the fluids at both ends of an edge.
    fn in_fluids(&self, fluids: [&Fluid; 2]) -> Self::Fluids;

    /// The traction at the velocities `along` and `across` the rod (m/s), relative to the fluid.
    fn traction(&self, halves: &Self::Halves, fluids: Self::Fluids, along: f64x2, across: f64x2) -> Traction;

    /// The traction with its derivatives.
    fn with_slopes(
        &self,
        halves: &Self::Halves,
        fluids: Self::Fluids,
        along: f64x2,
        across: f64x2,
    ) -> (Traction, TractionSlopes);

    /// The derivatives ∂(along)/∂(velocity along) and ∂(across)/∂(velocity across) (N s/m²) of a law that is
    /// proportional to the velocity and has no other derivatives.
    fn coefficients(&self, _halves: &Self::Halves, _fluids: Self::Fluids) -> Option<[f64x2; 2]> {
        None
    }

    /// The parameters that it depends on, by their keys in a scene.
    fn parameters(&self) -> &[Key];

    /// ∂(traction)/∂p for one of its parameters.
    fn by_parameter(
        &self,
        key: Key,
        halves: &Self::Halves,
        fluids: [&Fluid; 2],
        along: f64x2,
        across: f64x2,
    ) -> Traction;
}

/// The values `of` both halves of an edge.
pub fn both<T>(halves: &[T; 2], of: impl Fn(&T) -> f64) -> f64x2 {
    f64x2::new([of(&halves[0]), of(&halves[1])])
}

/// A factor `weight` on the drag of the head, up to the arc length `length` (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadWeight {
    /// The factor.
    pub weight: f64,
    /// Arc length up to which it applies, m.
    pub length: f64,
}

impl HeadWeight {
    /// No weight.
    pub const NONE: Self = Self { weight: 1.0, length: 0.0 };
}

/// A local law on both halves of every edge.
#[derive(Debug)]
pub struct LocalDrag<L: Law> {
    law: L,
    /// True for viscosity and density if the law depends on them.
    depends: [bool; 2],
    /// The weighted lengths (m) of both halves of each edge, and the data of the law for them.
    halves: EdgeValues<(f64x2, L::Halves)>,
}

impl<L: Law> LocalDrag<L> {
    /// Applies `law` to each edge of `rod`; `of` returns the data of the law for both halves of an edge. Each half has
    /// the exact mean of the weight over itself.
    pub fn new(law: L, rod: &Rod, head: HeadWeight, of: impl Fn(&[HalfEdge; 2]) -> L::Halves) -> Self {
        let weighted = |h: &HalfEdge| {
            let inside = (head.length - (h.middle - 0.5 * h.length)).clamp(0.0, h.length);
            h.length + (head.weight - 1.0) * inside
        };
        let halves: Vec<_> = rod.halves().map(|halves| (both(&halves, weighted), of(&halves))).collect();
        let depends = [VISCOSITY, DENSITY].map(|key| law.parameters().contains(&key));
        Self { law, depends, halves: halves.into() }
    }

    /// The law.
    pub fn law(&self) -> &L {
        &self.law
    }

    /// The weighted lengths (m) of both halves of edge `e`, and the data of the law for them.
    pub fn on_halves(&self, e: usize) -> &(f64x2, L::Halves) {
        &self.halves[e]
    }

    /// The change (N) of the opposing forces on the ends of an edge that move at `w` (m/s) relative to `fluids`, if
    /// these change by `changes`.
    #[inline(always)]
    fn by_fluids(
        &self,
        (lengths, halves): &(f64x2, L::Halves),
        fluids: [&Fluid; 2],
        edge: &Edge,
        w: [f64x2; 2],
        changes: [&Fluid; 2],
    ) -> [f64x2; 2] {
        let [u, v] = edge.components(w);
        let (mut along, mut across) = (f64x2::ZERO, f64x2::ZERO);
        let (viscosity, density) = (both(&changes, |change| change.viscosity), both(&changes, |change| change.density));
        if self.depends[0] && viscosity != f64x2::ZERO {
            let by = self.law.by_parameter(VISCOSITY, halves, fluids, u, v);
            (along, across) = (by.along * viscosity, by.across * viscosity);
        }
        if self.depends[1] && density != f64x2::ZERO {
            let by = self.law.by_parameter(DENSITY, halves, fluids, u, v);
            (along, across) = (along + by.along * density, across + by.across * density);
        }
        if changes.iter().any(|change| change.flow != Vector2::zeros()) {
            let (_, by) = self.law.with_slopes(halves, self.law.in_fluids(fluids), u, v);
            let [du, dv] = edge.components(changes.map(|change| pair(-change.flow)));
            let mixed = by.mixed.unwrap_or_default();
            along += by.along * du + mixed[0] * dv;
            across += mixed[1] * du + by.across * dv;
        }
        edge.vectors(along * *lengths, across * *lengths)
    }

    /// The opposing forces on `edges` in the uniform `fluid`.
    #[inline(always)]
    fn evaluate_in(
        &self,
        fluid: Fluid,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        let (flow, fluids) = (pair(fluid.flow), self.law.in_fluids([&fluid; 2]));
        let v = rod.v.as_chunks::<2>().0;
        let first = edges.start;
        let some = &rod.edges[edges.clone()];
        let v = &v[first..=edges.end];
        let here = edges.map(|e| &self.halves[e]).zip(some).zip(v.windows(2));
        let against = |v: &[[f64; 2]]| [f64x2::new(v[0]) - flow, f64x2::new(v[1]) - flow];
        match along {
            Some(direction) => {
                sums.each(here, |((halves, edge), v)| on_edge(&self.law, halves, fluids, edge, against(v), direction))
            }
            None => sums.each(here, |((halves, edge), v)| EdgeForce {
                force: push(&self.law, halves, fluids, edge, against(v)),
                ..EdgeForce::ZERO
            }),
        }
    }

    /// The same if the fluid changes along the edges.
    fn evaluate_across(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        let normal = pair(rod.normal());
        let ends = rod.around.along(edges.clone()).windows(2);
        sums.each(edges.zip(ends), |(e, ends)| {
            let (halves, edge) = (&self.halves[e], &rod.edges[e]);
            let fluids = [&ends[0].fluid, &ends[1].fluid];
            // Not `map` over both ends, which would be a call for each.
            let against = [pair(node(rod.v, e) - fluids[0].flow), pair(node(rod.v, e + 1) - fluids[1].flow)];
            let Some(direction) = along else {
                let force = push(&self.law, halves, self.law.in_fluids(fluids), edge, against);
                return EdgeForce { force, ..EdgeForce::ZERO };
            };
            let mut on = on_edge(&self.law, halves, self.law.in_fluids(fluids), edge, against, direction);
            if direction.q != 0.0 {
                let by_height = self.by_fluids(halves, fluids, edge, against, [&ends[0].slope, &ends[1].slope]);
                for (own, by_height) in on.own.iter_mut().zip(by_height) {
                    *own += Block::outer(Vector2::from(by_height.to_array()) * direction.q, normal);
                }
            }
            on
        });
    }
}

/// The opposing forces (N) of a law on the ends of `edge`, which move at `w` (m/s) relative to the fluid.
#[inline(always)]
fn push<L: Law>(
    law: &L,
    (lengths, halves): &(f64x2, L::Halves),
    fluids: L::Fluids,
    edge: &Edge,
    w: [f64x2; 2],
) -> [f64x2; 2] {
    let [u, v] = edge.components(w);
    let Traction { along, across } = law.traction(halves, fluids, u, v);
    edge.vectors(along * *lengths, across * *lengths)
}

/// The opposing forces (N) of a law on both ends of `edge`, which move at `w` (m/s) relative to the fluid, and their
/// derivatives along `direction` with respect to an end and to the edge vector.
#[inline(always)]
fn on_edge<L: Law>(
    law: &L,
    (lengths, halves): &(f64x2, L::Halves),
    fluids: L::Fluids,
    edge: &Edge,
    w: [f64x2; 2],
    direction: Direction,
) -> EdgeForce {
    let [u, v] = edge.components(w);
    around(edge, *lengths, [u, v], law.with_slopes(halves, fluids, u, v), direction)
}

/// The opposing forces of a traction on both ends of `edge`, whose halves have `lengths` (m) and move at `u` along and
/// `v` across it (m/s).
#[inline(always)]
pub(crate) fn around<T: Real>(
    edge: &Edge<T>,
    lengths: T::Pair,
    [u, v]: [T::Pair; 2],
    (Traction { along, across }, by): (Traction<T>, TractionSlopes<T>),
    direction: Direction,
) -> EdgeForce<T> {
    let (t, n) = (pair(edge.t), pair(edge.n()));
    let (tt, tn, nn) = (Block::outer(edge.t, t), Block::outer(edge.t, n), Block::outer(edge.n(), n));
    let force = edge.vectors(along * lengths, across * lengths);
    let by_velocity = lengths * edge.length.like(direction.v);
    // The edge turns by n·δe/ℓ; the velocity's components turn with it, and so does the traction.
    let turn = lengths * (edge.length.like(direction.q) * edge.per_length);
    let mut turned = [by.along * v - across, along - by.across * u];
    let own = match by.mixed {
        // a t tᵀ + b n nᵀ = b I + (a − b) t tᵀ.
        None => {
            let ([a0, a1], [b0, b1]) =
                (((by.along - by.across) * by_velocity).to_array(), (by.across * by_velocity).to_array());
            [tt * a0 + Block::diagonal(b0), tt * a1 + Block::diagonal(b1)]
        }
        Some([along, across]) => {
            turned = [turned[0] - along * u, turned[1] + across * v];
            let nt = tn.transpose();
            let (a, b) = ((by.along * by_velocity).to_array(), (along * by_velocity).to_array());
            let (c, d) = ((across * by_velocity).to_array(), (by.across * by_velocity).to_array());
            // Not `map` over both ends, which would be a call for each.
            [tt * a[0] + tn * b[0] + (nt * c[0] + nn * d[0]), tt * a[1] + tn * b[1] + (nt * c[1] + nn * d[1])]
        }
    };
    let (a, b) = ((turned[0] * turn).to_array(), (turned[1] * turn).to_array());
    EdgeForce { force, own, edge: [tn * a[0] + nn * b[0], tn * a[1] + nn * b[1]] }
}

/// Adds the powers of a `traction` on both halves of `edge`, with `lengths` (m), which move at `u` along and `w` across
/// it (m/s), to `sums`.
#[inline(always)]
pub(crate) fn add_powers<T: Real>(
    sums: &mut PowerSums<T>,
    edge: &Edge<T>,
    lengths: T::Pair,
    [u, w]: [T::Pair; 2],
    traction: Traction<T>,
) {
    let (along, across) = (traction.along * lengths, traction.across * lengths);
    sums.against_fluid += along * u + across * w;
    sums.opposing += pair(edge.t) * along.sum() + pair(edge.n()) * across.sum();
}

impl<L: Law> LocalDrag<L> {
    /// The pass over a rod of a `material`, compiled for each material type: a closure shared by both would be called
    /// for every edge.
    #[inline(never)]
    fn assemble_of(
        &self,
        material: impl MaterialLaw<f64>,
        rod: Deformed<'_>,
        fluid: Fluid,
        mut others: ExternalForces<'_>,
        residual: &mut [[f64; 2]],
        jacobian: Option<(&mut [BlockRow], Direction)>,
    ) {
        let (Self { law, halves, .. }, Kinematics { edges, v, .. }) = (self, others.rod);
        let alone = others.are_none();
        let direction = others.along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 });
        let (flow, fluids) = (pair(fluid.flow), law.in_fluids([&fluid; 2]));
        let ends = v.as_chunks::<2>().0.windows(2);
        let around = edges.iter().zip(ends).enumerate().map(|(e, (edge, v))| {
            let w = [f64x2::new(v[0]) - flow, f64x2::new(v[1]) - flow];
            let mut on = on_edge(law, &halves[e], fluids, edge, w, direction);
            if !alone {
                on.add(&others.on(e));
            }
            Some(on)
        });
        rod.assemble_with(material, around, residual, jacobian);
    }
}

impl<L: Law> FusedForce for LocalDrag<L> {
    fn assemble(
        &self,
        rod: Deformed<'_>,
        damped: Option<KelvinVoigt<'_>>,
        fluid: Fluid,
        others: ExternalForces<'_>,
        residual: &mut [[f64; 2]],
        jacobian: Option<(&mut [BlockRow], Direction)>,
    ) {
        match damped {
            None => self.assemble_of(Elastic, rod, fluid, others, residual, jacobian),
            Some(damped) => self.assemble_of(damped, rod, fluid, others, residual, jacobian),
        }
    }

    fn coefficients(&self, fluid: Fluid, e: usize) -> Option<[f64x2; 3]> {
        let (lengths, halves) = &self.halves[e];
        let [along, across] = self.law.coefficients(halves, self.law.in_fluids([&fluid; 2]))?;
        Some([*lengths, along, across])
    }

    fn powers(&self, rod: &Kinematics<'_>, fluid: Fluid, edges: Range<usize>) -> Powers {
        let (law, flow, fluids) = (&self.law, fluid.flow, self.law.in_fluids([&fluid; 2]));
        let mut sums = PowerSums::none(0.0);
        let ends = rod.v.as_chunks::<2>().0[edges.start..=edges.end].windows(2);
        for (e, (edge, v)) in edges.clone().zip(rod.edges[edges].iter().zip(ends)) {
            let (lengths, halves) = &self.halves[e];
            let [u, w] = edge.components([f64x2::new(v[0]) - pair(flow), f64x2::new(v[1]) - pair(flow)]);
            add_powers(&mut sums, edge, *lengths, [u, w], law.traction(halves, fluids, u, w));
        }
        sums.powers(flow)
    }
}

impl<L: Law> Force for LocalDrag<L> {
    fn name(&self) -> &'static str {
        self.law.name()
    }

    fn validity(&self) -> Validity {
        self.law.validity()
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn is_linear(&self) -> bool {
        self.law.is_linear()
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        match rod.everywhere() {
            Some(fluid) => self.evaluate_in(fluid, rod, along, edges, sums),
            None => self.evaluate_across(rod, along, edges, sums),
        }
    }

    fn fused(&self) -> Option<&dyn FusedForce> {
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
        for (e, edge) in rod.edges.iter().enumerate() {
            let here = [rod.here(e), rod.here(e + 1)];
            let (fluids, w) = ([&here[0].fluid, &here[1].fluid], [e, e + 1].map(|k| pair(rod.against_fluid(k))));
            let forces = match property {
                Some(property) => {
                    let by = [e, e + 1].map(|k| rod.by_property(property, k));
                    self.by_fluids(&self.halves[e], fluids, edge, w, [&by[0].fluid, &by[1].fluid])
                }
                None => {
                    let ((lengths, halves), [u, w]) = (&self.halves[e], edge.components(w));
                    let by = self.law.by_parameter(key, halves, fluids, u, w);
                    edge.vectors(by.along * *lengths, by.across * *lengths)
                }
            };
            for (k, force) in [e, e + 1].into_iter().zip(forces) {
                add(out, k, force.to_array().into());
            }
        }
        [0.0; 2]
    }
}
