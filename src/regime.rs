//! Which flow a motion makes around its rod, by its numbers.

use std::borrow::Borrow;
use std::f64::consts::{FRAC_PI_4, SQRT_2, TAU};

use nalgebra::Vector2;

use crate::actuation::{Actuation, Wave};
use crate::fluid::Fluid;
use crate::model::Drive;
use crate::rod::Rod;
use crate::start::Start;
use crate::system::State;

/// Phases of a period at which the prescribed shape is looked at.
const PHASES: u32 = 32;

/// The part of the velocity along the rod that counts as across it: no rod lies along a flow exactly.
pub const MISALIGNED: f64 = 0.1;

/// How a rod moves against the fluid: root mean squares over its nodes and over time, the same in every frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Velocity along the rod, m/s.
    pub along: f64,
    /// Velocity w across it with [`MISALIGNED`] of that along it, m/s.
    pub across: f64,
    /// ρw/μ where each node is, 1/m.
    pub inertia: f64,
    /// Half the largest distance between two places of the tip, seen from the centre of mass of a free rod, m.
    pub tip: f64,
}

/// The flow across the rod, by its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regime {
    /// Root mean square of the velocity across the rod, w, m/s.
    pub speed: f64,
    /// Frequency f, Hz; none where nothing moves periodically.
    pub frequency: Option<f64>,
    /// Depth of the rod across the plane of motion, mean over the length, D, m.
    pub depth: f64,
    /// Re_d = ρ w D/μ.
    pub reynolds: f64,
    /// Stokes number β = f D²/ν: the boundary layer is thin where it is large.
    pub stokes: Option<f64>,
    /// Keulegan–Carpenter number √2 w/(f D): how far the rod moves across itself, in depths.
    pub keulegan_carpenter: Option<f64>,
    /// Added mass over the rod's own.
    pub mass_ratio: f64,
    /// Dimensionless flow velocity U L √(m/EI), U along the rod and m the added mass per length: what the water's inertia does to the
    /// stiffness of the rod goes with its square, and near 5 and above rods flutter.
    pub flow_velocity: f64,
    /// Length over the largest radius that slow flow sees.
    pub slenderness: f64,
    /// Half of how far the tip moves, m.
    pub tip: f64,
}

impl Regime {
    /// The regime of `rod` in `fluid` that `motion` comes to, at this `frequency` (Hz).
    pub fn of(rod: &Rod, fluid: Fluid, frequency: Option<f64>, motion: &Motion) -> Self {
        let depth = rod.sections.mean(0.0, 1.0, |xi| rod.sections.depth_at(xi));
        let added = FRAC_PI_4 * fluid.density * rod.sections.mean(0.0, 1.0, |xi| rod.sections.at(xi).added());
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        Self {
            speed: motion.across,
            frequency,
            depth,
            reynolds: motion.inertia * depth,
            stokes: frequency.map(|frequency| frequency * depth * depth * fluid.density / fluid.viscosity),
            keulegan_carpenter: frequency.map(|frequency| SQRT_2 * motion.across / (frequency * depth)),
            mass_ratio: added * rod.length / rod.total_mass(),
            flow_velocity: motion.along * rod.length * (added / weakest).sqrt(),
            slenderness: rod.length / rod.sections.largest_radius(),
            tip: motion.tip,
        }
    }
}

/// Largest |y| of the tip of `shapes`, m.
pub fn reach(shapes: impl Iterator<Item = impl Borrow<State>>) -> f64 {
    shapes.fold(0.0, |most, shape| shape.borrow().q.last().map_or(most, |y| y.abs().max(most)))
}

/// The shapes that the actuation prescribes over a period, at rest, with the straight rod's centre of mass.
pub fn shapes(rod: &Rod, actuation: &dyn Actuation, drive: Drive) -> impl Iterator<Item = State> {
    (0..PHASES).map(move |i| {
        let (mut natural, zeros) = (vec![0.0; rod.nodes], vec![0.0; rod.nodes]);
        let phase = TAU * f64::from(i) / f64::from(PHASES);
        let wave = Wave { amplitude: drive.amplitude, gain: 1.0, gain_rate: 0.0, phase, phase_rate: 0.0 };
        actuation.add(wave, &mut natural, &mut zeros.clone());
        let mut state = State::zeros(2 * rod.nodes);
        Start::Shaped.place(rod, &natural, &zeros, None, &mut state);
        state
    })
}

/// The size of `gravity`, m/s².
pub fn size(gravity: [f64; 2]) -> f64 {
    Vector2::from(gravity).norm()
}
