//! What an integrator sees of a model: a second-order system f(t, q, v, a) = 0 and its linearisation.

use crate::error::Result;
use crate::linear::BandMatrix;

/// Time, positions (m), velocities (m/s) and accelerations (m/s²); two entries a node: x₀, y₀, x₁, y₁, …
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time, s.
    pub t: f64,
    /// Positions, m.
    pub q: Vec<f64>,
    /// Velocities, m/s.
    pub v: Vec<f64>,
    /// Accelerations, m/s².
    pub a: Vec<f64>,
}

impl State {
    /// A state of `unknowns` zeros at time zero.
    pub fn zeros(unknowns: usize) -> Self {
        Self { t: 0.0, q: vec![0.0; unknowns], v: vec![0.0; unknowns], a: vec![0.0; unknowns] }
    }

    /// Copies `other` without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.t = other.t;
        self.q.copy_from_slice(&other.q);
        self.v.copy_from_slice(&other.v);
        self.a.copy_from_slice(&other.a);
    }
}

/// The direction in which one unknown δ moves the state: δq = `q`·δ, δv = `v`·δ, δa = `a`·δ.
///
/// The Jacobian along it is q ∂f/∂q + v ∂f/∂v + a ∂f/∂a. A method chooses the three numbers from its step size; the
/// model never sees the step itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Factor of the positions.
    pub q: f64,
    /// Factor of the velocities.
    pub v: f64,
    /// Factor of the accelerations.
    pub a: f64,
}

/// The matrix q ∂f/∂q + v ∂f/∂v + a ∂f/∂a to be written.
#[derive(Debug)]
pub struct Linearisation<'a> {
    /// The matrix.
    pub matrix: &'a mut BandMatrix,
    /// Its direction.
    pub direction: Direction,
}

/// A system f(t, q, v, a) = 0 of second order in time.
pub trait System {
    /// Number of nodes; there are two unknowns a node.
    fn nodes(&self) -> usize;

    /// The length that displacements are measured against, m.
    fn length(&self) -> f64;

    /// Moves to time `t`: evaluates all that depends on time alone and writes prescribed unknowns into `state`.
    fn move_to(&mut self, t: f64, state: &mut State);

    /// Writes the residual f (N) at `state` to `residual` and its linearisation, if asked for, to that matrix; the time
    /// of `state` is the one last moved to.
    ///
    /// # Errors
    /// Where the state has no meaning: an edge without length, a fold-over, a number that is not finite.
    fn assemble(&mut self, state: &State, residual: &mut [f64], jacobian: Option<Linearisation<'_>>) -> Result<()>;

    /// Refuses a step from `before` to `after` that went through a state without meaning.
    ///
    /// # Errors
    /// [`FoldOver`](crate::Error::FoldOver), [`EdgeCollapse`](crate::Error::EdgeCollapse).
    fn check_step(&self, before: &State, after: &State) -> Result<()>;

    /// The size (N) below which a residual is rounding noise at `state`.
    fn residual_floor(&self, state: &State) -> f64;
}
