//! Overdamped: C(q) (v − u) = F(q, t), no inertia; positions are the only unknowns, one order in time less.
//!
//! The residual is the model's own at a = 0. Steps are those of ESDIRK3(2), L-stable, on q' = v: a stage solves for its
//! velocity with q_i = qⁿ + h Σ_{j<i} a_ij v_j + hγ v_i.

use super::shape::longest_step;
use super::{Mover, Rung};
use crate::error::Result;
use crate::integrator::esdirk3::{G, STAGES, TIMES, WEIGHTS, error};
use crate::integrator::{Foot, Stage, StepError};
use crate::model::{Dynamics, Mechanics};
use crate::newton::{Convergence, Newton};
use crate::system::{Direction, State};

/// What is known of it.
pub static RUNG: Rung = Rung {
    name: "overdamped",
    meaning: "elasticity and drag, without inertia",
    method: Some("esdirk3 of first order"),
    needs_drag: true,
    estimate: Some(|estimates| &estimates.overdamped),
    refuses: |_, _| None,
    build: |_| Box::new(Overdamped::default()),
};

/// The velocities of the first three stages.
#[derive(Debug, Default)]
struct Overdamped {
    v: [Vec<f64>; STAGES - 1],
}

impl Mover for Overdamped {
    fn mechanics(&self) -> Mechanics {
        Mechanics::Overdamped
    }

    fn order(&self) -> u32 {
        3
    }

    fn longest_step(&self, dynamics: &Dynamics) -> f64 {
        longest_step(dynamics) // a motion much smaller than the length is within any tolerance
    }

    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        for stage in &mut self.v {
            stage.resize(state.q.len(), 0.0);
        }
        self.settle(dynamics, newton, state)
    }

    fn settle(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        newton.iterate(dynamics, state, Direction::VELOCITIES).map(|_| ())
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
            // Every stage converges by itself: what one that is spared leaves, drag in all would show, which is nothing here.
            stage.solve(dynamics, newton, &mut Convergence::default(), from, to, |k| {
                let dq = (0..i).map(|j| h * WEIGHTS[i][j] * v[j][k]).sum();
                Foot { dq, v: 0.0, guess: v[i - 1][k] }
            })?;
            if i < STAGES - 1 {
                self.v[i].copy_from_slice(&to.v);
            }
        }
        Ok(StepError { position: error(h, &self.v, &to.v), velocity: 0.0 })
    }
}
