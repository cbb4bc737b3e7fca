//! Stretching of one edge: E = ½ EA ΔL ((ℓ−ΔL)/ΔL)².

use super::Edge;

/// Energy (J) of an edge of stiffness `ea` (N) and rest length `spacing` (m).
#[inline]
pub fn energy(edge: &Edge, ea: f64, spacing: f64) -> f64 {
    0.5 * tension(edge, ea, spacing) * (edge.length - spacing)
}

/// Tension dE/dℓ = EA (ℓ−ΔL)/ΔL, N.
#[inline]
pub fn tension(edge: &Edge, ea: f64, spacing: f64) -> f64 {
    ea * ((edge.length - spacing) / spacing)
}
