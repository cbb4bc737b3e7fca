//! Communication steps and intermediate updates.

use std::ops::ControlFlow;
use std::ptr::NonNull;

use caudal::stepper::{HeadJump, Stepper};

use super::{Instance, InstanceMode};
use crate::status::{FmiError, FmiResult, Status, refuse};

/// The host's time may differ from that of the instance by this fraction of its step, in total, …
const TIME_TOLERANCE: f64 = 1e-3;

/// … and from the end of its own last step by this fraction of the time, the rounding error of a sum.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The outcome of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepOutcome {
    pub time: f64,
    pub early: bool,
}

impl Instance {
    /// Returns an error for a step that is not allowed.
    fn check_step(&self, current: f64, h: f64) -> FmiResult {
        let now = self.time();
        if !(h.is_finite() && h > 0.0) {
            return refuse(format!("a step of {h} s is not possible: it must be positive and finite"));
        }
        // Hosts count their steps, or add them up with a rounding error in each step. Any other deviation accumulates too, and
        // does not lead to a step of this instance.
        let rounding = |time: f64| ROUNDING * time.abs();
        let slack = |time: f64| TIME_TOLERANCE * h + rounding(time);
        let goes_on = |time: f64| (current - time).abs() <= rounding(time);
        let is_now = (current - now).abs() <= slack(now) || self.host_time.is_some_and(goes_on);
        if !is_now {
            return refuse(format!("the communication point {current} s is not the time of this instance, {now} s"));
        }
        let begin = now.min(current);
        match self.experiment.stop {
            Some(stop) if begin + h > stop + slack(stop) => {
                refuse(format!("a step from {begin} s by {h} s goes beyond the stop time, {stop} s"))
            }
            _ => Ok(()),
        }
    }

    /// Steps from `current` by `h` (s). `look` is called after each internal step with its time and whether it is the last, and
    /// may break with the time at which to end.
    ///
    /// # Safety
    /// `this` is an instance. No reference to it exists while `look` runs, so a host may call with it.
    pub unsafe fn do_step(
        this: *mut Self,
        current: f64,
        h: f64,
        look: Option<&mut dyn FnMut(f64, bool) -> ControlFlow<f64>>,
    ) -> FmiResult<StepOutcome> {
        // SAFETY: guaranteed by the caller; this reference ends before `look` runs.
        let instance = unsafe { &mut *this };
        instance.check_step(current, h)?;
        instance.ready()?;
        let Some(mut stepper) = instance.stepper.own.take() else { return refuse("there is no model") };
        let (start, from) = (instance.experiment.start, stepper.time());
        // Inputs set before the step belong to an earlier time for a host that reads values during the step.
        let set = std::mem::take(&mut instance.inputs);
        let before = (stepper.work().newton_iterations, stepper.metrics().totals.steps);
        let outcome = match look {
            None => stepper.do_step(h).map(|()| true).map_err(FmiError::discard),
            // SAFETY: as above.
            Some(look) => unsafe { Self::do_step_watched(this, &mut stepper, h, look) },
        };
        let jump = stepper.take_head_jump();
        let (time, iterations, steps) =
            (stepper.time(), stepper.work().newton_iterations - before.0, stepper.metrics().totals.steps - before.1);
        // SAFETY: as above.
        let instance = unsafe { &mut *this };
        instance.stepper.own = Some(stepper);
        if time == from {
            instance.inputs = set;
        } else {
            instance.host_time = matches!(outcome, Ok(true)).then_some(current + h);
        }
        if let Some(jump) = jump {
            let jump = HeadJump { time: start + jump.time, ..jump };
            instance.log_message(Status::Warning, &jump.to_string());
        }
        if instance.logged.contains(&Status::Ok.category()) {
            let (from, to) = (start + from, start + time);
            instance.log_message(
                Status::Ok,
                &format!("{from} s to {to} s: {steps} internal steps, {iterations} Newton iterations"),
            );
        }
        outcome.map(|whole| StepOutcome { time: start + time, early: !whole })
    }

    /// # Safety
    /// As for [`do_step`](Self::do_step).
    unsafe fn do_step_watched(
        this: *mut Self,
        stepper: &mut Stepper,
        h: f64,
        look: &mut dyn FnMut(f64, bool) -> ControlFlow<f64>,
    ) -> FmiResult<bool> {
        let goal = stepper.time() + h;
        let (mut wish, mut refusal) = (None, None);
        let mut watch = |stepper: &mut Stepper| {
            // SAFETY: guaranteed by the caller; each reference ends with its statement.
            let start = unsafe { &mut *this }.begin_intermediate_update(stepper);
            let answer = look(start + stepper.time(), stepper.time() >= goal);
            // SAFETY: as above.
            refusal = unsafe { &mut *this }.end_intermediate_update().err();
            match answer {
                ControlFlow::Continue(()) if refusal.is_none() => ControlFlow::Continue(()),
                ControlFlow::Continue(()) => ControlFlow::Break(()),
                ControlFlow::Break(time) => {
                    wish = Some(time - start);
                    ControlFlow::Break(())
                }
            }
        };
        let whole = stepper.do_step_with(h, &mut watch).map_err(FmiError::discard)?;
        if let Some(refusal) = refusal {
            return Err(refusal);
        }
        // Continues to the time at which the host wants to end.
        let left = wish.map_or(0.0, |wish: f64| wish.min(goal) - stepper.time());
        if whole || left <= 1e-9 * h {
            return Ok(whole);
        }
        // If that fails, the step ends at the current time.
        Ok(stepper.do_step(left).is_ok() && stepper.time() >= goal)
    }

    /// Begins an intermediate update, in which the host's calls use the stepper of the step. Returns the start time of the experiment, s.
    fn begin_intermediate_update(&mut self, stepper: &mut Stepper) -> f64 {
        self.stepper.lent = Some(NonNull::from(stepper));
        self.mode = InstanceMode::Intermediate;
        self.experiment.start
    }

    /// Ends an intermediate update: passes the inputs that the host has set to the stepper.
    fn end_intermediate_update(&mut self) -> FmiResult {
        if self.mode == InstanceMode::Fatal {
            let message = "this instance failed during a step".to_string();
            return Err(FmiError { status: Status::Fatal, message });
        }
        let outcome = if self.inputs.is_pending() { self.pass_inputs() } else { Ok(()) };
        if outcome.is_ok() {
            self.inputs.clear();
        }
        self.stepper.lent = None;
        self.mode = InstanceMode::Step;
        outcome
    }
}
