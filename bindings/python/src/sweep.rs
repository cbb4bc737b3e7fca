//! Sweeps: on the threads of this machine, or case by case on workers.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use caudal::error::Error;
use caudal::jobs::{Job, Journal, cores};
use caudal::report::{Claim, Folder};
use caudal::scene::Files;
use caudal::sweep::{RecentResults, Sweep, SweepResults, SweepWorker, run as run_cases};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::attention::Progress;
use crate::distributed::lines;
use crate::error::{OrRaise, exception};
use crate::locks::{lock, lock_detached};
use crate::values::to_toml;

/// A sweep in progress, with its journal.
#[pyclass(module = "caudal._caudal", name = "_Sweep", frozen)]
pub struct SweepAtWork {
    sweep: Sweep,
    job: Job,
    folder: PathBuf,
    /// Its folder, claimed while results are written.
    held: Mutex<Folder>,
    threads: usize,
    /// `None` once the results are written.
    journal: Mutex<Option<Journal>>,
    /// Results of cases that ran in this process.
    fresh: Mutex<RecentResults>,
}

impl SweepAtWork {
    fn with_journal<T>(&self, act: impl FnOnce(&mut Journal) -> caudal::Result<T>, py: Python<'_>) -> PyResult<T> {
        let mut journal = lock(py, &self.journal);
        match journal.as_mut() {
            Some(journal) => act(journal).or_raise(py),
            None => Err(PyRuntimeError::new_err("the sweep is finished")),
        }
    }
}

#[pymethods]
impl SweepAtWork {
    /// Reads and checks a sweep and opens its journal. If `sources` are given, the sweep is read from these file contents, which
    /// are written to its folder.
    #[new]
    #[allow(clippy::too_many_arguments)] // called so from Python
    fn new(
        py: Python<'_>,
        path: PathBuf,
        set: Option<&Bound<'_, PyDict>>,
        out: Option<PathBuf>,
        jobs: Option<usize>,
        restart: bool,
        force: bool,
        sources: BTreeMap<PathBuf, Vec<u8>>,
    ) -> PyResult<Self> {
        let mut overrides = Vec::new();
        for (key, value) in set.into_iter().flatten() {
            overrides.push(format!("{key}={}", to_toml(&value)?));
        }
        let threads = jobs.unwrap_or_else(cores).max(1);
        let placed: Vec<PathBuf> = sources.keys().cloned().collect();
        let prepared = py.detach(|| {
            let named = |(path, content): (&PathBuf, &Vec<u8>)| {
                (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), content.clone())
            };
            let written: Vec<_> = sources.iter().map(named).collect();
            let sweep = Sweep::read_from(&Files::over_disk(sources), &path, &overrides)?;
            let job = sweep.job(threads)?;
            let folder = out.unwrap_or_else(|| sweep.folder());
            let mut held = sweep.claim(&folder, &job, Claim::forced(force))?;
            written.iter().try_for_each(|(name, _)| held.admit(name))?;
            if restart {
                held.begin_anew(None)?;
            }
            let journal = Mutex::new(Some(sweep.journal(&mut held, "cases.journal", &job)?));
            held.keep_sources(&written)?;
            held.let_others();
            Ok(Self { sweep, job, folder, held: Mutex::new(held), threads, journal, fresh: Mutex::default() })
        });
        prepared.map_err(|error| without_file(error, &placed)).or_raise(py)
    }

    /// Number of its cases.
    #[getter]
    fn size(&self) -> usize {
        self.sweep.size()
    }

    /// The noun for a case.
    #[getter]
    fn noun(&self) -> &'static str {
        "case"
    }

    /// The function of this module that runs cases on a worker.
    #[getter]
    fn worker(&self) -> &'static str {
        "_cases"
    }

    /// The folder of its results.
    #[getter]
    fn folder(&self) -> &PathBuf {
        &self.folder
    }

    /// Its axes: name, values of its column at each level, and whether it varies with the sample.
    #[getter]
    fn axes<'py>(&self, py: Python<'py>) -> PyResult<Vec<(String, Bound<'py, PyAny>, bool)>> {
        let axes = self.sweep.axes.iter();
        axes.map(|axis| Ok((axis.name.clone(), pythonize::pythonize(py, &axis.labels)?, axis.sampled))).collect()
    }

    /// The cases without a result.
    fn todo(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.with_journal(|journal| Ok((0..self.sweep.size()).filter(|index| !journal.has(*index)).collect()), py)
    }

    /// A description of a case.
    fn describe(&self, py: Python<'_>, index: usize) -> PyResult<String> {
        Ok(self.sweep.describe(&self.sweep.case(index).or_raise(py)?))
    }

    /// The bundle sent to a worker, as bytes.
    fn bundle<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.sweep.bundle().and_then(|bundle| bundle.bytes()).or_raise(py)?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Stores the result lines of cases that workers ran; returns the number of new ones.
    fn keep(&self, py: Python<'_>, lines: Vec<Vec<u8>>) -> PyResult<usize> {
        let add = |journal: &mut Journal| {
            let mut new = 0;
            for line in &lines {
                new += usize::from(journal.add_line(line)?.1);
            }
            Ok(new)
        };
        self.with_journal(add, py)
    }

    /// Runs the cases without a result on this machine's threads.
    fn run(&self, py: Python<'_>, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let todo = self.todo(py)?;
        let told = Progress::default();
        told.reach(self.sweep.size() - todo.len(), self.sweep.size());
        let cases = || {
            let mut journal = lock_detached(&self.journal);
            let mut fresh = lock_detached(&self.fresh);
            journal.as_mut().map_or(Ok(()), |journal| {
                run_cases(&self.sweep, journal, &todo, self.threads, &told.interrupted, |index, row| {
                    told.advance();
                    fresh.keep(index, row);
                })
            })
        };
        told.watch(py, progress.as_ref(), cases)?.or_raise(py)?;
        told.tell(py, progress.as_ref())
    }

    /// Closes the journal, so that the sweep can resume.
    fn close(&self, py: Python<'_>) {
        let journal = lock(py, &self.journal).take();
        py.detach(|| drop(journal));
    }

    /// Writes table, figures and report of the finished cases, and closes the journal. Returns the rows as dictionaries (none
    /// unless `wanted`), the numbers of cases and of incomplete ones, and the exception of a file that could not be written.
    fn finish<'py>(&self, py: Python<'py>, wanted: bool) -> PyResult<(Bound<'py, PyList>, [usize; 2], Option<PyErr>)> {
        let journal = lock(py, &self.journal).take();
        let mut journal = journal.ok_or_else(|| PyRuntimeError::new_err("the sweep is finished"))?;
        let results = py.detach(|| {
            journal.sync()?;
            let fresh = std::mem::take(&mut *lock_detached(&self.fresh));
            let results = SweepResults::new(&self.sweep, &self.job, vec![journal])?.with(fresh);
            let mut held = lock_detached(&self.held);
            held.relock()?;
            let written = results.write(&mut held);
            held.let_others();
            Ok((results, written.and_then(|written| written.kept.complete())))
        });
        let (results, written) = results.or_raise(py)?;
        let rows = PyList::empty(py);
        let [mut cases, mut failed] = [0, 0];
        for row in results.rows() {
            let (index, row) = row.or_raise(py)?;
            cases += 1;
            failed += usize::from(!row.complete());
            if !wanted {
                continue;
            }
            let dictionary = PyDict::new(py);
            dictionary.set_item("case", index)?;
            let case = self.sweep.case(index).or_raise(py)?;
            for (column, value) in self.sweep.columns().into_iter().zip(self.sweep.values(&case)) {
                dictionary.set_item(column, pythonize::pythonize(py, &value)?)?;
            }
            for (name, value) in &row.quantities {
                dictionary.set_item(name, pythonize::pythonize(py, value)?)?;
            }
            rows.append(dictionary)?;
        }
        Ok((rows, [cases, failed], written.err().map(|error| exception(py, &error))))
    }
}

/// Replaces the locations in `error` for a sweep of objects, which was not read from these files; they may not exist yet.
fn without_file(error: Error, files: &[PathBuf]) -> Error {
    match error {
        Error::Scene { place, key, problem }
            if files.iter().any(|file| place.starts_with(&*file.to_string_lossy())) =>
        {
            Error::Scene { place: "sweep".to_string(), key, problem }
        }
        Error::Several(errors) => Error::Several(errors.into_iter().map(|error| without_file(error, files)).collect()),
        other => other,
    }
}

/// File descriptors of the journals that this process has locked.
#[pyfunction]
#[pyo3(name = "_held_descriptors")]
pub fn held_descriptors() -> Vec<i32> {
    #[cfg(unix)]
    return caudal::jobs::held_descriptors();
    #[cfg(not(unix))]
    return Vec::new();
}

/// The sweep whose cases this process ran last, and its bundle.
static UNPACKED: Mutex<Option<(Vec<u8>, Arc<SweepWorker>)>> = Mutex::new(None);

/// On a worker: runs cases of the sweep in a bundle; returns their lines and the wall-clock time of each (s).
#[pyfunction]
#[pyo3(name = "_cases")]
pub fn cases<'py>(
    py: Python<'py>,
    bundle: &[u8],
    indices: Vec<usize>,
) -> PyResult<(Vec<Bound<'py, PyBytes>>, Vec<f64>)> {
    let made: caudal::Result<Vec<_>> = py.detach(|| {
        let known = lock_detached(&UNPACKED).clone();
        let sweep = match known.filter(|(bytes, _)| bytes == bundle) {
            Some((_, sweep)) => sweep,
            None => {
                let sweep = Arc::new(SweepWorker::read(bundle)?);
                let known = Some((bundle.to_vec(), sweep.clone()));
                *lock_detached(&UNPACKED) = known;
                sweep
            }
        };
        sweep.lines(&indices)
    });
    Ok(lines(py, made.or_raise(py)?))
}
