//! Exact derivatives of a simulation: of any recorded [`Output`] by stiffness, natural curvature and scalar
//! [`Parameter`]s.
//!
//! A method of one stage solves f(t, q, v, a; p) = 0 with q = q* + A a, v = v* + B a ([`Rule`]). With J = M + A f_q + B f_v
//! and derivatives Q, V, … of q, v, … by p, that is
//!
//! J (Q − Q*) = −A (f_q Q* + f_v V* + f_p), of which the derivatives of a and v follow.
//!
//! Forces do not change where the whole rod moves, so f_q Q* is summed over differences of nodes, (f_q)ᵢⱼ (Q*ⱼ − Q*ᵢ): the
//! stiffness of stretching, 10⁸ N/m in an aluminium tail, would else make its rounding an acceleration.
//!
//! [`Problem::forward`] carries all columns along with the simulation: one matrix more a step, and a solve a parameter.
//! [`Problem::adjoint`] goes back over a stored simulation with the transposed matrix: one solve a step, whatever the number
//! of parameters. Both are exact to rounding where Newton's method has converged to it; they need fixed steps, a method of one
//! stage, and positions as unknowns.
//!
//! Source: J. T. Betts, Practical Methods for Optimal Control (2010), chapter 3; derivation for these rules: DESIGN.md.

pub mod output;
pub mod parameter;
mod start;

use std::sync::Arc;

use nalgebra::{Matrix2, Vector2};

use crate::actuation::Actuation;
use crate::error::{Error, Result};
use crate::fluid::{Force, Key};
use crate::head::{Row, hermite};
use crate::integrator::{Integrator, Pace, Rule};
use crate::linear::{BandMatrix, BlockBand, BlockRow, Choice, LinearSolver, PivotedLu, REACH};
use crate::model::{Dynamics, Inputs, Model};
use crate::newton::Newton;
use crate::scene::{Scene, whole_steps};
use crate::start::Start;
use crate::system::{Direction, Form, Linearisation, State, System};
use output::{At, Gradient, Point, Span};
pub use output::{Output, Quantity, Work};
pub use parameter::Parameter;
use parameter::{Effect, Shape};

/// A solution with a larger backward error comes from the pivoted LU instead of the block band's.
const BACKWARD_ERROR: f64 = 1e-12;

/// A scene whose simulation can be differentiated, with the parameters as they are now.
#[derive(Debug)]
pub struct Problem {
    dynamics: Dynamics,
    /// The actuation as the scene has it.
    actuation: Option<Box<dyn Actuation>>,
    integrator: Box<dyn Integrator>,
    tolerance: f64,
    linear: Choice,
    steps: Steps,
}

/// A simulation as it was: times (s), and positions (m), velocities (m/s) and accelerations (m/s²) of every step, two entries
/// per node.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Times, the start's first.
    pub times: Vec<f64>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
}

impl Trajectory {
    /// Positions at time `n`.
    pub fn positions(&self, n: usize) -> &[f64] {
        let width = self.q.len() / self.times.len();
        &self.q[n * width..(n + 1) * width]
    }

    /// Velocities at time `n`.
    pub fn velocities(&self, n: usize) -> &[f64] {
        let width = self.v.len() / self.times.len();
        &self.v[n * width..(n + 1) * width]
    }

    /// Positions at `time` (s), by cubic Hermite polynomials between the steps; none beyond the simulation.
    pub fn at(&self, time: f64) -> Option<Vec<f64>> {
        let last = *self.times.last()?;
        if !(self.times[0]..=last * (1.0 + 1e-9)).contains(&time) {
            return None;
        }
        let n = self.times.partition_point(|t| *t <= time).clamp(1, self.times.len() - 1);
        let rows = |n: usize| {
            let values = self.positions(n).iter().zip(self.velocities(n));
            values.map(move |(q, v)| Row { time: self.times[n], value: *q, rate: *v })
        };
        Some(rows(n - 1).zip(rows(n)).map(|(from, to)| hermite(&from, &to, time.min(last)).value).collect())
    }

    /// Adds a state.
    pub(crate) fn push(&mut self, state: &State) {
        self.times.push(state.t);
        self.q.extend_from_slice(&state.q);
        self.v.extend_from_slice(&state.v);
        self.a.extend_from_slice(&state.a);
    }

    fn load(&self, n: usize, state: &mut State) {
        state.t = self.times[n];
        state.q.copy_from_slice(self.positions(n));
        state.v.copy_from_slice(self.velocities(n));
        let width = state.a.len();
        state.a.copy_from_slice(&self.a[n * width..(n + 1) * width]);
    }
}

/// What [`Problem::forward`] finds.
#[derive(Debug, Clone, Default)]
pub struct Sensitivities {
    /// The recorded times, s.
    pub times: Vec<f64>,
    /// Values, one row a time, one entry an output.
    pub values: Vec<f64>,
    /// Derivatives: a block a time, in it a row an output, one entry a parameter.
    pub derivatives: Vec<f64>,
    outputs: usize,
    parameters: usize,
}

impl Sensitivities {
    /// The value of output `o` at recorded time `n`.
    pub fn value(&self, n: usize, o: usize) -> f64 {
        self.values[n * self.outputs + o]
    }

    /// The derivatives of output `o` at recorded time `n`, one a parameter.
    pub fn row(&self, n: usize, o: usize) -> &[f64] {
        let start = (n * self.outputs + o) * self.parameters;
        &self.derivatives[start..start + self.parameters]
    }
}

/// The derivatives of a state by one parameter.
#[derive(Debug, Clone)]
struct Column {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    memory: Vec<f64>,
}

/// The linearised equations at a time: matrices, factors and room to work in.
#[derive(Debug)]
struct Equations {
    direction: Direction,
    /// J, as if nothing held the head.
    matrix: BandMatrix,
    /// J of a held head.
    held: Option<BandMatrix>,
    /// ∂f/∂v, where any force acts.
    damping: Option<BandMatrix>,
    /// ∂f/∂a, where it is not the lumped mass.
    inertia: Option<BandMatrix>,
    /// What ∂f/∂q does where the whole rod moves: of forces that depend on where it is.
    place: Option<Vec<Matrix2<f64>>>,
    band: BlockBand,
    /// Analysed when it is first needed; `pivoted`: it has the factors.
    lu: Option<PivotedLu>,
    pivoted: bool,
    residual: Vec<f64>,
    product: Vec<f64>,
}

impl Equations {
    fn new(model: &Model) -> Result<Self> {
        let nodes = model.rod.nodes;
        let matrix = BandMatrix::new(nodes);
        let of = |there: bool| there.then(|| matrix.clone());
        let everywhere = model.forces.iter().all(Force::is_the_same_everywhere);
        Ok(Self {
            direction: Direction::POSITIONS,
            held: of(model.head.is_some()),
            damping: of(!model.forces.is_empty()),
            inertia: of(model.forces.are_inertial()),
            place: (!everywhere).then(|| vec![Matrix2::zeros(); nodes]),
            band: BlockBand::analyse(&matrix)?,
            lu: None,
            pivoted: false,
            residual: vec![0.0; 2 * nodes],
            product: vec![0.0; 2 * nodes],
            matrix,
        })
    }

    fn assemble(&mut self, dynamics: &mut Dynamics, state: &State, direction: Direction) -> Result<()> {
        self.direction = direction;
        let along = [
            (self.damping.as_mut(), Direction::VELOCITIES),
            (self.inertia.as_mut(), Direction::ACCELERATIONS),
            (Some(&mut self.matrix), direction),
        ];
        for (matrix, direction) in along {
            if let Some(matrix) = matrix {
                dynamics.unconstrained(state, &mut self.residual, Some(Linearisation { matrix, direction }))?;
            }
        }
        if let Some(place) = &mut self.place {
            place.fill(Matrix2::zeros());
            let (forces, edges) = (&dynamics.model.forces, 0..dynamics.edges().len());
            forces.on_edges(&dynamics.kinematics(state), Some(Direction::POSITIONS), edges, |e, on| {
                (0..2).for_each(|i| place[e + i] += Matrix2::from(on.own(i)));
            });
        }
        if let Some(held) = &mut self.held {
            held.clone_from(&self.matrix);
            held.prescribe(0);
        }
        Ok(())
    }

    /// The block of ∂f/∂q at row `i` and its `j`-th entry, times the direction's part of the positions.
    #[inline]
    fn stiffness(&self, i: usize, j: usize, block: &[f64; 4]) -> [f64; 4] {
        let mut block = *block;
        let others = [(&self.damping, self.direction.v), (&self.inertia, self.direction.a)];
        for (matrix, factor) in others.into_iter().filter_map(|(matrix, factor)| Some((matrix.as_ref()?, factor))) {
            let other = &matrix.rows()[i][j + REACH - i];
            block.iter_mut().zip(other).for_each(|(block, other)| *block -= factor * other);
        }
        block
    }

    /// y = −A f_q x: −Σ (f_q)ᵢⱼ (xⱼ − xᵢ) over j ≠ i, and what moves with the place.
    fn differences(&self, x: &[f64], y: &mut [f64]) {
        let x = x.as_chunks::<2>().0;
        for (i, (row, y)) in self.matrix.rows().iter().zip(y.as_chunks_mut::<2>().0).enumerate() {
            *y = [0.0; 2];
            for (j, block) in neighbours(i, row, x.len()) {
                let [a, b, c, d] = self.stiffness(i, j, block);
                let by = [x[j][0] - x[i][0], x[j][1] - x[i][1]];
                *y = [y[0] - (a * by[0] + b * by[1]), y[1] - (c * by[0] + d * by[1])];
            }
            if let Some(place) = &self.place {
                let moved = place[i] * Vector2::from(x[i]) * self.direction.q;
                *y = [y[0] - moved.x, y[1] - moved.y];
            }
        }
    }

    /// Its transpose: adds −A (f_q)ᵀ x to y.
    fn add_differences_transposed(&self, x: &[f64], y: &mut [f64]) {
        let (x, y) = (x.as_chunks::<2>().0, y.as_chunks_mut::<2>().0);
        for (i, row) in self.matrix.rows().iter().enumerate() {
            for (j, block) in neighbours(i, row, x.len()) {
                let [a, b, c, d] = self.stiffness(i, j, block);
                let by = [a * x[i][0] + c * x[i][1], b * x[i][0] + d * x[i][1]];
                y[j] = [y[j][0] - by[0], y[j][1] - by[1]];
                y[i] = [y[i][0] + by[0], y[i][1] + by[1]];
            }
            if let Some(place) = &self.place {
                let moved = place[i].tr_mul(&Vector2::from(x[i])) * self.direction.q;
                y[i] = [y[i][0] - moved.x, y[i][1] - moved.y];
            }
        }
    }

    /// f_v x, or its transpose; zero without forces.
    fn damp(&mut self, x: &[f64], transposed: bool) -> &[f64] {
        match &self.damping {
            Some(damping) => damping.multiply(x, &mut self.product, transposed),
            None => self.product.fill(0.0),
        }
        &self.product
    }

    /// Replaces `rhs` by f_a⁻¹ rhs, where f_a is symmetric.
    fn divide_by_inertia(&mut self, masses: &[f64], rhs: &mut [f64]) -> Result<()> {
        let Some(inertia) = &self.inertia else {
            for (k, mass) in masses.iter().enumerate() {
                rhs[2 * k] /= mass;
                rhs[2 * k + 1] /= mass;
            }
            return Ok(());
        };
        let mut inertia = inertia.clone();
        if self.held.is_some() {
            inertia.prescribe(0);
        }
        self.band.factor(&inertia)?;
        self.band.solve(rhs);
        Ok(())
    }

    /// Factors, and replaces the first right-hand side by A⁻¹ rhs, or by A⁻ᵀ rhs: so it is known that the band's
    /// factors are good, or the pivoted ones are taken.
    fn factor(&mut self, rhs: &mut [f64], transposed: bool) -> Result<()> {
        self.pivoted = false;
        self.residual.copy_from_slice(rhs);
        self.band.factor(self.held.as_ref().unwrap_or(&self.matrix))?;
        self.solve(rhs, transposed);
        let matrix = self.held.as_ref().unwrap_or(&self.matrix);
        matrix.multiply(rhs, &mut self.product, transposed);
        let largest = |values: &[f64]| {
            values.iter().fold(0.0, |max: f64, x| if max.is_nan() || x.abs() <= max { max } else { x.abs() })
        };
        let diagonal =
            self.matrix.rows().iter().fold(0.0, |max: f64, row| max.max(row[2][0].abs()).max(row[2][3].abs()));
        self.product.iter_mut().zip(&self.residual).for_each(|(product, rhs)| *product -= rhs);
        if largest(&self.product) <= BACKWARD_ERROR * (diagonal * largest(rhs) + largest(&self.residual)) {
            return Ok(());
        }
        let lu = match &mut self.lu {
            Some(lu) => lu,
            none => none.insert(PivotedLu::analyse(matrix)?),
        };
        LinearSolver::factor(lu, matrix)?;
        self.pivoted = true;
        rhs.copy_from_slice(&self.residual);
        self.solve(rhs, transposed);
        Ok(())
    }

    fn solve(&mut self, rhs: &mut [f64], transposed: bool) {
        match (&mut self.lu, transposed) {
            (Some(lu), false) if self.pivoted => lu.solve(rhs),
            (Some(lu), true) if self.pivoted => lu.solve_transposed(rhs),
            (_, false) => self.band.solve(rhs),
            (_, true) => self.band.solve_transposed(rhs),
        }
    }
}

/// The blocks of row `i` beside the diagonal, with their columns.
#[inline]
fn neighbours(i: usize, row: &BlockRow, nodes: usize) -> impl Iterator<Item = (usize, &[f64; 4])> {
    let inside =
        move |(j, block): (usize, _)| (i + j).checked_sub(2).filter(|j| *j != i && *j < nodes).map(|j| (j, block));
    row.iter().enumerate().filter_map(inside)
}

/// Drives and heads over the steps beside a state, for work that is summed over them.
#[derive(Debug)]
struct Ends {
    /// Shapes at the last time, now, and the next.
    shapes: [Shape; 3],
    natural: [Vec<f64>; 3],
    /// The step to here, and the one from here.
    spans: [Span; 2],
    scratch: State,
}

impl Ends {
    fn new(nodes: usize) -> Self {
        Self {
            shapes: std::array::from_fn(|_| Shape::new(nodes)),
            natural: std::array::from_fn(|_| vec![0.0; nodes]),
            spans: std::array::from_fn(|_| Span { natural: vec![0.0; nodes], ..Span::default() }),
            scratch: State::zeros(2 * nodes),
        }
    }

    /// Looks around from time `n` of `count` + 1; `dynamics` is left at that time.
    fn look(&mut self, dynamics: &mut Dynamics, problem: Steps, n: usize) {
        let mut poses = [None; 3];
        for (i, m) in [(0, n.saturating_sub(1)), (2, (n + 1).min(problem.count())), (1, n)] {
            let t = problem.time(m);
            dynamics.move_to(t, &mut self.scratch);
            self.shapes[i].take(dynamics, t);
            self.natural[i].copy_from_slice(&dynamics.natural);
            poses[i] = dynamics.held;
        }
        for (i, span) in self.spans.iter_mut().enumerate() {
            span.h = if i == 0 { problem.length(n) } else { problem.length(n + 1) };
            for (k, change) in span.natural.iter_mut().enumerate() {
                *change = self.natural[i + 1][k] - self.natural[i][k];
            }
            span.poses = poses[i].zip(poses[i + 1]).map(|(from, to)| [from, to]);
        }
    }
}

/// The times of a simulation.
#[derive(Debug, Clone, Copy)]
struct Steps {
    whole: usize,
    length: f64,
    last: Option<f64>,
}

impl Steps {
    fn count(&self) -> usize {
        self.whole + usize::from(self.last.is_some())
    }

    fn time(&self, n: usize) -> f64 {
        if n <= self.whole { n as f64 * self.length } else { self.whole as f64 * self.length + self.length(n) }
    }

    /// The length of the step that ends at time `n`; zero where there is none.
    fn length(&self, n: usize) -> f64 {
        match n {
            0 => 0.0,
            n if n <= self.whole => self.length,
            n if n <= self.count() => self.last.unwrap_or(0.0),
            _ => 0.0,
        }
    }
}

impl Problem {
    /// The problem of a scene.
    ///
    /// # Errors
    /// Those of [`Scene::model`]; [`Error::Scene`] for a scene whose steps are adaptive, whose method has several stages, or
    /// that is solved in the chain form.
    pub fn of(scene: &Scene) -> Result<Self> {
        Self::of_model(scene, scene.model()?)
    }

    /// The problem of another `model` than the scene's own, solved as the scene says.
    ///
    /// # Errors
    /// Those of [`of`](Self::of).
    pub fn of_model(scene: &Scene, model: Model) -> Result<Self> {
        let refuse = |key: &str, problem: &str| {
            Err(Error::Scene { place: scene.name.clone(), key: key.to_string(), problem: problem.to_string() })
        };
        let Pace::Fixed(length) = scene.pace() else {
            return refuse("solver.tolerance", "derivatives need fixed steps; allowed: solver.time_step_s");
        };
        let integrator = scene.integrator()?;
        if integrator.rule(length).is_none() {
            let allowed = "derivatives need a method of one stage; allowed: implicit-euler, newmark, generalized-alpha";
            return refuse("solver.integrator", allowed);
        }
        if scene.form(&model.rod) == Form::Chain {
            return refuse(
                "solver.form",
                "derivatives need positions as unknowns; allowed: fewer nodes, or \"positions\"",
            );
        }
        let (whole, last) = whole_steps(scene.solver.duration_s.get(), length);
        Ok(Self {
            dynamics: Dynamics::new(Arc::new(model)),
            actuation: scene.model()?.actuation.map(|(actuation, _)| actuation),
            integrator,
            tolerance: scene.solver.newton_tolerance.get(),
            linear: scene.solver.linear,
            steps: Steps { whole: whole as usize, length, last },
        })
    }

    /// The model as it is now.
    pub fn model(&self) -> &Model {
        &self.dynamics.model
    }

    /// The inputs, which hold over the whole simulation.
    pub fn inputs(&mut self) -> &mut Inputs {
        &mut self.dynamics.inputs
    }

    /// Bending stiffness EI_k of the joints, N m², in their order.
    pub fn stiffness(&self) -> Vec<f64> {
        let rod = &self.model().rod;
        rod.joints().map(|k| rod.joint_stiffness(k)).collect()
    }

    /// Sets the bending stiffness EI_k of the joints, N m², in their order.
    ///
    /// # Errors
    /// [`Error::WrongLength`].
    pub fn set_stiffness(&mut self, values: &[f64]) -> Result<()> {
        let expected = self.model().rod.joints().len();
        if values.len() != expected {
            return Err(Error::WrongLength { name: "joint_stiffness_n_m2", expected, found: values.len() });
        }
        if let Some(model) = Arc::get_mut(&mut self.dynamics.model) {
            let rod = &mut model.rod;
            for (k, ei) in rod.joints().zip(values) {
                rod.joint[k] = ei / (rod.joint_part(k) * rod.spacing);
            }
        }
        Ok(())
    }

    /// Sets what the amplitude of the scene's actuation is multiplied by, and the phases (rad) subtracted inside it, at the
    /// joints in their order.
    ///
    /// # Errors
    /// [`Error::WrongLength`].
    pub fn set_actuation(&mut self, factors: &[f64], phases: &[f64]) -> Result<()> {
        let joints = self.model().rod.joints();
        for (name, found) in
            [("actuation.amplitude_profile", factors.len()), ("actuation.phase_profile_rad", phases.len())]
        {
            if found != joints.len() {
                return Err(Error::WrongLength { name, expected: joints.len(), found });
            }
        }
        let nodes = self.model().rod.nodes;
        let along = |values: &[f64], rest: f64| {
            let mut all = vec![rest; nodes];
            all[joints.clone()].copy_from_slice(values);
            all
        };
        let own = self.actuation.as_ref().map(|own| own.profiled(&along(factors, 1.0), &along(phases, 0.0)));
        if let (Some(model), Some(own)) = (Arc::get_mut(&mut self.dynamics.model), own)
            && let Some((actuation, _)) = &mut model.actuation
        {
            *actuation = own;
        }
        Ok(())
    }

    /// Times, the start's first, s.
    pub fn times(&self) -> Vec<f64> {
        (0..=self.steps.count()).map(|n| self.steps.time(n)).collect()
    }

    /// The rules of its steps: of whole ones, and of the last.
    fn rules(&self) -> Result<[Rule; 2]> {
        let rule = |h: f64| self.integrator.rule(h).ok_or(Error::Step(h)); // `of` has asked for one
        Ok([rule(self.steps.length)?, rule(self.steps.last.unwrap_or(self.steps.length))?])
    }

    /// Steps through the simulation; `look` sees the number of the time, where it came from, and where it is.
    fn advance(&mut self, mut look: impl FnMut(&mut Dynamics, usize, &State, f64) -> Result<()>) -> Result<()> {
        let steps = self.steps;
        let dynamics = &mut self.dynamics;
        let mut newton = Newton::with(Form::Positions, self.linear, dynamics.nodes(), self.tolerance)?;
        let mut state = dynamics.first_state();
        newton.iterate(dynamics, &mut state, Direction::ACCELERATIONS)?;
        self.integrator.begin(&mut state);
        let mut next = state.clone();
        look(dynamics, 0, &state, 0.0)?;
        for n in 1..=steps.count() {
            let h = steps.length(n);
            next.t = steps.time(n);
            self.integrator.step(dynamics, &mut newton, &state, h, &mut next)?;
            std::mem::swap(&mut state, &mut next);
            look(dynamics, n, &state, h)?;
        }
        Ok(())
    }

    /// Simulates.
    ///
    /// # Errors
    /// A step that fails; it is not halved.
    pub fn simulate(&mut self) -> Result<Trajectory> {
        let mut trajectory = Trajectory::default();
        self.advance(|_, _, state, _| {
            trajectory.push(state);
            Ok(())
        })?;
        Ok(trajectory)
    }

    /// Simulates and carries the derivatives of all `outputs` by all `parameters` along; records every `every` steps,
    /// and the end. `look` sees every state.
    ///
    /// # Errors
    /// Those of [`simulate`](Self::simulate).
    pub fn forward(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        every: usize,
        mut look: impl FnMut(&State),
    ) -> Result<Sensitivities> {
        let (nodes, steps) = (self.dynamics.nodes(), self.steps);
        let mut equations = Equations::new(self.model())?;
        let mut point = Point::new(nodes, &keys(parameters));
        let mut shape = Shape::new(nodes);
        let mut gradient = Gradient::new(nodes, &keys(parameters));
        let mut effects: Vec<Effect> = Vec::with_capacity(parameters.len());
        let mut columns: Vec<Column> = Vec::new();
        let summing = outputs.iter().any(|output| !output.work.is_empty());
        let mut ends = Ends::new(nodes);
        let (width, size) = (parameters.len(), outputs.len() * parameters.len());
        let mut first = vec![0.0; outputs.len() + size];
        let mut sums = vec![0.0; outputs.len() + size];
        let mut now = vec![0.0; outputs.len() + size];
        let mut row = vec![0.0; width];
        let mut rhs = vec![0.0; 2 * nodes];
        let mut star = vec![0.0; 2 * nodes];
        let mut found = Sensitivities { outputs: outputs.len(), parameters: width, ..Sensitivities::default() };
        let rules = self.rules()?;

        self.advance(|dynamics, n, state, h| {
            look(state);
            shape.take(dynamics, state.t);
            effects.clear();
            effects.extend(parameters.iter().map(|parameter| parameter.effect(&dynamics.model.rod, &shape)));
            if n == 0 {
                columns = first_columns(dynamics, state, &effects, &shape, &mut equations, &mut point)?;
            } else {
                let rule = rules[usize::from(n > steps.whole)];
                let direction = Direction { q: rule.q_new, v: rule.v_new, a: 1.0 };
                equations.assemble(dynamics, state, direction)?;
                point.look(dynamics, state);
                let at = At { dynamics, state, point: &point };
                for (j, (column, effect)) in columns.iter_mut().zip(&effects).enumerate() {
                    feet(&rule, h, column, &mut star);
                    equations.differences(&star, &mut rhs);
                    resist(&mut equations, &at, effect, &shape, rule.q_new, &column.v, &mut rhs);
                    if j == 0 {
                        equations.factor(&mut rhs, false)?;
                    } else {
                        equations.solve(&mut rhs, false);
                    }
                    land(&rule, column, &star, &rhs);
                }
            }
            let recorded = n % every == 0 || n == steps.count();
            if !(recorded || summing || n == 0) {
                return Ok(());
            }
            if summing {
                ends.look(dynamics, steps, n);
                dynamics.shape(state)?;
            }
            let at = At { dynamics, state, point: &point };
            let derivatives = |gradient: &Gradient, step: Option<[&Shape; 2]>, row: &mut [f64]| {
                for ((entry, column), (effect, parameter)) in
                    row.iter_mut().zip(&columns).zip(effects.iter().zip(parameters))
                {
                    *entry = dot(&gradient.q, &column.q) + dot(&gradient.v, &column.v) + dot(&gradient.a, &column.a);
                    *entry += direct(gradient, effect, &shape, step.map(|ends| (ends, *parameter, &at)));
                }
            };
            now.fill(0.0);
            for (o, output) in outputs.iter().enumerate() {
                // A value and its derivatives, wherever they are.
                let block = outputs.len() + o * width;
                let own = || [o].into_iter().chain(block..block + width);
                let mut sum = |i: usize, sums: &mut [f64]| {
                    let span = &ends.spans[i];
                    if output.work.is_empty() || span.h == 0.0 {
                        return;
                    }
                    gradient.clear();
                    let add = |(c, work): &(f64, Work)| c * work.add(&at, span, i == 0, *c, &mut gradient);
                    sums[o] += output.work.iter().map(add).sum::<f64>();
                    derivatives(&gradient, Some([&ends.shapes[i], &ends.shapes[i + 1]]), &mut row);
                    sums[block..block + width].iter_mut().zip(&row).for_each(|(sum, x)| *sum += x);
                };
                sum(0, &mut sums);
                own().for_each(|k| now[k] = sums[k]);
                sum(1, &mut sums); // the share of the step that begins here, for the next time
                gradient.clear();
                now[o] += output.now.iter().map(|(c, quantity)| c * quantity.add(&at, *c, &mut gradient)).sum::<f64>();
                derivatives(&gradient, None, &mut row);
                now[block..block + width].iter_mut().zip(&row).for_each(|(now, x)| *now += x);
                if n == 0 && output.since_start {
                    own().for_each(|k| first[k] = now[k]);
                }
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
        })?;
        Ok(found)
    }

    /// The derivatives by all `parameters` of Σ w y over all times and outputs y of the stored simulation `trajectory`
    /// of this problem, with `weights` w, one row a time.
    ///
    /// # Errors
    /// [`Error::WrongLength`] for weights of another simulation.
    pub fn adjoint(
        &mut self,
        parameters: &[Parameter],
        outputs: &[Output],
        weights: &[f64],
        trajectory: &Trajectory,
    ) -> Result<Vec<f64>> {
        let (nodes, steps) = (self.dynamics.nodes(), self.steps);
        let expected = outputs.len() * (steps.count() + 1);
        if weights.len() != expected {
            return Err(Error::WrongLength { name: "weights", expected, found: weights.len() });
        }
        let rules = self.rules()?;
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
        let dynamics = &mut self.dynamics;
        let held = dynamics.model.head.is_some();
        // Weights of all later times, for what is summed or counted from the start.
        let mut later = vec![0.0; outputs.len()];
        for n in (0..=steps.count()).rev() {
            trajectory.load(n, &mut state);
            if summing {
                ends.look(dynamics, steps, n);
            }
            dynamics.move_to(state.t, &mut state);
            shape.take(dynamics, state.t);
            let rule = rules[usize::from(n > steps.whole)];
            let direction = match n {
                0 => Direction::POSITIONS,
                _ => Direction { q: rule.q_new, v: rule.v_new, a: 1.0 },
            };
            equations.assemble(dynamics, &state, direction)?;
            point.look(dynamics, &state);
            effects.clear();
            effects.extend(parameters.iter().map(|parameter| parameter.effect(&dynamics.model.rod, &shape)));
            let at = At { dynamics, state: &state, point: &point };
            for (o, output) in outputs.iter().enumerate() {
                let weight = weights[n * outputs.len() + o];
                let begun = later[o];
                later[o] += weight;
                let own = if n == 0 && output.since_start { weight - later[o] } else { weight };
                if own != 0.0 {
                    gradient.clear();
                    for (c, quantity) in &output.now {
                        quantity.add(&at, c * own, &mut gradient);
                    }
                    gather(&gradient, &effects, &shape, None, &mut bar, &mut total);
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
                }
            }
            if n == 0 {
                first_cotangents(&at, &mut equations, &mut bar, &mut force, held, self.integrator.as_ref())?;
            } else {
                let h = steps.length(n);
                let Rule { q_old, v_old, q_new, v_new, memory } = rule;
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
            let at = At { dynamics, state: &state, point: &point };
            for (total, effect) in total.iter_mut().zip(&effects) {
                *total += pushed(&at, effect, &shape, &force);
            }
            if n == 0 {
                for (total, effect) in total.iter_mut().zip(&effects).filter(|(_, effect)| effect.bends()) {
                    let [q, v] = first_by(dynamics, effect, &shape);
                    *total += dot(&q, &bar.q) + dot(&v, &bar.v);
                }
            }
        }
        Ok(total)
    }
}

/// The keys of the forces' parameters among `parameters`.
fn keys(parameters: &[Parameter]) -> Vec<Key> {
    let key = |parameter: &Parameter| if let Parameter::OfForces(key) = parameter { Some(*key) } else { None };
    parameters.iter().filter_map(key).collect()
}

#[inline]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// How `effect` moves the force f along `force`: f_p·force.
fn pushed(at: &At<'_>, effect: &Effect, shape: &Shape, force: &[f64]) -> f64 {
    let (dynamics, rod) = (at.dynamics, &at.dynamics.model.rod);
    let mut sum = effect.key.map_or(0.0, |key| dot(at.point.by_key(key), force));
    for k in effect.joints.clone() {
        let deviation = dynamics.kappa()[k] - dynamics.natural[k];
        let size = effect.stiffness * deviation - rod.joint[k] * effect.natural(shape, k);
        sum += size * at.point.gather(k, force);
    }
    sum
}

/// The derivative that does not go through the state; over a step with the shapes at its ends.
fn direct(gradient: &Gradient, effect: &Effect, shape: &Shape, step: Option<([&Shape; 2], Parameter, &At<'_>)>) -> f64 {
    let mut sum = effect.key.map_or(0.0, |key| gradient.by_key(key));
    for k in effect.joints.clone() {
        sum += gradient.stiffness[k] * effect.stiffness
            + gradient.natural[k] * effect.natural(shape, k)
            + gradient.natural_rate[k] * effect.rate(shape, k);
        if let Some(([from, to], parameter, at)) = step.filter(|_| effect.bends()) {
            let rod = &at.dynamics.model.rod;
            let change = parameter.effect(rod, to).natural(to, k) - parameter.effect(rod, from).natural(from, k);
            sum += gradient.natural_step[k] * change;
        }
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

/// The derivatives of the first positions and velocities.
fn first_by(dynamics: &Dynamics, effect: &Effect, shape: &Shape) -> [Vec<f64>; 2] {
    let rod = &dynamics.model.rod;
    let mut by = [vec![0.0; 2 * rod.nodes], vec![0.0; 2 * rod.nodes]];
    if dynamics.model.start == Start::Shaped && effect.bends() {
        let mut change = [vec![0.0; rod.nodes], vec![0.0; rod.nodes]];
        for k in effect.joints.clone() {
            (change[0][k], change[1][k]) = (effect.natural(shape, k), effect.rate(shape, k));
        }
        let [natural, rate] = &change;
        let [q, v] = &mut by;
        start::shaped(rod, [&dynamics.natural, &dynamics.natural_rate], [natural, rate], dynamics.held.as_ref(), q, v);
    }
    by
}

/// The derivatives of the first state; its accelerations fulfil M a = F.
fn first_columns(
    dynamics: &mut Dynamics,
    state: &State,
    effects: &[Effect],
    shape: &Shape,
    equations: &mut Equations,
    point: &mut Point,
) -> Result<Vec<Column>> {
    equations.assemble(dynamics, state, Direction::POSITIONS)?;
    point.look(dynamics, state);
    let at = At { dynamics, state, point };
    let mut columns = Vec::with_capacity(effects.len());
    for effect in effects {
        let [q, v] = first_by(dynamics, effect, shape);
        let mut a = vec![0.0; q.len()];
        equations.differences(&q, &mut a);
        resist(equations, &at, effect, shape, 1.0, &v, &mut a);
        equations.divide_by_inertia(&dynamics.model.rod.mass, &mut a)?;
        columns.push(Column { q, v, memory: a.clone(), a });
    }
    Ok(columns)
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
    equations.divide_by_inertia(&at.dynamics.model.rod.mass, force)?;
    let minus: Vec<f64> = force.iter().map(|x| -x).collect();
    equations.add_differences_transposed(&minus, &mut bar.q);
    bar.v.iter_mut().zip(equations.damp(force, true)).for_each(|(bar, damped)| *bar += damped);
    Ok(())
}

/// Adds `factor`·f_p to `force`.
#[inline]
fn push(at: &At<'_>, effect: &Effect, shape: &Shape, factor: f64, force: &mut [f64]) {
    let (dynamics, rod) = (at.dynamics, &at.dynamics.model.rod);
    if let Some(key) = effect.key {
        force.iter_mut().zip(at.point.by_key(key)).for_each(|(f, by)| *f += factor * by);
    }
    for k in effect.joints.clone() {
        let deviation = dynamics.kappa()[k] - dynamics.natural[k];
        let size = effect.stiffness * deviation - rod.joint[k] * effect.natural(shape, k);
        at.point.scatter(k, factor * size, force);
    }
}

/// Q* to `star` and V* to the column's velocities; its memory becomes what it keeps of the old accelerations.
#[inline]
fn feet(rule: &Rule, h: f64, column: &mut Column, star: &mut [f64]) {
    let Column { q, v, a, memory } = column;
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

/// Adds −A (f_v V* + f_p), and makes the whole zero at a held node.
fn resist(
    equations: &mut Equations,
    at: &At<'_>,
    effect: &Effect,
    shape: &Shape,
    size: f64,
    v_star: &[f64],
    rhs: &mut [f64],
) {
    rhs.iter_mut().zip(equations.damp(v_star, false)).for_each(|(rhs, damped)| *rhs -= size * damped);
    push(at, effect, shape, -size, rhs);
    if at.dynamics.held.is_some() {
        rhs[..2].fill(0.0);
    }
}

/// The column at the new time from Q − Q*.
#[inline]
fn land(rule: &Rule, column: &mut Column, star: &[f64], moved: &[f64]) {
    let Column { q, v, a, memory } = column;
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
