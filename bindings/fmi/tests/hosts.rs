//! Today's hosts and checkers load the FMUs and see the stepper's own trajectory: FMPy, fmutool, ecos, libcosim, rust-fmi.
//!
//! The first four are Python packages, set up in `target/hosts` from `requirements.txt`; `rust-host` is built in
//! `target/rust-host`. What is not there (Python, libclang, a network the first time) the tests say that they skipped; with
//! `CAUDAL_HOSTS=required`, as in continuous integration, they fail.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a failure ends the test")]

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use caudal::fmu::Standard;
use caudal::scene::Document;
use caudal::stepper::Stepper;
use common::{document, write};

/// The Python that has the hosts; set up where it is not there yet.
fn python() -> Result<PathBuf, String> {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let wanted = std::fs::read_to_string(tests.join("requirements.txt")).unwrap();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/hosts");
    let (python, done) = (folder.join("bin/python"), folder.join("requirements.txt"));
    if std::fs::read_to_string(&done).is_ok_and(|there| there == wanted) {
        return Ok(python);
    }
    let run = |command: &mut Command, advice: &str| match command.output() {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => Err(format!("{}\n{advice}", String::from_utf8_lossy(&output.stderr))),
        Err(error) => Err(format!("{error}\n{advice}")),
    };
    let advice = "install Python 3 with its venv module (Debian: apt-get install python3-venv)";
    run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder), advice)?;
    let advice = "the packages of bindings/fmi/tests/requirements.txt must be within reach of pip";
    run(
        Command::new(&python).args(["-m", "pip", "install", "--quiet", "-r"]).arg(tests.join("requirements.txt")),
        advice,
    )?;
    std::fs::write(&done, wanted).map_err(|error| error.to_string())?;
    Ok(python)
}

/// Fails where the hosts are required, else says what was not tried.
fn skip(what: &str, reason: &str) {
    assert!(std::env::var("CAUDAL_HOSTS").as_deref() != Ok("required"), "{what}: {reason}");
    eprintln!("SKIPPED: {what}: {reason}");
}

/// The values of `tip_y_m` after each of `count` steps.
fn tips(document: &Document, step: f64, count: usize) -> Vec<f64> {
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    let mut after = || {
        stepper.do_step(step).unwrap();
        stepper.get_scalar("tip_y_m").unwrap()
    };
    (0..count).map(|_| after()).collect()
}

#[test]
fn a_rust_host_sees_the_stepper_s_trajectory() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/rust-host/Cargo.toml");
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/rust-host");
    let mut build = Command::new(env!("CARGO"));
    build.args(["build", "--quiet", "--locked", "--manifest-path"]).arg(package).env("CARGO_TARGET_DIR", &target);
    let built = build.output().unwrap();
    if !built.status.success() {
        let advice = "it needs libclang (Debian: apt-get install libclang-dev) and crates.io";
        return skip("rust-fmi", &format!("{}\n{advice}", String::from_utf8_lossy(&built.stderr)));
    }
    let folder = tempfile::tempdir().unwrap();
    for model in ["baseline-smooth", "driven-head"] {
        let document = document(model, &[]);
        let expected: Vec<_> = tips(&document, 0.01, 20).iter().map(|tip| tip.to_bits().to_string()).collect();
        for standard in [Standard::Fmi2, Standard::Fmi3] {
            let fmu = write(&document, standard, folder.path());
            let output =
                Command::new(target.join("debug/rust-host")).arg(fmu).args(["tip_y_m", "0.01", "20"]).output().unwrap();
            let [found, messages] =
                [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
            assert!(output.status.success() && messages.is_empty(), "{model}, {standard:?}: {messages}");
            assert_eq!(found.lines().collect::<Vec<_>>(), expected, "{model}, {standard:?}");
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn the_library_needs_glibc_and_libgcc_s_alone() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("needs.py");
    // Measured: 2.35, by hypot; glibc 2.38 has the latest functions that Rust asks for. For 2.28 see portable.sh.
    let needs =
        Command::new("python3").arg(script).arg(common::library_path()).args(["2.38", "libgcc_s.so.1"]).output();
    let Ok(output) = needs else { return skip("needs.py", "install Python 3") };
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    println!("{text}");
    assert!(output.status.success(), "{text}");
}

#[test]
fn hosts_and_checkers_take_the_fmus_and_see_the_stepper_s_trajectory() {
    let python = match python() {
        Ok(python) => python,
        Err(reason) => return skip("FMPy, fmutool, ecos and libcosim", &reason),
    };
    let folder = tempfile::tempdir().unwrap();
    let mut expected = serde_json::Map::new();
    for model in ["baseline", "driven-head", "cantilever", "glycerol"] {
        let document = document(model, &[]);
        let scene = document.scene().unwrap();
        let step = 2.0 * scene.solver.time_step_s.unwrap().get();
        let mut entry = serde_json::json!({ "step": step, "tip_y_m": tips(&document, step, 25) });
        if model == "driven-head" {
            let mut stepper = Stepper::of(&scene.with_nodes(20)).unwrap();
            let mut after = || {
                stepper.do_step(step).unwrap();
                stepper.get("y_m").unwrap()
            };
            entry["other_y_m"] = (0..10).map(|_| after()).collect();
            entry["other_nodes"] = 20.into();
        }
        expected.insert(scene.name.clone(), entry);
        for standard in [Standard::Fmi2, Standard::Fmi3] {
            write(&document, standard, folder.path());
        }
    }
    std::fs::write(folder.path().join("expected.json"), serde_json::to_string(&expected).unwrap()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hosts/run.py");
    let output = Command::new(python).arg(script).arg(folder.path()).output().unwrap();
    let text = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()).concat();
    println!("{text}");
    assert!(output.status.success(), "{text}");
}
