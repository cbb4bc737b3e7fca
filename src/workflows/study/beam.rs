//! Theory of flutter: a uniform cantilever beam in axial flow, clamped at the upstream end, by the Galerkin method.
//!
//! EI(y⁗ + τ ẏ⁗) + m_a U² y″ + 2 m_a U ẏ′ + (m + m_a) ÿ = 0, which also describes a pipe that conveys fluid; τ is the damping time
//! of the material. The wake takes the share χ of the force m_a U(ẏ + U y′) that the water exerts when it leaves the tip. In units
//! of length L and time L²√((m + m_a)/EI), with u = U L √(m_a/EI), β = m_a/(m + m_a) and the damping time α, the Galerkin method
//! with the modes φ_i of the clamped beam and their wave numbers λ_i gives ÿ_i + αλ_i⁴ ẏ_i + 2u√β Σ(∫φ_i φ_j′ − ½fφ_i(1)φ_j(1)) ẏ_j +
//! λ_i⁴ y_i + u² Σ(∫φ_i φ_j″ − fφ_i(1)φ_j′(1)) y_j = 0, f = 1 − χ.
//!
//! Sources: R. W. Gregory & M. P. Païdoussis, Proc. R. Soc. A 293 (1966); M. P. Païdoussis, Fluid-Structure Interactions (1998).

use faer::{Mat, c64};

use super::root_search::first_crossing;

/// Number of modes.
const MODES: usize = 12;

/// Intervals of Simpson's rule.
const INTERVALS: usize = 2000;

/// The integrals of the Galerkin method.
#[derive(Debug)]
pub(super) struct Beam {
    wave_numbers: [f64; MODES],
    /// ∫φ_i φ_j′, ∫φ_i φ_j″.
    integrals: [[[f64; MODES]; MODES]; 2],
    /// φ_i(1), φ_i′(1).
    tip: [[f64; 2]; MODES],
}

/// φ, φ′, φ″ at `x` of the mode with this wave number.
fn mode(wave: f64, x: f64) -> [f64; 3] {
    // φ = cosh − cos − s(sinh − sin), without subtracting large numbers.
    let (sin, cos) = wave.sin_cos();
    let below = (sin - cos - (-wave).exp()) / (wave.sinh() + sin); // 1 − s
    let ratio = 1.0 - below;
    let (up, down) = (0.5 * below * (wave * x).exp(), 0.5 * (1.0 + ratio) * (-wave * x).exp());
    let (sin, cos) = (wave * x).sin_cos();
    [
        up + down - cos + ratio * sin,
        wave * (up - down + sin + ratio * cos),
        wave * wave * (up + down + cos - ratio * sin),
    ]
}

impl Beam {
    pub(super) fn new() -> Self {
        let wave_numbers = std::array::from_fn(|i| {
            // cosh λ cos λ = −1, by Newton's method on cos λ + 1/cosh λ.
            let mut wave = (i as f64 + 0.5) * std::f64::consts::PI;
            for _ in 0..20 {
                wave -= (wave.cos() + 1.0 / wave.cosh()) / (-wave.sin() - wave.tanh() / wave.cosh());
            }
            wave
        });
        let mut integrals = [[[0.0; MODES]; MODES]; 2];
        for point in 0..=INTERVALS {
            let x = point as f64 / INTERVALS as f64;
            let weight = match point {
                0 | INTERVALS => 1.0,
                odd if odd % 2 == 1 => 4.0,
                _ => 2.0,
            } / (3.0 * INTERVALS as f64);
            let modes = wave_numbers.map(|wave| mode(wave, x));
            for (i, of) in modes.iter().enumerate() {
                for (j, by) in modes.iter().enumerate() {
                    integrals[0][i][j] += weight * of[0] * by[1];
                    integrals[1][i][j] += weight * of[0] * by[2];
                }
            }
        }
        let tip = wave_numbers.map(|wave| {
            let [value, slope, _] = mode(wave, 1.0);
            [value, slope]
        });
        Self { wave_numbers, integrals, tip }
    }

    /// Growth rate σ and frequency ω of the fastest growing mode at the speed `u`, in units of time; `None` if the iteration fails.
    fn leading(&self, flow: &BeamInFlow, u: f64) -> Option<[f64; 2]> {
        let kept = 1.0 - flow.shedding;
        // In the time unit of the highest mode, so that both halves of the matrix are of similar size.
        let scale = self.wave_numbers[MODES - 1].powi(2);
        let beam = |i: usize, j: usize| if i == j { self.wave_numbers[i].powi(4) } else { 0.0 };
        let matrix = Mat::from_fn(2 * MODES, 2 * MODES, |row, column| match (row.checked_sub(MODES), column) {
            (None, column) => f64::from(u8::from(row + MODES == column)),
            (Some(i), j) if j < MODES => {
                let flow = self.integrals[1][i][j] - kept * self.tip[i][0] * self.tip[j][1];
                -(beam(i, j) + u * u * flow) / (scale * scale)
            }
            (Some(i), j) => {
                let j = j - MODES;
                let coriolis = 2.0 * self.integrals[0][i][j] - kept * self.tip[i][0] * self.tip[j][0];
                -(u * flow.mass_ratio.sqrt() * coriolis + flow.damping * beam(i, j)) / scale
            }
        });
        let values: Vec<c64> = matrix.eigenvalues().ok()?;
        let leading = values.into_iter().max_by(|a, b| a.re.total_cmp(&b.re))?;
        Some([leading.re * scale, leading.im.abs() * scale])
    }

    /// The smallest u, up to `most`, at which the straight beam is unstable.
    pub(super) fn critical(&self, flow: &BeamInFlow, most: f64) -> Option<f64> {
        let growth = |u: f64| self.leading(flow, u).map_or(f64::NEG_INFINITY, |[growth, _]| growth - GROWS);
        first_crossing(0.0, most, growth)
    }
}

/// Parameters that determine the flutter speed of a beam.
#[derive(Debug, Clone, Copy)]
pub(super) struct BeamInFlow {
    /// β.
    pub mass_ratio: f64,
    /// χ.
    pub shedding: f64,
    /// α.
    pub damping: f64,
}

/// Growth rates below this are rounding errors.
const GROWS: f64 = 1e-7;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beam_flutters_and_diverges_where_it_is_published_to() {
        let beam = Beam::new();
        let sharp = |mass_ratio: f64| BeamInFlow { mass_ratio, shedding: 1.0, damping: 0.0 };
        // Gregory and Paidoussis 5.6, 9.3, 13.5; more digits by an independent program.
        for (beta, published) in [(0.2, 5.5914), (0.5, 9.3224), (0.8, 13.493)] {
            let found = beam.critical(&sharp(beta), 20.0).unwrap_or(f64::NAN);
            // Measured: at most 4.5e-4, at 0.8.
            assert!((found / published - 1.0).abs() < 1e-3, "{beta}: {found}");
        }
        // Where the flutter of the second mode soon ends and that of the third begins, a narrow window lies between the samples.
        // Compared with a scan of 4000 speeds.
        for beta in [0.2935, 0.2945, 0.2955, 0.2965] {
            let speeds = (0..4000).map(|i| 20.0 * f64::from(i) / 4000.0);
            let grows = |u: &f64| beam.leading(&sharp(beta), *u).is_some_and(|[growth, _]| growth > GROWS);
            let scanned = { speeds }.find(grows).unwrap_or(f64::NAN);
            let found = beam.critical(&sharp(beta), 20.0).unwrap_or(f64::NAN);
            println!("β {beta}: {found}, scanned {scanned}");
            assert!((found - scanned).abs() < 6e-3, "{beta}: {found} {scanned}");
        }
        // cos u = 1 − 1/f.
        for kept in [1.0, 0.8, 0.6_f64] {
            let published = (1.0 - 1.0 / kept).acos();
            let found = beam.critical(&BeamInFlow { shedding: 1.0 - kept, ..sharp(0.5) }, 4.0).unwrap_or(f64::NAN);
            assert!((found / published - 1.0).abs() < 1e-3, "{kept}: {found}");
        }
    }
}
