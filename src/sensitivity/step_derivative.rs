//! The derivative of a communication step: the change of the state and of the outputs at its end with the state at its beginning
//! and with the inputs that are given for it.
//!
//! A step maps the state z to z⁺ = Φ(z, u), with outputs y⁺ = g(z⁺, u). Its derivatives A = ∂z⁺/∂z, B = ∂z⁺/∂u, C = ∂y⁺/∂z and
//! D = ∂y⁺/∂u are those of the internal steps that were actually made, including halved steps and steps chosen by a tolerance:
//! each implicit stage is linearised where it converged, its matrix is factored once, and each direction is one solve (see the
//! [module above](super) for the equations).
//!
//! An input acts as if a host had set it at the beginning: accelerations follow it there, by the equation of motion, and
//! velocities follow a jump of the flow if the rod accelerates water. Without [`LinearisationRequest::jump`] the input is assumed
//! to be present before, and neither follows.

use nalgebra::{DMatrix, Vector2};

use super::equations::Equations;
use super::output::{Gradient, LocalDerivatives, Output, OutputContext};
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
    /// The coordinates z; held nodes have none.
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

/// The options of [`Stepper::linearise_as`].
#[derive(Debug, Clone, Copy)]
pub struct LinearisationRequest<'a> {
    /// The coordinates of the state.
    pub coordinates: StateCoordinates,
    /// Names of the inputs u. The derivative with respect to a pose of a driven head holds for changes of about 1e-4 of the
    /// length: the motion of the head between poses is extrapolated by a polynomial whose degree follows from the poses, and may
    /// differ for changes of other sizes.
    pub inputs: &'a [&'a str],
    /// Names of the outputs y.
    pub outputs: &'a [&'a str],
    /// True to compute the derivatives with respect to the state, A and C. Otherwise both have no columns, and neither time nor
    /// memory grows with the number of states: 3 MB for an input of a rod with 1001 nodes, instead of 0.5 GB.
    pub states: bool,
    /// True if inputs change at the beginning of the step, false if they had these values before it. A change moves the
    /// accelerations at the beginning, which are separate coordinates in [`StateCoordinates::Full`], and a change of flow also
    /// moves the velocities of a rod that accelerates water. With inputs that change at the first step and are constant
    /// afterwards, the matrices of successive steps compose: ∂z₂/∂u = A₂ B₁ + B₂, with B₁ computed with the jump and B₂ without.
    /// Poses of a head are given for each step; they are treated as if this were true.
    pub jump: bool,
}

impl<'a> LinearisationRequest<'a> {
    /// A request for the derivatives with respect to the state and to `inputs` that change at the beginning.
    pub fn new(coordinates: StateCoordinates, inputs: &'a [&'a str], outputs: &'a [&'a str]) -> Self {
        Self { coordinates, inputs, outputs, states: true, jump: true }
    }
}

impl Stepper {
    /// Makes a step of `h` (s), bit-identical to [`do_step`](Self::do_step), and returns the derivatives of the state and of
    /// `outputs` with respect to the state in these `coordinates` and to `inputs`. To keep the current state,
    /// [`save`](Self::save) before and [`restore`](Self::restore) after the call.
    ///
    /// # Errors
    /// Errors of [`linearise_as`](Self::linearise_as).
    pub fn linearise(
        &mut self,
        h: f64,
        coordinates: StateCoordinates,
        inputs: &[&str],
        outputs: &[&str],
    ) -> Result<StepDerivative> {
        self.linearise_as(h, &LinearisationRequest::new(coordinates, inputs, outputs))
    }

    /// The same as [`linearise`](Self::linearise), with all options.
    ///
    /// The matrices of successive steps compose, z₂ = A₂ A₁ z₀, in full coordinates for any method, and in positions and
    /// velocities for methods without a memory: Newmark's, implicit Euler and ESDIRK3. Generalized-α has a memory of
    /// accelerations that differ from those of the equation of motion, so that products of its A in positions and velocities
    /// describe another system.
    ///
    /// # Errors
    /// [`Error::Derivative`] for a reduced model, an explicit method, an input on which the step does not depend smoothly, and an
    /// output that is a total; also if the mesh is too fine for derivatives or memory is insufficient;
    /// [`Error::UnknownVariable`], [`Error::NotAnInput`]; errors of [`do_step`](Self::do_step). The stepper is then as it was
    /// before the call.
    pub fn linearise_as(&mut self, h: f64, asked: &LinearisationRequest<'_>) -> Result<StepDerivative> {
        let LinearisationRequest { coordinates, inputs, outputs, .. } = *asked;
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
        let starts = if asked.states { &states[..] } else { &[] };
        let ends = self.step_along(h, (coordinates, asked.jump), starts, &given, states.len() + read.len())?;
        let mut found = StepDerivative {
            states: self.state_entries(coordinates),
            inputs: given.iter().map(|entry| entry_of(*entry)).collect(),
            outputs: read.iter().map(|entry| entry_of(*entry)).collect(),
            a: DMatrix::zeros(states.len(), starts.len()),
            b: DMatrix::zeros(states.len(), given.len()),
            c: DMatrix::zeros(read.len(), starts.len()),
            d: DMatrix::zeros(read.len(), given.len()),
        };
        ends.write_rows(&states, [&mut found.a, &mut found.b]);
        let rest = self.read_by_gradients(&ends, &read, [&mut found.c, &mut found.d])?;
        for j in 0..ends.width {
            let (readings, input, j_read, rest) = match j.checked_sub(starts.len()) {
                None => (&mut found.c, None, j, &rest[0]),
                Some(j) => (&mut found.d, Some(&ends.inputs[j].direction), j, &rest[1]),
            };
            if rest.is_empty() {
                continue;
            }
            let changes = self.along_step(&ends.column(j), input)?;
            for i in rest {
                readings[(*i, j_read)] = changes.of(read[*i].0, read[*i].1).unwrap_or_default();
            }
        }
        Ok(found)
    }

    /// Adds, for each of `outputs` (variables at nodes), its change with the poses of a head that were given for the end of the
    /// last communication step (`head.input = "at-end"`), each with its `seed`: the interface Jacobian of that step. A rate or an
    /// acceleration that was [set](Self::set) is a separate input.
    ///
    /// The step is repeated for this, with identical bits; further calls reuse the result of the first.
    ///
    /// # Errors
    /// [`Error::Derivative`] if the current state is not the end of a step, or something was set or restored since; for an input
    /// that was not given for that step, and for an output that is a total.
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
        // Taken out of the stepper, which is borrowed below.
        let Some(known) = self.last_derivatives_mut().take() else { return Ok(()) };
        let mut add = || {
            for (variable, seed) in given {
                let Some((_, end, direction)) = known.iter().find(|(own, ..)| own.name == variable.name) else {
                    let problem = format!(
                        "no derivative by {}, which was not set for the last step; allowed: an input that was set for it",
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

    /// Repeats the last communication step, and differentiates it with respect to the inputs of the head that were given for it.
    fn last_step_along_head(&mut self) -> Result<Box<LastDerivatives>> {
        let there = self.save();
        let Some(h) = self.return_to_last_step() else {
            let problem = "no step was made since something was last set or restored; allowed: right after a step";
            return Err(Error::Derivative { problem: problem.to_string() });
        };
        let jump = self.take_head_jump();
        let given: Vec<_> = self.given_head_inputs().into_iter().map(|variable| (variable, 0)).collect();
        let found = self.step_along(h, (StateCoordinates::Full, true), &[], &given, 0);
        if found.is_err() || self.time() != there.time() {
            let mut kept = self.take_last_step();
            self.restore(&there)?;
            kept.size = Some(h);
            self.put_last_step(kept);
        }
        self.put_head_jump(jump);
        let ends = found?;
        let columns: Vec<State> = (0..ends.width).map(|j| ends.column(j)).collect();
        let given = given.into_iter().zip(columns).zip(ends.inputs);
        Ok(Box::new(given.map(|(((variable, _), end), input)| (variable, end, input.direction)).collect()))
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

    /// Adds the derivatives of those of the outputs `read` that have a gradient to `c`, and to `d` where inputs change them through the
    /// nodes alone. Returns the places of the others, for each.
    fn read_by_gradients(
        &mut self,
        ends: &Columns,
        read: &[(&'static Variable, usize)],
        [c, d]: [&mut DMatrix<f64>; 2],
    ) -> Result<[Vec<usize>; 2]> {
        let (mut rest, states) = ([Vec::new(), Vec::new()], c.ncols());
        let mut gradient = Gradient::new(self.model(), &[]);
        let mut point = LocalDerivatives::new(self.model().rod.nodes, &[]);
        let mut looked = false;
        for (i, (variable, _)) in read.iter().enumerate() {
            let output = Output::named(variable.name, self.model()).ok();
            let Some(output) = output.filter(|output| variable.size == Size::Scalar && output.work.is_empty()) else {
                rest.iter_mut().for_each(|rest| rest.push(i));
                continue;
            };
            let inputs = if output.now.iter().all(|(_, quantity)| quantity.is_of_nodes()) {
                states..ends.width
            } else {
                rest[1].push(i);
                states..states
            };
            let bent = self.bent_now()?;
            if !looked {
                point.look(&bent);
                looked = true;
            }
            gradient.clear();
            let at = OutputContext { bent, point: &point };
            output.now.iter().for_each(|(factor, quantity)| _ = quantity.add(&at, *factor, &mut gradient));
            gradient.follow_winches(&at.bent);
            let State { q, v, a, .. } = &ends.now;
            for (gradient, values) in [(&gradient.q, q), (&gradient.v, v), (&gradient.a, a)] {
                for (by, row) in gradient.iter().zip(values.chunks(ends.width)).filter(|(by, _)| **by != 0.0) {
                    row[..states].iter().enumerate().for_each(|(j, x)| c[(i, j)] += by * x);
                    row[inputs.clone()].iter().enumerate().for_each(|(j, x)| d[(i, j)] += by * x);
                }
            }
        }
        Ok(rest)
    }

    /// Makes a step of `h` (s) and returns its effect on a unit change of each of the coordinates `starts` at its beginning, and
    /// of each entry of inputs in `given`, which change there if they `jump`. For each column, `rows` numbers will be returned.
    fn step_along(
        &mut self,
        h: f64,
        (coordinates, jump): (StateCoordinates, bool),
        starts: &[Coordinate],
        given: &[(&'static Variable, usize)],
        rows: usize,
    ) -> Result<Columns> {
        let Some(stages) = self.integrator().map(|integrator| integrator.stages(h)) else {
            let problem = "a step of a reduced model has no derivative; allowed: solver.model = \"full\"".to_string();
            return Err(Error::Derivative { problem });
        };
        let Some(stages) = stages else {
            let problem = "a step of an explicit method has no derivative; allowed: solver.integrator = \"implicit-euler\", \"newmark\", \
                           \"generalized-alpha\" or \"esdirk3\"";
            return Err(Error::Derivative { problem: problem.to_string() });
        };
        if !(h.is_finite() && h > 0.0) {
            return Err(Error::Step(h));
        }
        if self.restarts_in(h) {
            let problem = "this step restarts the run with the pose that is given for its end; allowed: linearise from the next step on";
            return Err(Error::Derivative { problem: problem.to_string() });
        }
        if self.flow_jumps_in_water() {
            let problem = "the flow jumps at the beginning of this step, where it accelerates water, which has no derivative; allowed: a step by \
                           do_step before, or a flow that was set with its rate";
            return Err(Error::Derivative { problem: problem.to_string() });
        }
        self.reserve(starts.len() + given.len(), stages.count, rows)?;
        let mut inputs = Vec::with_capacity(given.len());
        for (variable, k) in given {
            let first = variable.entries(self.model()).start;
            let direction = self.input_direction(variable, k - first, h)?;
            inputs.push(Input { direction, force: Vec::new(), head: Default::default() });
        }
        let width = starts.len() + inputs.len();
        let State { q, memory, .. } = self.state();
        let mut now = State { memory: vec![0.0; width * memory.len()], ..State::zeros(width * q.len()) };
        starts.iter().enumerate().for_each(|(j, start)| start.set_of_many(&mut now, j, width, 1.0));
        let consistent = (0..width)
            .map(|j| match j.checked_sub(starts.len()) {
                // Accelerations that are coordinates follow an input only if it changes.
                None => coordinates == StateCoordinates::Motion,
                Some(j) => (jump || coordinates == StateCoordinates::Motion) && !inputs[j].direction.is_of_head(),
            })
            .collect();
        let saved = self.save();
        let mut columns = Columns {
            now,
            width,
            inputs,
            consistent,
            jump,
            stages: Vec::new(),
            equations: vec![Equations::new(self.model())?],
            states: Vec::new(),
            point: LocalDerivatives::new(self.model().rod.nodes, &[]),
            reinitialisations: self.reinitialisations(),
            begun: false,
            rhs: vec![0.0; width * self.model().unknowns()],
            begins: Vec::new(),
        };
        let mut failed = None;
        let outcome = self.do_step_with(h, |stepper| match columns.follow(stepper) {
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
        if !columns.begun && columns.consistent.contains(&true) {
            // No internal step was made: only the time has advanced.
            let state = self.state().clone();
            let mut tangent = self.take_tangent();
            columns.reinitialise(self.dynamics_mut(), &mut tangent, &state, false)?;
        }
        self.return_to_now()?;
        Ok(columns)
    }
}

/// Rows that are copied to a matrix together: its columns are contiguous, and here the rows are.
const ROWS_AT_ONCE: usize = 8;

/// Number of copies of a matrix in memory, including those made for a host's language.
const COPIES: usize = 3;

impl Stepper {
    /// Returns an error if memory is insufficient for `width` columns through steps of that many `stages`, and for the `rows`
    /// numbers returned for each.
    fn reserve(&self, width: usize, stages: usize, rows: usize) -> Result<()> {
        let State { q, memory, .. } = self.state();
        // State and stages; the right-hand side, its initial value and work arrays of refinement.
        let parts = (stages + 1) * (3 * q.len() + memory.len()) + 7 * q.len() + COPIES * rows;
        let bytes = width.saturating_mul(parts).saturating_mul(size_of::<f64>());
        if Vec::<u8>::new().try_reserve_exact(bytes).is_ok() {
            return Ok(());
        }
        let problem = format!(
            "the derivatives of this step along {width} directions need {:.1} GB of memory, which is not available; allowed: fewer inputs, or those by \
             inputs without those by the state",
            bytes as f64 / 1e9
        );
        Err(Error::Derivative { problem })
    }
}

fn entry_of((variable, k): (&'static Variable, usize)) -> Entry {
    Entry { variable: variable.name, index: (variable.size != Size::Scalar).then_some(k), unit: variable.unit }
}

/// An input that a column belongs to, and its effect at the current time.
#[derive(Debug)]
struct Input {
    direction: InputDirection,
    /// ∂f/∂u.
    force: Vec<f64>,
    /// Motion of the head.
    head: [[f64; 2]; 3],
}

/// Changes of the state during a step, stored side by side: entry `i` of column `j` is at `i·width + j`. Columns of inputs come
/// last.
#[derive(Debug)]
struct Columns {
    now: State,
    width: usize,
    inputs: Vec<Input>,
    /// True for columns whose initial accelerations follow from the equation of motion.
    consistent: Vec<bool>,
    /// True if inputs change at the beginning.
    jump: bool,
    /// For each stage of the internal step: the columns, the linearised equations, and the state.
    stages: Vec<State>,
    equations: Vec<Equations>,
    states: Vec<State>,
    point: LocalDerivatives,
    /// How often the stepper had recomputed its accelerations at the end of the previous internal step.
    reinitialisations: u64,
    begun: bool,
    rhs: Vec<f64>,
    /// The positions at the beginning of the internal step.
    begins: Vec<f64>,
}

impl Columns {
    /// Column `j` at the end of the last internal step.
    fn column(&self, j: usize) -> State {
        let of = |values: &[f64]| values.iter().skip(j).step_by(self.width).copied().collect();
        let State { q, v, a, memory, .. } = &self.now;
        State { q: of(q), v: of(v), a: of(a), memory: of(memory), ..State::default() }
    }

    /// Writes the rows of these `states` to `a` and `b`, whose columns follow each other here.
    fn write_rows(&self, states: &[Coordinate], [a, b]: [&mut DMatrix<f64>; 2]) {
        let (width, first) = (self.width, self.width - self.inputs.len());
        for (written, states) in states.chunks(ROWS_AT_ONCE).enumerate() {
            let rows: Vec<_> = states.iter().map(|state| state.row_of_many(&self.now, width)).collect();
            for (to, columns) in [(&mut *a, 0..first), (&mut *b, first..width)] {
                for (mut to, j) in to.column_iter_mut().zip(columns) {
                    let to = to.as_mut_slice().iter_mut().skip(written * ROWS_AT_ONCE);
                    to.zip(&rows)
                        .for_each(|(to, (row, scale))| *to = if *scale == 1.0 { row[j] } else { row[j] / scale });
                }
            }
        }
    }

    /// Follows the internal step that `stepper` has just made.
    fn follow(&mut self, stepper: &mut Stepper) -> Result<()> {
        let (Some(from), to) = (stepper.previous().cloned(), stepper.state().clone()) else { return Ok(()) };
        if self.width == 0 {
            return Ok(());
        }
        let h = to.t - from.t;
        let Some(stages) = stepper.integrator().and_then(|integrator| integrator.stages(h)) else { return Ok(()) };
        while self.states.len() < stages.count {
            if self.equations.len() == self.states.len() {
                self.equations.push(Equations::new(stepper.model())?);
            }
            self.states.push(to.clone());
            self.stages.push(self.now.clone());
        }
        let mut tangent = stepper.take_tangent();
        // Accelerations are recomputed where they jump, in all columns if the step itself recomputed them.
        let jumped = stepper.reinitialisations() != self.reinitialisations;
        self.reinitialisations = stepper.reinitialisations();
        if jumped || !self.begun && self.consistent.contains(&true) {
            self.reinitialise(stepper.dynamics_mut(), &mut tangent, &from, jumped)?;
        }
        self.begun = true;
        if let Some(integrator) = stepper.integrator() {
            integrator.write_stages(&from, h, &to, &mut self.states);
        }
        let mut given = Vec::with_capacity(stages.count);
        let dynamics = stepper.dynamics_mut();
        for (state, equations) in self.states.iter_mut().zip(&mut self.equations) {
            // The linearisation is in positions.
            state.links.clear();
            dynamics.move_to(state.t, state);
            equations.assemble(dynamics, state, stages.direction)?;
            look_at_inputs(dynamics, state, &mut self.inputs, &mut self.point, &mut tangent)?;
            given.push(self.inputs.iter().map(|input| (input.force.clone(), input.head)).collect::<Vec<_>>());
        }
        let (held, model) = (dynamics.held.is_some(), std::sync::Arc::clone(&dynamics.model));
        let Some(integrator) = stepper.integrator() else { return Ok(()) };
        let Self { now, stages: own, equations, rhs, width, inputs, begins, .. } = self;
        let (width, first) = (*width, *width - inputs.len());
        begins.clone_from(&now.q);
        let mut outcome = Ok(());
        integrator.step_linear(now, h, own, &mut |i, state| {
            if outcome.is_ok() {
                let given = given[i].iter().map(|(force, head)| (&force[..], head));
                let stage = StageSolve { along: stages.direction, masses: &model.rod.mass, held, width, first };
                outcome = stage.solve(&mut equations[i], given, begins, state, rhs);
            }
        });
        outcome?;
        if let Some(last) = own.last_mut() {
            std::mem::swap(now, last);
        }
        stepper.put_tangent(tangent);
        stepper.return_to_now()
    }

    /// Makes the accelerations of columns satisfy the equation of motion at `from` again: of `all` columns, or of those that
    /// begin so.
    fn reinitialise(
        &mut self,
        dynamics: &mut Dynamics,
        tangent: &mut StateTangent,
        from: &State,
        all: bool,
    ) -> Result<()> {
        let mut state = from.clone();
        state.links.clear();
        dynamics.move_to(from.t, &mut state);
        let Self { now, width, inputs, consistent, equations, point, rhs, begun, jump, .. } = self;
        // Before the stages need it.
        let [start, ..] = &mut equations[..] else { return Ok(()) };
        let (width, first) = (*width, *width - inputs.len());
        start.assemble(dynamics, &state, Direction::POSITIONS)?;
        look_at_inputs(dynamics, &state, inputs, point, tangent)?;
        let held = dynamics.held.is_some();
        let flows = || inputs.iter().map(|input| input.direction.flow());
        if *jump
            && !*begun
            && flows().any(|flow| flow != [0.0; 2])
            && let Some(by) = flow_jump_force(dynamics, &state)?
        {
            // A jump of the flow immediately accelerates bodies that move with the water.
            for (j, flow) in flows().enumerate() {
                let mut faster = vec![0.0; state.q.len()];
                for (flow, by) in flow.iter().zip(&by) {
                    faster.iter_mut().zip(by).for_each(|(rhs, by)| *rhs -= flow * by);
                }
                if held {
                    faster[..2].fill(0.0);
                }
                start.divide_by_inertia(&dynamics.model.rod.mass, &mut faster)?;
                now.v.iter_mut().skip(first + j).step_by(width).zip(faster).for_each(|(v, by)| *v += by);
            }
        }
        start.differences_of_many(&now.q, rhs, width)?;
        start.add_damping_of_many(-1.0, &now.v, rhs, width)?;
        for (j, input) in inputs.iter().enumerate() {
            rhs.iter_mut().skip(first + j).step_by(width).zip(&input.force).for_each(|(rhs, force)| *rhs -= force);
        }
        subtract_inertia_of_heads(start, 1.0, inputs.iter().map(|input| &input.head), (width, first), rhs);
        if held {
            rhs[..2 * width].fill(0.0);
        }
        start.divide_many_by_inertia(&dynamics.model.rod.mass, rhs, width)?;
        if held {
            for (j, input) in inputs.iter().enumerate() {
                let [_, _, a] = input.head;
                (0..2).for_each(|axis| rhs[axis * width + first + j] = a[axis]);
            }
        }
        let whole = all || consistent.iter().all(|follows| *follows);
        let (all_a, all_w) = (now.a.chunks_exact_mut(width), &mut now.memory);
        for (i, (a, new)) in all_a.zip(rhs.chunks_exact(width)).enumerate() {
            let mut w = all_w.get_mut(i * width..(i + 1) * width);
            if w.is_none() && whole {
                a.copy_from_slice(new);
                continue;
            }
            for j in (0..width).filter(|j| all || consistent[*j]) {
                if let Some(w) = &mut w {
                    w[j] += new[j] - a[j]; // as in the step itself
                }
                a[j] = new[j];
            }
        }
        Ok(())
    }
}

/// Data for solving one stage of `width` columns for the accelerations along `along`; columns from `first` on belong to inputs.
#[derive(Debug, Clone, Copy)]
struct StageSolve<'a> {
    along: Direction,
    masses: &'a [f64],
    held: bool,
    width: usize,
    first: usize,
}

impl StageSolve<'_> {
    /// Solves the stage whose explicit parts Q*, V* are in `state`; `given` holds, for each input, ∂f/∂u and the motion of a held
    /// head. The positions at the beginning of the internal step are `begins`.
    ///
    /// Q* may be far from there: a consistent acceleration times h² is (ωh)² times the positions of a stretching wave of
    /// frequency ω. The solver therefore computes X = Q − Q₀: with D = Q* − Q₀, J X = f_a D + B f_v D − A (f_q Q₀ + f_v V* +
    /// f_u), whose terms do not exceed J by that factor.
    fn solve<'b>(
        self,
        equations: &mut Equations,
        given: impl Iterator<Item = (&'b [f64], &'b [[f64; 2]; 3])> + Clone,
        begins: &[f64],
        state: &mut State,
        rhs: &mut [f64],
    ) -> Result<()> {
        let Self { along, masses, held, width, first } = self;
        let mut begin = begins.to_vec();
        state.a.fill(0.0);
        if held {
            for values in [&mut state.q, &mut state.v] {
                values[..2 * width].fill(0.0);
            }
            for (j, (_, head)) in given.clone().enumerate() {
                for (values, moved) in [&mut state.q, &mut state.v, &mut state.a].into_iter().zip(head) {
                    (0..2).for_each(|axis| values[axis * width + first + j] = moved[axis]);
                }
            }
            begin[..2 * width].copy_from_slice(&state.q[..2 * width]);
        }
        equations.differences_of_many(&begin, rhs, width)?;
        // From here on, the difference Q* − Q₀.
        state.q.iter_mut().zip(&begin).for_each(|(q, begin)| *q -= begin);
        equations.add_damping_of_many(along.v, &state.q, rhs, width)?;
        equations.add_inertia_of_many(masses, &state.q, rhs, width)?;
        equations.add_damping_of_many(-along.q, &state.v, rhs, width)?;
        for (j, (force, _)) in given.clone().enumerate() {
            rhs.iter_mut().skip(first + j).step_by(width).zip(force).for_each(|(rhs, force)| *rhs -= along.q * force);
        }
        if held {
            subtract_inertia_of_heads(equations, along.q, given.map(|(_, head)| head), (width, first), rhs);
            rhs[..2 * width].fill(0.0);
        }
        equations.factor_and_solve_many(rhs, width)?;
        let (a_of, v_of) = (1.0 / along.q, along.v / along.q);
        let State { q, v, a, .. } = state;
        for ((((q, v), a), x), begin) in q.iter_mut().zip(v).zip(a).zip(&*rhs).zip(&begin) {
            let by = x - *q;
            *q = begin + x;
            *v += v_of * by;
            *a += a_of * by;
        }
        Ok(())
    }
}

/// Subtracts `factor` times the forces on other nodes due to the inertia of accelerated `heads` from the columns of `rhs` from
/// `first` on.
fn subtract_inertia_of_heads<'a>(
    equations: &mut Equations,
    factor: f64,
    heads: impl Iterator<Item = &'a [[f64; 2]; 3]>,
    (width, first): (usize, usize),
    rhs: &mut [f64],
) {
    for (j, [_, _, a]) in heads.enumerate().filter(|(_, [_, _, a])| *a != [0.0; 2]) {
        let mut pulled = vec![0.0; rhs.len() / width];
        pulled[..2].copy_from_slice(a);
        let by = equations.accelerate(&pulled);
        rhs.iter_mut().skip(first + j).step_by(width).zip(by).for_each(|(rhs, by)| *rhs -= factor * by);
    }
}

/// The change of the residual with a unit acceleration of the flow along each axis; `None` if nothing moves with the water.
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
        // The residual is linear in it.
        let [more, less] = [residual(dynamics, by)?, residual(dynamics, -by)?];
        Ok(more.iter().zip(less).map(|(more, less)| 0.5 * (more - less)).collect())
    };
    Ok(Some([of(Vector2::x())?, of(Vector2::y())?]))
}

/// Evaluates the changes due to `inputs` in `state`, to whose time `dynamics` was moved, each along the `tangent`.
fn look_at_inputs(
    dynamics: &mut Dynamics,
    state: &State,
    inputs: &mut [Input],
    point: &mut LocalDerivatives,
    tangent: &mut StateTangent,
) -> Result<()> {
    for (i, Input { direction, force, head }) in inputs.iter_mut().enumerate() {
        direction.evaluate(dynamics, state.t, tangent);
        let bent = dynamics.shape(state)?;
        if i == 0 {
            point.look(&bent);
        }
        direction.follow(&bent, tangent);
        force.clear();
        force.resize(state.q.len(), 0.0);
        add_input_force(&bent, tangent, point, force);
        *head = tangent.head();
    }
    Ok(())
}

/// Adds ∂f/∂u of an input to `force`, including the equation of a hinge.
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
