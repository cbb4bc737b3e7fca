//! CSV tables, written row by row, and the column types of Parquet tables.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;
use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::files::{partial_file, write_error};

/// Writer of a CSV file.
#[derive(Debug)]
pub struct CsvTable {
    path: PathBuf,
    file: NamedTempFile,
    /// Rows that are not yet written to the file.
    rows: String,
    /// Time of the last row, s.
    pub last: Option<f64>,
    /// Length of the file when a write failed; later rows are ignored.
    broken: Option<u64>,
}

/// Rows are written in chunks of about this size, bytes.
const CHUNK_BYTES: usize = 1 << 16;

/// Appends the shortest text that parses to `x`.
fn push_number(text: &mut String, x: f64) {
    let mut buffer = zmij::Buffer::new();
    let digits = buffer.format(x);
    // 1e20, not 1e+20.
    let plus = if x.abs() < 1e16 { None } else { digits.split_once('+') };
    match plus {
        Some((digits, power)) => text.extend([digits, power]),
        None => text.push_str(digits),
    }
}

impl CsvTable {
    /// Creates the file with its header.
    pub fn create(path: PathBuf, columns: impl Iterator<Item = String>) -> Result<Self> {
        let file = partial_file(&path)?;
        let rows = columns.collect::<Vec<_>>().join(",") + "\n";
        Ok(Self { path, file, rows, last: None, broken: None })
    }

    /// Appends a row, unless an earlier one failed.
    pub fn row(&mut self, time: f64, values: impl Iterator<Item = f64>) -> Result<()> {
        if self.broken.is_some() {
            return Ok(());
        }
        for (i, x) in values.enumerate() {
            if i > 0 {
                self.rows.push(',');
            }
            push_number(&mut self.rows, x);
        }
        self.rows.push('\n');
        if self.rows.len() >= CHUNK_BYTES {
            self.flush()?;
        }
        self.last = Some(time);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.file.as_file_mut().write_all(self.rows.as_bytes());
        self.rows.clear();
        written.map_err(|e| self.failed(e))
    }

    fn failed(&mut self, error: std::io::Error) -> Error {
        self.broken = Some(self.file.as_file().metadata().map_or(0, |file| file.len()));
        write_error(&self.path, &error)
    }

    /// Its path.
    pub fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// The finished file, its path, and the error that truncated it, unless it was reported before.
    ///
    /// # Errors
    /// [`Error::Write`] if even the truncated file cannot be completed.
    pub fn complete(mut self) -> Result<(NamedTempFile, PathBuf, Option<Error>)> {
        let lost = match self.broken {
            None => self.flush().err(),
            Some(_) => None,
        };
        if let Some(end) = self.broken {
            let file = self.file.as_file_mut();
            file.set_len(end).and_then(|()| cut_to_whole_lines(file)).map_err(|e| write_error(&self.path, &e))?;
        }
        Ok((self.file, self.path, lost))
    }
}

/// Removes an incomplete last line.
fn cut_to_whole_lines(file: &mut File) -> std::io::Result<()> {
    let mut end = file.metadata()?.len();
    let mut block = [0; 4096];
    while end > 0 {
        let start = end.saturating_sub(block.len() as u64);
        let size = (end - start) as usize; // at most that of a block
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut block[..size])?;
        if let Some(last) = block[..size].iter().rposition(|byte| *byte == b'\n') {
            return file.set_len(start + last as u64 + 1);
        }
        end = start;
    }
    file.set_len(0)
}

/// Writer of a CSV table with texts, numbers and booleans.
#[derive(Debug)]
pub struct MixedCsvTable {
    path: PathBuf,
    writer: csv::Writer<NamedTempFile>,
}

impl MixedCsvTable {
    /// Creates the table at `path` with its header.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn create(path: &Path, header: &[String]) -> Result<Self> {
        let mut table = Self { path: path.to_path_buf(), writer: csv::Writer::from_writer(partial_file(path)?) };
        table.record(|writer| writer.write_record(header))?;
        Ok(table)
    }

    /// Appends a row; null is an empty cell.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn row(&mut self, cells: &[Value]) -> Result<()> {
        self.record(|writer| {
            for cell in cells {
                match cell {
                    Value::Null => writer.write_field("")?,
                    Value::String(text) => writer.write_field(text)?,
                    other => writer.write_field(other.to_string())?,
                }
            }
            writer.write_record(None::<&[u8]>)
        })
    }

    /// The finished file.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn complete(self) -> Result<NamedTempFile> {
        self.writer.into_inner().map_err(|e| write_error(&self.path, e.error()))
    }

    fn record(&mut self, write: impl FnOnce(&mut csv::Writer<NamedTempFile>) -> csv::Result<()>) -> Result<()> {
        write(&mut self.writer).map_err(|e| Error::Write { path: self.path.clone(), reason: e.to_string() })
    }
}

/// The type of a Parquet column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnType {
    /// Numbers.
    Number,
    /// Booleans.
    Truth,
    /// Anything else, as text.
    Text,
}

impl ColumnType {
    /// The type that can hold `value` along with all values of the `known` type (`None`: no values yet).
    pub fn widened(known: Option<Self>, value: &Value) -> Option<Self> {
        let own = match value {
            Value::Null => return known,
            Value::Number(_) => Self::Number,
            Value::Bool(_) => Self::Truth,
            _ => Self::Text,
        };
        Some(if known.is_none_or(|known| known == own) { own } else { Self::Text })
    }
}
