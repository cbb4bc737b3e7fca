//! What acts on the rod from outside: a list of forces, each with exact derivatives, its energy and what it takes.
//!
//! A force acts on the two ends of every edge. It is written as what *opposes* the motion, M a + ∇E + ΣF = W, and may depend
//! on positions, velocities and accelerations of both nodes, on the edge between them, and on time. Its derivatives are given
//! along a [`Direction`], so a force never sees a step size, and in a form that serves positions and the chain form alike:
//! for either end, how the force changes where the whole edge moves with that end, and how it changes where the edge vector
//! e = x_{k+1} − x_k changes while that end stays.

use std::any::Any;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use wide::f64x2;

use super::fluid_along::{FluidAlong, FluidRuns};
use super::medium::{DENSITY, Fluid, Key, Layers, LocalFluid, Property};
use super::validity::Validity;
use crate::linear::{BlockRow, Coupling, Direction, Pair, Real, pair};
use crate::rod::damping::KelvinVoigt;
pub use crate::rod::edge_force::{EDGES_PER_BLOCK, EdgeForce};
use crate::rod::elastic::Deformed;
use crate::rod::{Edge, Rod, add, node};

/// How the rod lies and moves, and in which fluid.
#[derive(Debug, Clone, Copy)]
pub struct Kinematics<'a> {
    /// Time, s.
    pub t: f64,
    /// The edges.
    pub edges: &'a [Edge],
    /// Positions, m, two entries per node.
    pub q: &'a [f64],
    /// Velocities, m/s, two entries per node.
    pub v: &'a [f64],
    /// Accelerations, m/s², two entries per node.
    pub a: &'a [f64],
    /// The fluid; where there are layers, that before the first interface.
    pub fluid: Fluid,
    /// What lies beyond it; `None` where the medium is uniform.
    pub layers: Option<&'a Layers>,
    /// The fluid found along it; nothing where nobody has looked yet.
    pub around: FluidAlong<'a>,
}

impl<'a> Kinematics<'a> {
    /// The motion `q`, `v`, `a` of a rod of `edges` in one and the same fluid, at time 0.
    pub fn within(fluid: Fluid, edges: &'a [Edge], [q, v, a]: [&'a [f64]; 3]) -> Self {
        Self { t: 0.0, edges, q, v, a, fluid, layers: None, around: FluidAlong::default() }
    }

    /// The fluid at node `k`, and how it changes from there.
    #[inline(always)]
    pub fn here(&self, k: usize) -> LocalFluid {
        match (self.layers, self.around.at(k)) {
            (None, _) => self.fluid.into(),
            (_, Some(here)) => *here,
            (Some(layers), None) => layers.at(self.fluid, layers.height(node(self.q, k))),
        }
    }

    /// The flow (m/s) at node `k`.
    #[inline(always)]
    pub fn flow(&self, k: usize) -> Vector2<f64> {
        self.here(k).fluid.flow
    }

    /// The flow (m/s) where it is known to be the same along the whole rod.
    pub fn flow_everywhere(&self) -> Option<Vector2<f64>> {
        let one = self.everywhere().map(|fluid| fluid.flow);
        one.or_else(|| self.layers.is_none_or(Layers::flow_together).then_some(self.fluid.flow))
    }

    /// Velocity (m/s) of node `k` against the fluid.
    #[inline(always)]
    pub fn against_fluid(&self, k: usize) -> Vector2<f64> {
        node(self.v, k) - self.flow(k)
    }

    /// The fluid where it is known to be the same along the whole rod.
    #[inline(always)]
    pub fn everywhere(&self) -> Option<Fluid> {
        match self.layers {
            None => Some(self.fluid),
            Some(_) => self.around.everywhere().copied(),
        }
    }

    /// True where the fluid is known to be the same at every node, or to change along every edge.
    #[inline(always)]
    fn is_one_run(&self) -> bool {
        self.layers.is_none() || self.around.is_one()
    }

    /// The runs of `edges` along each of which the fluid is the same, or changes along every edge, with the rod as it is to be looked
    /// at there: in one fluid [`everywhere`](Self::everywhere), or not.
    #[inline(always)]
    pub fn runs(self, edges: Range<usize>) -> impl Iterator<Item = (Range<usize>, Self)> {
        self.around.over(edges).map(move |(run, around)| (run, Self { around, ..self }))
    }

    /// The same with the fluid along it found, in `runs` where nobody has looked yet.
    pub fn found<'b>(&self, runs: &'b mut FluidRuns) -> Kinematics<'b>
    where
        'a: 'b,
    {
        let around = match self.layers {
            Some(layers) if self.around.is_unknown() => runs.find(layers, self.fluid, self.q),
            _ => self.around,
        };
        Kinematics { around, ..*self }
    }

    /// The change of the fluid at node `k`, and of its slope, with a property of the medium.
    pub fn by_property(&self, property: Property, k: usize) -> LocalFluid {
        match (self.layers, property) {
            (Some(layers), _) => layers.by_property(self.fluid, property, layers.height(node(self.q, k))),
            (None, Property::Viscosity(0)) => Fluid { viscosity: 1.0, ..Fluid::NONE }.into(),
            (None, Property::Density(0)) => Fluid { density: 1.0, ..Fluid::NONE }.into(),
            (None, _) => Fluid::NONE.into(),
        }
    }

    /// The normal along which the medium changes; zero where it is uniform.
    #[inline(always)]
    pub fn normal(&self) -> Vector2<f64> {
        self.layers.map_or(Vector2::zeros(), |layers| layers.normal)
    }

    /// Acceleration (m/s²) of node `k` against the fluid.
    #[inline(always)]
    pub fn accelerating_against_fluid(&self, k: usize) -> Vector2<f64> {
        node(self.a, k) - self.fluid.acceleration
    }
}

/// What a force opposes the last node with beyond its last edge: it may know the last two edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipForce {
    /// The force, N.
    pub force: Vector2<f64>,
    /// Its change where the whole tip moves, along the direction.
    pub own: Matrix2<f64>,
    /// Its change with the vectors of the last edge but one and of the last edge, where the node stays.
    pub edges: [Matrix2<f64>; 2],
}

impl TipForce {
    /// What it adds to the first three blocks of the last row of a matrix.
    pub(crate) fn blocks(&self) -> [Matrix2<f64>; 3] {
        let [before, last] = self.edges;
        [-before, before - last, self.own + last]
    }
}

/// Where forces on some edges are summed.
#[derive(Debug)]
pub struct ForceAccumulator<'a> {
    sums: &'a mut [EdgeForce],
    /// Nothing has been summed yet.
    fresh: bool,
    /// Derivatives are wanted too; else they are not touched.
    slopes: bool,
}

impl ForceAccumulator<'_> {
    /// Adds what `on` says of each of `items`, one for every edge that the force was asked for: the edges' numbers, or
    /// whatever is known of them.
    #[inline(always)]
    pub fn each<T>(&mut self, items: impl IntoIterator<Item = T>, mut on: impl FnMut(T) -> EdgeForce) {
        for (sum, item) in self.sums.iter_mut().zip(items) {
            let on = on(item);
            match (self.fresh, self.slopes) {
                (true, true) => *sum = on,
                (false, true) => sum.add(&on),
                (true, false) => sum.force = on.force,
                (false, false) => sum.add_force(&on),
            }
        }
        self.fresh = false;
    }
}

impl ForceAccumulator<'_> {
    /// Adds what `on` says of the `i`-th edge that the force was asked for, and nothing of the others. Where there is no such edge
    /// nothing can be known: the sums are NaN then, which ends the step with [`Error::NotFinite`](crate::Error::NotFinite).
    pub fn one(&mut self, i: usize, on: &EdgeForce) {
        if self.fresh {
            self.sums.fill(EdgeForce::ZERO);
            self.fresh = false;
        }
        match self.sums.get_mut(i) {
            Some(sum) if self.slopes => sum.add(on),
            Some(sum) => sum.add_force(on),
            None => self.sums.fill(EdgeForce::UNKNOWN),
        }
    }
}

/// Where the power that a force takes goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerKind {
    /// Into the fluid's friction and eddies: drag.
    Drag,
    /// Into the wake that leaves the tail.
    Wake,
    /// Nowhere: the flow itself puts it in.
    Flow,
    /// Into the spray where the rod meets a denser fluid.
    Spray,
    /// Nowhere: it is a load, whose work is that of gravity; it stores an energy, and [`energy`](Force::energy) says how much.
    Load,
    /// Elsewhere.
    Other,
}

/// The derivatives of a number by the state.
#[derive(Debug)]
pub struct StateDerivatives<'a> {
    /// By positions, two entries per node.
    pub q: &'a mut [f64],
    /// By velocities.
    pub v: &'a mut [f64],
    /// By accelerations.
    pub a: &'a mut [f64],
}

/// A force that knows every edge by itself: the share of a linear one is computed where the rod's own is, in the pass compiled
/// for it.
pub trait FusedForce {
    /// Assembles `rod`, of a `damped` or of an elastic material, which moves through `fluid`, the same along all of it, with this force
    /// and with what `others` say, see [`Deformed::assemble`].
    fn assemble(
        &self,
        rod: Deformed<'_>,
        damped: Option<KelvinVoigt<'_>>,
        fluid: Fluid,
        others: ExternalForces<'_>,
        residual: &mut [[f64; 2]],
        jacobian: Option<(&mut [BlockRow], Direction)>,
    );

    /// Of a force in proportion to the velocity of each half of an edge: the lengths (m) of the halves of edge `e`, and its
    /// coefficients along and across them in `fluid`, N s/m². None of any other.
    fn coefficients(&self, _fluid: Fluid, _e: usize) -> Option<[f64x2; 3]> {
        None
    }

    /// Its [`powers`] on `edges` of `rod`, which moves through `fluid`, the same along all of them.
    fn powers(&self, rod: &Kinematics<'_>, fluid: Fluid, edges: Range<usize>) -> Powers;
}

/// A force on each node that depends on the motion of all of them. As [`Coupling`] it is what it adds to Newton's matrix beside
/// the derivatives that [`evaluate`](Force::evaluate) gives, at the motion last evaluated.
pub trait GlobalForce: Coupling {
    /// Adds to `out` how much more it opposes every node with where positions and velocities change by `change`, the flow by
    /// `flow` (m/s).
    fn add_change(&self, rod: &Kinematics<'_>, change: [&[f64]; 2], flow: Vector2<f64>, out: &mut [f64]);
}

/// A force on the rod. What an implementation says of itself is held against what it does by [`audit`](super::audit::audit).
pub trait Force: std::fmt::Debug + Send + Sync + Any {
    /// Its name.
    fn name(&self) -> &'static str;

    /// Where it holds, and its source.
    fn validity(&self) -> Validity;

    /// True where it is a fluid's: it depends on velocities against the flow, whose power is booked apart. A spring or a damper that is
    /// fixed to the ground is none.
    fn is_of_fluid(&self) -> bool;

    /// True where it is the same wherever the rod lies, in one fluid. Sensitivities and the shape model count on it: a spring to a point
    /// that says so has wrong derivatives.
    fn is_the_same_everywhere(&self) -> bool;

    /// Adds what opposes the motion on `edges` to `sums`, with derivatives along the direction `along` if there is one. The fluid
    /// is known: the same [`everywhere`](Kinematics::everywhere), or what was found [`along`](FluidAlong::along) `edges`.
    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    );

    /// The same compiled into the pass over the rod, of a force that most scenes have.
    fn fused(&self) -> Option<&dyn FusedForce> {
        None
    }

    /// False where it does nothing on any edge of `rod`.
    fn is_on_edges(&self, _rod: &Kinematics<'_>) -> bool {
        true
    }

    /// What opposes the last node beyond that.
    fn tip(&self, _rod: &Kinematics<'_>, _along: Option<Direction>) -> Option<TipForce> {
        None
    }

    /// True where it depends on accelerations: it adds to the inertia. Slopes by accelerations are asked for only where it says so.
    fn is_inertial(&self) -> bool {
        false
    }

    /// What is known of a force on each node that depends on the motion of them all; [`evaluate`](Self::evaluate) gives only those
    /// of its derivatives that are an edge's own.
    fn global(&self) -> Option<&dyn GlobalForce> {
        None
    }

    /// True where it is linear in the velocities, apart from constants.
    fn is_linear(&self) -> bool {
        false
    }

    /// Energy (J) that it stores; adds `factor` times its derivatives to `by`.
    fn energy(&self, _rod: &Kinematics<'_>, _factor: f64, _by: Option<StateDerivatives<'_>>) -> f64 {
        0.0
    }

    /// Momentum (N s) along the unit vector `axis` that it stores: what it opposes the whole rod with is the rate of that; adds
    /// `factor` times its derivatives to `by`.
    fn momentum(
        &self,
        _rod: &Kinematics<'_>,
        _axis: Vector2<f64>,
        _factor: f64,
        _by: Option<StateDerivatives<'_>>,
    ) -> f64 {
        0.0
    }

    /// Its [`energy`](Self::energy) and its [`momentum`](Self::momentum), of a force that finds both in one pass.
    fn stored(&self, rod: &Kinematics<'_>) -> (f64, Vector2<f64>) {
        let along = |axis| self.momentum(rod, axis, 0.0, None);
        (self.energy(rod, 0.0, None), Vector2::new(along(Vector2::x()), along(Vector2::y())))
    }

    /// What it gives to its momentum and the rod's together (N), beside being the rate of that: where the medium changes from
    /// place to place.
    fn pull(&self, _rod: &Kinematics<'_>) -> Vector2<f64> {
        Vector2::zeros()
    }

    /// ∂/∂p of its [`momentum`](Self::momentum); that of a force in one fluid is linear in its density.
    fn momentum_by_parameter(&self, key: Key, rod: &Kinematics<'_>, axis: Vector2<f64>) -> f64 {
        if key != DENSITY || !self.parameters().contains(&DENSITY) {
            return 0.0;
        }
        self.momentum(
            &Kinematics { fluid: Fluid { density: 1.0, ..rod.fluid }, around: FluidAlong::default(), ..*rod },
            axis,
            0.0,
            None,
        )
    }

    /// ∂(energy)/∂t where the rod stays, W: what it puts in by itself; adds `factor` times its derivatives to `by`.
    fn energy_by_time(&self, _rod: &Kinematics<'_>, _factor: f64, _by: Option<StateDerivatives<'_>>) -> f64 {
        0.0
    }

    /// Where what it takes for good goes: all of its power where it stores no energy. `None`: it takes nothing.
    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Drag)
    }

    /// The parameters that it depends on, by their keys in a scene.
    fn parameters(&self) -> &[Key] {
        &[]
    }

    /// Adds ∂(force)/∂p to `out`, two entries per node, and returns ∂/∂p of its [`energy`](Self::energy) and of its
    /// [`energy_by_time`](Self::energy_by_time); `key` is one of its [`parameters`](Self::parameters), others change nothing.
    fn add_by_parameter(&self, _key: Key, _rod: &Kinematics<'_>, _out: &mut [f64]) -> [f64; 2] {
        [0.0; 2]
    }
}

/// Powers (W) of a force, and its sum over the rod.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Powers {
    /// ΣF: what it opposes the whole rod with, N.
    pub opposing: Vector2<f64>,
    /// F·(v − u): what it takes, and what its energy gains.
    pub against_fluid: f64,
    /// −F·u: what the flow puts in.
    pub of_flow: f64,
}

/// What powers are summed up from, where one flow is all around.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PowerSums<T: Real = f64> {
    /// ΣF, N.
    pub opposing: T::Pair,
    /// Σ of the products of both components of F and of v − u, W.
    pub against_fluid: T::Pair,
}

impl<T: Real> PowerSums<T> {
    /// None yet, in numbers like `zero`.
    #[inline(always)]
    pub fn none(zero: T) -> Self {
        let none = T::Pair::new([zero; 2]);
        Self { opposing: none, against_fluid: none }
    }

    /// Adds what opposes a node that moves at `velocity` (m/s) against the flow.
    #[inline(always)]
    pub fn add(&mut self, opposing: T::Pair, velocity: T::Pair) {
        self.opposing += opposing;
        self.against_fluid += opposing * velocity;
    }
}

impl PowerSums {
    /// The powers in a `flow`, m/s.
    pub fn powers(&self, flow: Vector2<f64>) -> Powers {
        let opposing = Vector2::from(self.opposing.to_array());
        Powers { opposing, against_fluid: self.against_fluid.sum(), of_flow: -opposing.dot(&flow) }
    }
}

/// The forces on a rod.
#[derive(Debug, Default)]
pub struct Forces(pub Vec<Box<dyn Force>>);

impl Forces {
    /// True where there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Force> + Clone {
        self.0.iter().map(|force| &**force)
    }

    /// The one that is compiled into the pass over a rod in one fluid, and its place.
    pub fn in_pass(&self) -> Option<(usize, &dyn FusedForce)> {
        // Roots and quotients of a law that is not linear take long, but pass while the next edges are looked at, in a loop that is
        // short: such a law takes its turn among the others.
        let mut linear = self.iter().enumerate().filter(|(_, force)| force.is_linear());
        linear.find_map(|(i, force)| Some((i, force.fused()?)))
    }

    /// True if there is one that is neither of a fluid nor a load that stores an energy.
    pub fn are_others(&self) -> bool {
        self.iter().any(|force| !force.is_of_fluid() && force.power_kind() != Some(PowerKind::Load))
    }

    /// True where one of them adds to the inertia.
    pub fn are_inertial(&self) -> bool {
        self.iter().any(Force::is_inertial)
    }

    /// The one that depends on the motion of all nodes at once, see [`Force::global`].
    pub fn global(&self) -> Option<&dyn Force> {
        self.iter().find(|force| force.global().is_some())
    }

    /// Visits what acts on each of `edges`.
    pub fn on_edges(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        visit: impl FnMut(usize, &EdgeForce),
    ) {
        if !self.0.is_empty() {
            on_edges(self.iter(), rod, along, edges, visit);
        }
    }

    /// What acts on the tip beyond its last edge.
    pub fn on_tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> impl Iterator<Item = TipForce> {
        self.0.iter().filter_map(move |force| force.tip(rod, along))
    }

    /// Assembles `rod`, of a `damped` or of an elastic material, which moves as `moving` says, with all forces, see
    /// [`Deformed::assemble`]; `room` has room for [`EDGES_PER_BLOCK`] edges.
    pub fn assemble(
        &self,
        rod: Deformed<'_>,
        damped: Option<KelvinVoigt<'_>>,
        moving: Kinematics<'_>,
        room: &mut [EdgeForce],
        residual: &mut [[f64; 2]],
        mut jacobian: Option<(&mut [BlockRow], Direction)>,
    ) {
        if self.is_empty() {
            let none = (0..rod.edges.len()).map(|_| None);
            return match damped {
                None => rod.assemble(none, residual, jacobian),
                Some(damped) => rod.assemble_with(damped, none, residual, jacobian),
            };
        }
        let along = jacobian.as_ref().map(|(_, direction)| *direction);
        let part = jacobian.as_mut().map(|(rows, direction)| (&mut **rows, *direction));
        let in_pass = moving.everywhere().and_then(|fluid| self.in_pass().map(|(i, force)| (i, force, fluid)));
        let forces = in_pass.map_or([&self.0[..], &[]], |(i, ..)| [&self.0[..i], &self.0[i + 1..]]);
        let mut others = ExternalForces { forces, rod: moving, along, room };
        let around = (0..moving.edges.len()).map(|e| Some(others.on(e)));
        match (in_pass, damped) {
            (Some((_, force, fluid)), _) => force.assemble(rod, damped, fluid, others, residual, part),
            (None, Some(damped)) => rod.assemble_with(damped, around, residual, part),
            (None, None) => rod.assemble(around, residual, part),
        }
        for tip in self.on_tip(&moving, along) {
            if let Some(last) = residual.last_mut() {
                *last = (Vector2::from(*last) + tip.force).into();
            }
            if let Some([.., row]) = jacobian.as_mut().map(|(rows, _)| &mut **rows) {
                for (entry, block) in row.iter_mut().zip(tip.blocks()) {
                    for (x, y) in entry.iter_mut().zip(block.transpose().iter()) {
                        *x += y;
                    }
                }
            }
        }
    }

    /// Adds what opposes the motion (N) to `out`, two entries per node.
    pub fn add(&self, rod: &Kinematics<'_>, out: &mut [f64]) {
        self.on_edges(rod, None, 0..rod.edges.len(), |e, on| {
            add(out, e, on.force(0));
            add(out, e + 1, on.force(1));
        });
        self.on_tip(rod, None).for_each(|tip| add(out, rod.edges.len(), tip.force));
    }

    /// Adds ∂(force)/∂p to `out`.
    pub fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) {
        for force in self.iter() {
            force.add_by_parameter(key, rod, out);
        }
    }

    /// Drag per length and speed (N s/m²) along and across the middle of `rod`, where it moves slowly through `fluid`.
    pub fn resistance(&self, rod: &Rod, fluid: Fluid) -> Option<[f64; 2]> {
        let middle = (rod.nodes - 1) / 2;
        let mut found = None;
        straight(rod, fluid, [0.0; 2], |rest| {
            self.on_edges(rest, Some(Direction::VELOCITIES), middle..middle + 1, |e, on| {
                let [along, _, _, across] = on.own(1).into();
                found = Some([along, across].map(|force: f64| force / (0.5 * rod.cells[e].rest)));
            });
        });
        found
    }

    /// Drag per length and speed (N s/m²) along and across the middle of `rod`, where it moves across itself at `speed` (m/s) and
    /// a tenth of it along.
    pub fn coefficients(&self, rod: &Rod, fluid: Fluid, speed: f64) -> Option<[f64; 2]> {
        let middle = (rod.nodes - 1) / 2;
        let mut found = [0.0; 2];
        straight(rod, fluid, [0.1 * speed, speed], |moving| {
            on_edges(self.drags(), moving, None, middle..middle + 1, |e, on| {
                let per = 1.0 / (0.5 * rod.cells[e].rest * speed);
                found = [on.force(1).x * per / 0.1, on.force(1).y * per];
            });
        });
        self.drags().next().map(|_| found)
    }

    /// The drag (N) of `rod` lying straight, towed along itself at `speed` (m/s) through `fluid` at rest, head first.
    pub fn towing(&self, rod: &Rod, fluid: Fluid, speed: f64) -> f64 {
        straight(rod, fluid, [-speed, 0.0], |towed| -self.drags().map(|force| resultant(force, towed).x).sum::<f64>())
    }

    /// Those of a fluid that drag takes power by.
    fn drags(&self) -> impl Iterator<Item = &dyn Force> + Clone {
        self.iter().filter(|force| force.power_kind() == Some(PowerKind::Drag) && force.is_of_fluid())
    }
}

/// Forces that act around a rod; their sum is in `room`, which has room for [`EDGES_PER_BLOCK`] edges.
#[derive(Debug)]
pub struct ExternalForces<'a> {
    /// The forces: those before one that is compiled into the pass, and those after it.
    pub forces: [&'a [Box<dyn Force>]; 2],
    /// How the rod moves.
    pub rod: Kinematics<'a>,
    /// The direction of the derivatives, if any are wanted.
    pub along: Option<Direction>,
    /// Where sums are.
    pub room: &'a mut [EdgeForce],
}

impl ExternalForces<'_> {
    /// True where there are none.
    pub fn are_none(&self) -> bool {
        self.forces[0].is_empty() && self.forces[1].is_empty()
    }

    /// What they do on edge `e`; edges are asked for in their order.
    #[inline(always)]
    pub fn on(&mut self, e: usize) -> EdgeForce {
        let place = e % EDGES_PER_BLOCK;
        if place == 0 {
            self.look_ahead(e);
        }
        self.room[place]
    }

    /// Sums what they do on the edges from `e` on.
    #[inline(never)] // where edges are assembled there are no registers to spare
    fn look_ahead(&mut self, e: usize) {
        let forces = self.forces[0].iter().chain(self.forces[1]).map(|force| &**force);
        let edges = e..self.rod.edges.len().min(e + EDGES_PER_BLOCK);
        if !sum(forces, &self.rod, self.along, edges, self.room) {
            self.room.fill(EdgeForce::ZERO);
        }
    }
}

/// Looks at `rod` lying straight, unstretched, and moving as a whole with `velocity` (m/s) through `fluid` at rest.
pub(crate) fn straight<T>(rod: &Rod, fluid: Fluid, velocity: [f64; 2], look: impl FnOnce(&Kinematics<'_>) -> T) -> T {
    let edges: Vec<Edge> = rod.cells.iter().map(|cell| Edge::along(Vector2::x(), cell.rest)).collect();
    let q: Vec<f64> = (0..rod.nodes).flat_map(|k| [rod.arc_length(k), 0.0]).collect();
    let (v, a) = (velocity.repeat(rod.nodes), vec![0.0; 2 * rod.nodes]);
    let fluid = Fluid { flow: Vector2::zeros(), ..fluid };
    look(&Kinematics::within(fluid, &edges, [&q, &v, &a]))
}

/// Sums what `forces` do on `edges` in `room`. False where they do nothing; there may be anything in `room` then.
#[inline(always)]
fn sum<'a>(
    forces: impl Iterator<Item = &'a dyn Force> + Clone,
    rod: &Kinematics<'_>,
    along: Option<Direction>,
    edges: Range<usize>,
    room: &mut [EdgeForce],
) -> bool {
    let on_run = |rod: &Kinematics<'_>, run: Range<usize>, sums: &mut [EdgeForce]| {
        let mut tally = ForceAccumulator { sums, fresh: true, slopes: along.is_some() };
        for force in forces.clone() {
            force.evaluate(rod, along, run.clone(), &mut tally);
        }
        !tally.fresh
    };
    // One run, without what it takes to look for more (2 % of a step).
    if rod.is_one_run() {
        return on_run(rod, edges.clone(), &mut room[..edges.len()]);
    }
    let (mut any, mut runs) = (false, FluidRuns::default());
    for (run, rod) in rod.found(&mut runs).runs(edges.clone()) {
        let place = run.start - edges.start..run.end - edges.start;
        let sums = &mut room[place];
        if on_run(&rod, run, sums) {
            any = true;
        } else {
            sums.fill(EdgeForce::ZERO);
        }
    }
    any
}

/// Visits what `forces` do on each of `edges` on which they do anything.
fn on_edges<'a>(
    forces: impl Iterator<Item = &'a dyn Force> + Clone,
    rod: &Kinematics<'_>,
    along: Option<Direction>,
    edges: Range<usize>,
    mut visit: impl FnMut(usize, &EdgeForce),
) {
    let mut room = [EdgeForce::ZERO; 8];
    let mut first = edges.start;
    while first < edges.end {
        let some = first..edges.end.min(first + room.len());
        first = some.end;
        if sum(forces.clone(), rod, along, some.clone(), &mut room) {
            some.zip(&room).for_each(|(e, on)| visit(e, on));
        }
    }
}

/// Visits what `force` alone opposes every node with, edge by edge: node, and force (N).
pub fn visit_alone(force: &dyn Force, rod: &Kinematics<'_>, mut visit: impl FnMut(usize, Vector2<f64>)) {
    visit_run(force, rod, 0..rod.edges.len(), &mut visit);
}

/// The same for what acts on `edges`, and with the last of them on the tip.
#[inline(always)]
fn visit_run(
    force: &dyn Force,
    rod: &Kinematics<'_>,
    edges: Range<usize>,
    visit: &mut impl FnMut(usize, Vector2<f64>),
) {
    let last = edges.end == rod.edges.len();
    if force.is_on_edges(rod) {
        let on_edge = |e: usize, on: &EdgeForce| (0..2).for_each(|i| visit(e + i, on.force(i)));
        on_edges(std::iter::once(force), rod, None, edges, on_edge);
    }
    if last && let Some(tip) = force.tip(rod, None) {
        visit(rod.edges.len(), tip.force);
    }
}

/// The sum of what `force` opposes the whole rod with, N.
pub fn resultant(force: &dyn Force, rod: &Kinematics<'_>) -> Vector2<f64> {
    let mut sum = Vector2::zeros();
    visit_alone(force, rod, |_, force| sum += force);
    sum
}

/// The powers of `force`, W; those of one that is not a fluid's are against the ground.
pub fn powers(force: &dyn Force, rod: &Kinematics<'_>) -> Powers {
    let edges = 0..rod.edges.len();
    // One run, without what it takes to look for more.
    if rod.is_one_run() || !force.is_on_edges(rod) {
        return powers_on(force, rod, edges);
    }
    let mut powers = Powers::default();
    for (run, rod) in rod.runs(edges) {
        let Powers { opposing, against_fluid, of_flow } = powers_on(force, &rod, run);
        powers.opposing += opposing;
        powers.against_fluid += against_fluid;
        powers.of_flow += of_flow;
    }
    powers
}

/// The same of what acts on `edges`, and with the last of them on the tip.
fn powers_on(force: &dyn Force, rod: &Kinematics<'_>, edges: Range<usize>) -> Powers {
    if let (Some(force), Some(fluid)) = (force.fused(), rod.everywhere()) {
        return force.powers(rod, fluid, edges);
    }
    let one = if force.is_of_fluid() { rod.flow_everywhere() } else { Some(Vector2::zeros()) };
    match one {
        Some(flow) => {
            let (mut sums, u) = (PowerSums::none(0.0), pair(flow));
            visit_run(force, rod, edges, &mut |k, opposing| sums.add(pair(opposing), pair(node(rod.v, k)) - u));
            sums.powers(flow)
        }
        None => powers_against(force, rod, edges, |k| rod.flow(k)),
    }
}

/// The same, where the velocity of the `flow` (m/s) is another one at every node.
#[inline(always)]
fn powers_against(
    force: &dyn Force,
    rod: &Kinematics<'_>,
    edges: Range<usize>,
    flow: impl Fn(usize) -> Vector2<f64>,
) -> Powers {
    let (mut sum, mut against_fluid, mut of_flow) = (f64x2::ZERO, f64x2::ZERO, f64x2::ZERO);
    visit_run(force, rod, edges, &mut |k, opposing| {
        let (opposing, flow) = (pair(opposing), pair(flow(k)));
        sum += opposing;
        against_fluid += opposing * (pair(node(rod.v, k)) - flow);
        of_flow -= opposing * flow;
    });
    Powers { opposing: sum.to_array().into(), against_fluid: against_fluid.reduce_add(), of_flow: of_flow.reduce_add() }
}

/// The directions that a force is differentiated along: accelerations only where it depends on them.
fn directions(force: &dyn Force) -> &'static [Direction] {
    const ALL: [Direction; 3] = [Direction::POSITIONS, Direction::VELOCITIES, Direction::ACCELERATIONS];
    if force.is_inertial() { &ALL } else { &ALL[..2] }
}

fn visit_tip(force: &dyn Force, rod: &Kinematics<'_>, i: usize, mut visit: impl FnMut(&TipForce, [usize; 3])) {
    if let Some(tip) = directions(force).get(i).and_then(|along| force.tip(rod, Some(*along))) {
        let last = rod.edges.len();
        visit(&tip, [last - 2, last - 1, last]);
    }
}

/// Adds to `out` (two entries per node) how much more `force` opposes every node with where positions, velocities and
/// accelerations change by `change`, the flow by `flow` (m/s).
pub fn add_change(force: &dyn Force, rod: &Kinematics<'_>, change: [&[f64]; 3], flow: Vector2<f64>, out: &mut [f64]) {
    if let Some(whole) = force.global() {
        return whole.add_change(rod, [change[0], change[1]], flow, out);
    }
    for (i, along) in directions(force).iter().enumerate() {
        let against = if i == 1 && force.is_of_fluid() { flow } else { Vector2::zeros() };
        let d = |k: usize| node(change[i], k) - against;
        let on_edge = |e: usize, on: &EdgeForce| {
            for end in 0..2 {
                add(out, e + end, on.change(end, [d(e), d(e + 1)]));
            }
        };
        on_edges(std::iter::once(force), rod, Some(*along), 0..rod.edges.len(), on_edge);
        visit_tip(force, rod, i, |tip, [before, inner, last]| {
            let [first, second] = tip.edges;
            let moved = tip.own * d(last) + first * (d(inner) - d(before)) + second * (d(last) - d(inner));
            add(out, last, moved);
        });
    }
}

/// The transpose of [`add_change`], of a force that is not [`whole`](Force::global): adds to `by` the derivatives of Σ c·F over the
/// ends of `edges`, c the `cotangent` of a node.
pub fn add_slopes(
    force: &dyn Force,
    rod: &Kinematics<'_>,
    edges: Range<usize>,
    cotangent: impl Fn(usize) -> Vector2<f64>,
    by: &mut StateDerivatives<'_>,
) {
    for (i, along) in directions(force).iter().enumerate() {
        let StateDerivatives { q, v, a } = by;
        let to: &mut [f64] = [&mut **q, v, a][i];
        let on_edge = |e: usize, on: &EdgeForce| {
            for end in 0..2 {
                let [first, second] = on.change_transposed(end, cotangent(e + end));
                add(to, e, first);
                add(to, e + 1, second);
            }
        };
        on_edges(std::iter::once(force), rod, Some(*along), edges.clone(), on_edge);
        if edges.end == rod.edges.len() {
            visit_tip(force, rod, i, |tip, [before, inner, last]| {
                let c = cotangent(last);
                let [first, second] = tip.edges.map(|by| by.tr_mul(&c));
                add(to, before, -first);
                add(to, inner, first - second);
                add(to, last, second + tip.own.tr_mul(&c));
            });
        }
    }
}

impl StateDerivatives<'_> {
    /// The same for a while.
    pub fn reborrow(&mut self) -> StateDerivatives<'_> {
        StateDerivatives { q: self.q, v: self.v, a: self.a }
    }
}
