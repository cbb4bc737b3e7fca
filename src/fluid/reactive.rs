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
use wide::f64x2;

use super::force::{Force, Kinematics, OnEdge, OnTip, Sink, Slopes, Tally, Validity};
use super::laws::{Published, Uncertainty};
use super::local::both;
use super::medium::{DENSITY, Fluid, Here, Key, Property};
use crate::linear::{Block, pair};
use crate::rod::{Alike, Edge, Rod, add, node};
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

/// What leaving out the reactive force changes of a round free swimmer, found by simulation with cross-flow; of thrust no more is
/// known than of speed.
pub static OMITTED: Published = Published {
    table: &[
        Uncertainty::at(5e-4, [0.001, 0.001, 0.001]),
        Uncertainty::at(0.016, [0.008, 0.008, 0.003]),
        Uncertainty::at(0.26, [0.04, 0.04, 0.01]),
        Uncertainty::at(3.1, [0.09, 0.09, 0.03]),
        Uncertainty::at(3e2, [0.11, 0.11, 0.03]),
        Uncertainty::at(3e3, [0.11, 0.11, 0.17]),
        Uncertainty::at(3e4, [0.11, 0.11, 0.45]),
    ],
    source: "a round free swimmer by cross-flow",
};

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

    /// What opposes the ends of edge `k`, whose fluid is that of `ends`; it changes from there where it `VARIES`. Numbers are
    /// those of both ends, an end a lane, and blocks are put together from their components along and across the edge: numbers
    /// written apart and read as lanes would have to wait for each other.
    #[inline(always)]
    fn on_edge<const VARIES: bool>(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        k: usize,
        ends: [&Here; 2],
    ) -> OnEdge {
        let edge = &rod.edges[k];
        let (t, n, length) = (pair(edge.t), pair(edge.n()), edge.length);
        let opening = node(rod.v, k + 1) - node(rod.v, k);
        let (stretching, lambda) = (opening.dot(&edge.t), opening.dot(&edge.n()));
        let (c, [u, w]) = self.moving(rod, k, [&ends[0].fluid, &ends[1].fluid]);
        let [at, an] =
            edge.components([pair(rod.accelerating_against_fluid(k)), pair(rod.accelerating_against_fluid(k + 1))]);
        // p_i over c_i, and the pair that acts with opposite signs on the two ends.
        let own = [-(w * lambda), an * length + w * stretching - u * lambda];
        let pair = [w * w * 0.5, -(u * w)];
        let mut force =
            [own[0] * c + opposite((pair[0] * c).reduce_add()), own[1] * c + opposite((pair[1] * c).reduce_add())];
        // c changes with the place: g ℓ w [ρ′(ν·V) n − ½ w ρ′ν], the fluid that becomes heavier as the rod moves and the pull
        // towards the lighter side.
        let crossing = VARIES && ends.iter().any(|here| here.slope.density != 0.0 || here.bend != 0.0);
        let halves = f64x2::new(self.halves[k]);
        let slope = halves * both(&ends, |here| here.slope.density);
        let (nu_t, nu_n) = (rod.normal().dot(&edge.t), rod.normal().dot(&edge.n()));
        let rising = u * nu_t + w * nu_n;
        let shape = [-(pair[0] * nu_t), rising * w - pair[0] * nu_n];
        if crossing {
            force[0] += shape[0] * slope * length;
            force[1] += shape[1] * slope * length;
        }
        let mut on = OnEdge { force: edge.vectors(force[0], force[1]), ..OnEdge::ZERO };
        let Some(Direction { q, v, a }) = along else { return on };
        let (by_velocity, by_turning) = (c * v, c * (q * edge.per_length));
        // The pair changes by (tn − nt) w − nn u with each end's velocity.
        let (turned, pushed) = (by_velocity * w, by_velocity * u);
        let twisted = opposite(turned.reduce_add());
        let mixed = -(by_velocity * lambda);
        let (mut own_tn, mut own_nt) = (mixed + twisted, mixed - twisted);
        let mut own_nn = c * (length * a + stretching * v) - opposite(pushed.reduce_add());
        // Where one end stays, the other moves with the edge vector.
        let turned = turned - swapped(turned);
        let mut edge_tn = by_turning * (u * (2.0 * lambda) - an * length) - turned;
        let mut edge_nt = c * an * q + turned;
        let pair_nn = (by_turning * (u * u - pair[0])).reduce_add();
        let mut edge_nn = opposite(pair_nn) - by_turning * (at * length + w * lambda) - pushed - swapped(pushed);
        let (tn, nt, nn) = (Block::outer(edge.t, n), Block::outer(edge.n(), t), Block::outer(edge.n(), n));
        if crossing {
            let (by_velocity, by_place) = (slope * (length * v), slope * q);
            let bend = halves * both(&ends, |here| here.bend) * (length * q);
            let pair = [pair[0] * by_place, pair[1] * by_place];
            let moved = [
                shape[0] * bend + own[0] * by_place + opposite(pair[0].reduce_add()),
                shape[1] * bend + own[1] * by_place + opposite(pair[1].reduce_add()),
            ];
            let turned = [swapped(pair[0]), swapped(pair[1])];
            let twisted = by_velocity * w * nu_t;
            own_tn += moved[0] * nu_n - twisted;
            own_nt += moved[1] * nu_t + twisted;
            own_nn += moved[1] * nu_n + by_velocity * rising;
            edge_tn += turned[0] * nu_n + (u * nu_t - rising) * w * by_place;
            edge_nt += turned[1] * nu_t + shape[1] * by_place;
            edge_nn += turned[1] * nu_n + (w * nu_n - rising) * u * by_place;
            let tt = Block::outer(edge.t, t);
            let own = (moved[0] * nu_t).to_array();
            let by_edge = (turned[0] * nu_t + shape[0] * by_place).to_array();
            for i in 0..2 {
                on.own[i] = tt * own[i];
                on.edge[i] = tt * by_edge[i];
            }
        }
        let [own_tn, own_nt, own_nn] = [own_tn.to_array(), own_nt.to_array(), own_nn.to_array()];
        let [edge_tn, edge_nt, edge_nn] = [edge_tn.to_array(), edge_nt.to_array(), edge_nn.to_array()];
        for i in 0..2 {
            let own = tn * own_tn[i] + nt * own_nt[i] + nn * own_nn[i];
            let by_edge = tn * edge_tn[i] + nt * edge_nt[i] + nn * edge_nn[i];
            // What is there already is zero where nothing is crossed.
            (on.own[i], on.edge[i]) = if crossing { (on.own[i] + own, on.edge[i] + by_edge) } else { (own, by_edge) };
        }
        on
    }

    /// Visits every edge with c and the velocities against the fluid, along and across it, an end a lane.
    #[inline(always)]
    fn each_edge(&self, rod: &Kinematics<'_>, mut visit: impl FnMut(usize, &Edge, f64x2, [f64x2; 2])) {
        for (run, rod) in rod.runs(0..rod.edges.len()) {
            let everywhere = rod.everywhere();
            for k in run {
                let fluids = match everywhere {
                    Some(fluid) => [fluid; 2],
                    None => [rod.here(k).fluid, rod.here(k + 1).fluid],
                };
                let (c, components) = self.moving(&rod, k, [&fluids[0], &fluids[1]]);
                visit(k, &rod.edges[k], c, components);
            }
        }
    }

    /// c and the velocities of the ends of edge `k` against the `fluids` there, along and across it, an end a lane.
    #[inline(always)]
    fn moving(&self, rod: &Kinematics<'_>, k: usize, fluids: [&Fluid; 2]) -> (f64x2, [f64x2; 2]) {
        let halves = &self.halves[k];
        let c = f64x2::new([fluids[0].density * halves[0], fluids[1].density * halves[1]]);
        let v = [pair(node(rod.v, k) - fluids[0].flow), pair(node(rod.v, k + 1) - fluids[1].flow)];
        (c, rod.edges[k].components(v))
    }
}

/// `value` on the first end, and the opposite on the second.
#[inline(always)]
fn opposite(value: f64) -> f64x2 {
    f64x2::new([value, -value])
}

/// What the other end has.
#[inline(always)]
fn swapped(ends: f64x2) -> f64x2 {
    let [first, second] = ends.to_array();
    f64x2::new([second, first])
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
        match rod.everywhere() {
            Some(fluid) => {
                let here = fluid.into();
                sums.each(edges, |k| self.on_edge::<false>(rod, along, k, [&here; 2]));
            }
            None => {
                let ends = rod.around.along(edges.clone()).windows(2);
                sums.each(edges.zip(ends), |(k, ends)| self.on_edge::<true>(rod, along, k, [&ends[0], &ends[1]]));
            }
        }
    }

    fn energy(&self, rod: &Kinematics<'_>, factor: f64, mut by: Option<Slopes<'_>>) -> f64 {
        let mut energy = f64x2::ZERO;
        self.each_edge(rod, |k, edge, c, [u, w]| {
            let own = c * w * w * 0.5;
            energy += own * edge.length;
            if let Some(Slopes { q, v, .. }) = &mut by {
                let pair = edge.vectors(own * factor, -(c * u * w) * factor);
                let across = (c * w).to_array();
                for i in 0..2 {
                    let (pair, half, slope) =
                        (Vector2::from(pair[i].to_array()), self.halves[k][i], rod.here(k + i).slope);
                    let w = w.to_array()[i];
                    add(q, k, -pair);
                    add(q, k + 1, pair);
                    add(q, k + i, rod.normal() * (0.5 * half * slope.density * edge.length * w * w * factor));
                    add(v, k + i, edge.n() * (across[i] * edge.length * factor));
                }
            }
        });
        energy.reduce_add()
    }

    fn momentum(&self, rod: &Kinematics<'_>, axis: Vector2<f64>, factor: f64, mut by: Option<Slopes<'_>>) -> f64 {
        // Σ c ℓ w n, the derivative of the energy by the velocity of the whole rod.
        let mut momentum = f64x2::ZERO;
        self.each_edge(rod, |k, edge, c, [u, w]| {
            let (along, across) = (edge.t.dot(&axis), edge.n().dot(&axis));
            momentum += c * w * (edge.length * across);
            if let Some(Slopes { q, v, .. }) = &mut by {
                let pair = edge.vectors(c * w * (across * factor), -(c * (u * across + w * along)) * factor);
                for i in 0..2 {
                    let (pair, half, slope) =
                        (Vector2::from(pair[i].to_array()), self.halves[k][i], rod.here(k + i).slope);
                    let (c, w) = (c.to_array()[i], w.to_array()[i]);
                    add(q, k, -pair);
                    add(q, k + 1, pair);
                    add(q, k + i, rod.normal() * (half * slope.density * edge.length * w * across * factor));
                    add(v, k + i, edge.n() * (c * edge.length * across * factor));
                }
            }
        });
        momentum.reduce_add()
    }

    /// ½ g ℓ w² ∇ρ of every end.
    fn pull(&self, rod: &Kinematics<'_>) -> Vector2<f64> {
        let mut pull = Vector2::zeros();
        for (run, rod) in rod.runs(0..rod.edges.len()).filter(|(_, rod)| rod.everywhere().is_none()) {
            for k in run {
                let edge = &rod.edges[k];
                for (i, half) in self.halves[k].iter().enumerate() {
                    let here = rod.here(k + i);
                    let w = (node(rod.v, k + i) - here.fluid.flow).dot(&edge.n());
                    pull += rod.normal() * (0.5 * half * here.slope.density * edge.length * w * w);
                }
            }
        }
        pull
    }

    fn momentum_by_parameter(&self, key: Key, rod: &Kinematics<'_>, axis: Vector2<f64>) -> f64 {
        let Some(property) = Property::of(key) else { return 0.0 };
        let mut momentum = 0.0;
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            for (i, half) in halves.iter().enumerate() {
                let c = rod.by_property(property, k + i).fluid.density * half;
                momentum += c * edge.length * rod.against_fluid(k + i).dot(&edge.n()) * edge.n().dot(&axis);
            }
        }
        momentum
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let Some(property) = Property::of(key) else { return [0.0; 2] };
        let mut energy = 0.0;
        for (k, (edge, halves)) in rod.edges.iter().zip(self.halves.iter()).enumerate() {
            // Linear in density and slope.
            let ends = [0, 1].map(|i| {
                let by = rod.by_property(property, k + i);
                Here { fluid: Fluid { flow: rod.flow(k + i), ..by.fluid }, ..by }
            });
            let on = self.on_edge::<true>(rod, None, k, ends.each_ref());
            for i in 0..2 {
                add(out, k + i, on.force(i));
                let w = rod.against_fluid(k + i).dot(&edge.n());
                energy += 0.5 * ends[i].fluid.density * halves[i] * edge.length * w * w;
            }
        }
        [energy, 0.0]
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

    fn is_on_edges(&self, _: &Kinematics<'_>) -> bool {
        false
    }

    /// Nothing: all of it acts on the tip.
    fn evaluate(&self, _: &Kinematics<'_>, _: Option<Direction>, _: Range<usize>, _: &mut Tally<'_>) {}

    fn tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> Option<OnTip> {
        let OnTip { force, own, edges } = Self::on_tip(rod)?;
        let Here { fluid, slope, .. } = rod.here(rod.edges.len());
        let mass = -self.mass * fluid.density; // it opposes
        let Direction { q, v, .. } = along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 });
        let by_place = outer(force, rod.normal()) * (-self.mass * slope.density * q);
        Some(OnTip { force: force * mass, own: own * (mass * v) + by_place, edges: edges.map(|by| by * (mass * q)) })
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        if let (Some(property), Some(tip)) = (Property::of(key), Self::on_tip(rod)) {
            let by = rod.by_property(property, rod.edges.len()).fluid.density;
            add(out, rod.edges.len(), tip.force * (-self.mass * by));
        }
        [0.0; 2]
    }
}
