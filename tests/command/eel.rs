//! A small swimmer that runs in a moment, and the command in the folder of its scene.

use std::path::Path;
use std::process::{Command, Output};

/// 20 steps per period of 0.2 s.
pub const EEL: &str = r#"
name = "eel"
[rod]
nodes = 5
length_m = 1.0
outer_radius_m = 0.02
youngs_modulus_pa = 5e6
density_kg_m3 = 1150.0
[actuation]
kind = "travelling-wave"
kappa_amp = 3.0
frequency_hz = 5.0
wavelength_m = 1.0
[medium]
viscosity_pa_s = 0.8
density_kg_m3 = 1200.0
[drag]
law = "cross-flow"
[solver]
integrator = "newmark"
time_step_s = 1e-2
duration_s = 0.6
"#;

/// A folder with the scene eel.toml of this `text`.
pub fn place(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("eel.toml"), text).unwrap();
    folder
}

/// The command with these arguments in a folder.
pub fn caudal(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(folder).args(arguments).output().unwrap()
}

/// What the command prints where it succeeds.
pub fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = caudal(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// What the command says on its error output.
pub fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
