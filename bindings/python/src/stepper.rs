//! The stepper.

use std::ffi::CString;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};

use caudal::batch::{self, Batch, WIDTH};
use caudal::sensitivity::LinearisationRequest;
use caudal::stepper::{Entry, InputChange, StateCoordinates};
use caudal::variable::{Size, VARIABLES};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyRuntimeWarning, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyFloat, PyString, PyTuple};

use crate::attention::Attention;
use crate::error::{OrRaise, exception};
use crate::locks::lock;
use crate::scene::Scene;
use crate::values::{Numbers, fields, names, shown};

/// A variable of a scene.
///
/// Attributes
/// ----------
/// name : str
///     Name, ending in its unit.
/// unit : str
///     SI unit; ``"1"`` if dimensionless.
/// causality : str
///     ``"independent"``, ``"output"``, ``"input"`` or ``"parameter"``.
/// description : str
///     Description.
/// shape : tuple of int
///     ``()`` for a scalar, ``(n,)`` for an array.
#[pyclass(frozen, get_all, module = "caudal")]
pub struct Variable {
    name: &'static str,
    unit: &'static str,
    causality: &'static str,
    description: &'static str,
    shape: Py<PyTuple>,
}

#[pymethods]
impl Variable {
    fn __repr__(&self) -> String {
        format!("<caudal.Variable {} ({}, {}): {}>", self.name, self.unit, self.causality, self.description)
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }

    fn __eq__(&self, py: Python<'_>, other: &Self) -> PyResult<bool> {
        Ok(self.name == other.name && self.shape.bind(py).eq(other.shape.bind(py))?)
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.name.hash(&mut hasher);
        hasher.finish()
    }

    /// For pickle: everything except name and shape is taken from the table of variables.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let variable = py.import("caudal._caudal")?.getattr("_variable")?;
        Ok((variable, (self.name, &self.shape).into_pyobject(py)?))
    }
}

/// A variable from its pickled data.
#[pyfunction]
#[pyo3(name = "_variable")]
pub fn variable(name: &str, shape: Py<PyTuple>) -> PyResult<Variable> {
    let found = VARIABLES.iter().find(|variable| variable.name == name);
    let found = found.ok_or_else(|| PyValueError::new_err(format!("this version has no variable `{name}`")))?;
    Ok(Variable::with(found, shape))
}

/// Unit and description of all variables by name.
#[pyfunction]
#[pyo3(name = "_units")]
pub fn units(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    VARIABLES.iter().try_for_each(|variable| all.set_item(variable.name, (variable.unit, variable.description)))?;
    Ok(all)
}

impl Variable {
    fn with(variable: &'static caudal::variable::Variable, shape: Py<PyTuple>) -> Self {
        Self {
            name: variable.name,
            unit: variable.unit,
            causality: variable.causality.name(),
            description: variable.description,
            shape,
        }
    }

    /// The Python object for `variable` in `model`.
    pub fn of(
        py: Python<'_>,
        variable: &'static caudal::variable::Variable,
        model: &caudal::model::Model,
    ) -> PyResult<Self> {
        let shape = match variable.size {
            Size::Scalar => PyTuple::empty(py),
            Size::Nodes | Size::Joints => PyTuple::new(py, [variable.len(model)])?,
        };
        Ok(Self::with(variable, shape.unbind()))
    }
}

/// Everything that changes in a :class:`Stepper`, at the time of :meth:`Stepper.save`.
///
/// ``bytes(snapshot)``, or a pickle, can be stored in a file and restored by a stepper of the same scene in another process with
/// the same version of caudal.
#[pyclass(frozen, module = "caudal")]
pub struct Snapshot {
    snapshot: caudal::stepper::Snapshot,
    scene: String,
}

#[pymethods]
impl Snapshot {
    /// Its time, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.snapshot.time()
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.snapshot.serialize().or_raise(py)?))
    }

    /// For pickle, between programs of the same version.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let snapshot = py.import("caudal._caudal")?.getattr("_snapshot")?;
        Ok((snapshot, (self.__bytes__(py)?, &self.scene).into_pyobject(py)?))
    }

    fn __repr__(&self) -> String {
        format!("<caudal.Snapshot of {:?} at {} s>", self.scene, self.time_s())
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }
}

/// The derivatives of a step: of the state at its end and of outputs there, with respect to the state at its beginning and to
/// inputs.
///
/// Attributes
/// ----------
/// a, b : numpy.ndarray
///     Of the state at the end with respect to the state at the beginning (a) and to the inputs (b): one row for each of
///     `states`.
/// c, d : numpy.ndarray
///     Of the outputs with respect to the state (c) and to the inputs (d): one row for each of `outputs`.
/// states, inputs, outputs : list of str
///     The names of rows and columns: for an array one for each entry, with the number of its node in brackets.
/// units : dict
///     Their units by name.
#[pyclass(frozen, get_all, module = "caudal")]
pub struct StepDerivative {
    a: Py<PyArray2<f64>>,
    b: Py<PyArray2<f64>>,
    c: Py<PyArray2<f64>>,
    d: Py<PyArray2<f64>>,
    states: Vec<String>,
    inputs: Vec<String>,
    outputs: Vec<String>,
    units: Py<PyDict>,
}

#[pymethods]
impl StepDerivative {
    fn __repr__(&self) -> String {
        let Self { states, inputs, outputs, .. } = self;
        format!(
            "<caudal.StepDerivative of {} states and {} outputs by {} states and {} inputs>",
            states.len(),
            outputs.len(),
            states.len(),
            inputs.len()
        )
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }
}

impl StepDerivative {
    fn of(py: Python<'_>, found: caudal::sensitivity::StepDerivative) -> PyResult<Self> {
        let caudal::sensitivity::StepDerivative { states, inputs, outputs, a, b, c, d } = found;
        let array = |matrix: caudal::nalgebra::DMatrix<f64>| -> PyResult<Py<PyArray2<f64>>> {
            let (rows, columns) = matrix.shape();
            let values = PyArray1::from_slice(py, matrix.transpose().as_slice());
            Ok(values.reshape([rows, columns])?.unbind())
        };
        let units = PyDict::new(py);
        let names = |entries: Vec<Entry>| -> PyResult<Vec<String>> {
            entries.iter().try_for_each(|entry| units.set_item(entry.name(), entry.unit))?;
            Ok(entries.iter().map(Entry::name).collect())
        };
        let [states, inputs, outputs] = [names(states)?, names(inputs)?, names(outputs)?];
        let [a, b, c, d] = [array(a)?, array(b)?, array(c)?, array(d)?];
        Ok(Self { a, b, c, d, states, inputs, outputs, units: units.unbind() })
    }
}

/// A snapshot from its pickled data.
#[pyfunction]
#[pyo3(name = "_snapshot")]
pub fn snapshot(py: Python<'_>, bytes: &[u8], scene: String) -> PyResult<Snapshot> {
    Ok(Snapshot { snapshot: caudal::stepper::Snapshot::deserialize(bytes).or_raise(py)?, scene })
}

/// A simulation that a host drives: set inputs, step, get outputs.
///
/// As a context manager it frees its memory at the end of the block. Several steppers can run in parallel in several threads;
/// only one thread may use a stepper at a time.
///
/// Parameters
/// ----------
/// scene : Scene, str, os.PathLike or dict
///     The scene, or anything that :func:`caudal.load` accepts as a source.
///
/// Warns
/// -----
/// RuntimeWarning
///     If ``auto`` chose the fluid for a rod at rest, because nothing in the scene moves it.
///
/// Examples
/// --------
/// >>> import caudal
/// >>> tail = caudal.Stepper("models/driven-head.toml")
/// >>> tail.set("head_angle_rad", 0.1)
/// >>> tail.do_step(0.01)
/// >>> tail.time_s
/// 0.01
/// >>> tail.get("x_m").shape
/// (33,)
/// >>> tail.variables["head_moment_n_m"].unit
/// 'N m'
#[pyclass(frozen, module = "caudal")]
pub struct Stepper {
    scene: Py<Scene>,
    /// `None` once it is closed.
    stepper: Mutex<Option<Box<caudal::stepper::Stepper>>>,
    /// Set by another thread to end a step in progress.
    stopped: AtomicBool,
}

/// The error for an argument of a wrong type.
fn wrong(argument: &str, found: &Bound<'_, PyAny>, allowed: &str) -> PyErr {
    let found = found.repr().map_or_else(|_| "this value".to_string(), |text| text.to_string());
    PyTypeError::new_err(format!("{argument}: found {found}; allowed: {allowed}"))
}

/// The variable of this name.
fn find(stepper: &caudal::stepper::Stepper, name: &Bound<'_, PyAny>) -> PyResult<&'static caudal::variable::Variable> {
    let text = name.cast::<PyString>().map_err(|_| wrong("name", name, "the name of a variable"))?;
    stepper.find(&text.to_cow()?).or_raise(name.py())
}

/// Warns the caller.
fn warn(py: Python<'_>, text: String) -> PyResult<()> {
    PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &CString::new(text).unwrap_or_default(), 1)
}

/// A locked stepper.
struct Open<'a>(MutexGuard<'a, Option<Box<caudal::stepper::Stepper>>>);

impl Open<'_> {
    fn stepper(&mut self) -> PyResult<&mut caudal::stepper::Stepper> {
        self.0.as_deref_mut().ok_or_else(|| PyValueError::new_err("this stepper is closed"))
    }
}

impl Stepper {
    fn open(&self) -> PyResult<Open<'_>> {
        match self.stepper.try_lock() {
            Ok(guard) => Ok(Open(guard)),
            // A step that panicked has left its last valid state.
            Err(TryLockError::Poisoned(poisoned)) => Ok(Open(poisoned.into_inner())),
            Err(TryLockError::WouldBlock) => {
                Err(PyRuntimeError::new_err("this stepper is in use in another thread: use one stepper per thread"))
            }
        }
    }
}

#[pymethods]
impl Stepper {
    #[new]
    fn new(py: Python<'_>, scene: &Bound<'_, PyAny>) -> PyResult<Self> {
        let scene = match scene.cast::<Scene>() {
            Ok(scene) => scene.clone(),
            Err(_) => py.get_type::<Scene>().call1((scene,))?.cast_into()?,
        };
        let super::scene::Scene { scene: content, document, .. } = scene.get();
        let stepper = py.detach(|| document.stepper(content)).or_raise(py)?;
        if let Some(note) = stepper.fluid_note() {
            warn(py, note)?;
        }
        let stepper = Mutex::new(Some(Box::new(stepper)));
        Ok(Self { scene: scene.unbind(), stepper, stopped: AtomicBool::new(false) })
    }

    /// Its scene.
    #[getter]
    fn scene(&self, py: Python<'_>) -> Py<Scene> {
        self.scene.clone_ref(py)
    }

    /// Current time, s.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        Ok(self.open()?.stepper()?.time())
    }

    /// The variables of this scene by name: a dict of :class:`Variable`.
    #[getter]
    fn variables<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let dictionary = PyDict::new(py);
        for variable in stepper.variables() {
            dictionary.set_item(variable.name, Variable::of(py, variable, stepper.model())?)?;
        }
        fields(&dictionary)
    }

    /// Advance by a time, in as many internal steps as the solver needs.
    ///
    /// Other Python threads run meanwhile. Ctrl-C ends the step after an internal step, from which it can be continued.
    ///
    /// Parameters
    /// ----------
    /// h : float
    ///     The time, s; positive.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     If the step fails. Everything is then as it was before the call.
    ///
    /// Warns
    /// -----
    /// RuntimeWarning
    ///     If the pose or the velocity given for the head jumps, so that the tail oscillates.
    fn do_step(&self, py: Python<'_>, h: &Bound<'_, PyAny>) -> PyResult<()> {
        let h: f64 = h.extract().map_err(|_| wrong("h", h, "a time, s"))?;
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let mut attention = Attention::new();
        let outcome = py.detach(|| stepper.do_step_with(h, |_| attention.poll(|_| go_on_unless(&self.stopped))));
        match (outcome, attention.failure) {
            (_, Some(failure)) => return Err(failure),
            (Err(error), None) => return Err(exception(py, &error)),
            (Ok(_), None) => {}
        }
        let Some(jump) = stepper.take_head_jump() else { return Ok(()) };
        drop(open);
        warn(py, jump.to_string())
    }

    /// Sets whether steps in progress in other threads, and further ones, end soon after they begin, because Python reports
    /// Ctrl-C only to its main thread.
    fn _stop(&self, stopped: bool) {
        self.stopped.store(stopped, Ordering::Relaxed);
    }

    /// Read a variable.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     Its name.
    /// out : numpy.ndarray, optional
    ///     An array of doubles for the values, so that no new array is created.
    ///
    /// Returns
    /// -------
    /// float or numpy.ndarray
    ///     A number for a scalar, else an array of ``variables[name].shape``; `out` if that is given.
    ///
    /// Raises
    /// ------
    /// caudal.errors.UnknownVariableError
    ///     If this scene has no variable of that name.
    #[pyo3(signature = (name, out=None))]
    fn get<'py>(
        &self,
        py: Python<'py>,
        name: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let no_array = |_| PyTypeError::new_err("out: allowed: a NumPy array of one dimension and the type float64");
        let out = out.map(|out| out.cast::<PyArray1<f64>>().map_err(no_array)).transpose()?;
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let variable = find(stepper, name)?;
        if variable.size == Size::Scalar && out.is_none() {
            return Ok(PyFloat::new(py, variable.first(&stepper.view())).into_any());
        }
        let len = variable.len(stepper.model());
        let array = out.cloned().unwrap_or_else(|| PyArray1::zeros(py, len, false));
        let no_place = |error: &dyn std::fmt::Display| {
            PyTypeError::new_err(format!("out: {error}; allowed: an array that is contiguous, aligned and writeable"))
        };
        let mut place = array.try_readwrite().map_err(|error| no_place(&error))?;
        let values = place.as_slice_mut().map_err(|error| no_place(&error))?;
        if values.len() != len {
            return Err(exception(
                py,
                &caudal::Error::WrongLength { name: variable.name, expected: len, found: values.len() },
            ));
        }
        variable.read(&stepper.view(), values);
        Ok(array.into_any())
    }

    /// Set an input, which holds until it is set again.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     Its name.
    /// value : float or array_like
    ///     As many numbers as it has, or one for all.
    ///
    /// Raises
    /// ------
    /// caudal.errors.NotAnInputError, caudal.errors.WrongLengthError, caudal.errors.BadValueError
    ///     If it cannot be set to this value. Nothing is changed then.
    fn set(&self, py: Python<'_>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.change(py, name, 0, value)
    }

    /// Set several inputs at once.
    ///
    /// Parameters
    /// ----------
    /// values : dict
    ///     Numbers by name, as in :meth:`set`.
    fn set_all(&self, py: Python<'_>, values: &Bound<'_, PyDict>) -> PyResult<()> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let mut changes = Vec::with_capacity(values.len());
        for (name, value) in values {
            let variable = stepper.find(&name.extract::<String>()?).or_raise(py)?;
            let mut buffer = Vec::new();
            let numbers =
                Numbers::of(&value, variable.name)?.spread(variable.len(stepper.model()), &mut buffer)?.to_vec();
            changes.push((variable, numbers));
        }
        let changes = changes.iter().map(|(variable, values)| InputChange { variable, order: 0, values });
        stepper.set_all(changes).or_raise(py)
    }

    /// Set a time derivative of an input, which is then extrapolated from its value and derivatives, until its value is set
    /// again.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     Name of the input.
    /// order : int
    ///     Order of the derivative, from 1.
    /// value : float or array_like
    ///     As many numbers as the input has, or one for all.
    fn set_derivative(
        &self,
        py: Python<'_>,
        name: &Bound<'_, PyAny>,
        order: usize,
        value: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        if order == 0 {
            return Err(PyValueError::new_err("order: found 0; allowed: from 1; set() sets the value itself"));
        }
        self.change(py, name, order, value)
    }

    /// Positions and velocities of everything that is not held: x and y of each node, the angle of a hinge, and the corresponding
    /// velocities, in the order of the `states` of :meth:`linearize`.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     One dimension.
    fn motion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.open()?.stepper()?.motion()))
    }

    /// Set positions and velocities, for example from an estimator or as the start of a prediction. A held head continues its
    /// motion. Accelerations follow from the equation of motion, as after a jump of inputs; the change of energy counts as work
    /// of loads.
    ///
    /// Parameters
    /// ----------
    /// motion : array_like
    ///     In the order of :meth:`motion`.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     For a wrong length, a number that is not finite, an invalid shape, or a reduced model. Nothing is changed then.
    fn set_motion(&self, py: Python<'_>, motion: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let mut buffer = Vec::new();
        let length = stepper.motion().len();
        let values = Numbers::of(motion, "motion")?.spread(length, &mut buffer)?.to_vec();
        stepper.set_motion(&values).or_raise(py)
    }

    /// Advance by a time, bit-identical to :meth:`do_step`, and return the derivatives of that step: of the state at its end and
    /// of outputs there, with respect to the state at its beginning and to inputs. They are exact, those of the internal steps
    /// that were made. To keep the current state, :meth:`save` before and :meth:`restore` after.
    ///
    /// Parameters
    /// ----------
    /// h : float
    ///     The time, s; positive.
    /// inputs, outputs : str or list of str, optional
    ///     Names of variables; none by default. An input acts as if it were set at the beginning of the step. A pose of a head
    ///     acts at the time that ``head.input`` defines; its derivative is taken at the given pose, or else at the extrapolated
    ///     one, for changes of about 1e-4 of the length. Outputs must be values at one time, not totals or averages over cycles.
    /// coordinates : {"motion", "full"}, optional
    ///     The state: positions and velocities, in the order of :meth:`motion`, from which the accelerations follow at the
    ///     beginning of the step; or also accelerations, and the method's memory of earlier ones.
    /// jump : bool, optional
    ///     False if the inputs had these values before the step. A change at its beginning (the default) moves the accelerations
    ///     there, which are separate coordinates with ``coordinates="full"``, and a change of flow also moves the velocities of a
    ///     rod that accelerates water. For an input that changes once and is then constant, ``z2 = a2 @ b1 + b2`` with `b1`
    ///     computed with the jump and `b2` without.
    /// states : bool, optional
    ///     False to compute only `b` and `d`: `a` and `c` then have no columns, and on a fine mesh the step takes a small
    ///     fraction of the time and memory.
    ///
    /// Returns
    /// -------
    /// StepDerivative
    ///     With the matrices `a`, `b`, `c` and `d`.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     If the step fails or has no such derivative: for a reduced model or an explicit method, or on a mesh that is too fine
    ///     or needs more memory than available. Everything is then as it was before the call.
    ///
    /// Notes
    /// -----
    /// The product of the `a` of successive steps is that of all of them together, with ``coordinates="full"`` for every method,
    /// and with ``"motion"`` for Newmark's method, implicit Euler and ESDIRK3. Generalized-alpha has a memory of accelerations
    /// that ``"motion"`` does not contain.
    ///
    /// Examples
    /// --------
    /// >>> import caudal
    /// >>> tail = caudal.Stepper("models/driven-head.toml")
    /// >>> step = tail.linearize(0.01, inputs=["force_y_n"], outputs=["tip_y_m"])
    /// >>> step.a.shape, step.b.shape, step.d.shape
    /// ((128, 128), (128, 33), (1, 33))
    /// >>> step.states[0], step.inputs[-1]
    /// ('x_m[1]', 'force_y_n[32]')
    #[pyo3(signature = (h, inputs=None, outputs=None, coordinates="motion", jump=true, states=true), text_signature = "(self, h, inputs=(), outputs=(), coordinates=\"motion\", jump=True, states=True)")]
    #[allow(clippy::too_many_arguments, reason = "arguments of Python, by their names")]
    fn linearize(
        &self,
        py: Python<'_>,
        h: &Bound<'_, PyAny>,
        inputs: Option<&Bound<'_, PyAny>>,
        outputs: Option<&Bound<'_, PyAny>>,
        coordinates: &str,
        jump: bool,
        states: bool,
    ) -> PyResult<StepDerivative> {
        let h: f64 = h.extract().map_err(|_| wrong("h", h, "a time, s"))?;
        let coordinates = match coordinates {
            "motion" => StateCoordinates::Motion,
            "full" => StateCoordinates::Full,
            found => {
                let problem = format!("coordinates: found {found:?}; allowed: \"motion\", \"full\"");
                return Err(PyValueError::new_err(problem));
            }
        };
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let (inputs, outputs) = (names(inputs, "inputs")?, names(outputs, "outputs")?);
        let [inputs, outputs] = [&inputs, &outputs].map(|names| names.iter().map(String::as_str).collect::<Vec<_>>());
        let asked = LinearisationRequest { coordinates, inputs: &inputs, outputs: &outputs, states, jump };
        let found = py.detach(|| stepper.linearise_as(h, &asked)).or_raise(py)?;
        let jump = stepper.take_head_jump();
        drop(open);
        let found = StepDerivative::of(py, found)?;
        jump.map_or(Ok(()), |jump| warn(py, jump.to_string()))?;
        Ok(found)
    }

    /// A copy of everything that changes.
    ///
    /// Returns
    /// -------
    /// Snapshot
    ///     For :meth:`restore`.
    fn save(&self) -> PyResult<Snapshot> {
        let snapshot = self.open()?.stepper()?.save();
        Ok(Snapshot { snapshot, scene: self.scene.get().scene.name.clone() })
    }

    /// Restore a snapshot. The run that follows is bit-identical to the run that followed the snapshot.
    ///
    /// Parameters
    /// ----------
    /// snapshot : Snapshot or bytes
    ///     From :meth:`save` of a stepper of the same scene, or the bytes of one.
    ///
    /// Raises
    /// ------
    /// caudal.errors.SnapshotError
    ///     If it is damaged, or comes from another scene or version.
    fn restore(&self, py: Python<'_>, snapshot: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        if let Ok(bytes) = snapshot.cast::<PyBytes>() {
            let snapshot = stepper.deserialize(bytes.as_bytes()).or_raise(py)?;
            return stepper.restore(&snapshot).or_raise(py);
        }
        let wrong = |_| PyTypeError::new_err("snapshot: allowed: a Snapshot from save(), or the bytes of one");
        stepper.restore(&snapshot.cast::<Snapshot>().map_err(wrong)?.get().snapshot).or_raise(py)
    }

    /// Free its memory. It cannot be used afterwards.
    fn close(&self) -> PyResult<()> {
        *self.open()?.0 = None;
        Ok(())
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __exit__(
        &self,
        _kind: &Bound<'_, PyAny>,
        _value: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        self.close()
    }

    fn __repr__(&self) -> String {
        match self.open().and_then(|mut open| Ok(open.stepper()?.time())) {
            Ok(time) => format!("<caudal.Stepper of {:?} at {time} s>", self.scene.get().scene.name),
            Err(_) => format!("<caudal.Stepper of {:?}, closed or in use>", self.scene.get().scene.name),
        }
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }
}

/// Several steppers that step together: similar ones four at a time in SIMD lanes, with results bit-identical to separate steps.
#[pyclass(frozen, name = "_SteppersTogether", module = "caudal._caudal")]
pub struct SteppersTogether {
    steppers: Vec<Py<Stepper>>,
    /// The batch of each group of [`WIDTH`] steppers.
    batches: Mutex<Vec<Option<Batch>>>,
}

#[pymethods]
impl SteppersTogether {
    #[new]
    fn new(steppers: Vec<Py<Stepper>>) -> PyResult<Self> {
        let mut open = steppers.iter().map(|stepper| stepper.get().open()).collect::<PyResult<Vec<_>>>()?;
        let all = open.iter_mut().map(|open| open.stepper().map(|stepper| &*stepper)).collect::<PyResult<Vec<_>>>()?;
        let batches = Mutex::new(Batch::of_all(&all));
        drop(open);
        Ok(Self { steppers, batches })
    }

    /// Steps those steppers whose indices are in `moving`, as `do_step` does. Returns for each of them the exception that it
    /// would raise alone, or None.
    fn do_step(&self, py: Python<'_>, moving: Vec<usize>, h: f64) -> PyResult<Vec<Option<PyErr>>> {
        let mut open: Vec<Option<Open<'_>>> = self.steppers.iter().map(|_| None).collect();
        for place in &moving {
            let stepper = self.steppers.get(*place);
            let stepper =
                stepper.ok_or_else(|| PyValueError::new_err(format!("moving: there is no stepper {place}")))?;
            if open[*place].is_none() {
                open[*place] = Some(stepper.get().open()?);
            }
        }
        let mut steppers = Vec::with_capacity(open.len());
        for open in &mut open {
            steppers.push(open.as_mut().map(Open::stepper).transpose()?);
        }
        let mut batches = lock(py, &self.batches);
        let batches = &mut *batches;
        let (mut attention, mut looks) = (Attention::new(), 0);
        let outcomes: Vec<caudal::Result<bool>> = py.detach(|| {
            let mut outcomes = Vec::with_capacity(steppers.len());
            for (chunk, (steppers, batch)) in steppers.chunks_mut(WIDTH).zip(batches).enumerate() {
                let count = steppers.len();
                let all = batch::do_step_with(batch.as_mut(), steppers, h, |i, _| {
                    if attention.failure.is_some() {
                        return ControlFlow::Break(());
                    }
                    // Only every `WIDTH`-th call reads the clock.
                    looks += 1;
                    if looks % WIDTH != 0 {
                        return ControlFlow::Continue(());
                    }
                    let stopped = &self.steppers[WIDTH * chunk + i].get().stopped;
                    attention.poll(|_| go_on_unless(stopped))
                });
                outcomes.extend(all.into_iter().take(count));
                if attention.failure.is_some() {
                    break;
                }
            }
            outcomes
        });
        if let Some(failure) = attention.failure {
            return Err(failure);
        }
        let mut errors = Vec::with_capacity(moving.len());
        let mut jumps = Vec::new();
        for place in moving {
            let failed = outcomes.get(place).and_then(|outcome| outcome.as_ref().err());
            errors.push(failed.map(|error| exception(py, error)));
            if let (None, Some(stepper)) = (failed, steppers[place].as_mut()) {
                jumps.extend(stepper.take_head_jump());
            }
        }
        drop(open);
        jumps.iter().try_for_each(|jump| warn(py, jump.to_string()))?;
        Ok(errors)
    }
}

/// Continues unless another thread has requested a stop.
fn go_on_unless(stopped: &AtomicBool) -> PyResult<ControlFlow<()>> {
    match stopped.load(Ordering::Relaxed) {
        true => Err(PyKeyboardInterrupt::new_err("stopped by another thread")),
        false => Ok(ControlFlow::Continue(())),
    }
}

impl Stepper {
    fn change(&self, py: Python<'_>, name: &Bound<'_, PyAny>, order: usize, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let variable = find(stepper, name)?;
        let (numbers, mut buffer) = (Numbers::of(value, "value")?, Vec::new());
        let values = numbers.spread(variable.len(stepper.model()), &mut buffer)?;
        stepper.set_all([InputChange { variable, order, values }].into_iter()).or_raise(py)
    }
}
