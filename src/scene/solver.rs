//! `[solver]`: model, method, steps and form.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;

use super::document::{self, Fault};
use super::value::{self, Positive, Tolerance};
use super::{HeadKind, Scene, StartKind};
use crate::error::{Result, nearest};
use crate::integrator::{Integrator, METHODS, Method, StepControl};
use crate::linear;
use crate::model::Model;
use crate::model::chain;
use crate::reduced::estimate::Run;
use crate::reduced::{Choice, Estimates, FULL, Measure, RUNGS, Rung};
use crate::rod::Rod;
use crate::system::Form;

/// `[solver]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SolverTable {
    /// Name of the method; see [`Scene::integrator_name`] for scenes that say nothing.
    pub integrator: Option<String>,
    /// The rung of the ladder of models, or `auto`.
    #[serde(default = "full")]
    pub model: String,
    /// Largest estimated error of the model that `auto` takes.
    #[serde(default = "default_accuracy")]
    pub accuracy: Positive,
    /// What that error is of; all that the scene has where it is not given.
    pub accuracy_of: Option<Vec<Measure>>,
    /// Step size, s.
    pub time_step_s: Option<Positive>,
    /// Largest estimated error of an adaptive step, see [`Pace::Adaptive`].
    pub tolerance: Option<Tolerance>,
    /// Duration of the run, s.
    pub duration_s: Positive,
    /// Largest displacement increment of Newton's last iteration over the length; [`Scene::newton_tolerance`] is that of
    /// scenes that say nothing too.
    pub newton_tolerance: Option<Tolerance>,
    /// The linear solver.
    #[serde(default)]
    pub linear: linear::SolverChoice,
    /// What Newton's method takes as unknowns.
    #[serde(default)]
    pub form: FormKey,
    /// The method's own parameters.
    #[serde(flatten)]
    #[cfg_attr(feature = "schema", schemars(skip))]
    pub parameters: BTreeMap<String, toml::Value>,
}

/// Choices of the [`Form`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum FormKey {
    /// Positions where their rounding error stays below [`chain::ACCURACY`], else the chain form.
    #[default]
    Auto,
    /// See [`Form::Positions`].
    Positions,
    /// See [`Form::Chain`].
    Chain,
}

/// Most steps a scene may have; integers are exact well beyond.
const MOST_STEPS: f64 = 1e15;

/// The keys of `[solver]` beside the methods' parameters.
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

/// Refuses a key of `[solver]` that is neither its own nor a parameter of any method.
pub(super) fn check_solver_key(key: &str, integrator: Option<&str>) -> std::result::Result<(), Fault> {
    let parameters = |method: &'static Method| method.parameters.iter().map(|parameter| parameter.name);
    if SOLVER_KEYS.contains(&key) || METHODS.iter().any(|method| parameters(method).any(|name| name == key)) {
        return Ok(());
    }
    let mut keys = SOLVER_KEYS.to_vec();
    keys.extend(integrator.and_then(Method::named).into_iter().flat_map(parameters));
    let near = nearest(key, keys.iter().copied());
    let problem = document::unknown_key(&format!("`{}`", keys.join("`, `")), near);
    Err(Fault { key: format!("solver.{key}"), problem })
}

/// The model that the program chooses.
const AUTO: &str = "auto";

/// The errors of cheaper models are estimated on no more nodes than this.
const ESTIMATES_UP_TO: u64 = 17;

/// Part of the accuracy that is the tolerance of the cheaper model that `auto` takes, so that its steps add nothing to its
/// error: measured on three scenes, the overdamped model's displacement is off by up to 30 times its tolerance.
const STEPS_OF_ACCURACY: f64 = 0.01;

/// The method of a scene that names none: without a step of its own; with one; and with one where the rod is released into
/// its natural curvature at once, on which methods that damp little fail.
pub(super) const DEFAULT_INTEGRATORS: [&str; 3] = ["esdirk3", "generalized-alpha", "implicit-euler"];

/// The tolerance of a scene that gives neither step nor tolerance.
const DEFAULT_TOLERANCE: f64 = 1e-3;

/// Newton's tolerance where steps are fixed; where they are adaptive, the part of their tolerance that it is, and the largest
/// value: from a transverse error δ on, stiff rods have the stretching energy of δ²/2ℓ.
const NEWTON_TOLERANCE: f64 = 1e-10;
const NEWTON_OF_TOLERANCE: f64 = 1e-3;
const LARGEST_NEWTON_TOLERANCE: f64 = 1e-6;

pub(super) fn full() -> String {
    "full".to_string()
}

fn default_accuracy() -> Positive {
    Positive::constant(1e-3)
}

impl SolverTable {
    /// Refuses steps too many to be counted.
    pub(super) fn check_steps(&self) -> std::result::Result<(), Fault> {
        let duration = self.duration_s.get();
        let Some(step) = self.time_step_s.map(Positive::get).filter(|step| duration > MOST_STEPS * step) else {
            return Ok(());
        };
        let allowed =
            format!("at least {:e}, so that duration_s has at most {MOST_STEPS:e} steps", duration / MOST_STEPS);
        let problem = value::refused(format_args!("{step:e}"), allowed);
        Err(Fault { key: "solver.time_step_s".into(), problem })
    }
}

impl Scene {
    /// Checks that its model holds what the scene has.
    pub(super) fn check_model(&self) -> std::result::Result<(), Fault> {
        let fault = |key: &str, problem: String| Err(Fault { key: key.to_string(), problem });
        let rung = self.rung()?;
        if rung.is_some_and(|rung| rung.needs_drag) && self.drag.is_none() {
            let problem = format!("found {:?} without [drag]; add it, or take another model", self.solver.model);
            return fault("solver.model", problem);
        }
        if rung.is_some_and(|rung| rung.needs_drag) && !self.is_dragged() {
            let problem = format!(
                "found 0 with solver.model = {:?}: without inertia nothing says how nodes without drag move; allowed: a positive weight, or another model",
                self.solver.model
            );
            return fault("drag.head_weight", problem);
        }
        // What is left to the program is not taken with a model that cannot hold it.
        let reactive = self.reactive.as_ref().filter(|reactive| !reactive.auto);
        if let (Some(rung), Some(_)) = (rung.filter(|rung| rung.needs_drag), reactive) {
            let problem = format!(
                "found {:?} with [reactive]: without inertia there is none of the water either, and the reactive force is nothing else; remove one, or take another model",
                rung.name
            );
            return fault("solver.model", problem);
        }
        if let (Some(rung), Some(part)) = (rung.filter(|rung| rung.method.is_some()), self.only_whole()) {
            let problem = format!("found {:?} with {part}, which only the whole model holds; remove one", rung.name);
            return fault("solver.model", problem);
        }
        let held = self.head.kind != HeadKind::Free;
        match &self.solver.accuracy_of {
            Some(measures) if !measures.iter().any(|measure| measure.exists(held)) => {
                let problem = "found nothing that this scene has; allowed: \"displacement\", \"tip\", and with a held head \"force\", \"moment\"";
                return fault("solver.accuracy_of", problem.into());
            }
            _ => {}
        }
        Ok(())
    }

    /// True where it names a model that cannot hold the water's inertia.
    pub(super) fn refuses_water(&self) -> bool {
        self.rung().ok().flatten().is_some_and(|rung| rung.needs_drag)
    }

    /// Checks its method with its steps and form.
    pub(super) fn check_method(&self) -> std::result::Result<(), Fault> {
        let fault = |key: &str, problem: String| Err(Fault { key: key.to_string(), problem });
        let (method, _) = self.method()?;
        let adaptive = || METHODS.iter().filter(|other| other.adaptive).map(|other| other.name).collect::<Vec<_>>();
        let own_method = self.rung()?.is_some_and(|rung| rung.method.is_some());
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(_), Some(_)) => {
                return fault("solver.tolerance", "found beside time_step_s; allowed: one of the two".into());
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

    /// True where every node that is free to move has drag.
    fn is_dragged(&self) -> bool {
        let Some(drag) = &self.drag else { return false };
        let weightless = drag.head_weight.is_some_and(|weight| weight.get() == 0.0);
        let bare = if weightless { drag.head_length_m.map_or(0.0, Positive::get) } else { 0.0 };
        let spacing = self.rod.length_m.get() / (self.rod.nodes.get() - 1) as f64;
        let first = if self.head.kind == HeadKind::Free { 0.5 } else { 1.5 };
        bare < first * spacing
    }

    /// The rung of the ladder of models it names, none where the program chooses.
    fn rung(&self) -> std::result::Result<Option<&'static Rung>, Fault> {
        let model = self.solver.model.as_str();
        let rung = Rung::named(model);
        if rung.is_none() && model != AUTO {
            let allowed = RUNGS.iter().map(|rung| rung.name).chain([AUTO]).collect::<Vec<_>>().join(", ");
            return Err(Fault {
                key: "solver.model".into(),
                problem: value::refused(format_args!("{model:?}"), allowed),
            });
        }
        Ok(rung)
    }

    /// True where it names a model that leaves some of the rod's mechanics out.
    pub fn names_a_cheaper_model(&self) -> bool {
        self.rung().is_ok_and(|rung| rung.is_some_and(|rung| rung.method.is_some()))
    }

    /// What of its medium cheaper models cannot hold.
    fn only_whole(&self) -> Option<&'static str> {
        let stack = self.medium.as_ref().filter(|medium| medium.is_stacked())?;
        Some(if stack.interfaces().next().is_some() { "an interface in [medium]" } else { "[medium.shear]" })
    }

    /// How far the cheaper models of it are from the whole one; of a fine mesh, on a coarser one.
    ///
    /// # Errors
    /// Those of [`model`](Self::model) and [`integrator`](Self::integrator).
    pub fn estimates(&self) -> Result<Estimates> {
        if self.only_whole().is_some() {
            return Ok(Estimates::none("it cannot hold a medium that changes with the place"));
        }
        let nodes = (self.rod.nodes.get() as u64).min(ESTIMATES_UP_TO);
        let step = self.typical_step();
        let (method, _) = self.method().map_err(|Fault { key, problem }| self.error(&key, problem))?;
        let iterations = match (method.implicit, self.integrator()?.rule(step)) {
            (false, _) => 1.0,
            (true, Some(_)) => 2.0,
            (true, None) => 6.0,
        };
        let run = Run {
            duration: self.solver.duration_s.get(),
            nodes: self.nodes(),
            pace: [self.pace(), self.cheaper_pace()],
            iterations,
            accuracy: self.solver.accuracy.get(),
            measures: Measure::ALL.map(|measure| Some(measure).filter(|measure| self.measures().contains(measure))),
        };
        Ok(Estimates::of(&Arc::new(self.with_nodes(nodes).model()?), run))
    }

    /// The rung that it names, or the cheapest one that is accurate enough.
    ///
    /// # Errors
    /// Those of [`estimates`](Self::estimates).
    pub fn choice(&self) -> Result<Choice> {
        match self.rung().map_err(|Fault { key, problem }| self.error(&key, problem))? {
            Some(rung) if rung.method.is_some() => {
                match (rung.refuses)(&Arc::new(self.model()?), self.solver.duration_s.get()) {
                    Some(reason) => Err(self.error("solver.model", format!("found {:?}, but {reason}", rung.name))),
                    None => Ok(Choice::asked(rung)),
                }
            }
            Some(rung) => Ok(Choice::asked(rung)),
            None => {
                let accuracy = self.solver.accuracy.get();
                Ok(Choice::of(self.estimates()?, accuracy, self.measures(), self.is_dragged()))
            }
        }
    }

    /// The rung that it names, where that can run `model`, another than its own; the whole model where the program would choose.
    ///
    /// # Errors
    /// [`Error::Scene`](crate::Error::Scene).
    pub(crate) fn rung_or_whole(&self, model: &Arc<Model>) -> Result<&'static Rung> {
        let rung = self.rung().map_err(|Fault { key, problem }| self.error(&key, problem))?.unwrap_or(&FULL);
        match (rung.refuses)(model, self.solver.duration_s.get()).filter(|_| rung.method.is_some()) {
            Some(reason) => Err(self.error("solver.model", format!("found {:?}, but {reason}", rung.name))),
            None => Ok(rung),
        }
    }

    /// What its accuracy is asked of.
    fn measures(&self) -> &[Measure] {
        self.solver.accuracy_of.as_deref().unwrap_or(&Measure::ALL)
    }

    /// How a cheaper model that `auto` takes chooses its steps at most: for itself.
    pub(super) fn cheaper_pace(&self) -> StepControl {
        let most = STEPS_OF_ACCURACY * self.solver.accuracy.get();
        StepControl::Adaptive(self.solver.tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get).min(most))
    }

    /// The method and the values of its parameters.
    pub(crate) fn method(&self) -> std::result::Result<(&'static Method, Vec<f64>), Fault> {
        let solver = &self.solver;
        let names = || METHODS.iter().map(|method| method.name);
        let Some(method) = Method::named(self.integrator_name()) else {
            let allowed = names().collect::<Vec<_>>().join(", ");
            let problem = value::refused(format_args!("{:?}", self.integrator_name()), allowed);
            return Err(Fault { key: "solver.integrator".into(), problem });
        };
        for key in solver.parameters.keys() {
            if method.parameters.iter().any(|parameter| parameter.name == key) {
                continue;
            }
            check_solver_key(key, Some(method.name))?;
            let owners = METHODS.iter().filter(|other| other.parameters.iter().any(|p| p.name == key));
            let owners = owners.map(|other| other.name).collect::<Vec<_>>().join(", ");
            let problem = format!("found with integrator = \"{}\"; allowed: only with {owners}", method.name);
            return Err(Fault { key: format!("solver.{key}"), problem });
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
                return Err(Fault { key: format!("solver.{}", parameter.name), problem });
            }
            values.push(value);
        }
        Ok((method, values))
    }

    /// The name of its method: a scene that names none takes one that fits the step it gives and its start, or one that
    /// chooses steps for itself.
    pub fn integrator_name(&self) -> &str {
        let [without_step, with_step, released] = DEFAULT_INTEGRATORS;
        let default = match self.solver.time_step_s {
            None => without_step,
            Some(_) if self.start.kind == StartKind::Jump && self.actuation.is_some() => released,
            Some(_) => with_step,
        };
        self.solver.integrator.as_deref().unwrap_or(default)
    }

    /// How its steps are chosen.
    pub fn pace(&self) -> StepControl {
        match (self.solver.time_step_s, self.solver.tolerance) {
            (Some(step), _) => StepControl::Fixed(step.get()),
            (None, tolerance) => StepControl::Adaptive(tolerance.map_or(DEFAULT_TOLERANCE, Tolerance::get)),
        }
    }

    /// The largest displacement increment of Newton's last iteration over the length.
    pub fn newton_tolerance(&self) -> f64 {
        match (self.solver.newton_tolerance, self.pace()) {
            (Some(tolerance), _) => tolerance.get(),
            (None, StepControl::Fixed(_)) => NEWTON_TOLERANCE,
            (None, StepControl::Adaptive(tolerance)) => (NEWTON_OF_TOLERANCE * tolerance).min(LARGEST_NEWTON_TOLERANCE),
        }
    }

    /// True where Newton's method [foresees](crate::newton::Newton::foreseeing) iterations: a tolerance that is given is that of increments
    /// that were made.
    pub fn newton_foresees(&self) -> bool {
        self.solver.newton_tolerance.is_none()
    }

    /// The size of its steps, s; where they are adaptive, about what is usual: a fiftieth of the fastest period of what drives it, or of the run.
    pub fn typical_step(&self) -> f64 {
        match self.pace() {
            StepControl::Fixed(step) => step,
            StepControl::Adaptive(_) => {
                let period = self.spectrum().fastest().map_or(f64::INFINITY, f64::recip);
                period.min(self.solver.duration_s.get()) / 50.0
            }
        }
    }

    /// The form in which `rod`, its own, is solved.
    pub fn form(&self, rod: &Rod) -> Form {
        match (self.solver.form, Method::named(self.integrator_name())) {
            (FormKey::Positions, _) | (_, Some(Method { implicit: false, .. })) => Form::Positions,
            (FormKey::Chain, _) => Form::Chain,
            (FormKey::Auto, _) if self.has_whole_drag() => Form::Positions,
            (FormKey::Auto, _) => chain::form(rod, self.typical_step()),
        }
    }

    /// Its integrator.
    ///
    /// # Errors
    /// `Error::Scene`; none for a scene that was read by `Document::scene`.
    pub fn integrator(&self) -> Result<Box<dyn Integrator>> {
        let (method, values) = self.method().map_err(|Fault { key, problem }| self.error(&key, problem))?;
        Ok((method.build)(&values))
    }

    /// The lengths (s) of the calls of `do_step` that make its run: one of whole steps of Δt, and one of the shorter last
    /// step if there is one; one in all where steps are adaptive.
    pub fn spans(&self) -> impl Iterator<Item = f64> {
        let duration = self.solver.duration_s.get();
        let StepControl::Fixed(step) = self.pace() else { return [Some(duration), None].into_iter().flatten() };
        let (whole, last) = whole_steps(duration, step);
        [(whole > 0).then_some(whole as f64 * step), last].into_iter().flatten()
    }

    /// The same, whole steps one by one.
    #[cfg(feature = "report")]
    pub(crate) fn single_steps(&self) -> impl Iterator<Item = f64> + use<> {
        let (step, steps) = match self.pace() {
            StepControl::Fixed(step) => (step, whole_steps(self.solver.duration_s.get(), step)),
            StepControl::Adaptive(_) => (0.0, (0, Some(self.solver.duration_s.get()))),
        };
        let (whole, last) = steps;
        (0..whole).map(move |_| step).chain(last)
    }

    /// The number of its steps; none is known before where they are adaptive.
    pub fn steps(&self) -> Option<u64> {
        let StepControl::Fixed(step) = self.pace() else { return None };
        let (whole, last) = whole_steps(self.solver.duration_s.get(), step);
        Some(whole + u64::from(last.is_some()))
    }
}

/// The whole steps in `duration` (s), and the shorter last one (s) if there is one: together the duration.
pub(crate) fn whole_steps(duration: f64, step: f64) -> (u64, Option<f64>) {
    let whole = (duration / step).round();
    if (whole * step - duration).abs() <= 1e-9 * duration {
        return (whole as u64, None);
    }
    let whole = (duration / step).floor();
    (whole as u64, Some(duration - whole * step))
}
