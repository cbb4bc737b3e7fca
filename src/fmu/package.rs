//! Packing: the zip file that a host loads.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::{Catalogue, Standard, description, document, token};
use crate::error::{Error, Result};
use crate::report::tables::{beside, put_in_place, write_error};
use crate::scene::{Document, Scene};
use crate::stepper::Stepper;

/// The platform's folder of binaries in FMI 2.0 and 3.0, and the suffix of its shared libraries.
const PLATFORM: Option<([&str; 2], &str)> = {
    if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        Some((["linux64", "x86_64-linux"], "so"))
    } else if cfg!(all(target_os = "linux", target_arch = "aarch64")) {
        Some((["aarch64-linux", "aarch64-linux"], "so"))
    } else if cfg!(all(target_os = "macos", target_arch = "x86_64")) {
        Some((["darwin64", "x86_64-darwin"], "dylib"))
    } else if cfg!(all(target_os = "macos", target_arch = "aarch64")) {
        Some((["aarch64-darwin", "aarch64-darwin"], "dylib"))
    } else if cfg!(all(target_os = "windows", target_arch = "x86_64")) {
        Some((["win64", "x86_64-windows"], "dll"))
    } else {
        None
    }
};

/// A scene ready to be written as an FMU.
#[derive(Debug)]
pub struct Fmu<'a> {
    document: &'a Document,
    pub(super) scene: Scene,
    pub(super) stepper: Stepper,
    pub(super) catalogue: Catalogue,
}

impl<'a> Fmu<'a> {
    /// Prepares the FMU of a scene.
    ///
    /// # Errors
    /// Those of the scene and of its first state.
    pub fn of(document: &'a Document) -> Result<Self> {
        let scene = document.scene()?;
        let stepper = Stepper::of(&scene)?;
        let catalogue = Catalogue::of(&scene, &stepper);
        Ok(Self { document, scene, stepper, catalogue })
    }

    /// The identifier in C that names the library: the scene's name with `_` for all that C does not allow.
    pub fn identifier(&self) -> String {
        let mut identifier: String =
            self.scene.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if !identifier.starts_with(|c: char| c.is_ascii_alphabetic()) {
            identifier.insert_str(0, "caudal_");
        }
        identifier
    }

    /// See [`token`].
    pub fn token(&self) -> String {
        token(&self.scene)
    }

    /// `modelDescription.xml`.
    ///
    /// # Errors
    /// [`Error::Fmu`].
    pub fn description(&self, standard: Standard) -> Result<String> {
        description::write(self, standard).map_err(|error| Error::Fmu(format!("its description: {error}")))
    }

    /// Writes the FMU with the shared `library` to `path`: the same scene and library, the same bytes.
    ///
    /// # Errors
    /// [`Error::Fmu`], [`Error::Read`], [`Error::Write`].
    pub fn write(&self, standard: Standard, library: &Path, path: &Path) -> Result<()> {
        let Some((folders, suffix)) = PLATFORM else {
            return Err(Error::Fmu("this platform has no name in the FMI standard".to_string()));
        };
        let folder = folders[usize::from(standard == Standard::Fmi3)];
        let binary =
            std::fs::read(library).map_err(|e| Error::Read { path: library.to_path_buf(), reason: e.to_string() })?;
        let mut files = vec![("modelDescription.xml".to_string(), self.description(standard)?.into_bytes())];
        files.push((format!("binaries/{folder}/{}.{suffix}", self.identifier()), binary));
        files.extend(document::files(self).into_iter().map(|(name, text)| (name, text.into_bytes())));
        files.extend(self.document.packed()?.into_iter().map(|(name, bytes)| (format!("resources/{name}"), bytes)));
        let failed = |error: std::io::Error| write_error(path, &error);
        let mut archive = ZipWriter::new(BufWriter::new(beside(path)?));
        for (name, bytes) in files {
            let options = SimpleFileOptions::default()
                .compression_method(CompressionMethod::Deflated)
                .last_modified_time(DateTime::default())
                .unix_permissions(if name.starts_with("binaries") { 0o755 } else { 0o644 });
            archive.start_file(name, options).map_err(|e| failed(e.into()))?;
            archive.write_all(&bytes).map_err(failed)?;
        }
        let file = archive.finish().map_err(|e| failed(e.into()))?.into_inner().map_err(|e| failed(e.into_error()))?;
        put_in_place(file, path.to_path_buf()).map(|_| ())
    }
}

/// The name of the shared library as cargo builds it.
pub fn library_name() -> String {
    format!("{}caudal_fmi{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// Finds the shared library of the program `executable`: beside it, in `../lib` of it, or in the Python package of the
/// environment that it stands in.
///
/// # Errors
/// [`Error::Fmu`] that says what to do.
pub fn library(executable: &Path) -> Result<PathBuf> {
    let folder = executable.parent().unwrap_or(Path::new("."));
    let near = [folder.to_path_buf(), folder.join("../lib"), folder.join("deps")];
    let packages = ["../lib", "../Lib"].map(|lib| folder.join(lib)).into_iter().flat_map(python_packages);
    let place = |folder: PathBuf| folder.join(library_name());
    near.into_iter().chain(packages).map(place).find(|place| place.is_file()).ok_or_else(|| {
        Error::Fmu(format!(
            "the library {} is neither in {} nor in ../lib of it; `cargo build --release` in the project's folder \
             makes it, or give its place with --library",
            library_name(),
            folder.display()
        ))
    })
}

/// Where the Python package may be in the folder `lib` of an environment, in the order of their names.
fn python_packages(lib: PathBuf) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(&lib).into_iter().flatten().flatten();
    let versions = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with("python"));
    let mut roots: Vec<PathBuf> = versions.map(|entry| entry.path()).collect();
    roots.sort();
    roots.push(lib); // Windows has no folder of the version
    let kinds = ["site-packages", "dist-packages"];
    roots.iter().flat_map(|root| kinds.map(|kind| root.join(kind).join("caudal"))).collect()
}
