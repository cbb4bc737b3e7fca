//! Time stepping of a scene: the stepper, its table of variables, and batches that step several cases at once.

pub mod variable;

pub mod stepper;

#[cfg(feature = "report")]
pub mod batch;
