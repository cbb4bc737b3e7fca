//! Steps that are solved ahead, beside those of other cases.

use nalgebra::Vector2;

use super::Stepper;
use crate::batch::Measured;
use crate::fluid::force::Powers;
use crate::fluid::{Fluid, Force};
use crate::integrator::{StepControl, StepWeights};
use crate::newton::Progress;
use crate::system::{State, System};

/// A step that has set out.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ahead {
    end: f64,
    h: f64,
    rule: StepWeights,
    /// Its guess keeps the lengths of edges.
    keeps_lengths: bool,
    /// Iterations of Newton's method that solved it; none before it is solved.
    iterations: u32,
    /// It went through no state without meaning.
    checked: bool,
    /// What its end is measured to be is in the stepper's reading.
    measured: bool,
}

impl Ahead {
    /// Its size (s) and rule, and whether its guess keeps the lengths of edges.
    pub fn kind(&self) -> (f64, StepWeights, bool) {
        (self.h, self.rule, self.keeps_lengths)
    }
}

/// What cases have in common that are solved side by side.
#[derive(Debug, PartialEq)]
pub(crate) struct ShapeInLanes {
    nodes: usize,
    held: bool,
    forces: Vec<&'static str>,
    loads: usize,
}

impl Stepper {
    /// What others must have in common with it to be solved beside it; `None` where that cannot be.
    pub(crate) fn shape_in_lanes(&self) -> Option<ShapeInLanes> {
        let (dynamics, model) = (&self.dynamics, self.model());
        let StepControl::Fixed(step) = self.pace else { return None };
        let same = self.mover.rule(step).is_some()
            && self.newton.is_by_blocks()
            && model.layers.is_none()
            && (model.flow.is_none() || !model.forces.are_inertial());
        let shape = ShapeInLanes {
            nodes: model.rod.nodes,
            held: model.head.is_some(),
            forces: model.forces.iter().map(Force::name).collect(),
            loads: dynamics.loads().count(),
        };
        same.then_some(shape)
    }

    /// Sets out on the next internal step, where it does so as on the one before: all that depends on the time alone is that of its end.
    pub(crate) fn set_out_ahead(&mut self) -> Option<Ahead> {
        let StepControl::Fixed(h) = self.pace else { return None };
        let (inputs, scenes) = (&self.dynamics.inputs, self.model().fluid);
        let told =
            self.now.unsettled || self.now.steered || self.now.waiting.is_some() || self.dynamics.course.is_some();
        let fluid = |fluid: &Fluid| [fluid.viscosity, fluid.density];
        let hosts = inputs.head.is_some() || inputs.force.is_some() || fluid(&inputs.fluid) != fluid(&scenes);
        let t = self.now.state.t;
        if told || hosts || t != self.now.clock.at(0, h) || self.dynamics.head_jumps_at(t) {
            return None;
        }
        let (end, rule) = (self.now.clock.at(1, h), self.mover.rule(h)?);
        self.dynamics.step_end = Some(end);
        self.next.t = end;
        self.dynamics.move_to(end, &mut self.next);
        let keeps_lengths = self.dynamics.keeps_lengths(rule.direction());
        Some(Ahead { end, h, rule, keeps_lengths, iterations: 0, checked: false, measured: false })
    }

    /// The state that it has set out from and the one that it goes to, of which only what the time says is known, and Newton's method
    /// before its first iteration.
    pub(crate) fn under_way(&self) -> ([&State; 2], Progress) {
        ([&self.now.state, &self.next], self.newton.progress(&self.dynamics))
    }

    /// Takes over the solution of a step that was found in so many `iterations`, which `write` writes; it is `checked` that it went
    /// through no state without meaning, or not yet.
    pub(crate) fn solved_ahead(
        &mut self,
        step: &Ahead,
        iterations: u32,
        checked: bool,
        write: impl FnOnce(&mut State),
    ) {
        write(&mut self.next);
        self.solved = Some(Ahead { iterations, checked, ..*step });
    }

    /// Takes over what is `measured` of the step that was solved, see [`Reading::take_over`].
    pub(crate) fn measured_ahead(
        &mut self,
        measured: &Measured,
        of_force: impl Fn(usize, &dyn Force) -> (Powers, (f64, Vector2<f64>)),
        fill: impl FnOnce(&mut [f64], &mut [f64], &mut [Vector2<f64>]),
    ) {
        if let Some(solved) = &mut self.solved {
            solved.measured = self.reading.take_over(&self.dynamics, &self.next, measured, of_force, fill).is_ok();
        }
    }

    /// Ends the step of `h` (s) to `end` that was solved ahead; `None` where none was, or the solution does not do.
    pub(super) fn take_solved(&mut self, end: f64, h: f64) -> Option<()> {
        let Ahead { rule, iterations, checked, measured, .. } =
            self.solved.take().filter(|solved| solved.end == end && solved.h == h)?;
        if !checked {
            self.dynamics.check_step(&self.now.state, &self.next).ok()?;
        }
        rule.remember(&self.now.state, &mut self.next);
        self.newton.work.newton_iterations += u64::from(iterations);
        self.newton.work.factorisations += u64::from(iterations);
        self.measured = measured;
        Some(())
    }
}
