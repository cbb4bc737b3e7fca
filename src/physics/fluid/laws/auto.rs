//! The law that fits the flow that a scene makes: slender-body theory where the fluid has no inertia, cross-flow where it has.

use super::{Dependence, DragLaw, LawInputs, SectionInput, cox, cross_flow};
use crate::fluid::uncertainty::Published;
use crate::fluid::validity::Validity;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "auto",
    meaning: "cox or cross-flow, by estimates of the scene's own motion",
    validity: Validity { range: "that of the chosen law", bounds: &[], source: "of the law it takes" },
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

/// The laws that it takes one of, the cheapest first.
pub static CANDIDATES: [&DragLaw; 2] = [&cox::LAW, &cross_flow::LAW];

/// The law that the scene's own motion was found to need, or the highest where that is not known: it holds at every Reynolds number.
pub fn taken(inputs: &LawInputs<'_>) -> &'static DragLaw {
    inputs.taken.unwrap_or(&cross_flow::LAW)
}
