//! Nonlocal drag at low Reynolds number: hydrodynamic interaction of all parts of the rod.
//!
//! The rod exerts a force density f (N/m) on the fluid that is linear between nodes, as regularised Stokeslets of blob
//! size ε = √e a along its straight edges, where a is the local radius. With this ε, both coefficients of slender-body
//! theory for a cylinder are recovered. The velocity relative to the fluid at the nodes is w = M(q) f, with integrals
//! along each edge in closed form. The force on the nodes is F = G f, with the consistent mass matrix G. The motion is
//! planar, the flow is three-dimensional.
//!
//! Near a plane wall, parallel to the plane of the motion at height h, each Stokeslet has its image. The velocity that
//! remains at the wall, −2h x/(x² + h² + ε²)^{3/2} normal to it, is that of a point force at the depth H = √(h² + ε²).
//! Blake's correction for that depth, times h/H, therefore cancels it exactly.
//!
//! R. Cortez, J. Comput. Phys. 375 (2018); J. R. Blake, Proc. Camb. Phil. Soc. 70 (1971).

use std::f64::consts::PI;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use nalgebra::{Matrix2, Vector2};

use super::force::{EdgeForce, Force, ForceAccumulator, GlobalForce, Kinematics, StateDerivatives};
use super::laws::{DragLaw, LawInputs};
use super::medium::{Key, VISCOSITY};
use super::validity::Validity;
use crate::linear::{BandMatrix, Block, Coupling, DenseLu, Direction, pair};
use crate::rod::{Edge, Rod, add, node};

/// Minimum ratio of node spacing to blob size. Below it M is ill-conditioned: its condition number is 8e3 at 0.5 and
/// 2e8 at 0.2.
const FINEST: f64 = 0.5;

/// The load on an end of an edge is the length of the edge times these fractions of the force densities at the near and
/// the far end.
const SHARES: [f64; 2] = [1.0 / 3.0, 1.0 / 6.0];

/// Blob size ε (m) for a `radius` (m).
fn blob(radius: f64) -> f64 {
    (0.5_f64).exp() * radius
}

/// The minimum node spacing (m) on the rod of `inputs`.
pub fn least_spacing(inputs: &LawInputs<'_>) -> f64 {
    FINEST * blob(inputs.rod.sections.largest_radius())
}

/// The nonlocal drag on a rod.
#[derive(Debug)]
pub struct Nonlocal {
    law: &'static DragLaw,
    /// First node of the rod itself.
    front: usize,
    /// The square of the blob size of each edge, m².
    blobs: Vec<f64>,
    /// Height above a wall, m.
    height: Option<f64>,
    /// Quantities of the motion last evaluated, cached because everything that evaluates a step needs them.
    flow: Mutex<InducedFlow>,
}

/// The flow induced by a motion, for viscosity one. Entries of the centre of a body have no effect.
#[derive(Debug)]
struct InducedFlow {
    /// Positions (m) for which the mobility was computed.
    q: Vec<f64>,
    /// 8πM by columns, two rows and columns per node.
    mobility: Vec<f64>,
    factors: DenseLu,
    /// Velocities (m/s) relative to the fluid for which the density was computed.
    w: Vec<f64>,
    /// f/μ, m/s.
    density: Vec<f64>,
    viscosity: f64,
    /// Lengths of the edges, m; zero for a neck.
    lengths: Vec<f64>,
    /// Derivative of 8πM f/μ with respect to the positions at constant f, by columns.
    slopes: Vec<f64>,
    /// True if `slopes` belongs to this motion.
    sloped: bool,
    /// Newton's matrix without the term of `slopes`, for M⁻¹ times the unknowns.
    jacobian: DenseLu,
    // Work arrays.
    workspace: Vec<f64>,
    first: Vec<f64>,
    term: Vec<f64>,
}

impl InducedFlow {
    /// Factors J₀ for this `band`; `by_velocity` is the factor of velocities in the direction.
    fn factor(&mut self, band: &BandMatrix, by_velocity: f64) {
        let Self { mobility, viscosity, lengths, jacobian, .. } = self;
        let size = band.unknowns();
        for (column, product) in mobility.chunks_exact(size).zip(jacobian.values_mut().chunks_exact_mut(size)) {
            band.multiply(column, product, false);
        }
        let factor = 8.0 * PI * *viscosity * by_velocity;
        let entries = jacobian.values_mut();
        let mut put = |i: usize, j: usize, value: f64| {
            if !(i == 0 && band.is_prescribed(0)) {
                (0..2).for_each(|c| entries[(2 * j + c) * size + 2 * i + c] += factor * value);
            }
        };
        for (e, length) in lengths.iter().enumerate() {
            let [near, far] = SHARES.map(|share| share * length);
            put(e, e, near);
            put(e, e + 1, far);
            put(e + 1, e, far);
            put(e + 1, e + 1, near);
        }
        jacobian.factor();
    }

    /// Replaces `rhs` by J₀⁻¹ rhs; the unknowns of node 0 stay exactly zero if it is `held`.
    fn solve(&mut self, rhs: &mut [f64], held: bool) {
        self.jacobian.solve(rhs);
        multiply(&self.mobility, rhs, &mut self.workspace);
        rhs.copy_from_slice(&self.workspace);
        if held {
            rhs[..2].fill(0.0);
        }
    }

    /// Replaces `x` by `factor` G M⁻¹ D x, with zero on node 0 if it is `held`.
    fn by_positions(&mut self, factor: f64, x: &mut [f64], held: bool) {
        multiply(&self.slopes, x, &mut self.workspace);
        self.factors.solve(&mut self.workspace);
        x.fill(0.0);
        for (e, length) in self.lengths.iter().enumerate() {
            let ends = on_ends(&self.workspace, e, factor * self.viscosity * length);
            (0..2).for_each(|i| add(x, e + i, ends[i]));
        }
        if held {
            x[..2].fill(0.0);
        }
    }
}

/// y = A x, with A given by `columns`.
fn multiply(columns: &[f64], x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (column, x) in columns.chunks_exact(y.len()).zip(x) {
        y.iter_mut().zip(column).for_each(|(y, a)| *y += a * x);
    }
}

/// The maximum modulus of `values`.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, x| most.max(x.abs()))
}

impl Nonlocal {
    /// The force of `law` on the rod of `inputs`.
    pub fn new(law: &'static DragLaw, inputs: &LawInputs<'_>) -> Self {
        let Rod { nodes, front, .. } = *inputs.rod;
        let size = 2 * nodes;
        let radius = |[first, second]: [crate::rod::HalfEdge; 2]| 0.5 * (first.radius + second.radius);
        let flow = InducedFlow {
            q: vec![f64::NAN; size],
            mobility: vec![0.0; size * size],
            factors: DenseLu::new(size),
            w: vec![f64::NAN; size],
            density: vec![0.0; size],
            viscosity: 0.0,
            lengths: vec![0.0; nodes - 1],
            slopes: vec![0.0; size * size],
            sloped: false,
            jacobian: DenseLu::new(size),
            workspace: vec![0.0; size],
            first: vec![0.0; size],
            term: vec![0.0; size],
        };
        Self {
            law,
            front,
            blobs: inputs.rod.halves().map(|halves| blob(radius(halves)).powi(2)).collect(),
            height: Some(inputs.height).filter(|height| height.is_finite()),
            flow: Mutex::new(flow),
        }
    }

    /// The flow induced by the motion `rod`.
    fn flow(&self, rod: &Kinematics<'_>) -> MutexGuard<'_, InducedFlow> {
        let mut guard = self.last();
        let flow = &mut *guard;
        if flow.q != rod.q {
            flow.q.copy_from_slice(rod.q);
            self.mobility(rod, &mut flow.mobility);
            for (e, (length, edge)) in flow.lengths.iter_mut().zip(rod.edges).enumerate() {
                *length = if e < self.front { 0.0 } else { edge.length };
            }
            flow.factors.values_mut().copy_from_slice(&flow.mobility);
            flow.factors.factor();
            flow.w.fill(f64::NAN);
        }
        flow.viscosity = rod.fluid.viscosity;
        let mut same = true;
        for (k, w) in flow.w.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let now = if k < self.front { [0.0; 2] } else { rod.against_fluid(k).into() };
            same &= *w == now;
            *w = now;
        }
        if !same {
            flow.sloped = false;
            flow.density.copy_from_slice(&flow.w);
            flow.factors.solve(&mut flow.density);
            flow.density.iter_mut().for_each(|f| *f *= 8.0 * PI);
        }
        guard
    }

    /// The flow last evaluated.
    fn last(&self) -> MutexGuard<'_, InducedFlow> {
        self.flow.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes 8πμM of the rod's nodes by columns, and the identity for those before it.
    fn mobility(&self, rod: &Kinematics<'_>, columns: &mut [f64]) {
        let size = rod.q.len();
        columns.fill(0.0);
        (0..2 * self.front).for_each(|i| columns[i * (size + 1)] = 1.0);
        for (e, edge) in rod.edges.iter().enumerate().skip(self.front) {
            let segment = Segment { edge, blob_squared: self.blobs[e], height: self.height };
            let start = node(rod.q, e);
            let four = &mut columns[2 * e * size..(2 * e + 4) * size];
            let (first, second) = four.split_at_mut(2 * size);
            let (x0, y0) = first.split_at_mut(size);
            let (x1, y1) = second.split_at_mut(size);
            for k in self.front..size / 2 {
                let [near, far] = segment.at(node(rod.q, k) - start);
                for (columns, [xx, xy, yy]) in [([&mut *x0, &mut *y0], near), ([&mut *x1, &mut *y1], far)] {
                    let [x, y] = columns;
                    x[2 * k] += xx;
                    x[2 * k + 1] += xy;
                    y[2 * k] += xy;
                    y[2 * k + 1] += yy;
                }
            }
        }
    }

    /// Computes the derivative of the induced velocities with respect to the positions at constant density, unless it
    /// is known.
    fn slope(&self, flow: &mut InducedFlow) {
        let InducedFlow { q, density, slopes, sloped, .. } = flow;
        if std::mem::replace(sloped, true) {
            return;
        }
        let size = q.len();
        slopes.fill(0.0);
        for (e, blob_squared) in self.blobs.iter().enumerate().skip(self.front) {
            let start = node(q, e);
            let edge = Edge::new(node(q, e + 1) - start);
            let segment = Segment { edge: &edge, blob_squared: *blob_squared, height: self.height };
            let ends = [node(density, e), node(density, e + 1)];
            for k in self.front..size / 2 {
                let [by_place, by_edge] = segment.change(node(q, k) - start, ends);
                for (j, block) in [(k, by_place), (e, -by_place - by_edge), (e + 1, by_edge)] {
                    for c in 0..2 {
                        slopes[(2 * j + c) * size + 2 * k] += block[(0, c)];
                        slopes[(2 * j + c) * size + 2 * k + 1] += block[(1, c)];
                    }
                }
            }
        }
    }

    /// The opposing forces on the ends of edge `e`, N.
    fn on_edge(flow: &InducedFlow, e: usize) -> [Vector2<f64>; 2] {
        on_ends(&flow.density, e, flow.viscosity * flow.lengths[e])
    }
}

/// The loads of a force `density` on the ends of edge `e` with this `length`.
fn on_ends(density: &[f64], e: usize, length: f64) -> [Vector2<f64>; 2] {
    let [near, far] = SHARES.map(|share| share * length);
    let ends = [node(density, e), node(density, e + 1)];
    [ends[0] * near + ends[1] * far, ends[0] * far + ends[1] * near]
}

/// An edge that exerts forces on the fluid.
#[derive(Debug)]
pub struct Segment<'a> {
    /// The edge.
    pub edge: &'a Edge,
    /// ε², m².
    pub blob_squared: f64,
    /// Height above a wall, m.
    pub height: Option<f64>,
}

/// Entries xx, xy = yx and yy of a block.
pub type Symmetric = [f64; 3];

impl Segment<'_> {
    /// 8πμ times the velocity at the position `d` (m) relative to its start, for force densities that are linear along
    /// it: 1 at its start and 0 at its end, and the reverse.
    #[inline]
    pub fn at(&self, d: Vector2<f64>) -> [Symmetric; 2] {
        let edge = self.edge;
        let (along, across) = (d.dot(&edge.t), d.dot(&edge.n()));
        // The density at the end has the weight (σ + `along`)/ℓ.
        let [constant, linear] =
            self.sums(across, |square| InversePowers::over([-along, edge.length - along], square), stokeslets, dipoles);
        let far: Symmetric = std::array::from_fn(|j| (along * constant[j] + linear[j]) * edge.per_length);
        let near: Symmetric = std::array::from_fn(|j| constant[j] - far[j]);
        let (c, s) = (edge.t.x, edge.t.y);
        [near, far].map(|[tt, tn, nn]| {
            [
                tt * c * c - 2.0 * tn * c * s + nn * s * s,
                (tt - nn) * c * s + tn * (c * c - s * s),
                tt * s * s + 2.0 * tn * c * s + nn * c * c,
            ]
        })
    }

    /// The derivatives of 8πμ times the velocity at `d` with respect to `d` and to the edge's vector, for the force
    /// densities `ends` (N/m) at its start and end.
    #[inline]
    pub fn change(&self, d: Vector2<f64>, ends: [Vector2<f64>; 2]) -> [Matrix2<f64>; 2] {
        let edge = self.edge;
        let (along, across) = (d.dot(&edge.t), d.dot(&edge.n()));
        let [from, to] = [-along, edge.length - along];
        let over = |square| InversePowers::over([from, to], square);
        let [constant, linear] = self.sums(across, over, stokeslets, dipoles);
        let [constant_across, linear_across] = self.sums(across, over, stokeslets_across, dipoles_across);
        let [at_start, at_end] = [from, to]
            .map(|sigma| self.sums(across, |square| InversePowers::at(sigma, square), stokeslets, dipoles)[0]);
        // From here on in components along and across the edge. The density is `foot` + σ `rate`.
        let own = |f: Vector2<f64>| Vector2::new(f.dot(&edge.t), f.dot(&edge.n()));
        let times = |[tt, tn, nn]: Symmetric, f: Vector2<f64>| Vector2::new(tt * f.x + tn * f.y, tn * f.x + nn * f.y);
        let turned = |f: Vector2<f64>| Vector2::new(-f.y, f.x);
        let [start, end] = ends.map(own);
        let rate = (end - start) * edge.per_length;
        let foot = start + rate * along;
        let velocity = times(constant, foot) + times(linear, rate);
        let of_turned = times(constant, turned(foot)) + times(linear, turned(rate));
        let by_along = times(at_start, start) - times(at_end, end) + times(constant, rate);
        let by_across = times(constant_across, foot) + times(linear_across, rate);
        let by_length = times(at_end, end) - (times(constant, rate) * along + times(linear, rate)) * edge.per_length;
        // If the edge turns, the position and the density turn back relative to it, and the velocity turns with it.
        let by_turn = by_along * across - by_across * along - of_turned + turned(velocity);
        let axes = Matrix2::from_columns(&[edge.t, edge.n()]);
        [[by_along, by_across], [by_length, by_turn * edge.per_length]]
            .map(|columns| axes * Matrix2::from_columns(&columns) * axes.transpose())
    }

    /// The kernel `of` for the point forces, minus that for their images and minus the kernel `of_image` for Blake's
    /// correction, each applied to the integrals `powers`.
    #[inline(always)]
    fn sums(
        &self,
        across: f64,
        powers: impl Fn(f64) -> InversePowers,
        of: impl Fn(InversePowers, f64, f64) -> [Symmetric; 2],
        of_image: impl Fn(InversePowers, f64) -> [Symmetric; 2],
    ) -> [Symmetric; 2] {
        let Self { blob_squared, height, .. } = *self;
        let square = across * across;
        let mut sums = of(powers(square + blob_squared), across, blob_squared);
        if let Some(height) = height {
            let double = 4.0 * height * height;
            let image = of(powers(square + double + blob_squared), across, blob_squared);
            let depth = height + (height * height + blob_squared).sqrt();
            let left = of_image(powers(square + depth * depth), across);
            for i in 0..2 {
                for j in 0..3 {
                    sums[i][j] -= image[i][j] + 0.5 * double * left[i][j];
                }
            }
        }
        sums
    }
}

/// Integrals ∫σᵐ/Rⁿ dσ over an edge with R² = σ² + h², or the integrands σᵐ/Rⁿ at one position.
#[derive(Debug, Clone, Copy)]
struct InversePowers {
    /// n = 1, m = 0, 1.
    first: [f64; 2],
    /// n = 3, m = 0 … 3.
    third: [f64; 4],
    /// n = 5, m = 0 … 3.
    fifth: [f64; 4],
    /// n = 7, m = 0 … 3.
    seventh: [f64; 4],
}

impl InversePowers {
    /// The integrals over `ends`, with h² = `square`.
    #[inline(always)]
    fn over([from, to]: [f64; 2], square: f64) -> Self {
        let [r0, r1] = [from, to].map(|s| (s * s + square).sqrt());
        let [p0, p1] = [1.0 / r0, 1.0 / r1];
        let per_square = 1.0 / square;
        // σ + R, without cancellation for σ < 0.
        let grown = |s: f64, r: f64| if s < 0.0 { square / (r - s) } else { s + r };
        let logarithm = (grown(to, r1) / grown(from, r0)).ln();
        let (c0, c1) = (from * p0, to * p1);
        let (cubes, longer) = (p1 * p1 * p1 - p0 * p0 * p0, r1 - r0);
        let (shorter, third) = (p0 - p1, c1 * c1 * c1 - c0 * c0 * c0);
        let zeroth = (c1 - c0) * per_square;
        let second = logarithm - (c1 - c0);
        let per_cubes = to * p1 * p1 * p1 - from * p0 * p0 * p0;
        let powers_of_five = p1.powi(5) - p0.powi(5);
        let fifth = c1.powi(5) - c0.powi(5);
        Self {
            first: [logarithm, longer],
            third: [zeroth, shorter, second, longer - square * shorter],
            fifth: [
                (per_cubes + 2.0 * zeroth) * per_square / 3.0,
                -cubes / 3.0,
                third * per_square / 3.0,
                shorter + square * cubes / 3.0,
            ],
            seventh: [
                (c1 - c0 - 2.0 / 3.0 * third + 0.2 * fifth) * per_square.powi(3),
                -0.2 * powers_of_five,
                (third / 3.0 - 0.2 * fifth) * per_square * per_square,
                -cubes / 3.0 + 0.2 * square * powers_of_five,
            ],
        }
    }

    /// The integrands at `sigma`, with h² = `square`.
    #[inline(always)]
    fn at(sigma: f64, square: f64) -> Self {
        let per_square = 1.0 / (sigma * sigma + square);
        let first = per_square.sqrt();
        let powers = |inverse: f64| [inverse, sigma * inverse, sigma * sigma * inverse, sigma.powi(3) * inverse];
        Self {
            first: [first, sigma * first],
            third: powers(first * per_square),
            fifth: powers(first * per_square.powi(2)),
            seventh: powers(first * per_square.powi(3)),
        }
    }
}

/// ∫ (I/R³ − 3rrᵀ/R⁵)(1, σ) dσ with r = (−σ, `across`): components tt, tn, nn.
#[inline(always)]
fn dipoles(InversePowers { third, fifth, .. }: InversePowers, across: f64) -> [Symmetric; 2] {
    [0, 1].map(|m| {
        [third[m] - 3.0 * fifth[m + 2], 3.0 * across * fifth[m + 1], third[m] - 3.0 * across * across * fifth[m]]
    })
}

/// The derivative of [`dipoles`] with respect to `across`.
#[inline(always)]
fn dipoles_across(InversePowers { fifth, seventh, .. }: InversePowers, across: f64) -> [Symmetric; 2] {
    let square = across * across;
    [0, 1].map(|m| {
        [
            across * (15.0 * seventh[m + 2] - 3.0 * fifth[m]),
            3.0 * fifth[m + 1] - 15.0 * square * seventh[m + 1],
            across * (15.0 * square * seventh[m] - 9.0 * fifth[m]),
        ]
    })
}

/// ∫ (I/R + ε²I/R³ + rrᵀ/R³)(1, σ) dσ with r = (−σ, `across`): components tt, tn, nn.
#[inline(always)]
fn stokeslets(InversePowers { first, third, .. }: InversePowers, across: f64, blob_squared: f64) -> [Symmetric; 2] {
    [0, 1].map(|m| {
        let isotropic = first[m] + blob_squared * third[m];
        [isotropic + third[m + 2], -across * third[m + 1], isotropic + across * across * third[m]]
    })
}

/// The derivative of [`stokeslets`] with respect to `across`.
#[inline(always)]
fn stokeslets_across(
    InversePowers { third, fifth, .. }: InversePowers,
    across: f64,
    blob_squared: f64,
) -> [Symmetric; 2] {
    let square = across * across;
    [0, 1].map(|m| {
        let isotropic = third[m] + 3.0 * blob_squared * fifth[m];
        [
            -across * (isotropic + 3.0 * fifth[m + 2]),
            3.0 * square * fifth[m + 1] - third[m + 1],
            across * (2.0 * third[m] - isotropic - 3.0 * square * fifth[m]),
        ]
    })
}

impl Coupling for Nonlocal {
    /// Newton's matrix is J₀ − c_q G M⁻¹ D with J₀ = B + c_v G M⁻¹, where D is the derivative of the velocities with
    /// respect to the positions at constant f. With x = M y, J₀ x = r becomes (B M + c_v G) y = r, where B M is banded
    /// times dense, so one LU suffices. D is so small that the series of J₀⁻¹ c_q G M⁻¹ D gains two to three digits per
    /// term, each at the cost of a few matrix-vector products.
    fn solve(&self, band: &BandMatrix, along: Direction, rhs: &mut [f64]) {
        /// Size of the last term relative to the solution: Newton's method gains no more than four digits per
        /// iteration.
        const SERIES_TOLERANCE: f64 = 1e-5;
        /// With more terms the series counts as divergent, and only its first term is used, which neglects D.
        const MAX_TERMS: u32 = 8;
        let mut guard = self.last();
        let flow = &mut *guard;
        flow.factor(band, along.v);
        let held = band.is_prescribed(0);
        let mut term = std::mem::take(&mut flow.term);
        flow.solve(rhs, held);
        if along.q != 0.0 && flow.density.iter().any(|f| *f != 0.0) {
            self.slope(flow);
            let InducedFlow { first, .. } = flow;
            first.copy_from_slice(rhs);
            term.copy_from_slice(rhs);
            let mut last = largest(rhs);
            for terms in 1.. {
                flow.by_positions(along.q, &mut term, held);
                flow.solve(&mut term, held);
                let size = largest(&term);
                let shrinks = size < 0.5 * last; // false for NaN
                if terms > MAX_TERMS || !shrinks {
                    rhs.copy_from_slice(&flow.first);
                    break;
                }
                rhs.iter_mut().zip(&term).for_each(|(x, term)| *x += term);
                if size <= SERIES_TOLERANCE * largest(rhs) {
                    break;
                }
                last = size;
            }
        }
        flow.term = term;
    }
}

impl GlobalForce for Nonlocal {
    /// δF = δG f + G M⁻¹ (δw − D δq), where D δq is the change of M f with the positions.
    fn add_change(&self, rod: &Kinematics<'_>, [dq, dv]: [&[f64]; 2], flow: Vector2<f64>, out: &mut [f64]) {
        let mut last = self.flow(rod);
        let mut change = vec![0.0; dq.len()];
        if dq.iter().any(|d| *d != 0.0) {
            self.slope(&mut last);
            multiply(&last.slopes, dq, &mut change);
        }
        for (i, (change, v)) in change.iter_mut().zip(dv).enumerate().skip(2 * self.front) {
            *change = 8.0 * PI * (v - flow[i % 2]) - *change;
        }
        last.factors.solve(&mut change);
        for e in self.front..rod.edges.len() {
            let longer = rod.edges[e].t.dot(&(node(dq, e + 1) - node(dq, e)));
            let by_density = on_ends(&change, e, last.viscosity * last.lengths[e]);
            let by_length = on_ends(&last.density, e, last.viscosity * longer);
            (0..2).for_each(|i| add(out, e + i, by_density[i] + by_length[i]));
        }
    }

    /// With g = Gᵀc and y = M⁻ᵀ g: c·δF = c·δG f + y·(δw − D δq).
    fn add_slopes(
        &self,
        rod: &Kinematics<'_>,
        edges: Range<usize>,
        cotangent: &dyn Fn(usize) -> Vector2<f64>,
        by: &mut StateDerivatives<'_>,
    ) {
        let mut last = self.flow(rod);
        self.slope(&mut last);
        let mut y = vec![0.0; rod.q.len()];
        for e in edges.start.max(self.front)..edges.end {
            let ends = [cotangent(e), cotangent(e + 1)];
            // The loads on the ends are a symmetric function of the densities there.
            let [near, far] = SHARES.map(|share| share * last.viscosity * last.lengths[e]);
            add(&mut y, e, ends[0] * near + ends[1] * far);
            add(&mut y, e + 1, ends[0] * far + ends[1] * near);
            let by_length = on_ends(&last.density, e, last.viscosity);
            let longer = rod.edges[e].t * (ends[0].dot(&by_length[0]) + ends[1].dot(&by_length[1]));
            add(by.q, e, -longer);
            add(by.q, e + 1, longer);
        }
        last.factors.solve_transposed(&mut y);
        by.v.iter_mut().zip(&y).skip(2 * self.front).for_each(|(by, y)| *by += 8.0 * PI * y);
        for (by, column) in by.q.iter_mut().zip(last.slopes.chunks_exact(y.len())) {
            *by -= column.iter().zip(&y).skip(2 * self.front).map(|(slope, y)| slope * y).sum::<f64>();
        }
    }
}

impl Force for Nonlocal {
    fn name(&self) -> &'static str {
        self.law.name
    }

    fn validity(&self) -> Validity {
        self.law.validity
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    /// The derivatives are only those with respect to the length on which a density acts; the rest is nonlocal.
    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        let flow = self.flow(rod);
        let by_position = along.map_or(0.0, |along| along.q);
        sums.each(edges, |e| {
            let (forces, edge) = (Self::on_edge(&flow, e), &rod.edges[e]);
            let longer = pair(edge.t * (by_position * edge.per_length));
            EdgeForce::new(forces, [Block::ZERO; 2], forces.map(|force| Block::outer(force, longer)))
        });
    }

    fn global(&self) -> Option<&dyn GlobalForce> {
        Some(self)
    }

    fn is_linear(&self) -> bool {
        true
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        if key == VISCOSITY {
            let flow = self.flow(rod);
            for e in 0..rod.edges.len() {
                let ends = Self::on_edge(&flow, e);
                ends.into_iter().enumerate().for_each(|(i, force)| add(out, e + i, force / flow.viscosity));
            }
        }
        [0.0; 2]
    }
}
