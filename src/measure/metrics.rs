//! Measurements of a run: energies, powers, forces and momentum at each time, their totals, and the balances of energy and momentum.

use std::f64::consts::PI;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
#[cfg(all(feature = "report", target_arch = "x86_64"))]
use crate::fluid::Force;
use crate::fluid::force::{self, Powers};
use crate::fluid::validity::TransverseMotion;
use crate::fluid::{Fluid, Forces, Kinematics, PowerKind};
use crate::head::{Row, hermite};
#[cfg(all(feature = "report", target_arch = "x86_64"))]
use crate::linear::Real;
use crate::model::{ActiveMoments, DeformedRod, Dynamics, Mechanics};
use crate::rod::damping::KelvinVoigt;
use crate::rod::energies::{MovingRod, RodSums};
use crate::rod::{Cell, DampedRate, Edge, Rod, bend, node};
use crate::system::{Link, State, System};
use crate::tendons::MAX_TENDONS;

/// The measurements of a batched step: sums over a rod, for one case or for all lanes.
#[cfg(all(feature = "report", target_arch = "x86_64"))]
#[derive(Debug, Clone, Copy)]
pub(crate) struct BatchedMeasurements<T: Real = f64> {
    /// Sums over the rod.
    pub sums: RodSums<T>,
    /// The force that a held head must exert, N; zero for a free head.
    pub held: Vector2<T>,
}

/// Energies, J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// Stretching energy E_s.
    pub stretching: f64,
    /// Bending energy E_b.
    pub bending: f64,
    /// Kinetic energy E_k.
    pub kinetic: f64,
    /// Energy stored by external forces: kinetic energy of the added mass.
    pub fluid: f64,
}

impl Energy {
    /// The sum of all.
    pub fn total(&self) -> f64 {
        self.stretching + self.bending + self.kinetic + self.fluid
    }

    fn add(&mut self, other: &Self, factor: f64) {
        self.stretching += factor * other.stretching;
        self.bending += factor * other.bending;
        self.kinetic += factor * other.kinetic;
        self.fluid += factor * other.fluid;
    }
}

/// Powers (W), or work (J): dE/dt = actuation − material − viscous − wake − spray + load + head + flow + other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Power {
    /// Supplied by the change of natural curvature and by active moments: Σ M_k dκ_k/dt − Σ (m_k + M_k) dκ̄_k/dt.
    pub actuation: f64,
    /// Dissipated in the rod's material, see [`Damping`](crate::rod::Damping), and in the bearing of a hinge.
    pub material: f64,
    /// Dissipated by drag: F·(v − u) ≥ 0.
    pub viscous: f64,
    /// Dissipated in the wake shed by the tail.
    pub wake: f64,
    /// Dissipated in the spray where the rod enters a denser fluid.
    pub spray: f64,
    /// Supplied by gravity, point loads and the forces of a host.
    pub load: f64,
    /// Supplied by a held head.
    pub head: f64,
    /// Supplied by the background flow: −F·u.
    pub flow: f64,
    /// Supplied by other forces.
    pub other: f64,
}

impl Power {
    /// The net power into the rod.
    pub fn net(&self) -> f64 {
        self.actuation - self.material - self.viscous - self.wake - self.spray
            + self.load
            + self.head
            + self.flow
            + self.other
    }

    /// The largest modulus of its parts.
    pub(crate) fn largest(&self) -> f64 {
        let Self { actuation, material, viscous, wake, spray, load, head, flow, other } = *self;
        let parts = [actuation, material, viscous, wake, spray, load, head, flow, other];
        parts.into_iter().fold(0.0, |max: f64, x| max.max(x.abs()))
    }

    /// The powers of the actuation and of a held head.
    fn of_drives(&self) -> [f64; 2] {
        [self.actuation, self.head]
    }

    /// Computes each part by `value`, which gets the accessor of the part.
    #[inline(always)]
    fn by_part(value: impl Fn(fn(&Self) -> f64) -> f64) -> Self {
        Self {
            actuation: value(|power| power.actuation),
            material: value(|power| power.material),
            viscous: value(|power| power.viscous),
            wake: value(|power| power.wake),
            spray: value(|power| power.spray),
            load: value(|power| power.load),
            head: value(|power| power.head),
            flow: value(|power| power.flow),
            other: value(|power| power.other),
        }
    }

    /// Adds the powers and resultants of all `forces` to `self` and `resultants`; returns the energy (J) and momentum (N s) that
    /// they store.
    fn add_forces(
        &mut self,
        forces: &Forces,
        rod: &Kinematics<'_>,
        resultants: &mut Resultants,
    ) -> (f64, Vector2<f64>) {
        let (mut stored, mut momentum) = (0.0, Vector2::zeros());
        for force in forces.iter() {
            self.add_powers(force.power_kind(), force::powers(force, rod), resultants);
            if force.power_kind().is_none() {
                let (energy, own) = force.stored(rod);
                stored += energy;
                momentum += own;
                self.other += force.energy_by_time(rod, 0.0, None);
                resultants.other += force.pull(rod);
            }
        }
        (stored, momentum)
    }

    /// Adds the powers and the resultant of a force whose power is of this `kind`.
    #[inline(always)]
    fn add_powers(&mut self, kind: Option<PowerKind>, powers: Powers, resultants: &mut Resultants) {
        let Powers { opposing, against_fluid, of_flow } = powers;
        self.flow += of_flow;
        *resultants.from(kind) -= opposing;
        match kind {
            Some(PowerKind::Drag) => self.viscous += against_fluid,
            Some(PowerKind::Wake) => self.wake += against_fluid,
            Some(PowerKind::Flow) => self.flow -= against_fluid,
            Some(PowerKind::Spray) => self.spray += against_fluid,
            Some(PowerKind::Load) => self.load -= against_fluid,
            Some(PowerKind::Drive) => self.actuation -= against_fluid,
            Some(PowerKind::Other) => self.other -= against_fluid,
            None => (),
        }
    }
}

/// Resultant forces on the rod (N), or impulses (N s), by source:
/// d/dt (momentum of the rod + of the fluid) = drag + wake + spray + flow + load + head + other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Resultants {
    /// Drag.
    pub drag: Vector2<f64>,
    /// The wake shed by the tail.
    pub wake: Vector2<f64>,
    /// The spray where the rod enters a denser fluid.
    pub spray: Vector2<f64>,
    /// The inertia of the fluid: minus the rate of its momentum. It is not part of the balance.
    pub inertia: Vector2<f64>,
    /// The pressure of an accelerating flow.
    pub flow: Vector2<f64>,
    /// Gravity, point loads, buoyancy and the forces of a host.
    pub load: Vector2<f64>,
    /// A held head.
    pub head: Vector2<f64>,
    /// Other forces, and the pull towards the lighter side of an interface.
    pub other: Vector2<f64>,
}

impl Resultants {
    /// The rate of the momentum of rod and fluid together.
    pub fn net(&self) -> Vector2<f64> {
        self.drag + self.wake + self.spray + self.flow + self.load + self.head + self.other
    }

    /// The resultant of forces whose power is of this `kind`.
    pub(crate) fn from(&mut self, kind: Option<PowerKind>) -> &mut Vector2<f64> {
        match kind {
            Some(PowerKind::Drag) => &mut self.drag,
            Some(PowerKind::Wake) => &mut self.wake,
            Some(PowerKind::Spray) => &mut self.spray,
            Some(PowerKind::Load) => &mut self.load,
            Some(PowerKind::Flow) => &mut self.flow,
            Some(PowerKind::Drive | PowerKind::Other) => &mut self.other,
            None => &mut self.inertia,
        }
    }

    fn add(&mut self, other: &Self, factor: f64) {
        self.drag += other.drag * factor;
        self.wake += other.wake * factor;
        self.spray += other.spray * factor;
        self.inertia += other.inertia * factor;
        self.flow += other.flow * factor;
        self.load += other.load * factor;
        self.head += other.head * factor;
        self.other += other.other * factor;
    }
}

/// Momentum, N s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Momentum {
    /// Momentum of the rod; zero without inertia.
    pub rod: Vector2<f64>,
    /// Momentum of the fluid accelerated by the rod, relative to the flow.
    pub fluid: Vector2<f64>,
}

impl Momentum {
    /// Momentum of rod and fluid.
    pub fn total(&self) -> Vector2<f64> {
        self.rod + self.fluid
    }
}

/// Values of a tendon at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct TendonReading {
    /// Its tension, N.
    pub tension: f64,
    /// Its length Λ, m.
    pub length: f64,
    /// dΛ/dt, m/s.
    pub length_rate: f64,
    /// Σ ℓ_e of its edges, m.
    pub edge_length: f64,
    /// The free length of its cable, m, and the rate of that length, m/s: set by a winch, or else the tendon's own.
    pub wound: [f64; 2],
}

impl TendonReading {
    /// The power (W) of whatever pulls the tendon, −T dΛ/dt.
    pub fn power(&self) -> f64 {
        -self.tension * self.length_rate
    }

    /// The power (W) of whatever winds the cable: for a winch, which also stretches the cable.
    pub fn winding_power(&self) -> f64 {
        -self.tension * self.wound[1]
    }
}

/// Values of a hinge at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HingeReading {
    /// Torque T of its motor, N m.
    pub torque: f64,
    /// The torque commanded to the motor, before its limit, N m.
    pub asked: f64,
    /// Angle, rad.
    pub angle: f64,
    /// Angular velocity, rad/s.
    pub spin: f64,
    /// The commanded angle of the servo minus the angle, rad.
    pub error: f64,
}

impl HingeReading {
    /// The power (W) supplied by the motor.
    pub fn power(&self) -> f64 {
        self.torque * self.spin
    }
}

/// All measurements at one time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Measurements {
    /// Time, s.
    pub time: f64,
    /// Centre of mass, m.
    pub com: Vector2<f64>,
    /// Energies.
    pub energy: Energy,
    /// Powers.
    pub power: Power,
    /// Forces on the rod.
    pub resultants: Resultants,
    /// Momentum of rod and fluid.
    pub momentum: Momentum,
    /// Force of the tail on a held head, N.
    pub head_force: Vector2<f64>,
    /// Moment of the tail on a held head about node 0, N m.
    pub head_moment: f64,
    /// Values of a hinge.
    pub hinge: HingeReading,
    /// Position and velocity of node 0.
    head: [Vector2<f64>; 2],
    /// Angle and angular velocity of a held head.
    head_angle: [f64; 2],
    /// The moment (N m) against which the head is turned: that of the tail, or the opposite of a motor's torque.
    head_couple: f64,
    /// Force (N) that a held head exerts beyond the inertia of node 0.
    head_push: Vector2<f64>,
    /// Curvature κ_k, dimensionless, one entry per node.
    pub kappa: Vec<f64>,
    /// m_k = (EI_k/ΔL)(κ_k − κ̄_k) − M_k, N m, conjugate to κ_k, plus the damping moment of the material; one entry per node.
    pub moment: Vec<f64>,
    /// The elastic part of `moment`, N m, with a damped material or with active moments; empty otherwise.
    elastic: Vec<f64>,
    /// The active moments M_k, N m; empty without active moments.
    active: Vec<f64>,
    /// True if the moving natural curvature works against the total moments, false if it works against the elastic part.
    drives_all: bool,
    /// Largest |ℓ/ΔL − 1| of an edge.
    pub strain: f64,
    /// κ̄_k, or κ_k for the shape model, which prescribes it.
    natural: Vec<f64>,
    /// Unit tangent of each edge.
    tangent: Vec<Vector2<f64>>,
    /// Values of each tendon.
    pub tendons: [TendonReading; MAX_TENDONS],
    /// Cross-flow velocity of the rod.
    across: CrossFlowSquares,
}

/// Cross-flow of a rod: its velocity through the fluid, normal to itself, as mean squares over its length. [`RunningTotals`]
/// integrates them over time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct CrossFlowSquares {
    /// Mean square of the velocity w, m²/s².
    pub speed: f64,
    /// Mean square of w/ν for the local fluid, 1/m².
    pub per_depth: f64,
    /// Mean square of u/ν for the local fluid, where u is the velocity along the rod, 1/m².
    pub along: f64,
    /// Mean square of |V|/ν of a head body for the local fluid, 1/m².
    pub body: f64,
    /// Mean density of the local fluid, kg/m³.
    pub density: f64,
    /// Mean viscosity of the local fluid, Pa s.
    pub viscosity: f64,
}

impl CrossFlowSquares {
    /// Computes the mean squares for a rod at `state` whose edges have these tangents; zero without fluid.
    fn of(dynamics: &Dynamics, state: &State, tangent: &[Vector2<f64>]) -> Self {
        let (forces, inputs) = (&dynamics.model.forces, &dynamics.inputs);
        if forces.is_empty() || inputs.fluid.viscosity <= 0.0 {
            return Self::default();
        }
        let rod = &dynamics.model.rod;
        let mut sums = Self::default();
        // The neck of a body is not part of the rod.
        let edges = rod.front..tangent.len();
        let share = 1.0 / edges.len() as f64;
        if rod.body.is_some() {
            let fluid = dynamics.fluid_at(node(&state.q, 0));
            sums.body = (node(&state.v, 0) - fluid.flow).norm_squared() * (fluid.density / fluid.viscosity).powi(2);
        }
        // In a uniform medium the ratio is equal at every edge.
        let with_ratio = |fluid: Fluid| (fluid, (fluid.density / fluid.viscosity).powi(2));
        let uniform = inputs.layers.is_none().then(|| with_ratio(inputs.fluid));
        for e in edges {
            let (fluid, ratio) = uniform.unwrap_or_else(|| with_ratio(dynamics.fluid_at(node(&state.q, e))));
            let velocity = (node(&state.v, e) + node(&state.v, e + 1)) * 0.5 - fluid.flow;
            let square = tangent[e].perp(&velocity).powi(2) * share;
            sums.speed += square;
            sums.per_depth += square * ratio;
            sums.along += tangent[e].dot(&velocity).powi(2) * share * ratio;
            sums.density += fluid.density * share;
            sums.viscosity += fluid.viscosity * share;
        }
        sums
    }

    fn add(&mut self, other: &Self, factor: f64) {
        self.speed += factor * other.speed;
        self.per_depth += factor * other.per_depth;
        self.along += factor * other.along;
        self.body += factor * other.body;
        self.density += factor * other.density;
        self.viscosity += factor * other.viscosity;
    }
}

impl Measurements {
    /// Empty measurements for `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        let zeros = || vec![0.0; nodes];
        let tangent = vec![Vector2::zeros(); nodes - 1];
        Self { kappa: zeros(), moment: zeros(), natural: zeros(), tangent, ..Self::default() }
    }

    /// Copies `other`, without allocating if capacities suffice.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self { mut kappa, mut moment, mut elastic, mut active, mut natural, mut tangent, .. } =
            std::mem::take(self);
        kappa.clone_from(&other.kappa);
        moment.clone_from(&other.moment);
        elastic.clone_from(&other.elastic);
        active.clone_from(&other.active);
        natural.clone_from(&other.natural);
        tangent.clone_from(&other.tangent);
        *self = Self { kappa, moment, elastic, active, natural, tangent, ..*other };
    }

    /// The number of nodes; zero if the lengths of its arrays are inconsistent.
    pub(crate) fn nodes(&self) -> usize {
        let lengths = [self.kappa.len(), self.moment.len(), self.natural.len(), self.tangent.len() + 1];
        if lengths == [lengths[0]; 4] { lengths[0] } else { 0 }
    }

    /// Measures `state`. `dynamics` must be at its time.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`]; [`Error::NotFinite`] for energies and powers.
    pub fn measure(&mut self, dynamics: &mut Dynamics, state: &State) -> Result<()> {
        let taken = dynamics.mechanics == Mechanics::Shape;
        let mut workspace = std::mem::take(&mut dynamics.unused);
        let outcome = self.measure_with(dynamics, state, taken, &mut workspace);
        dynamics.unused = workspace;
        outcome
    }

    fn measure_with(
        &mut self,
        dynamics: &mut Dynamics,
        state: &State,
        taken: bool,
        workspace: &mut Vec<f64>,
    ) -> Result<()> {
        let holding = if taken { Some(dynamics.balance(state, &mut self.moment)?) } else { None };
        let bent = dynamics.shape(state)?;
        let (dynamics, edges) = (bent.dynamics, bent.edges());
        let rod = &dynamics.model.rod;
        self.kappa.copy_from_slice(bent.kappa());
        self.natural.copy_from_slice(if taken { &self.kappa } else { &dynamics.natural });
        if !taken {
            bend::moments(&rod.joint, &self.kappa, &self.natural, &mut self.moment);
        }
        self.tangent.iter_mut().zip(edges).for_each(|(tangent, edge)| *tangent = edge.t);
        let moving = MovingRod {
            cells: &rod.cells,
            edges,
            mass: &rod.mass,
            q: state.q.as_chunks().0,
            v: state.v.as_chunks().0,
            kappa: &self.kappa,
            natural: &self.natural,
            natural_rate: &dynamics.natural_rate,
            moment: &self.moment,
        };
        let mut sums = RodSums::of(&moving, 0.0);
        if !state.links.is_empty() {
            let resisted = |e: usize| dynamics.damped().map_or(0.0, |damped| damped.tension_of_rate(rod, e));
            let stored = |(e, ((edge, link), cell)): (usize, ((&Edge, &Link), &Cell))| {
                let tension = edge.t.dot(&Vector2::from(link.force)) - resisted(e);
                0.5 * tension * tension / cell.axial
            };
            sums.stretching = edges.iter().zip(&state.links).zip(rod.cells.iter()).enumerate().map(stored).sum();
        }
        let material = self.resist(dynamics, taken, &mut sums.actuation);
        self.activate(dynamics, state, taken, &mut sums);
        self.read_tendons(&bent);
        let held = || holding.unwrap_or_else(|| bent.reaction());
        let forces = |power: &mut Power, resultants: &mut Resultants| {
            let moving = bent.kinematics();
            let stored = power.add_forces(&dynamics.model.forces, &moving, resultants);
            if dynamics.extrapolation.is_some() && dynamics.model.forces.are_inertial() {
                workspace.resize(state.q.len(), 0.0);
                let (medium_power, momentum) = dynamics.medium_change_rates(&moving, workspace);
                power.flow += medium_power;
                resultants.flow += momentum;
            }
            stored
        };
        self.assemble(dynamics, state, &sums, material, forces, held)
    }

    /// Adds the damping moments of the material to the moments, unless these already contain `all` moments because they follow
    /// from balance, and adds their contribution to the power of the `actuation`. Returns the dissipated power, W.
    fn resist(&mut self, dynamics: &Dynamics, all: bool, actuation: &mut f64) -> f64 {
        dynamics.damped().map_or(0.0, |damped| self.resist_by(damped, dynamics, all, actuation))
    }

    #[inline(never)] // rare: most rods are elastic
    fn resist_by(&mut self, damped: KelvinVoigt<'_>, dynamics: &Dynamics, all: bool, actuation: &mut f64) -> f64 {
        let KelvinVoigt { damping, rates } = damped;
        let (rod, natural_rate) = (&dynamics.model.rod, &dynamics.natural_rate);
        let whole = damping.rate == DampedRate::Whole;
        self.drives_all = !whole;
        self.elastic.clone_from(&self.moment);
        for k in rod.joints() {
            let resisting = damped.moment_of_rate(rod, k);
            // Balance gives the total moment, the curvature only its elastic part. The power so far is based on the given part.
            if all {
                self.elastic[k] -= resisting;
            } else {
                self.moment[k] += resisting;
            }
            if all == whole {
                let sign = if all { 1.0 } else { -1.0 };
                *actuation += sign * resisting * natural_rate[k];
            }
        }
        damping.power(rod, rates)
    }

    /// Separates active moments from the natural curvature, and corrects the bending energy and the actuation power in `sums`. If
    /// the shape is `taken` (prescribed), it follows from the moments if the scene has them, and otherwise from curvatures.
    fn activate(&mut self, dynamics: &Dynamics, state: &State, taken: bool, sums: &mut RodSums) {
        match dynamics.active.as_ref().filter(|_| !taken || dynamics.model.active_moments) {
            Some(active) => self.activate_by(active, dynamics, state, taken, sums),
            None => {
                self.active.clear();
                if dynamics.damped().is_none() {
                    self.elastic.clear();
                }
            }
        }
    }

    #[inline(never)] // rare: most rods are bent by natural curvature
    fn activate_by(
        &mut self,
        active: &ActiveMoments,
        dynamics: &Dynamics,
        state: &State,
        taken: bool,
        sums: &mut RodSums,
    ) {
        let rod = &dynamics.model.rod;
        self.active.clone_from(&active.moment);
        self.natural.copy_from_slice(&active.natural);
        self.elastic.resize(rod.nodes, 0.0);
        sums.bending = 0.0;
        if !taken {
            sums.actuation = 0.0;
        }
        for k in rod.joints() {
            let strained = self.kappa[k] - active.natural[k];
            let elastic = rod.joint[k] * strained;
            self.elastic[k] = elastic;
            sums.bending += 0.5 * elastic * strained;
            sums.actuation += if taken {
                // In addition to the work required by balance, the moments store energy: κ = κ̄ + M/B.
                strained * active.rate[k]
            } else {
                active.moment[k] * self.curvature_rate(dynamics, state, k) - elastic * active.natural_rate[k]
            };
        }
    }

    /// Evaluates the tendons.
    fn read_tendons(&mut self, bent: &DeformedRod<'_>) {
        let DeformedRod { dynamics, state } = bent;
        for (i, tendon) in dynamics.model.tendons.iter().enumerate() {
            let turning: f64 = tendon.joints.clone().map(|k| self.curvature_rate(dynamics, state, k)).sum();
            let length = tendon.length(bent.edges(), &self.kappa);
            let length_rate = tendon.edge_length_rate(bent.edges(), &state.v) - tendon.offset * turning;
            self.tendons[i] = TendonReading {
                tension: dynamics.tensions[0][i],
                length,
                length_rate,
                edge_length: tendon.edge_length(bent.edges()),
                wound: dynamics.winch_length(i).unwrap_or([length, length_rate]),
            };
        }
    }

    /// dκ_k/dt of the joint at node `k`, 1/s, from the rotation of its edges.
    fn curvature_rate(&self, dynamics: &Dynamics, state: &State, k: usize) -> f64 {
        let spin = |e: usize| {
            let across = |values: &[f64]| self.tangent[e].perp(&(node(values, e + 1) - node(values, e)));
            across(&state.v) / self.tangent[e].dot(&(node(&state.q, e + 1) - node(&state.q, e)))
        };
        let before = match (k, &dynamics.held) {
            (0, held) => held.map_or(0.0, |[_, _, angle]| angle.rate),
            _ => spin(k - 1),
        };
        bend::curvature_per_turning(self.kappa[k]) * (spin(k) - before)
    }

    /// The power (W) that the actuation supplies at the joint of each node. For tendons this is the power of bending the joint
    /// and of shortening the edge behind it, or the nearest edge. The sum is [`Power::actuation`].
    #[cfg(feature = "report")]
    pub(crate) fn actuation_powers(&self, dynamics: &Dynamics, state: &State) -> Vec<f64> {
        let rod = &dynamics.model.rod;
        let taken = dynamics.mechanics == Mechanics::Shape;
        let active = dynamics.active.as_ref().filter(|_| !taken || dynamics.model.active_moments);
        let mut powers = vec![0.0; rod.nodes];
        for k in rod.joints() {
            let by_curvature = -self.driven(false)[k] * dynamics.natural_rate[k];
            powers[k] = match active {
                None => by_curvature,
                Some(active) if taken => by_curvature + (self.kappa[k] - active.natural[k]) * active.rate[k],
                Some(active) => {
                    active.moment[k] * self.curvature_rate(dynamics, state, k)
                        - self.elastic[k] * active.natural_rate[k]
                }
            };
        }
        for (tendon, TendonReading { tension, .. }) in dynamics.model.tendons.iter().zip(&self.tendons) {
            // The moments of tendons are among the active ones.
            for e in tendon.edges.clone() {
                let opening = self.tangent[e].dot(&(node(&state.v, e + 1) - node(&state.v, e)));
                powers[e.clamp(tendon.joints.start, tendon.joints.end - 1)] -= tension * opening;
            }
        }
        powers
    }

    /// The moments that the natural curvature works against, N m: for a jump (`jumps`), their elastic part.
    fn driven(&self, jumps: bool) -> &[f64] {
        if self.elastic.is_empty() || (self.drives_all && !jumps) { &self.moment } else { &self.elastic }
    }

    /// The same as [`measure`](Self::measure) for a `state` that was `measured` in a batch. `of_force` returns the powers of the
    /// force with that index, and the energy (J) and momentum (N s) that it stores; `fill` writes curvatures, moments and
    /// tangents.
    ///
    /// # Errors
    /// Errors of [`measure`](Self::measure).
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    pub(crate) fn measure_presolved(
        &mut self,
        dynamics: &Dynamics,
        state: &State,
        measured: &BatchedMeasurements,
        of_force: impl Fn(usize, &dyn Force) -> (Powers, (f64, Vector2<f64>)),
        fill: impl FnOnce(&mut [f64], &mut [f64], &mut [Vector2<f64>]),
    ) -> Result<()> {
        fill(&mut self.kappa, &mut self.moment, &mut self.tangent);
        self.natural.copy_from_slice(&dynamics.natural);
        let forces = |power: &mut Power, resultants: &mut Resultants| {
            let (mut stored, mut momentum) = (0.0, Vector2::zeros());
            for (i, force) in dynamics.model.forces.iter().enumerate() {
                let (kind, (powers, (energy, own))) = (force.power_kind(), of_force(i, force));
                power.add_powers(kind, powers, resultants);
                if kind.is_none() {
                    stored += energy;
                    momentum += own;
                }
            }
            (stored, momentum)
        };
        let mut sums = measured.sums;
        let material = self.resist(dynamics, false, &mut sums.actuation);
        self.activate(dynamics, state, false, &mut sums);
        self.assemble(dynamics, state, &sums, material, forces, || measured.held)
    }

    /// Assembles the measurements from the `sums` of `state`, after curvatures, moments and tangents. `forces` adds the powers
    /// and resultants of forces and returns the energy (J) and momentum (N s) that they store; `held` returns the force (N) that
    /// holds the head.
    #[inline(always)]
    fn assemble(
        &mut self,
        dynamics: &Dynamics,
        state: &State,
        sums: &RodSums,
        material: f64,
        forces: impl FnOnce(&mut Power, &mut Resultants) -> (f64, Vector2<f64>),
        held: impl FnOnce() -> Vector2<f64>,
    ) -> Result<()> {
        let RodSums { bending, stretching, kinetic, actuation, moment_of_mass, momentum, strain } = *sums;
        self.time = state.t;
        self.com = Vector2::from(moment_of_mass.to_array()) / dynamics.model.rod.total_mass();
        self.strain = strain;
        self.across = CrossFlowSquares::of(dynamics, state, &self.tangent);
        let mut energy = Energy { bending, stretching, kinetic, fluid: 0.0 };
        let mut momentum = Momentum { rod: momentum.to_array().into(), fluid: Vector2::zeros() };
        if dynamics.mechanics == Mechanics::Overdamped {
            energy.kinetic = 0.0;
            momentum.rod = Vector2::zeros();
        }
        let (mut power, mut resultants) = (Power { actuation, material, ..Power::default() }, Resultants::default());
        if dynamics.is_loaded() {
            (power.load, resultants.load) = dynamics.loads_along(|k| node(&state.v, k));
        }
        (energy.fluid, momentum.fluid) = forces(&mut power, &mut resultants);
        if let Some([_, _, angle]) = dynamics.held {
            let (mass, moment) = (dynamics.head_mass(), self.moment[0] * bend::curvature_per_turning(self.kappa[0]));
            let held = held();
            self.head_force = -held;
            resultants.head = held;
            self.head_moment = moment;
            self.head_push = held - node(&state.a, 0) * mass;
            self.head = [node(&state.q, 0), node(&state.v, 0)];
            self.head_angle = [angle.value, angle.rate];
            self.head_couple = moment;
            if let Some(hinge) = &dynamics.model.hinge {
                self.hinge = HingeReading {
                    torque: dynamics.hinge_torque(),
                    asked: hinge.asked(dynamics.command, angle.value),
                    angle: angle.value,
                    spin: angle.rate,
                    error: dynamics.command.angle - angle.value,
                };
                self.head_couple = -self.hinge.torque;
                power.material += hinge.damping * angle.rate * angle.rate;
                energy.kinetic += 0.5 * hinge.inertia * angle.rate * angle.rate;
            }
            power.head = held.dot(&self.head[1]) - self.head_couple * angle.rate;
        }
        if !(energy.total() + power.net()).is_finite() {
            let node = self.moment.iter().position(|m| !(m * m).is_finite()).unwrap_or(0);
            return Err(Error::NotFinite { time_s: state.t, node, what: "energy or power" });
        }
        let places = self.com.sum() + self.strain + self.kappa.iter().sum::<f64>() + self.moment.iter().sum::<f64>();
        let head = self.head_force.sum() + self.head_moment;
        if !(places + head).is_finite() {
            let bent = self.kappa.iter().zip(&self.moment);
            let node = bent.clone().position(|(kappa, moment)| !(kappa + moment).is_finite()).unwrap_or(0);
            return Err(Error::NotFinite { time_s: state.t, node, what: "position, curvature or force" });
        }
        (self.energy, self.power, self.resultants, self.momentum) = (energy, power, resultants, momentum);
        Ok(())
    }

    /// The energy (J) that the joints would store under the moments that they transmit, Σ ½ m²/B: the energy that a rod out of
    /// balance releases.
    pub fn imbalance(&self, rod: &Rod) -> f64 {
        rod.joints().map(|k| 0.5 * self.moment[k] * self.moment[k] / rod.joint[k]).sum()
    }

    /// Moduli of the force (N) and of the moment (N m) of the tail on a held head.
    fn on_head(&self) -> [f64; 2] {
        [self.head_force.norm(), self.head_moment.abs()]
    }

    /// The largest modulus of the couples (N m) transmitted by the joints.
    fn largest_couple(&self) -> f64 {
        let couple = |(moment, kappa): (&f64, &f64)| (moment * bend::curvature_per_turning(*kappa)).abs();
        self.moment.iter().zip(&self.kappa).map(couple).fold(0.0, |most, own| if own > most { own } else { most })
    }

    /// Angle of a held head, from +x, rad.
    pub(crate) fn head_angle(&self) -> f64 {
        self.head_angle[0]
    }

    /// The largest rotation (rad) of an edge since `before`, at least `most`.
    fn rotation_since(&self, before: &Self, most: f64) -> f64 {
        let chord = |(t, old): (&Vector2<f64>, &Vector2<f64>)| (t - old).norm_squared();
        let larger = |largest: f64, chord: f64| if chord > largest { chord } else { largest };
        let largest = self.tangent.iter().zip(&before.tangent).map(chord).fold(0.0, larger);
        // An arc is at most π/2 times its chord, which nearly always decides.
        if PI * PI * largest <= 4.0 * most * most {
            return most;
        }
        most.max(2.0 * (0.5 * largest.sqrt()).min(1.0).asin())
    }

    /// Work (J) since `before`, by Simpson's rule with the powers at the `middle`; `load` is the work of the loads.
    fn smooth_work_since(&self, before: &Self, middle: &Self, load: f64) -> Power {
        let sixth = (self.time - before.time) / 6.0;
        let work = |of: fn(&Power) -> f64| sixth * (of(&before.power) + 4.0 * of(&middle.power) + of(&self.power));
        Power { load, ..Power::by_part(work) }
    }

    /// Work (J) since `before`, by the trapezoidal rule: in time for drag and flow, in κ̄, κ or length for the actuation, in position and angle for the
    /// head. `load` is the work of the loads.
    fn work_since(&self, before: &Self, load: f64, head_mass: f64) -> Power {
        let half_time = 0.5 * (self.time - before.time);
        let trapezoid = |of: fn(&Power) -> f64| half_time * (of(&self.power) + of(&before.power));
        let mut actuation = (self.natural.iter().zip(&before.natural))
            .zip(self.driven(half_time == 0.0).iter().zip(before.driven(half_time == 0.0)))
            .map(|((now, old), (m_now, m_old))| -0.5 * (m_now + m_old) * (now - old))
            .sum();
        for active in [&self.active, &before.active] {
            let bent = active.iter().zip(self.kappa.iter().zip(&before.kappa));
            actuation += bent.map(|(moment, (now, old))| 0.5 * moment * (now - old)).sum::<f64>();
        }
        for (now, old) in self.tendons.iter().zip(&before.tendons) {
            actuation -= 0.5 * (now.tension + old.tension) * (now.edge_length - old.edge_length);
        }
        let translation = 0.5 * (self.head_push + before.head_push).dot(&(self.head[0] - before.head[0]));
        let inertia = 0.5 * head_mass * (self.head[1].norm_squared() - before.head[1].norm_squared());
        let twist = 0.5 * (self.head_couple + before.head_couple) * (self.head_angle[0] - before.head_angle[0]);
        Power { actuation, load, head: translation + inertia - twist, ..Power::by_part(trapezoid) }
    }
}

/// The source of the energy of a jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorkSource {
    /// The actuation, for a jump of the shape.
    Actuation,
    /// The flow, for a jump of its velocity or of the density.
    Flow,
    /// Loads, for a motion that a host gives.
    Load,
}

/// Extreme values of the motor of a hinge.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HingeExtremes {
    /// Largest modulus of its torque, N m.
    pub torque: f64,
    /// Largest modulus of the commanded torque, N m.
    pub asked: f64,
    /// Largest power supplied, W.
    pub power: f64,
    /// Largest modulus of its angular velocity, rad/s.
    pub speed: f64,
}

impl HingeExtremes {
    fn of(hinge: &HingeReading) -> Self {
        let HingeReading { torque, asked, spin, .. } = hinge;
        Self { torque: torque.abs(), asked: asked.abs(), power: hinge.power(), speed: spin.abs() }
    }

    fn widen(&mut self, hinge: &HingeReading) {
        let Self { torque, asked, power, speed } = Self::of(hinge);
        *self = Self {
            torque: self.torque.max(torque),
            asked: self.asked.max(asked),
            power: self.power.max(power),
            speed: self.speed.max(speed),
        };
    }
}

/// Extreme values of the drive of a tendon.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct TendonExtremes {
    /// Largest tension, N.
    pub tension: f64,
    /// Largest power supplied, W.
    pub power: f64,
    /// Largest speed of winding, in either direction, m/s.
    pub speed: f64,
    /// Smallest and largest free length of the cable, m.
    pub length: [f64; 2],
}

impl TendonExtremes {
    fn of(tendon: &TendonReading) -> Self {
        let TendonReading { tension, wound: [length, speed], .. } = *tendon;
        Self { tension, power: tendon.winding_power(), speed: speed.abs(), length: [length; 2] }
    }

    fn widen(&mut self, tendon: &TendonReading) {
        let Self { tension, power, speed, length: [least, most] } = Self::of(tendon);
        *self = Self {
            tension: self.tension.max(tension),
            power: self.power.max(power),
            speed: self.speed.max(speed),
            length: [self.length[0].min(least), self.length[1].max(most)],
        };
    }

    /// The difference between the largest and smallest free length, m.
    pub fn travel(&self) -> f64 {
        self.length[1] - self.length[0]
    }
}

/// Running totals over all steps of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RunningTotals {
    /// Work since the start, J.
    pub work: Power,
    /// Impulses since the start, N s.
    pub impulse: Resultants,
    /// Energies integrated over time since the start, J s.
    pub energy_time: Energy,
    /// Cross-flow integrated over time since the start.
    pub across_time: CrossFlowSquares,
    /// Largest |y_COM|, m.
    pub max_lateral: f64,
    /// Length of the path of the centre of mass, m.
    pub path: f64,
    /// Largest |ℓ/ΔL − 1| of any edge at any step.
    pub max_strain: f64,
    /// Largest rotation (rad) of any edge within a step.
    pub max_rotation: f64,
    /// Largest force (N) and moment (N m) of the tail on a held head at any step.
    pub max_on_head: [f64; 2],
    /// Largest energy, or work of one kind since the start, at any step, J. Both may be near zero at the end of whole cycles.
    pub max_energy: f64,
    /// Largest couple (N m) transmitted by a joint at any step.
    pub max_couple: f64,
    /// Largest power (W) of the actuation and of a held head at any step.
    pub max_power: [f64; 2],
    /// Extreme values of the motor of a hinge over all steps.
    pub hinge: HingeExtremes,
    /// Extreme values of the drive of each tendon over all steps.
    pub tendons: [TendonExtremes; MAX_TENDONS],
    /// Number of accepted steps.
    pub steps: u64,
    /// Number of halved steps.
    pub halvings: u64,
    /// Number of steps that the error estimate rejected and that were repeated with a smaller size.
    pub rejections: u64,
}

impl RunningTotals {
    /// The totals at `now`, between these totals and `later`; `ends` holds the measurements at both ends of the step. Work is
    /// interpolated by the cubic Hermite polynomial of work and power.
    pub(crate) fn until(&self, later: &Self, ends: [&Measurements; 2], now: &Measurements) -> Self {
        let [from, to] = ends;
        let work = |of: fn(&Power) -> f64| {
            let row = |measurements: &Measurements, totals: &Self| Row {
                time: measurements.time,
                value: of(&totals.work),
                rate: of(&measurements.power),
            };
            hermite(&row(from, self), &row(to, later), now.time).value
        };
        let mut totals = Self {
            work: Power::by_part(work),
            max_lateral: self.max_lateral.max(now.com.y.abs()),
            path: self.path + (now.com - from.com).norm(),
            ..*self
        };
        let half_time = 0.5 * (now.time - from.time);
        totals.energy_time.add(&from.energy, half_time);
        totals.energy_time.add(&now.energy, half_time);
        totals.across_time.add(&from.across, half_time);
        totals.across_time.add(&now.across, half_time);
        totals.impulse.add(&from.resultants, half_time);
        totals.impulse.add(&now.resultants, half_time);
        // The rest of the impulse of the step is distributed evenly over it.
        let part = (now.time - from.time) / (to.time - from.time);
        let half_step = 0.5 * (to.time - from.time);
        for (impulse, factor) in
            [(&later.impulse, 1.0), (&self.impulse, -1.0), (&from.resultants, -half_step), (&to.resultants, -half_step)]
        {
            totals.impulse.add(impulse, part * factor);
        }
        totals
    }
}

/// Metrics of a run: its start, its running totals, and the current measurements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunMetrics {
    /// The current measurements.
    pub now: Measurements,
    /// The totals.
    pub totals: RunningTotals,
    /// Energy at the start, J.
    pub first_energy: f64,
    /// Momentum of rod and fluid at the start, N s.
    pub first_momentum: Vector2<f64>,
    /// Time (s) and centre of mass (m) at the start.
    pub first: (f64, Vector2<f64>),
    /// Positions at the start, m, two entries per node.
    pub first_positions: Vec<f64>,
}

impl RunMetrics {
    /// Metrics of a run that starts at `state`. `dynamics` must be at its time.
    ///
    /// # Errors
    /// Errors of [`Measurements::measure`].
    pub fn start(dynamics: &mut Dynamics, state: &State) -> Result<Self> {
        let mut now = Measurements::new(dynamics.nodes());
        now.measure(dynamics, state)?;
        Ok(Self {
            totals: RunningTotals {
                max_lateral: now.com.y.abs(),
                max_strain: now.strain,
                max_on_head: now.on_head(),
                max_energy: now.energy.total().abs(),
                max_couple: now.largest_couple(),
                max_power: now.power.of_drives(),
                hinge: HingeExtremes::of(&now.hinge),
                tendons: now.tendons.each_ref().map(TendonExtremes::of),
                ..RunningTotals::default()
            },
            first_energy: now.energy.total(),
            first_momentum: now.momentum.total(),
            first: (now.time, now.com),
            first_positions: state.q.clone(),
            now,
        })
    }

    /// Copies `other`, without allocating if capacities suffice.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self { now, totals, first_energy, first_momentum, first, first_positions } = other;
        self.now.copy_from(now);
        self.first_positions.clone_from(first_positions);
        (self.totals, self.first_energy) = (*totals, *first_energy);
        (self.first_momentum, self.first) = (*first_momentum, *first);
    }

    /// Adds the step to `next` to the totals, and swaps the previous measurements into `next`; `load` is the work (J) of the
    /// loads. If the time is the same, it adds the effect of a jump of inputs. `middle` holds the measurements at the midpoint of
    /// the step, if the model has dense output.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for non-finite work. On error nothing is counted.
    pub fn count_step(
        &mut self,
        next: &mut Measurements,
        middle: Option<&Measurements>,
        load: f64,
        head_mass: f64,
    ) -> Result<()> {
        let work = match middle {
            Some(middle) => next.smooth_work_since(&self.now, middle, load),
            None => next.work_since(&self.now, load, head_mass),
        };
        let total = self.totals.work;
        let mut sum = Power::by_part(|part| part(&total) + part(&work));
        if next.time == self.now.time {
            // The rod has not moved: only a change of flow or density changes the energy of the fluid.
            sum.flow += next.energy.fluid - self.now.energy.fluid;
        }
        if !sum.net().is_finite() {
            return Err(Error::NotFinite { time_s: next.time, node: 0, what: "work" });
        }
        let span = next.time - self.now.time;
        let half_time = 0.5 * span;
        let totals = &mut self.totals;
        match middle {
            Some(middle) => {
                for (resultants, part) in
                    [(&self.now.resultants, 1.0), (&middle.resultants, 4.0), (&next.resultants, 1.0)]
                {
                    totals.impulse.add(resultants, part * span / 6.0);
                }
            }
            None => {
                totals.impulse.add(&self.now.resultants, half_time);
                totals.impulse.add(&next.resultants, half_time);
                // The impulse that the inertia of a held node takes is known exactly, whatever its accelerations within the step.
                let [old, new] =
                    [&self.now, &*next].map(|end| (end.head[1] * head_mass, end.resultants.head - end.head_push));
                totals.impulse.head += (new.0 - old.0) - (new.1 + old.1) * half_time;
            }
        }
        if span == 0.0 {
            totals.impulse.flow += next.momentum.fluid - self.now.momentum.fluid;
        }
        totals.work = sum;
        totals.energy_time.add(&self.now.energy, half_time);
        totals.energy_time.add(&next.energy, half_time);
        totals.across_time.add(&self.now.across, half_time);
        totals.across_time.add(&next.across, half_time);
        totals.max_lateral = totals.max_lateral.max(next.com.y.abs());
        let middle = middle.map_or(next.com, |middle| middle.com);
        totals.max_lateral = totals.max_lateral.max(middle.y.abs());
        totals.path += (middle - self.now.com).norm() + (next.com - middle).norm();
        totals.max_strain = totals.max_strain.max(next.strain);
        totals.max_rotation = next.rotation_since(&self.now, totals.max_rotation);
        let [force, moment] = next.on_head();
        totals.max_on_head = [totals.max_on_head[0].max(force), totals.max_on_head[1].max(moment)];
        totals.max_energy = totals.max_energy.max(next.energy.total().abs()).max(totals.work.largest());
        totals.max_couple = totals.max_couple.max(next.largest_couple());
        let [actuation, head] = next.power.of_drives();
        totals.max_power = [totals.max_power[0].max(actuation), totals.max_power[1].max(head)];
        totals.hinge.widen(&next.hinge);
        totals.tendons.iter_mut().zip(&next.tendons).for_each(|(most, tendon)| most.widen(tendon));
        std::mem::swap(&mut self.now, next);
        Ok(())
    }

    /// Adds a jump of shape or motion, with the measurements `next` after it. The `source` supplies the gain of energy.
    pub fn count_jump(&mut self, next: &mut Measurements, source: WorkSource) {
        let work = &mut self.totals.work;
        let given = match source {
            WorkSource::Actuation => &mut work.actuation,
            WorkSource::Flow => &mut work.flow,
            WorkSource::Load => &mut work.load,
        };
        *given += next.energy.total() - self.now.energy.total();
        self.totals.max_energy = self.totals.max_energy.max(next.energy.total().abs()).max(self.totals.work.largest());
        // If a held rod changes its shape at once, the head supplies the impulse.
        let impulse = &mut self.totals.impulse;
        let given = match source {
            WorkSource::Actuation => &mut impulse.head,
            WorkSource::Flow => &mut impulse.flow,
            WorkSource::Load => &mut impulse.load,
        };
        *given += next.momentum.total() - self.now.momentum.total();
        self.totals.max_lateral = self.totals.max_lateral.max(next.com.y.abs());
        std::mem::swap(&mut self.now, next);
    }

    /// Time since the start, s.
    pub fn elapsed(&self) -> f64 {
        self.now.time - self.first.0
    }

    /// Root mean square of the cross-flow since the start, or `None` before the first step.
    pub fn across(&self) -> Option<TransverseMotion> {
        let CrossFlowSquares { speed, per_depth, along, body, density, viscosity } = self.totals.across_time;
        let elapsed = Some(self.elapsed()).filter(|elapsed| *elapsed > 0.0)?;
        let root = |sum: f64| (sum / elapsed).sqrt();
        let fluid = Fluid { density: density / elapsed, viscosity: viscosity / elapsed, ..Fluid::NONE };
        Some(TransverseMotion {
            speed: root(speed),
            per_depth: root(per_depth),
            along: root(along),
            body: root(body),
            fluid,
        })
    }

    /// Δx of the centre of mass since the start, m.
    pub fn net_displacement(&self) -> f64 {
        self.now.com.x - self.first.1.x
    }

    /// Error of the momentum balance, N s: the total impulse minus the change of momentum of rod and fluid.
    pub fn momentum_defect(&self) -> Vector2<f64> {
        self.totals.impulse.net() - (self.now.momentum.total() - self.first_momentum)
    }

    /// Error of the energy balance, J: the net work minus the change of energy.
    pub fn numerical_dissipation(&self) -> f64 {
        self.totals.work.net() - (self.now.energy.total() - self.first_energy)
    }
}
