//! A scene in motion: the stepper, its table of variables, and several cases in one step.

pub mod variable;

pub mod stepper;

#[cfg(feature = "report")]
pub mod batch;
