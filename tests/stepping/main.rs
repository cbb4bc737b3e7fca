//! The stepper: events, hosts, readings between steps, averages over cycles, and what the table of variables says of them.

#[path = "../common/mod.rs"]
mod common;

mod between;
mod cosimulation;
mod cycle;
mod dependencies;
mod events;
mod guide;
mod random_scenes;
mod stepper;
mod told;
