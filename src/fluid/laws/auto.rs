//! The law that fits the flow that a scene makes: slender-body theory where the fluid has no inertia, cross-flow where it has.

use super::{DragLaw, Published, Reach, Recipe, cox, cross_flow};
use crate::fluid::force::Validity;

/// Re_d from which a fluid's inertia counts where nothing else is known: viscous drag alone is off by 10 % in speed at 0.016 (a round
/// swimmer).
pub const INERTIA: f64 = 1e-2;

/// What is known of it.
pub static LAW: DragLaw = DragLaw {
    name: "auto",
    meaning: "cox or cross-flow, by estimates of the scene's own motion",
    validity: Validity { range: "that of the law it takes", source: "of the law it takes" },
    reynolds: cross_flow::LAW.reynolds,
    published: Published::NOTHING,
    reach: Reach::Edge,
    keys: cross_flow::LAW.keys,
    needs: &[],
    resistance: None,
    slender: Some(|recipe| recipe.slender()),
    build: |recipe| (taken(recipe).build)(recipe),
    parts: Some(|recipe| taken(recipe).parts(recipe)),
};

/// The laws that it takes one of, the cheapest first.
pub static CANDIDATES: [&DragLaw; 2] = [&cox::LAW, &cross_flow::LAW];

/// The law that the scene's own motion was found to need, or the one of its Reynolds number where that is not known.
pub fn taken(recipe: &Recipe<'_>) -> &'static DragLaw {
    recipe.taken.unwrap_or(if recipe.reynolds < INERTIA { &cox::LAW } else { &cross_flow::LAW })
}
