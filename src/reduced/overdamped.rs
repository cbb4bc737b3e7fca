//! The overdamped model, without inertia: C(q) (v − u) = F(q, t), of first order in time with positions as unknowns.
//!
//! The residual is the model's own at a = 0. Steps are made with ESDIRK3(2), L-stable, on q' = v: a stage solves for its velocity
//! with q_i = qⁿ + h Σ_{j<i} a_ij v_j + hγ v_i.

use super::{ModelKind, ModelStepper};
use crate::error::{Error, Result};
use crate::fluid::Force;
use crate::integrator::esdirk3::{G, STAGES, TIMES, WEIGHTS, error};
use crate::integrator::{ExplicitPart, Stage, StepError};
use crate::linear::Direction;
use crate::model::{Dynamics, Mechanics};
use crate::newton::{ConvergenceRate, MAX_ITERATIONS, Newton};
use crate::system::{State, System};

/// Its entry in the table of models.
pub static MODEL: ModelKind = ModelKind {
    name: "overdamped",
    meaning: "elasticity and drag, without inertia",
    method: Some("esdirk3 of first order"),
    needs_drag: true,
    estimate: Some(|estimates| &estimates.overdamped),
    refuses: |_, _| None,
    build: |_| Box::new(Overdamped::default()),
};

/// Velocities have converged if an iteration changes them by at most this fraction of the largest …
const VELOCITY_TOLERANCE: f64 = 1e-10;

/// … or by at most this fraction and at least half of the previous change, which indicates rounding.
const ROUNDING_TOLERANCE: f64 = 1e-6;

/// The velocities of the first three stages.
#[derive(Debug, Default)]
struct Overdamped {
    v: [Vec<f64>; STAGES - 1],
    /// Velocities before an iteration.
    before: Vec<f64>,
}

impl ModelStepper for Overdamped {
    fn mechanics(&self) -> Mechanics {
        Mechanics::Overdamped
    }

    fn order(&self) -> u32 {
        3
    }

    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        for stage in &mut self.v {
            stage.resize(state.q.len(), 0.0);
        }
        self.reinitialise(dynamics, newton, state)
    }

    /// Solves F(q, v) = 0 for the velocities: by one iteration if all forces are linear in them, and otherwise until an iteration changes
    /// them by at most [`VELOCITY_TOLERANCE`] of the largest.
    fn reinitialise(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        if dynamics.coupling().is_none() && dynamics.model.forces.iter().all(Force::is_linear) {
            return newton.iterate(dynamics, state, Direction::VELOCITIES).map(|_| ());
        }
        let (mut last, mut iterations) = (f64::INFINITY, 0);
        loop {
            self.before.clone_from(&state.v);
            let residual_n = newton.iterate(dynamics, state, Direction::VELOCITIES)?.residual;
            iterations += 1;
            let changes = state.v.iter().zip(&self.before).map(|(v, before)| (v - before).abs());
            let (change, speed) =
                (changes.fold(0.0, f64::max), state.v.iter().fold(0.0, |max: f64, v| max.max(v.abs())));
            let stalled = change >= 0.5 * last && change <= ROUNDING_TOLERANCE * speed;
            if change <= VELOCITY_TOLERANCE * speed || stalled {
                return Ok(());
            }
            if iterations >= MAX_ITERATIONS {
                let (time_s, increment_m) = (state.t, 0.0);
                return Err(Error::NotConverged { time_s, step_s: 0.0, iterations, increment_m, residual_n, node: 0 });
            }
            last = change;
        }
    }

    fn step(
        &mut self,
        dynamics: &mut Dynamics,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        let end = to.t;
        let stage = Stage { new: Direction { q: h * G, ..Direction::VELOCITIES }, h };
        self.v[0].copy_from_slice(&from.v);
        for i in 1..STAGES {
            to.t = if i == 1 { from.t + TIMES[i] * h } else { end };
            let v = &self.v;
            // Every stage converges separately: the error of a skipped iteration would appear in the total drag, which is zero
            // here.
            stage.solve(dynamics, newton, &mut ConvergenceRate::default(), from, to, |k| {
                let dq = (0..i).map(|j| h * WEIGHTS[i][j] * v[j][k]).sum();
                ExplicitPart { dq, v: 0.0, guess: v[i - 1][k] }
            })?;
            if i < STAGES - 1 {
                self.v[i].copy_from_slice(&to.v);
            }
        }
        Ok(StepError { position: error(h, &self.v, &to.v), velocity: 0.0 })
    }
}
