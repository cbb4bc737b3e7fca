//! Resistance near a wall at height h: ξ∥ = 2πμ/acosh(h/a), ξ⊥ = 4πμ/acosh(h/a), or the resistance far from it if that
//! is larger.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, Dependence, DragLaw, LawInputs, SectionInput, cox};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "wall",
    meaning: "the drag of a rod that moves parallel to a nearby plane wall",
    validity: Validity {
        range: "creeping flow, a rod parallel to the wall and moving parallel to it",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::Height, 1.0),
            Bound::at_most(DimensionlessNumber::HeightInLengths, 1.0 / 3.0),
        ],
        source: "D. J. Jeffrey & Y. Onishi, Q. J. Mech. Appl. Math. 34 (1981); D. F. Katz & J. R. Blake (1975)",
    },
    reynolds: CREEPING,
    published: Published {
        // The growth with the Reynolds number, from the inertia of the fluid, is that of the errors of cox.
        table: &[
            Uncertainty::at(5e-4, [0.19, 0.19, 0.19]),
            Uncertainty::at(0.016, [0.213, 0.21, 0.19]),
            Uncertainty::at(0.26, [0.213, 0.21, 0.298]),
            Uncertainty::at(3.1, [0.394, 0.398, 0.677]),
        ],
        source: "drag of a straight rod against nonlocal theory with Blake's images, height over length 0.03 to 2",
    },
    reach: Dependence::Edge,
    takes: SectionInput::Round,
    keys: &["slender_length_m", "height_m"],
    needs: &["height_m"],
    resistance: Some(resistance),
    slender: Some(|inputs| inputs.slender()),
    build: |inputs| Resistance::viscous(&LAW, inputs),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(inputs: &LawInputs<'_>, half: &HalfEdge) -> [f64; 2] {
    let near = (inputs.height / half.radius).acosh();
    let [along, across] = cox::resistance(inputs, half);
    [along.max(2.0 * PI / near), across.max(4.0 * PI / near)]
}
