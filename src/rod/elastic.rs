//! Inertia and elasticity of the whole rod: M a + ∇E and its linearisation, one pass over the nodes.
//!
//! The energy depends on edge vectors only, and every edge i carries a tension N (stretching) and the shear that balances
//! the couples M of the joints at its ends, so ∂E/∂(edge i) = N t + ((M_i − M_{i+1})/ℓ) n: the equilibrium of a beam. The
//! Hessian in edge vectors is block tridiagonal, T on its diagonal and Q beside it; nodes are differences of edges.

use nalgebra::{Matrix2, Vector2};

use super::bend::Joint;
use super::{Edge, Rod, stretch};
use crate::linear::BlockRow;
use crate::system::Direction;

/// ∂E/∂(edge vector), N: the force that the edge carries, between joints `start` and `end`.
#[inline]
pub fn force(edge: &Edge, tension: f64, start: &Joint, end: &Joint) -> Vector2<f64> {
    edge.t * tension + edge.n() * ((start.couple - end.couple) * edge.per_length)
}

/// T = ∂²E/∂(edge vector)², N/m, with the axial stiffness EA/ΔL (N/m).
#[inline]
pub fn stiffness(edge: &Edge, axial: f64, tension: f64, start: &Joint, end: &Joint) -> Matrix2<f64> {
    let (t, n, per_length) = (edge.t, edge.n(), edge.per_length);
    let across = (tension + (start.stiffness + end.stiffness) * per_length) * per_length;
    let mixed = (end.couple - start.couple) * per_length * per_length;
    // axial·t tᵀ + across·n nᵀ + mixed (n tᵀ + t nᵀ)
    t * (t * axial + n * mixed).transpose() + n * (n * across + t * mixed).transpose()
}

/// Q = ∂²E/∂(edge before)∂(edge after) of a joint, N/m.
#[inline]
pub fn coupling(before: &Edge, after: &Edge, joint: &Joint) -> Matrix2<f64> {
    let size = -joint.stiffness * before.per_length * after.per_length;
    before.n() * (after.n() * size).transpose()
}

/// Writes M a + ∇E (N) to `residual` and its linearisation along `direction` to `matrix`, if there is one.
///
/// `joints` has one entry a node; those without a joint are zero.
pub fn assemble(
    rod: &Rod,
    edges: &[Edge],
    joints: &[Joint],
    a: &[f64],
    residual: &mut [f64],
    matrix: Option<(&mut [BlockRow], Direction)>,
) {
    let axial = rod.ea / rod.spacing;
    let (residual, a) = (residual.as_chunks_mut().0, a.as_chunks().0);
    let (mut rows, direction) =
        matrix.map_or((None, Direction { q: 0.0, v: 0.0, a: 0.0 }), |(rows, d)| (Some(rows), d));
    // Of the edge before: its force; its T and the Q of the joints before and at the node, times the factor of positions.
    let mut before = Vector2::zeros();
    let (mut t_before, mut q_before, mut q_here) = (Matrix2::zeros(), Matrix2::zeros(), Matrix2::zeros());
    for (k, mass) in rod.mass.iter().enumerate() {
        let (mut after, mut t_after, mut q_after) = (Vector2::zeros(), Matrix2::zeros(), Matrix2::zeros());
        if let (Some(edge), Some([start, end])) = (edges.get(k), joints.get(k..k + 2)) {
            let tension = stretch::tension(edge, rod.ea, rod.spacing);
            after = force(edge, tension, start, end);
            if rows.is_some() {
                t_after = stiffness(edge, axial, tension, start, end) * direction.q;
                if let Some(next) = edges.get(k + 1) {
                    q_after = coupling(edge, next, end) * direction.q;
                }
            }
        }
        residual[k] = (Vector2::from(a[k]) * *mass + before - after).into();
        before = after;
        if let Some(rows) = &mut rows {
            let inertia = Matrix2::from_diagonal_element(mass * direction.a);
            rows[k] = [
                flat(-q_before.transpose()),
                flat(q_before.transpose() - t_before + q_here.transpose()),
                flat(inertia + t_before + t_after - q_here - q_here.transpose()),
                flat(q_here - t_after + q_after),
                flat(-q_after),
            ];
            (t_before, q_before, q_here) = (t_after, q_here, q_after);
        }
    }
}

/// A block in the order of the matrix. Not by `map` over the row's blocks, which is a call for each.
#[inline(always)]
fn flat(block: Matrix2<f64>) -> [f64; 4] {
    [block.m11, block.m12, block.m21, block.m22]
}
