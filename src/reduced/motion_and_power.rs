//! Mean motion and power of a run over its last cycles, used to compare two fluid models.

use serde::{Deserialize, Serialize};

use super::comparison::NOISE;
use crate::cycle::{Cycle, CycleMeasure, Cycles, FORWARD_SPEED, SPEED, THRUST};
use crate::model::Dynamics;

/// Differences of means are relative to at least this fraction of the mean modulus.
const CANCELLATION_FLOOR: f64 = 0.01;

/// Mean motion and power over the last whole cycles except the first, or over the whole run if there is none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionAndPower {
    /// Forward speed of a free swimmer or speed of a passive free rod (m/s), or thrust on a held head (N).
    pub motion: f64,
    /// Mean modulus of the velocity relative to the flow (m/s), or of the force on the head (N).
    pub modulus: f64,
    /// Power dissipated in the fluid, W.
    pub power: f64,
    /// Noise of motion and power: [`NOISE`] lengths per period, or [`NOISE`] times EI/L².
    pub noise: [f64; 2],
}

impl MotionAndPower {
    /// The measure of the motion.
    pub fn measure(dynamics: &Dynamics) -> CycleMeasure {
        match (&dynamics.model.head, &dynamics.model.actuation) {
            (Some(_), _) => THRUST,
            (None, Some(_)) => FORWARD_SPEED,
            (None, None) => SPEED,
        }
    }

    /// The means over the `cycles` of a run, or `None` before its first step.
    pub fn of(cycles: &Cycles, dynamics: &Dynamics) -> Option<Self> {
        let (whole, all) = (cycles.whole(f64::INFINITY), cycles.since_start());
        // The first cycle contains the start.
        let start = all.map_or(f64::NEG_INFINITY, |all| all.from);
        let whole = if whole.len() > 1 && whole[0].from <= start { &whole[1..] } else { whole };
        let cycles = if whole.is_empty() { all.as_slice() } else { whole };
        let mean = |of: &dyn Fn(&Cycle) -> f64| cycles.iter().map(of).sum::<f64>() / cycles.len() as f64;
        let held = dynamics.model.head.is_some();
        let rod = &dynamics.model.rod;
        let speed = NOISE * rod.length / mean(&Cycle::period);
        let force = NOISE * rod.ei / rod.length.powi(2);
        Some(Self {
            motion: Self::measure(dynamics).mean(cycles, dynamics).filter(|_| !cycles.is_empty())?,
            modulus: mean(&|cycle| if held { cycle.mean_head_force().1 } else { cycle.mean_path_speed() }),
            power: mean(&Cycle::mean_power_into_fluid),
            noise: [if held { force } else { speed }, force * speed],
        })
    }

    /// Relative differences of motion and power from `reference`.
    pub fn differences(&self, reference: &Self) -> [f64; 2] {
        let relative = |a: f64, b: f64, scale: f64| if a == b { 0.0 } else { (a - b) / scale };
        [
            relative(
                self.motion,
                reference.motion,
                reference.motion.abs().max(CANCELLATION_FLOOR * reference.modulus).max(reference.noise[0]),
            ),
            relative(self.power, reference.power, reference.power.abs().max(reference.noise[1])),
        ]
    }
}
