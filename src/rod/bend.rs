//! Bending of one joint: E = ½ B (κ − κ̄)² with κ = 2 (t_e×t_f)/(1+t_e·t_f) = 2 tan(θ/2), θ the turning from e to f.

use nalgebra::{Matrix2, Vector2};

use super::Edge;

/// Below this, 1 + cos θ is a fold-over: the turning is within 2·10⁻⁶ of ±π and κ beyond 10⁶.
pub const FOLD: f64 = 1e-12;

/// Derivatives of the energy of a joint with respect to its two edge vectors e and f.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// ∂E/∂e, N.
    pub e: Vector2<f64>,
    /// ∂E/∂f, N.
    pub f: Vector2<f64>,
    /// ∂²E/∂e², N/m.
    pub ee: Matrix2<f64>,
    /// ∂²E/∂e∂f, N/m.
    pub ef: Matrix2<f64>,
    /// ∂²E/∂f², N/m.
    pub ff: Matrix2<f64>,
}

impl Derivatives {
    /// The same joint where no unknown moves the edge e.
    pub fn with_fixed_start(self) -> Self {
        Self { e: Vector2::zeros(), ee: Matrix2::zeros(), ef: Matrix2::zeros(), ..self }
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

/// Gradient and Hessian of ½ B (κ − κ̄)² with respect to the edge vectors, exact.
///
/// ∇θ = (−n_e/ℓ_e, n_f/ℓ_f), ∇²θ = diag((n tᵀ + t nᵀ)/ℓ² of e, −the same of f), κ' = s = 1 + κ²/4, κ'' = κ s/2:
/// ∇E = m s ∇θ and ∇²E = (B s² + m κ s/2) ∇θ∇θᵀ + m s ∇²θ, with m = B(κ − κ̄).
#[inline]
pub fn derivatives(e: &Edge, f: &Edge, stiffness: f64, kappa: f64, natural: f64) -> Derivatives {
    let s = curvature_per_turning(kappa);
    let m = stiffness * (kappa - natural);
    let (ne, nf) = (e.n(), f.n());
    let (ge, gf) = (ne * (-1.0 / e.length), nf * (1.0 / f.length));
    let outer = stiffness * s * s + 0.5 * m * kappa * s;
    let symmetric = |t: Vector2<f64>, n: Vector2<f64>, length: f64| {
        let nt = n * t.transpose();
        (nt + nt.transpose()) * (m * s / (length * length))
    };
    Derivatives {
        e: ge * (m * s),
        f: gf * (m * s),
        ee: ge * ge.transpose() * outer + symmetric(e.t, ne, e.length),
        ef: ge * gf.transpose() * outer,
        ff: gf * gf.transpose() * outer - symmetric(f.t, nf, f.length),
    }
}
