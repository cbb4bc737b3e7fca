//! Steps that are solved ahead, beside those of other cases.

use super::Stepper;
use crate::integrator::{Pace, Rule};
use crate::newton::Progress;
use crate::system::{Direction, State};

/// A step that has set out: its guess is made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ahead {
    end: f64,
    h: f64,
    rule: Rule,
    /// Iterations of Newton's method that solved it; none before it is solved.
    iterations: u32,
}

impl Ahead {
    /// The direction that it moves along.
    pub fn direction(&self) -> Direction {
        self.rule.direction()
    }
}

/// What cases have in common that are solved side by side.
#[derive(Debug, PartialEq)]
pub(crate) struct ShapeInLanes {
    nodes: usize,
    held: bool,
    drag: bool,
    loads: usize,
}

impl Stepper {
    /// What others must have in common with it to be solved beside it; `None` where that cannot be.
    pub(crate) fn shape_in_lanes(&self) -> Option<ShapeInLanes> {
        let (dynamics, model) = (&self.dynamics, self.model());
        let Pace::Fixed(step) = self.pace else { return None };
        let same = self.mover.rule(step).is_some()
            && self.newton.is_by_blocks()
            && model.layers.is_none()
            && (model.forces.is_empty() || model.forces.proportional().is_some());
        let shape = ShapeInLanes {
            nodes: model.rod.nodes,
            held: model.head.is_some(),
            drag: !model.forces.is_empty(),
            loads: dynamics.loads().count(),
        };
        same.then_some(shape)
    }

    /// Makes the guess of the next internal step, where it sets out as the one before did.
    pub(crate) fn set_out_ahead(&mut self) -> Option<Ahead> {
        let Pace::Fixed(h) = self.pace else { return None };
        let (inputs, scenes) = (&self.dynamics.inputs, self.model().fluid);
        let told = self.kick.due || self.steered || self.ahead.is_some() || self.dynamics.course.is_some();
        let hosts = inputs.head.is_some() || inputs.force.is_some() || inputs.fluid.viscosity != scenes.viscosity;
        if told || hosts || self.state.t != self.clock.at(0, h) {
            return None;
        }
        let (end, rule) = (self.clock.at(1, h), self.mover.rule(h)?);
        self.next.t = end;
        rule.guess(&mut self.dynamics, &self.state, h, &mut self.next);
        Some(Ahead { end, h, rule, iterations: 0 })
    }

    /// The guess, to be solved, and Newton's method before its first iteration.
    pub(crate) fn guessed(&self) -> (&State, Progress) {
        (&self.next, self.newton.progress(&self.dynamics))
    }

    /// Takes over the solution of a step that was found in so many `iterations`; `write` writes it.
    pub(crate) fn solved_ahead(&mut self, step: Ahead, iterations: u32, write: impl FnOnce(&mut State)) {
        write(&mut self.next);
        self.solved = Some(Ahead { iterations, ..step });
    }

    /// Ends the step of `h` (s) to `end` that was solved ahead; `None` where none was, or the solution does not do.
    pub(super) fn take_solved(&mut self, end: f64, h: f64) -> Option<()> {
        let Ahead { rule, iterations, .. } = self.solved.take().filter(|solved| solved.end == end && solved.h == h)?;
        rule.finish(&self.dynamics, &self.state, &mut self.next).ok()?;
        self.newton.work.newton_iterations += u64::from(iterations);
        self.newton.work.factorisations += u64::from(iterations);
        Some(())
    }
}
