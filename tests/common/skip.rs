//! Saying what was not tried on this machine. Included by the tests that need a program from outside by its path.

use std::io::Write;

/// Says that `what` was not tried, and how to get what it needs.
///
/// The line goes to standard error and, where the variable `CAUDAL_SKIPPED` names a file, to its end: `tests/all.sh` shows
/// all of them together.
pub fn skip(what: &str, remedy: &str) {
    let line = format!("{what}: {}\n", remedy.split_whitespace().collect::<Vec<_>>().join(" "));
    let _ = write!(std::io::stderr(), "SKIPPED {line}");
    if let Some(path) = std::env::var_os("CAUDAL_SKIPPED") {
        let file = std::fs::OpenOptions::new().append(true).create(true).open(&path);
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        assert!(written.is_ok(), "{}: {written:?}", path.display());
    }
}
