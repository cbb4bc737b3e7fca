//! Comparisons of runs.

use std::path::PathBuf;

use caudal::report::comparison::Comparison;
use caudal::report::recorded_run::{NodePositions, RecordedRun};
use caudal::report::{Claim, Folder};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{OrRaise, exception};
use crate::scene::Scene;
use crate::values::plain;

/// A run in memory: its scene, its summary, its scalar variables by name, and the nodes with their positions x and y, in
/// row-major order.
type InMemory<'py> =
    (Bound<'py, Scene>, Bound<'py, PyDict>, Vec<(String, Vec<f64>)>, Option<(Vec<usize>, Vec<f64>, Vec<f64>)>);

/// A folder of a run, or a run in memory.
#[derive(FromPyObject)]
pub enum Run<'py> {
    Folder(PathBuf),
    InMemory(InMemory<'py>),
}

impl Run<'_> {
    fn recorded(self, py: Python<'_>) -> PyResult<RecordedRun> {
        match self {
            Self::Folder(path) => py.detach(|| RecordedRun::read(&path)).or_raise(py),
            Self::InMemory((scene, summary, columns, positions)) => {
                let wrong = |error: pythonize::PythonizeError| PyRuntimeError::new_err(error.to_string());
                let summary = pythonize::depythonize(&plain(&summary)?).map_err(wrong)?;
                let positions = positions.map(|(nodes, x, y)| NodePositions { nodes, x, y });
                RecordedRun::in_memory(summary, scene.get().document.clone(), columns, positions).or_raise(py)
            }
        }
    }
}

/// Compares runs and, with `out`, writes the files. Returns the content, and the exception of a file that could not be written.
#[pyfunction]
#[pyo3(name = "_compare")]
pub fn compare<'py>(
    py: Python<'py>,
    runs: Vec<Run<'py>>,
    out: Option<PathBuf>,
    force: bool,
) -> PyResult<(Bound<'py, PyDict>, Option<PyErr>)> {
    let runs = runs.into_iter().map(|run| run.recorded(py)).collect::<PyResult<Vec<_>>>()?;
    let comparison = py.detach(|| Comparison::of(runs)).or_raise(py)?;
    let claim = |folder: &PathBuf| comparison.claim(folder, Claim::forced(force));
    let mut held: Option<Folder> = out.as_ref().map(claim).transpose().or_raise(py)?;
    let write = |held: &mut Folder| comparison.write(held)?.complete().map(drop);
    let written = py.detach(|| held.as_mut().map_or(Ok(()), write));
    let failure = written.err().map(|error| exception(py, &error));
    let content = PyDict::new(py);
    content.set_item("folder", out)?;
    content.set_item("labels", &comparison.labels)?;
    content.set_item("content", pythonize::pythonize(py, &comparison.content())?)?;
    content.set_item("html", comparison.html().or_raise(py)?)?;
    let figures = PyDict::new(py);
    for figure in &comparison.figures {
        figures.set_item(&figure.file, &figure.svg)?;
    }
    content.set_item("figures", figures)?;
    Ok((content, failure))
}
