//! External forces on the rod: a list of forces, each with exact derivatives, stored energy and dissipated power.
//!
//! A force acts on the two ends of every edge. Its sign is that of a resistance, which *opposes* the motion:
//! M a + ∇E + ΣF = W. It may depend on positions, velocities and accelerations of both nodes, on the edge between them,
//! and on time. Its derivatives are taken along a [`Direction`], so a force never sees a step size, and have a form that
//! suits both the positions and the chain form: for each end, the derivative with respect to a translation of the whole
//! edge, and the derivative with respect to the edge vector e = x_{k+1} − x_k while that end stays.

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

/// Positions, velocities and accelerations of the rod, and the fluid around it.
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
    /// The fluid; in layers, the one before the first interface.
    pub fluid: Fluid,
    /// The layers beyond the first interface; `None` in a uniform medium.
    pub layers: Option<&'a Layers>,
    /// The fluid along the rod; empty until it has been computed.
    pub around: FluidAlong<'a>,
    /// The tension of each tendon, N.
    pub tensions: &'a [f64],
}

impl<'a> Kinematics<'a> {
    /// The motion `q`, `v`, `a` of a rod of `edges` in a uniform fluid, at time 0.
    pub fn within(fluid: Fluid, edges: &'a [Edge], [q, v, a]: [&'a [f64]; 3]) -> Self {
        Self { t: 0.0, edges, q, v, a, fluid, layers: None, around: FluidAlong::default(), tensions: &[] }
    }

    /// The fluid at node `k`, with its slope.
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

    /// The flow (m/s), if it is known to be uniform along the rod.
    pub fn flow_everywhere(&self) -> Option<Vector2<f64>> {
        let one = self.everywhere().map(|fluid| fluid.flow);
        one.or_else(|| self.layers.is_none_or(Layers::flow_together).then_some(self.fluid.flow))
    }

    /// Velocity (m/s) of node `k` relative to the fluid.
    #[inline(always)]
    pub fn against_fluid(&self, k: usize) -> Vector2<f64> {
        node(self.v, k) - self.flow(k)
    }

    /// The fluid, if it is known to be uniform along the rod.
    #[inline(always)]
    pub fn everywhere(&self) -> Option<Fluid> {
        match self.layers {
            None => Some(self.fluid),
            Some(_) => self.around.everywhere().copied(),
        }
    }

    /// True if the fluid is known to be the same at every node, or to change along every edge.
    #[inline(always)]
    fn is_one_run(&self) -> bool {
        self.layers.is_none() || self.around.is_one()
    }

    /// The ranges of `edges` in which the fluid is uniform, or changes along every edge, each with the kinematics to
    /// use there: in one fluid [`everywhere`](Self::everywhere), or not.
    #[inline(always)]
    pub fn runs(self, edges: Range<usize>) -> impl Iterator<Item = (Range<usize>, Self)> {
        self.around.over(edges).map(move |(run, around)| (run, Self { around, ..self }))
    }

    /// The same with the fluid along the rod, computed into `runs` if it is not known yet.
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

    /// The derivative of the fluid at node `k`, and of its slope, with respect to a property of the medium.
    pub fn by_property(&self, property: Property, k: usize) -> LocalFluid {
        match (self.layers, property) {
            (Some(layers), _) => layers.by_property(self.fluid, property, layers.height(node(self.q, k))),
            (None, Property::Viscosity(0)) => Fluid { viscosity: 1.0, ..Fluid::NONE }.into(),
            (None, Property::Density(0)) => Fluid { density: 1.0, ..Fluid::NONE }.into(),
            (None, _) => Fluid::NONE.into(),
        }
    }

    /// The normal along which the medium changes; zero if it is uniform.
    #[inline(always)]
    pub fn normal(&self) -> Vector2<f64> {
        self.layers.map_or(Vector2::zeros(), |layers| layers.normal)
    }

    /// Acceleration (m/s²) of node `k` relative to the fluid.
    #[inline(always)]
    pub fn accelerating_against_fluid(&self, k: usize) -> Vector2<f64> {
        node(self.a, k) - self.fluid.acceleration
    }
}

/// A force on the last node in addition to that of its edge. It may depend on the last two edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipForce {
    /// The force, N.
    pub force: Vector2<f64>,
    /// Its derivative with respect to a translation of the whole tip, along the direction.
    pub own: Matrix2<f64>,
    /// Its derivatives with respect to the vectors of the last edge but one and of the last edge, while the node stays.
    pub edges: [Matrix2<f64>; 2],
}

impl TipForce {
    /// Its contribution to the first three blocks of the last row of a matrix.
    pub(crate) fn blocks(&self) -> [Matrix2<f64>; 3] {
        let [before, last] = self.edges;
        [-before, before - last, self.own + last]
    }
}

/// Accumulates the forces on some edges.
#[derive(Debug)]
pub struct ForceAccumulator<'a> {
    sums: &'a mut [EdgeForce],
    /// True until the first force has been added.
    fresh: bool,
    /// True if derivatives are summed as well; otherwise they are left unchanged.
    slopes: bool,
}

impl ForceAccumulator<'_> {
    /// Adds the force that `on` returns for each of `items`. There is one item per requested edge: its index, or data
    /// about it.
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
    /// Adds the force `on` to the `i`-th requested edge only. If there is no such edge, the sums become NaN, which ends
    /// the step with [`Error::NotFinite`](crate::Error::NotFinite).
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

/// The destination of the power that a force dissipates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerKind {
    /// Into the fluid's friction and eddies: drag.
    Drag,
    /// Into the wake that leaves the tail.
    Wake,
    /// None: the flow itself supplies it.
    Flow,
    /// Into the spray where the rod meets a denser fluid.
    Spray,
    /// None: the force is a load such as gravity, which stores the energy that [`energy`](Force::energy) returns.
    Load,
    /// None: the drive supplies it, as tendons do.
    Drive,
    /// Elsewhere.
    Other,
}

/// The derivatives of a number with respect to the state.
#[derive(Debug)]
pub struct StateDerivatives<'a> {
    /// With respect to positions, two entries per node.
    pub q: &'a mut [f64],
    /// With respect to velocities.
    pub v: &'a mut [f64],
    /// With respect to accelerations.
    pub a: &'a mut [f64],
}

/// A force whose edges are independent of each other. A linear one is computed together with the rod's own forces, in a
/// pass that is compiled for it.
pub trait FusedForce {
    /// Assembles `rod`, of a `damped` or of an elastic material, in the uniform `fluid`, with this force and the
    /// `others`; see [`Deformed::assemble`].
    fn assemble(
        &self,
        rod: Deformed<'_>,
        damped: Option<KelvinVoigt<'_>>,
        fluid: Fluid,
        others: ExternalForces<'_>,
        residual: &mut [[f64; 2]],
        jacobian: Option<(&mut [BlockRow], Direction)>,
    );

    /// For a force proportional to the velocity of each half of an edge: the lengths (m) of the halves of edge `e`, and
    /// the coefficients along and across them in `fluid`, N s/m². `None` for any other force.
    fn coefficients(&self, _fluid: Fluid, _e: usize) -> Option<[f64x2; 3]> {
        None
    }

    /// Its [`powers`] on `edges` of `rod`, which moves through the uniform `fluid`.
    fn powers(&self, rod: &Kinematics<'_>, fluid: Fluid, edges: Range<usize>) -> Powers;
}

/// A force on each node that depends on the motion of all nodes. Its [`Coupling`] is the part of Newton's matrix that
/// [`evaluate`](Force::evaluate) does not return, at the motion last evaluated.
pub trait GlobalForce: Coupling {
    /// Adds the differential of the opposing force on every node to `out`, for a `change` of positions and velocities
    /// and of the flow by `flow` (m/s).
    fn add_change(&self, rod: &Kinematics<'_>, change: [&[f64]; 2], flow: Vector2<f64>, out: &mut [f64]);

    /// The transpose of [`add_change`](Self::add_change): adds to `by` the derivatives with respect to positions and
    /// velocities of Σ c·F over the ends of `edges`, where c is the `cotangent` of a node.
    fn add_slopes(
        &self,
        rod: &Kinematics<'_>,
        edges: Range<usize>,
        cotangent: &dyn Fn(usize) -> Vector2<f64>,
        by: &mut StateDerivatives<'_>,
    );
}

/// A force on the rod. [`audit`](super::audit::audit) checks the statements of an implementation about itself against
/// finite differences.
pub trait Force: std::fmt::Debug + Send + Sync + Any {
    /// Its name.
    fn name(&self) -> &'static str;

    /// Its range of validity, and the source.
    fn validity(&self) -> Validity;

    /// True for a force of the fluid. It depends on velocities relative to the flow, and the power of the flow is
    /// counted separately. False for a spring or a damper that is fixed to the ground.
    fn is_of_fluid(&self) -> bool;

    /// True if it does not depend on where the rod lies in a uniform fluid. Sensitivities and the shape model rely on
    /// this: a spring to a fixed point that returns true gets wrong derivatives.
    fn is_the_same_everywhere(&self) -> bool;

    /// Adds the forces that oppose the motion of `edges` to `sums`, with derivatives along the direction `along` if
    /// there is one. The fluid is either uniform ([`everywhere`](Kinematics::everywhere)), or the one found
    /// [`along`](FluidAlong::along) `edges`.
    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    );

    /// The form that is compiled into the pass over the rod, for forces that most scenes have.
    fn fused(&self) -> Option<&dyn FusedForce> {
        None
    }

    /// False if it is zero on every edge of `rod`.
    fn is_on_edges(&self, _rod: &Kinematics<'_>) -> bool {
        true
    }

    /// The additional opposing force on the last node.
    fn tip(&self, _rod: &Kinematics<'_>, _along: Option<Direction>) -> Option<TipForce> {
        None
    }

    /// True if it depends on accelerations, as an added mass does. Derivatives with respect to accelerations are
    /// requested only in that case.
    fn is_inertial(&self) -> bool {
        false
    }

    /// The nonlocal part of a force that depends on the motion of all nodes; [`evaluate`](Self::evaluate) returns only
    /// the derivatives with respect to the edge itself.
    fn global(&self) -> Option<&dyn GlobalForce> {
        None
    }

    /// True if it is linear in the velocities, apart from constants.
    fn is_linear(&self) -> bool {
        false
    }

    /// Energy (J) that it stores; adds `factor` times its derivatives to `by`.
    fn energy(&self, _rod: &Kinematics<'_>, _factor: f64, _by: Option<StateDerivatives<'_>>) -> f64 {
        0.0
    }

    /// The stored momentum (N s) along the unit vector `axis`, whose rate is the total opposing force. Adds `factor`
    /// times its derivatives to `by`.
    fn momentum(
        &self,
        _rod: &Kinematics<'_>,
        _axis: Vector2<f64>,
        _factor: f64,
        _by: Option<StateDerivatives<'_>>,
    ) -> f64 {
        0.0
    }

    /// Its [`energy`](Self::energy) and [`momentum`](Self::momentum), for a force that computes both in one pass.
    fn stored(&self, rod: &Kinematics<'_>) -> (f64, Vector2<f64>) {
        let along = |axis| self.momentum(rod, axis, 0.0, None);
        (self.energy(rod, 0.0, None), Vector2::new(along(Vector2::x()), along(Vector2::y())))
    }

    /// The force (N) on the momentum of rod and fluid together in a medium that changes with the position, in addition
    /// to the rate of the stored momentum.
    fn pull(&self, _rod: &Kinematics<'_>) -> Vector2<f64> {
        Vector2::zeros()
    }

    /// ∂/∂p of its [`momentum`](Self::momentum). By default the momentum is linear in the density of a uniform fluid.
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

    /// ∂(energy)/∂t at a fixed position of the rod, W: the power that the force supplies by itself. Adds `factor` times
    /// its derivatives to `by`.
    fn energy_by_time(&self, _rod: &Kinematics<'_>, _factor: f64, _by: Option<StateDerivatives<'_>>) -> f64 {
        0.0
    }

    /// The destination of the power that it dissipates, which is all of its power if it stores no energy. `None` if it
    /// dissipates nothing. A spring must return that, because the default is drag.
    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Drag)
    }

    /// The parameters that it depends on, by their keys in a scene.
    fn parameters(&self) -> &[Key] {
        &[]
    }

    /// Adds ∂(force)/∂p to `out`, two entries per node, and returns ∂/∂p of its [`energy`](Self::energy) and of its
    /// [`energy_by_time`](Self::energy_by_time). A `key` that is not one of its [`parameters`](Self::parameters)
    /// changes nothing.
    fn add_by_parameter(&self, _key: Key, _rod: &Kinematics<'_>, _out: &mut [f64]) -> [f64; 2] {
        [0.0; 2]
    }
}

/// Powers (W) of a force, and its sum over the rod.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Powers {
    /// ΣF, the total opposing force, N.
    pub opposing: Vector2<f64>,
    /// F·(v − u): the power that it dissipates or stores.
    pub against_fluid: f64,
    /// −F·u: the power that the flow supplies.
    pub of_flow: f64,
}

/// The sums from which powers follow in a uniform flow.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PowerSums<T: Real = f64> {
    /// ΣF, N.
    pub opposing: T::Pair,
    /// Σ of the products of both components of F and of v − u, W.
    pub against_fluid: T::Pair,
}

impl<T: Real> PowerSums<T> {
    /// Zero sums; `zero` selects the number type.
    #[inline(always)]
    pub fn none(zero: T) -> Self {
        let none = T::Pair::new([zero; 2]);
        Self { opposing: none, against_fluid: none }
    }

    /// Adds the force on a node that moves at `velocity` (m/s) relative to the flow.
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
    /// True if there are no forces.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All forces.
    pub fn iter(&self) -> impl Iterator<Item = &dyn Force> + Clone {
        self.0.iter().map(|force| &**force)
    }

    /// The force that is compiled into the pass over a rod in a uniform fluid, with its index.
    pub fn in_pass(&self) -> Option<(usize, &dyn FusedForce)> {
        // Roots and quotients of a nonlinear law are slow. In a short loop of their own they overlap with the work on
        // the next edges, so such a law is evaluated with the other forces.
        let mut linear = self.iter().enumerate().filter(|(_, force)| force.is_linear());
        linear.find_map(|(i, force)| Some((i, force.fused()?)))
    }

    /// True if any force is neither one of the fluid, nor a load that stores energy, nor one of the drive.
    pub fn are_others(&self) -> bool {
        let own = [Some(PowerKind::Load), Some(PowerKind::Drive)];
        self.iter().any(|force| !force.is_of_fluid() && !own.contains(&force.power_kind()))
    }

    /// True if any of them depends on accelerations.
    pub fn are_inertial(&self) -> bool {
        self.iter().any(Force::is_inertial)
    }

    /// The force that depends on the motion of all nodes at once, see [`Force::global`].
    pub fn global(&self) -> Option<&dyn Force> {
        self.iter().find(|force| force.global().is_some())
    }

    /// Visits the force on each of `edges`.
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

    /// The forces on the tip in addition to those of its edge.
    pub fn on_tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> impl Iterator<Item = TipForce> {
        self.0.iter().filter_map(move |force| force.tip(rod, along))
    }

    /// Assembles `rod`, of a `damped` or of an elastic material, in the motion `moving`, with all forces; see
    /// [`Deformed::assemble`]. `workspace` has room for [`EDGES_PER_BLOCK`] edges.
    pub fn assemble(
        &self,
        rod: Deformed<'_>,
        damped: Option<KelvinVoigt<'_>>,
        moving: Kinematics<'_>,
        workspace: &mut [EdgeForce],
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
        let mut others = ExternalForces { forces, rod: moving, along, workspace };
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

    /// Adds the opposing forces (N) to `out`, two entries per node.
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

    /// Drag per length and speed (N s/m²) along and across the middle of `rod`, in slow motion through `fluid`.
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

    /// Drag per length and speed (N s/m²) along and across the middle of `rod`, which moves across itself at `speed`
    /// (m/s) and along itself at a tenth of it.
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

    /// The drag (N) of the straight `rod`, towed head first along itself at `speed` (m/s) through `fluid` at rest.
    pub fn towing(&self, rod: &Rod, fluid: Fluid, speed: f64) -> f64 {
        straight(rod, fluid, [-speed, 0.0], |towed| -self.drags().map(|force| resultant(force, towed).x).sum::<f64>())
    }

    /// The drag forces of the fluid.
    fn drags(&self) -> impl Iterator<Item = &dyn Force> + Clone {
        self.iter().filter(|force| force.power_kind() == Some(PowerKind::Drag) && force.is_of_fluid())
    }
}

/// Forces on a rod, summed in the buffer `workspace` of [`EDGES_PER_BLOCK`] edges.
#[derive(Debug)]
pub struct ExternalForces<'a> {
    /// The forces: those before one that is compiled into the pass, and those after it.
    pub forces: [&'a [Box<dyn Force>]; 2],
    /// Kinematics of the rod.
    pub rod: Kinematics<'a>,
    /// The direction of the derivatives, if they are requested.
    pub along: Option<Direction>,
    /// Buffer for the sums.
    pub workspace: &'a mut [EdgeForce],
}

impl ExternalForces<'_> {
    /// True if there are no forces.
    pub fn are_none(&self) -> bool {
        self.forces[0].is_empty() && self.forces[1].is_empty()
    }

    /// Their sum on edge `e`. Edges must be requested in order.
    #[inline(always)]
    pub fn on(&mut self, e: usize) -> EdgeForce {
        let place = e % EDGES_PER_BLOCK;
        if place == 0 {
            self.look_ahead(e);
        }
        self.workspace[place]
    }

    /// Sums the forces on the edges from `e` on.
    #[inline(never)] // keeps registers free for the assembly of edges
    fn look_ahead(&mut self, e: usize) {
        let forces = self.forces[0].iter().chain(self.forces[1]).map(|force| &**force);
        let edges = e..self.rod.edges.len().min(e + EDGES_PER_BLOCK);
        if !sum(forces, &self.rod, self.along, edges, self.workspace) {
            self.workspace.fill(EdgeForce::ZERO);
        }
    }
}

/// Calls `look` with the straight, unstretched `rod` that translates with `velocity` (m/s) through `fluid` at rest.
pub(crate) fn straight<T>(rod: &Rod, fluid: Fluid, velocity: [f64; 2], look: impl FnOnce(&Kinematics<'_>) -> T) -> T {
    let edges: Vec<Edge> = rod.cells.iter().map(|cell| Edge::along(Vector2::x(), cell.rest)).collect();
    let q: Vec<f64> = (0..rod.nodes).flat_map(|k| [rod.arc_length(k), 0.0]).collect();
    let (v, a) = (velocity.repeat(rod.nodes), vec![0.0; 2 * rod.nodes]);
    let fluid = Fluid { flow: Vector2::zeros(), ..fluid };
    look(&Kinematics::within(fluid, &edges, [&q, &v, &a]))
}

/// Sums `forces` on `edges` in `workspace`. Returns false if they are zero; the content of `workspace` is then unspecified.
#[inline(always)]
fn sum<'a>(
    forces: impl Iterator<Item = &'a dyn Force> + Clone,
    rod: &Kinematics<'_>,
    along: Option<Direction>,
    edges: Range<usize>,
    workspace: &mut [EdgeForce],
) -> bool {
    let on_run = |rod: &Kinematics<'_>, run: Range<usize>, sums: &mut [EdgeForce]| {
        let mut tally = ForceAccumulator { sums, fresh: true, slopes: along.is_some() };
        for force in forces.clone() {
            force.evaluate(rod, along, run.clone(), &mut tally);
        }
        !tally.fresh
    };
    // One run, without a search for more (2 % of a step).
    if rod.is_one_run() {
        return on_run(rod, edges.clone(), &mut workspace[..edges.len()]);
    }
    let (mut any, mut runs) = (false, FluidRuns::default());
    for (run, rod) in rod.found(&mut runs).runs(edges.clone()) {
        let place = run.start - edges.start..run.end - edges.start;
        let sums = &mut workspace[place];
        if on_run(&rod, run, sums) {
            any = true;
        } else {
            sums.fill(EdgeForce::ZERO);
        }
    }
    any
}

/// Visits the sum of `forces` on each of `edges`, except where no force contributes.
fn on_edges<'a>(
    forces: impl Iterator<Item = &'a dyn Force> + Clone,
    rod: &Kinematics<'_>,
    along: Option<Direction>,
    edges: Range<usize>,
    mut visit: impl FnMut(usize, &EdgeForce),
) {
    let mut workspace = [EdgeForce::ZERO; 8];
    let mut first = edges.start;
    while first < edges.end {
        let some = first..edges.end.min(first + workspace.len());
        first = some.end;
        if sum(forces.clone(), rod, along, some.clone(), &mut workspace) {
            some.zip(&workspace).for_each(|(e, on)| visit(e, on));
        }
    }
}

/// Visits the opposing force (N) of `force` alone on every node, edge by edge.
pub fn visit_alone(force: &dyn Force, rod: &Kinematics<'_>, mut visit: impl FnMut(usize, Vector2<f64>)) {
    visit_run(force, rod, 0..rod.edges.len(), &mut visit);
}

/// The same for `edges`, and for the tip if the last edge is among them.
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

/// The total opposing force of `force` on the rod, N.
pub fn resultant(force: &dyn Force, rod: &Kinematics<'_>) -> Vector2<f64> {
    let mut sum = Vector2::zeros();
    visit_alone(force, rod, |_, force| sum += force);
    sum
}

/// The powers of `force`, W. Velocities are relative to the fluid for a force of the fluid, and to the ground
/// otherwise.
pub fn powers(force: &dyn Force, rod: &Kinematics<'_>) -> Powers {
    let edges = 0..rod.edges.len();
    // One run, without a search for more.
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

/// The same for `edges`, and for the tip if the last edge is among them.
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

/// The same for a `flow` (m/s) that differs between nodes.
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

/// The directions of a force's derivatives: accelerations only if it depends on them.
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

/// Adds the first-order change of the opposing force on every node to `out` (two entries per node), for a `change` of
/// positions, velocities and accelerations, and of the flow by `flow` (m/s).
pub fn add_change(force: &dyn Force, rod: &Kinematics<'_>, change: [&[f64]; 3], flow: Vector2<f64>, out: &mut [f64]) {
    match force.global() {
        Some(whole) => whole.add_change(rod, [change[0], change[1]], flow, out),
        None => add_banded_change(force, rod, change, flow, out),
    }
}

/// The part of [`add_change`] within the band of the rod's matrix.
pub(crate) fn add_banded_change(
    force: &dyn Force,
    rod: &Kinematics<'_>,
    change: [&[f64]; 3],
    flow: Vector2<f64>,
    out: &mut [f64],
) {
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

/// The transpose of [`add_change`]: adds to `by` the derivatives of Σ c·F over the ends of `edges`, where c is the
/// `cotangent` of a node.
pub fn add_slopes(
    force: &dyn Force,
    rod: &Kinematics<'_>,
    edges: Range<usize>,
    cotangent: impl Fn(usize) -> Vector2<f64>,
    by: &mut StateDerivatives<'_>,
) {
    if let Some(whole) = force.global() {
        whole.add_slopes(rod, edges, &cotangent, by);
        return;
    }
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
    /// Reborrows the derivatives.
    pub fn reborrow(&mut self) -> StateDerivatives<'_> {
        StateDerivatives { q: self.q, v: self.v, a: self.a }
    }
}
