//! Where the runs of a study are made and kept.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::Studied;
use crate::error::{Error, Result};
use crate::jobs::{self, Job, Journal};
use crate::report::{Folder, JOURNAL};
use crate::scene::Scene;

/// What is known of a study while it goes on, and where its results are kept.
#[derive(Clone, Copy)]
pub struct Desk<'a> {
    /// None where the runs are made for another program.
    folder: Option<&'a Mutex<Folder>>,
    pub(super) interrupted: &'a AtomicBool,
    progress: &'a (dyn Fn(usize, usize) + Sync),
    makers: Makers<'a>,
}

/// Who makes the runs.
#[derive(Clone, Copy)]
enum Makers<'a> {
    /// Threads of this program.
    Threads,
    /// Programs elsewhere: the study ends at the first runs that lack.
    Others(&'a Mutex<Plan>),
    /// This program, for another one.
    This(&'a Errand),
}

/// How far a study gets with the runs that its folder has.
#[derive(Debug, Default)]
pub(super) struct Plan {
    /// The results of the runs before, as JSON, by their name.
    pub known: Known,
    /// The runs that come next.
    pub next: Option<Next>,
}

/// Results of a study's runs, as JSON, by the runs' name.
pub(super) type Known = BTreeMap<String, String>;

/// Runs some of which lack.
#[derive(Debug)]
pub(super) struct Next {
    pub journal: Journal,
    /// Each in words.
    pub words: Vec<String>,
}

/// Some runs of a study for another program.
#[derive(Debug, Default)]
pub(super) struct Errand {
    /// The results of the runs before.
    pub known: Known,
    pub indices: Vec<usize>,
    /// Their lines, and the time that each took, s.
    pub made: Mutex<Vec<(Vec<u8>, f64)>>,
}

impl<'a> Desk<'a> {
    /// A study's folder ([`Study::claim`](super::Study::claim)); `interrupted`, raised from outside, interrupts it; `progress` is told
    /// how many runs of how many are there.
    pub fn new(
        folder: &'a Mutex<Folder>,
        interrupted: &'a AtomicBool,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        Self { folder: Some(folder), interrupted, progress, makers: Makers::Threads }
    }

    /// The same for runs that are made elsewhere.
    pub(super) fn planning(self, plan: &'a Mutex<Plan>) -> Self {
        Self { makers: Makers::Others(plan), ..self }
    }

    /// One without a folder, for runs that another program asks for.
    pub(super) fn serving(
        errand: &'a Errand,
        interrupted: &'a AtomicBool,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        Self { folder: None, interrupted, progress, makers: Makers::This(errand) }
    }

    /// Makes every run of `runs`, called `name`, of `scene`, on `threads` threads, or takes it from the journal;
    /// results in the order of `runs`. A run that is interrupted returns `None`.
    ///
    /// # Errors
    /// [`Error::Write`], [`Error::Journal`].
    pub(super) fn work<R: Debug + Sync, T: Serialize + DeserializeOwned + Send>(
        &self,
        name: &str,
        scene: &Scene,
        runs: &[R],
        threads: usize,
        run: impl Fn(&R) -> Option<T> + Sync,
    ) -> Result<std::result::Result<Vec<T>, Studied>> {
        if let Makers::This(errand) = self.makers {
            return errand.work(name, runs, run);
        }
        let Some(folder) = self.folder else {
            return Err(Error::Parcel { problem: "it has no folder for its runs".to_string() });
        };
        let path = locked(folder).journal(&format!("{name}{JOURNAL}"))?;
        let failed = |e: std::io::Error| Error::Write { path: path.clone(), reason: e.to_string() };
        let job = Job::new(name, format!("{scene:?} {runs:?}").as_bytes(), runs.len());
        if Journal::read(&path).is_ok_and(|journal| job.difference(journal.job()).is_some()) {
            std::fs::remove_file(&path).map_err(failed)?; // of a study that asked for something else
        }
        let mut journal = Journal::open(&path, &job)?;
        let todo: Vec<usize> = (0..runs.len()).filter(|index| !journal.has(*index)).collect();
        let mut done = runs.len() - todo.len();
        (self.progress)(done, runs.len());
        if let Makers::Others(plan) = self.makers
            && !todo.is_empty()
        {
            let words = runs.iter().map(|run| format!("{run:?}")).collect();
            locked(plan).next = Some(Next { journal, words });
            return Ok(Err(Studied::Interrupted(done, runs.len())));
        }
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
        if let Makers::Others(plan) = self.makers {
            let told = serde_json::to_string(&results).map_err(|e| Error::Parcel { problem: e.to_string() })?;
            locked(plan).known.insert(name.to_string(), told);
        }
        Ok(Ok(results))
    }

    pub(super) fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

impl Errand {
    /// The results of `runs` where they are known; else makes those that are asked for, and the study ends.
    fn work<R, T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        runs: &[R],
        run: impl Fn(&R) -> Option<T>,
    ) -> Result<std::result::Result<Vec<T>, Studied>> {
        let refused = |problem: String| Error::Parcel { problem };
        if let Some(known) = self.known.get(name) {
            return serde_json::from_str(known).map(Ok).map_err(|e| refused(e.to_string()));
        }
        for index in &self.indices {
            let begun = Instant::now();
            let asked = runs.get(*index).ok_or_else(|| refused(format!("it has no run {index}")))?;
            let line = run(asked).and_then(|result| jobs::line(*index, result));
            let line = line.ok_or_else(|| refused(format!("run {index} cannot be told")))?;
            locked(&self.made).push((line, begun.elapsed().as_secs_f64()));
        }
        Ok(Err(Studied::Interrupted(0, runs.len())))
    }
}

/// What is in a lock, whatever became of others who had it.
pub(super) fn locked<T>(lock: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
