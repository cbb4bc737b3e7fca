//! Drag from creeping flow to Reynolds numbers of 10⁵: viscous, boundary layer and form drag.
//!
//! With u = V·t, w = V·n, depth D, perimeter P of the elliptic section, ν = μ/ρ:
//! f⊥ = [ξ⊥ + 2ρD(ν/D)^½ |w|^½ + ½ρD C_d |w|] w, and
//! f∥ = [ξ∥ + ½·3.5 ρ(P/π)(ν/D)^½ (τ²w² + (1.42 D u/L)²)^¼ + ½ρP C_f |u|] u.
//! The normal part is Taylor's, where u drops out; the tangential one is the heat that a cylinder loses, with the friction of
//! Blasius' plate where nothing flows across.

use std::f64::consts::PI;

use super::{Causes, DragLaw, Published, Reach, Recipe, Uncertainty};
use crate::fluid::force::{Force, Validity};
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes};
use crate::fluid::medium::{DENSITY, Fluid, Key, VISCOSITY};
use crate::rod::Half;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "cross-flow",
    meaning: "viscous drag, a boundary layer's friction and form drag",
    validity: Validity {
        range: "Reynolds numbers of the depth from 1e-3 to 1e5; no lift, vortex shedding or history",
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
    reach: Reach::Edge,
    keys: &["slender_length_m", "viscous", "form_drag", "thinning", "skin_friction", "turbulent_friction"],
    needs: &[],
    resistance: None,
    slender: Some(|recipe| recipe.viscous.slender.map_or(f64::INFINITY, |slender| slender(recipe))),
    build: |recipe| Box::new(LocalDrag::new(CrossFlow, recipe.rod, recipe.head, |half| Coefficients::of(recipe, half))),
    parts: Some(parts),
};

/// The law as three of its kind: each has what one cause does, and nothing of the others.
fn parts(recipe: &Recipe<'_>) -> Causes {
    let only = |keep: fn(Coefficients) -> Coefficients| -> Box<dyn Force> {
        Box::new(LocalDrag::new(CrossFlow, recipe.rod, recipe.head, |half| keep(Coefficients::of(recipe, half))))
    };
    vec![
        ("viscous", only(|c| Coefficients { viscous: c.viscous, ..Coefficients::default() })),
        ("boundary layer", only(|c| Coefficients { viscous: [0.0; 2], form: 0.0, form_unit: 0.0, ..c })),
        ("form drag", only(|c| Coefficients { form: c.form, form_unit: c.form_unit, ..Coefficients::default() })),
    ]
}

/// The key of the form drag C_d.
pub const FORM_DRAG: Key = "drag.form_drag";
/// The key of the factor of the boundary layer's friction.
pub const SKIN_FRICTION: Key = "drag.skin_friction";

/// Friction of a cylinder's boundary layer, from its heat transfer.
const FRICTION: f64 = 3.5;
/// Makes the friction Blasius' where nothing flows across.
const BLASIUS: f64 = 1.42;

/// The law.
#[derive(Debug)]
struct CrossFlow;

/// What does not depend on fluid and velocity.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Coefficients {
    /// ξ∥/μ, ξ⊥/μ.
    viscous: [f64; 2],
    /// 2√D, m^½: times √(ρμ).
    layer_across: f64,
    /// ½D C_d, m: times ρ.
    form: f64,
    /// The same for C_d = 1.
    form_unit: f64,
    /// ½·3.5 (P/π)/√D, m^½: times √(ρμ).
    layer_along: f64,
    /// The same for a factor of 1 in place of 3.5.
    layer_along_unit: f64,
    /// ½P C_f, m: times ρ.
    turbulent: f64,
    /// τ².
    thinning: f64,
    /// (1.42 D/L)².
    blasius: f64,
}

impl Coefficients {
    fn of(recipe: &Recipe<'_>, half: &Half) -> Self {
        let (depth, breadth) = (half.depth, 2.0 * half.radius);
        // Ramanujan's perimeter of the ellipse.
        let (a, b) = (0.5 * depth, 0.5 * breadth);
        let perimeter = PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt());
        let slim = (breadth / depth).min(1.0);
        let form_unit = 0.5 * depth;
        let layer_along_unit = 0.5 * perimeter / (PI * depth.sqrt());
        Self {
            viscous: recipe.viscous.resistance.map_or([0.0; 2], |of| of(recipe, half)),
            layer_across: 2.0 * depth.sqrt(),
            form: form_unit * recipe.form_drag.unwrap_or(2.0 - 0.9 * slim),
            form_unit,
            layer_along: layer_along_unit * recipe.skin_friction.unwrap_or(FRICTION),
            layer_along_unit,
            turbulent: 0.5 * perimeter * recipe.turbulent_friction.unwrap_or(0.0),
            thinning: recipe.thinning.unwrap_or(slim).powi(2),
            blasius: (BLASIUS * depth / recipe.rod.length).powi(2),
        }
    }

    /// (τ²w² + (1.42 D u/L)²), and its fourth root.
    #[inline(always)]
    fn sweep(&self, u: f64, w: f64) -> [f64; 2] {
        let square = self.thinning * w * w + self.blasius * u * u;
        [square, square.sqrt().sqrt()]
    }
}

/// μ, √(ρμ) and ρ.
type InFluid = [f64; 3];

impl Law for CrossFlow {
    type Half = Coefficients;
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

    #[inline]
    fn in_fluid(&self, fluid: Fluid) -> InFluid {
        [fluid.viscosity, (fluid.density * fluid.viscosity).sqrt(), fluid.density]
    }

    #[inline(always)]
    fn traction(&self, c: &Coefficients, [viscosity, root, density]: InFluid, u: f64, w: f64) -> Traction {
        let [_, sweep] = c.sweep(u, w);
        let (speed, along) = (w.abs(), u.abs());
        let across = viscosity * c.viscous[1] + root * c.layer_across * speed.sqrt() + density * c.form * speed;
        let along = viscosity * c.viscous[0] + root * c.layer_along * sweep + density * c.turbulent * along;
        Traction { along: along * u, across: across * w }
    }

    #[inline(always)]
    fn with_slopes(
        &self,
        c: &Coefficients,
        [viscosity, root, density]: InFluid,
        u: f64,
        w: f64,
    ) -> (Traction, TractionSlopes) {
        let [square, sweep] = c.sweep(u, w);
        let speed = w.abs();
        let (viscous, layer, form) =
            (viscosity * c.viscous[1], root * c.layer_across * speed.sqrt(), density * c.form * speed);
        let layer_along = root * c.layer_along * sweep;
        let (viscous_along, turbulent) = (viscosity * c.viscous[0], density * c.turbulent * u.abs());
        // d(sweep)/sweep = ½ (τ²w dw + (1.42 D/L)²u du)/square, which vanishes with the velocity.
        let per_square = if square > 0.0 { 0.5 * layer_along * u / square } else { 0.0 };
        let along = viscous_along + layer_along + turbulent;
        (
            Traction { along: along * u, across: (viscous + layer + form) * w },
            TractionSlopes {
                along: along + turbulent + per_square * c.blasius * u,
                across: viscous + 1.5 * layer + 2.0 * form,
                mixed: Some([per_square * c.thinning * w, 0.0]),
            },
        )
    }

    fn parameters(&self) -> &[Key] {
        &[VISCOSITY, DENSITY, FORM_DRAG, SKIN_FRICTION]
    }

    #[inline(always)] // which settles the key when it is compiled
    fn by_parameter(&self, key: Key, c: &Coefficients, fluid: Fluid, u: f64, w: f64) -> Traction {
        let [_, sweep] = c.sweep(u, w);
        let root = (fluid.density * fluid.viscosity).sqrt();
        let layers = [root * c.layer_along * sweep, root * c.layer_across * w.abs().sqrt()];
        let [along, across] = match key {
            VISCOSITY => {
                let half = 0.5 / fluid.viscosity;
                [c.viscous[0] + half * layers[0], c.viscous[1] + half * layers[1]]
            }
            DENSITY => {
                let half = 0.5 / fluid.density;
                [c.turbulent * u.abs() + half * layers[0], c.form * w.abs() + half * layers[1]]
            }
            FORM_DRAG => [0.0, fluid.density * c.form_unit * w.abs()],
            SKIN_FRICTION => [root * c.layer_along_unit * sweep, 0.0],
            _ => [0.0; 2],
        };
        Traction { along: along * u, across: across * w }
    }
}
