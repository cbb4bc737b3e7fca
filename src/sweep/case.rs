//! One case: run to its end, or to its failure, and put down as a row.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Sweep;
use crate::check::Assessment;
use crate::error::Result;
use crate::jobs::{self, Journal};
use crate::report::Frame;
use crate::run::{Ending, Summary, run as run_scene};
use crate::stepper::Stepper;

/// Entries of a summary that a row leaves out: what every run of the same scene does not repeat to the bit, and what is no
/// single quantity.
const LEFT_OUT: [&str; 4] = ["name", "caudal_version", "wall_s", "final_positions_m"];

/// What came out of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Hash of its scene, with all that the axes changed.
    pub scene_hash: String,
    /// The quantities of its summary; of a case that could not start only `complete` and `ending`, its error.
    pub quantities: Map<String, Value>,
    /// Its motion, if that is kept.
    pub frames: Vec<Frame>,
    /// Time (s) and centre of mass (m) along its path, if that is kept.
    pub trace: Vec<[f64; 3]>,
    /// Time it took, s.
    pub wall_s: f64,
}

impl Row {
    /// True where the case reached its end.
    pub fn complete(&self) -> bool {
        self.quantities.get("complete") == Some(&Value::Bool(true))
    }

    /// How it ended: "complete", or its error.
    pub fn ending(&self) -> &str {
        self.quantities.get("ending").and_then(Value::as_str).unwrap_or_default()
    }
}

/// Runs the cases of `todo` on `threads` threads and adds each to `journal` the moment it is done; `progress` sees it
/// then. Raising `interrupted` ends all at once: cases under way are dropped.
///
/// # Errors
/// Those of [`Journal::add`]. A case that fails is a row.
pub fn run(
    sweep: &Sweep,
    journal: &mut Journal,
    todo: &[usize],
    threads: usize,
    interrupted: &AtomicBool,
    mut progress: impl FnMut(&Row),
) -> Result<()> {
    let work = |index| row(sweep, index, interrupted);
    jobs::run(todo, threads, work, |index, row| {
        let Some(row) = row else { return Ok(ControlFlow::Break(())) };
        journal.add(index, &row)?;
        progress(&row);
        Ok(ControlFlow::Continue(()))
    })?;
    journal.sync()
}

/// The row of a case; none where it was interrupted.
pub fn row(sweep: &Sweep, index: usize, interrupted: &AtomicBool) -> Option<Row> {
    let start = Instant::now();
    let mut row =
        Row { scene_hash: String::new(), quantities: Map::new(), frames: Vec::new(), trace: Vec::new(), wall_s: 0.0 };
    let outcome = fill(&mut row, sweep, index, interrupted);
    if interrupted.load(Ordering::Relaxed) && !row.complete() {
        return None;
    }
    if let Err(error) = outcome {
        row.quantities.insert("complete".to_string(), false.into());
        row.quantities.insert("ending".to_string(), error.to_string().into());
    }
    row.wall_s = start.elapsed().as_secs_f64();
    Some(row)
}

fn fill(row: &mut Row, sweep: &Sweep, index: usize, interrupted: &AtomicBool) -> Result<()> {
    let made;
    let (scene, hash) = match sweep.kept(index) {
        Some(kept) => kept,
        None => {
            made = sweep.scene(&sweep.case(index)?)?;
            (&made.0, &made.1[..])
        }
    };
    row.scene_hash = hash.to_string();
    let mut stepper = Stepper::of(scene)?;
    let warnings = Assessment::of(scene, &stepper)?.warnings;
    let duration = scene.solver.duration_s.get();
    // The times wanted, evenly over the run, of which so many are kept already.
    let frame_time = |kept: usize| sweep.plays(index).then(|| even(duration, sweep.record.frames, kept)).flatten();
    let trace_time = |kept: usize| even(duration, sweep.record.traces, kept);
    let keep = |row: &mut Row, stepper: &mut Stepper| {
        while let Some(time) = frame_time(row.frames.len()).filter(|time| *time <= stepper.time()) {
            row.frames.push(stepper.at(time, Frame::of)?);
        }
        while let Some(time) = trace_time(row.trace.len()).filter(|time| *time <= stepper.time()) {
            row.trace.push(stepper.at(time, |view| [time, view.meter.now.com.x, view.meter.now.com.y])?);
        }
        Ok(())
    };
    keep(row, &mut stepper)?;
    let outcome = run_scene(scene, &mut stepper, |stepper| {
        keep(row, stepper)?;
        Ok(if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    });
    if outcome.ending != Ending::Interrupted {
        row.quantities = quantities(&Summary::of(scene, &stepper, &outcome, &warnings));
    }
    Ok(())
}

/// Time number `i` of `count` times from 0 to `duration`, s.
fn even(duration: f64, count: usize, i: usize) -> Option<f64> {
    (i < count).then(|| duration * (i as f64 / count.saturating_sub(1).max(1) as f64))
}

/// The single quantities of a summary, lists of numbers one by one, notes as one text.
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
