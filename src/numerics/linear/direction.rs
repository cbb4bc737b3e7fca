//! The direction along which a Jacobian is taken: a method's factors of ∂f/∂q, ∂f/∂v and ∂f/∂a.

use super::Number;

/// The direction in which one unknown δ moves the state: δq = `q`·δ, δv = `v`·δ, δa = `a`·δ.
///
/// The Jacobian along it is q ∂f/∂q + v ∂f/∂v + a ∂f/∂a. A method chooses the three numbers from its step size; the
/// model never sees the step itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Factor of the positions.
    pub q: f64,
    /// Factor of the velocities.
    pub v: f64,
    /// Factor of the accelerations.
    pub a: f64,
}

impl Direction {
    /// Moves a node, given by its position, velocity and acceleration, by `d`.
    #[inline(always)]
    pub(crate) fn move_node<T: Number>(self, [q, v, a]: [&mut [T; 2]; 3], d: [T; 2]) {
        for i in 0..2 {
            q[i] += d[i].like(self.q) * d[i];
            v[i] += d[i].like(self.v) * d[i];
            a[i] += d[i].like(self.a) * d[i];
        }
    }

    /// Moves positions alone.
    pub const POSITIONS: Self = Self { q: 1.0, v: 0.0, a: 0.0 };
    /// Moves velocities alone.
    pub const VELOCITIES: Self = Self { q: 0.0, v: 1.0, a: 0.0 };
    /// Moves accelerations alone.
    pub const ACCELERATIONS: Self = Self { q: 0.0, v: 0.0, a: 1.0 };
}
