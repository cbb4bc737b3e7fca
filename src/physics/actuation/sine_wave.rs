//! Sine wave: the curvature of the curve y = b sin(kx − ωt), which passes along its own arc: κ̄_k(t) = r ΔL (e₀ + e₁ ξ_k) κ(ψ_k),
//! ψ_k = 2πft − φ₀ − 2πs_k/λ, where a wave is λ long along the rod and `slope` is its steepest, bk. A host's amplitude, 1 until
//! it says otherwise, multiplies that.
//!
//! With X = ωt − kx, κ = bk² sin X/(1 + b²k² cos² X)^{3/2} and dψ/dX = (2π/S)(1 + b²k² cos² X)^½, S = kλ being the integral of that
//! root over a period. κ is odd in ψ and even about its crest, so it is a sum of the odd sines of ψ, and their sizes fall
//! geometrically; what is below rounding is left out. A small slope makes it the travelling wave of amplitude bk².

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{ActuationKind, TravellingWave};

/// The entry of this kind in the list of kinds.
pub static KIND: ActuationKind = ActuationKind {
    name: "sine-wave",
    keys: &["wavelength_m", "slope"],
    needs: &["wavelength_m", "slope"],
    build: |inputs| Box::new(TravellingWave::of(inputs, 1.0, harmonics(inputs.slope, inputs.wavelength).into_iter())),
};

/// The steepest slope: harmonics up to about the 200th count then.
pub const STEEPEST: f64 = 4.0;

/// A smaller part of the first harmonic is none.
const LEAST: f64 = 1e-14;

/// The highest order that is looked at, and parts of a quarter of a wave.
const HIGHEST: u32 = 399;
const PARTS: usize = 512;

/// Places and weights of Gauss's rule of three points on 0 … 1.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// The harmonics (n, 1/m) of the curvature of a sine of this largest slope that is `wavelength` (m) long along its arc.
fn harmonics(slope: f64, wavelength: f64) -> Vec<(f64, f64)> {
    let root = |x: f64| (1.0 + (slope * x.cos()).powi(2)).sqrt();
    let part = FRAC_PI_2 / PARTS as f64;
    // (X, arc length from X = 0) in units of 1/k, up to the crest.
    let mut places = Vec::with_capacity(PARTS);
    let mut arc = 0.0;
    for i in 0..PARTS {
        let from = part * i as f64;
        arc += part * GAUSS.iter().map(|(at, weight)| weight * root(from + part * at)).sum::<f64>();
        places.push((part * (i + 1) as f64, arc));
    }
    let whole = 4.0 * arc;
    let wavenumber = whole / wavelength;
    // (4/π) of the integral of κ sin nψ dψ over a quarter; the trapezoidal rule in X is exact to rounding, as all is periodic.
    let values: Vec<(f64, f64)> = places
        .iter()
        .map(|(x, arc)| {
            let weight = if *x < FRAC_PI_2 - 0.5 * part { 1.0 } else { 0.5 };
            let curvature = slope * wavenumber * x.sin() / root(*x).powi(2); // κ dψ/dX S/2π
            (TAU / whole * arc, 4.0 / PI * part * TAU / whole * weight * curvature)
        })
        .collect();
    let size = |order: u32| values.iter().map(|(psi, value)| value * (f64::from(order) * psi).sin()).sum::<f64>();
    let first = size(1);
    let mut all = vec![(1.0, first)];
    all.extend(
        (3..=HIGHEST)
            .step_by(2)
            .map(|order| (f64::from(order), size(order)))
            .take_while(|(_, size)| size.abs() > LEAST * first),
    );
    all
}
