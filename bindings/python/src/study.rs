//! Studies.

use std::path::PathBuf;

use caudal::report::Findings;
use caudal::study::{Desk, Studied, Study, keep};
use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::attention::Progress;
use crate::error::OrRaise;
use crate::scene::Scene;

/// Makes a study, `{kind: options}`, and writes its files: what `caudal.study` makes its findings from.
#[pyfunction]
#[pyo3(name = "_study")]
pub fn study<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    study: &Bound<'py, PyDict>,
    out: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let Scene { scene, document, .. } = scene.get();
    let study: Study = pythonize::depythonize(study).map_err(|error| PyTypeError::new_err(error.to_string()))?;
    let folder = out.unwrap_or_else(|| study.folder(scene));
    let told = Progress::default();
    let tell = |done: usize, of: usize| told.reach(done, of);
    let desk = Desk { folder: &folder, interrupted: &told.interrupted, progress: &tell };
    let findings = match told.watch(py, progress.as_ref(), || study.make(scene, desk))?.or_raise(py)? {
        Studied::Complete(findings) => findings,
        Studied::Interrupted(done, of) => {
            return Err(PyRuntimeError::new_err(format!("interrupted after {done} of {of} runs")));
        }
    };
    py.detach(|| keep(&findings, &folder, &scene.name, document)?.complete()).or_raise(py)?;
    told.tell(py, progress.as_ref())?;
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
    Ok(content)
}
