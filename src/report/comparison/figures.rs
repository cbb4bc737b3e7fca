//! Charts of the quantities that at least two runs have: one chart per quantity, one line per run.

use super::super::chart::{Chart, Figure, Mark, Scale, Series};
use super::super::recorded_run::RecordedRun;
use crate::variable::VARIABLES;

/// The units of quantities in the order of the page: of motion, of forces, of power, of energy; all others come last.
const ORDER: [&[&str]; 4] = [&["m", "m/s", "rad", "rad/s"], &["N", "N m", "N s"], &["W"], &["J"]];

/// The axis label of a quantity with this unit.
const AXES: [(&str, &str); 9] = [
    ("m", "position or distance"),
    ("m/s", "velocity"),
    ("rad", "angle"),
    ("rad/s", "angular velocity"),
    ("N", "force"),
    ("N m", "moment"),
    ("N s", "momentum"),
    ("W", "power"),
    ("J", "energy"),
];

/// Most entries of a quantity along the rod that have a chart each.
const MAX_ENTRIES: usize = 8;

/// The velocity of the centre of mass, which follows from its position.
const DERIVED: [&str; 2] = ["vx_com_m_s", "vy_com_m_s"];

/// The figures of `runs`, with these labels and colours.
pub fn all(runs: &[RecordedRun], labels: &[String], colours: &[usize]) -> Vec<Figure> {
    let series = |x: &str, y: &str| -> Vec<Series> {
        let curves = runs.iter().map(|run| run.curves.curve(x, y));
        let there = curves.zip(labels).zip(colours).filter(|((points, _), _)| !points.is_empty());
        there.map(|((points, label), k)| Series::new(label, points, Mark::Line).coloured(*k)).collect()
    };
    let mut groups: Vec<Vec<Figure>> = vec![Vec::new(); ORDER.len() + 1];
    let path = series("x_com_m", "y_com_m");
    if path.len() > 1 {
        let chart = Chart::new("path of the centre of mass", "x (m)", "y (m)", Scale::Linear, path);
        let caption = "The paths of the centres of mass; the two axes have scales of their own.";
        groups[0].extend(chart.figure("com_path.svg", caption));
    }
    let names = quantities(runs);
    for name in &names {
        let Some(part) = charted(name, &names) else { continue };
        let curves = series("time_s", name);
        if curves.len() < 2 || !tells(&curves) {
            continue;
        }
        let (base, entry) = name.split_once('[').unwrap_or((name, ""));
        let variable = VARIABLES.iter().find(|variable| variable.name == base);
        let (unit, description) = variable.map_or(("", base), |variable| (variable.unit, variable.description));
        let entry = entry.trim_end_matches(']');
        let at = if entry.is_empty() { String::new() } else { format!(", node {entry}") };
        // Text after a comma or a bracket is an explanation.
        let short = description.split([',', ';']).next().unwrap_or(description);
        let axis = description
            .rsplit(", ")
            .next()
            .filter(|axis| ["x", "y"].contains(axis))
            .map_or(String::new(), |axis| format!(", {axis}"));
        let noun = AXES.iter().find(|(own, _)| *own == unit).map_or(base, |(_, noun)| noun);
        let y = if unit.is_empty() || unit == "1" { noun.to_string() } else { format!("{noun} ({unit})") };
        let derived =
            DERIVED.contains(&base) && runs.iter().any(|run| !run.curves.columns().iter().any(|own| own == base));
        let how = if derived { ": mean values between recorded times" } else { "" };
        let caption = format!("{}{at}, over time{how}.{part}", capitalised(description));
        let chart = Chart::new(format!("{short}{axis}{at}"), "time (s)", y, Scale::Linear, curves);
        let place = ORDER.iter().position(|units| units.contains(&unit)).unwrap_or(ORDER.len());
        let file = format!("{}.svg", name.replace('[', "-").replace(']', ""));
        groups[place].extend(chart.figure(file, caption));
    }
    groups.concat()
}

/// What a caption says of a quantity that has charts of only some entries, of which this is one; `None` for the others.
fn charted(name: &str, names: &[String]) -> Option<String> {
    let base = |name: &str| name.split_once('[').map(|(base, _)| base.to_string());
    let Some(own) = base(name) else { return Some(String::new()) };
    let entries: Vec<&String> = names.iter().filter(|other| base(other).as_ref() == Some(&own)).collect();
    if entries.len() <= MAX_ENTRIES {
        return Some(String::new());
    }
    let mut shown = (0..MAX_ENTRIES).map(|i| entries[i * (entries.len() - 1) / (MAX_ENTRIES - 1)]);
    shown
        .any(|shown| shown == name)
        .then(|| format!(" Of {} entries, {MAX_ENTRIES} are drawn; trajectory.csv has all.", entries.len()))
}

/// The columns of all runs, in the order of the table of variables.
fn quantities(runs: &[RecordedRun]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let derived = DERIVED.iter().map(ToString::to_string);
    for name in runs.iter().flat_map(|run| run.curves.columns().iter().skip(1).cloned()).chain(derived) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let place = |name: &String| {
        let base = name.split('[').next().unwrap_or_default();
        VARIABLES.iter().position(|variable| variable.name == base).unwrap_or(usize::MAX)
    };
    names.sort_by_key(place);
    names
}

/// True if a line is not constant, or if constant lines differ.
fn tells(curves: &[Series]) -> bool {
    let first = curves.first().and_then(|series| series.points.first());
    let value = first.map_or(0.0, |(_, value)| *value);
    curves.iter().flat_map(|series| &series.points).any(|(_, other)| *other != value && other.is_finite())
}

fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}
