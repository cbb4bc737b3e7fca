//! Several cases at once: the equations of motion of four rods, each in a SIMD lane, solved by one Newton's method.
//!
//! A [`Batch`] makes the next step of each stepper ahead, from guess to reading; the stepper then goes on as it always does, and
//! finds the step made. What does it is the same source as for one rod, generic over its number, so the results have the same bits. A case whose step does not converge at once is not solved ahead: its stepper
//! does the step alone, from its beginning.

#[cfg(target_arch = "x86_64")]
mod forces;
#[cfg(target_arch = "x86_64")]
mod kernel;
#[cfg(target_arch = "x86_64")]
mod lanes;

use crate::stepper::Stepper;

/// Cases that a batch takes.
pub const WIDTH: usize = 4;

/// Steppers' cases that may be solved together, see [`Batch::of`].
#[derive(Debug)]
pub struct Batch {
    #[cfg(target_arch = "x86_64")]
    kernel: kernel::Kernel,
    steps: u64,
}

impl Batch {
    /// For at most [`WIDTH`] steppers at work on rods of as many nodes by the same method, in positions, in a uniform medium or in none,
    /// under the same local drag law, with the water that the rod accelerates or without.
    /// `None` for others, for fewer than two, and on a processor without AVX2.
    pub fn of(steppers: &[&Stepper]) -> Option<Self> {
        #[cfg(target_arch = "x86_64")]
        return Some(Self { kernel: kernel::Kernel::of(steppers)?, steps: 0 });
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = steppers;
            None
        }
    }

    /// True where there are steppers beside which it takes this one.
    pub fn takes(stepper: &Stepper) -> bool {
        Self::of(&[stepper; 2]).is_some()
    }

    /// Solves the next internal step of every one of `steppers`, those that the batch is [of](Self::of) or some of them in the same
    /// places. They are at the end of that step already with all that depends on the time alone: each has to do the step before
    /// anything is read from it.
    pub fn presolve(&mut self, steppers: &mut [Option<&mut Stepper>]) {
        #[cfg(target_arch = "x86_64")]
        {
            self.steps += self.kernel.presolve(steppers);
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = steppers;
    }

    /// The steps that it has solved so far, of all cases together.
    pub fn steps(&self) -> u64 {
        self.steps
    }
}
