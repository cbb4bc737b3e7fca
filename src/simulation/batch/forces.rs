//! Forces in SIMD lanes: local drag laws, the reactive force (added mass) on edges, and the wake at the tip.

use std::any::Any;
use std::fmt::Debug;

use fearless_simd::Avx2;
use fearless_simd::prelude::*;
use nalgebra::Vector2;
use wide::f64x2;

use super::WIDTH;
use super::lanes::{Lanes, PairLanes, two};
use crate::fluid::force::{self, PowerSums, Powers, TipForce};
use crate::fluid::laws::cross_flow::{Coefficients, CrossFlow};
use crate::fluid::laws::weak_inertia::WeakInertia;
use crate::fluid::local::{self, Law, LocalDrag, Traction, TractionSlopes};
use crate::fluid::reactive::{Accelerating, Reactive, Stored, Wake};
use crate::fluid::{Fluid, Force, Forces, FroudeKrylov, Kinematics};
use crate::linear::{Direction, Number, Pair};
use crate::model::Model;
use crate::rod::Edge;
use crate::rod::edge_force::EdgeForce;

/// All forces on the rods except drag that is linear in velocity.
#[derive(Debug)]
pub struct BatchedForces {
    /// Forces on edges, with their indices.
    forces: Vec<(usize, Box<dyn BatchedForce>)>,
    /// Indices of forces on the tip.
    tips: Vec<usize>,
}

/// The motion of rods in lanes.
#[derive(Debug, Clone, Copy)]
pub struct LaneMotion<'a> {
    /// Edges.
    pub edges: &'a [Edge<Lanes>],
    /// Positions, velocities and accelerations of the nodes.
    pub q: &'a [[Lanes; 2]],
    pub v: &'a [[Lanes; 2]],
    pub a: &'a [[Lanes; 2]],
    /// Velocity of the steady flow.
    pub flow: PairLanes,
}

/// A force on edges, in lanes.
trait BatchedForce: Debug + Send {
    /// Adds its opposing forces to `sums`, or overwrites `sums` if it is the `first` force.
    fn add(&self, simd: Avx2, rods: &LaneMotion<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]);

    /// Its totals over the rods.
    fn measure(&self, simd: Avx2, rods: &LaneMotion<'_>) -> ForceTotals;

    /// Moves the case in `lane`, whose force is `own`, to another `fluid`.
    fn enter(&mut self, lane: usize, own: &dyn Force, fluid: Fluid);
}

/// Totals of a force over the rods.
#[derive(Debug, Clone, Copy)]
pub struct ForceTotals {
    /// Sums from which the powers of the force follow.
    pub sums: PowerSums<Lanes>,
    /// Energy (J) and momentum (N s) that the force stores.
    pub stored: (Lanes, [Lanes; 2]),
    /// Opposing force on the first node, N.
    pub first: PairLanes,
}

impl ForceTotals {
    /// All zero.
    #[inline(always)]
    pub fn none(zero: Lanes) -> Self {
        Self { sums: PowerSums::none(zero), stored: (zero, [zero; 2]), first: PairLanes::new([zero; 2]) }
    }

    /// Powers of one case in a `flow`, with its stored energy and momentum.
    fn of_case(&self, lane: usize, flow: Vector2<f64>) -> (Powers, (f64, Vector2<f64>)) {
        let one = |x: Lanes| x.get(lane);
        let two = |pair: PairLanes| f64x2::new(pair.to_array().map(one));
        let Self { sums: PowerSums { opposing, against_fluid }, stored: (energy, momentum), .. } = *self;
        let sums = PowerSums { opposing: two(opposing), against_fluid: two(against_fluid) };
        (sums.powers(flow), (one(energy), momentum.map(one).into()))
    }
}

impl BatchedForces {
    /// The forces of `models`, in steady flows, except force `but`. `None` if one of them cannot be batched.
    pub fn of(simd: Avx2, models: [&Model; WIDTH], but: Option<usize>) -> Option<Self> {
        let mut others = Self { forces: Vec::new(), tips: Vec::new() };
        for i in (0..models[0].forces.0.len()).filter(|i| but != Some(*i)) {
            let cases = each(|lane| models[lane].forces.0.get(i).map(|force| &**force))?;
            if all::<FroudeKrylov>(cases).is_some() {
                // This force acts only in an accelerating flow, and the flow is steady here.
            } else if all::<Wake>(cases).is_some() {
                others.tips.push(i);
            } else {
                let edges = models[0].rod.nodes - 1;
                let fluids = models.map(|model| model.fluid);
                let force = drag::<CrossFlow>(simd, cases, fluids, edges)
                    .or_else(|| drag::<WeakInertia>(simd, cases, fluids, edges))
                    .or_else(|| water(simd, cases, fluids, edges))?;
                others.forces.push((i, force));
            }
        }
        Some(others)
    }

    /// True if there are no other forces.
    pub fn are_none(&self) -> bool {
        self.forces.is_empty() && self.tips.is_empty()
    }

    /// Number of forces on the tip.
    pub fn tips(&self) -> usize {
        self.tips.len()
    }

    /// True if any force acts on edges.
    pub fn are_on_edges(&self) -> bool {
        !self.forces.is_empty()
    }

    /// Writes the opposing forces on the edges to `sums`.
    pub fn on_edges(&self, simd: Avx2, rods: &LaneMotion<'_>, direction: Direction, sums: &mut [EdgeForce<Lanes>]) {
        for (i, (_, force)) in self.forces.iter().enumerate() {
            force.add(simd, rods, direction, i == 0, sums);
        }
    }

    /// Visits the `forces` on the last node of the case in `lane`, which is in `fluid`.
    pub fn on_tip(
        &self,
        forces: &Forces,
        lane: usize,
        rods: &LaneMotion<'_>,
        fluid: Fluid,
        direction: Direction,
        visit: impl FnMut(TipForce),
    ) {
        if !self.tips.is_empty() {
            rods.at_end(lane, fluid, |end| {
                self.tips.iter().filter_map(|i| forces.0.get(*i)?.tip(end, Some(direction))).for_each(visit);
            });
        }
    }

    /// Moves the case in `lane`, which has these `forces`, to another `fluid`.
    pub fn enter(&mut self, lane: usize, forces: &Forces, fluid: Fluid) {
        for (i, force) in &mut self.forces {
            if let Some(own) = forces.0.get(*i) {
                force.enter(lane, &**own, fluid);
            }
        }
    }

    /// Writes the totals of each force on edges to its entry in `all`.
    pub fn measure(&self, simd: Avx2, rods: &LaneMotion<'_>, all: &mut [ForceTotals]) {
        for (i, force) in &self.forces {
            all[*i] = force.measure(simd, rods);
        }
    }

    /// Powers of force `i` on the case in `lane`, which is in `fluid`, with the energy (J) and momentum (N s) that the force
    /// stores; `all` are the [measured](Self::measure) totals.
    pub fn of_case(
        &self,
        (i, force): (usize, &dyn Force),
        lane: usize,
        rods: &LaneMotion<'_>,
        fluid: Fluid,
        all: &[ForceTotals],
    ) -> (Powers, (f64, Vector2<f64>)) {
        if self.tips.contains(&i) {
            let powers = rods.at_end(lane, fluid, |end| force::powers(force, end)).unwrap_or_default();
            return (powers, Default::default());
        }
        all[i].of_case(lane, fluid.flow)
    }
}

impl LaneMotion<'_> {
    /// Evaluates `look` on the last edge of a case, since a force on the tip depends on nothing else.
    fn at_end<R>(&self, lane: usize, fluid: Fluid, look: impl FnOnce(&Kinematics<'_>) -> R) -> Option<R> {
        let LaneMotion {
            edges: [.., before, last], q: [.., q0, q1, q2], v: [.., v0, v1, v2], a: [.., a0, a1, a2], ..
        } = *self
        else {
            return None;
        };
        let edges = [before.of_case(lane), last.of_case(lane)];
        let nodes = |nodes: [&[Lanes; 2]; 3]| {
            let [a, b, c] = nodes.map(|node| node.map(|x| x.get(lane)));
            [a[0], a[1], b[0], b[1], c[0], c[1]]
        };
        let (q, v, a) = (nodes([q0, q1, q2]), nodes([v0, v1, v2]), nodes([a0, a1, a2]));
        Some(look(&Kinematics::within(fluid, &edges, [&q, &v, &a])))
    }
}

impl Edge<Lanes> {
    /// The edge of one case.
    fn of_case(&self, lane: usize) -> Edge {
        let Self { t, length, per_length } = self;
        Edge { t: t.map(|x| x.get(lane)), length: length.get(lane), per_length: per_length.get(lane) }
    }
}

/// The values of `of` for each case; `None` if one is missing.
fn each<T: Copy>(of: impl Fn(usize) -> Option<T>) -> Option<[T; WIDTH]> {
    let first = of(0)?;
    let mut all = [first; WIDTH];
    for (lane, one) in all.iter_mut().enumerate() {
        *one = of(lane)?;
    }
    Some(all)
}

/// The forces downcast to their type; `None` if they differ.
fn all<F: Force>(cases: [&dyn Force; WIDTH]) -> Option<[&F; WIDTH]> {
    each(|lane| (cases[lane] as &dyn Any).downcast_ref())
}

/// A local drag law that can be evaluated in lanes.
trait BatchedLaw: Law<Fluids = [f64x2; 3]> {
    /// Its coefficients on both halves of an edge.
    type Numbers: Debug + Copy + Send;

    /// Gathers the coefficients of each case into lanes.
    fn numbers(gather: impl Fn(fn(&Self::Halves) -> f64x2) -> PairLanes) -> Self::Numbers;

    /// See [`Law::with_slopes`].
    fn slopes(
        numbers: &Self::Numbers,
        fluids: [PairLanes; 3],
        u: PairLanes,
        w: PairLanes,
    ) -> (Traction<Lanes>, TractionSlopes<Lanes>);
}

impl BatchedLaw for CrossFlow {
    type Numbers = Coefficients<PairLanes>;

    fn numbers(gather: impl Fn(fn(&Coefficients) -> f64x2) -> PairLanes) -> Coefficients<PairLanes> {
        Coefficients::gathered(gather)
    }

    #[inline(always)]
    fn slopes(
        numbers: &Coefficients<PairLanes>,
        fluids: [PairLanes; 3],
        u: PairLanes,
        w: PairLanes,
    ) -> (Traction<Lanes>, TractionSlopes<Lanes>) {
        numbers.with_slopes(fluids, u, w)
    }
}

impl BatchedLaw for WeakInertia {
    type Numbers = [PairLanes; 2];

    fn numbers(gather: impl Fn(fn(&[f64x2; 2]) -> f64x2) -> PairLanes) -> [PairLanes; 2] {
        [gather(|halves| halves[0]), gather(|halves| halves[1])]
    }

    #[inline(always)]
    fn slopes(
        halves: &[PairLanes; 2],
        fluids: [PairLanes; 3],
        u: PairLanes,
        w: PairLanes,
    ) -> (Traction<Lanes>, TractionSlopes<Lanes>) {
        Self::slopes(*halves, fluids, u, w)
    }
}

/// A local drag law, evaluated on both halves of each edge of all cases.
#[derive(Debug)]
struct BatchedDrag<L: BatchedLaw> {
    /// Lengths of the halves with the coefficients of the law.
    halves: Vec<(PairLanes, L::Numbers)>,
    fluids: [PairLanes; 3],
}

/// Drag by the law `L`, if all of the forces have it.
fn drag<L: BatchedLaw>(
    simd: Avx2,
    cases: [&dyn Force; WIDTH],
    fluids: [Fluid; WIDTH],
    edges: usize,
) -> Option<Box<dyn BatchedForce>> {
    let drags = all::<LocalDrag<L>>(cases)?;
    let of_edge = |e: usize| {
        let halves = drags.map(|drag| drag.on_halves(e));
        let numbers = L::numbers(|of| two(simd, |lane| of(&halves[lane].1).to_array()));
        (two(simd, |lane| halves[lane].0.to_array()), numbers)
    };
    let in_fluids: [[f64x2; 3]; WIDTH] = std::array::from_fn(|lane| drags[lane].law().in_fluids([&fluids[lane]; 2]));
    let fluids = [0, 1, 2].map(|i| two(simd, |lane| in_fluids[lane][i].to_array()));
    Some(Box::new(BatchedDrag::<L> { halves: (0..edges).map(of_edge).collect(), fluids }))
}

impl<L: BatchedLaw> BatchedForce for BatchedDrag<L> {
    fn add(&self, simd: Avx2, rods: &LaneMotion<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]) {
        let LaneMotion { edges, v, flow, .. } = *rods;
        simd.vectorize(
            #[inline(always)]
            || {
                for (((edge, v), (lengths, numbers)), sum) in edges.iter().zip(v.windows(2)).zip(&self.halves).zip(sums)
                {
                    let [u, w] = against(edge, v, flow);
                    let traction = L::slopes(numbers, self.fluids, u, w);
                    put(sum, first, local::around(edge, *lengths, [u, w], traction, direction));
                }
            },
        );
    }

    fn measure(&self, simd: Avx2, rods: &LaneMotion<'_>) -> ForceTotals {
        simd.vectorize(
            #[inline(always)]
            || {
                let halves = self.halves.iter().map(
                    #[inline(always)]
                    |(lengths, numbers)| (*lengths, (self.fluids, numbers)),
                );
                measure_drag(
                    rods,
                    halves,
                    #[inline(always)]
                    |(fluids, numbers), u, w| L::slopes(numbers, fluids, u, w).0,
                )
            },
        )
    }

    fn enter(&mut self, lane: usize, own: &dyn Force, fluid: Fluid) {
        let Some(drag) = (own as &dyn Any).downcast_ref::<LocalDrag<L>>() else { return };
        let in_fluid = drag.law().in_fluids([&fluid; 2]);
        self.fluids.iter_mut().zip(in_fluid).for_each(|(to, from)| to.set(lane, from.to_array()));
    }
}

/// The velocities (m/s) `v` of the ends of `edge` relative to the `flow`, along and across the edge.
#[inline(always)]
pub fn against(edge: &Edge<Lanes>, v: &[[Lanes; 2]], flow: PairLanes) -> [PairLanes; 2] {
    edge.components([PairLanes::new(v[0]) - flow, PairLanes::new(v[1]) - flow])
}

/// The totals of drag over the rods. `of` returns the traction on `halves`, given their coefficients and the velocities along and
/// across.
#[inline(always)]
pub fn measure_drag<K>(
    rods: &LaneMotion<'_>,
    halves: impl Iterator<Item = (PairLanes, K)>,
    of: impl Fn(K, PairLanes, PairLanes) -> Traction<Lanes>,
) -> ForceTotals {
    let LaneMotion { edges, v, flow, .. } = *rods;
    let mut whole = ForceTotals::none(edges[0].length.like(0.0));
    for (e, ((edge, v), (lengths, known))) in edges.iter().zip(v.windows(2)).zip(halves).enumerate() {
        let [u, w] = against(edge, v, flow);
        let traction = of(known, u, w);
        local::add_powers(&mut whole.sums, edge, lengths, [u, w], traction);
        if e == 0 {
            [whole.first, _] = edge.vectors(traction.along * lengths, traction.across * lengths);
        }
    }
    whole
}

/// The reactive force: the added mass c of both halves of each edge.
#[derive(Debug)]
struct BatchedReactive(Vec<PairLanes>);

/// The batched [`Reactive`] force, if all of the forces are that.
fn water(
    simd: Avx2,
    cases: [&dyn Force; WIDTH],
    fluids: [Fluid; WIDTH],
    edges: usize,
) -> Option<Box<dyn BatchedForce>> {
    let cases = all::<Reactive>(cases)?;
    let c = |e: usize| two(simd, |lane| cases[lane].inertia(e, [fluids[lane].density; 2]).to_array());
    Some(Box::new(BatchedReactive((0..edges).map(c).collect())))
}

impl BatchedForce for BatchedReactive {
    fn add(&self, simd: Avx2, rods: &LaneMotion<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]) {
        let LaneMotion { edges, v, a, flow, .. } = *rods;
        simd.vectorize(
            #[inline(always)]
            || {
                let ends = v.windows(2).zip(a.windows(2));
                for (((edge, ends), c), sum) in edges.iter().zip(ends).zip(&self.0).zip(sums) {
                    put(sum, first, accelerating(edge, *c, ends, flow).on_edge(edge, direction));
                }
            },
        );
    }

    fn measure(&self, simd: Avx2, rods: &LaneMotion<'_>) -> ForceTotals {
        let LaneMotion { edges, v, a, flow, .. } = *rods;
        simd.vectorize(
            #[inline(always)]
            || {
                let zero = edges[0].length.like(0.0);
                let (mut whole, mut stored) = (ForceTotals::none(zero), Stored::none(zero));
                let ends = v.windows(2).zip(a.windows(2));
                for (e, ((edge, ends), c)) in edges.iter().zip(ends).zip(&self.0).enumerate() {
                    let moving = accelerating(edge, *c, ends, flow);
                    let forces = moving.force_on(edge);
                    for (force, v) in forces.into_iter().zip(ends.0) {
                        whole.sums.add(force, PairLanes::new(*v) - flow);
                    }
                    stored.add(edge, *c, moving.velocity[1]);
                    if e == 0 {
                        [whole.first, _] = forces;
                    }
                }
                whole.stored = stored.sum();
                whole
            },
        )
    }

    fn enter(&mut self, lane: usize, own: &dyn Force, fluid: Fluid) {
        let Some(reactive) = (own as &dyn Any).downcast_ref::<Reactive>() else { return };
        for (e, c) in self.0.iter_mut().enumerate() {
            c.set(lane, reactive.inertia(e, [fluid.density; 2]).to_array());
        }
    }
}

/// The acceleration of the water around `edge`, given the velocities and accelerations of its ends.
#[inline(always)]
fn accelerating(
    edge: &Edge<Lanes>,
    c: PairLanes,
    (v, a): (&[[Lanes; 2]], &[[Lanes; 2]]),
    flow: PairLanes,
) -> Accelerating<Lanes> {
    let opening = [v[1][0] - v[0][0], v[1][1] - v[0][1]];
    let (t, n) = (edge.t, edge.n());
    Accelerating {
        c,
        velocity: against(edge, v, flow),
        acceleration: edge.components([PairLanes::new(a[0]), PairLanes::new(a[1])]),
        opening: [opening[0] * t.x + opening[1] * t.y, opening[0] * n.x + opening[1] * n.y],
    }
}

/// Sets `sum` if the force is the `first`, and otherwise adds to it.
#[inline(always)]
fn put(sum: &mut EdgeForce<Lanes>, first: bool, on: EdgeForce<Lanes>) {
    if first { *sum = on } else { sum.add(&on) }
}
