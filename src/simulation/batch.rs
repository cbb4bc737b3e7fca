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
    /// A batch of at most [`WIDTH`] steppers. They must share the number of nodes, the integrator, nodal positions as unknowns, and the local
    /// drag law, with or without the reactive force, in a uniform medium or none, and an elastic material. `None` for others, for fewer than two steppers, and on
    /// a processor without AVX2.
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

    /// Solves the next internal step of each of `steppers`: all that the batch was [made of](Self::of), or some of them in the same
    /// places. All that depends on time alone is then already at the end of that step, so each stepper must take the step before
    /// anything is read from it.
    pub fn presolve(&mut self, steppers: &mut [Option<&mut Stepper>]) {
        #[cfg(target_arch = "x86_64")]
        {
            self.steps += self.kernel.presolve(steppers);
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = steppers;
    }

    /// Number of steps solved so far, of all cases.
    pub fn steps(&self) -> u64 {
        self.steps
    }
}
