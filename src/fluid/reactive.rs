//! The water that a slender body accelerates: Lighthill's large-amplitude elongated-body force.
//!
//! T_f = ½∫m w² dℓ with m = ¼πρD², w = V·n and the *current* length dℓ. The force is exactly that of this energy, −δT_f/δx,
//! and what leaves the tail takes the wake's: F_tip = m(L) χ S (u w n − ½w² t) on the last node, with S = 1 where the tip moves
//! ahead of the water (u ≤ 0) and falling to 0 where it runs backwards. Discretely, with e = x_{k+1} − x_k, ℓ = |e|, λ = ė·n and
//! c = ρ/ΔL ∫ ¼πD² ds over half an edge, T_f = Σ ½ c ℓ w_i², and what opposes end i is
//! p_i = c[(ℓ a·n + ℓ̇ w − λu) n − λ w t], with ±G on the two ends, G = Σ_i c(½w² t − u w n).
//!
//! Sources: M. J. Lighthill, Proc. R. Soc. B 179 (1971); F. Candelier, F. Boyer & A. Leroyer, J. Fluid Mech. 674 (2011).

use std::f64::consts::FRAC_PI_4;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use super::force::{Force, Kinematics, OnEdge, OnTip, Sink, Slopes, Tally, Validity};
use super::medium::{DENSITY, Key};
use crate::linear::Block;
use crate::rod::{Alike, Rod, add, node};
use crate::system::Direction;

/// The inertia of the water around the rod.
#[derive(Debug)]
pub struct Reactive {
    /// c/ρ for both halves of every edge, m².
    halves: Alike<[f64; 2]>,
}

/// What the vortex sheet takes that leaves the tail.
#[derive(Debug)]
pub struct Wake {
    /// χ m(L)/ρ, m².
    mass: f64,
}

/// The range of both.
const VALIDITY: Validity = Validity {
    range: "slender bodies whose depth changes slowly, waves longer than the depth, fD²/ν of at least 100",
    source: "M. J. Lighthill, Proc. R. Soc. B 179 (1971); F. Candelier, F. Boyer & A. Leroyer, J. Fluid Mech. 674 (2011)",
};

impl Reactive {
    /// The water around `rod`.
    pub fn new(rod: &Rod) -> Self {
        // c = ρ g with g = (1/ΔL) ∫ ¼πD² ds, so that T_f is exact for a straight rod.
        let half = |half: &crate::rod::Half| FRAC_PI_4 * half.depth_squared * half.length / rod.spacing;
        Self { halves: rod.halves().map(|halves| halves.map(|h| half(&h))).collect::<Vec<_>>().into() }
    }
}

impl Wake {
    /// The wake of `rod` that leaves its tail; `shedding` χ of 1 is a sharp end, 0 a pointed one.
    pub fn new(rod: &Rod, shedding: f64) -> Self {
        Self { mass: shedding * FRAC_PI_4 * rod.sections.depth_at(1.0).powi(2) }
    }
}

/// a bᵀ.
#[inline(always)]
fn outer(a: Vector2<f64>, b: Vector2<f64>) -> Matrix2<f64> {
    a * b.transpose()
}

impl Force for Reactive {
    fn name(&self) -> &'static str {
        "reactive"
    }

    fn validity(&self) -> Validity {
        VALIDITY
    }

    fn is_inertial(&self) -> bool {
        true
    }

    fn sink(&self) -> Option<Sink> {
        None
    }

    fn evaluate(&self, rod: &Kinematics<'_>, along: Option<Direction>, edges: Range<usize>, sums: &mut Tally<'_>) {
        let density = rod.fluid.density;
        sums.each(edges, |k| {
            let edge = &rod.edges[k];
            let (t, n, length) = (edge.t, edge.n(), edge.length);
            let opening = node(rod.v, k + 1) - node(rod.v, k);
            let (stretching, lambda) = (opening.dot(&t), opening.dot(&n));
            let c = self.halves[k].map(|half| density * half);
            let motion = [0, 1].map(|i| {
                let (v, a) = (rod.against_fluid(k + i), rod.accelerating_against_fluid(k + i));
                ([v.dot(&t), v.dot(&n)], [a.dot(&t), a.dot(&n)])
            });
            let mut pair = Vector2::zeros();
            let mut force = [0, 1].map(|i| {
                let ([u, w], [_, an]) = motion[i];
                pair += (t * (0.5 * w * w) - n * (u * w)) * c[i];
                (n * (length * an + stretching * w - lambda * u) - t * (lambda * w)) * c[i]
            });
            force[0] += pair;
            force[1] -= pair;
            let Some(Direction { q, v, a }) = along else {
                return OnEdge::new(force, [Block::ZERO; 2], [Block::ZERO; 2]);
            };
            let (nn, nt, tn) = (outer(n, n), outer(n, t), outer(t, n));
            let per = edge.per_length;
            let mut own = [Matrix2::zeros(); 2];
            let mut by_edge = [Matrix2::zeros(); 2];
            let mut pair_by_own = [Matrix2::zeros(); 2];
            let mut pair_by_edge = Matrix2::zeros();
            for i in 0..2 {
                let ([u, w], [at, an]) = motion[i];
                own[i] = (nn * (length * a + stretching * v) - (nt + tn) * (lambda * v)) * c[i];
                let by_opening = (nt - tn) * w - nn * u;
                let by_vector = (outer(t, n) * (2.0 * lambda * u - length * an) - nn * (length * at + lambda * w))
                    .map(|x| x * per)
                    + nt * an;
                by_edge[i] = (by_opening * v + by_vector.map(|x| x * q)) * c[i];
                pair_by_own[i] = ((tn - nt) * w - nn * u) * (c[i] * v);
                pair_by_edge += nn * (c[i] * (u * u - 0.5 * w * w) * per * q);
            }
            let both = pair_by_own[0] + pair_by_own[1];
            own[0] += both;
            own[1] -= both;
            // Where one end stays, the other moves with the edge vector.
            by_edge[0] += pair_by_edge + pair_by_own[1];
            by_edge[1] += pair_by_own[0] - pair_by_edge;
            OnEdge::new(force, own.map(Block::from), by_edge.map(Block::from))
        });
    }

    fn energy(&self, rod: &Kinematics<'_>, factor: f64, mut by: Option<Slopes<'_>>) -> f64 {
        let mut energy = 0.0;
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            let (t, n) = (edge.t, edge.n());
            for (i, half) in halves.iter().enumerate() {
                let c = rod.fluid.density * half;
                let v = rod.against_fluid(k + i);
                let (u, w) = (v.dot(&t), v.dot(&n));
                energy += 0.5 * c * edge.length * w * w;
                if let Some(Slopes { q, v, .. }) = &mut by {
                    let pair = (t * (0.5 * w * w) - n * (u * w)) * (c * factor);
                    add(q, k, -pair);
                    add(q, k + 1, pair);
                    add(v, k + i, n * (c * edge.length * w * factor));
                }
            }
        }
        energy
    }

    fn momentum(&self, rod: &Kinematics<'_>, axis: Vector2<f64>, factor: f64, mut by: Option<Slopes<'_>>) -> f64 {
        // Σ c ℓ w n, the derivative of the energy by the velocity of the whole rod.
        let mut momentum = 0.0;
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            let (t, n) = (edge.t, edge.n());
            let (along, across) = (t.dot(&axis), n.dot(&axis));
            for (i, half) in halves.iter().enumerate() {
                let c = rod.fluid.density * half;
                let v = rod.against_fluid(k + i);
                let (u, w) = (v.dot(&t), v.dot(&n));
                momentum += c * edge.length * w * across;
                if let Some(Slopes { q, v, .. }) = &mut by {
                    let pair = (t * (w * across) - n * (u * across + w * along)) * (c * factor);
                    add(q, k, -pair);
                    add(q, k + 1, pair);
                    add(v, k + i, n * (c * edge.length * across * factor));
                }
            }
        }
        momentum
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        if key != DENSITY {
            return [0.0; 2];
        }
        // Linear in the density.
        let unit = Kinematics { fluid: super::Fluid { density: 1.0, ..rod.fluid }, ..*rod };
        super::force::visit_alone(self, &unit, |k, force| add(out, k, force));
        [self.energy(&unit, 0.0, None), 0.0]
    }
}

/// S(u/|V|): 1 where the tip leads, falling to 0 where it runs straight backwards, and dS/dx.
fn switch(x: f64) -> [f64; 2] {
    if x <= 0.0 {
        return [1.0, 0.0];
    }
    let x = x.min(1.0);
    [1.0 - x * x * x * (10.0 + x * (-15.0 + 6.0 * x)), -30.0 * (x * (1.0 - x)).powi(2)]
}

impl Wake {
    /// The force that pulls the tip, over its mass, with its derivatives by velocity and by the vectors of the last two edges.
    fn on_tip(rod: &Kinematics<'_>) -> Option<OnTip> {
        let [.., before, last] = rod.edges else { return None };
        // The direction of the rod's end, one half edge beyond the middle of the last: second order.
        let wanted = last.t * 3.0 - before.t;
        let size = wanted.norm();
        let d = wanted / size;
        let n = Vector2::new(-d.y, d.x);
        let velocity = rod.against_fluid(rod.edges.len());
        let (u, w) = (velocity.dot(&d), velocity.dot(&n));
        let speed = u.hypot(w);
        if speed == 0.0 {
            return Some(OnTip { force: Vector2::zeros(), own: Matrix2::zeros(), edges: [Matrix2::zeros(); 2] });
        }
        let x = u / speed;
        let [s, slope] = switch(x);
        let plain = n * (u * w) - d * (0.5 * w * w);
        // S depends on u and w by x = u/√(u² + w²): dx = w (w du − u dw)/|V|³.
        let cube = speed * speed * speed;
        let (s_u, s_w) = (slope * w * w / cube, -slope * u * w / cube);
        let by_u = plain * s_u + n * (w * s);
        let by_w = plain * s_w + (n * u - d * w) * s;
        let by_velocity = by_u * d.transpose() + by_w * n.transpose();
        // Turning d by δφ turns n too: du = w δφ, dw = −u δφ.
        let by_turning = by_u * w - by_w * u + (-d * (u * w) - n * (0.5 * w * w)) * s;
        // δd = n (n·δwanted)/|wanted|, and each tangent turns by n_e (n_e·δe)/ℓ_e.
        let turned = |edge: &crate::rod::Edge, factor: f64| {
            let normal = edge.n();
            by_turning * (normal * (factor * n.dot(&normal) * edge.per_length / size)).transpose()
        };
        Some(OnTip { force: plain * s, own: by_velocity, edges: [turned(before, -1.0), turned(last, 3.0)] })
    }
}

impl Force for Wake {
    fn name(&self) -> &'static str {
        "wake"
    }

    fn validity(&self) -> Validity {
        VALIDITY
    }

    fn sink(&self) -> Option<Sink> {
        Some(Sink::Wake)
    }

    /// Nothing: all of it acts on the tip.
    fn evaluate(&self, _: &Kinematics<'_>, _: Option<Direction>, _: Range<usize>, _: &mut Tally<'_>) {}

    fn tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> Option<OnTip> {
        let OnTip { force, own, edges } = Self::on_tip(rod)?;
        let mass = -self.mass * rod.fluid.density; // it opposes
        let Direction { q, v, .. } = along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 });
        Some(OnTip { force: force * mass, own: own * (mass * v), edges: edges.map(|by| by * (mass * q)) })
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        if let (DENSITY, Some(tip)) = (key, Self::on_tip(rod)) {
            add(out, rod.edges.len(), tip.force * -self.mass);
        }
        [0.0; 2]
    }
}
