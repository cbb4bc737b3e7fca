//! FMUs: a scene as a component for co-simulation hosts, by the FMI standard, versions 2.0 and 3.0.
//!
//! An FMU is a zip file with the description of the variables (`modelDescription.xml`), the shared library of
//! `bindings/fmi`, the scene in `resources/`, and documentation. Library and description agree on the variables through
//! the [`Catalogue`].

mod description;
mod document;

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::error::{Error, Result};
use crate::report::tables::{beside, put_in_place, write_error};
use crate::scene::parameter::Parameter;
use crate::scene::{Document, Scene};
use crate::stepper::Stepper;
use crate::variable::{VARIABLES, Variable};

/// A version of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standard {
    /// FMI 2.0: every entry of an array is a variable of its own.
    Fmi2,
    /// FMI 3.0: arrays, whose sizes follow from the structural parameter `nodes`.
    Fmi3,
}

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

/// The categories of log messages, with what they say.
pub const LOG_CATEGORIES: [(&str, &str); 4] = [
    ("logStatusWarning", "what was done otherwise than asked for"),
    ("logStatusDiscard", "a step that could not be made; the last good state is kept"),
    ("logStatusError", "a call that the standard or the model does not allow"),
    ("logSteps", "every communication step: its internal steps and iterations"),
];

/// The name of the structural parameter.
pub const NODES: &str = "nodes";

/// The variables and parameters of a scene with the value references of both versions.
///
/// FMI 3.0: the place in [`VARIABLES`], or [`PARAMETERS`](Self::PARAMETERS) plus the place among the parameters. FMI 2.0: the
/// same, times 2²⁴ plus the node; so both are looked up by arithmetic.
#[derive(Debug)]
pub struct Catalogue {
    /// The scene's own values.
    pub parameters: Vec<Parameter>,
    exists: Vec<bool>,
}

/// What a value reference stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A variable by its place in [`VARIABLES`], and a node.
    Variable(usize, usize),
    /// A parameter by its place.
    Parameter(usize),
}

/// Bits of a node in a value reference of FMI 2.0.
const NODE_BITS: u32 = 24;

impl Catalogue {
    /// Where the parameters begin; there are fewer variables than that.
    pub const PARAMETERS: u32 = 100;

    /// The catalogue of a scene and its stepper.
    pub fn of(scene: &Scene, stepper: &Stepper) -> Self {
        let exists = VARIABLES.iter().map(|variable| variable.exists_in(stepper.model())).collect();
        Self { parameters: scene.parameters(), exists }
    }

    /// The variables that the scene has, with their places.
    pub fn variables(&self) -> impl Iterator<Item = (usize, &'static Variable)> + '_ {
        VARIABLES.iter().enumerate().filter(|(i, _)| self.exists[*i])
    }

    /// What a reference of FMI 3.0 stands for; the node is 0.
    #[inline]
    pub fn target(&self, reference: u32) -> Option<Target> {
        if (reference as usize) < VARIABLES.len() {
            return self.exists[reference as usize].then_some(Target::Variable(reference as usize, 0));
        }
        let place = reference.checked_sub(Self::PARAMETERS)? as usize;
        (place < self.parameters.len()).then_some(Target::Parameter(place))
    }

    /// What a reference of FMI 2.0 stands for; whether the variable has that node is not looked at.
    #[inline]
    pub fn scalar_target(&self, reference: u32) -> Option<Target> {
        let (place, node) = (reference >> NODE_BITS, (reference & ((1 << NODE_BITS) - 1)) as usize);
        match self.target(if place == Self::PARAMETERS { Self::PARAMETERS + node as u32 } else { place })? {
            Target::Variable(place, _) => Some(Target::Variable(place, node)),
            parameter => Some(parameter),
        }
    }

    /// The reference of a target.
    pub fn reference(standard: Standard, target: Target) -> u32 {
        match (standard, target) {
            (Standard::Fmi3, Target::Variable(place, _)) => place as u32,
            (Standard::Fmi3, Target::Parameter(place)) => Self::PARAMETERS + place as u32,
            (Standard::Fmi2, Target::Variable(place, node)) => (place as u32) << NODE_BITS | node as u32,
            (Standard::Fmi2, Target::Parameter(place)) => Self::PARAMETERS << NODE_BITS | place as u32,
        }
    }
}

/// A scene ready to be written as an FMU.
#[derive(Debug)]
pub struct Fmu<'a> {
    document: &'a Document,
    scene: Scene,
    stepper: Stepper,
    catalogue: Catalogue,
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

    /// What a host must show to get an instance: it names the scene and the version of the program.
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

/// The token of a scene, see [`Fmu::token`].
pub fn token(scene: &Scene) -> String {
    format!("{{{:032x}}}", scene.fingerprint())
}

/// The name of the shared library as cargo builds it.
pub fn library_name() -> String {
    format!("{}caudal_fmi{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX)
}

/// Finds the shared library beside the program `executable`, or in `../lib` of it.
///
/// # Errors
/// [`Error::Fmu`] that says what to do.
pub fn library(executable: &Path) -> Result<PathBuf> {
    let folder = executable.parent().unwrap_or(Path::new("."));
    let places =
        [folder.to_path_buf(), folder.join("../lib"), folder.join("deps")].map(|place| place.join(library_name()));
    places.iter().find(|place| place.is_file()).cloned().ok_or_else(|| {
        Error::Fmu(format!(
            "the library {} is neither in {} nor in ../lib of it; `cargo build --release` in the project's folder \
             makes it, or give its place with --library",
            library_name(),
            folder.display()
        ))
    })
}
