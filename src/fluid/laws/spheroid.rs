//! Resistance of a slender prolate spheroid, its local part: ξ∥ = 2πμ/(ln(L/a) − 1/2), ξ⊥ = 4πμ/(ln(L/a) + 1/2), a the radius in its middle.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, DragLaw, Published, Reach, Recipe, Uncertainty};
use crate::fluid::force::Validity;
use crate::rod::Half;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "spheroid",
    meaning: "slender-body theory's drag of a prolate spheroid, its local part",
    validity: Validity {
        range: "creeping flow, thin spheroids",
        source: "J. B. Keller & S. I. Rubinow, J. Fluid Mech. 75 (1976); R. E. Johnson, J. Fluid Mech. 99 (1980)",
    },
    reynolds: CREEPING,
    published: Published {
        table: &[Uncertainty::at(1.0, [0.15, 0.25, 0.45])],
        source: "that of cox, and what the drag of a cylinder along itself differs by",
    },
    reach: Reach::Edge,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|recipe| recipe.slender()),
    build: |recipe| Resistance::viscous(&LAW, recipe),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(recipe: &Recipe<'_>, half: &Half) -> [f64; 2] {
    let slender = (recipe.slender() / half.radius).ln();
    [2.0 * PI / (slender - 0.5), 4.0 * PI / (slender + 0.5)]
}
