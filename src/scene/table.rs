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
    let file =
        std::fs::File::open(path).map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() })?;
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(file);
    let width = reader.headers().map_err(|e| refuse(1, e.to_string()))?.len();
    let with_rates = width == 1 + 2 * columns;
    if !with_rates && width != 1 + columns {
        let allowed = format!("time_s and {columns} value(s), or these and {columns} rate(s)");
        return Err(refuse(1, format!("found {width} columns; allowed: {allowed}")));
    }
    let mut rows: Vec<Row> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| refuse(e.position().map_or(1, csv::Position::line), e.to_string()))?;
        let line = record.position().map_or(1, csv::Position::line);
        let number = |i: usize| {
            let text = &record[i];
            text.parse()
                .ok()
                .filter(|x: &f64| x.is_finite())
                .ok_or_else(|| refuse(line, format!("found {text:?} in column {}; allowed: a finite number", i + 1)))
        };
        let rate = if with_rates { number(1 + columns + column)? } else { 0.0 };
        let row = Row { time: number(0)?, value: number(1 + column)?, rate };
        if rows.last().is_some_and(|last| last.time >= row.time) {
            return Err(refuse(line, format!("found time {} s after a later one; allowed: rising times", row.time)));
        }
        rows.push(row);
    }
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Err(refuse(1, "found no rows; allowed: at least one".to_string()));
    };
    if first.time > 0.0 || last.time < duration * (1.0 - 1e-9) {
        let found = format!("found times from {} to {} s", first.time, last.time);
        return Err(refuse(1, format!("{found}; allowed: a table that reaches from 0 to the duration, {duration} s")));
    }
    if with_rates {
        return Ok(Signal::Table(rows));
    }
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.time, row.value]).collect();
    Ok(Signal::table_without_rates(&points))
}
