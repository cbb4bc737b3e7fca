//! The fluid: every law and force against what is published, independent programs and invariances.

#[path = "../common/mod.rs"]
mod common;

mod body;
mod choices;
mod drag;
mod estimates;
mod flow;
mod media;
mod nonlocal;
mod published;
mod ranges;
mod reference;
mod shape_in_water;
mod study;
mod swimming;
mod validation;
