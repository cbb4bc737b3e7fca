//! Lighthill's resistance of a flagellum: ξ∥ = 2πμ/ln(0.18Λ/a), ξ⊥ = 4πμ/(ln(0.18Λ/a) + 1/2), with the wavelength Λ
//! along the arc. Across a flat section, [`slender_across`](crate::rod::Section::slender_across) replaces 1/2.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, Dependence, DragLaw, LawInputs, SectionInput};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "lighthill",
    meaning: "the drag of a wave without load",
    validity: Validity {
        range: "creeping flow, a wave without load",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::Wave, 30.0),
            STEADY,
        ],
        source: "M. J. Lighthill, SIAM Review 18 (1976)",
    },
    reynolds: CREEPING,
    published: Published {
        // The growth with the Reynolds number, from the inertia of the fluid, is that of the errors of cox.
        table: &[
            Uncertainty::at(5e-4, [0.31, 0.57, 0.2]),
            Uncertainty::at(0.016, [0.325, 0.577, 0.2]),
            Uncertainty::at(0.26, [0.325, 0.577, 0.305]),
            Uncertainty::at(3.1, [0.464, 0.669, 0.68]),
        ],
        source: "nonlocal slender-body theory on prescribed waves, with and without a head, and driven tails",
    },
    reach: Dependence::Edge,
    takes: SectionInput::SlenderRadius,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|inputs| 0.18 * wave(inputs)),
    build: |inputs| Resistance::viscous(&LAW, inputs),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(inputs: &LawInputs<'_>, half: &HalfEdge) -> [f64; 2] {
    let slender = (0.18 * wave(inputs) / half.radius).ln();
    [2.0 * PI / slender, 4.0 * PI / (slender + half.slender_across)]
}

/// Λ, m: the scene's `slender_length_m`, else the wavelength of the actuation, else the rod's length.
fn wave(inputs: &LawInputs<'_>) -> f64 {
    inputs.slender_length.or(inputs.wavelength).unwrap_or(inputs.rod.length)
}
