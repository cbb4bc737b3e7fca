//! Distributed studies: workers execute the runs of a study, whose results are stored in the study's folder.
//!
//! A study requests the same runs each time. A worker therefore starts the same study, takes the results of earlier runs from its
//! bundle, and executes the requested runs.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use super::definition::Study;
use super::runner::{CachedResults, PendingRuns, Plan, RunRequest, StudyOutcome, StudyRunner, locked};
use crate::distributed::{Bundle, DistributableJob};
use crate::error::{Error, Result};
use crate::report::{Claim, Folder};
use crate::scene::Document;

/// The runs that a study needs next, and the stored results of earlier ones.
#[derive(Debug)]
pub struct DistributedStudy {
    study: Study,
    document: Document,
    known: CachedResults,
    next: PendingRuns,
    _folder: Folder, // dropped last: it is removed if it is empty
}

impl DistributedStudy {
    /// The next runs of `study` on the scene of `document`, with results in `folder`. `None` if no run is missing, so that
    /// [`Study::run`] only evaluates them.
    ///
    /// # Errors
    /// [`Error::Study`] for a study that cannot be distributed; those of [`Study::run`].
    pub fn of(study: &Study, document: &Document, folder: &Path) -> Result<Option<Self>> {
        if let Study::Modes(_) | Study::Scaling(_) = study {
            let problem = format!(
                "{}: found with an engine; allowed with one: accuracy, fluid, stability, whose runs do not depend on each other",
                study.name()
            );
            return Err(Error::Study { problem });
        }
        let plan = Mutex::new(Plan::default());
        let scene = document.scene()?;
        let folder = Mutex::new(study.claim(&scene, folder, Claim::Own)?);
        study.run(&scene, StudyRunner::new(&folder, &AtomicBool::new(false), &|_, _| ()).deferred(&plan))?;
        let folder = folder.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Plan { known, next } = std::mem::take(&mut *locked(&plan));
        Ok(next.map(|next| Self { study: study.clone(), document: document.clone(), known, next, _folder: folder }))
    }
}

impl DistributableJob for DistributedStudy {
    fn count(&self) -> usize {
        self.next.descriptions.len()
    }

    fn pending(&self) -> Vec<usize> {
        (0..self.count()).filter(|index| !self.next.journal.has(*index)).collect()
    }

    fn describe(&self, index: usize) -> String {
        self.next.descriptions.get(index).cloned().unwrap_or_default()
    }

    fn bundle(&self) -> Result<Vec<u8>> {
        Bundle::of_scene(&self.document, Vec::new(), (&self.study, &self.known))?.bytes()
    }

    fn store(&mut self, line: &[u8]) -> Result<bool> {
        Ok(self.next.journal.add_line(line)?.1)
    }
}

/// Executes the runs `indices` of a study in a [`Bundle`]; returns their lines for [`DistributableJob::store`] and the wall-clock time
/// of each, s.
///
/// # Errors
/// Those of [`Bundle::read`]; [`Error::Bundle`] for a run that the study does not have.
pub fn make_runs(bundle: &[u8], indices: &[usize]) -> Result<Vec<(Vec<u8>, f64)>> {
    let (document, (study, known)) = Bundle::<(Study, CachedResults)>::read(bundle)?.scene()?;
    let request = RunRequest { known, indices: indices.to_vec(), ..RunRequest::default() };
    let (interrupted, progress) = (AtomicBool::new(false), |_, _| ());
    let runner = StudyRunner::for_request(&request, &interrupted, &progress);
    match study.run(&document.scene()?, runner)? {
        StudyOutcome::Interrupted(..) => Ok(std::mem::take(&mut *locked(&request.made))),
        StudyOutcome::Complete(_) => Err(Error::Bundle { problem: "the study needs no runs".to_string() }),
    }
}
