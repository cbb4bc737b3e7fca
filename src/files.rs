//! Atomic writes: a file is written under a temporary name next to its path and then renamed, so that readers never see a partial
//! file. Also free disk space, and folders that are removed if nothing was written to them.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use tempfile::{Builder, NamedTempFile};

use crate::error::{Error, Result};

/// The error of writing `path`.
pub fn write_error(path: &Path, error: &std::io::Error) -> Error {
    Error::Write { path: path.to_path_buf(), reason: error.to_string() }
}

/// A temporary file next to `path`, removed unless it is persisted. It is locked while this program lives, so that others can
/// distinguish it from one left by a killed program.
pub fn partial_file(path: &Path) -> Result<NamedTempFile> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let prefix = format!(".{name}.");
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(PARTIAL);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666)); // reduced by the umask, like any file
    let file = builder.tempfile_in(folder).map_err(|e| write_error(folder, &e))?;
    let _ = file.as_file().try_lock(); // not all file systems support locks
    Ok(file)
}

/// Extension of temporary files, whose names begin with a dot.
pub const PARTIAL: &str = ".partial";

/// Created folders, innermost first; those that are empty are removed when this is dropped.
#[derive(Debug, Default)]
pub struct CreatedFolders(Vec<PathBuf>);

impl CreatedFolders {
    /// Creates the folder at `path` and its parents, if missing.
    ///
    /// # Errors
    /// [`Error::Write`].
    pub fn at(path: &Path) -> Result<Self> {
        let missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let made = Self(path.ancestors().take_while(missing).map(Path::to_path_buf).collect());
        if !made.0.is_empty() {
            std::fs::create_dir_all(path).map_err(|e| write_error(path, &e))?;
        }
        Ok(made)
    }

    /// The existing folder at `path`, treated as if it had been created here.
    pub fn adopted(path: &Path) -> Self {
        Self(vec![path.to_path_buf()])
    }
}

impl Drop for CreatedFolders {
    fn drop(&mut self) {
        for folder in &self.0 {
            let _ = std::fs::remove_dir(folder); // removes empty folders only
        }
    }
}

/// Free space, bytes, on the disk of `folder` or of its first existing parent; `None` if the system does not report it.
pub fn free_space(folder: &Path) -> Option<u64> {
    #[cfg(unix)]
    {
        let disk = rustix::fs::statvfs(existing(folder)).ok()?;
        Some(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
    #[cfg(not(unix))]
    {
        let _ = folder;
        None
    }
}

/// The innermost existing folder among `folder` and its parents.
fn existing(folder: &Path) -> &Path {
    let found = folder.ancestors().find(|folder| folder.as_os_str().is_empty() || folder.exists());
    found.filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The files of a result, and the errors of those that could not be written.
#[derive(Debug, Default)]
pub struct WrittenFiles {
    /// The files that were written.
    pub files: Vec<PathBuf>,
    /// The errors of the others.
    pub lost: Vec<Error>,
}

impl WrittenFiles {
    /// The files, or one error if any file is missing.
    ///
    /// # Errors
    /// The first error, with the number of others.
    pub fn complete(self) -> Result<Vec<PathBuf>> {
        let others = self.lost.len().saturating_sub(1);
        match self.lost.into_iter().next() {
            None => Ok(self.files),
            Some(Error::Write { path, reason }) if others > 0 => {
                Err(Error::Write { path, reason: format!("{reason}; the same applies to {others} other files") })
            }
            Some(error) => Err(error),
        }
    }
}

/// Writes `content` to `path` atomically, and creates its folder if missing.
///
/// # Errors
/// [`Error::Write`].
pub fn write_file(path: &Path, content: impl AsRef<[u8]>) -> Result<()> {
    write_atomically(path, |file| fill(file, path, content.as_ref()))
}

/// Writes what `write` produces to `path` atomically, through a temporary file next to it.
///
/// # Errors
/// [`Error::Write`]; errors of `write`.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut NamedTempFile) -> Result<()>) -> Result<()> {
    let _made = path.parent().map(CreatedFolders::at).transpose()?;
    let mut file = partial_file(path)?;
    write(&mut file)?;
    persist(file, path.to_path_buf()).map(|_| ())
}

/// Renames a finished file to its path.
pub fn persist(file: NamedTempFile, path: PathBuf) -> Result<PathBuf> {
    file.persist(&path).map_err(|e| write_error(&path, &e.error))?;
    Ok(path)
}

/// A temporary file with `content` next to `path`.
pub fn partial_file_with(path: &Path, content: impl AsRef<[u8]>) -> Result<NamedTempFile> {
    let mut file = partial_file(path)?;
    fill(&mut file, path, content.as_ref())?;
    Ok(file)
}

/// A temporary file next to `path` with `value` as JSON, streamed rather than held in memory as text.
pub fn partial_json_file(path: &Path, value: &impl Serialize) -> Result<NamedTempFile> {
    let mut file = partial_file(path)?;
    let mut out = BufWriter::new(file.as_file_mut());
    let written = serde_json::to_writer_pretty(&mut out, value).map_err(std::io::Error::from);
    written.and_then(|()| out.write_all(b"\n")).and_then(|()| out.flush()).map_err(|e| write_error(path, &e))?;
    drop(out);
    Ok(file)
}

fn fill(file: &mut NamedTempFile, path: &Path, content: &[u8]) -> Result<()> {
    file.as_file_mut().write_all(content).map_err(|e| write_error(path, &e))
}
