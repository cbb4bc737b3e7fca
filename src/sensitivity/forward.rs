//! Forward-mode (tangent) derivatives, advanced together with the simulation: one column per parameter.

use std::sync::Arc;

use super::checkpoints::Checkpoints;
use super::equations::Equations;
use super::output::{ActuatorState, Gradient, LocalDerivatives, Output, OutputContext, WorkKind};
use super::parameter::{ActuationShape, Parameter, ParameterEffect, direct, keys};
use super::problem::{GivenStart, Problem};
use super::step_ends::StepEnds;
use super::trajectory::Trajectory;
use super::{TangentState, dot, shaped_start};
use crate::error::{Error, Result};
use crate::integrator::StepWeights;
use crate::linear::Direction;
use crate::model::{DeformedRod, Dynamics};
use crate::system::{State, System};

/// The values and derivatives that [`Problem::forward`] computes.
#[derive(Debug, Clone, Default)]
pub struct Sensitivities {
    /// The recorded times, s.
    pub times: Vec<f64>,
    /// Values, one row per time, one entry per output.
    pub values: Vec<f64>,
    /// Derivatives: a block per time, with a row per output and an entry per parameter.
    pub derivatives: Vec<f64>,
    outputs: usize,
    parameters: usize,
}

impl Sensitivities {
    /// The value of output `o` at recorded time `n`.
    pub fn value(&self, n: usize, o: usize) -> f64 {
        self.values[n * self.outputs + o]
    }

    /// The derivatives of output `o` at recorded time `n`, one per parameter.
    pub fn row(&self, n: usize, o: usize) -> &[f64] {
        let start = (n * self.outputs + o) * self.parameters;
        &self.derivatives[start..start + self.parameters]
    }
}

impl Problem {
    /// Simulates and records the values of `outputs` at every time.
    ///
    /// # Errors
    /// The error of a step that fails; failing steps are not halved.
    pub fn simulate_with(&mut self, outputs: &[Output]) -> Result<(Trajectory, Sensitivities)> {
        let mut trajectory = Trajectory::default();
        let values = self.forward(&[], outputs, 1, |state| trajectory.push(state))?;
        Ok((trajectory, values))
    }

    /// The same, but stores only the states that an adjoint needs.
    pub(crate) fn simulate_with_checkpoints(&mut self, outputs: &[Output]) -> Result<(Checkpoints, Sensitivities)> {
        let mut checkpoints = self.checkpoints();
        let values = self.forward(&[], outputs, 1, |state| checkpoints.push(state))?;
        Ok((checkpoints, values))
    }

    /// Simulates with the derivatives of all `outputs` with respect to all `parameters`, and records every `every` steps and at
    /// the end. `look` is called with every state.
    ///
    /// # Errors
    /// Errors of [`simulate`](Self::simulate); [`Error::Derivative`] for parameters and outputs that the model does not have;
    /// [`Error::BadValue`] for `every` = 0.
    pub fn forward(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        every: usize,
        mut look: impl FnMut(&State),
    ) -> Result<Sensitivities> {
        self.check(parameters, outputs)?;
        if every == 0 {
            return Err(Error::BadValue { name: "every", value: 0.0, allowed: "1 or more steps" });
        }
        let follows_state = self.model().has_motor_or_winch();
        if follows_state && !parameters.is_empty() && outputs.iter().any(|output| !output.work.is_empty()) {
            let problem =
                "the work of a scene with a hinge or a winch has no forward derivative; allowed: Problem::adjoint";
            return Err(Error::Derivative { problem: problem.to_string() });
        }
        let (unknowns, nodes, steps) = (self.model().unknowns(), self.dynamics.nodes(), self.steps);
        let mut equations = Equations::new(self.model())?;
        let mut point = LocalDerivatives::new(nodes, &keys(parameters));
        let mut shape = ActuationShape::new(nodes);
        let mut gradient = Gradient::new(self.model(), &keys(parameters));
        let mut effects: Vec<ParameterEffect> = Vec::with_capacity(parameters.len());
        let mut columns: Vec<TangentState> = Vec::new();
        let summing = outputs.iter().any(|output| !output.work.is_empty());
        let mut ends = StepEnds::new(nodes);
        let mut before = ActuatorState::default();
        let (width, size) = (parameters.len(), outputs.len() * parameters.len());
        let mut first = vec![0.0; outputs.len() + size];
        let mut sums = vec![0.0; outputs.len() + size];
        let mut now = vec![0.0; outputs.len() + size];
        let mut row = vec![0.0; width];
        let mut rhs = vec![0.0; unknowns];
        let mut star = vec![0.0; unknowns];
        let mut found = Sensitivities { outputs: outputs.len(), parameters: width, ..Sensitivities::default() };
        let rules = self.rules()?;
        // Taken out of `self`, which the simulation borrows.
        let mut finite_differences = std::mem::take(&mut self.finite_differences);
        let mut force_by = vec![vec![0.0; unknowns]; finite_differences.len()];
        let mut scratch = Gradient::new(self.model(), &[]);
        let controls = Arc::clone(&self.controls);
        let given = self.start.clone();
        let directions = Arc::clone(&self.directions);

        let done = self.advance(|dynamics, n, state, h| {
            look(state);
            let bent = dynamics.shape(state)?;
            for (difference, force) in finite_differences.iter_mut().zip(&mut force_by) {
                difference.move_to(&bent, (&controls, steps, n), summing, force)?;
            }
            shape.take(dynamics, state.t);
            effects.clear();
            effects
                .extend(parameters.iter().map(|parameter| parameter.effect(&dynamics.model.rod, &shape, &directions)));
            if n == 0 {
                let first = |i: usize| finite_differences[i].first();
                let parameters = (&effects[..], &force_by[..], &given);
                columns = initial_columns(dynamics, state, parameters, &shape, &mut equations, &mut point, first)?;
            } else {
                let rule = rules[usize::from(n > steps.whole)];
                let direction = Direction { q: rule.q_new, v: rule.v_new, a: 1.0 };
                equations.assemble(dynamics, state, direction)?;
                let bent = dynamics.shape(state)?;
                point.look(&bent);
                let at = OutputContext { bent, point: &point };
                for (j, (column, effect)) in columns.iter_mut().zip(&effects).enumerate() {
                    predict(&rule, h, column, &mut star);
                    equations.differences(&star, &mut rhs);
                    subtract_damping_and_force(
                        &mut equations,
                        &at,
                        (effect, &force_by),
                        &shape,
                        rule.q_new,
                        &column.v,
                        &mut rhs,
                    );
                    if j == 0 {
                        equations.factor(&mut rhs, false)?;
                    } else {
                        equations.solve(&mut rhs, false)?;
                    }
                    correct(&rule, column, &star, &rhs);
                }
            }
            let recorded = n % every == 0 || n == steps.count();
            if !(recorded || summing || n == 0) {
                return Ok(());
            }
            if summing {
                ends.look(dynamics, &controls, steps, n);
            }
            let at = OutputContext { bent: dynamics.shape(state)?, point: &point };
            let beyond = [Some(&before).filter(|_| follows_state), None];
            let derivatives = |gradient: &Gradient, step: Option<[&ActuationShape; 2]>, row: &mut [f64]| {
                for ((entry, column), (effect, parameter)) in
                    row.iter_mut().zip(&columns).zip(effects.iter().zip(parameters))
                {
                    *entry = dot(&gradient.q, &column.q) + dot(&gradient.v, &column.v) + dot(&gradient.a, &column.a);
                    *entry += direct(gradient, effect, &shape, step.map(|ends| (ends, *parameter, &at, &*directions)));
                }
            };
            now.fill(0.0);
            for (o, output) in outputs.iter().enumerate() {
                // The positions of a value and of its derivatives in the sums.
                let block = outputs.len() + o * width;
                let own = || [o].into_iter().chain(block..block + width);
                let mut sum = |i: usize, sums: &mut [f64]| -> Result<()> {
                    let span = &ends.intervals[i];
                    if output.work.is_empty() || span.h == 0.0 {
                        return Ok(());
                    }
                    gradient.clear();
                    let add =
                        |(c, work): &(f64, WorkKind)| c * work.add(&at, (span, beyond[i]), i == 0, *c, &mut gradient);
                    sums[o] += output.work.iter().map(add).sum::<f64>();
                    gradient.follow_winches(&at.bent);
                    derivatives(&gradient, Some([&ends.shapes[i], &ends.shapes[i + 1]]), &mut row);
                    sums[block..block + width].iter_mut().zip(&row).for_each(|(sum, x)| *sum += x);
                    for (j, effect) in effects.iter().enumerate() {
                        if let Some(m) = effect.scene_parameter {
                            sums[block + j] += finite_differences[m].output(
                                (output, &gradient, 1.0),
                                Some((i, beyond[i])),
                                &point,
                                &mut scratch,
                            )?;
                        }
                    }
                    Ok(())
                };
                sum(0, &mut sums)?;
                own().for_each(|k| now[k] = sums[k]);
                sum(1, &mut sums)?; // the contribution of the step that begins here, for the next time
                gradient.clear();
                now[o] += output.now.iter().map(|(c, quantity)| c * quantity.add(&at, *c, &mut gradient)).sum::<f64>();
                gradient.follow_winches(&at.bent);
                derivatives(&gradient, None, &mut row);
                now[block..block + width].iter_mut().zip(&row).for_each(|(now, x)| *now += x);
                for (j, effect) in effects.iter().enumerate() {
                    if let Some(m) = effect.scene_parameter {
                        now[block + j] +=
                            finite_differences[m].output((output, &gradient, 1.0), None, &point, &mut scratch)?;
                    }
                }
                if n == 0 && output.since_start {
                    own().for_each(|k| first[k] = now[k]);
                }
            }
            if follows_state {
                before = ActuatorState::of(&at.bent);
            }
            if recorded {
                for (now, first) in now.iter_mut().zip(&first) {
                    *now -= first;
                }
                found.times.push(state.t);
                found.values.extend_from_slice(&now[..outputs.len()]);
                found.derivatives.extend_from_slice(&now[outputs.len()..]);
            }
            Ok(())
        });
        self.finite_differences = finite_differences;
        done.map(|()| found)
    }
}

/// The derivatives of the initial state, whose accelerations satisfy M a = F.
fn initial_columns(
    dynamics: &mut Dynamics,
    state: &State,
    (effects, force_by, given): (&[ParameterEffect], &[Vec<f64>], &GivenStart),
    shape: &ActuationShape,
    equations: &mut Equations,
    point: &mut LocalDerivatives,
    mut first: impl FnMut(usize) -> [Vec<f64>; 2],
) -> Result<Vec<TangentState>> {
    // The initial state does not depend on the tensions of winches at that time.
    dynamics.move_to(state.t, &mut state.clone());
    let mut drive = ActuationShape::new(dynamics.nodes());
    drive.take(dynamics, state.t);
    let first_by = |effect: &ParameterEffect| match effect.scene_parameter {
        Some(i) => first(i),
        None => shaped_start::first_by(dynamics, effect, &drive),
    };
    let firsts: Vec<[Vec<f64>; 2]> = effects.iter().map(first_by).collect();
    equations.assemble(dynamics, state, Direction::POSITIONS)?;
    let bent = dynamics.shape(state)?;
    point.look(&bent);
    let (dynamics, at) = (bent.dynamics, OutputContext { bent, point });
    let mut columns = Vec::with_capacity(effects.len());
    for (effect, [mut q, mut v]) in effects.iter().zip(firsts) {
        given.hold([&mut q, &mut v]);
        let mut a = vec![0.0; q.len()];
        equations.differences(&q, &mut a);
        subtract_damping_and_force(equations, &at, (effect, force_by), shape, 1.0, &v, &mut a);
        equations.divide_by_inertia(&dynamics.model.rod.mass, &mut a)?;
        columns.push(TangentState { q, v, memory: a.clone(), a });
    }
    Ok(columns)
}

/// Adds `factor`·f_p to `force`.
#[inline]
fn add_parameter_force(
    at: &OutputContext<'_>,
    effect: &ParameterEffect,
    shape: &ActuationShape,
    factor: f64,
    force: &mut [f64],
) {
    let DeformedRod { dynamics, .. } = at.bent;
    let (rod, kappa) = (&dynamics.model.rod, at.bent.kappa());
    if let Some(key) = effect.key {
        force.iter_mut().zip(at.point.by_key(key)).for_each(|(f, by)| *f += factor * by);
    }
    for k in effect.joints.clone() {
        let deviation = kappa[k] - dynamics.natural[k] + at.bent.resisted_curvature(k);
        let size = effect.stiffness(k) * deviation
            - rod.joint[k] * effect.natural(shape, k)
            - at.bent.resisted_natural_rate(k) * effect.rate(shape, k);
        at.point.scatter(k, factor * size, force);
    }
}

/// Writes Q* to `star` and V* to the velocities of the column, and updates its memory.
#[inline]
fn predict(rule: &StepWeights, h: f64, column: &mut TangentState, star: &mut [f64]) {
    let TangentState { q, v, a, memory } = column;
    match rule.memory {
        None => {
            for (((star, q), v), a) in star.iter_mut().zip(&*q).zip(v).zip(&*a) {
                *star = q + h * *v + rule.q_old * a;
                *v += rule.v_old * a;
            }
        }
        Some(m) => {
            for ((((star, q), v), a), w) in star.iter_mut().zip(&*q).zip(v).zip(&*a).zip(memory) {
                *star = q + h * *v + rule.q_old * a + m.q * *w;
                *v += rule.v_old * a + m.v * *w;
                *w = m.kept * *w + m.old * a;
            }
        }
    }
}

/// Subtracts A (f_v V* + f_p), and sets the rows of a held node to zero.
fn subtract_damping_and_force(
    equations: &mut Equations,
    at: &OutputContext<'_>,
    (effect, force_by): (&ParameterEffect, &[Vec<f64>]),
    shape: &ActuationShape,
    size: f64,
    v_star: &[f64],
    rhs: &mut [f64],
) {
    rhs.iter_mut().zip(equations.damp(v_star, false)).for_each(|(rhs, damped)| *rhs -= size * damped);
    add_parameter_force(at, effect, shape, -size, rhs);
    if let Some(by) = effect.scene_parameter.and_then(|i| force_by.get(i)) {
        rhs.iter_mut().zip(by).for_each(|(rhs, by)| *rhs -= size * by);
    }
    if at.bent.dynamics.held.is_some() {
        rhs[..2].fill(0.0);
    }
}

/// Computes the column at the new time from Q − Q*.
#[inline]
fn correct(rule: &StepWeights, column: &mut TangentState, star: &[f64], moved: &[f64]) {
    let TangentState { q, v, a, memory } = column;
    let per = 1.0 / rule.q_new;
    for ((((q, v), a), star), new) in q.iter_mut().zip(v).zip(&mut *a).zip(star).zip(moved) {
        *q = star + new;
        *a = new * per;
        *v += rule.v_new * *a;
    }
    if let Some(m) = rule.memory {
        for (w, a) in memory.iter_mut().zip(&*a) {
            *w += m.new * a;
        }
    }
}
