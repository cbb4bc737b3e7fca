//! Distributed work: jobs whose parts run on workers (Dask, from Python) that share no disk.
//!
//! A worker receives a [`Bundle`]: the scene or sweep, all files that it names, and the task, as bytes. It returns lines with
//! checksums; only the program that sent the bundle writes them to disk.

use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::jobs::BUILD;
use crate::scene::files::Contents;
use crate::scene::{Document, Files};

/// A job whose parts can run on any worker, in any order.
pub trait DistributableJob: Send {
    /// The number of parts.
    fn count(&self) -> usize;

    /// The parts without a result.
    fn pending(&self) -> Vec<usize>;

    /// A description of part `index` for users.
    fn describe(&self, index: usize) -> String;

    /// All data that a worker needs to run any part, see [`Bundle`].
    ///
    /// # Errors
    /// [`Error::Read`] for a file that no longer exists.
    fn bundle(&self) -> Result<Vec<u8>>;

    /// Stores the result of a part that a worker returned as `line`; false if it was stored before.
    ///
    /// # Errors
    /// [`Error::Bundle`] or [`Error::Journal`] for a damaged line; [`Error::Write`].
    fn store(&mut self, line: &[u8]) -> Result<bool>;
}

/// The data sent to a worker: a scene or a sweep with its overrides, all files that it names, and a task, serialised for the same
/// build of the program.
#[derive(Debug, Serialize, Deserialize)]
pub struct Bundle<T = ()> {
    caudal_version: String,
    /// Path of the scene or the sweep, one of `files`.
    pub path: PathBuf,
    /// Its overrides, see [`Document::override_lines`].
    pub set: Vec<String>,
    /// Contents of the scene or sweep and of all files that it names.
    pub files: Contents,
    /// The task.
    pub task: T,
}

impl<T> Bundle<T> {
    /// A bundle of this build of the program.
    pub fn of(path: PathBuf, set: Vec<String>, files: Contents, task: T) -> Self {
        Self { caudal_version: BUILD.to_string(), path, set, files, task }
    }

    /// The bundle of a scene, with the tables that it names and `more` files.
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

    /// The scene and the task.
    ///
    /// # Errors
    /// Those of [`Document::read`].
    pub fn scene(self) -> Result<(Document, T)> {
        let mut document = Document::read_from(Files::of(self.files), &self.path)?;
        document.set_override_lines(self.set.iter().map(String::as_str))?;
        Ok((document, self.task))
    }
}

impl<T: Serialize> Bundle<T> {
    /// Serialises the bundle, for [`read`](Self::read).
    ///
    /// # Errors
    /// [`Error::Bundle`] if it cannot be serialised.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        postcard::to_allocvec(self).map_err(|e| Error::Bundle { problem: e.to_string() })
    }
}

impl<T: DeserializeOwned> Bundle<T> {
    /// Reads [`bytes`](Self::bytes) of the same build of the program.
    ///
    /// # Errors
    /// [`Error::Bundle`] for another build, or damaged bytes.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        let failed = |e: postcard::Error| Error::Bundle { problem: e.to_string() };
        let (version, _): (String, _) = postcard::take_from_bytes(bytes).map_err(failed)?; // the rest may be of another version
        let own = BUILD;
        if version != own {
            return Err(Error::Bundle { problem: format!("it comes from caudal {version}, but this is caudal {own}") });
        }
        postcard::from_bytes(bytes).map_err(failed)
    }
}
