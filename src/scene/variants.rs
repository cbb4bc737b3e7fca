//! Copies of a scene with one property changed, such as the number of nodes or the integrator, for studies, sweeps and estimates.

use std::collections::BTreeMap;

use super::material::DampingTime;
use super::solver::{DEFAULT_INTEGRATORS, full};
use super::value::{BoundedInteger, Finite, Positive, Tolerance};
use super::{Scene, SolverTable};
use crate::integrator::{Method, StepControl};
use crate::reduced::{ModelChoice, ModelKind};

/// The tolerances of [`Scene::reference`] and of its Newton's method, because forces of stiff rods are differences of tiny
/// stretches.
const REFERENCE_TOLERANCE: f64 = 1e-6;

const REFERENCE_NEWTON_TOLERANCE: f64 = 1e-13;

impl Scene {
    /// The scene with another number of nodes. Point loads move to the nearest node.
    pub fn with_nodes(&self, nodes: u64) -> Self {
        let mut scene = self.clone();
        scene.rod.nodes = BoundedInteger::nearest(nodes);
        let (old, new) = (self.rod.nodes.get() as f64, scene.rod.nodes.get() as f64);
        let (all, front) = (self.nodes() as i64, self.front() as i64);
        for load in scene.loads.iter_mut().flat_map(|loads| &mut loads.point) {
            let node = load.node.rem_euclid(all);
            let along = (node - front).max(0) as f64; // the centre of a body stays
            load.node = (along * (new - 1.0) / (old - 1.0)).round() as i64 + front.min(node);
        }
        scene
    }

    /// The scene on its own mesh, or on one with `most` nodes if its own is finer.
    pub fn with_nodes_up_to(&self, most: u64) -> Self {
        self.with_nodes(most.min(self.rod.nodes.get() as u64))
    }

    /// The scene with the full model and accurate adaptive steps, as a reference for reduced models.
    pub fn reference(&self) -> Self {
        let mut scene = self.with_newton_tolerance(REFERENCE_NEWTON_TOLERANCE);
        scene.solver = SolverTable {
            integrator: Some(DEFAULT_INTEGRATORS[0].to_string()),
            model: full(),
            time_step_s: None,
            tolerance: Some(Tolerance::constant(REFERENCE_TOLERANCE)),
            parameters: BTreeMap::new(),
            ..scene.solver
        };
        scene
    }

    /// The scene with another duration (s).
    pub fn with_duration(&self, duration: f64) -> Self {
        let mut scene = self.clone();
        scene.solver.duration_s = Positive::constant(duration);
        scene
    }

    /// The scene with another step control. Only adaptive integrators accept a tolerance.
    pub fn with_step_control(&self, step_control: StepControl) -> Self {
        let mut scene = self.clone();
        scene.solver.integrator = Some(self.integrator_name().to_string());
        (scene.solver.time_step_s, scene.solver.tolerance) = match step_control {
            StepControl::Fixed(step) => (Some(Positive::constant(step)), None),
            StepControl::Adaptive(tolerance) => (None, Some(Tolerance::constant(tolerance))),
        };
        scene
    }

    /// The scene with a tolerance of Newton's method of at most `most`.
    pub fn with_newton_tolerance(&self, most: f64) -> Self {
        let mut scene = self.clone();
        scene.solver.newton_tolerance = Some(Tolerance::constant(self.newton_tolerance().min(most)));
        scene
    }

    /// The scene with the full model and another integrator, whose parameters have `values`, in order.
    pub fn with_method(&self, method: &Method, values: &[f64]) -> Self {
        let mut scene = self.clone();
        scene.solver.model = full();
        scene.solver.integrator = Some(method.name.to_string());
        let named = method.parameters.iter().zip(values);
        scene.solver.parameters = named.map(|(p, value)| (p.name.to_string(), toml::Value::Float(*value))).collect();
        scene
    }

    /// The scene with another kind of model.
    pub fn with_model(&self, kind: &ModelKind) -> Self {
        let mut scene = self.clone();
        scene.solver.model = kind.name.to_string();
        scene
    }

    /// The scene with the full model if it leaves the model to the program.
    pub(super) fn named_model(mut self) -> Self {
        if ModelKind::named(&self.solver.model).is_none() {
            self.solver.model = full();
        }
        self
    }

    /// The scene with the drag law and the added mass that the program has chosen for `other`, a nearly equal scene, if both
    /// leave the choice to the program.
    pub fn with_fluid_of(&self, other: &Self) -> Self {
        let mut scene = self.clone();
        scene.fluid_choice = None;
        if let Some(fluid) = other.fluid_choice_or_fixed() {
            scene.set_fluid_choice(fluid);
        }
        scene
    }

    /// The scene as it is run after `choice`: a reduced model that `auto` chooses has its own step control, and the tolerance of Newton's
    /// method of the reference.
    pub fn with_choice(&self, choice: &ModelChoice) -> Self {
        if choice.reason.is_none() || choice.kind.method.is_none() {
            return self.with_model(choice.kind);
        }
        let step_control = match (self.reduced_model_step_control(), &choice.estimates) {
            (StepControl::Adaptive(tolerance), Some(estimates)) => {
                StepControl::Adaptive(tolerance.min(estimates.tolerance))
            }
            (step_control, _) => step_control,
        };
        self.with_step_control(step_control).with_model(choice.kind).with_newton_tolerance(REFERENCE_NEWTON_TOLERANCE)
    }

    /// The scene with Young's modulus, or the measured stiffness, multiplied by `factor`.
    pub fn with_modulus(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        let rod = &mut scene.rod;
        rod.youngs_modulus_pa = rod.youngs_modulus_pa.map(|modulus| Positive::constant(modulus.get() * factor));
        for stiffness in [&mut rod.axial_stiffness_n, &mut rod.bending_stiffness_n_m2] {
            *stiffness = stiffness.as_ref().map(|stiffness| stiffness.times(factor));
        }
        scene
    }

    /// The scene with the damping time `time` (s) of its material, in bending and stretching.
    pub fn with_damping_time(&self, time: f64) -> Self {
        let mut scene = self.clone();
        let rod = &mut scene.rod;
        (rod.damping_time_s, rod.loss_factor, rod.loss_frequency_hz) = (Some(DampingTime::constant(time)), None, None);
        scene
    }

    /// The scene with its point loads multiplied by `factor`.
    pub fn with_point_loads(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        for load in scene.loads.iter_mut().flat_map(|loads| &mut loads.point) {
            load.force_n = load.force_n.map(|force| Finite::constant(factor * force.get()));
        }
        scene
    }

    /// The scene with the amplitude of the actuation multiplied by `factor`.
    pub fn with_amplitude(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        scene.actuation = scene.actuation.map(|actuation| actuation.times(factor));
        scene
    }

    /// The scene with an initial angular velocity (rad/s) of the free rod.
    pub fn with_spin(&self, spin: f64) -> Self {
        let mut scene = self.clone();
        scene.start.spin_rad_s = Some(Finite::constant(spin));
        scene
    }
}
