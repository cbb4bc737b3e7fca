//! Inverse design.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use caudal::design::{Design, Starts, start};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::error::OrRaise;
use crate::parts::{PartsAtWork, lines};
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

/// The starts of a design, for workers elsewhere.
#[pyfunction]
#[pyo3(name = "_starts_of")]
pub fn starts_of(py: Python<'_>, scene: &Bound<'_, Scene>, out: Option<PathBuf>) -> PyResult<PartsAtWork> {
    let Scene { scene, document, .. } = scene.get();
    let folder = out.unwrap_or_else(|| PathBuf::from("out").join(&scene.name));
    let starts = py.detach(|| Starts::of(document, &folder)).or_raise(py)?;
    Ok(PartsAtWork::new(starts, "start", folder))
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
    let made: caudal::Result<Vec<_>> = py.detach(|| indices.into_iter().map(one).collect());
    Ok(lines(py, made.or_raise(py)?))
}
