#![doc = "caudal"]
pub mod actuation;
pub mod drag;
pub mod error;
pub mod head;
pub mod integrator;
pub mod linear;
pub mod metrics;
pub mod model;
pub mod modes;
pub mod newton;
pub mod rod;
pub mod scene;
pub mod start;
pub mod stepper;
pub mod system;
pub mod variable;
pub use error::{Error, Result};
