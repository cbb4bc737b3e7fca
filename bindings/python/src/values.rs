//! Values between Python and the library.

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyList, PyTuple};

/// The same as a `caudal.fields.Fields`, which says what is there where something else is asked for.
pub fn fields<'py>(dictionary: &Bound<'py, PyDict>) -> PyResult<Bound<'py, PyDict>> {
    let class = dictionary.py().import("caudal.fields")?.getattr("Fields")?;
    Ok(class.call1((dictionary,))?.cast_into()?)
}

/// Numbers from Python: an array of contiguous doubles is used in place, others are converted.
pub enum Numbers<'py> {
    /// One for all entries.
    One(f64),
    /// One each, in place.
    Borrowed(PyReadonlyArray1<'py, f64>),
    /// One each, with gaps in memory.
    Copied(Vec<f64>),
}

impl<'py> Numbers<'py> {
    /// Those of a number or of anything that NumPy makes an array of one dimension from.
    pub fn of(values: &Bound<'py, PyAny>) -> PyResult<Self> {
        if let Ok(number) = values.cast::<PyFloat>() {
            return Ok(Self::One(number.value()));
        }
        if values.is_none() {
            return Err(PyTypeError::new_err(not_numbers(values))); // NumPy takes it for NaN
        }
        let array = match values.cast::<PyArray1<f64>>() {
            Ok(array) => array.clone(),
            Err(_) => {
                let numpy = values.py().import("numpy")?;
                let array = numpy.call_method1("asarray", (values, "float64")).map_err(|error| {
                    if error.is_instance_of::<PyValueError>(values.py()) {
                        PyValueError::new_err(not_numbers(values))
                    } else {
                        PyTypeError::new_err(not_numbers(values))
                    }
                })?;
                if array.getattr("ndim")?.extract::<usize>()? == 0 {
                    return Ok(Self::One(array.call_method0("item")?.extract()?));
                }
                array.cast_into().map_err(|_| PyTypeError::new_err(not_numbers(values)))?
            }
        };
        let array = array.try_readonly()?;
        Ok(if array.as_slice().is_ok() { Self::Borrowed(array) } else { Self::Copied(array.as_array().to_vec()) })
    }

    /// As many as a variable of `count` entries wants, where that can be told; `buffer` holds one repeated.
    pub fn spread<'a>(&'a self, count: usize, buffer: &'a mut Vec<f64>) -> PyResult<&'a [f64]> {
        Ok(match self {
            Self::One(number) => {
                buffer.clear();
                buffer.resize(count, *number);
                buffer
            }
            Self::Borrowed(array) => array.as_slice()?,
            Self::Copied(values) => values,
        })
    }
}

/// The message about a value that is no list of numbers.
fn not_numbers(value: &Bound<'_, PyAny>) -> String {
    let found = value.repr().map_or_else(|_| "this value".to_string(), |text| text.to_string());
    format!("value: found {found}; allowed: a number, or numbers in one dimension")
}

/// `value` with NumPy's scalars and arrays, itself or anywhere inside, as Python's.
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

/// A Python value as TOML.
pub fn to_toml(value: &Bound<'_, PyAny>) -> PyResult<::toml::Value> {
    let plain = plain(value)?;
    pythonize::depythonize(&plain).map_err(|_| {
        PyTypeError::new_err(format!(
            "{} cannot be part of a scene; allowed: numbers, strings, booleans, and lists and dictionaries of them",
            plain.repr().map_or_else(|_| "this value".to_string(), |text| text.to_string())
        ))
    })
}

/// A Python value as the right side of a key of a TOML file.
#[pyfunction]
#[pyo3(name = "_toml")]
pub fn toml(value: &Bound<'_, PyAny>) -> PyResult<String> {
    to_toml(value).map(|value| value.to_string())
}

/// An object as a notebook shows it, HTML.
pub fn shown(object: &Bound<'_, PyAny>) -> PyResult<String> {
    object.py().import("caudal.showing")?.call_method1("shown", (object,))?.extract()
}
