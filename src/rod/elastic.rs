//! Inertia and elasticity of the whole rod: M a + ∇E and its linearisation, one pass over the nodes.
//!
//! The energy depends on edge vectors only, and every edge i carries a tension N (stretching) and the shear that balances
//! the couples M of the joints at its ends, so ∂E/∂(edge i) = N t + ((M_i − M_{i+1})/ℓ) n: the equilibrium of a beam. The
//! Hessian in edge vectors is block tridiagonal, T on its diagonal and Q beside it; nodes are differences of edges.

use nalgebra::{Matrix2, Vector2};

use super::bend::Joint;
use super::{Edge, Rod, node, stretch};
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
    let mut before = Vector2::zeros();
    for (k, mass) in rod.mass.iter().enumerate() {
        let after = edges.get(k).map_or(Vector2::zeros(), |edge| {
            force(edge, stretch::tension(edge, rod.ea, rod.spacing), &joints[k], &joints[k + 1])
        });
        let sum = node(a, k) * *mass + before - after;
        residual[2 * k..2 * k + 2].copy_from_slice(sum.as_slice());
        before = after;
    }
    let Some((rows, direction)) = matrix else { return };
    // T of the edge before a node, and Q of the joints before and at it, all times the factor of the positions.
    let (mut t_before, mut q_before, mut q_here) = (Matrix2::zeros(), Matrix2::zeros(), Matrix2::zeros());
    for (k, (row, mass)) in rows.iter_mut().zip(&rod.mass).enumerate() {
        let t_after = edges.get(k).map_or(Matrix2::zeros(), |edge| {
            let tension = stretch::tension(edge, rod.ea, rod.spacing);
            stiffness(edge, axial, tension, &joints[k], &joints[k + 1]) * direction.q
        });
        let q_after = match edges.get(k..k + 2) {
            Some([edge, next]) => coupling(edge, next, &joints[k + 1]) * direction.q,
            _ => Matrix2::zeros(),
        };
        let inertia = Matrix2::from_diagonal_element(mass * direction.a);
        *row = [
            -q_before.transpose(),
            q_before.transpose() - t_before + q_here.transpose(),
            inertia + t_before + t_after - q_here - q_here.transpose(),
            q_here - t_after + q_after,
            -q_after,
        ]
        .map(|block| [block.m11, block.m12, block.m21, block.m22]);
        (t_before, q_before, q_here) = (t_after, q_here, q_after);
    }
}
