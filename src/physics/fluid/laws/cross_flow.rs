//! Drag from creeping flow to Reynolds numbers of 10⁵: viscous, boundary layer and form drag.
//!
//! With u = V·t, w = V·n, depth D, larger side B, perimeter P and form drag C_d of the section, ν = μ/ρ:
//! f⊥ = [ξ⊥ + 2ρD(ν/D)^½ |w|^½ + ½ρD C_d |w|] w, and
//! f∥ = [ξ∥ + ½·3.5 ρ(P/π)(ν/B)^½ (τ²w² + (1.42 B u/L)²)^¼ + ½ρP C_f |u|] u.
//! The normal part is Taylor's, without its dependence on u. The tangential part follows from the heat transfer of a
//! cylinder, with the friction of Blasius' plate if nothing flows across. The larger side is the depth of a body that
//! is flat across the plane of motion; along a body that is thick in this plane, the boundary layer grows over the
//! thickness.

use std::f64::consts::PI;

use wide::f64x2;

use super::{Dependence, DragLaw, ForcesByCause, LEAST_SLENDERNESS, LawInputs, SectionInput};
use crate::fluid::force::Force;
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes, both};
use crate::fluid::medium::{DENSITY, Fluid, Key, VISCOSITY};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};
use crate::linear::{Number, Pair, Real};
use crate::rod::{HalfEdge, Section};

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "cross-flow",
    meaning: "viscous drag, a boundary layer's friction and form drag",
    validity: Validity {
        range: "flows without lift, vortex shedding or history effects",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, 1e5),
            Bound::at_least(DimensionlessNumber::CreepingSlenderness, LEAST_SLENDERNESS),
            STEADY,
        ],
        source: "G. I. Taylor, Proc. R. Soc. A 214 (1952); U. Ehrenstein & C. Eloy, J. Fluid Mech. 718 (2013); S. F. Hoerner (1965)",
    },
    reynolds: 1e5,
    published: Published {
        table: &[
            Uncertainty::at(1e-3, [0.10, 0.20, 0.42]),
            Uncertainty::at(0.26, [0.13, 0.21, 0.42]),
            Uncertainty::at(3.0, [0.30, 0.30, 0.30]),
        ],
        source: "S. Kern & P. Koumoutsakos, J. Exp. Biol. 209 (2006), and others on the same eel, for speed; C. Sucker & H. Brauer (1975) for a cylinder's drag; at low Reynolds numbers that of cox",
    },
    reach: Dependence::Edge,
    takes: SectionInput::Outline,
    keys: &["slender_length_m", "viscous", "form_drag", "thinning", "skin_friction", "turbulent_friction"],
    needs: &[],
    resistance: None,
    slender: Some(|inputs| inputs.viscous.slender.map_or(f64::INFINITY, |slender| slender(inputs))),
    build: |inputs| {
        Box::new(LocalDrag::new(CrossFlow, inputs.rod, inputs.head, |halves| Coefficients::of(inputs, halves)))
    },
    parts: Some(parts),
};

/// The law as three forces of its type, one for each cause.
fn parts(inputs: &LawInputs<'_>) -> ForcesByCause {
    let only = |keep: fn(Coefficients) -> Coefficients| -> Box<dyn Force> {
        Box::new(LocalDrag::new(CrossFlow, inputs.rod, inputs.head, |halves| keep(Coefficients::of(inputs, halves))))
    };
    vec![
        ("viscous", only(|c| Coefficients { viscous: c.viscous, ..Coefficients::default() })),
        (
            "boundary layer",
            only(|c| Coefficients { viscous: Default::default(), form: f64x2::ZERO, form_unit: f64x2::ZERO, ..c }),
        ),
        ("form drag", only(|c| Coefficients { form: c.form, form_unit: c.form_unit, ..Coefficients::default() })),
    ]
}

/// The key of the form drag C_d.
pub const FORM_DRAG: Key = "drag.form_drag";
/// The key of the factor of the boundary layer's friction.
pub const SKIN_FRICTION: Key = "drag.skin_friction";

/// Friction of a cylinder's boundary layer, from its heat transfer.
const FRICTION: f64 = 3.5;
/// Factor that makes the friction Blasius' if nothing flows across.
const BLASIUS: f64 = 1.42;

/// The law.
#[derive(Debug)]
pub(crate) struct CrossFlow;

/// The coefficients that do not depend on fluid and velocity, as pairs over both halves of an edge.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Coefficients<P = f64x2> {
    /// ξ∥/μ, ξ⊥/μ.
    viscous: [P; 2],
    /// 2√D, m^½: times √(ρμ).
    layer_across: P,
    /// ½D C_d, m: times ρ.
    form: P,
    /// The same for C_d = 1.
    form_unit: P,
    /// ½·3.5 (P/π)/√B, m^½: times √(ρμ).
    layer_along: P,
    /// The same for a factor of 1 instead of 3.5.
    layer_along_unit: P,
    /// ½P C_f, m: times ρ.
    turbulent: P,
    /// τ².
    thinning: P,
    /// (1.42 B/L)².
    blasius: P,
}

impl Coefficients {
    fn of(inputs: &LawInputs<'_>, halves: &[HalfEdge; 2]) -> Self {
        let of = |quantity: fn(&Section) -> f64| both(halves, |half| quantity(&half.section()));
        let (depth, perimeter, slim) = (of(|section| section.depth), of(Section::perimeter), of(Section::slim));
        let form_unit = depth * 0.5;
        let side = of(|section| section.depth.max(2.0 * section.outer));
        let layer_along_unit = perimeter * 0.5 / (side.sqrt() * PI);
        let viscous =
            inputs.viscous.resistance.map_or([[0.0; 2]; 2], |of| halves.each_ref().map(|half| of(inputs, half)));
        let thinning = inputs.thinning.map_or(slim, f64x2::from);
        let sweeping = side * (BLASIUS / inputs.rod.length);
        Self {
            viscous: [both(&viscous, |xi| xi[0]), both(&viscous, |xi| xi[1])],
            layer_across: depth.sqrt() * 2.0,
            form: form_unit * inputs.form_drag.map_or_else(|| of(Section::form_drag), f64x2::from),
            form_unit,
            layer_along: layer_along_unit * inputs.skin_friction.unwrap_or(FRICTION),
            layer_along_unit,
            turbulent: perimeter * 0.5 * inputs.turbulent_friction.unwrap_or(0.0),
            thinning: thinning * thinning,
            blasius: sweeping * sweeping,
        }
    }

    /// The coefficients of several rods, combined by `gather`.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    pub(crate) fn gathered<Q>(gather: impl Fn(fn(&Self) -> f64x2) -> Q) -> Coefficients<Q> {
        Coefficients {
            viscous: [gather(|c| c.viscous[0]), gather(|c| c.viscous[1])],
            layer_across: gather(|c| c.layer_across),
            form: gather(|c| c.form),
            form_unit: gather(|c| c.form_unit),
            layer_along: gather(|c| c.layer_along),
            layer_along_unit: gather(|c| c.layer_along_unit),
            turbulent: gather(|c| c.turbulent),
            thinning: gather(|c| c.thinning),
            blasius: gather(|c| c.blasius),
        }
    }
}

impl<P: Number> Coefficients<P> {
    /// (τ²w² + (1.42 B u/L)²), and its fourth root.
    #[inline(always)]
    fn sweep(&self, u: P, w: P) -> [P; 2] {
        let square = self.thinning * w * w + self.blasius * u * u;
        [square, square.sqrt().sqrt()]
    }

    /// The traction at velocities `u` along and `w` across, and its derivatives, in fluids with these μ, √(ρμ) and ρ.
    #[inline(always)]
    pub(crate) fn with_slopes<T: Real<Pair = P>>(
        &self,
        [viscosity, root, density]: [P; 3],
        u: P,
        w: P,
    ) -> (Traction<T>, TractionSlopes<T>)
    where
        P: Pair<T>,
    {
        let [square, sweep] = self.sweep(u, w);
        let speed = w.abs();
        let (viscous, layer, form) =
            (viscosity * self.viscous[1], root * self.layer_across * speed.sqrt(), density * self.form * speed);
        let layer_along = root * self.layer_along * sweep;
        let (viscous_along, turbulent) = (viscosity * self.viscous[0], density * self.turbulent * u.abs());
        // d(sweep)/sweep = ½ (τ²w dw + (1.42 B/L)²u du)/square, which vanishes with the velocity.
        let per_square = layer_along * (u * u.like(0.5) / square.larger(u.like(f64::MIN_POSITIVE)));
        let along = viscous_along + layer_along + turbulent;
        (
            Traction { along: along * u, across: (viscous + layer + form) * w },
            TractionSlopes {
                along: along + turbulent + per_square * self.blasius * u,
                across: viscous + layer * u.like(1.5) + form * u.like(2.0),
                mixed: Some([per_square * self.thinning * w, u.like(0.0)]),
            },
        )
    }
}

/// μ, √(ρμ) and ρ.
pub(crate) type CrossFlowFluids = [f64x2; 3];

impl Law for CrossFlow {
    type Halves = Coefficients;
    type Fluids = CrossFlowFluids;

    fn name(&self) -> &'static str {
        LAW.name
    }

    fn validity(&self) -> Validity {
        LAW.validity
    }

    fn is_linear(&self) -> bool {
        false
    }

    #[inline(always)]
    fn in_fluids(&self, fluids: [&Fluid; 2]) -> CrossFlowFluids {
        let (viscosity, density) = (both(&fluids, |fluid| fluid.viscosity), both(&fluids, |fluid| fluid.density));
        [viscosity, (density * viscosity).sqrt(), density]
    }

    #[inline(always)]
    fn traction(&self, c: &Coefficients, [viscosity, root, density]: CrossFlowFluids, u: f64x2, w: f64x2) -> Traction {
        let [_, sweep] = c.sweep(u, w);
        let (speed, along) = (w.abs(), u.abs());
        let across = viscosity * c.viscous[1] + root * c.layer_across * speed.sqrt() + density * c.form * speed;
        let along = viscosity * c.viscous[0] + root * c.layer_along * sweep + density * c.turbulent * along;
        Traction { along: along * u, across: across * w }
    }

    #[inline(always)]
    fn with_slopes(&self, c: &Coefficients, fluids: CrossFlowFluids, u: f64x2, w: f64x2) -> (Traction, TractionSlopes) {
        c.with_slopes(fluids, u, w)
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY, FORM_DRAG, SKIN_FRICTION]
    }

    #[inline(always)] // resolves the key at compile time
    fn by_parameter(&self, key: Key, c: &Coefficients, fluids: [&Fluid; 2], u: f64x2, w: f64x2) -> Traction {
        let [_, sweep] = c.sweep(u, w);
        let [viscosity, root, density] = self.in_fluids(fluids);
        let layers = [root * c.layer_along * sweep, root * c.layer_across * w.abs().sqrt()];
        let [along, across] = match key {
            VISCOSITY => {
                let half = f64x2::HALF / viscosity;
                [c.viscous[0] + half * layers[0], c.viscous[1] + half * layers[1]]
            }
            DENSITY => {
                let half = f64x2::HALF / density;
                [c.turbulent * u.abs() + half * layers[0], c.form * w.abs() + half * layers[1]]
            }
            FORM_DRAG => [f64x2::ZERO, density * c.form_unit * w.abs()],
            SKIN_FRICTION => [root * c.layer_along_unit * sweep, f64x2::ZERO],
            _ => [f64x2::ZERO; 2],
        };
        Traction { along: along * u, across: across * w }
    }
}
