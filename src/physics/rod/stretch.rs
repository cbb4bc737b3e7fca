//! Stretching of one edge: E = ½ (EA/ℓ₀) (ℓ − ℓ₀)², where ℓ₀ is its rest length.

use super::Edge;
use crate::linear::Real;

/// Rest length and axial stiffness of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Cell<T = f64> {
    /// Rest length ℓ₀, m.
    pub rest: T,
    /// Axial stiffness EA/ℓ₀, N/m.
    pub axial: T,
}

impl<T: Real> Cell<T> {
    /// Tension dE/dℓ = (EA/ℓ₀)(ℓ−ℓ₀), N.
    #[inline(always)]
    pub fn tension(&self, edge: &Edge<T>) -> T {
        self.axial * (edge.length - self.rest)
    }

    /// Energy of `edge`, J.
    #[inline(always)]
    pub fn energy(&self, edge: &Edge<T>) -> T {
        edge.length.like(0.5) * self.tension(edge) * (edge.length - self.rest)
    }
}

impl Cell {
    /// Length (m) under the tension `tension` (N).
    #[inline]
    pub fn length(&self, tension: f64) -> f64 {
        self.rest + tension / self.axial
    }
}
