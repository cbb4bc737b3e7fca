//! Comparison of finished runs: the keys in which their scenes differ, their results with the differences from the first run, overlaid
//! charts, and a film of all rods.

mod figures;
mod film;
mod keys;
mod results;
mod stated_errors;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value, json};

pub use keys::KeyDifference;
pub use results::{ResultDifference, ResultRow, Verdict};

use super::chart::{Figure, SERIES};
use super::findings::Table;
use super::folder::{Claim, Folder, Owner};
use super::number_groups::{DIGITS, meaning_of};
use super::page::{Animation, Figures, RawJson, render};
use super::recorded_run::RecordedRun;
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::jobs::hash;
use crate::number_format::{in_sentence, signed, significant};
use crate::scene::Document;
use film::Film;
use stated_errors::StatedErrors;

/// Most runs that are compared: lines of more cannot be told apart.
pub const MAX_RUNS: usize = 8;

/// Maximum number of letters of the names of runs in a folder name.
const MAX_NAME: usize = 100;

/// Most results and keys that the answers list.
const MAX_LISTED: usize = 6;

/// Most letters of a value of a key on the page; keys.csv has all.
const MAX_VALUE: usize = 60;

/// Relative difference up to which two end times are equal.
const SAME_TIME: f64 = 1e-9;

/// Runs side by side.
#[derive(Debug)]
pub struct Comparison {
    /// The name of each run, which distinguishes it from the others.
    pub labels: Vec<String>,
    /// The keys in which the scenes differ.
    pub keys: Vec<KeyDifference>,
    /// The results of all runs.
    pub results: Vec<ResultRow>,
    /// The answers, of a sentence or two each.
    pub answers: Vec<String>,
    /// Notes on the comparison and on its runs.
    pub notes: Vec<String>,
    runs: Vec<RecordedRun>,
    /// The figures.
    pub figures: Vec<Figure>,
    film: Option<Film>,
}

impl Comparison {
    /// Reads the runs in `folders` and compares them.
    ///
    /// # Errors
    /// Those of [`RecordedRun::read`] and of [`of`](Self::of).
    pub fn read(folders: &[PathBuf]) -> Result<Self> {
        check_count(folders.len())?;
        Self::of(folders.iter().map(|folder| RecordedRun::read(folder)).collect::<Result<_>>()?)
    }

    /// Compares `runs`; differences are taken from the first one.
    ///
    /// # Errors
    /// [`Error::Comparison`] for fewer than two runs or more than [`MAX_RUNS`]; [`Error::Read`] for a damaged table of nodes.
    pub fn of(runs: Vec<RecordedRun>) -> Result<Self> {
        check_count(runs.len())?;
        let labels = labels(&runs);
        let scenes: Vec<Option<&Document>> = runs.iter().map(|run| run.scene.as_ref()).collect();
        let keys = keys::differing_keys(&scenes);
        let errors: Vec<StatedErrors> = runs.iter().map(StatedErrors::of).collect();
        let results = results::rows(&runs, &errors);
        let colours: Vec<usize> = (0..runs.len()).map(colour).collect();
        let figures = figures::all(&runs, &labels, &colours);
        let film = film::film(&runs, &labels, &colours)?;
        let answers = answers(&labels, &runs, &keys, &results, &errors);
        let notes = notes(&labels, &runs, film.as_ref());
        Ok(Self { labels, keys, results, answers, notes, runs, figures, film })
    }

    /// Its name: `compare-A-B`.
    pub fn name(&self) -> String {
        let joined = format!("compare-{}", self.labels.join("-"));
        let name = match joined.chars().count() > MAX_NAME {
            true => {
                let first: String = self.labels[0].chars().take(MAX_NAME).collect();
                format!("compare-{first}-and-{}-others", self.labels.len() - 1)
            }
            false => joined,
        };
        let parts = name.split(|c: char| !c.is_alphanumeric() && !"_.-+=".contains(c));
        parts.filter(|part| !part.is_empty()).collect::<Vec<_>>().join("-")
    }

    /// The default folder of its results.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from("out").join(self.name())
    }

    /// Claims `folder` for its results.
    ///
    /// # Errors
    /// [`Error::Comparison`] for the folder of one of the runs; those of [`Folder::claim`].
    pub fn claim(&self, folder: &Path, claim: Claim) -> Result<Folder> {
        let place = |path: &Path| path.canonicalize().ok();
        let mut there = self.runs.iter().filter_map(|run| run.path.as_deref());
        if let Some(run) = there.find(|run| place(run).is_some() && place(run) == place(folder)) {
            let problem = format!("{} is one of them; choose another folder for the comparison", run.display());
            return Err(Error::Comparison { problem });
        }
        Folder::claim(folder, self.owner()?, claim, &["report.html", "summary.json", "results.csv", "keys.csv"])
    }

    fn owner(&self) -> Result<Owner> {
        let source = |run: &RecordedRun| {
            let path = run.path.as_ref();
            path.map(|path| path.canonicalize().unwrap_or_else(|_| path.clone()).display().to_string())
        };
        // Several folders take the place of the scene file; runs in memory have none.
        let sources: Option<Vec<String>> = self.runs.iter().map(source).collect();
        let source = sources.map_or_else(|| "runs in memory".to_string(), |sources| sources.join(", "));
        let content = serde_json::to_vec(&self.content()).map_err(|e| Error::Page { reason: e.to_string() })?;
        Ok(Owner {
            kind: "comparison".to_string(),
            name: self.labels.join(", "),
            source: PathBuf::from(source),
            fingerprint: hash(&content),
        })
    }

    /// Writes summary.json, the tables, figures and report.html to `folder`, each atomically.
    ///
    /// # Errors
    /// [`Error::Page`].
    pub fn write(&self, folder: &mut Folder) -> Result<WrittenFiles> {
        let failed = |reason: String| Error::Page { reason };
        let summary = serde_json::to_string_pretty(&self.content()).map_err(|e| failed(e.to_string()))?;
        let mut files = vec![("summary.json".to_string(), summary + "\n")];
        for table in [self.results_table(), self.keys_table()] {
            files.push((table.file.to_string(), table.csv().map_err(|e| failed(e.to_string()))?));
        }
        files.extend(self.figures.iter().map(|figure| (figure.file.clone(), figure.svg.clone())));
        files.push(("report.html".to_string(), self.html()?));
        Ok(folder.results().all(&files))
    }

    /// The content of summary.json.
    pub fn content(&self) -> Value {
        let by_run =
            |values: Vec<Value>| -> Value { self.labels.iter().cloned().zip(values).collect::<Map<_, _>>().into() };
        let run = |(label, run): (&String, &RecordedRun)| {
            json!({
                "name": label,
                "folder": run.path,
                "scene_file": run.summary.get("scene_file"),
                "scene_fingerprint": run.summary.get("scene_fingerprint"),
                "complete": run.is_complete(),
                "ending": run.text("ending"),
                "end_time_s": run.number("end_time_s"),
            })
        };
        let key = |found: &KeyDifference| {
            let values = found.values.iter().map(|value| json!(value)).collect();
            (found.key.clone(), by_run(values))
        };
        let difference = |found: &Option<ResultDifference>| match found {
            None => Value::Null,
            Some(found) => json!({
                "difference": found.absolute,
                "relative_difference": found.relative,
                "stated_error": found.error,
                "above_stated_error": found.error.map(|_| found.verdict() == Verdict::Above),
            }),
        };
        let result = |row: &ResultRow| {
            let differences = self.labels.iter().skip(1).cloned().zip(row.differences.iter().map(difference));
            let content = json!({
                "group": row.group,
                "unit": row.unit,
                "values": by_run(row.values.clone()),
                "differences": differences.collect::<Map<_, _>>(),
            });
            (row.key.clone(), content)
        };
        json!({
            "name": self.name(),
            "caudal_version": env!("CARGO_PKG_VERSION"),
            "subject": "comparison",
            "answers": self.answers,
            "notes": self.notes,
            "runs": self.labels.iter().zip(&self.runs).map(run).collect::<Vec<_>>(),
            "keys": self.keys.iter().map(key).collect::<Map<_, _>>(),
            "results": self.results.iter().map(result).collect::<Map<_, _>>(),
        })
    }

    /// One row per key, one column per run.
    fn keys_table(&self) -> Table {
        let row = |found: &KeyDifference| {
            let values = found.values.iter().map(|value| match value {
                Some(toml::Value::Integer(x)) => json!(x),
                Some(toml::Value::Float(x)) => json!(x),
                Some(value) => json!(keys::shown(value)),
                None => Value::Null,
            });
            std::iter::once(json!(found.key)).chain(values).collect()
        };
        let columns = std::iter::once("key".to_string()).chain(self.labels.iter().cloned()).collect();
        Table { file: "keys.csv", title: "Keys that differ", columns, rows: self.keys.iter().map(row).collect() }
    }

    /// One row per result and run.
    fn results_table(&self) -> Table {
        let columns = [
            "group",
            "key",
            "unit",
            "run",
            "value",
            "difference",
            "relative_difference",
            "stated_error",
            "above_stated_error",
        ];
        let mut rows = Vec::new();
        for row in &self.results {
            for (i, label) in self.labels.iter().enumerate() {
                let found = i.checked_sub(1).and_then(|i| row.differences[i]);
                let mut cells =
                    vec![json!(row.group), json!(row.key), json!(row.unit), json!(label), row.values[i].clone()];
                cells.push(json!(found.map(|found| found.absolute)));
                cells.push(json!(found.and_then(|found| found.relative)));
                cells.push(json!(found.and_then(|found| found.error)));
                cells.push(json!(found.and_then(|found| found.error.map(|_| found.verdict() == Verdict::Above))));
                rows.push(cells);
            }
        }
        let columns = columns.iter().map(ToString::to_string).collect();
        Table { file: "results.csv", title: "Results", columns, rows }
    }

    /// The page's HTML.
    ///
    /// # Errors
    /// [`Error::Page`] if the template fails.
    pub fn html(&self) -> Result<String> {
        let runs = self.labels.iter().zip(&self.runs).enumerate().map(|(i, (label, run))| RunOnPage {
            label,
            swatch: swatch(i),
            dashed: colour(i) >= SERIES,
            filmed: self.film.as_ref().is_some_and(|film| film.shown.contains(&i)),
            folder: run.path.as_ref().map_or_else(|| "in memory".to_string(), |path| path.display().to_string()),
            scene: run.text("scene_file").unwrap_or_default(),
            nodes: run.number("nodes").map_or_else(String::new, |nodes| format!("{nodes}")),
            method: [run.text("model"), run.text("integrator")].into_iter().flatten().collect::<Vec<_>>().join(", "),
            end: run.number("end_time_s").map_or_else(String::new, |end| format!("{} s", in_sentence(end, 7))),
            ending: if run.is_complete() { "complete" } else { run.text("ending").unwrap_or("unknown") },
        });
        let content = Content {
            title: self.labels.join(", "),
            version: env!("CARGO_PKG_VERSION"),
            answers: &self.answers,
            notes: &self.notes,
            runs: runs.collect(),
            motion: self.film.as_ref().map(|film| RawJson(&film.animation)),
            window: self.film.as_ref().map(|film| film.window.map(|time| format!("{} s", in_sentence(time, 4)))),
            labels: &self.labels,
            keys: self.keys.iter().map(|found| self.key_on_page(found)).collect(),
            results: self.results_on_page(),
            figures: (!self.figures.is_empty()).then(|| Figures::of(&self.figures)),
        };
        render(include_str!("../comparison.html"), &content)
    }

    fn key_on_page(&self, found: &KeyDifference) -> KeyOnPage {
        let cell = |(value, run): (&Option<toml::Value>, &RecordedRun)| match value {
            Some(value) => {
                let text = keys::shown(value);
                match text.chars().count() > MAX_VALUE {
                    true => text.chars().take(MAX_VALUE).chain(['…']).collect(),
                    false => text,
                }
            }
            None if run.scene.is_none() => "not known".to_string(),
            None => "not given".to_string(),
        };
        KeyOnPage { key: found.key.clone(), cells: found.values.iter().zip(&self.runs).map(cell).collect() }
    }

    fn results_on_page(&self) -> Vec<ResultsOnPage<'_>> {
        let mut groups: Vec<ResultsOnPage> = Vec::new();
        for row in &self.results {
            if groups.last().is_none_or(|group| group.name != row.group) {
                groups.push(ResultsOnPage { name: row.group, rows: Vec::new() });
            }
            let cell = |i: usize| {
                let difference = i.checked_sub(1).and_then(|i| row.differences[i]);
                let spread = row.spreads[i].filter(|spread| *spread > 0.0);
                let spread = spread.map_or(String::new(), |spread| format!(" ± {}", in_sentence(spread, 2)));
                let value = match &row.values[i] {
                    Value::Null => "none".to_string(),
                    value => format!("{}{spread}", in_words(value)),
                };
                CellOnPage {
                    value,
                    exact: row.values[i].to_string(),
                    numeric: row.values[i].is_number(),
                    difference: difference.filter(|found| found.absolute != 0.0).map(|found| change_in_words(&found)),
                    verdict: difference.and_then(|found| self.verdict_in_words(&found, i)),
                    above: difference.is_some_and(|found| found.verdict() == Verdict::Above && !found.within_spread),
                }
            };
            let row = RowOnPage {
                key: &row.key,
                meaning: meaning_of(row.key.split('.').next().unwrap_or_default()),
                unit: row.unit.unwrap_or_default(),
                cells: (0..self.runs.len()).map(cell).collect(),
            };
            if let Some(group) = groups.last_mut() {
                group.rows.push(row);
            }
        }
        groups
    }

    fn verdict_in_words(&self, found: &ResultDifference, run: usize) -> Option<String> {
        verdict_in_words(found, &self.labels, run)
    }
}

/// The colour of run `i` in charts, which is that of its rod in the film.
fn colour(i: usize) -> usize {
    i.checked_sub(1).map_or(0, Animation::series_of_companion)
}

/// The variable of the style sheet that has the colour of run `i`.
fn swatch(i: usize) -> String {
    format!("--series-{}", colour(i) % SERIES)
}

fn check_count(count: usize) -> Result<()> {
    if (2..=MAX_RUNS).contains(&count) {
        return Ok(());
    }
    let hint = if count > MAX_RUNS { "; a sweep compares more" } else { "" };
    Err(Error::Comparison { problem: format!("found {count} of them; allowed: 2 to {MAX_RUNS}{hint}") })
}

/// The names of scenes or, where some are equal, of folders, with as many of the folders around them as tell them apart. The same folder
/// again has a number.
fn labels(runs: &[RecordedRun]) -> Vec<String> {
    let distinct = |labels: &[String]| labels.iter().collect::<BTreeSet<_>>().len() == labels.len();
    let names: Vec<String> = runs.iter().map(|run| run.name.clone()).collect();
    if distinct(&names) {
        return names;
    }
    let parts = |run: &RecordedRun| -> Vec<String> {
        let path = run.path.as_ref().map(|path| path.canonicalize().unwrap_or_else(|_| path.clone()));
        let parts = path.iter().flat_map(|path| path.components()).filter_map(|part| match part {
            std::path::Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        parts.collect()
    };
    let parts: Vec<Vec<String>> = runs.iter().map(parts).collect();
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    let places: BTreeSet<&Vec<String>> = parts.iter().collect();
    let suffix = |count: usize| -> Vec<String> {
        let of = |(parts, name): (&Vec<String>, &String)| match parts.len() {
            0 => name.clone(),
            length => parts[length.saturating_sub(count)..].join("/"),
        };
        parts.iter().zip(&names).map(of).collect()
    };
    // As many parts as distinguish different folders.
    let told = |labels: &Vec<String>| labels.iter().collect::<BTreeSet<_>>().len() >= places.len();
    let labels = (1..=longest).map(suffix).find(told).unwrap_or(names);
    let mut found: Vec<String> = Vec::new();
    for (i, label) in labels.iter().enumerate() {
        let again = labels[..i].iter().filter(|other| *other == label).count();
        let mut own = if again == 0 { label.clone() } else { format!("{label} ({})", again + 1) };
        while found.contains(&own) {
            own.push('\'');
        }
        found.push(own);
    }
    found
}

/// A number in a line of the terminal: no needless zeros, and its exponent, if it has one, behind an e; pages typeset it.
fn plain(x: f64, digits: usize) -> String {
    let text = significant(x, digits);
    let (digits, power) =
        text.split_once('e').map_or((text.as_str(), String::new()), |(digits, power)| (digits, format!("e{power}")));
    let digits = if digits.contains('.') { digits.trim_end_matches('0').trim_end_matches('.') } else { digits };
    format!("{digits}{power}")
}

fn in_words(value: &Value) -> String {
    match value {
        Value::Bool(true) => "yes".to_string(),
        Value::Bool(false) => "no".to_string(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => in_sentence(number.as_f64().unwrap_or(f64::NAN), DIGITS),
        other => other.to_string(),
    }
}

/// `+0.012, +3.4 %`.
fn change_in_words(found: &ResultDifference) -> String {
    let text = plain(found.absolute, 4);
    let sign = if found.absolute > 0.0 { "+" } else { "" };
    let relative = found.relative.map(|relative| format!(", {}", per_cent(relative)));
    format!("{sign}{text}{}", relative.unwrap_or_default())
}

/// A relative difference in per cent, in about three digits, or as a factor where it is large.
fn per_cent(relative: f64) -> String {
    let size = 100.0 * relative.abs();
    match size {
        _ if size >= 1e4 => format!("{} times", plain(1.0 + relative, 3)),
        _ if size >= 100.0 => format!("{} %", signed(100.0 * relative, 0)),
        _ if size >= 0.1 => format!("{} %", signed(100.0 * relative, if size >= 10.0 { 1 } else { 2 })),
        _ => format!("{}{} %", if relative > 0.0 { "+" } else { "" }, plain(100.0 * relative, 2)),
    }
}

fn verdict_in_words(found: &ResultDifference, labels: &[String], run: usize) -> Option<String> {
    let error = found.error?;
    let by = match found.stated {
        [true, false] => format!(" of {} alone", labels[0]),
        [false, true] => format!(" of {} alone", labels[run]),
        _ => String::new(),
    };
    let is_above = found.verdict() == Verdict::Above;
    let place = if is_above { "above" } else { "within" };
    let spread = if is_above && found.within_spread { ", but within the spread from cycle to cycle" } else { "" };
    (found.absolute != 0.0).then(|| format!("{place} the stated error{by}, {}{spread}", plain(error, 2)))
}

/// What is found, most important first.
fn answers(
    labels: &[String],
    runs: &[RecordedRun],
    keys: &[KeyDifference],
    results: &[ResultRow],
    errors: &[StatedErrors],
) -> Vec<String> {
    let mut answers = Vec::new();
    let known = runs.iter().filter(|run| run.scene.is_some()).count();
    let fingerprints: BTreeSet<Option<&str>> = runs.iter().map(|run| run.text("scene_fingerprint")).collect();
    let versions: BTreeSet<Option<&str>> = runs.iter().map(|run| run.text("caudal_version")).collect();
    if known < 2 {
        answers.push("The keys of the scenes cannot be compared: fewer than two are known.".to_string());
    } else if keys.is_empty() {
        let of =
            if known < runs.len() { format!("the {known} scenes that are known") } else { "the scenes".to_string() };
        let but = match fingerprints.len() > 1 && known == runs.len() {
            true if versions.len() > 1 => "; the runs were made by different versions of caudal",
            true => "; what differs is the content of a table that they name",
            false => "",
        };
        answers.push(format!("No key of {of} differs{but}."));
    } else {
        let value = |value: &Option<toml::Value>| value.as_ref().map_or_else(|| "not given".to_string(), keys::shown);
        let shorter = |text: String| match text.chars().count() > MAX_VALUE / 2 {
            true => text.chars().take(MAX_VALUE / 2).chain(['…']).collect(),
            false => text,
        };
        let one = |found: &KeyDifference| {
            let known = found.values.iter().zip(runs).filter(|(_, run)| run.scene.is_some());
            let values: Vec<String> = known.map(|(own, _)| shorter(value(own))).collect();
            format!("{} = {}", found.key, values.join(" | "))
        };
        let listed: Vec<String> = keys.iter().take(MAX_LISTED).map(one).collect();
        let more = keys.len().saturating_sub(MAX_LISTED);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        let noun = if keys.len() == 1 { "key differs" } else { "keys differ" };
        answers.push(format!("{} {noun}: {}{more}.", keys.len(), listed.join("; ")));
    }
    let different = results::most_different(results);
    let others = results.iter().filter(|row| row.differs() && !row.is_of_motion()).count();
    match (different.is_empty(), others) {
        (true, 0) if keys.is_empty() => answers.push("The runs do not differ: all results are equal.".to_string()),
        (true, 0) => answers.push("No result differs.".to_string()),
        (true, _) => answers.push("No result of the motion differs, only the work of the computation.".to_string()),
        _ => answers.push(match different.len() {
            1 => "1 result of the motion differs:".to_string(),
            count if count <= MAX_LISTED => {
                format!("{count} results of the motion differ:")
            }
            count => format!("{count} results of the motion differ; among them:"),
        }),
    }
    for row in different.iter().take(MAX_LISTED) {
        let unit = row.unit.map_or(String::new(), |unit| format!(" {unit}"));
        let value = |i: usize| row.values[i].as_f64().map_or("none".to_string(), |x| plain(x, 4) + &unit);
        let other = |i: usize| {
            let found = row.differences[i - 1].filter(|found| found.absolute != 0.0);
            let words = found.map(|found| {
                let relative = found.relative.map(per_cent);
                let verdict = verdict_in_words(&found, labels, i);
                let all: Vec<String> = relative.into_iter().chain(verdict).collect();
                if all.is_empty() { String::new() } else { format!(" ({})", all.join(", ")) }
            });
            value(i) + &words.unwrap_or_default()
        };
        let others: Vec<String> = (1..runs.len()).map(other).collect();
        answers.push(format!("{}: {} | {}", row.key, value(0), others.join(" | ")));
    }
    let other_laws = errors.iter().any(|own| own.forces() != errors[0].forces());
    let meshes: BTreeSet<Option<u64>> =
        runs.iter().map(|run| run.summary.get("nodes").and_then(Value::as_u64)).collect();
    let of_mesh = if meshes.len() > 1 { "; the errors of different meshes are not among them" } else { "" };
    let stated: Vec<String> = labels
        .iter()
        .zip(errors)
        .filter_map(|(label, own)| Some(format!("{label}: {}", own.in_words(other_laws)?)))
        .collect();
    if !different.is_empty() {
        answers.push(match stated.is_empty() {
            true => "No run states an error of its results, as one with --verify does, so whether a difference is larger than \
                     the errors is not known."
                .to_string(),
            false => format!("Stated relative errors, which are added up: {}{of_mesh}.", stated.join("; ")),
        });
    }
    answers
}

/// Notes on the comparison, and the notes of the runs.
fn notes(labels: &[String], runs: &[RecordedRun], film: Option<&Film>) -> Vec<String> {
    let mut notes = Vec::new();
    for (label, run) in labels.iter().zip(runs).filter(|(_, run)| !run.is_complete()) {
        notes.push(format!("{label} did not reach its end: {}", run.text("ending").unwrap_or("unknown")));
    }
    let ends: Vec<f64> = runs.iter().filter_map(|run| run.number("end_time_s")).collect();
    let [first, last] = [ends.iter().copied().fold(f64::INFINITY, f64::min), ends.iter().copied().fold(0.0, f64::max)];
    if last - first > SAME_TIME * last {
        notes.push(format!(
            "the runs end at different times, {} to {} s: totals and values at the end are of these times, while means over whole \
             cycles can be compared",
            plain(first, 5),
            plain(last, 5)
        ));
    }
    for (label, run) in labels.iter().zip(runs) {
        notes.extend(run.missing.iter().map(|missing| format!("{label}: {missing}")));
    }
    if film.is_none() && runs.iter().filter(|run| run.has_motion()).count() > 1 {
        let starts = labels.iter().zip(runs).filter_map(|(label, run)| {
            let [start, end] = [run.motion_start().ok()??, run.number("end_time_s")?].map(|time| plain(time, 5));
            Some(format!("{label} {start} to {end} s"))
        });
        let spans = starts.collect::<Vec<_>>().join(", ");
        notes.push(format!("there is no film: the tables of nodes have no time in common ({spans})"));
    }
    if let Some(film) = film {
        notes.extend(
            film.specks
                .iter()
                .map(|name| format!("{name} is so much smaller than the others that it is a dot in the film")),
        );
    }
    let texts = |run: &RecordedRun| -> Vec<String> {
        let notes = run.summary.get("notes").and_then(Value::as_array);
        notes.into_iter().flatten().filter_map(|note| note.as_str().map(str::to_string)).collect()
    };
    let all: Vec<Vec<String>> = runs.iter().map(texts).collect();
    let mut told: Vec<&String> = Vec::new();
    for note in all.iter().flatten() {
        if !told.contains(&note) {
            told.push(note);
            let of: Vec<&str> = labels
                .iter()
                .zip(&all)
                .filter(|(_, own)| own.contains(note))
                .map(|(label, _)| label.as_str())
                .collect();
            let who = if of.len() == labels.len() { "all runs".to_string() } else { of.join(", ") };
            notes.push(format!("{who}: {note}"));
        }
    }
    notes
}

/// The data for the template.
#[derive(Serialize)]
struct Content<'a> {
    title: String,
    version: &'static str,
    answers: &'a [String],
    notes: &'a [String],
    runs: Vec<RunOnPage<'a>>,
    motion: Option<RawJson<&'a Animation>>,
    window: Option<[String; 2]>,
    labels: &'a [String],
    keys: Vec<KeyOnPage>,
    results: Vec<ResultsOnPage<'a>>,
    figures: Option<Figures<'a>>,
}

#[derive(Serialize)]
struct RunOnPage<'a> {
    label: &'a str,
    swatch: String,
    dashed: bool,
    filmed: bool,
    folder: String,
    scene: &'a str,
    nodes: String,
    method: String,
    end: String,
    ending: &'a str,
}

#[derive(Serialize)]
struct KeyOnPage {
    key: String,
    cells: Vec<String>,
}

#[derive(Serialize)]
struct ResultsOnPage<'a> {
    name: &'static str,
    rows: Vec<RowOnPage<'a>>,
}

#[derive(Serialize)]
struct RowOnPage<'a> {
    key: &'a str,
    meaning: &'static str,
    unit: &'static str,
    cells: Vec<CellOnPage>,
}

#[derive(Serialize)]
struct CellOnPage {
    value: String,
    exact: String,
    numeric: bool,
    difference: Option<String>,
    verdict: Option<String>,
    above: bool,
}
