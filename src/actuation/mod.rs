//! Actuation: natural curvature prescribed along the rod, one kind a file.

pub mod travelling_wave;

pub use travelling_wave::TravellingWave;

/// Where a drive is in its cycle: natural curvature is `gain`·`amplitude` times a function of `phase` alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Amplitude κ_amp, in the kind's own unit.
    pub amplitude: f64,
    /// Start gain r(t), 0 … 1.
    pub gain: f64,
    /// dr/dt, 1/s.
    pub gain_rate: f64,
    /// Phase 2πft − φ₀, rad.
    pub phase: f64,
    /// Its rate 2πf, rad/s.
    pub phase_rate: f64,
}

/// A kind of actuation.
pub trait Actuation: std::fmt::Debug + Send + Sync {
    /// Adds the dimensionless natural curvature κ̄_k to `natural` and dκ̄_k/dt (1/s) to `rate`, one entry a node; a
    /// whole joint's worth at every node, the caller halves where a joint is half.
    fn add(&self, wave: Wave, natural: &mut [f64], rate: &mut [f64]);

    /// Adds `sizes[i]` times the `i`-th derivative by phase of that function of `phase` (rad) to `out`, one entry a node.
    fn add_derivatives(&self, sizes: [f64; 3], phase: f64, out: &mut [f64]);

    /// Wavelength λ along the rod, m, where it has one.
    fn wavelength(&self) -> Option<f64> {
        None
    }

    /// The same with its amplitude times `factors`, and `phases` (rad) subtracted inside its function of phase, one entry a
    /// node.
    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation>;
}
