//! Dense output: what a run was like at any time of its last internal step, at no cost to the steps.
//!
//! Positions are the cubic Hermite polynomial of positions and velocities at both ends, velocities that of velocities and
//! accelerations: errors of the fourth order in the step. The links of the chain form are linear in between.

use super::Stepper;
use crate::error::{Error, Result};
use crate::head::{Row, hermite};
use crate::metrics::Meter;
use crate::system::{Link, State, System};
use crate::variable::View;

/// Room for the state and the readings in between.
#[derive(Debug)]
pub(super) struct Dense {
    state: State,
    meter: Meter,
}

impl Stepper {
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
        let dense = self.dense.get_or_insert_with(|| Dense { state: self.state.clone(), meter: self.meter.clone() });
        interpolate(from, &self.state, t, &mut dense.state);
        self.dynamics.move_to(t, &mut dense.state);
        let reading = dense.meter.now.take(&mut self.dynamics, &dense.state);
        let outcome = reading.map(|()| {
            dense.meter.totals = totals.until(&self.meter.totals, [&self.reading, &self.meter.now], &dense.meter.now);
            look(&View {
                dynamics: &self.dynamics,
                state: &dense.state,
                meter: &dense.meter,
                work: self.newton.work,
                time_step: self.time_step,
            })
        });
        self.dynamics.move_to(self.state.t, &mut self.state);
        outcome
    }
}

/// Writes the state at `t` between two states to `out`.
fn interpolate(from: &State, to: &State, t: f64, out: &mut State) {
    let row =
        |state: &State, value: &[f64], rate: &[f64], i: usize| Row { time: state.t, value: value[i], rate: rate[i] };
    let part = (t - from.t) / (to.t - from.t);
    let between = |a: f64, b: f64| a + part * (b - a);
    for i in 0..from.q.len() {
        out.q[i] = hermite(&row(from, &from.q, &from.v, i), &row(to, &to.q, &to.v, i), t).value;
        out.v[i] = hermite(&row(from, &from.v, &from.a, i), &row(to, &to.v, &to.a, i), t).value;
        out.a[i] = between(from.a[i], to.a[i]);
    }
    for (out, (a, b)) in out.links.iter_mut().zip(from.links.iter().zip(&to.links)) {
        *out = Link {
            angle: between(a.angle, b.angle),
            force: [0, 1].map(|i| between(a.force[i], b.force[i])),
            moment: between(a.moment, b.moment),
            curvature: between(a.curvature, b.curvature),
        };
    }
}
