//! The stepper, which a host drives: it advances a simulation by `do_step`, reads and sets variables, and saves and restores its state.
//! The command, Python, C and FMUs all use it.

mod dense_output;
pub mod derivatives;
mod equal_steps;
mod head_jump;
mod interpolation;
mod parameter_change;
#[cfg(all(feature = "report", target_arch = "x86_64"))]
pub(crate) mod presolved_step;
mod run_state;
pub mod snapshot;
mod state_vector;
mod step_control;
mod undo;

use std::ops::ControlFlow;
use std::sync::Arc;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use dense_output::DenseOutput;
pub use head_jump::HeadJump;
use run_state::RunState;
pub use snapshot::Snapshot;
pub(crate) use state_vector::Coordinate;
pub use state_vector::{Entry, StateCoordinates};
use step_control::{STEP_FACTORS, step_factor};

use derivatives::InputDirection;

use crate::cycle::Cycles;
use crate::error::{Error, Result};
use crate::integrator::{StepControl, StepError};
use crate::metrics::{Measurements, RunMetrics, RunningTotals, WorkSource};
use crate::model::input_extrapolation::HIGHEST_ORDER;
use crate::model::{Dynamics, InputExtrapolation, Inputs, Mechanics, Model};
use crate::newton::{Newton, SolverWork};
use crate::reduced::{ModelChoice, ModelStepper};
use crate::scene::{Document, Scene};
use crate::system::{Form, State, System};
use crate::variable::{self, Causality, VARIABLES, Variable, View};

/// How many times a failing step is halved before the error is returned: down to 1/1024 of its size.
const MAX_HALVINGS: u32 = 10;

/// The residual that Newton's method may leave in the tension of an edge next to a held head, as a fraction of EI/L² times the
/// tolerance of adaptive steps.
const HEAD_FORCE_PART: f64 = 0.01;

/// The first adaptive step of a rod at rest, s. It grows by at most a factor of 5 per step.
const FIRST_STEP_AT_REST: f64 = 1e-4;

/// Lower bound of the velocity scale for relative errors, in lengths per step.
const MIN_RELATIVE_SPEED: f64 = 1e-3;

/// A step shorter than this fraction of the current time, or of the time in which a stretching wave crosses the rod, is below
/// rounding and is deferred to the next one.
const TIME_ROUNDING: f64 = 1e-12;

/// Relative tolerance for a communication step to count as a multiple of Δt. A step shorter than this fraction of Δt is deferred.
const STEP_ROUNDING: f64 = 1e-9;

/// A jump of the flow enters the linear equations as an acceleration: the jump times this factor, 1/s.
const FLOW_JUMP_RATE: f64 = 1e6;

/// A simulation that a host drives.
#[derive(Debug)]
pub struct Stepper {
    dynamics: Dynamics,
    model_stepper: Box<dyn ModelStepper>,
    choice: Option<ModelChoice>,
    newton: Newton,
    step_control: StepControl,
    /// All that changes during a run, other than the inputs.
    now: RunState,
    /// How many times a failing step is halved.
    max_halvings: u32,
    /// Steps shorter than this (s) are below rounding and are deferred.
    shortest: f64,
    /// Half of the range of the head's speed (m/s) in the scene's own motion.
    head_speed_amplitude: f64,
    undo: undo::Undo,
    variables: Vec<&'static Variable>,
    /// The totals before the last internal step. The state and measurements of that time are then in `next` and `measurements`.
    before: Option<RunningTotals>,
    dense: Option<DenseOutput>,
    tangent: Option<Box<derivatives::StateTangent>>,
    /// The [`Scene::fingerprint`], or the [`Model::fingerprint`] of a model that differs from the scene's own model.
    scene: u128,
    /// The scene that the stepper was built from, if any.
    source_scene: Option<Arc<Scene>>,
    /// The end of the communication step, s.
    step_target: f64,
    /// The next internal step, if a batch has already solved it.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    presolved: Option<presolved_step::PresolvedStep>,
    /// True if `measurements` already holds the measurements at the end of the internal step.
    measured: bool,
    /// The largest jump of the head since [`Stepper::take_head_jump`] was last called.
    head_jump: Option<HeadJump>,
    /// The size (s) of the last communication step, if nothing has been set or restored since; and the derivatives with respect
    /// to its inputs, once they have been requested.
    last_step: Option<f64>,
    last_derivatives: Option<Box<LastDerivatives>>,
    /// How often accelerations were recomputed after a jump of inputs or of the head.
    reinitialisations: u64,
    // Work arrays.
    inputs: (Inputs, Option<Box<InputExtrapolation>>),
    next: State,
    measurements: Measurements,
    /// Allocated when an input is set.
    read_at_once: Option<Measurements>,
    accelerations: Vec<f64>,
}

/// Derivatives of the state at the end of the last communication step with respect to the inputs given for that step.
pub(crate) type LastDerivatives = Vec<(&'static Variable, State, InputDirection)>;

/// The data of the last communication step, stored while another state is examined.
#[derive(Debug, Default)]
pub struct LastStep {
    /// Its size, s.
    pub(crate) size: Option<f64>,
    derivatives: Option<Box<LastDerivatives>>,
    undo: undo::Undo,
}

/// Time as an integer number of steps, without accumulated rounding: t = origin + count·Δt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Clock {
    origin: f64,
    count: u64,
}

impl Clock {
    /// The time (s) after `count` more steps of `step` (s).
    fn at(self, count: u64, step: f64) -> f64 {
        self.origin + (self.count + count) as f64 * step
    }
}

impl Document {
    /// Prepares the run of its `scene`, or of a scene derived from it; errors of a key include its place in the document.
    ///
    /// # Errors
    /// Errors of [`Stepper::of`].
    pub fn stepper(&self, scene: &Scene) -> Result<Stepper> {
        Stepper::of(scene).map_err(|error| self.located(error))
    }
}

impl Stepper {
    /// Prepares a run of `model` at time zero with `step_control`, solved by `newton`.
    ///
    /// Snapshots are compatible between steppers of the same `model`, integrator and form, even if their `step_control` differs.
    ///
    /// # Errors
    /// Errors of the initial state.
    pub fn init(
        model: impl Into<Arc<Model>>,
        model_stepper: impl Into<Box<dyn ModelStepper>>,
        newton: Newton,
        step_control: impl Into<StepControl>,
    ) -> Result<Self> {
        let (model, model_stepper, step_control) = (model.into(), model_stepper.into(), step_control.into());
        let scene = model.fingerprint(&(&model_stepper, newton.form()));
        Ok(Self { scene, ..Self::begin(model, model_stepper, newton, step_control)? })
    }

    fn begin(
        model: Arc<Model>,
        mut model_stepper: Box<dyn ModelStepper>,
        mut newton: Newton,
        step_control: StepControl,
    ) -> Result<Self> {
        let mut dynamics = Dynamics::new(model);
        dynamics.mechanics = model_stepper.mechanics();
        let mut state = dynamics.first_state_in(newton.form());
        model_stepper.begin(&mut dynamics, &mut newton, &mut state)?;
        newton.work = SolverWork::default();
        let time_step = match step_control {
            StepControl::Fixed(time_step) => time_step,
            StepControl::Adaptive(tolerance) => {
                let acceleration = largest(&state.a);
                let lightest = dynamics.model.rod.mass.iter().copied().fold(f64::INFINITY, f64::min);
                let rounding = dynamics.residual_floor(&state) / lightest;
                let moving = (tolerance * dynamics.length() / acceleration).sqrt();
                if acceleration > rounding {
                    moving.min(dynamics.longest_step(state.t, moving))
                } else {
                    FIRST_STEP_AT_REST
                }
            }
        };
        let metrics = RunMetrics::start(&mut dynamics, &state)?;
        let cycles = Cycles::start(&dynamics, &state, &metrics);
        let variables = VARIABLES.iter().filter(|variable| variable.exists_in(&dynamics.model)).collect();
        let dense = model_stepper.has_dense_output().then(|| DenseOutput::new(&state, &metrics));
        let shortest = match step_control {
            StepControl::Fixed(time_step) => STEP_ROUNDING * time_step,
            StepControl::Adaptive(_) => TIME_ROUNDING * dynamics.crossing_time(),
        };
        let now = RunState {
            clock: Clock { origin: state.t, count: 0 },
            pending_time: None,
            time_step,
            inputs_changed: false,
            needs_reinitialisation: false,
            flow_jump: [0.0; 2],
            metrics,
            cycles,
            state,
        };
        Ok(Self {
            model_stepper,
            choice: None,
            newton,
            step_control,
            max_halvings: MAX_HALVINGS,
            shortest,
            head_speed_amplitude: dynamics.model.head_speed_amplitude(),
            undo: undo::Undo::default(),
            before: None,
            dense,
            tangent: None,
            scene: 0,
            source_scene: None,
            step_target: now.state.t,
            #[cfg(all(feature = "report", target_arch = "x86_64"))]
            presolved: None,
            measured: false,
            head_jump: None,
            last_step: None,
            last_derivatives: None,
            reinitialisations: 0,
            inputs: (dynamics.inputs.clone(), None),
            next: now.state.clone(),
            measurements: now.metrics.now.clone(),
            read_at_once: None,
            accelerations: Vec::new(),
            now,
            variables,
            dynamics,
        })
    }

    /// Prepares the run of a scene.
    ///
    /// # Errors
    /// Errors of [`Scene::model`] and [`Newton::with`]; [`Error::Scene`] for a mesh so fine that steps in positions are below
    /// rounding; errors of [`init`](Self::init) as [`Error::Scene`].
    pub fn of(scene: &Scene) -> Result<Self> {
        Self::in_form(scene, None)
    }

    /// Prepares the run of a `model` that differs from the scene's own, for example by additional forces or another actuation,
    /// with the solver settings of the scene. `solver.model = "auto"` selects the full model here, because estimates apply to the
    /// scene's own model only.
    ///
    /// # Errors
    /// Errors of [`of`](Self::of); [`Error::WrongLength`] for a model with another number of nodes.
    pub fn of_model(scene: &Scene, model: impl Into<Arc<Model>>) -> Result<Self> {
        let model = model.into();
        scene.fits(&model)?;
        let kind = scene.kind_or_full(&model)?;
        let own = model.fingerprint(&scene.fingerprint());
        let start = Self::of_kind(scene, model, ModelChoice::asked(kind), None)?;
        Ok(Self { scene: own, source_scene: None, ..start })
    }

    /// Prepares the run of a scene in the given `form`, or in the scene's own if `None`.
    fn in_form(scene: &Scene, form: Option<Form>) -> Result<Self> {
        Self::of_kind(scene, scene.model()?.into(), scene.choice()?, form)
    }

    fn of_kind(scene: &Scene, model: Arc<Model>, choice: ModelChoice, form: Option<Form>) -> Result<Self> {
        let taken = scene.with_choice(&choice);
        let solver = &taken.solver;
        let model_stepper = (choice.kind.build)(taken.integrator()?);
        let solved = model_stepper.mechanics() != Mechanics::Shape;
        let own = || if solved { taken.form(&model.rod) } else { Form::Positions };
        let form = form.unwrap_or_else(own);
        if solved {
            scene.check_mesh(&model.rod, form)?;
        }
        let newton = Newton::with(form, solver.linear, model.rod.nodes, taken.newton_tolerance())?;
        let slenderness = model.rod.slenderness_squared();
        let newton = match taken.step_control() {
            _ if !taken.newton_may_predict() => newton,
            StepControl::Adaptive(tolerance) if model.head.is_some() => {
                newton.exact_in_force(slenderness, HEAD_FORCE_PART * tolerance)
            }
            _ => newton.foreseeing(slenderness),
        };
        let mut start = Self::begin(model, model_stepper, newton, taken.step_control())
            .map_err(|error| scene.start_error(&error))?;
        if matches!(start.step_control, StepControl::Adaptive(_)) {
            start.now.time_step = start.now.time_step.min(solver.duration_s.get());
        }
        Ok(Self {
            scene: scene.fingerprint(),
            source_scene: Some(Arc::new(scene.clone())),
            choice: Some(choice),
            ..start
        })
    }

    /// Sets whether a failing step is halved (the default) or returns its error at once.
    pub fn halve_failing_steps(&mut self, yes: bool) {
        self.max_halvings = if yes { MAX_HALVINGS } else { 0 };
    }

    /// The current time, s.
    pub fn time(&self) -> f64 {
        self.now.pending_time.unwrap_or(self.now.state.t)
    }

    /// The current positions, velocities and accelerations.
    pub fn state(&self) -> &State {
        &self.now.state
    }

    /// The running totals and the current measurements.
    pub fn metrics(&self) -> &RunMetrics {
        &self.now.metrics
    }

    /// The last whole cycles.
    pub fn cycles(&self) -> &Cycles {
        &self.now.cycles
    }

    /// Counts of Newton iterations and factorisations.
    pub fn work(&self) -> SolverWork {
        self.newton.work
    }

    /// The form of the equations that Newton's method solves.
    pub fn form(&self) -> Form {
        self.newton.form()
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// What a host should know about the fluid of the scene before it moves the rod, see [`Scene::fluid_note`].
    pub fn fluid_note(&self) -> Option<String> {
        self.source_scene.as_ref()?.fluid_note()
    }

    /// The kind of model that the run of a scene uses, and the reason.
    pub fn choice(&self) -> Option<&ModelChoice> {
        self.choice.as_ref()
    }

    /// The control of the step size.
    pub fn step_control(&self) -> StepControl {
        self.step_control
    }

    /// The name of the integrator in a run of its `scene`.
    pub fn method<'a>(&self, scene: &'a Scene) -> &'a str {
        self.choice.as_ref().and_then(|choice| choice.kind.method).unwrap_or(scene.integrator_name())
    }

    /// The variables that this scene has.
    pub fn variables(&self) -> &[&'static Variable] {
        &self.variables
    }

    /// The current view that variables are read from.
    #[inline]
    pub fn view(&self) -> View<'_> {
        View {
            time: self.time(),
            dynamics: &self.dynamics,
            inputs: &self.dynamics.inputs,
            state: &self.now.state,
            metrics: &self.now.metrics,
            cycles: &self.now.cycles,
            work: self.newton.work,
            time_step: self.now.time_step,
            head_turn: [0.0; 2],
        }
    }

    /// Advances by `h` (s) to exactly t + h, in ⌈h/Δt⌉ equal internal steps or in adaptive steps that meet the tolerance. If `h` is
    /// mere rounding, only the time advances and the motion follows with the next step.
    ///
    /// # Errors
    /// [`Error::Step`] for an `h` that is not positive and finite; otherwise the error of an internal step. The stepper is then as it
    /// was before the call.
    pub fn do_step(&mut self, h: f64) -> Result<()> {
        self.do_step_with(h, |_| ControlFlow::Continue(())).map(|_| ())
    }

    /// The same as [`do_step`](Self::do_step), and calls `look` after every internal step, including the halves of failed ones.
    /// If `look` breaks, the step ends there. Returns true if t + h was reached.
    ///
    /// # Errors
    /// Errors of [`do_step`](Self::do_step).
    pub fn do_step_with(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let before = (self.now.pending_time, self.head_jump);
        let outcome = self.advance_by(h, look);
        match outcome {
            Err(_) => self.return_to(before),
            Ok(whole) => {
                let deferred = before.0.is_some() || self.now.pending_time.is_some();
                self.last_step = (whole && !deferred).then_some(h);
            }
        }
        outcome
    }

    /// Returns to the start of a communication step that has failed. `before` holds the time of the host (s) and the jump of the
    /// head at that start.
    fn return_to(&mut self, before: (Option<f64>, Option<HeadJump>)) {
        self.undo_step();
        (self.now.pending_time, self.head_jump) = before;
    }

    /// The same as [`do_step_with`](Self::do_step_with), but keeps the state of the last successful internal step if a later one
    /// fails.
    ///
    /// # Errors
    /// Errors of [`do_step`](Self::do_step).
    pub fn advance_until_failure(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let (start, pending_time) = (self.now.state.t, self.now.pending_time);
        let outcome = self.advance_by(h, look);
        if outcome.is_err() {
            if self.now.state.t == start {
                self.undo_step(); // no internal step was accepted
                self.now.pending_time = pending_time;
            }
            self.discard_step();
        }
        // Frees memory: it was allocated for a whole run, which ends here.
        self.undo = undo::Undo::default();
        outcome
    }

    /// Removes and returns the data of the last communication step. [`put_last_step`](Self::put_last_step) restores them once
    /// this stepper is in the same state again, after other states have been examined.
    pub fn take_last_step(&mut self) -> LastStep {
        let undo = std::mem::take(&mut self.undo);
        LastStep { size: self.last_step.take(), derivatives: self.last_derivatives.take(), undo }
    }

    /// Restores what [`take_last_step`](Self::take_last_step) returned.
    pub fn put_last_step(&mut self, LastStep { size, derivatives, undo }: LastStep) {
        (self.last_step, self.last_derivatives, self.undo) = (size, derivatives, undo);
    }

    /// How often accelerations were recomputed after a jump.
    pub(crate) fn reinitialisations(&self) -> u64 {
        self.reinitialisations
    }

    /// True if a step of `h` (s) restarts the run, from the pose that a host gives for its end.
    pub(crate) fn restarts_in(&self, h: f64) -> bool {
        let t = self.now.state.t;
        self.is_at_start() && self.dynamics.starts_elsewhere(t, Some(t + h))
    }

    /// True if the flow has jumped since the last step, so that the next step accelerates water.
    pub(crate) fn flow_jumps_in_water(&self) -> bool {
        self.now.flow_jump != [0.0; 2] && self.dynamics.model.forces.are_inertial()
    }

    /// Discards the data of the last communication step.
    fn forget_last_step(&mut self) {
        (self.last_step, self.last_derivatives) = (None, None);
    }

    fn advance_by(&mut self, h: f64, mut look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let Some((h, end)) = self.begin_step(h)? else { return Ok(true) };
        match self.step_control {
            StepControl::Fixed(time_step) => {
                let mut steps = self.begin_equal_steps(h, time_step)?;
                while !steps.are_taken() {
                    if self.take_equal_step(&mut steps, &mut look)?.is_break() {
                        return Ok(false);
                    }
                }
                Ok(true)
            }
            StepControl::Adaptive(tolerance) => self.adaptive_steps(end, tolerance, look),
        }
    }

    /// Begins a communication step of `h` (s). Returns the distance in time (s) that the state has to move, and the end of the
    /// step (s); `None` if the step is below rounding and deferred.
    fn begin_step(&mut self, h: f64) -> Result<Option<(f64, f64)>> {
        if !(h.is_finite() && h > 0.0) {
            self.undo.begin();
            return Err(Error::Step(h));
        }
        self.forget_last_step();
        self.undo.begin();
        let (start, end) = (self.now.state.t, self.time() + h);
        let h = if self.now.pending_time.is_some() { end - start } else { h };
        if h <= self.shortest.max(TIME_ROUNDING * end.abs()) || end <= start {
            self.now.pending_time = Some(end);
            return Ok(None);
        }
        self.now.pending_time = None;
        Ok(Some((h, end)))
    }

    fn adaptive_steps(
        &mut self,
        end: f64,
        tolerance: f64,
        mut look: impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<bool> {
        self.save_for_undo();
        self.prepare_step(end, true)?;
        let order = self.model_stepper.order();
        let (mut grow, mut failures) = (STEP_FACTORS[1], 0);
        let mut speed = self.dynamics.own_speed(&self.now.state);
        while self.now.state.t < end {
            let left = end - self.now.state.t;
            // Avoids a remainder much smaller than a step: the last two steps are equal.
            let longest = self.dynamics.longest_step(self.now.state.t, self.now.time_step);
            let (h, to) = match self.now.time_step.min(longest) {
                wanted if wanted >= left * (1.0 - STEP_ROUNDING) => (left, end),
                wanted if 2.0 * wanted > left => (0.5 * left, self.now.state.t + 0.5 * left),
                wanted => (wanted, self.now.state.t + wanted),
            };
            if h < left && end + h <= end {
                return Err(Error::Tolerance { time_s: self.now.state.t, step_s: h, tolerance });
            }
            match self.try_step(to, h) {
                Ok(error) => {
                    let reached = self.dynamics.own_speed(&self.next);
                    let size = self.relative_error(error, h, [speed, reached]) / tolerance;
                    let factor = step_factor(size, order).clamp(STEP_FACTORS[0], grow);
                    if size <= 1.0 {
                        self.accept_step()?;
                        self.now.metrics.totals.steps += 1;
                        // A step shortened by the end of the interval does not reduce the wanted step size. After a step
                        // shortened by the drive of the rod, steps grow again from its size.
                        let wish = self.now.time_step.min(longest);
                        self.now.time_step = (h * factor).max(if h < wish { wish } else { 0.0 });
                        (grow, failures, speed) = (STEP_FACTORS[1], 0, reached);
                        if look(self).is_break() && self.now.state.t < end {
                            self.now.clock = Clock { origin: self.now.state.t, count: 0 };
                            return Ok(false);
                        }
                        continue;
                    }
                    self.now.metrics.totals.rejections += 1;
                    self.now.time_step = h * factor;
                }
                Err(error) if error.is_cured_by_smaller_step() && failures < self.max_halvings => {
                    failures += 1;
                    self.now.metrics.totals.halvings += 1;
                    self.now.time_step = 0.5 * h;
                }
                Err(error) => return Err(error),
            }
            grow = 1.0;
        }
        self.now.clock = Clock { origin: self.now.state.t, count: 0 };
        Ok(true)
    }

    /// The relative error of a step of `h` (s), which is compared with the tolerance, from its estimated `error`. Velocities are
    /// relative to the rod's own `speeds` (m/s) at both ends of the step, which do not depend on the frame.
    fn relative_error(&self, error: StepError, h: f64, speeds: [f64; 2]) -> f64 {
        let length = self.dynamics.length();
        let speed = speeds[0].max(speeds[1]).max(self.head_speed_amplitude).max(MIN_RELATIVE_SPEED * length / h);
        (error.position / length).max(error.velocity / speed)
    }

    /// Prepares the internal steps to `end`, at the start of a communication step (`begins`) or after inputs have changed within
    /// one: fits the motion of the head, and reinitialises the state after a jump of inputs.
    fn prepare_step(&mut self, end: f64, begins: bool) -> Result<()> {
        let words =
            self.dynamics.inputs.head.is_some() || self.dynamics.inputs.redundant_head_inputs.are_of(self.now.state.t);
        if words || self.now.needs_reinitialisation {
            self.save_for_undo();
        }
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.now.inputs_changed {
            self.presolved = None; // its step would differ now
        }
        (self.now.inputs_changed, self.step_target) = (false, end);
        let t = self.now.state.t;
        if begins && self.is_at_start() && self.dynamics.starts_elsewhere(t, Some(end)) {
            self.start_from_given_pose()?;
        }
        let distances = self.dynamics.fit_head_extrapolation(t, end, begins);
        self.note_jump(t, distances);
        if self.now.needs_reinitialisation { self.reinitialise() } else { Ok(()) }
    }

    /// True before the first step.
    fn is_at_start(&self) -> bool {
        self.now.state.t == self.now.metrics.first.0
    }

    /// Restarts from the pose of the head that the host gives. Other inputs that the host has set count as a jump at that start.
    fn start_from_given_pose(&mut self) -> Result<()> {
        let mut scene = Inputs::of(&self.dynamics.model);
        scene.head = self.dynamics.inputs.head.take();
        let mut given = std::mem::replace(&mut self.dynamics.inputs, scene);
        let extrapolation = self.dynamics.extrapolation.take();
        let started = self.restart();
        given.head.clone_from(&self.dynamics.inputs.head);
        let scene = std::mem::replace(&mut self.dynamics.inputs, given);
        self.dynamics.extrapolation = extrapolation;
        started?;
        if self.dynamics.extrapolation.is_none() && self.dynamics.inputs.act_as(&scene) {
            return Ok(());
        }
        let undo = std::mem::replace(&mut self.inputs.0, scene);
        let counted = self.count_input_change();
        self.inputs.0 = undo;
        counted
    }

    fn restart(&mut self) -> Result<()> {
        let mut state = self.now.state.clone();
        self.dynamics.start_with_host(self.now.state.t, &mut state);
        self.model_stepper.begin(&mut self.dynamics, &mut self.newton, &mut state)?;
        let metrics = RunMetrics::start(&mut self.dynamics, &state)?;
        self.now.cycles = Cycles::start(&self.dynamics, &state, &metrics);
        (self.now.metrics, self.now.state) = (metrics, state);
        (self.now.needs_reinitialisation, self.now.flow_jump) = (false, [0.0; 2]);
        self.newton.work = SolverWork::default();
        self.before = None;
        Ok(())
    }

    /// Reinitialises the state after a jump of inputs, so that it is consistent with them, and adds the jump of energy and
    /// momentum to the totals. Nothing changes on error.
    ///
    /// A jump of the flow (m/s) accelerates the added mass impulsively: because fluid forces are linear in accelerations, the
    /// jump of velocities follows from two solves.
    fn reinitialise(&mut self) -> Result<()> {
        self.reinitialisations += 1;
        let flow_jump = Vector2::from(self.now.flow_jump);
        let Self {
            dynamics,
            model_stepper,
            newton,
            now: RunState { state, .. },
            next,
            measurements,
            accelerations,
            ..
        } = self;
        dynamics.move_to(state.t, state);
        next.copy_from(state);
        model_stepper.reinitialise(dynamics, newton, next)?;
        let inertial = dynamics.model.forces.are_inertial();
        if flow_jump != Vector2::zeros() && inertial {
            let steady = dynamics.inputs.fluid.acceleration;
            accelerations.clone_from(&next.a);
            dynamics.inputs.fluid.acceleration += flow_jump * FLOW_JUMP_RATE;
            let accelerated = model_stepper.reinitialise(dynamics, newton, next);
            dynamics.inputs.fluid.acceleration = steady;
            accelerated?;
            let changes = next.a.iter().zip(&*accelerations);
            next.v.iter_mut().zip(changes).for_each(|(v, (with, without))| *v += (with - without) / FLOW_JUMP_RATE);
            model_stepper.reinitialise(dynamics, newton, next)?;
        }
        let (shape, motion) = (next.q != state.q, next.v != state.v);
        // Forces of an accelerated fluid, and moments that follow from balance, change with the accelerations alone.
        let forces = (inertial || dynamics.mechanics == Mechanics::Shape) && next.a != state.a;
        if shape || motion || forces {
            measurements.measure(dynamics, next)?;
        }
        let apart = |new: &[f64], old: &[f64]| new.iter().zip(old).fold(0.0, |max: f64, (a, b)| max.max((a - b).abs()));
        let reach = |tolerance: f64| match dynamics.mechanics {
            Mechanics::Full => (tolerance * dynamics.length() / apart(&next.a, &state.a)).sqrt(),
            Mechanics::Overdamped => tolerance * dynamics.length() / apart(&next.v, &state.v),
            Mechanics::Shape => f64::INFINITY,
        };
        if let StepControl::Adaptive(tolerance) = self.step_control {
            // A longer step would skip the transient and only see where the rod comes to rest.
            self.now.time_step = self.now.time_step.min(reach(tolerance));
        }
        let Self { now: RunState { state, .. }, next, .. } = self;
        std::mem::swap(state, next);
        if shape || motion {
            self.now
                .metrics
                .count_jump(&mut self.measurements, if shape { WorkSource::Actuation } else { WorkSource::Flow });
        } else if forces {
            std::mem::swap(&mut self.now.metrics.now, &mut self.measurements);
        }
        if shape || motion || forces {
            self.now.cycles.follow(&self.dynamics, &self.now.state, &self.now.metrics, None);
        }
        self.before = None;
        (self.now.needs_reinitialisation, self.now.flow_jump) = (false, [0.0; 2]);
        Ok(())
    }

    /// Discards an attempted step and returns to the current state.
    fn discard_step(&mut self) {
        self.forget_step();
        let t = self.now.state.t;
        self.dynamics.step_end = (!self.is_at_start()).then_some(t);
        self.dynamics.move_to(t, &mut self.now.state);
    }

    /// Discards the last internal step, so that dense output is unavailable.
    fn forget_step(&mut self) {
        self.before = None;
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        {
            self.presolved = None;
        }
    }

    /// Steps by `h` (s) to time `end`, in halves if the step fails, and calls `look` after each. It completes a `whole` step, or
    /// the first half of one.
    fn step_or_halve(
        &mut self,
        end: f64,
        h: f64,
        depth: u32,
        whole: bool,
        look: &mut impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        let limit = self.model_stepper.error_limit();
        let step = self.try_step(end, h).and_then(|error| {
            if error.position > limit * self.dynamics.length() {
                return Err(Error::Tolerance { time_s: end, step_s: h, tolerance: limit });
            }
            self.accept_step()
        });
        match step {
            Err(error) if error.is_cured_by_smaller_step() && depth < self.max_halvings => {
                self.save_for_undo();
                self.now.metrics.totals.halvings += 1;
                if self.step_or_halve(end - 0.5 * h, 0.5 * h, depth + 1, false, look)?.is_break() {
                    return Ok(ControlFlow::Break(()));
                }
                self.step_or_halve(end, 0.5 * h, depth + 1, whole, look)
            }
            outcome => outcome.map(|()| {
                self.now.metrics.totals.steps += u64::from(whole);
                look(self)
            }),
        }
    }

    /// Attempts a step of `h` (s) to time `end`, with the result in `next`.
    fn try_step(&mut self, end: f64, h: f64) -> Result<StepError> {
        if self.now.inputs_changed {
            self.prepare_step(self.step_target, false)?; // by `look` after the previous step
        }
        self.dynamics.step_end = Some(end);
        if self.dynamics.head_jumps_at(self.now.state.t) {
            self.save_for_undo();
            self.reinitialise()?;
        }
        self.before = None;
        if let Some(dense) = &mut self.dense {
            dense.forget();
        }
        self.dynamics.check_layers(end)?;
        self.next.t = end;
        self.measured = false;
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.take_presolved(end, h).is_some() {
            return Ok(StepError::default());
        }
        self.model_stepper.step(&mut self.dynamics, &mut self.newton, &self.now.state, h, &mut self.next)
    }

    /// Accepts `next` as the state, and adds the step to the totals.
    fn accept_step(&mut self) -> Result<()> {
        let middle = if self.model_stepper.has_dense_output() { Some(self.middle()?) } else { None };
        if !self.measured {
            self.measurements.measure(&mut self.dynamics, &self.next)?;
        }
        let load = self.dynamics.load_work([self.now.state.t, self.next.t], &self.now.state.q, &self.next.q);
        let middle = middle.and(self.dense.as_ref()).map(DenseOutput::last);
        let measurements = middle.map(|(_, measurements)| measurements);
        self.before = Some(self.now.metrics.totals);
        if let Err(error) =
            self.now.metrics.count_step(&mut self.measurements, measurements, load, self.dynamics.head_mass())
        {
            self.before = None;
            return Err(error);
        }
        std::mem::swap(&mut self.now.state, &mut self.next);
        self.now.cycles.follow(&self.dynamics, &self.now.state, &self.now.metrics, middle);
        Ok(())
    }

    /// The variable of this name.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn find(&self, name: &str) -> Result<&'static Variable> {
        let found = self.variables.iter().copied().find(|variable| variable.name == name);
        found.ok_or_else(|| variable::unknown(name, self.variables.iter().map(|variable| variable.name)))
    }

    /// The values of a variable.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn get(&self, name: &str) -> Result<Vec<f64>> {
        let variable = self.find(name)?;
        let mut values = vec![0.0; variable.len(self.model())];
        variable.read(&self.view(), &mut values);
        Ok(values)
    }

    /// The value of a scalar variable, or the first of an array.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn get_scalar(&self, name: &str) -> Result<f64> {
        Ok(self.find(name)?.first(&self.view()))
    }

    /// Sets an input, which holds until it is set again. The immediate change of energy, for example by a jump of natural
    /// curvature, is added to the totals.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`], [`Error::NotAnInput`], [`Error::WrongLength`], [`Error::BadValue`], and [`Error::NotFinite`]
    /// for a value so large that energies overflow. On error nothing is changed.
    pub fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        let variable = self.find(name)?;
        self.set_all([InputChange { variable, order: 0, values }].into_iter())
    }

    /// Sets the time derivative of order `order`, 1 to [`HIGHEST_ORDER`], of an input. The input is then extrapolated from its
    /// value and derivatives, until its value is set again.
    ///
    /// # Errors
    /// Errors of [`set`](Self::set), and [`Error::Order`].
    pub fn set_derivative(&mut self, name: &str, order: usize, values: &[f64]) -> Result<()> {
        let variable = self.find(name)?;
        if order == 0 {
            return Err(Error::Order { order, highest: HIGHEST_ORDER });
        }
        self.set_all([InputChange { variable, order, values }].into_iter())
    }

    /// Applies several changes in order, as one.
    ///
    /// # Errors
    /// Errors of [`set_derivative`](Self::set_derivative). On error nothing is changed.
    pub fn set_all<'a>(&mut self, changes: impl Iterator<Item = InputChange<'a>> + Clone) -> Result<()> {
        for change in changes.clone() {
            change.check(&self.dynamics, None)?;
        }
        self.apply_all(changes.map(|change| (change, 0)))
    }

    /// Applies several changes to parts of array inputs as one. Each change comes with the index of its first entry; other
    /// entries keep their values and derivatives.
    ///
    /// # Errors
    /// Errors of [`set_all`](Self::set_all).
    pub fn set_entries<'a>(&mut self, changes: impl Iterator<Item = (InputChange<'a>, usize)> + Clone) -> Result<()> {
        for (change, first) in changes.clone() {
            change.check(&self.dynamics, Some(first))?;
        }
        self.apply_all(changes)
    }

    fn apply_all<'a>(&mut self, changes: impl Iterator<Item = (InputChange<'a>, usize)> + Clone) -> Result<()> {
        let t = self.now.state.t;
        self.forget_last_step();
        self.inputs.0.clone_from(&self.dynamics.inputs);
        self.inputs.1.clone_from(&self.dynamics.extrapolation);
        if let Some(extrapolation) = &mut self.dynamics.extrapolation {
            extrapolation.rebase(t, &self.dynamics.inputs);
        }
        let of_head = |(change, _): (InputChange<'_>, usize)| change.variable.of_head().is_some();
        let of_head = changes.clone().any(of_head);
        let make = |dynamics: &mut Dynamics| changes.for_each(|(change, first)| change.make(dynamics, t, first));
        self.dynamics.change_inputs(t, make);
        let outcome = match of_head && self.is_at_start() && self.dynamics.starts_elsewhere(t, None) {
            true => self.start_from_given_pose(),
            false => self.count_input_change(),
        };
        if outcome.is_err() {
            self.dynamics.restore(&self.inputs.0);
            self.dynamics.extrapolation.clone_from(&self.inputs.1);
            self.dynamics.move_to(t, &mut self.now.state);
        }
        outcome
    }

    /// Call this after you have changed an input of one of your own forces, such as an atomic number that the force shares with your
    /// program. The next step then begins with accelerations under the new input, as after [`set`](Self::set). A change of the energy that
    /// the force stores counts as work of the flow. Snapshots do not have such inputs: set them again after
    /// [`restore`](Self::restore).
    ///
    /// ```
    /// use std::sync::atomic::{AtomicU64, Ordering};
    ///
    /// /// An input that a force and its host share.
    /// #[derive(Default)]
    /// struct Input(AtomicU64);
    ///
    /// impl Input {
    ///     fn set(&self, value: f64) {
    ///         self.0.store(value.to_bits(), Ordering::Relaxed);
    ///     }
    ///     fn get(&self) -> f64 {
    ///         f64::from_bits(self.0.load(Ordering::Relaxed))
    ///     }
    /// }
    ///
    /// /// A snapshot identifies its model by its `Debug` output, which must not contain the input.
    /// impl std::fmt::Debug for Input {
    ///     fn fmt(&self, text: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
    ///         text.write_str("an input")
    ///     }
    /// }
    /// ```
    ///
    /// # Errors
    /// [`Error::NotFinite`] if the force is not finite now. On error nothing is counted.
    pub fn inputs_changed(&mut self) -> Result<()> {
        self.forget_last_step();
        self.inputs.0.clone_from(&self.dynamics.inputs);
        self.count_input_change()?;
        self.now.needs_reinitialisation = true;
        Ok(())
    }

    /// Measures the state under inputs that have just changed, and adds the jump to the totals.
    fn count_input_change(&mut self) -> Result<()> {
        let Self { dynamics, now, read_at_once, .. } = self;
        dynamics.move_to(now.state.t, &mut now.state);
        dynamics.check_layers(now.state.t)?;
        let read_at_once = read_at_once.get_or_insert_with(|| Measurements::new(dynamics.nodes()));
        read_at_once.measure(dynamics, &now.state)?;
        now.metrics.count_step(read_at_once, None, 0.0, dynamics.head_mass())?;
        let before = &self.inputs.0;
        let flow_jump = dynamics.inputs.fluid.flow - before.fluid.flow;
        now.inputs_changed = true;
        now.needs_reinitialisation |= !dynamics.inputs.act_as(before);
        now.flow_jump = (Vector2::from(now.flow_jump) + flow_jump).into();
        now.cycles.follow(dynamics, &now.state, &now.metrics, None);
        self.before = None; // the end of the last step has changed
        Ok(())
    }
}

/// A new value of an input, or of one of its time derivatives.
#[derive(Debug, Clone, Copy)]
pub struct InputChange<'a> {
    /// The input.
    pub variable: &'static Variable,
    /// The order of the derivative; 0 is the value.
    pub order: usize,
    /// As many values as the variable has.
    pub values: &'a [f64],
}

impl InputChange<'_> {
    /// Returns an error unless this is a valid change of a whole input, or of its entries from index `first` on.
    fn check(&self, dynamics: &Dynamics, first: Option<usize>) -> Result<()> {
        let Self { variable, order, values } = *self;
        if variable.causality != Causality::Input {
            return Err(Error::NotAnInput(variable.name));
        }
        if order + variable.of_head().map_or(0, |[_, own]| own) > HIGHEST_ORDER {
            return Err(Error::Order { order, highest: HIGHEST_ORDER });
        }
        let expected = variable.len(&dynamics.model);
        let fits = first.map_or(values.len() == expected, |first| {
            first.checked_add(values.len()).is_some_and(|end| end <= expected)
        });
        if !fits {
            return Err(Error::WrongLength { name: variable.name, expected, found: values.len() });
        }
        let refused = if order == 0 {
            variable.refused(values).or_else(|| self.refused_length(&dynamics.model))
        } else {
            let refused = |x: &f64| match dynamics.refused_derivative(variable.name, order, *x) {
                None if x.is_finite() => None,
                refused => Some((*x, refused.unwrap_or("a finite number"))),
            };
            values.iter().find_map(refused)
        };
        match refused {
            Some((value, allowed)) => Err(Error::BadValue { name: variable.name, value, allowed }),
            None => Ok(()),
        }
    }

    /// A host's change of the length of a winch's cable that leaves no positive length at some time, with the allowed values.
    fn refused_length(&self, model: &Model) -> Option<(f64, &'static str)> {
        let tendon = variable::WINCHES.iter().position(|name| *name == self.variable.name)?;
        let [_, longest] = model.tendons.get(tendon)?.winch()?.length.range();
        let added = *self.values.first()?;
        let allowed = "a number with which the length of the cable, the scene's and this, is above 0";
        (longest + added <= 0.0).then_some((added, allowed))
    }

    /// Applies the change at time `t` (s) to the entries from index `first` on.
    fn make(&self, dynamics: &mut Dynamics, t: f64, first: usize) {
        let Self { variable, order, values } = *self;
        if let Some([i, own]) = variable.of_head() {
            dynamics.set_head_derivative(t, i, own + order, values[0], order > 0);
        } else if order == 0 {
            variable.write(dynamics, t, first, values);
            let Some(mut extrapolation) = dynamics.extrapolation.take() else { return };
            extrapolation.change(dynamics, 0, |inputs| variable.write(inputs, t, first, values));
            for order in 1..=HIGHEST_ORDER {
                extrapolation.change(dynamics, order, |rates| variable.clear(rates, t, first, values.len()));
            }
            dynamics.extrapolation = Some(extrapolation);
        } else {
            let mut extrapolation = match dynamics.extrapolation.take() {
                Some(extrapolation) => extrapolation,
                None => Box::new(InputExtrapolation::resting(&dynamics.model, &dynamics.inputs, t)),
            };
            extrapolation.change(dynamics, order, |rates| variable.write(rates, t, first, values));
            dynamics.inputs.flow_taken |= extrapolation.takes_flow();
            dynamics.extrapolation = Some(extrapolation);
        }
    }
}

/// The largest absolute value.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max, x| max.max(x.abs()))
}
