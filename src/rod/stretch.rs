//! Stretching of one edge: E = ½ (EA/ℓ₀) (ℓ − ℓ₀)², with ℓ₀ its length at rest.

use super::Edge;

/// How an edge resists stretching.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Cell {
    /// Length at rest ℓ₀, m.
    pub rest: f64,
    /// Axial stiffness EA/ℓ₀, N/m.
    pub axial: f64,
}

impl Cell {
    /// Energy of `edge`, J.
    #[inline]
    pub fn energy(&self, edge: &Edge) -> f64 {
        0.5 * self.tension(edge) * (edge.length - self.rest)
    }

    /// Tension dE/dℓ = (EA/ℓ₀)(ℓ−ℓ₀), N.
    #[inline]
    pub fn tension(&self, edge: &Edge) -> f64 {
        self.axial * (edge.length - self.rest)
    }

    /// Length (m) under a tension of `tension` N.
    #[inline]
    pub fn length(&self, tension: f64) -> f64 {
        self.rest + tension / self.axial
    }
}
