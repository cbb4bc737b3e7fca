//! The stepper: init, do_step, get, set, save and restore over the table of variables. Every face goes through it.

#[cfg(all(feature = "report", target_arch = "x86_64"))]
pub(crate) mod ahead;
mod between;
mod dense;
pub mod derivatives;
mod jump;
mod moment;
mod retune;
pub mod snapshot;
mod undo;

use std::ops::ControlFlow;
use std::sync::Arc;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use dense::Dense;
pub use jump::HeadJump;
use moment::Now;
pub use snapshot::Snapshot;

use crate::cycle::Cycles;
use crate::error::{Error, Result};
use crate::integrator::{StepControl, StepError};
use crate::metrics::{Giver, Meter, Reading, Totals};
use crate::model::input_extrapolation::HIGHEST_ORDER;
use crate::model::{Dynamics, InputExtrapolation, Inputs, Mechanics, Model};
use crate::newton::{Newton, Work};
use crate::reduced::{Choice, Mover};
use crate::scene::Scene;
use crate::system::{Form, State, System};
use crate::variable::{self, Causality, VARIABLES, Variable, View};

/// How often a failing step is halved before the failure is reported: down to 1/1024 of it.
const MAX_HALVINGS: u32 = 10;

/// An adaptive step may change by these factors, and aims at this part of the step that just meets the tolerance.
const FACTORS: [f64; 2] = [0.2, 5.0];
const SAFETY: f64 = 0.9;

/// The first adaptive step where the rod rests, s: it grows fivefold a step.
const AT_REST: f64 = 1e-4;

/// Velocities count as no smaller than this part of a length a step.
const SLOW: f64 = 1e-3;

/// A step shorter than this part of the time now waits for the next: it is rounding of the time. So is one shorter than this
/// part of the time in which a stretching wave passes the rod.
const TIME_ROUNDING: f64 = 1e-12;

/// A step length within this of a multiple of Δt, relative, has as many parts. A step shorter than this part of Δt waits.
const STEP_ROUNDING: f64 = 1e-9;

/// A change of the flow at once is taken for an acceleration of this many times it a second, in linear equations.
const GUST: f64 = 1e6;

/// A simulation that a host drives.
#[derive(Debug)]
pub struct Stepper {
    dynamics: Dynamics,
    mover: Box<dyn Mover>,
    choice: Option<Choice>,
    newton: Newton,
    pace: StepControl,
    /// All that changes beside the inputs.
    now: Now,
    /// How often a failing step is halved.
    max_halvings: u32,
    /// The shortest step (s) that is more than rounding.
    shortest: f64,
    /// Half of what the speed (m/s) of the head varies by in the scene's own motion.
    head_swing: f64,
    undo: undo::Undo,
    variables: Vec<&'static Variable>,
    /// The totals before the last internal step; its state and reading are then in `next` and `reading`.
    before: Option<Totals>,
    dense: Option<Dense>,
    tangent: Option<Box<derivatives::Tangent>>,
    /// The scene, as [`Scene::fingerprint`] names it; another model than a scene's own, as [`Model::fingerprint`] does.
    scene: u128,
    /// The scene itself, where it was made from one.
    made_from: Option<Arc<Scene>>,
    /// Where the step of several internal ones ends, s.
    goal: f64,
    /// The next internal step, solved already.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    solved: Option<ahead::Ahead>,
    /// What the end of the internal step is measured to be is in `reading` already.
    measured: bool,
    /// The largest jump of a head since it was last asked for.
    head_jump: Option<HeadJump>,
    // Room to work in.
    inputs: (Inputs, Option<Box<InputExtrapolation>>),
    next: State,
    reading: Reading,
    read_at_once: Reading,
    accelerations: Vec<f64>,
}

/// Time as an integer number of steps, so that it never drifts: t = origin + count·Δt.
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

impl Stepper {
    /// Prepares a run of `model` at time zero with internal steps of that `pace`, solved by `newton`.
    ///
    /// Its snapshots are those of this `model` by this method in this form, whatever its `pace`.
    ///
    /// # Errors
    /// Whatever is wrong with the first state.
    pub fn init(
        model: impl Into<Arc<Model>>,
        mover: impl Into<Box<dyn Mover>>,
        newton: Newton,
        pace: impl Into<StepControl>,
    ) -> Result<Self> {
        let (model, mover, pace) = (model.into(), mover.into(), pace.into());
        let scene = model.fingerprint(&(&mover, newton.form()));
        Ok(Self { scene, ..Self::begin(model, mover, newton, pace)? })
    }

    fn begin(model: Arc<Model>, mut mover: Box<dyn Mover>, mut newton: Newton, pace: StepControl) -> Result<Self> {
        let mut dynamics = Dynamics::new(model);
        dynamics.mechanics = mover.mechanics();
        let mut state = dynamics.first_state_in(newton.form());
        mover.begin(&mut dynamics, &mut newton, &mut state)?;
        newton.work = Work::default();
        let time_step = match pace {
            StepControl::Fixed(time_step) => time_step,
            StepControl::Adaptive(tolerance) => {
                let acceleration = largest(&state.a);
                let lightest = dynamics.model.rod.mass.iter().copied().fold(f64::INFINITY, f64::min);
                let rounding = dynamics.residual_floor(&state) / lightest;
                let moving = (tolerance * dynamics.length() / acceleration).sqrt();
                if acceleration > rounding { moving.min(dynamics.longest_step(state.t)) } else { AT_REST }
            }
        };
        let meter = Meter::start(&mut dynamics, &state)?;
        let cycles = Cycles::start(&dynamics, &state, &meter);
        let variables = VARIABLES.iter().filter(|variable| variable.exists_in(&dynamics.model)).collect();
        let dense = mover.knows_between().then(|| Dense::new(&state, &meter));
        let shortest = match pace {
            StepControl::Fixed(time_step) => STEP_ROUNDING * time_step,
            StepControl::Adaptive(_) => TIME_ROUNDING * dynamics.crossing_time(),
        };
        let now = Now {
            clock: Clock { origin: state.t, count: 0 },
            waiting: None,
            time_step,
            steered: false,
            unsettled: false,
            gust: [0.0; 2],
            meter,
            cycles,
            state,
        };
        Ok(Self {
            mover,
            choice: None,
            newton,
            pace,
            max_halvings: MAX_HALVINGS,
            shortest,
            head_swing: dynamics.model.head_swing(),
            undo: undo::Undo::default(),
            before: None,
            dense,
            tangent: None,
            scene: 0,
            made_from: None,
            goal: now.state.t,
            #[cfg(all(feature = "report", target_arch = "x86_64"))]
            solved: None,
            measured: false,
            head_jump: None,
            inputs: (dynamics.inputs.clone(), None),
            next: now.state.clone(),
            reading: Reading::new(dynamics.nodes()),
            read_at_once: Reading::new(dynamics.nodes()),
            accelerations: Vec::new(),
            now,
            variables,
            dynamics,
        })
    }

    /// The start of a scene's run.
    ///
    /// # Errors
    /// Those of [`Scene::model`] and [`Newton::with`]; those of [`init`](Self::init) as [`Error::Scene`], as no step is to
    /// blame.
    pub fn of(scene: &Scene) -> Result<Self> {
        Self::in_form(scene, None)
    }

    /// The start of a run of another `model` than the scene's own, as with forces or an actuation of your own beside those of
    /// [`Scene::model`], solved as the scene says; `solver.model = "auto"` is the whole model here, as estimates are of the scene's own.
    ///
    /// # Errors
    /// Those of [`of`](Self::of); [`Error::WrongLength`] for a model of another number of nodes.
    pub fn of_model(scene: &Scene, model: impl Into<Arc<Model>>) -> Result<Self> {
        let model = model.into();
        scene.fits(&model)?;
        let rung = scene.rung_or_whole(&model)?;
        let own = model.fingerprint(&scene.fingerprint());
        let start = Self::of_rung(scene, model, Choice::asked(rung), None)?;
        Ok(Self { scene: own, made_from: None, ..start })
    }

    /// The start of a scene's run in that form, or in the one that the scene takes.
    fn in_form(scene: &Scene, form: Option<Form>) -> Result<Self> {
        Self::of_rung(scene, scene.model()?.into(), scene.choice()?, form)
    }

    fn of_rung(scene: &Scene, model: Arc<Model>, choice: Choice, form: Option<Form>) -> Result<Self> {
        let taken = scene.taken(&choice);
        let solver = &taken.solver;
        let mover = (choice.rung.build)(taken.integrator()?);
        let solved = mover.mechanics() != Mechanics::Shape;
        let own = || if solved { taken.form(&model.rod) } else { Form::Positions };
        let form = form.unwrap_or_else(own);
        let newton = Newton::with(form, solver.linear, model.rod.nodes, taken.newton_tolerance())?;
        let newton = if taken.newton_foresees() { newton.foreseeing(model.rod.slenderness_squared()) } else { newton };
        let mut start = Self::begin(model, mover, newton, taken.pace()).map_err(|error| scene.cannot_start(&error))?;
        if matches!(start.pace, StepControl::Adaptive(_)) {
            start.now.time_step = start.now.time_step.min(solver.duration_s.get());
        }
        Ok(Self { scene: scene.fingerprint(), made_from: Some(Arc::new(scene.clone())), choice: Some(choice), ..start })
    }

    /// Chooses whether a step that fails is halved, as it is unless told otherwise, or reported at once.
    pub fn halve_failing_steps(&mut self, yes: bool) {
        self.max_halvings = if yes { MAX_HALVINGS } else { 0 };
    }

    /// Time now, s.
    pub fn time(&self) -> f64 {
        self.now.waiting.unwrap_or(self.now.state.t)
    }

    /// Positions, velocities and accelerations now.
    pub fn state(&self) -> &State {
        &self.now.state
    }

    /// The running totals and the last reading.
    pub fn meter(&self) -> &Meter {
        &self.now.meter
    }

    /// The last whole cycles.
    pub fn cycles(&self) -> &Cycles {
        &self.now.cycles
    }

    /// What Newton's method has done.
    pub fn work(&self) -> Work {
        self.newton.work
    }

    /// The form that Newton's method solves.
    pub fn form(&self) -> Form {
        self.newton.form()
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The rung of the ladder of models that a scene's run takes, and why.
    pub fn choice(&self) -> Option<&Choice> {
        self.choice.as_ref()
    }

    /// How its internal steps are chosen.
    pub fn pace(&self) -> StepControl {
        self.pace
    }

    /// The name of the method that solves a run of `scene`, its own.
    pub fn method<'a>(&self, scene: &'a Scene) -> &'a str {
        self.choice.as_ref().and_then(|choice| choice.rung.method).unwrap_or(scene.integrator_name())
    }

    /// The variables that this scene has.
    pub fn variables(&self) -> &[&'static Variable] {
        &self.variables
    }

    /// What variables are read from, now.
    #[inline]
    pub fn view(&self) -> View<'_> {
        View {
            time: self.time(),
            dynamics: &self.dynamics,
            inputs: &self.dynamics.inputs,
            state: &self.now.state,
            meter: &self.now.meter,
            cycles: &self.now.cycles,
            work: self.newton.work,
            time_step: self.now.time_step,
        }
    }

    /// Moves on by `h` (s) to exactly t + h: in ⌈h/Δt⌉ equal internal steps, or in steps that meet the tolerance. An h too
    /// short for the motion to be more than rounding moves the time alone, and the motion waits for the next step.
    ///
    /// # Errors
    /// [`Error::Step`] for an `h` that is not positive and finite; else what went wrong inside. Everything is then as it was
    /// before the call.
    pub fn do_step(&mut self, h: f64) -> Result<()> {
        self.do_step_with(h, |_| ControlFlow::Continue(())).map(|_| ())
    }

    /// The same, with a look at every internal step, the halves of failed ones included; a look that breaks ends the step
    /// there. True if it came to t + h.
    ///
    /// # Errors
    /// Those of [`do_step`](Self::do_step).
    pub fn do_step_with(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let (ahead, jump) = (self.now.waiting, self.head_jump);
        let outcome = self.go_on(h, look);
        if outcome.is_err() {
            self.take_back();
            (self.now.waiting, self.head_jump) = (ahead, jump);
        }
        outcome
    }

    /// The same for a run that ends where a step fails.
    ///
    /// # Errors
    /// Those of [`do_step`](Self::do_step), but the last good state stays.
    pub fn march(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let (start, waiting) = (self.now.state.t, self.now.waiting);
        let outcome = self.go_on(h, look);
        if outcome.is_err() {
            if self.now.state.t == start {
                self.take_back(); // it has not set out
                self.now.waiting = waiting;
            }
            self.stay();
        }
        outcome
    }

    fn go_on(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        self.undo.begin();
        if !(h.is_finite() && h > 0.0) {
            return Err(Error::Step(h));
        }
        let (start, end) = (self.now.state.t, self.time() + h);
        let h = if self.now.waiting.is_some() { end - start } else { h };
        if h <= self.shortest.max(TIME_ROUNDING * end.abs()) || end <= start {
            self.now.waiting = Some(end);
            return Ok(true);
        }
        self.now.waiting = None;
        match self.pace {
            StepControl::Fixed(time_step) => self.equal_steps(h, time_step, look),
            StepControl::Adaptive(tolerance) => self.adaptive_steps(end, tolerance, look),
        }
    }

    fn equal_steps(
        &mut self,
        h: f64,
        time_step: f64,
        mut look: impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<bool> {
        let start = self.now.state.t;
        let (nearest, most) = ((h / time_step).round(), 9e15);
        let off = (h - nearest * time_step).abs();
        let near = nearest >= 1.0 && off <= STEP_ROUNDING * h;
        let parts = if near { nearest } else { (h / time_step).ceil() };
        if parts >= most {
            return Err(Error::Step(h));
        }
        // The clock counts whole steps; what differs from them by more than the rounding of the time itself ends at t + h.
        let multiple = near && off <= 2.0 * f64::EPSILON * (start + h).abs();
        let part = if multiple { time_step } else { h / parts };
        let end_of = |clock: Clock, count: u64| {
            if multiple {
                clock.at(count, part)
            } else if count as f64 == parts {
                start + h
            } else {
                start + count as f64 * part
            }
        };
        let (clock, parts) = (self.now.clock, parts as u64);
        if parts > 1 {
            self.keep();
        }
        self.set_out(end_of(clock, parts), true)?;
        for count in 1..=parts {
            let end = end_of(clock, count);
            let outcome = self.advance(end, part, 0, true, &mut look);
            let complete = self.now.state.t == end;
            self.now.clock = match outcome {
                Ok(_) if multiple && complete => Clock { origin: clock.origin, count: clock.count + count },
                _ if self.now.state.t == start => clock,
                _ => Clock { origin: self.now.state.t, count: 0 },
            };
            if outcome?.is_break() && !(complete && count == parts) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn adaptive_steps(
        &mut self,
        end: f64,
        tolerance: f64,
        mut look: impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<bool> {
        self.keep();
        self.set_out(end, true)?;
        let order = self.mover.order();
        let (mut grow, mut failures) = (FACTORS[1], 0);
        let mut speed = self.dynamics.own_speed(&self.now.state);
        while self.now.state.t < end {
            let left = end - self.now.state.t;
            // A rest smaller than a step is not left over, nor one step much smaller than the next.
            let longest = self.dynamics.longest_step(self.now.state.t);
            let (h, to) = match self.now.time_step.min(longest) {
                wanted if wanted >= left * (1.0 - STEP_ROUNDING) => (left, end),
                wanted if 2.0 * wanted > left => (0.5 * left, self.now.state.t + 0.5 * left),
                wanted => (wanted, self.now.state.t + wanted),
            };
            if h < left && end + h <= end {
                return Err(Error::Tolerance { time_s: self.now.state.t, step_s: h, tolerance });
            }
            match self.step(to, h) {
                Ok(error) => {
                    let reached = self.dynamics.own_speed(&self.next);
                    let size = self.size(error, h, [speed, reached]) / tolerance;
                    let factor = fitting(size, order).clamp(FACTORS[0], grow);
                    if size <= 1.0 {
                        self.accept()?;
                        self.now.meter.totals.steps += 1;
                        // A step cut short by the end says nothing against the longer one that was wanted; where what
                        // drives the rod cut it, steps grow again from there.
                        let wish = self.now.time_step.min(longest);
                        self.now.time_step = (h * factor).max(if h < wish { wish } else { 0.0 });
                        (grow, failures, speed) = (FACTORS[1], 0, reached);
                        if look(self).is_break() && self.now.state.t < end {
                            self.now.clock = Clock { origin: self.now.state.t, count: 0 };
                            return Ok(false);
                        }
                        continue;
                    }
                    self.now.meter.totals.rejections += 1;
                    self.now.time_step = h * factor;
                }
                Err(error) if error.is_cured_by_smaller_step() && failures < self.max_halvings => {
                    failures += 1;
                    self.now.meter.totals.halvings += 1;
                    self.now.time_step = 0.5 * h;
                }
                Err(error) => return Err(error),
            }
            grow = 1.0;
        }
        self.now.clock = Clock { origin: self.now.state.t, count: 0 };
        Ok(true)
    }

    /// The estimated `error` of a step of `h` (s), relative: what the tolerance bounds. Velocities are measured by the rod's own
    /// `speeds` (m/s) at both ends of the step, the same in any frame.
    fn size(&self, error: StepError, h: f64, speeds: [f64; 2]) -> f64 {
        let length = self.dynamics.length();
        let speed = speeds[0].max(speeds[1]).max(self.head_swing).max(SLOW * length / h);
        (error.position / length).max(error.velocity / speed)
    }

    /// Before the first internal step of several to `end`, where a step `begins` or inputs have changed in the middle of one:
    /// aims the head, and finds the accelerations that changed inputs cause at once.
    fn set_out(&mut self, end: f64, begins: bool) -> Result<()> {
        if self.dynamics.inputs.head.is_some() || self.now.unsettled {
            self.keep();
        }
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.now.steered {
            self.solved = None; // it would be another step now
        }
        (self.now.steered, self.goal) = (false, end);
        let t = self.now.state.t;
        if begins && self.is_at_start() && self.dynamics.starts_elsewhere(t, Some(end)) {
            self.start_with_host()?;
        }
        let distances = self.dynamics.aim_head(t, end, begins);
        self.note_jump(t, distances);
        if self.now.unsettled { self.settle() } else { Ok(()) }
    }

    /// True before the first step.
    fn is_at_start(&self) -> bool {
        self.now.state.t == self.now.meter.first.0
    }

    /// Starts anew with the pose of the head that the host gives; what else it has set acts at once on that start.
    fn start_with_host(&mut self) -> Result<()> {
        let mut scene = Inputs::of(&self.dynamics.model);
        scene.head = self.dynamics.inputs.head.take();
        let mut given = std::mem::replace(&mut self.dynamics.inputs, scene);
        let course = self.dynamics.course.take();
        let started = self.start_with_pose();
        given.head.clone_from(&self.dynamics.inputs.head);
        let scene = std::mem::replace(&mut self.dynamics.inputs, given);
        self.dynamics.course = course;
        started?;
        if self.dynamics.course.is_none() && self.dynamics.inputs.act_as(&scene) {
            return Ok(());
        }
        let undo = std::mem::replace(&mut self.inputs.0, scene);
        let counted = self.count_inputs();
        self.inputs.0 = undo;
        counted
    }

    fn start_with_pose(&mut self) -> Result<()> {
        let mut state = self.now.state.clone();
        self.dynamics.start_with_host(self.now.state.t, &mut state);
        self.mover.begin(&mut self.dynamics, &mut self.newton, &mut state)?;
        let meter = Meter::start(&mut self.dynamics, &state)?;
        self.now.cycles = Cycles::start(&self.dynamics, &state, &meter);
        (self.now.meter, self.now.state) = (meter, state);
        (self.now.unsettled, self.now.gust) = (false, [0.0; 2]);
        self.newton.work = Work::default();
        self.before = None;
        Ok(())
    }

    /// Makes the state one of its own under the changed inputs, and counts what that does at once; nothing is changed where
    /// that fails.
    /// A gust (m/s) of the flow at once, before any other force can act, gives the rod the velocities that an endless
    /// acceleration of no duration would: forces of the fluid are linear in accelerations.
    fn settle(&mut self) -> Result<()> {
        let gust = Vector2::from(self.now.gust);
        let Self { dynamics, mover, newton, now: Now { state, .. }, next, reading, accelerations, .. } = self;
        dynamics.move_to(state.t, state);
        next.copy_from(state);
        mover.settle(dynamics, newton, next)?;
        let inertial = dynamics.model.forces.are_inertial();
        if gust != Vector2::zeros() && inertial {
            let steady = dynamics.inputs.fluid.acceleration;
            accelerations.clone_from(&next.a);
            dynamics.inputs.fluid.acceleration += gust * GUST;
            let accelerated = mover.settle(dynamics, newton, next);
            dynamics.inputs.fluid.acceleration = steady;
            accelerated?;
            let changes = next.a.iter().zip(&*accelerations);
            next.v.iter_mut().zip(changes).for_each(|(v, (with, without))| *v += (with - without) / GUST);
            mover.settle(dynamics, newton, next)?;
        }
        let (shape, motion) = (next.q != state.q, next.v != state.v);
        // What a fluid that is accelerated does, and moments that follow from balance, change with the accelerations alone.
        let forces = (inertial || dynamics.mechanics == Mechanics::Shape) && next.a != state.a;
        if shape || motion || forces {
            reading.take(dynamics, next)?;
        }
        let apart = |new: &[f64], old: &[f64]| new.iter().zip(old).fold(0.0, |max: f64, (a, b)| max.max((a - b).abs()));
        let reach = |tolerance: f64| match dynamics.mechanics {
            Mechanics::Full => (tolerance * dynamics.length() / apart(&next.a, &state.a)).sqrt(),
            Mechanics::Overdamped => tolerance * dynamics.length() / apart(&next.v, &state.v),
            Mechanics::Shape => f64::INFINITY,
        };
        if let StepControl::Adaptive(tolerance) = self.pace {
            // A longer step would see where the rod comes to rest, not how.
            self.now.time_step = self.now.time_step.min(reach(tolerance));
        }
        let Self { now: Now { state, .. }, next, .. } = self;
        std::mem::swap(state, next);
        if shape || motion {
            self.now.meter.count_jump(&mut self.reading, if shape { Giver::Actuation } else { Giver::Flow });
        } else if forces {
            std::mem::swap(&mut self.now.meter.now, &mut self.reading);
        }
        if shape || motion || forces {
            self.now.cycles.follow(&self.dynamics, &self.now.state, &self.now.meter, None);
        }
        self.before = None;
        (self.now.unsettled, self.now.gust) = (false, [0.0; 2]);
        Ok(())
    }

    /// Goes back to the state now from a step that is not made.
    fn stay(&mut self) {
        self.forget_step();
        let t = self.now.state.t;
        self.dynamics.step_end = (!self.is_at_start()).then_some(t);
        self.dynamics.move_to(t, &mut self.now.state);
    }

    /// The last internal step is no longer known.
    fn forget_step(&mut self) {
        self.before = None;
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        {
            self.solved = None;
        }
    }

    /// One step of `h` to time `end`, in halves where it fails, with a look at each; what it ends is a `whole` step or the
    /// first half of one.
    fn advance(
        &mut self,
        end: f64,
        h: f64,
        depth: u32,
        whole: bool,
        look: &mut impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        let limit = self.mover.limit();
        let step = self.step(end, h).and_then(|error| {
            if error.position > limit * self.dynamics.length() {
                return Err(Error::Tolerance { time_s: end, step_s: h, tolerance: limit });
            }
            self.accept()
        });
        match step {
            Err(error) if error.is_cured_by_smaller_step() && depth < self.max_halvings => {
                self.keep();
                self.now.meter.totals.halvings += 1;
                if self.advance(end - 0.5 * h, 0.5 * h, depth + 1, false, look)?.is_break() {
                    return Ok(ControlFlow::Break(()));
                }
                self.advance(end, 0.5 * h, depth + 1, whole, look)
            }
            outcome => outcome.map(|()| {
                self.now.meter.totals.steps += u64::from(whole);
                look(self)
            }),
        }
    }

    /// Steps by `h` to time `end`, into `next`.
    fn step(&mut self, end: f64, h: f64) -> Result<StepError> {
        if self.now.steered {
            self.set_out(self.goal, false)?; // by a look at the step before
        }
        self.dynamics.step_end = Some(end);
        if self.dynamics.head_jumps_at(self.now.state.t) {
            self.keep();
            self.settle()?;
        }
        self.before = None;
        if let Some(dense) = &mut self.dense {
            dense.forget();
        }
        self.dynamics.check_layers(end)?;
        self.next.t = end;
        self.measured = false;
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.take_solved(end, h).is_some() {
            return Ok(StepError::default());
        }
        self.mover.step(&mut self.dynamics, &mut self.newton, &self.now.state, h, &mut self.next)
    }

    /// Makes `next` the state, and counts the step.
    fn accept(&mut self) -> Result<()> {
        let middle = if self.mover.knows_between() { Some(self.middle()?) } else { None };
        if !self.measured {
            self.reading.take(&mut self.dynamics, &self.next)?;
        }
        let load = self.dynamics.load_work([self.now.state.t, self.next.t], &self.now.state.q, &self.next.q);
        let middle = middle.and(self.dense.as_ref()).map(Dense::last);
        let reading = middle.map(|(_, reading)| reading);
        self.before = Some(self.now.meter.totals);
        if let Err(error) = self.now.meter.count(&mut self.reading, reading, load, self.dynamics.head_mass()) {
            self.before = None;
            return Err(error);
        }
        std::mem::swap(&mut self.now.state, &mut self.next);
        self.now.cycles.follow(&self.dynamics, &self.now.state, &self.now.meter, middle);
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

    /// Sets an input; it holds until it is set again. What it changes at once, such as the energy of a changed natural
    /// curvature, is counted at once.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`], [`Error::NotAnInput`], [`Error::WrongLength`], [`Error::BadValue`], and
    /// [`Error::NotFinite`] for a value so large that energies overflow; nothing is changed then.
    pub fn set(&mut self, name: &str, values: &[f64]) -> Result<()> {
        let variable = self.find(name)?;
        self.set_all([Change { variable, order: 0, values }].into_iter())
    }

    /// Sets the time derivative of an input, of `order` 1 to [`HIGHEST_ORDER`]: from now on the input goes on as its value
    /// and derivatives say, until its value is set again.
    ///
    /// # Errors
    /// Those of [`set`](Self::set), and [`Error::Order`].
    pub fn set_derivative(&mut self, name: &str, order: usize, values: &[f64]) -> Result<()> {
        let variable = self.find(name)?;
        if order == 0 {
            return Err(Error::Order { order, highest: HIGHEST_ORDER });
        }
        self.set_all([Change { variable, order, values }].into_iter())
    }

    /// Makes several changes, in their order, as one.
    ///
    /// # Errors
    /// Those of [`set_derivative`](Self::set_derivative), after which nothing is changed.
    pub fn set_all<'a>(&mut self, changes: impl Iterator<Item = Change<'a>> + Clone) -> Result<()> {
        for change in changes.clone() {
            change.check(self.model(), None)?;
        }
        self.make_all(changes.map(|change| (change, 0)))
    }

    /// Makes several changes of some entries of inputs as one: those from the index beside each change on. The other entries
    /// go on as they do.
    ///
    /// # Errors
    /// Those of [`set_all`](Self::set_all).
    pub fn set_entries<'a>(&mut self, changes: impl Iterator<Item = (Change<'a>, usize)> + Clone) -> Result<()> {
        for (change, first) in changes.clone() {
            change.check(self.model(), Some(first))?;
        }
        self.make_all(changes)
    }

    fn make_all<'a>(&mut self, changes: impl Iterator<Item = (Change<'a>, usize)> + Clone) -> Result<()> {
        let t = self.now.state.t;
        self.inputs.0.clone_from(&self.dynamics.inputs);
        self.inputs.1.clone_from(&self.dynamics.course);
        if let Some(course) = &mut self.dynamics.course {
            course.rebase(t, &self.dynamics.inputs);
        }
        let of_head = |(change, _): (Change<'_>, usize)| change.variable.of_head().is_some();
        let of_head = changes.clone().any(of_head);
        changes.for_each(|(change, first)| change.make(&mut self.dynamics, t, first));
        let outcome = match of_head && self.is_at_start() && self.dynamics.starts_elsewhere(t, None) {
            true => self.start_with_host(),
            false => self.count_inputs(),
        };
        if outcome.is_err() {
            self.dynamics.restore(&self.inputs.0);
            self.dynamics.course.clone_from(&self.inputs.1);
            self.dynamics.move_to(t, &mut self.now.state);
        }
        outcome
    }

    /// Reads the state under inputs that have just changed, and counts what that does at once.
    fn count_inputs(&mut self) -> Result<()> {
        let Self { dynamics, now, read_at_once, .. } = self;
        dynamics.move_to(now.state.t, &mut now.state);
        dynamics.check_layers(now.state.t)?;
        read_at_once.take(dynamics, &now.state)?;
        now.meter.count(read_at_once, None, 0.0, dynamics.head_mass())?;
        let before = &self.inputs.0;
        let gust = dynamics.inputs.fluid.flow - before.fluid.flow;
        now.steered = true;
        now.unsettled |= !dynamics.inputs.act_as(before);
        now.gust = (Vector2::from(now.gust) + gust).into();
        now.cycles.follow(dynamics, &now.state, &now.meter, None);
        self.before = None; // its end is another now
        Ok(())
    }
}

/// A new value of an input, or of a time derivative of it.
#[derive(Debug, Clone, Copy)]
pub struct Change<'a> {
    /// The input.
    pub variable: &'static Variable,
    /// The order of the derivative; zero is the value.
    pub order: usize,
    /// As many values as the variable has.
    pub values: &'a [f64],
}

impl Change<'_> {
    /// Refuses what is no change of a whole input, or of its entries from index `first` on.
    fn check(&self, model: &Model, first: Option<usize>) -> Result<()> {
        let Self { variable, order, values } = *self;
        if variable.causality != Causality::Input {
            return Err(Error::NotAnInput(variable.name));
        }
        if order + variable.of_head().map_or(0, |[_, own]| own) > HIGHEST_ORDER {
            return Err(Error::Order { order, highest: HIGHEST_ORDER });
        }
        let expected = variable.len(model);
        let fits = first.map_or(values.len() == expected, |first| {
            first.checked_add(values.len()).is_some_and(|end| end <= expected)
        });
        if !fits {
            return Err(Error::WrongLength { name: variable.name, expected, found: values.len() });
        }
        let refused = if order == 0 {
            variable.refused(values)
        } else {
            values.iter().find(|x| !x.is_finite()).map(|x| (*x, "a finite number"))
        };
        match refused {
            Some((value, allowed)) => Err(Error::BadValue { name: variable.name, value, allowed }),
            None => Ok(()),
        }
    }

    /// Makes it at time `t` (s) for the entries from index `first` on.
    fn make(&self, dynamics: &mut Dynamics, t: f64, first: usize) {
        let Self { variable, order, values } = *self;
        if let Some([i, own]) = variable.of_head() {
            dynamics.say_head(t, i, own + order, values[0], order > 0);
        } else if order == 0 {
            variable.write(dynamics, t, first, values);
            let Some(mut course) = dynamics.course.take() else { return };
            course.change(dynamics, 0, |inputs| variable.write(inputs, t, first, values));
            for order in 1..=HIGHEST_ORDER {
                course.change(dynamics, order, |rates| variable.clear(rates, t, first, values.len()));
            }
            dynamics.course = Some(course);
        } else {
            let mut course = match dynamics.course.take() {
                Some(course) => course,
                None => Box::new(InputExtrapolation::resting(&dynamics.model, &dynamics.inputs, t)),
            };
            course.change(dynamics, order, |rates| variable.write(rates, t, first, values));
            dynamics.inputs.flow_taken |= course.takes_flow();
            dynamics.course = Some(course);
        }
    }
}

/// The largest modulus of `values`.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max, x| max.max(x.abs()))
}

/// The next step over one whose error was `size` times the tolerance, where errors go with the step to the power `order`: its own
/// is that power of [`SAFETY`] times the tolerance (E. Hairer, S. P. Nørsett & G. Wanner, Solving Ordinary Differential Equations I,
/// section II.4).
fn fitting(size: f64, order: u32) -> f64 {
    SAFETY * size.powf(-1.0 / f64::from(order))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_step_has_the_error_that_is_aimed_at() {
        for order in 1..=4 {
            for size in [1e-3_f64, 0.5, 1.0, 8.0, 1e4] {
                let next = size * fitting(size, order).powi(order as i32);
                let aim = SAFETY.powi(order as i32);
                assert!((next / aim - 1.0).abs() < 1e-14, "order {order}: {next} of the tolerance, aimed at {aim}");
            }
        }
    }
}
