//! Simulations that can be differentiated.

use std::sync::{Mutex, MutexGuard, PoisonError};

use caudal::Error;
use caudal::cycle::slopes;
use caudal::scene::parameter::Parameter as Number;
use caudal::sensitivity::{Controls, Output, Parameter, Problem, Sensitivities, Trajectory, Weights};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::OrRaise;
use crate::scene::Scene;

/// What a simulation is differentiated by.
#[derive(Debug, Clone, Copy, PartialEq)]
enum By {
    Number(Parameter),
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

impl By {
    /// What `name` says of `problem`, with unit and meaning.
    fn named<'a>(name: &str, problem: &Problem, numbers: &'a [Number]) -> Option<(Self, &'a str, &'a str)> {
        if let Some((by, _, unit, meaning)) = NAMED.iter().find(|(_, own, ..)| *own == name) {
            let driven = !matches!(by, Self::Amplitude | Self::PhaseProfile | Self::Phase);
            return (driven || problem.model().actuation.is_some()).then_some((*by, unit, meaning));
        }
        let number = numbers.iter().find(|number| number.component.is_none() && number.key == name)?;
        let parameter = Parameter::of_key(name, problem.model())?;
        Some((Self::Number(parameter), number.unit, &number.description))
    }

    /// Its value now, and whether it has an entry per joint or node.
    fn value(self, problem: &mut Problem, number: f64) -> (Vec<f64>, bool) {
        let (nodes, joints) = (problem.model().rod.nodes, problem.model().rod.joints().len());
        let axis = |values: &[f64], axis: usize| values.iter().skip(axis).step_by(2).copied().collect();
        match self {
            Self::Number(_) => (vec![number], false),
            Self::Phase => (vec![0.0], false),
            Self::Stiffness => (problem.stiffness(), true),
            Self::Amplitude => (vec![1.0; joints], true),
            Self::PhaseProfile | Self::Natural => (vec![0.0; joints], true),
            Self::Force(_) => (vec![0.0; nodes], true),
            Self::Position(i) => (axis(&problem.first()[0], i), true),
            Self::Velocity(i) => (axis(&problem.first()[1], i), true),
        }
    }
}

/// All that a simulation of `scene` can be differentiated by: (value, unit, meaning) by name.
#[pyfunction]
#[pyo3(name = "_parameters")]
pub fn parameters<'py>(py: Python<'py>, scene: &Bound<'py, Scene>) -> PyResult<Bound<'py, PyDict>> {
    let Scene { scene, .. } = scene.get();
    let mut problem = py.detach(|| Problem::of(scene)).or_raise(py)?;
    let numbers = scene.parameters();
    let found = PyDict::new(py);
    let names = numbers.iter().map(|number| number.key.as_str()).chain(NAMED.iter().map(|named| named.1));
    for name in names {
        let Some((by, unit, meaning)) = By::named(name, &problem, &numbers) else { continue };
        let number = numbers.iter().find(|number| number.key == name).map_or(0.0, |number| number.value);
        let (values, many) = by.value(&mut problem, number);
        let value = match many {
            true => PyArray1::from_vec(py, values).into_any(),
            false => values[0].into_pyobject(py)?.into_any(),
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

/// Outputs that a control over time, or forces, leave without derivative.
const NEEDS_RATE: [&str; 1] = ["actuation_power_w"];
const NEEDS_FORCE: [&str; 8] = [
    "load_power_w",
    "load_work_j",
    "numerical_dissipation_j",
    "head_force_x_n",
    "head_force_y_n",
    "head_moment_n_m",
    "head_power_w",
    "head_work_j",
];

/// A simulation, as it was.
#[pyclass(module = "caudal._caudal", name = "_Simulation", frozen)]
pub struct Simulation {
    inner: Mutex<Inner>,
}

struct Inner {
    problem: Problem,
    numbers: Vec<Number>,
    trajectory: Trajectory,
    values: Sensitivities,
    outputs: Vec<Output>,
    reads: Vec<(String, Read)>,
    /// Factors of the actuation's amplitude.
    factors: Vec<f64>,
    /// What was given over time.
    over_time: Vec<String>,
    given: bool,
}

/// An array over times and `width` entries, of one row for all times or a row each.
fn rows(name: &str, values: &PyReadonlyArrayDyn<'_, f64>, times: usize, width: usize) -> PyResult<(Vec<f64>, bool)> {
    let array = values.as_array();
    let flat: Vec<f64> = array.iter().copied().collect();
    if let Some(bad) = flat.iter().find(|x| !x.is_finite()) {
        return Err(PyValueError::new_err(format!("{name}: found {bad}; allowed: finite numbers")));
    }
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
        let (mut document, numbers) = (scene.document.clone(), scene.scene.parameters());
        for (name, value) in values.iter().filter(|(name, _)| !NAMED.iter().any(|named| named.1 == name)) {
            let [x] = value.as_array().iter().copied().collect::<Vec<_>>()[..] else {
                return Err(PyValueError::new_err(format!("{name}: found {} values; allowed: one", value.len())));
            };
            document.set(&format!("{name}={x:e}")).or_raise(py)?;
        }
        let own = document.scene().or_raise(py)?;
        let mut problem = Problem::of(&own).or_raise(py)?;
        let (nodes, joints) = (problem.model().rod.nodes, problem.model().rod.joints().len());
        let times = problem.times().len();
        let mut factors = vec![1.0; joints];
        let mut phases = vec![0.0; joints];
        let mut over_time = Vec::new();
        let (mut natural, mut force) = (None, [None, None]);
        let (mut start, mut given) = (problem.first(), false);
        let spread = |row: Vec<f64>, over_time: bool| if over_time { row } else { row.repeat(times) };
        for (name, value) in &values {
            let Some((by, ..)) = By::named(name, &problem, &numbers) else {
                let mut known: Vec<&str> = numbers.iter().map(|number| number.key.as_str()).collect();
                known.extend(NAMED.iter().map(|named| named.1));
                known.retain(|name| By::named(name, &problem, &numbers).is_some());
                let known = known.join(", ");
                return Err(PyValueError::new_err(format!(
                    "a simulation of {:?} has no derivative by `{name}`; allowed: {known}",
                    own.name
                )));
            };
            let width = match by {
                By::Number(_) | By::Phase => 1,
                By::Stiffness | By::Amplitude | By::PhaseProfile | By::Natural => joints,
                By::Force(_) | By::Position(_) | By::Velocity(_) => nodes,
            };
            let single = value.as_array();
            let (row, timed) = match (by, value.shape()) {
                (By::Number(_) | By::Phase, _) => (single.iter().copied().collect(), false),
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
                By::Number(_) => {}
                By::Phase => problem.inputs().phase_offset = row[0],
                By::Stiffness => {
                    if let Some(bad) = row.iter().find(|ei| **ei <= 0.0) {
                        return Err(PyValueError::new_err(format!("{name}: found {bad}; allowed: positive numbers")));
                    }
                    problem.set_stiffness(&row).or_raise(py)?;
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
        problem.set_actuation(&factors, &phases).or_raise(py)?;
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
        let (trajectory, values) = py.detach(|| problem.simulate_with(&outputs)).or_raise(py)?;
        Ok(Self { problem, numbers, trajectory, values, outputs, reads, factors, over_time, given })
    }

    /// Refuses derivatives of `output` that would lack a part.
    fn check(&self, output: &str, by: &[(String, By)]) -> PyResult<()> {
        for (name, by) in by {
            let timed = self.over_time.contains(name) && NEEDS_RATE.contains(&output);
            let forced = matches!(by, By::Force(_)) && NEEDS_FORCE.contains(&output);
            if timed || forced {
                let reason = if timed { "over time, whose rate is not given" } else { "" };
                return Err(PyValueError::new_err(
                    format!("{output} has no derivative by {name} {reason}").trim_end().to_string(),
                ));
            }
        }
        Ok(())
    }

    fn by(&self, names: Vec<String>) -> PyResult<Vec<(String, By)>> {
        let find = |name: String| match By::named(&name, &self.problem, &self.numbers) {
            Some((by, ..)) => Ok((name, by)),
            None => {
                Err(PyValueError::new_err(format!("no derivative by `{name}`; caudal.parameters(scene) lists them")))
            }
        };
        names.into_iter().map(find).collect()
    }

    /// The parameters behind names, in their order.
    fn parameters(&self, by: &[(String, By)]) -> Vec<Parameter> {
        let joints = || self.problem.model().rod.joints();
        let of = |by: &By| -> Vec<Parameter> {
            match by {
                By::Number(parameter) => vec![*parameter],
                By::Phase => vec![Parameter::Phase],
                By::Stiffness => joints().map(Parameter::Stiffness).collect(),
                By::Amplitude => joints().map(Parameter::WaveAmplitude).collect(),
                By::PhaseProfile => joints().map(Parameter::WavePhase).collect(),
                By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_) => Vec::new(),
            }
        };
        by.iter().flat_map(|(_, by)| of(by)).collect()
    }

    /// Takes what belongs to `by` from derivatives by its parameters.
    fn take(&self, by: By, from: &mut std::vec::IntoIter<f64>) -> Vec<f64> {
        let joints = self.problem.model().rod.joints().len();
        match by {
            By::Number(_) | By::Phase => from.take(1).collect(),
            By::Stiffness | By::PhaseProfile => from.take(joints).collect(),
            // The parameter is relative to what it is.
            By::Amplitude => from.take(joints).zip(&self.factors).map(|(by, factor)| by / factor).collect(),
            By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_) => Vec::new(),
        }
    }
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
        PyArray1::from_slice(py, &self.open().trajectory.times)
    }

    /// The outputs over time, by name.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let inner = self.open();
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
        let mut inner = self.open();
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
        let parameters = inner.parameters(&by);
        if by.iter().any(|(_, by)| *by == By::Amplitude) && inner.factors.contains(&0.0) {
            return Err(PyValueError::new_err("actuation.amplitude_profile: no derivative where a factor is 0"));
        }
        if !inner.given && by.iter().any(|(_, by)| matches!(by, By::Position(_) | By::Velocity(_))) {
            return Err(PyValueError::new_err("derivatives by the first state need it to be given"));
        }
        let Inner { problem, trajectory, outputs, .. } = &mut *inner;
        let weights = Weights { outputs: &all[0], positions: &all[1], velocities: &all[2] };
        let found = py.detach(|| problem.pull_back(&parameters, outputs, weights, trajectory)).or_raise(py)?;
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
            } else if matches!(by, By::Number(_) | By::Phase) {
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
        let mut inner = self.open();
        let by = inner.by(names)?;
        let Some(measure) = slopes::smooth().find(|own| own.key == measure) else {
            let known: Vec<&str> = slopes::smooth().map(|own| own.key).collect();
            return Err(PyValueError::new_err(format!("`{measure}` has no derivative; allowed: {}", known.join(", "))));
        };
        let other = |by: &By| matches!(by, By::Natural | By::Force(_) | By::Position(_) | By::Velocity(_));
        if let Some((name, _)) = by.iter().find(|(_, by)| other(by)) {
            return Err(PyValueError::new_err(format!("means over cycles have no derivative by {name}")));
        }
        let parameters = inner.parameters(&by);
        let problem = &mut inner.problem;
        let found = py.detach(|| problem.cycle_mean(&measure, &parameters)).or_raise(py)?;
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
            match by {
                By::Number(_) | By::Phase => result.set_item(name, values[0])?,
                _ => result.set_item(name, PyArray1::from_vec(py, values))?,
            }
        }
        Ok((value, result))
    }
}

impl Simulation {
    fn open(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
