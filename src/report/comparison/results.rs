//! The results of runs side by side: values of their summaries, differences from the first run, and whether these are above the errors
//! that the runs state.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

use super::super::number_groups::{ROUNDING, group_names, group_of, is_absent_at_zero, unit_of};
use super::super::recorded_run::RecordedRun;
use super::stated_errors::StatedErrors;
use crate::cycle::MEASURES;

/// Entries that the page shows elsewhere.
const LEFT_OUT: [&str; 8] = [
    "final_positions_m",
    "notes",
    "verification",
    "name",
    "scene_file",
    "scene_fingerprint",
    "caudal_version",
    "ending",
];

/// The results that are not compared between runs: the time that the computation took.
const OF_MACHINE: &str = "wall_s";

/// Results below this fraction of the largest one with the same unit are negligible, such as the lateral path of a symmetric swimmer.
const NEGLIGIBLE: f64 = 1e-3;

/// Results that are positions.
const POSITIONS: [&str; 2] = ["x_com_m", "y_com_m"];

/// The most important results, which are listed first.
const FIRST: [&str; 14] = [
    "cycle_speed_m_s",
    "cycle_thrust_n",
    "cycle_actuation_power_w",
    "cycle_head_power_w",
    "cycle_hinge_power_w",
    "cycle_tip_excursion_m",
    "cycle_strouhal_number",
    "cycle_cost_of_transport",
    "cycle_efficiency",
    "net_displacement_m",
    "mean_thrust_n",
    "max_head_force_n",
    "max_head_moment_n_m",
    "max_joint_moment_n_m",
];

/// Groups that describe the motion, not its computation.
const OF_MOTION: [&str; 5] = ["Motion", "Whole cycles", "Energy and work", "Power", "Forces and momentum"];

/// The comparison of a difference with the stated errors of both results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Neither run states an error.
    Unknown,
    /// It is larger than the sum of the stated errors.
    Above,
    /// It is no larger.
    Within,
}

/// The difference of a result from that of the first run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResultDifference {
    /// The result minus that of the first run.
    pub absolute: f64,
    /// The same, divided by the first one; `None` if that is zero.
    pub relative: Option<f64>,
    /// Sum of the errors that both runs state for it; if only one run states an error, that error.
    pub error: Option<f64>,
    /// The runs that state an error of it: the first one, this one.
    pub stated: [bool; 2],
    /// True if it is no larger than the spreads of both from cycle to cycle.
    pub within_spread: bool,
}

impl ResultDifference {
    /// How it compares with the stated errors.
    pub fn verdict(&self) -> Verdict {
        match self.error {
            None => Verdict::Unknown,
            Some(error) if self.absolute.abs() > error => Verdict::Above,
            Some(_) => Verdict::Within,
        }
    }
}

/// One result of all runs.
#[derive(Debug, Clone)]
pub struct ResultRow {
    /// Its key in summary.json; of a pair `.x` and `.y`, of a table its key behind a dot.
    pub key: String,
    /// Its group.
    pub group: &'static str,
    /// Its unit.
    pub unit: Option<&'static str>,
    /// Its value in each run; null where a run has none.
    pub values: Vec<Value>,
    /// Its standard deviation from cycle to cycle, where there is one.
    pub spreads: Vec<Option<f64>>,
    /// The differences of all runs but the first from that; `None` where one of the two has no number.
    pub differences: Vec<Option<ResultDifference>>,
}

impl ResultRow {
    /// True if the values differ by more than rounding; what only tells how long the computation took does not.
    pub fn differs(&self) -> bool {
        let numbers: Option<Vec<f64>> = self.values.iter().map(Value::as_f64).collect();
        self.key != OF_MACHINE
            && match numbers {
                Some(numbers) => numbers.iter().any(|x| is_apart(numbers[0], *x)),
                None => self.values.iter().any(|value| *value != self.values[0]),
            }
    }

    /// True if it is a result of the motion, not of its computation.
    pub fn is_of_motion(&self) -> bool {
        OF_MOTION.contains(&self.group)
    }

    /// The largest difference from the first run, relative to the larger of the two, from 0 to 2.
    pub fn largest_difference(&self) -> f64 {
        let first = self.values[0].as_f64();
        let others = self.values.iter().skip(1).filter_map(Value::as_f64);
        let relative =
            |first: f64, x: f64| if is_apart(first, x) { (x - first).abs() / first.abs().max(x.abs()) } else { 0.0 };
        first.map_or(0.0, |first| others.map(|x| relative(first, x)).fold(0.0, f64::max))
    }
}

fn is_apart(a: f64, b: f64) -> bool {
    (a - b).abs() > ROUNDING * a.abs().max(b.abs())
}

/// The entries of a summary by key, pairs and tables taken apart.
fn entries(summary: &Map<String, Value>) -> Vec<(String, Value)> {
    let mut found = Vec::new();
    for (key, value) in summary.iter().filter(|(key, _)| !LEFT_OUT.contains(&key.as_str())) {
        match value {
            Value::Array(pair) if pair.len() == 2 && pair.iter().all(Value::is_number) => {
                found.extend(["x", "y"].iter().zip(pair).map(|(axis, value)| (format!("{key}.{axis}"), value.clone())));
            }
            Value::Array(all) => {
                let words: Vec<String> =
                    all.iter().map(|value| value.as_str().map_or_else(|| value.to_string(), str::to_string)).collect();
                found.push((key.clone(), Value::String(words.join(", "))));
            }
            Value::Object(table) => {
                found.extend(table.iter().map(|(name, value)| (format!("{key}.{name}"), value.clone())));
            }
            value => found.push((key.clone(), value.clone())),
        }
    }
    found
}

/// The results of `runs` in the order of the groups, without texts that are equal, and without what no run has.
pub fn rows(runs: &[RecordedRun], errors: &[StatedErrors]) -> Vec<ResultRow> {
    let all: Vec<Vec<(String, Value)>> = runs.iter().map(|run| entries(&run.summary)).collect();
    let of_run: Vec<BTreeMap<&str, &Value>> =
        all.iter().map(|own| own.iter().map(|(key, value)| (key.as_str(), value)).collect()).collect();
    let mut keys: Vec<&str> = Vec::new();
    for key in all.iter().flatten().map(|(key, _)| key.as_str()) {
        if !keys.contains(&key) && !MEASURES.iter().any(|measure| measure.spread == key) {
            keys.push(key);
        }
    }
    let names: Vec<&'static str> = group_names().collect();
    let row = |key: &&str| {
        let base = key.split('.').next().unwrap_or(key);
        let place = group_of(base);
        let values: Vec<Value> =
            of_run.iter().map(|own| own.get(key).map_or(Value::Null, |value| (*value).clone())).collect();
        let is_number = values.iter().any(Value::is_number);
        let zero = |value: &Value| value.is_null() || value.as_f64() == Some(0.0);
        let is_load = unit_of(base).is_some_and(|unit| ["J", "W", "N", "N m"].contains(&unit));
        let is_mean = key.starts_with("cycle_");
        let absent = values.iter().all(Value::is_null)
            || (is_absent_at_zero(names[place]) || is_load || is_mean) && values.iter().all(zero);
        if absent || !is_number && values.iter().all(|value| *value == values[0]) {
            return None;
        }
        let spread = MEASURES.iter().find(|measure| measure.key == *key).map(|measure| measure.spread);
        let spreads: Vec<Option<f64>> = of_run.iter().map(|own| own.get(spread?)?.as_f64()).collect();
        let difference = |i: usize| {
            let [first, own] = [0, i].map(|i| values[i].as_f64());
            let (first, own) = first.zip(own)?;
            let absolute = if is_apart(first, own) { own - first } else { 0.0 };
            let other_law = errors[0].forces() != errors[i].forces();
            let [a, b] = [(0, first), (i, own)].map(|(i, value)| errors[i].of_result(key, value, other_law));
            let spread = spreads[0].unwrap_or(0.0) + spreads[i].unwrap_or(0.0);
            Some(ResultDifference {
                absolute,
                relative: (first != 0.0).then(|| absolute / first),
                error: [a, b].into_iter().flatten().reduce(|a, b| a + b),
                stated: [a.is_some(), b.is_some()],
                within_spread: absolute != 0.0 && absolute.abs() <= spread,
            })
        };
        let differences = (1..runs.len()).map(|i| difference(i).filter(|_| *key != OF_MACHINE)).collect();
        let unit = unit_of(base);
        Some((place, ResultRow { key: key.to_string(), group: names[place], unit, values, spreads, differences }))
    };
    let mut rows: Vec<(usize, ResultRow)> = keys.iter().filter_map(row).collect();
    rows.sort_by_key(|(place, _)| *place);
    rows.into_iter().map(|(_, row)| row).collect()
}

/// The results of the motion that differ: those that are asked for first, and among these and the others those that differ most.
pub fn most_different(rows: &[ResultRow]) -> Vec<&ResultRow> {
    let size = |row: &ResultRow| row.values.iter().filter_map(Value::as_f64).map(f64::abs).fold(0.0, f64::max);
    let of = |key: &str| rows.iter().find(|row| row.key == key).map(size).filter(|size| *size > 0.0);
    let speed = of("com_path_m").zip(of("end_time_s")).map_or(0.0, |(path, end)| path / end);
    let largest = |unit: Option<&str>| {
        let least = match unit {
            None | Some("rad") => 1e-3, // ratios and angles have a size of their own
            Some("m/s") => speed,
            _ => 0.0,
        };
        rows.iter()
            // A position is not a measure of the distance travelled.
            .filter(|row| {
                unit.is_some() && row.unit == unit && row.is_of_motion() && !POSITIONS.contains(&row.key.as_str())
            })
            .map(size)
            .fold(least, f64::max)
    };
    let is_result = |row: &&ResultRow| {
        row.is_of_motion() && row.differences.iter().any(Option::is_some) && size(row) > NEGLIGIBLE * largest(row.unit)
    };
    let mut found: Vec<&ResultRow> = rows.iter().filter(is_result).filter(|row| row.differs()).collect();
    let comes_later = |row: &ResultRow| !FIRST.contains(&row.key.as_str());
    found.sort_by(|a, b| {
        comes_later(a).cmp(&comes_later(b)).then(b.largest_difference().total_cmp(&a.largest_difference()))
    });
    found
}
