//! The design variables of one design: profiles of stiffness, amplitude and phase along the rod, and numbers of the scene.

use serde::{Deserialize, Serialize};

use super::table::{DesignTable, DesignVariable};
use crate::error::Result;
use crate::scene::{Document, Scene};
use crate::sensitivity::scene_parameter::{SceneParameter, keys_with};

/// Name of the scene without the design, in figures and tables.
pub const BASELINE: &str = "the scene's own";

/// The values of the design variables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DesignVector {
    /// EI, N m²; empty if it follows from the scene.
    pub stiffness_n_m2: Vec<f64>,
    /// Amplitude of the actuation over the scene's.
    pub amplitude: Vec<f64>,
    /// Phase subtracted inside the actuation's sinusoid, in addition to the scene's phase, rad.
    pub phase_rad: Vec<f64>,
    /// Numbers of the scene by name, in SI units, in the order of the table; all others keep the scene's values.
    pub numbers: Vec<(String, f64)>,
}

impl DesignVector {
    /// This stiffness (N m²), with the scene's actuation and numbers.
    pub fn of(stiffness: Vec<f64>) -> Self {
        let (amplitude, phase_rad) = (vec![1.0; stiffness.len()], vec![0.0; stiffness.len()]);
        Self { amplitude, phase_rad, stiffness_n_m2: stiffness, numbers: Vec::new() }
    }

    /// The baseline of a design: the unchanged scene, whose joints have the stiffness `own` (N m²).
    pub fn before(table: &DesignTable, own: &[f64]) -> Self {
        let mut before = Self { numbers: table.initial_numbers(), ..Self::of(own.to_vec()) };
        if !table.variables.contains(&DesignVariable::Stiffness) && !table.numbers.is_empty() {
            before.stiffness_n_m2.clear(); // it follows from the scene
        }
        before
    }

    /// The values of the numbers.
    pub fn values(&self) -> Vec<f64> {
        self.numbers.iter().map(|(_, value)| *value).collect()
    }

    /// The scene of `document` with these `numbers`.
    ///
    /// # Errors
    /// Those of [`Document::scene`].
    pub fn numbers_in(&self, document: &Document, numbers: &[SceneParameter]) -> Result<Scene> {
        let mut document = document.clone();
        document.begin_layer();
        for (key, value) in keys_with(numbers, &self.values()) {
            document.set_value("the design", &key, &value);
        }
        document.scene()
    }
}
