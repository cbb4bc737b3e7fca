//! Studies.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use caudal::report::{Claim, Findings};
use caudal::study::{DistributedStudy, Study, StudyOutcome, StudyRunner, make_runs, write_findings};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::attention::Progress;
use crate::distributed::{JobHandle, lines};
use crate::error::{OrRaise, exception, first_of};
use crate::scene::Scene;
use crate::values::plain;

/// The study of this kind with these options.
fn asked(kind: &str, options: &Bound<'_, PyDict>) -> PyResult<Study> {
    let py = options.py();
    let wrong = |error: pythonize::PythonizeError| caudal::Error::Study { problem: error.to_string() };
    let options = pythonize::depythonize(&plain(options)?).map_err(wrong).or_raise(py)?;
    Study::named(kind, &options).or_raise(py)
}

/// The next runs of a study for workers; `None` if no run is missing.
#[pyfunction]
#[pyo3(name = "_runs_of")]
pub fn runs_of(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    kind: &str,
    options: &Bound<'_, PyDict>,
    out: Option<PathBuf>,
    force: bool,
) -> PyResult<Option<JobHandle>> {
    let Scene { scene, document, .. } = scene.get();
    let study = asked(kind, options)?;
    let folder = out.unwrap_or_else(|| study.folder(scene));
    drop(study.claim(scene, &folder, Claim::forced(force)).or_raise(py)?); // removes results to be replaced
    let runs = py.detach(|| DistributedStudy::of(&study, document, &folder)).or_raise(py)?;
    Ok(runs.map(|runs| JobHandle::new(runs, "run", "_runs", folder)))
}

/// On a worker: executes runs of the study in a bundle; returns their lines and the wall-clock time of each (s).
#[pyfunction]
#[pyo3(name = "_runs")]
pub fn runs<'py>(
    py: Python<'py>,
    bundle: &[u8],
    indices: Vec<usize>,
) -> PyResult<(Vec<Bound<'py, PyBytes>>, Vec<f64>)> {
    Ok(lines(py, py.detach(|| make_runs(bundle, &indices)).or_raise(py)?))
}

/// Runs a study of this kind and writes its files. Returns its findings, and the exception of a file that could not be written.
#[pyfunction]
#[pyo3(name = "_study")]
pub fn study<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    kind: &str,
    options: &Bound<'py, PyDict>,
    out: Option<PathBuf>,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Option<PyErr>)> {
    let Scene { scene, document, .. } = scene.get();
    let study = asked(kind, options)?;
    let folder = out.unwrap_or_else(|| study.folder(scene));
    let told = Progress::default();
    let tell = |done: usize, of: usize| told.reach(done, of);
    let held = Mutex::new(study.claim(scene, &folder, Claim::forced(force)).or_raise(py)?);
    let runner = StudyRunner::new(&held, &told.interrupted, &tell);
    let findings = match told.watch(py, progress.as_ref(), || study.run(scene, runner))?.or_raise(py)? {
        StudyOutcome::Complete(findings) => findings,
        StudyOutcome::Interrupted(done, of) => {
            return Err(PyRuntimeError::new_err(format!("interrupted after {done} of {of} runs")));
        }
    };
    let mut held = held.into_inner().unwrap_or_else(PoisonError::into_inner);
    let written = py.detach(|| write_findings(&findings, &mut held, &scene.name, document)?.complete());
    let unwritten = written.err().map(|error| exception(py, &error));
    let failure = first_of(py, told.tell(py, progress.as_ref()).err(), unwritten);
    let Findings { subject, answers, numbers, figures, tables, .. } = findings;
    let content = PyDict::new(py);
    content.set_item("folder", folder)?;
    content.set_item("subject", subject)?;
    content.set_item("answers", answers)?;
    content.set_item("numbers", pythonize::pythonize(py, &numbers)?)?;
    content.set_item(
        "figures",
        figures.into_iter().map(|figure| (figure.file, figure.svg)).collect::<std::collections::BTreeMap<_, _>>(),
    )?;
    let all = PyDict::new(py);
    for table in tables {
        let columns = PyDict::new(py);
        for (i, column) in table.columns.iter().enumerate() {
            let values: Vec<_> = table.rows.iter().map(|row| row.get(i)).collect();
            columns.set_item(column, pythonize::pythonize(py, &values)?)?;
        }
        all.set_item(table.file.trim_end_matches(".csv"), columns)?;
    }
    content.set_item("tables", all)?;
    Ok((content, failure))
}
