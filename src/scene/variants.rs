//! The same scene otherwise: what studies, sweeps and estimates make of it.

use std::collections::BTreeMap;

use super::solver::{DEFAULT_INTEGRATORS, full};
use super::value::{Finite, Positive, Tolerance, Whole};
use super::{Scene, SolverTable};
use crate::integrator::{Method, StepControl};
use crate::reduced::{Choice, Rung};

/// The tolerance of [`Scene::whole`], and its Newton's method's: forces of stiff rods are differences of tiny stretches.
const WHOLE_TOLERANCE: f64 = 1e-6;

const WHOLE_NEWTON_TOLERANCE: f64 = 1e-13;

impl Scene {
    /// The same scene on another number of nodes; point loads go to the nearest.
    pub fn with_nodes(&self, nodes: u64) -> Self {
        let mut scene = self.clone();
        scene.rod.nodes = Whole::nearest(nodes);
        let (old, new) = (self.rod.nodes.get() as f64, scene.rod.nodes.get() as f64);
        let (all, front) = (self.nodes() as i64, self.front() as i64);
        for load in scene.loads.iter_mut().flat_map(|loads| &mut loads.point) {
            let node = load.node.rem_euclid(all);
            let along = (node - front).max(0) as f64; // a body's centre stays
            load.node = (along * (new - 1.0) / (old - 1.0)).round() as i64 + front.min(node);
        }
        scene
    }

    /// The same scene by the whole model, with steps whose error is small: what cheaper models are compared with.
    pub fn whole(&self) -> Self {
        let mut scene = self.with_newton_tolerance(WHOLE_NEWTON_TOLERANCE);
        scene.solver = SolverTable {
            integrator: Some(DEFAULT_INTEGRATORS[0].to_string()),
            model: full(),
            time_step_s: None,
            tolerance: Some(Tolerance::constant(WHOLE_TOLERANCE)),
            parameters: BTreeMap::new(),
            ..scene.solver
        };
        scene
    }

    /// The same scene over another duration (s).
    pub fn with_duration(&self, duration: f64) -> Self {
        let mut scene = self.clone();
        scene.solver.duration_s = Positive::constant(duration);
        scene
    }

    /// The same scene with other steps; only an adaptive method takes a tolerance.
    pub fn with_pace(&self, pace: StepControl) -> Self {
        let mut scene = self.clone();
        scene.solver.integrator = Some(self.integrator_name().to_string());
        (scene.solver.time_step_s, scene.solver.tolerance) = match pace {
            StepControl::Fixed(step) => (Some(Positive::constant(step)), None),
            StepControl::Adaptive(tolerance) => (None, Some(Tolerance::constant(tolerance))),
        };
        scene
    }

    /// The same scene with a tolerance of Newton's method of at most `most`.
    pub fn with_newton_tolerance(&self, most: f64) -> Self {
        let mut scene = self.clone();
        scene.solver.newton_tolerance = Some(Tolerance::constant(self.newton_tolerance().min(most)));
        scene
    }

    /// The same scene by the whole model and another method, with `values` for its parameters, in their order.
    pub fn with_method(&self, method: &Method, values: &[f64]) -> Self {
        let mut scene = self.clone();
        scene.solver.model = full();
        scene.solver.integrator = Some(method.name.to_string());
        let named = method.parameters.iter().zip(values);
        scene.solver.parameters = named.map(|(p, value)| (p.name.to_string(), toml::Value::Float(*value))).collect();
        scene
    }

    /// The same scene by a rung of the ladder of models.
    pub fn with_model(&self, rung: &Rung) -> Self {
        let mut scene = self.clone();
        scene.solver.model = rung.name.to_string();
        scene
    }

    /// The same scene by the whole model, where it leaves the model to the program.
    pub(super) fn named_model(mut self) -> Self {
        if Rung::named(&self.solver.model).is_none() {
            self.solver.model = full();
        }
        self
    }

    /// The same scene with the law of the fluid, and with or without the water that the rod accelerates, as `other`, which hardly
    /// differs, takes them where both leave that to the program.
    pub fn with_fluid_of(&self, other: &Self) -> Self {
        let mut scene = self.clone();
        scene.taken = None;
        if let Some(fluid) = other.taken_fluid() {
            scene.take_fluid(fluid);
        }
        scene
    }

    /// The same scene as its run takes it by `choice`: a cheaper model that `auto` takes has steps of its own, and solves as
    /// well as what it is compared with.
    pub fn taken(&self, choice: &Choice) -> Self {
        if choice.reason.is_none() || choice.rung.method.is_none() {
            return self.with_model(choice.rung);
        }
        let pace = match (self.cheaper_pace(), &choice.estimates) {
            (StepControl::Adaptive(tolerance), Some(estimates)) => {
                StepControl::Adaptive(tolerance.min(estimates.tolerance))
            }
            (pace, _) => pace,
        };
        self.with_pace(pace).with_model(choice.rung).with_newton_tolerance(WHOLE_NEWTON_TOLERANCE)
    }

    /// The same scene with Young's modulus times `factor`.
    pub fn with_modulus(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        scene.rod.youngs_modulus_pa = Positive::constant(self.rod.youngs_modulus_pa.get() * factor);
        scene
    }

    /// The same scene with the actuation's amplitude times `factor`.
    pub fn with_amplitude(&self, factor: f64) -> Self {
        let mut scene = self.clone();
        if let Some(actuation) = &mut scene.actuation {
            actuation.kappa_amp = Some(Finite::constant(actuation.amplitude() * factor));
        }
        scene
    }

    /// The same scene with a spin (rad/s) of the free rod at the start.
    pub fn with_spin(&self, spin: f64) -> Self {
        let mut scene = self.clone();
        scene.start.spin_rad_s = Some(Finite::constant(spin));
        scene
    }
}
