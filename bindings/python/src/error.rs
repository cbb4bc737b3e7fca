//! Errors of the library as Python exceptions: `caudal.errors.<variant>Error` with the variant's fields.

use caudal::Error;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

/// The exception for `error`; an error without a Python class of its own becomes `caudal.Error`.
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
    let exception = class.call1((error.to_string(),))?;
    for (name, value) in &fields {
        exception.setattr(name.cast_into::<PyString>()?, value)?;
    }
    Ok(PyErr::from_value(exception))
}

/// Of two exceptions the one to raise, with the other as its cause.
pub fn first_of(py: Python<'_>, first: Option<PyErr>, other: Option<PyErr>) -> Option<PyErr> {
    match first {
        Some(failure) => {
            if other.is_some() {
                failure.set_cause(py, other);
            }
            Some(failure)
        }
        None => other,
    }
}

/// Converts results of the library to Python.
pub trait OrRaise<T> {
    /// The value, or the error as an exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for caudal::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|error| exception(py, &error))
    }
}
