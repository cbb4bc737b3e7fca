//! Executes the runs of a study, on threads or as a worker of another program, and caches their results in the study's journal.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::jobs::{self, Job, Journal};
use crate::report::{Findings, Folder, JOURNAL};
use crate::scene::Scene;

/// How a study ended.
#[derive(Debug)]
pub enum StudyOutcome {
    /// All runs are evaluated.
    Complete(Findings),
    /// Interrupted; the numbers of stored and of all runs.
    Interrupted(usize, usize),
}

/// Executes the runs that a study asks for and caches their results in its output folder.
#[derive(Clone, Copy)]
pub struct StudyRunner<'a> {
    /// `None` on a worker.
    folder: Option<&'a Mutex<Folder>>,
    pub(super) interrupted: &'a AtomicBool,
    progress: &'a (dyn Fn(usize, usize) + Sync),
    executor: Executor<'a>,
}

/// Where the runs are executed.
#[derive(Clone, Copy)]
enum Executor<'a> {
    /// On threads of this program.
    Threads,
    /// On workers: the study stops at the first missing runs and leaves them in the plan.
    Deferred(&'a Mutex<Plan>),
    /// In this program, which is a worker of another one.
    Worker(&'a RunRequest),
}

/// The cached results of a study, and the runs that are still missing.
#[derive(Debug, Default)]
pub(super) struct Plan {
    /// The results of earlier runs.
    pub known: CachedResults,
    /// The runs that are needed next.
    pub next: Option<PendingRuns>,
}

/// Results of a study's earlier runs as JSON, by the name of each list of runs.
pub(super) type CachedResults = BTreeMap<String, String>;

/// A list of runs, some of which are missing.
#[derive(Debug)]
pub(super) struct PendingRuns {
    pub journal: Journal,
    /// A description of each run.
    pub descriptions: Vec<String>,
}

/// The runs of a study that a worker executes.
#[derive(Debug, Default)]
pub(super) struct RunRequest {
    /// The results of earlier runs.
    pub known: CachedResults,
    pub indices: Vec<usize>,
    /// The journal lines of the executed runs, and the wall-clock time of each, s.
    pub made: Mutex<Vec<(Vec<u8>, f64)>>,
}

impl<'a> StudyRunner<'a> {
    /// A runner for a study's folder ([`Study::claim`](super::definition::Study::claim)). Setting `interrupted` interrupts it;
    /// `progress` receives the numbers of finished and of all runs.
    pub fn new(
        folder: &'a Mutex<Folder>,
        interrupted: &'a AtomicBool,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        Self { folder: Some(folder), interrupted, progress, executor: Executor::Threads }
    }

    /// The same runner, but missing runs are left to workers.
    pub(super) fn deferred(self, plan: &'a Mutex<Plan>) -> Self {
        Self { executor: Executor::Deferred(plan), ..self }
    }

    /// A runner without a folder, for the runs that another program requests.
    pub(super) fn for_request(
        request: &'a RunRequest,
        interrupted: &'a AtomicBool,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        Self { folder: None, interrupted, progress, executor: Executor::Worker(request) }
    }

    /// Executes `runs` of `scene` on `threads` threads, or takes them from the journal `name`; returns results in the order of
    /// `runs`. `run` returns `None` if it was interrupted.
    ///
    /// # Errors
    /// [`Error::Write`], [`Error::Journal`].
    pub(super) fn run_all<R: Debug + Sync, T: Serialize + DeserializeOwned + Send>(
        &self,
        name: &str,
        scene: &Scene,
        runs: &[R],
        threads: usize,
        run: impl Fn(&R) -> Option<T> + Sync,
    ) -> Result<std::result::Result<Vec<T>, StudyOutcome>> {
        if let Executor::Worker(request) = self.executor {
            return request.run_all(name, runs, run);
        }
        let Some(folder) = self.folder else {
            return Err(Error::Bundle { problem: "it has no folder for its runs".to_string() });
        };
        let path = locked(folder).journal(&format!("{name}{JOURNAL}"))?;
        let failed = |e: std::io::Error| Error::Write { path: path.clone(), reason: e.to_string() };
        let job = Job::new(name, format!("{scene:?} {runs:?}").as_bytes(), runs.len());
        if Journal::read(&path).is_ok_and(|journal| job.difference(journal.job()).is_some()) {
            std::fs::remove_file(&path).map_err(failed)?; // of a study with other runs
        }
        let mut journal = Journal::open(&path, &job)?;
        let todo: Vec<usize> = (0..runs.len()).filter(|index| !journal.has(*index)).collect();
        let mut done = runs.len() - todo.len();
        (self.progress)(done, runs.len());
        if let Executor::Deferred(plan) = self.executor
            && !todo.is_empty()
        {
            let descriptions = runs.iter().map(|run| format!("{run:?}")).collect();
            locked(plan).next = Some(PendingRuns { journal, descriptions });
            return Ok(Err(StudyOutcome::Interrupted(done, runs.len())));
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
            return Ok(Err(StudyOutcome::Interrupted(results.len(), runs.len())));
        }
        if let Executor::Deferred(plan) = self.executor {
            let told = serde_json::to_string(&results).map_err(|e| Error::Bundle { problem: e.to_string() })?;
            locked(plan).known.insert(name.to_string(), told);
        }
        Ok(Ok(results))
    }

    pub(super) fn interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }
}

impl RunRequest {
    /// The cached results of `runs`; if some are missing, executes the requested ones and ends the study.
    fn run_all<R, T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        runs: &[R],
        run: impl Fn(&R) -> Option<T>,
    ) -> Result<std::result::Result<Vec<T>, StudyOutcome>> {
        let refused = |problem: String| Error::Bundle { problem };
        if let Some(known) = self.known.get(name) {
            return serde_json::from_str(known).map(Ok).map_err(|e| refused(e.to_string()));
        }
        for index in &self.indices {
            let begun = Instant::now();
            let asked = runs.get(*index).ok_or_else(|| refused(format!("it has no run {index}")))?;
            let line = run(asked).and_then(|result| jobs::line(*index, result));
            let line = line.ok_or_else(|| refused(format!("the result of run {index} cannot be written as JSON")))?;
            locked(&self.made).push((line, begun.elapsed().as_secs_f64()));
        }
        Ok(Err(StudyOutcome::Interrupted(0, runs.len())))
    }
}

/// The content of a lock, even if another thread panicked while holding it.
pub(super) fn locked<T>(lock: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
