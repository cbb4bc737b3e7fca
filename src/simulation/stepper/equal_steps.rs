//! A communication step in equal internal steps, taken one by one: by its stepper, or by a batch that alternates between several
//! steppers.

use std::ops::ControlFlow;

use super::{Clock, STEP_ROUNDING, Stepper};
use crate::error::{Error, Result};

/// The internal steps of a communication step, and the number of steps taken.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EqualSteps {
    /// Start of the communication step, s.
    start: f64,
    /// Size of the communication step, s.
    h: f64,
    /// The clock at the start.
    clock: Clock,
    /// Size of each internal step, s.
    part: f64,
    /// Number of internal steps.
    parts: u64,
    /// Number of internal steps taken.
    taken: u64,
    /// True if each internal step is a whole step of the clock.
    multiple: bool,
}

impl EqualSteps {
    /// The internal steps of at most `time_step` (s) that make up a step of `h` (s) from `start` (s).
    fn of(start: f64, h: f64, time_step: f64, clock: Clock) -> Result<Self> {
        let (nearest, most) = ((h / time_step).round(), 9e15);
        let off = (h - nearest * time_step).abs();
        let near = nearest >= 1.0 && off <= STEP_ROUNDING * h;
        let parts = if near { nearest } else { (h / time_step).ceil() };
        if parts >= most {
            return Err(Error::Step(h));
        }
        // The clock counts whole steps; a step whose size differs from them by more than the rounding of the time itself ends at
        // t + h.
        let multiple = near && off <= 2.0 * f64::EPSILON * (start + h).abs();
        let part = if multiple { time_step } else { h / parts };
        Ok(Self { start, h, clock, part, parts: parts as u64, taken: 0, multiple })
    }

    /// The time (s) after `count` internal steps.
    fn end_of(&self, count: u64) -> f64 {
        if self.multiple {
            self.clock.at(count, self.part)
        } else if count == self.parts {
            self.start + self.h
        } else {
            self.start + count as f64 * self.part
        }
    }

    /// End and size (s) of the next internal step.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    pub fn next(&self) -> [f64; 2] {
        [self.end_of(self.taken + 1), self.part]
    }

    /// True once all internal steps have been taken.
    pub fn are_taken(&self) -> bool {
        self.taken == self.parts
    }
}

impl Stepper {
    /// Prepares the internal steps of a communication step of `h` (s) with a fixed `time_step` (s).
    pub(super) fn begin_equal_steps(&mut self, h: f64, time_step: f64) -> Result<EqualSteps> {
        let steps = EqualSteps::of(self.now.state.t, h, time_step, self.now.clock)?;
        if steps.parts > 1 {
            self.save_for_undo();
        }
        self.prepare_step(steps.end_of(steps.parts), true)?;
        Ok(steps)
    }

    /// Takes the next of `steps`, in halves if it fails, and calls `look` after each. It breaks if `look` has ended the
    /// communication step early.
    ///
    /// # Errors
    /// Errors of the internal step.
    pub(crate) fn take_equal_step(
        &mut self,
        steps: &mut EqualSteps,
        look: &mut impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        steps.taken += 1;
        let (clock, end) = (steps.clock, steps.end_of(steps.taken));
        let outcome = self.step_or_halve(end, steps.part, 0, true, look);
        let complete = self.now.state.t == end;
        self.now.clock = match outcome {
            Ok(_) if steps.multiple && complete => Clock { origin: clock.origin, count: clock.count + steps.taken },
            _ if self.now.state.t == steps.start => clock,
            _ => Clock { origin: self.now.state.t, count: 0 },
        };
        let ended = outcome?.is_break() && !(complete && steps.are_taken());
        Ok(if ended { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}
