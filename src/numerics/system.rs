//! A model as integrators see it: a second-order system f(t, q, v, a) = 0 and its linearisation.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::linear::{BandMatrix, ChainMatrix, Coupling, Direction};

/// The unknowns of Newton's method. Both forms describe the same discrete rod.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// The nodes' positions: fast, but the rounding error grows as (L/ΔL)⁴.
    Positions,
    /// Positions, moments, forces and directions, see [`chain`](crate::model::chain): equally accurate on any mesh.
    Chain,
}

/// The chain form's unknowns of a node: its joint, and the edge that starts there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// Direction θ_k of the edge from +x, rad; not wrapped at ±π. Zero if no edge starts here.
    pub angle: f64,
    /// Force F_k (N) in the edge: it pulls node k by F_k and node k+1 by −F_k. Zero if no edge starts here.
    pub force: [f64; 2],
    /// Moment M_k (N m) of the joint, conjugate to its turning angle θ_k − θ_{k−1}; zero without a joint.
    pub moment: f64,
    /// Curvature κ_k of the joint, computed from its moment; dimensionless.
    pub curvature: f64,
}

/// Time, positions (m), velocities (m/s) and accelerations (m/s²); two entries per node: x₀, y₀, x₁, y₁, …, and one more for the
/// arc length of a [hinge](crate::head::Hinge).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Time, s.
    pub t: f64,
    /// Positions, m.
    pub q: Vec<f64>,
    /// Velocities, m/s.
    pub v: Vec<f64>,
    /// Accelerations, m/s².
    pub a: Vec<f64>,
    /// One per node in the chain form, where they are unknowns in their own right and more accurate than values computed from
    /// positions; empty if positions are the only unknowns.
    pub links: Vec<Link>,
    /// A method's memory of earlier accelerations, m/s², or the unknowns of a reduced model; empty for a method without memory.
    pub memory: Vec<f64>,
}

impl State {
    /// A state of `unknowns` zeros at time zero.
    pub fn zeros(unknowns: usize) -> Self {
        let zeros = || vec![0.0; unknowns];
        Self { q: zeros(), v: zeros(), a: zeros(), ..Self::default() }
    }

    /// Copies `other`, without allocating if the capacity suffices.
    pub fn copy_from(&mut self, other: &Self) {
        self.t = other.t;
        self.q.clone_from(&other.q);
        self.v.clone_from(&other.v);
        self.a.clone_from(&other.a);
        self.links.clone_from(&other.links);
        self.memory.clone_from(&other.memory);
    }

    /// Moves every unknown back by its entry of `increment` along `direction`.
    pub(crate) fn move_all_back(&mut self, direction: Direction, increment: &[f64]) {
        let moved = self.q.iter_mut().zip(&mut self.v).zip(&mut self.a).zip(increment);
        for (((q, v), a), d) in moved {
            *q -= direction.q * d;
            *v -= direction.v * d;
            *a -= direction.a * d;
        }
    }

    /// Positions, velocities and accelerations, by node.
    pub(crate) fn nodes_mut(&mut self) -> [&mut [[f64; 2]]; 3] {
        [&mut self.q, &mut self.v, &mut self.a].map(|values| values.as_chunks_mut().0)
    }

    /// Guesses the links from those of `from`: forces and moments are kept, and every edge turns with the motion of its nodes since
    /// then.
    pub fn guess_links(&mut self, from: &Self) {
        self.links.clone_from(&from.links);
        let edges = self.links.len().saturating_sub(1);
        for (k, link) in self.links.iter_mut().enumerate().take(edges) {
            let difference = |q: &[f64], i: usize| q[2 * k + 2 + i] - q[2 * k + i];
            let [(old_x, new_x), (old_y, new_y)] = [0, 1].map(|i| (difference(&from.q, i), difference(&self.q, i)));
            let turn = (old_x * new_y - old_y * new_x).atan2(old_x * new_x + old_y * new_y);
            if turn.is_finite() {
                link.angle += turn;
            }
        }
    }
}

/// The matrix q ∂f/∂q + v ∂f/∂v + a ∂f/∂a, to be assembled.
#[derive(Debug)]
pub struct Linearisation<'a> {
    /// The matrix.
    pub matrix: &'a mut BandMatrix,
    /// Its direction.
    pub direction: Direction,
}

/// The largest number of rank-one parts.
pub const MAX_RANK: usize = 4;

/// A rank-one part `column` · `row`ᵀ of a system's matrix, which may couple any unknowns, in the order and units of a form.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RankOne {
    /// The direction of the change of the residual.
    pub column: Vec<f64>,
    /// The linear form of the unknowns that scales this change.
    pub row: Vec<f64>,
}

/// A system f(t, q, v, a) = 0 of second order in time.
pub trait System {
    /// Number of nodes; there are two unknowns per node.
    fn nodes(&self) -> usize;

    /// The mass of each node, kg, if that is all of the inertia.
    fn lumped_masses(&self) -> Option<&[f64]>;

    /// The reference length of displacements, m.
    fn length(&self) -> f64;

    /// Moves to time `t`: evaluates everything that depends on time alone and writes prescribed unknowns into `state`.
    fn move_to(&mut self, t: f64, state: &mut State);

    /// Writes the residual f (N) at `state` to `residual` and, if requested, its linearisation to that matrix.
    /// [`move_to`](Self::move_to) must have been called with the time of `state`.
    ///
    /// # Errors
    /// For an invalid state: an edge without length, a fold-over, a value that is not finite.
    fn assemble(&mut self, state: &State, residual: &mut [f64], jacobian: Option<Linearisation<'_>>) -> Result<()>;

    /// Writes the chain form at `state`: its residual, each row as a force (N), and its matrix along `direction`, whose first two
    /// unknowns per node are the δ of the direction. [`move_to`](Self::move_to) must have been called with the time of `state`.
    ///
    /// # Errors
    /// Errors of [`assemble`](Self::assemble), and [`Error::Linear`] for a system without chain form.
    fn assemble_chain(
        &mut self,
        _state: &State,
        _direction: Direction,
        residual: &mut [f64],
        _matrix: &mut ChainMatrix,
    ) -> Result<()> {
        Err(Error::Linear { unknowns: residual.len(), reason: "the system has no chain form".to_string() })
    }

    /// The nonlocal part that [`assemble`](Self::assemble) left out of the matrix, for the state assembled last.
    fn coupling(&self) -> Option<&dyn Coupling> {
        None
    }

    /// The rank-one parts, at most [`MAX_RANK`], that the matrix assembled last, in either form, lacks in addition to
    /// [`coupling`](Self::coupling).
    fn rank_ones(&self) -> &[RankOne] {
        &[]
    }

    /// Moves the links of `state` back by Newton's increment of the chain form, and computes curvature from the moments. Returns
    /// the largest motion of an unknown other than nodes and links, m.
    fn move_links(&self, _increment: &[f64], _state: &mut State) -> f64 {
        0.0
    }

    /// Moves `state` back by Newton's `increment` of the positions along `direction`.
    fn move_back(&self, direction: Direction, increment: &mut [f64], state: &mut State) {
        state.move_all_back(direction, increment);
    }

    /// Improves the guess `to` of the state that follows `from`; moving unknowns move along `direction`.
    fn better_guess(&self, from: &State, _direction: Direction, to: &mut State) {
        to.guess_links(from);
    }

    /// Rejects a step from `before` to `after` that passed through an invalid state.
    ///
    /// # Errors
    /// [`FoldOver`](crate::Error::FoldOver), [`EdgeCollapse`](crate::Error::EdgeCollapse).
    fn check_step(&self, before: &State, after: &State) -> Result<()>;

    /// The size (N) below which a residual is rounding noise at `state`.
    fn residual_floor(&self, state: &State) -> f64;
}
