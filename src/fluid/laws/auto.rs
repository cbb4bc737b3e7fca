//! The law that fits the flow that a scene makes: slender-body theory where the fluid has no inertia, cross-flow where it has.

use super::{DragLaw, cox, cross_flow};
use crate::fluid::force::Validity;

/// Re_d from which a fluid's inertia counts: viscous drag alone is off by 10 % in speed at 0.016 (a round swimmer).
pub const INERTIA: f64 = 1e-2;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "auto",
    meaning: "cox below a Reynolds number of 1e-2 of the depth, cross-flow above",
    validity: Validity { range: "that of the law it takes", source: "of the law it takes" },
    reynolds: cross_flow::LAW.reynolds,
    keys: cross_flow::LAW.keys,
    needs: &[],
    resistance: None,
    slender: Some(|recipe| recipe.slender()),
    build: |recipe| {
        let law = if recipe.reynolds < INERTIA { &cox::LAW } else { &cross_flow::LAW };
        (law.build)(recipe)
    },
};
