//! Inverse design.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;

use caudal::design::{Design, DistributedDesign, SearchIteration, simulate};
use caudal::report::Claim;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::distributed::{JobHandle, lines};
use crate::error::OrRaise;
use crate::scene::Scene;

/// Runs the design problem in a scene's `[design]` and writes its files. Returns the content of design.json with the folder.
#[pyfunction]
#[pyo3(name = "_design")]
pub fn design<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    out: Option<PathBuf>,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Option<PyErr>)> {
    let Scene { scene, document, .. } = scene.get();
    let folder = out.unwrap_or_else(|| Design::folder(scene));
    drop(Design::claim(scene, &folder, Claim::forced(force)).or_raise(py)?); // removes results to be replaced
    let (mut failure, mut tell) = (None, progress_callback(progress));
    let designed = py.detach(|| {
        let design = Design::resumed(document, &folder, |iteration| tell(iteration, &mut failure))?;
        design.write(&folder)?.complete()?;
        design.numbers()
    });
    let numbers = designed.or_raise(py).map_err(|error| raised_before(error, &mut failure))?;
    let numbers = pythonize::pythonize(py, &numbers)?.cast_into::<PyDict>()?;
    numbers.set_item("folder", folder)?;
    Ok((numbers, failure))
}

/// The exception that stopped a search before it had a result, in place of the `error` that reports this.
fn raised_before(error: PyErr, failure: &mut Option<PyErr>) -> PyErr {
    failure.take().unwrap_or(error)
}

/// The callback for iterations: it checks for signals and calls `progress`, and stops the search if either raises an exception.
fn progress_callback(
    progress: Option<Py<PyAny>>,
) -> impl FnMut(Option<&SearchIteration>, &mut Option<PyErr>) -> ControlFlow<()> {
    move |iteration, failure| {
        let told = Python::attach(|py| {
            py.check_signals()?;
            let news = progress.as_ref().zip(iteration);
            news.map_or(Ok(()), |(callback, news)| callback.call1(py, (news.iteration, news.objective)).map(|_| ()))
        });
        match told {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                *failure = Some(error);
                ControlFlow::Break(())
            }
        }
    }
}

/// The next parts of a design for workers; `None` if nothing is left.
#[pyfunction]
#[pyo3(name = "_design_parts")]
pub fn parts(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    out: Option<PathBuf>,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Option<JobHandle>> {
    let Scene { scene, document, .. } = scene.get();
    let folder = out.unwrap_or_else(|| Design::folder(scene));
    drop(Design::claim(scene, &folder, Claim::forced(force)).or_raise(py)?); // removes results to be replaced
    let (mut failure, mut tell) = (None, progress_callback(progress));
    let next = py.detach(|| DistributedDesign::next(document, &folder, |iteration| tell(iteration, &mut failure)));
    let next = next.or_raise(py).map_err(|error| raised_before(error, &mut failure))?;
    match failure {
        Some(failure) => Err(failure),
        None => Ok(next.map(|next| {
            let noun = next.noun();
            JobHandle::new(next, noun, "_simulate", folder)
        })),
    }
}

/// On a worker: runs parts of the design in a bundle; returns their lines and the wall-clock time of each (s).
#[pyfunction]
#[pyo3(name = "_simulate")]
pub fn simulate_parts<'py>(
    py: Python<'py>,
    bundle: &[u8],
    indices: Vec<usize>,
) -> PyResult<(Vec<Bound<'py, PyBytes>>, Vec<f64>)> {
    let one = |index: usize| {
        let begun = Instant::now();
        simulate(bundle, index).map(|line| (line, begun.elapsed().as_secs_f64()))
    };
    let made: caudal::Result<Vec<_>> = py.detach(|| indices.into_iter().map(one).collect());
    Ok(lines(py, made.or_raise(py)?))
}
