//! The full model, M a = F, solved by the integrator of the scene.

use super::{ModelKind, ModelStepper};
use crate::error::Result;
use crate::integrator::{Integrator, StepError, StepWeights};
use crate::linear::Direction;
use crate::model::{Dynamics, Mechanics};
use crate::newton::Newton;
use crate::system::State;

/// Its entry in the table of models.
pub static MODEL: ModelKind = ModelKind {
    name: "full",
    meaning: "elasticity, inertia and drag",
    method: None,
    needs_drag: false,
    estimate: None,
    refuses: |_, _| None,
    build: |integrator| Box::new(Full { integrator, accelerations: Vec::new() }),
};

#[derive(Debug)]
struct Full {
    integrator: Box<dyn Integrator>,
    /// Accelerations before a jump of inputs.
    accelerations: Vec<f64>,
}

impl ModelStepper for Full {
    fn mechanics(&self) -> Mechanics {
        Mechanics::Full
    }

    fn order(&self) -> u32 {
        self.integrator.order()
    }

    fn begin(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        // The accelerations are linear in f, so one iteration solves the equation of motion for them.
        newton.iterate(dynamics, state, Direction::ACCELERATIONS)?;
        self.integrator.begin(state);
        Ok(())
    }

    fn reinitialise(&mut self, dynamics: &mut Dynamics, newton: &mut Newton, state: &mut State) -> Result<()> {
        self.accelerations.clone_from(&state.a);
        newton.iterate(dynamics, state, Direction::ACCELERATIONS)?;
        for (w, (new, old)) in state.memory.iter_mut().zip(state.a.iter().zip(&self.accelerations)) {
            *w += new - old; // the method's memory jumps with the accelerations
        }
        Ok(())
    }

    fn rule(&self, h: f64) -> Option<StepWeights> {
        self.integrator.rule(h)
    }

    fn integrator(&self) -> Option<&dyn Integrator> {
        Some(&*self.integrator)
    }

    fn step(
        &mut self,
        dynamics: &mut Dynamics,
        newton: &mut Newton,
        from: &State,
        h: f64,
        to: &mut State,
    ) -> Result<StepError> {
        self.integrator.step(dynamics, newton, from, h, to)
    }
}
