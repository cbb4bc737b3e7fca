//! Dense output: what a run was like at any time of its last internal step, at no cost to the steps.
//!
//! Either the [`Mover`](crate::reduced::Mover) knows the state in between, or it follows from the ends of the step
//! ([`Between`]).

use super::Stepper;
use super::between::Between;
use crate::error::{Error, Result};
use crate::metrics::{Meter, Reading};
use crate::system::{State, System};
use crate::variable::View;

/// Room for the state and the readings in between.
#[derive(Debug)]
pub(super) struct Dense {
    state: State,
    meter: Meter,
    between: Between,
}

impl Dense {
    /// Room for states like `state`.
    pub(super) fn new(state: &State, meter: &Meter) -> Self {
        Self { state: state.clone(), meter: meter.clone(), between: Between::default() }
    }

    /// Forgets the step, as another one is made.
    pub(super) fn forget(&mut self) {
        self.between.forget();
    }

    /// What was read last.
    pub(super) fn last(&self) -> (&State, &Reading) {
        (&self.state, &self.meter.now)
    }
}

impl Stepper {
    /// Reads the middle of the step from the state to the next, into the room of [`Dense`].
    pub(super) fn middle(&mut self) -> Result<()> {
        let (from, to) = (&self.now.state, &self.next);
        let t = 0.5 * (from.t + to.t);
        let dense = self.dense.get_or_insert_with(|| Dense::new(from, &self.now.meter));
        self.mover.between(&mut self.dynamics, from, t, &mut dense.state);
        self.dynamics.move_to(t, &mut dense.state);
        dense.meter.now.take(&mut self.dynamics, &dense.state)?;
        self.dynamics.move_to(self.next.t, &mut self.next);
        Ok(())
    }

    /// What `look` reads at time `t` (s) of the last internal step.
    ///
    /// # Errors
    /// [`Error::OutsideStep`], also where an input was set or a snapshot restored since that step; errors of the reading.
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
        let dense = self.dense.get_or_insert_with(|| Dense::new(&self.now.state, &self.now.meter));
        let Dense { state, meter, between } = dense;
        let placed = if self.mover.knows_between() {
            self.mover.between(&mut self.dynamics, from, t, state);
            self.dynamics.move_to(t, state);
            Ok(())
        } else {
            between.write(&mut self.dynamics, [from, &self.now.state], t, state)
        };
        let reading = placed.and_then(|()| meter.now.take(&mut self.dynamics, state));
        let outcome = reading.map(|()| {
            let (last, ends) = (&self.now.meter, [&self.reading, &self.now.meter.now]);
            meter.totals = totals.until(&last.totals, ends, &meter.now);
            // What steps have lost is known at their ends; in between it is on the line.
            let part = (t - from.t) / (self.now.state.t - from.t);
            let before = totals.work.net() - (self.reading.energy.total() - last.first_energy);
            let defect = before + part * (last.numerical_dissipation() - before);
            meter.first_energy = defect - meter.totals.work.net() + meter.now.energy.total();
            look(&View {
                time: t,
                dynamics: &self.dynamics,
                inputs: &self.dynamics.inputs,
                state,
                meter,
                cycles: &self.now.cycles,
                work: self.newton.work,
                time_step: self.now.time_step,
            })
        });
        self.dynamics.move_to(self.now.state.t, &mut self.now.state);
        outcome
    }
}
