//! A stored trajectory of a simulation, for its adjoint.

use crate::error::{Error, Result};
use crate::head::{Row, hermite};
use crate::model::Model;
use crate::system::State;

/// The trajectory of a simulation: times (s), and positions (m), velocities (m/s) and accelerations (m/s²) at each time, two entries
/// per node.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Times, including the start.
    pub times: Vec<f64>,
    /// As in a [`State`], with the arc of a hinge.
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

impl Trajectory {
    /// Positions at time `n`.
    pub fn positions(&self, n: usize) -> &[f64] {
        self.nodes(&self.q, n)
    }

    /// Velocities at time `n`.
    pub fn velocities(&self, n: usize) -> &[f64] {
        self.nodes(&self.v, n)
    }

    /// The part of `values` that belongs to the nodes at time `n`.
    fn nodes<'a>(&self, values: &'a [f64], n: usize) -> &'a [f64] {
        let row = self.row(values, n);
        &row[..row.len() / 2 * 2]
    }

    fn row<'a>(&self, values: &'a [f64], n: usize) -> &'a [f64] {
        let width = values.len() / self.times.len();
        &values[n * width..(n + 1) * width]
    }

    /// Positions at `time` (s), by cubic Hermite interpolation between the steps. `None` outside the simulation.
    pub fn at(&self, time: f64) -> Option<Vec<f64>> {
        let last = *self.times.last()?;
        if !(self.times[0]..=last * (1.0 + 1e-9)).contains(&time) {
            return None;
        }
        let n = self.times.partition_point(|t| *t <= time).clamp(1, self.times.len() - 1);
        let rows = |n: usize| {
            let values = self.positions(n).iter().zip(self.velocities(n));
            values.map(move |(q, v)| Row { time: self.times[n], value: *q, rate: *v })
        };
        Some(rows(n - 1).zip(rows(n)).map(|(from, to)| hermite(&from, &to, time.min(last)).value).collect())
    }

    /// Returns an error unless it has states of `model` at exactly these `times` (s).
    pub(super) fn check(&self, model: &Model, times: impl ExactSizeIterator<Item = f64>) -> Result<()> {
        let refuse = |problem: String| {
            let remedy = "allowed: what simulate returned for this problem";
            Err(Error::Derivative { problem: format!("the trajectory is of another simulation, {problem}; {remedy}") })
        };
        if self.times.len() != times.len() {
            return refuse(format!("of {} times for {}", self.times.len(), times.len()));
        }
        let (found, expected) = (self.q.len() / self.times.len().max(1), model.unknowns());
        if found / 2 != expected / 2 {
            return refuse(format!("of {} nodes for {}", found / 2, expected / 2));
        }
        if found != expected {
            return refuse("with a hinge for none, or the other way round".to_string());
        }
        match self.times.iter().zip(times).find(|(own, time)| **own != *time) {
            Some((own, time)) => refuse(format!("with a time of {own:e} s for {time:e} s")),
            None => Ok(()),
        }
    }

    /// Adds a state.
    pub(crate) fn push(&mut self, state: &State) {
        self.times.push(state.t);
        self.q.extend_from_slice(&state.q);
        self.v.extend_from_slice(&state.v);
        self.a.extend_from_slice(&state.a);
    }

    pub(super) fn load(&self, n: usize, state: &mut State) {
        state.t = self.times[n];
        state.q.copy_from_slice(self.row(&self.q, n));
        state.v.copy_from_slice(self.row(&self.v, n));
        state.a.copy_from_slice(self.row(&self.a, n));
    }
}
