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

/// What is known of a variable of a scene.
///
/// Attributes
/// ----------
/// name : str
///     Name, ending in its unit.
/// unit : str
///     SI unit; ``"1"`` where there is none.
/// causality : str
///     ``"independent"``, ``"output"``, ``"input"`` or ``"parameter"``.
/// description : str
///     What it is.
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

    /// For pickle: all but name and shape is the table's.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let variable = py.import("caudal._caudal")?.getattr("_variable")?;
        Ok((variable, (self.name, &self.shape).into_pyobject(py)?))
    }
}

/// A variable from what pickle keeps of it.
#[pyfunction]
#[pyo3(name = "_variable")]
pub fn variable(name: &str, shape: Py<PyTuple>) -> PyResult<Variable> {
    let found = VARIABLES.iter().find(|variable| variable.name == name);
    let found = found.ok_or_else(|| PyValueError::new_err(format!("this version has no variable `{name}`")))?;
    Ok(Variable::with(found, shape))
}

/// Unit and meaning of all variables by name.
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

    /// What Python sees of `variable` in `model`.
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

/// Everything of a :class:`Stepper` that changes, at the time of :meth:`Stepper.save`.
///
/// ``bytes(snapshot)`` can be kept in a file and restored by a stepper of the same scene in another process of the same
/// version of caudal; so can its pickle.
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

    /// For pickle, among programs of the same version.
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

/// The derivatives of a step: how the state at its end, and outputs there, follow from the state at its beginning and from inputs.
///
/// Attributes
/// ----------
/// a, b : numpy.ndarray
///     Of the state at the end by the state at the beginning (a) and by the inputs (b): one row for each of `states`.
/// c, d : numpy.ndarray
///     Of the outputs by the state (c) and by the inputs (d): one row for each of `outputs`.
/// states, inputs, outputs : list of str
///     The names of rows and columns: of an array each entry, with the number of its node in brackets.
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
            entries.iter().try_for_each(|entry| units.set_item(&entry.name, entry.unit))?;
            Ok(entries.into_iter().map(|entry| entry.name).collect())
        };
        let [states, inputs, outputs] = [names(states)?, names(inputs)?, names(outputs)?];
        let [a, b, c, d] = [array(a)?, array(b)?, array(c)?, array(d)?];
        Ok(Self { a, b, c, d, states, inputs, outputs, units: units.unbind() })
    }
}

/// A snapshot from what pickle keeps of it.
#[pyfunction]
#[pyo3(name = "_snapshot")]
pub fn snapshot(py: Python<'_>, bytes: &[u8], scene: String) -> PyResult<Snapshot> {
    Ok(Snapshot { snapshot: caudal::stepper::Snapshot::deserialize(bytes).or_raise(py)?, scene })
}

/// A simulation that a host drives: set inputs, step, get outputs.
///
/// As a context manager it frees its memory at the end of the block. Several steppers run in parallel in several threads;
/// one stepper belongs to one thread at a time.
///
/// Parameters
/// ----------
/// scene : Scene, str, os.PathLike or dict
///     The scene, or what :func:`caudal.load` makes one from.
///
/// Warns
/// -----
/// RuntimeWarning
///     Where ``auto`` chose the fluid for a rod at rest, because nothing of the scene moves it.
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
    /// None once it is closed.
    stepper: Mutex<Option<Box<caudal::stepper::Stepper>>>,
    /// Raised by another thread to end a step that is under way.
    stopped: AtomicBool,
}

/// The error of an argument of another type.
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

/// The stepper of a locked place.
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
            // A step that panicked has left its last good state.
            Err(TryLockError::Poisoned(poisoned)) => Ok(Open(poisoned.into_inner())),
            Err(TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "this stepper is at work in another thread: give every thread a stepper of its own",
            )),
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

    /// Time now, s.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        Ok(self.open()?.stepper()?.time())
    }

    /// The variables that this scene has, by name: a dict of :class:`Variable`.
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

    /// Move on by a time, in as many internal steps as the scene's solver wants.
    ///
    /// Other Python threads run meanwhile. Ctrl-C ends it after an internal step, where it can be gone on from.
    ///
    /// Parameters
    /// ----------
    /// h : float
    ///     The time, s; positive.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     What went wrong inside; everything is then as it was before the call.
    ///
    /// Warns
    /// -----
    /// RuntimeWarning
    ///     Where the pose or the velocity that was given for the head jumps: the tail rings.
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

    /// Whether steps under way, in other threads, and further ones end soon after they begin: Python tells its main thread alone of Ctrl-C.
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
    ///     An array of doubles that takes the values, so that none is made.
    ///
    /// Returns
    /// -------
    /// float or numpy.ndarray
    ///     A number for a scalar, else an array of ``variables[name].shape``; `out` where that is given.
    ///
    /// Raises
    /// ------
    /// caudal.errors.UnknownVariableError
    ///     Where this scene has no variable of that name.
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

    /// Set an input; it holds until it is set again.
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
    ///     Where it cannot be set so; nothing is changed then.
    fn set(&self, py: Python<'_>, name: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.change(py, name, 0, value)
    }

    /// Set several inputs as one.
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

    /// Set a time derivative of an input: from now on the input goes on as its value and derivatives say, until its value is
    /// set again.
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

    /// Positions and velocities of all that nothing holds: x and y of each node, the angle of a hinge, and the same of their velocities, in the
    /// order of the `states` of :meth:`linearize`.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray
    ///     One dimension.
    fn motion<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.open()?.stepper()?.motion()))
    }

    /// Set positions and velocities: those of an estimator, or where a prediction begins. A held head goes on as it moves. Accelerations follow
    /// from the equation of motion, as after a jump of inputs; the energy that this brings counts as work of loads.
    ///
    /// Parameters
    /// ----------
    /// motion : array_like
    ///     In the order of :meth:`motion`.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     Where there is no such motion: another length, a number that is not finite, a reduced model. Nothing is changed then.
    fn set_motion(&self, py: Python<'_>, motion: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut open = self.open()?;
        let stepper = open.stepper()?;
        let mut buffer = Vec::new();
        let length = stepper.motion().len();
        let values = Numbers::of(motion, "motion")?.spread(length, &mut buffer)?.to_vec();
        stepper.set_motion(&values).or_raise(py)
    }

    /// Move on by a time as :meth:`do_step` does, to the bit, and find the derivatives of that step: how the state at its end, and outputs there,
    /// follow from the state at its beginning and from inputs. They are exact, those of the internal steps that were made. To
    /// stay, :meth:`save` before and :meth:`restore` after.
    ///
    /// Parameters
    /// ----------
    /// h : float
    ///     The time, s; positive.
    /// inputs, outputs : str or list of str, optional
    ///     Names of variables; none by default. An input acts as if it were set at the beginning of the step; a pose of a head at the time that
    ///     ``head.input`` says, around the one that was set, or where the head goes anyway, for changes by about 1e-4 of the length. Outputs are those of one time: no totals, no
    ///     averages of cycles.
    /// coordinates : {"motion", "full"}, optional
    ///     The state: positions and velocities, in the order of :meth:`motion`, from which the accelerations follow at the beginning of the
    ///     step; or accelerations too, and what a method remembers of earlier ones.
    /// jump : bool, optional
    ///     False where the inputs had these values before the step. A change at its beginning (the default) moves the accelerations there,
    ///     which are coordinates of their own with ``coordinates="full"``, and a flow the velocities of a rod that accelerates water. Of
    ///     an input that is changed once and then stays, ``z2 = a2 @ b1 + b2`` with the jump in `b1` and without it in `b2`.
    /// states : bool, optional
    ///     False for `b` and `d` alone: `a` and `c` then have no columns, and of a fine mesh the step takes a small part of the time and memory.
    ///
    /// Returns
    /// -------
    /// StepDerivative
    ///     With the matrices `a`, `b`, `c` and `d`.
    ///
    /// Raises
    /// ------
    /// caudal.Error
    ///     Where the step fails or has no such derivative: of a reduced model, an explicit method, on a mesh that is too fine or takes more
    ///     memory than there is. Everything is then as it was before the call.
    ///
    /// Notes
    /// -----
    /// The `a` of successive steps multiply to that of all of them with ``coordinates="full"`` by every method, and with ``"motion"`` by Newmark's
    /// method, implicit Euler and ESDIRK3. Generalized-alpha remembers accelerations that ``"motion"`` does not have.
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

    /// Go back to a snapshot; what follows is equal to the bit to what followed then.
    ///
    /// Parameters
    /// ----------
    /// snapshot : Snapshot or bytes
    ///     From :meth:`save` of a stepper of the same scene, or the bytes of one.
    ///
    /// Raises
    /// ------
    /// caudal.errors.SnapshotError
    ///     Where it is damaged, or comes from another scene or version.
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

    /// Free its memory; it cannot be used any more.
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
            Err(_) => format!("<caudal.Stepper of {:?}, closed or at work>", self.scene.get().scene.name),
        }
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<String> {
        shown(slf.as_any())
    }
}

/// Several steppers that make their steps together, four alike in SIMD lanes, each with the bits it has alone.
#[pyclass(frozen, name = "_SteppersTogether", module = "caudal._caudal")]
pub struct SteppersTogether {
    steppers: Vec<Py<Stepper>>,
    /// Of every [`WIDTH`] of them.
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

    /// `do_step` of the steppers that are `moving`, by their places. Returns for each of these the exception that it would raise alone, or
    /// None.
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
                    // The clock is read for one in so many steps.
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

/// Goes on unless another thread has asked to stop.
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
