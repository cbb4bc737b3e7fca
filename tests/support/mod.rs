//! What several of these tests share: the study's tail as text, and numbers that look random and never change.

#![allow(dead_code, reason = "no test uses all of it")]

use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;

/// The study's tail in water, released as the study releases it.
pub const STUDY: &str = r#"name = "study"
[rod]
nodes = 9
length_m = 1.0
outer_radius_m = 0.013
inner_radius_m = 0.011
youngs_modulus_pa = 70e9
density_kg_m3 = 2700.0
stiffness_gradient = 1.0
mass_lumping = "uniform"
[actuation]
kind = "travelling-wave"
kappa_amp = 0.6
kappa_reference_length_m = 0.125
frequency_hz = 2.0
wavelength_m = 1.0
envelope = [0.2, 0.8]
[start]
kind = "jump"
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "stokes-like"
ratio = 5.0
head_weight = 10.0
head_length_m = 0.0625
[solver]
integrator = "implicit-euler"
time_step_s = 5e-3
duration_s = 20.0
newton_tolerance = 1e-12
"#;

/// A soft tail in glycerol, fat enough that stretching, bending, drag and inertia are of like size.
pub const SOFT: &str = r#"name = "soft"
[rod]
nodes = 9
length_m = 1.0
outer_radius_m = 0.08
inner_radius_m = 0.0
youngs_modulus_pa = 1e5
density_kg_m3 = 1000.0
stiffness_gradient = 0.5
[actuation]
kind = "travelling-wave"
kappa_amp = 4.0
frequency_hz = 1.5
wavelength_m = 0.8
envelope = [0.2, 0.8]
[medium]
viscosity_pa_s = 5.0
density_kg_m3 = 1260.0
[drag]
ratio = 5.0
head_weight = 10.0
head_length_m = 0.2
[solver]
time_step_s = 2e-3
duration_s = 1.0
"#;

/// The scene of `text` with `overrides`.
pub fn scene(text: &str, overrides: &[&str]) -> Scene {
    let mut document = Document::new("test.toml", text);
    for assignment in overrides {
        document.set(assignment).unwrap();
    }
    document.scene().unwrap_or_else(|error| panic!("{error}"))
}

/// The start of its run.
pub fn stepper(text: &str, overrides: &[&str]) -> Stepper {
    Stepper::of(&scene(text, overrides)).unwrap_or_else(|error| panic!("{error}"))
}

/// Numbers that look random: splitmix64.
pub struct Dice(pub u64);

impl Dice {
    /// Uniform between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// `count` of them.
    pub fn many(&mut self, count: usize, low: f64, high: f64) -> Vec<f64> {
        (0..count).map(|_| self.between(low, high)).collect()
    }

    /// A chain of `nodes` nodes: edges 0.6 to 1.5 times `spacing` long, turning by up to 2 rad at each node.
    pub fn chain(&mut self, nodes: usize, spacing: f64) -> Vec<f64> {
        let mut q = vec![self.between(-1.0, 1.0), self.between(-1.0, 1.0)];
        let mut angle = self.between(-3.0, 3.0);
        for _ in 1..nodes {
            let length = spacing * self.between(0.6, 1.5);
            let [x, y] = [q[q.len() - 2], q[q.len() - 1]];
            q.extend([x + length * angle.cos(), y + length * angle.sin()]);
            angle += self.between(-2.0, 2.0);
        }
        q
    }
}

/// Largest modulus.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |max, x| if x.is_nan() { f64::NAN } else { f64::max(max, x.abs()) })
}
