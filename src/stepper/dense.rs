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
        let (from, to) = (&self.state, &self.next);
        let t = 0.5 * (from.t + to.t);
        let dense = self.dense.get_or_insert_with(|| Dense::new(from, &self.meter));
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
        if t == self.state.t {
            return Ok(look(&self.view()));
        }
        let outside = |from| Err(Error::OutsideStep { time_s: t, within: [from, self.state.t] });
        let Some(totals) = self.before else { return outside(self.state.t) };
        let from = &self.next;
        if !(from.t..self.state.t).contains(&t) {
            return outside(from.t);
        }
        let dense = self.dense.get_or_insert_with(|| Dense::new(&self.state, &self.meter));
        let Dense { state, meter, between } = dense;
        let placed = if self.mover.knows_between() {
            self.mover.between(&mut self.dynamics, from, t, state);
            self.dynamics.move_to(t, state);
            Ok(())
        } else {
            between.write(&mut self.dynamics, [from, &self.state], t, state)
        };
        let reading = placed.and_then(|()| meter.now.take(&mut self.dynamics, state));
        let outcome = reading.map(|()| {
            let (last, ends) = (&self.meter, [&self.reading, &self.meter.now]);
            meter.totals = totals.until(&last.totals, ends, &meter.now);
            // What steps have lost is known at their ends; in between it is on the line.
            let part = (t - from.t) / (self.state.t - from.t);
            let before = totals.work.net() - (self.reading.energy.total() - last.first_energy);
            let defect = before + part * (last.numerical_dissipation() - before);
            meter.first_energy = defect - meter.totals.work.net() + meter.now.energy.total();
            look(&View {
                dynamics: &self.dynamics,
                state,
                meter,
                cycles: &self.cycles,
                work: self.newton.work,
                time_step: self.time_step,
            })
        });
        self.dynamics.move_to(self.state.t, &mut self.state);
        outcome
    }
}
