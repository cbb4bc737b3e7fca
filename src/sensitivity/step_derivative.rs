//! The derivative of a communication step: how the state at its end, and what is read there, follow from the state at its beginning and from
//! the inputs that are given for it.
//!
//! A step leads from the state z to z⁺ = Φ(z, u) and is read as y⁺ = g(z⁺, u). Its derivatives A = ∂z⁺/∂z, B = ∂z⁺/∂u, C = ∂y⁺/∂z and
//! D = ∂y⁺/∂u are those of the internal steps that were made, whether the step was halved or its parts were chosen by a tolerance: each
//! implicit stage is linearised where it converged, its matrix is factored once, and each direction is one solve (see the
//! [module above](super) for the equations).
//!
//! An input acts as if a host had set it at the beginning: accelerations follow it there, by the equation of motion.

use nalgebra::{DMatrix, Vector2};

use super::equations::Equations;
use super::output::LocalDerivatives;
use crate::error::{Error, Result};
use crate::linear::Direction;
use crate::model::{DeformedRod, Dynamics};
use crate::rod::add;
use crate::stepper::derivatives::{InputDirection, StateTangent};
use crate::stepper::{Coordinate, Entry, LastDerivatives, StateCoordinates, Stepper};
use crate::system::{State, System};
use crate::variable::{Causality, Size, Variable};

/// The derivatives of a step; rows and columns are in the order of `states`, `inputs` and `outputs`.
#[derive(Debug, Clone, PartialEq)]
pub struct StepDerivative {
    /// The coordinates z, those of the nodes that nothing holds.
    pub states: Vec<Entry>,
    /// The inputs u.
    pub inputs: Vec<Entry>,
    /// The outputs y.
    pub outputs: Vec<Entry>,
    /// ∂z⁺/∂z.
    pub a: DMatrix<f64>,
    /// ∂z⁺/∂u.
    pub b: DMatrix<f64>,
    /// ∂y⁺/∂z.
    pub c: DMatrix<f64>,
    /// ∂y⁺/∂u.
    pub d: DMatrix<f64>,
}

impl Stepper {
    /// Makes a step of `h` (s) as [`do_step`](Self::do_step) does, to the bit, and returns its derivatives by the state in these
    /// `coordinates` and by `inputs`: of that state, and of `outputs`. To stay, [`save`](Self::save) before and
    /// [`restore`](Self::restore) after.
    ///
    /// # Errors
    /// [`Error::Derivative`] for a reduced model, an explicit method, an input that the step does not depend on smoothly, and an output that
    /// is a total; [`Error::UnknownVariable`], [`Error::NotAnInput`]; those of [`do_step`](Self::do_step). The stepper is then
    /// as it was before the call.
    pub fn linearise(
        &mut self,
        h: f64,
        coordinates: StateCoordinates,
        inputs: &[&str],
        outputs: &[&str],
    ) -> Result<StepDerivative> {
        let outputs = outputs.iter().map(|name| self.output_of_one_time(name)).collect::<Result<Vec<_>>>()?;
        let inputs = inputs.iter().map(|name| self.input(name)).collect::<Result<Vec<_>>>()?;
        let states = self.coordinates(coordinates);
        let entries = |variables: &[&'static Variable]| -> Vec<(&'static Variable, usize)> {
            let of = |variable: &&'static Variable| {
                let variable = *variable;
                variable.entries(self.model()).map(move |k| (variable, k))
            };
            variables.iter().flat_map(of).collect()
        };
        let (given, read) = (entries(&inputs), entries(&outputs));
        let unit_state = |coordinate: &Coordinate| {
            let mut unit = self.zero_state();
            coordinate.set(&mut unit, 1.0);
            unit
        };
        let starts: Vec<State> = states.iter().map(unit_state).collect();
        let ends = self.step_along(h, coordinates, starts, &given)?;
        let mut found = StepDerivative {
            states: self.state_entries(coordinates),
            inputs: given.iter().map(|entry| entry_of(*entry)).collect(),
            outputs: read.iter().map(|entry| entry_of(*entry)).collect(),
            a: DMatrix::zeros(states.len(), states.len()),
            b: DMatrix::zeros(states.len(), given.len()),
            c: DMatrix::zeros(read.len(), states.len()),
            d: DMatrix::zeros(read.len(), given.len()),
        };
        for (j, (end, input)) in ends.iter().enumerate() {
            let (to, readings, j) = match j.checked_sub(states.len()) {
                None => (&mut found.a, &mut found.c, j),
                Some(j) => (&mut found.b, &mut found.d, j),
            };
            for (i, coordinate) in states.iter().enumerate() {
                to[(i, j)] = coordinate.of(end);
            }
            if read.is_empty() {
                continue;
            }
            let changes = self.along_step(end, input.as_ref())?;
            for (i, (variable, k)) in read.iter().enumerate() {
                readings[(i, j)] = changes.of(variable, *k).unwrap_or_default();
            }
        }
        Ok(found)
    }

    /// Adds, for each of `outputs` (variables at nodes), its change with the poses of a head that were given for the end of the communication
    /// step that led here (`head.input = "at-end"`), each with its `seed`: the interface Jacobian of that step. What was
    /// [set](Self::set) with a rate or an acceleration is an input of its own.
    ///
    /// The step is made once more for it, to the same bits; a further call is read from what the first has found.
    ///
    /// # Errors
    /// [`Error::Derivative`] where no step led here, or something was set or restored since; for an input that was not given for
    /// that step, and for an output that is a total.
    pub fn add_through_last_step(
        &mut self,
        given: &[(&'static Variable, f64)],
        outputs: &[Option<(&'static Variable, usize)>],
        out: &mut [f64],
    ) -> Result<()> {
        if let Some((total, _)) = outputs.iter().flatten().find(|(variable, _)| variable.is_total()) {
            self.output_of_one_time(total.name)?;
        }
        if self.last_derivatives_mut().is_none() {
            let found = self.last_step_along_head()?;
            *self.last_derivatives_mut() = Some(found);
        }
        // Out of the way of the stepper.
        let Some(known) = self.last_derivatives_mut().take() else { return Ok(()) };
        let mut add = || {
            for (variable, seed) in given {
                let Some((_, end, direction)) = known.iter().find(|(own, ..)| own.name == variable.name) else {
                    let problem = format!(
                        "no derivative by {}, which was not given for the step that led here; allowed: an input that was set for it",
                        variable.name
                    );
                    return Err(Error::Derivative { problem });
                };
                let changes = self.along_step(end, Some(direction))?;
                for (out, output) in out.iter_mut().zip(outputs) {
                    *out += seed * output.and_then(|(variable, k)| changes.of(variable, k)).unwrap_or_default();
                }
            }
            Ok(())
        };
        let outcome = add();
        *self.last_derivatives_mut() = Some(known);
        outcome
    }

    /// Makes the last communication step once more, and follows the inputs of the head that were given for it.
    fn last_step_along_head(&mut self) -> Result<Box<LastDerivatives>> {
        let there = self.save();
        let Some(h) = self.return_to_last_step() else {
            let problem = "no step led here since something was last set or restored; allowed: right after a step";
            return Err(Error::Derivative { problem: problem.to_string() });
        };
        let jump = self.take_head_jump();
        let given: Vec<_> = self.given_head_inputs().into_iter().map(|variable| (variable, 0)).collect();
        let found = self.step_along(h, StateCoordinates::Full, Vec::new(), &given);
        if found.is_err() || self.time() != there.time() {
            self.restore(&there)?;
        }
        self.put_head_jump(jump);
        let found = given
            .into_iter()
            .zip(found?)
            .filter_map(|((variable, _), (end, direction))| Some((variable, end, direction?)));
        Ok(Box::new(found.collect()))
    }

    fn input(&self, name: &str) -> Result<&'static Variable> {
        let variable = self.find(name)?;
        if variable.is_input() { Ok(variable) } else { Err(Error::NotAnInput(variable.name)) }
    }

    fn output_of_one_time(&self, name: &str) -> Result<&'static Variable> {
        let variable = self.find(name)?;
        if !variable.is_total() && variable.causality == Causality::Output {
            return Ok(variable);
        }
        let problem = format!(
            "{name} has no derivative of a step: allowed are outputs of one time, no totals since the start, no averages of cycles and no \
             parameters"
        );
        Err(Error::Derivative { problem })
    }

    fn zero_state(&self) -> State {
        let State { q, memory, .. } = self.state();
        State { memory: vec![0.0; memory.len()], ..State::zeros(q.len()) }
    }

    /// Makes a step of `h` (s) and returns what becomes of `starts`, which are changes of the state at its beginning, and of a unit of each
    /// entry of inputs in `given`.
    fn step_along(
        &mut self,
        h: f64,
        coordinates: StateCoordinates,
        starts: Vec<State>,
        given: &[(&'static Variable, usize)],
    ) -> Result<Vec<(State, Option<InputDirection>)>> {
        let Some(stages) = self.integrator().map(|integrator| integrator.stages(h)) else {
            let problem = "a step of a reduced model has no derivative; allowed: solver.model = \"full\"".to_string();
            return Err(Error::Derivative { problem });
        };
        if stages.is_none() {
            let problem = "a step of an explicit method has no derivative; allowed: solver.integrator = \"implicit-euler\", \"newmark\", \
                           \"generalized-alpha\" or \"esdirk3\"";
            return Err(Error::Derivative { problem: problem.to_string() });
        }
        if !(h.is_finite() && h > 0.0) {
            return Err(Error::Step(h));
        }
        let first = |variable: &Variable| variable.entries(self.model()).start;
        let firsts: Vec<usize> = given.iter().map(|(variable, _)| first(variable)).collect();
        let mut columns: Vec<Column> =
            starts.into_iter().map(|start| Column::new(start, None, coordinates == StateCoordinates::Motion)).collect();
        for ((variable, k), first) in given.iter().zip(firsts) {
            let direction = self.input_direction(variable, k - first, h)?;
            let tangent = self.zero_tangent();
            let jumps = !direction.is_of_head();
            let input = Input { direction, tangent };
            columns.push(Column::new(self.zero_state(), Some(input), jumps));
        }
        let saved = self.save();
        let mut following = Following::new(self, columns)?;
        let mut failed = None;
        let outcome = self.do_step_with(h, |stepper| match following.follow(stepper) {
            Ok(()) => std::ops::ControlFlow::Continue(()),
            Err(error) => {
                failed = Some(error);
                std::ops::ControlFlow::Break(())
            }
        });
        if let Some(error) = failed {
            self.restore(&saved)?;
            return Err(error);
        }
        outcome?;
        self.return_to_now()?;
        Ok(following
            .columns
            .into_iter()
            .map(|Column { now, input, .. }| (now, input.map(|input| input.direction)))
            .collect())
    }
}

fn entry_of((variable, k): (&'static Variable, usize)) -> Entry {
    let scalar = variable.size == Size::Scalar;
    let name = if scalar { variable.name.to_string() } else { format!("{}[{k}]", variable.name) };
    Entry { name, unit: variable.unit }
}

/// An input that a column follows, and what it changes at the time that is looked at.
#[derive(Debug)]
struct Input {
    direction: InputDirection,
    tangent: Box<StateTangent>,
}

/// A change of the state, on its way through a step.
#[derive(Debug)]
struct Column {
    now: State,
    /// The stages of the internal step.
    stages: Vec<State>,
    input: Option<Input>,
    /// −A ∂f/∂u of the input in each stage, and what it moves the head by.
    forces: Vec<Vec<f64>>,
    heads: Vec<[[f64; 2]; 3]>,
    /// Its accelerations follow from the equation of motion before the first internal step.
    consistent: bool,
}

impl Column {
    fn new(now: State, input: Option<Input>, consistent: bool) -> Self {
        Self { now, stages: Vec::new(), input, forces: Vec::new(), heads: Vec::new(), consistent }
    }
}

/// All changes that are followed through a step, and the linearised equations of its stages.
#[derive(Debug)]
struct Following {
    columns: Vec<Column>,
    equations: Vec<Equations>,
    states: Vec<State>,
    start: Equations,
    point: LocalDerivatives,
    /// The state at the end of the internal step before, or at the beginning.
    last: State,
    begun: bool,
    rhs: Vec<f64>,
}

impl Following {
    fn new(stepper: &Stepper, columns: Vec<Column>) -> Result<Self> {
        let model = stepper.model();
        Ok(Self {
            columns,
            equations: Vec::new(),
            states: Vec::new(),
            start: Equations::new(model)?,
            point: LocalDerivatives::new(model.rod.nodes, &[]),
            last: stepper.state().clone(),
            begun: false,
            rhs: vec![0.0; model.unknowns()],
        })
    }

    /// Follows the internal step that `stepper` has just made.
    fn follow(&mut self, stepper: &mut Stepper) -> Result<()> {
        let (Some(from), to) = (stepper.previous().cloned(), stepper.state().clone()) else { return Ok(()) };
        let h = to.t - from.t;
        let Some(stages) = stepper.integrator().and_then(|integrator| integrator.stages(h)) else { return Ok(()) };
        let model = std::sync::Arc::clone(&stepper.dynamics_mut().model);
        while self.equations.len() < stages.count {
            self.equations.push(Equations::new(&model)?);
            self.states.push(to.clone());
        }
        for column in &mut self.columns {
            column.stages.resize_with(stages.count, || column.now.clone());
            column.forces.resize_with(stages.count, || vec![0.0; model.unknowns()]);
            column.heads.resize(stages.count, [[0.0; 2]; 3]);
        }
        // Accelerations follow anew where they jump, of all columns where they did in the step itself.
        let jumped = from.a != self.last.a;
        if jumped || !self.begun {
            self.reinitialise(stepper.dynamics_mut(), &from, jumped)?;
        }
        self.begun = true;
        if let Some(integrator) = stepper.integrator() {
            integrator.write_stages(&from, h, &to, &mut self.states);
        }
        let dynamics = stepper.dynamics_mut();
        for (i, (state, equations)) in self.states.iter_mut().zip(&mut self.equations).enumerate() {
            // Linearised in positions.
            state.links.clear();
            dynamics.move_to(state.t, state);
            equations.assemble(dynamics, state, stages.direction)?;
            look_at_inputs(dynamics, state, &mut self.columns, &mut self.point, |column, force, head| {
                force.iter_mut().for_each(|force| *force *= -stages.direction.q);
                std::mem::swap(&mut column.forces[i], force);
                column.heads[i] = head;
            })?;
        }
        let held = dynamics.held.is_some();
        let integrator = stepper.integrator();
        let Some(integrator) = integrator else { return Ok(()) };
        let Self { columns, equations, rhs, .. } = self;
        let (mut factored, mut failed) = (0, None);
        for Column { now, stages: own, forces, heads, .. } in columns {
            integrator.step_linear(now, h, own, &mut |i, state| {
                let (equations, [q, v, a]) = (&mut equations[i], heads[i]);
                state.a.fill(0.0);
                if held {
                    state.q[..2].copy_from_slice(&q);
                    state.v[..2].copy_from_slice(&v);
                    state.a[..2].copy_from_slice(&a);
                }
                equations.differences(&state.q, rhs);
                let (along, damped) = (stages.direction, equations.damp(&state.v, false));
                rhs.iter_mut()
                    .zip(damped)
                    .zip(&forces[i])
                    .for_each(|((rhs, damped), force)| *rhs += force - along.q * damped);
                if held {
                    if a != [0.0; 2] {
                        let accelerated = equations.accelerate(&state.a);
                        rhs.iter_mut().zip(accelerated).for_each(|(rhs, by)| *rhs -= along.q * by);
                    }
                    rhs[..2].fill(0.0);
                }
                if i == factored {
                    if let Err(error) = equations.factor(rhs, false) {
                        failed = Some(error);
                    }
                    factored += 1;
                } else {
                    equations.solve(rhs, false);
                }
                for (((q, v), a), by) in state.q.iter_mut().zip(&mut state.v).zip(&mut state.a).zip(&*rhs) {
                    *q += by;
                    *a += by / along.q;
                    *v += along.v / along.q * by;
                }
            });
            if let Some(last) = own.last_mut() {
                std::mem::swap(now, last);
            }
        }
        self.last = to;
        match failed {
            Some(error) => Err(error),
            None => stepper.return_to_now(),
        }
    }

    /// Makes the accelerations of columns fulfil the equation of motion at `from` again: of `all`, or of those that begin so.
    fn reinitialise(&mut self, dynamics: &mut Dynamics, from: &State, all: bool) -> Result<()> {
        let mut state = from.clone();
        state.links.clear();
        dynamics.move_to(from.t, &mut state);
        let Self { columns, start, point, rhs, .. } = self;
        start.assemble(dynamics, &state, Direction::POSITIONS)?;
        let by_flow = flow_jump_force(dynamics, &state)?;
        look_at_inputs(dynamics, &state, columns, point, |column, force, head| {
            std::mem::swap(&mut column.forces[0], force);
            column.heads[0] = head;
        })?;
        let (masses, held) = (&dynamics.model.rod.mass, dynamics.held.is_some());
        for column in columns.iter_mut().filter(|column| all || column.consistent) {
            let Column { now, forces, heads, input, .. } = column;
            let flow = input.as_ref().map_or([0.0; 2], |input| input.direction.flow());
            if !self.begun
                && flow != [0.0; 2]
                && let Some(by) = &by_flow
            {
                // A jump of the flow accelerates what moves with the water at once.
                rhs.fill(0.0);
                for (axis, by) in by.iter().enumerate() {
                    rhs.iter_mut().zip(by).for_each(|(rhs, by)| *rhs -= flow[axis] * by);
                }
                if held {
                    rhs[..2].fill(0.0);
                }
                start.divide_by_inertia(masses, rhs)?;
                now.v.iter_mut().zip(&*rhs).for_each(|(v, by)| *v += by);
            }
            let [q, v, a] = heads[0];
            if held {
                now.q[..2].copy_from_slice(&q);
                now.v[..2].copy_from_slice(&v);
            }
            start.differences(&now.q, rhs);
            rhs.iter_mut()
                .zip(start.damp(&now.v, false))
                .zip(&forces[0])
                .for_each(|((rhs, by), force)| *rhs -= by + force);
            if held {
                if a != [0.0; 2] {
                    let mut pulled = vec![0.0; rhs.len()];
                    pulled[..2].copy_from_slice(&a);
                    rhs.iter_mut().zip(start.accelerate(&pulled)).for_each(|(rhs, by)| *rhs -= by);
                }
                rhs[..2].fill(0.0);
            }
            start.divide_by_inertia(masses, rhs)?;
            if held {
                rhs[..2].copy_from_slice(&a);
            }
            for (w, (new, old)) in now.memory.iter_mut().zip(rhs.iter().zip(&now.a)) {
                *w += new - old; // as in the step itself
            }
            now.a.copy_from_slice(rhs);
        }
        Ok(())
    }
}

/// What a unit of acceleration of the flow changes the residual by, along both axes; `None` where nothing moves with the water.
fn flow_jump_force(dynamics: &mut Dynamics, state: &State) -> Result<Option<[Vec<f64>; 2]>> {
    if !dynamics.model.forces.are_inertial() {
        return Ok(None);
    }
    let steady = dynamics.inputs.fluid.acceleration;
    let residual = |dynamics: &mut Dynamics, by: Vector2<f64>| {
        let mut out = vec![0.0; state.q.len()];
        dynamics.inputs.fluid.acceleration = steady + by;
        let done = dynamics.unconstrained(state, &mut out[..2 * dynamics.model.rod.nodes], None);
        dynamics.inputs.fluid.acceleration = steady;
        done.map(|()| out)
    };
    let mut of = |by: Vector2<f64>| -> Result<Vec<f64>> {
        // Linear in it.
        let [more, less] = [residual(dynamics, by)?, residual(dynamics, -by)?];
        Ok(more.iter().zip(less).map(|(more, less)| 0.5 * (more - less)).collect())
    };
    Ok(Some([of(Vector2::x())?, of(Vector2::y())?]))
}

/// Finds what the inputs of `columns` change in `state`, which `dynamics` was moved to: shows `take` for each ∂f/∂u, which it may keep, and
/// how the head moves.
fn look_at_inputs(
    dynamics: &mut Dynamics,
    state: &State,
    columns: &mut [Column],
    point: &mut LocalDerivatives,
    mut take: impl FnMut(&mut Column, &mut Vec<f64>, [[f64; 2]; 3]),
) -> Result<()> {
    if columns.iter().all(|column| column.input.is_none()) {
        return Ok(());
    }
    for column in columns.iter_mut() {
        if let Some(Input { direction, tangent }) = &mut column.input {
            direction.evaluate(dynamics, state.t, tangent);
        }
    }
    let bent = dynamics.shape(state)?;
    point.look(&bent);
    let mut force = vec![0.0; state.q.len()];
    for column in columns.iter_mut() {
        let Some(Input { direction, tangent }) = &mut column.input else { continue };
        direction.follow(&bent, tangent);
        force.resize(state.q.len(), 0.0);
        force.fill(0.0);
        add_input_force(&bent, tangent, point, &mut force);
        let head = tangent.head();
        take(column, &mut force, head);
    }
    Ok(())
}

/// Adds ∂f/∂u of an input to `force`, with its equation of a hinge.
fn add_input_force(bent: &DeformedRod<'_>, tangent: &StateTangent, point: &LocalDerivatives, force: &mut [f64]) {
    let (rod, nodes) = (&bent.dynamics.model.rod, bent.dynamics.model.rod.nodes);
    tangent.add_applied(bent, &mut force[..2 * nodes]);
    let [natural, rate] = tangent.natural();
    for k in rod.joints() {
        let size = -rod.joint[k] * natural[k] - bent.resisted_natural_rate(k) * rate[k];
        if size != 0.0 {
            point.scatter(k, size, force);
        }
    }
    let [angle, spin] = tangent.head_turn();
    if angle != 0.0 || spin != 0.0 {
        let edge = &bent.edges()[0];
        let viscosity = bent.dynamics.damped().map_or(0.0, |damped| damped.rates.viscosity[0]);
        let couple = bent.joint(0).stiffness * angle + viscosity * spin;
        add(force, 1, -edge.n() * (edge.per_length * couple));
    }
    if let Some(arc) = force.get_mut(2 * nodes) {
        *arc -= tangent.torque(bent) / rod.length;
    }
}
