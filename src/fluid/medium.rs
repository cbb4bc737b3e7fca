//! The fluid that the rod is in.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

/// A uniform fluid: what a host may change of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fluid {
    /// Dynamic viscosity μ, Pa s.
    pub viscosity: f64,
    /// Density ρ, kg/m³.
    pub density: f64,
    /// Uniform background velocity u, m/s.
    pub flow: Vector2<f64>,
    /// Its rate u̇, m/s²; a pressure gradient of −ρu̇ goes with it.
    pub acceleration: Vector2<f64>,
}

impl Fluid {
    /// No fluid at all, and no change of any.
    pub const NONE: Self =
        Self { viscosity: 0.0, density: 0.0, flow: Vector2::new(0.0, 0.0), acceleration: Vector2::new(0.0, 0.0) };
}

/// A parameter of a scene that forces may depend on, by its key.
pub type Key = &'static str;

/// The key of the viscosity, Pa s.
pub const VISCOSITY: Key = "medium.viscosity_pa_s";

/// The key of the density, kg/m³.
pub const DENSITY: Key = "medium.density_kg_m3";
