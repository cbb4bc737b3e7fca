//! Linear analysis of a model at one state: natural modes and stability.

#[cfg(feature = "faer")]
pub mod rest;

#[cfg(feature = "faer")]
pub mod linear_stability;

#[cfg(feature = "faer")]
pub mod modes;
