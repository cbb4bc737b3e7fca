//! The flow regime of a motion around its rod, described by dimensionless numbers.

use std::f64::consts::{FRAC_PI_4, PI, SQRT_2, TAU};

use nalgebra::Vector2;

use crate::fluid::validity::{MISALIGNED, TransverseMotion};
use crate::head::Pose;
use crate::model::Model;
use crate::rod::Rod;
use crate::start::Start;
use crate::system::State;

/// Number of phases of a period at which the prescribed shape is evaluated.
const PHASES: u32 = 32;

/// Number of directions in which widths are measured; the largest width is underestimated by at most 0.1 %.
const DIRECTIONS: u32 = 36;

/// Square of the [dimensionless flow velocity](Regime::flow_velocity) above which the inertia of the water matters for the
/// stability of the rod: the compression mU² of the rod is then a twentieth of [`BECK`].
const STABILITY: f64 = 1.0;

/// The follower force, relative to EI/L², at which a clamped rod begins to flutter. M. Beck, Z. angew. Math. Phys. 3 (1952).
pub const BECK: f64 = 20.05;

/// Motion of a rod relative to the fluid: root mean squares over its nodes and over time, which do not depend on the frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanMotion {
    /// Velocity along the rod, m/s.
    pub along: f64,
    /// Motion across the rod.
    pub across: TransverseMotion,
    /// Half the largest distance between two positions of the tip, relative to the centre of mass of a free rod or to the mean
    /// path of a held head, m.
    pub tip: f64,
}

/// The flow across the rod, described by dimensionless numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regime {
    /// Motion across the rod, with velocity w.
    pub across: TransverseMotion,
    /// Velocity along the rod, m/s.
    pub along: f64,
    /// Frequency f, Hz; `None` if nothing moves periodically.
    pub frequency: Option<f64>,
    /// Depth of the rod across the plane of motion, mean over the length, D, m.
    pub depth: f64,
    /// Re_d = ρ w D/μ, where w is a tenth of the velocity along the rod if that is larger: see [`TransverseMotion::counted`].
    pub reynolds: f64,
    /// Stokes number β = f D²/ν: the boundary layer is thin where it is large.
    pub stokes: Option<f64>,
    /// Keulegan–Carpenter number √2 w/(f D): displacement across the rod relative to its depth.
    pub keulegan_carpenter: Option<f64>,
    /// Added mass over the rod's own, without a head body.
    pub mass_ratio: f64,
    /// Dimensionless flow velocity U L √(m/EI), with U along the rod and m the added mass per length. The effect of the water's
    /// inertia on the stiffness of the rod is proportional to its square; near 5 and above rods flutter.
    pub flow_velocity: f64,
    /// Length divided by the largest radius that is relevant for slow flow.
    pub slenderness: f64,
    /// Half the travel of the tip, m.
    pub tip: f64,
}

impl Regime {
    /// The regime of `rod` under `motion` at this `frequency` (Hz).
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

    /// The velocity in the Reynolds number, m/s: w, or a tenth of the velocity along the rod if that is larger.
    pub fn counted_speed(&self) -> f64 {
        self.across.speed.max(MISALIGNED * self.along)
    }

    /// True if the inertia of the water matters for the stability of the rod, which a motion from rest may not show.
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

/// The shapes that the actuation prescribes over a period, for a rod whose head is held at its initial pose, or for a free rod at
/// rest with the centre of mass of the straight rod.
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

/// The magnitude of `gravity`, m/s².
pub fn size(gravity: [f64; 2]) -> f64 {
    Vector2::from(gravity).norm()
}
