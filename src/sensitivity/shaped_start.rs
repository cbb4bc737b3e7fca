//! The derivative of the `shaped` start: initial positions and velocities with respect to the natural curvature.

use nalgebra::{Rotation2, Vector2};

use super::parameter::{ActuationShape, ParameterEffect};
use crate::head::Pose;
use crate::model::Dynamics;
use crate::rod::{Rod, bend};
use crate::start::Start;

/// A dual number: a vector and its derivative.
type DualVector = [Vector2<f64>; 2];

/// The vector rotated by +90°.
fn turned(x: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-x.y, x.x)
}

/// The derivatives of the initial positions and velocities.
pub(super) fn first_by(dynamics: &Dynamics, effect: &ParameterEffect, shape: &ActuationShape) -> [Vec<f64>; 2] {
    let rod = &dynamics.model.rod;
    let mut by = [(); 2].map(|()| vec![0.0; dynamics.model.unknowns()]);
    if dynamics.model.start == Start::Shaped && effect.bends(shape) {
        let mut followed = dynamics.free_of_moment([&dynamics.natural, &dynamics.natural_rate].map(Vec::clone));
        followed[0]
            .iter_mut()
            .zip(dynamics.model.initial_curvature.iter().flatten())
            .for_each(|(shape, curvature)| *shape += curvature);
        let mut change = [vec![0.0; rod.nodes], vec![0.0; rod.nodes]];
        for k in effect.joints.clone() {
            (change[0][k], change[1][k]) = (effect.natural(shape, k), effect.rate(shape, k));
        }
        change = dynamics.free_of_moment(change);
        if let Some(damping) = rod.damping.as_ref().filter(|_| effect.angular_frequency != 0.0) {
            let omega = dynamics.initial_angular_frequency();
            for k in effect.joints.clone() {
                let natural = [dynamics.natural[k], dynamics.natural_rate[k]];
                let by_frequency = damping.free_of_moment_by(k, omega, effect.angular_frequency, natural);
                change[0][k] += by_frequency[0];
                change[1][k] += by_frequency[1];
            }
        }
        let [curvature, rate] = followed.each_ref().map(Vec::as_slice);
        let [curvature_by, rate_by] = change.each_ref().map(Vec::as_slice);
        let [q, v] = &mut by;
        shaped(rod, [curvature, rate], [curvature_by, rate_by], dynamics.held.as_ref(), q, v);
    }
    by
}

/// Writes the derivatives of the initial positions and velocities to `q` and `v`, two entries per node, along the directions `by` and
/// `rate_by` of the curvatures `curvature` and their rates `rate` (1/s); `held` is the pose of a held head. It differentiates
/// [`Start::place`](crate::start::Start::place) line by line.
fn shaped(
    rod: &Rod,
    [curvature, rate]: [&[f64]; 2],
    [by, rate_by]: [&[f64]; 2],
    held: Option<&Pose>,
    q: &mut [f64],
    v: &mut [f64],
) {
    let zero = [Vector2::zeros(); 2];
    let (mut angle, mut spin) = held.map_or(([0.0; 2], [0.0; 2]), |pose| ([pose[2].value, 0.0], [pose[2].rate, 0.0]));
    let mut x: Vec<DualVector> = vec![zero; rod.nodes];
    let mut w: Vec<DualVector> = vec![zero; rod.nodes];
    if let Some(pose) = held {
        x[0][0] = Vector2::new(pose[0].value, pose[1].value);
        w[0][0] = Vector2::new(pose[0].rate, pose[1].rate);
    }
    for e in 0..rod.nodes - 1 {
        if rod.joints().contains(&e) {
            let s = bend::curvature_per_turning(curvature[e]);
            angle = [angle[0] + bend::turning(curvature[e]), angle[1] + by[e] / s];
            spin = [spin[0] + rate[e] / s, spin[1] + rate_by[e] / s - 0.5 * rate[e] * curvature[e] * by[e] / (s * s)];
        }
        let edge = Vector2::new(angle[0].cos(), angle[0].sin()) * rod.cells[e].rest;
        let across = turned(edge);
        x[e + 1] = [x[e][0] + edge, x[e][1] + across * angle[1]];
        w[e + 1] = [w[e][0] + across * spin[0], w[e][1] + across * spin[1] - edge * (spin[0] * angle[1])];
    }
    if held.is_none() {
        straighten(rod, &mut x, &mut w);
        rest(rod, &x, &mut w);
    }
    for (k, (x, w)) in x.iter().zip(&w).enumerate() {
        q[2 * k..2 * k + 2].copy_from_slice(x[1].as_slice());
        v[2 * k..2 * k + 2].copy_from_slice(w[1].as_slice());
    }
}

/// Mass-weighted mean.
fn mean(rod: &Rod, values: &[DualVector]) -> DualVector {
    let sum = |i: usize| rod.mass.iter().zip(values).map(|(m, x)| x[i] * *m).sum::<Vector2<f64>>() / rod.total_mass();
    [sum(0), sum(1)]
}

fn straighten(rod: &Rod, x: &mut [DualVector], w: &mut [DualVector]) {
    let straight: Vec<DualVector> =
        (0..rod.nodes).map(|k| [Vector2::new(rod.arc_length(k), 0.0), Vector2::zeros()]).collect();
    let ([centre, centre_by], [target, _]) = (mean(rod, x), mean(rod, &straight));
    let (mut cross, mut dot) = ([0.0; 2], [0.0; 2]);
    for ((m, x), straight) in rod.mass.iter().zip(&*x).zip(&straight) {
        let r = straight[0] - target;
        for (i, p) in [x[0] - centre, x[1] - centre_by].into_iter().enumerate() {
            cross[i] += m * p.perp(&r);
            dot[i] += m * p.dot(&r);
        }
    }
    let turn = Rotation2::new(cross[0].atan2(dot[0]));
    let turn_by = (dot[0] * cross[1] - cross[0] * dot[1]) / (cross[0] * cross[0] + dot[0] * dot[0]);
    for (x, w) in x.iter_mut().zip(w) {
        let (p, u) = (turn * (x[0] - centre), turn * w[0]);
        *x = [target + p, turn * (x[1] - centre_by) + turned(p) * turn_by];
        *w = [u, turn * w[1] + turned(u) * turn_by];
    }
}

fn rest(rod: &Rod, x: &[DualVector], w: &mut [DualVector]) {
    let ([centre, centre_by], [drift, drift_by]) = (mean(rod, x), mean(rod, w));
    let (mut momentum, mut inertia) = ([0.0; 2], [0.0; 2]);
    for ((m, x), w) in rod.mass.iter().zip(x).zip(&*w) {
        let (r, r_by, u, u_by) = (x[0] - centre, x[1] - centre_by, w[0] - drift, w[1] - drift_by);
        momentum[0] += m * r.perp(&u);
        momentum[1] += m * (r_by.perp(&u) + r.perp(&u_by));
        inertia[0] += m * r.norm_squared();
        inertia[1] += 2.0 * m * r.dot(&r_by);
    }
    let spin = momentum[0] / inertia[0];
    let spin_by = (momentum[1] - spin * inertia[1]) / inertia[0];
    for (x, w) in x.iter().zip(w) {
        let (r, r_by) = (x[0] - centre, x[1] - centre_by);
        w[0] -= drift + turned(r) * spin;
        w[1] -= drift_by + turned(r_by) * spin + turned(r) * spin_by;
    }
}
