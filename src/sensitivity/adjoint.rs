//! Derivatives of one number by all parameters: back over a stored simulation, one transposed solve a step.

use super::controls::{Controls, Cotangents, Weights};
use super::ends::Ends;
use super::equations::Equations;
use super::output::{At, Gradient, Output, Point};
use super::parameter::{Effect, Parameter, Shape, direct, keys};
use super::problem::Problem;
use super::trajectory::Trajectory;
use super::{Column, dot, start};
use crate::error::{Error, Result};
use crate::integrator::{Integrator, StepWeights};
use crate::linear::Direction;
use crate::model::DeformedRod;
use crate::system::{State, System};

impl Problem {
    /// The derivatives by all `parameters` of Σ w y over all times and outputs y of the stored simulation `trajectory`
    /// of this problem, with `weights` w, one row per time.
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
        let weights = Weights { outputs: weights, ..Weights::default() };
        Ok(self.go_back(parameters, outputs, weights, trajectory, false)?.parameters)
    }

    /// The same with `weights` of positions and velocities too, and the derivatives by first state and controls, given or not,
    /// beside those by the `parameters`.
    ///
    /// # Errors
    /// Those of [`adjoint`](Self::adjoint).
    pub fn pull_back(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: Weights<'_>,
        trajectory: &Trajectory,
    ) -> Result<Cotangents> {
        self.go_back(parameters, outputs, weights, trajectory, true)
    }

    fn go_back(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: Weights<'_>,
        trajectory: &Trajectory,
        by_controls: bool,
    ) -> Result<Cotangents> {
        self.check(parameters, outputs)?;
        let (nodes, steps) = (self.dynamics.nodes(), self.steps);
        let times = steps.count() + 1;
        let given = [weights.outputs, weights.positions, weights.velocities];
        for (values, width) in given.iter().zip([outputs.len(), 2 * nodes, 2 * nodes]) {
            if !values.is_empty() && values.len() != times * width {
                let (expected, found) = (times * width, values.len());
                return Err(Error::WrongLength { name: "weights", expected, found });
            }
        }
        let (rules, go_on) = (self.rules()?, self.go_on());
        let summing = outputs.iter().any(|output| !output.work.is_empty());
        let mut equations = Equations::new(self.model())?;
        let mut point = Point::new(nodes, &keys(parameters));
        let mut shape = Shape::new(nodes);
        let mut ends = Ends::new(nodes);
        let mut gradient = Gradient::new(nodes, &keys(parameters));
        let mut effects: Vec<Effect> = Vec::with_capacity(parameters.len());
        let zeros = || vec![0.0; 2 * nodes];
        // The cotangents of a state, and of the one before it.
        let mut bar = Column { q: zeros(), v: zeros(), a: zeros(), memory: zeros() };
        let mut mu = zeros();
        let mut force = zeros();
        let mut total = vec![0.0; parameters.len()];
        let mut state = State::zeros(2 * nodes);
        let Self { dynamics, moved, controls, start: given, .. } = self;
        let mut scratch = Gradient::new(nodes, &[]);
        let held = dynamics.model.head.is_some();
        let joints = dynamics.model.rod.joints();
        let bends = if by_controls { Controls::effects(&dynamics.model.rod, &shape) } else { Vec::new() };
        let mut natural = vec![0.0; times * bends.len()];
        let mut by_force = vec![0.0; if by_controls { times * 2 * nodes } else { 0 }];
        let mut by_moved = vec![zeros(); moved.len()];
        // Weights of all later times, for what is summed or counted from the start.
        let mut later = vec![0.0; outputs.len()];
        for n in (0..=steps.count()).rev() {
            go_on()?;
            trajectory.load(n, &mut state);
            if summing {
                ends.look(dynamics, controls, steps, n);
            }
            controls.apply(dynamics, n);
            dynamics.move_to(state.t, &mut state);
            shape.take(dynamics, state.t);
            let rule = rules[usize::from(n > steps.whole)];
            let direction = match n {
                0 => Direction::POSITIONS,
                _ => Direction { q: rule.q_new, v: rule.v_new, a: 1.0 },
            };
            equations.assemble(dynamics, &state, direction)?;
            let bent = dynamics.shape(&state)?;
            point.look(&bent);
            effects.clear();
            effects.extend(parameters.iter().map(|parameter| parameter.effect(&bent.dynamics.model.rod, &shape)));
            let at = At { bent, point: &point };
            for (moved, by) in moved.iter_mut().zip(&mut by_moved) {
                moved.look(&bent, (controls, steps, n), summing, by)?;
            }
            for (bar, weights) in [(&mut bar.q, weights.positions), (&mut bar.v, weights.velocities)] {
                bar.iter_mut().zip(weights.iter().skip(2 * nodes * n)).for_each(|(bar, weight)| *bar += weight);
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
                    gather(&gradient, &effects, &shape, None, &mut bar, &mut total);
                    for (i, total) in of_scene(&effects, &mut total) {
                        *total += moved[i].output((output, &gradient, own), None, &point, &mut scratch)?;
                    }
                    for (j, (k, effect)) in joints.clone().zip(&bends).enumerate() {
                        natural[n * bends.len() + j] += gradient.natural[k] * effect.natural(&shape, k);
                    }
                    add_row(&mut by_force, n, &gradient.force);
                }
                for (i, factor) in [later[o], begun].into_iter().enumerate() {
                    let span = &ends.spans[i];
                    if output.work.is_empty() || span.h == 0.0 || factor == 0.0 {
                        continue;
                    }
                    gradient.clear();
                    for (c, work) in &output.work {
                        work.add(&at, span, i == 0, c * factor, &mut gradient);
                    }
                    let step = Some(([&ends.shapes[i], &ends.shapes[i + 1]], parameters, &at));
                    gather(&gradient, &effects, &shape, step, &mut bar, &mut total);
                    for (j, total) in of_scene(&effects, &mut total) {
                        *total += moved[j].output((output, &gradient, factor), Some(i), &point, &mut scratch)?;
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
                first_cotangents(&at, &mut equations, &mut bar, &mut force, held, self.integrator.as_ref())?;
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
                *total += pushed(&at, effect, &shape, &force);
            }
            for (i, total) in of_scene(&effects, &mut total) {
                *total += dot(&by_moved[i], &force);
            }
            for (by, effect) in natural.iter_mut().skip(n * bends.len()).zip(&bends) {
                *by += pushed(&at, effect, &shape, &force);
            }
            by_force.iter_mut().skip(2 * nodes * n).zip(&force).for_each(|(by, force)| *by -= force);
            if n == 0 {
                let by_natural = natural.iter_mut().zip(&bends);
                for (total, effect) in total.iter_mut().zip(&effects).chain(by_natural).filter(|(_, by)| by.bends()) {
                    let [mut q, mut v] = start::first_by(bent.dynamics, effect, &shape);
                    given.hold([&mut q, &mut v]);
                    *total += dot(&q, &bar.q) + dot(&v, &bar.v);
                }
                for (i, total) in of_scene(&effects, &mut total) {
                    let [mut q, mut v] = moved[i].first();
                    given.hold([&mut q, &mut v]);
                    *total += dot(&q, &bar.q) + dot(&v, &bar.v);
                }
            }
        }
        Ok(Cotangents { parameters: total, start: [bar.q, bar.v], natural, force: by_force })
    }
}

/// Adds `row` to row `n` of `rows`, where there are any.
fn add_row(rows: &mut [f64], n: usize, row: &[f64]) {
    rows.iter_mut().skip(n * row.len()).zip(row).for_each(|(to, from)| *to += from);
}

/// The numbers of the scene among the parameters, with their totals.
fn of_scene<'a>(effects: &'a [Effect], total: &'a mut [f64]) -> impl Iterator<Item = (usize, &'a mut f64)> {
    effects.iter().zip(total).filter_map(|(effect, total)| Some((effect.moved?, total)))
}

/// How `effect` moves the force f along `force`: f_p·force.
fn pushed(at: &At<'_>, effect: &Effect, shape: &Shape, force: &[f64]) -> f64 {
    let DeformedRod { dynamics, .. } = at.bent;
    let (rod, kappa) = (&dynamics.model.rod, at.bent.kappa());
    let mut sum = effect.key.map_or(0.0, |key| dot(at.point.by_key(key), force));
    for k in effect.joints.clone() {
        let deviation = kappa[k] - dynamics.natural[k];
        let size = effect.stiffness * deviation - rod.joint[k] * effect.natural(shape, k);
        sum += size * at.point.gather(k, force);
    }
    sum
}

/// Adds an output's gradient to the cotangents and to the totals.
fn gather(
    gradient: &Gradient,
    effects: &[Effect],
    shape: &Shape,
    step: Option<([&Shape; 2], &[Parameter], &At<'_>)>,
    bar: &mut Column,
    total: &mut [f64],
) {
    bar.q.iter_mut().zip(&gradient.q).for_each(|(bar, g)| *bar += g);
    bar.v.iter_mut().zip(&gradient.v).for_each(|(bar, g)| *bar += g);
    bar.a.iter_mut().zip(&gradient.a).for_each(|(bar, g)| *bar += g);
    for (j, (total, effect)) in total.iter_mut().zip(effects).enumerate() {
        *total += direct(gradient, effect, shape, step.map(|(ends, parameters, at)| (ends, parameters[j], at)));
    }
}

/// The transpose of it: moves the cotangents of the first accelerations to positions and velocities, and writes the force
/// that parameters push along.
fn first_cotangents(
    at: &At<'_>,
    equations: &mut Equations,
    bar: &mut Column,
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
