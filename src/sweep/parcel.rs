//! A sweep on its way to other machines, and its cases there.

use std::sync::atomic::AtomicBool;

use super::{Row, Sweep, row};
use crate::error::{Error, Result};
use crate::jobs;
use crate::scene::files::Contents;
use crate::scene::{Files, Parcel};

/// A sweep that came in a [`Parcel`].
#[derive(Debug)]
pub struct Unpacked {
    sweep: Sweep,
}

impl Sweep {
    /// It and all that its cases need.
    ///
    /// # Errors
    /// [`Error::Read`] for a file that is no longer there.
    pub fn parcel(&self) -> Result<Parcel> {
        let tables = self.checked.get().into_iter().flat_map(|checked| &checked.tables);
        let mut files = Contents::new();
        for path in self.own.iter().chain(tables) {
            files.insert(path.clone(), self.files.read(path)?);
        }
        let [path, _] = &self.own;
        Ok(Parcel::of(path.clone(), self.set.clone(), files, ()))
    }
}

impl Unpacked {
    /// The sweep of a [`Parcel`] as bytes.
    ///
    /// # Errors
    /// Those of [`Parcel::read`] and [`Sweep::read`].
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let Parcel { path, set, files, task: (), .. } = Parcel::read(bytes)?;
        let sweep = Sweep::read_from(&Files::of(files), &path, &set)?;
        Ok(Self { sweep })
    }

    /// Runs case `index`; returns its line for [`Journal::add_line`](jobs::Journal::add_line) of the program that sent the
    /// parcel, and the time that it took, s. A case that fails is a line too.
    ///
    /// # Errors
    /// [`Error::Parcel`] for a case that the sweep has not.
    pub fn line(&self, index: usize) -> Result<(Vec<u8>, f64)> {
        let refused = || Error::Parcel { problem: format!("it has no case {index}") };
        let known = index < self.sweep.size();
        let row: Row = known.then(|| row(&self.sweep, index, &AtomicBool::new(false))).flatten().ok_or_else(refused)?;
        Ok((jobs::line(index, &row).ok_or_else(refused)?, row.wall_s))
    }
}
