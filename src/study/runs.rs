//! The runs of a study, wherever they are made: what comes back is kept in the study's folder, and the study goes on from there.
//!
//! A study asks for the same runs each time, so a program elsewhere begins the same study, takes the results of earlier runs
//! from what was sent along, and makes those that it is asked for.

use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

use super::desk::{Errand, Known, Next, Plan, locked};
use super::{Desk, Studied, Study};
use crate::error::{Error, Result};
use crate::parts::Parts;
use crate::report::{Claim, Folder};
use crate::scene::{Document, Parcel};

/// The runs that a study needs next, with those of them that its folder has.
#[derive(Debug)]
pub struct Runs {
    study: Study,
    document: Document,
    known: Known,
    next: Next,
    _folder: Folder, // the last one to be dropped: it goes where nothing came into it
}

impl Runs {
    /// Those of `study` on the scene of `document`, whose results go to `folder`; `None` where all runs are there, and
    /// [`Study::make`] has only to say what follows.
    ///
    /// # Errors
    /// [`Error::Study`] for a study of this machine itself; those of [`Study::make`].
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
        study.make(&scene, Desk::new(&folder, &AtomicBool::new(false), &|_, _| ()).planning(&plan))?;
        let folder = folder.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Plan { known, next } = std::mem::take(&mut *locked(&plan));
        Ok(next.map(|next| Self { study: study.clone(), document: document.clone(), known, next, _folder: folder }))
    }
}

impl Parts for Runs {
    fn count(&self) -> usize {
        self.next.words.len()
    }

    fn todo(&self) -> Vec<usize> {
        (0..self.count()).filter(|index| !self.next.journal.has(*index)).collect()
    }

    fn describe(&self, index: usize) -> String {
        self.next.words.get(index).cloned().unwrap_or_default()
    }

    fn parcel(&self) -> Result<Vec<u8>> {
        Parcel::of_scene(&self.document, Vec::new(), (&self.study, &self.known))?.bytes()
    }

    fn keep(&mut self, line: &[u8]) -> Result<bool> {
        Ok(self.next.journal.add_line(line)?.1)
    }
}

/// Makes the runs `indices` of a study that came as bytes; their lines for [`Runs::keep`], and the time that each took, s.
///
/// # Errors
/// Those of [`Parcel::read`]; [`Error::Parcel`] for a run that the study has not.
pub fn make_runs(parcel: &[u8], indices: &[usize]) -> Result<Vec<(Vec<u8>, f64)>> {
    let (document, (study, known)) = Parcel::<(Study, Known)>::read(parcel)?.scene()?;
    let errand = Errand { known, indices: indices.to_vec(), ..Errand::default() };
    let (interrupted, progress) = (AtomicBool::new(false), |_, _| ());
    let desk = Desk::serving(&errand, &interrupted, &progress);
    match study.make(&document.scene()?, desk)? {
        Studied::Interrupted(..) => Ok(std::mem::take(&mut *locked(&errand.made))),
        Studied::Complete(_) => Err(Error::Parcel { problem: "the study needs no runs".to_string() }),
    }
}
