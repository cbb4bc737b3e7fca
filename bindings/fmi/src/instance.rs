//! One instance of the FMU, whatever the version of the standard: its modes, values, states and log.

use std::ffi::c_void;
use std::ops::ControlFlow;
use std::path::Path;
use std::ptr::NonNull;

use caudal::error::{Error, Result};
use caudal::fmu::{Catalogue, LOG_CATEGORIES, Target, token};
use caudal::model::Model;
use caudal::model::course::HIGHEST_ORDER;
use caudal::scene::{Document, NODES, Scene, parameter};
use caudal::stepper::snapshot::{self, Snapshot};
use caudal::stepper::{Change, Stepper};
use caudal::variable::{Causality, Size, VARIABLES, Variable};
use serde::{Deserialize, Serialize};

/// How a call ended; the numbers are those of both versions of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// All well.
    Ok = 0,
    /// Done, but not quite as asked.
    #[expect(dead_code, reason = "part of the standard's enumeration")]
    Warning = 1,
    /// Not done; what was before is still there.
    Discard = 2,
    /// The call is not allowed here.
    Error = 3,
    /// The instance is broken.
    Fatal = 4,
}

impl Status {
    fn category(self) -> &'static str {
        match self {
            Self::Ok => "logSteps",
            Self::Warning => "logStatusWarning",
            Self::Discard => "logStatusDiscard",
            Self::Error | Self::Fatal => "logStatusError",
        }
    }
}

/// Why a call was refused.
#[derive(Debug)]
pub struct Refusal {
    pub status: Status,
    pub message: String,
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        Self { status: Status::Error, message: error.to_string() }
    }
}

impl Refusal {
    /// A step that cannot be made.
    fn discard(error: Error) -> Self {
        Self { status: Status::Discard, message: error.to_string() }
    }
}

/// Refuses a call.
pub fn refuse<T>(message: impl Into<String>) -> Outcome<T> {
    Err(Refusal { status: Status::Error, message: message.into() })
}

pub type Outcome<T = ()> = std::result::Result<T, Refusal>;

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
    /// After an error in a step: only reading, reset, and going back to a saved state.
    Error,
    /// After a panic.
    Fatal,
}

/// The host's function for the middle of a step.
pub type IntermediateUpdate = unsafe extern "C" fn(*mut c_void, f64, u8, u8, u8, u8, *mut u8, *mut f64);

/// Where messages go.
pub type Logger = Box<dyn Fn(Status, &str, &str)>;

/// A saved state of an instance.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SavedState {
    mode: Mode,
    settings: Settings,
    experiment: Experiment,
    inputs: Inputs,
    snapshot: Snapshot,
}

/// What a host chooses before the model is built.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Settings {
    nodes: u64,
    parameters: Vec<f64>,
}

/// Begin and end of the experiment, s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Experiment {
    pub start: f64,
    pub stop: Option<f64>,
}

/// The host's inputs, which wait here until they are needed: one flat array for each input, in nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Inputs {
    /// Values and their derivatives; empty for what is no input, or no derivative yet.
    values: Vec<[Vec<f64>; HIGHEST_ORDER + 1]>,
    /// Set since they were last handed over.
    waiting: Vec<[bool; HIGHEST_ORDER + 1]>,
    any: bool,
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
    settings: Settings,
    /// Built with these settings when first needed.
    stepper: Held,
    stale: bool,
    inputs: Inputs,
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

/// How far a step came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    pub time: f64,
    pub early: bool,
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
        let original = Settings { nodes: scene.rod.nodes.get() as u64, parameters };
        let mut instance = Self {
            mode: Mode::Instantiated,
            experiment: Experiment { start: 0.0, stop: None },
            inputs: Inputs { values: Vec::new(), waiting: Vec::new(), any: false },
            catalogue,
            scene,
            document,
            settings: original.clone(),
            original,
            lengths: Vec::new(),
            nodes_place: VARIABLES
                .iter()
                .position(|variable| variable.name == caudal::fmu::NODES)
                .unwrap_or(usize::MAX),
            stepper: Held { own: Some(Box::new(stepper)), lent: None },
            stale: false,
            log,
            logged: Vec::new(),
            seeds: Vec::new(),
            environment,
            intermediate_update: None,
            early_return_allowed: false,
        };
        instance.size();
        Ok(instance)
    }

    /// Makes room for the variables with the number of nodes there is; inputs are forgotten.
    fn size(&mut self) {
        let nodes = self.settings.nodes as usize;
        let length = |variable: &Variable| if variable.size == Size::Scalar { 1 } else { nodes };
        self.lengths = VARIABLES.iter().map(length).collect();
        self.inputs.values = vec![Default::default(); VARIABLES.len()];
        self.inputs.waiting = vec![Default::default(); VARIABLES.len()];
        self.inputs.any = false;
    }

    /// Logs a message, if its category is on or it is about a refusal.
    pub fn say(&self, status: Status, message: &str) {
        if status != Status::Ok || self.logged.contains(&status.category()) {
            (self.log)(status, status.category(), message);
        }
    }

    /// Turns categories of messages on or off; all where none is named.
    pub fn log_categories(&mut self, on: bool, categories: &[&str]) -> Outcome {
        let known = LOG_CATEGORIES.iter().map(|(name, _)| *name);
        if let Some(other) = categories.iter().find(|name| !known.clone().any(|known| known == **name)) {
            return refuse(format!("there is no log category `{other}`"));
        }
        let meant = |name: &&str| categories.is_empty() || categories.contains(name);
        if on {
            self.logged.extend(known.filter(meant));
        } else {
            self.logged.retain(|name| !meant(name));
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

    /// The mode in which inputs and parameters are set and all is read.
    fn is_running(&self) -> bool {
        matches!(self.mode, Mode::Step | Mode::Intermediate)
    }

    // Structure ----------------------------------------------------------------------------------------------------

    /// Entries of a variable of FMI 3.0.
    #[inline]
    pub fn len3(&self, reference: u32) -> Option<usize> {
        match self.catalogue.target(reference)? {
            Target::Variable(place, _) => Some(self.lengths[place]),
            Target::Parameter(_) => Some(1),
        }
    }

    /// The target of a scalar of FMI 2.0.
    #[inline]
    pub fn scalar(&self, reference: u32) -> Outcome<Target> {
        match self.catalogue.scalar_target(reference) {
            Some(target @ Target::Variable(place, node)) if node < self.lengths[place] => {
                let nodes = if node == 0 && self.lengths[place] == 1 { 0..1 } else { self.entries(place) };
                if nodes.contains(&node) { Ok(target) } else { unknown(reference) }
            }
            Some(target @ Target::Parameter(_)) => Ok(target),
            _ => unknown(reference),
        }
    }

    /// The nodes at which a variable has entries.
    fn entries(&self, place: usize) -> std::ops::Range<usize> {
        let nodes = self.settings.nodes as usize;
        match VARIABLES[place].size {
            Size::Scalar => 0..1,
            Size::Nodes => 0..nodes,
            Size::Joints => usize::from(self.scene.head.kind == caudal::scene::HeadKind::Free)..nodes - 1,
        }
    }

    /// The target of a variable of FMI 3.0.
    #[inline]
    pub fn target(&self, reference: u32) -> Outcome<Target> {
        self.catalogue.target(reference).map_or_else(|| unknown(reference), Ok)
    }

    /// The target of a real scalar of FMI 2.0.
    #[inline]
    pub fn real(&self, reference: u32) -> Outcome<Target> {
        self.no_integer(self.scalar(reference)?)
    }

    /// The target of a Float64 of FMI 3.0.
    #[inline]
    pub fn float(&self, reference: u32) -> Outcome<Target> {
        self.no_integer(self.target(reference)?)
    }

    fn no_integer(&self, target: Target) -> Outcome<Target> {
        match target {
            Target::Variable(place, _) if place == self.nodes_place => refuse("`nodes` is an integer"),
            other => Ok(other),
        }
    }

    /// The value of an integer; there is one, the number of nodes.
    pub fn integer(&self, target: Target) -> Outcome<u64> {
        match target {
            Target::Variable(place, _) if place == self.nodes_place => Ok(self.settings.nodes),
            _ => refuse("this variable is no integer"),
        }
    }

    /// Sets the structural parameter.
    pub fn set_nodes(&mut self, nodes: u64) -> Outcome {
        if !(NODES[0]..=NODES[1]).contains(&nodes) {
            return refuse(format!("nodes: found {nodes}; allowed: {} to {}", NODES[0], NODES[1]));
        }
        if nodes != self.settings.nodes {
            self.settings.nodes = nodes;
            (self.stale, self.stepper.own) = (true, None);
            self.size();
        }
        Ok(())
    }

    // Life ---------------------------------------------------------------------------------------------------------

    /// The scene with the host's settings.
    fn build(&self) -> Result<Stepper> {
        let mut document = self.document.clone();
        for text in parameter::overrides(&self.catalogue.parameters, &self.settings.parameters) {
            document.set(&text)?;
        }
        if self.settings.nodes != self.original.nodes {
            document.set(&format!("rod.nodes={}", self.settings.nodes))?;
        }
        Stepper::of(&document.scene()?)
    }

    /// The stepper with everything that the host has set.
    pub fn ready(&mut self) -> Outcome<&mut Stepper> {
        if self.stale || self.stepper.get().is_none() {
            let stepper = self.build()?;
            for (values, waiting) in self.inputs.values.iter().zip(&mut self.inputs.waiting) {
                *waiting = std::array::from_fn(|order| !values[order].is_empty());
            }
            self.inputs.any = self.inputs.waiting.iter().flatten().any(|waiting| *waiting);
            (self.stepper.own, self.stale) = (Some(Box::new(stepper)), false);
        }
        if self.inputs.any {
            self.hand_over()?;
        }
        self.stepper.get_mut().map_or_else(|| refuse("there is no model"), Ok)
    }

    /// Gives the stepper the inputs that wait.
    fn hand_over(&mut self) -> Outcome {
        let Some(stepper) = self.stepper.get_mut() else { return Ok(()) };
        let inputs = inputs_by_place(&self.inputs, stepper.model());
        let outcome = stepper.set_all(inputs);
        // Whatever the answer, nothing waits: what was refused is gone.
        self.inputs.waiting.fill(Default::default());
        self.inputs.any = false;
        if outcome.is_err() {
            self.inputs.values.iter_mut().flatten().for_each(Vec::clear);
        }
        Ok(outcome?)
    }

    pub fn set_experiment(&mut self, experiment: Experiment) -> Outcome {
        let Experiment { start, stop } = experiment;
        if !start.is_finite() || stop.is_some_and(|stop| stop.is_nan() || stop < start) {
            return refuse(format!("start {start} s and stop {stop:?} s are no experiment"));
        }
        self.experiment = experiment;
        Ok(())
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
        self.settings = self.original.clone();
        self.experiment = Experiment { start: 0.0, stop: None };
        (self.stepper.own, self.stale, self.mode) = (None, true, Mode::Instantiated);
        self.size();
        Ok(())
    }

    /// The host's time now, s.
    pub fn time(&self) -> f64 {
        self.experiment.start + self.stepper.get().map_or(0.0, Stepper::time)
    }

    // Values -------------------------------------------------------------------------------------------------------

    /// Reads a value; inputs were handed over before.
    #[inline]
    pub fn value(&self, target: Target) -> f64 {
        match (target, self.stepper.get()) {
            (Target::Parameter(place), _) => self.settings.parameters[place],
            (Target::Variable(place, node), Some(stepper)) => {
                let variable = &VARIABLES[place];
                let value = variable.at(&stepper.view(), node);
                if variable.causality == Causality::Independent { self.experiment.start + value } else { value }
            }
            (Target::Variable(..), None) => f64::NAN,
        }
    }

    /// Makes ready for reading.
    #[inline]
    pub fn settle(&mut self) -> Outcome {
        if self.inputs.any || self.stale {
            self.ready()?;
        }
        Ok(())
    }

    /// Reads all entries of a variable of FMI 3.0; the length has been checked.
    pub fn read(&self, target: Target, out: &mut [f64]) {
        match target {
            Target::Variable(place, _) if out.len() > 1 => {
                let nodes = self.entries(place);
                for (k, out) in out.iter_mut().enumerate() {
                    *out = if nodes.contains(&k) { self.value(Target::Variable(place, k)) } else { 0.0 };
                }
            }
            _ => out[0] = self.value(target),
        }
    }

    /// Sets entries of a variable from `node` on, or a parameter.
    pub fn set(&mut self, target: Target, values: &[f64]) -> Outcome {
        match target {
            Target::Parameter(place) => {
                let parameter = &self.catalogue.parameters[place];
                if self.is_running() {
                    return refuse(format!("{} is fixed: it can be set until initialisation ends", parameter.name()));
                }
                let value = values[0];
                if !value.is_finite() || !parameter.range.contains(&value) {
                    return refuse(format!("{}: found {value}; allowed: {:?}", parameter.name(), parameter.range));
                }
                if self.settings.parameters[place] != value {
                    self.settings.parameters[place] = value;
                    self.stale = true;
                }
                Ok(())
            }
            Target::Variable(place, node) => self.set_input(place, node, 0, values),
        }
    }

    /// Sets a derivative of an input.
    pub fn set_derivative(&mut self, target: Target, order: i32, value: f64) -> Outcome {
        match (target, usize::try_from(order)) {
            (Target::Variable(place, node), Ok(order @ 1..=HIGHEST_ORDER)) => {
                self.set_input(place, node, order, &[value])
            }
            (Target::Variable(..), _) => {
                refuse(format!("a derivative of order {order} cannot be set; allowed: 1 to {HIGHEST_ORDER}"))
            }
            (Target::Parameter(_), _) => refuse("a parameter has no derivative"),
        }
    }

    fn set_input(&mut self, place: usize, node: usize, order: usize, values: &[f64]) -> Outcome {
        let variable = &VARIABLES[place];
        if !variable.is_input() {
            return refuse(format!("{} is not an input: it cannot be set", variable.name));
        }
        let finite = values.iter().find(|value| !value.is_finite());
        if let Some((value, allowed)) =
            finite.map(|x| (*x, "a finite number")).or_else(|| if order == 0 { variable.refused(values) } else { None })
        {
            return refuse(format!("{}: found {value}; allowed: {allowed}", variable.name));
        }
        if order == 0 && !self.inputs.waiting[place][0] {
            // Entries that are not set now stay as they are, and after a new value nothing goes on by itself.
            if self.stale || self.stepper.get().is_none() {
                self.ready()?;
            }
            let mut now = std::mem::take(&mut self.inputs.values[place]);
            now[0].resize(self.lengths[place], 0.0);
            for k in self.entries(place) {
                now[0][k] = self.value(Target::Variable(place, k));
            }
            now[1..].iter_mut().for_each(Vec::clear);
            self.inputs.values[place] = now;
            self.inputs.waiting[place] = Default::default();
        }
        self.inputs.waiting[place][order] = true;
        self.inputs.any = true;
        let entries = &mut self.inputs.values[place][order];
        entries.resize(self.lengths[place], 0.0);
        entries[node..node + values.len()].copy_from_slice(values);
        Ok(())
    }

    // Steps --------------------------------------------------------------------------------------------------------

    /// Refuses a step that the host may not ask for.
    fn check_step(&self, current: f64, h: f64) -> Outcome {
        let now = self.time();
        if !(h.is_finite() && h > 0.0) {
            return refuse(format!("a step of {h} s cannot be made: it must be positive and finite"));
        }
        // Hosts add up their steps with rounding errors of their own.
        let slack = |time: f64| 1e-3 * h + 1e-9 * time.abs();
        if (current - now).abs() > slack(now) || !current.is_finite() {
            return refuse(format!("the communication point {current} s is not the time of this instance, {now} s"));
        }
        match self.experiment.stop {
            Some(stop) if now + h > stop + slack(stop) => {
                refuse(format!("a step from {now} s by {h} s goes beyond the stop time, {stop} s"))
            }
            _ => Ok(()),
        }
    }

    /// Moves on from `current` by `h` (s); `look` sees every internal step by its time and whether it is the last, and may
    /// break there with the time at which it wants to end.
    ///
    /// # Safety
    /// `this` is an instance. No reference to it lives while `look` runs, so a host may call with it.
    pub unsafe fn do_step(
        this: *mut Self,
        current: f64,
        h: f64,
        look: Option<&mut dyn FnMut(f64, bool) -> ControlFlow<f64>>,
    ) -> Outcome<Reached> {
        // SAFETY: the caller's promise; this reference ends before `look` runs.
        let instance = unsafe { &mut *this };
        instance.check_step(current, h)?;
        instance.ready()?;
        let Some(mut stepper) = instance.stepper.own.take() else { return refuse("there is no model") };
        let (start, from) = (instance.experiment.start, stepper.time());
        let before = (stepper.work().newton_iterations, stepper.meter().totals.steps);
        let outcome = match look {
            None => stepper.do_step(h).map(|()| true).map_err(Refusal::discard),
            // SAFETY: the same promise.
            Some(look) => unsafe { Self::do_step_watched(this, &mut stepper, h, look) },
        };
        let (time, iterations, steps) =
            (stepper.time(), stepper.work().newton_iterations - before.0, stepper.meter().totals.steps - before.1);
        // SAFETY: the same promise.
        let instance = unsafe { &mut *this };
        instance.stepper.own = Some(stepper);
        if instance.logged.contains(&Status::Ok.category()) {
            let (from, to) = (start + from, start + time);
            instance.say(
                Status::Ok,
                &format!("{from} s to {to} s: {steps} internal steps, {iterations} Newton iterations"),
            );
        }
        outcome.map(|whole| Reached { time: start + time, early: !whole })
    }

    /// # Safety
    /// Those of [`do_step`](Self::do_step).
    unsafe fn do_step_watched(
        this: *mut Self,
        stepper: &mut Stepper,
        h: f64,
        look: &mut dyn FnMut(f64, bool) -> ControlFlow<f64>,
    ) -> Outcome<bool> {
        let goal = stepper.time() + h;
        let (mut wish, mut refusal) = (None, None);
        let mut watch = |stepper: &mut Stepper| {
            // SAFETY: the caller's promise; each reference ends with its statement.
            let start = unsafe { &mut *this }.lend(stepper);
            let answer = look(start + stepper.time(), stepper.time() >= goal);
            // SAFETY: the same.
            refusal = unsafe { &mut *this }.take_back().err();
            match answer {
                ControlFlow::Continue(()) if refusal.is_none() => ControlFlow::Continue(()),
                ControlFlow::Continue(()) => ControlFlow::Break(()),
                ControlFlow::Break(time) => {
                    wish = Some(time - start);
                    ControlFlow::Break(())
                }
            }
        };
        let whole = stepper.do_step_with(h, &mut watch).map_err(Refusal::discard)?;
        if let Some(refusal) = refusal {
            return Err(refusal);
        }
        // On to the time at which the host wants to end.
        let left = wish.map_or(0.0, |wish: f64| wish.min(goal) - stepper.time());
        if whole || left <= 1e-9 * h {
            return Ok(whole);
        }
        stepper.do_step(left).map_err(Refusal::discard)?;
        Ok(stepper.time() >= goal)
    }

    /// Gives calls of the host in the middle of a step the stepper to work on; returns the start of the experiment, s.
    fn lend(&mut self, stepper: &mut Stepper) -> f64 {
        self.stepper.lent = Some(NonNull::from(stepper));
        self.mode = Mode::Intermediate;
        self.experiment.start
    }

    /// Hands over what the host has set in the middle of a step.
    fn take_back(&mut self) -> Outcome {
        let outcome = if self.inputs.any { self.hand_over() } else { Ok(()) };
        self.stepper.lent = None;
        self.mode = Mode::Step;
        outcome
    }

    // Derivatives --------------------------------------------------------------------------------------------------

    /// The place of an output.
    fn output(&self, target: Target) -> Outcome<usize> {
        match target {
            Target::Variable(place, _) if VARIABLES[place].causality == Causality::Output => Ok(place),
            _ => refuse("only outputs have derivatives"),
        }
    }

    /// The variables of outputs with their nodes; none where a variable has no entry at its node, and so is always zero.
    fn outputs(&self, unknowns: &[(Target, usize)]) -> Outcome<Vec<Option<(&'static Variable, usize)>>> {
        let output = |(target, k): &(Target, usize)| {
            let place = self.output(*target)?;
            Ok(self.entries(place).contains(k).then_some((&VARIABLES[place], *k)))
        };
        unknowns.iter().map(output).collect()
    }

    /// The place of an input.
    fn input(&self, target: Target) -> Outcome<usize> {
        match target {
            Target::Variable(place, _) if VARIABLES[place].is_input() => Ok(place),
            _ => refuse("derivatives are by inputs only"),
        }
    }

    /// Writes the first derivatives by time of outputs at their nodes.
    pub fn rates(&mut self, unknowns: &[(Target, usize)], out: &mut [f64]) -> Outcome {
        let outputs = self.outputs(unknowns)?;
        let rates = self.ready()?.rates()?;
        for (out, output) in out.iter_mut().zip(outputs) {
            *out = output.map_or(0.0, |(variable, k)| rates.of(variable, k));
        }
        Ok(())
    }

    /// Writes the change of `unknowns` (outputs at nodes) when `knowns` (inputs at nodes) change by `seed`.
    pub fn directional(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> Outcome {
        let outputs = self.outputs(unknowns)?;
        self.seeds.resize(VARIABLES.len(), Vec::new());
        self.seeds.iter_mut().for_each(Vec::clear);
        for ((target, k), seed) in knowns.iter().zip(seed) {
            let place = self.input(*target)?;
            let seeds = &mut self.seeds[place];
            seeds.resize(self.lengths[place], 0.0);
            seeds[*k] += seed;
        }
        let entries: Vec<_> = (0..VARIABLES.len()).map(|place| self.entries(place)).collect();
        let seeds = std::mem::take(&mut self.seeds);
        let change = self.ready()?.directional(|inputs| {
            for ((variable, seeds), nodes) in VARIABLES.iter().zip(&seeds).zip(&entries) {
                if !seeds.is_empty() {
                    inputs.set(variable, &seeds[nodes.clone()]);
                }
            }
        })?;
        for (out, output) in out.iter_mut().zip(outputs) {
            *out = output.map_or(0.0, |(variable, k)| change.of(variable, k));
        }
        self.seeds = seeds;
        Ok(())
    }

    /// Writes the sum over `unknowns` of `seed` times their change by each of `knowns`: one direction for each of these.
    pub fn adjoint(
        &mut self,
        unknowns: &[(Target, usize)],
        knowns: &[(Target, usize)],
        seed: &[f64],
        out: &mut [f64],
    ) -> Outcome {
        let mut changes = vec![0.0; unknowns.len()];
        for (known, out) in knowns.iter().zip(out) {
            self.directional(unknowns, std::slice::from_ref(known), &[1.0], &mut changes)?;
            *out = changes.iter().zip(seed).map(|(change, seed)| change * seed).sum();
        }
        Ok(())
    }

    /// The dependencies of a variable of FMI 3.0: node of the dependent, place and node of the input.
    pub fn dependencies(&mut self, target: Target) -> Outcome<Vec<(usize, usize, usize)>> {
        let variable = &VARIABLES[self.output(target)?];
        let stepper = self.ready()?;
        let (model, form) = (stepper.model(), stepper.form());
        let inputs = || VARIABLES.iter().enumerate().filter(|(_, input)| input.is_input() && input.exists_in(model));
        let of = |node: usize| {
            inputs().flat_map(move |(place, input)| {
                variable.follows(node, input, model, form).map(move |k| (node, place, k))
            })
        };
        Ok(variable.entries(model).flat_map(of).collect())
    }

    // States -------------------------------------------------------------------------------------------------------

    /// A copy of everything that changes.
    pub fn save(&mut self) -> Outcome<SavedState> {
        let snapshot = self.ready()?.save();
        let (settings, experiment, inputs) = (self.settings.clone(), self.experiment, self.inputs.clone());
        Ok(SavedState { mode: self.mode, settings, experiment, inputs, snapshot })
    }

    /// Goes back to a saved state.
    pub fn restore(&mut self, state: &SavedState) -> Outcome {
        let before = (self.settings.clone(), self.stepper.own.take(), self.stale);
        if self.settings == state.settings && !self.stale {
            self.stepper.own = before.1;
        } else {
            self.settings = state.settings.clone();
            match self.build() {
                Ok(stepper) => self.stepper.own = Some(Box::new(stepper)),
                Err(error) => {
                    (self.settings, self.stepper.own, self.stale) = before;
                    return Err(error.into());
                }
            }
        }
        self.size();
        self.stale = false;
        if let Some(stepper) = &mut self.stepper.own {
            stepper.restore(&state.snapshot)?;
        }
        self.inputs.clone_from(&state.inputs);
        (self.mode, self.experiment) = (state.mode, state.experiment);
        Ok(())
    }

    /// A saved state as bytes, which any instance of this scene takes over.
    pub fn serialize(&self, state: &SavedState) -> Outcome<Vec<u8>> {
        Ok(snapshot::seal(self.scene.fingerprint(), state)?)
    }

    /// The saved state in `bytes`.
    pub fn deserialize(&self, bytes: &[u8]) -> Outcome<SavedState> {
        let state: SavedState = snapshot::open(self.scene.fingerprint(), bytes)?;
        let Inputs { values, waiting, .. } = &state.inputs;
        let nodes = state.settings.nodes as usize;
        let fits = |(values, variable): (&[Vec<f64>; HIGHEST_ORDER + 1], &Variable)| {
            let len = if variable.size == Size::Scalar { 1 } else { nodes };
            values.iter().all(|values| values.is_empty() || values.len() == len)
        };
        let same = (NODES[0]..=NODES[1]).contains(&state.settings.nodes)
            && state.settings.parameters.len() == self.settings.parameters.len()
            && [values.len(), waiting.len()] == [VARIABLES.len(); 2]
            && values.iter().zip(VARIABLES).all(fits);
        if same { Ok(state) } else { refuse("the saved state cannot be read: its sizes are not this scene's") }
    }
}

/// The changes that wait.
fn inputs_by_place<'a>(inputs: &'a Inputs, model: &Model) -> impl Iterator<Item = Change<'a>> + Clone + use<'a> {
    let first = usize::from(model.head.is_none());
    let last = model.rod.nodes - 1;
    let waiting = VARIABLES.iter().zip(&inputs.values).zip(&inputs.waiting);
    waiting.flat_map(move |((variable, values), waiting)| {
        let of = values.iter().zip(waiting).enumerate().filter(|(_, (_, waiting))| **waiting);
        of.map(move |(order, (values, _))| {
            let values = if variable.size == Size::Joints { &values[first..last] } else { &values[..] };
            Change { variable, order, values }
        })
    })
}

#[cold]
fn wrong_mode(mode: Mode) -> Outcome {
    refuse(format!("not allowed in mode {mode:?}"))
}

#[cold]
fn unknown<T>(reference: u32) -> Outcome<T> {
    refuse(format!("there is no variable with value reference {reference}"))
}
