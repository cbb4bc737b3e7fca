//! Which flow a scene makes around its rod, from the motion that it prescribes itself: no run is needed.

use std::borrow::Borrow;
use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::Vector2;

use crate::actuation::{Actuation, Wave};
use crate::fluid::Fluid;
use crate::head::{Motion, Signal};
use crate::model::Drive;
use crate::rod::{Rod, node};
use crate::start::Start;
use crate::system::State;

/// Phases of a period at which the prescribed shape is looked at.
const PHASES: u32 = 32;

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
    /// Length over the largest radius.
    pub slenderness: f64,
    /// Largest |y| of the tip of the shape that the actuation prescribes, at rest, m.
    pub tip: Option<f64>,
}

impl Regime {
    /// The regime of `rod` under that actuation and motion of its head in `fluid`; a passive rod falls with the acceleration
    /// `gravity` (m/s²).
    pub fn of(
        rod: &Rod,
        actuation: Option<&(Box<dyn Actuation>, Drive)>,
        head: Option<&Motion>,
        fluid: Fluid,
        gravity: f64,
    ) -> Self {
        let depth = rod.sections.mean(0.0, 1.0, |xi| rod.sections.depth_at(xi));
        let added = FRAC_PI_4 * fluid.density * rod.sections.mean(0.0, 1.0, |xi| rod.sections.depth_at(xi).powi(2));
        let line_density = rod.total_mass() / rod.length;
        let (mut squares, mut frequency, mut tip) = (0.0, None, None);
        if let Some((actuation, drive)) = actuation {
            let shapes: Vec<State> = shapes(rod, &**actuation, *drive).collect();
            squares += wave(rod, &shapes, drive.frequency);
            tip = Some(reach(shapes.iter()));
            frequency = Some(drive.frequency).filter(|frequency| *frequency > 0.0);
        }
        // Of a head that turns, half the length is the mean arm.
        for (signal, arm) in head.into_iter().flatten().zip([0.0, 1.0, 0.5 * rod.length]) {
            if let Signal::Sinusoid { amplitude, frequency: own, .. } = signal {
                squares += 0.5 * (arm * amplitude * TAU * own).powi(2);
                frequency = Some(frequency.map_or(*own, |other: f64| other.max(*own))).filter(|own| *own > 0.0);
            }
        }
        // A flow meets the rod along itself; across it only where a head holds it or nothing else moves.
        squares += fluid.flow.y.powi(2);
        if squares == 0.0 {
            squares = fluid.flow.norm_squared() + falling(line_density, gravity, depth, fluid).powi(2);
        }
        let speed = squares.sqrt();
        Self {
            speed,
            frequency,
            depth,
            reynolds: fluid.density * speed * depth / fluid.viscosity,
            stokes: frequency.map(|frequency| frequency * depth * depth * fluid.density / fluid.viscosity),
            keulegan_carpenter: frequency.map(|frequency| std::f64::consts::SQRT_2 * speed / (frequency * depth)),
            mass_ratio: added / line_density,
            slenderness: rod.length / rod.sections.outer.largest(),
            tip,
        }
    }
}

/// Largest |y| of the tip of `shapes`, m.
pub fn reach(shapes: impl Iterator<Item = impl Borrow<State>>) -> f64 {
    shapes.fold(0.0, |most, shape| shape.borrow().q.last().map_or(most, |y| y.abs().max(most)))
}

/// Mean square of the velocity (m/s) across itself of a rod that takes `shapes` in a period of this frequency (Hz), its centre
/// of mass and its direction at rest.
fn wave(rod: &Rod, shapes: &[State], frequency: f64) -> f64 {
    let per_phase = f64::from(PHASES) * frequency;
    let mut squares = 0.0;
    for (i, now) in shapes.iter().enumerate() {
        let next = &shapes[(i + 1) % shapes.len()];
        for k in 0..rod.nodes {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(rod.nodes - 1));
            let tangent = (node(&now.q, after) - node(&now.q, before)).normalize();
            let moved = node(&next.q, k) - node(&now.q, k);
            squares += (tangent.perp(&moved) * per_phase).powi(2) / rod.nodes as f64;
        }
    }
    squares / shapes.len() as f64
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

/// About the speed (m/s) at which a rod falls across itself: its weight against about 2πμ w + ½ρD w².
fn falling(line_density: f64, gravity: f64, depth: f64, fluid: Fluid) -> f64 {
    let weight = line_density * gravity.abs();
    let (viscous, form) = (TAU * fluid.viscosity, 0.5 * fluid.density * depth);
    if form == 0.0 {
        weight / viscous
    } else {
        (-viscous + (viscous * viscous + 4.0 * form * weight).sqrt()) / (2.0 * form)
    }
}

/// The size of `gravity`, m/s².
pub fn size(gravity: [f64; 2]) -> f64 {
    Vector2::from(gravity).norm()
}
