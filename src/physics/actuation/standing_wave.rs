//! Standing wave: κ̄_k(t) = r κ_amp (ΔL/ℓ_ref)(e₀ + e₁ ξ_k) Σ_n h_n sin n(2πft − φ₀). The whole rod bends in phase, as
//! with one pair of muscles or one piezoelectric strip.

use super::{ActuationInputs, ActuationKind, TravellingWave};

/// The entry of this kind in the list of kinds.
pub static KIND: ActuationKind = ActuationKind {
    name: "standing-wave",
    keys: &["kappa_amp", "moment_amp_n_m", "kappa_reference_length_m", "harmonics"],
    needs: &["kappa_amp"],
    // A wave of infinite length.
    build: |inputs| Box::new(TravellingWave::new(&ActuationInputs { wavelength: f64::INFINITY, ..*inputs })),
};
