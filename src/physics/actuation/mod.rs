//! Actuation: a wave of natural curvature or of active moment prescribed along the rod, one kind per file.
//!
//! A kind assigns a number to each joint. If the scene has `kappa_amp`, it is the dimensionless natural curvature κ̄_k.
//! If it has `moment_amp_n_m`, it is the active moment M_k in N m, which bends the joint against its stiffness:
//! m_k = B_k κ_k − M_k.

pub mod lag;
pub mod saturation;
pub mod sine_wave;
pub mod standing_wave;
pub mod travelling_wave;

use std::f64::consts::TAU;

use nalgebra::Complex;

pub use saturation::Saturation;
pub use travelling_wave::TravellingWave;

/// All kinds of actuation. To add one, write its file and list it here.
pub static KINDS: &[&ActuationKind] = &[&travelling_wave::KIND, &standing_wave::KIND, &sine_wave::KIND];

/// An entry in the list of kinds: its name and keys, and its constructor.
pub struct ActuationKind {
    /// Name in a scene.
    pub name: &'static str,
    /// The keys of `[actuation]` that it accepts in addition to those of every kind.
    pub keys: &'static [&'static str],
    /// Those of them that are required; `moment_amp_n_m` may replace `kappa_amp`.
    pub needs: &'static [&'static str],
    /// The actuation.
    pub build: fn(&ActuationInputs<'_>) -> Box<dyn Actuation>,
}

impl std::fmt::Debug for ActuationKind {
    /// The name only, which is the same in every run of the program.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for ActuationKind {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl ActuationKind {
    /// The kind of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        KINDS.iter().copied().find(|kind| kind.name == name)
    }
}

/// The inputs from which actuations are built. Those that a kind lists in [`ActuationKind::needs`] are present.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActuationInputs<'a> {
    /// Number of nodes.
    pub nodes: usize,
    /// Node at which the rod begins: 1 behind a body, see [`Rod::front`](crate::rod::Rod::front).
    pub front: usize,
    /// Node spacing, m.
    pub spacing: f64,
    /// [e₀, e₁] of the amplitude e₀ + e₁ξ along the rod.
    pub envelope: [f64; 2],
    /// ℓ_ref, m. An amplitude is a turning angle per ℓ_ref, so 1 m makes it a curvature in 1/m. For moments it is the
    /// spacing, so that the amplitude is the moment of a joint.
    pub reference_length: f64,
    /// `wavelength_m`.
    pub wavelength: f64,
    /// `harmonics`: the sizes of the second, third, … relative to the first.
    pub harmonics: &'a [f64],
    /// `slope`.
    pub slope: f64,
}

impl ActuationInputs<'_> {
    /// Arc length of node `k` in units of the spacing.
    pub fn place(&self, k: usize) -> f64 {
        k.saturating_sub(self.front) as f64
    }

    /// ξ of node `k`.
    pub fn xi(&self, k: usize) -> f64 {
        self.place(k) / (self.nodes - self.front - 1) as f64
    }
}

/// The phase and amplitude of a drive. The value at a joint is `gain`·`amplitude` times a function of `phase` alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wave {
    /// Amplitude, in the kind's own unit.
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

/// The factor by which `harmonics` (n, h_n) increase the number of steps that resolve the phase of a sum of sines. A
/// third-order method resolves the rate n h_n of each harmonic as well as the largest of the rates if its steps are
/// n (n h_n/max n h_n)^⅓ times shorter.
pub(crate) fn fastest(harmonics: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let rate = |(order, size): (f64, f64)| (order * size).abs();
    let most = harmonics.clone().map(rate).fold(0.0, f64::max);
    let part = |harmonic: (f64, f64)| harmonic.0 * (rate(harmonic) / most).cbrt();
    harmonics.map(part).fold(1.0, f64::max)
}

/// A kind of actuation.
pub trait Actuation: std::fmt::Debug + Send + Sync {
    /// Adds the dimensionless natural curvature κ̄_k or the active moment M_k (N m) of each joint to `given`, and its
    /// rate (per s) to `rate`, one entry per node. The values are those of full joints; the caller halves a curvature
    /// at a half-cell joint.
    fn add(&self, wave: Wave, given: &mut [f64], rate: &mut [f64]);

    /// Adds Σ_i `sizes[i]` times the `i`-th derivative of that function with respect to `phase` (rad) to `out`, one
    /// entry per node.
    fn add_derivatives(&self, sizes: [f64; 3], phase: f64, out: &mut [f64]);

    /// The factor by which harmonics increase the number of steps that resolve the phase; 1 without harmonics.
    fn fastest(&self) -> f64 {
        1.0
    }

    /// Order n and relative size of every harmonic of that function.
    fn harmonics(&self) -> Vec<(f64, f64)> {
        vec![(1.0, 1.0)]
    }

    /// Wavelength λ along the rod, m, if there is one.
    fn wavelength(&self) -> Option<f64> {
        None
    }

    /// Adds the imaginary part of `factor`(n) c_n e^{inφ} for each harmonic of order n of that function of `phase` φ
    /// (rad) to `out`, one entry per node. The default implementation evaluates the function at as many phases as its
    /// [`harmonics`](Self::harmonics) of integer order require.
    fn add_filtered(&self, factor: &dyn Fn(f64) -> Complex<f64>, phase: f64, out: &mut [f64]) {
        let harmonics = self.harmonics();
        let count = 2.0 * harmonics.iter().fold(1.0, |most: f64, (order, _)| most.max(*order)) + 1.0;
        for j in 0..count as u32 {
            let at = TAU * f64::from(j) / count;
            let part = |(order, _): &(f64, f64)| (factor(*order) * Complex::cis(order * (phase - at))).re;
            let weight = 2.0 / count * harmonics.iter().map(part).sum::<f64>();
            self.add_derivatives([weight, 0.0, 0.0], at, out);
        }
    }

    /// This actuation with each harmonic multiplied by `factor`(n). By default all of them are filtered like the first
    /// one.
    fn filtered(&self, factor: &dyn Fn(f64) -> Complex<f64>, nodes: usize) -> Box<dyn Actuation> {
        let (size, angle) = factor(1.0).to_polar();
        self.profiled(&vec![size; nodes], &vec![-angle; nodes])
    }

    /// This actuation with its amplitude multiplied by `factors`, and `phases` (rad) subtracted in its function of
    /// phase, one entry per node.
    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation>;
}
