//! Newton's method with full steps and the exact Jacobian, which solves every implicit step and counts its work.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::linear::{BandMatrix, ChainMatrix, Direction, FallbackSolver, Riccati, Solution, SolverChoice};
use crate::system::{Form, Linearisation, MAX_RANK, RankOne, State, System};

/// Iterations after which a step is given up. Quadratic convergence needs 3–8; the measured maximum on the scenes in `models/` is
/// 9.
pub(crate) const MAX_ITERATIONS: u32 = 30;

/// If the ratio of the last two increments is at most this, the next iteration is assumed to gain at least its square root and is
/// skipped if that meets the tolerance. Quadratic convergence would gain the ratio's square, but ratios alternate: a transverse
/// error leaves a stretch that is EA/EI times as stiff. Measured on the scenes of `models/` and `tests/reference`, 9–1001 nodes,
/// steps of 1e-5 … 2e-2 s, tolerances of 1e-7 … 1e-12: the next increment is at most 0.43 of the tolerance; with 1e-3 it is up to
/// twice the tolerance, with the ratio itself instead of its root 73 times.
const FAST_CONVERGENCE_RATE: f64 = 3e-4;

/// An iteration that has stalled at the residual's rounding floor is accepted if its increment, relative to the length, is at most
/// this; above it the solution itself would be noise.
const FLOOR_INCREMENT: f64 = 1e-6;

/// In the chain form the floor is the rounding error of the positions themselves: this fraction of the largest coordinate.
const CHAIN_FLOOR: f64 = 64.0 * f64::EPSILON;

/// Bound of C L in e₂ = C e₁², for the first two increments of a solve, where L is the length: this times (N λ)², where N is the
/// number of nodes and λ the [slenderness](crate::rod::Rod::slenderness_squared). A change δ across an edge leaves a stretch
/// (δ/ℓ)²/2, which produces EA ℓ²/EI times the force that bends the rod.
const LARGEST_QUADRATIC_CONSTANT: f64 = 0.1;

/// A predicted increment is multiplied by this.
const SAFETY_FACTOR: f64 = 4.0;

/// The axial force EA e/ℓ that a skipped increment e leaves is at most this many tolerances, times EI/L².
const SKIPPED_INCREMENT_FORCE: f64 = 1e5;

/// The same for the smallest tolerances: no force below this fraction of EI/L² is required.
const MIN_SKIPPED_INCREMENT_FORCE: f64 = 1e-4;

/// The convergence of the solves of one step: e₂ = C e₁² for the first two increments of each. Once C is measured, the second
/// increment of the next solve is predicted from its first.
#[derive(Debug, Clone, Copy)]
pub struct ConvergenceRate {
    /// The largest C so far, 1/m; infinite before the first measurement.
    constant: f64,
}

impl Default for ConvergenceRate {
    fn default() -> Self {
        Self { constant: f64::INFINITY }
    }
}

impl ConvergenceRate {
    /// Updates C from the `increments` of a solve.
    fn learn(&mut self, increments: &Increments) {
        if let [first, second, ..] = *increments.as_slice() {
            let (constant, known) = (second / (first * first), self.constant.is_finite());
            self.constant = if known { self.constant.max(constant) } else { constant };
        }
    }

    /// The predicted second increment (m) of a solve whose first is `first`; infinite if C was not measured.
    fn foreseen(self, first: f64) -> f64 {
        SAFETY_FACTOR * self.constant * first * first
    }
}

/// Work counters of Newton's method.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SolverWork {
    /// Iterations; each assembles, factors and solves once.
    pub newton_iterations: u64,
    /// Numeric factorisations.
    pub factorisations: u64,
    /// Systems on which the fast linear solver failed, so that the pivoting one solved them.
    pub linear_fallbacks: u64,
    /// Solves that ended at the rounding floor of the residual instead of at the tolerance.
    pub floor_stops: u64,
}

/// Newton's method with its matrix, right-hand side and linear solver, all allocated once.
#[derive(Debug)]
pub struct Newton {
    tolerance: f64,
    /// The largest increment, relative to the length, that may be skipped.
    spared: f64,
    /// The largest first increment, relative to the length, that needs no second one; zero if none is predicted.
    sufficient_first_increment: f64,
    nodes: usize,
    equations: EquationSolver,
    increment: Vec<f64>,
    /// Buffers for the solutions of rank-one parts, and the node of their largest residual.
    columns: Vec<Vec<f64>>,
    worst_coupled: usize,
    /// Work done since the start.
    pub work: SolverWork,
}

/// The matrix and its solver.
#[derive(Debug)]
enum EquationSolver {
    Positions {
        jacobian: BandMatrix,
        solver: Box<FallbackSolver>,
    },
    /// The chain form, with the residual and the node where it is largest.
    Chain {
        matrix: ChainMatrix,
        solver: Riccati,
        residual: Vec<f64>,
        worst: usize,
    },
}

impl Newton {
    /// Prepares for systems of `nodes` nodes. `tolerance` bounds the largest displacement increment, relative to the system's
    /// length, of the last iteration, or of the next one that is skipped because of the convergence rate.
    ///
    /// # Errors
    /// Errors of [`FallbackSolver::new`].
    pub fn new(nodes: usize, tolerance: f64) -> Result<Self> {
        Self::with(Form::Positions, SolverChoice::default(), nodes, tolerance)
    }

    /// Prepares as [`new`](Self::new) does, for systems in `form`; their states must be in the same form. `linear` chooses the
    /// linear solver of the positions; the chain form has its own. In the chain form the increment of the edges' directions (rad),
    /// times the length, counts as well.
    ///
    /// # Errors
    /// Errors of [`FallbackSolver::new`].
    pub fn with(form: Form, linear: SolverChoice, nodes: usize, tolerance: f64) -> Result<Self> {
        let (equations, unknowns) = match form {
            Form::Positions => {
                let jacobian = BandMatrix::new(nodes);
                let solver = Box::new(FallbackSolver::new(linear, &jacobian)?);
                (EquationSolver::Positions { jacobian, solver }, 2 * nodes)
            }
            Form::Chain => {
                let matrix = ChainMatrix::new(nodes);
                let unknowns = matrix.unknowns();
                let (solver, residual) = (Riccati::new(nodes), vec![0.0; unknowns]);
                (EquationSolver::Chain { matrix, solver, residual, worst: 0 }, unknowns)
            }
        };
        Ok(Self {
            tolerance,
            spared: tolerance,
            sufficient_first_increment: 0.0,
            nodes,
            equations,
            increment: vec![0.0; unknowns],
            columns: Vec::new(),
            worst_coupled: 0,
            work: SolverWork::default(),
        })
    }

    /// The same, but skips the second iteration of a solve if its predicted increment is within the tolerance and
    /// leaves no significant force. The prediction follows from the first increment and the squared `slenderness` of
    /// the rod, or from earlier solves in the same step.
    pub fn foreseeing(self, slenderness: f64) -> Self {
        let nodes = self.nodes as f64;
        let force = (SKIPPED_INCREMENT_FORCE * self.tolerance).max(MIN_SKIPPED_INCREMENT_FORCE);
        let spared = self.tolerance.min(force / (nodes * slenderness));
        let enough = (spared / (LARGEST_QUADRATIC_CONSTANT * slenderness)).sqrt() / nodes;
        Self { spared, sufficient_first_increment: enough, ..self }
    }

    /// The same for a rod with a held head and adaptive steps: the stretch (e/ℓ)²/2 of an edge that the last increment e leaves
    /// enters the force on the head, so its tension must not exceed `part` of EI/L². No iteration is skipped: in gentle motions the
    /// mean force on the head is quadratic in the amplitude, as this error is.
    pub fn exact_in_force(self, slenderness: f64, part: f64) -> Self {
        let most = (2.0 * part / slenderness).sqrt() / self.nodes as f64;
        let tolerance = self.tolerance.min(most);
        Self { tolerance, spared: tolerance, ..self }
    }

    /// The form of the system that it solves.
    pub fn form(&self) -> Form {
        match self.equations {
            EquationSolver::Positions { .. } => Form::Positions,
            EquationSolver::Chain { .. } => Form::Chain,
        }
    }

    /// Moves `state` along `direction` until f = 0; returns the displacement increments (m) of the iterations made.
    ///
    /// # Errors
    /// [`Error::NotConverged`], or the system's error for an iterate.
    pub fn solve(&mut self, system: &mut dyn System, state: &mut State, direction: Direction) -> Result<Increments> {
        self.solve_with(ConvergencePolicy::AllIterations, &mut ConvergenceRate::default(), system, state, direction)
    }

    /// Solves as [`solve`](Self::solve) does, with `patience`, and with `known`, the convergence of earlier solves in the same step.
    ///
    /// # Errors
    /// Errors of [`solve`](Self::solve).
    pub fn solve_with(
        &mut self,
        patience: ConvergencePolicy,
        known: &mut ConvergenceRate,
        system: &mut dyn System,
        state: &mut State,
        direction: Direction,
    ) -> Result<Increments> {
        let length = system.length();
        let (mut progress, mut increments) = (self.progress(system), Increments::default());
        let mut residual = 0.0;
        for _ in 0..MAX_ITERATIONS {
            let step = self.iterate(system, state, direction)?;
            increments.push(step.increment);
            if self.sufficient_first_increment > 0.0
                && increments.count == 1
                && known.foreseen(step.increment) <= progress.spared
            {
                return Ok(increments);
            }
            residual = step.residual;
            let at_floor = || match self.equations {
                EquationSolver::Positions { .. } => residual <= system.residual_floor(state),
                EquationSolver::Chain { .. } => step.increment <= CHAIN_FLOOR * reach(state, length),
            };
            match progress.judge(step) {
                Convergence::Converged => {
                    known.learn(&increments);
                    return Ok(increments);
                }
                Convergence::Stalled if at_floor() => {
                    self.work.floor_stops += 1;
                    return Ok(increments);
                }
                Convergence::Diverges if patience == ConvergencePolicy::WhileShrinking => break,
                _ => {}
            }
        }
        Err(Error::NotConverged {
            time_s: state.t,
            step_s: f64::NAN, // only the caller knows it
            iterations: increments.count,
            increment_m: increments.last(),
            residual_n: residual,
            node: self.worst(residual),
        })
    }

    /// A solve of `system` before its first iteration.
    pub(crate) fn progress(&self, system: &dyn System) -> SolveProgress {
        let length = system.length();
        SolveProgress {
            length,
            tolerance: self.tolerance * length,
            spared: self.spared * length,
            enough: self.sufficient_first_increment * length,
            last: [f64::INFINITY; 2],
        }
    }

    /// True if it solves for positions, by [`BlockBand`](crate::linear::BlockBand) first.
    pub fn is_by_blocks(&self) -> bool {
        matches!(&self.equations, EquationSolver::Positions { solver, .. } if solver.is_by_blocks())
    }

    /// The node of the largest `residual` (N) of the last iteration.
    fn worst(&self, residual: f64) -> usize {
        match &self.equations {
            EquationSolver::Positions { solver, .. } => {
                solver.rhs().iter().position(|force| force.abs() == residual).map_or(self.worst_coupled, |i| i / 2)
            }
            EquationSolver::Chain { worst, .. } => *worst,
        }
    }

    /// One iteration: assemble, factor, solve, move.
    ///
    /// # Errors
    /// The system's error for the state, or [`Error::NotFinite`] for a singular matrix.
    pub fn iterate(&mut self, system: &mut dyn System, state: &mut State, direction: Direction) -> Result<Iteration> {
        self.work.newton_iterations += 1;
        let length = system.length();
        let (increment, columns, t) = (&mut self.increment, &mut self.columns, state.t);
        match &mut self.equations {
            EquationSolver::Positions { jacobian, solver } => {
                let linearisation = Linearisation { matrix: &mut *jacobian, direction };
                system.assemble(state, increment, Some(linearisation))?;
                let coupling = system.coupling().filter(|_| direction.v != 0.0);
                let solve = |solver: &mut FallbackSolver, rhs: &mut [f64]| match coupling {
                    None => solver.solve(jacobian, rhs),
                    Some(coupling) => Ok(solver.solve_coupled(jacobian, coupling, direction, rhs)),
                };
                let Solution { fallback, sizes } = solve(solver, increment)?;
                self.work.factorisations += 1 + u64::from(fallback);
                self.work.linear_fallbacks += u64::from(fallback);
                let [size, residual] = match (sizes, system.rank_ones()) {
                    (Some(sizes), []) => sizes,
                    (_, rank_ones) => {
                        let residual;
                        (self.worst_coupled, residual) = largest(solver.rhs(), 2, t, "force")?;
                        add_rank_ones(rank_ones, increment, columns, |column, x| {
                            column.clone_into(x);
                            solve(solver, x).map(|_| ())
                        })?;
                        self.work.factorisations += rank_ones.len() as u64;
                        [largest(increment, 2, t, "Newton's increment")?.1, residual]
                    }
                };
                system.move_back(direction, increment, state);
                Ok(Iteration { increment: direction.q * size, residual })
            }
            EquationSolver::Chain { matrix, solver, residual, worst } => {
                system.assemble_chain(state, direction, residual, matrix)?;
                let force;
                (*worst, force) = largest(residual, 6, t, "force")?;
                let fallback = solver.solve(matrix, residual, increment);
                self.work.factorisations += 1 + u64::from(fallback);
                self.work.linear_fallbacks += u64::from(fallback);
                add_rank_ones(system.rank_ones(), increment, columns, |column, x| {
                    x.resize(column.len(), 0.0);
                    solver.solve(matrix, column, x);
                    Ok(())
                })?;
                self.work.factorisations += system.rank_ones().len() as u64;
                largest(increment, 6, t, "Newton's increment")?;
                let [mut move_size, mut turn_size] = [0.0_f64; 2];
                let [q, v, a] = state.nodes_mut();
                for (((q, v), a), of_node) in q.iter_mut().zip(v).zip(a).zip(increment.chunks(6)) {
                    if let [x, y, ..] = *of_node {
                        direction.move_node([q, v, a], [-x, -y]);
                        move_size = move_size.max(x.abs()).max(y.abs());
                    }
                    turn_size = of_node.get(5).map_or(turn_size, |turn| turn_size.max(turn.abs()));
                }
                let beside = system.move_links(increment, state);
                let size = (direction.q.abs() * move_size).max(length * turn_size).max(beside);
                Ok(Iteration { increment: size, residual: force })
            }
        }
    }
}

/// Corrects the solution `x` of a system for its rank-one parts U Vᵀ: x − Z (1 + Vᵀ Z)⁻¹ Vᵀ x (Woodbury). `solve` replaces the
/// columns of U by those of Z = A⁻¹ U, in `columns`. A singular sum gives non-finite values.
fn add_rank_ones(
    rank_ones: &[RankOne],
    x: &mut [f64],
    columns: &mut Vec<Vec<f64>>,
    mut solve: impl FnMut(&[f64], &mut Vec<f64>) -> Result<()>,
) -> Result<()> {
    if rank_ones.is_empty() {
        return Ok(());
    }
    columns.resize_with(columns.len().max(rank_ones.len()), Vec::new);
    for (part, column) in rank_ones.iter().zip(&mut *columns) {
        solve(&part.column, column)?;
    }
    woodbury(rank_ones, columns, x);
    Ok(())
}

/// The same with the columns of Z given.
pub(crate) fn woodbury(rank_ones: &[RankOne], columns: &[Vec<f64>], x: &mut [f64]) {
    if rank_ones.is_empty() {
        return;
    }
    let along = |row: &[f64], x: &[f64]| row.iter().zip(x).map(|(row, x)| row * x).sum::<f64>();
    let mut sizes = SVector::<f64, MAX_RANK>::zeros();
    let mut sum = SMatrix::<f64, MAX_RANK, MAX_RANK>::identity();
    for (i, part) in rank_ones.iter().enumerate().take(MAX_RANK) {
        sizes[i] = along(&part.row, x);
        for (j, column) in columns.iter().enumerate().take(rank_ones.len()) {
            sum[(i, j)] += along(&part.row, column);
        }
    }
    if !sum.lu().solve_mut(&mut sizes) {
        sizes.fill(f64::NAN);
    }
    for (column, size) in columns.iter().zip(&sizes).take(rank_ones.len()) {
        x.iter_mut().zip(column).for_each(|(x, column)| *x -= size * column);
    }
}

/// The progress of a solve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SolveProgress {
    length: f64,
    /// Tolerance of an increment, m.
    tolerance: f64,
    /// Tolerance of a skipped increment, m.
    spared: f64,
    /// Tolerance of the first increment, m.
    enough: f64,
    /// The last two increments, m.
    last: [f64; 2],
}

/// The state of a solve after an iteration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Convergence {
    /// Another iteration is needed.
    Continue,
    /// The tolerance is met.
    Converged,
    /// Increments no longer shrink, and are small enough to be rounding errors.
    Stalled,
    /// The increment has grown twice in a row.
    Diverges,
}

impl SolveProgress {
    /// Updates the progress with an iteration.
    pub(crate) fn judge(&mut self, step: Iteration) -> Convergence {
        let [before, previous] = self.last;
        self.last = [previous, step.increment];
        let rate = step.increment / previous; // 0 in the first iteration
        if rate == 0.0 && step.increment <= self.enough {
            return Convergence::Converged;
        }
        let converges_fast = rate > 0.0 && rate <= FAST_CONVERGENCE_RATE;
        if step.increment <= self.tolerance || converges_fast && rate.sqrt() * step.increment <= self.spared {
            return Convergence::Converged;
        }
        if step.increment >= 0.5 * previous && step.increment <= FLOOR_INCREMENT * self.length {
            return Convergence::Stalled;
        }
        let grew_twice = before < previous && previous < step.increment;
        let astray = step.increment > FLOOR_INCREMENT * self.length && grew_twice;
        if astray { Convergence::Diverges } else { Convergence::Continue }
    }
}

/// When a solve that does not converge is given up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ConvergencePolicy {
    /// After the maximum number of iterations: a diverging iterate usually shows the cause.
    AllIterations,
    /// When the increment has grown twice in a row: for a guess that has an alternative.
    WhileShrinking,
}

/// Outcome of one iteration.
#[derive(Debug, Clone, Copy)]
pub struct Iteration {
    /// Largest displacement increment, m.
    pub increment: f64,
    /// Largest residual before the iteration, N.
    pub residual: f64,
}

/// The displacement increments (m) of the iterations of one solve, in order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Increments {
    values: [f64; MAX_ITERATIONS as usize],
    count: u32,
}

impl Increments {
    fn push(&mut self, value: f64) {
        self.values[self.count as usize] = value;
        self.count += 1;
    }

    fn last(&self) -> f64 {
        self.as_slice().last().copied().unwrap_or(f64::INFINITY)
    }

    /// The increments, one per iteration.
    pub fn as_slice(&self) -> &[f64] {
        &self.values[..self.count as usize]
    }
}

/// Largest coordinate of `state`, or the length if that is larger, m.
fn reach(state: &State, length: f64) -> f64 {
    state.q.iter().fold(length, |max, x| max.max(x.abs()))
}

/// Node and modulus of the largest value, with `a_node` values per node; an error if a value is not finite.
fn largest(values: &[f64], a_node: usize, time_s: f64, what: &'static str) -> Result<(usize, f64)> {
    const BLOCK: usize = 64;
    let (mut first, mut max) = (0, 0.0);
    for (i, block) in values.chunks(BLOCK).enumerate() {
        // In lanes: the largest modulus, and a sum that is zero unless a value is not finite.
        let (mut sizes, mut zeros) = ([0.0_f64; 4], [0.0; 4]);
        let (lanes, rest) = block.as_chunks::<4>();
        for four in lanes {
            for j in 0..4 {
                let size = four[j].abs();
                sizes[j] = if size > sizes[j] { size } else { sizes[j] };
                zeros[j] += 0.0 * size;
            }
        }
        let size = sizes.iter().chain(rest).fold(0.0, |max: f64, x| max.max(x.abs()));
        if zeros.iter().sum::<f64>() != 0.0 || rest.iter().any(|x| !x.is_finite()) {
            let at = block.iter().position(|x| !x.is_finite()).unwrap_or(0);
            return Err(Error::NotFinite { time_s, node: (BLOCK * i + at) / a_node, what });
        }
        if size > max {
            (first, max) = (BLOCK * i, size);
        }
    }
    let at = values[first..].iter().position(|x| x.abs() == max).unwrap_or(0);
    Ok(((first + at) / a_node, max))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn the_largest_value_and_the_first_that_is_not_finite_are_those_of_their_node() {
        for (nodes, a_node) in [(2, 2), (33, 2), (97, 2), (129, 6)] {
            let count = nodes * a_node;
            let small: Vec<f64> = (0..count).map(|i| (i as f64).sin()).collect();
            for at in 0..count {
                let mut values = small.clone();
                values[at] = if at % 2 == 0 { -3.0 } else { 3.0 };
                assert_eq!(largest(&values, a_node, 0.5, "of a test").unwrap(), (at / a_node, 3.0));
                for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    values[at] = wrong;
                    let node = match largest(&values, a_node, 0.5, "of a test") {
                        Err(Error::NotFinite { node, time_s: 0.5, what: "of a test" }) => node,
                        other => panic!("{wrong} at {at}: {other:?}"),
                    };
                    assert_eq!(node, at / a_node, "{wrong} at {at} of {count}");
                }
            }
        }
    }
}
