//! Inverse design.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use caudal::design::{Design, Starts, start};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::error::OrRaise;
use crate::scene::Scene;

/// Designs what a scene's `[design]` asks for and writes its files: the content of design.json with the folder.
#[pyfunction]
#[pyo3(name = "_design")]
pub fn design<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    out: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Option<PyErr>)> {
    let Scene { scene, document, .. } = scene.get();
    let folder = out.unwrap_or_else(|| PathBuf::from("out").join(&scene.name));
    let mut failure = None;
    let look = |py: Python<'_>, iteration: usize, objective: f64| {
        py.check_signals()?;
        progress.as_ref().map_or(Ok(()), |callback| callback.call1(py, (iteration, objective)).map(|_| ()))
    };
    let designed = py.detach(|| {
        let design = Design::resumed(document, &folder, |iteration| {
            match Python::attach(|py| look(py, iteration.iteration, iteration.objective)) {
                Ok(()) => ControlFlow::Continue(()),
                Err(error) => {
                    failure = Some(error);
                    ControlFlow::Break(())
                }
            }
        })?;
        design.write(&folder)?.complete()?;
        design.numbers()
    });
    let numbers = pythonize::pythonize(py, &designed.or_raise(py)?)?.cast_into::<PyDict>()?;
    numbers.set_item("folder", folder)?;
    Ok((numbers, failure))
}

/// The starts of a design at work, with what is known of them in its folder.
#[pyclass(module = "caudal._caudal", name = "_Starts", frozen)]
pub struct StartsAtWork {
    folder: PathBuf,
    size: usize,
    /// None once it is closed.
    starts: Mutex<Option<Starts>>,
}

impl StartsAtWork {
    fn with<T>(&self, act: impl FnOnce(&mut Starts) -> caudal::Result<T>, py: Python<'_>) -> PyResult<T> {
        let mut starts = self.starts.lock().unwrap_or_else(PoisonError::into_inner);
        match starts.as_mut() {
            Some(starts) => act(starts).or_raise(py),
            None => Err(PyRuntimeError::new_err("the starts are closed")),
        }
    }
}

#[pymethods]
impl StartsAtWork {
    /// Reads and checks a design and opens its journal.
    #[new]
    fn new(py: Python<'_>, scene: &Bound<'_, Scene>, out: Option<PathBuf>) -> PyResult<Self> {
        let Scene { scene, document, .. } = scene.get();
        let folder = out.unwrap_or_else(|| PathBuf::from("out").join(&scene.name));
        let starts = Starts::of(document, &folder).or_raise(py)?;
        Ok(Self { folder, size: starts.count(), starts: Mutex::new(Some(starts)) })
    }

    /// Number of starts.
    #[getter]
    fn size(&self) -> usize {
        self.size
    }

    /// Where the design's files go.
    #[getter]
    fn folder(&self) -> &PathBuf {
        &self.folder
    }

    /// Starts that are worth handing out.
    fn todo(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        self.with(|starts| Ok(starts.todo()), py)
    }

    /// All that a worker elsewhere needs to search from them.
    fn parcel<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.with(|starts| starts.parcel()?.bytes(), py).map(|bytes| PyBytes::new(py, &bytes))
    }

    /// Keeps what starts simulated elsewhere; how many of them are new.
    fn keep(&self, py: Python<'_>, lines: Vec<Vec<u8>>) -> PyResult<usize> {
        self.with(|starts| lines.iter().try_fold(0, |new, line| Ok(new + usize::from(starts.keep(line)?))), py)
    }

    /// Closes the journal, so that the design may go on with it.
    fn close(&self) {
        drop(self.starts.lock().unwrap_or_else(PoisonError::into_inner).take());
    }
}

/// Searches from starts of a design that came in a parcel, one after the other: what they simulated, and the time that each took (s).
#[pyfunction]
#[pyo3(name = "_starts")]
pub fn starts<'py>(
    py: Python<'py>,
    parcel: &[u8],
    indices: Vec<usize>,
) -> PyResult<(Vec<Bound<'py, PyBytes>>, Vec<f64>)> {
    let one = |index: usize| {
        let begun = Instant::now();
        start(parcel, index).map(|line| (line, begun.elapsed().as_secs_f64()))
    };
    let lines: caudal::Result<Vec<_>> = py.detach(|| indices.into_iter().map(one).collect());
    Ok(lines.or_raise(py)?.into_iter().map(|(line, time)| (PyBytes::new(py, &line), time)).unzip())
}
