//! One instance of the FMU, whatever the version of the standard: its modes, values, states and log.

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

use crate::status::{Outcome, Status, refuse};

/// Where an instance stands between calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    Instantiated,
    Configuration,
    Initialization,
    Step,
    /// Inside the host's callback of a step.
    Intermediate,
    /// A step was discarded (FMI 2.0).
    StepFailed,
    Terminated,
    /// After a panic.
    Fatal,
}

/// The host's function for the middle of a step.
pub type IntermediateUpdate = unsafe extern "C" fn(*mut c_void, f64, u8, u8, u8, u8, *mut u8, *mut f64);

/// Where messages go.
pub type Logger = Box<dyn Fn(Status, &str, &str)>;

/// What a host chooses before the model is built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Settings {
    nodes: u64,
    parameters: Vec<f64>,
    /// The host's relative tolerance, for scenes whose steps follow one.
    tolerance: Option<f64>,
}

/// Begin and end of the experiment, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    pub start: f64,
    pub stop: Option<f64>,
}

/// The stepper: ours, or lent by the step in which the host looks.
#[derive(Default)]
struct Held {
    own: Option<Box<Stepper>>,
    lent: Option<NonNull<Stepper>>,
}

impl Held {
    fn get(&self) -> Option<&Stepper> {
        match self.lent {
            // SAFETY: set by `Instance::do_step` around the host's callback only, from a reference that lives longer.
            Some(lent) => Some(unsafe { lent.as_ref() }),
            None => self.own.as_deref(),
        }
    }

    fn get_mut(&mut self) -> Option<&mut Stepper> {
        match self.lent {
            // SAFETY: as above, and that reference is not used while the host looks.
            Some(mut lent) => Some(unsafe { lent.as_mut() }),
            None => self.own.as_deref_mut(),
        }
    }
}

/// An instance.
pub struct Instance {
    pub mode: Mode,
    pub experiment: Experiment,
    catalogue: Catalogue,
    scene: Scene,
    document: Document,
    original: Settings,
    /// What the host wants; the stepper has it as soon as it is needed.
    settings: Settings,
    /// What the host has set of the inputs at this time.
    inputs: SetInputs,
    /// The stepper was not built with `settings`.
    stale: bool,
    stepper: Held,
    /// What the stepper was built with.
    built: Settings,
    /// Where the last step ends by the host's own sum, s.
    host_time: Option<f64>,
    /// Values of each variable for one node each; of a scalar, one.
    lengths: Vec<usize>,
    /// The place of the number of nodes.
    nodes_place: usize,
    log: Logger,
    logged: Vec<&'static str>,
    seeds: Vec<Vec<f64>>,
    /// Opaque to us; kept alive by the host.
    pub environment: *mut c_void,
    /// Called after every internal step (FMI 3.0).
    pub intermediate_update: Option<IntermediateUpdate>,
    /// That call may ask to end the step (FMI 3.0).
    pub early_return_allowed: bool,
}

impl Instance {
    /// Reads the scene in `resources` and checks that the host means this scene.
    pub fn new(resources: &Path, host_token: &str, log: Logger, environment: *mut c_void) -> Result<Self> {
        let document = Document::unpack(resources)?;
        let scene = document.scene()?;
        let own = token(&scene);
        if own != host_token {
            return Err(Error::Fmu(format!("the host expects the token {host_token}, this FMU has {own}")));
        }
        let stepper = Stepper::of(&scene)?;
        let catalogue = Catalogue::of(&scene, &stepper);
        let parameters = catalogue.parameters.iter().map(|parameter| parameter.value).collect();
        let original = Settings { nodes: scene.nodes() as u64, parameters, tolerance: None };
        let mut instance = Self {
            mode: Mode::Instantiated,
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
            stepper: Held { own: Some(Box::new(stepper)), lent: None },
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

    /// Finds the lengths of the variables with the number of nodes that the host wants.
    fn size(&mut self) {
        let nodes = self.settings.nodes as usize;
        let length = |variable: &Variable| if variable.size == Size::Scalar { 1 } else { nodes };
        self.lengths = VARIABLES.iter().map(length).collect();
    }

    /// Logs a message, if its category is on.
    pub fn say(&self, status: Status, message: &str) {
        if self.logged.contains(&status.category()) {
            (self.log)(status, status.category(), message);
        }
    }

    /// Turns categories of messages on or off, all where none is named, as `standard` says: FMI 2.0 logs exactly the categories of
    /// the last call, and none once it is off; FMI 3.0 adds and removes them, and always logs errors.
    pub fn log_categories(&mut self, standard: Standard, on: bool, categories: &[&str]) -> Outcome {
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

    /// After a panic nothing of it can be trusted.
    pub fn break_down(&mut self) {
        self.mode = Mode::Fatal;
        self.stepper.lent = None;
    }

    /// Refuses a call in any but these modes.
    #[inline]
    pub fn only_in(&self, modes: &[Mode]) -> Outcome {
        if modes.contains(&self.mode) { Ok(()) } else { wrong_mode(self.mode) }
    }

    /// Moves on to mode `to`, from one of `from` only.
    pub fn change_mode(&mut self, from: &[Mode], to: Mode) -> Outcome {
        self.only_in(from)?;
        self.mode = to;
        Ok(())
    }

    /// True once initialisation is over: from then on the stepper goes on, and is not built anew.
    fn has_started(&self) -> bool {
        !matches!(self.mode, Mode::Instantiated | Mode::Configuration | Mode::Initialization)
    }

    /// The scene with these settings.
    fn configured(&self, settings: &Settings) -> Result<Scene> {
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
        document.scene()
    }

    /// The stepper with everything that the host has set; where that cannot be, nothing has changed.
    pub fn ready(&mut self) -> Outcome<&mut Stepper> {
        if self.stale {
            self.rebuild()?;
        }
        if self.inputs.is_pending() {
            self.hand_over()?;
        }
        self.stepper.get_mut().map_or_else(|| refuse("there is no model"), Ok)
    }

    /// Builds the stepper with the host's settings and inputs; once started it goes on with tuned parameters.
    fn rebuild(&mut self) -> Outcome {
        let scene = self.configured(&self.settings)?;
        if self.has_started() {
            self.stepper
                .get_mut()
                .map_or_else(|| refuse("there is no model"), |stepper| Ok(stepper.retune(&scene)?))?;
        } else {
            let mut stepper = Stepper::of(&scene)?;
            stepper.set_entries(self.inputs.changes(stepper.model(), true).into_iter())?;
            self.stepper.own = Some(Box::new(stepper));
            self.inputs.settle();
        }
        self.built.clone_from(&self.settings);
        self.stale = false;
        Ok(())
    }

    pub fn set_experiment(&mut self, experiment: Experiment) -> Outcome {
        let Experiment { start, stop } = experiment;
        if !start.is_finite() || stop.is_some_and(|stop| stop.is_nan() || stop < start) {
            return refuse(format!("start {start} s and stop {stop:?} s are no experiment"));
        }
        self.experiment = experiment;
        Ok(())
    }

    /// Takes over the tolerance that the host wants, or the scene's own: that of the internal steps where the scene has one.
    pub fn set_tolerance(&mut self, tolerance: Option<f64>) -> Outcome {
        if let Some(tolerance) = tolerance.filter(|tolerance| !(*tolerance > 0.0 && *tolerance < 1.0)) {
            return refuse(format!("a relative tolerance of {tolerance}; allowed: between 0 and 1"));
        }
        let tolerance = tolerance.filter(|_| matches!(self.scene.pace(), StepControl::Adaptive(_)));
        if self.settings.tolerance != tolerance {
            self.settings.tolerance = tolerance;
            self.stale = true;
        }
        Ok(())
    }

    /// Enters initialisation of an experiment, or changes nothing.
    pub fn enter_initialization_of(&mut self, experiment: Experiment, tolerance: Option<f64>) -> Outcome {
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

    pub fn enter_initialization(&mut self) -> Outcome {
        self.ready()?;
        self.mode = Mode::Initialization;
        Ok(())
    }

    pub fn exit_initialization(&mut self) -> Outcome {
        self.ready()?;
        self.mode = Mode::Step;
        Ok(())
    }

    pub fn reset(&mut self) -> Outcome {
        let stepper = Stepper::of(&self.scene)?;
        self.stepper.own = Some(Box::new(stepper));
        self.settings.clone_from(&self.original);
        self.built.clone_from(&self.original);
        self.inputs.clear();
        self.experiment = Experiment { start: 0.0, stop: None };
        (self.stale, self.host_time, self.mode) = (false, None, Mode::Instantiated);
        self.size();
        Ok(())
    }

    /// The host's time now, s.
    pub fn time(&self) -> f64 {
        self.experiment.start + self.stepper.get().map_or(0.0, Stepper::time)
    }
}

#[cold]
fn wrong_mode(mode: Mode) -> Outcome {
    refuse(format!("not allowed in mode {mode:?}"))
}
