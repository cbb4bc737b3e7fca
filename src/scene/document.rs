//! A scene's text with overrides: parsed once, and every complaint finds its way back to file, line and key.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Scene;
use crate::error::{Error, Result, nearest};

/// A larger file is no scene.
const LARGEST: u64 = 16 << 20;

/// What is wrong with a key, before it is known where the key stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Dotted key; where it is absent, its nearest parent is shown.
    pub key: String,
    /// What was found and what is allowed.
    pub problem: String,
}

/// The text of a scene and the overrides of its keys.
#[derive(Debug, Clone)]
pub struct Document {
    path: PathBuf,
    text: String,
    overrides: Vec<String>,
}

impl Document {
    /// Reads a scene file.
    ///
    /// # Errors
    /// [`Error::Read`].
    pub fn read(path: &Path) -> Result<Self> {
        let failed = |reason: String| Error::Read { path: path.to_path_buf(), reason };
        let size = std::fs::metadata(path).map_err(|e| failed(e.to_string()))?.len();
        if size > LARGEST {
            return Err(failed(format!("it has {size} bytes, a scene has at most {LARGEST}")));
        }
        let bytes = std::fs::read(path).map_err(|e| failed(e.to_string()))?;
        let text = String::from_utf8(bytes).map_err(|e| failed(format!("it is not UTF-8 text: {e}")))?;
        Ok(Self::new(path, text))
    }

    /// A scene from text; `path` is shown in errors, and tables are looked for beside it.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self { path: path.into(), text: text.into(), overrides: Vec::new() }
    }

    /// Its text, without overrides.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The overrides, in order.
    pub fn overrides(&self) -> &[String] {
        &self.overrides
    }

    /// Overrides a key, as `table.key=value`; a value that is not TOML is taken as a string.
    ///
    /// # Errors
    /// [`Error::Scene`] where it has not that form.
    pub fn set(&mut self, assignment: &str) -> Result<()> {
        let place = || format!("--set {assignment}");
        let refuse = |problem: &str| Error::Scene { place: place(), key: String::new(), problem: problem.to_string() };
        let (key, value) = assignment.split_once('=').ok_or_else(|| refuse("allowed: table.key=value"))?;
        let (key, value) = (key.trim(), value.trim());
        if key.is_empty() || value.contains(['\n', '\r']) {
            return Err(refuse("allowed: table.key=value on one line"));
        }
        let as_is = format!("{key}={value}");
        let quoted = || format!("{key}={}", toml::Value::String(value.to_string()));
        let text = if DeTable::parse(&as_is).is_ok() { as_is } else { quoted() };
        DeTable::parse(&text).map_err(|e| refuse(e.message()))?;
        self.overrides.push(text);
        Ok(())
    }

    /// The scene, checked.
    ///
    /// # Errors
    /// [`Error::Scene`] with file, line and key.
    pub fn scene(&self) -> Result<Scene> {
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
        for text in &texts {
            let table = DeTable::parse(text)
                .map_err(|e| self.error(&root, e.span(), &Fault { key: String::new(), problem: e.message().into() }))?;
            merge(root.get_mut(), table.into_inner());
        }
        let mut scene = Scene::deserialize(toml::Deserializer::from(root.clone())).map_err(|e| {
            let key = e.span().and_then(|span| key_at(root.get_ref(), span.start)).unwrap_or_default();
            let (key, problem) = reworded(key, e.message());
            self.error(&root, e.span(), &Fault { key, problem })
        })?;
        if scene.name.is_empty() {
            scene.name = self.path.file_stem().map_or_else(|| "scene".into(), |stem| stem.to_string_lossy().into());
        }
        scene.folder = self.path.parent().map(Path::to_path_buf).unwrap_or_default();
        scene.check().map_err(|fault| self.error(&root, span_of(root.get_ref(), &fault.key), &fault))?;
        Ok(scene)
    }

    /// The error of a fault found after reading, at its key.
    pub(super) fn error(&self, root: &Spanned<DeTable<'_>>, span: Option<Range<usize>>, fault: &Fault) -> Error {
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

    /// File and line, or the override, that `span` lies in.
    fn place(&self, span: Option<Range<usize>>) -> String {
        let start = span.map_or(0, |span| span.start);
        if start > self.text.len() {
            let mut overrides = self.overrides.iter().zip(self.starts());
            if let Some((text, _)) = overrides.find(|(text, at)| (*at..=at + text.len()).contains(&start)) {
                return format!("--set {text}");
            }
        }
        let before = &self.text.as_bytes()[..start.min(self.text.len())];
        format!("{}:{}", self.path.display(), 1 + before.iter().filter(|byte| **byte == b'\n').count())
    }
}

/// Puts `over` on top of `base`, table by table.
fn merge<'a>(base: &mut DeTable<'a>, over: DeTable<'a>) {
    for (key, value) in over {
        match (base.get_mut(&key).map(Spanned::get_mut), value.into_inner_with_span()) {
            (Some(DeValue::Table(base)), (DeValue::Table(over), _)) => merge(base, over),
            (_, (value, span)) => {
                base.remove(&key); // with its old span
                base.insert(key, Spanned::new(span, value));
            }
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
                DeValue::Table(inner) => key_at(inner, at).map(|inner| format!("{i}.{inner}")),
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

/// serde's words for what is wrong at `key`, in those of this program.
fn reworded(key: String, message: &str) -> (String, String) {
    let quoted = |text: &str| text.split('`').nth(1).unwrap_or_default().to_string();
    let allowed = |rest: &str| rest.trim_start_matches(", expected ").trim_start_matches("one of ").to_string();
    if let Some(rest) = message.strip_prefix("unknown field ") {
        let name = quoted(rest);
        let names = rest.splitn(3, '`').nth(2).unwrap_or_default();
        let near = nearest(&name, names.split('`').skip(1).step_by(2));
        let hint = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
        return (key, format!("unknown key; allowed: {}{hint}", allowed(names)));
    }
    if let Some(rest) = message.strip_prefix("missing field ") {
        let name = quoted(rest);
        let key = if key.is_empty() { name } else { format!("{key}.{name}") };
        return (key, "missing; it has no default".to_string());
    }
    if let Some(rest) = message.strip_prefix("unknown variant ") {
        let names = rest.splitn(3, '`').nth(2).unwrap_or_default();
        return (key, format!("found `{}`; allowed: {}", quoted(rest), allowed(names)));
    }
    for prefix in ["invalid type: ", "invalid value: ", "invalid length "] {
        if let Some((found, allowed)) = message.strip_prefix(prefix).and_then(|rest| rest.split_once(", expected ")) {
            let length = if prefix == "invalid length " { "length " } else { "" };
            return (key, format!("found {length}{found}; allowed: {allowed}"));
        }
    }
    (key, message.to_string())
}
