//! A scene or a sweep on its way to other machines, with all that is needed to run it there and no disk in common.

use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::files::Contents;
use super::{Document, Files};
use crate::error::{Error, Result};
use crate::jobs::BUILD;

/// A file with its overrides and all files that it names, as bytes for the same build of the program elsewhere.
#[derive(Debug, Serialize, Deserialize)]
pub struct Parcel<T = ()> {
    caudal_version: String,
    /// The scene or the sweep, one of `files`.
    pub path: PathBuf,
    /// Its overrides, see [`Document::override_lines`].
    pub set: Vec<String>,
    /// It and the files that it names.
    pub files: Contents,
    /// What is to be done with it.
    pub task: T,
}

impl<T> Parcel<T> {
    /// Of this version of the program.
    pub fn of(path: PathBuf, set: Vec<String>, files: Contents, task: T) -> Self {
        Self { caudal_version: BUILD.to_string(), path, set, files, task }
    }

    /// That of a scene, with the tables that it names and `more` files.
    ///
    /// # Errors
    /// Those of [`Document::scene`]; [`Error::Read`] for a file that is no longer there.
    pub fn of_scene(document: &Document, more: Vec<PathBuf>, task: T) -> Result<Self> {
        let scene = document.scene()?;
        let path = scene.folder.join(scene.file().file_name().unwrap_or_default());
        let mut files = Contents::from([(path.clone(), document.text().as_bytes().to_vec())]);
        for file in scene.files().into_iter().chain(more) {
            let content = scene.read_from.read(&file)?;
            files.insert(file, content);
        }
        Ok(Self::of(path, document.override_lines(), files, task))
    }

    /// The scene, and what is to be done with it.
    ///
    /// # Errors
    /// Those of [`Document::read`].
    pub fn scene(self) -> Result<(Document, T)> {
        let mut document = Document::read_from(Files::of(self.files), &self.path)?;
        document.set_override_lines(self.set.iter().map(String::as_str))?;
        Ok((document, self.task))
    }
}

impl<T: Serialize> Parcel<T> {
    /// As bytes, for [`read`](Self::read).
    ///
    /// # Errors
    /// [`Error::Parcel`] where it cannot be written so.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        postcard::to_allocvec(self).map_err(|e| Error::Parcel { problem: e.to_string() })
    }
}

impl<T: DeserializeOwned> Parcel<T> {
    /// From [`bytes`](Self::bytes) of the same version of the program.
    ///
    /// # Errors
    /// [`Error::Parcel`] where it is of another version, or damaged.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let failed = |e: postcard::Error| Error::Parcel { problem: e.to_string() };
        let (version, _): (String, _) = postcard::take_from_bytes(bytes).map_err(failed)?; // what follows may be others'
        let own = BUILD;
        if version != own {
            return Err(Error::Parcel { problem: format!("it comes from caudal {version}, and this is caudal {own}") });
        }
        postcard::from_bytes(bytes).map_err(failed)
    }
}
