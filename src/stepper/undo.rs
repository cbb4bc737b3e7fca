//! Taking back a step that failed: everything is then as it was before the call.

use nalgebra::Vector2;

use super::{Clock, Stepper};
use crate::cycle::Cycles;
use crate::metrics::{Reading, Totals};
use crate::model::{Course, Inputs};
use crate::newton::Work;
use crate::system::{State, System};

/// What a step changes, as it was before. It is kept only once a step can fail halfway: before the first of several internal
/// steps, of a halved one, or before inputs act.
#[derive(Debug, Default)]
pub(super) struct Undo {
    /// What there was before the step that is under way is in `room`.
    kept: bool,
    /// What there was; room after the first step that needed it.
    room: Option<Box<Before>>,
}

#[derive(Debug)]
struct Before {
    clock: Clock,
    time_step: f64,
    state: State,
    kicked: bool,
    gust: Vector2<f64>,
    steered: bool,
    inputs: Inputs,
    course: Option<Box<Course>>,
    reading: Reading,
    totals: Totals,
    first_energy: f64,
    cycles: Cycles,
    work: Work,
}

impl Undo {
    /// A step begins.
    pub(super) fn begin(&mut self) {
        self.kept = false;
    }
}

impl Stepper {
    /// Keeps what there is, unless it was kept before in this step.
    pub(super) fn keep(&mut self) {
        if self.undo.kept {
            return;
        }
        self.undo.kept = true;
        let (dynamics, meter) = (&self.dynamics, &self.meter);
        match &mut self.undo.room {
            Some(room) => {
                room.state.copy_from(&self.state);
                room.inputs.clone_from(&dynamics.inputs);
                room.course.clone_from(&dynamics.course);
                room.reading.copy_from(&meter.now);
                (room.clock, room.time_step) = (self.clock, self.time_step);
                (room.kicked, room.gust, room.steered) = (self.kick.due, self.kick.gust, self.steered);
                (room.totals, room.first_energy) = (meter.totals, meter.first_energy);
                (room.cycles, room.work) = (self.cycles, self.newton.work);
            }
            empty => {
                *empty = Some(Box::new(Before {
                    clock: self.clock,
                    time_step: self.time_step,
                    state: self.state.clone(),
                    kicked: self.kick.due,
                    gust: self.kick.gust,
                    steered: self.steered,
                    inputs: dynamics.inputs.clone(),
                    course: dynamics.course.clone(),
                    reading: meter.now.clone(),
                    totals: meter.totals,
                    first_energy: meter.first_energy,
                    cycles: self.cycles,
                    work: self.newton.work,
                }));
            }
        }
    }

    /// Goes back to what was kept of this step; where nothing was, the step has changed nothing but the counts of its attempt.
    pub(super) fn take_back(&mut self) {
        if self.undo.kept
            && let Some(room) = &self.undo.room
        {
            self.state.copy_from(&room.state);
            self.dynamics.restore(&room.inputs);
            self.dynamics.course.clone_from(&room.course);
            self.meter.now.copy_from(&room.reading);
            (self.clock, self.time_step) = (room.clock, room.time_step);
            (self.kick.due, self.kick.gust, self.steered) = (room.kicked, room.gust, room.steered);
            (self.meter.totals, self.meter.first_energy) = (room.totals, room.first_energy);
            (self.cycles, self.newton.work) = (room.cycles, room.work);
        }
        self.before = None;
        self.dynamics.move_to(self.state.t, &mut self.state);
    }
}
