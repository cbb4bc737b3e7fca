//! Packages an FMU: the zip file that a host loads, with shared libraries for each platform.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::catalogue::Standard;
use super::component::Fmu;
use super::{documentation, terminals};
use crate::error::{Error, Result};
use crate::files::{write_atomically, write_error};
use crate::wording::Phrase;

/// The folders of binaries in FMI 2.0 and 3.0 for the platform of a shared library, and its suffix.
fn platform(library: &[u8]) -> Option<([&'static str; 2], &'static str)> {
    let two = |place: usize| library.get(place..place + 2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
    let four = |place: usize| {
        library.get(place..place + 4).map(|bytes| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    if library.starts_with(b"\x7fELF") {
        return match two(18)? {
            0x3e => Some((["linux64", "x86_64-linux"], "so")),
            0xb7 => Some((["aarch64-linux", "aarch64-linux"], "so")),
            _ => None,
        };
    }
    if four(0)? == 0xfeed_facf {
        return match four(4)? {
            0x0100_0007 => Some((["darwin64", "x86_64-darwin"], "dylib")),
            0x0100_000c => Some((["aarch64-darwin", "aarch64-darwin"], "dylib")),
            _ => None,
        };
    }
    if library.starts_with(b"MZ") {
        let header = four(0x3c)? as usize;
        return match (library.get(header..header + 4)?, two(header + 4)?) {
            (b"PE\0\0", 0x8664) => Some((["win64", "x86_64-windows"], "dll")),
            (b"PE\0\0", 0xaa64) => Some((["aarch64-windows", "aarch64-windows"], "dll")),
            _ => None,
        };
    }
    None
}

impl Fmu<'_> {
    /// Writes the FMU with shared `libraries`, one per platform, to `path`. The same scene and libraries give the same bytes.
    ///
    /// # Errors
    /// [`Error::Fmu`], [`Error::Read`], [`Error::Write`].
    pub fn write(&self, standard: Standard, libraries: &[PathBuf], path: &Path) -> Result<()> {
        let wrong = |error: std::io::Error| Error::Fmu(format!("its description: {error}"));
        if self.options.nodes.is_some() && self.has_arrays(standard) {
            let problem = "arrays of FMI 3.0 have all nodes; allowed: a choice of nodes with FMI 2.0 or plain FMI 3.0";
            return Err(Error::Fmu(problem.to_string()));
        }
        let mut files = vec![("modelDescription.xml".to_string(), self.description(standard)?.into_bytes())];
        for library in libraries {
            let binary =
                std::fs::read(library).map_err(|e| Error::Read { path: library.clone(), reason: e.to_string() })?;
            let Some((folders, suffix)) = platform(&binary) else {
                let problem = "not a shared library for Linux, macOS or Windows on x86_64 or aarch64";
                return Err(Error::Fmu(format!("{}: {problem}", library.display())));
            };
            let folder = folders[usize::from(standard == Standard::Fmi3)];
            let name = format!("binaries/{folder}/{}.{suffix}", self.identifier());
            if files.iter().any(|(other, _)| *other == name) {
                return Err(Error::Fmu(format!("{}: a second library for {folder}", library.display())));
            }
            files.push((name, binary));
        }
        match standard {
            Standard::Fmi2 => files.push(("model.png".to_string(), terminals::ICON.to_vec())),
            Standard::Fmi3 => {
                let list = terminals::write(self).map_err(wrong)?;
                files.push(("terminalsAndIcons/terminalsAndIcons.xml".to_string(), list));
                files.push(("terminalsAndIcons/icon.png".to_string(), terminals::ICON.to_vec()));
            }
        }
        files.extend(documentation::files(self).into_iter().map(|(name, text)| (name, text.into_bytes())));
        files.extend(self.document.packed()?.into_iter().map(|(name, bytes)| (format!("resources/{name}"), bytes)));
        let failed = |error: std::io::Error| write_error(path, &error);
        write_atomically(path, |file| {
            let mut archive = ZipWriter::new(BufWriter::new(file));
            for (name, bytes) in files {
                let options = SimpleFileOptions::default()
                    .compression_method(CompressionMethod::Deflated)
                    .last_modified_time(DateTime::default())
                    .unix_permissions(if name.starts_with("binaries") { 0o755 } else { 0o644 });
                archive.start_file(name, options).map_err(|e| failed(e.into()))?;
                archive.write_all(&bytes).map_err(failed)?;
            }
            archive.finish().map_err(|e| failed(e.into()))?.flush().map_err(failed)
        })
    }
}

/// The file name of the shared library that cargo builds.
pub fn library_name() -> String {
    format!("{}caudal_fmi{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// Finds the shared library for the program `executable`: in its folder, in `../lib`, or in the Python package of its
/// environment.
///
/// # Errors
/// [`Error::Fmu`] with advice.
pub fn library(executable: &Path) -> Result<PathBuf> {
    let folder = executable.parent().unwrap_or(Path::new("."));
    let near = [folder.to_path_buf(), folder.join("../lib"), folder.join("deps")];
    let packages = ["../lib", "../Lib"].map(|lib| folder.join(lib)).into_iter().flat_map(python_packages);
    let place = |folder: PathBuf| folder.join(library_name());
    near.into_iter().chain(packages).map(place).find(|place| place.is_file()).ok_or_else(|| {
        Error::Fmu(format!(
            "the library {} is neither in {} nor in ../lib of it; build it with `cargo build --release` in the project's folder, or give its path with {}",
            library_name(),
            folder.display(),
            Phrase::Library
        ))
    })
}

/// The folders that may contain the Python package in the folder `lib` of an environment, in alphabetical order.
fn python_packages(lib: PathBuf) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(&lib).into_iter().flatten().flatten();
    let versions = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("python"));
    let mut roots: Vec<PathBuf> = versions.map(|entry| entry.path()).collect();
    roots.sort();
    roots.push(lib); // Windows has no versioned folder
    let kinds = ["site-packages", "dist-packages"];
    roots.iter().flat_map(|root| kinds.map(|kind| root.join(kind).join("caudal"))).collect()
}
