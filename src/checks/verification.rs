//! Verification of a run against the full model, for a run with a cheaper model or with an automatically chosen fluid model.

use std::ops::ControlFlow;
use std::time::Instant;

use serde::Serialize;

use crate::error::Result;
use crate::integrator::StepControl;
use crate::reduced::comparison::{SeriesPoint, TimeSeries};
use crate::reduced::{Differences, ErrorMeasure};
use crate::scene::Scene;
use crate::stepper::Stepper;

/// The two runs are compared at most at this many times.
const MAX_COMPARISONS: f64 = 256.0;

/// Times that differ by less than this fraction of the duration are equal.
const SAME_TIME: f64 = 1e-9;

/// Differences between a run and the same scene with the full model.
#[derive(Debug, Clone, Serialize)]
#[expect(missing_docs, reason = "the names say what they are, with units")]
pub struct Verification {
    pub net_displacement_m: f64,
    /// Relative differences of the two runs; see [`ErrorMeasure`] for the reference values.
    pub relative_differences: Differences,
    /// The measures that are zero to rounding in both runs, so that their differences are meaningless.
    pub noise: Vec<ErrorMeasure>,
    pub steps: u64,
    pub wall_s: f64,
}

impl Verification {
    /// Runs the full model up to the time of `stepper`, whose scene is `scene`, together with the scene itself once more, and
    /// compares the two trajectories at the ends of the scene's steps, or at equal intervals. `None` if `observe` stops it.
    ///
    /// # Errors
    /// Errors of the run.
    pub fn of(
        scene: &Scene,
        stepper: &Stepper,
        mut observe: impl FnMut(&mut Stepper) -> ControlFlow<()>,
    ) -> Result<Option<Self>> {
        let start = Instant::now();
        let mut whole = Stepper::of(&scene.reference())?;
        let mut again = match stepper.choice() {
            Some(choice) => Stepper::of(&scene.with_choice(choice))?,
            None => Stepper::of(scene)?,
        };
        let mut courses = [&whole, &again].map(|run| TimeSeries::of(run.model()));
        let end = stepper.time();
        let part = match stepper.step_control() {
            StepControl::Fixed(step) => step * (end / (step * MAX_COMPARISONS)).ceil(),
            StepControl::Adaptive(_) => end / MAX_COMPARISONS,
        };
        loop {
            for (run, course) in [&whole, &again].into_iter().zip(&mut courses) {
                course.points.push(SeriesPoint::of(run.state(), &run.metrics().now));
            }
            let left = end - whole.time();
            if left <= 0.5 * SAME_TIME * end {
                break;
            }
            let span = if left <= part * (1.0 + SAME_TIME) { left } else { part };
            if !whole.do_step_with(span, &mut observe)? {
                return Ok(None);
            }
            again.do_step(span)?;
        }
        let [truth, mut found] = courses;
        found.points.pop();
        found.points.push(SeriesPoint::of(stepper.state(), &stepper.metrics().now));
        let metrics = whole.metrics();
        Ok(Some(Self {
            net_displacement_m: metrics.net_displacement(),
            relative_differences: truth.differences(&found),
            noise: truth.noise(&found),
            steps: metrics.totals.steps,
            wall_s: start.elapsed().as_secs_f64(),
        }))
    }
}
