//! Gray and Hancock's resistance: ξ∥ = 2πμ/(ln(2λ/a) − 1/2), ξ⊥ = 2ξ∥.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, DragLaw, Published, Reach, Recipe, Uncertainty};
use crate::fluid::force::Validity;
use crate::rod::Half;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "gray-hancock",
    meaning: "the drag of a wave of given length, twice as large across as along",
    validity: Validity {
        range: "creeping flow, waves of small amplitude; 20 to 160 % too fast for bodies of radius over length above 0.01",
        source: "J. Gray & G. J. Hancock, J. Exp. Biol. 32 (1955)",
    },
    reynolds: CREEPING,
    published: Published {
        table: &[Uncertainty::at(1.0, [0.68, 0.48, 0.46])],
        source: "nonlocal slender-body theory on prescribed waves and driven tails",
    },
    reach: Reach::Edge,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|recipe| 2.0 * recipe.slender()),
    build: |recipe| Resistance::viscous(&LAW, recipe),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(recipe: &Recipe<'_>, half: &Half) -> [f64; 2] {
    let along = 2.0 * PI / ((2.0 * recipe.slender() / half.radius).ln() - 0.5);
    [along, 2.0 * along]
}
