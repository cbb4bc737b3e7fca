//! Jobs whose parts run on workers (Dask): the starts and checks of designs, and the runs of studies.

use std::path::PathBuf;
use std::sync::Mutex;

use caudal::distributed::DistributableJob;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::OrRaise;
use crate::locks::lock;

/// A distributable job, with its stored results.
#[pyclass(module = "caudal._caudal", name = "_Parts", frozen)]
pub struct JobHandle {
    /// The folder of its results.
    #[pyo3(get)]
    folder: PathBuf,
    /// The noun for a part.
    #[pyo3(get)]
    noun: &'static str,
    /// The function of this module that runs parts on a worker.
    #[pyo3(get)]
    worker: &'static str,
    /// Number of parts.
    #[pyo3(get)]
    size: usize,
    /// `None` once the job is closed.
    parts: Mutex<Option<Box<dyn DistributableJob>>>,
}

impl JobHandle {
    /// Creates a job with these `parts`, each called `noun` and run by the function `worker`, with results in `folder`.
    pub fn new(
        parts: impl DistributableJob + 'static,
        noun: &'static str,
        worker: &'static str,
        folder: PathBuf,
    ) -> Self {
        Self { folder, noun, worker, size: parts.count(), parts: Mutex::new(Some(Box::new(parts))) }
    }

    fn with<T>(&self, act: impl FnOnce(&mut dyn DistributableJob) -> caudal::Result<T>, py: Python<'_>) -> PyResult<T> {
        let mut parts = lock(py, &self.parts);
        match parts.as_mut() {
            Some(parts) => act(parts.as_mut()).or_raise(py),
            None => Err(PyRuntimeError::new_err("it is closed")),
        }
    }
}

#[pymethods]
impl JobHandle {
    /// The parts without a result.
    fn todo(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.with(|parts| Ok(parts.pending()), py)
    }

    /// A description of a part.
    fn describe(&self, py: Python<'_>, index: usize) -> PyResult<String> {
        self.with(|parts| Ok(parts.describe(index)), py)
    }

    /// The bundle sent to a worker, as bytes.
    fn bundle<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.with(|parts| parts.bundle(), py).map(|bytes| PyBytes::new(py, &bytes))
    }

    /// Stores the results that workers returned; returns the number of new ones.
    fn keep(&self, py: Python<'_>, lines: Vec<Vec<u8>>) -> PyResult<usize> {
        self.with(|parts| lines.iter().try_fold(0, |new, line| Ok(new + usize::from(parts.store(line)?))), py)
    }

    /// Closes its journal, so that the job can resume.
    fn close(&self, py: Python<'_>) {
        let parts = lock(py, &self.parts).take();
        py.detach(|| drop(parts));
    }
}

/// Journal lines and the wall-clock time of each (s), for Python.
pub fn lines(py: Python<'_>, lines: Vec<(Vec<u8>, f64)>) -> (Vec<Bound<'_, PyBytes>>, Vec<f64>) {
    lines.into_iter().map(|(line, time)| (PyBytes::new(py, &line), time)).unzip()
}
