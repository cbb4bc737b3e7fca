//! caudal simulates bio-inspired tails and swimmers: a slender planar rod of N nodes, driven by a travelling natural
//! curvature in a fluid, stepped by implicit methods with exact banded Jacobians.
//!
//! Data flows one way: a [`scene`] describes a [`model`] and an [`integrator`], and the [`stepper`] drives both. The
//! command, files and hosts use the stepper through one table of [`variable`]s. All units are SI. Each node has two
//! coordinates, x and y.
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
//!
//! # Using the library
//!
//! ```toml
//! [dependencies]
//! caudal = { path = "../caudal", default-features = false }
//!
//! [profile.dev.package.caudal]
//! opt-level = 3   # without it a step takes many times as long
//! ```
//!
//! Without features the crate has scenes, models, forces, integrators, the stepper and its derivatives. `faer` adds the general
//! linear solver, natural modes, stability, nonlocal drag and the assessment of scenes; `report` adds sweeps, studies and their
//! output files; `design` adds inverse design; `fmu` packs FMUs; `parquet`, `pictures` and `schema` write files of these kinds;
//! `cli`, a default feature, adds the command.
//!
//! Vectors are [`nalgebra`] vectors. [`variable::VARIABLES`] and `caudal variables SCENE` list the variables of a
//! host, with units, frames and signs. To add your own force, implement [`fluid::Force`] and check it with
//! [`fluid::audit`].

#![warn(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::todo)]

pub use nalgebra;

// Each module imports only from the modules above it (`tests/layers.rs`). Private folders group several modules, in the order of
// their `mod.rs`.

pub mod wording;

pub mod error;

pub mod files;

pub mod number_format;

mod numerics;

mod physics;

mod measure;

#[cfg(feature = "faer")]
mod analysis;

pub mod reduced;

pub mod scene;

mod simulation;

mod checks;

pub mod sensitivity;

pub mod jobs;

#[cfg(feature = "report")]
pub mod report;

pub mod fmu;

mod workflows;

#[cfg(feature = "faer")]
pub use analysis::{linear_stability, modes, rest};
#[cfg(feature = "faer")]
pub use checks::assessment;
#[cfg(feature = "faer")]
pub(crate) use checks::diagnostics;
pub use checks::verification;
pub use error::{Error, Result};
pub use measure::{cycle, metrics, regime, spectrum};
pub use numerics::{integrator, linear, newton, system};
pub use physics::{actuation, drives, fluid, head, loads, model, rod, start, tendons};
#[cfg(feature = "report")]
pub use simulation::batch;
pub use simulation::{stepper, variable};
#[cfg(feature = "design")]
pub use workflows::design;
pub use workflows::run;
#[cfg(feature = "report")]
pub use workflows::{distributed, study, sweep};
