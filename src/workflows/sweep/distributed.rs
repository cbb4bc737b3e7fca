//! Distributed sweeps: the data sent to a worker, and how it runs cases.

use std::sync::atomic::AtomicBool;

use super::case_result::CaseResult;
use super::case_run::run_together;
use super::definition::Sweep;
use crate::batch::WIDTH;
use crate::distributed::Bundle;
use crate::error::{Error, Result};
use crate::jobs;
use crate::scene::Files;
use crate::scene::files::Contents;

/// A sweep on a worker.
#[derive(Debug)]
pub struct SweepWorker {
    sweep: Sweep,
}

impl Sweep {
    /// The sweep, with all files that its cases need.
    ///
    /// # Errors
    /// [`Error::Read`] for a file that no longer exists.
    pub fn bundle(&self) -> Result<Bundle> {
        let tables = self.checked.get().into_iter().flat_map(|checked| &checked.tables);
        let mut files = Contents::new();
        for path in self.own.iter().chain(tables) {
            files.insert(path.clone(), self.files.read(path)?);
        }
        let [path, _] = &self.own;
        Ok(Bundle::of(path.clone(), self.set.clone(), files, ()))
    }
}

impl SweepWorker {
    /// Reads the sweep from the bytes of a [`Bundle`].
    ///
    /// # Errors
    /// Those of [`Bundle::read`] and [`Sweep::read`].
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let Bundle { path, set, files, task: (), .. } = Bundle::read(bytes)?;
        let sweep = Sweep::read_from(&Files::of(files), &path, &set)?;
        Ok(Self { sweep })
    }

    /// Runs the cases `indices`. Returns for each the line for [`Journal::add_line`](jobs::Journal::add_line) in the program that
    /// sent the bundle, and its wall-clock time, s. A failing case also has a line.
    ///
    /// # Errors
    /// [`Error::Bundle`] for a case that the sweep does not have.
    pub fn lines(&self, indices: &[usize]) -> Result<Vec<(Vec<u8>, f64)>> {
        let refused = |index: usize| Error::Bundle { problem: format!("it has no case {index}") };
        if let Some(unknown) = indices.iter().find(|index| **index >= self.sweep.size()) {
            return Err(refused(*unknown));
        }
        // Batches of similar size, because a single remaining case would run alone.
        let together = indices.len().div_ceil(indices.len().div_ceil(WIDTH).max(1)).max(1);
        let rows = indices.chunks(together).flat_map(|some| run_together(&self.sweep, some, &AtomicBool::new(false)));
        let line = |(index, row): (&usize, Option<CaseResult>)| {
            let row = row.ok_or_else(|| refused(*index))?;
            Ok((jobs::line(*index, &row).ok_or_else(|| refused(*index))?, row.wall_s))
        };
        indices.iter().zip(rows).map(line).collect()
    }
}
