//! Inverse design, identification, and the verdicts that they and stability reach.
#![cfg(feature = "design")]

#[path = "../common/mod.rs"]
mod common;

mod identify;
mod inverse;
mod limits;
mod optima;
mod robust;
mod trust;
mod variables;
mod verdicts;
