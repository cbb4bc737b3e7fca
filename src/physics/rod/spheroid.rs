//! A rigid body in front of the rod.

use std::f64::consts::PI;

/// A spheroid of revolution about its axis along the rod.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheroid {
    /// Semi-axis along the rod a, m.
    pub along: f64,
    /// Semi-axis across it b, m.
    pub across: f64,
}

impl Spheroid {
    /// Volume 4/3 π a b², m³.
    pub fn volume(&self) -> f64 {
        4.0 / 3.0 * PI * self.along * self.across * self.across
    }

    /// Moment of inertia (a² + b²)/5 of a homogeneous body of 1 kg about an axis across it, m².
    pub fn inertia(&self) -> f64 {
        (self.along * self.along + self.across * self.across) / 5.0
    }

    /// Frontal areas along and across it, πb² and πab, m².
    pub fn areas(&self) -> [f64; 2] {
        [PI * self.across * self.across, PI * self.along * self.across]
    }
}
