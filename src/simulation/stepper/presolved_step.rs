//! Time steps that a batch has solved in SIMD lanes together with steps of other cases, before their steppers accept them.

use std::ops::ControlFlow;

use nalgebra::Vector2;

use super::equal_steps::EqualSteps;
use super::{HeadJump, Stepper};
use crate::error::Result;
use crate::fluid::Force;
use crate::fluid::force::Powers;
use crate::integrator::{StepControl, StepWeights};
use crate::metrics::BatchedMeasurements;
use crate::newton::SolveProgress;
use crate::rod::DampedRate;
use crate::rod::damping::StrainRates;
use crate::system::{State, System};

/// A time step that was solved together with other cases in SIMD lanes and waits to be accepted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PresolvedStep {
    end: f64,
    h: f64,
    rule: StepWeights,
    /// True if the initial guess keeps the lengths of edges.
    keeps_lengths: bool,
    /// Newton iterations of the solution; 0 before it is solved.
    iterations: u32,
    /// True if its states were checked for folds and collapsed edges.
    checked: bool,
    /// True if the measurements at its end are stored in the stepper.
    measured: bool,
}

impl PresolvedStep {
    /// Its size (s) and weights, and whether its initial guess keeps the lengths of edges.
    pub fn kind(&self) -> (f64, StepWeights, bool) {
        (self.h, self.rule, self.keeps_lengths)
    }
}

/// A communication step that is taken in turn with steps of other steppers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SharedStep {
    steps: EqualSteps,
    /// The time of the host (s) and the jump of the head before this step.
    before: (Option<f64>, Option<HeadJump>),
}

/// The properties that cases must share to be solved in one batch.
#[derive(Debug, PartialEq)]
pub(crate) struct BatchKey {
    nodes: usize,
    held: bool,
    forces: Vec<&'static str>,
    damped: Option<DampedRate>,
}

impl Stepper {
    /// The properties that steppers must share to be solved in one batch, or `None` if this one cannot be batched.
    pub(crate) fn batch_key(&self) -> Option<BatchKey> {
        let model = self.model();
        let StepControl::Fixed(step) = self.step_control else { return None };
        let same = self.model_stepper.rule(step).is_some()
            && self.newton.is_by_blocks()
            && model.layers.is_none()
            && model.hinge.is_none()
            && (model.flow.is_none() || !model.forces.are_inertial());
        let shape = BatchKey {
            nodes: model.rod.nodes,
            held: model.head.is_some(),
            forces: model.forces.iter().map(Force::name).collect(),
            damped: model.rod.damping.as_ref().map(|damping| damping.rate),
        };
        same.then_some(shape)
    }

    /// Begins a communication step of `h` (s) that is taken in turn with steps of other steppers. Returns `None` if there is
    /// nothing to solve, because the step is deferred.
    ///
    /// # Errors
    /// Errors of [`do_step`](Self::do_step). The stepper is then as it was before.
    pub(crate) fn begin_shared_step(&mut self, h: f64) -> Result<Option<SharedStep>> {
        let before = (self.now.pending_time, self.head_jump);
        let begun = self.begin_step(h).and_then(|step| match (step, self.step_control) {
            (Some((h, _)), StepControl::Fixed(time_step)) => self.begin_equal_steps(h, time_step).map(Some),
            _ => Ok(None),
        });
        if begun.is_err() {
            self.return_to(before);
        }
        Ok(begun?.map(|steps| SharedStep { steps, before }))
    }

    /// Takes the next internal step of `step`, and calls `look` after it and after each part of a halved one. Returns `None` if
    /// more steps are left, and otherwise whether the end was reached.
    ///
    /// # Errors
    /// Errors of [`do_step`](Self::do_step). The stepper is then as it was before the communication step.
    pub(crate) fn take_shared_step(
        &mut self,
        step: &mut SharedStep,
        mut look: impl FnMut(&mut Self) -> ControlFlow<()>,
    ) -> Result<Option<bool>> {
        let outcome = self.take_equal_step(&mut step.steps, &mut look);
        if outcome.is_err() {
            self.return_to(step.before);
        }
        Ok(if outcome?.is_break() { Some(false) } else { step.steps.are_taken().then_some(true) })
    }

    /// Prepares the next internal step of `step`, unless inputs have changed since the last one, see
    /// [`presolve_next`](Self::presolve_next).
    pub(crate) fn presolve_shared(&mut self, step: &SharedStep) -> Option<PresolvedStep> {
        let [end, h] = step.steps.next();
        self.presolve_to(end, h)
    }

    /// Prepares the next internal step, if only the time has changed since the last one. Quantities that depend on time alone are
    /// evaluated at its end.
    pub(crate) fn presolve_next(&mut self) -> Option<PresolvedStep> {
        let StepControl::Fixed(h) = self.step_control else { return None };
        let told = self.now.pending_time.is_some() || self.dynamics.extrapolation.is_some();
        // The motion of a head that a host drives is known only when the communication step begins.
        if told || self.dynamics.inputs.head.is_some() || self.now.state.t != self.now.clock.at(0, h) {
            return None;
        }
        self.presolve_to(self.now.clock.at(1, h), h)
    }

    /// Prepares the internal step of `h` (s) to time `end` (s), unless it has to be taken alone.
    fn presolve_to(&mut self, end: f64, h: f64) -> Option<PresolvedStep> {
        // Extrapolated inputs change the fluid, which lanes do not support.
        let alone = self.now.needs_reinitialisation
            || self.now.inputs_changed
            || self.dynamics.extrapolation.is_some() && self.model().forces.are_inertial()
            || self.dynamics.head_jumps_at(self.now.state.t);
        let rule = self.model_stepper.rule(h).filter(|_| !alone)?;
        self.dynamics.step_end = Some(end);
        self.next.t = end;
        self.dynamics.move_to(end, &mut self.next);
        let keeps_lengths = self.dynamics.keeps_lengths(rule.direction());
        Some(PresolvedStep { end, h, rule, keeps_lengths, iterations: 0, checked: false, measured: false })
    }

    /// The states at the start and at the end of the prepared step, and the initial progress of Newton's method. Of the end, only
    /// what depends on time alone is known.
    pub(crate) fn presolve_inputs(&self) -> ([&State; 2], SolveProgress) {
        ([&self.now.state, &self.next], self.newton.progress(&self.dynamics))
    }

    /// Stores the solution of a step that took that many `iterations`; `write` writes it. If `checked`, its states were checked
    /// for folds and collapsed edges.
    pub(crate) fn store_presolved(
        &mut self,
        step: &PresolvedStep,
        iterations: u32,
        checked: bool,
        write: impl FnOnce(&mut State),
    ) {
        write(&mut self.next);
        self.presolved = Some(PresolvedStep { iterations, checked, ..*step });
    }

    /// Stores the measurements of the presolved step, see [`Measurements::measure_presolved`](crate::metrics::Measurements::measure_presolved).
    pub(crate) fn store_presolved_measurements(
        &mut self,
        measured: &BatchedMeasurements,
        read_rates: impl FnOnce(&mut StrainRates),
        of_force: impl Fn(usize, &dyn Force) -> (Powers, (f64, Vector2<f64>)),
        fill: impl FnOnce(&mut [f64], &mut [f64], &mut [Vector2<f64>]),
    ) {
        if let Some(solved) = &mut self.presolved {
            if let Some(rates) = &mut self.dynamics.rates {
                read_rates(rates);
            }
            solved.measured =
                self.measurements.measure_presolved(&self.dynamics, &self.next, measured, of_force, fill).is_ok();
        }
    }

    /// Completes the presolved step of `h` (s) to `end`. Returns `None` if there is none, or if its solution is not valid.
    pub(super) fn take_presolved(&mut self, end: f64, h: f64) -> Option<()> {
        let PresolvedStep { rule, iterations, checked, measured, .. } =
            self.presolved.take().filter(|solved| solved.end == end && solved.h == h)?;
        if !checked {
            self.dynamics.check_step(&self.now.state, &self.next).ok()?;
        }
        rule.remember(&self.now.state, &mut self.next);
        self.newton.work.newton_iterations += u64::from(iterations);
        self.newton.work.factorisations += u64::from(iterations);
        self.measured = measured;
        Some(())
    }
}
