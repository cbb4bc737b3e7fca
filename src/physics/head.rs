//! Motion of a held head: position and angle as functions of time, from a scene or a host.

pub mod hinge;
pub mod pose_extrapolation;

use std::f64::consts::TAU;

pub use hinge::{Hinge, MotorCommand};
pub use pose_extrapolation::{HeadInput, HostHead, RedundantHeadInputs};
use serde::{Deserialize, Serialize};

/// A value with its first and second time derivatives.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sample {
    /// The value.
    pub value: f64,
    /// First derivative, per s.
    pub rate: f64,
    /// Second derivative, per s².
    pub acceleration: f64,
}

/// Minimum number of steps per period of the drive, or per ramp.
pub const RESOLVING_STEPS_PER_PERIOD: f64 = 16.0;

/// Minimum number of steps between two rows of a table if their neighbours do not predict them.
const STEPS_PER_ROW: f64 = 8.0;

/// Minimum number of steps over rows that are predicted by the first and the last of them.
const STEPS_PER_INTERPOLATED_SPAN: f64 = 3.0;

/// Rows are predicted if the error of the cubic through the first and the last row is at most this fraction of the
/// rows' maximum distance from the straight line between the two. For a sinusoid such a span is a twelfth to a sixth of
/// its period.
const INTERPOLATION_TOLERANCE: f64 = 2.6e-2;

/// Rounding error of row values, relative to the largest of them.
const ROW_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A time within this fraction of the row spacing of a row counts as the time of the row.
const ROW_TIME_TOLERANCE: f64 = 1e-9;

/// The second derivative jumps at a row if it changes there by more than this fraction.
const MIN_ACCELERATION_JUMP: f64 = 1e-2;

/// If the second derivative changes by more than this fraction at a row, a new motion begins, and the step there does
/// not extend over several rows.
const MAX_RELATIVE_JUMP: f64 = 0.5;

/// A scalar function of time.
#[derive(Debug, Clone, PartialEq)]
pub enum Signal {
    /// A constant value.
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
    /// Cubic Hermite interpolation between rows; outside, the first or last value.
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
    /// A table without rates: the rate of a row is that of the parabola through it and its neighbours.
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

    /// The value of a constant signal.
    pub fn constant(&self) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            _ => None,
        }
    }

    /// Minimum and maximum; for a table, those of its rows.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Constant(value) => [*value; 2],
            Self::Sinusoid { amplitude, offset, .. } => [offset - amplitude.abs(), offset + amplitude.abs()],
            Self::Table(rows) => range(rows.iter().map(|row| row.value)),
        }
    }

    /// Root mean square over a period, or over the rows of a table.
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

    /// The integral from time zero to `t` (s).
    pub fn integral(&self, t: f64) -> f64 {
        match self {
            Self::Constant(value) => value * t,
            Self::Sinusoid { amplitude, frequency, phase, offset } => {
                let half = std::f64::consts::PI * frequency * t;
                // The mean of the sine over the interval is its value at the midpoint times sin(x)/x.
                let part = if half == 0.0 { 1.0 } else { half.sin() / half };
                (offset + amplitude * part * (half + phase).sin()) * t
            }
            Self::Table(rows) => {
                let mut times: Vec<f64> =
                    rows.iter().map(|row| row.time).filter(|time| *time > t.min(0.0) && *time < t.max(0.0)).collect();
                times.insert(0, t.min(0.0));
                times.push(t.max(0.0));
                let part = |span: &[f64]| {
                    // The signal is cubic between rows, so Simpson's rule is exact.
                    let [from, to] = [span[0], span[1]];
                    (self.at(from).value + 4.0 * self.at(0.5 * (from + to)).value + self.at(to).value) * (to - from)
                        / 6.0
                };
                times.windows(2).map(part).sum::<f64>() * t.signum()
            }
        }
    }

    /// The longest step (s) from time `t` (s) that resolves the signal, whatever its amplitude. The search stops at
    /// steps of `wanted` (s) or more.
    pub fn longest_step(&self, t: f64, wanted: f64) -> f64 {
        match self {
            Self::Sinusoid { amplitude, frequency, .. } if *amplitude != 0.0 && *frequency != 0.0 => {
                1.0 / (RESOLVING_STEPS_PER_PERIOD * frequency.abs())
            }
            Self::Constant(_) | Self::Sinusoid { .. } => f64::INFINITY,
            Self::Table(rows) => longest_in_table(rows, t, wanted),
        }
    }

    /// Half the range of the rate. Adding a constant speed to the motion does not change it.
    pub fn rate_amplitude(&self) -> f64 {
        match self {
            Self::Constant(_) => 0.0,
            Self::Sinusoid { amplitude, frequency, .. } => (TAU * amplitude * frequency).abs(),
            Self::Table(rows) => {
                let middle = |span: &[Row]| hermite(&span[0], &span[1], 0.5 * (span[0].time + span[1].time)).rate;
                let [least, most] = range(rows.iter().map(|row| row.rate).chain(rows.windows(2).map(middle)));
                if least < most { 0.5 * (most - least) } else { 0.0 }
            }
        }
    }

    /// The left-hand limit of the signal at time `t` (s): at a row of a table, the second derivative is that of the
    /// interval before.
    pub fn before(&self, t: f64) -> Sample {
        if let Self::Table(rows) = self {
            let next = row_at(rows, t).unwrap_or_else(|| rows.partition_point(|row| row.time < t));
            if let (Some(from), Some(to)) = (rows.get(next.wrapping_sub(1)), rows.get(next)) {
                return hermite(from, to, t);
            }
        }
        self.at(t)
    }

    /// True if the second derivative jumps at time `t` (s), at a row of a table.
    pub fn jumps_at(&self, t: f64) -> bool {
        let Self::Table(rows) = self else { return false };
        row_at(rows, t).is_some_and(|at| jumps(rows, at, MIN_ACCELERATION_JUMP))
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
                let after = match row_at(rows, t) {
                    Some(at) if at + 1 < rows.len() => at + 1,
                    _ => rows.partition_point(|row| row.time <= t),
                };
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

/// Minimum and maximum of `values`.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| [least.min(x), most.max(x)])
}

/// The row whose time is `t` (s), up to rounding.
fn row_at(rows: &[Row], t: f64) -> Option<usize> {
    let after = rows.partition_point(|row| row.time <= t);
    let [from, to] = [after.wrapping_sub(1), after].map(|at| rows.get(at));
    let near = from.zip(to).map_or(0.0, |(from, to)| ROW_TIME_TOLERANCE * (to.time - from.time));
    if from.is_some_and(|from| t - from.time <= near) {
        Some(after - 1)
    } else {
        to.filter(|to| to.time - t <= near).map(|_| after)
    }
}

/// True if the second derivative changes by more than the fraction `part` at row `at`.
fn jumps(rows: &[Row], at: usize, part: f64) -> bool {
    let Some([from, row, to]) = at.checked_sub(1).and_then(|before| rows.get(before..before + 3)) else { return false };
    let [before, after] = [hermite(from, row, row.time), hermite(row, to, row.time)].map(|sample| sample.acceleration);
    (after - before).abs() > part * before.abs().max(after.abs())
}

/// The longest step (s) from time `t` (s) in a table. It ends at the next row if the signal is constant or linear up to
/// there. Otherwise it is a fraction of the row spacing, or of the time over as many rows as the cubic through the
/// first and the last of them predicts. Adding a constant speed to the motion does not change it. No more rows are
/// examined than a step of `wanted` (s) needs.
fn longest_in_table(rows: &[Row], t: f64, wanted: f64) -> f64 {
    let at = row_at(rows, t);
    let after = at.map_or_else(|| rows.partition_point(|row| row.time <= t), |at| at + 1);
    let Some(next) = rows.get(after) else { return f64::INFINITY };
    let Some(from) = rows.get(after.wrapping_sub(1)) else { return next.time - t };
    let span = next.time - from.time;
    let moved = next.value - from.value;
    let rounding = ROW_ROUNDING * from.value.abs().max(next.value.abs());
    if [from, next].iter().all(|row| (row.rate * span - moved).abs() <= rounding) {
        return next.time - t;
    }
    let (mut longest, mut reached) = (span / STEPS_PER_ROW, next.time);
    if at.is_some_and(|at| jumps(rows, at, MAX_RELATIVE_JUMP)) {
        return longest;
    }
    for count in (0..).map(|power| 1_usize << power) {
        if longest.min(reached - t) >= wanted {
            break;
        }
        let Some([between @ .., last]) = rows.get(after..after + count + 1) else { break };
        let mean = (last.value - from.value) / (last.time - from.time);
        let evenly = |row: &Row| from.value + mean * (row.time - from.time);
        let most = |of: &dyn Fn(&Row) -> f64| between.iter().map(of).fold(0.0, |max: f64, x| max.max(x.abs()));
        let rounding = ROW_ROUNDING * most(&|row| row.value).max(from.value.abs()).max(last.value.abs());
        let near = INTERPOLATION_TOLERANCE * most(&|row| row.value - evenly(row)) + rounding;
        if most(&|row| hermite(from, last, row.time).value - row.value) > near {
            break;
        }
        longest = longest.max((last.time - from.time) / STEPS_PER_INTERPOLATED_SPAN);
        reached = last.time;
    }
    // There may be a burst beyond the examined rows.
    longest.min(reached - t)
}

/// The cubic Hermite polynomial through the values and rates of `from` and `to`, at time `t`.
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
pub type HeadMotion = [Signal; 3];

/// The pose of `motion` at time `t` (s).
pub fn pose(motion: &HeadMotion, t: f64) -> Pose {
    motion.each_ref().map(|signal| signal.at(t))
}

/// The left-hand limit of the pose at time `t` (s), see [`Signal::before`].
pub fn pose_before(motion: &HeadMotion, t: f64) -> Pose {
    motion.each_ref().map(|signal| signal.before(t))
}

#[cfg(test)]
mod tests {
    use super::{Row, longest_in_table as longest};

    fn longest_in_table(rows: &[Row], t: f64) -> f64 {
        longest(rows, t, f64::INFINITY)
    }

    fn rows(times: impl Iterator<Item = f64>, of: impl Fn(f64) -> [f64; 2]) -> Vec<Row> {
        times.map(|time| Row { time, value: of(time)[0], rate: of(time)[1] }).collect()
    }

    #[test]
    fn the_longest_step_in_a_table_is_a_third_of_the_rows_that_a_cubic_foretells_or_an_eighth_of_one() {
        // The cubic predicts all rows, and spans grow by doubling: from row 0 to rows 1, 2, 3, 5 and 9 of 10.
        let cubic = rows((0..=10).map(f64::from), |t| [t * t * t, 3.0 * t * t]);
        assert_eq!(longest_in_table(&cubic, 0.0), 9.0 / 3.0);
        assert_eq!(longest_in_table(&cubic, 0.5), 9.0 / 3.0);
        // A fast oscillation is not predicted.
        let shaken = rows((0..=10).map(f64::from), |t| [(2.0 * t).sin(), 2.0 * (2.0 * t).cos()]);
        assert_eq!(longest_in_table(&shaken, 2.0), 1.0 / 8.0);
        // In linear motion the next row is the limit; before all rows the first row, after all rows none.
        let even = rows((0..=4).map(f64::from), |t| [2.0 * t, 2.0]);
        assert_eq!([longest_in_table(&even, 1.25), longest_in_table(&even, -3.0)], [0.75, 3.0]);
        assert_eq!(longest_in_table(&even, 4.0), f64::INFINITY);
        // If one row interval allows the wanted step, no further rows are examined.
        assert_eq!(longest(&cubic, 0.0, 0.1), 1.0 / 8.0);
        assert_eq!(longest(&cubic, 0.0, 1.5), 5.0 / 3.0);
    }
}
