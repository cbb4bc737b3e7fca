//! The time scales of a motion: periods of the drive, and the times in which drag stops a node.

use nalgebra::Vector2;

use crate::drives::Drives;
use crate::fluid::Kinematics;
use crate::model::Dynamics;
use crate::rod::{Edge, node};
use crate::spectrum::Spectrum;
use crate::start::Start;

/// The time scales that decide which cheaper model is suitable, s.
#[derive(Debug, Clone, Copy)]
pub struct TimeScales {
    /// The shortest and the longest period of the drive; infinite if it does not repeat.
    pub periods: [f64; 2],
    /// The shortest and the longest time in which drag stops a node.
    pub stops: [f64; 2],
}

impl TimeScales {
    /// The time scales of a run of `duration` (s).
    pub fn of(dynamics: &Dynamics, duration: f64) -> Self {
        Self { periods: periods(dynamics), stops: stops(dynamics, duration) }
    }
}

fn periods(dynamics: &Dynamics) -> [f64; 2] {
    let model = &dynamics.model;
    let spectrum = Spectrum::of_model(model);
    let ramp = match model.start {
        Start::Ramp { duration } if Drives::of(model).begin_with_start() => duration,
        _ => f64::INFINITY,
    };
    let shortest = spectrum.fastest().map_or(f64::INFINITY, f64::recip).min(ramp);
    let longest = if spectrum.is_transient { f64::INFINITY } else { spectrum.slowest().map_or(0.0, f64::recip) };
    [shortest, longest]
}

/// Computed from the forces on a straight rod that moves along and across itself by its length in the `duration` (s).
fn stops(dynamics: &Dynamics, duration: f64) -> [f64; 2] {
    let rod = &dynamics.model.rod;
    if dynamics.model.forces.is_empty() {
        return [f64::INFINITY; 2];
    }
    let fluid = dynamics.inputs.fluid;
    let speed = rod.length / duration;
    let edges: Vec<Edge> = rod.cells.iter().map(|cell| Edge::along(Vector2::x(), cell.rest)).collect();
    let q: Vec<f64> = (0..rod.nodes).flat_map(|k| [rod.arc_length(k), 0.0]).collect();
    let a = vec![0.0; 2 * rod.nodes];
    let forces = |v: Vector2<f64>| {
        let v: Vec<f64> = (0..2 * rod.nodes).map(|i| (fluid.flow + v)[i % 2]).collect();
        let moving = Kinematics::within(fluid, &edges, [&q, &v, &a]);
        let mut applied = vec![0.0; 2 * rod.nodes];
        dynamics.write_applied_without_inertia(&moving, &mut applied);
        applied
    };
    let still = forces(Vector2::zeros());
    let mut stops = [f64::INFINITY, 0.0];
    for direction in [Vector2::x(), Vector2::y()] {
        let moving = forces(direction * speed);
        for (k, mass) in rod.mass.iter().enumerate() {
            let stop = mass * speed / (node(&moving, k) - node(&still, k)).norm();
            stops = [stops[0].min(stop), stops[1].max(stop)];
        }
    }
    stops
}
