//! Bending of one joint: E = ½ B (κ − κ̄)² with κ = 2 (t_e×t_f)/(1+t_e·t_f) = 2 tan(θ/2), where θ is the turning angle
//! from e to f.

use nalgebra::Vector2;

use super::Edge;
use crate::linear::Real;

/// If 1 + cos θ is below this, the rod folds over: the turning angle is within 2·10⁻⁶ of ±π, and κ is beyond 10⁶.
pub const FOLD: f64 = 1e-12;

/// Derivatives of a joint's energy with respect to its turning angle θ; zero where there is no joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Joint<T = f64> {
    /// Couple M = dE/dθ that the joint transmits, N m.
    pub couple: T,
    /// dM/dθ = d²E/dθ², N m.
    pub stiffness: T,
}

impl<T: Real> Joint<T> {
    /// The joint with `stiffness` B (N m), curvature κ and natural curvature κ̄: with s = dκ/dθ = 1 + κ²/4 and
    /// ds/dθ = κ s/2, M = B(κ−κ̄) s and dM/dθ = B s² + ½ κ M.
    #[inline(always)]
    pub fn new(stiffness: T, kappa: T, natural: T) -> Self {
        let s = curvature_per_turning(kappa);
        let couple = stiffness * (kappa - natural) * s;
        Self { couple, stiffness: stiffness * s * s + kappa.like(0.5) * kappa * couple }
    }
}

/// Discrete curvature κ = 2 tan(θ/2) between unit tangents; not finite at fold-over.
#[inline(always)]
pub fn curvature<T: Real>(e: Vector2<T>, f: Vector2<T>) -> T {
    e.x.like(2.0) * (e.x * f.y - e.y * f.x) / beyond_fold(e, f)
}

/// 1 + cos θ, zero at fold-over.
#[inline(always)]
pub fn beyond_fold<T: Real>(e: Vector2<T>, f: Vector2<T>) -> T {
    e.x.like(1.0) + (e.x * f.x + e.y * f.y)
}

/// Computes the joint at the start of each of `edges`, with `stiffness` and `natural` curvature, and its curvature
/// `kappa`. `clamp_tangent` is the tangent before the first joint, if there is one. `look` receives the index and
/// 1 + cos θ of each joint.
#[inline(always)]
pub fn joints<T: Real>(
    clamp_tangent: Option<Vector2<T>>,
    edges: &[Edge<T>],
    stiffness: &[T],
    natural: &[T],
    joints: &mut [Joint<T>],
    kappa: &mut [T],
    mut look: impl FnMut(usize, T),
) {
    let mut before = clamp_tangent;
    let parts = edges.iter().zip(stiffness).zip(natural).zip(joints).zip(kappa);
    for (k, ((((after, stiffness), natural), joint), kappa)) in parts.enumerate() {
        if let Some(before) = before {
            look(k, beyond_fold(before, after.t));
            *kappa = curvature(before, after.t);
            *joint = Joint::new(*stiffness, *kappa, *natural);
        }
        before = Some(after.t);
    }
}

/// Writes m = B (κ − κ̄), N m, conjugate to κ: zero where there is no joint.
#[inline(always)]
pub fn moments<T: Real>(stiffness: &[T], kappa: &[T], natural: &[T], moments: &mut [T]) {
    for (((moment, stiffness), kappa), natural) in moments.iter_mut().zip(stiffness).zip(kappa).zip(natural) {
        *moment = *stiffness * (*kappa - *natural);
    }
}

/// dκ/dθ = 1 + κ²/4.
#[inline(always)]
pub fn curvature_per_turning<T: Real>(kappa: T) -> T {
    kappa.like(1.0) + kappa.like(0.25) * kappa * kappa
}

/// Turning angle θ of a joint of curvature κ, the inverse of κ = 2 tan(θ/2).
#[inline]
pub fn turning(kappa: f64) -> f64 {
    2.0 * (0.5 * kappa).atan()
}
