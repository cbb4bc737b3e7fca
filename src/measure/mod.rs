//! What a motion tells: energies, means over cycles, the regime of the flow.

pub mod spectrum;

pub mod regime;

pub mod metrics;

pub mod cycle;
