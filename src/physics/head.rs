//! How a held head moves: position and angle as functions of time, from a scene or from a host.

pub mod hinge;
pub mod pose_extrapolation;

use std::f64::consts::TAU;

pub use hinge::{Hinge, MotorCommand};
pub use pose_extrapolation::{HeadInput, HostHead, RedundantHeadInputs};
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

/// The smallest number of steps that resolve a period of the drive, or a ramp.
pub const RESOLVING_STEPS_PER_PERIOD: f64 = 16.0;

/// The fewest steps between two rows of a table where rows are too far apart to be foretold by their neighbours.
const STEPS_PER_ROW: f64 = 8.0;

/// The fewest steps over rows that are foretold by the first and the last of them.
const STEPS_PER_INTERPOLATED_SPAN: f64 = 3.0;

/// Rows are foretold where the cubic misses them by no more than this part of how far they are from an even motion between the
/// first and the last: of a sinusoid they go over a twelfth to a sixth of its period.
const INTERPOLATION_TOLERANCE: f64 = 2.6e-2;

/// Rounding of rows, in parts of the largest of their values.
const ROW_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A row of a table that is no further than this part of the distance between rows is reached.
const ROW_TIME_TOLERANCE: f64 = 1e-9;

/// A second rate that changes at a row by more than this part of it jumps there.
const MIN_ACCELERATION_JUMP: f64 = 1e-2;

/// Where it changes by more than this part of it, another motion begins: what it does is not known from its first step.
const MAX_RELATIVE_JUMP: f64 = 0.5;

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

    /// Its value, where that is always the same.
    pub fn constant(&self) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            _ => None,
        }
    }

    /// The least and the largest value, of a table those of its rows.
    pub fn range(&self) -> [f64; 2] {
        match self {
            Self::Constant(value) => [*value; 2],
            Self::Sinusoid { amplitude, offset, .. } => [offset - amplitude.abs(), offset + amplitude.abs()],
            Self::Table(rows) => range(rows.iter().map(|row| row.value)),
        }
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

    /// The longest step (s) from time `t` (s) that resolves it, whatever its size, or one of at least `wanted` (s).
    pub fn longest_step(&self, t: f64, wanted: f64) -> f64 {
        match self {
            Self::Sinusoid { amplitude, frequency, .. } if *amplitude != 0.0 && *frequency != 0.0 => {
                1.0 / (RESOLVING_STEPS_PER_PERIOD * frequency.abs())
            }
            Self::Constant(_) | Self::Sinusoid { .. } => f64::INFINITY,
            Self::Table(rows) => longest_in_table(rows, t, wanted),
        }
    }

    /// Half of the range of its rate, which does not change if a constant speed is added to the motion.
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

    /// The signal at time `t` (s) as it comes there: at a row of a table its second rate is that of the rows before.
    pub fn before(&self, t: f64) -> Sample {
        if let Self::Table(rows) = self {
            let next = row_at(rows, t).unwrap_or_else(|| rows.partition_point(|row| row.time < t));
            if let (Some(from), Some(to)) = (rows.get(next.wrapping_sub(1)), rows.get(next)) {
                return hermite(from, to, t);
            }
        }
        self.at(t)
    }

    /// True where its second rate jumps at time `t` (s): at a row of a table.
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

/// Least and largest of `values`.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], x| [least.min(x), most.max(x)])
}

/// The row that is reached at time `t` (s), or was just then, but for rounding.
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

/// True where the second rate changes at row `at` by more than this `part` of it.
fn jumps(rows: &[Row], at: usize, part: f64) -> bool {
    let Some([from, row, to]) = at.checked_sub(1).and_then(|before| rows.get(before..before + 3)) else { return false };
    let [before, after] = [hermite(from, row, row.time), hermite(row, to, row.time)].map(|sample| sample.acceleration);
    (after - before).abs() > part * before.abs().max(after.abs())
}

/// The longest step (s) from time `t` (s) in a table: to the next row where it rests or moves evenly, else a part of the way between rows, or
/// of the way over as many rows as the cubic through the first and the last of them foretells. The same for a motion that goes on
/// at some speed beside it. No more rows are looked at than a step of `wanted` (s) needs.
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
    // What is beyond the rows that were looked at may be a burst.
    longest.min(reached - t)
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
pub type HeadMotion = [Signal; 3];

/// The pose of `motion` at time `t` (s).
pub fn pose(motion: &HeadMotion, t: f64) -> Pose {
    motion.each_ref().map(|signal| signal.at(t))
}

/// The same as it comes there, see [`Signal::before`].
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
        // A cubic is foretold as far as its rows are doubled: from 0 over 1, 2, 3, 5 and 9 of 10 rows.
        let cubic = rows((0..=10).map(f64::from), |t| [t * t * t, 3.0 * t * t]);
        assert_eq!(longest_in_table(&cubic, 0.0), 9.0 / 3.0);
        assert_eq!(longest_in_table(&cubic, 0.5), 9.0 / 3.0);
        // What shakes from row to row is not foretold.
        let shaken = rows((0..=10).map(f64::from), |t| [(2.0 * t).sin(), 2.0 * (2.0 * t).cos()]);
        assert_eq!(longest_in_table(&shaken, 2.0), 1.0 / 8.0);
        // At rest and in even motion the next row is the limit, before and after all rows the first of them and nothing.
        let even = rows((0..=4).map(f64::from), |t| [2.0 * t, 2.0]);
        assert_eq!([longest_in_table(&even, 1.25), longest_in_table(&even, -3.0)], [0.75, 3.0]);
        assert_eq!(longest_in_table(&even, 4.0), f64::INFINITY);
        // Of a step that is short enough for one row nothing more is told.
        assert_eq!(longest(&cubic, 0.0, 0.1), 1.0 / 8.0);
        assert_eq!(longest(&cubic, 0.0, 1.5), 5.0 / 3.0);
    }
}
