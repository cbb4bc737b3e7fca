//! Travelling wave: κ̄_k(t) = r κ_amp (ΔL/ℓ_ref)(e₀ + e₁ ξ_k) sin(2πft − φ₀ − 2πs_k/λ).

use std::f64::consts::TAU;

use super::{Actuation, Kind, Recipe, Wave};

/// This kind.
pub static KIND: Kind = Kind {
    name: "travelling-wave",
    keys: &["wavelength_m"],
    needs: &["wavelength_m"],
    build: |recipe| Box::new(TravellingWave::new(recipe)),
};

/// A travelling wave with a linear envelope.
///
/// sin(ψ − b_k) is expanded so that a time costs one sine and one cosine, whatever the number of nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct TravellingWave {
    /// (ΔL/ℓ_ref)(e₀ + e₁ξ_k) times (cos b_k, sin b_k), b_k = 2πs_k/λ.
    table: Vec<[f64; 2]>,
    /// λ, m; infinite where all of the rod bends at once.
    wavelength: f64,
}

impl TravellingWave {
    /// The wave that `recipe` describes.
    pub fn new(recipe: &Recipe) -> Self {
        let Recipe { nodes, spacing, envelope, reference_length, wavelength, .. } = *recipe;
        let table = (0..nodes)
            .map(|k| {
                let size = spacing / reference_length * (envelope[0] + envelope[1] * recipe.xi(k));
                let (sin, cos) = (TAU * recipe.place(k) * spacing / wavelength).sin_cos();
                [size * cos, size * sin]
            })
            .collect();
        Self { table, wavelength }
    }
}

impl Actuation for TravellingWave {
    fn add(&self, wave: Wave, natural: &mut [f64], rate: &mut [f64]) {
        let (sin, cos) = wave.phase.sin_cos();
        let size = wave.amplitude * wave.gain;
        let (turning, growing) = (size * wave.phase_rate, wave.amplitude * wave.gain_rate);
        for ((natural, rate), [c, s]) in natural.iter_mut().zip(rate).zip(&self.table) {
            let value = c * sin - s * cos;
            *natural += size * value;
            *rate += turning * (c * cos + s * sin) + growing * value;
        }
    }

    fn add_derivatives(&self, [value, first, second]: [f64; 3], phase: f64, out: &mut [f64]) {
        let (sin, cos) = phase.sin_cos();
        for (out, [c, s]) in out.iter_mut().zip(&self.table) {
            *out += (value - second) * (c * sin - s * cos) + first * (c * cos + s * sin);
        }
    }

    fn wavelength(&self) -> Option<f64> {
        Some(self.wavelength).filter(|wavelength| wavelength.is_finite())
    }

    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation> {
        let turned = |(([c, s], factor), phase): ((&[f64; 2], &f64), &f64)| {
            let (sin, cos) = phase.sin_cos();
            [factor * (c * cos - s * sin), factor * (s * cos + c * sin)]
        };
        Box::new(Self { table: self.table.iter().zip(factors).zip(phases).map(turned).collect(), ..*self })
    }
}
