//! Which law of the fluid a scene needs: the study that compares them, what is published of them, and what their forces are made of.

use crate::common;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use caudal::fluid::force::visit_alone;
use caudal::fluid::laws::{LAWS, auto};
use caudal::report::Findings;
use caudal::rod::{Edge, node};
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use caudal::study::{FluidOptions, Study, StudyOutcome, StudyRunner};
use common::{claimed, scene_of};
use nalgebra::Vector2;

const EEL: &str = include_str!("../../models/eel.toml");
const FISH: &str = include_str!("../../models/fish.toml");
const SPERM: &str = include_str!("../../models/sperm.toml");
const WORM: &str = include_str!("../../models/worm-over-a-wall.toml");

fn study(scene: &Scene, folder: &Path, most: usize) -> StudyOutcome {
    let interrupted = AtomicBool::new(false);
    let progress = |done: usize, _: usize| interrupted.store(done >= most, Ordering::Relaxed);
    let study = Study::Fluid(FluidOptions::default());
    let held = claimed(&study, scene, folder);
    study.run(scene, StudyRunner::new(&held, &interrupted, &progress)).unwrap()
}

fn findings(scene: &Scene) -> Findings {
    let folder = tempfile::tempdir().unwrap();
    match study(scene, folder.path(), usize::MAX) {
        StudyOutcome::Complete(findings) => findings,
        StudyOutcome::Interrupted(done, of) => panic!("interrupted at {done} of {of}"),
    }
}

/// The numbers of a row of the table of laws: motion, and its difference and that of the power.
fn row(findings: &Findings, law: &str, reactive: bool) -> Option<[f64; 3]> {
    let row = findings.tables[0].rows.iter().find(|row| row[0] == law && row[1] == reactive)?;
    Some([4, 8, 9].map(|column| row[column].as_f64().unwrap()))
}

#[test]
fn what_is_published_of_laws_is_in_order_and_has_a_source() {
    for law in LAWS {
        let known = law.published;
        // What a scene's own measurement says, the source study's law and the choice between laws have none.
        assert_eq!(
            known.table.is_empty(),
            ["coefficients", "stokes-like", auto::LAW.name].contains(&law.name),
            "{}",
            law.name
        );
        assert_eq!(known.table.is_empty(), known.source.is_empty(), "{}", law.name);
        assert!(known.table.windows(2).all(|pair| pair[0].reynolds < pair[1].reynolds), "{}", law.name);
        let parts = known.table.iter().flat_map(|entry| [entry.speed, entry.thrust, entry.power]);
        assert!(parts.clone().all(|part| part > 0.0 && part < 1.0), "{}", law.name);
        if let (Some(first), Some(last)) = (known.table.first(), known.table.last()) {
            for (entry, beyond) in [(first, 0.1), (last, 10.0)] {
                assert_eq!(known.at(entry.reynolds * beyond).map(|at| at.speed), Some(entry.speed));
                assert!((known.at(entry.reynolds).unwrap().power - entry.power).abs() < 1e-15);
            }
        }
    }
}

#[test]
fn the_parts_of_a_law_are_together_what_the_law_is() {
    for law in LAWS {
        for text in [EEL, WORM] {
            let Ok((scene, _)) = scene_of(text, &[]).with_fluid(law, true) else { continue };
            let mut stepper = Stepper::of(&scene).unwrap();
            stepper.do_step(0.1 * scene.solver.duration_s.get()).unwrap();
            let (view, state) = (stepper.view(), stepper.state());
            let nodes = state.q.len() / 2;
            let edges: Vec<Edge> = (1..nodes).map(|k| Edge::new(node(&state.q, k) - node(&state.q, k - 1))).collect();
            let moving = view.dynamics.kinematics_of(state.t, &edges, [&state.q, &state.v, &state.a]);
            let mut sums = [vec![Vector2::zeros(); nodes], vec![Vector2::zeros(); nodes]];
            let parts = scene.parts_of_fluid(&stepper.model().rod).unwrap();
            for (_, part) in &parts {
                visit_alone(&**part, &moving, |k, force| sums[0][k] += force);
            }
            for force in stepper.model().forces.iter() {
                visit_alone(force, &moving, |k, force| sums[1][k] += force);
            }
            let [found, wanted] = sums;
            let largest = wanted.iter().map(|force| force.norm()).fold(0.0, f64::max);
            let off = found.iter().zip(&wanted).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            assert!(largest > 0.0 && off < 1e-13 * largest, "{}: {off:e} {largest:e}", law.name); // measured 2e-16
            let names: Vec<_> = parts.iter().map(|(name, _)| *name).collect();
            let several = ["viscous", "boundary layer", "form drag", "added mass", "shedding"];
            assert_eq!(several.iter().all(|name| names.contains(name)), law.parts.is_some(), "{names:?}");
        }
    }
}

#[test]
fn a_swimmer_in_creeping_flow_needs_nonlocal_drag_for_its_power_alone_and_a_fish_needs_all() {
    let sperm = findings(&scene_of(SPERM, &[]));
    assert_eq!(sperm.numbers["law_that_suffices"], "nonlocal", "{:?}", sperm.answers);
    let [_, speed, power] = row(&sperm, "cox", false).unwrap();
    // Measured 3.2 %, −17 %.
    assert!((0.02..0.045).contains(&speed) && (-0.2..-0.14).contains(&power), "{speed} {power}");
    let fish = findings(&scene_of(FISH, &[]));
    assert_eq!(fish.numbers["law_that_suffices"], "cross-flow + reactive", "{:?}", fish.answers);
    let [_, speed, power] = row(&fish, "cross-flow", false).unwrap();
    // Measured −74 %, −75 %.
    assert!((-0.84..-0.64).contains(&speed) && (-0.85..-0.65).contains(&power), "{speed} {power}");
    assert!(row(&fish, "cox", false).is_none(), "out of its range");
    assert!(fish.tables[1].rows.iter().any(|row| row[0] == "cox"));
    // Around the sperm, at fD²/ν = 1e-5, the water that the theory accelerates is none.
    for (findings, laws) in [(&sperm, 7), (&fish, 2)] {
        assert_eq!(findings.tables[0].rows.len(), laws, "{:?}", findings.tables[0].rows);
        assert!(findings.answers.last().unwrap().starts_with("Verdict: "));
        assert!(findings.motion.is_some());
        let files: Vec<_> = findings.figures.iter().map(|figure| figure.file.as_str()).collect();
        for file in ["speed-time.svg", "power-time.svg", "along-body-reference.svg", "over-cycle-reference.svg"] {
            assert!(files.contains(&file), "{files:?}");
        }
    }
}

#[test]
fn the_study_s_speeds_are_those_of_runs() {
    let found = findings(&scene_of(EEL, &["solver.duration_s=3"]));
    for (reactive, change) in [(false, "drag={ law = \"cross-flow\" }"), (true, "reactive={}")] {
        let scene = scene_of(EEL, &["solver.duration_s=3", change]);
        let scene = if reactive { scene } else { scene.with_reactive(false) };
        let mut stepper = Stepper::of(&scene).unwrap();
        for span in scene.spans() {
            stepper.do_step(span).unwrap();
        }
        let speed = stepper.get_scalar("cycle_forward_speed_m_s").unwrap();
        assert_eq!(row(&found, "cross-flow", reactive).unwrap()[0], speed);
    }
}

#[test]
fn beside_a_wall_the_highest_law_knows_the_wall() {
    // Nearer than three radii nonlocal drag is out of its range.
    let found = findings(&scene_of(WORM, &["solver.duration_s=1", "drag.height_m=1.1e-4"]));
    let reference = found.numbers["reference"].as_str().unwrap();
    let [_, speed, _] = row(&found, "cox", false).unwrap();
    let [_, wall, _] = row(&found, "wall", false).unwrap();
    assert!(reference.starts_with("nonlocal"), "{reference}");
    // Measured −28 %, and +38 %: the wall screens what parts of the rod do to each other, which a local law leaves out.
    assert!((-0.35..-0.2).contains(&speed) && (0.3..0.45).contains(&wall), "{reference} {speed} {wall}");
}

#[test]
fn the_verdict_keeps_the_water_that_decides_whether_a_rod_is_stable() {
    let flag = include_str!("../../models/flag.toml");
    let found = findings(&scene_of(flag, &["solver.duration_s=0.5"]));
    let [_, thrust, power] = row(&found, "cross-flow", false).unwrap();
    println!("{thrust} {power}: {:?}", found.answers.last());
    // From rest both are the same: what the water does to the rod a motion of half a second does not show.
    assert!(thrust.abs() < 0.05 && power.abs() < 0.05, "{thrust} {power}");
    assert_eq!(found.numbers["law_that_suffices"], "cross-flow + reactive", "{:?}", found.answers);
    assert!(found.answers.last().unwrap().contains("whether the rod is stable"), "{:?}", found.answers);
}

#[test]
fn the_animation_of_a_study_is_even_to_its_end_with_24_frames_a_period_or_as_many_as_allowed() {
    // 119 to 239 spaces; where these would be fewer than twelve a period, the last periods.
    for (duration, from, spaces) in [(0.35, 0.0, 119), (0.8, 0.0, 192), (1.5, 0.0, 239), (3.0, 2.1, 216)] {
        let period = ["actuation.frequency_hz=10.0", "rod.nodes=9", &format!("solver.duration_s={duration}")];
        let found = findings(&scene_of(SPERM, &period));
        let (animation, _) = *found.motion.unwrap();
        let animation = serde_json::to_value(animation).unwrap();
        let times: Vec<f64> = animation["times"].as_array().unwrap().iter().map(|t| t.as_f64().unwrap()).collect();
        assert!((times[0] - from).abs() < 1e-9, "{duration}: begins at {} s", times[0]);
        let last = times.len() - 1;
        for (i, t) in times.iter().enumerate() {
            let even = from + (duration - from) * i as f64 / last as f64;
            // Pages have nine digits of times.
            assert!((t - even).abs() < 1e-8, "{duration}: frame {i} at {t} s, not {even}");
        }
        assert_eq!(last, spaces, "{duration}");
        let beside = animation["beside"].as_array().unwrap();
        // Two numbers of four bytes for each point of a frame.
        let points = |rod: &serde_json::Value| STANDARD.decode(rod["points"].as_str().unwrap()).unwrap().len();
        assert!(!beside.is_empty() && points(&animation) > 0 && points(&animation).is_multiple_of(8 * times.len()));
        assert!(beside.iter().all(|rod| points(rod) == points(&animation)));
    }
}

#[test]
fn an_interrupted_study_of_laws_goes_on_to_the_same_end() {
    let scene = scene_of(SPERM, &["solver.duration_s=0.05"]);
    let wanted = findings(&scene);
    let folder = tempfile::tempdir().unwrap();
    let StudyOutcome::Interrupted(done, of) = study(&scene, folder.path(), 3) else { panic!("not interrupted") };
    assert!(done >= 3 && done < of, "{done} of {of}");
    let StudyOutcome::Complete(found) = study(&scene, folder.path(), usize::MAX) else { panic!("interrupted") };
    let untimed = |findings: &Findings| -> Vec<Vec<serde_json::Value>> {
        let columns = &findings.tables[0].columns;
        let kept = |row: &Vec<serde_json::Value>| {
            let timed = |name: &str| ["wall_s", "processor_s"].contains(&name);
            row.iter().zip(columns).filter(|(_, name)| !timed(name)).map(|(value, _)| value.clone()).collect()
        };
        findings.tables[0].rows.iter().map(kept).collect()
    };
    assert_eq!(untimed(&found), untimed(&wanted));
    let of_forces = |findings: &Findings| -> Vec<_> {
        findings.figures.iter().filter(|figure| !figure.file.ends_with("-time.svg")).cloned().collect()
    };
    assert_eq!(of_forces(&found), of_forces(&wanted));
}

#[test]
fn what_a_mesh_cannot_have_is_said_beside_the_verdict() {
    let worm = r#"
[rod]
nodes = 33
length_m = 0.001
outer_radius_m = 4e-5
youngs_modulus_pa = 4e5
density_kg_m3 = 1260.0
[actuation]
kind = "travelling-wave"
kappa_amp = 8000.0
frequency_hz = 1.0
wavelength_m = 0.0007
[medium]
viscosity_pa_s = 1.4
density_kg_m3 = 1260.0
[drag]
law = "cox"
[solver]
duration_s = 2.0
"#;
    let [fine, coarse] = ["rod.nodes=33", "rod.nodes=25"].map(|nodes| findings(&scene_of(worm, &[nodes])).answers);
    println!("{fine:#?}\n{coarse:#?}");
    let missing = fine.iter().filter(|answer| answer.starts_with("nonlocal") && answer.contains("at most 31")).count();
    assert_eq!(missing, 1, "{fine:?}");
    assert!(fine.last().unwrap().contains("whether it needs nonlocal is not known"), "{fine:?}");
    assert!(coarse.last().unwrap().contains("nonlocal is needed here"), "{coarse:?}");
}
