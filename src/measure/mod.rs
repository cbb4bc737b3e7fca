//! Measurements of a motion: energies, means over cycles, and the flow regime.

pub mod spectrum;

pub mod regime;

pub mod metrics;

pub mod cycle;
