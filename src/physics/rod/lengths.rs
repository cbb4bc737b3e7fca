//! Edges during a step: initial guesses that preserve edge lengths, and the angles by which edges turn. Generic over
//! one case and several SIMD lanes.

use nalgebra::Vector2;

use super::EdgeValues;
use crate::linear::{Direction, Number, Pair, Real, pair};

/// Moves the nodes after the first, given by positions, velocities and accelerations, along `direction` until every
/// edge has the length that it has between the `old` positions. The centre of mass of a free rod, of mass `free` (kg),
/// does not move.
#[inline(always)]
pub(crate) fn keep<T: Real>(
    old: &[[T; 2]],
    nodes: [&mut [[T; 2]]; 3],
    mass: &[T],
    free: Option<T>,
    direction: Direction,
) {
    let square = |edge: T::Pair| (edge * edge).sum();
    stretch(old, nodes, mass, free, direction, |_, was, [edge, _]| (square(was) / square(edge)).sqrt());
}

/// The same for a material with damping times `times` (s), preserving ℓ + τ ℓ̇, and so the tension, of `old` positions
/// and velocities.
#[inline(always)]
pub(crate) fn keep_tensions<T: Real>(
    old: [&[[T; 2]]; 2],
    nodes: [&mut [[T; 2]]; 3],
    mass: &[T],
    free: Option<T>,
    direction: Direction,
    times: &EdgeValues<T>,
) {
    stretch(old[0], nodes, mass, free, direction, |e, was, [edge, opening]| {
        let time = times[e];
        let (one, per_move) = (time.like(1.0), time.like(direction.v / direction.q));
        let opened = T::Pair::new(old[1][e + 1]) - T::Pair::new(old[1][e]);
        let (was_long, long) = ((was * was).sum().sqrt(), (edge * edge).sum().sqrt());
        let carried = was_long + time * (was * opened).sum() / was_long;
        // ℓ̇ follows ℓ along the direction.
        (carried - time * ((edge * opening).sum() / long - per_move * long)) / ((one + time * per_move) * long)
    });
}

/// Moves the nodes along `direction` until the length of every edge is multiplied by `ratio`, a function of its index,
/// its vector between the `old` positions, and its present vector with the rate of that.
#[inline(always)]
fn stretch<T: Real>(
    old: &[[T; 2]],
    [q, v, a]: [&mut [[T; 2]]; 3],
    mass: &[T],
    free: Option<T>,
    direction: Direction,
    ratio: impl Fn(usize, T::Pair, [T::Pair; 2]) -> T,
) {
    let ([old_first, ..], [first, ..], [some, ..]) = (old, &*q, mass) else { return };
    let like = |x: f64| some.like(x);
    let (mut old_before, mut before) = (T::Pair::new(*old_first), T::Pair::new(*first));
    let mut speed_before = v.first().map_or(before, |speed| T::Pair::new(*speed));
    let (mut moved, mut mean) = (before.like(0.0), before.like(0.0));
    let beyond = old.iter().zip(q.iter_mut()).zip(v.iter_mut()).zip(a.iter_mut()).zip(mass).skip(1).enumerate();
    for (e, ((((old, q), v), a), mass)) in beyond {
        let (old, guessed, speed) = (T::Pair::new(*old), T::Pair::new(*q), T::Pair::new(*v));
        let (was, edge) = (old - old_before, guessed - before);
        let ratio = ratio(e, was, [edge, speed - speed_before]);
        // No move if the ratio is not finite.
        moved += edge * T::where_at_most(ratio, like(f64::MAX), ratio - like(1.0), like(0.0));
        mean += moved * *mass;
        direction.move_node([q, v, a], (moved / moved.like(direction.q)).to_array());
        (old_before, before, speed_before) = (old, guessed, speed);
    }
    if let Some(mass) = free {
        let back = (-(mean / T::Pair::new([mass * like(direction.q); 2]))).to_array();
        for ((q, v), a) in q.iter_mut().zip(v).zip(a) {
            direction.move_node([q, v, a], back);
        }
    }
}

/// The smallest cosine, times a positive number, of the angles by which edges turn from `old` to `new` positions, and
/// of the angles between adjacent edges at both. `clamp_tangents` are the tangents before the first edge at both, if
/// there are any.
#[inline(always)]
pub(crate) fn least_turn<T: Real>(
    clamp_tangents: Option<[Vector2<T>; 2]>,
    old: &[[T; 2]],
    new: &[[T; 2]],
) -> Option<T> {
    let ([old_first, ..], [first, ..]) = (old, new) else { return None };
    let (mut old_node, mut node) = (T::Pair::new(*old_first), T::Pair::new(*first));
    let [mut old_before, mut before] =
        clamp_tangents.map_or([node.like(0.0); 2], |clamp_tangents| clamp_tangents.map(pair));
    let mut most = -first[0].like(f64::INFINITY);
    for (old, new) in old.iter().zip(new).skip(1) {
        let (old, new) = (T::Pair::new(*old), T::Pair::new(*new));
        let (old_edge, edge) = (old - old_node, new - node);
        let cosines = [(old_edge * edge).sum(), (old_before * old_edge).sum(), (before * edge).sum()];
        most = most.larger(-cosines[0]).larger(-cosines[1]).larger(-cosines[2]);
        (old_node, node, old_before, before) = (old, new, old_edge, edge);
    }
    Some(-most)
}
