//! The numbers of a run's summary as its page shows them: in groups, each with its unit and meaning.

use serde::Serialize;
use serde_json::{Map, Value};

use crate::cycle::MEASURES;
use crate::number_format::in_sentence;
use crate::variable::VARIABLES;

/// Digits that are shown; the whole number appears under the cursor.
pub(super) const DIGITS: usize = 6;

/// Spreads over cycles below this part of their means are rounding.
pub(super) const ROUNDING: f64 = 1e-12;

/// Ends of keys, and the units that they mean. Of two that fit, the first counts.
const UNITS: [(&str, &str); 10] = [
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_n_m", "N m"),
    ("_n_s", "N s"),
    ("_rad", "rad"),
    ("_j", "J"),
    ("_w", "W"),
    ("_n", "N"),
    ("_m", "m"),
    ("_s", "s"),
];

/// Groups in the order of the page, with the beginnings of their keys. Energies, powers and forces are known by their units, and what
/// no group has is motion.
const GROUPS: [(&str, &[&str]); 8] = [
    ("Motion", &[]),
    ("Whole cycles", &["cycle", "swims"]),
    ("Energy and work", &[]),
    ("Power", &[]),
    ("Forces and momentum", &[]),
    ("Model", &["nodes", "model", "forces", "fluid_reason", "fluid_error", "fluid_uncertainty"]),
    (
        "Method",
        &[
            "integrator",
            "form",
            "time_step_s",
            "tolerance",
            "steps",
            "rejected_steps",
            "newton",
            "factorisations",
            "linear",
            "step_halvings",
            "max_strain",
            "max_rotation",
            "wall_s",
        ],
    ),
    ("Run", &["name", "scene_", "caudal_version", "complete", "ending", "end_time_s"]),
];

/// Ratios for which a mean over whole cycles exists, too.
pub(super) const WHOLE_RUN: [&str; 2] = ["cost_of_transport", "efficiency"];

/// Entries that the page shows elsewhere.
const ELSEWHERE: [&str; 2] = ["final_positions_m", "notes"];

/// Numbers of one kind.
#[derive(Debug, Serialize)]
pub(super) struct NumberGroup {
    name: &'static str,
    rows: Vec<NumberRow>,
}

/// One number.
#[derive(Debug, Serialize)]
struct NumberRow {
    key: String,
    /// With its unit, and its spread over cycles.
    value: String,
    /// As in the summary.
    exact: String,
    /// Empty if the key is self-explanatory.
    meaning: &'static str,
}

/// The groups of a `summary`, without what has no value, and without energies, powers and forces that are zero.
pub(super) fn groups(summary: &Map<String, Value>) -> Vec<NumberGroup> {
    let mut groups = GROUPS.map(|(name, _)| NumberGroup { name, rows: Vec::new() });
    let spreads: Vec<&str> = MEASURES.iter().map(|measure| measure.spread).collect();
    for (key, value) in summary {
        let group = group_of(key);
        let measure = MEASURES.iter().find(|measure| measure.key == key);
        let spread = measure.and_then(|measure| summary.get(measure.spread)).and_then(Value::as_f64);
        // A quantity that is zero in all cycles does not belong to this scene.
        let nothing = is_absent_at_zero(GROUPS[group].0)
            || spread == Some(0.0) && unit_of(key).is_some_and(|unit| ["J", "W", "N", "N m"].contains(&unit));
        let absent = value.is_null() || nothing && is_zero(value);
        if absent || ELSEWHERE.contains(&key.as_str()) || spreads.contains(&key.as_str()) {
            continue;
        }
        // A spread due to rounding is omitted.
        let size = value.as_f64().unwrap_or(0.0).abs();
        let spread = spread.filter(|spread| *spread > ROUNDING * size);
        let spread = spread.map_or(String::new(), |spread| format!(" ± {}", in_sentence(spread, 2)));
        let unit = unit_of(key).map_or(String::new(), |unit| format!(" {unit}"));
        let whole = WHOLE_RUN.contains(&key.as_str());
        groups[group].rows.push(NumberRow {
            key: key.clone(),
            value: format!("{}{spread}{unit}{}", in_words(value), if whole { ", of the whole run" } else { "" }),
            exact: value.to_string(),
            meaning: meaning_of(key),
        });
    }
    groups.into_iter().filter(|group| !group.rows.is_empty()).collect()
}

pub(super) fn unit_of(key: &str) -> Option<&'static str> {
    UNITS.iter().find(|(end, _)| key.ends_with(end)).map(|(_, unit)| *unit)
}

/// The names of the groups, in the order of the page.
pub(super) fn group_names() -> impl Iterator<Item = &'static str> {
    GROUPS.iter().map(|(name, _)| *name)
}

/// True where a number of zero in this group means that the scene does not have it.
pub(super) fn is_absent_at_zero(group: &str) -> bool {
    matches!(group, "Energy and work" | "Power" | "Forces and momentum")
}

/// The meaning of the number of this key; empty if the key is self-explanatory.
pub(super) fn meaning_of(key: &str) -> &'static str {
    let of_variable = || VARIABLES.iter().find(|variable| variable.name == key).map(|variable| variable.description);
    match MEASURES.iter().find(|measure| measure.key == key) {
        _ if WHOLE_RUN.contains(&key) => "as cycle_…, with the means over the whole run and its start",
        Some(measure) => measure.description,
        None => of_variable().unwrap_or(""),
    }
}

/// The place of its group.
pub(super) fn group_of(key: &str) -> usize {
    let named = |name: &str| GROUPS.iter().position(|(own, _)| *own == name);
    let begins = |(_, keys): &(&str, &[&str])| keys.iter().any(|begin| key.starts_with(begin));
    let by_unit = || match unit_of(key)? {
        "J" => named("Energy and work"),
        "W" => named("Power"),
        "N" | "N m" | "N s" => named("Forces and momentum"),
        _ => None,
    };
    GROUPS.iter().position(begins).or_else(by_unit).unwrap_or(0)
}

fn is_zero(value: &Value) -> bool {
    match value {
        Value::Array(values) => values.iter().all(is_zero),
        _ => value.as_f64() == Some(0.0),
    }
}

fn in_words(value: &Value) -> String {
    let listed = |words: Vec<String>| words.join(", ");
    match value {
        Value::Null => "none".to_string(),
        Value::Bool(true) => "yes".to_string(),
        Value::Bool(false) => "no".to_string(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => in_sentence(number.as_f64().unwrap_or(f64::NAN), DIGITS),
        Value::Number(number) => number.to_string(),
        Value::Array(values) => listed(values.iter().map(in_words).collect()),
        Value::Object(entries) => {
            listed(entries.iter().map(|(name, value)| format!("{name} {}", in_words(value))).collect())
        }
    }
}
