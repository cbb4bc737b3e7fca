//! Slender-body theory's resistance of a blunt cylinder: ξ∥ = 2πμ/(ln(ℒ/a) − 3/2 + ln 2),
//! ξ⊥ = 4πμ/(ln(ℒ/a) − 1/2 + ln 2). Across a flat section, [`slender_across`](crate::rod::Section::slender_across)
//! minus 1 replaces −1/2.

use std::f64::consts::{LN_2, PI};

use super::resistance::Resistance;
use super::{CREEPING, Dependence, DragLaw, LEAST_SLENDERNESS, LawInputs, SectionInput};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "cox",
    meaning: "slender-body theory's drag of a cylinder",
    validity: Validity {
        range: "creeping flow; within 10 % in speed for radius over length up to 0.01",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::Slenderness, LEAST_SLENDERNESS),
            STEADY,
        ],
        source: "R. G. Cox, J. Fluid Mech. 44 (1970); G. K. Batchelor, J. Fluid Mech. 44 (1970)",
    },
    reynolds: CREEPING,
    published: Published {
        table: &[
            Uncertainty::at(5e-4, [0.102, 0.20, 0.42]),
            Uncertainty::at(0.016, [0.14, 0.22, 0.42]),
            Uncertainty::at(0.26, [0.14, 0.22, 0.48]),
            Uncertainty::at(3.1, [0.36, 0.40, 0.77]),
        ],
        source: "nonlocal slender-body theory by regularised Stokeslets on prescribed waves and driven tails of sperm number 1.5 to 3, radius over length up to 0.01; growth with inertia: a round swimmer against cross-flow",
    },
    reach: Dependence::Edge,
    takes: SectionInput::SlenderRadius,
    keys: &["slender_length_m"],
    needs: &[],
    resistance: Some(resistance),
    slender: Some(|inputs| inputs.slender()),
    build: |inputs| Resistance::viscous(&LAW, inputs),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ.
pub(super) fn resistance(inputs: &LawInputs<'_>, half: &HalfEdge) -> [f64; 2] {
    let slender = (inputs.slender() / half.radius).ln();
    [2.0 * PI / (slender - 1.5 + LN_2), 4.0 * PI / (slender - (1.0 - half.slender_across) + LN_2)]
}
