//! Travelling wave: κ̄_k(t) = r κ_amp (ΔL/ℓ_ref)(e₀ + e₁ ξ_k) Σ_n h_n sin nψ_k, ψ_k = 2πft − φ₀ − 2πs_k/λ, with h₁ = 1
//! and the further harmonics h₂, h₃, … of `harmonics`. With `moment_amp_n_m`,
//! M_k(t) = r M_amp (e₀ + e₁ ξ_k) Σ_n h_n sin nψ_k.

use std::f64::consts::TAU;

use nalgebra::Complex;

use super::{Actuation, ActuationInputs, ActuationKind, Wave, fastest};

/// The entry of this kind in the list of kinds.
pub static KIND: ActuationKind = ActuationKind {
    name: "travelling-wave",
    keys: &["kappa_amp", "moment_amp_n_m", "kappa_reference_length_m", "wavelength_m", "harmonics"],
    needs: &["kappa_amp", "wavelength_m"],
    build: |inputs| Box::new(TravellingWave::new(inputs)),
};

/// A travelling wave of any shape, as a sum of sines, with a linear envelope.
///
/// sin n(ψ − b_k) is expanded, so that each evaluation needs one sine and one cosine per harmonic, whatever the number
/// of nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct TravellingWave {
    harmonics: Vec<Harmonic>,
    /// λ, m; infinite if the whole rod bends in phase.
    wavelength: f64,
    /// See [`Actuation::fastest`].
    fastest: f64,
}

/// The harmonic of order n.
#[derive(Debug, Clone, PartialEq)]
struct Harmonic {
    /// n.
    order: f64,
    /// h_n.
    size: f64,
    /// h_n (ΔL/ℓ_ref)(e₀ + e₁ξ_k) times (cos n b_k, sin n b_k), b_k = 2πs_k/λ.
    table: Vec<[f64; 2]>,
}

impl TravellingWave {
    /// The wave that `inputs` describes.
    pub fn new(inputs: &ActuationInputs<'_>) -> Self {
        let orders = std::iter::once(&1.0).chain(inputs.harmonics).zip(1..);
        let orders = orders.filter(|(size, _)| **size != 0.0).map(|(size, order)| (f64::from(order), *size));
        Self::of(inputs, inputs.reference_length, orders)
    }

    /// The wave κ_amp (ΔL/`length`)(e₀ + e₁ξ) Σ h_n sin nψ of `harmonics` (n, h_n), with the envelope and wavelength of
    /// `inputs`.
    pub fn of(inputs: &ActuationInputs<'_>, length: f64, harmonics: impl Iterator<Item = (f64, f64)> + Clone) -> Self {
        let ActuationInputs { nodes, spacing, envelope, wavelength, .. } = *inputs;
        let harmonic = |(order, part): (f64, f64)| {
            let at = |k: usize| {
                let size = spacing / length * (envelope[0] + envelope[1] * inputs.xi(k)) * part;
                let (sin, cos) = (order * (TAU * inputs.place(k) * spacing / wavelength)).sin_cos();
                [size * cos, size * sin]
            };
            Harmonic { order, size: part, table: (0..nodes).map(at).collect() }
        };
        let fastest = fastest(harmonics.clone());
        Self { harmonics: harmonics.map(harmonic).collect(), wavelength, fastest }
    }
}

impl Actuation for TravellingWave {
    fn add(&self, wave: Wave, given: &mut [f64], rate: &mut [f64]) {
        let size = wave.amplitude * wave.gain;
        let growing = wave.amplitude * wave.gain_rate;
        for Harmonic { order, table, .. } in &self.harmonics {
            let (sin, cos) = (order * wave.phase).sin_cos();
            let turning = order * size * wave.phase_rate;
            for ((given, rate), [c, s]) in given.iter_mut().zip(&mut *rate).zip(table) {
                let value = c * sin - s * cos;
                *given += size * value;
                *rate += turning * (c * cos + s * sin) + growing * value;
            }
        }
    }

    fn add_derivatives(&self, [value, first, second]: [f64; 3], phase: f64, out: &mut [f64]) {
        for Harmonic { order, table, .. } in &self.harmonics {
            let (sin, cos) = (order * phase).sin_cos();
            let (even, odd) = (value - order * order * second, order * first);
            for (out, [c, s]) in out.iter_mut().zip(table) {
                *out += even * (c * sin - s * cos) + odd * (c * cos + s * sin);
            }
        }
    }

    fn add_filtered(&self, factor: &dyn Fn(f64) -> Complex<f64>, phase: f64, out: &mut [f64]) {
        for Harmonic { order, table, .. } in &self.harmonics {
            let Complex { re: cos, im: sin } = factor(*order) * Complex::cis(order * phase);
            out.iter_mut().zip(table).for_each(|(out, [c, s])| *out += c * sin - s * cos);
        }
    }

    fn filtered(&self, factor: &dyn Fn(f64) -> Complex<f64>, _nodes: usize) -> Box<dyn Actuation> {
        let part = |Harmonic { order, size, table }: &Harmonic| {
            let factor = factor(*order);
            let table = table.iter().map(|[c, s]| {
                let turned = Complex::new(*c, -s) * factor;
                [turned.re, -turned.im]
            });
            Harmonic { order: *order, size: size * factor.norm(), table: table.collect() }
        };
        Box::new(Self { harmonics: self.harmonics.iter().map(part).collect(), ..*self })
    }

    fn fastest(&self) -> f64 {
        self.fastest
    }

    fn harmonics(&self) -> Vec<(f64, f64)> {
        self.harmonics.iter().map(|harmonic| (harmonic.order, harmonic.size)).collect()
    }

    fn wavelength(&self) -> Option<f64> {
        Some(self.wavelength).filter(|wavelength| wavelength.is_finite())
    }

    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation> {
        let turned = |Harmonic { order, size, table }: &Harmonic| {
            let turn = |(([c, s], factor), phase): ((&[f64; 2], &f64), &f64)| {
                let (sin, cos) = (order * phase).sin_cos();
                [factor * (c * cos - s * sin), factor * (s * cos + c * sin)]
            };
            Harmonic { order: *order, size: *size, table: table.iter().zip(factors).zip(phases).map(turn).collect() }
        };
        Box::new(Self { harmonics: self.harmonics.iter().map(turned).collect(), ..*self })
    }
}
