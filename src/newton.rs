//! Full Newton with the exact Jacobian: one method for every implicit step, and it counts its work.

use serde::Serialize;

use crate::error::{Error, Result};
use crate::linear::{BandMatrix, Choice, Chosen};
use crate::system::{Direction, Linearisation, State, System};

/// Iterations after which a step is given up. Quadratic convergence needs 3–8; measured worst case of the scenes in
/// `models/` is 9.
const MAX_ITERATIONS: u32 = 30;

/// An iteration that has stalled at the residual's rounding floor is accepted if its increment, over the length, is
/// not above this; beyond it the answer itself would be noise.
const FLOOR_INCREMENT: f64 = 1e-6;

/// What Newton's method has done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Work {
    /// Iterations; each assembles, factors and solves once.
    pub newton_iterations: u64,
    /// Numeric factorisations.
    pub factorisations: u64,
    /// Systems that the fast linear solver failed on, so that faer's LU solved them.
    pub linear_fallbacks: u64,
    /// Solves that ended at the rounding floor of the residual instead of at the tolerance.
    pub floor_stops: u64,
}

/// Newton's method with its matrix, right-hand side and linear solver, all allocated once.
#[derive(Debug)]
pub struct Newton {
    tolerance: f64,
    jacobian: BandMatrix,
    increment: Vec<f64>,
    solver: Chosen,
    /// Work done since the start.
    pub work: Work,
}

impl Newton {
    /// Prepares for systems of `nodes` nodes. `tolerance` bounds the largest displacement increment of the last
    /// iteration over the system's length.
    ///
    /// # Errors
    /// Those of [`Chosen::new`].
    pub fn new(nodes: usize, tolerance: f64) -> Result<Self> {
        Self::with(Choice::default(), nodes, tolerance)
    }

    /// The same with a choice of the linear solver.
    ///
    /// # Errors
    /// Those of [`Chosen::new`].
    pub fn with(linear: Choice, nodes: usize, tolerance: f64) -> Result<Self> {
        let jacobian = BandMatrix::new(nodes);
        let solver = Chosen::new(linear, &jacobian)?;
        Ok(Self { tolerance, increment: vec![0.0; jacobian.unknowns()], jacobian, solver, work: Work::default() })
    }

    /// Moves `state` along `direction` until f = 0; returns the displacement increments (m) of the iterations made.
    ///
    /// # Errors
    /// [`Error::NotConverged`], or whatever the system finds wrong with an iterate.
    pub fn solve(&mut self, system: &mut dyn System, state: &mut State, direction: Direction) -> Result<Increments> {
        let length = system.length();
        let mut increments = Increments::default();
        let (mut residual, mut node) = (0.0, 0);
        for _ in 0..MAX_ITERATIONS {
            let previous = increments.last();
            let step = self.iterate(system, state, direction)?;
            increments.push(step.increment);
            (residual, node) = (step.residual, step.node);
            if step.increment <= self.tolerance * length {
                return Ok(increments);
            }
            let stalled = step.increment >= 0.5 * previous && step.increment <= FLOOR_INCREMENT * length;
            if stalled && residual <= system.residual_floor(state) {
                self.work.floor_stops += 1;
                return Ok(increments);
            }
        }
        Err(Error::NotConverged {
            time_s: state.t,
            step_s: f64::NAN, // known to the caller only
            iterations: MAX_ITERATIONS,
            increment_m: increments.last(),
            residual_n: residual,
            node,
        })
    }

    /// One iteration: assemble, factor, solve, move.
    ///
    /// # Errors
    /// Whatever the system finds wrong with the state, or [`Error::NotFinite`] for a singular matrix.
    pub fn iterate(&mut self, system: &mut dyn System, state: &mut State, direction: Direction) -> Result<Iteration> {
        self.work.newton_iterations += 1;
        let linearisation = Linearisation { matrix: &mut self.jacobian, direction };
        system.assemble(state, &mut self.increment, Some(linearisation))?;
        finite(&self.increment, state.t, "force")?; // here its node is still known
        let (worst, residual) = largest(&self.increment);
        let fallback = self.solver.solve(&self.jacobian, &mut self.increment)?;
        self.work.factorisations += 1 + u64::from(fallback);
        self.work.linear_fallbacks += u64::from(fallback);
        finite(&self.increment, state.t, "Newton's increment")?;
        for (i, d) in self.increment.iter().enumerate() {
            state.q[i] -= direction.q * d;
            state.v[i] -= direction.v * d;
            state.a[i] -= direction.a * d;
        }
        let (_, increment) = largest(&self.increment);
        Ok(Iteration { increment: direction.q * increment, residual, node: worst / 2 })
    }
}

/// Outcome of one iteration.
#[derive(Debug, Clone, Copy)]
pub struct Iteration {
    /// Largest displacement increment, m.
    pub increment: f64,
    /// Largest residual before the iteration, N.
    pub residual: f64,
    /// Node of that residual.
    pub node: usize,
}

/// The displacement increments (m) of the iterations of one solve, in order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Increments {
    values: [f64; MAX_ITERATIONS as usize],
    count: usize,
}

impl Increments {
    fn push(&mut self, value: f64) {
        self.values[self.count] = value;
        self.count += 1;
    }

    fn last(&self) -> f64 {
        self.as_slice().last().copied().unwrap_or(f64::INFINITY)
    }

    /// One value an iteration.
    pub fn as_slice(&self) -> &[f64] {
        &self.values[..self.count]
    }
}

/// Refuses values, two a node, that are not all finite.
fn finite(values: &[f64], time_s: f64, what: &'static str) -> Result<()> {
    match values.iter().position(|x| !x.is_finite()) {
        Some(i) => Err(Error::NotFinite { time_s, node: i / 2, what }),
        None => Ok(()),
    }
}

/// Index and size of the entry of largest modulus.
fn largest(values: &[f64]) -> (usize, f64) {
    values.iter().enumerate().fold((0, 0.0), |(k, max), (i, x)| if x.abs() > max { (i, x.abs()) } else { (k, max) })
}
