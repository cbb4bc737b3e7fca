//! A scene's text with overrides: parsed once, and every complaint finds its way back to file, line and key.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};
use twox_hash::XxHash3_128;

use super::files::{Contents, Files};
use super::key_error::{KeyError, unknown_key};
use super::value::{SIGNAL_KEYS, refused};
use super::{Scene, Unchecked};
use crate::error::{Error, Result, did_you_mean, nearest};
use crate::integrator::{METHODS, Method};
use crate::reduced::FluidChoice;

/// A larger file is no scene.
const LARGEST: u64 = 16 << 20;

/// Up to this many bytes of a wrong value are shown as they are written.
const LONGEST_FOUND: usize = 60;

/// The text of a scene and the overrides of its keys.
#[derive(Debug, Clone)]
pub struct Document {
    path: PathBuf,
    text: String,
    overrides: Vec<String>,
    /// Where it, and the tables that it names, are read from.
    files: Files,
    /// Who made each override, as errors name it.
    makers: Vec<String>,
    /// The layer of each override, from 1; the text is layer 0.
    layers: Vec<usize>,
    /// That of the next one.
    layer: usize,
    /// What its scenes take of the fluid that they leave to the program; where it is absent, what their own motion says.
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

    /// Reads a scene file of `files`, where its tables are too.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn read_from(files: Files, path: &Path) -> Result<Self> {
        let size = files.size(path)?;
        if size > LARGEST {
            let reason = format!("it has {size} bytes, a scene has at most {LARGEST}");
            return Err(Error::Read { path: path.to_path_buf(), reason });
        }
        let text = files.text(path)?;
        Ok(Self { files, ..Self::new(path, text) })
    }

    /// A scene from text; `path` is shown in errors, and tables are looked for beside it.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            text: text.into(),
            overrides: Vec::new(),
            files: Files::default(),
            makers: Vec::new(),
            layers: Vec::new(),
            layer: 1,
            fluid: None,
        }
    }

    /// Its scenes with other numbers take the law of the fluid, and the water that the rod accelerates, as `scene` does, where they leave
    /// that to the program: what follows them from number to number would jump else.
    pub fn keep_fluid_of(&mut self, scene: &Scene) {
        self.fluid = scene.taken_fluid();
    }

    /// Reads a scene that was packed into a folder by [`packed`](Self::packed).
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn unpack(folder: &Path) -> Result<Self> {
        let mut document = Self::read(&folder.join(PACKED[0]))?;
        let overrides = folder.join(PACKED[1]);
        if overrides.exists() {
            document.set_layers(Self::read(&overrides)?.text.lines())?;
        }
        let mut tables = Contents::new();
        for (i, path) in document.scene()?.files().into_iter().enumerate() {
            tables.insert(path, document.files.read(&folder.join(packed_table(i)))?);
        }
        document.files = Files::of(tables);
        Ok(document)
    }

    /// The files that hold the whole scene, names and contents: its text, its overrides, and the tables that it names.
    ///
    /// # Errors
    /// Those of [`scene`](Self::scene), and [`Error::Read`] for a table.
    pub fn packed(&self) -> Result<Vec<(String, Vec<u8>)>> {
        let scene = self.scene()?;
        let mut files = vec![(PACKED[0].to_string(), self.text.clone().into_bytes())];
        if !self.overrides.is_empty() {
            files.push((PACKED[1].to_string(), self.layered().join("\n").into_bytes()));
        }
        for (i, path) in scene.files().into_iter().enumerate() {
            files.push((packed_table(i), self.files.read(&path)?));
        }
        Ok(files)
    }

    /// The tables that its `scene` names, with their contents.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn tables(&self, scene: &Scene) -> Result<Contents> {
        scene.files().into_iter().map(|path| Ok((path.clone(), self.files.read(&path)?))).collect()
    }

    /// The same with the contents of these files, which are no longer read from the disk.
    pub fn carrying(self, files: Contents) -> Self {
        Self { files: Files::over_disk(files), ..self }
    }

    /// Files of one scene without overrides that says the same from any folder, names and contents: its text in `name`, and the
    /// tables that it names beside it.
    ///
    /// # Errors
    /// Those of [`packed`](Self::packed).
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

    /// Its text, without overrides.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The overrides, in order.
    pub fn overrides(&self) -> &[String] {
        &self.overrides
    }

    /// Begins a new layer of overrides. Overrides are resolved layer by layer: those of one layer merge into one document whatever
    /// their order, and where two of them exclude each other, as a time step and a tolerance, the scene is refused. What an override
    /// of a higher layer excludes in a lower one, the text included, goes. Of one key that a layer sets twice the last value holds, and a key holds against the table that it is in.
    pub fn begin_layer(&mut self) {
        self.layer += 1;
    }

    /// The overrides in order, with an empty one where a layer begins.
    pub fn layered(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for (i, text) in self.overrides.iter().enumerate() {
            if i > 0 && self.layers[i] != self.layers[i - 1] {
                lines.push(String::new());
            }
            lines.push(text.clone());
        }
        lines
    }

    /// Sets what [`layered`](Self::layered) says of another document.
    ///
    /// # Errors
    /// Those of [`set`](Self::set).
    pub fn set_layers<'l>(&mut self, lines: impl IntoIterator<Item = &'l str>) -> Result<()> {
        lines.into_iter().try_for_each(|line| match line {
            "" => {
                self.begin_layer();
                Ok(())
            }
            assignment => self.set(assignment),
        })
    }

    /// Overrides a key, as `table.key=value`; a value that is not TOML is taken as a string. A table goes on top of the one that is
    /// there; a function of time ([`ScalarSignal`](super::value::ScalarSignal)) replaces it.
    ///
    /// # Errors
    /// [`Error::Scene`] where it has not that form.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let place = || format!("--set {assignment}");
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
        self.add(format!("--set {text}"), text);
        Ok(())
    }

    /// Overrides a dotted key by `value`; errors name `maker` as the place.
    pub fn put(&mut self, maker: &str, key: &str, value: &toml::Value) {
        self.add(maker.to_string(), format!("{key}={value}"));
    }

    fn add(&mut self, maker: String, text: String) {
        self.makers.push(maker);
        self.overrides.push(text);
        self.layers.push(self.layer);
    }

    /// The scene, checked, and what names all that the document with its overrides says, both of one reading: bytes that are the same
    /// where keys and values are, however they are written.
    ///
    /// # Errors
    /// Those of [`scene`](Self::scene).
    pub fn resolved(&self) -> Result<(Scene, Vec<u8>)> {
        self.with_root(|root| {
            let mut content = Vec::with_capacity(2 * self.text.len());
            name_table(root.get_ref(), &mut content);
            Ok((self.scene_of(root)?, content))
        })
    }

    /// Text and overrides as another kind of file than a scene, or as mere tables.
    ///
    /// # Errors
    /// [`Error::Scene`] with file, line and key.
    pub fn read_as<T: DeserializeOwned>(&self) -> Result<T> {
        self.with_root(|root| self.deserialized(root))
    }

    /// Where `keys` stand in the text, one number each, rising from its beginning to its end.
    ///
    /// # Errors
    /// [`Error::Scene`] where it is not TOML.
    pub fn positions(&self, keys: &[String]) -> Result<Vec<usize>> {
        let position = |root: &DeTable<'_>, key: &String| span_of(root, key).map_or(0, |span| span.start);
        self.with_root(|root| Ok(keys.iter().map(|key| position(root.get_ref(), key)).collect()))
    }

    /// The scene, checked.
    ///
    /// # Errors
    /// [`Error::Scene`] with file, line and key; [`Error::Several`] of these, where more than one key is wrong by itself.
    pub fn scene(&self) -> Result<Scene> {
        self.with_root(|root| self.scene_of(root))
    }

    /// The error of a fault that was found after reading, at its key.
    pub fn refuse(&self, fault: &KeyError) -> Error {
        let at = |root: &Spanned<DeTable<'_>>| Ok(self.error(root, span_of(root.get_ref(), &fault.key), fault));
        self.with_root(at).unwrap_or_else(|error| error)
    }

    /// The place of a key as errors name it.
    pub fn place_of(&self, key: &str) -> String {
        match self.refuse(&KeyError { key: key.to_string(), problem: String::new() }) {
            Error::Scene { place, .. } => place,
            _ => self.path.display().to_string(),
        }
    }

    /// Parses text and overrides.
    fn with_root<T>(&self, read: impl FnOnce(&Spanned<DeTable<'_>>) -> Result<T>) -> Result<T> {
        let mut root = DeTable::parse(&self.text).map_err(|e| Error::Scene {
            place: self.place(e.span()),
            key: String::new(),
            problem: format!("not TOML: {}", e.message()),
        })?;
        // Every override is parsed behind as many blanks as there is text before it, so that no two spans overlap.
        let mut texts = Vec::new();
        for (text, start) in self.overrides.iter().zip(self.starts()) {
            texts.push(format!("{}{text}", " ".repeat(start)));
        }
        let mut layer = (0, DeTable::new());
        // Keys go on top of the tables that hold them, whichever comes first.
        let depth = |text: &str| text.split('=').next().map_or(0, |key| key.matches('.').count());
        let mut order: Vec<usize> = (0..texts.len()).collect();
        order.sort_by_key(|i| (self.layers[*i], depth(&texts[*i])));
        for (text, number) in order.into_iter().map(|i| (&texts[i], &self.layers[i])) {
            let table = DeTable::parse(text).map_err(|e| {
                self.error(&root, e.span(), &KeyError { key: String::new(), problem: e.message().into() })
            })?;
            if layer.0 != *number {
                overlay(root.get_mut(), std::mem::replace(&mut layer, (*number, DeTable::new())).1);
            }
            if let Err((fault, span)) = unite(&mut layer.1, table.into_inner(), "") {
                return Err(self.error(&root, Some(span), &fault));
            }
        }
        overlay(root.get_mut(), layer.1);
        if !texts.is_empty() {
            let starts: Vec<usize> = self.starts().collect();
            // The text before the first override is layer 0.
            let layer_of =
                |at: usize| starts.partition_point(|start| *start <= at).checked_sub(1).map_or(0, |i| self.layers[i]);
            settle(root.get_mut(), &layer_of);
        }
        read(&root)
    }

    fn scene_of(&self, root: &Spanned<DeTable<'_>>) -> Result<Scene> {
        if root.get_ref().contains_key("axes") && root.get_ref().contains_key("scene") {
            let problem = "this is a sweep, not a scene; `caudal sweep` runs it".to_string();
            let fault = KeyError { key: "axes".to_string(), problem };
            return Err(self.error(root, span_of(root.get_ref(), &fault.key), &fault));
        }
        let mut scene = self.parsed(root).map_err(|first| self.all_mistakes(root, first))?;
        if scene.name.is_empty() {
            scene.name = self.path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into());
        }
        scene.folder = self.path.parent().map(Path::to_path_buf).unwrap_or_default();
        scene.read_from = self.files.clone();
        scene.file.clone_from(&self.path);
        scene.contents = contents(&scene);
        scene.check().map_err(|fault| self.error(root, span_of(root.get_ref(), &fault.key), &fault))?;
        match &self.fluid {
            Some(fluid) => scene.take_fluid(fluid.clone()),
            None => scene.choose_fluid(),
        }
        Ok(scene)
    }

    /// The scene as far as each key can be judged by itself.
    fn parsed(&self, root: &Spanned<DeTable<'_>>) -> Result<Scene> {
        check_tables(root.get_ref()).map_err(|fault| self.error(root, span_of(root.get_ref(), &fault.key), &fault))?;
        self.deserialized(root).map(|Unchecked(scene)| scene)
    }

    /// The `first` mistake with those that remain where it, and each after it, is mended; in the order of the text.
    fn all_mistakes(&self, root: &Spanned<DeTable<'_>>, first: Error) -> Error {
        let sound = DeTable::parse(SOUND);
        let Ok(sound) = &sound else { return first };
        let mut mendable = root.clone();
        let mut mended: Vec<(String, Error)> = Vec::new();
        let mut next = Some(first.clone());
        while let Some(error) = next.take() {
            let Error::Scene { key, .. } = &error else { break };
            let key = key.clone();
            // The same again, or a table that lacks what was taken out of it, is no mistake of the text.
            let made = |(other, _): &(String, Error)| {
                other.strip_prefix(&*key).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            if mended.iter().any(made) {
                break;
            }
            mended.push((key.clone(), error));
            if mended.len() < MOST_MISTAKES && mend(mendable.get_mut(), sound.get_ref(), &key) {
                next = self.parsed(&mendable).err();
            }
        }
        // What is missing last: it may be what another mistake was meant to be.
        let missing = |error: &Error| matches!(error, Error::Scene { problem, .. } if problem.starts_with("missing"));
        let start = |key: &str| span_of(root.get_ref(), key).map_or(usize::MAX, |span| span.start);
        mended.sort_by_key(|(key, error)| (missing(error), start(key)));
        if mended.len() < 2 { first } else { Error::Several(mended.into_iter().map(|(_, error)| error).collect()) }
    }

    fn deserialized<T: DeserializeOwned>(&self, root: &Spanned<DeTable<'_>>) -> Result<T> {
        T::deserialize(toml::Deserializer::from(root.clone())).map_err(|e| {
            let span = e.span().filter(|span| *span != root.span());
            let key = span.as_ref().and_then(|span| key_at(root.get_ref(), span.start)).unwrap_or_default();
            let found = span.as_ref().and_then(|span| self.source(span));
            let (key, problem) = reworded(key, e.message(), found);
            self.error(root, span, &KeyError { key, problem })
        })
    }

    fn error(&self, root: &Spanned<DeTable<'_>>, span: Option<Range<usize>>, fault: &KeyError) -> Error {
        let span = span.filter(|span| *span != root.span());
        Error::Scene { place: self.place(span), key: fault.key.clone(), problem: fault.problem.clone() }
    }

    /// Where each override's text starts in the numbering of spans.
    fn starts(&self) -> impl Iterator<Item = usize> {
        self.overrides.iter().scan(self.text.len() + 1, |next, text| {
            let start = *next;
            *next += text.len() + 1;
            Some(start)
        })
    }

    /// What is written at `span`, where that is short.
    fn source(&self, span: &Range<usize>) -> Option<&str> {
        let overrides = self.overrides.iter().map(String::as_str).zip(self.starts());
        let mut texts = std::iter::once((self.text.as_str(), 0)).chain(overrides);
        let found = texts.find_map(|(text, at)| text.get(span.start.checked_sub(at)?..span.end.checked_sub(at)?))?;
        (found.len() <= LONGEST_FOUND && !found.contains('\n')).then_some(found)
    }

    /// File and line, or the override, that `span` lies in.
    fn place(&self, span: Option<Range<usize>>) -> String {
        let start = span.map_or(0, |span| span.start);
        if start > self.text.len() {
            let mut overrides = self.overrides.iter().zip(self.starts()).zip(&self.makers);
            if let Some((_, maker)) = overrides.find(|((text, at), _)| (*at..=at + text.len()).contains(&start)) {
                return maker.clone();
            }
        }
        let before = &self.text.as_bytes()[..start.min(self.text.len())];
        format!("{}:{}", self.path.display(), 1 + before.iter().filter(|byte| **byte == b'\n').count())
    }
}

/// Keys of which a table has one at most.
const ALTERNATIVES: [[&str; 2]; 3] =
    [["time_step_s", "tolerance"], ["every", "interval_s"], ["stiffness_gradient", "stiffness_profile"]];

/// Calls the file of every `{ table = … }` in `value` that is called `from` `to`.
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

/// Names the contents of the tables of `scene`, as far as they can be read.
fn contents(scene: &Scene) -> u128 {
    let mut hasher = XxHash3_128::new();
    for table in scene.files().into_iter().map(|table| scene.read_from.read(&table).unwrap_or_default()) {
        hasher.write(&(table.len() as u64).to_le_bytes());
        hasher.write(&table);
    }
    hasher.finish_128()
}

/// Appends what names a table: its keys in order, with their values.
fn name_table(table: &DeTable<'_>, content: &mut Vec<u8>) {
    content.push(b'{');
    for (key, value) in table {
        name_text(key.get_ref(), content);
        name_value(value.get_ref(), content);
    }
    content.push(b'}');
}

fn name_value(value: &DeValue<'_>, content: &mut Vec<u8>) {
    match value {
        DeValue::Table(table) => name_table(table, content),
        DeValue::Array(items) => {
            content.push(b'[');
            items.iter().for_each(|item| name_value(item.get_ref(), content));
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
        DeValue::String(text) => name_text(text, content),
        DeValue::Boolean(truth) => content.extend([b'b', u8::from(*truth)]),
        DeValue::Datetime(time) => name_text(&time.to_string(), content),
    }
}

fn name_text(text: &str, content: &mut Vec<u8>) {
    content.push(b's');
    content.extend((text.len() as u64).to_le_bytes());
    content.extend(text.as_bytes());
}

/// The dotted keys that a scene cannot have beside `key`.
#[cfg(feature = "report")]
pub(crate) fn rivals(key: &str) -> impl Iterator<Item = String> {
    let (table, name) = key.rsplit_once('.').unwrap_or(("", key));
    let pairs = ALTERNATIVES.iter().filter(move |pair| pair.contains(&name)).flatten();
    pairs.filter(move |other| **other != name).map(move |other| format!("{table}.{other}"))
}

/// Puts the overrides of a layer together; what is a table in one of them and none in another has no meaning.
fn unite<'a>(
    base: &mut DeTable<'a>,
    more: DeTable<'a>,
    path: &str,
) -> std::result::Result<(), (KeyError, Range<usize>)> {
    for (key, value) in more {
        let place = if path.is_empty() { key.get_ref().to_string() } else { format!("{path}.{}", key.get_ref()) };
        let there = base.get(&key).map(|value| value.get_ref().is_table());
        match (base.get_mut(&key).map(Spanned::get_mut), value.into_inner_with_span()) {
            (Some(DeValue::Table(base)), (DeValue::Table(more), _)) => unite(base, more, &place)?,
            (_, (value, span)) => {
                if there.is_some_and(|table| table != value.is_table()) {
                    let found = refused("a table of its keys beside another value", "one of the two");
                    return Err((KeyError { key: place, problem: found }, key.span()));
                }
                base.remove(&key); // with its old span
                base.insert(key, Spanned::new(span, value));
            }
        }
    }
    Ok(())
}

/// Puts a layer on top of what is below it, table by table; functions of time are values.
fn overlay<'a>(base: &mut DeTable<'a>, over: DeTable<'a>) {
    for (key, value) in over {
        match (base.get_mut(&key).map(Spanned::get_mut), value.into_inner_with_span()) {
            (Some(DeValue::Table(base)), (DeValue::Table(over), _)) if !is_function(&over) => overlay(base, over),
            (_, (value, span)) => {
                base.remove(&key); // with its old span
                base.insert(key, Spanned::new(span, value));
            }
        }
    }
}

/// True for a function of time that says all that it has to.
fn is_function(table: &DeTable<'_>) -> bool {
    let whole = table.contains_key("table") || table.contains_key("amplitude") && table.contains_key("frequency_hz");
    whole && table.keys().all(|key| SIGNAL_KEYS.contains(&&**key.get_ref()))
}

/// Takes out what keys of a higher layer exclude: alternatives, and the parameters of other methods.
fn settle(table: &mut DeTable<'_>, layer_of: &impl Fn(usize) -> usize) {
    let layer = |table: &DeTable<'_>, key: &str| table.get_key_value(key).map(|(key, _)| layer_of(key.span().start));
    for [a, b] in ALTERNATIVES {
        match (layer(table, a), layer(table, b)) {
            (Some(own), Some(other)) if own > other => drop(table.remove(b)),
            (Some(own), Some(other)) if own < other => drop(table.remove(a)),
            _ => {}
        }
    }
    let method = table.get("integrator").and_then(|value| Method::named(value.get_ref().as_str()?));
    if let Some((method, own)) = method.zip(layer(table, "integrator")) {
        let others = METHODS.iter().flat_map(|other| other.parameters).map(|parameter| parameter.name);
        for key in others.filter(|name| !method.parameters.iter().any(|parameter| parameter.name == *name)) {
            if layer(table, key).is_some_and(|layer| layer < own) {
                table.remove(key);
            }
        }
    }
    for (_, value) in table.iter_mut() {
        if let DeValue::Table(inner) = value.get_mut() {
            settle(inner, layer_of);
        }
    }
}

trait IntoInnerWithSpan<T> {
    fn into_inner_with_span(self) -> (T, Range<usize>);
}

impl<T> IntoInnerWithSpan<T> for Spanned<T> {
    fn into_inner_with_span(self) -> (T, Range<usize>) {
        let span = self.span();
        (self.into_inner(), span)
    }
}

/// The dotted key that byte `at` belongs to.
fn key_at(table: &DeTable<'_>, at: usize) -> Option<String> {
    table.iter().find_map(|(key, value)| {
        let inner = match value.get_ref() {
            DeValue::Table(inner) => key_at(inner, at),
            DeValue::Array(items) => items.iter().enumerate().find_map(|(i, item)| match item.get_ref() {
                DeValue::Table(inner) => match key_at(inner, at) {
                    Some(inner) => Some(format!("{i}.{inner}")),
                    None => item.span().contains(&at).then(|| i.to_string()),
                },
                _ => None,
            }),
            _ => None,
        };
        match inner {
            Some(inner) => Some(format!("{}.{inner}", key.get_ref())),
            None if key.span().contains(&at) || value.span().contains(&at) => Some(key.get_ref().to_string()),
            None => None,
        }
    })
}

/// Where `key` stands; where it is absent, where its nearest parent does.
fn span_of(table: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
    let (name, value) = table.get_key_value(first)?;
    let inner = rest.and_then(|rest| match value.get_ref() {
        DeValue::Table(inner) => span_of(inner, rest),
        DeValue::Array(items) => {
            let (index, rest) = rest.split_once('.')?;
            let item = items.get(index.parse::<usize>().ok()?)?;
            item.get_ref().as_table().and_then(|inner| span_of(inner, rest))
        }
        _ => None,
    });
    Some(inner.unwrap_or_else(|| name.span()))
}

/// Most mistakes that are reported at once.
const MOST_MISTAKES: usize = 12;

/// Keys without a default, with values that stand in for missing and wrong ones while others are looked for.
const SOUND: &str = "
rod = { nodes = 9, length_m = 1.0, outer_radius_m = 0.01, youngs_modulus_pa = 1e9, density_kg_m3 = 1e3 }
actuation = { kind = \"travelling-wave\", kappa_amp = 1.0, frequency_hz = 1.0, wavelength_m = 1.0 }
medium = { viscosity_pa_s = 1.0, density_kg_m3 = 1e3 }
drag = { ratio = 2.0 }
loads.point = [{ node = 0, force_n = [0.0, 0.0] }]
solver = { duration_s = 1.0 }
";

/// Gives a dotted key the value of `sound`, or takes it away where that has none; false where neither changes anything.
fn mend<'a>(table: &mut DeTable<'a>, sound: &DeTable<'a>, key: &str) -> bool {
    let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
    let known = sound.get(first).map(Spanned::get_ref);
    let inner = rest.zip(table.get_mut(first).map(Spanned::get_mut));
    if let Some((rest, value)) = inner {
        let nothing = DeTable::new();
        match value {
            DeValue::Table(inner) => return mend(inner, known.and_then(DeValue::as_table).unwrap_or(&nothing), rest),
            DeValue::Array(items) => {
                let (index, rest) = rest.split_once('.').unwrap_or((rest, ""));
                let item = index.parse().ok().and_then(|index: usize| items.get_mut(index));
                let known = known.and_then(DeValue::as_array).and_then(|items| items.first());
                let known = known.and_then(|item| item.get_ref().as_table()).unwrap_or(&nothing);
                return match item.map(Spanned::get_mut) {
                    Some(DeValue::Table(inner)) if !rest.is_empty() => mend(inner, known, rest),
                    _ => false,
                };
            }
            _ => {}
        }
    }
    let name = table.get_key_value(first).map(|(name, _)| name.clone());
    match (known, name) {
        (Some(value), name) => {
            // With no place: it is written nowhere.
            let name = name.unwrap_or_else(|| Spanned::new(0..0, first.to_string().into()));
            table.remove(&name);
            table.insert(Spanned::new(0..0, name.into_inner()), Spanned::new(0..0, unplaced(value)));
            true
        }
        (None, Some(name)) => table.remove(&name).is_some(),
        (None, None) => false,
    }
}

/// A value that is written nowhere.
fn unplaced<'a>(value: &DeValue<'a>) -> DeValue<'a> {
    let nowhere = |value: &Spanned<DeValue<'a>>| Spanned::new(0..0, unplaced(value.get_ref()));
    match value {
        DeValue::Table(table) => {
            let entry = |(key, value): (&Spanned<DeString<'a>>, &Spanned<DeValue<'a>>)| {
                (Spanned::new(0..0, key.get_ref().clone()), nowhere(value))
            };
            DeValue::Table(table.iter().map(entry).collect())
        }
        DeValue::Array(items) => DeValue::Array(items.iter().map(nowhere).collect()),
        other => other.clone(),
    }
}

/// Refuses what serde would let pass or complain of in the wrong words: lists in the place of tables, whose values
/// would be taken in the order of our own structs, and unknown keys of `[solver]`, which stand behind missing ones.
fn check_tables(root: &DeTable<'_>) -> std::result::Result<(), KeyError> {
    for (key, value) in root {
        if value.get_ref().is_array() {
            return Err(KeyError { key: key.get_ref().to_string(), problem: refused("a list", "a table") });
        }
    }
    let inside = |table: &str, key: &str| root.get(table)?.get_ref().as_table()?.get(key).map(Spanned::get_ref);
    if let Some(DeValue::Array(points)) = inside("loads", "point")
        && let Some(i) = points.iter().position(|point| !point.get_ref().is_table())
    {
        let problem = format!("point {i} is no table; allowed: tables {{ node, force_n }}");
        return Err(KeyError { key: "loads.point".to_string(), problem });
    }
    let Some(DeValue::Table(solver)) = root.get("solver").map(Spanned::get_ref) else { return Ok(()) };
    let integrator = inside("solver", "integrator").and_then(DeValue::as_str);
    solver.keys().try_for_each(|key| super::solver::check_solver_key(key.get_ref(), integrator))
}

/// serde's words for what is wrong at `key`, in those of this program; `source` is the text of the wrong value.
fn reworded(key: String, message: &str, source: Option<&str>) -> (String, String) {
    let listed = |names: &str| names.trim_start_matches("one of ").to_string();
    if let Some((name, names)) =
        message.strip_prefix("unknown field `").and_then(|rest| rest.rsplit_once("`, expected "))
    {
        let near = nearest(name, names.split('`').skip(1).step_by(2));
        return (key, unknown_key(&listed(names), near));
    }
    if let Some(name) = message.strip_prefix("missing field `") {
        let name = name.trim_end_matches('`');
        let key = if key.is_empty() { name.to_string() } else { format!("{key}.{name}") };
        return (key, "missing; it has no default".to_string());
    }
    if let Some((name, names)) =
        message.strip_prefix("unknown variant `").and_then(|rest| rest.rsplit_once("`, expected "))
    {
        let near = nearest(name, names.split('`').skip(1).step_by(2));
        return (key, format!("found {name:?}; allowed: {}{}", listed(names), did_you_mean(near)));
    }
    for prefix in ["invalid type: ", "invalid value: ", "invalid length "] {
        if let Some((found, allowed)) = message.strip_prefix(prefix).and_then(|rest| rest.rsplit_once(", expected ")) {
            let found = match (found, source) {
                // The source of a table made by a dotted key is that key.
                ("map", Some(text)) if text.starts_with(|c: char| c == '{' || c == '[' || c.is_ascii_digit()) => text,
                ("map", _) => "a table",
                (_, Some(text)) => text,
                ("sequence", None) => "a list",
                (other, None) => other,
            };
            let allowed = match allowed {
                "a string" => "a text in quotes",
                "a boolean" => "true or false",
                "a sequence" => "a list in brackets",
                "i64" => "a whole number",
                "usize" => "a whole number that is not negative",
                "an array of length 2" => "two values in brackets",
                table if table.starts_with("struct ") => "a table",
                other => other,
            };
            return (key, format!("found {found}; allowed: {allowed}"));
        }
    }
    let found = source.unwrap_or("another value");
    match message {
        "wanted string or table" => (key, format!("found {found}; allowed: a text in quotes")),
        "floating-point number overflowed" | "integer number overflowed" => {
            (key, format!("found {found}; allowed: a number below 1e308"))
        }
        other => (key, other.to_string()),
    }
}
