//! Findings of a study: answers in sentences, numbers, tables and figures, written to one folder with a page.

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::chart::Figure;
use super::folder::Folder;
use super::page::{Animation, RawJson, render};
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

#[derive(Serialize)]
struct PageTable {
    title: &'static str,
    file: &'static str,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
    more: usize,
}

impl Findings {
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
            "figures": self.figures,
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
        PageTable {
            title: self.title,
            file: self.file,
            columns: self.columns.clone(),
            rows: self.rows.iter().take(MAX_TABLE_ROWS).map(|row| row.iter().map(cell).collect()).collect(),
            more: self.rows.len().saturating_sub(MAX_TABLE_ROWS),
        }
    }
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
        // No line of a cell is kept whole on paper, which is narrow, and headings are on every sheet.
        let apart = page.split("white-space: nowrap").filter(|text| text.ends_with(".rows td, .rows th { "));
        assert!(apart.clone().count() == 1 && apart.clone().all(|text| text.contains("@media screen { .rows td")));
        assert!(page.contains("<thead><tr><th>name</th></tr></thead>"));
    }
}
