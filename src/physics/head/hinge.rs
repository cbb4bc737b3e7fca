//! A head on a hinge: its position is held, its angle φ is free, and a motor turns it.
//!
//! I φ̈ = T − c φ̇ + M, with the inertia I of what turns with the hinge, the damping c of its bearing, the couple M of the joint at
//! node 0, and the torque T of the motor. The motor is asked for τ + k (φ_c − φ): a torque, and that of a servo of stiffness k on the way
//! to the commanded angle φ_c. It gives T_max tanh(asked/T_max) where it has a limit.
//!
//! Its unknown is the arc s = φ L, so that it is measured against the length as displacements are. It is the last entry of positions,
//! velocities and accelerations, beyond those of the nodes. A held node needs no equations of its own, and that of the hinge takes the
//! place of the first of them: the hinge meets node 1 alone, so that the band stays what it is.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{Sample, Signal};
use crate::actuation::saturation::limited;
use crate::linear::{BandMatrix, Direction};
use crate::system::State;

/// A hinge with its motor. The commanded angle is the third signal of the head's motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Hinge {
    /// Torque τ, N m, before the ramp of the start and without what a host adds.
    pub torque: Signal,
    /// Stiffness k of the servo, N m/rad; zero without one.
    pub stiffness: f64,
    /// Damping c of the bearing, N m s/rad.
    pub damping: f64,
    /// Inertia I of what turns with the hinge, kg m²; positive.
    pub inertia: f64,
    /// T_max, N m, if the motor has a limit.
    pub largest_torque: Option<f64>,
}

/// What a motor is told at one time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct MotorCommand {
    /// Torque τ, N m.
    pub torque: f64,
    /// Commanded angle φ_c, rad.
    pub angle: f64,
}

/// What is left of the equation of motion of a hinge at one state, for a step of Newton's method.
#[derive(Debug, Clone, Copy)]
pub struct HingeResidual {
    /// I φ̈ − T + c φ̇ − M, N m.
    pub moment: f64,
    /// Its derivative by the angle along the direction of the step, with M constant, N m.
    pub slope: f64,
    /// The direction.
    pub direction: Direction,
}

/// The equation of motion of a hinge as a force, (I φ̈ − T + c φ̇ − M)/L, with its derivatives along the direction of a step, N/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HingeEquation {
    /// What is left of it, N.
    pub(crate) residual: f64,
    /// Its derivative by the arc.
    pub(crate) own: f64,
    /// That by node 1.
    pub(crate) by_node: Vector2<f64>,
    /// The derivative of the equations of node 1 by the arc.
    pub(crate) by_arc: Vector2<f64>,
}

impl HingeEquation {
    /// Writes it in the place of the first equation of node 0, which is prescribed in `matrix`.
    pub(crate) fn write(&self, matrix: &mut BandMatrix) {
        if let [first, second, ..] = matrix.rows_mut() {
            first[2][0] = self.own;
            [first[3][0], first[3][1]] = self.by_node.into();
            [second[1][0], second[1][2]] = self.by_arc.into();
        }
    }
}

impl Hinge {
    /// Its angle in `state`, with both rates, of a rod of `nodes` nodes and that `length` (m).
    pub fn angle(state: &State, nodes: usize, length: f64) -> Sample {
        let at = |values: &[f64]| values.get(2 * nodes).map_or(0.0, |arc| arc / length);
        Sample { value: at(&state.q), rate: at(&state.v), acceleration: at(&state.a) }
    }

    /// The torque (N m) that the motor is asked for at `angle` (rad).
    pub fn asked(&self, command: MotorCommand, angle: f64) -> f64 {
        command.torque + self.stiffness * (command.angle - angle)
    }

    /// T (N m) at `angle` (rad), and the part of a further torque that the motor gives if it is asked for it.
    pub fn torque(&self, command: MotorCommand, angle: f64) -> [f64; 2] {
        let asked = self.asked(command, angle);
        self.largest_torque.map_or([asked, 1.0], |most| {
            let [given, part] = limited(asked, most);
            [given, 1.0 - part * part]
        })
    }

    /// The residual where the head is at `angle` and the joint passes on the couple `couple` (N m).
    pub fn residual(&self, command: MotorCommand, angle: Sample, couple: f64, direction: Direction) -> HingeResidual {
        let [torque, given] = self.torque(command, angle.value);
        HingeResidual {
            moment: self.inertia * angle.acceleration - torque + self.damping * angle.rate - couple,
            slope: direction.a * self.inertia + direction.v * self.damping + direction.q * self.stiffness * given,
            direction,
        }
    }
}
