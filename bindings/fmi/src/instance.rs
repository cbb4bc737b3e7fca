//! An instance of the FMU, independent of the version of the standard: its modes, values, states and log.

mod derivatives;
mod saved;
mod steps;
mod values;
mod variables;

use std::ffi::c_void;
use std::path::Path;
use std::ptr::NonNull;

use caudal::error::{Error, Result};
use caudal::fmu::{Catalogue, LOG_CATEGORIES, Standard, token};
use caudal::integrator::StepControl;
use caudal::scene::{Document, Scene, parameter};
use caudal::stepper::Stepper;
use caudal::variable::{Size, VARIABLES, Variable};
use serde::{Deserialize, Serialize};

pub use saved::SavedState;
use values::SetInputs;

use crate::status::{FmiResult, Status, refuse};

/// The mode of an instance between calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum InstanceMode {
    Instantiated,
    Configuration,
    Initialization,
    Step,
    /// Within the host's callback during a step.
    Intermediate,
    /// A step was discarded (FMI 2.0).
    StepFailed,
    Terminated,
    /// After a panic.
    Fatal,
}

/// The host's callback for intermediate updates.
pub type IntermediateUpdate = unsafe extern "C" fn(*mut c_void, f64, u8, u8, u8, u8, *mut u8, *mut f64);

/// The receiver of messages.
pub type Logger = Box<dyn Fn(Status, &str, &str)>;

/// Settings that a host makes before the model is built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Settings {
    nodes: u64,
    parameters: Vec<f64>,
    /// The host's relative tolerance, for scenes with adaptive steps.
    tolerance: Option<f64>,
}

/// Start and stop time of the experiment, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    pub start: f64,
    pub stop: Option<f64>,
}

/// The stepper: owned, or borrowed from the current step during an intermediate update.
#[derive(Default)]
struct SharedStepper {
    own: Option<Box<Stepper>>,
    lent: Option<NonNull<Stepper>>,
}

impl SharedStepper {
    fn get(&self) -> Option<&Stepper> {
        match self.lent {
            // SAFETY: only set by `Instance::do_step` during the host's callback, from a reference that lives longer.
            Some(lent) => Some(unsafe { lent.as_ref() }),
            None => self.own.as_deref(),
        }
    }

    fn get_mut(&mut self) -> Option<&mut Stepper> {
        match self.lent {
            // SAFETY: as above, and that reference is not used during the callback.
            Some(mut lent) => Some(unsafe { lent.as_mut() }),
            None => self.own.as_deref_mut(),
        }
    }
}

/// An instance.
pub struct Instance {
    pub mode: InstanceMode,
    pub experiment: Experiment,
    catalogue: Catalogue,
    scene: Scene,
    document: Document,
    original: Settings,
    /// The settings of the host, which are passed to the stepper when it is needed.
    settings: Settings,
    /// The inputs that the host has set at this time.
    inputs: SetInputs,
    /// True if the stepper was not built with `settings`.
    stale: bool,
    stepper: SharedStepper,
    /// The settings that the stepper was built with.
    built: Settings,
    /// The end of the last step according to the host's own summation, s.
    host_time: Option<f64>,
    /// The number of values of each variable; 1 for a scalar.
    lengths: Vec<usize>,
    /// The index of the parameter for the number of nodes.
    nodes_place: usize,
    log: Logger,
    logged: Vec<&'static str>,
    seeds: Vec<Vec<f64>>,
    /// Opaque pointer of the host, which keeps it alive.
    pub environment: *mut c_void,
    /// Called after every internal step (FMI 3.0).
    pub intermediate_update: Option<IntermediateUpdate>,
    /// True if that call may request to end the step (FMI 3.0).
    pub early_return_allowed: bool,
}

impl Instance {
    /// Reads the scene in `resources`, and checks the host's token for it.
    pub fn new(resources: &Path, host_token: &str, log: Logger, environment: *mut c_void) -> Result<Self> {
        let document = Document::unpack(resources)?;
        let scene = document.scene()?;
        let own = token(&scene);
        if own != host_token {
            return Err(Error::Fmu(format!("the host expects the token {host_token}, this FMU has {own}")));
        }
        let stepper = document.stepper(&scene)?;
        let catalogue = Catalogue::of(&scene, &stepper);
        let parameters = catalogue.parameters.iter().map(|parameter| parameter.value).collect();
        let original = Settings { nodes: scene.nodes() as u64, parameters, tolerance: None };
        let mut instance = Self {
            mode: InstanceMode::Instantiated,
            experiment: Experiment { start: 0.0, stop: None },
            inputs: SetInputs::default(),
            catalogue,
            scene,
            document,
            settings: original.clone(),
            built: original.clone(),
            original,
            lengths: Vec::new(),
            nodes_place: VARIABLES
                .iter()
                .position(|variable| variable.name == caudal::fmu::NODES)
                .unwrap_or(usize::MAX),
            stepper: SharedStepper { own: Some(Box::new(stepper)), lent: None },
            stale: false,
            host_time: None,
            log,
            logged: vec![Status::Error.category()],
            seeds: Vec::new(),
            environment,
            intermediate_update: None,
            early_return_allowed: false,
        };
        instance.size();
        Ok(instance)
    }

    /// Updates the lengths of variables to the host's number of nodes.
    fn size(&mut self) {
        let nodes = self.settings.nodes as usize;
        let length = |variable: &Variable| if variable.size == Size::Scalar { 1 } else { nodes };
        self.lengths = VARIABLES.iter().map(length).collect();
    }

    /// Logs a message, if its category is enabled.
    pub fn log_message(&self, status: Status, message: &str) {
        if self.logged.contains(&status.category()) {
            (self.log)(status, status.category(), message);
        }
    }

    /// Enables or disables categories of messages, all if none is given, according to `standard`: FMI 2.0 logs exactly the
    /// categories of the last call, and none once logging is off; FMI 3.0 adds and removes categories, and always logs errors.
    pub fn log_categories(&mut self, standard: Standard, on: bool, categories: &[&str]) -> FmiResult {
        let known = LOG_CATEGORIES.iter().map(|(name, _)| *name);
        if let Some(other) = categories.iter().find(|name| !known.clone().any(|known| known == **name)) {
            return refuse(format!("there is no log category `{other}`"));
        }
        let meant = |name: &&str| categories.is_empty() || categories.contains(name);
        match (standard, on) {
            (Standard::Fmi2, false) => self.logged.clear(),
            (Standard::Fmi2, true) => self.logged = known.filter(meant).collect(),
            (Standard::Fmi3, true) => self.logged.extend(known.filter(meant)),
            (Standard::Fmi3, false) => self.logged.retain(|name| !meant(name) || *name == Status::Error.category()),
        }
        Ok(())
    }

    /// Marks the instance as unusable after a panic.
    pub fn mark_fatal(&mut self) {
        self.mode = InstanceMode::Fatal;
        self.stepper.lent = None;
    }

    /// Returns an error unless the instance is in one of these modes.
    #[inline]
    pub fn require_mode(&self, modes: &[InstanceMode]) -> FmiResult {
        if modes.contains(&self.mode) { Ok(()) } else { wrong_mode(self.mode) }
    }

    /// Changes to mode `to`, which is only allowed from one of `from`.
    pub fn change_mode(&mut self, from: &[InstanceMode], to: InstanceMode) -> FmiResult {
        self.require_mode(from)?;
        self.mode = to;
        Ok(())
    }

    /// True after initialisation. From then on the stepper is not rebuilt.
    fn has_started(&self) -> bool {
        !matches!(self.mode, InstanceMode::Instantiated | InstanceMode::Configuration | InstanceMode::Initialization)
    }

    /// The scene with these settings, and its document.
    fn configured(&self, settings: &Settings) -> Result<(Document, Scene)> {
        let mut document = self.document.clone();
        document.begin_layer();
        for text in parameter::overrides(&self.catalogue.parameters, &settings.parameters) {
            document.set(&text)?;
        }
        if settings.nodes != self.original.nodes {
            document.set(&format!("rod.nodes={}", settings.nodes - self.scene.front() as u64))?;
        }
        if let Some(tolerance) = settings.tolerance {
            document.set(&format!("solver.tolerance={tolerance:e}"))?;
        }
        let scene = document.scene()?;
        Ok((document, scene))
    }

    /// The stepper with all settings and inputs of the host. Nothing changes on error.
    pub fn ready(&mut self) -> FmiResult<&mut Stepper> {
        if self.stale {
            self.rebuild()?;
        }
        if self.inputs.is_pending() {
            self.pass_inputs()?;
        }
        self.stepper.get_mut().map_or_else(|| refuse("there is no model"), Ok)
    }

    /// Builds the stepper with the host's settings and inputs, or changes its tunable parameters after the start.
    fn rebuild(&mut self) -> FmiResult {
        let (document, scene) = self.configured(&self.settings)?;
        if self.has_started() {
            self.stepper
                .get_mut()
                .map_or_else(|| refuse("there is no model"), |stepper| Ok(stepper.change_parameters(&scene)?))?;
        } else {
            let mut stepper = document.stepper(&scene)?;
            stepper.set_entries(self.inputs.changes(stepper.model(), true).into_iter())?;
            self.stepper.own = Some(Box::new(stepper));
            self.inputs.mark_applied();
        }
        self.built.clone_from(&self.settings);
        self.stale = false;
        Ok(())
    }

    pub fn set_experiment(&mut self, experiment: Experiment) -> FmiResult {
        let Experiment { start, stop } = experiment;
        if !start.is_finite() || stop.is_some_and(|stop| stop.is_nan() || stop < start) {
            return refuse(format!("start {start} s and stop {stop:?} s are not a valid experiment"));
        }
        self.experiment = experiment;
        Ok(())
    }

    /// Sets the tolerance of adaptive internal steps to the host's, or to the scene's own.
    pub fn set_tolerance(&mut self, tolerance: Option<f64>) -> FmiResult {
        if let Some(tolerance) = tolerance.filter(|tolerance| !(*tolerance > 0.0 && *tolerance < 1.0)) {
            return refuse(format!("a relative tolerance of {tolerance}; allowed: between 0 and 1"));
        }
        let tolerance = tolerance.filter(|_| matches!(self.scene.step_control(), StepControl::Adaptive(_)));
        if self.settings.tolerance != tolerance {
            self.settings.tolerance = tolerance;
            self.stale = true;
        }
        Ok(())
    }

    /// Enters initialisation of an experiment, or changes nothing.
    pub fn enter_initialization_of(&mut self, experiment: Experiment, tolerance: Option<f64>) -> FmiResult {
        let before = (self.experiment, self.settings.tolerance, self.stale);
        let entered = self
            .set_experiment(experiment)
            .and_then(|()| self.set_tolerance(tolerance))
            .and_then(|()| self.enter_initialization());
        if entered.is_err() {
            (self.experiment, self.settings.tolerance, self.stale) = before;
        }
        entered
    }

    pub fn enter_initialization(&mut self) -> FmiResult {
        self.ready()?;
        self.mode = InstanceMode::Initialization;
        Ok(())
    }

    pub fn exit_initialization(&mut self) -> FmiResult {
        let note = self.ready()?.fluid_note();
        if let Some(note) = note {
            self.log_message(Status::Warning, &note);
        }
        self.mode = InstanceMode::Step;
        Ok(())
    }

    pub fn reset(&mut self) -> FmiResult {
        let stepper = self.document.stepper(&self.scene)?;
        self.stepper.own = Some(Box::new(stepper));
        self.settings.clone_from(&self.original);
        self.built.clone_from(&self.original);
        self.inputs.clear();
        self.experiment = Experiment { start: 0.0, stop: None };
        (self.stale, self.host_time, self.mode) = (false, None, InstanceMode::Instantiated);
        self.size();
        Ok(())
    }

    /// The current time of the host, s.
    pub fn time(&self) -> f64 {
        self.experiment.start + self.stepper.get().map_or(0.0, Stepper::time)
    }
}

#[cold]
fn wrong_mode(mode: InstanceMode) -> FmiResult {
    refuse(format!("not allowed in mode {mode:?}"))
}
