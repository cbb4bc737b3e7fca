//! Several runs at once, similar ones stepped together in SIMD lanes.

use std::ops::ControlFlow;
use std::time::Instant;

use super::{Ending, Outcome, advance};
use crate::batch::{Batch, WIDTH};
use crate::error::Result;
use crate::scene::Scene;
use crate::stepper::Stepper;

/// One of several runs that [`run_batched`] drives.
#[derive(Debug)]
pub struct BatchedRun<'a> {
    /// Its scene.
    pub scene: &'a Scene,
    /// Its stepper, at the start.
    pub stepper: Stepper,
}

/// Drives several runs, each as [`run`](super::run) does and with bit-identical results; `observe` also receives the index of the run.
/// Runs that a [`Batch`] accepts are stepped together.
pub fn run_batched(
    runs: &mut [BatchedRun<'_>],
    mut observe: impl FnMut(usize, &mut Stepper) -> Result<ControlFlow<()>>,
) -> Vec<Outcome> {
    let start = Instant::now();
    let steppers: Vec<&Stepper> = runs.iter().map(|run| &run.stepper).collect();
    let Some(mut batch) = Batch::of(&steppers) else {
        let alone = |(i, run): (usize, &mut BatchedRun<'_>)| super::run(run.scene, &mut run.stepper, |s| observe(i, s));
        return runs.iter_mut().enumerate().map(alone).collect();
    };
    // The remaining steps of each run: single steps, and a shorter last one.
    let mut left: Vec<_> = runs.iter().map(|run| run.scene.single_steps()).collect();
    let mut endings: Vec<Option<Ending>> = runs.iter().map(|_| None).collect();
    while endings.iter().any(Option::is_none) {
        let mut spans = [None; WIDTH];
        let mut going: [Option<&mut Stepper>; WIDTH] = Default::default();
        let all = runs.iter_mut().zip(&mut left).zip(&mut endings);
        for (((run, left), ending), (span, going)) in all.zip(spans.iter_mut().zip(&mut going)) {
            if ending.is_none() {
                *span = left.next();
                match span {
                    Some(_) => *going = Some(&mut run.stepper),
                    None => *ending = Some(Ending::Complete),
                }
            }
        }
        batch.presolve(&mut going);
        for (i, ((run, span), ending)) in runs.iter_mut().zip(spans).zip(&mut endings).enumerate() {
            if let Some(span) = span {
                *ending = advance(&mut run.stepper, span, |stepper| observe(i, stepper));
            }
        }
    }
    let wall = start.elapsed() / u32::try_from(runs.len()).unwrap_or(1).max(1);
    endings.into_iter().flatten().map(|ending| Outcome { ending, wall }).collect()
}
