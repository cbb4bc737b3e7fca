//! The stepper: init, do_step, get, set, save and restore over the table of variables. Every face goes through it.

#[cfg(all(feature = "report", target_arch = "x86_64"))]
pub(crate) mod ahead;
mod between;
mod dense;
pub mod derivatives;
mod retune;
pub mod snapshot;
mod undo;

use std::ops::ControlFlow;
use std::sync::Arc;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use dense::Dense;
pub use snapshot::Snapshot;

use crate::cycle::Cycles;
use crate::error::{Error, Result, nearest};
use crate::integrator::{Pace, StepError};
use crate::metrics::{Giver, Meter, Reading, Totals};
use crate::model::course::HIGHEST_ORDER;
use crate::model::{Course, Dynamics, Inputs, Mechanics, Model};
use crate::newton::{Newton, Work};
use crate::reduced::{Choice, Mover};
use crate::scene::Scene;
use crate::system::{Form, State, System};
use crate::variable::{Causality, VARIABLES, Variable, View};

/// How often a failing step is halved before the failure is reported: down to 1/1024 of it.
const MAX_HALVINGS: u32 = 10;

/// An adaptive step may change by these factors, and aims at this part of the step that just meets the tolerance.
const FACTORS: [f64; 2] = [0.2, 5.0];
const SAFETY: f64 = 0.9;

/// The first adaptive step where the rod rests, s: it grows fivefold a step.
const AT_REST: f64 = 1e-4;

/// Velocities count as no smaller than this part of a length a step.
const SLOW: f64 = 1e-3;

/// A step shorter than this part of the internal one waits for the next: its motion would be rounding errors over a time that
/// is too short for them.
const UNRESOLVED: f64 = 1e-6;

/// A step length within this of a multiple of Δt, relative, is that multiple.
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
    pace: Pace,
    clock: Clock,
    /// The next internal step that the pace wants, s.
    time_step: f64,
    /// How often a failing step is halved.
    max_halvings: u32,
    state: State,
    kick: Kick,
    undo: undo::Undo,
    meter: Meter,
    cycles: Cycles,
    variables: Vec<&'static Variable>,
    /// The totals before the last internal step; its state and reading are then in `next` and `reading`.
    before: Option<Totals>,
    dense: Option<Dense>,
    tangent: Option<Box<derivatives::Tangent>>,
    /// The scene, as [`Scene::fingerprint`] names it.
    scene: u128,
    /// An input has changed since the last internal step set out.
    steered: bool,
    /// Where the step of several internal ones ends, s.
    goal: f64,
    /// The next internal step, solved already.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    solved: Option<ahead::Ahead>,
    /// What the end of the internal step is measured to be is in `reading` already.
    measured: bool,
    /// The host's time (s), where it is ahead of the state's by steps that wait.
    ahead: Option<f64>,
    // Room to work in.
    inputs: (Inputs, Option<Box<Course>>),
    next: State,
    reading: Reading,
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

/// What changed inputs do to the state at once.
#[derive(Debug, Clone)]
struct Kick {
    /// They have changed since the state settled.
    due: bool,
    /// How much the flow has changed at once since then, m/s.
    gust: Vector2<f64>,
    /// The state before; there once inputs have changed.
    before: State,
    /// What was measured before, where a shape or a motion that changed at once was counted.
    measured: Option<Box<(Meter, Cycles)>>,
}

impl Stepper {
    /// Prepares a run of `model` at time zero with internal steps of that `pace`, solved by `newton`.
    ///
    /// # Errors
    /// Whatever is wrong with the first state.
    pub fn init(
        model: impl Into<Arc<Model>>,
        mover: impl Into<Box<dyn Mover>>,
        mut newton: Newton,
        pace: impl Into<Pace>,
    ) -> Result<Self> {
        let (mut dynamics, mut mover) = (Dynamics::new(model.into()), mover.into());
        dynamics.mechanics = mover.mechanics();
        let mut state = dynamics.first_state_in(newton.form());
        mover.begin(&mut dynamics, &mut newton, &mut state)?;
        newton.work = Work::default();
        let pace = pace.into();
        let time_step = match pace {
            Pace::Fixed(time_step) => time_step,
            Pace::Adaptive(tolerance) => {
                let acceleration = largest(&state.a);
                if acceleration > 0.0 { (tolerance * dynamics.length() / acceleration).sqrt() } else { AT_REST }
            }
        };
        let meter = Meter::start(&mut dynamics, &state)?;
        let cycles = Cycles::start(&dynamics, &state, &meter);
        let variables = VARIABLES.iter().filter(|variable| variable.exists_in(&dynamics.model)).collect();
        let dense = mover.knows_between().then(|| Dense::new(&state, &meter));
        Ok(Self {
            mover,
            choice: None,
            newton,
            pace,
            clock: Clock { origin: state.t, count: 0 },
            time_step,
            max_halvings: MAX_HALVINGS,
            kick: Kick { due: false, gust: Vector2::zeros(), before: State::default(), measured: None },
            undo: undo::Undo::default(),
            before: None,
            dense,
            tangent: None,
            scene: 0,
            steered: false,
            goal: state.t,
            #[cfg(all(feature = "report", target_arch = "x86_64"))]
            solved: None,
            measured: false,
            ahead: None,
            inputs: (dynamics.inputs.clone(), None),
            next: state.clone(),
            reading: Reading::new(dynamics.nodes()),
            meter,
            cycles,
            state,
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
        let (choice, model) = (scene.choice()?, scene.model()?);
        let taken = scene.taken(&choice);
        let solver = &taken.solver;
        let mover = (choice.rung.build)(taken.integrator()?);
        let solved = mover.mechanics() != Mechanics::Shape;
        let form = if solved { taken.form(&model.rod) } else { Form::Positions };
        let newton = Newton::with(form, solver.linear, model.rod.nodes, taken.newton_tolerance())?;
        let newton = if taken.newton_foresees() { newton.foreseeing(model.rod.slenderness_squared()) } else { newton };
        let start = Self::init(model, mover, newton, taken.pace()).map_err(|error| scene.cannot_start(&error))?;
        Ok(Self { scene: scene.fingerprint(), choice: Some(choice), ..start })
    }

    /// Chooses whether a step that fails is halved, as it is unless told otherwise, or reported at once.
    pub fn halve_failing_steps(&mut self, yes: bool) {
        self.max_halvings = if yes { MAX_HALVINGS } else { 0 };
    }

    /// Time now, s.
    pub fn time(&self) -> f64 {
        self.ahead.unwrap_or(self.state.t)
    }

    /// Positions, velocities and accelerations now.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The running totals and the last reading.
    pub fn meter(&self) -> &Meter {
        &self.meter
    }

    /// The last whole cycles.
    pub fn cycles(&self) -> &Cycles {
        &self.cycles
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
    pub fn pace(&self) -> Pace {
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
            dynamics: &self.dynamics,
            state: &self.state,
            meter: &self.meter,
            cycles: &self.cycles,
            work: self.newton.work,
            time_step: self.time_step,
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
        let ahead = self.ahead;
        let outcome = self.go_on(h, look);
        if outcome.is_err() {
            self.take_back();
            self.ahead = ahead;
        }
        outcome
    }

    /// The same for a run that ends where a step fails.
    ///
    /// # Errors
    /// Those of [`do_step`](Self::do_step), but the last good state stays.
    pub fn march(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        let start = self.state.t;
        let outcome = self.go_on(h, look);
        if outcome.is_err() {
            if self.state.t == start {
                self.take_back(); // it has not set out
            }
            self.before = None;
            self.dynamics.move_to(self.state.t, &mut self.state);
        }
        outcome
    }

    fn go_on(&mut self, h: f64, look: impl FnMut(&mut Self) -> ControlFlow<()>) -> Result<bool> {
        self.undo.begin();
        if !(h.is_finite() && h > 0.0) {
            return Err(Error::Step(h));
        }
        let end = self.time() + h;
        let h = if self.ahead.is_some() { end - self.state.t } else { h };
        if h < UNRESOLVED * self.time_step || end <= self.state.t {
            self.ahead = Some(end);
            return Ok(true);
        }
        self.ahead = None;
        match self.pace {
            Pace::Fixed(time_step) => self.equal_steps(h, time_step, look),
            Pace::Adaptive(tolerance) => self.adaptive_steps(end, tolerance, look),
        }
    }

    fn equal_steps(
        &mut self,
        h: f64,
        time_step: f64,
        mut look: impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<bool> {
        let start = self.state.t;
        let (nearest, most) = ((h / time_step).round(), 9e15);
        let multiple = nearest >= 1.0 && (h - nearest * time_step).abs() <= STEP_ROUNDING * h;
        let parts = if multiple { nearest } else { (h / time_step).ceil() };
        if parts >= most {
            return Err(Error::Step(h));
        }
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
        let (clock, parts) = (self.clock, parts as u64);
        if parts > 1 {
            self.keep();
        }
        self.set_out(end_of(clock, parts), true)?;
        for count in 1..=parts {
            let end = end_of(clock, count);
            let outcome = self.advance(end, part, 0, true, &mut look);
            let complete = self.state.t == end;
            self.clock = match outcome {
                Ok(_) if multiple && complete => Clock { origin: clock.origin, count: clock.count + count },
                _ if self.state.t == start => clock,
                _ => Clock { origin: self.state.t, count: 0 },
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
        let exponent = -1.0 / f64::from(self.mover.order());
        let longest = self.mover.longest_step(&self.dynamics);
        let (mut grow, mut failures) = (FACTORS[1], 0);
        while self.state.t < end {
            let left = end - self.state.t;
            // A rest smaller than a step is not left over, nor one step much smaller than the next.
            let (h, to) = match self.time_step.min(longest) {
                wanted if wanted >= left * (1.0 - STEP_ROUNDING) => (left, end),
                wanted if 2.0 * wanted > left => (0.5 * left, self.state.t + 0.5 * left),
                wanted => (wanted, self.state.t + wanted),
            };
            if h < left && end + h <= end {
                return Err(Error::Tolerance { time_s: self.state.t, step_s: h, tolerance });
            }
            match self.step(to, h) {
                Ok(error) => {
                    let size = self.size(error, h) / tolerance;
                    let factor = (SAFETY * size.powf(exponent)).clamp(FACTORS[0], grow);
                    if size <= 1.0 {
                        self.accept()?;
                        self.meter.totals.steps += 1;
                        // A step cut short by the end says nothing against the longer one that was wanted.
                        self.time_step = (h * factor).max(if h < self.time_step { self.time_step } else { 0.0 });
                        (grow, failures) = (FACTORS[1], 0);
                        if look(self).is_break() && self.state.t < end {
                            self.clock = Clock { origin: self.state.t, count: 0 };
                            return Ok(false);
                        }
                        continue;
                    }
                    self.meter.totals.rejections += 1;
                    self.time_step = h * factor;
                }
                Err(error) if error.is_cured_by_smaller_step() && failures < self.max_halvings => {
                    failures += 1;
                    self.meter.totals.halvings += 1;
                    self.time_step = 0.5 * h;
                }
                Err(error) => return Err(error),
            }
            grow = 1.0;
        }
        self.clock = Clock { origin: self.state.t, count: 0 };
        Ok(true)
    }

    /// The estimated `error` of a step of `h` (s) to `next`, relative: what the tolerance bounds.
    fn size(&self, error: StepError, h: f64) -> f64 {
        let length = self.dynamics.length();
        let speed = largest(&self.state.v).max(largest(&self.next.v)).max(SLOW * length / h);
        (error.position / length).max(error.velocity / speed)
    }

    /// Before the first internal step of several to `end`, where a step `begins` or inputs have changed in the middle of one:
    /// aims the head, and finds the accelerations that changed inputs cause at once.
    fn set_out(&mut self, end: f64, begins: bool) -> Result<()> {
        if self.dynamics.inputs.head.is_some() || self.kick.due {
            self.keep();
        }
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.steered {
            self.solved = None; // it would be another step now
        }
        (self.steered, self.goal) = (false, end);
        self.dynamics.aim_head(self.state.t, end, begins);
        if self.kick.due {
            self.dynamics.move_to(self.state.t, &mut self.state);
            self.kick.before.copy_from(&self.state);
            self.kick.measured = None;
            self.kick.due = false;
            let gust = std::mem::take(&mut self.kick.gust);
            if let Err(error) = self.settle(gust) {
                self.kick.gust = gust;
                self.unsettle();
                return Err(error);
            }
        }
        Ok(())
    }

    /// Makes the state one of its own under the changed inputs, and counts what that does at once.
    /// A `gust` (m/s) of the flow at once, before any other force can act, gives the rod the velocities that an endless
    /// acceleration of no duration would: forces of the fluid are linear in accelerations.
    fn settle(&mut self, gust: Vector2<f64>) -> Result<()> {
        let Self { dynamics, mover, newton, state, .. } = self;
        mover.settle(dynamics, newton, state)?;
        if gust != Vector2::zeros() && dynamics.model.forces.are_inertial() {
            let steady = dynamics.inputs.fluid.acceleration;
            self.next.a.copy_from_slice(&state.a);
            dynamics.inputs.fluid.acceleration += gust * GUST;
            let accelerated = mover.settle(dynamics, newton, state);
            dynamics.inputs.fluid.acceleration = steady;
            accelerated?;
            let accelerations = state.a.iter().zip(&self.next.a);
            state.v.iter_mut().zip(accelerations).for_each(|(v, (with, without))| *v += (with - without) / GUST);
            mover.settle(dynamics, newton, state)?;
        }
        let (shape, motion) = (self.state.q != self.kick.before.q, self.state.v != self.kick.before.v);
        if shape || motion {
            self.reading.take(&mut self.dynamics, &self.state)?;
            self.kick.measured = Some(Box::new((self.meter.clone(), self.cycles)));
            self.meter.count_jump(&mut self.reading, if shape { Giver::Actuation } else { Giver::Flow });
            self.cycles.follow(&self.dynamics, &self.state, &self.meter, None);
        }
        Ok(())
    }

    /// Takes back what [`settle`](Self::settle) did.
    fn unsettle(&mut self) {
        std::mem::swap(&mut self.state, &mut self.kick.before);
        if let Some(measured) = self.kick.measured.take() {
            (self.meter, self.cycles) = *measured;
        }
        self.kick.due = true;
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
                self.meter.totals.halvings += 1;
                if self.advance(end - 0.5 * h, 0.5 * h, depth + 1, false, look)?.is_break() {
                    return Ok(ControlFlow::Break(()));
                }
                self.advance(end, 0.5 * h, depth + 1, whole, look)
            }
            outcome => outcome.map(|()| {
                self.meter.totals.steps += u64::from(whole);
                look(self)
            }),
        }
    }

    /// Steps by `h` to time `end`, into `next`.
    fn step(&mut self, end: f64, h: f64) -> Result<StepError> {
        if self.steered {
            self.set_out(self.goal, false)?; // by a look at the step before
        }
        self.before = None;
        if let Some(dense) = &mut self.dense {
            dense.forget();
        }
        self.next.t = end;
        self.measured = false;
        #[cfg(all(feature = "report", target_arch = "x86_64"))]
        if self.take_solved(end, h).is_some() {
            return Ok(StepError::default());
        }
        self.mover.step(&mut self.dynamics, &mut self.newton, &self.state, h, &mut self.next)
    }

    /// Makes `next` the state, and counts the step.
    fn accept(&mut self) -> Result<()> {
        let middle = if self.mover.knows_between() { Some(self.middle()?) } else { None };
        if !self.measured {
            self.reading.take(&mut self.dynamics, &self.next)?;
        }
        let load = self.dynamics.load_work([self.state.t, self.next.t], &self.state.q, &self.next.q);
        let middle = middle.and(self.dense.as_ref()).map(Dense::last);
        let reading = middle.map(|(_, reading)| reading);
        self.before = Some(self.meter.totals);
        if let Err(error) = self.meter.count(&mut self.reading, reading, load, self.dynamics.head_mass()) {
            self.before = None;
            return Err(error);
        }
        std::mem::swap(&mut self.state, &mut self.next);
        self.cycles.follow(&self.dynamics, &self.state, &self.meter, middle);
        Ok(())
    }

    /// The variable of this name.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`].
    pub fn find(&self, name: &str) -> Result<&'static Variable> {
        self.variables.iter().copied().find(|variable| variable.name == name).ok_or_else(|| Error::UnknownVariable {
            name: name.to_string(),
            nearest: nearest(name, self.variables.iter().map(|variable| variable.name)),
        })
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
            change.check(self.model())?;
        }
        let t = self.state.t;
        self.inputs.0.clone_from(&self.dynamics.inputs);
        self.inputs.1.clone_from(&self.dynamics.course);
        if let Some(course) = &mut self.dynamics.course {
            course.rebase(t, &self.dynamics.inputs);
        }
        changes.clone().for_each(|change| change.make(&mut self.dynamics, t));
        self.dynamics.move_to(t, &mut self.state);
        self.before = None; // its reading is lost
        let head_mass = self.dynamics.head_mass();
        let read = self.reading.take(&mut self.dynamics, &self.state);
        if let Err(error) = read.and_then(|()| self.meter.count(&mut self.reading, None, 0.0, head_mass)) {
            self.dynamics.restore(&self.inputs.0);
            self.dynamics.course.clone_from(&self.inputs.1);
            self.dynamics.move_to(t, &mut self.state);
            return Err(error);
        }
        self.steered = true;
        self.kick.due |= !self.dynamics.inputs.act_as(&self.inputs.0);
        self.kick.gust += self.dynamics.inputs.fluid.flow - self.inputs.0.fluid.flow;
        self.cycles.follow(&self.dynamics, &self.state, &self.meter, None);
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
    fn check(&self, model: &Model) -> Result<()> {
        let Self { variable, order, values } = *self;
        if variable.causality != Causality::Input {
            return Err(Error::NotAnInput(variable.name));
        }
        if order + variable.of_head().map_or(0, |[_, own]| own) > HIGHEST_ORDER {
            return Err(Error::Order { order, highest: HIGHEST_ORDER });
        }
        let expected = variable.len(model);
        if values.len() != expected {
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

    /// Makes it at time `t` (s).
    fn make(&self, dynamics: &mut Dynamics, t: f64) {
        let Self { variable, order, values } = *self;
        if let Some([i, own]) = variable.of_head() {
            dynamics.say_head(t, i, own + order, values[0], order > 0);
        } else if order == 0 {
            let Some(mut course) = dynamics.course.take() else { return variable.write(dynamics, t, values) };
            variable.write(dynamics, t, values);
            course.set_values(&dynamics.inputs);
            let zeros = vec![0.0; values.len()];
            for order in 1..=HIGHEST_ORDER {
                course.change_rates(dynamics, order, |rates| variable.write(rates, t, &zeros));
            }
            dynamics.course = Some(course);
        } else {
            let mut course = match dynamics.course.take() {
                Some(course) => course,
                None => Box::new(Course::resting(&dynamics.model, &dynamics.inputs, t)),
            };
            course.change_rates(dynamics, order, |rates| variable.write(rates, t, values));
            dynamics.inputs.flow_taken |= course.takes_flow();
            dynamics.course = Some(course);
        }
    }
}

/// The largest modulus of `values`.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |max, x| max.max(x.abs()))
}
