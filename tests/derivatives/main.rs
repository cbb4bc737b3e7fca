//! Derivatives of readings, of whole simulations and of means over cycles, against differences.

#[path = "../common/mod.rs"]
mod common;

mod by_name;
mod cycle_goals;
mod derivatives;
mod fine;
mod gradients;
mod sensitivity;
mod step;
