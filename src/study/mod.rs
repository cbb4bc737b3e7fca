//! Studies of a scene: what a user asks before trusting a run. Each makes [`Findings`].
//!
//! A study is a list of independent runs and what follows from their results. The runs are kept in a journal in its folder
//! until all are there, so that a study goes on where it was interrupted.

mod accuracy;
mod modes;
mod scaling;
mod stability;
mod trial;

use std::fmt::Debug;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::jobs::{self, Job, Journal};
use crate::report::Findings;
use crate::scene::Scene;
pub use accuracy::{Accuracy, accuracy};
pub use modes::modes;
pub use scaling::{Scaling, scaling};
pub use stability::{Stability, Vary, stability};

/// Ending of the names of the files in which a study keeps its runs until it is complete.
const JOURNAL: &str = ".journal";

/// What is known of a study while it goes on, and where its results are kept.
#[derive(Clone, Copy)]
pub struct Desk<'a> {
    /// The study's folder.
    pub folder: &'a Path,
    /// Raised from outside to interrupt it.
    pub interrupted: &'a AtomicBool,
    /// Told how many runs of how many are there.
    pub progress: &'a (dyn Fn(usize, usize) + Sync),
}

/// How a study ended.
#[derive(Debug)]
pub enum Studied {
    /// With these findings.
    Complete(Findings),
    /// Interrupted, with this many runs of so many kept.
    Interrupted(usize, usize),
}

impl Desk<'_> {
    /// Makes every run of `runs`, called `name`, of `scene`, on `threads` threads, or takes it from the journal;
    /// results in the order of `runs`. A run that is interrupted returns `None`.
    ///
    /// # Errors
    /// [`Error::Write`], [`Error::Journal`].
    fn work<R: Debug + Sync, T: Serialize + DeserializeOwned + Send>(
        &self,
        name: &str,
        scene: &Scene,
        runs: &[R],
        threads: usize,
        run: impl Fn(&R) -> Option<T> + Sync,
    ) -> Result<std::result::Result<Vec<T>, Studied>> {
        let failed = |e: std::io::Error| Error::Write { path: self.folder.to_path_buf(), reason: e.to_string() };
        std::fs::create_dir_all(self.folder).map_err(failed)?;
        let path = self.folder.join(format!("{name}{JOURNAL}"));
        let job = Job::new(name, format!("{scene:?} {runs:?}").as_bytes(), runs.len());
        if Journal::read(&path).is_ok_and(|journal| job.difference(journal.job()).is_some()) {
            std::fs::remove_file(&path).map_err(failed)?; // of a study that asked for something else
        }
        let mut journal = Journal::open(&path, &job)?;
        let todo: Vec<usize> = (0..runs.len()).filter(|index| !journal.has(*index)).collect();
        let mut done = runs.len() - todo.len();
        (self.progress)(done, runs.len());
        jobs::run(
            &todo,
            threads,
            |index| run(&runs[index]),
            |index, result| {
                if let Some(result) = result {
                    journal.add(index, result)?;
                    done += 1;
                    (self.progress)(done, runs.len());
                }
                let stop = self.interrupted.load(Ordering::Relaxed);
                Ok(if stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
            },
        )?;
        let results = (0..runs.len()).filter_map(|index| journal.get(index).transpose()).collect::<Result<Vec<T>>>()?;
        if results.len() < runs.len() {
            return Ok(Err(Studied::Interrupted(results.len(), runs.len())));
        }
        Ok(Ok(results))
    }

    fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

/// Removes the journals of a study whose findings are written.
pub fn forget(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().ends_with(JOURNAL) {
            let _ = std::fs::remove_file(entry.path()); // of use to nobody, and of no harm
        }
    }
}

/// The exponent p and factor c of the least-squares fit y ≈ c xᵖ; `None` for fewer than two different x.
fn power_law(points: &[(f64, f64)]) -> Option<[f64; 2]> {
    let logs: Vec<_> = points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|p| (p.0.ln(), p.1.ln())).collect();
    let count = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let across: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let along: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    (logs.len() > 1 && along > 0.0).then(|| [across / along, (y - across / along * x).exp()])
}
