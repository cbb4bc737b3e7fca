//! The inertia of the water around a slender body: Lighthill's large-amplitude elongated-body force.
//!
//! T_f = ½∫m w² dℓ with m = ¼πρC D², C of the section ([`Section::added`](crate::rod::Section::added)), w = V·n and the
//! *current* length dℓ. The force is exactly that of this energy, −δT_f/δx. The wake that leaves the tail exerts the
//! force F_tip = m(L) χ S (u w n − ½w² t) on the last node, with S = 1 if the tip moves ahead of the water (u ≤ 0),
//! falling to 0 if it moves backwards. In the discretisation, with e = x_{k+1} − x_k, ℓ = |e|, λ = ė·n and
//! c = ρ/ΔL ∫ ¼πC D² ds over half an edge, T_f = Σ ½ c ℓ w_i². The opposing force on end i is
//! p_i = c[(ℓ a·n + ℓ̇ w − λu) n − λ w t], with ±G on the two ends, G = Σ_i c(½w² t − u w n).
//!
//! Sources: M. J. Lighthill, Proc. R. Soc. B 179 (1971); F. Candelier, F. Boyer & A. Leroyer, J. Fluid Mech. 674
//! (2011).

use std::f64::consts::{FRAC_PI_4, PI};
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use wide::f64x2;

use super::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind, StateDerivatives, TipForce};
use super::local::both;
use super::medium::{DENSITY, Fluid, Key, LocalFluid, Property};
use super::uncertainty::{Published, Uncertainty};
use super::validity::Validity;
use super::validity::{Bound, DimensionlessNumber};
use crate::linear::{Block, Direction, Number, Pair, Real, pair};
use crate::rod::{Edge, EdgeValues, Rod, add, node};

/// The inertia of the water around the rod.
#[derive(Debug)]
pub struct Reactive {
    /// c/ρ for both halves of every edge, m².
    halves: EdgeValues<[f64; 2]>,
}

/// The force of the vortex sheet that leaves the tail.
#[derive(Debug)]
pub struct Wake {
    /// χ m(L)/ρ, m².
    mass: f64,
}

/// The relative change of results when the reactive force is omitted, simulated with cross-flow for a round free
/// swimmer. The change of thrust is not known separately and taken to be that of speed.
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

/// The name of the force.
pub const NAME: &str = "reactive";

/// Above this bound, omitting the force causes a larger error than including it: the boundary layer entrained by
/// viscosity adds 4/√(πβ) to the added mass, β = fD²/ν.
pub const COUNTS: Bound = Bound::at_least(DimensionlessNumber::Stokes, 16.0 / PI);

/// The range of validity of both forces.
const VALIDITY: Validity = Validity {
    range: "slender bodies whose depth changes slowly",
    bounds: &[
        Bound::at_most(DimensionlessNumber::Depth, 0.3),
        Bound::at_least(DimensionlessNumber::WaveInDepths, 1.0),
        Bound::at_least(DimensionlessNumber::Stokes, 100.0),
    ],
    source: "M. J. Lighthill, Proc. R. Soc. B 179 (1971); F. Candelier, F. Boyer & A. Leroyer, J. Fluid Mech. 674 (2011)",
};

impl Reactive {
    /// The reactive force on `rod`.
    pub fn new(rod: &Rod) -> Self {
        // c = ρ g with g = (1/ΔL) ∫ ¼πC D² ds, so that T_f is exact for a straight rod.
        let half = |half: &crate::rod::HalfEdge| FRAC_PI_4 * half.added * half.length / rod.spacing;
        Self { halves: rod.halves().map(|halves| halves.map(|h| half(&h))).collect::<Vec<_>>().into() }
    }

    /// The opposing forces on the ends of edge `k`, with the fluids `ends`; `VARIES` includes the effects of their
    /// slopes.
    #[inline(always)]
    fn on_edge<const VARIES: bool>(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        k: usize,
        ends: [&LocalFluid; 2],
    ) -> EdgeForce {
        let edge = &rod.edges[k];
        let opening = node(rod.v, k + 1) - node(rod.v, k);
        let (c, [u, w]) = self.moving(rod, k, [&ends[0].fluid, &ends[1].fluid]);
        let accelerations = [rod.accelerating_against_fluid(k), rod.accelerating_against_fluid(k + 1)];
        let moving = Accelerating {
            c,
            velocity: [u, w],
            acceleration: edge.components(accelerations.map(pair)),
            opening: [opening.dot(&edge.t), opening.dot(&edge.n())],
        };
        if let (false, Some(direction)) = (VARIES, along) {
            return moving.on_edge(edge, direction);
        }
        let parts = moving.parts_on(edge);
        let mut force = moving.force(&parts);
        // c changes with the position: g ℓ w [ρ′(ν·V) n − ½ w ρ′ν], the increasing density as the rod moves, and the
        // pull towards the lighter side.
        let crossing = VARIES && ends.iter().any(|here| here.slope.density != 0.0 || here.bend != 0.0);
        let halves = f64x2::new(self.halves[k]);
        let slope = halves * both(&ends, |here| here.slope.density);
        let (nu_t, nu_n) = (rod.normal().dot(&edge.t), rod.normal().dot(&edge.n()));
        let (length, Parts { own, pair }) = (edge.length, parts);
        let rising = u * nu_t + w * nu_n;
        let shape = [-(pair[0] * nu_t), rising * w - pair[0] * nu_n];
        if crossing {
            force[0] += shape[0] * slope * length;
            force[1] += shape[1] * slope * length;
        }
        let Some(direction) = along else {
            return EdgeForce { force: edge.vectors(force[0], force[1]), ..EdgeForce::ZERO };
        };
        let mut slopes = moving.slopes(edge, &parts, direction);
        let mut along_twice = None;
        if crossing {
            let Direction { q, v, .. } = direction;
            let (by_velocity, by_place) = (slope * (length * v), slope * q);
            let bend = halves * both(&ends, |here| here.bend) * (length * q);
            let pair = [pair[0] * by_place, pair[1] * by_place];
            let moved = [
                shape[0] * bend + own[0] * by_place + opposite(pair[0].reduce_add()),
                shape[1] * bend + own[1] * by_place + opposite(pair[1].reduce_add()),
            ];
            let turned = [swapped(pair[0]), swapped(pair[1])];
            let twisted = by_velocity * w * nu_t;
            let [[own_tn, own_nt, own_nn], [edge_tn, edge_nt, edge_nn]] = &mut slopes;
            *own_tn += moved[0] * nu_n - twisted;
            *own_nt += moved[1] * nu_t + twisted;
            *own_nn += moved[1] * nu_n + by_velocity * rising;
            *edge_tn += turned[0] * nu_n + (u * nu_t - rising) * w * by_place;
            *edge_nt += turned[1] * nu_t + shape[1] * by_place;
            *edge_nn += turned[1] * nu_n + (w * nu_n - rising) * u * by_place;
            along_twice = Some([moved[0] * nu_t, turned[0] * nu_t + shape[0] * by_place]);
        }
        assemble_in_plane(edge, force, slopes, along_twice)
    }

    /// c of both halves of edge `k` for these densities.
    #[inline(always)]
    pub(crate) fn inertia(&self, k: usize, densities: [f64; 2]) -> f64x2 {
        let halves = &self.halves[k];
        f64x2::new([densities[0] * halves[0], densities[1] * halves[1]])
    }

    /// Visits every edge with c and the velocities relative to the fluid, along and across the edge, one end per lane.
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

    /// c and the velocities of the ends of edge `k` relative to the `fluids` there, along and across the edge, one end
    /// per lane.
    #[inline(always)]
    fn moving(&self, rod: &Kinematics<'_>, k: usize, fluids: [&Fluid; 2]) -> (f64x2, [f64x2; 2]) {
        let c = self.inertia(k, [fluids[0].density, fluids[1].density]);
        let v = [pair(node(rod.v, k) - fluids[0].flow), pair(node(rod.v, k + 1) - fluids[1].flow)];
        (c, rod.edges[k].components(v))
    }
}

/// The motion of both ends of an edge relative to the fluid, as pairs over both ends of components along and across the
/// edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Accelerating<T: Real> {
    /// c of both halves, kg/m.
    pub c: T::Pair,
    /// Velocities u and w relative to the fluid, m/s.
    pub velocity: [T::Pair; 2],
    /// Accelerations relative to the fluid, m/s².
    pub acceleration: [T::Pair; 2],
    /// ℓ̇ and λ, m/s.
    pub opening: [T; 2],
}

/// Parts of the force over c, in components along and across.
#[derive(Debug, Clone, Copy)]
struct Parts<T: Real> {
    /// p_i over c_i.
    own: [T::Pair; 2],
    /// The force with opposite signs on the two ends.
    pair: [T::Pair; 2],
}

/// The derivatives of the force on both ends, for the components t nᵀ, n tᵀ and n nᵀ: with respect to a translation of
/// the whole edge, and with respect to the edge vector while that end stays.
type Derivatives<P> = [[P; 3]; 2];

/// Energy and momentum of the water, summed separately over the two ends of the edges.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stored<T: Real> {
    energy: T::Pair,
    momentum: [T::Pair; 2],
}

impl<T: Real> Stored<T> {
    /// Zero; `zero` selects the number type.
    #[inline(always)]
    pub fn none(zero: T) -> Self {
        let none = T::Pair::new([zero; 2]);
        Self { energy: none, momentum: [none; 2] }
    }

    /// Adds ½ c ℓ w² and c ℓ w n of the ends of `edge`.
    #[inline(always)]
    pub fn add(&mut self, edge: &Edge<T>, c: T::Pair, w: T::Pair) {
        let (n, across) = (edge.n(), c * w);
        self.energy += across * w * edge.length.like(0.5) * edge.length;
        self.momentum[0] += across * (edge.length * n.x);
        self.momentum[1] += across * (edge.length * n.y);
    }

    /// The sums over all ends, J and N s.
    #[inline(always)]
    pub fn sum(&self) -> (T, [T; 2]) {
        let [x, y] = self.momentum;
        (self.energy.sum(), [x.sum(), y.sum()])
    }
}

impl<T: Real> Accelerating<T> {
    /// The opposing forces on the ends of `edge` in a uniform fluid, as vectors of both.
    #[inline(always)]
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    pub fn force_on(&self, edge: &Edge<T>) -> [T::Pair; 2] {
        let [along, across] = self.force(&self.parts_on(edge));
        edge.vectors(along, across)
    }

    /// The opposing forces on the ends of `edge` in a uniform fluid, with their derivatives. Blocks are built from
    /// components: numbers that are written separately and read as lanes would stall.
    #[inline(always)]
    pub fn on_edge(&self, edge: &Edge<T>, direction: Direction) -> EdgeForce<T> {
        let parts = self.parts_on(edge);
        assemble_in_plane(edge, self.force(&parts), self.slopes(edge, &parts, direction), None)
    }

    #[inline(always)]
    fn parts_on(&self, edge: &Edge<T>) -> Parts<T> {
        let Self { velocity: [u, w], acceleration: [_, an], opening: [stretching, lambda], .. } = *self;
        Parts {
            own: [-(w * lambda), an * edge.length + w * stretching - u * lambda],
            pair: [w * w * w.like(0.5), -(u * w)],
        }
    }

    /// The force on both ends, N.
    #[inline(always)]
    fn force(&self, Parts { own, pair }: &Parts<T>) -> [T::Pair; 2] {
        [own[0] * self.c + opposite((pair[0] * self.c).sum()), own[1] * self.c + opposite((pair[1] * self.c).sum())]
    }

    #[inline(always)]
    fn slopes(&self, edge: &Edge<T>, Parts { pair, .. }: &Parts<T>, direction: Direction) -> Derivatives<T::Pair> {
        let Self { c, velocity: [u, w], acceleration: [at, an], opening: [stretching, lambda] } = *self;
        let length = edge.length;
        let (q, v, a) = (length.like(direction.q), length.like(direction.v), length.like(direction.a));
        let (by_velocity, by_turning) = (c * v, c * (q * edge.per_length));
        // The pair changes by (tn − nt) w − nn u with each end's velocity.
        let (turned, pushed) = (by_velocity * w, by_velocity * u);
        let twisted = opposite(turned.sum());
        let mixed = -(by_velocity * lambda);
        let own_nn = c * (length * a + stretching * v) - opposite(pushed.sum());
        // If one end stays, the other moves with the edge vector.
        let turned = turned - swapped(turned);
        let edge_tn = by_turning * (u * (length.like(2.0) * lambda) - an * length) - turned;
        let edge_nt = c * an * q + turned;
        let pair_nn = (by_turning * (u * u - pair[0])).sum();
        let edge_nn = opposite(pair_nn) - by_turning * (at * length + w * lambda) - pushed - swapped(pushed);
        [[mixed + twisted, mixed - twisted, own_nn], [edge_tn, edge_nt, edge_nn]]
    }
}

/// The force and its derivatives in the plane; `along_twice` are those of the component t tᵀ, if there are any.
#[inline(always)]
fn assemble_in_plane<T: Real>(
    edge: &Edge<T>,
    force: [T::Pair; 2],
    slopes: Derivatives<T::Pair>,
    along_twice: Option<[T::Pair; 2]>,
) -> EdgeForce<T> {
    let (t, n) = (pair(edge.t), pair(edge.n()));
    let blocks = [Block::outer(edge.t, n), Block::outer(edge.n(), t), Block::outer(edge.n(), n)];
    let (mut own, mut by_edge) = (combined(blocks, slopes[0]), combined(blocks, slopes[1]));
    if let Some([of_own, of_edge]) = along_twice {
        let tt = Block::outer(edge.t, t);
        let (of_own, of_edge) = (of_own.to_array(), of_edge.to_array());
        own = [tt * of_own[0] + own[0], tt * of_own[1] + own[1]];
        by_edge = [tt * of_edge[0] + by_edge[0], tt * of_edge[1] + by_edge[1]];
    }
    EdgeForce { force: edge.vectors(force[0], force[1]), own, edge: by_edge }
}

/// The sum of `blocks` times their factors, for both ends.
#[inline(always)]
fn combined<T: Real>([tn, nt, nn]: [Block<T>; 3], [by_tn, by_nt, by_nn]: [T::Pair; 3]) -> [Block<T>; 2] {
    let (by_tn, by_nt, by_nn) = (by_tn.to_array(), by_nt.to_array(), by_nn.to_array());
    [tn * by_tn[0] + nt * by_nt[0] + nn * by_nn[0], tn * by_tn[1] + nt * by_nt[1] + nn * by_nn[1]]
}

/// `value` on the first end, and −`value` on the second.
#[inline(always)]
fn opposite<T: Real>(value: T) -> T::Pair {
    T::Pair::new([value, -value])
}

/// The values with both ends exchanged.
#[inline(always)]
fn swapped<T: Real, P: Pair<T>>(ends: P) -> P {
    let [first, second] = ends.to_array();
    P::new([second, first])
}

impl Wake {
    /// The wake that leaves the tail of `rod`. The `shedding` χ is 1 for a sharp end and 0 for a pointed one.
    pub fn new(rod: &Rod, shedding: f64) -> Self {
        Self { mass: shedding * FRAC_PI_4 * rod.sections.at(1.0).added() }
    }
}

/// a bᵀ.
#[inline(always)]
fn outer(a: Vector2<f64>, b: Vector2<f64>) -> Matrix2<f64> {
    a * b.transpose()
}

impl Force for Reactive {
    fn name(&self) -> &'static str {
        NAME
    }

    fn validity(&self) -> Validity {
        VALIDITY
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn is_inertial(&self) -> bool {
        true
    }

    fn power_kind(&self) -> Option<PowerKind> {
        None
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
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

    fn energy(&self, rod: &Kinematics<'_>, factor: f64, mut by: Option<StateDerivatives<'_>>) -> f64 {
        let mut energy = f64x2::ZERO;
        self.each_edge(rod, |k, edge, c, [u, w]| {
            let own = c * w * w * 0.5;
            energy += own * edge.length;
            if let Some(StateDerivatives { q, v, .. }) = &mut by {
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

    fn momentum(
        &self,
        rod: &Kinematics<'_>,
        axis: Vector2<f64>,
        factor: f64,
        mut by: Option<StateDerivatives<'_>>,
    ) -> f64 {
        // Σ c ℓ w n, the derivative of the energy with respect to the velocity of the whole rod.
        let mut momentum = f64x2::ZERO;
        self.each_edge(rod, |k, edge, c, [u, w]| {
            let (along, across) = (edge.t.dot(&axis), edge.n().dot(&axis));
            momentum += c * w * (edge.length * across);
            if let Some(StateDerivatives { q, v, .. }) = &mut by {
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

    fn stored(&self, rod: &Kinematics<'_>) -> (f64, Vector2<f64>) {
        let mut stored = Stored::none(0.0);
        self.each_edge(rod, |_, edge, c, [_, w]| stored.add(edge, c, w));
        let (energy, momentum) = stored.sum();
        (energy, momentum.into())
    }

    /// Σ ½ g ℓ w² ∇ρ over all ends.
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
                LocalFluid { fluid: Fluid { flow: rod.flow(k + i), ..by.fluid }, ..by }
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

/// S(u/|V|) and dS/dx: S is 1 if the tip leads, and falls to 0 if it moves straight backwards.
fn switch(x: f64) -> [f64; 2] {
    if x <= 0.0 {
        return [1.0, 0.0];
    }
    let x = x.min(1.0);
    [1.0 - x * x * x * (10.0 + x * (-15.0 + 6.0 * x)), -30.0 * (x * (1.0 - x)).powi(2)]
}

impl Wake {
    /// The force that pulls the tip, over its mass, with derivatives with respect to velocity and to the vectors of the
    /// last two edges.
    fn on_tip(rod: &Kinematics<'_>) -> Option<TipForce> {
        let [.., before, last] = rod.edges else { return None };
        // The direction of the rod's end, extrapolated by half an edge from the middle of the last one: second order.
        let wanted = last.t * 3.0 - before.t;
        let size = wanted.norm();
        let d = wanted / size;
        let n = Vector2::new(-d.y, d.x);
        let velocity = rod.against_fluid(rod.edges.len());
        let (u, w) = (velocity.dot(&d), velocity.dot(&n));
        let speed = u.hypot(w);
        if speed == 0.0 {
            return Some(TipForce { force: Vector2::zeros(), own: Matrix2::zeros(), edges: [Matrix2::zeros(); 2] });
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
        Some(TipForce { force: plain * s, own: by_velocity, edges: [turned(before, -1.0), turned(last, 3.0)] })
    }
}

impl Force for Wake {
    fn name(&self) -> &'static str {
        "wake"
    }

    fn validity(&self) -> Validity {
        VALIDITY
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn power_kind(&self) -> Option<PowerKind> {
        Some(PowerKind::Wake)
    }

    fn is_on_edges(&self, _: &Kinematics<'_>) -> bool {
        false
    }

    /// Does nothing: all of it acts on the tip.
    fn evaluate(&self, _: &Kinematics<'_>, _: Option<Direction>, _: Range<usize>, _: &mut ForceAccumulator<'_>) {}

    fn tip(&self, rod: &Kinematics<'_>, along: Option<Direction>) -> Option<TipForce> {
        let TipForce { force, own, edges } = Self::on_tip(rod)?;
        let LocalFluid { fluid, slope, .. } = rod.here(rod.edges.len());
        let mass = -self.mass * fluid.density; // opposing force
        let Direction { q, v, .. } = along.unwrap_or(Direction { q: 0.0, v: 0.0, a: 0.0 });
        let by_place = outer(force, rod.normal()) * (-self.mass * slope.density * q);
        Some(TipForce { force: force * mass, own: own * (mass * v) + by_place, edges: edges.map(|by| by * (mass * q)) })
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
