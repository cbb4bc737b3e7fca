//! Slender-body theory's resistance of a blunt cylinder: ξ∥ = 2πμ/(ln(ℒ/a) − 3/2 + ln 2), ξ⊥ = 4πμ/(ln(ℒ/a) − 1/2 + ln 2).

use std::f64::consts::{LN_2, PI};

use super::resistance::Resistance;
use super::{CREEPING, DragLaw, Recipe};
use crate::fluid::force::Validity;
use crate::rod::Half;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "cox",
    meaning: "slender-body theory's drag of a cylinder",
    validity: Validity {
        range: "creeping flow, length over radius of at least 10; within 10 % in speed for radius over length up to 0.01",
        source: "R. G. Cox, J. Fluid Mech. 44 (1970); G. K. Batchelor, J. Fluid Mech. 44 (1970)",
    },
    reynolds: CREEPING,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|recipe| recipe.slender()),
    build: |recipe| Resistance::viscous(&LAW, recipe),
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(recipe: &Recipe<'_>, half: &Half) -> [f64; 2] {
    let slender = (recipe.slender() / half.radius).ln();
    [2.0 * PI / (slender - 1.5 + LN_2), 4.0 * PI / (slender - 0.5 + LN_2)]
}
