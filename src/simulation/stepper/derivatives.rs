//! Derivatives of variables at the current time: with respect to time, and directional derivatives with respect to inputs.
//!
//! An input acts on the motion only through the steps that follow. Its derivatives are therefore those of the values that
//! [`get`](Stepper::get) returns right after [`set`](Stepper::set): positions and velocities stay; moments, energies, powers and
//! the reaction of a held head follow at once. They are exact: every measurement is differentiated by hand, with the same
//! derivatives of drag, bending and stretching as in the Newton matrix. The rate of a measurement follows the motion; only the
//! pose of the head, and effects of inputs that change at a rate, are differentiated by finite differences.

mod step_inputs;

use nalgebra::Vector2;
pub(crate) use step_inputs::InputDirection;

use super::Stepper;
use crate::error::{Error, Result};
use crate::fluid::force::{self, StateDerivatives};
use crate::fluid::medium::{Property, by_key};
use crate::fluid::{Fluid, Force, Kinematics, Layers, PowerKind};
use crate::head::MotorCommand;
use crate::linear::Direction;
use crate::metrics::{Energy, HingeReading, Measurements, Momentum, Power, Resultants, RunMetrics, RunningTotals};
use crate::model::{ActiveMoments, DeformedRod, Dynamics, Inputs, Mechanics};
use crate::newton::SolverWork;
use crate::rod::damping::KelvinVoigt;
use crate::rod::{DampedRate, add, bend, node};
use crate::system::{State, System};
use crate::tendons::MAX_TENDONS;
use crate::variable::{Variable, View};

/// The motion of a head is differenced over this fraction of an internal step to either side.
const TIME_DIFFERENCE: f64 = 1e-3;

/// The longest internal step (s) for that difference.
const MAX_DIFFERENCED_STEP: f64 = 0.1;

/// Relative step of the finite difference with respect to fluid properties (densities, speeds and thicknesses), for inputs with a
/// rate.
const FLUID_DIFFERENCE: f64 = 1e-4;

/// The kind of direction to differentiate along.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Along {
    /// Inputs that change at once, while positions and velocities stay.
    Inputs,
    /// The time, while the state moves on or stays.
    Time,
    /// The state at the end of a step, with the inputs given for it.
    Step,
}

/// The differential of a state and its measurements along a direction.
#[derive(Debug)]
pub(crate) struct StateTangent {
    state: State,
    metrics: RunMetrics,
    natural: Vec<f64>,
    natural_rate: Vec<f64>,
    /// Differential of the active moments.
    active: ActiveMoments,
    force: Vec<f64>,
    /// Differential of the tension of each tendon, N.
    tensions: [f64; MAX_TENDONS],
    /// Differential of the motor command of a hinge.
    command: MotorCommand,
    fluid: Fluid,
    layers: Option<Layers>,
    /// Differential of the force that opposes the motion.
    opposing: Vec<f64>,
    /// The same for all forces, minus the differential of the loads.
    applied: Vec<f64>,
    /// Differential of the head's angle and angular velocity.
    angle: [f64; 2],
    /// Differential of the inputs.
    inputs: Inputs,
}

impl StateTangent {
    fn new(dynamics: &Dynamics) -> Self {
        let nodes = dynamics.nodes();
        let zeros = || vec![0.0; 2 * nodes];
        Self {
            state: State::zeros(dynamics.model.unknowns()),
            metrics: RunMetrics {
                now: Measurements::new(nodes),
                totals: RunningTotals::default(),
                first_energy: 0.0,
                first_momentum: Vector2::zeros(),
                first: (0.0, Vector2::zeros()),
                first_positions: zeros(),
            },
            natural: vec![0.0; nodes],
            natural_rate: vec![0.0; nodes],
            active: ActiveMoments::zeros(nodes),
            force: zeros(),
            tensions: [0.0; MAX_TENDONS],
            command: MotorCommand::default(),
            fluid: Fluid::NONE,
            layers: None,
            opposing: zeros(),
            applied: zeros(),
            angle: [0.0; 2],
            inputs: Inputs::none(&dynamics.model),
        }
    }

    /// Sets the differential to zero.
    fn clear(&mut self) {
        self.state.t = 0.0;
        for values in [&mut self.state.q, &mut self.state.v, &mut self.state.a, &mut self.force] {
            values.fill(0.0);
        }
        self.natural.fill(0.0);
        self.natural_rate.fill(0.0);
        self.active.clear();
        (self.tensions, self.command) = ([0.0; MAX_TENDONS], MotorCommand::default());
        (self.fluid, self.layers, self.angle) = (Fluid::NONE, None, [0.0; 2]);
        self.inputs.clear();
    }

    /// Computes the changes of natural curvature, forces and fluid that `self.inputs` cause in `dynamics` at its current time.
    fn follow_inputs(&mut self, bent: &DeformedRod<'_>) {
        let DeformedRod { dynamics, state } = bent;
        let rod = &dynamics.model.rod;
        let natural = [&mut self.natural, &mut self.natural_rate].map(Vec::as_mut_slice);
        dynamics.natural_change(&self.inputs, state.t, natural, &mut self.active);
        (self.tensions, self.command) = (dynamics.tension_change(&self.inputs), self.inputs.hinge);
        if let Some(force) = &self.inputs.force {
            self.force.copy_from_slice(force);
        }
        (self.fluid, self.layers) = (self.inputs.fluid, self.inputs.layers);
        if dynamics.mechanics == Mechanics::Shape {
            // The shape follows with the next step; the strain that it has in addition to active moments changes at once.
            self.natural.fill(0.0);
            self.active.moment.fill(0.0);
            if !dynamics.model.active_moments {
                self.active.clear();
            }
        }
        // The work that a change of the natural curvature does at once; a change of active moments does none.
        let actuation = -rod.joints().map(|k| bent.elastic_moment(k) * self.active.natural[k]).sum::<f64>();
        self.metrics.totals.work = Power { actuation, ..Power::default() };
    }

    /// Computes the change of the `measurements` from the changes of all quantities that they depend on, along the inputs, the
    /// time or the state.
    fn read(&mut self, bent: &DeformedRod<'_>, measurements: &Measurements, kind: Along) {
        let DeformedRod { dynamics, state } = bent;
        let rod = &dynamics.model.rod;
        let (edges, kappa) = (bent.edges(), bent.kappa());
        let Self { state: d, metrics, natural, natural_rate, active, force, tensions, fluid, layers, .. } = self;
        let (opposing, applied, angle) = (&mut self.opposing, &mut self.applied, &self.angle);
        // In the shape model, moments follow from balance, see below.
        let shape = dynamics.mechanics == Mechanics::Shape;
        for (applied, force) in applied.iter_mut().zip(&*force) {
            *applied = -force;
        }
        let now = &mut metrics.now;
        (now.energy, now.power) = (Energy::default(), Power::default());
        (now.resultants, now.momentum) = (Resultants::default(), Momentum::default());
        let inertia = dynamics.mechanics != Mechanics::Overdamped;
        let mass = |k: usize| if inertia { rod.mass[k] } else { 0.0 };
        now.momentum.rod = (0..rod.nodes).map(|k| node(&d.v, k) * mass(k)).sum();
        now.resultants.load = (0..rod.nodes).map(|k| node(force, k)).sum();
        let (energy, power) = (&mut now.energy, &mut now.power);
        now.com = rod.mean(&d.q);
        // Changes of an edge's length and direction.
        let change = |e: usize| {
            let vector = node(&d.q, e + 1) - node(&d.q, e);
            [edges[e].t.dot(&vector), edges[e].n().dot(&vector) * edges[e].per_length]
        };
        // Changes of the rates of strain: of an edge's length and angular velocity, and of the turning angle at its first node.
        let [angle, angular_velocity] = *angle;
        let rate_change = |e: usize| {
            let rate = bent.edge_rate(e);
            let ends = |values: &[f64]| node(values, e + 1) - node(values, e);
            let changes = [(Direction::POSITIONS, ends(&d.q)), (Direction::VELOCITIES, ends(&d.v))];
            changes.iter().fold([0.0; 2], |[longer, spin], (direction, change)| {
                let edge = &edges[e];
                let stretching = rate.stretching_slope(edge, *direction).dot(change);
                [longer + stretching, spin + rate.spin_slope(edge, *direction).dot(change)]
            })
        };
        let activated = dynamics.active.is_some() || self.inputs.moment.is_some();
        let drives_all = dynamics.damped().is_none_or(|damped| damped.damping.rate == DampedRate::Elastic);
        let spinning = |e: usize| rate_change(e)[1] - if e == 0 { angular_velocity } else { rate_change(e - 1)[1] };
        // The change of the moment that resists the rate of the joint at node `e`, if its curvature changes by `kappa_change`.
        let resisting = |e: usize, kappa_change: f64| {
            let Some(KelvinVoigt { damping, .. }) = dynamics.damped() else { return 0.0 };
            let rate =
                0.5 * kappa[e] * bent.spin(e) * kappa_change + bend::curvature_per_turning(kappa[e]) * spinning(e);
            damping.moment(rod, e, rate - damping.given(natural_rate[e]))
        };
        now.tendons = Default::default();
        for (i, tendon) in dynamics.model.tendons.iter().enumerate() {
            let reading = &mut now.tendons[i];
            for e in tendon.edges.clone() {
                reading.length += change(e)[0];
                reading.length_rate += rate_change(e)[0];
            }
            for k in tendon.joints.clone() {
                let s = bend::curvature_per_turning(kappa[k]);
                let turned = s * (change(k)[1] - if k == 0 { angle } else { change(k - 1)[1] });
                reading.length -= tendon.offset * turned;
                reading.length_rate -= tendon.offset * (0.5 * kappa[k] * bent.spin(k) * turned + s * spinning(k));
            }
            // The tension of a winch follows the length of its cable.
            let followed = dynamics.tension_slope(i) * reading.length;
            tensions[i] += followed;
            reading.tension = tensions[i];
            if followed != 0.0 {
                for k in tendon.joints.clone() {
                    active.moment[k] += followed * tendon.offset;
                    natural[k] += followed * tendon.offset / rod.joint[k];
                }
            }
        }
        let mut before = angle;
        for (e, edge) in edges.iter().enumerate() {
            let [longer, turned] = change(e);
            energy.stretching += rod.cells[e].tension(edge) * longer;
            if let Some(damped) = dynamics.damped() {
                let stretching = rate_change(e)[0];
                power.material += 2.0 * damped.tension_of_rate(rod, e) * stretching;
            }
            if rod.joints().contains(&e) {
                let turning = turned - before;
                now.kappa[e] = bend::curvature_per_turning(kappa[e]) * turning;
                let resisting = resisting(e, now.kappa[e]);
                if let Some(KelvinVoigt { rates, .. }) = dynamics.damped() {
                    power.material += 2.0 * resisting * rates.joints[e];
                }
                if shape {
                    if dynamics.model.active_moments {
                        let change = now.kappa[e] - active.natural[e];
                        energy.bending += bent.elastic_moment(e) * change;
                        let strained = bent.elastic_moment(e) / rod.joint[e];
                        power.actuation += change * bent.active_moment(e)[1] + strained * active.rate[e];
                    }
                    before = turned;
                    continue;
                }
                let moment = rod.joint[e] * (kappa[e] - dynamics.natural[e]);
                let elastic = rod.joint[e] * (now.kappa[e] - natural[e]);
                now.moment[e] = elastic + resisting;
                let driven = if drives_all { now.moment[e] } else { elastic };
                if !activated {
                    energy.bending += moment * (now.kappa[e] - natural[e]);
                    power.actuation -= driven * dynamics.natural_rate[e] + bent.driven_moment(e) * natural_rate[e];
                    before = turned;
                    continue;
                }
                // The elastic moment m + M, with the natural curvature alone.
                let ([own, _], given) = (bent.active_moment(e), bent.given_rate(e));
                let change = now.kappa[e] - active.natural[e];
                energy.bending += (moment + own) * change;
                power.actuation -= rod.joint[e] * change * given + (moment + own) * active.natural_rate[e];
                let s = bend::curvature_per_turning(kappa[e]);
                let quicker = 0.5 * kappa[e] * bent.spin(e) * now.kappa[e] + s * spinning(e);
                power.actuation += active.moment[e] * s * bent.spin(e) + own * quicker;
            }
            before = turned;
        }
        for k in 0..rod.nodes {
            let (v, dv) = (node(&state.v, k), node(&d.v, k));
            energy.kinetic += mass(k) * v.dot(&dv);
            power.load += node(force, k).dot(&v) + dynamics.load(k).dot(&dv);
        }
        if let (Some(hinge), Some([_, _, pitch])) = (&dynamics.model.hinge, &dynamics.held) {
            let [_, given] = hinge.torque(dynamics.command, pitch.value);
            let asked = self.command.torque + hinge.stiffness * (self.command.angle - angle);
            now.hinge = HingeReading { torque: given * asked, spin: angular_velocity, ..HingeReading::default() };
            energy.kinetic += hinge.inertia * pitch.rate * angular_velocity;
            power.material += 2.0 * hinge.damping * pitch.rate * angular_velocity;
        }
        let mut on_head = [Vector2::zeros(); 2];
        let moving = bent.kinematics();
        for own in dynamics.model.forces.iter() {
            opposing.fill(0.0);
            let stored = opposing_change(
                own,
                &moving,
                Some([&d.q, &d.v, &d.a]),
                (fluid, layers.as_ref(), &tensions[..]),
                opposing,
            );
            // The flow at a node changes in time, and as the node moves through it.
            let drift = |k: usize| match (own.is_of_fluid(), moving.layers) {
                (false, _) => Vector2::zeros(),
                (true, None) => fluid.flow,
                (true, Some(_)) => {
                    let by = |(key, change)| {
                        let by = Property::of(key).map(|property| moving.by_property(property, k).fluid.flow);
                        by.unwrap_or_default() * change
                    };
                    let by_place = moving.here(k).slope.flow * moving.normal().dot(&node(&d.q, k));
                    fluid.flow + by_place + by_key(fluid, layers.as_ref()).map(by).sum::<Vector2<f64>>()
                }
            };
            let flow = |k: usize| if own.is_of_fluid() { moving.flow(k) } else { Vector2::zeros() };
            let mut taken = 0.0;
            force::visit_alone(own, &moving, |k, now| {
                taken += now.dot(&(node(&d.v, k) - drift(k)));
                power.flow -= now.dot(&drift(k));
                if k == 0 {
                    on_head[0] += now;
                }
            });
            for k in 0..rod.nodes {
                let change = node(opposing, k);
                taken += change.dot(&(node(&state.v, k) - flow(k)));
                power.flow -= change.dot(&flow(k));
            }
            on_head[1] += node(opposing, 0);
            applied.iter_mut().zip(&*opposing).for_each(|(sum, own)| *sum += own);
            *now.resultants.from(own.power_kind()) -= (0..rod.nodes).map(|k| node(opposing, k)).sum::<Vector2<f64>>();
            match own.power_kind() {
                Some(PowerKind::Drag) => power.viscous += taken,
                Some(PowerKind::Wake) => power.wake += taken,
                Some(PowerKind::Flow) => power.flow -= taken,
                Some(PowerKind::Spray) => power.spray += taken,
                Some(PowerKind::Load) => power.load -= taken,
                Some(PowerKind::Drive) => power.actuation -= taken,
                Some(PowerKind::Other) => power.other -= taken,
                None => {
                    // The energy depends on velocities relative to the flow.
                    let mut by = [vec![0.0; d.q.len()], vec![0.0; d.q.len()], vec![0.0; d.q.len()]];
                    let [q, v, a] = &mut by;
                    own.energy(&moving, 1.0, Some(StateDerivatives { q, v, a }));
                    let along = |by: &[f64], d: &[f64]| by.iter().zip(d).map(|(x, y)| x * y).sum::<f64>();
                    energy.fluid += along(q, &d.q) + along(v, &d.v) + along(a, &d.a) + stored[0];
                    energy.fluid -= (0..rod.nodes).map(|k| node(v, k).dot(&drift(k))).sum::<f64>();
                    for (axis, change) in [Vector2::x(), Vector2::y()].into_iter().zip(now.momentum.fluid.iter_mut()) {
                        let mut by = [vec![0.0; d.q.len()], vec![0.0; d.q.len()], vec![0.0; d.q.len()]];
                        let [q, v, a] = &mut by;
                        own.momentum(&moving, axis, 1.0, Some(StateDerivatives { q, v, a }));
                        *change += along(q, &d.q) + along(v, &d.v);
                        *change -= (0..rod.nodes).map(|k| node(v, k).dot(&drift(k))).sum::<f64>();
                        for (key, by) in by_key(fluid, layers.as_ref()).filter(|(_, by)| *by != 0.0) {
                            *change += own.momentum_by_parameter(key, &moving, axis) * by;
                        }
                    }
                    if kind == Along::Time {
                        energy.fluid += own.energy_by_time(&moving, 0.0, None);
                    }
                    by.iter_mut().for_each(|by| by.fill(0.0));
                    let [q, v, a] = &mut by;
                    own.energy_by_time(&moving, 1.0, Some(StateDerivatives { q, v, a }));
                    power.other += along(q, &d.q) + along(v, &d.v) + along(a, &d.a) + stored[1];
                }
            }
        }
        // Buoyancy follows the density.
        if let Some(buoyancy) = &dynamics.model.buoyancy {
            now.resultants.load += (0..rod.nodes).map(|k| node(buoyancy, k)).sum::<Vector2<f64>>() * fluid.density;
            power.load +=
                (0..rod.nodes).map(|k| node(buoyancy, k).dot(&node(&state.v, k))).sum::<f64>() * fluid.density;
            on_head[1] -= node(buoyancy, 0) * fluid.density;
            applied.iter_mut().zip(buoyancy).for_each(|(sum, own)| *sum -= own * fluid.density);
        }
        if shape {
            // The change of Dynamics::balance: m_k dκ_k/dθ_k = −Σ (x_j − x_k) × (M a_j − F_j).
            dynamics.write_applied(&moving, opposing);
            let (mut held, mut held_change, mut turning) = (Vector2::zeros(), Vector2::zeros(), 0.0);
            for k in (0..rod.nodes).rev() {
                if k + 1 < rod.nodes {
                    let ahead = |values: &[f64]| node(values, k + 1) - node(values, k);
                    turning += ahead(&state.q).perp(&held_change) + ahead(&d.q).perp(&held);
                }
                if rod.joints().contains(&k) {
                    let more = measurements.moment[k] * 0.5 * kappa[k] * now.kappa[k];
                    now.moment[k] = -(turning + more) / bend::curvature_per_turning(kappa[k]);
                    // Of the moments by balance, the part that resists the rate of the total curvature is not applied by the
                    // drive.
                    let apart =
                        if drives_all { [0.0; 2] } else { [resisting(k, now.kappa[k]), bent.damping_moment(k)] };
                    power.actuation -= (now.moment[k] - apart[0]) * dynamics.natural_rate[k]
                        + (measurements.moment[k] - apart[1]) * natural_rate[k];
                }
                held += node(&state.a, k) * rod.mass[k] + node(opposing, k);
                held_change += node(&d.a, k) * rod.mass[k] + node(applied, k);
            }
            if let Some([x, y, pitch]) = &dynamics.held {
                let s = bend::curvature_per_turning(kappa[0]);
                now.head_force = -held_change;
                now.resultants.head = held_change;
                now.head_moment = now.moment[0] * s + measurements.moment[0] * 0.5 * kappa[0] * now.kappa[0];
                power.head = held_change.dot(&Vector2::new(x.rate, y.rate))
                    - measurements.head_force.dot(&node(&d.v, 0))
                    - now.head_moment * pitch.rate
                    - measurements.moment[0] * s * angular_velocity;
            }
            return;
        }
        if let Some([x, y, pitch]) = &dynamics.held {
            let couple = |k: usize, kappa_change: f64| {
                let (joint, s) = (bent.joint(k), bend::curvature_per_turning(kappa[k]));
                let change = joint.stiffness * kappa_change / s - rod.joint[k] * s * natural[k];
                match dynamics.damped().filter(|_| rod.joints().contains(&k)) {
                    None => change,
                    Some(KelvinVoigt { rates, .. }) => {
                        change + rates.viscosity[k] * spinning(k) - bent.resisted_natural_rate(k) * s * natural_rate[k]
                    }
                }
            };
            let (edge, [longer, turned]) = (&edges[0], change(0));
            let (tension, t, n) = (bent.tension(0), edge.t, edge.n());
            let mut tension_change = rod.cells[0].axial * longer;
            if let Some(KelvinVoigt { damping, .. }) = dynamics.damped() {
                tension_change += damping.tension(rod, 0, rate_change(0)[0]);
            }
            let shear = (bent.joint(0).couple - bent.joint(1).couple) * edge.per_length;
            let couples = [couple(0, now.kappa[0]), couple(1, now.kappa[1])];
            let mut after = Vector2::zeros();
            // In the chain form the force of an edge is an unknown, which an input changes only with the next step.
            if state.links.is_empty() || kind != Along::Inputs {
                after += t * tension_change + n * (tension * turned);
                after += n * ((couples[0] - couples[1] - shear * longer) * edge.per_length) - t * (shear * turned);
            }
            let held = node(&state.a, 0) * mass(0) - bent.first_edge_force() - dynamics.load(0) + on_head[0];
            let held_change = node(&d.a, 0) * mass(0) - after - node(force, 0) + on_head[1];
            let s = bend::curvature_per_turning(kappa[0]);
            let moment = rod.joint[0] * (kappa[0] - dynamics.natural[0]) + bent.damping_moment(0);
            now.head_force = -held_change;
            now.resultants.head = held_change;
            now.head_moment = now.moment[0] * s + moment * 0.5 * kappa[0] * now.kappa[0];
            let [couple, couple_change] = match &dynamics.model.hinge {
                None => [moment * s, now.head_moment],
                Some(_) => [-measurements.hinge.torque, -now.hinge.torque],
            };
            power.head = held_change.dot(&Vector2::new(x.rate, y.rate)) + held.dot(&node(&d.v, 0))
                - couple_change * pitch.rate
                - couple * angular_velocity;
        }
    }
}

/// Adds the change of the force `own` to `opposing`; the force opposes the motion `moving` of the rod. The state changes by
/// `motion`, and fluid, layers and the tensions of tendons change too. Returns the changes of the force's energy, and of the rate
/// of that energy due to the fluid alone.
fn opposing_change(
    own: &dyn Force,
    moving: &Kinematics<'_>,
    motion: Option<[&[f64]; 3]>,
    (fluid, layers, tensions): (&Fluid, Option<&Layers>, &[f64]),
    opposing: &mut [f64],
) -> [f64; 2] {
    if let Some(motion) = motion {
        force::add_change(own, moving, motion, fluid.flow, opposing);
    } else if fluid.flow != Vector2::zeros() {
        let still = vec![0.0; opposing.len()];
        force::add_change(own, moving, [&still; 3], fluid.flow, opposing);
    }
    if own.power_kind() == Some(PowerKind::Drive) {
        // Linear in the tensions.
        let pulled = Kinematics { tensions, ..*moving };
        force::visit_alone(own, &pulled, |k, change| add(opposing, k, change));
    }
    let mut stored = [0.0; 2];
    for (key, change) in by_key(fluid, layers) {
        if change != 0.0 {
            let mut by = vec![0.0; opposing.len()];
            let of_energy = own.add_by_parameter(key, moving, &mut by);
            (0..2).for_each(|i| stored[i] += of_energy[i] * change);
            opposing.iter_mut().zip(by).for_each(|(sum, by)| *sum += change * by);
        }
    }
    stored
}

/// The derivatives of all variables along a direction.
#[derive(Debug, Clone, Copy)]
pub struct VariableDerivatives<'a> {
    now: View<'a>,
    change: View<'a>,
}

impl VariableDerivatives<'_> {
    /// The derivative of `variable` at node `k`, or `None` if that is not one of its [`entries`](Variable::entries).
    pub fn of(&self, variable: &Variable, k: usize) -> Option<f64> {
        let there = variable.entries(&self.now.dynamics.model).contains(&k);
        there.then(|| variable.change(&self.now, &self.change, k))
    }
}

impl Stepper {
    /// The total time derivatives d/dt of all variables.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`].
    pub fn rates(&mut self) -> Result<VariableDerivatives<'_>> {
        self.rates_of(true)
    }

    /// The partial time derivatives ∂/∂t of all variables at the current state.
    ///
    /// # Errors
    /// Errors of [`Dynamics::shape`].
    pub fn explicit_rates(&mut self) -> Result<VariableDerivatives<'_>> {
        self.rates_of(false)
    }

    fn rates_of(&mut self, moving: bool) -> Result<VariableDerivatives<'_>> {
        let (t, mut tangent) = (self.now.state.t, self.take_tangent());
        let d = &mut tangent.state;
        d.t = 1.0;
        if moving {
            d.q.copy_from_slice(&self.now.state.v);
            d.v.copy_from_slice(&self.now.state.a);
        }
        // The quantities that depend on time alone: κ̄' and its rate, and the head's third derivative.
        let longest = self.dynamics.longest_step(t, self.now.time_step);
        let half = TIME_DIFFERENCE * self.now.time_step.min(longest).min(MAX_DIFFERENCED_STEP);
        let accelerations = |dynamics: &Dynamics| dynamics.held.map(|pose| pose.map(|sample| sample.acceleration));
        let [later, sooner] = [t + half, t - half].map(|t| {
            self.dynamics.evaluate_at(t);
            accelerations(&self.dynamics)
        });
        self.move_to_now()?;
        let mut rate = Vec::new();
        self.dynamics.natural_acceleration(t, &mut tangent.natural_rate, &mut rate);
        tangent.natural.copy_from_slice(&self.dynamics.natural_rate);
        tangent.tensions = self.dynamics.tensions[1];
        tangent.command = self.dynamics.command_rate(t);
        if let Some(active) = &self.dynamics.active {
            let natural_rate = tangent.natural_rate.iter().zip(&rate).enumerate();
            let joint = &self.dynamics.model.rod.joint;
            tangent.active = ActiveMoments {
                moment: active.rate.clone(),
                natural: active.natural_rate.clone(),
                natural_rate: natural_rate
                    .map(|(k, (all, moment))| if *moment == 0.0 { *all } else { all - moment / joint[k] })
                    .collect(),
                rate,
            };
        }
        if let (Some(later), Some(sooner), Some([.., angle])) = (later, sooner, self.dynamics.held) {
            let shape = moving && self.dynamics.mechanics == Mechanics::Shape;
            for i in 0..if shape { 0 } else { 2 } {
                d.a[i] = (later[i] - sooner[i]) / (2.0 * half);
            }
            // The angle of a hinge is part of the state.
            let turns = moving || self.dynamics.model.hinge.is_none();
            tangent.angle = if turns { [angle.rate, angle.acceleration] } else { [0.0; 2] };
        }
        // In a prescribed shape, moments follow from accelerations, and these from the shape; without inertia, velocities follow
        // from positions. Forces with the inertia of the water follow from accelerations, and these from the equation of motion.
        let follows: Option<fn(&mut State) -> &mut Vec<f64>> = match self.dynamics.mechanics {
            _ if !moving => None,
            Mechanics::Overdamped => Some(|state| &mut state.v),
            Mechanics::Shape => Some(|state| &mut state.a),
            Mechanics::Full => self.dynamics.model.forces.are_inertial().then_some(|state| &mut state.a),
        };
        if let Some(follows) = follows {
            follows(&mut tangent.state).fill(0.0);
            let work = self.newton.work;
            for sign in [1.0, -1.0] {
                let (mut there, tau) = (self.now.state.clone(), sign * half);
                for (q, (v, a)) in there.q.iter_mut().zip(self.now.state.v.iter().zip(&self.now.state.a)) {
                    *q += tau * (v + 0.5 * tau * a);
                }
                there.v.iter_mut().zip(&self.now.state.a).for_each(|(v, a)| *v += tau * a);
                self.dynamics.move_to(t + tau, &mut there);
                self.dynamics.carry_links(&self.now.state, &mut there);
                self.model_stepper.reinitialise(&mut self.dynamics, &mut self.newton, &mut there)?;
                let rates = follows(&mut tangent.state).iter_mut();
                rates.zip(follows(&mut there)).for_each(|(rate, value)| *rate += *value / (2.0 * tau));
            }
            self.newton.work = work;
            self.move_to_now()?;
        }
        if let Some(extrapolation) = &self.dynamics.extrapolation {
            let rate = extrapolation.rate();
            if let Some(force) = &rate.force {
                tangent.force.copy_from_slice(force);
            }
            (tangent.fluid, tangent.layers) = (rate.fluid, rate.layers);
            tangent.inputs.clone_from(rate);
        }
        tangent.fluid.flow = self.dynamics.inputs.fluid.acceleration;
        tangent.inputs.fluid.flow = tangent.fluid.flow;
        tangent.read(&self.dynamics.shape(&self.now.state)?, &self.now.metrics.now, Along::Time);
        if self.dynamics.extrapolation.is_some() && self.dynamics.model.forces.are_inertial() {
            let [later, sooner] = [self.medium_change_rates_after(half)?, self.medium_change_rates_after(-half)?];
            tangent.metrics.now.power.flow += (later.0 - sooner.0) / (2.0 * half);
            tangent.metrics.now.resultants.flow += (later.1 - sooner.1) / (2.0 * half);
            self.dynamics.move_to(t, &mut self.now.state);
        }
        let now = &self.now.metrics.now;
        if moving {
            tangent.metrics.totals.work = now.power;
            tangent.metrics.totals.impulse = now.resultants;
        }
        let aside = now.com.y * tangent.metrics.now.com.y;
        let at_most = now.com.y.abs() >= self.now.metrics.totals.max_lateral;
        tangent.metrics.totals.max_lateral = if at_most && aside > 0.0 { tangent.metrics.now.com.y.abs() } else { 0.0 };
        Ok(self.put_tangent(tangent))
    }

    /// Moves the dynamics to the current time, with the tensions of winches for the current shape of the rod.
    pub(super) fn move_to_now(&mut self) -> Result<()> {
        self.dynamics.move_to(self.now.state.t, &mut self.now.state);
        if self.dynamics.has_winches() {
            self.dynamics.shape(&self.now.state)?;
        }
        Ok(())
    }

    /// The power and force of inputs that change at a rate, see `Dynamics::medium_change_rates`, at `h` (s) from now.
    fn medium_change_rates_after(&mut self, h: f64) -> Result<(f64, Vector2<f64>)> {
        let mut state = self.now.state.clone();
        for i in 0..state.q.len() {
            state.q[i] += h * (state.v[i] + 0.5 * h * state.a[i]);
            state.v[i] += h * state.a[i];
        }
        state.links.clear();
        self.dynamics.move_to(self.now.state.t + h, &mut state);
        let mut workspace = vec![0.0; state.q.len()];
        let bent = self.dynamics.shape(&state)?;
        Ok(bent.dynamics.medium_change_rates(&bent.kinematics(), &mut workspace))
    }

    /// The directional derivatives of all variables with respect to inputs. `seed` sets the direction by [`Seed::set`]. Targets of
    /// the head have no effect before the next step.
    ///
    /// # Errors
    /// Errors of `seed` and of [`Dynamics::shape`].
    pub fn directional(&mut self, seed: impl FnOnce(&mut Seed<'_>) -> Result<()>) -> Result<VariableDerivatives<'_>> {
        let mut tangent = self.take_tangent();
        seed(&mut Seed { dynamics: &mut self.dynamics, change: &mut tangent.inputs })?;
        let bent = self.dynamics.shape(&self.now.state)?;
        tangent.follow_inputs(&bent);
        tangent.metrics.totals.max_lateral = 0.0;
        tangent.read(&bent, &self.now.metrics.now, Along::Inputs);
        let (power, force) = self.medium_change_rates_derivative(&tangent.inputs)?;
        tangent.metrics.now.power.flow += power;
        tangent.metrics.now.resultants.flow += force;
        tangent.metrics.totals.work.flow = tangent.metrics.now.energy.fluid;
        tangent.metrics.totals.impulse =
            Resultants { flow: tangent.metrics.now.momentum.fluid, ..Resultants::default() };
        Ok(self.put_tangent(tangent))
    }

    /// The change of the power and force of inputs that change at a rate, see `Dynamics::medium_change_rates`, when the inputs
    /// change by `change` at constant rates. It is linear in densities and quadratic in the flow, so central differences are
    /// exact.
    fn medium_change_rates_derivative(&mut self, change: &Inputs) -> Result<(f64, Vector2<f64>)> {
        let nothing = (0.0, Vector2::zeros());
        let Inputs { fluid, layers, .. } = &self.dynamics.inputs;
        if self.dynamics.extrapolation.is_none() || !self.dynamics.model.forces.are_inertial() {
            return Ok(nothing);
        }
        let length = self.dynamics.length();
        let of_fluid = |now: &Fluid, by: &Fluid| {
            (by.density / now.density.max(1.0)).abs().max(by.flow.amax() / now.flow.amax().max(length))
        };
        let mut size = of_fluid(fluid, &change.fluid);
        for (now, by) in layers.iter().flat_map(Layers::iter).zip(change.layers.iter().flat_map(Layers::iter)) {
            let reach = if now.thickness > 0.0 { now.thickness } else { length };
            size = size.max(of_fluid(&now.fluid, &by.fluid)).max((by.offset / reach).abs());
        }
        if size == 0.0 {
            return Ok(nothing);
        }
        let step = FLUID_DIFFERENCE / size;
        let kept = (*fluid, *layers);
        let mut at = |step: f64| {
            let Inputs { fluid, layers, .. } = &mut self.dynamics.inputs;
            fluid.add(&change.fluid, step);
            if let (Some(to), Some(by)) = (layers, &change.layers) {
                to.add(by, step);
            }
            let rates = self.dynamics.shape(&self.now.state).map(|bent| {
                let mut workspace = vec![0.0; bent.state.q.len()];
                bent.dynamics.medium_change_rates(&bent.kinematics(), &mut workspace)
            });
            (self.dynamics.inputs.fluid, self.dynamics.inputs.layers) = kept;
            rates
        };
        let [more, less] = [at(step)?, at(-step)?];
        self.dynamics.shape(&self.now.state)?;
        Ok(((more.0 - less.0) / (2.0 * step), (more.1 - less.1) / (2.0 * step)))
    }

    /// A zero differential of the state and of all inputs, to be [put back](Self::put_tangent) for the next one who needs it.
    pub(crate) fn take_tangent(&mut self) -> Box<StateTangent> {
        let mut tangent = self.tangent.take().unwrap_or_else(|| Box::new(StateTangent::new(&self.dynamics)));
        tangent.clear();
        tangent
    }

    /// The derivatives of all variables along `tangent`, which is kept for the next one who [takes](Self::take_tangent) it.
    pub(crate) fn put_tangent(&mut self, tangent: Box<StateTangent>) -> VariableDerivatives<'_> {
        let time = self.time();
        let tangent = &**self.tangent.insert(tangent);
        let now = View {
            time,
            dynamics: &self.dynamics,
            inputs: &self.dynamics.inputs,
            state: &self.now.state,
            metrics: &self.now.metrics,
            cycles: &self.now.cycles,
            work: self.newton.work,
            time_step: self.now.time_step,
            head_turn: [0.0; 2],
        };
        let change = View {
            time: tangent.state.t,
            inputs: &tangent.inputs,
            state: &tangent.state,
            metrics: &tangent.metrics,
            work: SolverWork::default(),
            head_turn: tangent.angle,
            ..now
        };
        VariableDerivatives { now, change }
    }
}

/// The direction in the space of inputs for a directional derivative.
#[derive(Debug)]
pub struct Seed<'a> {
    dynamics: &'a mut Dynamics,
    change: &'a mut Inputs,
}

impl Seed<'_> {
    /// Sets the direction of a whole input.
    ///
    /// # Errors
    /// [`Error::NotAnInput`], [`Error::WrongLength`].
    pub fn set(&mut self, variable: &Variable, values: &[f64]) -> Result<()> {
        let expected = variable.len(&self.dynamics.model);
        if !variable.is_input() {
            return Err(Error::NotAnInput(variable.name));
        }
        if values.len() != expected {
            return Err(Error::WrongLength { name: variable.name, expected, found: values.len() });
        }
        if variable.of_head().is_some() {
            return Ok(()); // the motion of the head does not change before the next step
        }
        std::mem::swap(&mut self.dynamics.inputs, self.change);
        variable.write(self.dynamics, 0.0, 0, values);
        std::mem::swap(&mut self.dynamics.inputs, self.change);
        Ok(())
    }
}
