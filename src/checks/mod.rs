//! Checks of a scene before its run, and of a run after its end.

#[cfg(feature = "faer")]
pub mod assessment;

#[cfg(feature = "faer")]
pub(crate) mod diagnostics;

pub mod verification;
