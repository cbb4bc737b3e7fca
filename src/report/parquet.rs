//! Parquet files: positions of many nodes, and tables of many cases.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as PhysicalType};
use parquet::column::reader::get_typed_column_reader;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, RowGroupReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::Type as SchemaType;
use serde_json::Value;
use tempfile::NamedTempFile;

use super::tables::ColumnType;
use crate::error::{Error, Result};
use crate::files::{partial_file, write_error};

/// Rows per row group; a group is kept in memory until it is written.
const ROWS_PER_GROUP: usize = 1 << 17;

/// The same for tables of cases, whose rows have about 5 kB.
const CASES_PER_GROUP: usize = 1 << 10;

/// Writer of a Parquet file with one row per time and node, with the columns time_s, node, x_m, y_m.
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
    /// Creates the file.
    pub fn create(path: PathBuf) -> Result<Self> {
        const SCHEMA: &str = "message nodes { required double time_s; required int32 node; required double x_m; \
            required double y_m; }";
        let schema = parse_message_type(SCHEMA).map_err(|e| parquet_error(&path, &e))?;
        let writer = parquet_writer(&path, schema)?;
        Ok(Self { path, writer, times: Vec::new(), nodes: Vec::new(), x: Vec::new(), y: Vec::new() })
    }

    /// Adds the positions `q` (m, two entries per node) of `nodes` at a time (s).
    pub fn rows(&mut self, time: f64, nodes: &[usize], q: &[f64]) -> Result<()> {
        for k in nodes {
            self.times.push(time);
            self.nodes.push(*k as i32); // at most 10⁷
            self.x.push(q[2 * k]);
            self.y.push(q[2 * k + 1]);
            if self.times.len() == ROWS_PER_GROUP {
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

    /// The finished file.
    pub fn complete(mut self) -> Result<NamedTempFile> {
        if !self.times.is_empty() {
            self.write_group()?;
        }
        let buffer = self.writer.into_inner().map_err(|e| parquet_error(&self.path, &e))?;
        buffer.into_inner().map_err(|e| write_error(&self.path, e.error()))
    }

    /// Its path.
    pub fn path(&self) -> PathBuf {
        self.path.clone()
    }
}

/// Takes the positions (m) of nodes at a time (s); false if no more are needed.
pub type NodesVisitor<'a> = dyn FnMut(f64, &[(i32, [f64; 2])]) -> Result<bool> + 'a;

/// Calls `look` with each time (s) of a table of nodes and the nodes from head to tip with their positions (m), until it returns
/// false.
///
/// # Errors
/// [`Error::Read`]; those of `look`.
pub fn visit_nodes(path: &Path, look: &mut NodesVisitor<'_>) -> Result<()> {
    let failed = |reason: String| Error::Read { path: path.to_path_buf(), reason };
    let broken = |e: parquet::errors::ParquetError| failed(format!("{e}; run the scene again"));
    let file = File::open(path).map_err(|e| failed(e.to_string()))?;
    let table = SerializedFileReader::new(file).map_err(broken)?;
    let names = table.metadata().file_metadata().schema_descr().columns();
    if names.iter().map(|column| column.name()).ne(["time_s", "node", "x_m", "y_m"]) {
        return Err(failed("its columns are not time_s, node, x_m, y_m; run the scene again".to_string()));
    }
    // The rows of one time may be split between two groups.
    let (mut now, mut nodes) = (f64::NAN, Vec::new());
    let mut pass = |time: f64, nodes: &mut Vec<(i32, [f64; 2])>| {
        nodes.sort_by_key(|(node, _)| *node);
        look(time, nodes)
    };
    for group in 0..table.num_row_groups() {
        let group = table.get_row_group(group).map_err(broken)?;
        let numbers = |k: usize| values_of::<DoubleType>(&*group, k).map_err(broken);
        let (times, x, y) = (numbers(0)?, numbers(2)?, numbers(3)?);
        let of_nodes = values_of::<Int32Type>(&*group, 1).map_err(broken)?;
        for (((time, node), x), y) in times.into_iter().zip(of_nodes).zip(x).zip(y) {
            if time != now && !nodes.is_empty() {
                if !pass(now, &mut nodes)? {
                    return Ok(());
                }
                nodes.clear();
            }
            now = time;
            nodes.push((node, [x, y]));
        }
    }
    if !nodes.is_empty() {
        pass(now, &mut nodes)?;
    }
    Ok(())
}

/// The values of a column of a group, which all rows have.
fn values_of<T: DataType>(group: &dyn RowGroupReader, column: usize) -> parquet::errors::Result<Vec<T::T>> {
    let rows = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
    let mut values = Vec::with_capacity(rows);
    let mut reader = get_typed_column_reader::<T>(group.get_column_reader(column)?);
    while values.len() < rows && reader.read_records(rows - values.len(), None, None, &mut values)?.0 > 0 {}
    Ok(values)
}

/// Creates a Parquet file next to `path`.
fn parquet_writer(path: &Path, schema: SchemaType) -> Result<SerializedFileWriter<BufWriter<NamedTempFile>>> {
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let file = BufWriter::new(partial_file(path)?);
    SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties)).map_err(|e| parquet_error(path, &e))
}

/// Writes the next column of a group.
fn column<T: DataType, W: Write + Send>(
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

/// Writes `rows` of JSON values to a Parquet file with these column names and types.
///
/// # Errors
/// Those of `rows`; [`Error::Write`].
pub fn parquet_of(
    path: &Path,
    header: &[(String, ColumnType)],
    rows: impl Iterator<Item = Result<Vec<Value>>>,
) -> Result<NamedTempFile> {
    let failed = |e: parquet::errors::ParquetError| parquet_error(path, &e);
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
    let mut writer = parquet_writer(path, schema)?;
    let mut rows = rows.peekable();
    while rows.peek().is_some() {
        let group: Vec<Vec<Value>> = rows.by_ref().take(CASES_PER_GROUP).collect::<Result<_>>()?;
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
    buffer.into_inner().map_err(|e| write_error(path, e.error()))
}

/// Writes the next column of a group, with missing values.
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
