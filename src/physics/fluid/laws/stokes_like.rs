//! The source study's law: ξ∥ = 6πμR_eq and ξ⊥ = α ξ∥ per metre of length, R_eq = √(A/π).
//!
//! A sphere's coefficient per unit length. It is not dimensionally homogeneous, so scenes with the same Reynolds and
//! frequency numbers swim differently at another size. It is kept for the study's scenes.

use std::f64::consts::PI;

use super::resistance::{RATIO, Resistance};
use super::{CREEPING, Dependence, DragLaw, LawInputs, SectionInput};
use crate::fluid::medium::VISCOSITY;
use crate::fluid::uncertainty::Published;
use crate::fluid::validity::{Bound, DimensionlessNumber, Validity};
use crate::rod::HalfEdge;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "stokes-like",
    meaning: "the source study's: 6πμR per metre of length along the rod, a ratio times that across",
    validity: Validity {
        range: "the source study's own scenes: its coefficients lack a factor of 1/m, so its drag does not scale correctly with the size of the rod",
        bounds: &[Bound::at_most(DimensionlessNumber::Reynolds, CREEPING)],
        source: "the source study",
    },
    reynolds: 0.0,
    published: Published::NOTHING,
    reach: Dependence::Edge,
    takes: SectionInput::Area,
    keys: &["ratio"],
    needs: &["ratio"],
    resistance: Some(resistance),
    slender: None,
    build: |inputs| Resistance::scaled(&LAW, inputs, &[VISCOSITY, RATIO]),
    parts: None,
};

/// ξ∥/μ and ξ⊥/μ, per metre.
fn resistance(inputs: &LawInputs<'_>, half: &HalfEdge) -> [f64; 2] {
    let along = 6.0 * PI * half.equivalent_radius;
    [along, inputs.ratio * along]
}
