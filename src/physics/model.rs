//! The model: rod, actuation, forces, loads and head as one [`System`].
//!
//! A [`Model`] is constant and shared. [`Dynamics`] is one run of it: the inputs of a host, and the quantities that
//! depend on time.

pub mod chain;
pub mod deformed_rod;
pub mod input_extrapolation;
mod lagging;
mod winches;

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

pub use deformed_rod::DeformedRod;
use input_extrapolation::HIGHEST_ORDER;
pub use input_extrapolation::InputExtrapolation;
use winches::Winches;

use crate::actuation::lag::{self, LagState};
use crate::actuation::saturation::limited;
use crate::actuation::{Actuation, Saturation, Wave};
use crate::error::{Error, Result};
use crate::fluid::force::visit_alone;
use crate::fluid::medium::by_key;
use crate::fluid::{Fluid, FluidAlong, FluidRuns, Force, Forces, Kinematics, Layers, PowerKind};
use crate::head::hinge::{HingeEquation, HingeResidual};
use crate::head::{
    HeadInput, HeadMotion, Hinge, HostHead, MotorCommand, Pose, RESOLVING_STEPS_PER_PERIOD, RedundantHeadInputs,
    Sample, Signal, pose, pose_before,
};
use crate::linear::{ChainMatrix, Coupling, Direction};
use crate::rod::bend::{self, Joint};
use crate::rod::damping::{Damping, KelvinVoigt, StrainRates};
use crate::rod::edge_force::{EDGES_PER_BLOCK, EdgeForce};
use crate::rod::elastic::Deformed;
use crate::rod::{Edge, Rod, add, lengths, node};
use crate::start::{Start, add_spin};
use crate::system::{Form, Linearisation, Link, RankOne, State, System};
use crate::tendons::{MAX_TENDONS, Pull, Tendon, Tendons, slack_below_zero};

/// An edge shorter than this fraction of its rest length counts as collapsed.
const COLLAPSED: f64 = 1e-3;

/// An edge whose direction turns by more than the angle of this cosine, 150°, in one step went through zero length.
const REVERSED: f64 = -0.87;

/// The minimum length of an edge of `rod`, m, and the exclusive upper bound.
pub(crate) fn lengths_allowed(rod: &Rod) -> [f64; 2] {
    [COLLAPSED * rod.shortest(), f64::INFINITY]
}

/// A periodic drive of the actuation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Drive {
    /// Amplitude κ_amp, or that of the moment, N m.
    pub amplitude: f64,
    /// Frequency f, Hz.
    pub frequency: f64,
}

/// The mechanics that a model includes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mechanics {
    /// Inertia and elasticity.
    #[default]
    Full,
    /// Elasticity without inertia: the motion has no memory of its velocities, and no kinetic energy.
    Overdamped,
    /// Inertia of an inextensible rod that takes its natural curvature: joint moments follow from balance, and there is
    /// no elastic energy.
    Shape,
}

/// Everything that is constant during a run. A part that the scene does not have is `None` and costs nothing.
#[derive(Debug)]
pub struct Model {
    /// The rod.
    pub rod: Rod,
    /// Actuation and its drive, as in the scene.
    pub actuation: Option<(Box<dyn Actuation>, Drive)>,
    /// True if the actuation gives active moments (N m) instead of natural curvatures.
    pub active_moments: bool,
    /// Limit of the drive at a joint, including a host's contribution, if there is a limit: a dimensionless curvature,
    /// or N m of active moments.
    pub largest_drive: Option<f64>,
    /// Time constant (s) of the first-order lag between the demand, including a host's, and the output of the drive,
    /// before that limit.
    pub lag: Option<f64>,
    /// The tendons; their pull on the edges is one of the forces.
    pub tendons: Tendons,
    /// How the run starts.
    pub start: Start,
    /// External forces on the rod, apart from constant loads.
    pub forces: Forces,
    /// The fluid as in the scene, at time zero if its flow depends on time.
    pub fluid: Fluid,
    /// Velocity of a flow that depends on time, m/s.
    pub flow: Option<[Signal; 2]>,
    /// Interfaces and the fluids beyond them; `None` in a uniform medium.
    pub layers: Option<Layers>,
    /// Constant force of gravity and point loads (N), two entries per node.
    pub load: Option<Vec<f64>>,
    /// Buoyancy in a fluid of density 1 kg/m³ (N), two entries per node; `None` without buoyancy.
    pub buoyancy: Option<Vec<f64>>,
    /// Motion of a held head; `None` for a free head. With a hinge, the angle is the commanded one.
    pub head: Option<HeadMotion>,
    /// The hinge of a held head whose angle is free.
    pub hinge: Option<Hinge>,
    /// The time to which a pose of the head set by a host refers.
    pub head_input: HeadInput,
    /// Initial spin of a free rod about its centre of mass, in addition to that of the start, rad/s.
    pub spin: f64,
    /// Initial curvature κ_k in addition to that of the start, one entry per node; `None` if there is none.
    pub initial_curvature: Option<Vec<f64>>,
}

/// The wave of natural curvatures to which the moments of `actuation` bend an unloaded `rod`.
pub(crate) fn bending(actuation: &dyn Actuation, rod: &Rod) -> Box<dyn Actuation> {
    // Values of full joints; those of a half-cell joint are halved later.
    let flexible = |k: usize| if rod.joints().contains(&k) { 1.0 / (rod.joint[k] * rod.joint_part(k)) } else { 0.0 };
    actuation.profiled(&(0..rod.nodes).map(flexible).collect::<Vec<_>>(), &vec![0.0; rod.nodes])
}

impl Model {
    /// A hash of the model, including every bit of every number, and of the solver settings `solved`. Custom forces and
    /// actuations are included by their `Debug` output.
    pub fn fingerprint(&self, solved: &impl std::fmt::Debug) -> u128 {
        XxHash3_128::oneshot(format!("{} {solved:?} {self:?}", env!("CARGO_PKG_VERSION")).as_bytes())
    }

    /// Calls `look` with the actuation as a wave of natural curvatures, and its drive. Active moments are converted to
    /// the curvatures to which they bend the unloaded rod, and a lagged drive to its steady wave.
    pub(crate) fn with_curvature_wave<R>(&self, look: impl FnOnce(&dyn Actuation, Drive) -> R) -> Option<R> {
        let (actuation, drive) = self.actuation.as_ref()?;
        let lagging = self.lag.map(|tau| actuation.filtered(&lag::steady(tau, TAU * drive.frequency), self.rod.nodes));
        let actuation = lagging.as_ref().unwrap_or(actuation);
        if self.active_moments {
            return Some(look(&*bending(&**actuation, &self.rod), *drive));
        }
        Some(look(&**actuation, *drive))
    }

    /// The fully developed natural curvature of each joint at this `phase` (rad) of the actuation, within its limit,
    /// see [`with_curvature_wave`](Self::with_curvature_wave); zero without actuation.
    pub(crate) fn natural_curvature(&self, phase: f64) -> Vec<f64> {
        let (rod, mut natural) = (&self.rod, vec![0.0; self.rod.nodes]);
        self.with_curvature_wave(|actuation, drive| {
            let wave = Wave { amplitude: drive.amplitude, gain: 1.0, gain_rate: 0.0, phase, phase_rate: 0.0 };
            actuation.add(wave, &mut natural, &mut vec![0.0; rod.nodes]);
        });
        if let Some(most) = self.largest_drive {
            for k in rod.joints() {
                let most = if self.active_moments { most / (rod.joint[k] * rod.joint_part(k)) } else { most };
                natural[k] = limited(natural[k], most)[0];
            }
        }
        natural
    }

    /// The number of entries of the positions of a state: two per node, and the arc of a hinge.
    pub fn unknowns(&self) -> usize {
        2 * self.rod.nodes + usize::from(self.hinge.is_some())
    }

    /// True if the material of the rod or the bearing of a hinge dissipates energy.
    pub fn is_damped(&self) -> bool {
        self.rod.damping.is_some() || self.hinge.as_ref().is_some_and(|hinge| hinge.damping > 0.0)
    }

    /// True if the fluid of the scene flows, anywhere and at any time.
    #[cfg(feature = "design")]
    pub(crate) fn is_in_flow(&self) -> bool {
        let still = self.flow.is_none() && self.fluid.flow == Vector2::zeros();
        !still || self.layers.is_some_and(|layers| !layers.flow_together())
    }

    /// True if a drive of the rod depends on its state: the motor of a hinge, or a winch.
    pub(crate) fn has_motor_or_winch(&self) -> bool {
        self.hinge.is_some() || self.tendons.iter().any(|tendon| tendon.winch().is_some())
    }

    /// True if the drive has a limit or a lag, so that its output differs from the demand.
    pub fn filters_drive(&self) -> bool {
        self.largest_drive.is_some() || self.lag.is_some()
    }

    /// Half the range of the speed (m/s) of the head in the scene's motion.
    pub fn head_speed_amplitude(&self) -> f64 {
        let Some([x, y, angle]) = &self.head else { return 0.0 };
        x.rate_amplitude().max(y.rate_amplitude()).max(angle.rate_amplitude() * self.rod.length)
    }
}

/// The inputs that a host may set during a run; initially those of the scene.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Inputs {
    /// Drive of the actuation.
    pub drive: Drive,
    /// Phase offset φ₀, rad.
    pub phase_offset: f64,
    /// Time (s) and phase (rad) at the last change of the frequency, where the phase is continuous.
    phase_origin: [f64; 2],
    /// Natural curvature of each joint set by a host (1/m), one entry per node.
    pub natural: Option<Vec<f64>>,
    /// Active moment of each joint set by a host (N m), one entry per node.
    pub moment: Option<Vec<f64>>,
    /// A host's contribution to the tension of each tendon, N.
    pub tension: [f64; MAX_TENDONS],
    /// A host's contribution to the length that a winch prescribes for each tendon, m.
    pub winch: [f64; MAX_TENDONS],
    /// A host's contributions to the torque (N m) and to the commanded angle (rad) of a hinge.
    pub hinge: MotorCommand,
    /// The output of a lagged drive at the last change of its inputs; `None` before the first change.
    pub lagging: Option<LagState>,
    /// Forces set by a host (N), two entries per node.
    pub force: Option<Vec<f64>>,
    /// The fluid; with layers, the one before the first interface.
    pub fluid: Fluid,
    /// True once a host has set the flow, which then no longer follows the scene.
    pub flow_taken: bool,
    /// Interfaces and the fluids beyond them.
    pub layers: Option<Layers>,
    /// Motion of the head set by a host, for the coordinates that it drives.
    pub head: Option<Box<HostHead>>,
    /// Inputs of a host for the other coordinates, which repeat their present motion.
    pub(crate) redundant_head_inputs: RedundantHeadInputs,
}

impl Clone for Inputs {
    fn clone(&self) -> Self {
        let (natural, moment) = (self.natural.clone(), self.moment.clone());
        let (force, head, lagging) = (self.force.clone(), self.head.clone(), self.lagging.clone());
        Self { natural, moment, force, head, lagging, ..*self }
    }

    /// Does not allocate if there is room.
    fn clone_from(&mut self, other: &Self) {
        let (mut natural, mut moment) = (self.natural.take(), self.moment.take());
        let (mut force, mut head, mut lagging) = (self.force.take(), self.head.take(), self.lagging.take());
        natural.clone_from(&other.natural);
        moment.clone_from(&other.moment);
        force.clone_from(&other.force);
        head.clone_from(&other.head);
        lagging.clone_from(&other.lagging);
        *self = Self { natural, moment, force, head, lagging, ..*other };
    }
}

impl Inputs {
    /// The inputs as in the scene.
    pub fn of(model: &Model) -> Self {
        Self {
            drive: model.actuation.as_ref().map_or(Drive { amplitude: 0.0, frequency: 0.0 }, |(_, drive)| *drive),
            phase_offset: 0.0,
            phase_origin: [0.0; 2],
            natural: None,
            moment: None,
            tension: [0.0; MAX_TENDONS],
            winch: [0.0; MAX_TENDONS],
            hinge: MotorCommand::default(),
            lagging: None,
            force: None,
            fluid: model.fluid,
            flow_taken: false,
            layers: model.layers,
            head: None,
            redundant_head_inputs: RedundantHeadInputs::default(),
        }
    }

    /// True if these inputs act on the rod like `other`, apart from the motion of the head.
    pub fn act_as(&self, other: &Self) -> bool {
        let parts =
            |inputs: &Self| (inputs.drive, inputs.phase_offset, inputs.phase_origin, inputs.fluid, inputs.layers);
        parts(self) == parts(other)
            && self.natural == other.natural
            && self.moment == other.moment
            && self.tension == other.tension
            && self.winch == other.winch
            && self.hinge == other.hinge
            && self.force == other.force
    }

    /// Changes the frequency (Hz) at time `t` (s), keeping the phase.
    pub fn set_frequency(&mut self, frequency: f64, t: f64) {
        let frequency = frequency + 0.0; // no negative zero
        if frequency != self.drive.frequency {
            self.phase_origin = [t, self.cycle(t)];
            self.drive.frequency = frequency;
        }
    }

    /// Phase 2πft of the drive before the offset, rad.
    pub fn cycle(&self, t: f64) -> f64 {
        let [start, phase] = self.phase_origin;
        phase + TAU * self.drive.frequency * (t - start)
    }

    /// The drive at time `t` (s), with inputs that follow `extrapolation`.
    pub(crate) fn drive_state(&self, start: &Start, t: f64, extrapolation: Option<&InputExtrapolation>) -> DriveState {
        let [gain, gain_rate] = start.gain(t);
        let (amplitude, gain_acceleration) = (self.drive.amplitude, start.gain_acceleration(t));
        let mut drive = DriveState {
            size: [amplitude * gain, amplitude * gain_rate, amplitude * gain_acceleration],
            phase: [self.cycle(t) - self.phase_offset, TAU * self.drive.frequency, 0.0],
        };
        if let Some(extrapolation) = extrapolation {
            let rate = extrapolation.rate();
            let second = |of: fn(&Self) -> f64| extrapolation.derivative(2, t, of);
            let [_, size_rate, size_acceleration] = &mut drive.size;
            let [_, phase_rate, phase_acceleration] = &mut drive.phase;
            *size_rate += rate.drive.amplitude * gain;
            *size_acceleration +=
                2.0 * rate.drive.amplitude * gain_rate + second(|inputs| inputs.drive.amplitude) * gain;
            *phase_rate -= rate.phase_offset;
            *phase_acceleration = TAU * rate.drive.frequency - second(|inputs| inputs.phase_offset);
        }
        drive
    }

    /// The wave of the drive at time `t` (s), with inputs that follow `extrapolation`.
    pub(crate) fn wave(&self, start: &Start, t: f64, extrapolation: Option<&InputExtrapolation>) -> Wave {
        let DriveState { size: [size, size_rate, _], phase: [phase, phase_rate, _] } =
            self.drive_state(start, t, extrapolation);
        let ([gain, gain_rate], amplitude) = match extrapolation {
            None => (start.gain(t), self.drive.amplitude),
            Some(_) => ([size, size_rate], 1.0),
        };
        Wave { amplitude, gain, gain_rate, phase, phase_rate }
    }
}

/// The drive of the actuation at one time: its output is S g(φ), with the size S and the phase φ, each with two time
/// derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DriveState {
    /// S, dS/dt and d²S/dt².
    pub size: [f64; 3],
    /// φ (rad), dφ/dt and d²φ/dt².
    pub phase: [f64; 3],
}

impl DriveState {
    /// The coefficients of g, dg/dφ and d²g/dφ² in d²κ̄/dt²: S″, 2S′φ′ + Sφ″ and Sφ′².
    fn acceleration(&self) -> [f64; 3] {
        let ([size, rate, second], [_, speed, quickening]) = (self.size, self.phase);
        [second, 2.0 * rate * speed + size * quickening, size * speed * speed]
    }
}

/// Active moments M_k of the joints (N m), conjugate to their curvatures, and the natural curvatures without them, with
/// the rates of both (per s), one entry per node.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ActiveMoments {
    /// M_k.
    pub moment: Vec<f64>,
    /// dM_k/dt.
    pub rate: Vec<f64>,
    /// Natural curvature.
    pub natural: Vec<f64>,
    /// Rate of the natural curvature.
    pub natural_rate: Vec<f64>,
}

impl ActiveMoments {
    /// Zeros for `nodes` nodes.
    pub(crate) fn zeros(nodes: usize) -> Self {
        let zeros = || vec![0.0; nodes];
        Self { moment: zeros(), rate: zeros(), natural: zeros(), natural_rate: zeros() }
    }

    pub(crate) fn clear(&mut self) {
        for values in [&mut self.moment, &mut self.rate, &mut self.natural, &mut self.natural_rate] {
            values.fill(0.0);
        }
    }

    /// Stores the natural curvature and its rate, and adds M_k/B_k and its rate to them. Moments are set to zero where
    /// `rod` has no joint.
    fn bend(&mut self, rod: &Rod, [natural, rate]: [&mut [f64]; 2]) {
        self.natural.copy_from_slice(natural);
        self.natural_rate.copy_from_slice(rate);
        for (moments, natural) in [(&mut self.moment, natural), (&mut self.rate, rate)] {
            let joints = rod.joints();
            moments[..joints.start].fill(0.0);
            moments[joints.end..].fill(0.0);
            joints.for_each(|k| natural[k] += moments[k] / rod.joint[k]);
        }
    }
}

/// Subtracts `increment` along `direction` from the arc of a hinge in a `state` of `nodes` nodes.
fn move_arc_back(nodes: usize, direction: Direction, increment: f64, state: &mut State) {
    let parts = [(&mut state.q, direction.q), (&mut state.v, direction.v), (&mut state.a, direction.a)];
    for (values, along) in parts {
        if let Some(arc) = values.get_mut(2 * nodes) {
            *arc -= along * increment;
        }
    }
}

/// An array of a host's inputs, if it is set.
type InputArray = fn(&Inputs) -> Option<&[f64]>;

fn own_moment(inputs: &Inputs) -> Option<&[f64]> {
    inputs.moment.as_deref()
}

fn own_curvature(inputs: &Inputs) -> Option<&[f64]> {
    inputs.natural.as_deref()
}

/// Adds the active moments (N m) of `tendons` at these `tensions` (N) to those of the joints, one entry per node.
fn add_tendon_moments(tendons: &Tendons, tensions: &[f64], moments: &mut [f64]) {
    for (tendon, tension) in tendons.iter().zip(tensions) {
        moments[tendon.joints.clone()].iter_mut().for_each(|moment| *moment += tension * tendon.offset);
    }
}

/// A model in motion: its inputs, the quantities that follow from time and inputs, and work arrays. The current time is
/// that of the last [`System::move_to`].
#[derive(Debug)]
pub struct Dynamics {
    /// The model.
    pub model: Arc<Model>,
    /// The included mechanics.
    pub mechanics: Mechanics,
    /// The host's inputs at the current time.
    pub inputs: Inputs,
    /// The extrapolation of the inputs, if the host has set derivatives.
    pub extrapolation: Option<Box<InputExtrapolation>>,
    /// Curvature κ̄_k without moment at the current time, one entry per node; zero where there is no joint. It is the
    /// natural curvature, or with active moments the curvature to which they bend the joint:
    /// m_k = B_k(κ_k − κ̄_k) = B_k(κ_k − natural) − M_k.
    pub natural: Vec<f64>,
    /// dκ̄_k/dt, 1/s.
    pub natural_rate: Vec<f64>,
    /// The limit of the actuation, if there is one.
    saturation: Option<Saturation>,
    winches: Option<Box<Winches>>,
    /// The active moments, if there are any.
    pub active: Option<ActiveMoments>,
    /// The tension of each tendon, N, and its rate, N/s, at the current time.
    pub tensions: [[f64; MAX_TENDONS]; 2],
    /// Pose of a held head at the current time; with a hinge, its angle is that of the last evaluated state.
    pub held: Option<Pose>,
    /// Inputs of the motor of a hinge at the current time.
    pub command: MotorCommand,
    /// Residual of a hinge in the last assembly in the chain form.
    hinge_residual: Option<HingeResidual>,
    /// End (s) of the present or last step. At this time the pose of the head is the left-hand limit, see
    /// [`Signal::before`].
    pub(crate) step_end: Option<f64>,
    edges: Vec<Edge>,
    joints: Vec<Joint>,
    kappa: Vec<f64>,
    /// Strain rates of the rod as last deformed; `None` if it is elastic.
    pub(crate) rates: Option<StrainRates>,
    /// The fluid along the rod as last deformed; empty in a uniform medium.
    runs: FluidRuns,
    /// A buffer for forces and loads.
    applied: Vec<f64>,
    /// A buffer for derivatives of forces that are not used.
    pub(crate) unused: Vec<f64>,
    workspace: Vec<EdgeForce>,
}

impl Dynamics {
    /// The model at time zero with the scene's inputs.
    pub fn new(model: Arc<Model>) -> Self {
        let nodes = model.rod.nodes;
        let mut dynamics = Self {
            mechanics: Mechanics::default(),
            inputs: Inputs::of(&model),
            extrapolation: None,
            natural: vec![0.0; nodes],
            natural_rate: vec![0.0; nodes],
            saturation: model.largest_drive.map(|most| Saturation::new(most, nodes)),
            winches: Winches::of(&model),
            active: None,
            tensions: Default::default(),
            held: None,
            command: MotorCommand::default(),
            hinge_residual: None,
            step_end: None,
            edges: vec![Edge::new(Vector2::x()); nodes - 1],
            joints: vec![Joint::default(); nodes],
            kappa: vec![0.0; nodes],
            rates: model.rod.damping.as_ref().map(|_| StrainRates::zeros(nodes, 0.0)),
            runs: FluidRuns::with_capacity(if model.layers.is_some() { nodes } else { 0 }),
            applied: Vec::new(),
            unused: Vec::new(),
            workspace: vec![EdgeForce::ZERO; EDGES_PER_BLOCK],
            model,
        };
        dynamics.evaluate(0.0);
        dynamics
    }

    /// The initial state of a run: positions and velocities at time zero, zero accelerations.
    pub fn first_state(&mut self) -> State {
        self.first_state_in(Form::Positions)
    }

    /// The entries of nodes in the `values` of a state, two per node.
    pub(crate) fn of_nodes(&self, mut values: Vec<f64>) -> Vec<f64> {
        values.truncate(2 * self.model.rod.nodes);
        values
    }

    /// Writes the initial positions and velocities to `state`.
    fn place(&mut self, state: &mut State) {
        self.evaluate(0.0);
        let [curvature, rate] = self.free_of_moment([&self.natural, &self.natural_rate].map(Vec::clone));
        let Model { rod, start, spin, initial_curvature, hinge, .. } = &*self.model;
        start.place(rod, [&curvature, &rate], initial_curvature.as_deref(), self.held.as_ref(), state);
        if let (Some(_), Some([_, _, angle])) = (hinge, &self.held) {
            // A rod that starts at rest has a head at rest.
            let spin = if matches!(start, Start::Shaped) { angle.rate } else { 0.0 };
            for (values, angle) in [(&mut state.q, angle.value), (&mut state.v, spin)] {
                if let Some(arc) = values.get_mut(2 * rod.nodes) {
                    *arc = angle * rod.length;
                }
            }
        }
        if *spin != 0.0 {
            add_spin(rod, *spin, state);
        }
        self.move_to(0.0, state);
        self.resist_opening(state);
    }

    /// Sets the forces in the links of a damped, unstrained rod to the damping of their length rates: forces are
    /// unknowns of the chain form.
    fn resist_opening(&self, state: &mut State) {
        let Model { rod, .. } = &*self.model;
        let Some(damping) = &rod.damping else { return };
        let State { v, links, .. } = state;
        for (k, link) in links.iter_mut().enumerate().take(rod.nodes - 1) {
            let along = Vector2::new(link.angle.cos(), link.angle.sin());
            let opening = along.dot(&(node(v, k + 1) - node(v, k)));
            link.force = (along * damping.tension(rod, k, opening)).into();
        }
    }

    /// The curvature at every node and its rate (1/s) with which the rod follows `natural`, a curvature and its rate,
    /// without a moment at the start. Linear in `natural`.
    pub(crate) fn free_of_moment(&self, mut natural: [Vec<f64>; 2]) -> [Vec<f64>; 2] {
        if let Some(damping) = &self.model.rod.damping {
            let omega = self.initial_angular_frequency();
            for k in self.model.rod.joints() {
                let followed = damping.free_of_moment(k, omega, natural.each_ref().map(|values| values[k]));
                (natural[0][k], natural[1][k]) = followed.into();
            }
        }
        natural
    }

    /// 2πf of the actuation at the start, rad/s; zero without actuation.
    pub(crate) fn initial_angular_frequency(&self) -> f64 {
        let driven = self.model.actuation.is_some();
        if driven { self.inputs.wave(&self.model.start, 0.0, self.extrapolation.as_deref()).phase_rate } else { 0.0 }
    }

    /// Replaces the inputs by `inputs`.
    pub fn restore(&mut self, inputs: &Inputs) {
        self.inputs.clone_from(inputs);
    }

    /// Stores the derivative of `order` 0 to 3 that a host sets for coordinate `i` (x, y, angle) of a held head at time
    /// `t` (s). `derivative` is true if it is set as a derivative of another input. The host drives a coordinate from
    /// the first input on that differs from its present motion: start values leave the head to the scene.
    pub fn set_head_derivative(&mut self, t: f64, i: usize, order: usize, value: f64, derivative: bool) {
        let Some(pose) = &self.held else { return };
        let now = pose[i];
        let hosts = self.inputs.head.as_ref().is_some_and(|host| host.axes[i].is_some());
        if !hosts && [now.value, now.rate, now.acceleration, 0.0].get(order) == Some(&value) {
            self.inputs.redundant_head_inputs.keep(t, [i, order], value);
            return;
        }
        let words = if hosts { Default::default() } else { self.inputs.redundant_head_inputs.of(t, i) };
        let head = self.inputs.head.get_or_insert_default();
        for (order, word) in words.into_iter().enumerate() {
            word.into_iter().for_each(|word| head.set_derivative(t, i, now, order, word, false));
        }
        head.set_derivative(t, i, now, order, value, derivative);
    }

    /// Hands the flow over to the host; it stays constant until it is set again.
    pub fn take_over_flow(&mut self) -> &mut Vector2<f64> {
        self.inputs.flow_taken = true;
        self.inputs.fluid.acceleration = Vector2::zeros();
        &mut self.inputs.fluid.flow
    }

    /// Evaluates natural curvature and head pose at time `t` (s) before there is a state.
    pub(crate) fn evaluate_at(&mut self, t: f64) {
        self.evaluate(t);
    }

    /// The first-order change of κ̄ and dκ̄/dt at time `t` (s), one entry per node, and of the active moments in them,
    /// when the inputs change by `by`.
    pub(crate) fn natural_change(
        &self,
        by: &Inputs,
        t: f64,
        [natural, rate]: [&mut [f64]; 2],
        active: &mut ActiveMoments,
    ) {
        let Model { rod, actuation, start, active_moments, .. } = &*self.model;
        natural.fill(0.0);
        rate.fill(0.0);
        active.clear();
        if let Some((actuation, _)) = actuation {
            let (natural, rate) = if *active_moments {
                (&mut active.moment[..], &mut active.rate[..])
            } else {
                (&mut *natural, &mut *rate)
            };
            let (amplitude, turn, quicker) = (by.drive.amplitude, -by.phase_offset, TAU * by.drive.frequency);
            if [amplitude, turn, quicker] != [0.0; 3] {
                let wave = self.inputs.wave(start, t, self.extrapolation.as_deref());
                let (grows, size) = (wave.amplitude * wave.gain_rate, wave.amplitude * wave.gain);
                let [gain, gain_rate] = start.gain(t);
                // κ̄ = S g(φ) and dκ̄/dt = S g' φ' + S' g, with S = `size`, S' = `grows`.
                actuation.add(Wave { amplitude, gain, gain_rate, ..wave }, natural, rate);
                let of_rate = [0.0, size * quicker + grows * turn, size * wave.phase_rate * turn];
                actuation.add_derivatives(of_rate, wave.phase, rate);
                actuation.add_derivatives([0.0, size * turn, 0.0], wave.phase, natural);
            }
        }
        if let Some(own) = &by.natural {
            natural.iter_mut().zip(own).for_each(|(natural, own)| *natural += own * rod.spacing);
        }
        if let Some(own) = &by.moment {
            active.moment.iter_mut().zip(own).for_each(|(moment, own)| *moment += own);
        }
        if let Some(tau) = self.model.lag {
            // The output of a lagged drive does not jump; its rate does, by the jump of (x − y)/τ.
            let (given, rate) = if *active_moments {
                (&mut active.moment[..], &mut active.rate[..])
            } else {
                (&mut *natural, &mut *rate)
            };
            for (given, rate) in given.iter_mut().zip(rate) {
                (*given, *rate) = (0.0, *given / tau);
            }
        }
        match &self.saturation {
            Some(limit) if *active_moments => limit.change(&mut active.moment, &mut active.rate),
            Some(limit) => limit.change(natural, rate),
            None => {}
        }
        rod.at_joints(natural);
        rod.at_joints(rate);
        add_tendon_moments(&self.model.tendons, &self.tension_change(by), &mut active.moment);
        active.bend(rod, [natural, rate]);
    }

    /// Computes the motion of a head that a host drives, from time `t` to `end` (s), the end of the host's step.
    /// `begins` is true if the step begins at `t`, false if the host has set the pose within it.
    ///
    /// Returns the differences of a new pose (m, m, rad), and of a new velocity (m/s, m/s, rad/s), from the motion
    /// without it.
    pub fn fit_head_extrapolation(&mut self, t: f64, end: f64, begins: bool) -> [[f64; 2]; 3] {
        match (&mut self.inputs.head, &self.held, &self.model.head) {
            (Some(host), Some(pose), Some(motion)) => host.fit([t, end], pose, self.model.head_input, motion, begins),
            _ => [[0.0; 2]; 3],
        }
    }

    /// True if the run starts with a head pose that a host sets before the first step, at time `t` (s), for time `t` or
    /// for the end of the step. A pose for time `t` that equals the scene's within a tolerance leaves the head to the
    /// scene. A pose for the end of a step is a target, unless it is too far for one step.
    pub(crate) fn starts_elsewhere(&self, t: f64, step_end: Option<f64>) -> bool {
        /// Fractions of the length, and angles in rad.
        const START_POSE_TOLERANCE: f64 = 1e-6;
        const MAX_TARGET_DISTANCE: f64 = 0.1;
        let (Some(host), Some(motion)) = (&self.inputs.head, &self.model.head) else { return false };
        let (time, reach) = match (self.model.head_input, step_end) {
            (HeadInput::Now, None) => (t, START_POSE_TOLERANCE),
            (HeadInput::AtEnd, Some(end)) => (end, MAX_TARGET_DISTANCE),
            _ => return false,
        };
        let reaches = [self.model.rod.length, self.model.rod.length, 1.0].map(|unit| reach * unit);
        let moves = step_end.is_none() && host.moves_unlike(motion, time);
        host.has_started() || moves || host.largest_relative_offset(motion, time, reaches) > 1.0
    }

    /// Resets `state` to the start, at time `t` (s), with the pose of the head set by a host.
    pub(crate) fn start_with_host(&mut self, t: f64, state: &mut State) {
        if let Some(host) = &mut self.inputs.head {
            host.start(t);
        }
        for values in [&mut state.q, &mut state.v, &mut state.a] {
            values.fill(0.0);
        }
        state.links.fill(Link::default());
        self.place(state);
        self.move_to(t, state);
    }

    /// Writes d²κ̄_k/dt² (1/s²) at time `t` (s) to `out`, one entry per node, and d²M_k/dt² (N m/s²) of active moments
    /// to `active`, which is left empty if there are none.
    pub(crate) fn natural_acceleration(&self, t: f64, out: &mut [f64], active: &mut Vec<f64>) {
        out.fill(0.0);
        let Model { rod, active_moments, .. } = &*self.model;
        if !active_moments {
            self.add_drive_acceleration(t, out);
        } else {
            self.add_own(2, t, false, 1.0, out);
        }
        if let Some(limit) = self.saturation.as_ref().filter(|_| !active_moments) {
            limit.second(out);
        }
        rod.at_joints(out);
        active.clear();
        if self.active.is_some() {
            active.resize(rod.nodes, 0.0);
            if *active_moments {
                self.add_drive_acceleration(t, active);
            } else {
                self.add_own(2, t, true, 1.0, active);
            }
            if let Some(limit) = self.saturation.as_ref().filter(|_| *active_moments) {
                limit.second(active);
            }
            let second: [f64; MAX_TENDONS] = std::array::from_fn(|i| self.pull(i, t).acceleration);
            add_tendon_moments(&self.model.tendons, &second, active);
            rod.joints().for_each(|k| out[k] += active[k] / rod.joint[k]);
        }
    }

    /// The tension of tendon `i` at time `t` (s), N, with two time derivatives: the scene's, multiplied by the start
    /// ramp, plus the host's.
    fn pull(&self, i: usize, t: f64) -> Sample {
        let Model { tendons, start, .. } = &*self.model;
        let Some(Pull::Tension(tension)) = tendons.get(i).map(|tendon| &tendon.pull) else { return Sample::default() };
        let ([gain, gain_rate], gain_acceleration) = (start.gain(t), start.gain_acceleration(t));
        let Sample { value, rate, acceleration } = tension.at(t);
        let added = |order: usize| {
            let extrapolation = self.extrapolation.as_ref();
            extrapolation.map_or(0.0, |extrapolation| extrapolation.derivative(order, t, |inputs| inputs.tension[i]))
        };
        slack_below_zero(Sample {
            value: gain * value + self.inputs.tension[i],
            rate: gain * rate + gain_rate * value + added(1),
            acceleration: gain * acceleration + 2.0 * gain_rate * rate + gain_acceleration * value + added(2),
        })
    }

    /// Adds the second derivative of the drive's output before its limit, including a host's contribution, to `out`.
    fn add_drive_acceleration(&self, t: f64, out: &mut [f64]) {
        let Model { actuation, start, lag, active_moments, .. } = &*self.model;
        if let Some(tau) = lag {
            return self.add_lagging(*tau, t, 2, out);
        }
        if let Some((actuation, _)) = actuation {
            let drive = self.inputs.drive_state(start, t, self.extrapolation.as_deref());
            actuation.add_derivatives(drive.acceleration(), drive.phase[0], out);
        }
        self.add_own(2, t, *active_moments, 1.0, out);
    }

    /// Adds `factor` times the derivative of `order` of a host's natural curvatures (dimensionless), or of its active
    /// `moments`, to `out`.
    fn add_own(&self, order: usize, t: f64, moments: bool, factor: f64, out: &mut [f64]) {
        let (of, factor) = match moments {
            true => (own_moment as InputArray, factor),
            false => (own_curvature as InputArray, factor * self.model.rod.spacing),
        };
        match &self.extrapolation {
            Some(extrapolation) => extrapolation.add_derivative(order, t, of, factor, out),
            None if order == 0 => {
                out.iter_mut().zip(of(&self.inputs).into_iter().flatten()).for_each(|(out, own)| *out += factor * own);
            }
            None => {}
        }
    }

    /// Evaluates natural curvature, tensions and head pose at time `t` (s).
    fn evaluate(&mut self, t: f64) {
        self.follow_extrapolation(t);
        for i in 0..self.model.tendons.len() {
            let Sample { value, rate, .. } = self.pull(i, t);
            (self.tensions[0][i], self.tensions[1][i]) = (value, rate);
        }
        let Model { rod, actuation, start, active_moments, tendons, .. } = &*self.model;
        // Everything follows from inputs and time, nothing from earlier values.
        if *active_moments || self.inputs.moment.is_some() || !tendons.is_empty() {
            self.active.get_or_insert_with(|| ActiveMoments::zeros(rod.nodes)).clear();
        } else {
            self.active = None;
        }
        self.natural.fill(0.0);
        self.natural_rate.fill(0.0);
        if let Some(tau) = self.model.lag {
            self.evaluate_lagging(tau, t);
        } else if let Some((actuation, _)) = actuation {
            let wave = self.inputs.wave(start, t, self.extrapolation.as_deref());
            match &mut self.active {
                Some(ActiveMoments { moment, rate, .. }) if *active_moments => actuation.add(wave, moment, rate),
                _ => actuation.add(wave, &mut self.natural, &mut self.natural_rate),
            }
        }
        let Model { rod, active_moments, tendons, .. } = &*self.model;
        // The output of a lagged drive already includes a host's contribution.
        let [curvature_lags, moment_lags] =
            [false, true].map(|moments| self.model.lag.is_some() && *active_moments == moments);
        let extrapolation = self.extrapolation.as_ref().map(|extrapolation| extrapolation.rate());
        if !curvature_lags {
            let rate = extrapolation.and_then(|rate| rate.natural.as_ref());
            for (to, own) in [(&mut self.natural, self.inputs.natural.as_ref()), (&mut self.natural_rate, rate)] {
                to.iter_mut().zip(own.into_iter().flatten()).for_each(|(to, own)| *to += own * rod.spacing);
            }
        }
        if let Some(limit) = self.saturation.as_mut().filter(|_| !active_moments) {
            limit.limit(&mut self.natural, &mut self.natural_rate);
        }
        rod.at_joints(&mut self.natural);
        rod.at_joints(&mut self.natural_rate);
        if let Some(active) = &mut self.active {
            let rate = extrapolation.and_then(|rate| rate.moment.as_ref());
            let own = [(&mut active.moment, self.inputs.moment.as_ref()), (&mut active.rate, rate)];
            for (to, own) in own.into_iter().filter(|_| !moment_lags) {
                to.iter_mut().zip(own.into_iter().flatten()).for_each(|(to, own)| *to += own);
            }
            if let Some(limit) = self.saturation.as_mut().filter(|_| *active_moments) {
                limit.limit(&mut active.moment, &mut active.rate);
            }
            for (tensions, to) in self.tensions.iter().zip([&mut active.moment, &mut active.rate]) {
                add_tendon_moments(tendons, tensions, to);
            }
            active.bend(rod, [&mut self.natural, &mut self.natural_rate]);
        }
        self.evaluate_winches(t);
        let pose = if self.step_end == Some(t) { pose_before } else { pose };
        self.held = self.pose(t, pose);
        self.command = self.command_at(t);
    }

    /// The inputs of the motor of a hinge at time `t` (s). The scene's torque is multiplied by the start ramp.
    fn command_at(&self, t: f64) -> MotorCommand {
        let (Some(hinge), Some([_, _, angle])) = (&self.model.hinge, &self.held) else {
            return MotorCommand::default();
        };
        let [gain, _] = self.model.start.gain(t);
        MotorCommand {
            torque: gain * hinge.torque.at(t).value + self.inputs.hinge.torque,
            angle: angle.value + self.inputs.hinge.angle,
        }
    }

    /// The rates (per s) of the inputs of the motor of a hinge at time `t` (s).
    pub(crate) fn command_rate(&self, t: f64) -> MotorCommand {
        let (Some(hinge), Some([_, _, angle])) = (&self.model.hinge, self.pose(t, pose)) else {
            return MotorCommand::default();
        };
        let [gain, gain_rate] = self.model.start.gain(t);
        let (own, rate) =
            (hinge.torque.at(t), self.extrapolation.as_ref().map(|extrapolation| extrapolation.rate().hinge));
        let MotorCommand { torque, angle: turning } = rate.unwrap_or_default();
        MotorCommand { torque: gain * own.rate + gain_rate * own.value + torque, angle: angle.rate + turning }
    }

    /// Takes the angle of a hinged head from `state`.
    fn follow_hinge(&mut self, state: &State) {
        let Model { rod, hinge, .. } = &*self.model;
        if let (Some(_), Some([_, _, angle])) = (hinge, &mut self.held) {
            *angle = Hinge::angle(state, rod.nodes, rod.length);
        }
    }

    /// The angle (rad) of a held head in `state`, with two time derivatives.
    fn head_angle(&self, state: &State) -> Option<Sample> {
        let Model { rod, hinge, .. } = &*self.model;
        let own = hinge.as_ref().map(|_| Hinge::angle(state, rod.nodes, rod.length));
        own.or_else(|| self.held.map(|[_, _, angle]| angle))
    }

    /// Motor torque T (N m) of a hinge, at the head angle of the last evaluated state.
    pub fn hinge_torque(&self) -> f64 {
        let (Some(hinge), Some([_, _, angle])) = (&self.model.hinge, &self.held) else { return 0.0 };
        hinge.torque(self.command, angle.value)[0]
    }

    /// The equation of a hinge with its derivatives along `direction`, for the rod as last deformed; `None` without a
    /// hinge.
    pub(crate) fn hinge_equation(&self, direction: Direction) -> Option<HingeEquation> {
        let (Some(hinge), Some([_, _, angle])) = (&self.model.hinge, &self.held) else { return None };
        let Joint { couple, stiffness } = self.joints[0];
        let own = hinge.residual(self.command, *angle, couple, direction);
        // Rows are scaled to forces, columns to arcs.
        let per_length = 1.0 / self.model.rod.length;
        let edge = &self.edges[0];
        let damped = self.rates.as_ref().map(|rates| (rates.viscosity[0], rates.edges[0].spin_slope(edge, direction)));
        let (viscosity, spin_slope) = damped.unwrap_or_default();
        let couple_slope = direction.q * stiffness + direction.v * viscosity;
        let across = edge.n() * (edge.per_length * per_length);
        Some(HingeEquation {
            residual: own.moment * per_length,
            own: (own.slope + couple_slope) * per_length * per_length,
            by_node: -across * (direction.q * stiffness) - spin_slope * (viscosity * per_length),
            by_arc: -across * couple_slope,
        })
    }

    /// Writes the equation of a hinge, with its coupling to node 1, in place of the first equation of node 0, which is
    /// prescribed.
    fn write_hinge(&self, residual: &mut [f64], jacobian: Option<Linearisation<'_>>) {
        let direction = jacobian.as_ref().map_or(Direction::POSITIONS, |jacobian| jacobian.direction);
        let Some(equation) = self.hinge_equation(direction) else { return };
        residual[0] = equation.residual;
        if let Some(Linearisation { matrix, .. }) = jacobian {
            equation.write(matrix);
        }
    }

    /// Position (m) and velocity (m/s) of a held head at time `t` (s) of the last step.
    pub(crate) fn head_place(&self, t: f64) -> Option<[Vector2<f64>; 2]> {
        self.pose(t, pose_before).map(|[x, y, _]| [Vector2::new(x.value, y.value), Vector2::new(x.rate, y.rate)])
    }

    /// Pose of a held head at time `t` (s); `own` evaluates the scene's motion.
    fn pose(&self, t: f64, own: fn(&HeadMotion, f64) -> Pose) -> Option<Pose> {
        let mut pose = own(self.model.head.as_ref()?, t);
        if let Some(host) = &self.inputs.head {
            for (sample, axis) in pose.iter_mut().zip(&host.axes) {
                *sample = axis.as_ref().and_then(|axis| axis.at(t)).unwrap_or(*sample);
            }
        }
        Some(pose)
    }

    /// The rod deformed as in `state`, at the current time: by its links if it has any, else by its positions.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::EdgeCollapse`], [`Error::FoldOver`].
    pub fn shape<'a>(&'a mut self, state: &'a State) -> Result<DeformedRod<'a>> {
        self.bend(state)?;
        Ok(DeformedRod { dynamics: self, state })
    }

    fn bend(&mut self, state: &State) -> Result<()> {
        self.follow_hinge(state);
        self.locate_fluid(&state.q);
        if state.links.is_empty() {
            self.shape_edges(&state.q, state.t)?;
            self.shape_joints(state.t)?;
            if self.winches.is_some() {
                self.pull_winches();
                self.shape_joints(state.t)?;
            }
        } else {
            self.shape_edges_of(state, None)?;
            self.kappa.iter_mut().zip(&state.links).for_each(|(kappa, link)| *kappa = link.curvature);
            self.pull_winches();
        }
        if self.rates.is_some() {
            self.strain(state);
        }
        Ok(())
    }

    /// Computes the strain rates of the rod as just deformed, and adds their damping to the joints.
    #[inline(never)] // most rods are elastic
    fn strain(&mut self, state: &State) {
        let Self { model, edges, joints, kappa, natural_rate, rates, held, .. } = self;
        let rod = &model.rod;
        let (Some(rates), Some(damping)) = (rates, &rod.damping) else { return };
        rates.clamp_spin = held.map_or(0.0, |[_, _, angle]| angle.rate);
        if state.links.is_empty() {
            rates.read_edges(edges, state.v.as_chunks().0);
        }
        rates.read_joints(rod.joints(), &rod.joint, damping, kappa, natural_rate);
        if state.links.is_empty() {
            damping.resist(rod.joints(), &rod.joint, rates, [kappa, natural_rate], joints);
        }
    }

    /// The damping of the rod with its strain rates as last deformed; `None` if it is elastic.
    pub fn damped(&self) -> Option<KelvinVoigt<'_>> {
        KelvinVoigt::of(self.model.rod.damping.as_ref(), self.rates.as_ref())
    }

    /// Finds the fluid along a rod with positions `q`.
    fn locate_fluid(&mut self, q: &[f64]) {
        match &self.inputs {
            Inputs { layers: Some(layers), fluid, .. } => _ = self.runs.find(layers, *fluid, q),
            _ => self.runs.clear(),
        }
    }

    fn shape_edges(&mut self, q: &[f64], t: f64) -> Result<()> {
        let [shortest, longest] = lengths_allowed(&self.model.rod);
        let meaningful = shortest..longest;
        let mut fine = true;
        for (edge, ends) in self.edges.iter_mut().zip(q.as_chunks().0.windows(2)) {
            *edge = Edge::new(Vector2::from(ends[1]) - Vector2::from(ends[0]));
            fine &= meaningful.contains(&edge.length);
        }
        match self.edges.iter().position(|e| !fine && !meaningful.contains(&e.length)) {
            None => Ok(()),
            Some(node) => Err(match self.edges[node].length {
                length_m if length_m < meaningful.start => Error::EdgeCollapse { time_s: t, node, length_m },
                _ => Error::NotFinite { time_s: t, node, what: "position" },
            }),
        }
    }

    /// The tangent before the first joint that a held head prescribes.
    pub(crate) fn clamp_tangent(&self) -> Option<Vector2<f64>> {
        self.held.as_ref().map(|pose| self.along_head(pose))
    }

    /// The clamp tangent in `state`, at the current time.
    fn clamp_tangent_of(&self, state: &State) -> Option<Vector2<f64>> {
        let [x, y, _] = self.held?;
        Some(self.along_head(&[x, y, self.head_angle(state)?]))
    }

    /// The clamp tangent in the state `before`, at the beginning of a step.
    pub(crate) fn clamp_tangent_before(&self, before: &State) -> Option<Vector2<f64>> {
        let mut pose = self.pose(before.t, pose_before)?;
        if self.model.hinge.is_some() {
            pose[2] = self.head_angle(before)?;
        }
        Some(self.along_head(&pose))
    }

    fn along_head(&self, [_, _, angle]: &Pose) -> Vector2<f64> {
        Edge::new(Vector2::new(angle.value.cos(), angle.value.sin()) * self.model.rod.spacing).t
    }

    fn shape_joints(&mut self, t: f64) -> Result<()> {
        let clamp_tangent = self.clamp_tangent();
        let Self { model, edges, natural, joints, kappa, .. } = self;
        let mut folded = None;
        bend::joints(clamp_tangent, edges, &model.rod.joint, natural, joints, kappa, |k, beyond_fold| {
            if beyond_fold <= bend::FOLD {
                folded = Some(k);
            }
        });
        folded.map_or(Ok(()), |node| Err(Error::FoldOver { time_s: t, node }))
    }

    /// Constant and host forces and buoyancy on node `k`, N.
    pub fn load(&self, k: usize) -> Vector2<f64> {
        self.loads().map(|(force, factor)| node(force, k) * factor).sum()
    }

    /// The loads, two entries per node, with their factors.
    pub(crate) fn loads(&self) -> impl Iterator<Item = (&[f64], f64)> {
        self.loads_by_source().into_iter().flatten()
    }

    /// The constant load, the host's load, and buoyancy.
    pub(crate) fn loads_by_source(&self) -> [Option<(&[f64], f64)>; 3] {
        fn with(force: &Option<Vec<f64>>, factor: f64) -> Option<(&[f64], f64)> {
            force.as_deref().map(|force| (force, factor))
        }
        let buoyancy = with(&self.model.buoyancy, self.inputs.fluid.density);
        [with(&self.model.load, 1.0), with(&self.inputs.force, 1.0), buoyancy]
    }

    /// True if any constant force, host force or buoyancy acts.
    pub fn is_loaded(&self) -> bool {
        self.loads().next().is_some()
    }

    /// Work (J) of the constant and host forces from positions `from` to `to` over the `times` (s). Time-dependent
    /// forces are evaluated at the middle of the interval.
    pub fn load_work(&mut self, times: [f64; 2], from: &[f64], to: &[f64]) -> f64 {
        if !self.is_loaded() {
            return 0.0;
        }
        self.follow_extrapolation(0.5 * (times[0] + times[1]));
        let work = self.work_along(from, to) + self.placed(from) - self.placed(to);
        self.follow_extrapolation(times[1]);
        work
    }

    /// Updates extrapolated and time-dependent inputs to time `t` (s).
    fn follow_extrapolation(&mut self, t: f64) {
        if let Some(extrapolation) = &mut self.extrapolation {
            extrapolation.at(t, &mut self.inputs);
        }
        if let (Some([x, y]), false) = (&self.model.flow, self.inputs.flow_taken) {
            let (x, y) = (x.at(t), y.at(t));
            let Fluid { flow, acceleration, .. } = &mut self.inputs.fluid;
            (*flow, *acceleration) = (Vector2::new(x.value, y.value), Vector2::new(x.rate, y.rate));
        }
    }

    /// True if the acceleration of the head jumps at time `t` (s) in the scene's motion.
    pub(crate) fn head_jumps_at(&self, t: f64) -> bool {
        self.own_head().any(|signal| signal.jumps_at(t))
    }

    /// The scene's motion of the head coordinates that no host drives.
    fn own_head(&self) -> impl Iterator<Item = &Signal> {
        let host = self.inputs.head.as_deref();
        let hosts = move |i: usize| host.and_then(|host| host.axes[i].as_ref()).is_some_and(|axis| axis.moves());
        let signals = self.model.head.iter().flatten().enumerate();
        signals.filter(move |(i, _)| !hosts(*i)).map(|(_, signal)| signal)
    }

    /// The longest step (s) from the current time `t` (s) that resolves the drives of the rod, whatever their
    /// amplitude: the wave, the start ramp, the signals of head, flow, tendons and hinge. The search stops at steps of
    /// `wanted` (s) or more.
    pub fn longest_step(&self, t: f64, wanted: f64) -> f64 {
        let Model { actuation, start, flow, tendons, hinge, .. } = &*self.model;
        let own_flow = flow.iter().flatten().filter(|_| !self.inputs.flow_taken);
        let pulls = tendons.iter().map(Tendon::signal).chain(hinge.iter().map(|hinge| &hinge.torque));
        let signals = own_flow.chain(self.own_head()).chain(pulls);
        let mut longest = signals.map(|signal| signal.longest_step(t, wanted)).fold(f64::INFINITY, f64::min);
        if let Some(host) = &self.inputs.head {
            let axes = host.axes.iter().zip([self.model.rod.length, self.model.rod.length, 1.0]);
            let steps = axes.filter_map(|(axis, unit)| Some(axis.as_ref()?.longest_step(t, unit)));
            longest = steps.fold(longest, f64::min);
        }
        if let Start::Ramp { duration } = *start
            && t < duration
            && (actuation.is_some() || !tendons.is_empty() || hinge.is_some())
        {
            longest = longest.min(duration / RESOLVING_STEPS_PER_PERIOD);
        }
        if let Some((actuation, _)) = actuation {
            let drive = self.inputs.drive_state(start, t, self.extrapolation.as_deref());
            if drive.size != [0.0; 3] {
                longest =
                    longest.min(self.longest_turn(TAU / RESOLVING_STEPS_PER_PERIOD / actuation.fastest(), &drive, t));
            }
        }
        longest
    }

    /// The time (s) from `t` (s) in which the phase changes by `turn` (rad).
    fn longest_turn(&self, turn: f64, drive: &DriveState, t: f64) -> f64 {
        let Some(extrapolation) = self.extrapolation.as_deref() else { return turn / drive.phase[1].abs() };
        // |φ′|h, |φ″|h²/2, …: the nonzero terms have equal shares.
        let rate = |order: usize| {
            let frequency =
                if order <= HIGHEST_ORDER { extrapolation.derivative(order, t, |i| i.drive.frequency) } else { 0.0 };
            let offset =
                if order < HIGHEST_ORDER { extrapolation.derivative(order + 1, t, |i| i.phase_offset) } else { 0.0 };
            (TAU * frequency - offset).abs()
        };
        let rates: [f64; HIGHEST_ORDER + 1] =
            std::array::from_fn(|k| if k == 0 { drive.phase[1].abs() } else { rate(k) });
        let share = turn / rates.iter().filter(|rate| **rate > 0.0).count().max(1) as f64;
        let mut factorial = 1.0;
        let mut longest = f64::INFINITY;
        for (k, rate) in rates.into_iter().enumerate() {
            factorial *= (k + 1) as f64;
            longest = longest.min((share * factorial / rate).powf(1.0 / (k + 1) as f64));
        }
        longest
    }

    /// The rates at which changing densities and moving interfaces change the energy (W) and the momentum (N) of the
    /// fluid around the rod. New fluid has the velocity of the fluid that it replaces.
    pub(crate) fn medium_change_rates(&self, rod: &Kinematics<'_>, workspace: &mut [f64]) -> (f64, Vector2<f64>) {
        let (mut power, mut force) = (0.0, Vector2::zeros());
        let Some(extrapolation) = &self.extrapolation else { return (power, force) };
        let rate = extrapolation.rate();
        let keys = by_key(&rate.fluid, rate.layers.as_ref()).filter(|(_, change)| *change != 0.0);
        for (key, change) in keys {
            for own in self.model.forces.iter().filter(|force| force.power_kind().is_none()) {
                let [energy, _] = own.add_by_parameter(key, rod, workspace);
                power += change * energy;
                let along = |axis| own.momentum_by_parameter(key, rod, axis);
                force += Vector2::new(along(Vector2::x()), along(Vector2::y())) * change;
            }
        }
        (power, force)
    }

    /// Checks that the interfaces follow each other along their normal at time `t` (s).
    ///
    /// # Errors
    /// [`Error::BadValue`].
    pub(crate) fn check_layers(&self, t: f64) -> Result<()> {
        let Some(now) = &self.inputs.layers else { return Ok(()) };
        let ahead = self.extrapolation.as_ref().and_then(|extrapolation| extrapolation.layers(t));
        let layers = ahead.as_ref().unwrap_or(now);
        match layers.overlap() {
            None => Ok(()),
            Some(j) => {
                let name =
                    ["interface_1_offset_m", "interface_2_offset_m", "interface_3_offset_m", "interface_4_offset_m"];
                let value = layers.get(j).map_or(f64::NAN, |layer| layer.offset);
                let allowed = "an offset beyond the interface before, without overlap: interfaces follow each other";
                Err(Error::BadValue { name: name[j.min(3)], value, allowed })
            }
        }
    }

    /// The energy (J) of the position-dependent loads at positions `q`.
    fn placed(&self, q: &[f64]) -> f64 {
        let loads = self.model.forces.iter().filter(|force| force.power_kind() == Some(PowerKind::Load));
        loads.map(|load| load.energy(&self.kinematics_of(0.0, &self.edges, [q; 3]), 0.0, None)).sum()
    }

    fn work_along(&self, from: &[f64], to: &[f64]) -> f64 {
        self.loads_along(|k| node(to, k) - node(from, k)).0
    }

    /// Σ F·d over the constant and host forces and buoyancy F, where d is the `motion` of a node, and ΣF (N).
    pub(crate) fn loads_along(&self, motion: impl Fn(usize) -> Vector2<f64>) -> (f64, Vector2<f64>) {
        let (mut along, mut total) = (0.0, Vector2::zeros());
        for (forces, factor) in self.loads() {
            for (k, force) in forces.as_chunks().0.iter().enumerate() {
                let force = Vector2::from(*force) * factor;
                along += force.dot(&motion(k));
                total += force;
            }
        }
        (along, total)
    }

    /// The kinematics of a rod with these `edges` at time `t` (s), with positions q, velocities v and accelerations a.
    pub fn kinematics_of<'a>(&'a self, t: f64, edges: &'a [Edge], [q, v, a]: [&'a [f64]; 3]) -> Kinematics<'a> {
        Kinematics {
            t,
            edges,
            q,
            v,
            a,
            fluid: self.inputs.fluid,
            layers: self.inputs.layers.as_ref(),
            around: FluidAlong::default(),
            tensions: &self.tensions[0],
        }
    }

    /// The kinematics of the rod in `state`, the last one to which it was deformed.
    fn moving<'a>(&'a self, State { t, q, v, a, .. }: &'a State) -> Kinematics<'a> {
        Kinematics { around: (&self.runs).into(), ..self.kinematics_of(*t, &self.edges, [q, v, a]) }
    }

    /// The flow (m/s) at position `x` (m).
    pub fn flow_at(&self, x: Vector2<f64>) -> Vector2<f64> {
        self.fluid_at(x).flow
    }

    /// The fluid at position `x` (m).
    pub fn fluid_at(&self, x: Vector2<f64>) -> Fluid {
        let Inputs { fluid, layers, .. } = &self.inputs;
        layers.map_or(*fluid, |layers| layers.at(*fluid, layers.height(x)).fluid)
    }

    /// Drag (N) of the straight rod, towed along itself through the fluid at `speed` (m/s); `None` in a layered medium,
    /// or without forces.
    pub fn towing_force(&self, speed: f64) -> Option<f64> {
        self.towing_force_in(self.inputs.fluid, speed)
    }

    /// The same through this `fluid`.
    pub(crate) fn towing_force_in(&self, fluid: Fluid, speed: f64) -> Option<f64> {
        let Model { rod, forces, .. } = &*self.model;
        let uniform = self.inputs.layers.is_none();
        (uniform && !forces.is_empty()).then(|| forces.towing(rod, fluid, speed))
    }

    /// The time (s) that a stretching wave needs to cross the rod.
    pub fn crossing_time(&self) -> f64 {
        let rod = &self.model.rod;
        (rod.total_mass() * rod.length / rod.ea).sqrt()
    }

    /// The largest speed (m/s) of the rod in `state`, independent of the frame: relative to its head if that is held,
    /// else relative to its centre of mass, including the speed of that relative to the fluid.
    pub fn own_speed(&self, state: &State) -> f64 {
        let rod = &self.model.rod;
        let [own, drift] = if self.model.head.is_some() {
            [node(&state.v, 0), Vector2::zeros()]
        } else {
            let mean = rod.mean(&state.v);
            let in_fluid = self.model.forces.iter().any(Force::is_of_fluid);
            let drift = match self.inputs.layers {
                _ if !in_fluid => Vector2::zeros(),
                None => mean - self.inputs.fluid.flow,
                Some(_) => mean - self.flow_at(rod.mean(&state.q)),
            };
            [mean, drift]
        };
        let against = |v: &[f64; 2]| (v[0] - own.x).abs().max((v[1] - own.y).abs());
        state.v.as_chunks().0.iter().map(against).fold(drift.amax(), f64::max)
    }

    /// Twice the kinetic energy of node 0 at unit speed, kg.
    pub fn head_mass(&self) -> f64 {
        if self.mechanics == Mechanics::Overdamped { 0.0 } else { self.model.rod.mass[0] }
    }

    /// Computes the moments m_k (N m) that hold the rod in its shape in `state`, from balance alone: the nodes j beyond
    /// joint k need m_k dκ_k/dθ_k = −Σ (x_j − x_k) × (M a_j − F_j), with forces and loads F (whatever EI and EA are).
    /// Returns Σ (M a_j − F_j), the force (N) that a held head must exert, zero for a free one.
    ///
    /// # Errors
    /// Errors of [`shape`](Self::shape).
    pub fn balance(&mut self, state: &State, moment: &mut [f64]) -> Result<Vector2<f64>> {
        let mut applied = std::mem::take(&mut self.applied);
        applied.resize(state.q.len(), 0.0);
        let deformed = self.shape(state)?;
        deformed.dynamics.write_applied(&deformed.kinematics(), &mut applied);
        let (rod, kappa) = (&deformed.dynamics.model.rod, deformed.kappa());
        let (mut force, mut turning) = (Vector2::zeros(), 0.0);
        for k in (0..rod.nodes).rev() {
            if k + 1 < rod.nodes {
                turning += (node(&state.q, k + 1) - node(&state.q, k)).perp(&force);
            }
            moment[k] = if rod.joints().contains(&k) { -turning / bend::curvature_per_turning(kappa[k]) } else { 0.0 };
            force += node(&state.a, k) * rod.mass[k] + node(&applied, k);
        }
        self.applied = applied;
        Ok(force)
    }

    /// Writes the forces (N) that oppose the motion `rod`, minus the loads, to `out`, two entries per node.
    pub fn write_applied(&self, rod: &Kinematics<'_>, out: &mut [f64]) {
        out.fill(0.0);
        self.subtract_loads(out);
        self.model.forces.add(rod, out);
    }

    /// The same without the forces that depend on accelerations.
    pub fn write_applied_without_inertia(&self, rod: &Kinematics<'_>, out: &mut [f64]) {
        if !self.model.forces.are_inertial() {
            return self.write_applied(rod, out);
        }
        out.fill(0.0);
        self.subtract_loads(out);
        for force in self.model.forces.iter().filter(|force| !force.is_inertial()) {
            visit_alone(force, rod, |k, force| add(out, k, force));
        }
    }

    fn subtract_loads(&self, out: &mut [f64]) {
        for (force, factor) in self.loads() {
            out.iter_mut().zip(force).for_each(|(r, w)| *r -= factor * w);
        }
    }

    /// M a − F at `state` for every node, including a held head, where it is the force that the head must exert.
    ///
    /// # Errors
    /// Errors of [`System::assemble`].
    pub fn unconstrained(
        &mut self,
        state: &State,
        residual: &mut [f64],
        jacobian: Option<Linearisation<'_>>,
    ) -> Result<()> {
        self.bend(state)?;
        let Self { model, edges, joints, inputs, workspace, runs, rates, tensions, .. } = self;
        let Model { rod, forces, .. } = &**model;
        let State { t, q, v, a, .. } = state;
        let damped = KelvinVoigt::of(rod.damping.as_ref(), rates.as_ref());
        let moving = Kinematics {
            t: *t,
            edges,
            q,
            v,
            a,
            fluid: inputs.fluid,
            layers: inputs.layers.as_ref(),
            around: (&*runs).into(),
            tensions: &tensions[0],
        };
        let deformed = Deformed { cells: &rod.cells, mass: &rod.mass, edges, joints, a: a.as_chunks().0 };
        let jacobian = jacobian.map(|Linearisation { matrix, direction }| (matrix.rows_mut(), direction));
        forces.assemble(deformed, damped, moving, workspace, residual.as_chunks_mut().0, jacobian);
        self.subtract_loads(residual);
        Ok(())
    }
}

impl Dynamics {
    /// True if a guess preserves edge lengths, see [`better_guess`](System::better_guess).
    pub(crate) fn keeps_lengths(&self, direction: Direction) -> bool {
        let rod = &self.model.rod;
        PI * PI * rod.ea * direction.q >= rod.total_mass() * rod.length * direction.a
    }
}

impl System for Dynamics {
    fn nodes(&self) -> usize {
        self.model.rod.nodes
    }

    fn lumped_masses(&self) -> Option<&[f64]> {
        (!self.model.forces.are_inertial() && self.model.hinge.is_none()).then_some(&self.model.rod.mass)
    }

    fn length(&self) -> f64 {
        self.model.rod.length
    }

    fn move_to(&mut self, t: f64, state: &mut State) {
        self.evaluate(t);
        state.t = t;
        if let Some([x, y, _]) = &self.held {
            for (i, s) in [x, y].into_iter().enumerate() {
                let acceleration = if self.mechanics == Mechanics::Overdamped { 0.0 } else { s.acceleration };
                (state.q[i], state.v[i], state.a[i]) = (s.value, s.rate, acceleration);
            }
        }
        self.follow_hinge(state);
    }

    fn assemble(&mut self, state: &State, residual: &mut [f64], mut jacobian: Option<Linearisation<'_>>) -> Result<()> {
        let part = jacobian.as_mut().map(|j| Linearisation { matrix: j.matrix, direction: j.direction });
        let direction = part.as_ref().map(|part| part.direction);
        self.unconstrained(state, residual, part)?;
        if let Some(direction) = direction {
            self.couple_winches(direction);
        }
        if self.held.is_some() {
            residual[..2].fill(0.0);
            if let Some(Linearisation { matrix, .. }) = &mut jacobian {
                matrix.prescribe(0);
            }
            self.write_hinge(residual, jacobian);
        }
        Ok(())
    }

    fn coupling(&self) -> Option<&dyn Coupling> {
        self.model.forces.global().and_then(Force::global).map(|whole| whole as &dyn Coupling)
    }

    fn rank_ones(&self) -> &[RankOne] {
        self.winches.as_ref().map_or(&[], |winches| winches.couplings())
    }

    fn assemble_chain(
        &mut self,
        state: &State,
        direction: Direction,
        residual: &mut [f64],
        matrix: &mut ChainMatrix,
    ) -> Result<()> {
        self.assemble_links(state, direction, residual, matrix)
    }

    fn move_links(&self, increment: &[f64], state: &mut State) -> f64 {
        let moved = self.move_hinge_back(increment, state);
        self.move_links_back(increment, state);
        moved
    }

    fn move_back(&self, direction: Direction, increment: &mut [f64], state: &mut State) {
        if self.model.hinge.is_some() {
            move_arc_back(self.model.rod.nodes, direction, std::mem::take(&mut increment[0]), state);
        }
        state.move_all_back(direction, increment);
    }

    /// In the positions form, edge lengths are preserved if the step does not resolve the slowest stretching mode. A
    /// guess that turns edges too far would stretch them, and that tension, as large as the bending forces, costs
    /// Newton's method one or two iterations.
    fn better_guess(&self, from: &State, direction: Direction, to: &mut State) {
        to.guess_links(from);
        if !to.links.is_empty() || !self.keeps_lengths(direction) {
            return;
        }
        let rod = &self.model.rod;
        let free = self.held.is_none().then(|| rod.total_mass());
        let [q, v] = [&from.q, &from.v].map(|part| part.as_chunks().0);
        match &rod.damping {
            None => lengths::keep(q, to.nodes_mut(), &rod.mass, free, direction),
            Some(Damping { stretching, .. }) => {
                lengths::keep_tensions([q, v], to.nodes_mut(), &rod.mass, free, direction, stretching)
            }
        }
    }

    fn check_step(&self, before: &State, after: &State) -> Result<()> {
        // Each state with its own pose of the head, which may turn far within a step.
        let clamp_tangents =
            self.clamp_tangent_before(before).zip(self.clamp_tangent_of(after)).map(|(before, after)| [before, after]);
        if lengths::least_turn(clamp_tangents, before.q.as_chunks().0, after.q.as_chunks().0)
            .is_some_and(|cos| cos >= 0.0)
        {
            return Ok(()); // almost always
        }
        let [mut nodes, mut edges] = [[node(&before.q, 0), node(&after.q, 0)], clamp_tangents.unwrap_or_default()];
        let mut folded = None;
        let beyond = before.q.as_chunks().0.iter().zip(after.q.as_chunks().0).skip(1);
        for (k, (old, new)) in beyond.enumerate() {
            let next = [Vector2::from(*old), Vector2::from(*new)];
            let [old, new] = [next[0] - nodes[0], next[1] - nodes[1]];
            let turned = old.dot(&new);
            if turned < 0.0 && turned < REVERSED * old.norm() * new.norm() {
                return Err(Error::EdgeCollapse { time_s: after.t, node: k, length_m: new.norm() });
            }
            // Cosine of the turning angle at node k, times a positive number; zero if there is no edge before.
            let cos = [edges[0].dot(&old), edges[1].dot(&new)];
            if cos[0].min(cos[1]) < 0.0 && folded.is_none() {
                let sin = [edges[0].perp(&old), edges[1].perp(&new)];
                // The turning angle changed sign, and the path through ±180° is the shorter one.
                if sin[0] * sin[1] < 0.0 && cos[0] / cos[0].hypot(sin[0]) + cos[1] / cos[1].hypot(sin[1]) < 0.0 {
                    folded = Some(k);
                }
            }
            (nodes, edges) = (next, [old, new]);
        }
        folded.map_or(Ok(()), |node| Err(Error::FoldOver { time_s: after.t, node }))
    }

    fn residual_floor(&self, state: &State) -> f64 {
        let rod = &self.model.rod;
        let reach = state.q.iter().fold(rod.length, |max, x| max.max(x.abs()));
        let stiffest = rod.joint.iter().fold(0.0_f64, |max, b| max.max(*b));
        let shortest = rod.shortest();
        8.0 * f64::EPSILON * reach * (rod.ea / shortest + 4.0 * stiffest / (shortest * shortest))
    }
}
