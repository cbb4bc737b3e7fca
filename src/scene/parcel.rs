//! A scene or a sweep on its way to other machines, with all that is needed to run it there and no disk in common.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::files::Contents;
use crate::error::{Error, Result};

/// A file with its overrides and all files that it names, as bytes for the same version of the program elsewhere.
#[derive(Debug, Serialize, Deserialize)]
pub struct Parcel {
    caudal_version: String,
    /// The scene or the sweep, one of `files`.
    pub path: PathBuf,
    /// Its overrides.
    pub set: Vec<String>,
    /// It and the files that it names.
    pub files: Contents,
}

impl Parcel {
    /// Of this version of the program.
    pub fn of(path: PathBuf, set: Vec<String>, files: Contents) -> Self {
        Self { caudal_version: env!("CARGO_PKG_VERSION").to_string(), path, set, files }
    }

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
        if parcel.caudal_version != own {
            let problem = format!("it comes from caudal {}, and this is caudal {own}", parcel.caudal_version);
            return Err(Error::Parcel { problem });
        }
        Ok(parcel)
    }
}
