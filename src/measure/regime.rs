//! Which flow a motion makes around its rod, by its numbers.

use std::f64::consts::{FRAC_PI_4, PI, SQRT_2, TAU};

use nalgebra::Vector2;

use crate::fluid::validity::{MISALIGNED, TransverseMotion};
use crate::head::Pose;
use crate::model::Model;
use crate::rod::Rod;
use crate::start::Start;
use crate::system::State;

/// Phases of a period at which the prescribed shape is looked at.
const PHASES: u32 = 32;

/// Directions in which widths are measured: the largest of them is short by 0.1 % at most.
const DIRECTIONS: u32 = 36;

/// Square of the [dimensionless flow velocity](Regime::flow_velocity) from which on the water's inertia counts for whether the rod is
/// stable: the compression mU² of the rod is then a twentieth of [`BECK`].
const STABILITY: f64 = 1.0;

/// The follower force, over EI/L², that makes a clamped rod flutter. M. Beck, Z. angew. Math. Phys. 3 (1952).
pub const BECK: f64 = 20.05;

/// How a rod moves against the fluid: root mean squares over its nodes and over time, the same in every frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanMotion {
    /// Velocity along the rod, m/s.
    pub along: f64,
    /// Across the rod.
    pub across: TransverseMotion,
    /// Half the largest distance between two places of the tip, seen from the centre of mass of a free rod or from where a held head has
    /// gone on the average, m.
    pub tip: f64,
}

/// The flow across the rod, by its numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regime {
    /// The motion across the rod, of velocity w.
    pub across: TransverseMotion,
    /// Velocity along the rod, m/s.
    pub along: f64,
    /// Frequency f, Hz; none where nothing moves periodically.
    pub frequency: Option<f64>,
    /// Depth of the rod across the plane of motion, mean over the length, D, m.
    pub depth: f64,
    /// Re_d = ρ w D/μ, where w is a tenth of the velocity along the rod if that is larger: see [`TransverseMotion::counted`].
    pub reynolds: f64,
    /// Stokes number β = f D²/ν: the boundary layer is thin where it is large.
    pub stokes: Option<f64>,
    /// Keulegan–Carpenter number √2 w/(f D): how far the rod moves across itself, in depths.
    pub keulegan_carpenter: Option<f64>,
    /// Added mass over the rod's own, without a head body.
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
    /// The regime of `rod` that `motion` comes to, at this `frequency` (Hz).
    pub fn of(rod: &Rod, frequency: Option<f64>, motion: &MeanMotion) -> Self {
        let TransverseMotion { speed, fluid, .. } = motion.across;
        let depth = rod.sections.mean(0.0, 1.0, |xi| rod.sections.depth_at(xi));
        let added = FRAC_PI_4 * fluid.density * rod.sections.mean(0.0, 1.0, |xi| rod.sections.at(xi).added());
        let weakest = rod.joints().map(|k| rod.joint[k]).fold(f64::INFINITY, f64::min) * rod.spacing;
        Self {
            across: motion.across,
            along: motion.along,
            frequency,
            depth,
            reynolds: motion.across.counted().0 * depth,
            stokes: frequency.map(|frequency| frequency * depth * depth * fluid.density / fluid.viscosity),
            keulegan_carpenter: frequency.map(|frequency| SQRT_2 * speed / (frequency * depth)),
            mass_ratio: added * rod.length / rod.mass[rod.front..].iter().sum::<f64>(),
            flow_velocity: motion.along * rod.length * (added / weakest).sqrt(),
            slenderness: rod.length / rod.sections.largest_radius(),
            tip: motion.tip,
        }
    }

    /// The velocity that is behind its Reynolds number, m/s: w, or a tenth of that along the rod if that is larger.
    pub fn counted_speed(&self) -> f64 {
        self.across.speed.max(MISALIGNED * self.along)
    }

    /// True where the water's inertia counts for whether the rod is stable, as a motion from rest may not show.
    pub fn water_decides_stability(&self) -> bool {
        self.flow_velocity.powi(2) > STABILITY
    }
}

/// Half the largest distance between two of `places`, m.
pub fn half_width(places: &[Vector2<f64>]) -> f64 {
    let width = |i: u32| {
        let (sin, cos) = (PI * f64::from(i) / f64::from(DIRECTIONS)).sin_cos();
        let along = places.iter().map(|place| place.dot(&Vector2::new(cos, sin)));
        let [low, high] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
        (high - low).max(0.0)
    };
    0.5 * (0..DIRECTIONS).map(width).fold(0.0, f64::max)
}

/// The shapes that the actuation prescribes over a period: of a rod whose head is held as that begins, or which is at rest with the
/// straight rod's centre of mass.
pub fn shapes(model: &Model, head: Option<&Pose>) -> impl Iterator<Item = State> {
    let rod = &model.rod;
    (0..PHASES).map(move |i| {
        let zeros = vec![0.0; rod.nodes];
        let mut natural = model.natural_curvature(TAU * f64::from(i) / f64::from(PHASES));
        rod.at_joints(&mut natural);
        let mut state = State::zeros(2 * rod.nodes);
        Start::Shaped.place(rod, [&natural, &zeros], None, head, &mut state);
        state
    })
}

/// The size of `gravity`, m/s².
pub fn size(gravity: [f64; 2]) -> f64 {
    Vector2::from(gravity).norm()
}
