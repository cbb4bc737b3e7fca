//! A sweep on its way to other machines: all that is needed to run its cases there, with no disk in common.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::{Row, Sweep, row};
use crate::error::{Error, Result};
use crate::jobs::{self, Job};
use crate::scene::Files;
use crate::scene::files::Contents;

/// A sweep with its base scene and the tables of all its cases, for programs elsewhere.
#[derive(Debug, Serialize, Deserialize)]
pub struct Parcel {
    /// What its cases are the results of, and the version that must run them.
    pub job: Job,
    path: PathBuf,
    set: Vec<String>,
    files: Contents,
}

/// A sweep that came in a [`Parcel`].
#[derive(Debug)]
pub struct Unpacked {
    sweep: Sweep,
}

impl Sweep {
    /// It and all that the cases of `job`, its own, need.
    ///
    /// # Errors
    /// [`Error::Read`] for a file that is no longer there.
    pub fn parcel(&self, job: &Job) -> Result<Parcel> {
        let tables = self.checked.get().into_iter().flat_map(|checked| &checked.tables);
        let mut files = Contents::new();
        for path in self.own.iter().chain(tables) {
            files.insert(path.clone(), self.files.read(path)?);
        }
        let [path, _] = &self.own;
        Ok(Parcel { job: job.clone(), path: path.clone(), set: self.set.clone(), files })
    }
}

impl Parcel {
    /// As bytes, for [`read`](Self::read).
    ///
    /// # Errors
    /// [`Error::Parcel`] where it cannot be written so.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        postcard::to_allocvec(self).map_err(|e| Error::Parcel { problem: e.to_string() })
    }

    /// From [`bytes`](Self::bytes) of the same version of the program.
    ///
    /// # Errors
    /// [`Error::Parcel`] where it is of another version, or damaged.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let parcel: Self = postcard::from_bytes(bytes).map_err(|e| Error::Parcel { problem: e.to_string() })?;
        let own = env!("CARGO_PKG_VERSION");
        if parcel.job.caudal_version != own {
            let problem = format!("it comes from caudal {}, and this is caudal {own}", parcel.job.caudal_version);
            return Err(Error::Parcel { problem });
        }
        Ok(parcel)
    }

    /// The sweep in it.
    ///
    /// # Errors
    /// Those of [`Sweep::read`].
    pub fn unpack(self) -> Result<Unpacked> {
        let sweep = Sweep::read_from(&Files::of(self.files), &self.path, &self.set)?;
        Ok(Unpacked { sweep })
    }
}

impl Unpacked {
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
