//! A head on a hinge: its position is held, its angle φ is free, and a motor turns it.
//!
//! I φ̈ = T − c φ̇ + M, with the inertia I of the parts that rotate about the hinge, the damping c of its bearing, the
//! moment M of the joint at node 0, and the motor torque T. The requested torque is τ + k (φ_c − φ): a prescribed
//! torque, and that of a servo of stiffness k that drives the head to the commanded angle φ_c. A motor with a limit
//! delivers T_max tanh(requested/T_max).
//!
//! The unknown is the arc s = φ L, so that it scales like displacements. It is the last entry of positions, velocities
//! and accelerations, after those of the nodes. The held node needs no equations of its own, so the equation of the
//! hinge replaces the first of them: the hinge is coupled to node 1 only, and the bandwidth stays the same.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{Sample, Signal};
use crate::actuation::saturation::limited;
use crate::linear::{BandMatrix, Direction};
use crate::system::State;

/// A hinge with its motor. The commanded angle is the third signal of the head's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Hinge {
    /// Torque τ, N m, without the start ramp and without the host's contribution.
    pub torque: Signal,
    /// Stiffness k of the servo, N m/rad; zero without one.
    pub stiffness: f64,
    /// Damping c of the bearing, N m s/rad.
    pub damping: f64,
    /// Inertia I of the parts that rotate about the hinge, kg m²; positive.
    pub inertia: f64,
    /// T_max, N m, if the motor has a limit.
    pub largest_torque: Option<f64>,
}

/// Inputs of a motor at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorCommand {
    /// Torque τ, N m.
    pub torque: f64,
    /// Commanded angle φ_c, rad.
    pub angle: f64,
}

/// The residual of the equation of motion of a hinge at one state, for a step of Newton's method.
#[derive(Debug, Clone, Copy)]
pub struct HingeResidual {
    /// I φ̈ − T + c φ̇ − M, N m.
    pub moment: f64,
    /// Its derivative with respect to the angle along the direction of the step, with M constant, N m.
    pub slope: f64,
    /// The direction.
    pub direction: Direction,
}

/// The equation of motion of a hinge as a force, (I φ̈ − T + c φ̇ − M)/L, with its derivatives along the direction of a
/// step, N/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HingeEquation {
    /// Residual, N.
    pub(crate) residual: f64,
    /// Derivative with respect to the arc.
    pub(crate) own: f64,
    /// Derivative with respect to the position of node 1.
    pub(crate) by_node: Vector2<f64>,
    /// Derivative of the equations of node 1 with respect to the arc.
    pub(crate) by_arc: Vector2<f64>,
}

impl HingeEquation {
    /// Writes the equation in place of the first one of node 0, which is prescribed in `matrix`.
    pub(crate) fn write(&self, matrix: &mut BandMatrix) {
        if let [first, second, ..] = matrix.rows_mut() {
            first[2][0] = self.own;
            [first[3][0], first[3][1]] = self.by_node.into();
            [second[1][0], second[1][2]] = self.by_arc.into();
        }
    }
}

impl Hinge {
    /// The angle in `state`, with both derivatives, for a rod of `nodes` nodes and this `length` (m).
    pub fn angle(state: &State, nodes: usize, length: f64) -> Sample {
        let at = |values: &[f64]| values.get(2 * nodes).map_or(0.0, |arc| arc / length);
        Sample { value: at(&state.q), rate: at(&state.v), acceleration: at(&state.a) }
    }

    /// The torque (N m) requested from the motor at `angle` (rad).
    pub fn asked(&self, command: MotorCommand, angle: f64) -> f64 {
        command.torque + self.stiffness * (command.angle - angle)
    }

    /// T (N m) at `angle` (rad), and its derivative with respect to the requested torque.
    pub fn torque(&self, command: MotorCommand, angle: f64) -> [f64; 2] {
        let asked = self.asked(command, angle);
        self.largest_torque.map_or([asked, 1.0], |most| {
            let [given, part] = limited(asked, most);
            [given, 1.0 - part * part]
        })
    }

    /// The residual if the head is at `angle` and the joint transmits the moment `couple` (N m).
    pub fn residual(&self, command: MotorCommand, angle: Sample, couple: f64, direction: Direction) -> HingeResidual {
        let [torque, given] = self.torque(command, angle.value);
        HingeResidual {
            moment: self.inertia * angle.acceleration - torque + self.damping * angle.rate - couple,
            slope: direction.a * self.inertia + direction.v * self.damping + direction.q * self.stiffness * given,
            direction,
        }
    }
}
