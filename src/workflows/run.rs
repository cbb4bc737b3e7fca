//! Runs a scene: drives its stepper over the duration, alone or batched with similar scenes, and summarises the results.

#[cfg(feature = "report")]
mod batched;
#[cfg(feature = "report")]
mod summary;

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

#[cfg(feature = "report")]
pub use batched::{BatchedRun, run_batched};

use crate::error::{Error, Result};
use crate::scene::Scene;
use crate::stepper::Stepper;

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// The run reached its duration.
    Complete,
    /// The observer stopped it.
    Interrupted,
    /// A step or the observer failed; the stepper holds the last valid state.
    Failed(Error),
}

/// How a run ended, and its wall-clock time.
#[derive(Debug)]
pub struct Outcome {
    /// How it ended.
    pub ending: Ending,
    /// Wall-clock time.
    pub wall: Duration,
}

/// Drives `stepper` through the steps of `scene`; `observe` receives the state after every step, and may stop the run. If a step or
/// the observer fails, this is returned as an [`Ending`], so that earlier results remain.
pub fn run(
    scene: &Scene,
    stepper: &mut Stepper,
    mut observe: impl FnMut(&mut Stepper) -> Result<ControlFlow<()>>,
) -> Outcome {
    let start = Instant::now();
    let ending = scene.spans().find_map(|span| advance(stepper, span, &mut observe)).unwrap_or(Ending::Complete);
    Outcome { ending, wall: start.elapsed() }
}

/// Advances by `span` (s); returns how the run ended, if it did.
fn advance(
    stepper: &mut Stepper,
    span: f64,
    mut observe: impl FnMut(&mut Stepper) -> Result<ControlFlow<()>>,
) -> Option<Ending> {
    let mut seen = Ok(ControlFlow::Continue(()));
    let outcome = stepper.advance_until_failure(span, |stepper| {
        seen = observe(stepper);
        match seen {
            Ok(flow) => flow,
            Err(_) => ControlFlow::Break(()),
        }
    });
    match (outcome, seen) {
        (Err(error), _) | (_, Err(error)) => Some(Ending::Failed(error)),
        (Ok(_), Ok(ControlFlow::Break(()))) => Some(Ending::Interrupted),
        (Ok(_), Ok(ControlFlow::Continue(()))) => None,
    }
}
