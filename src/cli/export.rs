//! `caudal export`: converts results to PNG, PDF, VTK, and films as SVG, GIF and MP4.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use caudal::error::{Error, Result};
use caudal::report::film::{FilmRecord, FilmSettings, FilmedMotion};
use caudal::report::picture::{self, PictureFormat};
use caudal::report::sampling::fastest_drive;
use caudal::report::trajectory::TrajectoryTable;
use caudal::report::vtk;
use caudal::report::{Claim, Folder, MANIFEST, Owner, VTK_FOLDER, recorded_overrides};
use caudal::run::{Ending, run as run_scene};
use clap::{ArgGroup, Args};

use super::progress::{Progress, Unit};
use super::run::watch_for_interrupts;
use super::{SceneArguments, exit, output_folder, print_error, print_unless_quiet, print_written, refuse};

#[derive(Debug, Args)]
#[command(group(ArgGroup::new("what").args(["film", "vtk", "png", "pdf", "gif", "mp4"]).required(true).multiple(true)))]
pub struct ExportArguments {
    /// The folder of a run, or a scene; for --png and --pdf any folder with figures
    run: PathBuf,
    /// A film to write: .svg, an animated picture; .gif; or .mp4, by the program ffmpeg. It replaces an earlier film
    film: Option<PathBuf>,
    /// The overrides that the run was made with [default: those that its report.html shows]
    #[arg(long, value_name = "TABLE.KEY=VALUE")]
    set: Vec<String>,
    /// Write NAME.pvd and a .vtp file per recorded time, for ParaView and other programs that read VTK
    #[arg(long)]
    vtk: bool,
    /// Turn the figures of the folder into PNG files
    #[arg(long)]
    png: bool,
    /// Turn the figures of the folder into PDF files
    #[arg(long)]
    pdf: bool,
    /// Write NAME.gif, a film of the moving body
    #[arg(long)]
    gif: bool,
    /// Write NAME.mp4, the same by the program ffmpeg
    #[arg(long)]
    mp4: bool,
    /// Replace files of the same names that were made of other results, or not by caudal
    #[arg(long)]
    force: bool,
    /// Folder for the files [default: the run's, or out/<name of the scene>; of --vtk its folder vtk; of FILM the current one]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The fields of --vtk, variables by name [default: those of nodes and joints, and all of trajectory.csv]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    fields: Option<Vec<String>>,
    /// The figures of --png and --pdf [default: all in the folder]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    figures: Option<Vec<String>>,
    /// Pictures per second of a .gif or .mp4 [default: 25]
    #[arg(long, value_name = "NUMBER")]
    fps: Option<u32>,
    /// Seconds of the run per second of a film [default: what makes the motion easy to see]
    #[arg(long, value_name = "FACTOR")]
    speed: Option<f64>,
    /// First time of a film, s [default: that of the last cycle of a periodic run, or of the run]
    #[arg(long, value_name = "SECONDS")]
    from: Option<f64>,
    /// Last time of a film, s [default: that of the last cycle of a periodic run, or of the run]
    #[arg(long, value_name = "SECONDS")]
    until: Option<f64>,
}

impl ExportArguments {
    /// The formats to which figures are converted.
    fn formats(&self) -> Vec<PictureFormat> {
        let all = [(self.png, PictureFormat::Png), (self.pdf, PictureFormat::Pdf)];
        all.into_iter().filter_map(|(wanted, format)| wanted.then_some(format)).collect()
    }

    /// The extensions of the films that are named after the scene.
    fn named_films(&self) -> impl Iterator<Item = &'static str> {
        [(self.gif, "gif"), (self.mp4, "mp4")].into_iter().filter_map(|(wanted, ending)| wanted.then_some(ending))
    }

    fn makes_film(&self) -> bool {
        self.film.is_some() || self.named_films().next().is_some()
    }

    /// The settings of the films.
    fn film(&self) -> FilmSettings {
        let FilmSettings { sharpness, window: [first, last], .. } = FilmSettings::default();
        let window = [self.from.unwrap_or(first), self.until.unwrap_or(last)];
        FilmSettings { per_second: self.fps, speed: self.speed, sharpness, window, claim: Claim::forced(self.force) }
    }

    /// Converts the figures of `folder`.
    fn convert(&self, folder: &Path) -> Result<ExitCode> {
        let out = self.out.as_deref().unwrap_or(folder);
        let kept = picture::convert(folder, self.figures.as_deref(), &self.formats(), out, Claim::forced(self.force))?;
        let last = kept.files.last().and_then(|path| path.file_name()).unwrap_or_default();
        Ok(print_written(&kept, out, &last.to_string_lossy()))
    }
}

/// Figures are read from the folder. For all other exports the run is repeated with bit-identical results, because its tables
/// contain neither velocities nor moments.
pub fn export(arguments: &ExportArguments) -> Result<ExitCode> {
    for (name, time) in [("from", arguments.from), ("until", arguments.until)] {
        if let Some(time) = time.filter(|time| !time.is_finite()) {
            print_error(&format!("--{name}: found {time}; allowed: a finite number"));
            return Ok(ExitCode::from(exit::WRONG_INPUT));
        }
        if time.is_some() && !arguments.makes_film() {
            print_error(&format!(
                "--{name}: found without a film; allowed with the name of one, --gif or --mp4, as it cuts films alone"
            ));
            return Ok(ExitCode::from(exit::WRONG_INPUT));
        }
    }
    if !arguments.run.exists() {
        let reason = "there is no such folder or scene; `caudal run SCENE` makes the folder of a run".to_string();
        return Ok(refuse(&Error::Read { path: arguments.run.clone(), reason }));
    }
    let folder = arguments.run.is_dir().then_some(arguments.run.as_path());
    let mut whole = ExitCode::SUCCESS;
    if let Some(folder) = folder.filter(|_| !arguments.formats().is_empty()) {
        whole = arguments.convert(folder)?;
        if !arguments.vtk && !arguments.makes_film() {
            return Ok(whole);
        }
    }
    let SummaryExcerpt { file, fingerprint, end } = match folder {
        None => SummaryExcerpt { file: arguments.run.clone(), fingerprint: None, end: None },
        Some(folder) => match summary(folder) {
            Ok(found) => found,
            Err(error) => return Ok(refuse(&error)),
        },
    };
    // A run is repeated with its own overrides, unless others are given.
    let set = match folder {
        Some(folder) if arguments.set.is_empty() => recorded_overrides(folder),
        _ => arguments.set.clone(),
    };
    let scene = SceneArguments { scene: file.clone(), set };
    let (_, scene, mut stepper) = scene.prepare()?;
    if let Some(fingerprint) = fingerprint.filter(|fingerprint| *fingerprint != scene.fingerprint_text()) {
        print_error(&format!(
            "{}: the run is of another scene than {} is now ({fingerprint}); --set gives the overrides that it was made with",
            arguments.run.display(),
            file.display()
        ));
        return Ok(ExitCode::from(exit::WRONG_INPUT));
    }
    let own = folder.map_or_else(|| output_folder(&scene), Path::to_path_buf);
    let film = arguments.film();
    let films: Vec<PathBuf> = {
        let place = arguments.out.as_ref().unwrap_or(&own);
        let named = arguments.named_films().map(|ending| place.join(format!("{}.{ending}", scene.name)));
        let film = arguments.film.as_ref();
        named.chain(film.map(|film| arguments.out.as_ref().map_or(film.clone(), |out| out.join(film)))).collect()
    };
    // A run that ended before its duration is repeated up to there.
    let run = [stepper.time(), end.unwrap_or(scene.solver.duration_s.get())];
    let drive = fastest_drive(&scene, stepper.model());
    let owner = || Owner::of("export", &scene);
    let claim = Claim::forced(arguments.force);
    let place_of = |path: &Path| path.parent().unwrap_or(&own).to_path_buf();
    // A folder of results lists its films; other folders get no list.
    let is_listed = |path: &PathBuf| arguments.film.as_ref() != Some(path) || place_of(path).join(MANIFEST).exists();
    for path in &films {
        let listed = || if is_listed(path) { Folder::admit_export(path, owner(), claim) } else { Ok(()) };
        if let Err(error) = film.check(path, run, drive).and_then(|()| listed()) {
            return Ok(refuse(&error));
        }
        if let Some(warning) = film.warning(path, drive) {
            print_unless_quiet(&format!("note: {warning}"));
        }
    }
    if let Some(end) = end {
        let run = arguments.run.display();
        print_unless_quiet(&format!("note: the run in {run} ended at t = {end} s, and so do its exports"));
    } else if let Some(until) = arguments.until.filter(|until| *until > run[1]) {
        print_unless_quiet(&format!("note: --until {until}: the run ends at t = {} s, and so do its films", run[1]));
    }
    if folder.is_none() && !arguments.formats().is_empty() {
        whole = arguments.convert(&own)?;
    }
    let fields = match &arguments.fields {
        None => vtk::fields(&stepper),
        named => vtk::POSITIONS.map(str::to_string).into_iter().chain(named.iter().flatten().cloned()).collect(),
    };
    let table = || TrajectoryTable::start(&scene, &stepper, Some(&fields));
    let mut trajectory = arguments.vtk.then(table).transpose()?;
    let start = |path: &PathBuf| FilmRecord::start(&film, path, &scene, &mut stepper, run[1]);
    let mut records = films.iter().map(start).collect::<Result<Vec<_>>>()?;
    let interrupted = watch_for_interrupts();
    let raised =
        || if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
    let progress = Progress::of(Unit::SimulatedSeconds, scene.solver.duration_s.get());
    let outcome = run_scene(&scene, &mut stepper, |stepper| {
        progress.set(stepper.time());
        records.iter_mut().try_for_each(|record| record.step(stepper))?;
        let flow = match &mut trajectory {
            Some(trajectory) => trajectory.step(stepper, &mut || raised())?,
            None => raised(),
        };
        Ok(if end.is_some_and(|end| stepper.time() >= end) { ControlFlow::Break(()) } else { flow })
    });
    drop(progress);
    let is_interrupted = outcome.ending == Ending::Interrupted && raised().is_break();
    if is_interrupted {
        let films = if films.is_empty() { "" } else { ": no film is made of a part of the run" };
        print_error(&format!("interrupted at t = {} s{films}", stepper.time()));
    }
    if let Some(mut trajectory) = trajectory {
        trajectory.finish(&stepper);
        let out = arguments.out.clone().unwrap_or_else(|| own.join(VTK_FOLDER));
        let mut held = Folder::export(&out, owner(), claim)?;
        let kept = vtk::write(&mut held, &scene.name, &stepper.model().rod, trajectory.columns())?;
        whole = print_written(&kept, &out, &format!("{}.pvd", scene.name));
    }
    // The reason of a failure stands before what is said of the films of what was simulated.
    if let Ending::Failed(error) = &outcome.ending {
        print_error(&error.to_string());
        whole = ExitCode::from(exit::FAILED);
    }
    let cycle = stepper.cycles().whole(f64::INFINITY).last().map(|cycle| [cycle.from, cycle.until]);
    let simulated = [run[0], stepper.time()];
    let mut is_any_written = arguments.vtk;
    for (path, record) in films.into_iter().zip(records).filter(|_| !is_interrupted) {
        let motion = record.finish(&stepper);
        let motion = FilmedMotion { name: &scene.name, motion: &motion, cycle, drive };
        let make = || {
            film.check(&path, simulated, drive)?; // what is chosen may be after the end of a run that failed
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let folder = is_listed(&path).then(|| Folder::export(&place_of(&path), owner(), claim));
            let mut held = folder.transpose()?;
            if let Some(held) = &mut held {
                held.exports().admit(&name)?;
                held.let_others();
            }
            let excerpt = film.excerpt(&path, &motion)?;
            let pictures = excerpt.pictures as f64;
            let progress = Progress::of(Unit::Exactly("pictures"), pictures);
            let drawn = film.write(&path, &motion, &excerpt, |part| {
                progress.set((part * pictures).round());
                raised()
            });
            drop(progress);
            let _ = held.as_mut().map(Folder::relock); // its list is removed with it if no film was written
            drawn.map(|()| excerpt)
        };
        match make() {
            Ok(excerpt) => {
                is_any_written = true;
                print_unless_quiet(&format!("{} was written: {excerpt}", path.display()));
            }
            Err(Error::Interrupted) => {
                let kept = if path.exists() { "; the earlier one is kept" } else { "" };
                print_error(&format!("interrupted: {} was not written{kept}", path.display()));
                return Ok(ExitCode::from(exit::INTERRUPTED));
            }
            // The other films are made.
            Err(error) => {
                print_error(&error.to_string());
                whole = ExitCode::from(exit::FAILED);
            }
        }
    }
    if matches!(outcome.ending, Ending::Failed(_)) && is_any_written {
        print_unless_quiet("what was computed until then is there");
    }
    Ok(if is_interrupted { ExitCode::from(exit::INTERRUPTED) } else { whole })
}

/// What the summary of a run says of it.
struct SummaryExcerpt {
    /// The file of its scene.
    file: PathBuf,
    fingerprint: Option<String>,
    /// The time that it reached, if that is not its duration, s.
    end: Option<f64>,
}

/// What the summary of the run in `folder` says of it.
fn summary(folder: &Path) -> Result<SummaryExcerpt> {
    let path = folder.join("summary.json");
    let read = |reason: String| Error::Read { path: path.clone(), reason };
    let text = std::fs::read_to_string(&path).map_err(|e| read(e.to_string()))?;
    let summary: serde_json::Value = serde_json::from_str(&text).map_err(|e| read(e.to_string()))?;
    let entry = |key: &str| summary.get(key).and_then(|value| value.as_str()).map(str::to_string);
    let file =
        entry("scene_file").ok_or_else(|| read("it is not that of a run; give its scene instead".to_string()))?;
    let end = summary.get("end_time_s").and_then(serde_json::Value::as_f64);
    let is_part = summary.get("complete") == Some(&serde_json::Value::Bool(false));
    Ok(SummaryExcerpt {
        file: PathBuf::from(file),
        fingerprint: entry("scene_fingerprint"),
        end: end.filter(|_| is_part),
    })
}
