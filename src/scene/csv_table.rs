//! CSV tables of functions of time, for a driven head or a flow: a header, then a column of times followed by values and rates.

use std::path::Path;

use super::files::Files;
use crate::error::{Error, Result};
use crate::head::{Row, Signal};

/// Reads value `column` of `columns` from a file of `files` with the columns time, the values, and (all or none) their rates.
///
/// # Errors
/// [`Error::Read`]; [`Error::Scene`] with file and line if it is not such a table, or does not span 0 to `duration` (s).
pub fn read(files: &Files, path: &Path, column: usize, columns: usize, duration: f64) -> Result<Signal> {
    let refuse = |line: u64, problem: String| Error::Scene {
        place: format!("{}:{line}", path.display()),
        key: String::new(),
        problem,
    };
    let text = files.text(path)?;
    // The reported start of a record may be followed by comments and empty lines.
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
    let names: Vec<String> = header.iter().map(str::to_lowercase).collect();
    if let Some((i, unit)) = names.iter().enumerate().find_map(|(i, name)| Some((i, other_unit(name)?))) {
        let found = format!("found {:?} as column {}, in {unit}", &header[i], i + 1);
        return Err(refuse(first_line, format!("{found}; allowed: seconds, metres and radians, and their rates")));
    }
    if let Some((i, wanted)) = misplaced(&names, columns) {
        let found = format!("found {:?} as column {}", &header[i], i + 1);
        return Err(refuse(
            first_line,
            format!("{found}; allowed: {wanted} there, in the order time, values, their rates"),
        ));
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
            format!("{found}; allowed: a table that covers 0 to the duration, {duration} s"),
        ));
    }
    if with_rates {
        return Ok(Signal::Table(rows));
    }
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.time, row.value]).collect();
    Ok(Signal::table_without_rates(&points))
}

/// The unit at the end of a column name, if it is not one of seconds, metres, radians and their rates. A name without unit is taken as
/// SI.
fn other_unit(name: &str) -> Option<&str> {
    const OTHERS: [&str; 14] =
        ["ms", "us", "ns", "min", "mm", "cm", "um", "µs", "µm", "km", "deg", "degrees", "°", "rev"];
    // A unit follows the quantity, as in `x_mm_s` or in `x [mm]`.
    let words = name.split(|c: char| !c.is_alphanumeric() && c != '°' && c != 'µ').skip(1);
    words.into_iter().find(|word| OTHERS.contains(word))
}

/// The first column whose name indicates a wrong order, and the expected quantity: time first, x before y, values before rates.
/// Other names are accepted.
fn misplaced(names: &[String], values: usize) -> Option<(usize, &'static str)> {
    let is_time = |name: &str| name == "t" || name.starts_with("t_") || name.starts_with("time");
    let is_rate = |name: &str| name.ends_with("_s") || name.contains("rate") || name.contains("spin");
    let is_value = |name: &str| name.ends_with("_m") || name.ends_with("_rad");
    let wrong = |(i, name): (usize, &String)| match i {
        0 => (!is_time(name)).then_some("the time"),
        _ if is_time(name) => Some("a value"),
        _ if i <= values && is_rate(name) => Some("a value, not a rate,"),
        _ if i > values && is_value(name) => Some("a rate"),
        1 if values == 2 && name.starts_with('y') => Some("x"),
        2 if values == 2 && name.starts_with('x') => Some("y"),
        _ => None,
    };
    names.iter().enumerate().find_map(|column| wrong(column).map(|wanted| (column.0, wanted)))
}
