//! The law that suits the flow of a scene: slender-body theory without fluid inertia, cross-flow with it.

use super::{Dependence, DragLaw, LawInputs, SectionInput, cox, cross_flow};
use crate::fluid::uncertainty::Published;
use crate::fluid::validity::Validity;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "auto",
    meaning: "cox or cross-flow, by estimates from the scene's own motion",
    validity: Validity { range: "that of the chosen law", bounds: &[], source: "of the chosen law" },
    reynolds: cross_flow::LAW.reynolds,
    published: Published::NOTHING,
    reach: Dependence::Edge,
    takes: SectionInput::Outline,
    keys: cross_flow::LAW.keys,
    needs: &[],
    resistance: None,
    slender: Some(|inputs| inputs.slender()),
    build: |inputs| (taken(inputs).build)(inputs),
    parts: Some(|inputs| taken(inputs).parts(inputs)),
};

/// The laws that may be chosen, the cheapest first.
pub static CANDIDATES: [&DragLaw; 2] = [&cox::LAW, &cross_flow::LAW];

/// The law chosen for the scene's motion, or `cross-flow` if that is unknown: it holds at every Reynolds number.
pub fn taken(inputs: &LawInputs<'_>) -> &'static DragLaw {
    inputs.taken.unwrap_or(&cross_flow::LAW)
}
