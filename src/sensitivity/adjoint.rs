//! Adjoint (reverse-mode) derivatives of one number with respect to all parameters: backwards over a stored simulation, with one
//! transposed solve per step.

use super::checkpoints::{Checkpoints, ReverseStates, StepSolver};
use super::controls::{Controls, Cotangents, Weights};
use super::equations::Equations;
use super::output::{ActuatorState, Gradient, LocalDerivatives, Output, OutputContext};
use super::parameter::{ActuationShape, JointDirection, Parameter, ParameterEffect, direct, keys};
use super::problem::Problem;
use super::step_ends::StepEnds;
use super::trajectory::Trajectory;
use super::{TangentState, dot, shaped_start};
use crate::error::{Error, Result};
use crate::integrator::{Integrator, StepWeights};
use crate::linear::Direction;
use crate::model::DeformedRod;
use crate::system::{State, System};

impl Problem {
    /// The derivatives with respect to all `parameters` of Σ w y over all times and outputs y of the stored simulation
    /// `trajectory` of this problem, with `weights` w in one row per time.
    ///
    /// # Errors
    /// [`Error::WrongLength`] for weights of another simulation; [`Error::Derivative`] for parameters and outputs that the model
    /// does not have.
    pub fn adjoint(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: &[f64],
        trajectory: &Trajectory,
    ) -> Result<Vec<f64>> {
        let expected = outputs.len() * (self.steps.count() + 1);
        if weights.len() != expected {
            return Err(Error::WrongLength { name: "weights", expected, found: weights.len() });
        }
        let states = self.states_of(trajectory)?;
        let weights = Weights { outputs: weights, ..Weights::default() };
        Ok(self.backward_pass(parameters, outputs, weights, states, [false; 2])?.parameters)
    }

    /// The same as [`adjoint`](Self::adjoint) for a simulation of this problem that is stored as `checkpoints`.
    pub(crate) fn adjoint_of(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: &[f64],
        checkpoints: &Checkpoints,
    ) -> Result<Vec<f64>> {
        let weights = Weights { outputs: weights, ..Weights::default() };
        Ok(self.backward_pass(parameters, outputs, weights, checkpoints.states(), [false; 2])?.parameters)
    }

    /// The same as [`adjoint`](Self::adjoint), with `weights` of positions and velocities too, and with derivatives with respect
    /// to the initial state and the controls in addition to the `parameters`.
    ///
    /// # Errors
    /// Errors of [`adjoint`](Self::adjoint).
    pub fn pull_back(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: Weights<'_>,
        trajectory: &Trajectory,
    ) -> Result<Cotangents> {
        let states = self.states_of(trajectory)?;
        self.backward_pass(parameters, outputs, weights, states, [true; 2])
    }

    /// The states of a `trajectory`, if it belongs to this problem.
    fn states_of<'a>(&self, trajectory: &'a Trajectory) -> Result<ReverseStates<'a>> {
        trajectory.check(self.model(), (0..self.steps.count() + 1).map(|n| self.steps.time(n)))?;
        Ok(ReverseStates::of(trajectory))
    }

    /// Goes backwards over the `states`. `by_controls` requests derivatives with respect to the natural curvature at each time,
    /// and with respect to the forces.
    pub(super) fn backward_pass(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: Weights<'_>,
        mut states: ReverseStates<'_>,
        [by_natural, by_forces]: [bool; 2],
    ) -> Result<Cotangents> {
        self.check(parameters, outputs)?;
        let (unknowns, nodes, steps) = (self.model().unknowns(), self.dynamics.nodes(), self.steps);
        let times = steps.count() + 1;
        let given = [weights.outputs, weights.positions, weights.velocities];
        for (values, width) in given.iter().zip([outputs.len(), 2 * nodes, 2 * nodes]) {
            if !values.is_empty() && values.len() != times * width {
                let (expected, found) = (times * width, values.len());
                return Err(Error::WrongLength { name: "weights", expected, found });
            }
        }
        let (rules, check_interruption) = (self.rules()?, self.check_interruption());
        let summing = outputs.iter().any(|output| !output.work.is_empty());
        let mut equations = Equations::new(self.model())?;
        let mut point = LocalDerivatives::new(nodes, &keys(parameters));
        let mut shape = ActuationShape::new(nodes);
        let mut ends = StepEnds::new(nodes);
        let mut gradient = Gradient::new(self.model(), &keys(parameters));
        let mut effects: Vec<ParameterEffect> = Vec::with_capacity(parameters.len());
        let zeros = || vec![0.0; unknowns];
        // The cotangents of a state and of the previous one.
        let mut bar = TangentState { q: zeros(), v: zeros(), a: zeros(), memory: zeros() };
        let mut mu = zeros();
        let mut force = zeros();
        let mut total = vec![0.0; parameters.len()];
        let mut state = State::zeros(unknowns);
        let newton = self.newton()?;
        let Self { dynamics, finite_differences, directions, controls, start: given, integrator, .. } = self;
        let mut again = StepSolver { newton, integrator: integrator.as_mut(), controls, grid: steps };
        let mut scratch = Gradient::new(&dynamics.model, &[]);
        let held = dynamics.model.head.is_some();
        let joints = dynamics.model.rod.joints();
        let bends = if by_natural { Controls::effects(&dynamics.model.rod, &shape) } else { Vec::new() };
        let mut natural = vec![0.0; times * bends.len()];
        let mut by_force = vec![0.0; if by_forces { times * 2 * nodes } else { 0 }];
        let mut force_by = vec![zeros(); finite_differences.len()];
        // Sums of the weights of all later times, for outputs that are accumulated from the start.
        let mut later = vec![0.0; outputs.len()];
        // Values of a motor and winches at the times before, of, and after a state.
        let follows_state = summing && dynamics.model.has_motor_or_winch();
        let mut actuators = [ActuatorState::default(); 3];
        for n in (0..=steps.count()).rev() {
            check_interruption()?;
            if follows_state {
                let mut at = |n: usize| {
                    states.load(n, &mut state, dynamics, &mut again)?;
                    controls.apply(dynamics, n);
                    dynamics.move_to(state.t, &mut state);
                    dynamics.shape(&state).map(|bent| ActuatorState::of(&bent))
                };
                let own = if n == steps.count() { at(n)? } else { actuators[0] };
                actuators = [at(n.saturating_sub(1))?, own, actuators[1]];
            }
            states.load(n, &mut state, dynamics, &mut again)?;
            if summing {
                ends.look(dynamics, controls, steps, n);
            }
            controls.apply(dynamics, n);
            dynamics.move_to(state.t, &mut state);
            let rule = rules[usize::from(n > steps.whole)];
            let direction = match n {
                0 => Direction::POSITIONS,
                _ => Direction { q: rule.q_new, v: rule.v_new, a: 1.0 },
            };
            equations.assemble(dynamics, &state, direction)?;
            shape.take(dynamics, state.t);
            let bent = dynamics.shape(&state)?;
            point.look(&bent);
            effects.clear();
            let rod = &bent.dynamics.model.rod;
            effects.extend(parameters.iter().map(|parameter| parameter.effect(rod, &shape, directions)));
            let at = OutputContext { bent, point: &point };
            for (difference, force) in finite_differences.iter_mut().zip(&mut force_by) {
                difference.move_to(&bent, (controls, steps, n), summing, force)?;
            }
            for (bar, weights) in [(&mut bar.q, weights.positions), (&mut bar.v, weights.velocities)] {
                bar.iter_mut()
                    .zip(weights.iter().skip(2 * nodes * n).take(2 * nodes))
                    .for_each(|(bar, weight)| *bar += weight);
            }
            for (o, output) in outputs.iter().enumerate() {
                let weight = weights.outputs.get(n * outputs.len() + o).copied().unwrap_or(0.0);
                let begun = later[o];
                later[o] += weight;
                let own = if n == 0 && output.since_start { weight - later[o] } else { weight };
                if own != 0.0 {
                    gradient.clear();
                    for (c, quantity) in &output.now {
                        quantity.add(&at, c * own, &mut gradient);
                    }
                    gradient.follow_winches(&at.bent);
                    accumulate(&gradient, &effects, &shape, None, &mut bar, &mut total);
                    for (i, total) in finite_differenced(&effects, &mut total) {
                        *total += finite_differences[i].output((output, &gradient, own), None, &point, &mut scratch)?;
                    }
                    for (j, (k, effect)) in joints.clone().zip(&bends).enumerate() {
                        natural[n * bends.len() + j] += gradient.natural[k] * effect.natural(&shape, k);
                    }
                    add_row(&mut by_force, n, &gradient.force);
                }
                for (i, factor) in [later[o], begun].into_iter().enumerate() {
                    let span = &ends.intervals[i];
                    if output.work.is_empty() || span.h == 0.0 || factor == 0.0 {
                        continue;
                    }
                    gradient.clear();
                    let beyond = Some(&actuators[2 * i]).filter(|_| follows_state);
                    for (c, work) in &output.work {
                        work.add(&at, (span, beyond), i == 0, c * factor, &mut gradient);
                    }
                    gradient.follow_winches(&at.bent);
                    let step = Some(([&ends.shapes[i], &ends.shapes[i + 1]], parameters, &at, &**directions));
                    accumulate(&gradient, &effects, &shape, step, &mut bar, &mut total);
                    for (j, total) in finite_differenced(&effects, &mut total) {
                        let share = Some((i, beyond));
                        *total +=
                            finite_differences[j].output((output, &gradient, factor), share, &point, &mut scratch)?;
                    }
                    for (j, (k, effect)) in joints.clone().zip(&bends).enumerate() {
                        let own = effect.natural(&shape, k);
                        natural[n * bends.len() + j] += gradient.natural[k] * own;
                        // The change of κ̄ over the step from time n - 1 + i.
                        let change = gradient.natural_step[k] * own;
                        natural[(n + i) * bends.len() + j] += change;
                        natural[(n + i).saturating_sub(1) * bends.len() + j] -= change;
                    }
                    add_row(&mut by_force, n, &gradient.force);
                    add_row(&mut by_force, if i == 0 { n - 1 } else { n + 1 }, &gradient.force_beyond);
                }
            }
            if n == 0 {
                initial_cotangents(&at, &mut equations, &mut bar, &mut force, held, again.integrator)?;
            } else {
                let h = steps.length(n);
                let StepWeights { q_old, v_old, q_new, v_new, memory } = rule;
                let (new, old, kept, q_w, v_w) =
                    memory.map_or((0.0, 0.0, 0.0, 0.0, 0.0), |m| (m.new, m.old, m.kept, m.q, m.v));
                for (i, mu) in mu.iter_mut().enumerate() {
                    bar.a[i] += v_new * bar.v[i] + new * bar.memory[i];
                    *mu = bar.q[i] + bar.a[i] / q_new;
                }
                equations.factor(&mut mu, true)?;
                if held {
                    mu[..2].fill(0.0);
                }
                equations.add_differences_transposed(&mu, &mut bar.q);
                for (i, damped) in equations.damp(&mu, true).iter().enumerate() {
                    let (q_star, v_star, w) = (bar.q[i], bar.v[i] - q_new * damped, bar.memory[i]);
                    bar.v[i] = h * q_star + v_star;
                    bar.a[i] = q_old * q_star + v_old * v_star + old * w;
                    bar.memory[i] = q_w * q_star + v_w * v_star + kept * w;
                    force[i] = -q_new * mu[i];
                }
                if held {
                    for part in [&mut bar.q, &mut bar.v, &mut bar.a, &mut bar.memory] {
                        part[..2].fill(0.0);
                    }
                }
            }
            for (total, effect) in total.iter_mut().zip(&effects) {
                *total += parameter_force_along(&at, effect, &shape, &force);
            }
            for (i, total) in finite_differenced(&effects, &mut total) {
                *total += dot(&force_by[i], &force);
            }
            for (by, effect) in natural.iter_mut().skip(n * bends.len()).zip(&bends) {
                *by += parameter_force_along(&at, effect, &shape, &force);
            }
            by_force.iter_mut().skip(2 * nodes * n).zip(&force[..2 * nodes]).for_each(|(by, force)| *by -= force);
            if n == 0 {
                // The initial state does not depend on the tensions of winches at that time.
                dynamics.move_to(state.t, &mut state);
                shape.take(dynamics, state.t);
                let by_natural = natural.iter_mut().zip(&bends);
                for (total, effect) in
                    total.iter_mut().zip(&effects).chain(by_natural).filter(|(_, by)| by.bends(&shape))
                {
                    let [mut q, mut v] = shaped_start::first_by(dynamics, effect, &shape);
                    given.hold([&mut q, &mut v]);
                    *total += dot(&q, &bar.q) + dot(&v, &bar.v);
                }
                for (i, total) in finite_differenced(&effects, &mut total) {
                    let [mut q, mut v] = finite_differences[i].first();
                    given.hold([&mut q, &mut v]);
                    *total += dot(&q, &bar.q) + dot(&v, &bar.v);
                }
            }
        }
        if held {
            // The head also determines the initial position and velocity of node 0.
            bar.q[..2].fill(0.0);
            bar.v[..2].fill(0.0);
        }
        let start = [bar.q, bar.v].map(|by| dynamics.of_nodes(by));
        Ok(Cotangents { parameters: total, start, natural, force: by_force })
    }
}

/// Adds `row` to row `n` of `rows`, unless `rows` is empty.
fn add_row(rows: &mut [f64], n: usize, row: &[f64]) {
    rows.iter_mut().skip(n * row.len()).zip(row).for_each(|(to, from)| *to += from);
}

/// The finite-differenced parameters, by index, with their totals.
fn finite_differenced<'a>(
    effects: &'a [ParameterEffect],
    total: &'a mut [f64],
) -> impl Iterator<Item = (usize, &'a mut f64)> {
    effects.iter().zip(total).filter_map(|(effect, total)| Some((effect.scene_parameter?, total)))
}

/// The derivative f_p·force of the residual with respect to the parameter of `effect`, along `force`.
fn parameter_force_along(
    at: &OutputContext<'_>,
    effect: &ParameterEffect,
    shape: &ActuationShape,
    force: &[f64],
) -> f64 {
    let DeformedRod { dynamics, .. } = at.bent;
    let (rod, kappa) = (&dynamics.model.rod, at.bent.kappa());
    let mut sum = effect.key.map_or(0.0, |key| dot(at.point.by_key(key), force));
    for k in effect.joints.clone() {
        let deviation = kappa[k] - dynamics.natural[k] + at.bent.resisted_curvature(k);
        let size = effect.stiffness(k) * deviation
            - rod.joint[k] * effect.natural(shape, k)
            - at.bent.resisted_natural_rate(k) * effect.rate(shape, k);
        sum += size * at.point.gather(k, force);
    }
    sum
}

/// What the direct contribution of a step to an output depends on: the drive at both ends of the step, the parameters, the
/// evaluation of the output, and the directions of joints.
type StepContribution<'a> = ([&'a ActuationShape; 2], &'a [Parameter], &'a OutputContext<'a>, &'a [JointDirection]);

/// Adds an output's gradient to the cotangents and to the totals.
fn accumulate(
    gradient: &Gradient,
    effects: &[ParameterEffect],
    shape: &ActuationShape,
    step: Option<StepContribution<'_>>,
    bar: &mut TangentState,
    total: &mut [f64],
) {
    bar.q.iter_mut().zip(&gradient.q).for_each(|(bar, g)| *bar += g);
    bar.v.iter_mut().zip(&gradient.v).for_each(|(bar, g)| *bar += g);
    bar.a.iter_mut().zip(&gradient.a).for_each(|(bar, g)| *bar += g);
    for (j, (total, effect)) in total.iter_mut().zip(effects).enumerate() {
        let step = step.map(|(ends, parameters, at, directions)| (ends, parameters[j], at, directions));
        *total += direct(gradient, effect, shape, step);
    }
}

/// The transpose of the initial step: transfers the cotangents of the initial accelerations to positions and velocities, and
/// writes the cotangent of the residual to `force`.
fn initial_cotangents(
    at: &OutputContext<'_>,
    equations: &mut Equations,
    bar: &mut TangentState,
    force: &mut [f64],
    held: bool,
    integrator: &dyn Integrator,
) -> Result<()> {
    let remembers = integrator.rule(1.0).is_some_and(|rule| rule.memory.is_some());
    for (i, force) in force.iter_mut().enumerate() {
        *force = -(bar.a[i] + if remembers { bar.memory[i] } else { 0.0 });
    }
    if held {
        force[..2].fill(0.0);
    }
    equations.divide_by_inertia(&at.bent.dynamics.model.rod.mass, force)?;
    let minus: Vec<f64> = force.iter().map(|x| -x).collect();
    equations.add_differences_transposed(&minus, &mut bar.q);
    bar.v.iter_mut().zip(equations.damp(force, true)).for_each(|(bar, damped)| *bar += damped);
    Ok(())
}
