//! Work against precision: linear solves to reach an error of the displacement, method against method; and the study of it
//! recommends only where there is a reference.

use crate::common;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use caudal::integrator::{METHODS, StepControl};
use caudal::report::Summary;
use caudal::run::{Ending, Outcome};
use caudal::scene::Scene;
use caudal::study::{AccuracyOptions, Study, StudyOutcome, StudyRunner};
use common::{DRAG, STUDY, WAVE, all_scene_files, distance, run, scene, scene_of};

/// The study's tail in a medium, its actuation grown over 0.25 s, by a method with steps of 0.5 s/`parts` and Newton's
/// `tolerance`: displacement (m) and linear solves; `None` where it fails or halves.
fn displacement(method: &str, viscosity: f64, parts: u32, tolerance: f64) -> Option<(f64, u64)> {
    let scene = scene(&[
        WAVE,
        DRAG,
        "rod.mass_lumping=uniform",
        "start={ kind = \"ramp\", ramp_s = 0.25 }",
        "solver.duration_s=0.5",
        &format!("solver.newton_tolerance={tolerance:e}"),
        &format!("medium={{ viscosity_pa_s = {viscosity}, density_kg_m3 = 1000.0 }}"),
        &format!("solver.integrator={method}"),
        &format!("solver.time_step_s={:e}", 0.5 / f64::from(parts)),
    ]);
    let mut stepper = caudal::stepper::Stepper::of(&scene).unwrap();
    stepper.halve_failing_steps(false);
    stepper.do_step(0.5).ok()?;
    Some((stepper.metrics().net_displacement(), stepper.work().factorisations))
}

/// The fewest solves with which this error is reached, and kept with finer steps.
fn solves(runs: &[(f64, u64)], error: f64) -> Option<u64> {
    let kept = runs.iter().rev().take_while(|run| run.0 <= error).count();
    (kept > 0).then(|| runs[runs.len() - kept].1)
}

#[test]
fn the_best_method_needs_a_small_part_of_the_solves_of_implicit_euler() {
    // At 1e-2 Newton's tolerance is 1e-6 for all methods: fewest solves for that error. A tighter one costs iterations, of which
    // long steps have most: with 1e-8 the first ratio is 3.6 and 3.3, with 1e-10 3.3 and 3.1; one solve a step gives 3.8 and 4.4.
    let runs_of = |method: &str, viscosity: f64, reference: f64, tolerance: f64, most: u32| -> Vec<(f64, u64)> {
        // Eight steps in an octave where solves are few, one where they are many.
        let coarse = (0..56).map(|i| (8.0 * 2.0_f64.powf(f64::from(i) / 8.0)).round() as u32);
        let fine = (10..=16).map(|i| 1 << i).chain([50_000]).filter(|n| *n <= most);
        let error = |found: (f64, u64)| ((found.0 / reference - 1.0).abs(), found.1);
        let run = |parts| displacement(method, viscosity, parts, tolerance).map_or((f64::NAN, 0), error);
        coarse.chain(fine).map(run).collect()
    };
    for viscosity in [1e-3, 1.0] {
        let (reference, _) = displacement("esdirk3", viscosity, 50_000, 1e-8).unwrap();
        let (other, _) = displacement("generalized-alpha", viscosity, 50_000, 1e-8).unwrap();
        assert!((other / reference - 1.0).abs() < 1e-7);
        let mut table = Vec::new();
        for method in METHODS.iter().filter(|method| method.implicit) {
            let most = if method.name == "implicit-euler" { 50_000 } else { 8192 };
            let [loose, tight] = [(1e-6, 1024), (1e-8, most)]
                .map(|(tolerance, most)| runs_of(method.name, viscosity, reference, tolerance, most));
            table.push((method.name, [solves(&loose, 1e-2), solves(&tight, 1e-4), solves(&tight, 1e-6)]));
        }
        println!("{viscosity} Pa s: {table:?}");
        let (_, euler) = table.iter().find(|(name, _)| *name == "implicit-euler").unwrap();
        let best = |i: usize| table.iter().filter_map(|(_, reached)| reached[i]).min().unwrap();
        // Measured in water: 362 against 74, 32768 against 205, never against 1410; at 1 Pa s 362 against 75.
        assert!(4 * best(0) <= euler[0].unwrap(), "{table:?}");
        assert!(30 * best(1) <= euler[1].unwrap(), "{table:?}");
        assert!(best(2) > 0 && euler[2].is_none(), "{table:?}");
    }
}

#[test]
fn the_default_method_completes_every_scene_and_errs_less_than_implicit_euler_where_there_is_an_answer() {
    let mut compared = 0;
    for path in all_scene_files() {
        let mut scene = Scene::load(&path).unwrap();
        scene.solver.parameters.clear();
        scene = scene.with_duration(scene.solver.duration_s.get().min(0.5)); // the start is the hard part
        let mut ends = |integrator: Option<&str>, step_control: StepControl| {
            scene.solver.integrator = integrator.map(str::to_string);
            let scene = scene.with_step_control(step_control);
            let end = run(&scene);
            let notes =
                Summary::of(&scene, &end, &Outcome { ending: Ending::Complete, wall: Duration::ZERO }, &[]).notes;
            (scene.integrator_name().to_string(), end.state().q.clone(), end.metrics().totals.halvings, notes)
        };
        let step = StepControl::Fixed(common::time_step(&Scene::load(&path).unwrap()));
        let (name, q, halvings, notes) = ends(None, step);
        assert_eq!(halvings, 0, "{path:?}");
        if name == "implicit-euler" {
            continue; // released at once, its motion has no limit of small steps that a run could be compared with
        }
        // What a law leaves its range by is no matter of the method.
        // And a column under a sudden thrust rings along itself, of which the method takes 10 % within this time, as it is to do.
        let rings = path.ends_with("beck-column.toml");
        let taken = |note: &String| rings && note.contains("were dissipated by the integrator");
        let notes: Vec<_> = notes.iter().filter(|note| !note.contains(" outside ") && !taken(note)).collect();
        assert!(notes.is_empty(), "{path:?}: {notes:?}");
        let exact = ends(Some("esdirk3"), StepControl::Adaptive(1e-5)).1;
        let errors = [q, ends(Some("implicit-euler"), step).1].map(|q| distance(&q, &exact));
        // Measured: 12 (cantilever) … 3000 times as small.
        println!("{path:?}: {errors:?}, {}", errors[1] / errors[0]);
        assert!(errors[0] < errors[1], "{path:?}: {errors:?}");
        compared += 1;
    }
    assert!(compared >= 10, "{compared}");
}

/// The findings of a small accuracy study, made in a folder of its own.
fn study(text: &str, overrides: &[&str], asked: &AccuracyOptions) -> caudal::report::Findings {
    let folder = tempfile::tempdir().unwrap();
    let (interrupted, progress) = (AtomicBool::new(false), |_, _| ());
    let (study, scene) = (Study::Accuracy(asked.clone()), scene_of(text, overrides));
    let held = common::claimed(&study, &scene, folder.path());
    match study.run(&scene, StudyRunner::new(&held, &interrupted, &progress)).unwrap() {
        StudyOutcome::Complete(findings) => findings,
        StudyOutcome::Interrupted(..) => panic!("nobody did"),
    }
}

#[test]
fn a_chaotic_scene_has_no_reference_and_no_errors() {
    let asked = AccuracyOptions {
        nodes: vec![9],
        steps: vec![1e-3, 5e-4],
        tolerances: vec![1e-3],
        ..AccuracyOptions::default()
    };
    let findings = study(STUDY, &["solver.duration_s=1"], &asked);
    assert!(findings.answers[0].starts_with("No trajectory reference exists"), "{:?}", findings.answers);
    assert!(findings.tables.is_empty());
    let rate = findings.numbers["separation_growth_rate_1_s"].as_f64().unwrap();
    assert!((20.0..300.0).contains(&rate), "{rate}"); // measured: 55.7
}

#[test]
fn a_smooth_scene_has_a_reference_errors_and_a_recommendation() {
    let smooth = include_str!("../../models/baseline-smooth.toml");
    let asked = AccuracyOptions {
        nodes: vec![9, 17, 33],
        steps: vec![1e-2, 5e-3, 2.5e-3, 1.25e-3],
        tolerances: vec![1e-3],
        ..AccuracyOptions::default()
    };
    let findings = study(smooth, &["solver.duration_s=0.5"], &asked);
    let own = findings.numbers["reference_9_nodes"]["displacement_error"].as_f64().unwrap();
    assert!(own < 1e-5, "{own}"); // measured: 1.2e-7
    assert_eq!(findings.figures.len(), 7);
    let recommended = &findings.numbers["recommended_net_displacement_1e-2"]["on_this_mesh"];
    assert!(recommended.is_string(), "{:?}", findings.answers);
}

#[test]
fn the_first_error_of_a_held_head_is_that_of_the_mean_force_on_it() {
    let driven = include_str!("../../models/driven-head.toml");
    let overrides = ["rod.nodes=9", "solver.duration_s=0.5"];
    let asked = AccuracyOptions {
        nodes: vec![9],
        steps: vec![4e-3, 2e-3, 1e-3],
        tolerances: vec![1e-3],
        ..AccuracyOptions::default()
    };
    let findings = study(driven, &overrides, &asked);
    let reference = &findings.numbers["reference_9_nodes"];
    assert!(reference["head_force_error"].as_f64().unwrap() < 1e-5, "{reference}"); // measured: 1.9e-6
    assert!(findings.figures.iter().any(|figure| figure.file == "head_force-work.svg"));
    assert!(findings.answers.iter().all(|answer| !answer.contains("displacement")), "{:?}", findings.answers);
    // The same by a run of its own, whose summary has the mean.
    let scene = scene_of(driven, &[&overrides[..], &["solver.integrator=esdirk3", "solver.time_step_s=5e-4"]].concat());
    let tail = run(&scene);
    let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
    let mean = Summary::of(&scene, &tail, &outcome, &[]).mean_head_force_n.unwrap();
    let found = ["mean_head_force_x_n", "mean_head_force_y_n"].map(|key| reference[key].as_f64().unwrap());
    let apart = (mean[0] - found[0]).hypot(mean[1] - found[1]) / mean[0].hypot(mean[1]);
    println!("{reference} {apart:e}");
    assert!(apart < 1e-5, "{apart:e}");
}

#[test]
fn on_the_smooth_baseline_generalized_alpha_and_esdirk3_agree() {
    let smooth = include_str!("../../models/baseline-smooth.toml");
    let ends = [("esdirk3", 2.5e-3), ("generalized-alpha", 6.25e-4)].map(|(method, step)| {
        let changes = [format!("solver.integrator={method}"), format!("solver.time_step_s={step}")];
        run(&scene_of(smooth, &[&changes[0], &changes[1]])).metrics().net_displacement()
    });
    // Measured: 5.0e-6.
    assert!((ends[0] / ends[1] - 1.0).abs() < 1e-5, "{ends:?}");
}

#[test]
fn methods_that_would_cost_more_than_all_others_are_left_out_by_name_as_are_those_that_are_asked_for() {
    // A wire as stiff in tension as steel: its explicit steps are ten thousand times the implicit ones.
    let wire = ["rod.youngs_modulus_pa=2e11", "actuation.kappa_amp=1e-3", "solver.duration_s=0.05", "rod.nodes=9"];
    let smooth = include_str!("../../models/baseline-smooth.toml");
    let asked = AccuracyOptions {
        nodes: vec![9],
        steps: vec![5e-3, 2.5e-3],
        tolerances: vec![1e-3],
        without: vec!["generalized-alpha".into()],
    };
    let findings = study(smooth, &wire, &asked);
    let left_out: Vec<_> = findings.answers.iter().filter(|answer| answer.starts_with("Left out: ")).collect();
    println!("{left_out:?}");
    assert!(
        left_out.iter().any(|answer| answer.contains("symplectic-euler on 9 nodes, whose stability limit of")),
        "{left_out:?}"
    );
    assert!(left_out.iter().any(|answer| answer.contains("generalized-alpha, as asked")), "{left_out:?}");
    let rows: Vec<String> =
        findings.tables.iter().flat_map(|table| &table.rows).map(|row| format!("{row:?}")).collect();
    assert!(!rows.is_empty() && rows.iter().all(|row| !row.contains("symplectic-euler")), "{rows:?}");
    assert!(rows.iter().all(|row| !row.contains("generalized-alpha")), "{rows:?}");
}
