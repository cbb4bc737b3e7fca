//! FMUs: a scene as a component for co-simulation hosts, following the FMI standard, versions 2.0 and 3.0.
//!
//! An FMU is a zip file with the description of the variables (`modelDescription.xml`), the shared library of `bindings/fmi`, the
//! scene in `resources/`, and documentation. Library and description share the variables of the [`Catalogue`].

mod catalogue;
#[cfg(feature = "fmu")]
mod component;
#[cfg(feature = "fmu")]
mod description;
#[cfg(feature = "fmu")]
mod documentation;
#[cfg(feature = "fmu")]
mod package;
#[cfg(feature = "fmu")]
mod terminals;

pub use catalogue::{Catalogue, LOG_CATEGORIES, NODES, Standard, Target, token};
#[cfg(feature = "fmu")]
pub use component::{Fmu, FmuOptions};
#[cfg(feature = "fmu")]
pub use package::{library, library_name};
