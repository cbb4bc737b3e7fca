//! caudal simulates bio-inspired tails and swimmers: a slender planar rod of N nodes, driven by a travelling natural
//! curvature in a fluid, stepped by implicit methods with exact banded Jacobians.
//!
//! Data flows one way: a [`scene`] describes a [`model`] and an [`integrator`]; the [`stepper`] drives both and is what
//! every face (command, files, hosts) sees, through the one table of [`variable`]s. SI units everywhere; two numbers a
//! node, x and y.
//!
//! ```
//! use caudal::scene::Document;
//! use caudal::stepper::Stepper;
//!
//! # fn main() -> caudal::Result<()> {
//! let scene = Document::new(
//!     "eel.toml",
//!     r#"
//!     [rod]
//!     nodes = 17
//!     length_m = 1.0
//!     outer_radius_m = 0.012
//!     inner_radius_m = 0.0
//!     youngs_modulus_pa = 5e6
//!     density_kg_m3 = 1150.0
//!     [actuation]
//!     kind = "travelling-wave"
//!     kappa_amp = 4.0
//!     frequency_hz = 1.0
//!     wavelength_m = 1.0
//!     envelope = [0.2, 0.8]
//!     [medium]
//!     viscosity_pa_s = 1.0
//!     density_kg_m3 = 1260.0
//!     [drag]
//!     ratio = 2.0
//!     [solver]
//!     integrator = "newmark"
//!     time_step_s = 2e-3
//!     duration_s = 2.0
//!     "#,
//! )
//! .scene()?;
//! let mut tail = Stepper::of(&scene)?;
//! while tail.time() < 1.0 {
//!     tail.do_step(0.01)?;
//!     // A host steers: it bends the whole tail to one side.
//!     let bend = 0.5 * tail.time();
//!     tail.set("natural_curvature_1_m", &[bend; 15])?;
//! }
//! let curvature = tail.get("curvature_1_m")?;
//! assert!(curvature.iter().sum::<f64>() > 0.0);
//! # Ok(())
//! # }
//! ```

#![warn(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::todo)]

// From the ground up: each module imports only what stands above it.
pub mod error;
pub mod linear;
pub mod system;
pub mod words;

pub mod newton;

pub mod rod;

pub mod actuation;
pub mod fluid;
pub mod head;
pub mod start;

pub mod model;
pub mod regime;

pub mod integrator;
pub mod metrics;

pub mod cycle;
#[cfg(feature = "faer")]
pub mod linear_stability;
#[cfg(feature = "faer")]
pub mod modes;
pub mod reduced;

pub mod scene;

pub mod variable;

pub mod stepper;

pub mod sensitivity;

pub mod jobs;
#[cfg(feature = "report")]
pub mod parts;

#[cfg(feature = "report")]
pub mod batch;
#[cfg(feature = "faer")]
pub mod check;
pub mod fmu;
#[cfg(feature = "report")]
pub mod report;
pub mod run;
#[cfg(feature = "report")]
pub mod study;

#[cfg(feature = "report")]
pub mod sweep;

#[cfg(feature = "design")]
pub mod design;

pub use error::{Error, Result};
