//! `caudal export`.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use caudal::error::{Error, Result};
use caudal::report::trajectory::Trajectory;
use caudal::report::vtk;
use caudal::run::{Ending, run as run_scene};
use clap::Args;

use super::run::{progress_bar, watch_for_interrupts};
use super::{Prepared, SceneArguments, complain, exit, output_folder, refuse, say, say_written};

#[derive(Debug, Args)]
pub struct Arguments {
    /// The folder of a run, or a scene
    run: PathBuf,
    /// The overrides that the run was made with
    #[arg(long, value_name = "TABLE.KEY=VALUE")]
    set: Vec<String>,
    /// Write NAME.pvd and a .vtp file per recorded time, for ParaView and other programs that read VTK
    #[arg(long, required = true)]
    vtk: bool,
    /// Folder for the files [default: the run's, or out/<name of the scene>, with /vtk]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The fields, variables by name [default: those of nodes and joints, and all of trajectory.csv]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    fields: Option<Vec<String>>,
}

/// A run is computed again, equal to the bit: its tables hold neither velocities nor moments.
pub fn export(arguments: &Arguments) -> Result<ExitCode> {
    let folder = arguments.run.is_dir().then_some(arguments.run.as_path());
    let (file, fingerprint) = match folder {
        None => (arguments.run.clone(), None),
        Some(folder) => match summary(folder) {
            Ok(found) => found,
            Err(error) => return Ok(refuse(&error)),
        },
    };
    let prepared = SceneArguments { scene: file, set: arguments.set.clone() }.prepare()?;
    let Prepared { document, scene, mut stepper, assessment } = prepared;
    if let Some(error) = assessment.refused(&document) {
        return Ok(refuse(&error));
    }
    if let Some(fingerprint) = fingerprint.filter(|fingerprint| *fingerprint != scene.fingerprint_text()) {
        complain(&format!(
            "{}: the run is of another scene than {} is now ({fingerprint}); --set gives the overrides that it was made with",
            arguments.run.display(),
            arguments.run.display()
        ));
        return Ok(ExitCode::from(exit::WRONG_INPUT));
    }
    let out = arguments.out.clone().unwrap_or_else(|| match folder {
        Some(folder) => folder.join("vtk"),
        None => output_folder(&scene).join("vtk"),
    });
    let fields = match &arguments.fields {
        Some(fields) => vtk::POSITIONS.map(str::to_string).into_iter().chain(fields.iter().cloned()).collect(),
        None => vtk::fields(&stepper),
    };
    let mut trajectory = Trajectory::start(&scene, &stepper, Some(&fields))?;
    let interrupted = watch_for_interrupts();
    let raised =
        || if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let bar = progress_bar();
    let outcome = run_scene(&scene, &mut stepper, |stepper| {
        bar.set_position(super::run::part(stepper.time(), &scene));
        trajectory.step(stepper, &mut || raised())
    });
    bar.finish_and_clear();
    trajectory.finish(&stepper);
    let kept = vtk::write(&out, &scene.name, &stepper.model().rod, trajectory.columns())?;
    let whole = say_written(&kept, &out, &format!("{}.pvd", scene.name));
    Ok(match outcome.ending {
        Ending::Complete => whole,
        Ending::Interrupted => ExitCode::from(exit::INTERRUPTED),
        Ending::Failed(error) => {
            complain(&error.to_string());
            say("what was computed until then is there");
            ExitCode::from(exit::FAILED)
        }
    })
}

/// The scene's file of a run in `folder`, and its fingerprint.
fn summary(folder: &Path) -> Result<(PathBuf, Option<String>)> {
    let path = folder.join("summary.json");
    let read = |reason: String| Error::Read { path: path.clone(), reason };
    let text = std::fs::read_to_string(&path).map_err(|e| read(e.to_string()))?;
    let summary: serde_json::Value = serde_json::from_str(&text).map_err(|e| read(e.to_string()))?;
    let entry = |key: &str| summary.get(key).and_then(|value| value.as_str()).map(str::to_string);
    let file =
        entry("scene_file").ok_or_else(|| read("it is not that of a run; give its scene instead".to_string()))?;
    Ok((PathBuf::from(file), entry("scene_fingerprint")))
}
