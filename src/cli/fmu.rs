//! `caudal fmu`: packages a scene as an FMU.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use caudal::error::{Error, Result};
use caudal::fmu::{self, Fmu, FmuOptions, Standard};
use clap::ValueEnum;

use super::{SceneArguments, print_unless_quiet};

/// Versions of the FMI standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Version {
    #[value(name = "2")]
    Fmi2,
    #[value(name = "3")]
    Fmi3,
    Both,
}

pub fn fmu(
    arguments: &SceneArguments,
    out: Option<PathBuf>,
    version: Version,
    mut libraries: Vec<PathBuf>,
    choice: FmuOptions,
) -> Result<ExitCode> {
    let (document, scene) = arguments.read()?;
    let fmu = Fmu::of(&document)?.showing(choice)?;
    if libraries.is_empty() {
        let executable = std::env::current_exe().map_err(|error| Error::Fmu(error.to_string()))?;
        libraries.push(fmu::library(&executable)?);
    }
    let out = out.unwrap_or_else(|| PathBuf::from(format!("{}.fmu", scene.name)));
    let targets = match version {
        Version::Fmi2 => vec![(Standard::Fmi2, out)],
        Version::Fmi3 => vec![(Standard::Fmi3, out)],
        Version::Both => {
            vec![(Standard::Fmi2, with_suffix(&out, "-fmi2")), (Standard::Fmi3, with_suffix(&out, "-fmi3"))]
        }
    };
    for (standard, path) in targets {
        fmu.write(standard, &libraries, &path)?;
        let version = if standard == Standard::Fmi2 { "2.0" } else { "3.0" };
        print_unless_quiet(&format!("{}: FMI {version} for co-simulation", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// `tail.fmu` with a suffix of its stem.
fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map_or("fmu".into(), |extension| extension.to_string_lossy());
    path.with_file_name(format!("{stem}{suffix}.{extension}"))
}
