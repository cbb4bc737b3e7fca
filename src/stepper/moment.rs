//! Everything of a stepper that changes, as one value: snapshots and the undoing of failed steps are copies of it.

use serde::{Deserialize, Serialize};

use super::{Clock, Stepper};
use crate::cycle::Cycles;
use crate::metrics::Meter;
use crate::model::{Dynamics, InputExtrapolation, Inputs};
use crate::newton::Work;
use crate::system::State;

/// What changes beside the inputs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Now {
    pub clock: Clock,
    /// The host's time (s), where it is ahead of the state's by steps that wait.
    pub waiting: Option<f64>,
    /// The next internal step that the pace wants, s.
    pub time_step: f64,
    pub state: State,
    /// An input has changed since the last internal step set out.
    pub steered: bool,
    /// Inputs have changed since the state settled under them.
    pub unsettled: bool,
    /// How much the flow has changed at once since then, m/s.
    pub gust: [f64; 2],
    pub meter: Meter,
    pub cycles: Cycles,
}

impl Now {
    /// Copies `other`, without allocating where there is room.
    fn copy_from(&mut self, other: &Self) {
        let Self { clock, waiting, time_step, state, steered, unsettled, gust, meter, cycles } = other;
        self.state.copy_from(state);
        self.meter.copy_from(meter);
        (self.clock, self.waiting, self.time_step) = (*clock, *waiting, *time_step);
        (self.steered, self.unsettled, self.gust) = (*steered, *unsettled, *gust);
        self.cycles = *cycles;
    }
}

/// Time, state, inputs and how they go on, totals and counts. Not in it: the model, and matrices and factors, which every step
/// makes anew.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Moment {
    pub now: Now,
    pub inputs: Inputs,
    pub course: Option<Box<InputExtrapolation>>,
    work: Work,
}

impl Stepper {
    /// A copy of everything that changes.
    pub(super) fn moment(&self) -> Moment {
        let Dynamics { inputs, course, .. } = &self.dynamics;
        Moment { now: self.now.clone(), inputs: inputs.clone(), course: course.clone(), work: self.newton.work }
    }

    /// The same into `moment`, without allocating where there is room.
    pub(super) fn copy_to(&self, moment: &mut Moment) {
        let Moment { now, inputs, course, work } = moment;
        now.copy_from(&self.now);
        inputs.clone_from(&self.dynamics.inputs);
        course.clone_from(&self.dynamics.course);
        *work = self.newton.work;
    }

    /// Goes back to `moment`.
    pub(super) fn go_back_to(&mut self, moment: &Moment) {
        let Moment { now, inputs, course, work } = moment;
        self.now.copy_from(now);
        self.dynamics.restore(inputs);
        self.dynamics.course.clone_from(course);
        self.newton.work = *work;
        self.stay();
    }
}
