//! Findings of a study: answers in sentences, numbers, tables and figures, written to one folder with a page.

use std::collections::BTreeSet;

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::chart::Figure;
use super::folder::Folder;
use super::page::{Animation, Figures, RawJson, render};
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::number_format::number;
use crate::scene::Document;

/// Most rows of a table on the page.
const MAX_TABLE_ROWS: usize = 2000;

/// A table of texts and numbers.
#[derive(Debug, Clone)]
pub struct Table {
    /// Name of its file.
    pub file: &'static str,
    /// Title on the page.
    pub title: &'static str,
    /// Names of its columns, with units.
    pub columns: Vec<String>,
    /// Its rows; null and non-finite numbers are empty cells.
    pub rows: Vec<Vec<Value>>,
}

/// The findings of a study.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    /// Subject of the study: `natural modes` …
    pub subject: &'static str,
    /// The answers, of a sentence or two each.
    pub answers: Vec<String>,
    /// The numbers behind it, for summary.json.
    pub numbers: Map<String, Value>,
    /// Figures.
    pub figures: Vec<Figure>,
    /// Tables.
    pub tables: Vec<Table>,
    /// Other files: name and text.
    pub files: Vec<(String, String)>,
    /// An animation for the page, and its caption.
    pub motion: Option<Box<(Animation, String)>>,
}

/// Letters of a printed line of a table, on a page in landscape format.
const PRINTED_LINE: usize = 190;

/// Most letters of a line of a text in a printed cell, and of a heading; longer ones are broken.
const TEXT_CELL: usize = 30;
const HEADING: usize = 12;

#[derive(Serialize)]
struct PageTable {
    title: &'static str,
    file: &'static str,
    columns: Vec<String>,
    /// True for each column of numbers, which are not broken.
    numeric: Vec<bool>,
    /// The places of all columns.
    all: Vec<usize>,
    rows: Vec<Vec<String>>,
    more: usize,
    /// The columns that are printed together, if not all fit side by side.
    parts: Vec<Vec<usize>>,
}

impl Findings {
    /// Adds the answers, numbers, figures and tables of a part of the study after its own.
    pub(crate) fn append(&mut self, part: Self) {
        self.answers.extend(part.answers);
        self.numbers.extend(part.numbers);
        self.figures.extend(part.figures);
        self.tables.extend(part.tables);
    }

    /// Writes summary.json, the tables, other files, figures and report.html to `folder`, in this order, each atomically.
    ///
    /// # Errors
    /// [`Error::Page`].
    pub fn write(&self, folder: &mut Folder, name: &str, document: &Document) -> Result<WrittenFiles> {
        let summary = json!({
            "name": name,
            "caudal_version": env!("CARGO_PKG_VERSION"),
            "subject": self.subject,
            "answers": self.answers,
            "numbers": self.numbers,
        });
        let summary = serde_json::to_string_pretty(&summary).map_err(|e| Error::Page { reason: e.to_string() })?;
        let mut texts = vec![("summary.json".to_string(), summary + "\n")];
        for table in &self.tables {
            texts.push((table.file.to_string(), table.csv().map_err(|e| Error::Page { reason: e.to_string() })?));
        }
        texts.extend(self.files.iter().cloned());
        texts.extend(self.figures.iter().map(|figure| (figure.file.clone(), figure.svg.clone())));
        texts.push(("report.html".to_string(), self.page(name, document)?));
        Ok(folder.results().all(&texts))
    }

    /// The page's HTML.
    pub(crate) fn page(&self, name: &str, document: &Document) -> Result<String> {
        let tables: Vec<_> = self.tables.iter().map(Table::on_page).collect();
        let content = json!({
            "name": name,
            "subject": self.subject,
            "version": env!("CARGO_PKG_VERSION"),
            "answers": self.answers,
            "figures": Figures::of(&self.figures),
            "tables": tables,
            "motion": self.motion.as_ref().map(|motion| RawJson(&motion.0)),
            "shown": self.motion.as_ref().map(|motion| &motion.1),
            "scene": document.text(),
            "overrides": document.overrides(),
        });
        render(include_str!("findings.html"), &content)
    }
}

impl Table {
    /// The table as CSV.
    pub(crate) fn csv(&self) -> std::result::Result<String, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.serialize(row)?;
        }
        let bytes = writer.into_inner().map_err(|e| e.into_error())?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn on_page(&self) -> PageTable {
        let cell = |value: &Value| match value {
            Value::Null => String::new(),
            Value::String(text) => text.clone(),
            Value::Number(x) if x.is_f64() => x.as_f64().map_or_else(String::new, number),
            other => other.to_string(),
        };
        let columns = self.columns.len();
        let numeric: Vec<bool> = (0..columns)
            .map(|k| self.rows.iter().filter_map(|row| row.get(k)).all(|value| !value.is_string()))
            .collect();
        // Rows that are shorter than others end with empty cells.
        let shown = |row: &Vec<Value>| (0..columns).map(|k| row.get(k).map_or_else(String::new, cell)).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().take(MAX_TABLE_ROWS).map(shown).collect();
        let width = |k: usize| {
            let longest = rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0);
            let cells = if numeric[k] { longest } else { longest.min(TEXT_CELL) };
            cells.max(self.columns[k].chars().count().min(HEADING)) + 1
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let whole: usize = widths.iter().sum();
        let parts = if whole > PRINTED_LINE { parts(&widths, keys(&rows)) } else { Vec::new() };
        PageTable {
            title: self.title,
            file: self.file,
            columns: self.columns.clone(),
            numeric,
            all: (0..columns).collect(),
            more: self.rows.len().saturating_sub(MAX_TABLE_ROWS),
            rows,
            parts,
        }
    }
}

/// The number of leading columns that distinguish all rows; one if none do.
fn keys(rows: &[Vec<String>]) -> usize {
    let columns = rows.first().map_or(0, Vec::len);
    let apart = |count: &usize| rows.iter().map(|row| &row[..*count]).collect::<BTreeSet<_>>().len() == rows.len();
    (1..columns).find(apart).unwrap_or(1)
}

/// Columns with these widths in parts that have room on a page that lies, each with the first `keys` columns.
fn parts(widths: &[usize], keys: usize) -> Vec<Vec<usize>> {
    let of_keys: usize = widths[..keys].iter().sum();
    // Key columns that fill the line are not repeated.
    let (keys, of_keys) = if 2 * of_keys > PRINTED_LINE { (1, widths[0]) } else { (keys, of_keys) };
    let mut parts: Vec<Vec<usize>> = Vec::new();
    let mut used = usize::MAX;
    for (k, width) in widths.iter().enumerate().skip(keys) {
        if used.saturating_add(*width) > PRINTED_LINE {
            parts.push((0..keys).collect());
            used = of_keys;
        }
        if let Some(part) = parts.last_mut() {
            part.push(k);
        }
        used += width;
    }
    parts
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn a_long_table_is_whole_on_its_page_and_printed_without_a_frame() {
        let rows = (0..500).map(|i| vec![json!(format!("row {i}."))]).collect();
        let table = Table { file: "runs.csv", title: "All runs", columns: vec!["name".to_string()], rows };
        let findings = Findings { tables: vec![table], ..Findings::default() };
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("models/eel.toml");
        let page = findings.page("runs", &Document::read(&path).unwrap()).unwrap();
        assert!((0..500).all(|i| page.contains(&format!("<td>row {i}.</td>"))));
        let print = page.split("@media print").nth(1).unwrap().split("</style>").next().unwrap();
        assert!(print.contains(".rows { overflow: visible; max-height: none; }"), "{print}");
        // No line of a text is kept whole on paper, which is narrow, and headings are on every sheet.
        let apart = page.split("white-space: nowrap").filter(|text| text.ends_with(".rows td, .rows th { "));
        assert!(apart.clone().count() == 1 && apart.clone().all(|text| text.contains("@media screen { .rows td")));
        assert!(page.contains("<thead><tr><th>name</th></tr></thead>"));
    }

    #[test]
    fn a_printed_table_breaks_no_number_and_repeats_what_tells_its_rows_apart() {
        let names = ["method", "step"].into_iter().map(str::to_string);
        let columns: Vec<String> = names.chain((0..30).map(|k| format!("quantity_{k}"))).collect();
        let row = |i: usize| {
            let name = if i < 2 { "newmark" } else { "esdirk3" };
            let numbers = (0..30).map(|k| json!(1.234567e-7 * (i + k + 1) as f64));
            [json!(name), json!((i % 2) as f64)].into_iter().chain(numbers).collect()
        };
        let table = Table { file: "runs.csv", title: "All runs", columns, rows: (0..4).map(row).collect() };
        let page = table.on_page();
        assert!(page.parts.len() > 1, "{:?}", page.parts);
        assert!(page.parts.iter().all(|part| part[..2] == [0, 1]), "{:?}", page.parts);
        let all: BTreeSet<usize> = page.parts.iter().flatten().copied().collect();
        assert_eq!(all.len(), 32);
        assert!(!page.numeric[0] && page.numeric[1..].iter().all(|numeric| *numeric));
        let small = Table { columns: vec!["a".to_string()], rows: vec![vec![json!(1.0)]], ..table };
        assert!(small.on_page().parts.is_empty());
        let style = include_str!("style.css");
        assert!(
            style.contains(".rows td.number { white-space: nowrap; }") && style.contains("@page { size: A4 landscape;")
        );
    }
}
