//! Forces on rods in lanes: those that know each edge by itself, and what leaves the tail.

use std::any::Any;
use std::fmt::Debug;

use fearless_simd::Avx2;
use fearless_simd::prelude::*;
use nalgebra::Vector2;
use wide::f64x2;

use super::WIDTH;
use super::kernel::{against, two};
use super::lanes::{Lanes, Two};
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

/// What acts on the rods beside a drag in proportion to the velocity.
#[derive(Debug)]
pub struct Others {
    /// Those on edges, with their places.
    forces: Vec<(usize, Box<dyn InLanes>)>,
    /// The places of those that act on the tip.
    tips: Vec<usize>,
}

/// How rods in lanes move.
#[derive(Debug, Clone, Copy)]
pub struct Motions<'a> {
    /// Edges.
    pub edges: &'a [Edge<Lanes>],
    /// Positions, velocities and accelerations.
    pub q: &'a [[Lanes; 2]],
    pub v: &'a [[Lanes; 2]],
    pub a: &'a [[Lanes; 2]],
    /// Velocity of the flow, which does not accelerate.
    pub flow: Two,
}

/// A force in lanes.
trait InLanes: Debug + Send {
    /// Adds what opposes the edges to `sums`, where it is not the `first` that does.
    fn add(&self, simd: Avx2, rods: &Motions<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]);

    /// What it comes to on the whole rods.
    fn measure(&self, simd: Avx2, rods: &Motions<'_>) -> Whole;
}

/// What a force on whole rods comes to.
#[derive(Debug, Clone, Copy)]
pub struct Whole {
    /// What its powers are summed up from.
    pub sums: PowerSums<Lanes>,
    /// Energy (J) and momentum (N s) that it stores.
    pub stored: (Lanes, [Lanes; 2]),
    /// What it opposes the first node with, N.
    pub first: Two,
}

impl Whole {
    /// Nothing yet.
    #[inline(always)]
    pub fn none(zero: Lanes) -> Self {
        Self { sums: PowerSums::none(zero), stored: (zero, [zero; 2]), first: Two::new([zero; 2]) }
    }

    /// That of a case in a `flow`: powers, and what is stored.
    fn of_case(&self, lane: usize, flow: Vector2<f64>) -> (Powers, (f64, Vector2<f64>)) {
        let one = |x: Lanes| x.get(lane);
        let two = |pair: Two| f64x2::new(pair.to_array().map(one));
        let Self { sums: PowerSums { opposing, against_fluid }, stored: (energy, momentum), .. } = *self;
        let sums = PowerSums { opposing: two(opposing), against_fluid: two(against_fluid) };
        (sums.powers(flow), (one(energy), momentum.map(one).into()))
    }
}

impl Others {
    /// The forces of `models`, in steady flows, but for the one at the place `but`; `None` where one of them cannot be in lanes.
    pub fn of(simd: Avx2, models: [&Model; WIDTH], but: Option<usize>) -> Option<Self> {
        let mut others = Self { forces: Vec::new(), tips: Vec::new() };
        for i in (0..models[0].forces.0.len()).filter(|i| but != Some(*i)) {
            let cases = each(|lane| models[lane].forces.0.get(i).map(|force| &**force))?;
            if all::<FroudeKrylov>(cases).is_some() {
                // It pushes where the flow accelerates, which it does not.
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

    /// True where there are none.
    pub fn are_none(&self) -> bool {
        self.forces.is_empty() && self.tips.is_empty()
    }

    /// How many act on the tip.
    pub fn tips(&self) -> usize {
        self.tips.len()
    }

    /// True where any act on edges.
    pub fn are_on_edges(&self) -> bool {
        !self.forces.is_empty()
    }

    /// Writes what opposes the edges to `sums`.
    pub fn on_edges(&self, simd: Avx2, rods: &Motions<'_>, direction: Direction, sums: &mut [EdgeForce<Lanes>]) {
        for (i, (_, force)) in self.forces.iter().enumerate() {
            force.add(simd, rods, direction, i == 0, sums);
        }
    }

    /// Visits what of the `forces` of the case in `lane`, which is in `fluid`, opposes the last node.
    pub fn on_tip(
        &self,
        forces: &Forces,
        lane: usize,
        rods: &Motions<'_>,
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

    /// Writes what each force on edges comes to at its place in `all`.
    pub fn measure(&self, simd: Avx2, rods: &Motions<'_>, all: &mut [Whole]) {
        for (i, force) in &self.forces {
            all[*i] = force.measure(simd, rods);
        }
    }

    /// The powers of the `force` at place `i` on the case in `lane`, which is in `fluid`, and energy (J) and momentum (N s) that it stores;
    /// `all` is what was [measured](Self::measure).
    pub fn of_case(
        &self,
        (i, force): (usize, &dyn Force),
        lane: usize,
        rods: &Motions<'_>,
        fluid: Fluid,
        all: &[Whole],
    ) -> (Powers, (f64, Vector2<f64>)) {
        if self.tips.contains(&i) {
            let powers = rods.at_end(lane, fluid, |end| force::powers(force, end)).unwrap_or_default();
            return (powers, Default::default());
        }
        all[i].of_case(lane, fluid.flow)
    }
}

impl Motions<'_> {
    /// Looks at the end of the rod of a case, which is all that a force on the tip may depend on.
    fn at_end<R>(&self, lane: usize, fluid: Fluid, look: impl FnOnce(&Kinematics<'_>) -> R) -> Option<R> {
        let Motions {
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
    /// That of one case.
    fn of_case(&self, lane: usize) -> Edge {
        let Self { t, length, per_length } = self;
        Edge { t: t.map(|x| x.get(lane)), length: length.get(lane), per_length: per_length.get(lane) }
    }
}

/// What `of` has of every case; none where one has none.
fn each<T: Copy>(of: impl Fn(usize) -> Option<T>) -> Option<[T; WIDTH]> {
    let first = of(0)?;
    let mut all = [first; WIDTH];
    for (lane, one) in all.iter_mut().enumerate() {
        *one = of(lane)?;
    }
    Some(all)
}

/// The forces as what they are, if all are that.
fn all<F: Force>(cases: [&dyn Force; WIDTH]) -> Option<[&F; WIDTH]> {
    each(|lane| (cases[lane] as &dyn Any).downcast_ref())
}

/// A local law in lanes.
trait LawInLanes: Law<Fluids = [f64x2; 3]> {
    /// What it knows of both halves of an edge.
    type Numbers: Debug + Copy + Send;

    /// From what each case knows: `gather` puts pairs into lanes.
    fn numbers(gather: impl Fn(fn(&Self::Halves) -> f64x2) -> Two) -> Self::Numbers;

    /// See [`Law::with_slopes`].
    fn slopes(numbers: &Self::Numbers, fluids: [Two; 3], u: Two, w: Two) -> (Traction<Lanes>, TractionSlopes<Lanes>);
}

impl LawInLanes for CrossFlow {
    type Numbers = Coefficients<Two>;

    fn numbers(gather: impl Fn(fn(&Coefficients) -> f64x2) -> Two) -> Coefficients<Two> {
        Coefficients::gathered(gather)
    }

    #[inline(always)]
    fn slopes(
        numbers: &Coefficients<Two>,
        fluids: [Two; 3],
        u: Two,
        w: Two,
    ) -> (Traction<Lanes>, TractionSlopes<Lanes>) {
        numbers.with_slopes(fluids, u, w)
    }
}

impl LawInLanes for WeakInertia {
    type Numbers = [Two; 2];

    fn numbers(gather: impl Fn(fn(&[f64x2; 2]) -> f64x2) -> Two) -> [Two; 2] {
        [gather(|halves| halves[0]), gather(|halves| halves[1])]
    }

    #[inline(always)]
    fn slopes(halves: &[Two; 2], fluids: [Two; 3], u: Two, w: Two) -> (Traction<Lanes>, TractionSlopes<Lanes>) {
        Self::slopes(*halves, fluids, u, w)
    }
}

/// A local law on every half of every edge of the rods.
#[derive(Debug)]
struct Drag<L: LawInLanes> {
    /// Lengths of the halves and what the law knows of them.
    halves: Vec<(Two, L::Numbers)>,
    fluids: [Two; 3],
}

/// Drag by the law `L`, if that is what the forces are.
fn drag<L: LawInLanes>(
    simd: Avx2,
    cases: [&dyn Force; WIDTH],
    fluids: [Fluid; WIDTH],
    edges: usize,
) -> Option<Box<dyn InLanes>> {
    let drags = all::<LocalDrag<L>>(cases)?;
    let of_edge = |e: usize| {
        let halves = drags.map(|drag| drag.on_halves(e));
        let numbers = L::numbers(|of| two(simd, |lane| of(&halves[lane].1).to_array()));
        (two(simd, |lane| halves[lane].0.to_array()), numbers)
    };
    let in_fluids: [[f64x2; 3]; WIDTH] = std::array::from_fn(|lane| drags[lane].law().in_fluids([&fluids[lane]; 2]));
    let fluids = [0, 1, 2].map(|i| two(simd, |lane| in_fluids[lane][i].to_array()));
    Some(Box::new(Drag::<L> { halves: (0..edges).map(of_edge).collect(), fluids }))
}

impl<L: LawInLanes> InLanes for Drag<L> {
    fn add(&self, simd: Avx2, rods: &Motions<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]) {
        let Motions { edges, v, flow, .. } = *rods;
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

    fn measure(&self, simd: Avx2, rods: &Motions<'_>) -> Whole {
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
}

/// What drag comes to on the whole rods: `of` finds the traction on `halves` of given lengths, from what is known of them and the
/// velocities along and across.
#[inline(always)]
pub fn measure_drag<K>(
    rods: &Motions<'_>,
    halves: impl Iterator<Item = (Two, K)>,
    of: impl Fn(K, Two, Two) -> Traction<Lanes>,
) -> Whole {
    let Motions { edges, v, flow, .. } = *rods;
    let mut whole = Whole::none(edges[0].length.like(0.0));
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

/// The inertia of the water around the rods: c of both halves of every edge.
#[derive(Debug)]
struct Water(Vec<Two>);

/// That of [`Reactive`], if that is what the forces are.
fn water(simd: Avx2, cases: [&dyn Force; WIDTH], fluids: [Fluid; WIDTH], edges: usize) -> Option<Box<dyn InLanes>> {
    let cases = all::<Reactive>(cases)?;
    let c = |e: usize| two(simd, |lane| cases[lane].inertia(e, [fluids[lane].density; 2]).to_array());
    Some(Box::new(Water((0..edges).map(c).collect())))
}

impl InLanes for Water {
    fn add(&self, simd: Avx2, rods: &Motions<'_>, direction: Direction, first: bool, sums: &mut [EdgeForce<Lanes>]) {
        let Motions { edges, v, a, flow, .. } = *rods;
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

    fn measure(&self, simd: Avx2, rods: &Motions<'_>) -> Whole {
        let Motions { edges, v, a, flow, .. } = *rods;
        simd.vectorize(
            #[inline(always)]
            || {
                let zero = edges[0].length.like(0.0);
                let (mut whole, mut stored) = (Whole::none(zero), Stored::none(zero));
                let ends = v.windows(2).zip(a.windows(2));
                for (e, ((edge, ends), c)) in edges.iter().zip(ends).zip(&self.0).enumerate() {
                    let moving = accelerating(edge, *c, ends, flow);
                    let forces = moving.force_on(edge);
                    for (force, v) in forces.into_iter().zip(ends.0) {
                        whole.sums.add(force, Two::new(*v) - flow);
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
}

/// How the water around `edge` is accelerated, whose ends have these velocities and accelerations.
#[inline(always)]
fn accelerating(edge: &Edge<Lanes>, c: Two, (v, a): (&[[Lanes; 2]], &[[Lanes; 2]]), flow: Two) -> Accelerating<Lanes> {
    let opening = [v[1][0] - v[0][0], v[1][1] - v[0][1]];
    let (t, n) = (edge.t, edge.n());
    Accelerating {
        c,
        velocity: against(edge, v, flow),
        acceleration: edge.components([Two::new(a[0]), Two::new(a[1])]),
        opening: [opening[0] * t.x + opening[1] * t.y, opening[0] * n.x + opening[1] * n.y],
    }
}

/// Makes `sum` what acts `first`, or adds to it.
#[inline(always)]
fn put(sum: &mut EdgeForce<Lanes>, first: bool, on: EdgeForce<Lanes>) {
    if first { *sum = on } else { sum.add(&on) }
}
