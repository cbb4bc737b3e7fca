//! Inverse design.

use std::ops::ControlFlow;
use std::path::PathBuf;

use caudal::design::Design;
use pyo3::prelude::*;
use pyo3::types::PyDict;

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
        let design = Design::of(document, |iteration| {
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
