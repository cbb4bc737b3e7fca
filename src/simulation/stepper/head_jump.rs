//! Detection of jumps in the pose or velocity that a host gives for the head.

use super::Stepper;
use crate::model::Mechanics;

/// A pose is a jump if it differs from the extrapolated one by at least this fraction of the length, or by this angle (rad). A
/// velocity is a jump if it makes a clamped rod oscillate in its first mode with this amplitude.
const MIN_RELATIVE_JUMP: f64 = 0.05;

/// βL² of the first mode of a clamped rod: ω₁ = (βL)² √(EI/(m L³)).
const FIRST_MODE_COEFFICIENT: f64 = 3.516;

/// A jump of the pose or of the velocity that a host gives from one step to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadJump {
    /// Time of the jump, s.
    pub time: f64,
    /// Coordinate: x, y or angle.
    pub coordinate: usize,
    /// Order of the derivative that jumps: 0 for the pose, 1 for the velocity.
    pub order: usize,
    /// Size of the jump: m or rad for a pose, m/s or rad/s for a velocity.
    pub distance: f64,
}

impl std::fmt::Display for HeadJump {
    /// The warning message, identical in every interface.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { time, coordinate, order, distance } = *self;
        let (what, unit) = [
            [("position x", "m"), ("position y", "m"), ("angle", "rad")],
            [("velocity x", "m/s"), ("velocity y", "m/s"), ("spin", "rad/s")],
        ][order.min(1)][coordinate.min(2)];
        let [was, goes, gives, places] = if order == 0 {
            ["the expected one", "moves there", "poses", "pose"]
        } else {
            ["the previous one", "reaches it", "velocities", "velocity"]
        };
        write!(
            f,
            "the {what} given for the head is {distance:.3e} {unit} from {was} at t = {time:.6} s; the head {goes} within one step, \
             which makes the tail vibrate, for long if its stretching is not damped: give {gives} that are continuous, or the first {places} before the first step, so that the run starts there"
        )
    }
}

impl Stepper {
    /// Returns the largest jump of the head since the last call and clears it. Every interface reports it after a step: the FMU
    /// in its log, Python as a warning, C by `caudal_note`.
    pub fn take_head_jump(&mut self) -> Option<HeadJump> {
        self.head_jump.take()
    }

    /// Restores the value that [`take_head_jump`](Self::take_head_jump) returned, in place of what was recorded since.
    pub(crate) fn put_head_jump(&mut self, jump: Option<HeadJump>) {
        self.head_jump = jump;
    }

    /// Records the distances (m, m, rad) of the pose given at time `t` (s) from the extrapolated pose, and of the velocity from
    /// the previous one.
    pub(super) fn note_jump(&mut self, time: f64, distances: [[f64; 2]; 3]) {
        if distances == [[0.0; 2]; 3] {
            return;
        }
        let rod = &self.dynamics.model.rod;
        let length = rod.length;
        let omega = match self.dynamics.mechanics {
            Mechanics::Overdamped => f64::INFINITY, // without inertia nothing oscillates
            _ => FIRST_MODE_COEFFICIENT * (rod.ei / (rod.total_mass() * length.powi(3))).sqrt(),
        };
        let units = [1.0, omega].map(|per_time| [length, length, 1.0].map(|unit| unit * per_time));
        let part = |jump: &HeadJump| jump.distance / units[jump.order][jump.coordinate];
        for (coordinate, distances) in distances.into_iter().enumerate() {
            for (order, distance) in distances.into_iter().enumerate() {
                let jump = HeadJump { time, coordinate, order, distance };
                if part(&jump) >= MIN_RELATIVE_JUMP
                    && self.head_jump.as_ref().is_none_or(|known| part(known) < part(&jump))
                {
                    self.head_jump = Some(jump);
                }
            }
        }
    }
}
