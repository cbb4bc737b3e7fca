//! Tables in the making: each grows beside its place and is put there whole.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::Type as SchemaType;
use serde_json::Value;
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

/// Fails where no file can be written to `folder`, or to what it would be made in: to be asked before a long computation.
///
/// # Errors
/// [`Error::Write`].
pub fn check_writable(folder: &Path) -> Result<()> {
    let exists = |folder: &&Path| folder.as_os_str().is_empty() || folder.exists();
    let first = folder.ancestors().find(exists).unwrap_or(folder);
    beside(&first.join("file")).map(|_| ())
}

/// Writes files, names and texts, to `folder`, and puts them in place when all of them are there; returns their paths.
///
/// # Errors
/// [`Error::Write`]; files already in the folder are then as they were.
pub fn write_all<'a>(folder: &Path, files: impl Iterator<Item = &'a (String, String)>) -> Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder).map_err(|e| write_error(folder, &e))?;
    let files = files.map(|(name, text)| text_file(folder.join(name), text)).collect::<Result<Vec<_>>>()?;
    files.into_iter().map(|(file, path)| put_in_place(file, path)).collect()
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
        let writer = parquet_writer(&path, schema)?;
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

/// Begins a Parquet file beside `path`.
fn parquet_writer(path: &Path, schema: SchemaType) -> Result<SerializedFileWriter<BufWriter<NamedTempFile>>> {
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let file = BufWriter::new(beside(path)?);
    SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).map_err(|e| parquet_error(path, &e))
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

/// A file with `text`, and its place.
pub fn text_file(path: PathBuf, text: &str) -> Result<(NamedTempFile, PathBuf)> {
    let mut file = beside(&path)?;
    file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(|e| write_error(&path, &e))?;
    Ok((file, path))
}

/// A CSV file of `rows` of any JSON values under `header`; what is null is empty.
///
/// # Errors
/// Those of `rows`; [`Error::Write`].
pub fn csv_of(
    path: PathBuf,
    header: &[String],
    rows: impl Iterator<Item = Result<Vec<Value>>>,
) -> Result<(NamedTempFile, PathBuf)> {
    let mut writer = csv::Writer::from_writer(BufWriter::new(beside(&path)?));
    let failed = |e: csv::Error| Error::Write { path: path.clone(), reason: e.to_string() };
    writer.write_record(header).map_err(failed)?;
    for row in rows {
        for cell in row? {
            let text = match cell {
                Value::Null => String::new(),
                Value::String(text) => text,
                other => other.to_string(),
            };
            writer.write_field(text).map_err(failed)?;
        }
        writer.write_record(None::<&[u8]>).map_err(failed)?;
    }
    let buffer = writer.into_inner().map_err(|e| write_error(&path, e.error()))?;
    let file = buffer.into_inner().map_err(|e| write_error(&path, e.error()))?;
    Ok((file, path))
}

/// The type of a Parquet column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnType {
    /// Numbers.
    Number,
    /// Yes or no.
    Truth,
    /// Anything else.
    Text,
}

impl ColumnType {
    /// The type that holds `value` and all that one of this type (`None`: nothing yet) holds.
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

/// The same as a Parquet file with the columns' names and types.
///
/// # Errors
/// Those of `rows`; [`Error::Write`].
pub fn parquet_of(
    path: PathBuf,
    header: &[(String, ColumnType)],
    rows: impl Iterator<Item = Result<Vec<Value>>>,
) -> Result<(NamedTempFile, PathBuf)> {
    let failed = |e: parquet::errors::ParquetError| parquet_error(&path, &e);
    let column = |(name, kind): &(String, ColumnType)| {
        let (physical, logical) = match kind {
            ColumnType::Number => (PhysicalType::DOUBLE, None),
            ColumnType::Truth => (PhysicalType::BOOLEAN, None),
            ColumnType::Text => (PhysicalType::BYTE_ARRAY, Some(LogicalType::String)),
        };
        let column = SchemaType::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
        column.with_logical_type(logical).build().map(Arc::new)
    };
    let columns: Vec<_> = header.iter().map(column).collect::<parquet::errors::Result<_>>().map_err(failed)?;
    let schema = SchemaType::group_type_builder("cases").with_fields(columns).build().map_err(failed)?;
    let mut writer = parquet_writer(&path, schema)?;
    let mut rows = rows.peekable();
    while rows.peek().is_some() {
        let group: Vec<Vec<Value>> = rows.by_ref().take(GROUP / 16).collect::<Result<_>>()?;
        let mut out = writer.next_row_group().map_err(failed)?;
        for (i, (_, kind)) in header.iter().enumerate() {
            let cells = || group.iter().map(|row| &row[i]);
            match kind {
                ColumnType::Number => optional::<DoubleType, _>(&mut out, cells().map(Value::as_f64)),
                ColumnType::Truth => optional::<BoolType, _>(&mut out, cells().map(Value::as_bool)),
                ColumnType::Text => optional::<ByteArrayType, _>(
                    &mut out,
                    cells().map(|cell| match cell {
                        Value::Null => None,
                        Value::String(text) => Some(ByteArray::from(text.as_str())),
                        other => Some(ByteArray::from(other.to_string().as_str())),
                    }),
                ),
            }
            .map_err(failed)?;
        }
        out.close().map_err(failed)?;
    }
    let buffer = writer.into_inner().map_err(failed)?;
    let file = buffer.into_inner().map_err(|e| write_error(&path, e.error()))?;
    Ok((file, path))
}

/// Writes the next column of a group, in which some values are missing.
fn optional<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    cells: impl Iterator<Item = Option<T::T>>,
) -> parquet::errors::Result<()> {
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    for cell in cells {
        levels.push(i16::from(cell.is_some()));
        values.extend(cell);
    }
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(&values, Some(&levels), None)?;
        column.close()?;
    }
    Ok(())
}
