//! Drag where the fluid's inertia begins to matter: slender-body theory with a length that inertia shortens.
//!
//! Lamb's cylinder 4πμ/(½ − γ − ln(Re/8)), Re = 2a|V|/ν, is Cox's ξ⊥ with ℒ = 3.0524 ν/|V|, and Stokes's oscillating cylinder is
//! Cox's with ℒ = 0.926 √(ν/ω). So 1/ℒ = 1/ℒ₀ + |V|/(3.0524 ν) + √(ω/ν)/0.926, exact in every limit. Across the rod Kaplun's
//! factor 1 − 0.87 ε², ε = ξ⊥/4πμ, applies in the share that inertia has in 1/ℒ.

use std::f64::consts::{LN_2, PI, TAU};

use super::{DragLaw, Published, Reach, SLENDER, Uncertainty};
use crate::fluid::force::Validity;
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes};
use crate::fluid::medium::{DENSITY, Fluid, Key, VISCOSITY};

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
        Box::new(LocalDrag::new(law, recipe.rod, recipe.head, |half| half.radius))
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
struct WeakInertia {
    /// 1/ℒ₀, 1/m.
    per_length: f64,
    /// √ω, (rad/s)^½.
    root_omega: f64,
}

/// Viscosity, 1/ℒ at rest, its growth with the speed, and its derivatives by ν.
type InFluid = (f64, f64, f64);

/// ξ∥ and ξ⊥, and their derivatives by 1/ℒ and by the part of it at rest.
struct Resistances {
    xi: [f64; 2],
    by_inverse: [f64; 2],
    by_rest: f64,
}

impl WeakInertia {
    /// ξ for 1/ℒ = `inverse`, `rest` of it at rest. Beyond the range of slender bodies 1/ℒ stays at its limit.
    fn resistances(radius: f64, viscosity: f64, rest: f64, inverse: f64) -> Resistances {
        let most = (-SLENDER).exp() / radius;
        let (inside, inverse) = if inverse < most { (1.0, inverse) } else { (0.0, most) };
        let slender = -(inverse * radius).ln();
        let (lt, ln) = (slender - 1.5 + LN_2, slender - 0.5 + LN_2);
        let (along, plain) = (2.0 * PI * viscosity / lt, 4.0 * PI * viscosity / ln);
        let (epsilon, share) = (1.0 / ln, (1.0 - rest / inverse).max(0.0));
        let kaplun = 1.0 - KAPLUN * epsilon * epsilon * share;
        let by = inside / inverse;
        let (plain_by, epsilon_by) = (plain * epsilon * by, epsilon * epsilon * by);
        let share_by = if share > 0.0 { inside * rest / (inverse * inverse) } else { 0.0 };
        Resistances {
            xi: [along, plain * kaplun],
            by_inverse: [
                along / lt * by,
                plain_by * kaplun
                    - plain * KAPLUN * (2.0 * epsilon * epsilon_by * share + epsilon * epsilon * share_by),
            ],
            by_rest: if share > 0.0 { plain * KAPLUN * epsilon * epsilon / inverse } else { 0.0 },
        }
    }
}

impl Law for WeakInertia {
    type Half = f64;
    type Fluid = InFluid;

    fn name(&self) -> &'static str {
        LAW.name
    }

    fn validity(&self) -> Validity {
        LAW.validity
    }

    fn is_linear(&self) -> bool {
        false
    }

    fn in_fluid(&self, fluid: Fluid) -> InFluid {
        let per_nu = fluid.density / fluid.viscosity;
        (fluid.viscosity, self.per_length + self.root_omega * per_nu.sqrt() / OSCILLATING, per_nu / STEADY)
    }

    #[inline]
    fn traction(&self, radius: &f64, (viscosity, rest, growth): InFluid, u: f64, w: f64) -> Traction {
        let [along, across] = Self::resistances(*radius, viscosity, rest, rest + growth * u.hypot(w)).xi;
        Traction { along: along * u, across: across * w }
    }

    #[inline]
    fn with_slopes(
        &self,
        radius: &f64,
        (viscosity, rest, growth): InFluid,
        u: f64,
        w: f64,
    ) -> (Traction, TractionSlopes) {
        let speed = u.hypot(w);
        let Resistances { xi: [along, across], by_inverse, .. } =
            Self::resistances(*radius, viscosity, rest, rest + growth * speed);
        // |V| grows by V·δV/|V|.
        let [su, sw] = if speed > 0.0 { [growth * u / speed, growth * w / speed] } else { [0.0; 2] };
        (
            Traction { along: along * u, across: across * w },
            TractionSlopes {
                along: along + by_inverse[0] * su * u,
                across: across + by_inverse[1] * sw * w,
                mixed: Some([by_inverse[0] * sw * u, by_inverse[1] * su * w]),
            },
        )
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY]
    }

    #[inline(always)] // which settles the key when it is compiled
    fn by_parameter(&self, key: Key, radius: &f64, fluid: Fluid, u: f64, w: f64) -> Traction {
        let (viscosity, rest, growth) = self.in_fluid(fluid);
        let speed = u.hypot(w);
        let found = Self::resistances(*radius, viscosity, rest, rest + growth * speed);
        // ρ/μ moves by −ρ/μ² δμ or by δρ/μ.
        let per_nu = fluid.density / viscosity;
        let moved = match key {
            VISCOSITY => -per_nu / viscosity,
            DENSITY => 1.0 / viscosity,
            _ => return Traction::default(),
        };
        let rest_by = 0.5 * self.root_omega / (per_nu.sqrt() * OSCILLATING) * moved;
        let inverse_by = rest_by + speed / STEADY * moved;
        let own = |i: usize| if key == VISCOSITY { found.xi[i] / viscosity } else { 0.0 };
        Traction {
            along: (own(0) + found.by_inverse[0] * inverse_by) * u,
            across: (own(1) + found.by_inverse[1] * inverse_by + found.by_rest * rest_by) * w,
        }
    }
}
