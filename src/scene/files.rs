//! Where the text of a scene and the tables that it names are read from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{Error, Result};

/// Files by their paths, as the scenes that name them write these.
pub type Contents = BTreeMap<PathBuf, Vec<u8>>;

/// The disk, or the contents of files that came from elsewhere: in an FMU, or from the machine that hands out the cases
/// of a sweep.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Files(Option<Arc<Contents>>);

impl Files {
    /// These files and no others.
    pub fn of(contents: Contents) -> Self {
        Self(Some(Arc::new(contents)))
    }

    /// The content of the file at `path`.
    ///
    /// # Errors
    /// [`Error::Read`] where there is none, or it cannot be read.
    pub fn read(&self, path: &Path) -> Result<Vec<u8>> {
        let failed = |reason: String| Error::Read { path: path.to_path_buf(), reason };
        match &self.0 {
            Some(contents) => contents.get(path).cloned().ok_or_else(|| failed("it was not sent along".to_string())),
            None => std::fs::read(path).map_err(|e| failed(e.to_string())),
        }
    }

    /// The text of the file at `path`.
    ///
    /// # Errors
    /// Those of [`read`](Self::read); [`Error::Read`] where it is not UTF-8.
    pub fn text(&self, path: &Path) -> Result<String> {
        let failed = |reason: String| Error::Read { path: path.to_path_buf(), reason };
        String::from_utf8(self.read(path)?).map_err(|e| failed(format!("it is not UTF-8 text: {e}")))
    }

    /// The size of the file at `path`, bytes.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn size(&self, path: &Path) -> Result<u64> {
        match &self.0 {
            Some(_) => Ok(self.read(path)?.len() as u64),
            None => std::fs::metadata(path)
                .map(|found| found.len())
                .map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() }),
        }
    }
}
