//! Inertia and elasticity of the whole rod, and what else acts on its edges: M a + ∇E + ΣF and its linearisation, one
//! pass over the edges in which every block is written once.
//!
//! The energy depends on edge vectors only, and every edge i carries a tension N (stretching) and the shear that balances
//! the couples M of the joints at its ends, so ∂E/∂(edge i) = N t + ((M_i − M_{i+1})/ℓ) n: the equilibrium of a beam. The
//! Hessian in edge vectors is block tridiagonal, T on its diagonal and Q beside it; nodes are differences of edges. What
//! else acts on the ends of an edge depends on their motion and on the edge, so it joins them.

use nalgebra::Vector2;
use wide::f64x2;

use super::around::OnEdge;
use super::bend::Joint;
use super::{Edge, Rod};
use crate::linear::{Block, BlockRow, lanes};
use crate::system::{Direction, Linearisation};

/// ∂E/∂(edge vector), N: the force that the edge carries, between joints `start` and `end`.
#[inline]
pub fn force(edge: &Edge, tension: f64, start: &Joint, end: &Joint) -> Vector2<f64> {
    edge.t * tension + edge.n() * shear(edge, start, end)
}

/// The force (N) across an edge that balances the couples of its joints.
#[inline]
fn shear(edge: &Edge, start: &Joint, end: &Joint) -> f64 {
    (start.couple - end.couple) * edge.per_length
}

/// `factor` times T = ∂²E/∂(edge vector)², N/m, with the axial stiffness EA/ΔL (N/m).
#[inline]
pub fn stiffness(edge: &Edge, axial: f64, tension: f64, [start, end]: [&Joint; 2], factor: f64) -> Block {
    let (t, n) = (lanes(edge.t), lanes(edge.n()));
    let per_length = factor * edge.per_length;
    let along = axial * factor;
    let across = (tension + (start.stiffness + end.stiffness) * edge.per_length) * per_length;
    let mixed = -shear(edge, start, end) * per_length;
    // along·t tᵀ + across·n nᵀ + mixed (n tᵀ + t nᵀ)
    Block::outer(edge.t, t * along + n * mixed) + Block::outer(edge.n(), n * across + t * mixed)
}

/// `factor` times Q = ∂²E/∂(edge before)∂(edge after) of a joint, N/m.
#[inline]
pub fn coupling(before: &Edge, after: &Edge, joint: &Joint, factor: f64) -> Block {
    let size = -joint.stiffness * (factor * before.per_length) * after.per_length;
    Block::outer(before.n(), lanes(after.n()) * size)
}

/// A rod as it is at one time.
#[derive(Debug, Clone, Copy)]
pub struct Deformed<'a> {
    /// The rod.
    pub rod: &'a Rod,
    /// Its edges.
    pub edges: &'a [Edge],
    /// One entry per node; those without a joint are zero.
    pub joints: &'a [Joint],
    /// Accelerations, m/s², two entries per node.
    pub a: &'a [f64],
}

impl Deformed<'_> {
    /// Writes M a + ∇E (N), and what opposes the motion of every edge from `around`, to `residual` and its linearisation to
    /// `jacobian`, if there is one.
    #[inline]
    pub fn assemble(
        &self,
        around: impl Iterator<Item = Option<OnEdge>>,
        residual: &mut [f64],
        jacobian: Option<Linearisation<'_>>,
    ) {
        let Self { rod, edges, joints, a } = *self;
        let (residual, a) = (residual.as_chunks_mut().0, a.as_chunks().0);
        let (rows, direction): (&mut [BlockRow], _) = match jacobian {
            Some(Linearisation { matrix, direction }) => (matrix.rows_mut(), direction),
            None => (&mut [], Direction { q: 0.0, v: 0.0, a: 0.0 }),
        };
        if let Some(row) = rows.first_mut() {
            *row = BlockRow::default();
        }
        // Of the edge before: what it adds to the residual and to the diagonal block of this node, and −Q of the joint here
        // with its transpose.
        let mut before = f64x2::ZERO;
        let (mut diagonal, mut q_here, mut qt_here) = (Block::ZERO, Block::ZERO, Block::ZERO);
        let ends = joints.iter().zip(joints.iter().skip(1));
        let here = edges.iter().zip(ends).zip(around).zip(a).zip(&rod.mass).enumerate();
        for (k, ((((edge, (start, end)), around), a), mass)) in here {
            let cell = &rod.cells[k];
            let tension = cell.tension(edge);
            let force = lanes(force(edge, tension, start, end));
            let mut sum = f64x2::new(*a) * *mass + before;
            before = force;
            if let Some(around) = &around {
                sum += around.force_lanes(0);
                before += around.force_lanes(1);
            }
            residual[k] = (sum - force).to_array();
            // Not `let … else { continue }`: that takes a tenth more time.
            if let Some([row, next_row]) = rows.get_mut(k..k + 2) {
                // −T and −Q, as more blocks need them than T and Q.
                let t = stiffness(edge, cell.axial, tension, [start, end], -direction.q);
                let q_after = edges.get(k + 1).map_or(Block::ZERO, |next| coupling(edge, next, end, -direction.q));
                let qt_after = q_after.transpose();
                let (mut right, mut left) = (t, t);
                let mut own = [Block::ZERO; 2];
                if let Some(around) = &around {
                    right += around.edge(0);
                    left = left - around.edge(1);
                    own = [around.own(0), around.own(1)];
                }
                row[2] = (diagonal + Block::diagonal(mass * direction.a) + (own[0] - right)).into();
                row[3] = (right - (q_here + q_after)).into();
                row[4] = q_after.into();
                next_row[0] = qt_here.into();
                next_row[1] = (left - (qt_here + qt_after)).into();
                diagonal = own[1] - left + (q_after + qt_after);
                (q_here, qt_here) = (q_after, qt_after);
            }
        }
        if let ([.., last], [.., a], [.., mass]) = (residual, a, &rod.mass[..]) {
            *last = (f64x2::new(*a) * *mass + before).to_array();
            if let Some(row) = rows.last_mut() {
                row[2] = (diagonal + Block::diagonal(mass * direction.a)).into();
                row[3] = [0.0; 4];
                row[4] = [0.0; 4];
            }
        }
    }
}
