//! Simulations that can be differentiated.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use caudal::Error;
use caudal::cycle::slopes;
use caudal::scene::Document;
use caudal::sensitivity::number::{self, Number, Numbers};
use caudal::sensitivity::{Controls, Output, Parameter, Problem, Sensitivities, Trajectory, Weights};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::attention::Progress;
use crate::error::OrRaise;
use crate::locks::lock;
use crate::scene::Scene;

/// What a simulation is differentiated by.
#[derive(Debug, Clone, Copy, PartialEq)]
enum By {
    /// Numbers of the scene, by the place of their key.
    Scene(usize),
    Stiffness,
    Amplitude,
    PhaseProfile,
    Phase,
    Natural,
    /// Along an axis.
    Force(usize),
    Position(usize),
    Velocity(usize),
}

/// Name, unit and meaning of what has an entry per joint or node, or is no key of the scene.
const NAMED: [(By, &str, &str, &str); 11] = [
    (By::Stiffness, "joint_stiffness_n_m2", "N m^2", "bending stiffness of the joints"),
    (By::Amplitude, "actuation.amplitude_profile", "1", "factors of the actuation's amplitude at the joints"),
    (
        By::PhaseProfile,
        "actuation.phase_profile_rad",
        "rad",
        "phases subtracted inside the actuation's sine at the joints",
    ),
    (By::Phase, "actuation_phase_rad", "rad", "phase subtracted inside the actuation's sine"),
    (
        By::Natural,
        "natural_curvature_1_m",
        "1/m",
        "natural curvature of the joints beside the actuation's; may be given over time",
    ),
    (By::Force(0), "force_x_n", "N", "forces on the nodes, x; may be given over time"),
    (By::Force(1), "force_y_n", "N", "forces on the nodes, y; may be given over time"),
    (By::Position(0), "x_m", "m", "nodes at the start, x"),
    (By::Position(1), "y_m", "m", "nodes at the start, y"),
    (By::Velocity(0), "vx_m_s", "m/s", "velocity of the nodes at the start, x"),
    (By::Velocity(1), "vy_m_s", "m/s", "velocity of the nodes at the start, y"),
];

/// All that a scene can be differentiated by.
struct Known {
    /// The numbers of every key.
    keys: Vec<Vec<Number>>,
    driven: bool,
}

impl Known {
    fn of(scene: &caudal::scene::Scene) -> caudal::Result<Self> {
        let model = scene.model()?;
        let numbers = Numbers::of(scene, &model);
        let keys = numbers.keys().into_iter().filter(|key| !NAMED.iter().any(|named| named.1 == *key));
        let keys = keys.map(|key| numbers.of_key(key)).collect();
        Ok(Self { keys, driven: model.actuation.is_some() })
    }

    fn names(&self) -> Vec<&str> {
        let keys = self.keys.iter().map(|numbers| &*numbers[0].key);
        let named = NAMED.iter().map(|named| named.1).filter(|name| self.named(name).is_some());
        keys.chain(named).collect()
    }

    /// What `name` says, with unit and meaning.
    fn named(&self, name: &str) -> Option<(By, &str, String)> {
        if let Some((by, _, unit, meaning)) = NAMED.iter().find(|(_, own, ..)| *own == name) {
            let wave = matches!(by, By::Amplitude | By::PhaseProfile | By::Phase);
            return (self.driven || !wave).then(|| (*by, *unit, meaning.to_string()));
        }
        let i = self.keys.iter().position(|numbers| numbers[0].key == name)?;
        let numbers = &self.keys[i];
        let meanings: Vec<&str> = numbers.iter().map(|number| &*number.description).collect();
        let meaning = if numbers[0].xi.is_some() { meanings[0].to_string() } else { meanings.join("; ") };
        Some((By::Scene(i), numbers[0].unit, meaning))
    }

    /// True where `by` is one number and no list.
    fn is_single(&self, by: By) -> bool {
        match by {
            By::Phase => true,
            By::Scene(i) => self.keys[i][0].place.is_empty(),
            _ => false,
        }
    }

    /// Its value now.
    fn value(&self, by: By, problem: &mut Problem) -> Vec<f64> {
        let (nodes, joints) = (problem.model().rod.nodes, problem.model().rod.joints().len());
        let axis = |values: &[f64], axis: usize| values.iter().skip(axis).step_by(2).copied().collect();
        match by {
            By::Scene(i) => self.keys[i].iter().map(|number| number.own).collect(),
            By::Phase => vec![0.0],
            By::Stiffness => problem.stiffness(),
            By::Amplitude => vec![1.0; joints],
            By::PhaseProfile | By::Natural => vec![0.0; joints],
            By::Force(_) => vec![0.0; nodes],
            By::Position(i) => axis(&problem.first()[0], i),
            By::Velocity(i) => axis(&problem.first()[1], i),
        }
    }
}

/// All that a simulation of `scene` can be differentiated by: (value, unit, meaning) by name.
#[pyfunction]
#[pyo3(name = "_parameters")]
pub fn parameters<'py>(py: Python<'py>, scene: &Bound<'py, Scene>) -> PyResult<Bound<'py, PyDict>> {
    let Scene { scene, .. } = scene.get();
    let mut problem = py.detach(|| Problem::of(scene)).or_raise(py)?;
    let known = Known::of(scene).or_raise(py)?;
    let found = PyDict::new(py);
    for name in known.names() {
        let Some((by, unit, meaning)) = known.named(name) else { continue };
        let values = known.value(by, &mut problem);
        let value = match known.is_single(by) {
            false => PyArray1::from_vec(py, values).into_any(),
            true => values[0].into_pyobject(py)?.into_any(),
        };
        found.set_item(name, (value, unit, meaning))?;
    }
    Ok(found)
}

/// What is read of a simulation.
#[derive(Debug, Clone)]
enum Read {
    /// Numbers of the outputs.
    Output(usize),
    Position(usize),
    Velocity(usize),
}

impl Read {
    fn named(name: &str, outputs: &mut Vec<Output>, problem: &Problem) -> caudal::Result<Self> {
        Ok(match name {
            "x_m" => Self::Position(0),
            "y_m" => Self::Position(1),
            "vx_m_s" => Self::Velocity(0),
            "vy_m_s" => Self::Velocity(1),
            _ => {
                outputs.push(Output::named(name, problem.model())?);
                Self::Output(outputs.len() - 1)
            }
        })
    }
}

/// Outputs that a control over time leaves without derivative.
const NEEDS_RATE: [&str; 1] = ["actuation_power_w"];

/// A simulation, as it was.
#[pyclass(module = "caudal._caudal", name = "_Simulation", frozen)]
pub struct Simulation {
    inner: Mutex<Inner>,
}

struct Inner {
    problem: Problem,
    /// The scene, with the numbers that were given.
    document: Document,
    known: Known,
    trajectory: Trajectory,
    values: Sensitivities,
    outputs: Vec<Output>,
    reads: Vec<(String, Read)>,
    /// Stiffness of the joints, where it was given.
    stiffness: Option<Vec<f64>>,
    /// Factors and phases of the actuation.
    factors: Vec<f64>,
    phases: Vec<f64>,
    phase: f64,
    /// What was given over time.
    over_time: Vec<String>,
    given: bool,
}

/// The numbers of an array, one after the other.
fn finite(name: &str, values: &PyReadonlyArrayDyn<'_, f64>) -> PyResult<Vec<f64>> {
    let flat: Vec<f64> = values.as_array().iter().copied().collect();
    match flat.iter().find(|x| !x.is_finite()) {
        Some(bad) => Err(PyValueError::new_err(format!("{name}: found {bad}; allowed: finite numbers"))),
        None => Ok(flat),
    }
}

/// An array over times and `width` entries, of one row for all times or a row each.
fn rows(name: &str, values: &PyReadonlyArrayDyn<'_, f64>, times: usize, width: usize) -> PyResult<(Vec<f64>, bool)> {
    let flat = finite(name, values)?;
    match values.shape() {
        [n] if *n == width => Ok((flat, false)),
        [t, n] if *t == times && *n == width => Ok((flat, true)),
        found => Err(PyValueError::new_err(format!(
            "{name}: found the shape {found:?}; allowed: ({width},) or ({times}, {width})"
        ))),
    }
}

fn interleaved([x, y]: [&[f64]; 2]) -> Vec<f64> {
    x.iter().zip(y).flat_map(|(x, y)| [*x, *y]).collect()
}

impl Inner {
    fn new(
        py: Python<'_>,
        scene: &Scene,
        values: Vec<(String, PyReadonlyArrayDyn<'_, f64>)>,
        names: Vec<String>,
    ) -> PyResult<Self> {
        let mut document = scene.document.clone();
        document.keep_fluid_of(&scene.scene);
        let numbers = values.iter().filter(|(name, _)| !NAMED.iter().any(|named| named.1 == name));
        let refuse = |name: &str, known: &Known| {
            let known = known.names().join(", ");
            PyValueError::new_err(format!(
                "a simulation of {:?} has no derivative by `{name}`; allowed: {known}",
                scene.scene.name
            ))
        };
        let as_is = Known::of(&scene.scene).or_raise(py)?;
        for (name, value) in numbers {
            let given = finite(name, value)?;
            let Some((By::Scene(i), ..)) = as_is.named(name) else {
                // The scene says what is near to it, where it knows no such key.
                document.set(&format!("{name}={:e}", given.first().unwrap_or(&0.0))).or_raise(py)?;
                document.scene().or_raise(py)?;
                return Err(refuse(name, &as_is));
            };
            let own = &as_is.keys[i];
            if own.len() != given.len() {
                let problem = format!("{name}: found {} values; allowed: {}", given.len(), own.len());
                return Err(PyValueError::new_err(problem));
            }
            for (key, value) in number::keys_with(own, &given) {
                document.put("a simulation's values", &key, &value);
            }
        }
        let own = document.scene().or_raise(py)?;
        let known = Known::of(&own).or_raise(py)?;
        let mut problem = Problem::of(&own).or_raise(py)?;
        let (nodes, joints) = (problem.model().rod.nodes, problem.model().rod.joints().len());
        let times = problem.times().len();
        let mut factors = vec![1.0; joints];
        let (mut phases, mut phase, mut stiffness) = (vec![0.0; joints], 0.0, None);
        let mut over_time = Vec::new();
        let (mut natural, mut force) = (None, [None, None]);
        let (mut start, mut given) = (problem.first(), false);
        let spread = |row: Vec<f64>, over_time: bool| if over_time { row } else { row.repeat(times) };
        for (name, value) in &values {
            let Some((by, ..)) = known.named(name) else { return Err(refuse(name, &known)) };
            let width = match by {
                By::Scene(_) => continue, // the scene has it
                By::Phase => 1,
                By::Stiffness | By::Amplitude | By::PhaseProfile | By::Natural => joints,
                By::Force(_) | By::Position(_) | By::Velocity(_) => nodes,
            };
            let (row, timed) = match (by, value.shape()) {
                (By::Phase, []) => (finite(name, value)?, false),
                _ => rows(name, value, times, width)?,
            };
            let may_be_timed = matches!(by, By::Natural | By::Force(_));
            if timed && !may_be_timed {
                return Err(PyValueError::new_err(format!("{name}: found a row per time; allowed: ({width},)")));
            }
            if timed {
                over_time.push(name.clone());
            }
            match by {
                By::Scene(_) => {}
                By::Phase => phase = row.first().copied().unwrap_or_default(),
                By::Stiffness => {
                    if let Some(bad) = row.iter().find(|ei| **ei <= 0.0) {
                        return Err(PyValueError::new_err(format!("{name}: found {bad}; allowed: positive numbers")));
                    }
                    stiffness = Some(row);
                }
                By::Amplitude => factors = row,
                By::PhaseProfile => phases = row,
                By::Natural => natural = Some(spread(row, timed)),
                By::Force(axis) => force[axis] = Some(spread(row, timed)),
                By::Position(axis) | By::Velocity(axis) => {
                    let part = usize::from(matches!(by, By::Velocity(_)));
                    start[part].iter_mut().skip(axis).step_by(2).zip(&row).for_each(|(to, from)| *to = *from);
                    given = true;
                }
            }
        }
        set(&mut problem, stiffness.as_deref(), [&factors, &phases], phase).or_raise(py)?;
        let force = (force != [None, None]).then(|| {
            let [x, y] = force.map(|part| part.unwrap_or_else(|| vec![0.0; times * nodes]));
            interleaved([&x, &y])
        });
        problem.set_controls(Controls { natural, force }).or_raise(py)?;
        if given {
            let [q, v] = start;
            problem.set_start(q, v).or_raise(py)?;
        }
        let mut outputs = Vec::new();
        let mut reads = Vec::new();
        for name in names {
            let read = Read::named(&name, &mut outputs, &problem).or_raise(py)?;
            reads.push((name, read));
        }
        let (trajectory, values) = ending(py, &problem.interrupt(), || problem.simulate_with(&outputs))?;
        Ok(Self {
            problem,
            document,
            known,
            trajectory,
            values,
            outputs,
            reads,
            stiffness,
            factors,
            phases,
            phase,
            over_time,
            given,
        })
    }

    /// Refuses derivatives of `output` that would lack a part.
    fn check(&self, output: &str, by: &[(String, By)]) -> PyResult<()> {
        for (name, by) in by {
            if *by == By::Natural && self.over_time.contains(name) && NEEDS_RATE.contains(&output) {
                return Err(PyValueError::new_err(format!(
                    "{output} has no derivative by {name} over time, whose rate is not given"
                )));
            }
        }
        Ok(())
    }

    fn by(&self, names: Vec<String>) -> PyResult<Vec<(String, By)>> {
        let find = |name: String| match self.known.named(&name) {
            Some((by, ..)) => Ok((name, by)),
            None => {
                Err(PyValueError::new_err(format!("no derivative by `{name}`; caudal.parameters(scene) lists them")))
            }
        };
        names.into_iter().map(find).collect()
    }

    /// The parameters behind names, in their order, with the problem ready for them.
    fn parameters(&mut self, by: &[(String, By)]) -> caudal::Result<Vec<Parameter>> {
        let of_scene = |by: &By| if let By::Scene(i) = by { &self.known.keys[*i][..] } else { &[] };
        let mut numbers: Vec<Number> = by.iter().flat_map(|(_, by)| of_scene(by)).cloned().collect();
        number::count(&mut numbers);
        let own: Vec<f64> = numbers.iter().map(|number| number.own).collect();
        self.problem.moved = number::moved(&self.document, &numbers, &own)?;
        set(&mut self.problem, self.stiffness.as_deref(), [&self.factors, &self.phases], self.phase)?;
        let joints = || self.problem.model().rod.joints();
        let mut numbers = numbers.into_iter();
        let of = |(_, by): &(String, By)| -> Vec<Parameter> {
            match by {
                By::Scene(i) => numbers.by_ref().take(self.known.keys[*i].len()).map(|number| number.by).collect(),
                By::Phase => vec![Parameter::Phase],
                By::Stiffness => joints().map(Parameter::Stiffness).collect(),
                By::Amplitude => joints().map(Parameter::WaveAmplitude).collect(),
                By::PhaseProfile => joints().map(Parameter::WavePhase).collect(),
                By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_) => Vec::new(),
            }
        };
        Ok(by.iter().flat_map(of).collect())
    }

    /// Takes what belongs to `by` from derivatives by its parameters.
    fn take(&self, by: By, from: &mut std::vec::IntoIter<f64>) -> Vec<f64> {
        let joints = self.problem.model().rod.joints().len();
        match by {
            By::Scene(i) => from.take(self.known.keys[i].len()).collect(),
            By::Phase => from.take(1).collect(),
            By::Stiffness | By::PhaseProfile => from.take(joints).collect(),
            // The parameter is relative to what it is.
            By::Amplitude => from.take(joints).zip(&self.factors).map(|(by, factor)| by / factor).collect(),
            By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_) => Vec::new(),
        }
    }
}

/// Computes in another thread, while this one looks up for Ctrl-C and ends the computation by the `flag` then.
fn ending<T: Send>(
    py: Python<'_>,
    flag: &Arc<AtomicBool>,
    compute: impl FnOnce() -> caudal::Result<T> + Send,
) -> PyResult<T> {
    Progress::ended_by(Arc::clone(flag)).watch(py, None, compute)?.or_raise(py)
}

/// Gives a problem, and it with its numbers moved, what is no number of the scene.
fn set(
    problem: &mut Problem,
    stiffness: Option<&[f64]>,
    [factors, phases]: [&[f64]; 2],
    phase: f64,
) -> caudal::Result<()> {
    if let Some(stiffness) = stiffness {
        problem.set_stiffness(stiffness)?;
    }
    problem.set_phase(phase);
    problem.set_actuation(factors, phases)
}

/// Positions or velocities along an axis, a row per time.
fn along(trajectory: &Trajectory, read: &Read) -> Vec<f64> {
    let axis = |values: &[f64], i: usize| values.iter().skip(i).step_by(2).copied().collect::<Vec<_>>();
    let times = 0..trajectory.times.len();
    match read {
        Read::Position(i) => times.flat_map(|n| axis(trajectory.positions(n), *i)).collect(),
        Read::Velocity(i) => times.flat_map(|n| axis(trajectory.velocities(n), *i)).collect(),
        Read::Output(_) => Vec::new(),
    }
}

#[pymethods]
impl Simulation {
    /// Simulates.
    #[new]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, Scene>,
        values: Vec<(String, PyReadonlyArrayDyn<'_, f64>)>,
        outputs: Vec<String>,
    ) -> PyResult<Self> {
        Ok(Self { inner: Mutex::new(Inner::new(py, scene.get(), values, outputs)?) })
    }

    /// Times, s.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &lock(py, &self.inner).trajectory.times)
    }

    /// The outputs over time, by name.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let inner = lock(py, &self.inner);
        let times = inner.trajectory.times.len();
        let found = PyDict::new(py);
        for (name, read) in &inner.reads {
            match read {
                Read::Output(o) => {
                    let values = (0..times).map(|n| inner.values.value(n, *o)).collect();
                    found.set_item(name, PyArray1::from_vec(py, values))?;
                }
                _ => {
                    let values = along(&inner.trajectory, read);
                    let width = values.len() / times;
                    found.set_item(name, PyArray1::from_vec(py, values).reshape([times, width])?)?;
                }
            }
        }
        Ok(found)
    }

    /// The derivatives of Σ w y over all outputs y and times, with `weights` w by output, by what is named.
    fn pull_back<'py>(
        &self,
        py: Python<'py>,
        weights: Vec<(String, PyReadonlyArrayDyn<'py, f64>)>,
        names: Vec<String>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut inner = lock(py, &self.inner);
        let by = inner.by(names)?;
        let (times, nodes) = (inner.trajectory.times.len(), inner.problem.model().rod.nodes);
        let count = inner.outputs.len();
        let mut all = [vec![0.0; times * count], Vec::new(), Vec::new()];
        for (name, given) in weights {
            let Some((_, read)) = inner.reads.iter().find(|(own, _)| *own == name) else {
                return Err(PyValueError::new_err(format!("`{name}` was not read")));
            };
            inner.check(&name, &by)?;
            let given: Vec<f64> = given.as_array().iter().copied().collect();
            let (list, width, stride, offset) = match read {
                Read::Output(o) => (&mut all[0], 1, count, *o),
                Read::Position(i) => (&mut all[1], nodes, 2 * nodes, *i),
                Read::Velocity(i) => (&mut all[2], nodes, 2 * nodes, *i),
            };
            list.resize(times * stride, 0.0);
            if given.len() != times * width {
                let error = Error::WrongLength { name: "weights", expected: times * width, found: given.len() };
                return Err(crate::error::exception(py, &error));
            }
            for (n, row) in given.chunks(width).enumerate() {
                for (k, weight) in row.iter().enumerate() {
                    list[n * stride + offset + 2 * k] += weight;
                }
            }
        }
        let parameters = inner.parameters(&by).or_raise(py)?;
        if by.iter().any(|(_, by)| *by == By::Amplitude) && inner.factors.contains(&0.0) {
            return Err(PyValueError::new_err("actuation.amplitude_profile: no derivative where a factor is 0"));
        }
        if !inner.given && by.iter().any(|(_, by)| matches!(by, By::Position(_) | By::Velocity(_))) {
            return Err(PyValueError::new_err("derivatives by the first state need it to be given"));
        }
        let Inner { problem, trajectory, outputs, .. } = &mut *inner;
        let weights = Weights { outputs: &all[0], positions: &all[1], velocities: &all[2] };
        let flag = problem.interrupt();
        let found = ending(py, &flag, || problem.pull_back(&parameters, outputs, weights, trajectory))?;
        let mut parts = found.parameters.clone().into_iter();
        let result = PyDict::new(py);
        let axis = |values: &[f64], i: usize| values.iter().skip(i).step_by(2).copied().collect::<Vec<_>>();
        for (name, by) in by {
            let (values, width) = match by {
                By::Natural => (found.natural.clone(), inner.problem.model().rod.joints().len()),
                By::Force(i) => (axis(&found.force, i), nodes),
                By::Position(i) => (axis(&found.start[0], i), nodes),
                By::Velocity(i) => (axis(&found.start[1], i), nodes),
                _ => {
                    let values = inner.take(by, &mut parts);
                    let width = values.len();
                    (values, width)
                }
            };
            let timed = matches!(by, By::Natural | By::Force(_));
            if timed && inner.over_time.contains(&name) {
                result.set_item(&name, PyArray1::from_vec(py, values).reshape([times, width])?)?;
            } else if timed {
                let mut sum = vec![0.0; width];
                values.chunks(width).for_each(|row| sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += x));
                result.set_item(&name, PyArray1::from_vec(py, sum))?;
            } else if inner.known.is_single(by) {
                result.set_item(&name, values[0])?;
            } else {
                result.set_item(&name, PyArray1::from_vec(py, values))?;
            }
        }
        Ok(result)
    }

    /// A mean over the last whole cycles, and its derivatives by what is named, which holds over the whole simulation.
    fn cycle_mean<'py>(
        &self,
        py: Python<'py>,
        measure: &str,
        names: Vec<String>,
    ) -> PyResult<(f64, Bound<'py, PyDict>)> {
        let mut inner = lock(py, &self.inner);
        let by = inner.by(names)?;
        let Some(measure) = slopes::smooth().find(|own| own.key == measure) else {
            let known: Vec<&str> = slopes::smooth().map(|own| own.key).collect();
            return Err(PyValueError::new_err(format!("`{measure}` has no derivative; allowed: {}", known.join(", "))));
        };
        let other = |by: &By| matches!(by, By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_));
        if let Some((name, _)) = by.iter().find(|(_, by)| other(by)) {
            return Err(PyValueError::new_err(format!("means over cycles have no derivative by {name}")));
        }
        let parameters = inner.parameters(&by).or_raise(py)?;
        let problem = &mut inner.problem;
        let found = ending(py, &problem.interrupt(), || problem.cycle_mean(&measure, &parameters))?;
        let Some((value, slopes)) = found else {
            return Err(PyValueError::new_err(format!(
                "this run has no {}: no whole cycle, or nothing to average",
                measure.key
            )));
        };
        let mut parts = slopes.into_iter();
        let result = PyDict::new(py);
        for (name, by) in by {
            let values = inner.take(by, &mut parts);
            match inner.known.is_single(by) {
                true => result.set_item(name, values[0])?,
                false => result.set_item(name, PyArray1::from_vec(py, values))?,
            }
        }
        Ok((value, result))
    }
}
