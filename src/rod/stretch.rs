//! Stretching of one edge: E = ½ EA ΔL ((ℓ−ΔL)/ΔL)².

use super::Edge;

/// Energy (J) of an edge of stiffness `ea` (N) and rest length `spacing` (m).
#[inline]
pub fn energy(edge: &Edge, ea: f64, spacing: f64) -> f64 {
    0.5 * tension(edge, ea, spacing) * (edge.length - spacing)
}

/// Tension dE/dℓ = (EA/ΔL)(ℓ−ΔL), N; EA/ΔL is one division for all edges.
#[inline]
pub fn tension(edge: &Edge, ea: f64, spacing: f64) -> f64 {
    (ea / spacing) * (edge.length - spacing)
}
