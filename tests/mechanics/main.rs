//! The rod, its models, its integrators and its solvers against theory, published numbers and each other.

#[path = "../common/mod.rs"]
mod common;

mod accuracy;
mod adaptive;
mod amplification;
mod batch;
mod beam;
mod chain;
mod damping;
mod energy;
mod forces;
mod guards;
mod head;
mod hinge;
mod homogeneity;
mod invariance;
mod jacobian;
mod lag;
mod linear;
mod modes;
mod moments;
mod momentum;
mod newton;
mod order;
mod own_actuation;
mod own_force;
mod pivoted_band;
mod reduced;
mod reference;
mod resonance;
mod saturation;
mod section;
mod solvers;
mod stability;
mod study;
mod tendons;
mod waves;
mod winches;
