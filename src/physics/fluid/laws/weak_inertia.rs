//! Drag at weak fluid inertia: slender-body theory with a length that inertia shortens.
//!
//! Across the rod, Lamb's cylinder 4πμ/(½ − γ − ln(Re/8)), Re = 2a|V|/ν, is Cox's ξ⊥ with ℒ = 2e^(1−γ) ν/|V|, and
//! Stokes's oscillating cylinder is Cox's with ℒ = e^(½−γ) √(ν/ω). 1/ℒ is the sum of both inverses and 1/ℒ₀. Kaplun's
//! factor 1 − 0.87 ε², ε = ξ⊥/4πμ, applies in proportion to the share of the speed in 1/ℒ.
//!
//! Along the rod, a long cylinder that oscillates has ℒ = e^(3/2−γ) √(ν/ω), whatever the amplitude. Momentum along the
//! rod is carried away like heat by the flow across, ℒ = 2e^(3/2−γ) ν/|w|, and through a boundary layer by the flow
//! along, ℒ² = e^(2−γ) ν ℒ₀/|V|. The squares of both inverses and of 1/ℒ₀ are summed, which is Oseen's first correction
//! within 4 %. The inverse for the oscillation is added to the root of this sum.
//!
//! In an oscillation, drag is the part in phase with the speed: Re 1/(D + iπ/4) = D/(D² + π²/16) for a logarithm D,
//! where the angle π/4 is multiplied by the share of the oscillation in 1/ℒ.

use std::f64::consts::{FRAC_PI_4, LN_2, PI, TAU};

use wide::f64x2;

use super::{Dependence, DragLaw, MIN_LOG_SLENDERNESS, SectionInput};
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes, both};
use crate::fluid::medium::{DENSITY, Fluid, Key, VISCOSITY};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, Validity};
use crate::linear::{Number, Real};

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "weak-inertia",
    meaning: "slender-body theory with an effective length that the inertia of the fluid shortens",
    validity: Validity {
        range: "slender rods",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, 0.5),
            Bound::at_most(DimensionlessNumber::Swinging, 0.05),
        ],
        source: "G. G. Stokes (1851); H. Lamb (1911); S. Kaplun, J. Math. Mech. 6 (1957); R. E. Khayat & R. G. Cox, J. Fluid Mech. 209 (1989)",
    },
    reynolds: 0.5,
    published: Published {
        table: &[Uncertainty::at(1e-3, [0.101, 0.20, 0.42]), Uncertainty::at(0.5, [0.15, 0.22, 0.44])],
        source: "that of cox, and the measured drag of a cylinder up to a Reynolds number of 1",
    },
    reach: Dependence::Edge,
    takes: SectionInput::Round,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: None,
    slender: Some(|inputs| inputs.slender()),
    build: |inputs| {
        let law = WeakInertia { root_omega: inputs.frequency.map_or(0.0, |frequency| (TAU * frequency).sqrt()) };
        let per_length = 1.0 / inputs.slender();
        Box::new(LocalDrag::new(law, inputs.rod, inputs.head, |halves| {
            [both(halves, |half| half.radius), both(halves, |_| per_length)]
        }))
    },
    parts: None,
};

/// ℒ|V|/ν and ℒ √(ω/ν) of a cylinder across the flow: 2e^(1−γ) and e^(½−γ).
const STEADY: f64 = 3.052_410_2;
const OSCILLATING: f64 = 0.925_690_2;
/// Along the rod, ℒ|w|/ν, ℒ √(ω/ν) and ℒ²|V|/νℒ₀: 2e^(3/2−γ), e^(3/2−γ) and e^(2−γ).
const ALONG_CROSSED: f64 = 5.032_573_7;
const ALONG_OSCILLATING: f64 = 2.516_286_8;
const ALONG_SWEPT: f64 = 4.148_655_6;
/// The factor of Kaplun's ε².
const KAPLUN: f64 = 0.87;

/// The law of a rod.
#[derive(Debug)]
pub(crate) struct WeakInertia {
    /// √ω, (rad/s)^½.
    root_omega: f64,
}

/// Viscosity, 1/ν and √(ω/ν).
type WeakInertiaFluids = [f64x2; 3];

/// 1/ℒ of one direction.
#[derive(Clone, Copy)]
struct InverseLength<P> {
    value: P,
    /// The contribution of the oscillation.
    swinging: P,
    /// Derivatives with respect to the velocities along and across.
    by: [P; 2],
    /// Derivative with respect to 1/ν at constant √(ω/ν).
    by_per_nu: P,
}

/// ξ of one direction, and its derivatives with respect to 1/ℒ and to the contribution of the oscillation to it.
struct DirectionalResistance<P> {
    xi: P,
    by_value: P,
    by_swinging: P,
}

/// 1/ℒ along and across the rod, at velocities `u` and `w` there.
#[inline(always)]
fn inverses<P: Number>(per_length: P, [per_nu, root]: [P; 2], u: P, w: P) -> [InverseLength<P>; 2] {
    let of = |x: f64| u.like(x);
    let speed = speed(u, w);
    // |V| changes by V·δV/|V|.
    let some = speed.larger(of(f64::MIN_POSITIVE));
    let (du, dw) = (u / some, w / some);
    let (swept, crossed) = (per_length * per_nu * of(1.0 / ALONG_SWEPT), per_nu * of(1.0 / ALONG_CROSSED));
    let crossing = crossed * w;
    let steady = (per_length * per_length + swept * speed + crossing * crossing).sqrt();
    let half = of(0.5) / steady;
    let swinging = root * of(1.0 / ALONG_OSCILLATING);
    let along = InverseLength {
        value: steady + swinging,
        swinging,
        by: [half * swept * du, half * (swept * dw + of(2.0) * crossed * crossing)],
        by_per_nu: half * (swept * speed + of(2.0) * crossing * crossing) / per_nu,
    };
    let growth = per_nu * of(1.0 / STEADY);
    let swinging = root * of(1.0 / OSCILLATING);
    let across = InverseLength {
        value: per_length + swinging + growth * speed,
        swinging,
        by: [growth * du, growth * dw],
        by_per_nu: speed * of(1.0 / STEADY),
    };
    [along, across]
}

/// `scale`/(−ln(a/ℒ) + `offset`) in phase with the speed. Outside the range of slender bodies ℒ stays at its limit.
#[inline(always)]
fn logarithmic<P: Number>(
    scale: P,
    radius: P,
    offset: f64,
    inverse: &InverseLength<P>,
) -> (P, DirectionalResistance<P>) {
    let (none, one) = (radius.like(0.0), radius.like(1.0));
    let most = radius.like((-MIN_LOG_SLENDERNESS).exp()) / radius;
    let inside = P::where_at_most(most, inverse.value, none, one);
    let within = P::where_at_most(inverse.value, most, inverse.value, most);
    let log = radius.like(offset) - (within * radius).ln();
    let per_value = one / inverse.value;
    let angle = radius.like(FRAC_PI_4) * inverse.swinging * per_value;
    let per = one / (log * log + angle * angle);
    let xi = scale * log * per;
    let by_log = scale * per - (log + log) * xi * per;
    let by_angle = -(angle + angle) * xi * per;
    let by_value = -(by_log * inside + by_angle * angle) * per_value;
    (log, DirectionalResistance { xi, by_value, by_swinging: by_angle * radius.like(FRAC_PI_4) * per_value })
}

/// ξ∥ and ξ⊥.
#[inline(always)]
fn resistances<P: Number>(
    radius: P,
    per_length: P,
    viscosity: P,
    [inverse_along, inverse]: &[InverseLength<P>; 2],
) -> [DirectionalResistance<P>; 2] {
    let one = radius.like(1.0);
    let (_, along) = logarithmic(viscosity * radius.like(2.0 * PI), radius, LN_2 - 1.5, inverse_along);
    let (log, plain) = logarithmic(viscosity * radius.like(4.0 * PI), radius, LN_2 - 0.5, inverse);
    // Kaplun's factor applies to the share of the speed.
    let (epsilon, per_value) = (one / log, one / inverse.value);
    let kaplun = epsilon * epsilon * radius.like(KAPLUN);
    let rest = (per_length + inverse.swinging) * per_value;
    let factor = one - kaplun * (one - rest);
    let inside =
        P::where_at_most(radius.like((-MIN_LOG_SLENDERNESS).exp()) / radius, inverse.value, radius.like(0.0), one);
    let by_value = -kaplun * per_value * ((epsilon + epsilon) * inside * (one - rest) + rest);
    let across = DirectionalResistance {
        xi: plain.xi * factor,
        by_value: plain.by_value * factor + plain.xi * by_value,
        by_swinging: plain.by_swinging * factor + plain.xi * kaplun * per_value,
    };
    [along, across]
}

impl WeakInertia {
    /// The traction on halves with this `radius` at velocities `u` along and `w` across, and its derivatives.
    #[inline(always)]
    pub(crate) fn slopes<T: Real>(
        [radius, per_length]: [T::Pair; 2],
        [viscosity, per_nu, root]: [T::Pair; 3],
        u: T::Pair,
        w: T::Pair,
    ) -> (Traction<T>, TractionSlopes<T>) {
        let inverses = inverses(per_length, [per_nu, root], u, w);
        let [along, across] = resistances(radius, per_length, viscosity, &inverses);
        (
            Traction { along: along.xi * u, across: across.xi * w },
            TractionSlopes {
                along: along.xi + along.by_value * inverses[0].by[0] * u,
                across: across.xi + across.by_value * inverses[1].by[1] * w,
                mixed: Some([along.by_value * inverses[0].by[1] * u, across.by_value * inverses[1].by[0] * w]),
            },
        )
    }
}

/// |V|.
#[inline(always)]
fn speed<P: Number>(u: P, w: P) -> P {
    (u * u + w * w).sqrt()
}

impl Law for WeakInertia {
    /// Radius and 1/ℒ₀.
    type Halves = [f64x2; 2];
    type Fluids = WeakInertiaFluids;

    fn name(&self) -> &'static str {
        LAW.name
    }

    fn validity(&self) -> Validity {
        LAW.validity
    }

    fn is_linear(&self) -> bool {
        false
    }

    #[inline]
    fn in_fluids(&self, fluids: [&Fluid; 2]) -> WeakInertiaFluids {
        let viscosity = both(&fluids, |fluid| fluid.viscosity);
        let per_nu = both(&fluids, |fluid| fluid.density) / viscosity;
        [viscosity, per_nu, per_nu.sqrt() * self.root_omega]
    }

    #[inline]
    fn traction(&self, halves: &[f64x2; 2], fluids: WeakInertiaFluids, u: f64x2, w: f64x2) -> Traction {
        Self::slopes(*halves, fluids, u, w).0
    }

    #[inline]
    fn with_slopes(
        &self,
        halves: &[f64x2; 2],
        fluids: WeakInertiaFluids,
        u: f64x2,
        w: f64x2,
    ) -> (Traction, TractionSlopes) {
        Self::slopes(*halves, fluids, u, w)
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY]
    }

    #[inline(always)] // resolves the key at compile time
    fn by_parameter(&self, key: Key, halves: &[f64x2; 2], fluids: [&Fluid; 2], u: f64x2, w: f64x2) -> Traction {
        let [radius, per_length] = *halves;
        let [viscosity, per_nu, root] = self.in_fluids(fluids);
        let inverses = inverses(per_length, [per_nu, root], u, w);
        let found = resistances(radius, per_length, viscosity, &inverses);
        // ρ/μ changes by −ρ/μ² δμ or by δρ/μ.
        let moved = match key {
            VISCOSITY => -per_nu / viscosity,
            DENSITY => f64x2::ONE / viscosity,
            _ => return Traction::default(),
        };
        let by = |i: usize| {
            let (found, inverse) = (&found[i], &inverses[i]);
            let own = if key == VISCOSITY { found.xi / viscosity } else { f64x2::ZERO };
            let swinging = inverse.swinging * 0.5 / per_nu;
            own + moved * (found.by_value * (inverse.by_per_nu + swinging) + found.by_swinging * swinging)
        };
        Traction { along: by(0) * u, across: by(1) * w }
    }
}
