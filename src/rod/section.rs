//! The cross-section: an annulus, or a disc where the inner radius is zero.

use std::f64::consts::PI;

/// An annulus with outer and inner radius in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Outer radius R_o, m.
    pub outer: f64,
    /// Inner radius R_i, m; zero for a solid rod.
    pub inner: f64,
}

impl Section {
    /// A = π(R_o² − R_i²), m².
    pub fn area(&self) -> f64 {
        PI * (self.outer.powi(2) - self.inner.powi(2))
    }

    /// I = π/4 (R_o⁴ − R_i⁴), m⁴.
    pub fn inertia(&self) -> f64 {
        PI / 4.0 * (self.outer.powi(4) - self.inner.powi(4))
    }

    /// Radius √(A/π) of the disc of equal area, m.
    pub fn equivalent_radius(&self) -> f64 {
        (self.area() / PI).sqrt()
    }
}
