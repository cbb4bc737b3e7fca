//! Standing wave: κ̄_k(t) = r κ_amp (ΔL/ℓ_ref)(e₀ + e₁ ξ_k) sin(2πft − φ₀). The whole rod bends at once, as one pair of muscles or one
//! piezoelectric strip bends it.

use super::{Kind, Recipe, TravellingWave};

/// This kind.
pub static KIND: Kind = Kind {
    name: "standing-wave",
    keys: &[],
    needs: &[],
    // A wave that is infinitely long.
    build: |recipe| Box::new(TravellingWave::new(&Recipe { wavelength: f64::INFINITY, ..*recipe })),
};
