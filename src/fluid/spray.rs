//! What a slender body loses where the fluid around it grows denser as it moves: the jet that entry throws up.
//!
//! Where added mass c ℓ grows at the rate ċ ℓ > 0, half of the work of von Kármán's ċ ℓ w goes into the moving fluid, the other half into
//! a jet. Where it falls, no suction holds the rod back. Both is the added mass's own force and, on every end,
//! ½ g ℓ |ρ̇| w n with g = c/ρ and ρ̇ = ∇ρ·V: its power ½ g ℓ |ρ̇| w² is never negative.
//!
//! Source: Th. von Kármán, NACA TN 321 (1929).

use std::f64::consts::FRAC_PI_4;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use super::force::{Force, Kinematics, OnEdge, Sink, Tally, Validity};
use super::medium::{DENSITY, Key, Property};
use crate::linear::Block;
use crate::rod::{Alike, Edge, Half, Rod, add, node};
use crate::system::Direction;

/// The spray around the rod.
#[derive(Debug)]
pub struct Spray {
    /// g for both halves of every edge, m².
    halves: Alike<[f64; 2]>,
}

impl Spray {
    /// The spray around `rod`.
    pub fn new(rod: &Rod) -> Self {
        let half = |half: &Half| FRAC_PI_4 * half.depth_squared * half.length / rod.spacing;
        Self { halves: rod.halves().map(|halves| halves.map(|h| half(&h))).collect::<Vec<_>>().into() }
    }

    /// What opposes one end, with its derivatives where the edge moves with the end and where it changes: `slope` and `bend`
    /// are the first two derivatives of the density along the `normal`.
    #[inline(always)]
    fn on_end(
        half: f64,
        edge: &Edge,
        normal: Vector2<f64>,
        [slope, bend]: [f64; 2],
        velocity: Vector2<f64>,
        Direction { q, v, .. }: Direction,
    ) -> (Vector2<f64>, Matrix2<f64>, Matrix2<f64>) {
        let (t, n, length) = (edge.t, edge.n(), edge.length);
        let (u, w, across) = (velocity.dot(&t), velocity.dot(&n), velocity.dot(&normal));
        let rate = slope * across;
        let (c, sign) = (0.5 * half * rate.abs(), if rate < 0.0 { -1.0 } else { 1.0 });
        let by_velocity = n * n.transpose() * c + n * normal.transpose() * (0.5 * half * sign * slope * w);
        let by_place = n * normal.transpose() * (0.5 * half * sign * bend * across * w);
        // n turns by −t n·δe/ℓ, and w with it by −u.
        let by_vector = n * t.transpose() * w - (n * u + t * w) * n.transpose();
        (n * (c * length * w), (by_velocity * v + by_place * q) * length, by_vector * (c * q))
    }
}

impl Force for Spray {
    fn name(&self) -> &'static str {
        "spray"
    }

    fn validity(&self) -> Validity {
        Validity {
            range: "impulses of entry and exit within about 30 %, forces by order of magnitude; no cavity, waves or air cushion",
            source: "Th. von Kármán, NACA TN 321 (1929)",
        }
    }

    fn sink(&self) -> Option<Sink> {
        Some(Sink::Spray)
    }

    fn evaluate(&self, rod: &Kinematics<'_>, along: Option<Direction>, edges: Range<usize>, sums: &mut Tally<'_>) {
        if rod.throughout(&edges).is_some() {
            return;
        }
        let (normal, along) = (rod.normal(), along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 }));
        let mut next = rod.here(edges.start);
        sums.each(edges, |k| {
            let ends = [std::mem::replace(&mut next, rod.here(k + 1)), next];
            if ends.iter().all(|here| here.slope.density == 0.0) {
                return OnEdge::ZERO;
            }
            let [(f0, own0, edge0), (f1, own1, edge1)] = [0, 1].map(|i| {
                let velocity = node(rod.v, k + i) - ends[i].fluid.flow;
                let slopes = [ends[i].slope.density, ends[i].bend];
                Self::on_end(self.halves[k][i], &rod.edges[k], normal, slopes, velocity, along)
            });
            OnEdge::new([f0, f1], [own0, own1].map(Block::from), [edge0, edge1].map(Block::from))
        });
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let Some(property) = Property::of(key) else { return [0.0; 2] };
        let rest = Direction { q: 0.0, v: 0.0, a: 0.0 };
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            for (i, half) in halves.iter().enumerate() {
                let (here, by) = (rod.here(k + i), rod.by_property(property, k + i));
                // |ρ′| grows by sgn(ρ′) δρ′.
                let grows = by.slope.density * here.slope.density.signum();
                let (force, ..) = Self::on_end(*half, edge, rod.normal(), [1.0, 0.0], rod.against_fluid(k + i), rest);
                add(out, k + i, force * grows);
            }
        }
        [0.0; 2]
    }
}
