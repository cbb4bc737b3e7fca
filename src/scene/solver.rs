//! `[solver]`: model, integrator, step size, tolerances and form of the equations.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;

use super::key_error::{KeyError, unknown_key};
use super::keys_by_choice::KeysByChoice;
use super::value::{self, Positive, Tolerance};
use super::{HeadKind, Scene, StartKind};
use crate::error::{Result, nearest};
use crate::integrator::{Integrator, METHODS, Method, StepControl};
use crate::linear;
use crate::model::Model;
use crate::model::chain;
use crate::reduced::model_estimates::FullModelRun;
use crate::reduced::{ErrorMeasure, Estimates, FULL, MODELS, ModelChoice, ModelKind};
use crate::rod::Rod;
use crate::system::Form;

/// `[solver]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SolverTable {
    /// The integrator. By default `esdirk3` with adaptive steps, and `generalized-alpha` if `time_step_s` is given, or
    /// `implicit-euler` if the rod is then also released into its drive at once, by a `jump` or by winches.
    pub integrator: Option<String>,
    /// The model: `full`, a cheaper one, or `auto` for the cheapest whose estimated error is within `accuracy`.
    #[serde(default = "full")]
    pub model: String,
    /// Largest relative error of the model that `auto` may choose. By default 1e-3.
    #[serde(default = "default_accuracy")]
    pub accuracy: Positive,
    /// The quantities whose error is limited by `accuracy`. By default, all that the scene has.
    pub accuracy_of: Option<Vec<ErrorMeasure>>,
    /// Step size of fixed steps, s.
    pub time_step_s: Option<Positive>,
    /// Relative tolerance of adaptive steps. By default 1e-3, if `time_step_s` is not given.
    pub tolerance: Option<Tolerance>,
    /// Duration of the run, s.
    pub duration_s: Positive,
    /// Newton's method stops when the displacement increment divided by the rod length is below this. By default 1e-10 with fixed
    /// steps; with adaptive steps `tolerance`/1000, at most 1e-6 and less for a stiff rod with a held head.
    pub newton_tolerance: Option<Tolerance>,
    /// The linear solver.
    #[serde(default)]
    pub linear: linear::SolverChoice,
    /// The unknowns of Newton's method. By default `auto`.
    #[serde(default)]
    pub form: FormKey,
    /// The parameters of the integrator.
    #[serde(flatten)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub parameters: BTreeMap<String, toml::Value>,
}

/// Choices of the [`Form`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum FormKey {
    /// Positions, or the chain form if the rounding error of positions would be too large.
    #[default]
    Auto,
    /// The positions of the nodes.
    Positions,
    /// Positions, angles, forces and moments: accurate for very fine meshes and stiff rods.
    Chain,
}

/// The largest number of steps of a scene.
const MAX_STEPS: f64 = 1e15;

/// The keys of `[solver]` other than the parameters of integrators.
const SOLVER_KEYS: [&str; 10] = [
    "integrator",
    "time_step_s",
    "tolerance",
    "duration_s",
    "newton_tolerance",
    "linear",
    "form",
    "model",
    "accuracy",
    "accuracy_of",
];

/// Returns an error for a key of `[solver]` that is neither its own nor a parameter of an integrator.
pub(super) fn check_solver_key(key: &str, integrator: Option<&str>) -> std::result::Result<(), KeyError> {
    let parameters = |method: &'static Method| method.parameters.iter().map(|parameter| parameter.name);
    if SOLVER_KEYS.contains(&key) || METHODS.iter().any(|method| parameters(method).any(|name| name == key)) {
        return Ok(());
    }
    let mut keys = SOLVER_KEYS.to_vec();
    keys.extend(integrator.and_then(Method::named).into_iter().flat_map(parameters));
    let near = nearest(key, keys.iter().copied());
    let problem = unknown_key(&format!("`{}`", keys.join("`, `")), near);
    Err(KeyError { key: format!("solver.{key}"), problem })
}

/// The name that leaves the model to the program.
const AUTO: &str = "auto";

/// The key of tendons, for messages.
const TENDONS: &str = "[[tendons]]";

/// The key of a hinged head, whose angle is an additional unknown, for messages.
const HINGE: &str = "head.kind = \"hinged\"";

/// The errors of cheaper models are estimated on at most this many nodes.
const MAX_ESTIMATE_NODES: u64 = 17;

/// Tolerance of the cheaper model that `auto` chooses, as a fraction of the accuracy, so that its step errors are negligible:
/// measured on three scenes, the displacement error of the overdamped model is up to 30 times its tolerance.
const TOLERANCE_PER_ACCURACY: f64 = 0.01;

/// The default integrators: without a given step; with one; and with one if the rod is released into its drive at once, where
/// methods with little damping fail.
pub(super) const DEFAULT_INTEGRATORS: [&str; 3] = ["esdirk3", "generalized-alpha", "implicit-euler"];

/// The default tolerance, if neither step nor tolerance is given.
const DEFAULT_TOLERANCE: f64 = 1e-3;

/// Newton's tolerance with fixed steps; with adaptive ones, its ratio to their tolerance, and its largest value. A transverse
/// error δ stretches an edge by δ²/2ℓ, whose energy matters in stiff rods.
const NEWTON_TOLERANCE: f64 = 1e-10;
const NEWTON_TOLERANCE_RATIO: f64 = 1e-3;
const MAX_NEWTON_TOLERANCE: f64 = 1e-6;

pub(super) fn full() -> String {
    "full".to_string()
}

fn default_accuracy() -> Positive {
    Positive::constant(1e-3)
}

impl SolverTable {
    /// The parameters of integrators.
    pub(super) const KEYS_BY_INTEGRATOR: KeysByChoice = KeysByChoice {
        table: "solver",
        choices: &["integrator"],
        keys: || METHODS.iter().flat_map(|method| method.parameters).map(|parameter| parameter.name).collect(),
        accepted: |chosen| {
            let method = Method::named(&chosen("integrator")?)?;
            Some(method.parameters.iter().map(|parameter| parameter.name).collect())
        },
    };

    /// Checks the number of steps.
    pub(super) fn check_steps(&self) -> std::result::Result<(), KeyError> {
        let duration = self.duration_s.get();
        let Some(step) = self.time_step_s.map(Positive::get).filter(|step| duration > MAX_STEPS * step) else {
            return Ok(());
        };
        let allowed =
            format!("at least {:e}, so that duration_s has at most {MAX_STEPS:e} steps", duration / MAX_STEPS);
        let problem = value::refused(format_args!("{step:e}"), allowed);
        Err(KeyError { key: "solver.time_step_s".into(), problem })
    }
}

impl Scene {
    /// Checks that the model supports every part of the scene.
    pub(crate) fn check_model(&self) -> std::result::Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
        let kind = self.kind()?;
        if kind.is_some_and(|kind| kind.needs_drag) && self.drag.is_none() {
            let problem = format!("found {:?} without [drag]; add it, or use another model", self.solver.model);
            return fault("solver.model", problem);
        }
        if kind.is_some_and(|kind| kind.needs_drag) && !self.is_dragged() {
            let problem = format!(
                "found 0 with solver.model = {:?}: without inertia the motion of nodes without drag is undetermined; allowed: a positive weight, or another model",
                self.solver.model
            );
            return fault("drag.head_weight", problem);
        }
        // If added mass is left to the program, it is not chosen together with a model that does not support it.
        let reactive = self.reactive.as_ref().filter(|reactive| !reactive.auto);
        if let (Some(kind), Some(_)) = (kind.filter(|kind| kind.needs_drag), reactive) {
            let problem = format!(
                "found {:?} with [reactive]: a model without inertia has no added mass, which is what [reactive] adds; remove one, or use another model",
                kind.name
            );
            return fault("solver.model", problem);
        }
        if let (Some(kind), Some(part)) = (kind.filter(|kind| kind.method.is_some()), self.requires_full_model()) {
            let problem = format!("found {:?} with {part}, which only the full model supports; remove one", kind.name);
            return fault("solver.model", problem);
        }
        let held = self.head.kind != HeadKind::Free;
        match &self.solver.accuracy_of {
            Some(measures) if !measures.iter().any(|measure| measure.exists(held)) => {
                let problem = "found no quantity of this scene; allowed: \"displacement\", \"tip\", and with a held head \"force\", \"moment\"";
                return fault("solver.accuracy_of", problem.into());
            }
            _ => {}
        }
        Ok(())
    }

    /// True if the scene specifies a model without inertia of the fluid.
    pub(super) fn excludes_added_mass(&self) -> bool {
        self.kind().ok().flatten().is_some_and(|kind| kind.needs_drag)
    }

    /// Checks the integrator against steps and form.
    pub(super) fn check_method(&self) -> std::result::Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
        let (method, _) = self.method()?;
        let adaptive = || METHODS.iter().filter(|other| other.adaptive).map(|other| other.name).collect::<Vec<_>>();
        let own_method = self.kind()?.is_some_and(|kind| kind.method.is_some());
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(_), Some(_)) => {
                return fault("solver.tolerance", "found together with time_step_s; allowed: one of the two".into());
            }
            (None, Some(_)) if !method.adaptive && !own_method => {
                let problem = format!(
                    "found with integrator = \"{}\"; allowed: only with {}",
                    method.name,
                    adaptive().join(", ")
                );
                return fault("solver.tolerance", problem);
            }
            (None, None) if !method.adaptive && !own_method => {
                return fault(
                    "solver.time_step_s",
                    format!("missing; integrator = \"{}\" has no default", method.name),
                );
            }
            _ => {}
        }
        if self.solver.form == FormKey::Chain && !method.implicit {
            let problem =
                format!("found \"chain\" with integrator = \"{}\"; allowed: with implicit methods only", method.name);
            return fault("solver.form", problem);
        }
        Ok(())
    }

    /// True if every node that can move has drag.
    fn is_dragged(&self) -> bool {
        let Some(drag) = &self.drag else { return false };
        let weightless = drag.head_weight.is_some_and(|weight| weight.get() == 0.0);
        let bare = if weightless { drag.head_length_m.map_or(0.0, Positive::get) } else { 0.0 };
        let spacing = self.rod.length_m.get() / (self.rod.nodes.get() - 1) as f64;
        let first = if self.head.kind == HeadKind::Free { 0.5 } else { 1.5 };
        bare < first * spacing
    }

    /// The specified model, or `None` if the program chooses.
    fn kind(&self) -> std::result::Result<Option<&'static ModelKind>, KeyError> {
        let model = self.solver.model.as_str();
        let kind = ModelKind::named(model);
        if kind.is_none() && model != AUTO {
            let allowed = MODELS.iter().map(|kind| kind.name).chain([AUTO]).collect::<Vec<_>>().join(", ");
            return Err(KeyError {
                key: "solver.model".into(),
                problem: value::refused(format_args!("{model:?}"), allowed),
            });
        }
        Ok(kind)
    }

    /// True if the scene specifies a reduced model.
    pub fn names_reduced_model(&self) -> bool {
        self.kind().is_ok_and(|kind| kind.is_some_and(|kind| kind.method.is_some()))
    }

    /// The property of its medium that reduced models do not support, if any.
    fn requires_full_model(&self) -> Option<&'static str> {
        if !self.tendons.is_empty() {
            return Some(TENDONS);
        }
        if self.head.kind == HeadKind::Hinged {
            return Some(HINGE);
        }
        let stack = self.medium.as_ref().filter(|medium| medium.is_stacked())?;
        Some(if stack.interfaces().next().is_some() { "an interface in [medium]" } else { "[medium.shear]" })
    }

    /// Estimated errors of the reduced models, on a coarser mesh if the mesh is fine.
    ///
    /// # Errors
    /// Errors of [`model`](Self::model) and [`integrator`](Self::integrator).
    pub fn estimates(&self) -> Result<Estimates> {
        if let Some(part) = self.requires_full_model() {
            return Ok(Estimates::none(match part {
                TENDONS => "it does not support tendons",
                HINGE => "it does not support a hinged head",
                _ => "it does not support a medium that varies with position",
            }));
        }
        let step = self.typical_step();
        let (method, _) = self.method().map_err(|KeyError { key, problem }| self.error(&key, problem))?;
        let iterations = match (method.implicit, self.integrator()?.rule(step)) {
            (false, _) => 1.0,
            (true, Some(_)) => 2.0,
            (true, None) => 6.0,
        };
        let run = FullModelRun {
            duration: self.solver.duration_s.get(),
            nodes: self.nodes(),
            step_control: [self.step_control(), self.reduced_model_step_control()],
            iterations,
            accuracy: self.solver.accuracy.get(),
            measures: ErrorMeasure::ALL
                .map(|measure| Some(measure).filter(|measure| self.measures().contains(measure))),
        };
        Ok(Estimates::of(&Arc::new(self.with_nodes_up_to(MAX_ESTIMATE_NODES).model()?), run))
    }

    /// The specified model, or the cheapest one that is accurate enough.
    ///
    /// # Errors
    /// Errors of [`estimates`](Self::estimates).
    pub fn choice(&self) -> Result<ModelChoice> {
        match self.kind().map_err(|KeyError { key, problem }| self.error(&key, problem))? {
            Some(kind) if kind.method.is_some() => {
                match (kind.refuses)(&Arc::new(self.model()?), self.solver.duration_s.get()) {
                    Some(reason) => Err(self.error("solver.model", format!("found {:?}, but {reason}", kind.name))),
                    None => Ok(ModelChoice::asked(kind)),
                }
            }
            Some(kind) => Ok(ModelChoice::asked(kind)),
            None => {
                let accuracy = self.solver.accuracy.get();
                Ok(ModelChoice::of(self.estimates()?, accuracy, self.measures(), self.is_dragged()))
            }
        }
    }

    /// The specified kind of model, if it can run `model`, which differs from the scene's own; the full model if the program
    /// would choose.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene).
    pub(crate) fn kind_or_full(&self, model: &Arc<Model>) -> Result<&'static ModelKind> {
        let kind = self.kind().map_err(|KeyError { key, problem }| self.error(&key, problem))?.unwrap_or(&FULL);
        match (kind.refuses)(model, self.solver.duration_s.get()).filter(|_| kind.method.is_some()) {
            Some(reason) => Err(self.error("solver.model", format!("found {:?}, but {reason}", kind.name))),
            None => Ok(kind),
        }
    }

    /// The quantities whose error is limited by `accuracy`.
    fn measures(&self) -> &[ErrorMeasure] {
        self.solver.accuracy_of.as_deref().unwrap_or(&ErrorMeasure::ALL)
    }

    /// The step control of a reduced model that `auto` chooses: adaptive.
    pub(super) fn reduced_model_step_control(&self) -> StepControl {
        let most = TOLERANCE_PER_ACCURACY * self.solver.accuracy.get();
        StepControl::Adaptive(self.solver.tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get).min(most))
    }

    /// The integrator and the values of its parameters.
    pub(crate) fn method(&self) -> std::result::Result<(&'static Method, Vec<f64>), KeyError> {
        let solver = &self.solver;
        let names = || METHODS.iter().map(|method| method.name);
        let Some(method) = Method::named(self.integrator_name()) else {
            let allowed = names().collect::<Vec<_>>().join(", ");
            let problem = value::refused(format_args!("{:?}", self.integrator_name()), allowed);
            return Err(KeyError { key: "solver.integrator".into(), problem });
        };
        for key in solver.parameters.keys() {
            if method.parameters.iter().any(|parameter| parameter.name == key) {
                continue;
            }
            check_solver_key(key, Some(method.name))?;
            let owners = METHODS.iter().filter(|other| other.parameters.iter().any(|p| p.name == key));
            let owners = owners.map(|other| other.name).collect::<Vec<_>>().join(", ");
            let problem = format!("found with integrator = \"{}\"; allowed: only with {owners}", method.name);
            return Err(KeyError { key: format!("solver.{key}"), problem });
        }
        let mut values = Vec::new();
        for parameter in method.parameters {
            let value = match solver.parameters.get(parameter.name) {
                None => parameter.default,
                Some(toml::Value::Float(x)) => *x,
                Some(toml::Value::Integer(x)) => *x as f64,
                Some(_) => f64::NAN,
            };
            if !(parameter.range[0]..=parameter.range[1]).contains(&value) {
                let found = solver.parameters.get(parameter.name).map_or(String::new(), ToString::to_string);
                let problem = value::refused(found, parameter.allowed);
                return Err(KeyError { key: format!("solver.{}", parameter.name), problem });
            }
            values.push(value);
        }
        Ok((method, values))
    }

    /// True if the rod is released into its drive at once.
    pub fn is_released(&self) -> bool {
        match self.start.kind {
            StartKind::Jump => self.drives().begin_with_start(),
            StartKind::Shaped => self.has_winches() && self.drives().tendons,
            StartKind::Ramp => false,
        }
    }

    /// The name of the integrator. By default it depends on whether a step size is given, and on the start.
    pub fn integrator_name(&self) -> &str {
        let [without_step, with_step, released] = DEFAULT_INTEGRATORS;
        let default = match self.solver.time_step_s {
            None => without_step,
            Some(_) if self.is_released() => released,
            Some(_) => with_step,
        };
        self.solver.integrator.as_deref().unwrap_or(default)
    }

    /// The control of the step size.
    pub fn step_control(&self) -> StepControl {
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(step), _) => StepControl::Fixed(step.get()),
            (None, tolerance) => StepControl::Adaptive(tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get)),
        }
    }

    /// Tolerance of the displacement increment of Newton's method, divided by the length.
    pub fn newton_tolerance(&self) -> f64 {
        match (self.solver.newton_tolerance, self.step_control()) {
            (Some(tolerance), _) => tolerance.get(),
            (None, StepControl::Fixed(_)) => NEWTON_TOLERANCE,
            (None, StepControl::Adaptive(tolerance)) => (NEWTON_TOLERANCE_RATIO * tolerance).min(MAX_NEWTON_TOLERANCE),
        }
    }

    /// True if Newton's method may [predict](crate::newton::Newton::foreseeing) the last increment instead of computing it. This
    /// is the case unless a tolerance is given.
    pub fn newton_may_predict(&self) -> bool {
        self.solver.newton_tolerance.is_none()
    }

    /// The step size, s, or a typical one if steps are adaptive: 1/50 of the shortest period of the drive, or of the run.
    pub fn typical_step(&self) -> f64 {
        match self.step_control() {
            StepControl::Fixed(step) => step,
            StepControl::Adaptive(_) => {
                let period = self.spectrum().fastest().map_or(f64::INFINITY, f64::recip);
                period.min(self.solver.duration_s.get()) / 50.0
            }
        }
    }

    /// The form in which the equations of its `rod` are solved.
    pub fn form(&self, rod: &Rod) -> Form {
        match (self.solver.form, Method::named(self.integrator_name())) {
            (FormKey::Positions, _) | (_, Some(Method { implicit: false, .. })) => Form::Positions,
            (FormKey::Chain, _) => Form::Chain,
            (FormKey::Auto, _) if self.has_nonlocal_drag() => Form::Positions,
            (FormKey::Auto, _) => chain::form(rod, self.typical_step()),
        }
    }

    /// Returns an error for a mesh of `rod` so fine that steps solved in `form` are below rounding.
    pub(crate) fn check_mesh(&self, rod: &Rod, form: Form) -> Result<()> {
        let step = self.typical_step();
        let meaningless = form == Form::Positions && chain::is_meaningless(rod, step);
        match chain::too_fine(rod, step).filter(|_| meaningless) {
            Some(problem) => Err(self.error("rod.nodes", problem)),
            None => Ok(()),
        }
    }

    /// Its integrator.
    ///
    /// # Errors
    /// `Error::Scene`, but never for a scene read by `Document::scene`.
    pub fn integrator(&self) -> Result<Box<dyn Integrator>> {
        let (method, values) = self.method().map_err(|KeyError { key, problem }| self.error(&key, problem))?;
        Ok((method.build)(&values))
    }

    /// The durations (s) of the calls of `do_step` that make up its run: one for all full steps of Δt, and one for a shorter last
    /// step, if any. Adaptive steps need a single call.
    pub fn spans(&self) -> impl Iterator<Item = f64> {
        let duration = self.solver.duration_s.get();
        let StepControl::Fixed(step) = self.step_control() else { return [Some(duration), None].into_iter().flatten() };
        let (whole, last) = whole_steps(duration, step);
        [(whole > 0).then_some(whole as f64 * step), last].into_iter().flatten()
    }

    /// The same, with one call per full step.
    #[cfg(feature = "report")]
    pub(crate) fn single_steps(&self) -> impl Iterator<Item = f64> + use<> {
        let (step, steps) = match self.step_control() {
            StepControl::Fixed(step) => (step, whole_steps(self.solver.duration_s.get(), step)),
            StepControl::Adaptive(_) => (0.0, (0, Some(self.solver.duration_s.get()))),
        };
        let (whole, last) = steps;
        (0..whole).map(move |_| step).chain(last)
    }

    /// The number of steps, or `None` if they are adaptive.
    pub fn steps(&self) -> Option<u64> {
        let StepControl::Fixed(step) = self.step_control() else { return None };
        let (whole, last) = whole_steps(self.solver.duration_s.get(), step);
        Some(whole + u64::from(last.is_some()))
    }
}

/// The number of full steps in `duration` (s), and the size (s) of a shorter last step, if any.
pub(crate) fn whole_steps(duration: f64, step: f64) -> (u64, Option<f64>) {
    let whole = (duration / step).round();
    if (whole * step - duration).abs() <= 1e-9 * duration {
        return (whole as u64, None);
    }
    let whole = (duration / step).floor();
    (whole as u64, Some(duration - whole * step))
}
