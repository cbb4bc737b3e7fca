//! Values between Python and the library.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyList, PyTuple};

/// Converts a dictionary to a `caudal.fields.Fields`, which lists the existing keys if an unknown one is requested.
pub fn fields<'py>(dictionary: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let class = dictionary.py().import("caudal.fields")?.getattr("Fields")?;
    Ok(class.call1((dictionary,))?.cast_into()?)
}

/// Names from Python: one, or a list of them; none by default. Errors mention the `argument`.
pub fn names(names: Option<&Bound<'_, PyAny>>, argument: &str) -> PyResult<Vec<String>> {
    let Some(names) = names else { return Ok(Vec::new()) };
    names.py().import("caudal.arguments")?.call_method1("names_of", (names, argument))?.extract()
}

/// Numbers from Python: an array of contiguous, aligned doubles is used in place, others are converted.
pub enum Numbers<'py> {
    /// One number for all entries.
    One(f64),
    /// One number per entry.
    Borrowed(PyReadonlyArray1<'py, f64>),
}

impl<'py> Numbers<'py> {
    /// Converts a number, or anything from which NumPy makes a one-dimensional array; errors mention the `argument`.
    pub fn of(values: &Bound<'py, PyAny>, argument: &str) -> PyResult<Self> {
        if let Ok(number) = values.cast::<PyFloat>() {
            return Ok(Self::One(number.value()));
        }
        let array = match values.cast::<PyArray1<f64>>() {
            Ok(array) if array.try_readonly().is_ok_and(|array| array.as_slice().is_ok()) => array.clone(),
            _ => {
                let arguments = values.py().import("caudal.arguments")?;
                let array = arguments.call_method1("numbers_of", (values, argument))?;
                let shape = array.getattr("shape")?;
                if shape.len()? == 0 {
                    return Ok(Self::One(array.call_method0("item")?.extract()?));
                }
                let wrong = |_| {
                    let allowed = "allowed: a number, or numbers in one dimension";
                    PyTypeError::new_err(format!("{argument}: found the shape {shape}; {allowed}"))
                };
                array.cast_into().map_err(wrong)?
            }
        };
        Ok(Self::Borrowed(array.try_readonly()?))
    }

    /// As many numbers as a variable of `count` entries needs, if possible; `buffer` holds a repeated one.
    pub fn spread<'a>(&'a self, count: usize, buffer: &'a mut Vec<f64>) -> PyResult<&'a [f64]> {
        Ok(match self {
            Self::One(number) => {
                buffer.clear();
                buffer.resize(count, *number);
                buffer
            }
            Self::Borrowed(array) => array.as_slice()?,
        })
    }
}

/// Converts NumPy scalars and arrays in `value`, itself or nested at any depth, to plain Python values.
pub fn plain<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    if let Some(tolist) = value.getattr_opt("tolist")? {
        return tolist.call0();
    }
    if let Ok(entries) = value.cast::<PyDict>() {
        let dictionary = PyDict::new(value.py());
        for (key, value) in entries {
            dictionary.set_item(key, plain(&value)?)?;
        }
        return Ok(dictionary.into_any());
    }
    if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let list = PyList::empty(value.py());
        for value in value.try_iter()? {
            list.append(plain(&value?)?)?;
        }
        return Ok(list.into_any());
    }
    Ok(value.clone())
}

/// Converts a Python value to TOML.
pub fn to_toml(value: &Bound<'_, PyAny>) -> PyResult<::toml::Value> {
    let plain = plain(value)?;
    pythonize::depythonize(&plain).map_err(|_| {
        PyTypeError::new_err(format!(
            "{} cannot be part of a scene; allowed: numbers, strings, booleans, and lists and dictionaries of them",
            plain.repr().map_or_else(|_| "this value".to_string(), |text| text.to_string())
        ))
    })
}

/// Formats a Python value as the right-hand side of a key in a TOML file.
#[pyfunction]
#[pyo3(name = "_toml")]
pub fn toml(value: &Bound<'_, PyAny>) -> PyResult<String> {
    to_toml(value).map(|value| value.to_string())
}

/// HTML representation of an object for notebooks.
pub fn shown(object: &Bound<'_, PyAny>) -> PyResult<String> {
    object.py().import("caudal.showing")?.call_method1("shown", (object,))?.extract()
}
