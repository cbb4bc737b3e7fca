//! Axes of charts: a range that contains the data, and axis ticks at round numbers (linear, logarithmic, signed logarithmic,
//! categories), whose labels leave each other room.

use std::collections::BTreeSet;

use crate::number_format::{number, superscript};

/// Values beyond these are treated as infinity or zero, so that ranges and ticks cannot overflow.
const LARGEST: f64 = 1e300;
const SMALLEST: f64 = 1e-290;

/// Approximate number of ticks; if their labels do not fit, the next number that fits.
const TICKS: [f64; 6] = [7.0, 5.0, 4.0, 3.0, 2.0, 1.0];

/// Values with a smaller relative difference are equal up to rounding errors.
const ROUNDING: f64 = 1e-12;

/// Room past the end of an axis for the half of its last label, px.
const PAST_END: f64 = 22.0;

/// How numbers are spaced along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TickSpacing {
    Linear,
    Logarithmic,
    /// By the logarithm of their modulus, above or below the middle depending on their sign.
    Signed,
    /// Equally wide categories, at 0, 1, 2 …
    Categories,
}

/// An axis from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct ChartAxis {
    /// The values at 0 and 1: numbers, or their decimal logarithms; for a signed axis the middle and both ends.
    range: [f64; 2],
    spacing: TickSpacing,
    /// Tick positions from 0 to 1 with their labels; minor ticks have none.
    pub ticks: Vec<(f64, String)>,
    /// Common power of ten of all labels.
    pub power: i32,
    /// True if the values have no extent, so that its range is arbitrary.
    pub is_point: bool,
    /// True if categories have their numbers as labels, from 1.
    pub numbered: bool,
}

impl ChartAxis {
    /// A linear axis that contains the finite `values`, with a margin.
    pub fn linear(values: impl Iterator<Item = f64>) -> Self {
        let (range, is_point) = range(values);
        Self { is_point, ..Self::from(range) }
    }

    /// A linear axis over a range.
    pub fn from(range: [f64; 2]) -> Self {
        Self::with_ticks(range, TICKS[0])
    }

    /// A linear axis over a range with about this number of ticks.
    fn with_ticks([low, high]: [f64; 2], ticks: f64) -> Self {
        let step = round_step((high - low) / ticks);
        let size = low.abs().max(high.abs());
        let power = if (1e-3..1e5).contains(&size) { 0 } else { 3 * (size.log10() / 3.0).floor() as i32 };
        let unit = 10.0_f64.powi(power);
        let decimals = (-(step / unit).log10() - 1e-9).ceil().clamp(0.0, 12.0) as usize;
        let first = (low / step).ceil();
        let tick = |i: u32| {
            let x = (first + f64::from(i)) * step;
            let label = format!("{:.decimals$}", x / unit);
            let label = if label.trim_matches(['-', '0', '.']).is_empty() { "0".to_string() } else { label };
            ((x - low) / (high - low), label)
        };
        let ticks = (0..20).map(tick).take_while(|(place, _)| *place <= 1.0 + 1e-9).collect();
        Self { range: [low, high], spacing: TickSpacing::Linear, ticks, power, is_point: false, numbered: false }
    }

    /// A logarithmic axis that contains the positive `values`, with a margin.
    pub fn logarithmic(values: impl Iterator<Item = f64>) -> Self {
        let logs = values.filter(|x| *x > 0.0 && x.is_finite()).map(|x| x.clamp(SMALLEST, LARGEST).log10());
        let [low, high] = extent(logs).unwrap_or([-1.0, 0.0]);
        let margin = (0.04 * (high - low)).max(0.04);
        Self::from_logs([low - margin, high + margin])
    }

    /// A logarithmic axis for the moduli of `values`: down to the least that is not zero, or this many `decades` from the largest.
    pub fn decades(values: impl Iterator<Item = f64> + Clone, decades: i32) -> Self {
        let sizes = values.clone().map(f64::abs).filter(|x| *x >= SMALLEST && x.is_finite());
        let least = sizes.fold(f64::INFINITY, f64::min).log10().floor();
        let [low, high] = down_from_largest(values, decades);
        Self::from_logs([if least.is_finite() { low.max(least.min(high.floor() - 1.0)) } else { low }, high])
    }

    /// A logarithmic axis over a range, given by its decimal logarithms.
    pub fn from_logs([low, high]: [f64; 2]) -> Self {
        let place = |log: f64| (log - low) / (high - low);
        let (first, last) = (low.ceil() as i32, high.floor() as i32);
        let every = ((last - first) as usize / 8 + 1).max(1);
        let decades = (first..=last).step_by(every).map(|power| (place(f64::from(power)), power_of_ten(power)));
        let mut ticks: Vec<_> = decades.collect();
        let inside = |log: f64| (low..=high).contains(&log);
        if high - low < 0.6 {
            // Less than a factor of four: as on a linear axis.
            let linear = Self::from([low, high].map(|log| 10.0_f64.powf(log)));
            let [bottom, top] = linear.range;
            let x = |(at, _): &(f64, String)| bottom + at * (top - bottom);
            ticks = linear.ticks.iter().map(|tick| (place(x(tick).log10()), number(x(tick)))).collect();
        } else if high - low < 12.0 {
            for (power, digit) in (first - 1..=last).flat_map(|power| (2..10).map(move |digit| (power, digit))) {
                let log = f64::from(power) + f64::from(digit).log10();
                if inside(log) {
                    let shown = high - low < 2.5 && [2, 5].contains(&digit);
                    let label = if shown { tick_label(digit, power) } else { String::new() };
                    ticks.push((place(log), label));
                }
            }
        }
        let spacing = TickSpacing::Logarithmic;
        Self { range: [low, high], spacing, ticks, power: 0, is_point: false, numbered: false }
    }

    /// A signed logarithmic axis: this many `decades` in each direction, from the largest modulus of `values` to zero in the
    /// middle.
    pub fn signed(values: impl Iterator<Item = f64>, decades: i32) -> Self {
        let one = Self::from_logs(down_from_largest(values, decades));
        let [low, high] = one.range;
        let every = (decades as usize / 4).max(1);
        let powers = (low.ceil() as i32..=high.floor() as i32)
            .rev()
            .step_by(every)
            .filter(|power| f64::from(*power) > low + 0.5);
        let mut ticks = vec![(0.5, "0".to_string())];
        for power in powers {
            let place = 0.5 * (f64::from(power) - low) / (high - low);
            ticks.push((0.5 + place, power_of_ten(power)));
            ticks.push((0.5 - place, format!("−{}", power_of_ten(power))));
        }
        Self { spacing: TickSpacing::Signed, ticks, ..one }
    }

    /// An axis of equally wide categories at 0, 1, 2 …
    pub fn categories(labels: &[String]) -> Self {
        let range = [-0.5, labels.len().max(1) as f64 - 0.5];
        let place = |i: usize| (i as f64 - range[0]) / (range[1] - range[0]);
        let ticks = labels.iter().enumerate().map(|(i, label)| (place(i), label.clone())).collect();
        Self { range, spacing: TickSpacing::Categories, ticks, power: 0, is_point: false, numbered: false }
    }

    /// The same axis, with categories that can be told apart by what is `shown` of their labels: if they cannot, without what all of
    /// them begin and end with, or by their numbers.
    pub fn told_apart(mut self, shown: impl Fn(&str) -> String) -> Self {
        if self.spacing == TickSpacing::Categories {
            let labels: Vec<String> = self.ticks.iter().map(|(_, label)| label.clone()).collect();
            let (labels, numbered) = told_apart(&labels, shown);
            self.ticks.iter_mut().zip(labels).for_each(|(tick, label)| tick.1 = label);
            self.numbered = numbered;
        }
        self
    }

    /// The same axis with labels that leave each other room on its length (px), where a label takes so much `room` (px) along it: of
    /// a linear axis with larger steps, of others without labels that come too close to more important ones.
    pub fn apart(mut self, length: f64, room: impl Fn(&str) -> f64) -> Self {
        let fits = |axis: &Self| {
            let ends: Vec<_> = axis.ticks.iter().map(|(at, label)| (at * length, 0.5 * room(label))).collect();
            ends.windows(2).all(|pair| pair[0].0 + pair[0].1 <= pair[1].0 - pair[1].1)
                && ends.last().is_none_or(|(at, half)| at + half <= length + PAST_END)
        };
        match self.spacing {
            TickSpacing::Linear if fits(&self) => self,
            TickSpacing::Linear => {
                let mut fewer = TICKS.into_iter().map(|ticks| Self::with_ticks(self.range, ticks));
                let found = fewer.find(fits).unwrap_or_else(|| Self::with_ticks(self.range, 1.0));
                Self { is_point: self.is_point, ..found }
            }
            TickSpacing::Categories => {
                let widest = self.ticks.iter().map(|(_, label)| room(label)).fold(0.0, f64::max);
                let every = (widest * self.ticks.len() as f64 / length).ceil().max(1.0) as usize;
                let dropped = |(i, _): &(usize, &mut (f64, String))| !i.is_multiple_of(every);
                self.ticks.iter_mut().enumerate().filter(dropped).for_each(|(_, tick)| tick.1.clear());
                self
            }
            TickSpacing::Logarithmic | TickSpacing::Signed => {
                let mut kept: Vec<[f64; 2]> = Vec::new();
                for (at, label) in self.ticks.iter_mut().filter(|(_, label)| !label.is_empty()) {
                    let (middle, half) = (*at * length, 0.5 * room(label));
                    let own = [middle - half, middle + half];
                    if kept.iter().any(|other| own[0] < other[1] && other[0] < own[1]) {
                        label.clear();
                    } else {
                        kept.push(own);
                    }
                }
                self
            }
        }
    }

    /// The same range, extended about its middle by `factor`.
    pub fn widened(&self, factor: f64) -> Self {
        let [low, high] = self.range;
        let (middle, half) = (0.5 * low + 0.5 * high, 0.5 * factor * (high - low));
        Self::from([(middle - half).max(-LARGEST), (middle + half).min(LARGEST)])
    }

    /// Length of its range.
    pub fn size(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    /// Its lower end.
    pub fn low(&self) -> f64 {
        match self.spacing {
            TickSpacing::Linear | TickSpacing::Categories => self.range[0],
            TickSpacing::Logarithmic => 10.0_f64.powf(self.range[0]),
            TickSpacing::Signed => -10.0_f64.powf(self.range[1]),
        }
    }

    /// Position of a number from 0 at the lower end to 1 at the upper, and beyond.
    pub fn part(&self, x: f64) -> f64 {
        let part = |x: f64| (x - self.range[0]) / self.size();
        match self.spacing {
            TickSpacing::Linear | TickSpacing::Categories => part(x),
            TickSpacing::Logarithmic => part(x.log10()),
            TickSpacing::Signed => 0.5 + 0.5 * part(x.abs().log10()).max(0.0).copysign(x),
        }
    }

    /// The same; `None` outside the axis.
    pub fn place(&self, x: f64) -> Option<f64> {
        let place = self.part(x);
        (-1e-6..=1.0 + 1e-6).contains(&place).then_some(place)
    }
}

/// The decimal logarithms of the ends of an axis of this many `decades` down from the largest modulus of `values`.
fn down_from_largest(values: impl Iterator<Item = f64>, decades: i32) -> [f64; 2] {
    let largest = values.filter(|x| x.is_finite()).fold(0.0, |max: f64, x| max.max(x.abs())).min(LARGEST);
    let top = if largest < SMALLEST { 0.0 } else { largest.log10() };
    [(top.ceil() - f64::from(decades)).max(SMALLEST.log10()), top + 0.15]
}

/// Least and largest value; `None` without values.
fn extent(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.fold(None, |extent, x| {
        let [low, high] = extent.unwrap_or([x, x]);
        Some([x.min(low), x.max(high)])
    })
}

/// A non-empty range that contains the finite `values`, with a margin; and true if they have no extent.
fn range(values: impl Iterator<Item = f64>) -> ([f64; 2], bool) {
    let finite = values.filter(|x| x.is_finite()).map(|x| x.clamp(-LARGEST, LARGEST));
    let [low, high] = extent(finite).unwrap_or([0.0, 1.0]);
    let size = low.abs().max(high.abs());
    if size < SMALLEST {
        return ([-1.0, 1.0], true);
    }
    let is_point = high - low <= ROUNDING * size;
    let margin = if is_point { 0.1 * size } else { (0.04 * (high - low)).max(1e-6 * size) };
    ([low - margin, high + margin], is_point)
}

/// Labels of which what is `shown` can be told apart: as they are, without what all of them begin and end with, or the numbers of their
/// places from 1; and true for the last.
pub fn told_apart(labels: &[String], shown: impl Fn(&str) -> String) -> (Vec<String>, bool) {
    let count = |labels: &[String]| labels.iter().map(|label| shown(label)).collect::<BTreeSet<_>>().len();
    let distinct = labels.iter().collect::<BTreeSet<_>>().len();
    if count(labels) == distinct {
        return (labels.to_vec(), false);
    }
    let own = without_common_ends(labels);
    if count(&own) == distinct {
        return (own, false);
    }
    ((1..=labels.len()).map(|number| number.to_string()).collect(), true)
}

/// Labels without the words that all of them begin or end with.
fn without_common_ends(labels: &[String]) -> Vec<String> {
    let Some(first) = labels.first() else { return Vec::new() };
    // Numbers and names are not split.
    let of_word = |c: char| c.is_alphanumeric() || matches!(c, '.' | '_' | '-' | '+');
    let same = |a: &str, b: &str| a.chars().zip(b.chars()).take_while(|(a, b)| a == b).map(|(a, _)| a.len_utf8()).sum();
    let begin: usize = labels.iter().map(|label| same(first, label)).min().unwrap_or(0);
    let begin =
        first[..begin].rfind(|c| !of_word(c)).map_or(0, |at| at + first[at..].chars().next().map_or(0, char::len_utf8));
    let reversed = |text: &str| text[begin..].chars().rev().collect::<String>();
    let back = reversed(first);
    let end: usize = labels.iter().map(|label| same(&back, &reversed(label))).min().unwrap_or(0);
    let end =
        back[..end].rfind(|c| !of_word(c)).map_or(0, |at| at + back[at..].chars().next().map_or(0, char::len_utf8));
    let mark = |cut: usize| if cut > 0 { "…" } else { "" };
    labels.iter().map(|label| format!("{}{}{}", mark(begin), &label[begin..label.len() - end], mark(end))).collect()
}

/// The next larger of 1, 2, 5, 10 … times a power of ten.
fn round_step(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    power * [1.0, 2.0, 5.0].into_iter().find(|digit| step <= digit * power * (1.0 + 1e-9)).unwrap_or(10.0)
}

/// The label of a power of ten.
fn power_of_ten(power: i32) -> String {
    tick_label(1, power)
}

/// The label of a digit times a power of ten.
fn tick_label(digit: u32, power: i32) -> String {
    match digit {
        _ if (-3..=4).contains(&power) => number(f64::from(digit) * 10.0_f64.powi(power)),
        1 => format!("10{}", superscript(power)),
        _ => format!("{digit}·10{}", superscript(power)),
    }
}
