//! The start of a run: the gain of the actuation over time, and the initial positions and velocities.

use nalgebra::{Rotation2, Vector2};

use crate::actuation::lag::Jet;
use crate::head::Pose;
use crate::rod::{Rod, add, bend, node};
use crate::system::State;

/// The kind of start.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Start {
    /// The straight rod, at rest, is released into the full actuation (as in the source study).
    Jump,
    /// The actuation grows over `duration` (s) by r = 10z³ − 15z⁴ + 6z⁵, z = t/duration: twice differentiable.
    Ramp {
        /// Duration, s.
        duration: f64,
    },
    /// The rod starts in the shape of its natural curvature and moves with it, with zero momentum. If its material
    /// damps this motion, the shape lags as in motion without moments.
    #[default]
    Shaped,
}

impl Start {
    /// The gain r(t) and its rate (1/s).
    pub fn gain(&self, t: f64) -> [f64; 2] {
        match *self {
            Self::Ramp { duration } if t < duration => {
                let z = (t / duration).max(0.0);
                [z * z * z * (10.0 + z * (-15.0 + 6.0 * z)), 30.0 * (z * (1.0 - z)).powi(2) / duration]
            }
            _ => [1.0, 0.0],
        }
    }

    /// r and all of its derivatives just after time `t` (s), or just `before` it.
    pub fn gain_jet(&self, t: f64, before: bool) -> Jet {
        let mut jet = Jet::default();
        jet[0] = 1.0;
        if let Self::Ramp { duration } = *self
            && (t < duration || before && t == duration)
        {
            let z = (t / duration).max(0.0);
            let [gain, rate] = if t < duration { self.gain(t) } else { [1.0, 0.0] };
            let higher = [60.0 + z * (-360.0 + 360.0 * z), -360.0 + 720.0 * z, 720.0];
            jet[..3].copy_from_slice(&[gain, rate, self.gain_acceleration(t)]);
            for (order, derivative) in (3..).zip(higher) {
                jet[order as usize] = derivative / duration.powi(order);
            }
        }
        jet
    }

    /// d²r/dt², 1/s².
    pub fn gain_acceleration(&self, t: f64) -> f64 {
        match *self {
            Self::Ramp { duration } if t < duration => {
                let z = (t / duration).max(0.0);
                60.0 * z * (1.0 - z) * (1.0 - 2.0 * z) / (duration * duration)
            }
            _ => 0.0,
        }
    }

    /// Writes the initial positions and velocities to `state`.
    ///
    /// `curvature` and its `rate` (1/s) are those of every node of a rod free of moments, `initial_curvature` is added
    /// to the curvature of the start, and `held` is the pose of a held head.
    pub fn place(
        &self,
        rod: &Rod,
        [curvature, rate]: [&[f64]; 2],
        initial_curvature: Option<&[f64]>,
        held: Option<&Pose>,
        state: &mut State,
    ) {
        let (origin, speed, angle, spin) = match held {
            Some([x, y, angle]) => {
                (Vector2::new(x.value, y.value), Vector2::new(x.rate, y.rate), angle.value, angle.rate)
            }
            None => (Vector2::zeros(), Vector2::zeros(), 0.0, 0.0),
        };
        if let (false, Some(initial_curvature)) = (matches!(self, Self::Shaped), initial_curvature) {
            chain(rod, initial_curvature, &vec![0.0; rod.nodes], [origin, Vector2::zeros()], [angle, 0.0], state);
            add(&mut state.v, 0, speed);
            if held.is_none() {
                straighten(rod, state);
            }
            return;
        }
        if !matches!(self, Self::Shaped) {
            let direction = Vector2::new(angle.cos(), angle.sin());
            for k in 0..rod.nodes {
                add(&mut state.q, k, origin + direction * rod.arc_length(k));
            }
            add(&mut state.v, 0, speed);
            state.links.iter_mut().take(rod.nodes - 1).for_each(|link| link.angle = angle);
            return;
        }
        let mut shape = curvature.to_vec();
        shape
            .iter_mut()
            .zip(initial_curvature.into_iter().flatten())
            .for_each(|(shape, initial_curvature)| *shape += initial_curvature);
        chain(rod, &shape, rate, [origin, speed], [angle, spin], state);
        if held.is_none() {
            straighten(rod, state);
            rest(rod, state);
        }
    }
}

/// The unstretched chain with turning angles from `curvature`. Node 0 is at `origin` and moves at `speed`; the
/// direction before the first joint is `angle`, rotating at `spin`.
fn chain(
    rod: &Rod,
    curvature: &[f64],
    rate: &[f64],
    [origin, speed]: [Vector2<f64>; 2],
    [mut angle, mut spin]: [f64; 2],
    state: &mut State,
) {
    let (mut x, mut v) = (origin, speed);
    add(&mut state.q, 0, x);
    add(&mut state.v, 0, v);
    for e in 0..rod.nodes - 1 {
        if rod.joints().contains(&e) {
            angle += bend::turning(curvature[e]);
            spin += rate[e] / bend::curvature_per_turning(curvature[e]);
            if let Some(link) = state.links.get_mut(e) {
                link.curvature = curvature[e];
            }
        }
        if let Some(link) = state.links.get_mut(e) {
            link.angle = angle;
        }
        let edge = Vector2::new(angle.cos(), angle.sin()) * rod.cells[e].rest;
        x += edge;
        v += Vector2::new(-edge.y, edge.x) * spin;
        add(&mut state.q, e + 1, x);
        add(&mut state.v, e + 1, v);
    }
}

/// Translates and rotates the rod, with its velocities, so that its centre of mass is that of the straight rod and the
/// mass-weighted squared distance to the straight rod is minimal.
fn straighten(rod: &Rod, state: &mut State) {
    let straight = |k: usize| Vector2::new(rod.arc_length(k), 0.0);
    let centre = rod.mean(&state.q);
    let target = rod.mass.iter().enumerate().map(|(k, m)| straight(k) * *m).sum::<Vector2<f64>>() / rod.total_mass();
    let (mut cross, mut dot) = (0.0, 0.0);
    for (k, m) in rod.mass.iter().enumerate() {
        let (p, r) = (node(&state.q, k) - centre, straight(k) - target);
        cross += m * p.perp(&r);
        dot += m * p.dot(&r);
    }
    let turn = cross.atan2(dot);
    state.links.iter_mut().take(rod.nodes - 1).for_each(|link| link.angle += turn);
    let turn = Rotation2::new(turn);
    for k in 0..rod.nodes {
        let (x, v) = (target + turn * (node(&state.q, k) - centre), turn * node(&state.v, k));
        state.q[2 * k..2 * k + 2].copy_from_slice(x.as_slice());
        state.v[2 * k..2 * k + 2].copy_from_slice(v.as_slice());
    }
}

/// Adds the rigid motion that makes linear and angular momentum zero.
fn rest(rod: &Rod, state: &mut State) {
    let (centre, drift) = (rod.mean(&state.q), rod.mean(&state.v));
    let (mut momentum, mut inertia) = (0.0, 0.0);
    for (k, m) in rod.mass.iter().enumerate() {
        let r = node(&state.q, k) - centre;
        momentum += m * r.perp(&(node(&state.v, k) - drift));
        inertia += m * r.norm_squared();
    }
    (0..rod.nodes).for_each(|k| add(&mut state.v, k, -drift));
    add_spin(rod, -momentum / inertia, state);
}

/// Adds a rigid rotation about the centre of mass, `spin` rad/s.
pub fn add_spin(rod: &Rod, spin: f64, state: &mut State) {
    let centre = rod.mean(&state.q);
    for k in 0..rod.nodes {
        let r = node(&state.q, k) - centre;
        add(&mut state.v, k, Vector2::new(-r.y, r.x) * spin);
    }
}
