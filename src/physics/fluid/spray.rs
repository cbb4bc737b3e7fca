//! Energy that a slender body loses when the fluid around it becomes denser as it moves: the jet thrown up at entry.
//!
//! If the added mass c ℓ grows at the rate ċ ℓ > 0, half of the work of von Kármán's force ċ ℓ w goes into the moving
//! fluid, and the other half into a jet. If it decreases, no suction holds the rod back. Both cases result from the
//! force of the added mass itself and, on every end, ½ g ℓ |ρ̇| w n with g = c/ρ and ρ̇ = ∇ρ·V, whose power
//! ½ g ℓ |ρ̇| w² is never negative.
//!
//! Source: Th. von Kármán, NACA TN 321 (1929).

use std::f64::consts::FRAC_PI_4;
use std::ops::Range;

use nalgebra::Vector2;
use wide::f64x2;

use super::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind};
use super::local::both;
use super::medium::{DENSITY, Key, Property};
use super::validity::Validity;
use crate::linear::{Block, Direction, pair};
use crate::rod::{Edge, EdgeValues, HalfEdge, Rod, add, node};

/// The spray around the rod.
#[derive(Debug)]
pub struct Spray {
    /// g for both halves of every edge, m².
    halves: EdgeValues<[f64; 2]>,
}

impl Spray {
    /// The spray around `rod`.
    pub fn new(rod: &Rod) -> Self {
        let half = |half: &HalfEdge| FRAC_PI_4 * half.added * half.length / rod.spacing;
        Self { halves: rod.halves().map(|halves| halves.map(|h| half(&h))).collect::<Vec<_>>().into() }
    }

    /// The opposing force on both ends of an edge, one end per lane, at `velocities` (m/s) relative to the fluid.
    /// `halves` is g; `slope` and `bend` are the first two derivatives of the density along the `normal`.
    #[inline(always)]
    fn on_edge(
        halves: f64x2,
        edge: &Edge,
        normal: Vector2<f64>,
        [slope, bend]: [f64x2; 2],
        velocities: [f64x2; 2],
        along: Option<Direction>,
    ) -> EdgeForce {
        let (half, length) = (halves * 0.5, edge.length);
        let (nu_t, nu_n) = (normal.dot(&edge.t), normal.dot(&edge.n()));
        let [u, w] = edge.components(velocities);
        let across = u * nu_t + w * nu_n;
        let rate = slope * across;
        let c = half * rate.abs();
        let force = edge.vectors(f64x2::ZERO, c * w * length);
        let Some(Direction { q, v, .. }) = along else { return EdgeForce { force, ..EdgeForce::ZERO } };
        let sign = rate.simd_lt(f64x2::ZERO).bitselect(f64x2::from(-1.0), f64x2::ONE);
        // |ρ̇| changes with velocity and position, along ν; n turns by −t n·δe/ℓ, and w with it by −u.
        let grows = half * sign * w * (slope * v + bend * across * q) * length;
        let (own_nt, own_nn) = ((grows * nu_t).to_array(), (grows * nu_n + c * (v * length)).to_array());
        let (turned, pushed) = ((c * w * q).to_array(), (c * u * q).to_array());
        let (t, n) = (pair(edge.t), pair(edge.n()));
        let (tn, nt, nn) = (Block::outer(edge.t, n), Block::outer(edge.n(), t), Block::outer(edge.n(), n));
        let on = |i: usize| (nt * own_nt[i] + nn * own_nn[i], (nt - tn) * turned[i] - nn * pushed[i]);
        // Not `map` over both ends, which would be a call for each.
        let ((own0, edge0), (own1, edge1)) = (on(0), on(1));
        EdgeForce { force, own: [own0, own1], edge: [edge0, edge1] }
    }
}

impl Force for Spray {
    fn name(&self) -> &'static str {
        "spray"
    }

    fn validity(&self) -> Validity {
        Validity {
            range: "impulses of entry and exit within about 30 %, forces by order of magnitude; no cavity, waves or air cushion",
            bounds: &[],
            source: "Th. von Kármán, NACA TN 321 (1929)",
        }
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Spray)
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        if !self.is_on_edges(rod) {
            return;
        }
        let ends = rod.around.along(edges.clone()).windows(2);
        sums.each(edges.zip(ends), |(k, ends)| {
            let ends = [&ends[0], &ends[1]];
            let slopes = [both(&ends, |here| here.slope.density), both(&ends, |here| here.bend)];
            let against = |i: usize| pair(node(rod.v, k + i) - ends[i].fluid.flow);
            let halves = f64x2::new(self.halves[k]);
            Self::on_edge(halves, &rod.edges[k], rod.normal(), slopes, [against(0), against(1)], along)
        });
    }

    fn is_on_edges(&self, rod: &Kinematics<'_>) -> bool {
        rod.everywhere().is_none()
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let Some(property) = Property::of(key) else { return [0.0; 2] };
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            let (ends, by) = ([rod.here(k), rod.here(k + 1)], [k, k + 1].map(|k| rod.by_property(property, k)));
            // |ρ′| changes by sgn(ρ′) δρ′.
            let grows = [0, 1].map(|i| by[i].slope.density * ends[i].slope.density.signum() * halves[i]);
            let against = [k, k + 1].map(|k| pair(rod.against_fluid(k)));
            let on = Self::on_edge(f64x2::new(grows), edge, rod.normal(), [f64x2::ONE, f64x2::ZERO], against, None);
            add(out, k, on.force(0));
            add(out, k + 1, on.force(1));
        }
        [0.0; 2]
    }
}
