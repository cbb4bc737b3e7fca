//! Stretching of one edge: E = ½ EA ΔL ((ℓ−ΔL)/ΔL)².

use nalgebra::{Matrix2, Vector2};

use super::Edge;

/// Energy (J) of an edge of stiffness `ea` (N) and rest length `spacing` (m).
#[inline]
pub fn energy(edge: &Edge, ea: f64, spacing: f64) -> f64 {
    let strain = (edge.length - spacing) / spacing;
    0.5 * ea * spacing * strain * strain
}

/// Gradient (N) and Hessian (N/m) of the energy with respect to the edge vector:
/// EA (ℓ/ΔL − 1) t and EA/ΔL [t tᵀ + (1 − ΔL/ℓ) n nᵀ].
#[inline]
pub fn derivatives(edge: &Edge, ea: f64, spacing: f64) -> (Vector2<f64>, Matrix2<f64>) {
    let stretch = edge.length - spacing;
    let axial = ea / spacing;
    let (t, n) = (edge.t, edge.n());
    let gradient = t * (axial * stretch);
    let hessian = t * t.transpose() * axial + n * n.transpose() * (axial * stretch / edge.length);
    (gradient, hessian)
}
