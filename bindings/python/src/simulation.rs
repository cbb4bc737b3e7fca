//! Differentiable simulations.

use std::sync::Mutex;

use caudal::sensitivity::Array;
use caudal::sensitivity::simulation::{self, Simulation as Own};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::attention::Progress;
use crate::error::OrRaise;
use crate::locks::lock;
use crate::scene::Scene;

/// Values or weights by name.
type Given<'py> = Vec<(String, PyReadonlyArrayDyn<'py, f64>)>;

fn array(values: &PyReadonlyArrayDyn<'_, f64>) -> Array {
    Array { shape: values.shape().to_vec(), values: values.as_array().iter().copied().collect() }
}

fn arrays<'a>(given: &'a Given<'_>) -> Vec<(&'a str, Array)> {
    given.iter().map(|(name, values)| (&**name, array(values))).collect()
}

fn texts(names: &[String]) -> Vec<&str> {
    names.iter().map(String::as_str).collect()
}

/// A number, or a NumPy array.
fn shown(py: Python<'_>, Array { shape, values }: Array) -> PyResult<Bound<'_, PyAny>> {
    match (shape.is_empty(), values.first()) {
        (true, Some(value)) => Ok(value.into_pyobject(py)?.into_any()),
        _ => {
            let array: Bound<'_, PyArrayDyn<f64>> = PyArray1::from_vec(py, values).reshape(shape)?;
            Ok(array.into_any())
        }
    }
}

fn by_name<'py>(py: Python<'py>, names: &[String], arrays: Vec<Array>) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    for (name, array) in names.iter().zip(arrays) {
        found.set_item(name, shown(py, array)?)?;
    }
    Ok(found)
}

/// All parameters with respect to which a simulation of `scene` can be differentiated: (value, unit, description) by name.
#[pyfunction]
#[pyo3(name = "_parameters")]
pub fn parameters<'py>(py: Python<'py>, scene: &Bound<'py, Scene>) -> PyResult<Bound<'py, PyDict>> {
    let Scene { scene, document, .. } = scene.get();
    let found = PyDict::new(py);
    let known = py.detach(|| simulation::parameters(scene).map_err(|error| document.located(error)));
    for named in known.or_raise(py)? {
        found.set_item(named.name, (shown(py, named.value)?, named.unit, named.description))?;
    }
    Ok(found)
}

/// A differentiable simulation with named outputs.
#[pyclass(module = "caudal._caudal", name = "_Simulation", frozen)]
pub struct Simulation {
    inner: Mutex<Own>,
}

/// Computes in another thread, while this one checks for Ctrl-C, which ends the computation.
fn ending<T: Send>(
    py: Python<'_>,
    own: &mut Own,
    compute: impl FnOnce(&mut Own) -> caudal::Result<T> + Send,
) -> PyResult<T> {
    Progress::ended_by(own.interrupt()).watch(py, None, || compute(own))?.or_raise(py)
}

#[pymethods]
impl Simulation {
    #[new]
    fn new(py: Python<'_>, scene: &Bound<'_, Scene>, values: Given<'_>, outputs: Vec<String>) -> PyResult<Self> {
        let (document, values) = (&scene.get().document, arrays(&values));
        let own = py
            .detach(|| Own::of(document, &texts(&outputs), &values).map_err(|error| document.located(error)))
            .or_raise(py)?;
        Ok(Self { inner: Mutex::new(own) })
    }

    /// Times, s.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, lock(py, &self.inner).times())
    }

    /// The outputs over time, by name.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut inner = lock(py, &self.inner);
        ending(py, &mut inner, Own::simulate)?;
        let found = PyDict::new(py);
        for (name, values) in inner.outputs().or_raise(py)? {
            found.set_item(name, shown(py, values)?)?;
        }
        Ok(found)
    }

    /// The notes on the run.
    fn notes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        ending(py, &mut lock(py, &self.inner), Own::notes)
    }

    /// The derivatives of Σ w y over all outputs y and times, with `weights` w by output, with respect to the named parameters.
    fn pull_back<'py>(&self, py: Python<'py>, weights: Given<'py>, names: Vec<String>) -> PyResult<Bound<'py, PyDict>> {
        let weights = arrays(&weights);
        let found = ending(py, &mut lock(py, &self.inner), |own| own.pull_back(&weights, &texts(&names)))?;
        by_name(py, &names, found)
    }

    /// The value of an output at the end, or a mean over the last whole cycles, and its derivatives with respect to the named
    /// parameters.
    fn value_and_grad<'py>(
        &self,
        py: Python<'py>,
        output: &str,
        names: Vec<String>,
    ) -> PyResult<(f64, Bound<'py, PyDict>)> {
        let own = &mut lock(py, &self.inner);
        let (value, found) = ending(py, own, |own| own.value_and_grad(output, &texts(&names)))?;
        Ok((value, by_name(py, &names, found)?))
    }
}
