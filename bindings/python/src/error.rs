//! Errors of the library as Python exceptions: `caudal.errors.<variant>Error` with the variant's fields.

use caudal::Error;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

/// The exception of `error`; one that Python does not know by name is a `caudal.Error`.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    raised(py, error).unwrap_or_else(|failure| failure)
}

fn raised(py: Python<'_>, error: &Error) -> PyResult<PyErr> {
    let errors = py.import("caudal.errors")?;
    let content = pythonize::pythonize(py, error)?;
    let variants = content.cast_into::<PyDict>()?;
    let mut class = errors.getattr("Error")?;
    let fields = PyDict::new(py);
    for (variant, content) in &variants {
        let name = PyString::new(py, &format!("{}Error", variant.str()?.to_cow()?));
        class = errors.getattr_opt(name)?.unwrap_or(class);
        match content.cast_into::<PyDict>() {
            Ok(named) => fields.update(named.as_mapping())?,
            Err(single) => fields.set_item("value", single.into_inner())?,
        }
    }
    let exception = class.call1((as_arguments(&error.to_string()),))?;
    for (name, value) in &fields {
        exception.setattr(name.cast_into::<PyString>()?, value)?;
    }
    Ok(PyErr::from_value(exception))
}

/// Rewrites messages about options of the command as messages about the arguments of Python.
fn as_arguments(text: &str) -> String {
    let options = [
        ("--out", "`out=`"),
        ("--force", "`force=True`"),
        ("--restart", "`restart=True`"),
        ("--jobs ", "jobs="),
        ("--set ", ""),
        ("override ", ""),
        ("`caudal sweep` runs it", "`caudal.sweep` runs it"),
        ("`caudal run` runs it", "`caudal.run` runs it"),
        ("`caudal run SCENE` makes the folder of a run", "`caudal.run` with `out=` makes the folder of a run"),
        ("`caudal run` leaves some", "`caudal.run` with `out=` leaves some"),
        ("Simulation::pull_back", "`Simulation.pull_back`"),
        ("`caudal variables SCENE` lists them", "`Stepper.variables` lists them"),
    ];
    options.into_iter().fold(text.to_string(), |text, (option, argument)| text.replace(option, argument))
}

/// Turns the library's results into Python's.
pub trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for caudal::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| exception(py, &error))
    }
}
