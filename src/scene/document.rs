//! The TOML text of a scene and the overrides of its keys. Errors are located by file, line and key ([`Document::error_at`]); overrides
//! are resolved in layers ([`Document::begin_layer`]).

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};
use twox_hash::XxHash3_128;

use super::error_location::{key_at, rephrase, span_of};
use super::files::{Contents, Files};
use super::key_error::KeyError;
use super::override_layers::{apply_layer, mark_functions, merge_layer, remove_excluded_keys};
use super::placeholders::{PLACEHOLDERS, substitute};
use super::value::refused;
use super::{
    ActuationTable, HeadTable, LoadsTable, MediumTable, RecordTable, RodTable, Scene, SolverTable, StartTable,
    Unchecked,
};
use crate::error::{Error, Result, did_you_mean, nearest};
use crate::reduced::FluidChoice;
use crate::wording::Phrase;

/// Size limit of a scene file.
const MAX_BYTES: u64 = 16 << 20;

/// A wrong value of up to this many bytes is quoted in the error.
const MAX_SHOWN_BYTES: usize = 60;

/// The text of a scene and the overrides of its keys.
#[derive(Debug, Clone)]
pub struct Document {
    path: PathBuf,
    text: String,
    overrides: Vec<String>,
    /// Source of the file and its tables.
    files: Files,
    /// Origin of each override, as errors name it.
    origins: Vec<String>,
    /// The layer of each override, starting at 1. The text is layer 0.
    layers: Vec<usize>,
    /// The layer of the next override.
    layer: usize,
    /// The drag law for scenes that leave it to the program. If `None`, it is chosen from the motion of the scene itself.
    fluid: Option<FluidChoice>,
}

/// The files of a packed scene.
const PACKED: [&str; 2] = ["scene.toml", "overrides.txt"];

/// The name of table `i` of a packed scene.
fn packed_table(i: usize) -> String {
    format!("table-{i}.csv")
}

impl Document {
    /// Reads a scene file.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_from(Files::default(), path)
    }

    /// Reads a scene file from `files`, which also holds its tables.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn read_from(files: Files, path: &Path) -> Result<Self> {
        let size = files.size(path)?;
        if size > MAX_BYTES {
            let reason = format!("it has {size} bytes, a scene has at most {MAX_BYTES}");
            return Err(Error::Read { path: path.to_path_buf(), reason });
        }
        let text = files.text(path)?;
        Ok(Self { files, ..Self::new(path, text) })
    }

    /// A scene from text. Errors show `path`; paths of tables are relative to its folder.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            text: text.into(),
            overrides: Vec::new(),
            files: Files::default(),
            origins: Vec::new(),
            layers: Vec::new(),
            layer: 1,
            fluid: None,
        }
    }

    /// Fixes the drag law and the added mass that the program has chosen for `scene`, so that results do not jump when numbers of
    /// the scene vary.
    pub fn keep_fluid_of(&mut self, scene: &Scene) {
        self.fluid = scene.fluid_choice_or_fixed();
    }

    /// Reads a scene that was packed into a folder by [`packed`](Self::packed).
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn unpack(folder: &Path) -> Result<Self> {
        let mut document = Self::read(&folder.join(PACKED[0]))?;
        let overrides = folder.join(PACKED[1]);
        if overrides.exists() {
            document.set_override_lines(Self::read(&overrides)?.text.lines())?;
        }
        let mut tables = Contents::new();
        for (i, path) in document.scene()?.files().into_iter().enumerate() {
            tables.insert(path, document.files.read(&folder.join(packed_table(i)))?);
        }
        document.files = Files::of(tables);
        Ok(document)
    }

    /// All files of the scene by name and content: its text, its overrides and its tables.
    ///
    /// # Errors
    /// Errors of [`scene`](Self::scene), and [`Error::Read`] for a table.
    pub fn packed(&self) -> Result<Vec<(String, Vec<u8>)>> {
        let scene = self.scene()?;
        let mut files = vec![(PACKED[0].to_string(), self.text.clone().into_bytes())];
        if !self.overrides.is_empty() {
            files.push((PACKED[1].to_string(), self.override_lines().join("\n").into_bytes()));
        }
        for (i, path) in scene.files().into_iter().enumerate() {
            files.push((packed_table(i), self.files.read(&path)?));
        }
        Ok(files)
    }

    /// The paths and contents of the tables of its `scene`.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn tables(&self, scene: &Scene) -> Result<Contents> {
        scene.files().into_iter().map(|path| Ok((path.clone(), self.files.read(&path)?))).collect()
    }

    /// Uses the contents of these files instead of the disk.
    pub fn with_files(self, files: Contents) -> Self {
        Self { files: Files::over_disk(files), ..self }
    }

    /// The files, by name and content, of an equivalent scene without overrides that can be moved to any folder. Its text is in the
    /// file `name`, with its tables in the same folder.
    ///
    /// # Errors
    /// Errors of [`packed`](Self::packed).
    pub fn standalone(&self, name: &str) -> Result<Vec<(String, Vec<u8>)>> {
        let scene = self.scene()?;
        let mut text: toml::Table = self.read_as()?;
        text.insert("name".to_string(), toml::Value::String(scene.name.clone()));
        let mut files = Vec::new();
        for (i, table) in scene.tables().into_iter().enumerate() {
            files.push((packed_table(i), self.files.read(&scene.table_path(table))?));
            for key in ["head", "medium"] {
                text.get_mut(key).into_iter().for_each(|value| rename_table(value, table, &packed_table(i)));
            }
        }
        files.insert(0, (name.to_string(), text.to_string().into_bytes()));
        Ok(files)
    }

    /// The text, without overrides.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The overrides, in order.
    pub fn overrides(&self) -> &[String] {
        &self.overrides
    }

    /// Begins a new layer of overrides. The overrides of one layer are merged regardless of their order; two that exclude each other,
    /// such as a time step and a tolerance, are an error. An override removes the keys of lower layers, including the text, that it
    /// excludes. If a layer sets a key twice, the last value applies; a key takes precedence over the table that contains it.
    pub fn begin_layer(&mut self) {
        self.layer += 1;
    }

    /// The overrides in order, with an empty line at the start of each layer.
    pub fn override_lines(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for (i, text) in self.overrides.iter().enumerate() {
            if i > 0 && self.layers[i] != self.layers[i - 1] {
                lines.push(String::new());
            }
            lines.push(text.clone());
        }
        lines
    }

    /// Applies the [`override_lines`](Self::override_lines) of another document.
    ///
    /// # Errors
    /// Errors of [`set`](Self::set).
    pub fn set_override_lines<'l>(&mut self, lines: impl IntoIterator<Item = &'l str>) -> Result<()> {
        lines.into_iter().try_for_each(|line| match line {
            "" => {
                self.begin_layer();
                Ok(())
            }
            assignment => self.set(assignment),
        })
    }

    /// Overrides a key by `table.key=value`. A value that is not TOML is a string. A table is merged into the existing one, but a
    /// function of time ([`ScalarSignal`](super::value::ScalarSignal)) replaces it.
    ///
    /// # Errors
    /// [`Error::Scene`] for any other form.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        self.set_as(&Phrase::Override.to_string(), assignment)
    }

    /// The same as [`set`](Self::set); errors show `before` in front of the override, such as the option of a command.
    ///
    /// # Errors
    /// Errors of [`set`](Self::set).
    pub fn set_as(&mut self, before: &str, assignment: &str) -> Result<()> {
        let place = || format!("{before}{assignment}");
        let refuse = |problem: &str| Error::Scene { place: place(), key: String::new(), problem: problem.to_string() };
        let (key, value) = assignment.split_once('=').ok_or_else(|| refuse("allowed: table.key=value"))?;
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || key.starts_with('#') || assignment.trim().contains(['\n', '\r']) {
            return Err(refuse("allowed: table.key=value on one line"));
        }
        let as_is = format!("{key}={value}");
        let quoted = || format!("{key}={}", toml::Value::String(value.to_string()));
        let text = if DeTable::parse(&as_is).is_ok() { as_is } else { quoted() };
        DeTable::parse(&text).map_err(|e| refuse(e.message()))?;
        self.add(format!("{before}{text}"), text);
        Ok(())
    }

    /// Overrides a dotted key by `value`. Errors show `origin` as its location.
    pub fn set_value(&mut self, origin: &str, key: &str, value: &toml::Value) {
        self.add(origin.to_string(), format!("{key}={value}"));
    }

    fn add(&mut self, origin: String, text: String) {
        self.origins.push(origin);
        self.overrides.push(text);
        self.layers.push(self.layer);
    }

    /// The checked scene, and bytes that identify the content of the document with its overrides: they are equal for equal keys
    /// and values, however these are written.
    ///
    /// # Errors
    /// Errors of [`scene`](Self::scene).
    pub fn resolve(&self) -> Result<(Scene, Vec<u8>)> {
        self.with_root(|root| {
            let mut content = Vec::with_capacity(2 * self.text.len());
            hash_table(root.get_ref(), &mut content);
            Ok((self.scene_from(root)?, content))
        })
    }

    /// Deserialises text and overrides as another type than a scene.
    ///
    /// # Errors
    /// [`Error::Scene`] with file, line and key.
    pub fn read_as<T: DeserializeOwned>(&self) -> Result<T> {
        self.with_root(|root| self.deserialized(root))
    }

    /// The byte offsets of `keys` in the text.
    ///
    /// # Errors
    /// [`Error::Scene`] if it is not TOML.
    pub fn positions(&self, keys: &[String]) -> Result<Vec<usize>> {
        let position = |root: &DeTable<'_>, key: &String| span_of(root, key).map_or(0, |span| span.start);
        self.with_root(|root| Ok(keys.iter().map(|key| position(root.get_ref(), key)).collect()))
    }

    /// The checked scene.
    ///
    /// # Errors
    /// [`Error::Scene`] with file, line and key; [`Error::Several`] if several keys are wrong.
    pub fn scene(&self) -> Result<Scene> {
        self.with_root(|root| self.scene_from(root))
    }

    /// Locates an error of a key: adds file and line, or the override.
    pub fn error_at(&self, fault: &KeyError) -> Error {
        let at = |root: &Spanned<DeTable<'_>>| Ok(self.error(root, span_of(root.get_ref(), &fault.key), fault));
        self.with_root(at).unwrap_or_else(|error| error)
    }

    /// An `error` of its scene, with the location of the key if the error has a key.
    pub fn located(&self, error: Error) -> Error {
        match error {
            Error::Scene { key, problem, .. } if !key.is_empty() => self.error_at(&KeyError { key, problem }),
            other => other,
        }
    }

    /// The location of a key as errors show it: file and line, or the override.
    pub fn place_of(&self, key: &str) -> String {
        match self.error_at(&KeyError { key: key.to_string(), problem: String::new() }) {
            Error::Scene { place, .. } => place,
            _ => self.path.display().to_string(),
        }
    }

    /// Parses text and overrides, and calls `read` with the merged root table.
    fn with_root<T>(&self, read: impl FnOnce(&Spanned<DeTable<'_>>) -> Result<T>) -> Result<T> {
        let mut root = DeTable::parse(&self.text).map_err(|e| Error::Scene {
            place: self.place(e.span()),
            key: String::new(),
            problem: format!("not TOML: {}", e.message()),
        })?;
        // Every override is parsed after as many blanks as there is text before it, so that spans do not overlap.
        let mut texts = Vec::new();
        for (text, start) in self.overrides.iter().zip(self.override_offsets()) {
            texts.push(format!("{}{text}", " ".repeat(start)));
        }
        let mut layer = (0, DeTable::new());
        let located =
            |root: &Spanned<DeTable<'_>>, (fault, span): (KeyError, Range<usize>)| self.error(root, Some(span), &fault);
        // Keys take precedence over the tables that contain them, in any order.
        let depth = |text: &str| text.split('=').next().map_or(0, |key| key.matches('.').count());
        let mut order: Vec<usize> = (0..texts.len()).collect();
        order.sort_by_key(|i| (self.layers[*i], depth(&texts[*i])));
        for (text, number) in order.into_iter().map(|i| (&texts[i], &self.layers[i])) {
            let mut table = DeTable::parse(text).map_err(|e| {
                self.error(&root, e.span(), &KeyError { key: String::new(), problem: e.message().into() })
            })?;
            mark_functions(table.get_mut(), depth(text) + 1);
            if layer.0 != *number {
                let over = std::mem::replace(&mut layer, (*number, DeTable::new())).1;
                apply_layer(root.get_mut(), over, "").map_err(|fault| located(&root, fault))?;
            }
            merge_layer(&mut layer.1, table.into_inner(), "").map_err(|fault| located(&root, fault))?;
        }
        apply_layer(root.get_mut(), layer.1, "").map_err(|fault| located(&root, fault))?;
        if !texts.is_empty() {
            let starts: Vec<usize> = self.override_offsets().collect();
            // The text before the first override is layer 0.
            let layer_of =
                |at: usize| starts.partition_point(|start| *start <= at).checked_sub(1).map_or(0, |i| self.layers[i]);
            remove_excluded_keys(root.get_mut(), &layer_of);
        }
        read(&root)
    }

    fn scene_from(&self, root: &Spanned<DeTable<'_>>) -> Result<Scene> {
        if root.get_ref().contains_key("axes") && root.get_ref().contains_key("scene") {
            let problem = format!("this is a sweep, not a scene; {}", Phrase::RunsSweep);
            let fault = KeyError { key: "axes".to_string(), problem };
            return Err(self.error(root, span_of(root.get_ref(), &fault.key), &fault));
        }
        let mut scene = self.parsed(root).map_err(|first| self.all_errors(root, first))?;
        if scene.name.is_empty() {
            scene.name = self.path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into());
        }
        scene.folder = self.path.parent().map(Path::to_path_buf).unwrap_or_default();
        scene.read_from = self.files.clone();
        scene.file.clone_from(&self.path);
        scene.contents = contents(&scene);
        scene.check().map_err(|fault| self.error(root, span_of(root.get_ref(), &fault.key), &fault))?;
        match &self.fluid {
            Some(fluid) => scene.set_fluid_choice(fluid.clone()),
            None => scene.choose_fluid(),
        }
        Ok(scene)
    }

    /// The scene with each key checked on its own only.
    fn parsed(&self, root: &Spanned<DeTable<'_>>) -> Result<Scene> {
        check_tables(root.get_ref()).map_err(|fault| self.error(root, span_of(root.get_ref(), &fault.key), &fault))?;
        self.deserialized(root).map(|Unchecked(scene)| scene)
    }

    /// All errors of the text in order: after each, a valid value is substituted and the scene is parsed again, beginning with `first`.
    fn all_errors(&self, root: &Spanned<DeTable<'_>>, first: Error) -> Error {
        let placeholders = DeTable::parse(PLACEHOLDERS);
        let Ok(placeholders) = &placeholders else { return first };
        let mut substituted = root.clone();
        let mut reported: Vec<(String, Error)> = Vec::new();
        let mut next = Some(first.clone());
        while let Some(error) = next.take() {
            let Error::Scene { key, .. } = &error else { break };
            let key = key.clone();
            // A repeated error, or one about a removed key, is not an error of the text.
            let made = |(other, _): &(String, Error)| {
                other.strip_prefix(&*key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            if reported.iter().any(made) {
                break;
            }
            reported.push((key.clone(), error));
            if reported.len() < MAX_ERRORS && substitute(substituted.get_mut(), placeholders.get_ref(), &key) {
                next = self.parsed(&substituted).err();
            }
        }
        // Missing keys come last, because another error may be a misspelt one.
        let missing = |error: &Error| matches!(error, Error::Scene { problem, .. } if problem.starts_with("missing"));
        let start = |key: &str| span_of(root.get_ref(), key).map_or(usize::MAX, |span| span.start);
        reported.sort_by_key(|(key, error)| (missing(error), start(key)));
        if reported.len() < 2 { first } else { Error::Several(reported.into_iter().map(|(_, error)| error).collect()) }
    }

    fn deserialized<T: DeserializeOwned>(&self, root: &Spanned<DeTable<'_>>) -> Result<T> {
        T::deserialize(toml::Deserializer::from(root.clone())).map_err(|e| {
            let span = e.span().filter(|span| *span != root.span());
            let key = span.as_ref().and_then(|span| key_at(root.get_ref(), span.start)).unwrap_or_default();
            let found = span.as_ref().and_then(|span| self.source(span));
            let (key, mut problem) = rephrase(key, e.message(), found);
            if problem.starts_with("unknown key; allowed: `name`, `rod`") {
                problem += &did_you_mean(in_a_table(&key).as_deref());
            }
            self.error(root, span, &KeyError { key, problem })
        })
    }

    fn error(&self, root: &Spanned<DeTable<'_>>, span: Option<Range<usize>>, fault: &KeyError) -> Error {
        let span = span.filter(|span| *span != root.span());
        Error::Scene { place: self.place(span), key: fault.key.clone(), problem: fault.problem.clone() }
    }

    /// The offset of each override in the numbering of spans.
    fn override_offsets(&self) -> impl Iterator<Item = usize> {
        self.overrides.iter().scan(self.text.len() + 1, |next, text| {
            let start = *next;
            *next += text.len() + 1;
            Some(start)
        })
    }

    /// The text at `span`, if it is short.
    fn source(&self, span: &Range<usize>) -> Option<&str> {
        let overrides = self.overrides.iter().map(String::as_str).zip(self.override_offsets());
        let mut texts = std::iter::once((self.text.as_str(), 0)).chain(overrides);
        let found = texts.find_map(|(text, at)| text.get(span.start.checked_sub(at)?..span.end.checked_sub(at)?))?;
        (found.len() <= MAX_SHOWN_BYTES && !found.contains('\n')).then_some(found)
    }

    /// The location of `span` for errors: file and line, or the origin of the override.
    fn place(&self, span: Option<Range<usize>>) -> String {
        let start = span.map_or(0, |span| span.start);
        if start > self.text.len() {
            let mut overrides = self.overrides.iter().zip(self.override_offsets()).zip(&self.origins);
            if let Some((_, origin)) = overrides.find(|((text, at), _)| (*at..=at + text.len()).contains(&start)) {
                return origin.clone();
            }
        }
        let before = &self.text.as_bytes()[..start.min(self.text.len())];
        format!("{}:{}", self.path.display(), 1 + before.iter().filter(|byte| **byte == b'\n').count())
    }
}

/// Renames the file `from` to `to` in every `{ table = … }` in `value`.
fn rename_table(value: &mut toml::Value, from: &str, to: &str) {
    match value {
        toml::Value::Table(table) => {
            if let Some(toml::Value::String(file)) = table.get_mut("table").filter(|file| file.as_str() == Some(from)) {
                *file = to.to_string();
                return;
            }
            table.iter_mut().for_each(|(_, value)| rename_table(value, from, to));
        }
        toml::Value::Array(values) => values.iter_mut().for_each(|value| rename_table(value, from, to)),
        _ => {}
    }
}

/// Hash of the contents of the tables of `scene`, as far as they can be read.
fn contents(scene: &Scene) -> u128 {
    let mut hasher = XxHash3_128::new();
    for table in scene.files().into_iter().map(|table| scene.read_from.read(&table).unwrap_or_default()) {
        hasher.write(&(table.len() as u64).to_le_bytes());
        hasher.write(&table);
    }
    hasher.finish_128()
}

/// Appends the identifying bytes of a table: its keys in order, with their values.
fn hash_table(table: &DeTable<'_>, content: &mut Vec<u8>) {
    content.push(b'{');
    for (key, value) in table {
        hash_text(key.get_ref(), content);
        hash_value(value.get_ref(), content);
    }
    content.push(b'}');
}

fn hash_value(value: &DeValue<'_>, content: &mut Vec<u8>) {
    match value {
        DeValue::Table(table) => hash_table(table, content),
        DeValue::Array(items) => {
            content.push(b'[');
            items.iter().for_each(|item| hash_value(item.get_ref(), content));
            content.push(b']');
        }
        DeValue::Float(x) => {
            content.push(b'f');
            content.extend(x.as_str().parse::<f64>().unwrap_or(f64::NAN).to_le_bytes());
        }
        DeValue::Integer(x) => {
            content.push(b'i');
            content.extend(i128::from_str_radix(x.as_str(), x.radix()).unwrap_or_default().to_le_bytes());
        }
        DeValue::String(text) => hash_text(text, content),
        DeValue::Boolean(truth) => content.extend([b'b', u8::from(*truth)]),
        DeValue::Datetime(time) => hash_text(&time.to_string(), content),
    }
}

fn hash_text(text: &str, content: &mut Vec<u8>) {
    content.push(b's');
    content.extend((text.len() as u64).to_le_bytes());
    content.extend(text.as_bytes());
}

/// The key in one of a scene's tables that the unknown top-level `key` most likely stands for.
fn in_a_table(key: &str) -> Option<String> {
    fn names<T: DeserializeOwned>(table: &str) -> Vec<String> {
        // Serde's message for an unknown key lists the allowed ones.
        let message = toml::from_str::<T>("\"?\" = 0").err().map(|error| error.message().to_string());
        let names = message.iter().flat_map(|text| text.split('`').skip(3).step_by(2));
        names.map(|name| format!("{table}.{name}")).collect()
    }
    let all = [
        names::<RodTable>("rod"),
        names::<ActuationTable>("actuation"),
        names::<StartTable>("start"),
        names::<MediumTable>("medium"),
        names::<LoadsTable>("loads"),
        names::<HeadTable>("head"),
        names::<SolverTable>("solver"),
        names::<RecordTable>("record"),
    ]
    .concat();
    let name = |full: &String| full.split_once('.').map_or(String::new(), |(_, name)| name.to_string());
    let names: Vec<String> = all.iter().map(name).collect();
    let near = nearest(key, names.iter().map(String::as_str))?;
    all.iter().find(|full| name(full) == near).cloned()
}

/// The largest number of errors that are reported at once.
const MAX_ERRORS: usize = 12;

/// Returns errors that serde would not report, or not clearly: lists instead of tables, which serde reads as the fields of a
/// struct, and unknown keys of `[solver]`, which it reports after missing ones.
fn check_tables(root: &DeTable<'_>) -> std::result::Result<(), KeyError> {
    for (key, value) in root {
        if key.get_ref() == "tendons" {
            let entries = value.get_ref().as_array();
            if entries.is_none_or(|entries| entries.iter().any(|tendon| !tendon.get_ref().is_table())) {
                let problem = "found something other than tables; allowed: one [[tendons]] for each tendon";
                return Err(KeyError { key: "tendons".into(), problem: problem.into() });
            }
        } else if value.get_ref().is_array() {
            return Err(KeyError { key: key.get_ref().to_string(), problem: refused("a list", "a table") });
        }
    }
    let inside = |table: &str, key: &str| root.get(table)?.get_ref().as_table()?.get(key).map(Spanned::get_ref);
    if let Some(DeValue::Array(points)) = inside("loads", "point")
        && let Some(i) = points.iter().position(|point| !point.get_ref().is_table())
    {
        let problem = format!("point {i} is not a table; allowed: tables {{ node, force_n }}");
        return Err(KeyError { key: "loads.point".to_string(), problem });
    }
    let Some(DeValue::Table(solver)) = root.get("solver").map(Spanned::get_ref) else { return Ok(()) };
    let integrator = inside("solver", "integrator").and_then(DeValue::as_str);
    solver.keys().try_for_each(|key| super::solver::check_solver_key(key.get_ref(), integrator))
}
