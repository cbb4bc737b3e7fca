//! Sweeps.

use std::path::PathBuf;

use caudal::Error;
use caudal::jobs::{Journal, cores};
use caudal::sweep::{Results, Sweep, run as run_cases};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::attention::Progress;
use crate::error::OrRaise;
use crate::values::to_toml;

/// Runs the cases of a sweep that its folder lacks; the rows of all as dictionaries.
#[pyfunction]
#[pyo3(name = "_sweep")]
pub fn sweep<'py>(
    py: Python<'py>,
    path: PathBuf,
    set: Option<&Bound<'py, PyDict>>,
    out: Option<PathBuf>,
    jobs: Option<usize>,
    restart: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyList>> {
    let mut overrides = Vec::new();
    for (key, value) in set.into_iter().flatten() {
        overrides.push(format!("{key}={}", to_toml(&value)?));
    }
    let threads = jobs.unwrap_or_else(cores).max(1);
    let prepared = py.detach(|| {
        let sweep = Sweep::read(&path, &overrides)?;
        let job = sweep.job(threads)?;
        let folder = out.unwrap_or_else(|| sweep.folder());
        std::fs::create_dir_all(&folder).map_err(|e| Error::Write { path: folder.clone(), reason: e.to_string() })?;
        let journal = folder.join("cases.journal");
        if restart && journal.exists() {
            Journal::clear(&journal)?;
        }
        let journal = sweep.journal(&journal, &job)?;
        Ok((sweep, job, folder, journal))
    });
    let (sweep, job, folder, mut journal) = prepared.or_raise(py)?;
    let todo: Vec<usize> = (0..sweep.size()).filter(|index| !journal.has(*index)).collect();
    let told = Progress::default();
    told.reach(sweep.size() - todo.len(), sweep.size());
    let cases = || run_cases(&sweep, &mut journal, &todo, threads, &told.interrupted, |_| told.advance());
    told.watch(py, progress.as_ref(), cases)?.or_raise(py)?;
    let finished = py.detach(|| {
        let results = Results::new(&sweep, &job, vec![journal])?;
        results.write(&folder)?.complete()?;
        results.rows().collect::<caudal::Result<Vec<_>>>()
    });
    let rows = PyList::empty(py);
    for (index, row) in finished.or_raise(py)? {
        let dictionary = PyDict::new(py);
        dictionary.set_item("case", index)?;
        let case = sweep.case(index).or_raise(py)?;
        for (column, value) in sweep.columns().into_iter().zip(sweep.values(&case)) {
            dictionary.set_item(column, pythonize::pythonize(py, &value)?)?;
        }
        for (name, value) in &row.quantities {
            dictionary.set_item(name, pythonize::pythonize(py, value)?)?;
        }
        rows.append(dictionary)?;
    }
    told.tell(py, progress.as_ref())?;
    Ok(rows)
}
