//! Resistance of a slender prolate spheroid, local part: ξ∥ = 2πμ/(ln(L/a) − 1/2), ξ⊥ = 4πμ/(ln(L/a) + 1/2), with the
//! radius a at its middle.

use std::f64::consts::PI;

use super::resistance::Resistance;
use super::{CREEPING, Dependence, DragLaw, LEAST_SLENDERNESS, LawInputs, SectionInput};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "spheroid",
    meaning: "slender-body theory's drag of a prolate spheroid, its local part",
    validity: Validity {
        range: "creeping flow, thin spheroids",
        bounds: &[
            Bound::at_most(DimensionlessNumber::Reynolds, CREEPING),
            Bound::at_least(DimensionlessNumber::Slenderness, LEAST_SLENDERNESS),
            STEADY,
        ],
        source: "J. B. Keller & S. I. Rubinow, J. Fluid Mech. 75 (1976); R. E. Johnson, J. Fluid Mech. 99 (1980)",
    },
    reynolds: CREEPING,
    published: Published {
        // The growth with the Reynolds number, from the inertia of the fluid, is that of the errors of cox.
        table: &[
            Uncertainty::at(5e-4, [0.15, 0.25, 0.45]),
            Uncertainty::at(0.016, [0.178, 0.266, 0.45]),
            Uncertainty::at(0.26, [0.178, 0.266, 0.505]),
            Uncertainty::at(3.1, [0.376, 0.43, 0.79]),
        ],
        source: "that of cox, plus the difference from the axial drag of a cylinder",
    },
    reach: Dependence::Edge,
    takes: SectionInput::Round,
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
    [2.0 * PI / (slender - 0.5), 4.0 * PI / (slender + 0.5)]
}
