//! Batched steps: the equations of motion of four similar cases, each in a SIMD lane (AVX2), solved by one Newton iteration.
//!
//! A [`Batch`] solves the next step of each stepper in advance, from the initial guess to the measurements; the stepper then accepts it
//! instead of solving it. The source is the same as for one rod, generic over its number type, so the results are bit-identical. If a
//! case does not converge at once, its stepper solves the step alone, from the beginning.

#[cfg(target_arch = "x86_64")]
mod forces;
#[cfg(target_arch = "x86_64")]
mod kernel;
#[cfg(target_arch = "x86_64")]
mod lanes;

use std::ops::ControlFlow;

use crate::error::Result;
#[cfg(target_arch = "x86_64")]
use crate::integrator::StepControl;
use crate::stepper::Stepper;

/// Number of cases in a batch.
pub const WIDTH: usize = 4;

/// Steppers whose steps are solved together, see [`Batch::of`].
#[derive(Debug)]
pub struct Batch {
    #[cfg(target_arch = "x86_64")]
    kernel: kernel::Kernel,
    steps: u64,
}

impl Batch {
    /// Creates a batch of at most [`WIDTH`] steppers. They must have the same number of nodes, kind of material and one-stage
    /// method at a fixed step, nodal positions as unknowns, the local drag law with or without the reactive force, and a uniform
    /// medium or none. Returns `None` for others, for fewer than two steppers, and on a processor without AVX2.
    pub fn of(steppers: &[&Stepper]) -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        return Some(Self { kernel: kernel::Kernel::of(steppers)?, steps: 0 });
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = steppers;
            None
        }
    }

    /// True if this stepper can be batched with others like it.
    pub fn takes(stepper: &Stepper) -> bool {
        Self::of(&[stepper; 2]).is_some()
    }

    /// Batches of `steppers`, [`WIDTH`] at a time in their order; `None` for each group that [cannot be batched](Self::of).
    pub fn of_all(steppers: &[&Stepper]) -> Vec<Option<Self>> {
        steppers.chunks(WIDTH).map(Self::of).collect()
    }

    /// Solves the next internal step of each of `steppers`: all steppers that the batch was [made of](Self::of), or some of them
    /// in the same places. Quantities that depend on time alone are then already evaluated at the end of that step, so each
    /// stepper must take the step before anything is read from it.
    pub fn presolve(&mut self, steppers: &mut [Option<&mut Stepper>]) {
        #[cfg(target_arch = "x86_64")]
        {
            self.steps += self.kernel.presolve(steppers, |_, stepper| stepper.presolve_next());
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = steppers;
    }

    /// Advances each of `steppers` by `h` (s): all steppers that the batch was [made of](Self::of), or some of them in the same
    /// places. They take their internal steps in turn, so that steps of the same size are solved together, even if their times
    /// and inputs differ.
    ///
    /// Each stepper ends as after [`Stepper::do_step_with`] alone, with identical bits or the same error; a failure does not
    /// affect the others. `look` also receives the place. The outcome of a place without a stepper is `Ok(true)`.
    pub fn do_step_with(
        &mut self,
        steppers: &mut [Option<&mut Stepper>],
        h: f64,
        look: impl FnMut(usize, &mut Stepper) -> ControlFlow<()>,
    ) -> [Result<bool>; WIDTH] {
        #[cfg(target_arch = "x86_64")]
        {
            self.take_in_turns(steppers, h, look)
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            do_step_alone(steppers, h, look)
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn take_in_turns(
        &mut self,
        steppers: &mut [Option<&mut Stepper>],
        h: f64,
        mut look: impl FnMut(usize, &mut Stepper) -> ControlFlow<()>,
    ) -> [Result<bool>; WIDTH] {
        let mut outcomes = [const { Ok(true) }; WIDTH];
        let mut going = [None; WIDTH];
        for (lane, ((stepper, going), outcome)) in steppers.iter_mut().zip(&mut going).zip(&mut outcomes).enumerate() {
            let Some(stepper) = stepper else { continue };
            if matches!(stepper.step_control(), StepControl::Adaptive(_)) {
                *outcome = stepper.do_step_with(h, |stepper| look(lane, stepper));
                continue;
            }
            match stepper.begin_shared_step(h) {
                Ok(step) => *going = step,
                Err(error) => *outcome = Err(error),
            }
        }
        while going.iter().any(Option::is_some) {
            self.steps +=
                self.kernel.presolve(steppers, |lane, stepper| stepper.presolve_shared(going.get(lane)?.as_ref()?));
            let all = steppers.iter_mut().zip(&mut going).zip(&mut outcomes).enumerate();
            for (lane, ((stepper, going), outcome)) in all {
                let (Some(stepper), Some(step)) = (stepper, going.as_mut()) else { continue };
                if let Some(ended) = stepper.take_shared_step(step, |stepper| look(lane, stepper)).transpose() {
                    (*going, *outcome) = (None, ended);
                }
            }
        }
        outcomes
    }

    /// Number of steps solved so far, over all cases.
    pub fn steps(&self) -> u64 {
        self.steps
    }
}

/// Advances each of at most [`WIDTH`] `steppers` by `h` (s): in lanes by their `batch`, or one after the other without a batch;
/// see [`Batch::do_step_with`].
pub fn do_step_with(
    batch: Option<&mut Batch>,
    steppers: &mut [Option<&mut Stepper>],
    h: f64,
    look: impl FnMut(usize, &mut Stepper) -> ControlFlow<()>,
) -> [Result<bool>; WIDTH] {
    match batch {
        Some(batch) => batch.do_step_with(steppers, h, look),
        None => do_step_alone(steppers, h, look),
    }
}

fn do_step_alone(
    steppers: &mut [Option<&mut Stepper>],
    h: f64,
    mut look: impl FnMut(usize, &mut Stepper) -> ControlFlow<()>,
) -> [Result<bool>; WIDTH] {
    let mut outcomes = [const { Ok(true) }; WIDTH];
    for (i, (stepper, outcome)) in steppers.iter_mut().zip(&mut outcomes).enumerate() {
        if let Some(stepper) = stepper {
            *outcome = stepper.do_step_with(h, |stepper| look(i, stepper));
        }
    }
    outcomes
}
