//! Gray and Hancock's resistance: ξ∥ = 2πμ/(ln(2λ/a) − 1/2), ξ⊥ = 2ξ∥.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, Dependence, DragLaw, LEAST_SLENDERNESS, LawInputs, SectionInput};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "gray-hancock",
    meaning: "the drag of a wave of given length, twice as large across as along",
    validity: Validity {
        range: "creeping flow, waves of small amplitude; 20 to 160 % too fast for bodies of radius over length above 0.01",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::Slenderness, LEAST_SLENDERNESS),
            STEADY,
        ],
        source: "J. Gray & G. J. Hancock, J. Exp. Biol. 32 (1955)",
    },
    reynolds: CREEPING,
    published: Published {
        // The growth with the Reynolds number, from the inertia of the fluid, is that of the errors of cox.
        table: &[
            Uncertainty::at(5e-4, [0.68, 0.48, 0.46]),
            Uncertainty::at(0.016, [0.687, 0.488, 0.46]),
            Uncertainty::at(0.26, [0.687, 0.488, 0.514]),
            Uncertainty::at(3.1, [0.763, 0.594, 0.796]),
        ],
        source: "nonlocal slender-body theory on prescribed waves and driven tails",
    },
    reach: Dependence::Edge,
    takes: SectionInput::SlenderRadius,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|inputs| 2.0 * inputs.slender()),
    build: |inputs| Resistance::viscous(&LAW, inputs),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(inputs: &LawInputs<'_>, half: &HalfEdge) -> [f64; 2] {
    let along = 2.0 * PI / ((2.0 * inputs.slender() / half.radius).ln() - 0.5);
    [along, 2.0 * along]
}
