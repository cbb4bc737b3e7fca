//! Tables in the making: each grows beside its place and is put there whole.

use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::Compression;
use parquet::data_type::{DataType, DoubleType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use tempfile::{Builder, NamedTempFile};

use crate::error::{Error, Result};

/// The error of writing `path`.
pub fn write_error(path: &Path, error: &std::io::Error) -> Error {
    Error::Write { path: path.to_path_buf(), reason: error.to_string() }
}

/// A file beside `path`, which disappears unless it is put in place.
pub fn beside(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{name}.");
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(".partial");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // less the user's mask, as any file
    builder.tempfile_in(folder).map_err(|e| write_error(folder, &e))
}

/// Gives a finished file its name.
pub fn put_in_place(file: NamedTempFile, path: PathBuf) -> Result<PathBuf> {
    file.persist(&path).map_err(|e| write_error(&path, &e.error))?;
    Ok(path)
}

/// A CSV file in the making.
#[derive(Debug)]
pub struct Csv {
    path: PathBuf,
    writer: csv::Writer<BufWriter<NamedTempFile>>,
    /// Time of the last row, s.
    pub last: Option<f64>,
    values: Vec<f64>,
}

impl Csv {
    /// Begins the file with a header.
    pub fn create(path: PathBuf, columns: impl Iterator<Item = String>) -> Result<Self> {
        let writer = csv::Writer::from_writer(BufWriter::new(beside(&path)?));
        let mut table = Self { path, writer, last: None, values: Vec::new() };
        let header: Vec<String> = columns.collect();
        table.writer.write_record(&header).map_err(|e| table.failed(e))?;
        Ok(table)
    }

    /// Adds a row.
    pub fn row(&mut self, time: f64, values: impl Iterator<Item = f64>) -> Result<()> {
        self.last = Some(time);
        self.values.clear();
        self.values.extend(values);
        self.writer.serialize(&self.values).map_err(|e| self.failed(e))
    }

    fn failed(&self, error: csv::Error) -> Error {
        match error.into_kind() {
            csv::ErrorKind::Io(error) => write_error(&self.path, &error),
            other => Error::Write { path: self.path.clone(), reason: format!("{other:?}") },
        }
    }

    /// The finished file, and its place.
    pub fn complete(self) -> Result<(NamedTempFile, PathBuf)> {
        let path = self.path;
        let buffer = self.writer.into_inner().map_err(|e| write_error(&path, e.error()))?;
        let file = buffer.into_inner().map_err(|e| write_error(&path, e.error()))?;
        Ok((file, path))
    }
}

/// Rows of a Parquet file that are kept in memory before they are written as one group.
const GROUP: usize = 1 << 17;

/// A Parquet file in the making: one row a time and node, with the columns time_s, node, x_m, y_m.
pub struct Parquet {
    path: PathBuf,
    writer: SerializedFileWriter<BufWriter<NamedTempFile>>,
    times: Vec<f64>,
    nodes: Vec<i32>,
    x: Vec<f64>,
    y: Vec<f64>,
}

impl std::fmt::Debug for Parquet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Parquet").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Parquet {
    /// Begins the file.
    pub fn create(path: PathBuf) -> Result<Self> {
        const SCHEMA: &str = "message nodes { required double time_s; required int32 node; required double x_m; \
            required double y_m; }";
        let schema = parse_message_type(SCHEMA).map_err(|e| parquet_error(&path, &e))?;
        let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
        let file = BufWriter::new(beside(&path)?);
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties))
            .map_err(|e| parquet_error(&path, &e))?;
        Ok(Self { path, writer, times: Vec::new(), nodes: Vec::new(), x: Vec::new(), y: Vec::new() })
    }

    /// Adds the positions `q` (m, two entries a node) of `nodes` at a time (s).
    pub fn rows(&mut self, time: f64, nodes: &[usize], q: &[f64]) -> Result<()> {
        for k in nodes {
            self.times.push(time);
            self.nodes.push(*k as i32); // at most 10⁷
            self.x.push(q[2 * k]);
            self.y.push(q[2 * k + 1]);
            if self.times.len() == GROUP {
                self.write_group()?;
            }
        }
        Ok(())
    }

    fn write_group(&mut self) -> Result<()> {
        let Self { path, writer, times, nodes, x, y } = self;
        let mut write = || {
            let mut group = writer.next_row_group()?;
            column::<DoubleType, _>(&mut group, times)?;
            column::<Int32Type, _>(&mut group, nodes)?;
            column::<DoubleType, _>(&mut group, x)?;
            column::<DoubleType, _>(&mut group, y)?;
            group.close().map(|_| ())
        };
        write().map_err(|e| parquet_error(path, &e))?;
        for column in [times, x, y] {
            column.clear();
        }
        nodes.clear();
        Ok(())
    }

    /// The finished file, and its place.
    pub fn complete(mut self) -> Result<(NamedTempFile, PathBuf)> {
        if !self.times.is_empty() {
            self.write_group()?;
        }
        let path = self.path;
        let buffer = self.writer.into_inner().map_err(|e| parquet_error(&path, &e))?;
        let file = buffer.into_inner().map_err(|e| write_error(&path, e.error()))?;
        Ok((file, path))
    }
}

/// Writes the next column of a group.
fn column<T: DataType, W: std::io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
) -> parquet::errors::Result<()> {
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(values, None, None)?;
        column.close()?;
    }
    Ok(())
}

fn parquet_error(path: &Path, error: &parquet::errors::ParquetError) -> Error {
    Error::Write { path: path.to_path_buf(), reason: error.to_string() }
}
