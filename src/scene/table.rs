//! Tables of a driven head: CSV files with a header, time first.

use std::path::Path;

use crate::error::{Error, Result};
use crate::head::{Row, Signal};

/// Reads value `column` of `columns` from a file with the columns time, the values, and (all or none) their rates.
///
/// # Errors
/// [`Error::Read`]; [`Error::Scene`] with file and line where it is not such a table, or does not reach from 0 to
/// `duration` (s).
pub fn read(path: &Path, column: usize, columns: usize, duration: f64) -> Result<Signal> {
    let refuse = |line: u64, problem: String| Error::Scene {
        place: format!("{}:{line}", path.display()),
        key: String::new(),
        problem,
    };
    let text =
        std::fs::read_to_string(path).map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() })?;
    // Where a record is said to start there may be comments and empty lines before it.
    let line_of = |start: Option<&csv::Position>| {
        let (byte, line) = start.map_or((0, 1), |start| (start.byte() as usize, start.line()));
        let before = text.get(byte..).unwrap_or_default().lines();
        line + before.take_while(|line| line.is_empty() || line.starts_with('#')).count() as u64
    };
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let first_line = line_of(None);
    let header = reader.headers().map_err(|e| refuse(first_line, e.to_string()))?;
    let width = header.len();
    if let Some(number) = header.iter().find(|name| name.parse::<f64>().is_ok()) {
        return Err(refuse(first_line, format!("found {number} in the header; allowed: names, time_s first")));
    }
    let with_rates = width == 1 + 2 * columns;
    if !with_rates && width != 1 + columns {
        let allowed = format!("time_s and {columns} value(s), or these and {columns} rate(s)");
        return Err(refuse(first_line, format!("found {width} columns; allowed: {allowed}")));
    }
    let mut rows: Vec<Row> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| refuse(line_of(e.position()), e.to_string()))?;
        let line = line_of(record.position());
        if record.len() != width {
            return Err(refuse(line, format!("found {} columns; allowed: {width}, as in the header", record.len())));
        }
        let number = |i: usize| {
            let text = &record[i];
            text.parse()
                .ok()
                .filter(|x: &f64| x.is_finite())
                .ok_or_else(|| refuse(line, format!("found {text:?} in column {}; allowed: a finite number", i + 1)))
        };
        let rate = if with_rates { number(1 + columns + column)? } else { 0.0 };
        let row = Row { time: number(0)?, value: number(1 + column)?, rate };
        if let Some(last) = rows.last().filter(|last| last.time >= row.time) {
            return Err(refuse(
                line,
                format!("found time {} s after {} s; allowed: rising times", row.time, last.time),
            ));
        }
        rows.push(row);
    }
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Err(refuse(first_line, "found no rows; allowed: at least one".to_string()));
    };
    if first.time > 0.0 || last.time < duration * (1.0 - 1e-9) {
        let found = format!("found times from {} to {} s", first.time, last.time);
        return Err(refuse(
            first_line,
            format!("{found}; allowed: a table that reaches from 0 to the duration, {duration} s"),
        ));
    }
    if with_rates {
        return Ok(Signal::Table(rows));
    }
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.time, row.value]).collect();
    Ok(Signal::table_without_rates(&points))
}
