//! A design for several scenes is the best for the worst of them, or for their mean.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::io::{BufRead, BufReader};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Stdio};

use caudal::design::{Answer, Design, SearchResult};
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;

/// The scene beside a sweep of `axes`.
fn document(folder: &Path, axes: &str, changes: &[&str]) -> Document {
    let path = folder.join("driven.toml");
    let design = "newton_tolerance = 1e-12\n[design]\ngoal = \"cycle_thrust_n\"\nknots = [0.5]\nstarts = 1\nover = \"cases.toml\"\n";
    std::fs::write(&path, common::driven(17) + design).unwrap();
    std::fs::write(folder.join("cases.toml"), format!("scene = \"driven.toml\"\n[axes]\n{axes}\n")).unwrap();
    let mut document = Document::read(&path).unwrap();
    changes.iter().for_each(|change| document.set(change).unwrap());
    document
}

fn found(design: &Design) -> &SearchResult {
    let Answer::Search(found) = &design.answer else { panic!("found") };
    found
}

/// The mean thrust of a scene's run.
fn thrust(scene: &Scene) -> f64 {
    let mut stepper = Stepper::of(scene).unwrap();
    stepper.do_step(scene.solver.duration_s.get()).unwrap();
    let mean = stepper.cycles().averages(stepper.view().dynamics);
    mean.mean(&caudal::cycle::THRUST).unwrap()
}

const AXES: &str = r#""rod.youngs_modulus_pa" = { factors = [0.4, 1.0, 2.5] }"#;
const FACTORS: [f64; 3] = [0.4, 1.0, 2.5];

/// The thrust in every case with this stiffness over the scene's.
fn thrusts(folder: &Path, factor: f64) -> [f64; 3] {
    let text = document(folder, AXES, &[]).text().split("[design]").next().unwrap().to_string();
    FACTORS.map(|stiffer| {
        let mut document = Document::new("driven.toml", &text);
        document.set(&format!("rod.youngs_modulus_pa={:e}", 1e7 * stiffer)).unwrap();
        document.set(&format!("rod.stiffness_profile=[[0.0, {factor:e}], [1.0, {factor:e}]]")).unwrap();
        thrust(&document.scene().unwrap())
    })
}

/// The cases differ in mass; a limit of it is that of the scene itself.
#[test]
fn limits_of_a_robust_design_are_written_and_those_of_the_body_are_the_scenes_own() {
    let folder = tempfile::tempdir().unwrap();
    let axes = r#""rod.density_kg_m3" = { factors = [0.9, 1.0, 1.1] }"#;
    let mass = document(folder.path(), AXES, &[]).scene().unwrap().model().unwrap().rod.total_mass();
    let mass = format!("design.largest_mass_kg={:e}", 1.01 * mass);
    let radius =
        ["design.variables=[\"rod.outer_radius_m\"]", "design.number_bounds=[0.9, 1.1]", "design.iterations=3"];
    let changes = [&radius[..], &["design.largest_moment_n_m=1e3", &mass]].concat();
    let document = document(folder.path(), axes, &changes);
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let numbers = design.numbers().unwrap();
    for check in numbers["checks"].as_array().unwrap() {
        let limit = &check["limit"];
        assert!(
            limit["limit"].as_str().unwrap().contains("moment") && limit["used"].as_f64().unwrap() < 1.0,
            "{check}"
        );
    }
    assert!(numbers["trust"]["broken_in"].is_null(), "{}", numbers["trust"]);
    let files = design.write(&folder.path().join("out")).unwrap().complete().unwrap();
    assert!(files.iter().any(|path| path.ends_with("cases.csv")));
}

#[test]
fn the_worst_case_and_the_mean_are_as_good_as_they_can_be() {
    let folder = tempfile::tempdir().unwrap();
    for (robust, of) in [
        ("worst", (|all| all.into_iter().fold(f64::INFINITY, f64::min)) as fn([f64; 3]) -> f64),
        ("mean", |all| all.iter().sum::<f64>() / 3.0),
    ] {
        let document = document(folder.path(), AXES, &[&format!("design.robust={robust}")]);
        let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
        let found = found(&design);
        let reference = document.scene().unwrap().model().unwrap().rod.ei;
        let factor = found.profile.stiffness_n_m2[0] / reference;
        let at = |change: f64| of(thrusts(folder.path(), factor * (1.0 + change)));
        let all = thrusts(folder.path(), factor);
        println!("{robust}: {factor:.5}, {:.6e}, {all:?}, {:?}", found.objective, design.lines);
        assert!(found.converged, "{robust}: {:e}", found.stationarity);
        assert!((of(all) / found.objective - 1.0).abs() <= 1e-9, "{robust}: {:e} {:e}", of(all), found.objective);
        // Nothing beside it is better, and it is no plain.
        for change in [-0.02, -1e-3, 1e-3, 0.02] {
            assert!(at(change) < of(all), "{robust}: {change}: {:e} {:e}", at(change), of(all));
        }
        // It says what it is in each.
        let numbers = design.numbers().unwrap();
        for (case, own) in numbers["cases"].as_array().unwrap().iter().zip(all) {
            assert!((case["designed"].as_f64().unwrap() / own - 1.0).abs() <= 1e-9, "{case}");
        }
        assert_eq!(numbers["trust"]["survives"], true, "{}", numbers["checks"]);
    }
}

#[test]
fn scatter_of_the_stiffness_scatters_that_of_the_design() {
    let folder = tempfile::tempdir().unwrap();
    let axes = r#""rod.youngs_modulus_pa" = { factors = [0.5, 1.0, 1.5] }"#;
    let document = document(folder.path(), axes, &["design.knots=[0.2, 0.8]"]);
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let out = folder.path().join("out");
    design.write(&out).unwrap().complete().unwrap();
    let numbers = design.numbers().unwrap();
    for (case, factor) in numbers["cases"].as_array().unwrap().iter().zip([0.5, 1.0, 1.5]) {
        let mut scene = Document::read(&out.join("driven-designed.toml")).unwrap();
        scene.set(&format!("rod.youngs_modulus_pa={:e}", 1e7 * factor)).unwrap();
        let own = thrust(&scene.scene().unwrap());
        println!("{case}: {own:e}");
        assert!((case["designed"].as_f64().unwrap() / own - 1.0).abs() <= 1e-9, "{case}: {own}");
    }
    assert!(out.join("cases.csv").exists() && out.join("cases.svg").exists());
    assert!(found(&design).converged);
}

#[test]
fn cases_that_mean_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (axes, changes, words) in [
        (r#""rod.stiffness_gradient" = [0.5, 1.0]"#, &[][..], "which the design decides"),
        (r#""rod.nodes" = [9, 17]"#, &[], "which the design decides"),
        (AXES, &["design.variables=[\"rod.youngs_modulus_pa\"]"], "which the design decides"),
        (AXES, &["design.over=none.toml"], "none.toml"),
        (r#""drag.wrong" = [1.0]"#, &[], "drag.wrong"),
        (AXES, &["design.robust=best"], "worst"),
        (AXES, &["design.front={ goal = \"cycle_head_power_w\", better = \"smaller\" }"], "one of the two"),
        (r#""medium.viscosity_pa_s" = [-1.0]"#, &[], "in case 0"),
    ] {
        let document = document(folder.path(), axes, changes);
        let error = Design::of(&document, |_| ControlFlow::Continue(())).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{axes} {changes:?}: {error}");
    }
}

/// An eel's front between speed and economy: in some of its gaps the one is held, in others the other.
const FRONT: [&str; 4] = [
    "rod.nodes=5",
    "solver.time_step_s=0.02",
    "solver.duration_s=1.5",
    r#"design={ goal = "cycle_forward_speed_m_s", variables = ["rod.outer_radius_m", "actuation.kappa_amp"], number_bounds = [0.8, 1.3], starts = 2, front = { goal = "cycle_cost_of_transport", better = "smaller", points = 5 } }"#,
];

#[test]
fn a_front_that_was_ended_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let command = |out: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
        command.args(["design", "models/eel.toml", "--out"]).arg(folder.path().join(out));
        command.args(FRONT.iter().flat_map(|change| ["--set", change]));
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        command
    };
    let whole = command("whole").output().unwrap();
    assert!(whole.status.success());
    let lines = String::from_utf8_lossy(&whole.stdout).lines().filter(|line| line.starts_with("start")).count();
    // Killed, without a warning, again and again: in the search, and in the front.
    for part in [0.2, 0.6, 0.9] {
        let mut killed = command("killed").spawn().unwrap();
        let told = BufReader::new(killed.stdout.take().unwrap()).lines();
        assert!(told.take((part * lines as f64) as usize).all(|line| line.is_ok()));
        killed.kill().unwrap();
        killed.wait().unwrap();
    }
    let journal = folder.path().join("killed/design.journal");
    let kept = std::fs::read_to_string(&journal).unwrap().lines().count();
    assert!(kept > lines / 2, "{kept} of {lines}");
    assert!(command("killed").output().unwrap().status.success());
    let mut names = 0;
    for entry in std::fs::read_dir(folder.path().join("whole")).unwrap() {
        let path = entry.unwrap().path();
        let other = folder.path().join("killed").join(path.file_name().unwrap());
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&other).unwrap(), "{path:?}");
        names += 1;
    }
    assert!(names > 10 && !journal.exists());
    // What another design left does not count, and is no hindrance.
    std::fs::write(&journal, "").unwrap();
    let other = command("killed").args(["--set", "design.starts=1"]).output().unwrap();
    assert!(other.status.success() && !journal.exists());
}
