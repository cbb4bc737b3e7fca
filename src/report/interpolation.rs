//! Interpolation between rows of numbers at times.

use crate::head::{Row, hermite};

/// The numbers at a `time` between those at `rows` times that rise, by the cubic through the neighbours on both sides; the first or last
/// numbers outside, and none without rows.
pub fn interpolate(
    rows: usize,
    time: f64,
    time_of: impl Fn(usize) -> f64,
    value: impl Fn(usize, usize) -> f64,
    count: usize,
) -> Vec<f64> {
    let mut low = 0;
    let mut high = rows;
    while low < high {
        let middle = low.midpoint(high);
        if time_of(middle) <= time { low = middle + 1 } else { high = middle }
    }
    // `low` is the first row after the time.
    if low == 0 || low == rows {
        let nearest = low.saturating_sub(1);
        return if rows == 0 { Vec::new() } else { (0..count).map(|k| value(nearest, k)).collect() };
    }
    // The rate at a row is that of the parabola through it and its neighbours, or of the line at an end.
    let rate = |row: usize, k: usize| {
        let rise = |a: usize, b: usize| (value(b, k) - value(a, k)) / (time_of(b) - time_of(a));
        match (row.checked_sub(1), row + 1 < rows) {
            (Some(before), true) => {
                let [left, right] = [time_of(row) - time_of(before), time_of(row + 1) - time_of(row)];
                (rise(before, row) * right + rise(row, row + 1) * left) / (left + right)
            }
            (Some(before), false) => rise(before, row),
            (None, true) => rise(row, row + 1),
            (None, false) => 0.0,
        }
    };
    let at = |k: usize| {
        let [from, to] = [low - 1, low].map(|row| Row { time: time_of(row), value: value(row, k), rate: rate(row, k) });
        hermite(&from, &to, time).value
    };
    (0..count).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_rows_per_period_are_enough_to_interpolate_a_wave() {
        let rows: Vec<f64> = (0..40).map(|k| f64::from(k) / 12.0 + if k % 2 == 0 { 0.0 } else { 0.01 }).collect();
        let wave = |time: f64| (std::f64::consts::TAU * time).sin();
        let at = |time: f64| interpolate(rows.len(), time, |i| rows[i], |i, _| wave(rows[i]), 1)[0];
        let error = (0..1000).map(|k| 0.5 + 2e-3 * f64::from(k)).map(|t| (at(t) - wave(t)).abs()).fold(0.0, f64::max);
        assert!(error < 5e-3, "{error}"); // a straight line is off by 34e-3
        assert_eq!([at(-1.0), at(99.0), at(rows[7])], [rows[0], rows[39], rows[7]].map(wave));
        assert!(interpolate(0, 1.0, |_| 0.0, |_, _| 0.0, 3).is_empty());
    }
}
