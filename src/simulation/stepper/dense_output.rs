//! Dense output: state and measurements at any time within the last internal step, without affecting the steps.
//!
//! The intermediate state is provided by the [`ModelStepper`](crate::reduced::ModelStepper), or is interpolated from the ends of
//! the step ([`StepInterpolation`]).

use super::Stepper;
use super::interpolation::StepInterpolation;
use crate::error::{Error, Result};
use crate::metrics::{Measurements, RunMetrics};
use crate::system::{State, System};
use crate::variable::View;

/// Work arrays for the interpolated state and its measurements.
#[derive(Debug)]
pub(super) struct DenseOutput {
    state: State,
    metrics: RunMetrics,
    interpolation: StepInterpolation,
}

impl DenseOutput {
    /// Allocates for states like `state`.
    pub(super) fn new(state: &State, metrics: &RunMetrics) -> Self {
        Self { state: state.clone(), metrics: metrics.clone(), interpolation: StepInterpolation::default() }
    }

    /// Forgets the step, because another one begins.
    pub(super) fn forget(&mut self) {
        self.interpolation.forget();
    }

    /// The last interpolated state and its measurements.
    pub(super) fn last(&self) -> (&State, &Measurements) {
        (&self.state, &self.metrics.now)
    }
}

impl Stepper {
    /// Evaluates the middle between the state and the next one, into the work arrays of [`DenseOutput`].
    pub(super) fn middle(&mut self) -> Result<()> {
        let (from, to) = (&self.now.state, &self.next);
        let t = 0.5 * (from.t + to.t);
        let dense = self.dense.get_or_insert_with(|| DenseOutput::new(from, &self.now.metrics));
        self.model_stepper.interpolate(&mut self.dynamics, from, t, &mut dense.state);
        self.dynamics.move_to(t, &mut dense.state);
        dense.metrics.now.measure(&mut self.dynamics, &dense.state)?;
        self.dynamics.move_to(self.next.t, &mut self.next);
        Ok(())
    }

    /// Calls `look` with the view at time `t` (s) within the last internal step.
    ///
    /// # Errors
    /// [`Error::OutsideStep`], also if an input was set or a snapshot restored since that step; errors of the measurement.
    pub fn at<T>(&mut self, t: f64, look: impl FnOnce(&View<'_>) -> T) -> Result<T> {
        if t == self.now.state.t || t == self.time() {
            return Ok(look(&self.view()));
        }
        let outside = |from| Err(Error::OutsideStep { time_s: t, within: [from, self.now.state.t] });
        let Some(totals) = self.before else { return outside(self.now.state.t) };
        let from = &self.next;
        if !(from.t..self.now.state.t).contains(&t) {
            return outside(from.t);
        }
        let dense = self.dense.get_or_insert_with(|| DenseOutput::new(&self.now.state, &self.now.metrics));
        let DenseOutput { state, metrics, interpolation } = dense;
        let placed = if self.model_stepper.has_dense_output() {
            self.model_stepper.interpolate(&mut self.dynamics, from, t, state);
            self.dynamics.move_to(t, state);
            Ok(())
        } else {
            interpolation.write(&mut self.dynamics, [from, &self.now.state], t, state)
        };
        let measurements = placed.and_then(|()| metrics.now.measure(&mut self.dynamics, state));
        let outcome = measurements.map(|()| {
            let (last, ends) = (&self.now.metrics, [&self.measurements, &self.now.metrics.now]);
            metrics.totals = totals.until(&last.totals, ends, &metrics.now);
            // The numerical losses of a step are known at its end; in between they are interpolated linearly.
            let part = (t - from.t) / (self.now.state.t - from.t);
            let before = totals.work.net() - (self.measurements.energy.total() - last.first_energy);
            let defect = before + part * (last.numerical_dissipation() - before);
            metrics.first_energy = defect - metrics.totals.work.net() + metrics.now.energy.total();
            look(&View {
                time: t,
                dynamics: &self.dynamics,
                inputs: &self.dynamics.inputs,
                state,
                metrics,
                cycles: &self.now.cycles,
                work: self.newton.work,
                time_step: self.now.time_step,
                head_turn: [0.0; 2],
            })
        });
        self.dynamics.move_to(self.now.state.t, &mut self.now.state);
        outcome
    }
}
