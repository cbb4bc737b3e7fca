//! Today's hosts and checkers load the FMUs and see the stepper's own trajectory: FMPy, fmutool, ecos, libcosim.
//!
//! They are Python packages, set up in `target/hosts` from `requirements.txt`. Without Python (or a network, the first
//! time) the test says what was skipped; with `CAUDAL_HOSTS=required`, as in continuous integration, it fails.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a failure ends the test")]

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use caudal::fmu::Standard;
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

#[test]
fn hosts_and_checkers_take_the_fmus_and_see_the_stepper_s_trajectory() {
    let python = match python() {
        Ok(python) => python,
        Err(reason) => {
            assert!(std::env::var("CAUDAL_HOSTS").as_deref() != Ok("required"), "{reason}");
            return eprintln!("SKIPPED: FMPy, fmutool, ecos and libcosim were not tried: {reason}");
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let mut expected = serde_json::Map::new();
    for model in ["baseline", "driven-head", "cantilever", "glycerol"] {
        let document = document(model, &[]);
        let scene = document.scene().unwrap();
        let step = 2.0 * scene.solver.time_step_s.unwrap().get();
        let mut stepper = Stepper::of(&scene).unwrap();
        let mut tips = Vec::new();
        for _ in 0..25 {
            stepper.do_step(step).unwrap();
            tips.push(stepper.get_scalar("tip_y_m").unwrap());
        }
        let mut entry = serde_json::json!({ "step": step, "tip_y_m": tips });
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
