//! The definition of a sweep: its file, axes and cases, and the scene of each case.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::Deserialize;
use toml::Value;

use super::axis::{self, AxisKind, Sampling, SweepAxis};
use super::case_result::CaseResult;
use crate::error::{Error, Result, bytes, did_you_mean, nearest};
use crate::files::free_space;
use crate::jobs::{self, Job, Journal};
use crate::report::{Claim, Folder, MAX_POINTS, Owner};
use crate::scene::{Document, Files, KeyError, Scene, exclusive_keys};
use crate::wording::Phrase;

/// The files that every sweep writes.
pub(super) const TABLE: &str = "table.csv";
pub(super) const PAGE: &str = "report.html";

/// Most cases of a sweep.
const MAX_CASES: usize = 1_000_000;

/// Most recorded times of a motion or a path per case.
const MAX_SAMPLES: usize = 1_000_000;

/// The scenes of up to this many cases are kept in memory from the check to the run.
const MAX_CACHED_SCENES: usize = 20_000;

/// Largest report that browsers open, bytes.
const MAX_PAGE_BYTES: f64 = 5e8;

/// Approximate size of a coordinate and of a result, in journal and table together, bytes.
const BYTES_PER_COORDINATE: f64 = 22.0;
const BYTES_PER_ROW: f64 = 5000.0;

/// A sweep's file.
#[derive(Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
struct SweepFile {
    /// Name of the sweep. By default, the name of the file without its extension.
    #[serde(default)]
    name: String,
    /// Path of the base scene, relative to this file.
    scene: String,
    /// What is set in the base scene for every case.
    #[serde(default)]
    #[cfg_attr(feature = "schema", schemars(with = "serde_json::Map<String, serde_json::Value>"))]
    set: toml::Table,
    /// The axes: keys of the scene, each with its levels.
    #[cfg_attr(feature = "schema", schemars(with = "serde_json::Map<String, serde_json::Value>"))]
    axes: toml::Table,
    /// Size and seed of the Latin hypercube.
    samples: Option<Sampling>,
    /// What is recorded of a case, in addition to its row of the table.
    #[serde(default)]
    record: SweepRecordTable,
    /// Options of the report.
    #[serde(default)]
    report: ReportTable,
}

/// `[record]` of a sweep: what is kept of a case beside its row of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(rename = "RecordTable"))]
#[serde(default, deny_unknown_fields)]
pub struct SweepRecordTable {
    /// Number of cases whose motion is stored for the report to play. They are drawn at random.
    pub played: usize,
    /// Number of times of that motion, at most the number of steps. They cover the whole run or, if they are fewer than 12 per
    /// period of the fastest drive, its last periods.
    pub frames: usize,
    /// Number of times at which the path of the centre of mass is stored for every case, in traces.csv; 0 for none.
    pub traces: usize,
}

impl Default for SweepRecordTable {
    fn default() -> Self {
        Self { played: 200, frames: 60, traces: 0 }
    }
}

/// `[report]` of a sweep.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct ReportTable {
    /// The axis whose levels have separate figures and are compared.
    pub split: Option<String>,
}

/// A sweep whose file was read and checked.
#[derive(Debug)]
pub struct Sweep {
    /// Its name; by default that of its file.
    pub name: String,
    /// The axes, in the order of the file; the last one changes fastest.
    pub axes: Vec<SweepAxis>,
    /// What is recorded per case.
    pub record: SweepRecordTable,
    /// The axis whose levels are shown separately in the report.
    pub split: Option<usize>,
    document: Document,
    base: Document,
    tables: toml::Table,
    /// Groups of axes that advance together.
    dimensions: Vec<Vec<usize>>,
    /// Path of each axis, for error messages.
    places: Vec<String>,
    played: BTreeSet<usize>,
    /// The result of checking all cases' scenes.
    pub(super) checked: OnceLock<CheckedScenes>,
    /// The sweep's own file and that of its base scene.
    pub(super) own: [PathBuf; 2],
    /// The overrides with which it was read.
    pub(super) set: Vec<String>,
    /// The source of all files.
    pub(super) files: Files,
    /// Names of the columns that identify a case, each with its axis if it shows a label, or `None` if it shows the value of a key.
    columns: Vec<(String, Option<usize>)>,
}

/// The result of checking all cases' scenes.
#[derive(Debug, Default)]
pub(super) struct CheckedScenes {
    /// Hash of each scene.
    hashes: Vec<String>,
    /// The scenes, for a sweep of up to [`MAX_CACHED_SCENES`] cases.
    scenes: Vec<Option<Scene>>,
    /// The tables that the scenes read.
    pub(super) tables: BTreeSet<PathBuf>,
}

/// The outcome of migrating a journal of the same sweep from before levels or axes were added.
#[derive(Debug)]
enum Migration {
    /// The journal now has the cases of this sweep.
    Done,
    /// The journal has other cases; with the reason.
    OtherCases(String),
    /// The journal belongs to another job, is damaged, or is in use.
    OtherJob,
}

/// One case of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Its index.
    pub index: usize,
    /// Its level on each axis.
    pub levels: Vec<usize>,
    /// The keys that the axes set: axis, key and value.
    pub settings: Vec<(usize, String, Value)>,
}

#[cfg(feature = "schema")]
impl Sweep {
    /// The JSON Schema (draft 2020-12) of sweeps.
    pub fn schema() -> serde_json::Value {
        use serde_json::{Value, json};
        let mut schema = crate::scene::schema::of::<SweepFile>();
        schema["title"] = "A sweep of caudal".into();
        let values = json!({ "type": "array", "minItems": 1 });
        let scale = json!({ "enum": ["linear", "log"] });
        let mut marked = json!({
            "values": { "anyOf": [values, { "$ref": "#/$defs/Range" }] },
            "factors": { "anyOf": [values, { "$ref": "#/$defs/Range" }] },
            "zip": { "type": "object" },
            "keys": { "type": "array", "items": { "type": "string" } },
            "labels": values
        });
        let range = json!({
            "from": {},
            "to": {},
            "count": { "type": "integer", "minimum": 1 },
            "between": { "type": "array", "items": { "type": "number" }, "minItems": 2, "maxItems": 2 },
            "scale": scale
        });
        if let (Value::Object(marked), Value::Object(range)) = (&mut marked, &range) {
            marked.extend(range.clone());
        }
        let any_mark: Vec<Value> = axis::AXIS_KEYS.iter().map(|mark| json!({ "required": [mark] })).collect();
        schema["$defs"]["Range"] = json!({ "type": "object", "properties": range, "additionalProperties": false });
        schema["$defs"]["Axis"] = json!({ "anyOf": [
            values,
            { "type": "object", "properties": marked, "additionalProperties": false, "anyOf": any_mark },
            {
                "type": "object",
                "not": { "anyOf": any_mark },
                "additionalProperties": { "$ref": "#/$defs/Axis" }
            }
        ] });
        schema["properties"]["axes"]["additionalProperties"] = json!({ "$ref": "#/$defs/Axis" });
        // `[set]` may contain any keys of the scene; the scene's tables get their own names.
        let mut scene = Scene::schema();
        optional(&mut scene, "Scene");
        if let Some(table) = scene.as_object_mut() {
            table.remove("$schema");
            if let Some(Value::Object(parts)) = table.remove("$defs") {
                parts.into_iter().for_each(|(name, part)| schema["$defs"][format!("Scene{name}")] = part);
            }
            table.insert("title".into(), "What is set in the base scene for every case".into());
        }
        schema["properties"]["set"] = scene;
        schema
    }
}

/// Makes all keys of a schema optional, and puts `prefix` before references to its definitions.
#[cfg(feature = "schema")]
fn optional(value: &mut serde_json::Value, prefix: &str) {
    match value {
        serde_json::Value::Array(values) => values.iter_mut().for_each(|value| optional(value, prefix)),
        serde_json::Value::Object(entries) => {
            entries.remove("required");
            if let Some(serde_json::Value::String(place)) = entries.get_mut("$ref") {
                *place = place.replace("#/$defs/", &format!("#/$defs/{prefix}"));
            }
            entries.values_mut().for_each(|value| optional(value, prefix));
        }
        _ => {}
    }
}

impl Sweep {
    /// Reads a sweep and its base scene, with the overrides `set` (`table.key=value`) after the file's own.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Scene`] with file, line and key.
    pub fn read(path: &Path, set: &[String]) -> Result<Self> {
        Self::read_from(&Files::default(), path, set)
    }

    /// Reads a sweep from `files`, which also contain its base scene and tables.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn read_from(files: &Files, path: &Path, set: &[String]) -> Result<Self> {
        Self::over(files, path, set, None)
    }

    /// Like [`read_from`](Self::read_from), with another base scene, if given.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn over(files: &Files, path: &Path, set: &[String], base: Option<Document>) -> Result<Self> {
        let document = Document::read_from(files.clone(), path)?;
        if document.read_as::<toml::Table>().is_ok_and(|table| table.contains_key("rod") && !table.contains_key("axes"))
        {
            let problem = format!("this is a scene, not a sweep; {}", Phrase::RunsScene);
            return Err(document.error_at(&KeyError { key: "rod".to_string(), problem }));
        }
        let file: SweepFile = document.read_as()?;
        let refuse = |fault: KeyError| document.error_at(&fault);
        let mut axes = axis::read(&file.axes, "axes").map_err(refuse)?;
        let at = document.positions(&axes.iter().map(|axis| axis.path.clone()).collect::<Vec<_>>())?;
        let mut order: Vec<_> = at.into_iter().zip(axes).collect();
        order.sort_by_key(|(at, _)| *at);
        axes = order.into_iter().map(|(_, axis)| axis).collect();
        axis::sample(&mut axes, file.samples).map_err(refuse)?;
        for axis in axes.iter_mut().filter(|axis| axis::is_result(&axis.name)) {
            axis.name = format!("axis.{}", axis.name); // a result column has this name
        }

        let folder = path.parent().unwrap_or(Path::new(""));
        let scene = folder.join(&file.scene);
        let mut base = base.map_or_else(|| Document::read_from(files.clone(), &scene), Ok)?;
        let mut own = Vec::new();
        axis::leaves(&file.set, "", &mut own);
        base.begin_layer();
        for (key, value) in &own {
            let place = document.place_of(&format!("set.{key}"));
            excluded(&axes, key, value).map_err(|problem| Error::Scene {
                place: place.clone(),
                key: key.clone(),
                problem,
            })?;
            base.set_value(&place, key, value);
        }
        base.begin_layer();
        for assignment in set {
            base.set_as(&Phrase::Set.to_string(), assignment)?;
        }
        let asked = base.overrides()[base.overrides().len() - set.len()..].to_vec();
        for text in asked {
            let mut keys = Vec::new();
            axis::leaves(&text.parse().unwrap_or_default(), "", &mut keys);
            for (key, value) in keys {
                let place = format!("{}{text}", Phrase::Set);
                excluded(&axes, &key, &value).map_err(|problem| Error::Scene { place, key, problem })?;
            }
        }
        base.begin_layer(); // for the axes
        let mut sweep = Self {
            name: if file.name.is_empty() {
                path.file_stem().map_or_else(|| "sweep".into(), |stem| stem.to_string_lossy().into())
            } else {
                file.name
            },
            dimensions: dimensions(&axes),
            places: axes.iter().map(|axis| document.place_of(&axis.path)).collect(),
            split: None,
            record: file.record,
            tables: base.read_as()?,
            played: BTreeSet::new(),
            checked: OnceLock::new(),
            own: [path.to_path_buf(), scene],
            set: set.to_vec(),
            files: files.clone(),
            columns: columns(&axes),
            axes,
            base,
            document,
        };
        sweep.check(&file.report).map_err(|fault| sweep.document.error_at(&fault))?;
        if let Some(split) = &file.report.split {
            sweep.split = sweep.axes.iter().position(|axis| axis.is_called(split));
        }
        sweep.played = jobs::shuffled(sweep.size()).into_iter().take(sweep.record.played).collect();
        Ok(sweep)
    }

    /// Checks that involve several keys.
    fn check(&self, report: &ReportTable) -> std::result::Result<(), KeyError> {
        let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
        if self.name.contains(['/', '\\']) || ["", ".", ".."].contains(&self.name.trim()) {
            return fault("name", format!("found {:?}; allowed: a valid folder name", self.name));
        }
        let sizes = self.dimensions.iter().map(|dimension| self.axes[dimension[0]].levels.len());
        let size = sizes.clone().try_fold(1_usize, |product, size| product.checked_mul(size));
        if size.is_none_or(|size| size > MAX_CASES) {
            let sizes = sizes.map(|size| size.to_string()).collect::<Vec<_>>().join(" × ");
            return fault("axes", format!("found {sizes} cases; allowed: up to {MAX_CASES}"));
        }
        let SweepRecordTable { played, frames, traces } = self.record;
        if frames == 1 || frames > MAX_SAMPLES {
            return fault("record.frames", format!("found {frames}; allowed: 0, or 2 to {MAX_SAMPLES}"));
        }
        if traces > MAX_SAMPLES {
            return fault("record.traces", format!("found {traces}; allowed: up to {MAX_SAMPLES} of a case"));
        }
        let page = played.min(size.unwrap_or(0)) as f64 * self.motion_bytes();
        if page > MAX_PAGE_BYTES {
            let problem = format!(
                "the motions of {played} cases at {frames} times make a report of {}; allowed: up to {}, which browsers can open; reduce record.frames or record.played",
                bytes(page),
                bytes(MAX_PAGE_BYTES)
            );
            return fault("record.frames", problem);
        }
        let mut moved: Vec<(&str, AxisKind)> = Vec::new();
        for (i, axis) in self.axes.iter().enumerate() {
            if self.axes[..i].iter().any(|other| other.name == axis.name) {
                return fault(&axis.path, format!("found a second axis `{}`; allowed: one of each name", axis.name));
            }
            for key in &axis.keys {
                let before = moved.iter().find(|(other, _)| other == key);
                if axis.kind != AxisKind::Factors && before.is_some() {
                    return fault(
                        &axis.path,
                        format!(
                            "sets {key}, which an earlier axis sets; allowed: one axis with its values, then factors"
                        ),
                    );
                }
                if axis.kind == AxisKind::Factors && before.is_none() && axis::look_up(&self.tables, key).is_none() {
                    return fault(
                        &axis.path,
                        format!("multiplies {key}, which the base scene does not give; add it there or under [set]"),
                    );
                }
                moved.push((key, axis.kind));
            }
        }
        if let Some(split) = &report.split
            && !self.axes.iter().any(|axis| axis.is_called(split) && !axis.sampled)
        {
            let names = self.axes.iter().filter(|axis| !axis.sampled).map(|axis| axis.name.as_str());
            let names: Vec<&str> = names.collect();
            let meant = did_you_mean(nearest(split, names.iter().copied()));
            let allowed = format!("an axis with listed levels: {}{meant}", names.join(", "));
            return fault("report.split", format!("found {split:?}; allowed: {allowed}"));
        }
        Ok(())
    }

    /// Approximate size of the recorded motion of a case, bytes.
    fn motion_bytes(&self) -> f64 {
        let nodes = axis::look_up(&self.tables, "rod.nodes").and_then(axis::number).unwrap_or(f64::INFINITY);
        self.record.frames as f64 * (nodes.min(MAX_POINTS as f64) + 1.5) * 2.0 * BYTES_PER_COORDINATE
    }

    /// Checks that the results of `cases` cases fit into `folder`.
    ///
    /// # Errors
    /// [`Error::Room`] if they do not.
    pub fn fits(&self, cases: usize, folder: &Path) -> Result<()> {
        let rows = cases as f64 * self.record.traces as f64;
        let played = cases.min(self.record.played) as f64;
        let needed =
            cases as f64 * BYTES_PER_ROW + 2.0 * rows * 3.0 * BYTES_PER_COORDINATE + 2.0 * played * self.motion_bytes();
        match free_space(folder) {
            Some(free) if needed > free as f64 => {
                let what = format!(
                    "the rows of {cases} cases, {rows:.3e} rows of traces (record.traces) and {played} motions (record.frames)"
                );
                Err(Error::Room { path: folder.to_path_buf(), what, needed, free: free as f64 })
            }
            _ => Ok(()),
        }
    }

    /// Number of cases.
    pub fn size(&self) -> usize {
        self.dimensions.iter().map(|dimension| self.axes[dimension[0]].levels.len()).product()
    }

    /// Case `index`.
    ///
    /// # Errors
    /// [`Error::Scene`] if a factor multiplies a value that is not a number.
    pub fn case(&self, index: usize) -> Result<Case> {
        let mut levels = vec![0; self.axes.len()];
        let mut rest = index;
        for dimension in self.dimensions.iter().rev() {
            let size = self.axes[dimension[0]].levels.len();
            dimension.iter().for_each(|axis| levels[*axis] = rest % size);
            rest /= size;
        }
        let mut settings: Vec<(usize, String, Value)> = Vec::new();
        for (i, axis) in self.axes.iter().enumerate() {
            let level = &axis.levels[levels[i]];
            for (k, key) in axis.keys.iter().enumerate() {
                let value = level.get(k).unwrap_or(&level[0]);
                if axis.kind != AxisKind::Factors {
                    settings.push((i, key.clone(), value.clone()));
                    continue;
                }
                let before = settings.iter().position(|(_, other, _)| other == key);
                let old = before.map_or_else(|| axis::look_up(&self.tables, key), |at| Some(&settings[at].2));
                let product = old.and_then(|old| axis::product(old, value)).ok_or_else(|| Error::Scene {
                    place: self.places[i].clone(),
                    key: axis.path.clone(),
                    problem: axis::no_product(key, old),
                })?;
                match before {
                    Some(at) => settings[at] = (i, key.clone(), product),
                    None => settings.push((i, key.clone(), product)),
                }
            }
        }
        Ok(Case { index, levels, settings })
    }

    /// The document of a case's scene.
    pub fn document(&self, case: &Case) -> Document {
        let mut document = self.base.clone();
        for (axis, key, value) in &case.settings {
            document.set_value(&self.places[*axis], key, value);
        }
        document
    }

    /// The checked scene of a case, and its hash.
    ///
    /// # Errors
    /// [`Error::Scene`] that names the axis and the case; [`Error::Read`].
    pub fn scene(&self, case: &Case) -> Result<(Scene, String)> {
        let (scene, mut inputs) = self.document(case).resolve().map_err(|error| match error {
            Error::Several(mistakes) => {
                Error::Several(mistakes.into_iter().map(|one| self.in_case(case, one)).collect())
            }
            one => self.in_case(case, one),
        })?;
        let files = scene.files();
        if !files.is_empty() {
            scene.model()?; // reads and checks the tables
        }
        for path in files {
            inputs.extend(scene.read_from.read(&path)?);
        }
        Ok((scene, jobs::hash(&inputs)))
    }

    /// The scene of case `index` and its hash, if [`job`](Self::job) has cached it.
    pub(super) fn kept(&self, index: usize) -> Option<(&Scene, &str)> {
        let checked = self.checked.get()?;
        Some((checked.scenes.get(index)?.as_ref()?, &checked.hashes[index]))
    }

    /// An error in a case's scene, with the description of the case.
    fn in_case(&self, case: &Case, error: Error) -> Error {
        match error {
            Error::Scene { place, key, mut problem } => {
                // The last part of the key's path may be a misspelt key of an axis.
                let axis = self.axes.iter().zip(&self.places).find(|(_, own)| **own == place);
                if let Some(part) = axis.and_then(|(axis, _)| axis.path.rsplit('.').next())
                    && !problem.contains("did you mean")
                {
                    problem += &did_you_mean(nearest(part, axis::AXIS_KEYS.into_iter()));
                }
                let problem = format!("{problem} (in case {}: {})", case.index, self.describe(case));
                Error::Scene { place, key, problem }
            }
            other => other,
        }
    }

    /// A description of a case.
    pub fn describe(&self, case: &Case) -> String {
        let level = |(axis, level): (&SweepAxis, &usize)| format!("{} = {}", axis.name, axis.labels[*level]);
        self.axes.iter().zip(&case.levels).map(level).collect::<Vec<_>>().join(", ")
    }

    /// Checks the scenes of all cases on `threads` threads; returns the job for the journal.
    ///
    /// # Errors
    /// Those of the first invalid case that is found.
    pub fn job(&self, threads: usize) -> Result<Job> {
        let size = self.size();
        let scenes = if size <= MAX_CACHED_SCENES { size } else { 0 };
        let mut checked = CheckedScenes {
            hashes: vec![String::new(); size],
            scenes: std::iter::repeat_with(|| None).take(scenes).collect(),
            tables: BTreeSet::new(),
        };
        let todo: Vec<usize> = (0..self.size()).collect();
        let check = |index| self.scene(&self.case(index)?);
        jobs::run(&todo, threads, check, |index, found| {
            let (scene, hash) = found?;
            checked.hashes[index] = hash;
            checked.tables.extend(scene.files());
            if let Some(kept) = checked.scenes.get_mut(index) {
                *kept = Some(scene);
            }
            Ok(std::ops::ControlFlow::Continue(()))
        })?;
        let inputs = format!("{:?} {:?} {}", self.record, self.columns(), checked.hashes.concat());
        let SweepRecordTable { frames, traces, .. } = self.record;
        let kept = format!("{frames} frames and {traces} traces");
        self.checked.get_or_init(|| checked);
        Ok(Job { kept, ..Job::new(&format!("sweep {}", self.name), inputs.as_bytes(), self.size()) })
    }

    /// Claims `folder` for the results of `job`, the job of this sweep; waits for other shards that hold the folder briefly.
    ///
    /// # Errors
    /// Those of [`Folder::claim`].
    pub fn claim(&self, folder: &Path, job: &Job, claim: Claim) -> Result<Folder> {
        let source = self.own[0].canonicalize().unwrap_or_else(|_| self.own[0].clone());
        let owner = Owner { kind: "sweep".to_string(), name: self.name.clone(), source, fingerprint: job.hash.clone() };
        Folder::claim_shared(folder, owner, claim, &[TABLE, PAGE])
    }

    /// Opens or creates the journal `name` of `job`, the job of this sweep, in `folder`. Identical cases from before levels or axes
    /// were added are reused.
    ///
    /// # Errors
    /// Those of [`Folder::journal`] and [`Journal::open`].
    pub fn journal(&self, folder: &mut Folder, name: &str, job: &Job) -> Result<Journal> {
        let path = folder.journal(name)?;
        let refusal = match Journal::open(&path, job) {
            Ok(journal) => return Ok(journal),
            Err(error) => error,
        };
        match self.migrate_journal(&path, job) {
            Ok(Migration::Done) => Journal::open(&path, job),
            Ok(Migration::OtherCases(problem)) => Err(jobs::of_another_job(&path, &problem)),
            Ok(Migration::OtherJob) | Err(_) => Err(refusal),
        }
    }

    /// Replaces the journal at `path` by one of `job` with the same cases, if it contains only cases of this sweep.
    fn migrate_journal(&self, path: &Path, job: &Job) -> Result<Migration> {
        let old = Journal::read(path)?;
        let grown = Job { hash: job.hash.clone(), size: job.size, ..old.job().clone() };
        let checked = self.checked.get().filter(|_| grown == *job && !old.is_held());
        let Some(CheckedScenes { hashes, .. }) = checked else { return Ok(Migration::OtherJob) };
        let mut known: HashMap<String, usize> = HashMap::new();
        for index in old.indices() {
            known.extend(old.get::<CaseResult>(index)?.map(|row| (row.scene_hash, index)));
        }
        let own: HashSet<&String> = hashes.iter().collect();
        let others: Vec<&String> = known.keys().filter(|hash| !own.contains(hash)).collect();
        if !others.is_empty() {
            return Ok(Migration::OtherCases(self.other_cases(&others)));
        }
        let path =
            &path.canonicalize().map_err(|e| Error::Write { path: path.to_path_buf(), reason: e.to_string() })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
        let mut new = Journal::open(&partial, job)?;
        for (index, hash) in hashes.iter().enumerate() {
            let Some(mut row) = known.get(hash).map(|at| old.get::<CaseResult>(*at)).transpose()?.flatten() else {
                continue;
            };
            if !self.plays(index) {
                row.motion = None;
                row.path.clear();
            } else if row.motion.is_none() {
                continue; // its motion is now to be recorded
            }
            new.add(index, &row)?;
        }
        new.sync()?;
        std::fs::rename(&partial, path)
            .map_err(|e| Error::Write { path: path.to_path_buf(), reason: e.to_string() })?;
        Ok(Migration::Done)
    }

    /// The reason why the scenes with these hashes, which have results, are not among the scenes of the cases.
    fn other_cases(&self, hashes: &[&String]) -> String {
        let count = hashes.len();
        let cases = if count == 1 { "1 of its cases" } else { &format!("{count} of its cases") };
        // If an axis was added, the cases without it are the previous cases.
        let without = |axis: usize| -> Result<HashSet<String>> {
            let mut found = HashSet::new();
            for index in 0..self.size() {
                let mut case = self.case(index)?;
                if case.levels[axis] == 0 {
                    case.settings.retain(|(of, ..)| *of != axis);
                    found.insert(self.scene(&case)?.1);
                }
            }
            Ok(found)
        };
        let few = self.size() <= MAX_CACHED_SCENES;
        let added = (0..self.axes.len())
            .filter(|_| few)
            .find(|axis| without(*axis).is_ok_and(|found| hashes.iter().all(|hash| found.contains(*hash))));
        match added.map(|axis| &self.axes[axis]) {
            Some(axis) => {
                let value = axis.keys.first().and_then(|key| axis::look_up(&self.tables, key));
                let level = match (axis.kind, value) {
                    (AxisKind::Factors, _) => "1".to_string(),
                    (_, Some(value)) if axis.keys.len() == 1 => value.to_string(),
                    _ => "that value".to_string(),
                };
                let axis = &axis.name;
                format!(
                    "{cases} ran with the scene's value of axis {axis}, which this sweep does not have; add {level} to its levels"
                )
            }
            None => format!(
                "{cases} ran with values that this sweep does not have: the scene changed, a level was taken away, or an added axis does not have the scene's value"
            ),
        }
    }

    /// The columns that identify a case: one per axis, then each key without an axis of its name. A column named after a key has
    /// the value that was used.
    pub fn columns(&self) -> Vec<String> {
        self.columns.iter().map(|(name, _)| name.clone()).collect()
    }

    /// The values of a case in these columns.
    pub fn values(&self, case: &Case) -> Vec<Value> {
        let value = |(name, axis): &(String, Option<usize>)| match axis {
            Some(axis) => Some(self.axes[*axis].labels[case.levels[*axis]].clone()),
            None => case.settings.iter().find(|(_, key, _)| key == name).map(|(_, _, value)| value.clone()),
        };
        self.columns.iter().map(|column| value(column).unwrap_or(Value::String(String::new()))).collect()
    }

    /// True if the motion of the case is recorded.
    pub fn plays(&self, index: usize) -> bool {
        self.record.frames > 0 && self.played.contains(&index)
    }

    /// The text of its file.
    pub fn text(&self) -> &str {
        self.document.text()
    }

    /// The default folder of its results.
    pub fn folder(&self) -> PathBuf {
        PathBuf::from("out").join(&self.name)
    }
}

/// See [`Sweep::columns`].
fn columns(axes: &[SweepAxis]) -> Vec<(String, Option<usize>)> {
    let keys = || axes.iter().flat_map(|axis| &axis.keys);
    let mut columns: Vec<(String, Option<usize>)> = Vec::new();
    for (i, axis) in axes.iter().enumerate() {
        if !keys().any(|key| *key == axis.name) {
            columns.push((axis.name.clone(), Some(i)));
            continue;
        }
        columns.push((axis.name.clone(), None));
        if axis.labels.iter().zip(&axis.levels).any(|(label, level)| label != &level[0]) {
            columns.push((format!("{}.label", axis.name), Some(i)));
        }
    }
    for key in keys() {
        if !columns.iter().any(|(name, _)| name == key) {
            columns.push((key.clone(), None));
        }
    }
    columns
}

/// The reason why `key` cannot be set to `value` along with `axes`: one of them sets it, or a key that excludes it. An axis may set
/// entries of a list.
fn excluded(axes: &[SweepAxis], key: &str, value: &Value) -> std::result::Result<(), String> {
    let within = |a: &str, b: &str| a == b || a.strip_prefix(b).is_some_and(|rest| rest.starts_with('.'));
    let replaces = |own: &str| within(key, own) || within(own, key) && !value.is_array();
    let sets = |axis: &&SweepAxis| {
        let mut keys = axis.keys.iter();
        axis.kind != AxisKind::Factors
            && keys.any(|own| replaces(own) || exclusive_keys(key).any(|rival| rival == *own))
    };
    match axes.iter().find(sets) {
        Some(axis) => {
            Err(format!("found together with the axis `{}`, which replaces it; leave one of them out", axis.name))
        }
        None => Ok(()),
    }
}

/// The groups of axes that advance together: all sampled axes, and each other axis alone.
fn dimensions(axes: &[SweepAxis]) -> Vec<Vec<usize>> {
    let mut dimensions: Vec<Vec<usize>> = Vec::new();
    for (i, axis) in axes.iter().enumerate() {
        match dimensions.iter_mut().find(|dimension| axis.sampled && axes[dimension[0]].sampled) {
            Some(dimension) => dimension.push(i),
            None => dimensions.push(vec![i]),
        }
    }
    dimensions
}
