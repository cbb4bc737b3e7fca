//! Drag where the fluid's inertia begins to matter: slender-body theory with a length that inertia shortens.
//!
//! Lamb's cylinder 4πμ/(½ − γ − ln(Re/8)), Re = 2a|V|/ν, is Cox's ξ⊥ with ℒ = 3.0524 ν/|V|, and Stokes's oscillating cylinder is
//! Cox's with ℒ = 0.926 √(ν/ω). So 1/ℒ = 1/ℒ₀ + |V|/(3.0524 ν) + √(ω/ν)/0.926, exact in every limit. Across the rod Kaplun's
//! factor 1 − 0.87 ε², ε = ξ⊥/4πμ, applies in the share that inertia has in 1/ℒ.

use std::f64::consts::{LN_2, PI, TAU};

use wide::f64x2;

use super::{DragLaw, Published, Reach, SLENDER, Uncertainty};
use crate::fluid::force::Validity;
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes, both};
use crate::fluid::medium::{DENSITY, Fluid, Key, VISCOSITY};
use crate::linear::{Number, Real};

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "weak-inertia",
    meaning: "slender-body theory with a length that the fluid's inertia shortens",
    validity: Validity {
        range: "Reynolds numbers of the diameter up to 0.5",
        source: "H. Lamb (1911); S. Kaplun, J. Math. Mech. 6 (1957); R. E. Khayat & R. G. Cox, J. Fluid Mech. 209 (1989)",
    },
    reynolds: 0.5,
    published: Published {
        table: &[Uncertainty::at(1e-3, [0.101, 0.20, 0.42]), Uncertainty::at(0.5, [0.15, 0.22, 0.44])],
        source: "that of cox, and the measured drag of a cylinder up to a Reynolds number of 1",
    },
    reach: Reach::Edge,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: None,
    slender: Some(|recipe| recipe.slender()),
    build: |recipe| {
        let law = WeakInertia {
            per_length: 1.0 / recipe.slender(),
            root_omega: recipe.frequency.map_or(0.0, |frequency| (TAU * frequency).sqrt()),
        };
        Box::new(LocalDrag::new(law, recipe.rod, recipe.head, |halves| both(halves, |half| half.radius)))
    },
    parts: None,
};

/// ℒ|V|/ν of Lamb's cylinder, ℒ √(ω/ν) of Stokes's.
const STEADY: f64 = 3.0524;
const OSCILLATING: f64 = 0.926;
/// Of Kaplun's ε².
const KAPLUN: f64 = 0.87;

/// The law of a rod.
#[derive(Debug)]
pub(crate) struct WeakInertia {
    /// 1/ℒ₀, 1/m.
    per_length: f64,
    /// √ω, (rad/s)^½.
    root_omega: f64,
}

/// Viscosity, 1/ℒ at rest, and its growth with the speed.
type InFluids = [f64x2; 3];

/// ξ∥ and ξ⊥, and their derivatives by 1/ℒ and by the part of it at rest.
struct Resistances<P> {
    xi: [P; 2],
    by_inverse: [P; 2],
    by_rest: P,
}

impl WeakInertia {
    /// ξ for 1/ℒ = `inverse`, `rest` of it at rest. Beyond the range of slender bodies 1/ℒ stays at its limit.
    #[inline(always)]
    fn resistances<P: Number>(radius: P, viscosity: P, rest: P, inverse: P) -> Resistances<P> {
        let (none, one) = (radius.like(0.0), radius.like(1.0));
        let most = radius.like((-SLENDER).exp()) / radius;
        let inside = P::where_at_most(most, inverse, none, one);
        let inverse = P::where_at_most(inverse, most, inverse, most);
        let slender = -(inverse * radius).ln();
        let lt = slender - radius.like(1.5) + radius.like(LN_2);
        let ln = slender - radius.like(0.5) + radius.like(LN_2);
        let (along, plain) = (viscosity * radius.like(2.0 * PI) / lt, viscosity * radius.like(4.0 * PI) / ln);
        let (epsilon, share) = (one / ln, (one - rest / inverse).larger(none));
        // Kaplun's factor holds where the fluid's inertia has a share.
        let kaplun = epsilon * epsilon * P::where_at_most(share, none, none, radius.like(KAPLUN));
        let factor = one - kaplun * share;
        let by = inside / inverse;
        let share_by = inside * rest / (inverse * inverse);
        Resistances {
            xi: [along, plain * factor],
            by_inverse: [
                along / lt * by,
                plain * (epsilon * by * factor - kaplun * (epsilon * by * share * radius.like(2.0) + share_by)),
            ],
            by_rest: plain * kaplun / inverse,
        }
    }

    /// The traction on halves of that `radius` at velocities `u` along and `w` across, and its derivatives.
    #[inline(always)]
    pub(crate) fn slopes<T: Real>(
        radius: T::Pair,
        [viscosity, rest, growth]: [T::Pair; 3],
        u: T::Pair,
        w: T::Pair,
    ) -> (Traction<T>, TractionSlopes<T>) {
        let speed = speed(u, w);
        let Resistances { xi: [along, across], by_inverse, .. } =
            Self::resistances(radius, viscosity, rest, rest + growth * speed);
        // |V| grows by V·δV/|V|.
        let some = speed.larger(u.like(f64::MIN_POSITIVE));
        let (su, sw) = (u / some * growth, w / some * growth);
        (
            Traction { along: along * u, across: across * w },
            TractionSlopes {
                along: along + by_inverse[0] * su * u,
                across: across + by_inverse[1] * sw * w,
                mixed: Some([by_inverse[0] * sw * u, by_inverse[1] * su * w]),
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
    type Halves = f64x2;
    type Fluids = InFluids;

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
    fn in_fluids(&self, fluids: [&Fluid; 2]) -> InFluids {
        let viscosity = both(&fluids, |fluid| fluid.viscosity);
        let per_nu = both(&fluids, |fluid| fluid.density) / viscosity;
        [viscosity, per_nu.sqrt() * self.root_omega / OSCILLATING + self.per_length, per_nu / STEADY]
    }

    #[inline]
    fn traction(&self, radius: &f64x2, [viscosity, rest, growth]: InFluids, u: f64x2, w: f64x2) -> Traction {
        let [along, across] = Self::resistances(*radius, viscosity, rest, rest + growth * speed(u, w)).xi;
        Traction { along: along * u, across: across * w }
    }

    #[inline]
    fn with_slopes(&self, radius: &f64x2, fluids: InFluids, u: f64x2, w: f64x2) -> (Traction, TractionSlopes) {
        Self::slopes(*radius, fluids, u, w)
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY]
    }

    #[inline(always)] // which settles the key when it is compiled
    fn by_parameter(&self, key: Key, radius: &f64x2, fluids: [&Fluid; 2], u: f64x2, w: f64x2) -> Traction {
        let [viscosity, rest, growth] = self.in_fluids(fluids);
        let speed = speed(u, w);
        let found = Self::resistances(*radius, viscosity, rest, rest + growth * speed);
        // ρ/μ moves by −ρ/μ² δμ or by δρ/μ.
        let per_nu = growth * STEADY;
        let moved = match key {
            VISCOSITY => -per_nu / viscosity,
            DENSITY => f64x2::ONE / viscosity,
            _ => return Traction::default(),
        };
        let rest_by = moved * (0.5 * self.root_omega / OSCILLATING) / per_nu.sqrt();
        let inverse_by = rest_by + speed / STEADY * moved;
        let own = |i: usize| if key == VISCOSITY { found.xi[i] / viscosity } else { f64x2::ZERO };
        Traction {
            along: (own(0) + found.by_inverse[0] * inverse_by) * u,
            across: (own(1) + found.by_inverse[1] * inverse_by + found.by_rest * rest_by) * w,
        }
    }
}
