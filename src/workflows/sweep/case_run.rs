//! Runs the cases of a sweep, similar ones batched, and stores a result for each.

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde_json::{Map, Value};

use super::case_result::CaseResult;
use super::definition::Sweep;
use crate::assessment::Assessment;
use crate::batch::{Batch, WIDTH};
use crate::error::{Error, Result};
use crate::jobs::{self, Journal};
use crate::report::Summary;
use crate::report::sampling::{self, FrameRecord, fastest_drive};
use crate::report::{DrawnRod, Frame, RecordingTimes, RodMotion};
use crate::run::{BatchedRun, Ending, run_batched};
use crate::scene::Scene;
use crate::stepper::Stepper;

/// Entries of a summary that are omitted from a result: those that differ between runs of the same scene, and lists.
const LEFT_OUT: [&str; 4] = ["name", "caudal_version", "wall_s", "final_positions_m"];

/// Runs the cases `todo` on `threads` threads and adds each result to `journal` immediately; `progress` receives its index and
/// result. Setting `interrupted` aborts all running cases.
///
/// # Errors
/// Those of [`Journal::add`]. A failing case is a result, not an error.
pub fn run(
    sweep: &Sweep,
    journal: &mut Journal,
    todo: &[usize],
    threads: usize,
    interrupted: &AtomicBool,
    mut progress: impl FnMut(usize, CaseResult),
) -> Result<()> {
    // Cases that cannot be batched are run one by one, so that each result is stored when it is done. If every thread has at most
    // one case, this need not be tested.
    let asked = todo.first().filter(|_| todo.len() > threads);
    let first = asked.and_then(|index| Some((*index, Stepper::of(&scene(sweep, *index).ok()?.0).ok()?)));
    let together = if first.as_ref().is_some_and(|(_, stepper)| Batch::takes(stepper)) { WIDTH } else { 1 };
    let first = Mutex::new(first); // built only once: the estimates of a scene may take long
    let made = |index: usize| {
        let mut first = first.lock().unwrap_or_else(PoisonError::into_inner);
        first.take_if(|(own, _)| *own == index).map(|(_, stepper)| stepper)
    };
    let work = |indices: &[usize]| run_cases_with(sweep, indices, interrupted, made);
    jobs::run_chunks(todo, threads, together, work, |index, row| {
        let Some(row) = row else { return Ok(ControlFlow::Break(())) };
        journal.add(index, &row)?;
        progress(index, row);
        Ok(ControlFlow::Continue(()))
    })?;
    journal.sync()
}

/// Runs some cases, similar ones batched; `None` for an interrupted case. The wall-clock time of a result is an equal share of the
/// total time.
pub fn run_together(sweep: &Sweep, indices: &[usize], interrupted: &AtomicBool) -> Vec<Option<CaseResult>> {
    run_cases_with(sweep, indices, interrupted, |_| None)
}

/// Like [`run_together`], with some steppers `made` before.
fn run_cases_with(
    sweep: &Sweep,
    indices: &[usize],
    interrupted: &AtomicBool,
    made: impl Fn(usize) -> Option<Stepper>,
) -> Vec<Option<CaseResult>> {
    let start = Instant::now();
    let scenes: Vec<_> = indices.iter().map(|index| scene(sweep, *index)).collect();
    let mut cases: Vec<CaseRun<'_>> =
        indices.iter().zip(&scenes).map(|(index, scene)| CaseRun::of(sweep, *index, scene)).collect();
    let (mut own, mut runs) = (Vec::new(), Vec::new());
    for (case, index) in cases.iter_mut().zip(indices) {
        if let Some(run) = case.begin(made(*index)) {
            runs.push(run);
            own.push(case);
        }
    }
    let outcomes = run_batched(&mut runs, |i, stepper| {
        own[i].keep(stepper)?;
        Ok(if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    });
    for ((case, BatchedRun { scene, stepper }), outcome) in own.into_iter().zip(&runs).zip(&outcomes) {
        case.row.motion = case.motion.take().map(|motion| motion.finish(stepper, outcome.ending == Ending::Complete));
        if outcome.ending != Ending::Interrupted {
            case.row.quantities = quantities(&Summary::of(scene, stepper, outcome, &case.warnings));
        }
    }
    let part = start.elapsed().as_secs_f64() / indices.len().max(1) as f64;
    let dropped = |row: &CaseResult| interrupted.load(Ordering::Relaxed) && !row.complete();
    let rows = cases.into_iter().map(|case| CaseResult { wall_s: part, ..case.row });
    rows.map(|row| (!dropped(&row)).then_some(row)).collect()
}

/// Relative rounding of the times at the ends of steps.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The scene of a case, and its hash.
type Hashed<'a> = (Cow<'a, Scene>, Cow<'a, str>);

fn scene(sweep: &Sweep, index: usize) -> Result<Hashed<'_>> {
    match sweep.kept(index) {
        Some((scene, hash)) => Ok((Cow::Borrowed(scene), Cow::Borrowed(hash))),
        None => sweep.scene(&sweep.case(index)?).map(|(scene, hash)| (Cow::Owned(scene), Cow::Owned(hash))),
    }
}

/// The record of the motion of a running case.
struct CaseMotion {
    times: RecordingTimes,
    tick: u64,
    rod: DrawnRod,
    frames: FrameRecord,
}

impl CaseMotion {
    /// Starts with the current state: as many `frames` of the run, or of its last periods if they are too few.
    fn start(scene: &Scene, stepper: &Stepper, frames: usize) -> Self {
        let (duration, control) = (scene.solver.duration_s.get(), stepper.step_control());
        let drive = fastest_drive(scene, stepper.model());
        let tick = sampling::tick(duration, drive, control, frames as f64 - 1.0);
        let frames = FrameRecord::start(duration, drive, &(frames..=frames), tick);
        let times = RecordingTimes::sampled(control, tick);
        let mut motion = Self { times, tick: 0, rod: DrawnRod::of(stepper.model()), frames };
        motion.frames.offer(0, || Frame::of(&stepper.view(), motion.rod.nodes()));
        motion
    }

    /// Records the last step.
    fn pass(&mut self, stepper: &mut Stepper) -> Result<()> {
        let Self { times, tick, rod, frames } = self;
        let outcome = times.pass(stepper, |view, _| {
            *tick += 1;
            frames.offer(*tick, || Frame::of(view, rod.nodes()));
            Ok(ControlFlow::Continue(()))
        });
        outcome.map(drop)
    }

    /// The motion: up to the final state, or to the last recorded one of a case that failed.
    fn finish(mut self, stepper: &Stepper, is_complete: bool) -> RodMotion {
        if is_complete {
            self.frames.finish(stepper.time(), || Frame::of(&stepper.view(), self.rod.nodes()));
        }
        self.frames.motion(self.rod)
    }
}

/// A running case.
struct CaseRun<'a> {
    scene: &'a Result<Hashed<'a>>,
    warnings: Vec<String>,
    row: CaseResult,
    motion: Option<CaseMotion>,
    /// Numbers of recorded times of the path of the played motion, and of that of traces.csv.
    wanted: [usize; 2],
    /// Numbers of these times that have passed.
    passed: [usize; 2],
    /// The next time to record, s.
    due: f64,
}

impl<'a> CaseRun<'a> {
    fn of(sweep: &'a Sweep, index: usize, scene: &'a Result<Hashed<'a>>) -> Self {
        let frames = if sweep.plays(index) { sweep.record.frames } else { 0 };
        let wanted = [frames, sweep.record.traces];
        Self { scene, warnings: Vec::new(), row: CaseResult::default(), motion: None, wanted, passed: [0; 2], due: 0.0 }
    }

    /// Starts the run, with a stepper that may be `made` before; if it cannot start, the result has the error.
    fn begin(&mut self, made: Option<Stepper>) -> Option<BatchedRun<'a>> {
        let start = self.scene.as_ref().map_err(Error::clone).and_then(|(scene, hash)| {
            self.row.scene_hash = hash.to_string();
            let mut stepper = made.map_or_else(|| Stepper::of(scene), Ok)?;
            self.warnings = Assessment::of_run(scene, &stepper)?.warnings;
            self.motion = (self.wanted[0] > 0).then(|| CaseMotion::start(scene, &stepper, self.wanted[0]));
            self.keep(&mut stepper)?;
            Ok(BatchedRun { scene, stepper })
        });
        start.map_err(|error| self.fail(&error)).ok()
    }

    fn fail(&mut self, error: &Error) {
        self.row.quantities.insert("complete".to_string(), false.into());
        self.row.quantities.insert("ending".to_string(), error.to_string().into());
    }

    /// Records motion and paths up to the time of `stepper`.
    fn keep(&mut self, stepper: &mut Stepper) -> Result<()> {
        let now = stepper.time();
        let reached_time = now * (1.0 + ROUNDING);
        let Self { row, scene: Ok((scene, _)), motion, wanted, passed, due, .. } = self else { return Ok(()) };
        if let Some(motion) = motion {
            motion.pass(stepper)?;
        }
        if reached_time < *due {
            return Ok(());
        }
        let [frames, points] = wanted.map(|count| move |i: usize| even(scene.solver.duration_s.get(), count, i));
        let reached = (passed[0]..).map_while(&frames).take_while(|time| *time <= reached_time).count();
        if reached > 0 {
            row.path.push([now, stepper.view().metrics.now.com.x]);
            passed[0] += reached;
        }
        while let Some(time) = points(passed[1]).filter(|time| *time <= now) {
            row.trace.push(stepper.at(time, |view| [time, view.metrics.now.com.x, view.metrics.now.com.y])?);
            passed[1] += 1;
        }
        *due = [frames(passed[0]), points(passed[1])].into_iter().flatten().fold(f64::INFINITY, f64::min);
        Ok(())
    }
}

/// Time `i` of `count` equidistant times from 0 to `duration`, s.
fn even(duration: f64, count: usize, i: usize) -> Option<f64> {
    (i < count).then(|| duration * (i as f64 / count.saturating_sub(1).max(1) as f64))
}

/// The scalar quantities of a summary; lists of numbers element by element, notes as one text.
fn quantities(summary: &Summary) -> Map<String, Value> {
    let mut row = Map::new();
    let Ok(Value::Object(entries)) = serde_json::to_value(summary) else { return row };
    for (name, value) in entries.into_iter().filter(|(name, _)| !LEFT_OUT.contains(&name.as_str())) {
        match value {
            Value::Array(items) if items.iter().all(Value::is_string) => {
                let texts: Vec<&str> = items.iter().filter_map(Value::as_str).collect();
                row.insert(name, texts.join("; ").into());
            }
            Value::Array(items) => {
                row.extend(items.into_iter().enumerate().map(|(i, item)| (format!("{name}.{i}"), item)));
            }
            value => drop(row.insert(name, value)),
        }
    }
    row
}
