//! All that changes in a stepper during a run, as one value. Snapshots and the undo of failed steps copy it.

use serde::{Deserialize, Serialize};

use super::{Clock, Stepper};
use crate::cycle::Cycles;
use crate::metrics::RunMetrics;
use crate::model::{Dynamics, InputExtrapolation, Inputs};
use crate::newton::SolverWork;
use crate::system::State;

/// All that changes during a run, other than the inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct RunState {
    pub clock: Clock,
    /// The time (s) of the host, if it is ahead of the state's time because of deferred steps.
    pub pending_time: Option<f64>,
    /// The size of the next internal step chosen by the step control, s.
    pub time_step: f64,
    pub state: State,
    /// An input has changed since the last internal step was prepared.
    pub inputs_changed: bool,
    /// Inputs have jumped since the state was last reinitialised.
    pub needs_reinitialisation: bool,
    /// Jump of the flow since the last reinitialisation, m/s.
    pub flow_jump: [f64; 2],
    pub metrics: RunMetrics,
    pub cycles: Cycles,
}

impl RunState {
    /// Copies `other`, without allocating if capacities suffice.
    fn copy_from(&mut self, other: &Self) {
        let Self {
            clock,
            pending_time,
            time_step,
            state,
            inputs_changed,
            needs_reinitialisation,
            flow_jump,
            metrics,
            cycles,
        } = other;
        self.state.copy_from(state);
        self.metrics.copy_from(metrics);
        (self.clock, self.pending_time, self.time_step) = (*clock, *pending_time, *time_step);
        (self.inputs_changed, self.needs_reinitialisation, self.flow_jump) =
            (*inputs_changed, *needs_reinitialisation, *flow_jump);
        self.cycles = *cycles;
    }
}

/// Time, state, inputs with their extrapolation, totals and counts. It contains neither the model nor matrices and factors, which
/// every step recomputes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct SavedRun {
    pub now: RunState,
    pub inputs: Inputs,
    pub extrapolation: Option<Box<InputExtrapolation>>,
    work: SolverWork,
}

impl Stepper {
    /// A copy of everything that changes.
    pub(super) fn saved(&self) -> SavedRun {
        let Dynamics { inputs, extrapolation, .. } = &self.dynamics;
        SavedRun {
            now: self.now.clone(),
            inputs: inputs.clone(),
            extrapolation: extrapolation.clone(),
            work: self.newton.work,
        }
    }

    /// Copies the same into `saved`, without allocating if capacities suffice.
    pub(super) fn copy_to(&self, saved: &mut SavedRun) {
        let SavedRun { now, inputs, extrapolation, work } = saved;
        now.copy_from(&self.now);
        inputs.clone_from(&self.dynamics.inputs);
        extrapolation.clone_from(&self.dynamics.extrapolation);
        *work = self.newton.work;
    }

    /// Restores `saved`.
    pub(super) fn restore_saved(&mut self, saved: &SavedRun) {
        let SavedRun { now, inputs, extrapolation, work } = saved;
        self.forget_last_step();
        self.now.copy_from(now);
        self.dynamics.restore(inputs);
        self.dynamics.extrapolation.clone_from(extrapolation);
        self.newton.work = *work;
        self.discard_step();
    }
}
