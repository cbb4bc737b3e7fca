//! Time steps that a batch has solved in SIMD lanes together with those of other cases, before their steppers accept them.

use nalgebra::Vector2;

use super::Stepper;
use crate::fluid::force::Powers;
use crate::fluid::{Fluid, Force};
use crate::integrator::{StepControl, StepWeights};
use crate::metrics::BatchedMeasurements;
use crate::newton::SolveProgress;
use crate::rod::DampedRate;
use crate::rod::damping::StrainRates;
use crate::system::{State, System};

/// A time step that was solved together with other cases in SIMD lanes and waits to be accepted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PresolvedStep {
    end: f64,
    h: f64,
    rule: StepWeights,
    /// Its initial guess keeps the lengths of edges.
    keeps_lengths: bool,
    /// Newton iterations that solved it; 0 before.
    iterations: u32,
    /// Its states were checked for folds and collapsed edges.
    checked: bool,
    /// The measurements at its end are stored in the stepper.
    measured: bool,
}

impl PresolvedStep {
    /// Its size (s) and rule, and whether its initial guess keeps the lengths of edges.
    pub fn kind(&self) -> (f64, StepWeights, bool) {
        (self.h, self.rule, self.keeps_lengths)
    }
}

/// The properties that cases must share to be solved in one batch.
#[derive(Debug, PartialEq)]
pub(crate) struct BatchKey {
    nodes: usize,
    held: bool,
    forces: Vec<&'static str>,
    loads: usize,
    damped: Option<DampedRate>,
}

impl Stepper {
    /// The properties that steppers must share to be solved in one batch, or `None` if this one cannot be batched.
    pub(crate) fn batch_key(&self) -> Option<BatchKey> {
        let (dynamics, model) = (&self.dynamics, self.model());
        let StepControl::Fixed(step) = self.step_control else { return None };
        let same = self.model_stepper.rule(step).is_some()
            && self.newton.is_by_blocks()
            && model.layers.is_none()
            && model.hinge.is_none()
            && (model.flow.is_none() || !model.forces.are_inertial());
        let shape = BatchKey {
            nodes: model.rod.nodes,
            held: model.head.is_some(),
            forces: model.forces.iter().map(Force::name).collect(),
            loads: dynamics.loads().count(),
            damped: model.rod.damping.as_ref().map(|damping| damping.rate),
        };
        same.then_some(shape)
    }

    /// Prepares the next internal step, if nothing but the time has changed since the last one. Quantities that depend on time alone are
    /// evaluated at its end.
    pub(crate) fn presolve_next(&mut self) -> Option<PresolvedStep> {
        let StepControl::Fixed(h) = self.step_control else { return None };
        let (inputs, scenes) = (&self.dynamics.inputs, self.model().fluid);
        let told = self.now.needs_reinitialisation
            || self.now.inputs_changed
            || self.now.pending_time.is_some()
            || self.dynamics.extrapolation.is_some();
        let fluid = |fluid: &Fluid| [fluid.viscosity, fluid.density];
        let hosts = inputs.head.is_some() || inputs.force.is_some() || fluid(&inputs.fluid) != fluid(&scenes);
        let t = self.now.state.t;
        if told || hosts || t != self.now.clock.at(0, h) || self.dynamics.head_jumps_at(t) {
            return None;
        }
        let (end, rule) = (self.now.clock.at(1, h), self.model_stepper.rule(h)?);
        self.dynamics.step_end = Some(end);
        self.next.t = end;
        self.dynamics.move_to(end, &mut self.next);
        let keeps_lengths = self.dynamics.keeps_lengths(rule.direction());
        Some(PresolvedStep { end, h, rule, keeps_lengths, iterations: 0, checked: false, measured: false })
    }

    /// The states at the start and at the end of the prepared step, the latter known only where it depends on time alone, and the initial
    /// progress of Newton's method.
    pub(crate) fn presolve_inputs(&self) -> ([&State; 2], SolveProgress) {
        ([&self.now.state, &self.next], self.newton.progress(&self.dynamics))
    }

    /// Stores the solution of a step that took so many `iterations`, which `write` writes. If `checked`, its states were checked for folds
    /// and collapsed edges.
    pub(crate) fn store_presolved(
        &mut self,
        step: &PresolvedStep,
        iterations: u32,
        checked: bool,
        write: impl FnOnce(&mut State),
    ) {
        write(&mut self.next);
        self.presolved = Some(PresolvedStep { iterations, checked, ..*step });
    }

    /// Stores the measurements of the presolved step, see [`Measurements::measure_presolved`](crate::metrics::Measurements::measure_presolved).
    pub(crate) fn store_presolved_measurements(
        &mut self,
        measured: &BatchedMeasurements,
        read_rates: impl FnOnce(&mut StrainRates),
        of_force: impl Fn(usize, &dyn Force) -> (Powers, (f64, Vector2<f64>)),
        fill: impl FnOnce(&mut [f64], &mut [f64], &mut [Vector2<f64>]),
    ) {
        if let Some(solved) = &mut self.presolved {
            if let Some(rates) = &mut self.dynamics.rates {
                read_rates(rates);
            }
            solved.measured =
                self.measurements.measure_presolved(&self.dynamics, &self.next, measured, of_force, fill).is_ok();
        }
    }

    /// Completes the presolved step of `h` (s) to `end`. Returns `None` if there is none, or if its solution is not valid.
    pub(super) fn take_presolved(&mut self, end: f64, h: f64) -> Option<()> {
        let PresolvedStep { rule, iterations, checked, measured, .. } =
            self.presolved.take().filter(|solved| solved.end == end && solved.h == h)?;
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
