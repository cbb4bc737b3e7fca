//! Bending of one joint: E = ½ B (κ − κ̄)² with κ = 2 (t_e×t_f)/(1+t_e·t_f) = 2 tan(θ/2), θ the turning from e to f.

use nalgebra::Vector2;

/// Below this, 1 + cos θ is a fold-over: the turning is within 2·10⁻⁶ of ±π and κ beyond 10⁶.
pub const FOLD: f64 = 1e-12;

/// Derivatives of a joint's energy by its turning θ; zero where there is no joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Joint {
    /// Couple M = dE/dθ that the joint passes on, N m.
    pub couple: f64,
    /// dM/dθ = d²E/dθ², N m.
    pub stiffness: f64,
}

impl Joint {
    /// The joint of stiffness `stiffness` B (N m), curvature κ and natural curvature κ̄: with s = dκ/dθ = 1 + κ²/4 and
    /// ds/dθ = κ s/2, M = B(κ−κ̄) s and dM/dθ = B s² + ½ κ M.
    #[inline]
    pub fn new(stiffness: f64, kappa: f64, natural: f64) -> Self {
        let s = curvature_per_turning(kappa);
        let couple = stiffness * (kappa - natural) * s;
        Self { couple, stiffness: stiffness * s * s + 0.5 * kappa * couple }
    }
}

/// Discrete curvature κ = 2 tan(θ/2) between unit tangents; not finite at fold-over.
#[inline]
pub fn curvature(e: Vector2<f64>, f: Vector2<f64>) -> f64 {
    2.0 * e.perp(&f) / (1.0 + e.dot(&f))
}

/// dκ/dθ = 1 + κ²/4.
#[inline]
pub fn curvature_per_turning(kappa: f64) -> f64 {
    1.0 + 0.25 * kappa * kappa
}

/// Turning θ of a joint of curvature κ, inverse of κ = 2 tan(θ/2).
#[inline]
pub fn turning(kappa: f64) -> f64 {
    2.0 * (0.5 * kappa).atan()
}
