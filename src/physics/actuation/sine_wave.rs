//! Sine wave: the curvature of the curve y = b sin(kx − ωt) travelling along its own arc:
//! κ̄_k(t) = r ΔL (e₀ + e₁ ξ_k) κ(ψ_k), ψ_k = 2πft − φ₀ − 2πs_k/λ,
//! where λ is the wavelength along the rod and `slope` is the maximum slope, bk. The amplitude that a host sets, 1 by
//! default, multiplies the curvature.
//!
//! With X = ωt − kx, κ = bk² sin X/(1 + b²k² cos² X)^{3/2} and dψ/dX = (2π/S)(1 + b²k² cos² X)^½, where S = kλ is the
//! integral of that root over a period. κ is odd in ψ and even about its crest, so it is a series of odd sines of ψ,
//! whose coefficients decay geometrically. Those below rounding are omitted. For a small slope it is the travelling
//! wave of amplitude bk².

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{ActuationKind, TravellingWave};

/// The entry of this kind in the list of kinds.
pub static KIND: ActuationKind = ActuationKind {
    name: "sine-wave",
    keys: &["wavelength_m", "slope"],
    needs: &["wavelength_m", "slope"],
    build: |inputs| Box::new(TravellingWave::of(inputs, 1.0, harmonics(inputs.slope, inputs.wavelength).into_iter())),
};

/// Maximum slope; with it, harmonics up to about the 200th count.
pub const STEEPEST: f64 = 4.0;

/// Harmonics smaller than this fraction of the first are omitted.
const LEAST: f64 = 1e-14;

/// Highest order that is considered.
const HIGHEST: u32 = 399;
/// Number of intervals in a quarter of a wave.
const PARTS: usize = 512;

/// Nodes and weights of the three-point Gauss rule on 0 … 1.
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// The harmonics (n, 1/m) of the curvature of a sine with this maximum slope and `wavelength` (m) along its arc.
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
    // 4/π times the integral of κ sin nψ dψ over a quarter. The integrand is periodic, so the trapezoidal rule in X is
    // exact to rounding.
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
