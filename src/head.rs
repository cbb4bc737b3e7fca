//! How a held head moves: position and angle as functions of time, from a scene or from a host.

pub mod host;

use std::f64::consts::TAU;

pub use host::{HeadInput, HostHead};
use serde::{Deserialize, Serialize};

/// A value with its first and second rate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// The value.
    pub value: f64,
    /// Its rate, per s.
    pub rate: f64,
    /// The rate of that, per s².
    pub acceleration: f64,
}

/// A scalar function of time.
#[derive(Debug, Clone, PartialEq)]
pub enum Signal {
    /// Always the same.
    Constant(f64),
    /// offset + amplitude·sin(2πft + phase).
    Sinusoid {
        /// Amplitude.
        amplitude: f64,
        /// Frequency f, Hz.
        frequency: f64,
        /// Phase, rad.
        phase: f64,
        /// Offset.
        offset: f64,
    },
    /// Cubic Hermite between rows; the first and last value are held outside.
    Table(Vec<Row>),
}

/// A row of a table: time (s), value and rate (per s).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Time, s.
    pub time: f64,
    /// Value.
    pub value: f64,
    /// Rate, per s.
    pub rate: f64,
}

impl Signal {
    /// A table without rates: each row's rate is that of the parabola through it and its neighbours.
    pub fn table_without_rates(points: &[[f64; 2]]) -> Self {
        let slope = |a: usize, b: usize| (points[b][1] - points[a][1]) / (points[b][0] - points[a][0]);
        let rate = |k: usize| match points.len() {
            1 => 0.0,
            2 => slope(0, 1),
            n => {
                let b = k.clamp(1, n - 2);
                let (a, c) = (b - 1, b + 1);
                let curve = (slope(b, c) - slope(a, b)) / (points[c][0] - points[a][0]);
                slope(a, b) + curve * (2.0 * points[k][0] - points[a][0] - points[b][0])
            }
        };
        let row = |(k, &[time, value]): (usize, &[f64; 2])| Row { time, value, rate: rate(k) };
        Self::Table(points.iter().enumerate().map(row).collect())
    }

    /// The root mean square over its period, or over the rows of a table.
    pub fn root_mean_square(&self) -> f64 {
        match self {
            Self::Constant(value) => value.abs(),
            Self::Sinusoid { amplitude, frequency, phase, offset } if *frequency == 0.0 => {
                (offset + amplitude * phase.sin()).abs()
            }
            Self::Sinusoid { amplitude, offset, .. } => offset.hypot(amplitude * std::f64::consts::FRAC_1_SQRT_2),
            Self::Table(rows) => {
                (rows.iter().map(|row| row.value * row.value).sum::<f64>() / rows.len().max(1) as f64).sqrt()
            }
        }
    }

    /// Its integral from time zero to `t` (s).
    pub fn integral(&self, t: f64) -> f64 {
        match self {
            Self::Constant(value) => value * t,
            Self::Sinusoid { amplitude, frequency, phase, offset } => {
                let half = std::f64::consts::PI * frequency * t;
                // The mean of the sine over the time is that of its middle, less by sin(x)/x.
                let part = if half == 0.0 { 1.0 } else { half.sin() / half };
                (offset + amplitude * part * (half + phase).sin()) * t
            }
            Self::Table(rows) => {
                let mut times: Vec<f64> =
                    rows.iter().map(|row| row.time).filter(|time| *time > t.min(0.0) && *time < t.max(0.0)).collect();
                times.insert(0, t.min(0.0));
                times.push(t.max(0.0));
                let part = |span: &[f64]| {
                    // Cubic between rows, so that Simpson's rule is exact.
                    let [from, to] = [span[0], span[1]];
                    (self.at(from).value + 4.0 * self.at(0.5 * (from + to)).value + self.at(to).value) * (to - from)
                        / 6.0
                };
                times.windows(2).map(part).sum::<f64>() * t.signum()
            }
        }
    }

    /// The signal at time `t` (s).
    pub fn at(&self, t: f64) -> Sample {
        match self {
            Self::Constant(value) => Sample { value: *value, ..Sample::default() },
            Self::Sinusoid { amplitude, frequency, phase, offset } => {
                let omega = TAU * frequency;
                let (sin, cos) = (omega * t + phase).sin_cos();
                Sample {
                    value: offset + amplitude * sin,
                    rate: amplitude * omega * cos,
                    acceleration: -amplitude * omega * omega * sin,
                }
            }
            Self::Table(rows) => {
                let after = rows.partition_point(|row| row.time <= t);
                match (rows.get(after.wrapping_sub(1)), rows.get(after)) {
                    (Some(from), Some(to)) => hermite(from, to, t),
                    (Some(row), None) if row.time == t => {
                        Sample { value: row.value, rate: row.rate, acceleration: 0.0 }
                    }
                    (Some(row), None) | (None, Some(row)) => Sample { value: row.value, ..Sample::default() },
                    (None, None) => Sample::default(),
                }
            }
        }
    }
}

/// The cubic with the values and rates of `from` and `to`, at time `t`.
pub fn hermite(from: &Row, to: &Row, t: f64) -> Sample {
    let span = to.time - from.time;
    let z = (t - from.time) / span;
    let mean = (to.value - from.value) / span;
    // value = from + span (r z + c z² + d z³)
    let (r, c, d) = (from.rate, 3.0 * mean - 2.0 * from.rate - to.rate, from.rate + to.rate - 2.0 * mean);
    Sample {
        value: from.value + span * z * (r + z * (c + z * d)),
        rate: r + z * (2.0 * c + z * 3.0 * d),
        acceleration: (2.0 * c + 6.0 * d * z) / span,
    }
}

/// Position x, y (m) and angle from +x (rad) of a held head.
pub type Pose = [Sample; 3];

/// The motion of a held head: x (m), y (m) and angle (rad).
pub type Motion = [Signal; 3];

/// The pose of `motion` at time `t` (s).
pub fn pose(motion: &Motion, t: f64) -> Pose {
    [motion[0].at(t), motion[1].at(t), motion[2].at(t)]
}
