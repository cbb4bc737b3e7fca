//! The source of a scene's text and tables: files on the disk, or contents in memory.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::{Error, Result};

/// Contents of files by their paths as written in scenes.
pub type Contents = BTreeMap<PathBuf, Vec<u8>>;

/// The disk, or contents of files from elsewhere: from an FMU, or from the machine that distributes the cases of a sweep. Each
/// file is read from disk once, by the first clone that needs it, so that everything built from a scene uses the same bytes.
#[derive(Clone, Default)]
pub struct Files {
    given: Option<Arc<Contents>>,
    /// True if other files are read from the disk.
    over_disk: bool,
    read: Arc<Mutex<Contents>>,
}

impl PartialEq for Files {
    /// True if both refer to the disk, or hold the same contents.
    fn eq(&self, other: &Self) -> bool {
        self.given == other.given && self.over_disk == other.over_disk
    }
}

impl fmt::Debug for Files {
    /// Omits the contents, which are represented in a scene by their hash.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.given.is_some() { "Files(given)" } else { "Files(disk)" })
    }
}

impl Files {
    /// Only these files.
    pub fn of(contents: Contents) -> Self {
        Self { given: Some(Arc::new(contents)), ..Self::default() }
    }

    /// These files, and the disk for all others.
    pub fn over_disk(contents: Contents) -> Self {
        Self { over_disk: true, ..Self::of(contents) }
    }

    /// The content of the file at `path`, if held in memory.
    fn in_memory(&self, path: &Path) -> Option<Result<&Vec<u8>>> {
        let contents = self.given.as_ref()?;
        match contents.get(path) {
            Some(content) => Some(Ok(content)),
            None if self.over_disk => None,
            None => Some(Err(Error::Read {
                path: path.to_path_buf(),
                reason: "it was not sent with the scene".to_string(),
            })),
        }
    }

    /// The content of the file at `path`.
    ///
    /// # Errors
    /// [`Error::Read`] if it does not exist or cannot be read.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        if let Some(content) = self.in_memory(path) {
            return content.cloned();
        }
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(content) = read.get(path) {
            return Ok(content.clone());
        }
        let content =
            std::fs::read(path).map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() })?;
        read.insert(path.to_path_buf(), content.clone());
        Ok(content)
    }

    /// The text of the file at `path`.
    ///
    /// # Errors
    /// Errors of [`read`](Self::read); [`Error::Read`] if it is not UTF-8.
    pub fn text(&self, path: &Path) -> Result<String> {
        let failed = |reason: String| Error::Read { path: path.to_path_buf(), reason };
        String::from_utf8(self.read(path)?).map_err(|e| failed(format!("it is not UTF-8 text: {e}")))
    }

    /// The size of the file at `path`, bytes.
    ///
    /// # Errors
    /// Errors of [`read`](Self::read).
    pub fn size(&self, path: &Path) -> Result<u64> {
        match self.in_memory(path) {
            Some(content) => Ok(content?.len() as u64),
            None => std::fs::metadata(path)
                .map(|found| found.len())
                .map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() }),
        }
    }
}
