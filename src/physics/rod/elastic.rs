//! Inertia and elasticity of the whole rod, and the other forces on its edges: M a + ∇E + ΣF and its linearisation, in
//! one pass over the edges that writes every block once.
//!
//! The energy depends on edge vectors only. Every edge i carries a tension N (stretching) and the shear that balances
//! the couples M of the joints at its ends, so ∂E/∂(edge i) = N t + ((M_i − M_{i+1})/ℓ) n: the equilibrium of a beam.
//! The Hessian with respect to edge vectors is block tridiagonal, with T on its diagonal and Q next to it; edges are
//! differences of nodes. Other forces on the ends of an edge depend on their motion and on the edge, so they are added
//! in the same pass.

use nalgebra::Vector2;

use super::bend::Joint;
use super::damping::{Elastic, MaterialLaw};
use super::edge_force::EdgeForce;
use super::{Cell, Edge, EdgeValues};
use crate::linear::{Block, BlockRow, Direction, Pair, Real, pair};

/// ∂E/∂(edge vector), N: the force that the edge carries, between joints `start` and `end`.
#[inline(always)]
pub fn force<T: Real>(edge: &Edge<T>, tension: T, start: &Joint<T>, end: &Joint<T>) -> Vector2<T> {
    let (n, shear) = (edge.n(), shear(edge, start, end));
    Vector2::new(edge.t.x * tension + n.x * shear, edge.t.y * tension + n.y * shear)
}

/// The shear (N) of an edge, which balances the couples of its joints.
#[inline(always)]
fn shear<T: Real>(edge: &Edge<T>, start: &Joint<T>, end: &Joint<T>) -> T {
    (start.couple - end.couple) * edge.per_length
}

/// `factor` times T = ∂²E/∂(edge vector)², N/m, with the axial stiffness EA/ΔL (N/m).
#[inline(always)]
pub fn stiffness<T: Real>(edge: &Edge<T>, axial: T, tension: T, [start, end]: [&Joint<T>; 2], factor: T) -> Block<T> {
    let (t, n) = (pair(edge.t), pair(edge.n()));
    let per_length = factor * edge.per_length;
    let along = axial * factor;
    let across = (tension + (start.stiffness + end.stiffness) * edge.per_length) * per_length;
    let mixed = -shear(edge, start, end) * per_length;
    // along·t tᵀ + across·n nᵀ + mixed (n tᵀ + t nᵀ)
    Block::outer(edge.t, t * along + n * mixed) + Block::outer(edge.n(), n * across + t * mixed)
}

/// `factor` times Q = ∂²E/∂(edge before)∂(edge after) of a joint, N/m.
#[inline(always)]
pub fn coupling<T: Real>(before: &Edge<T>, after: &Edge<T>, joint: &Joint<T>, factor: T) -> Block<T> {
    let size = -joint.stiffness * (factor * before.per_length) * after.per_length;
    Block::outer(before.n(), pair(after.n()) * size)
}

/// The state of a rod at one time.
#[derive(Debug, Clone, Copy)]
pub struct Deformed<'a, T = f64> {
    /// Rest length and axial stiffness of each edge.
    pub cells: &'a EdgeValues<Cell<T>>,
    /// Mass of each node, kg.
    pub mass: &'a [T],
    /// Edges.
    pub edges: &'a [Edge<T>],
    /// One entry per node; zero where there is no joint.
    pub joints: &'a [Joint<T>],
    /// Accelerations, m/s².
    pub a: &'a [[T; 2]],
}

impl<T: Real> Deformed<'_, T> {
    /// Writes M a + ∇E (N), plus the forces on every edge from `around`, to `residual`, and its linearisation along a
    /// direction to the rows of a matrix, if given.
    #[inline(always)]
    pub fn assemble(
        &self,
        around: impl Iterator<Item = Option<EdgeForce<T>>>,
        residual: &mut [[T; 2]],
        jacobian: Option<(&mut [BlockRow<T>], Direction)>,
    ) {
        self.assemble_with(Elastic, around, residual, jacobian);
    }

    /// Like [`assemble`](Self::assemble), for a material that also resists strain rates. The couples and stiffnesses of
    /// the joints already include the damping.
    #[inline(always)]
    pub fn assemble_with(
        &self,
        law: impl MaterialLaw<T>,
        around: impl Iterator<Item = Option<EdgeForce<T>>>,
        residual: &mut [[T; 2]],
        jacobian: Option<(&mut [BlockRow<T>], Direction)>,
    ) {
        let Self { cells, mass: masses, edges, joints, a } = *self;
        let Some(zero) = masses.first().map(|mass| mass.like(0.0)) else { return };
        let (rows, direction): (&mut [BlockRow<T>], _) =
            jacobian.unwrap_or((&mut [], Direction { q: 0.0, v: 0.0, a: 0.0 }));
        let none = Block::diagonal(zero);
        if let Some(row) = rows.first_mut() {
            *row = [[zero; 4]; 5];
        }
        // From the previous edge: its contributions to the residual and to the diagonal block of this node, and −Q of
        // the joint here with its transpose.
        let mut before = T::Pair::new([zero; 2]);
        let (mut diagonal, mut q_here, mut qt_here) = (none, none, none);
        let ends = joints.iter().zip(joints.iter().skip(1));
        let here = edges.iter().zip(ends).zip(around).zip(a).zip(masses).enumerate();
        for (k, ((((edge, (start, end)), around), a), mass)) in here {
            let cell = &cells[k];
            let tension = law.tension(k, cell, cell.tension(edge));
            let force = pair(force(edge, tension, start, end));
            let mut sum = T::Pair::new(*a) * *mass + before;
            before = force;
            if let Some(around) = &around {
                sum += around.force_lanes(0);
                before += around.force_lanes(1);
            }
            residual[k] = (sum - force).to_array();
            // Not `let … else { continue }`, which is 10 % slower.
            if let Some([row, next_row]) = rows.get_mut(k..k + 2) {
                // −T and −Q, because more blocks need them than T and Q.
                let less = zero.like(-direction.q);
                let t = stiffness(edge, cell.axial, tension, [start, end], less);
                let t = law.own(k, edge, cell, t, direction);
                let [q_after, qt_after] = edges.get(k + 1).map_or([none; 2], |next| {
                    law.couplings(k + 1, [edge, next], coupling(edge, next, end, less), direction)
                });
                let (mut right, mut left) = (t, t);
                let mut own = [none; 2];
                if let Some(around) = &around {
                    right += around.edge(0);
                    left = left - around.edge(1);
                    own = [around.own(0), around.own(1)];
                }
                let inertia = Block::diagonal(*mass * zero.like(direction.a));
                row[2] = (diagonal + inertia + (own[0] - right)).into();
                row[3] = (right - (q_here + q_after)).into();
                row[4] = q_after.into();
                next_row[0] = qt_here.into();
                next_row[1] = (left - (qt_here + qt_after)).into();
                diagonal = own[1] - left + (q_after + qt_after);
                (q_here, qt_here) = (q_after, qt_after);
            }
        }
        if let ([.., last], [.., a], [.., mass]) = (residual, a, masses) {
            *last = (T::Pair::new(*a) * *mass + before).to_array();
            if let Some(row) = rows.last_mut() {
                row[2] = (diagonal + Block::diagonal(*mass * zero.like(direction.a))).into();
                row[3] = [zero; 4];
                row[4] = [zero; 4];
            }
        }
    }
}
