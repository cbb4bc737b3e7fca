//! A rigid spheroid in front of the rod: its drag, and the inertia of the fluid around it.
//!
//! The body's centre is node 0, and the neck from there to node 1, where the rod begins, turns with it: t is the body's
//! axis, V the velocity of its centre relative to the fluid, and φ̇ = n·(v₁ − v₀)/ℓ its angular velocity. A force f on
//! the centre and a couple C act as f − (C/ℓ) n on node 0 and (C/ℓ) n on node 1. Both forces have this form:
//!
//! - the opposing drag is f = Σ_i (μH_i + ½ρA_iC_i|V_i|)V_i along and across the body, and C = μH_r φ̇;
//! - the fluid's energy T = ½m∥(V·t)² + ½m⊥(V·n)² + ½Jφ̇² gives f = d(m∥u t + m⊥w n)/dt and C = Jφ̈ − (m∥ − m⊥)uw, with
//!   Munk's moment.
//!
//! The coefficients of a spheroid are those of A. T. Chwang & T. Y.-T. Wu, J. Fluid Mech. 67 (1975) and H. Lamb,
//! Hydrodynamics (1932), articles 114–115 and 121. All of them follow from Λ = (atanh e − e)/e³, which is smooth from a
//! prolate body (0 < e² < 1) through the sphere (Λ = ⅓) to an oblate one (e² < 0).

use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use super::force::{EdgeForce, Force, ForceAccumulator, Kinematics, PowerKind, StateDerivatives};
use super::laws::CREEPING;
use super::medium::{DENSITY, Key, VISCOSITY};
use super::validity::Validity;
use super::validity::{Bound, DimensionlessNumber};
use crate::linear::{Block, Direction};
use crate::rod::{Spheroid, add, node};

/// Name of the drag.
pub const DRAG: &str = "head-body drag";
/// Name of the inertia.
pub const INERTIA: &str = "head-body inertia";

/// The key of the form drag C along the body.
pub const FORM_DRAG_ALONG: Key = "head_body.form_drag_along";
/// The key of the form drag C across the body.
pub const FORM_DRAG_ACROSS: Key = "head_body.form_drag_across";

/// Smallest coefficient that counts as form drag if the flow does not creep: the most streamlined bodies have about
/// 0.02.
const LEAST_FORM: f64 = 0.01;

/// Up to this |e²|, Λ is summed from its series, because its closed form is a difference of nearly equal numbers.
const NEARLY_A_SPHERE: f64 = 0.1;

/// Number of terms of Jeffery's series: the remainder is at most 2e-6.
const SPINNING: u32 = 500;

impl Spheroid {
    /// e² = 1 − (b/a)², negative for an oblate body, and Λ = (atanh e − e)/e³.
    fn shape(&self) -> [f64; 2] {
        let ratio = self.across / self.along;
        let square = 1.0 - ratio * ratio;
        let lambda = if square.abs() < NEARLY_A_SPHERE {
            // Σ e^2n/(2n + 3)
            let (mut sum, mut power, mut odd): (f64, f64, f64) = (0.0, 1.0, 3.0);
            while power.abs() > f64::EPSILON * f64::EPSILON {
                sum += power / odd;
                (power, odd) = (power * square, odd + 2.0);
            }
            sum
        } else if square > 0.0 {
            let e = square.sqrt();
            (((1.0 + e) / ratio).ln() - e) / (e * square)
        } else {
            let e = (-square).sqrt();
            (e - e.atan()) / (e * -square)
        };
        [square, lambda]
    }

    /// Stokes drag over μ for translation along and across the body (m), and for rotation about an axis across it (m³):
    /// 6πa, 6πa and 8πa³ for a sphere.
    pub fn drag(&self) -> [f64; 3] {
        let [square, lambda] = self.shape();
        let a = self.along;
        let along = 1.0 + (1.0 + square) * lambda;
        [
            8.0 * PI * a / along,
            16.0 * PI * a / (3.0 + (3.0 * square - 1.0) * lambda),
            16.0 / 3.0 * PI * a.powi(3) * (2.0 - square) / along,
        ]
    }

    /// The same with the centre at `height` (m) above a plane wall, for translation parallel to the wall and rotation
    /// about its normal: each is multiplied by the effect of the wall on a sphere with the same drag. H. Faxén's
    /// reflections for translation (Happel & Brenner, Low Reynolds Number Hydrodynamics, section 7-4), within 1 % above
    /// 1.5 radii and 5 % above 1.13; G. B. Jeffery's series for rotation (Proc. Lond. Math. Soc. 14, 1915), exact for a
    /// sphere. A lower height counts as touching the wall.
    pub fn drag_beside(&self, height: f64) -> [f64; 3] {
        let [along, across, turning] = self.drag();
        let moving = |drag: f64| {
            let near = (drag / (6.0 * PI * height)).min(1.0);
            let left = [-9.0 / 16.0, 0.0, 1.0 / 8.0, -45.0 / 256.0, -1.0 / 16.0];
            drag / (1.0 + near * left.iter().rfold(0.0, |sum, factor| factor + near * sum))
        };
        let near = ((turning / (8.0 * PI)).cbrt() / height).min(1.0);
        [moving(along), moving(across), turning * spinning(near)]
    }

    /// Added mass along and across the body (m³) and added moment of inertia about an axis across it (m⁵), each over
    /// the density of the fluid. For a sphere, the added mass is half of the displaced mass, and the added moment of
    /// inertia is zero.
    pub fn added(&self) -> [f64; 3] {
        let [square, lambda] = self.shape();
        let alpha = 2.0 * (1.0 - square) * lambda;
        let beta = 1.0 - 0.5 * alpha;
        let [along, across] = [alpha, beta].map(|x| x / (2.0 - x));
        // β − α = 1 − 3(1 − e²)Λ vanishes with e² towards a sphere.
        let difference = beta - alpha;
        let turning = if square == 0.0 {
            0.0
        } else {
            square * square * difference / ((2.0 - square) * (2.0 * square - (2.0 - square) * difference))
        };
        [along, across, turning * self.inertia()].map(|factor| factor * self.volume())
    }
}

/// Σ sinh³α/sinh³nα with cosh α = 1/`near`, where `near` is the radius over the height: the drag of a sphere that
/// rotates about the normal of a wall, relative to that far from the wall.
fn spinning(near: f64) -> f64 {
    // With x = e^−α, sinh nα/sinh α is x^(1−n) (1 − x^2n)/(1 − x²), or n if they touch.
    let x = near / (1.0 + (1.0 - near * near).sqrt());
    let (square, mut sum) = (x * x, 0.0);
    // Terms decay at least as n⁻³.
    for n in 1..=SPINNING {
        let n = f64::from(n);
        let ratio =
            if square < 1.0 { x.powf(n - 1.0) * (1.0 - square) / -(n * square.ln()).exp_m1() } else { n.recip() };
        sum += ratio.powi(3);
    }
    sum
}

/// The drag of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyDrag {
    /// Stokes drag over μ for translation along and across the body, m, and for rotation, m³.
    pub viscous: [f64; 3],
    /// ½A along and across the body, m².
    pub half_area: [f64; 2],
    /// Form drag C along and across the body; 0 in creeping flow.
    pub form: [f64; 2],
}

/// The inertia of the fluid around the body, and the body's own moment of inertia, which the mass of node 0 does not
/// include.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyInertia {
    /// m∥/ρ, m⊥/ρ, m³, and the fluid's share of J over ρ, m⁵.
    pub added: [f64; 3],
    /// The body's own share of J, kg m².
    pub own: f64,
}

/// The motion of the body: axes, components of velocity along and across it, and angular velocity φ̇.
struct BodyMotion {
    t: Vector2<f64>,
    n: Vector2<f64>,
    u: f64,
    w: f64,
    spin: f64,
    per_length: f64,
}

impl BodyMotion {
    fn of(rod: &Kinematics<'_>) -> Self {
        let edge = &rod.edges[0];
        let (t, n) = (edge.t, edge.n());
        let velocity = rod.against_fluid(0);
        let spin = (node(rod.v, 1) - node(rod.v, 0)).dot(&n) * edge.per_length;
        Self { t, n, u: velocity.dot(&t), w: velocity.dot(&n), spin, per_length: edge.per_length }
    }

    /// The forces on the ends of the neck for a force `f` (N) on the centre and a couple (N m).
    fn ends(&self, f: Vector2<f64>, couple: f64) -> [Vector2<f64>; 2] {
        let pair = self.n * (couple * self.per_length);
        [f - pair, pair]
    }
}

/// a bᵀ.
fn outer(a: Vector2<f64>, b: Vector2<f64>) -> Matrix2<f64> {
    a * b.transpose()
}

/// The derivatives of a force on the centre and of a couple with respect to the motion of the centre and to the neck's
/// vector, along a direction.
struct Slope {
    force: [Matrix2<f64>; 2],
    couple: [Vector2<f64>; 2],
}

/// The opposing force on the neck.
fn on_neck(motion: &BodyMotion, f: Vector2<f64>, couple: f64, slope: Option<(Slope, f64)>) -> EdgeForce {
    let ends = motion.ends(f, couple);
    let Some((Slope { force: [f_own, f_edge], couple: [c_own, c_edge] }, q)) = slope else {
        return EdgeForce::new(ends, [Block::ZERO; 2], [Block::ZERO; 2]);
    };
    // The pair (C/ℓ) n: n turns by −t (n·δe)/ℓ, and 1/ℓ falls by (t·δe)/ℓ².
    let BodyMotion { t, n, per_length, .. } = *motion;
    let size = couple * per_length * per_length * q;
    let pair_own = outer(n, c_own) * per_length;
    let pair_edge = outer(n, c_edge) * per_length - (outer(t, n) + outer(n, t)) * size;
    // If node 1 stays, the centre moves by −δe.
    let own = [f_own - pair_own, pair_own];
    let edge = [f_edge - pair_edge, pair_edge - pair_own];
    EdgeForce::new(ends, own.map(Block::from), edge.map(Block::from))
}

impl BodyDrag {
    /// Force along and across the body over the velocity (N s/m), its derivative with respect to the velocity (N s/m),
    /// and the couple over the angular velocity (N m s).
    fn coefficients(&self, rod: &Kinematics<'_>, motion: &BodyMotion) -> ([f64; 2], [f64; 2], f64) {
        let (viscosity, density) = (rod.fluid.viscosity, rod.fluid.density);
        let form = |i: usize, speed: f64| density * self.half_area[i] * self.form[i] * speed.abs();
        let form = [form(0, motion.u), form(1, motion.w)];
        let sum = [0, 1].map(|i| viscosity * self.viscous[i] + form[i]);
        (sum, [0, 1].map(|i| sum[i] + form[i]), viscosity * self.viscous[2])
    }
}

impl Force for BodyDrag {
    fn name(&self) -> &'static str {
        DRAG
    }

    fn validity(&self) -> Validity {
        const CREEPS: &[Bound] = &[
            Bound::at_most(DimensionlessNumber::BodyReynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::BodyHeight, 1.0),
        ];
        Validity {
            range: "a spheroid; near a wall for motion parallel to it; form drag by the given coefficients",
            bounds: if self.form.iter().all(|form| *form >= LEAST_FORM) { &CREEPS[1..] } else { CREEPS },
            source: "A. T. Chwang & T. Y.-T. Wu, J. Fluid Mech. 67 (1975); H. Faxén (1923) and G. B. Jeffery (1915) for walls",
        }
    }

    fn is_of_fluid(&self) -> bool {
        true
    }

    fn is_the_same_everywhere(&self) -> bool {
        true
    }

    fn is_linear(&self) -> bool {
        self.form == [0.0; 2]
    }

    fn evaluate(
        &self,
        rod: &Kinematics<'_>,
        along: Option<Direction>,
        edges: Range<usize>,
        sums: &mut ForceAccumulator<'_>,
    ) {
        if edges.start > 0 {
            return;
        }
        let motion = BodyMotion::of(rod);
        let BodyMotion { t, n, u, w, spin, per_length } = motion;
        let ([h, k], [dh, dk], turning) = self.coefficients(rod, &motion);
        let slope = along.map(|Direction { q, v, .. }| {
            let own = (outer(t, t) * dh + outer(n, n) * dk) * v;
            // Turning by δφ = (n·δe)/ℓ: t turns by n δφ, n by −t δφ, so du = w δφ and dw = −u δφ.
            let by_turning = t * (dh * w - k * w) + n * (h * u - dk * u);
            let stretching = (node(rod.v, 1) - node(rod.v, 0)).dot(&t) * per_length;
            // φ̇ = ė·n/ℓ: its derivative with respect to ė is n/ℓ, and with respect to e −(ė·t) n/ℓ² − φ̇ t/ℓ.
            let spin_edge = n * (per_length * (v - stretching * q)) - t * (spin * per_length * q);
            Slope {
                force: [own, outer(by_turning, n) * (per_length * q)],
                couple: [Vector2::zeros(), spin_edge * turning],
            }
        });
        let slope = slope.zip(along.map(|along| along.q));
        sums.one(0, &on_neck(&motion, t * (h * u) + n * (k * w), turning * spin, slope));
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY, FORM_DRAG_ALONG, FORM_DRAG_ACROSS]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        let motion = BodyMotion::of(rod);
        let BodyMotion { t, n, u, w, spin, .. } = motion;
        let form = |i: usize, speed: f64| self.half_area[i] * speed.abs() * speed;
        let density = rod.fluid.density;
        let (f, couple) = match key {
            VISCOSITY => (t * (self.viscous[0] * u) + n * (self.viscous[1] * w), self.viscous[2] * spin),
            DENSITY => (t * (self.form[0] * form(0, u)) + n * (self.form[1] * form(1, w)), 0.0),
            FORM_DRAG_ALONG => (t * (density * form(0, u)), 0.0),
            FORM_DRAG_ACROSS => (n * (density * form(1, w)), 0.0),
            _ => return [0.0; 2],
        };
        let [first, second] = motion.ends(f, couple);
        add(out, 0, first);
        add(out, 1, second);
        [0.0; 2]
    }
}

impl BodyInertia {
    /// m∥, m⊥ (kg) and J (kg m²) in a fluid of `density` (kg/m³).
    fn masses(&self, density: f64) -> [f64; 3] {
        let [along, across, turning] = self.added.map(|added| added * density);
        [along, across, turning + self.own]
    }
}

impl Force for BodyInertia {
    fn name(&self) -> &'static str {
        INERTIA
    }

    fn validity(&self) -> Validity {
        Validity {
            range: "a spheroid in potential flow; no lift, no separation",
            bounds: const { &[Bound::at_least(DimensionlessNumber::BodyStokes, 100.0)] },
            source: "H. Lamb, Hydrodynamics (1932), articles 114, 115, 121 and 124",
        }
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
        if edges.start > 0 {
            return;
        }
        let motion = BodyMotion::of(rod);
        let BodyMotion { t, n, u, w, spin, per_length } = motion;
        let [m, k, j] = self.masses(rod.fluid.density);
        let more = m - k;
        let a = rod.accelerating_against_fluid(0);
        let (at, an) = (a.dot(&t), a.dot(&n));
        let opening = node(rod.v, 1) - node(rod.v, 0);
        let accelerating = node(rod.a, 1) - node(rod.a, 0);
        let stretching = opening.dot(&t);
        // φ̈ = (ë·n − 2φ̇ℓ̇)/ℓ.
        let twist = (accelerating.dot(&n) - 2.0 * spin * stretching) * per_length;
        let f = t * (m * at + more * spin * w) + n * (k * an + more * spin * u);
        let couple = j * twist - more * u * w;
        let slope = along.map(|Direction { q, v, a: by_a }| {
            let own = (outer(t, t) * m + outer(n, n) * k) * by_a + (outer(t, n) + outer(n, t)) * (more * spin * v);
            // δφ̇, and the effect of turning by δφ = (n·δe)/ℓ: δu = w δφ, δw = −u δφ, δa_t = a_n δφ, δa_n = −a_t δφ.
            let by_spin = t * (more * w) + n * (more * u);
            let spin_edge = n * (per_length * (v - stretching * per_length * q)) - t * (spin * per_length * q);
            let by_turning = t * (m * an - more * spin * u - k * an - more * spin * u)
                + n * (m * at + more * spin * w - k * at + more * spin * w);
            let force_edge = outer(by_spin, spin_edge) + outer(by_turning, n) * (per_length * q);
            // δφ̈ by ë, by ℓ̇ and φ̇, by e.
            let stretching_edge = t * v + n * (opening.dot(&n) * per_length * q);
            let twist_edge = n * (per_length * by_a)
                - n * (accelerating.dot(&t) * per_length * per_length * q)
                - (spin_edge * stretching + stretching_edge * spin) * (2.0 * per_length)
                - t * (twist * per_length * q);
            let couple_own = (t * w + n * u) * (-more * v);
            let couple_edge = twist_edge * j - n * (more * (w * w - u * u) * per_length * q);
            Slope { force: [own, force_edge], couple: [couple_own, couple_edge] }
        });
        let slope = slope.zip(along.map(|along| along.q));
        sums.one(0, &on_neck(&motion, f, couple, slope));
    }

    fn energy(&self, rod: &Kinematics<'_>, factor: f64, by: Option<StateDerivatives<'_>>) -> f64 {
        let BodyMotion { t, n, u, w, spin, per_length } = BodyMotion::of(rod);
        let [m, k, j] = self.masses(rod.fluid.density);
        if let Some(StateDerivatives { q, v, .. }) = by {
            let stretching = (node(rod.v, 1) - node(rod.v, 0)).dot(&t) * per_length;
            let momentum = t * (m * u) + n * (k * w);
            let by_edge =
                n * (((m - k) * u * w - j * spin * stretching) * per_length) - t * (j * spin * spin * per_length);
            let [first, second] = [n * (-j * spin * per_length), n * (j * spin * per_length)];
            add(q, 0, by_edge * -factor);
            add(q, 1, by_edge * factor);
            add(v, 0, (momentum + first) * factor);
            add(v, 1, second * factor);
        }
        0.5 * (m * u * u + k * w * w + j * spin * spin)
    }

    fn momentum(&self, rod: &Kinematics<'_>, axis: Vector2<f64>, factor: f64, by: Option<StateDerivatives<'_>>) -> f64 {
        let BodyMotion { t, n, u, w, per_length, .. } = BodyMotion::of(rod);
        let [m, k, _] = self.masses(rod.fluid.density);
        let (along, across) = (t.dot(&axis), n.dot(&axis));
        if let Some(StateDerivatives { q, v, .. }) = by {
            let by_edge = n * ((m - k) * (w * along + u * across) * per_length);
            add(q, 0, by_edge * -factor);
            add(q, 1, by_edge * factor);
            add(v, 0, (t * (m * along) + n * (k * across)) * factor);
        }
        m * u * along + k * w * across
    }

    fn parameters(&self) -> &[Key] {
        &[DENSITY]
    }

    fn add_by_parameter(&self, key: Key, rod: &Kinematics<'_>, out: &mut [f64]) -> [f64; 2] {
        if key != DENSITY {
            return [0.0; 2];
        }
        // Everything except the body's own share is linear in the density.
        let unit = Kinematics { fluid: super::Fluid { density: 1.0, ..rod.fluid }, around: Default::default(), ..*rod };
        let of_fluid = Self { own: 0.0, ..*self };
        super::force::visit_alone(&of_fluid, &unit, |k, force| add(out, k, force));
        [of_fluid.energy(&unit, 0.0, None), 0.0]
    }
}
