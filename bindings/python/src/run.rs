//! Complete runs.

use std::ops::ControlFlow;
use std::path::PathBuf;

use caudal::Error;
use caudal::assessment::Assessment;
use caudal::report::RodMotion;
use caudal::report::Summary;
use caudal::report::film::{FilmSettings, FilmedMotion};
use caudal::report::picture::{self, PictureFormat};
use caudal::report::sampling::fastest_drive;
use caudal::report::trajectory::{TrajectoryColumn, TrajectoryTable};
use caudal::report::vtk;
use caudal::report::{Claim, Folder, Owner, RunOutput};
use caudal::run::Ending;
use caudal::variable::{Size, VARIABLES};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::attention::Attention;
use crate::error::{OrRaise, exception, first_of};
use crate::scene::Scene;
use crate::stepper::Variable;

/// Runs a scene. Returns the data from which `caudal.run` builds its result, and the exception that ended the run early, if any.
#[pyfunction]
#[pyo3(name = "_run")]
pub fn run<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    record: Option<Vec<String>>,
    out: Option<PathBuf>,
    force: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Option<PyErr>)> {
    let Scene { scene, document, .. } = scene.get();
    let prepared = py.detach(|| {
        let stepper = document.stepper(scene)?;
        let warnings = Assessment::of_run(scene, &stepper)?.warnings;
        Ok((stepper, warnings))
    });
    let (mut stepper, warnings) = prepared.or_raise(py)?;
    let located = |error| document.located(error);
    let mut trajectory = TrajectoryTable::start(scene, &stepper, record.as_deref()).map_err(located).or_raise(py)?;
    let claim = Claim::forced(force);
    let create = |folder: PathBuf| RunOutput::create(&folder, scene, &stepper, claim).map_err(located);
    let mut output = out.map(create).transpose().or_raise(py)?;
    let duration = scene.solver.duration_s.get();
    let tell = |py: Python<'_>, time: f64| match &progress {
        None => Ok(ControlFlow::Continue(())),
        // Only the value False ends the run, because most callbacks return nothing.
        Some(callback) => match callback.call1(py, (time, duration))?.extract::<bool>(py) {
            Ok(false) => Ok(ControlFlow::Break(())),
            _ => Ok(ControlFlow::Continue(())),
        },
    };
    let mut attention = Attention::new();
    let finished = py.detach(|| {
        let outcome = caudal::run::run(scene, &mut stepper, |stepper| {
            let time = stepper.time();
            let mut watch = || attention.poll(|py| tell(py, time));
            if trajectory.step(stepper, &mut watch)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
            if let Some(output) = &mut output
                && output.step(stepper, &mut watch)?.is_break()
            {
                return Ok(ControlFlow::Break(()));
            }
            Ok(watch())
        });
        trajectory.finish(&stepper);
        let summary = Summary::of(scene, &stepper, &outcome, &warnings);
        let player = trajectory.player(&summary);
        let written = output
            .map_or(Ok(()), |output| output.finish(&stepper, &summary, document, &summary.notes).complete().map(drop));
        (outcome.ending, summary, player, written)
    });
    let (ending, summary, player, written) = finished;
    // A file that cannot be written does not discard the computed result.
    let unwritten = player.as_ref().err().cloned().or(written.err()).map(|error| exception(py, &error));
    if ending == Ending::Complete
        && let Err(failure) = tell(py, stepper.time())
    {
        attention.failure.get_or_insert(failure);
    }
    let (variables, arrays) = (PyDict::new(py), PyDict::new(py));
    for TrajectoryColumn { variable, nodes, values } in trajectory.into_columns() {
        variables.set_item(variable.name, Variable::of(py, variable, stepper.model())?)?;
        let rows = values.len() / nodes.len();
        let array = PyArray1::from_vec(py, values); // takes ownership of the memory
        match variable.size {
            Size::Scalar => arrays.set_item(variable.name, array)?,
            Size::Nodes | Size::Joints => arrays.set_item(variable.name, array.reshape([rows, nodes.len()])?)?,
        }
    }
    let content = PyDict::new(py);
    content.set_item("notes", &summary.notes)?;
    // Converted by way of JSON, which turns pairs into lists, as in summary.json.
    let summary = serde_json::to_value(&summary).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    content.set_item("summary", pythonize::pythonize(py, &summary)?)?;
    content.set_item("variables", variables)?;
    content.set_item("arrays", arrays)?;
    content.set_item("nodes", PyArray1::from_vec(py, scene.recorded_nodes()))?;
    content.set_item("html", player.unwrap_or_default())?;
    let failure = match ending {
        Ending::Failed(error) => Some(exception(py, &error)),
        Ending::Complete | Ending::Interrupted => attention.failure,
    };
    Ok((content, first_of(py, failure, unwritten)))
}

/// Writes the recorded data of a run as VTK files; returns their paths.
#[pyfunction]
#[pyo3(name = "_vtk")]
pub fn write_vtk(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    folder: PathBuf,
    arrays: Vec<(String, PyReadonlyArrayDyn<'_, f64>)>,
    force: bool,
) -> PyResult<Vec<PathBuf>> {
    let Scene { scene, .. } = scene.get();
    let model = scene.model().or_raise(py)?;
    let mut columns = Vec::with_capacity(arrays.len());
    for (name, array) in arrays {
        let unknown = || exception(py, &Error::UnknownVariable { name: name.clone(), nearest: None, needs: None });
        let variable = VARIABLES.iter().find(|variable| variable.name == name).ok_or_else(unknown)?;
        let nodes = match variable.size {
            Size::Nodes => scene.recorded_nodes(),
            Size::Scalar | Size::Joints => variable.entries(&model).collect(),
        };
        columns.push(TrajectoryColumn { variable, nodes, values: array.as_array().iter().copied().collect() });
    }
    let written = py.detach(|| {
        let mut folder = Folder::export(&folder, Owner::of("export", scene), Claim::forced(force))?;
        vtk::write(&mut folder, &scene.name, &model.rod, &columns)?.complete()
    });
    written.or_raise(py)
}

/// Converts the figures of a folder to other formats; returns the paths of the new files.
#[pyfunction]
#[pyo3(name = "_pictures")]
pub fn pictures(
    py: Python<'_>,
    folder: PathBuf,
    figures: Option<Vec<String>>,
    formats: Vec<String>,
    out: PathBuf,
    force: bool,
) -> PyResult<Vec<PathBuf>> {
    let format = |name: &String| match name.as_str() {
        "png" => Ok(PictureFormat::Png),
        "pdf" => Ok(PictureFormat::Pdf),
        _ => Err(PyValueError::new_err(format!("found {name:?}; allowed: \"png\", \"pdf\""))),
    };
    let formats = formats.iter().map(format).collect::<PyResult<Vec<_>>>()?;
    let claim = Claim::forced(force);
    py.detach(|| picture::convert(&folder, figures.as_deref(), &formats, &out, claim)?.complete()).or_raise(py)
}

/// Writes a film of the rod of a scene with these positions of the nodes, a row per time; `cycle` is the last whole cycle of the run, if
/// it has cycles; `look` holds pictures per second, speed, pixels per px, the first and last time, and whether another file is replaced.
#[pyfunction]
#[pyo3(name = "_film")]
pub fn write_film(
    py: Python<'_>,
    path: PathBuf,
    scene: &Bound<'_, Scene>,
    times: Vec<f64>,
    positions: [PyReadonlyArrayDyn<'_, f64>; 2],
    cycle: Option<[f64; 2]>,
    look: (Option<u32>, Option<f64>, f64, [f64; 2], bool),
) -> PyResult<()> {
    let positions = positions.map(|array| array.as_array().iter().copied().collect::<Vec<f64>>());
    let (per_second, speed, sharpness, window, force) = look;
    let Scene { scene, .. } = scene.get();
    let model = scene.model().or_raise(py)?;
    let mut attention = Attention::new();
    let written = py.detach(|| {
        let (nodes, [x, y]) = (scene.recorded_nodes(), &positions);
        let count = nodes.len();
        let row = |(n, time): (usize, f64)| (time, move |place: usize| [x, y].map(|all| all[n * count + place]));
        let motion = RodMotion::of_positions(&model, &nodes, times.into_iter().enumerate().map(row));
        let drive = fastest_drive(scene, &model);
        let motion = FilmedMotion { name: &scene.name, motion: &motion, cycle, drive };
        let film = FilmSettings { per_second, speed, sharpness, window, claim: Claim::forced(force) };
        let excerpt = film.excerpt(&path, &motion)?;
        film.write(&path, &motion, &excerpt, |_| attention.poll(|_| Ok(ControlFlow::Continue(()))))
    });
    match attention.failure {
        Some(failure) => Err(failure),
        None => written.or_raise(py),
    }
}
