//! Drag linear in velocity: f = ξ∥ u t + ξ⊥ w n per unit length, with u = V·t and w = V·n.

use wide::f64x2;

use crate::fluid::force::Force;
use crate::fluid::laws::{DragLaw, LawInputs};
use crate::fluid::local::{Law, LocalDrag, Traction, TractionSlopes, both};
use crate::fluid::medium::{Fluid, Key, VISCOSITY};
use crate::fluid::validity::Validity;

/// A linear law. Each half of an edge stores its coefficients ξ∥ and ξ⊥, divided by the viscosity if they are
/// proportional to it.
#[derive(Debug)]
pub struct Resistance {
    law: &'static DragLaw,
    /// True if the coefficients are proportional to the viscosity.
    viscous: bool,
    parameters: &'static [Key],
}

impl Resistance {
    /// The force of a `law` whose coefficients are proportional to the viscosity.
    pub fn viscous(law: &'static DragLaw, inputs: &LawInputs<'_>) -> Box<dyn Force> {
        Self::scaled(law, inputs, &[VISCOSITY])
    }

    /// The same for a law that depends on these `parameters`.
    pub fn scaled(law: &'static DragLaw, inputs: &LawInputs<'_>, parameters: &'static [Key]) -> Box<dyn Force> {
        let of = law.resistance.unwrap_or(|_, _| [0.0; 2]);
        let own = Self { law, viscous: true, parameters };
        Box::new(LocalDrag::new(own, inputs.rod, inputs.head, |halves| {
            let of = halves.each_ref().map(|half| of(inputs, half));
            [both(&of, |xi| xi[0]), both(&of, |xi| xi[1])]
        }))
    }

    /// The force of a `law` with the coefficients given in the scene, whatever the fluid.
    pub fn given(law: &'static DragLaw, inputs: &LawInputs<'_>, parameters: &'static [Key]) -> Box<dyn Force> {
        let own = Self { law, viscous: false, parameters };
        let length = inputs.rod.length;
        Box::new(LocalDrag::new(own, inputs.rod, inputs.head, |halves| {
            [&inputs.along, &inputs.across].map(|profile| both(halves, |half| profile.at(half.middle / length)))
        }))
    }
}

/// The key of the coefficient along the rod.
pub const ALONG: Key = "drag.along_n_s_m2";
/// The key of the coefficient across the rod.
pub const ACROSS: Key = "drag.across_n_s_m2";
/// The key of the ratio of both.
pub const RATIO: Key = "drag.ratio";

impl Law for Resistance {
    type Halves = [f64x2; 2];
    type Fluids = f64x2;

    fn name(&self) -> &'static str {
        self.law.name
    }

    fn validity(&self) -> Validity {
        self.law.validity
    }

    fn is_linear(&self) -> bool {
        true
    }

    #[inline(always)]
    fn in_fluids(&self, fluids: [&Fluid; 2]) -> f64x2 {
        if self.viscous { both(&fluids, |fluid| fluid.viscosity) } else { f64x2::ONE }
    }

    #[inline(always)]
    fn traction(&self, [along, across]: &[f64x2; 2], scale: f64x2, u: f64x2, w: f64x2) -> Traction {
        Traction { along: *along * scale * u, across: *across * scale * w }
    }

    #[inline(always)]
    fn with_slopes(
        &self,
        [along, across]: &[f64x2; 2],
        scale: f64x2,
        u: f64x2,
        w: f64x2,
    ) -> (Traction, TractionSlopes) {
        Traction::linear([*along * scale, *across * scale], u, w)
    }

    fn coefficients(&self, [along, across]: &[f64x2; 2], scale: f64x2) -> Option<[f64x2; 2]> {
        Some([*along * scale, *across * scale])
    }

    fn parameters(&self) -> &[Key] {
        self.parameters
    }

    #[inline(always)] // resolves the key at compile time
    fn by_parameter(
        &self,
        key: Key,
        &[along, across]: &[f64x2; 2],
        fluids: [&Fluid; 2],
        u: f64x2,
        w: f64x2,
    ) -> Traction {
        match key {
            VISCOSITY => Traction { along: along * u, across: across * w },
            ALONG => Traction { along: u, across: f64x2::ZERO },
            ACROSS => Traction { along: f64x2::ZERO, across: w },
            // ξ⊥ is the ratio times ξ∥.
            RATIO => Traction { along: f64x2::ZERO, across: along * both(&fluids, |fluid| fluid.viscosity) * w },
            _ => Traction::default(),
        }
    }
}
