//! Outputs that can be differentiated, with their derivatives with respect to positions, velocities, and parameters at a fixed
//! state.

use nalgebra::{Matrix2, Vector2};

use super::dot;
use crate::error::{Error, Result};
use crate::fluid::force::{self, StateDerivatives};
use crate::fluid::medium::Property;
use crate::fluid::{DENSITY, Force, Key, PowerKind};
use crate::head::Pose;
use crate::linear::{Block, Direction};
use crate::model::{DeformedRod, Dynamics, Model};
use crate::rod::damping::{KelvinVoigt, MaterialLaw};
use crate::rod::{add, bend, elastic, node};
use crate::system::State;
use crate::tendons::MAX_TENDONS;
use crate::variable::{self, VARIABLES};

/// A quantity at one time. Nodes count from the head, axes are x and y.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Coordinate of a node along an axis, m.
    Position(usize, usize),
    /// Velocity of a node along an axis, m/s.
    Velocity(usize, usize),
    /// Direction of the body's axis, rad.
    BodyAngle,
    /// Coordinate of the centre of mass along an axis, m.
    CentreOfMass(usize),
    /// Velocity of the centre of mass along an axis, m/s.
    CentreVelocity(usize),
    /// Component along an axis of the unit vector from node 1 to node 0, or for a held head of the direction in which it is held.
    HeadAxis(usize),
    /// Stretching energy, J.
    Stretching,
    /// Bending energy, J.
    Bending,
    /// Kinetic energy, J.
    Kinetic,
    /// Power of the moving natural curvature and of active moments, W.
    ActuationPower,
    /// Power dissipated in the material, W.
    MaterialPower,
    /// Power dissipated by drag, W.
    ViscousPower,
    /// Power dissipated in the wake, W.
    WakePower,
    /// Power dissipated in the spray, W.
    SprayPower,
    /// Power of other forces, W.
    OtherPower,
    /// Energy stored by external forces, J.
    Fluid,
    /// Power of the background flow, W.
    FlowPower,
    /// Power of constant loads, W.
    LoadPower,
    /// Power of a held head, W.
    HeadPower,
    /// Velocity of the background flow along an axis at the centre of mass, or at node 0 of a held head, m/s.
    Flow(usize),
    /// Force of the tail on a held head along an axis, N.
    HeadForce(usize),
    /// Moment of the tail on a held head about node 0, N m.
    HeadMoment,
    /// Resultant along an axis of the forces whose power is of this kind, or of inertial forces if `None`, N.
    Resultant(Option<PowerKind>, usize),
    /// Moment of the joint at a node, N m.
    JointMoment(usize),
    /// Strain of the outermost fibre at a joint, relative to the natural curvature.
    JointStrain(usize),
    /// Momentum of the rod along an axis, N s.
    RodMomentum(usize),
    /// Momentum of the fluid along an axis, N s.
    FluidMomentum(usize),
    /// Tension of a tendon, N.
    TendonTension(usize),
    /// Length of a tendon, m.
    TendonLength(usize),
    /// Power supplied by the drive of a tendon, W.
    TendonPower(usize),
    /// A quantity of a hinge.
    Hinge(HingeQuantity),
}

/// A quantity of the motor of a head on a hinge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HingeQuantity {
    /// Angle φ, rad.
    Angle,
    /// Its rate, rad/s.
    Spin,
    /// Torque T of the motor, N m.
    Torque,
    /// Power T φ̇ supplied by the motor, W.
    Power,
    /// T², N² m².
    TorqueSquare,
    /// The square of the commanded angle minus φ, rad².
    ErrorSquare,
}

/// Work summed over the steps as in [`RunMetrics`](crate::metrics::RunMetrics), J.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorkKind {
    /// Work of the moving natural curvature and of active moments.
    Actuation,
    /// Dissipated in the material.
    Material,
    /// Dissipated by drag.
    Viscous,
    /// Dissipated in the wake.
    Wake,
    /// Dissipated in the spray.
    Spray,
    /// Work of other forces.
    Other,
    /// Work of the background flow.
    Flow,
    /// Work of loads: gravity, point loads, buoyancy and forces over time.
    Load,
    /// Work of a held head.
    Head,
}

/// An output: a linear combination of quantities and work.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Quantities with their factors.
    pub now: Vec<(f64, Quantity)>,
    /// True if their initial values are subtracted.
    pub since_start: bool,
    /// Work since the start, with factors.
    pub work: Vec<(f64, WorkKind)>,
}

impl From<Quantity> for Output {
    fn from(quantity: Quantity) -> Self {
        Self { now: vec![(1.0, quantity)], since_start: false, work: Vec::new() }
    }
}

impl From<WorkKind> for Output {
    fn from(work: WorkKind) -> Self {
        Self { now: Vec::new(), since_start: false, work: vec![(1.0, work)] }
    }
}

impl Quantity {
    /// Returns an error for a node, joint or axis that `model` does not have.
    fn check(self, model: &Model) -> Result<()> {
        use Quantity as Q;
        let (nodes, joints) = (model.rod.nodes, model.rod.joints());
        let (within, allowed) = match self {
            Q::Position(k, _) | Q::Velocity(k, _) => (k < nodes, format!("nodes 0 to {}", nodes - 1)),
            Q::TendonTension(i) | Q::TendonLength(i) | Q::TendonPower(i) => {
                (i < model.tendons.len(), format!("tendons from 0, of which there are {}", model.tendons.len()))
            }
            Q::JointMoment(k) | Q::JointStrain(k) => {
                (joints.contains(&k), format!("joints at nodes {} to {}", joints.start, joints.end - 1))
            }
            _ => (true, String::new()),
        };
        if matches!(self, Q::HeadForce(_) | Q::HeadMoment) && model.head.is_none() {
            return Err(Error::Derivative {
                problem: format!("{self:?} does not exist in this scene; allowed: with a held head, clamped or driven"),
            });
        }
        if matches!(self, Q::Hinge(_)) && model.hinge.is_none() {
            return Err(Error::Derivative {
                problem: format!("{self:?} does not exist in this scene; allowed: with a head of kind \"hinged\""),
            });
        }
        let axis = match self {
            Q::Position(_, i) | Q::Velocity(_, i) | Q::CentreOfMass(i) | Q::CentreVelocity(i) | Q::HeadAxis(i) => i,
            Q::Flow(i) | Q::HeadForce(i) | Q::Resultant(_, i) | Q::RodMomentum(i) | Q::FluidMomentum(i) => i,
            _ => 0,
        };
        let problem = match (within, axis) {
            (false, _) => allowed,
            (true, 0 | 1) => return Ok(()),
            (true, _) => "axes 0 (x) and 1 (y)".to_string(),
        };
        Err(Error::Derivative { problem: format!("{self:?} does not exist in this scene; allowed: {problem}") })
    }
}

/// The names of the outputs in the table of variables.
fn names() -> impl Iterator<Item = &'static str> {
    let recorded = VARIABLES.iter().filter(|variable| variable.recorded && variable.name != "time_s");
    recorded.map(|variable| variable.name).chain(["tip_x_m", "tip_y_m"])
}

/// The error for a `name` that is not an output of `model`: a variable without a derivative, or not a variable of this scene.
fn not_there(name: &str, model: &Model) -> Error {
    let there = |name: &str| VARIABLES.iter().any(|variable| variable.name == name && variable.exists_in(model));
    if !there(name) {
        return variable::unknown(name, names().filter(|name| there(name)));
    }
    let allowed: Vec<&str> = names().filter(|name| there(name)).collect();
    Error::Derivative { problem: format!("`{name}` cannot be differentiated; allowed: {}", allowed.join(", ")) }
}

/// The quantity of one of that many `tendons` that `name` refers to.
fn tendon_reading(name: &str, tendons: usize) -> Option<Quantity> {
    let (number, what) = name.strip_prefix("tendon_")?.split_once('_')?;
    let reading: fn(usize) -> Quantity = match what {
        "tension_n" => Quantity::TendonTension,
        "length_m" => Quantity::TendonLength,
        "power_w" => Quantity::TendonPower,
        _ => return None,
    };
    let tendon = number.parse::<usize>().ok()?.checked_sub(1)?;
    (tendon < tendons).then(|| reading(tendon))
}

impl Output {
    /// Returns an error for an output that `model` does not have.
    pub(super) fn check(&self, model: &Model) -> Result<()> {
        self.now.iter().try_for_each(|(_, quantity)| quantity.check(model))
    }

    /// The same, minus its initial value.
    pub fn since_start(self) -> Self {
        Self { since_start: true, ..self }
    }

    /// The output of this name in the table of variables; all recorded variables except time are outputs.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn named(name: &str, model: &Model) -> Result<Self> {
        use Quantity as Q;
        let (mid, tip) = ((model.rod.nodes - 1) / 2, model.rod.nodes - 1);
        let moved = |k: usize, axis: usize| Self::from(Q::Position(k, axis)).since_start();
        let energy = [(1.0, Q::Stretching), (1.0, Q::Bending), (1.0, Q::Kinetic), (1.0, Q::Fluid)];
        Ok(match name {
            "x_com_m" => Q::CentreOfMass(0).into(),
            "y_com_m" => Q::CentreOfMass(1).into(),
            "stretching_energy_j" => Q::Stretching.into(),
            "bending_energy_j" => Q::Bending.into(),
            "kinetic_energy_j" => Q::Kinetic.into(),
            "actuation_power_w" => Q::ActuationPower.into(),
            "fluid_energy_j" => Q::Fluid.into(),
            "material_power_w" => Q::MaterialPower.into(),
            "viscous_power_w" => Q::ViscousPower.into(),
            "wake_power_w" => Q::WakePower.into(),
            "spray_power_w" => Q::SprayPower.into(),
            "other_power_w" => Q::OtherPower.into(),
            "load_power_w" => Q::LoadPower.into(),
            "head_power_w" if model.head.is_some() => Q::HeadPower.into(),
            "head_power_w" => Self { now: Vec::new(), since_start: false, work: Vec::new() },
            "flow_power_w" => Q::FlowPower.into(),
            "head_dx_m" => moved(0, 0),
            "head_dy_m" => moved(0, 1),
            "mid_dx_m" => moved(mid, 0),
            "mid_dy_m" => moved(mid, 1),
            "tip_dx_m" => moved(tip, 0),
            "tip_dy_m" => moved(tip, 1),
            "tip_x_m" => Q::Position(tip, 0).into(),
            "tip_y_m" => Q::Position(tip, 1).into(),
            "body_x_m" if model.rod.front == 1 => Q::Position(0, 0).into(),
            "body_y_m" if model.rod.front == 1 => Q::Position(0, 1).into(),
            "body_angle_rad" if model.rod.front == 1 => Q::BodyAngle.into(),
            "head_force_x_n" if model.head.is_some() => Q::HeadForce(0).into(),
            "head_force_y_n" if model.head.is_some() => Q::HeadForce(1).into(),
            "head_moment_n_m" if model.head.is_some() => Q::HeadMoment.into(),
            "hinge_angle_rad" if model.hinge.is_some() => Q::Hinge(HingeQuantity::Angle).into(),
            "hinge_spin_rad_s" if model.hinge.is_some() => Q::Hinge(HingeQuantity::Spin).into(),
            "hinge_torque_n_m" if model.hinge.is_some() => Q::Hinge(HingeQuantity::Torque).into(),
            "hinge_power_w" if model.hinge.is_some() => Q::Hinge(HingeQuantity::Power).into(),
            "drag_force_x_n" => Q::Resultant(Some(PowerKind::Drag), 0).into(),
            "drag_force_y_n" => Q::Resultant(Some(PowerKind::Drag), 1).into(),
            "reactive_force_x_n" => Q::Resultant(None, 0).into(),
            "reactive_force_y_n" => Q::Resultant(None, 1).into(),
            "wake_force_x_n" => Q::Resultant(Some(PowerKind::Wake), 0).into(),
            "wake_force_y_n" => Q::Resultant(Some(PowerKind::Wake), 1).into(),
            "rod_momentum_x_n_s" => Q::RodMomentum(0).into(),
            "rod_momentum_y_n_s" => Q::RodMomentum(1).into(),
            "fluid_momentum_x_n_s" => Q::FluidMomentum(0).into(),
            "fluid_momentum_y_n_s" => Q::FluidMomentum(1).into(),
            "net_displacement_m" => Self::from(Q::CentreOfMass(0)).since_start(),
            "actuation_work_j" => WorkKind::Actuation.into(),
            "material_work_j" => WorkKind::Material.into(),
            "viscous_work_j" => WorkKind::Viscous.into(),
            "wake_work_j" => WorkKind::Wake.into(),
            "spray_work_j" => WorkKind::Spray.into(),
            "other_work_j" => WorkKind::Other.into(),
            "load_work_j" => WorkKind::Load.into(),
            "head_work_j" if model.head.is_some() => WorkKind::Head.into(),
            "head_work_j" => Self { now: Vec::new(), since_start: false, work: Vec::new() },
            "flow_work_j" => WorkKind::Flow.into(),
            "numerical_dissipation_j" => {
                let now = energy.map(|(_, quantity)| (-1.0, quantity)).to_vec();
                let mut work = vec![
                    (1.0, WorkKind::Actuation),
                    (-1.0, WorkKind::Material),
                    (-1.0, WorkKind::Viscous),
                    (-1.0, WorkKind::Wake),
                    (-1.0, WorkKind::Spray),
                    (1.0, WorkKind::Flow),
                    (1.0, WorkKind::Load),
                    (1.0, WorkKind::Other),
                ];
                work.extend(model.head.is_some().then_some((1.0, WorkKind::Head)));
                Self { now, since_start: true, work }
            }
            _ => match tendon_reading(name, model.tendons.len()) {
                Some(quantity) => quantity.into(),
                None => return Err(not_there(name, model)),
            },
        })
    }
}

/// The derivatives of one output.
#[derive(Debug, Clone, Default)]
pub(super) struct Gradient {
    /// With respect to positions and velocities, in the order of a [`State`].
    pub(super) q: Vec<f64>,
    pub(super) v: Vec<f64>,
    /// With respect to accelerations.
    pub(super) a: Vec<f64>,
    /// With respect to the flow at the nodes, two entries per node, and at the body's centre.
    flow: Vec<f64>,
    flow_at_centre: Vector2<f64>,
    /// With respect to velocities, for one force.
    own: Vec<f64>,
    /// With respect to B_k, κ̄_k and dκ̄_k/dt, and to the change of the natural curvature over a step, one entry per node.
    pub(super) stiffness: Vec<f64>,
    pub(super) natural: Vec<f64>,
    pub(super) natural_rate: Vec<f64>,
    pub(super) natural_step: Vec<f64>,
    /// With respect to active moments M_k at constant κ̄_k, and to those at both ends of a step.
    pub(super) active: Vec<f64>,
    pub(super) active_ends: Vec<f64>,
    /// With respect to the tensions of tendons, in their edges alone.
    tension: [f64; MAX_TENDONS],
    /// With respect to a host's forces at this time, and to those at the other end of a step, two entries per node.
    pub(super) force: Vec<f64>,
    pub(super) force_beyond: Vec<f64>,
    /// With respect to parameters of the forces.
    keys: Vec<(Key, f64)>,
}

impl Gradient {
    pub(super) fn new(model: &Model, keys: &[Key]) -> Self {
        let nodes = model.rod.nodes;
        let [a, b, all] = [nodes, 2 * nodes, model.unknowns()].map(|n| vec![0.0; n]);
        Self {
            q: all.clone(),
            v: all.clone(),
            a: all.clone(),
            flow: b.clone(),
            flow_at_centre: Vector2::zeros(),
            own: all,
            force: b.clone(),
            force_beyond: b,
            stiffness: a.clone(),
            natural: a.clone(),
            natural_rate: a.clone(),
            natural_step: a.clone(),
            active: a.clone(),
            active_ends: a,
            tension: Default::default(),
            keys: keys.iter().map(|key| (*key, 0.0)).collect(),
        }
    }

    pub(super) fn clear(&mut self) {
        for part in [&mut self.q, &mut self.v, &mut self.a, &mut self.flow, &mut self.force, &mut self.force_beyond] {
            part.fill(0.0);
        }
        self.flow_at_centre = Vector2::zeros();
        for part in [&mut self.stiffness, &mut self.natural, &mut self.natural_rate, &mut self.natural_step] {
            part.fill(0.0);
        }
        self.active.fill(0.0);
        self.active_ends.fill(0.0);
        self.tension.fill(0.0);
        self.keys.iter_mut().for_each(|(_, by)| *by = 0.0);
    }

    /// Adds the derivatives through the tensions of winches, which follow from the positions.
    pub(super) fn follow_winches(&mut self, bent: &DeformedRod<'_>) {
        let DeformedRod { dynamics, .. } = bent;
        for (i, tendon) in dynamics.model.tendons.iter().enumerate() {
            let slope = dynamics.tension_slope(i);
            if slope == 0.0 {
                continue;
            }
            let of_joint = |k: usize| self.natural[k] / dynamics.model.rod.joint[k] + self.active[k];
            let size = self.tension[i] + tendon.offset * tendon.joints.clone().map(of_joint).sum::<f64>();
            tendon.visit_length_slopes(bent.edges(), bent.kappa(), |k, by| add(&mut self.q, k, by * (size * slope)));
        }
    }

    /// Calls `add`, which adds the derivatives of a quantity of `force`, and returns its result. Forces of a fluid depend on
    /// velocities relative to the flow.
    fn of_force<T>(&mut self, force: &dyn Force, add: impl FnOnce(StateDerivatives<'_>) -> T) -> T {
        let Self { q, v, a, flow, own, .. } = self;
        own.fill(0.0);
        let value = add(StateDerivatives { q, v: own, a });
        v.iter_mut().zip(&*own).for_each(|(by, own)| *by += own);
        if force.is_of_fluid() {
            flow.iter_mut().zip(&*own).for_each(|(by, own)| *by -= own);
        }
        value
    }

    /// The derivative along a change of the flow at the nodes (two entries per node) and at the body's centre, m/s.
    pub(super) fn by_flow(&self, nodes: &[f64], centre: Vector2<f64>) -> f64 {
        dot(&self.flow, nodes) + self.flow_at_centre.dot(&centre)
    }

    /// The derivative with respect to a parameter of the forces.
    pub(super) fn by_key(&self, key: Key) -> f64 {
        self.keys.iter().find(|(own, _)| *own == key).map_or(0.0, |(_, by)| *by)
    }
}

/// The change of controls and head over a step next to a state.
#[derive(Debug, Clone, Default)]
pub(super) struct StepInterval {
    /// Size of the step, s.
    pub(super) h: f64,
    /// Change of the natural curvature over the step, one entry per node.
    pub(super) natural: Vec<f64>,
    /// Sum of the active moments at both ends, one entry per node.
    pub(super) active: Vec<f64>,
    /// Sum of the tensions of each tendon at both ends, N.
    pub(super) tensions: [f64; MAX_TENDONS],
    /// Change of a host's forces over the step, two entries per node.
    pub(super) force: Vec<f64>,
    /// Poses of a held head at the start and the end.
    pub(super) poses: Option<[Pose; 2]>,
}

/// Values of the motor of a hinge and of winches at one end of a step. They follow from the state there, not from the time alone.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ActuatorState {
    /// Torque of the motor, N m.
    pub(super) torque: f64,
    /// Angle of the hinge, rad.
    pub(super) angle: f64,
    /// Tension (N) and length (m) of each tendon.
    pub(super) tensions: [f64; MAX_TENDONS],
    pub(super) lengths: [f64; MAX_TENDONS],
}

impl ActuatorState {
    pub(super) fn of(bent: &DeformedRod<'_>) -> Self {
        let DeformedRod { dynamics, .. } = bent;
        let mut lengths = [0.0; MAX_TENDONS];
        for (length, tendon) in lengths.iter_mut().zip(dynamics.model.tendons.iter()) {
            *length = tendon.length(bent.edges(), bent.kappa());
        }
        Self {
            torque: dynamics.hinge_torque(),
            angle: dynamics.held.map_or(0.0, |[_, _, angle]| angle.value),
            tensions: dynamics.tensions[0],
            lengths,
        }
    }
}

/// Derivatives at one state that all outputs share.
#[derive(Debug)]
pub(super) struct LocalDerivatives {
    /// ∇κ_k with respect to the nodes k−1, k, k+1.
    pub(super) slopes: Vec<[Vector2<f64>; 3]>,
    /// ∂κ₀/∂s with respect to the arc of a hinge; zero without one.
    arc_slope: f64,
    /// ℓ − ℓ₀ of each edge, m.
    stretches: Vec<f64>,
    /// For a damped rod, or one with active moments: ∇Ω_k with respect to the positions of the same nodes, where Ω is the rate of
    /// the turning angle at the joint; empty otherwise.
    spins: Vec<[Vector2<f64>; 3]>,
    /// ∂f/∂p for the parameters of forces, two entries per node.
    keys: Vec<(Key, Vec<f64>)>,
}

impl LocalDerivatives {
    pub(super) fn new(nodes: usize, keys: &[Key]) -> Self {
        Self {
            slopes: vec![[Vector2::zeros(); 3]; nodes],
            arc_slope: 0.0,
            stretches: vec![0.0; nodes - 1],
            spins: Vec::new(),
            keys: keys.iter().map(|key| (*key, vec![0.0; 2 * nodes])).collect(),
        }
    }

    /// ∂f/∂p for a parameter of the forces.
    pub(super) fn by_key(&self, key: Key) -> &[f64] {
        self.keys.iter().find(|(own, _)| *own == key).map_or(&[], |(_, by)| by)
    }

    /// Evaluates the derivatives at a state.
    pub(super) fn look(&mut self, bent: &DeformedRod<'_>) {
        let (dynamics, edges, kappa) = (bent.dynamics, bent.edges(), bent.kappa());
        for k in dynamics.model.rod.joints() {
            let s = bend::curvature_per_turning(kappa[k]);
            let across = |e: usize| edges[e].n() * (s * edges[e].per_length);
            let before = if k == 0 { Vector2::zeros() } else { across(k - 1) };
            let after = across(k);
            self.slopes[k] = [before, -before - after, after];
        }
        let turned_by_arc = dynamics.model.hinge.as_ref().map_or(0.0, |_| -1.0 / dynamics.model.rod.length);
        self.arc_slope = bend::curvature_per_turning(kappa[0]) * turned_by_arc;
        let cells = edges.iter().zip(dynamics.model.rod.cells.iter());
        self.stretches.iter_mut().zip(cells).for_each(|(own, (edge, cell))| *own = edge.length - cell.rest);
        self.spins.clear();
        if dynamics.rates.is_some() || dynamics.active.is_some() {
            self.spins.resize(self.slopes.len(), [Vector2::zeros(); 3]);
            let slope = |e: usize| bent.edge_rate(e).spin_slope(&edges[e], Direction::POSITIONS);
            for k in dynamics.model.rod.joints() {
                let before = if k == 0 { Vector2::zeros() } else { slope(k - 1) };
                let after = slope(k);
                self.spins[k] = [before, -before - after, after];
            }
        }
        let moving = bent.kinematics();
        for (key, by) in &mut self.keys {
            by.fill(0.0);
            dynamics.model.forces.add_by_parameter(key, &moving, by);
            if let Some(buoyancy) = dynamics.model.buoyancy.as_ref().filter(|_| *key == DENSITY) {
                by.iter_mut().zip(buoyancy).for_each(|(by, buoyancy)| *by -= buoyancy);
            }
        }
    }

    /// Adds `factor`·∇κ_k to `q`.
    #[inline]
    pub(super) fn scatter(&self, k: usize, factor: f64, q: &mut [f64]) {
        Self::scatter_slopes(self.slopes[k], k, factor, q);
        if let (0, Some(arc)) = (k, q.get_mut(2 * self.slopes.len())) {
            *arc += factor * self.arc_slope;
        }
    }

    /// Adds `factor`·∇Ω_k with respect to positions to `q`.
    fn scatter_spin(&self, k: usize, factor: f64, q: &mut [f64]) {
        Self::scatter_slopes(self.spins[k], k, factor, q);
    }

    #[inline]
    fn scatter_slopes([before, here, after]: [Vector2<f64>; 3], k: usize, factor: f64, q: &mut [f64]) {
        if k > 0 {
            add(q, k - 1, before * factor);
        }
        add(q, k, here * factor);
        add(q, k + 1, after * factor);
    }

    /// ∇κ_k·q.
    #[inline]
    pub(super) fn gather(&self, k: usize, q: &[f64]) -> f64 {
        // The slopes sum to zero.
        let ([before, _, after], here) = (self.slopes[k], node(q, k));
        let first = if k > 0 { before.dot(&(node(q, k - 1) - here)) } else { 0.0 };
        let arc = if k == 0 { q.get(2 * self.slopes.len()).map_or(0.0, |arc| self.arc_slope * arc) } else { 0.0 };
        first + after.dot(&(node(q, k + 1) - here)) + arc
    }
}

/// The state at which outputs are evaluated, with the derivatives that all outputs share.
#[derive(Clone, Copy)]
pub(super) struct OutputContext<'a> {
    pub(super) bent: DeformedRod<'a>,
    pub(super) point: &'a LocalDerivatives,
}

impl OutputContext<'_> {
    /// B_k(κ_k − κ̄_k), which is m_k without the part that resists the rate of κ_k; and κ_k − κ̄_k.
    fn moment(&self, k: usize) -> [f64; 2] {
        let deviation = self.bent.kappa()[k] - self.bent.dynamics.natural[k];
        [self.bent.dynamics.model.rod.joint[k] * deviation, deviation]
    }

    /// Adds `factor` times the gradient of the part of m_k that the moving natural curvature works against.
    fn add_driven(&self, k: usize, factor: f64, g: &mut Gradient) {
        let stiffness = self.bent.dynamics.model.rod.joint[k];
        self.point.scatter(k, factor * stiffness, &mut g.q);
        g.stiffness[k] += factor * self.moment(k)[1];
        g.natural[k] -= factor * stiffness;
        g.active[k] += factor;
        if self.bent.resisted_natural_rate(k) != 0.0 {
            self.add_resisting(k, factor, g);
        }
    }

    /// The curvature minus the natural one, and the part M_k/B_k of it due to active moments.
    fn strained(&self, k: usize) -> [f64; 2] {
        let by_moment = self.bent.active_moment(k)[0] / self.bent.dynamics.model.rod.joint[k];
        [self.bent.kappa()[k] - self.bent.given(k), by_moment]
    }

    /// The rate κ̇ = s Ω of a curvature; adds `factor` times its gradient: ½κΩ ∇κ + s ∇Ω with respect to positions, ∇κ with
    /// respect to velocities.
    fn add_curvature_rate(&self, k: usize, factor: f64, g: &mut Gradient) -> f64 {
        let (kappa, spin) = (self.bent.kappa()[k], self.bent.spin(k));
        let s = bend::curvature_per_turning(kappa);
        self.point.scatter(k, factor * 0.5 * kappa * spin, &mut g.q);
        self.point.scatter_spin(k, factor * s, &mut g.q);
        self.point.scatter(k, factor, &mut g.v);
        s * spin
    }

    /// Adds `factor` times the gradient of the part of m_k that resists the rate r = s Ω − κ̄′.
    fn add_resisting(&self, k: usize, factor: f64, g: &mut Gradient) {
        let Some(KelvinVoigt { damping, rates }) = self.bent.dynamics.damped() else { return };
        self.add_curvature_rate(k, factor * damping.moment(&self.bent.dynamics.model.rod, k, 1.0), g);
        g.stiffness[k] += factor * damping.bending[k] * rates.joints[k];
        g.natural_rate[k] -= factor * self.bent.resisted_natural_rate(k);
    }

    /// The energy stored by the forces whose power is of this `kind`, J (`rate` 0), or the power that they supply, W (1). Adds
    /// `factor` times its derivatives.
    fn stored(&self, kind: Option<PowerKind>, rate: usize, factor: f64, g: &mut Gradient) -> f64 {
        let moving = self.bent.kinematics();
        let mut sum = 0.0;
        for force in self.bent.dynamics.model.forces.iter().filter(|force| force.power_kind() == kind) {
            sum += g.of_force(force, |by| match rate {
                0 => force.energy(&moving, factor, Some(by)),
                _ => force.energy_by_time(&moving, factor, Some(by)),
            });
            for (key, by) in &mut g.keys {
                let mut unused = vec![0.0; self.bent.state.q.len()];
                *by += factor * force.add_by_parameter(key, &moving, &mut unused)[rate];
            }
        }
        sum
    }

    /// The component along `along` of the flow at the centre of mass, or at node 0 of a held head, m/s. Adds `factor` times its
    /// derivatives.
    fn flow_of_body(&self, along: Vector2<f64>, factor: f64, g: &mut Gradient) -> f64 {
        let DeformedRod { dynamics, state } = self.bent;
        let (rod, fluid) = (&dynamics.model.rod, dynamics.inputs.fluid);
        g.flow_at_centre += along * factor;
        let Some(layers) = &dynamics.inputs.layers else { return fluid.flow.dot(&along) };
        let held = dynamics.model.head.is_some();
        let height = layers.height(centre_of(dynamics, state));
        let here = layers.at(fluid, height);
        let slope = layers.normal * (factor * here.slope.flow.dot(&along));
        if held {
            add(&mut g.q, 0, slope);
        } else {
            rod.mass.iter().enumerate().for_each(|(k, m)| add(&mut g.q, k, slope * (m / rod.total_mass())));
        }
        for (key, by) in &mut g.keys {
            if let Some(property) = Property::of(key) {
                *by += factor * layers.by_property(fluid, property, height).fluid.flow.dot(&along);
            }
        }
        here.fluid.flow.dot(&along)
    }

    /// The power dissipated by the forces whose power is of this `kind`, W. Adds `factor` times its derivatives.
    fn power_to(&self, kind: PowerKind, factor: f64, g: &mut Gradient) -> f64 {
        let moving = self.bent.kinematics();
        let mut power = 0.0;
        for of_fluid in [true, false] {
            let chosen = |force: &dyn Force| force.power_kind() == Some(kind) && force.is_of_fluid() == of_fluid;
            let flow = |k: usize| if of_fluid { moving.flow(k) } else { Vector2::zeros() };
            let against = |k: usize| node(&self.bent.state.v, k) - flow(k);
            power += self.power_along(chosen, against, factor, g);
            for force in self.bent.dynamics.model.forces.iter().filter(|force| chosen(*force)) {
                force::visit_alone(force, &moving, |k, force| add(&mut g.v, k, force * factor));
            }
            if of_fluid {
                self.add_by_flow(chosen, factor, g);
            }
        }
        power
    }

    /// Adds `factor` times the derivatives of −Σ F·u with respect to the flow u and to the position at which it is evaluated, at
    /// constant forces F of the `chosen` kind.
    fn add_by_flow(&self, chosen: impl Fn(&dyn Force) -> bool, factor: f64, g: &mut Gradient) {
        let moving = self.bent.kinematics();
        for force in self.bent.dynamics.model.forces.iter().filter(|force| chosen(*force)) {
            force::visit_alone(force, &moving, |k, force| {
                add(&mut g.flow, k, force * -factor);
                if moving.layers.is_some() {
                    add(&mut g.q, k, moving.normal() * (-factor * force.dot(&moving.here(k).slope.flow)));
                }
            });
        }
    }

    /// Adds `factor` times the gradient of the length of tendon `i`.
    fn add_length(&self, i: usize, factor: f64, g: &mut Gradient) {
        let tendon = &self.bent.dynamics.model.tendons[i];
        tendon.visit_slopes(self.bent.edges(), |k, slope| add(&mut g.q, k, slope * factor));
        tendon.joints.clone().for_each(|k| self.point.scatter(k, -factor * tendon.offset, &mut g.q));
    }

    /// Adds `factor` times the gradient of the tension of tendon `i`, which is nonzero for a winch.
    fn add_tension(&self, i: usize, factor: f64, g: &mut Gradient) {
        self.add_length(i, factor * self.bent.dynamics.tension_slope(i), g);
    }

    /// The torque T of the motor of a hinge (N m), its derivative with respect to the arc (N), and the angle of the hinge, rad.
    fn motor(&self) -> [f64; 3] {
        let dynamics = self.bent.dynamics;
        let (Some(hinge), Some([_, _, angle])) = (&dynamics.model.hinge, &dynamics.held) else { return [0.0; 3] };
        let [torque, given] = hinge.torque(dynamics.command, angle.value);
        [torque, -hinge.stiffness * given / dynamics.model.rod.length, angle.value]
    }

    /// Σ F·w over the nodes, with F of the `chosen` forces; adds `factor` times its derivatives at constant w.
    fn power_along(
        &self,
        chosen: impl Fn(&dyn Force) -> bool,
        w: impl Fn(usize) -> Vector2<f64>,
        factor: f64,
        g: &mut Gradient,
    ) -> f64 {
        let moving = self.bent.kinematics();
        let mut power = 0.0;
        for force in self.bent.dynamics.model.forces.iter().filter(|force| chosen(*force)) {
            force::visit_alone(force, &moving, |k, force| power += force.dot(&w(k)));
            if force.power_kind() == Some(PowerKind::Drive) {
                for (by, tendon) in g.tension.iter_mut().zip(self.bent.dynamics.model.tendons.iter()) {
                    tendon.visit_slopes(self.bent.edges(), |k, slope| *by += factor * slope.dot(&w(k)));
                }
            }
            g.of_force(force, |mut by| {
                force::add_slopes(force, &moving, 0..moving.edges.len(), |k| w(k) * factor, &mut by);
            });
            for (key, by) in &mut g.keys {
                let mut opposing = vec![0.0; self.bent.state.q.len()];
                force.add_by_parameter(key, &moving, &mut opposing);
                *by += factor * (0..=moving.edges.len()).map(|k| node(&opposing, k).dot(&w(k))).sum::<f64>();
            }
        }
        power
    }

    /// Σ W·x over the nodes, with the loads W. Adds `factor` times its derivatives with respect to x to the part of `g` selected
    /// by `by`, and with respect to the density, on which buoyancy depends.
    fn along_loads(&self, x: &[f64], factor: f64, g: &mut Gradient, by: impl Fn(&mut Gradient) -> &mut [f64]) -> f64 {
        let dynamics = self.bent.dynamics;
        let mut sum = 0.0;
        g.force.iter_mut().zip(x).for_each(|(by, x)| *by += factor * x);
        for k in (0..dynamics.model.rod.nodes).filter(|_| dynamics.is_loaded()) {
            let load = dynamics.load(k);
            add(by(g), k, load * factor);
            sum += load.dot(&node(x, k));
        }
        if let Some(buoyancy) = &dynamics.model.buoyancy {
            let slope: f64 = buoyancy.iter().zip(x).map(|(buoyancy, x)| buoyancy * x).sum();
            g.keys.iter_mut().filter(|(key, _)| *key == DENSITY).for_each(|(_, by)| *by += factor * slope);
        }
        sum
    }

    /// The component along `along` of the force (N) that a held head exerts beyond the inertia of node 0; adds `factor` times its
    /// derivative.
    fn push(&self, along: Vector2<f64>, factor: f64, g: &mut Gradient) -> f64 {
        let (dynamics, rod) = (self.bent.dynamics, &self.bent.dynamics.model.rod);
        let edges = self.bent.edges();
        let joints = [0, 1].map(|k| self.bent.joint(k));
        let tension = self.bent.tension(0);
        let mut force = -elastic::force(&edges[0], tension, &joints[0], &joints[1]) - dynamics.load(0);
        // With respect to the vectors of edges 0 and 1, and to their rates.
        let joints_of_edge = [&joints[0], &joints[1]];
        let next = elastic::stiffness(&edges[0], rod.cells[0].axial, tension, joints_of_edge, -factor);
        let coupling = rod.joints().contains(&1).then(|| elastic::coupling(&edges[0], &edges[1], &joints[1], -factor));
        let mut add_slopes = |next: Block, coupling: Option<Block>, by: fn(&mut Gradient) -> &mut [f64]| {
            let blocks = [Some(next), coupling].into_iter().enumerate();
            for (e, block) in blocks.filter_map(|(e, block)| Some((e, block?))) {
                let slope = Matrix2::from(block.transpose()) * along;
                add(by(g), e, -slope);
                add(by(g), e + 1, slope);
            }
        };
        match dynamics.damped() {
            None => add_slopes(next, coupling, |g| &mut g.q),
            Some(damped) => {
                let (cell, ends) = (&rod.cells[0], [&edges[0], &edges[1]]);
                let direction = Direction { q: factor, v: 0.0, a: 0.0 };
                let next = damped.own(0, &edges[0], cell, next, direction);
                let coupling = coupling.map(|coupling| damped.couplings(1, ends, coupling, direction)[0]);
                add_slopes(next, coupling, |g| &mut g.q);
                let direction = Direction { q: 0.0, v: factor, a: 0.0 };
                let next = damped.own(0, &edges[0], cell, Block::ZERO, direction);
                let coupling = coupling.map(|_| damped.couplings(1, ends, Block::ZERO, direction)[0]);
                add_slopes(next, coupling, |g| &mut g.v);
            }
        }
        if dynamics.model.hinge.is_some() {
            // The couple of its joint acts across the first edge.
            let per_arc = factor * along.dot(&edges[0].n()) * edges[0].per_length / rod.length;
            let viscosity = dynamics.damped().map_or(0.0, |damped| damped.rates.viscosity[0]);
            let arc = 2 * rod.nodes;
            g.q[arc] += per_arc * joints[0].stiffness;
            g.v[arc] += per_arc * viscosity;
        }
        for (by, tendon) in g.tension.iter_mut().zip(dynamics.model.tendons.iter()) {
            if tendon.edges.contains(&0) {
                *by -= factor * along.dot(&edges[0].t);
            }
        }
        for k in [0, 1].into_iter().filter(|k| rod.joints().contains(k)) {
            let size = factor * self.point.slopes[k][1 - k].dot(&along);
            g.stiffness[k] += size * (self.moment(k)[1] + self.bent.resisted_curvature(k));
            g.natural[k] -= size * rod.joint[k];
            g.natural_rate[k] -= size * self.bent.resisted_natural_rate(k);
        }
        let moving = self.bent.kinematics();
        let on_head = |k: usize| if k == 0 { along * factor } else { Vector2::zeros() };
        for own in dynamics.model.forces.iter() {
            g.of_force(own, |mut by| force::add_slopes(own, &moving, 0..1, on_head, &mut by));
        }
        dynamics.model.forces.on_edges(&moving, None, 0..1, |_, on| force += on.force(0));
        for (key, by) in &mut g.keys {
            *by += factor * node(self.point.by_key(key), 0).dot(&along);
        }
        add(&mut g.force, 0, along * -factor);
        force.dot(&along)
    }
}

/// The point at which the background flow is evaluated: the centre of mass, or node 0 of a held head.
pub(super) fn centre_of(dynamics: &Dynamics, state: &State) -> Vector2<f64> {
    if dynamics.model.head.is_some() { node(&state.q, 0) } else { dynamics.model.rod.mean(&state.q) }
}

/// The unit vector of an axis.
fn axis(i: usize) -> Vector2<f64> {
    if i == 0 { Vector2::x() } else { Vector2::y() }
}

impl Quantity {
    /// True for what positions and velocities of nodes alone determine: no input changes it but through them.
    pub(super) fn is_of_nodes(self) -> bool {
        matches!(
            self,
            Self::Position(..)
                | Self::Velocity(..)
                | Self::BodyAngle
                | Self::CentreOfMass(_)
                | Self::CentreVelocity(_)
                | Self::RodMomentum(_)
        )
    }

    /// The value; adds `factor` times its derivatives.
    pub(super) fn add(self, at: &OutputContext<'_>, factor: f64, g: &mut Gradient) -> f64 {
        let DeformedRod { dynamics, state } = at.bent;
        let rod = &dynamics.model.rod;
        match self {
            Self::Position(k, i) => {
                g.q[2 * k + i] += factor;
                state.q[2 * k + i]
            }
            Self::BodyAngle => {
                let along = node(&state.q, 1) - node(&state.q, 0);
                let turn = Vector2::new(-along.y, along.x) * (factor / along.norm_squared());
                add(&mut g.q, 0, -turn);
                add(&mut g.q, 1, turn);
                along.y.atan2(along.x)
            }
            Self::Velocity(k, i) => {
                g.v[2 * k + i] += factor;
                state.v[2 * k + i]
            }
            Self::CentreOfMass(i) => {
                let part = factor / rod.total_mass();
                for (k, m) in rod.mass.iter().enumerate() {
                    g.q[2 * k + i] += part * m;
                }
                rod.mean(&state.q)[i]
            }
            Self::CentreVelocity(i) => {
                let part = factor / rod.total_mass();
                for (k, m) in rod.mass.iter().enumerate() {
                    g.v[2 * k + i] += part * m;
                }
                rod.mean(&state.v)[i]
            }
            Self::Flow(i) => at.flow_of_body(axis(i), factor, g),
            Self::HeadAxis(i) if dynamics.held.is_some() => {
                let angle = dynamics.held.map_or(0.0, |[_, _, angle]| angle.value);
                if dynamics.model.hinge.is_some() {
                    g.q[2 * rod.nodes] += factor * [angle.sin(), -angle.cos()][i] / rod.length;
                }
                -[angle.cos(), angle.sin()][i]
            }
            Self::HeadAxis(i) => {
                let edge = &at.bent.edges()[0];
                let turn = edge.n() * (factor * edge.per_length * edge.n()[i]);
                add(&mut g.q, 0, turn);
                add(&mut g.q, 1, -turn);
                -edge.t[i]
            }
            Self::Stretching => {
                let mut energy = 0.0;
                let cells = at.bent.edges().iter().zip(rod.cells.iter()).zip(&at.point.stretches);
                for (k, ((edge, cell), own)) in cells.enumerate() {
                    let pull = edge.t * (factor * cell.tension(edge));
                    add(&mut g.q, k, -pull);
                    add(&mut g.q, k + 1, pull);
                    // To first order in ℓ₀, because in a perturbed scene ℓ₀ changes by far more than the edge is stretched.
                    energy += cell.axial * own * (edge.length - cell.rest - 0.5 * own);
                }
                energy
            }
            Self::Bending => {
                let mut energy = 0.0;
                for k in rod.joints() {
                    let [strained, by_moment] = at.strained(k);
                    let moment = rod.joint[k] * strained;
                    at.point.scatter(k, factor * moment, &mut g.q);
                    g.stiffness[k] += factor * strained * (0.5 * strained - by_moment);
                    g.natural[k] -= factor * moment;
                    g.active[k] += factor * strained;
                    energy += 0.5 * moment * strained;
                }
                energy
            }
            Self::Kinetic => {
                let mut energy = 0.0;
                for (k, m) in rod.mass.iter().enumerate() {
                    let v = node(&state.v, k);
                    add(&mut g.v, k, v * (factor * m));
                    energy += 0.5 * m * v.norm_squared();
                }
                if let (Some(hinge), Some([_, _, angle])) = (&dynamics.model.hinge, &dynamics.held) {
                    g.v[2 * rod.nodes] += factor * hinge.inertia * angle.rate / rod.length;
                    energy += 0.5 * hinge.inertia * angle.rate * angle.rate;
                }
                energy
            }
            Self::ActuationPower => {
                let mut power = 0.0;
                for k in rod.joints() {
                    let (moment, rate) = (at.bent.driven_moment(k), at.bent.given_rate(k));
                    at.add_driven(k, -factor * rate, g);
                    if !dynamics.model.active_moments {
                        // With a wave of moments, the natural curvature has no rate here, see `Controls`.
                        g.natural_rate[k] -= factor * moment;
                        // Excludes the parts of that rate due to tendons, and their decrease with the stiffness of the joint.
                        let softening = at.bent.active_moment(k)[1] / rod.joint[k].powi(2);
                        g.stiffness[k] -= factor * moment * softening;
                    }
                    power -= moment * rate;
                    if let Some(active) = &dynamics.active {
                        let moment = active.moment[k];
                        let rate = at.add_curvature_rate(k, factor * moment, g);
                        g.active[k] += factor * rate;
                        power += moment * rate;
                    }
                }
                power - at.power_to(PowerKind::Drive, -factor, g)
            }
            Self::MaterialPower => {
                let mut bearing = 0.0;
                if let (Some(hinge), Some([_, _, angle])) = (&dynamics.model.hinge, &dynamics.held) {
                    g.v[2 * rod.nodes] += 2.0 * factor * hinge.damping * angle.rate / rod.length;
                    bearing = hinge.damping * angle.rate * angle.rate;
                }
                let Some(KelvinVoigt { damping, rates }) = dynamics.damped() else { return bearing };
                for k in rod.joints() {
                    // P = Bτr²: the gradient of Bτr, and of the other factor r.
                    let rate = rates.joints[k];
                    at.add_resisting(k, 2.0 * factor * rate, g);
                    g.stiffness[k] -= factor * damping.bending[k] * rate * rate;
                }
                for (e, (edge, rate)) in at.bent.edges().iter().zip(&rates.edges).enumerate() {
                    let size = 2.0 * factor * damping.tension(rod, e, rate.stretching);
                    for (by, direction) in [(&mut g.q, Direction::POSITIONS), (&mut g.v, Direction::VELOCITIES)] {
                        let slope = rate.stretching_slope(edge, direction) * size;
                        add(by, e, -slope);
                        add(by, e + 1, slope);
                    }
                }
                damping.power(rod, rates) + bearing
            }
            Self::ViscousPower => at.power_to(PowerKind::Drag, factor, g),
            Self::WakePower => at.power_to(PowerKind::Wake, factor, g),
            Self::SprayPower => at.power_to(PowerKind::Spray, factor, g),
            Self::OtherPower => at.stored(None, 1, factor, g) - at.power_to(PowerKind::Other, -factor, g),
            Self::FlowPower => {
                let of_fluid = |force: &dyn Force| force.is_of_fluid();
                let moving = at.bent.kinematics();
                let power = at.power_along(of_fluid, |k| -moving.flow(k), factor, g);
                at.add_by_flow(of_fluid, factor, g);
                power - at.power_to(PowerKind::Flow, -factor, g)
            }
            Self::Fluid => at.stored(None, 0, factor, g),
            Self::LoadPower => {
                at.along_loads(&state.v, factor, g, |g| &mut g.v) - at.power_to(PowerKind::Load, -factor, g)
            }
            Self::HeadForce(i) => {
                let inertia = dynamics.held.map_or(0.0, |pose| rod.mass[0] * pose[i].acceleration);
                -inertia - at.push(axis(i), -factor, g)
            }
            Self::HeadMoment => Self::JointMoment(0).add(at, factor, g),
            Self::Resultant(kind, i) => {
                let chosen = |force: &dyn Force| force.power_kind() == kind;
                -at.power_along(chosen, |_| axis(i), -factor, g)
            }
            Self::JointMoment(k) => {
                let (moment, joint) = (at.moment(k), at.bent.joint(k));
                let s = bend::curvature_per_turning(at.bent.kappa()[k]);
                at.point.scatter(k, factor * joint.stiffness / s, &mut g.q);
                g.stiffness[k] += factor * s * (moment[1] + at.bent.resisted_curvature(k));
                g.natural[k] -= factor * s * rod.joint[k];
                if let Some(KelvinVoigt { rates, .. }) = dynamics.damped() {
                    let viscosity = factor * rates.viscosity[k];
                    at.point.scatter_spin(k, viscosity, &mut g.q);
                    at.point.scatter(k, viscosity / s, &mut g.v);
                    g.natural_rate[k] -= factor * s * at.bent.resisted_natural_rate(k);
                }
                joint.couple
            }
            Self::JointStrain(k) => {
                let per = rod.sections.at(rod.xi(k)).outer / (rod.joint_part(k) * rod.spacing);
                let ([strained, by_moment], stiffness) = (at.strained(k), rod.joint[k]);
                at.point.scatter(k, factor * per, &mut g.q);
                g.natural[k] -= factor * per;
                g.active[k] += factor * per / stiffness;
                g.stiffness[k] -= factor * per * by_moment / stiffness;
                strained * per
            }
            Self::RodMomentum(i) => {
                let mut momentum = 0.0;
                for (k, m) in rod.mass.iter().enumerate() {
                    g.v[2 * k + i] += factor * m;
                    momentum += m * state.v[2 * k + i];
                }
                momentum
            }
            Self::FluidMomentum(i) => {
                let moving = at.bent.kinematics();
                let mut momentum = 0.0;
                for force in dynamics.model.forces.iter().filter(|force| force.power_kind().is_none()) {
                    momentum += g.of_force(force, |by| force.momentum(&moving, axis(i), factor, Some(by)));
                    for (key, by) in &mut g.keys {
                        // Linear in the density, and independent of other parameters.
                        *by += factor * force.momentum_by_parameter(key, &moving, axis(i));
                    }
                }
                momentum
            }
            Self::TendonTension(i) => {
                at.add_tension(i, factor, g);
                dynamics.tensions[0][i]
            }
            Self::TendonLength(i) => {
                at.add_length(i, factor, g);
                let tendon = &dynamics.model.tendons[i];
                tendon.length(at.bent.edges(), at.bent.kappa())
            }
            Self::TendonPower(i) => {
                // −T dΛ/dt.
                let (tendon, tension) = (&dynamics.model.tendons[i], dynamics.tensions[0][i]);
                let mut rate = 0.0;
                for e in tendon.edges.clone() {
                    let (edge, stretching) = (&at.bent.edges()[e], at.bent.edge_rate(e));
                    for (by, direction) in [(&mut g.q, Direction::POSITIONS), (&mut g.v, Direction::VELOCITIES)] {
                        let slope = stretching.stretching_slope(edge, direction) * (-factor * tension);
                        add(by, e, -slope);
                        add(by, e + 1, slope);
                    }
                    rate += stretching.stretching;
                }
                for k in tendon.joints.clone() {
                    rate -= tendon.offset * at.add_curvature_rate(k, factor * tension * tendon.offset, g);
                }
                at.add_tension(i, -factor * rate, g);
                -tension * rate
            }
            Self::Hinge(reading) => {
                let Some([_, _, angle]) = dynamics.held else { return 0.0 };
                let (arc, per_arc) = (2 * rod.nodes, 1.0 / rod.length);
                let [torque, slope, _] = at.motor();
                let error = dynamics.command.angle - angle.value;
                // The value, and its derivatives with respect to the arc and to the rate of the arc.
                let (value, by_arc, by_rate) = match reading {
                    HingeQuantity::Angle => (angle.value, per_arc, 0.0),
                    HingeQuantity::Spin => (angle.rate, 0.0, per_arc),
                    HingeQuantity::Torque => (torque, slope, 0.0),
                    HingeQuantity::Power => (torque * angle.rate, slope * angle.rate, torque * per_arc),
                    HingeQuantity::TorqueSquare => (torque * torque, 2.0 * torque * slope, 0.0),
                    HingeQuantity::ErrorSquare => (error * error, -2.0 * error * per_arc, 0.0),
                };
                g.q[arc] += factor * by_arc;
                g.v[arc] += factor * by_rate;
                value
            }
            Self::HeadPower => {
                let Some([x, y, angle]) = dynamics.held else { return 0.0 };
                let v = Vector2::new(x.rate, y.rate);
                let inertia = v.dot(&Vector2::new(x.acceleration, y.acceleration)) * rod.mass[0];
                let push = at.push(v, factor, g);
                let turning = match &dynamics.model.hinge {
                    Some(_) => Self::Hinge(HingeQuantity::Power).add(at, factor, g),
                    None => -angle.rate * Self::HeadMoment.add(at, -factor * angle.rate, g),
                };
                push + inertia + turning
            }
        }
    }
}

impl WorkKind {
    /// The contribution of the state at one end of `span` (its end, or its beginning) to the work over it; adds `factor` times
    /// its derivatives. The work of a motor and of winches depends on both ends: it is included if their values at the other end,
    /// `beyond`, are known, and omitted otherwise.
    pub(super) fn add(
        self,
        at: &OutputContext<'_>,
        (span, beyond): (&StepInterval, Option<&ActuatorState>),
        end: bool,
        factor: f64,
        g: &mut Gradient,
    ) -> f64 {
        let half = 0.5 * span.h;
        let rod = &at.bent.dynamics.model.rod;
        match self {
            Self::Material => half * Quantity::MaterialPower.add(at, half * factor, g),
            Self::Viscous => half * Quantity::ViscousPower.add(at, half * factor, g),
            Self::Wake => half * Quantity::WakePower.add(at, half * factor, g),
            Self::Spray => half * Quantity::SprayPower.add(at, half * factor, g),
            Self::Other => half * Quantity::OtherPower.add(at, half * factor, g),
            Self::Flow => half * Quantity::FlowPower.add(at, half * factor, g),
            Self::Load => {
                // The mean of the forces at both ends, times the displacement between them.
                let (q, sign) = (&at.bent.state.q, if end { 1.0 } else { -1.0 });
                let mut work = at.along_loads(q, sign * factor, g, |g| &mut g.q);
                work -= at.stored(Some(PowerKind::Load), 0, -sign * factor, g);
                for (((by, beyond), to), (q, change)) in
                    g.force.iter_mut().zip(&mut g.force_beyond).zip(&mut g.q).zip(q.iter().zip(&span.force))
                {
                    let half = 0.5 * sign * factor * q;
                    *by -= half;
                    *beyond += half;
                    *to -= 0.5 * factor * change;
                    work -= 0.5 * sign * q * change;
                }
                sign * work
            }
            Self::Actuation => {
                let mut work = 0.0;
                for k in rod.joints() {
                    let moment = at.bent.driven_moment(k);
                    at.add_driven(k, -0.5 * factor * span.natural[k], g);
                    g.natural_step[k] -= 0.5 * factor * moment;
                    work -= 0.5 * moment * span.natural[k];
                    // The mean of the active moments at both ends, times the change of the curvature between them.
                    let (half, kappa) = (if end { 0.5 } else { -0.5 }, at.bent.kappa()[k]);
                    at.point.scatter(k, half * factor * span.active[k], &mut g.q);
                    g.active_ends[k] += half * factor * kappa;
                    work += half * kappa * span.active[k];
                }
                // Likewise for the tensions of tendons, times the change of the length of their edges.
                for (i, (tendon, tensions)) in at.bent.dynamics.model.tendons.iter().zip(&span.tensions).enumerate() {
                    if tendon.winch().is_some() {
                        let Some(beyond) = beyond else { continue };
                        let length = tendon.length(at.bent.edges(), at.bent.kappa());
                        let sum = at.bent.dynamics.tensions[0][i] + beyond.tensions[i];
                        let sign = if end { 1.0 } else { -1.0 };
                        let wound = sign * (beyond.lengths[i] - length);
                        at.add_length(i, -0.5 * sign * factor * sum, g);
                        at.add_tension(i, 0.5 * factor * wound, g);
                        work += 0.5 * sum * wound;
                        continue;
                    }
                    let size = if end { -0.5 * tensions } else { 0.5 * tensions };
                    let edges = at.bent.edges();
                    tendon.visit_slopes(edges, |k, slope| add(&mut g.q, k, slope * (size * factor)));
                    work += size * tendon.edge_length(edges);
                }
                work
            }
            Self::Head => {
                let Some([from, to]) = &span.poses else { return 0.0 };
                let moved = Vector2::new(to[0].value - from[0].value, to[1].value - from[1].value);
                let speed = |pose: &Pose| pose[0].rate.powi(2) + pose[1].rate.powi(2);
                let inertia = 0.5 * rod.mass[0] * if end { speed(to) } else { -speed(from) };
                let push = at.push(moved, 0.5 * factor, g);
                let turning = match (&at.bent.dynamics.model.hinge, beyond) {
                    (Some(_), None) => 0.0,
                    (Some(_), Some(beyond)) => {
                        let [torque, slope, angle] = at.motor();
                        let (sum, sign) = (torque + beyond.torque, if end { 1.0 } else { -1.0 });
                        let turned = sign * (angle - beyond.angle);
                        g.q[2 * rod.nodes] += 0.5 * factor * (sign * sum / rod.length + slope * turned);
                        0.5 * sum * turned
                    }
                    (None, _) => {
                        let turned = to[2].value - from[2].value;
                        -0.5 * turned * Quantity::HeadMoment.add(at, -0.5 * factor * turned, g)
                    }
                };
                0.5 * push + inertia + turning
            }
        }
    }
}
