//! Studies: maps show the limits of theory, meshes converge, an interrupted study goes on, and the command writes it all.

use crate::common;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};

use caudal::report::Findings;
use caudal::scene::Scene;
use caudal::study::{AccuracyOptions, ScalingOptions, StabilityOptions, Study, StudyOutcome, StudyRunner, Vary};
use common::{DRAG, GLYCEROL, SILICONE, WAVE, claimed, scene, scene_of};

const SMALL: StabilityOptions = StabilityOptions {
    vary: Vary::Modulus,
    range: Some([1e6, 1e8]),
    steps: Some([1e-4, 1e-2]),
    points: 3,
    accurate: 0.05,
};

/// A study in `folder`, interrupted after so many runs.
fn small(folder: &Path, most: usize) -> StudyOutcome {
    let interrupted = AtomicBool::new(false);
    let progress = |done: usize, _: usize| interrupted.store(done >= most, Ordering::Relaxed);
    let scene = scene(&[SILICONE, WAVE, DRAG, GLYCEROL, "solver.duration_s=0.2"]);
    made_in(folder, &Study::Stability(SMALL), &scene, &interrupted, &progress)
}

fn made_in(
    folder: &Path,
    study: &Study,
    scene: &Scene,
    interrupted: &AtomicBool,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> StudyOutcome {
    let held = claimed(study, scene, folder);
    study.run(scene, StudyRunner::new(&held, interrupted, progress)).unwrap()
}

/// A study in a folder of its own.
fn made(study: &Study, scene: &Scene) -> StudyOutcome {
    made_in(tempfile::tempdir().unwrap().path(), study, scene, &AtomicBool::new(false), &|_, _| ())
}

fn complete(studied: StudyOutcome) -> Findings {
    match studied {
        StudyOutcome::Complete(findings) => findings,
        StudyOutcome::Interrupted(done, of) => panic!("interrupted at {done} of {of}"),
    }
}

#[test]
fn an_interrupted_study_goes_on_to_the_same_end() {
    let [whole, parts] = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let wanted = complete(small(whole.path(), usize::MAX));
    let StudyOutcome::Interrupted(done, of) = small(parts.path(), 5) else { panic!("not interrupted") };
    assert!(done >= 5 && done < of, "{done} of {of}");
    let found = complete(small(parts.path(), usize::MAX));
    assert_eq!((&found.answers, &found.figures), (&wanted.answers, &wanted.figures));
    assert_eq!(found.tables[0].rows, wanted.tables[0].rows);
}

#[test]
fn errors_that_a_reference_cannot_measure_are_hollow_and_nothing_is_said_of_them() {
    let scene = scene(&[SILICONE, WAVE, DRAG, GLYCEROL, "solver.duration_s=0.5", "rod.nodes=5"]);
    let without = ["shape", "overdamped", "symplectic-euler", "newmark"].map(str::to_string).to_vec();
    let asked = AccuracyOptions { nodes: vec![5], steps: vec![2e-2, 1e-2], tolerances: vec![1e-3, 1e-7], without };
    let findings = complete(made(&Study::Accuracy(asked), &scene));
    // The reference takes half of the finest step, so that the smallest tolerance is far better.
    let floor = 2.0 * findings.numbers["reference_5_nodes"]["tip_error"].as_f64().unwrap();
    assert!(floor > 1e-4, "{floor:e}");
    let unknown = findings.answers.iter().filter(|answer| answer.starts_with("For an error of 0.01 %"));
    assert!(
        unknown.clone().count() == 2 && unknown.clone().all(|answer| answer.contains("unknown")),
        "{:?}",
        findings.answers
    );
    let runs = findings.tables.iter().find(|table| table.file == "accuracy.csv").unwrap();
    let column = |name: &str| runs.columns.iter().position(|column| column == name).unwrap();
    let (error, own) = (column("time_error_tip"), column("reference_error_tip"));
    let below = runs.rows.iter().filter(|row| row[error].as_f64() <= row[own].as_f64().map(|own| 2.0 * own)).count();
    assert!(below > 0 && below < runs.rows.len(), "{below}");
    // Each is a mark of the paper's colour within another, before which is the chart's own field; and one method has one colour and dash in all figures.
    let figures = || findings.figures.iter().filter(|figure| figure.svg.contains(">esdirk3</text>"));
    let tip = findings.figures.iter().find(|figure| figure.file == "tip-work.svg").unwrap();
    assert_eq!(tip.svg.matches("class=\"f12\"").count() - 1, below);
    assert!(tip.svg.contains("twice the reference") && tip.caption.contains("Hollow"), "{}", tip.caption);
    let looks = figures().map(|figure| {
        let before = figure.svg.split(">esdirk3</text>").next().unwrap();
        let line = before.rsplit("<polyline").next().unwrap();
        let of =
            |name: &str| line.split(&format!("{name}=\"")).nth(1).unwrap_or("").split('"').next().unwrap().to_string();
        (of("stroke"), of("stroke-dasharray"))
    });
    assert_eq!((looks.collect::<std::collections::BTreeSet<_>>().len(), figures().count()), (1, 6));
}

#[test]
fn a_map_of_stability_shows_the_explicit_limit_and_no_accurate_run_beyond_it() {
    let smooth = scene_of(include_str!("../../models/baseline-smooth.toml"), &["solver.duration_s=0.05"]);
    let asked = StabilityOptions { steps: Some([5e-6, 5e-3]), range: Some([7e6, 7e10]), points: 7, ..SMALL };
    let findings = complete(made(&Study::Stability(asked), &smooth));
    let limit = findings.numbers["limits_by_theory"]["symplectic-euler"]["step_s"].as_f64().unwrap();
    assert!((limit / 2.4928e-5 - 1.0).abs() < 1e-4, "{limit:e}");
    let mut seen = 0;
    for row in &findings.tables[0].rows {
        let (value, step, outcome) = (row[1].as_f64().unwrap(), row[2].as_f64().unwrap(), row[3].as_str().unwrap());
        if row[0] == "symplectic-euler" && step > 1.5 * limit * (7e10 / value).sqrt() {
            assert!(!outcome.contains("accurate"), "{value:e} Pa, {step:e} s: {outcome}");
            seen += 1;
        }
    }
    assert!(seen > 10, "{seen}");
}

/// A clamped strip in nothing but added mass, and the study of it.
fn flutter(changes: &[&str], points: usize) -> Findings {
    let text = include_str!("../../models/flag.toml");
    let bare = text
        .replace("[drag]\nlaw = \"cross-flow\"\n", "")
        .replace("[[loads.point]]\nnode = -1\nforce_n = [0.0, 1e-4]\n", "")
        .replace("[loads]\n", "");
    let asked = StabilityOptions { vary: Vary::Flow, points, ..StabilityOptions::default() };
    complete(made(&Study::Stability(asked), &scene_of(&bare, changes)))
}

#[test]
fn a_map_over_the_flow_shows_flutter_and_divergence_where_theory_has_them() {
    for (changes, outcome) in
        [(&["rod.nodes=33"][..], "flutter"), (&["rod.nodes=33", "reactive.shedding=0.2"], "divergence")]
    {
        let findings = flutter(changes, 5);
        let critical = findings.tables.iter().find(|table| table.file == "critical.csv").unwrap();
        let column = |name: &str| critical.columns.iter().position(|column| column == name).unwrap();
        let [speed, by_theory, what] = ["critical_flow_m_s", "theory_flow_m_s", "outcome"].map(column);
        for row in &critical.rows {
            let numbers = [0, speed, by_theory].map(|i| row[i].as_f64());
            let [Some(share), Some(found), Some(theory)] = numbers else {
                // Beyond the highest speed of the map.
                assert!(row[0].as_f64() > Some(0.9) && outcome == "flutter", "{row:?}");
                continue;
            };
            // Measured on 33 nodes: flutter −3.1e-3 … −7.5e-3 and, at a share of 0.95, whose waves are the shortest, −1.26e-2 (on 65
            // −3.8e-3); divergence 2.9e-4 … 3.1e-4.
            let off = found / theory - 1.0;
            assert!(off.abs() < if share > 0.9 { 1.5e-2 } else { 1e-2 }, "{share}: {found} {theory}");
            assert_eq!(row[what], outcome, "{share}");
        }
        let map = findings.tables.iter().find(|table| table.file == "stability.csv").unwrap();
        for row in &map.rows {
            let beyond = critical.rows.iter().find(|critical| critical[0] == row[0]).unwrap()[speed].as_f64();
            let beyond = beyond.unwrap_or(f64::INFINITY);
            let below = row[1].as_f64().unwrap() < beyond;
            // Beyond divergence the Coriolis force may bring the rest back, and at a share of 0.95 the flutter that begins at u = 17.5
            // ends before 20.
            let quiet_again = outcome == "divergence" || row[0].as_f64() > Some(0.9);
            assert!(if below { row[3] == "stays at rest" } else { quiet_again || row[3] == outcome }, "{row:?}");
        }
    }
}

#[test]
fn a_narrow_window_of_flutter_is_not_stepped_over() {
    // At this share the second mode flutters from u = 7.29 on and is quiet again before the third does from 8.2 on.
    let density = |rho: f64| format!("rod.density_kg_m3={rho:e}");
    let share = |rho: f64| flutter(&["rod.nodes=33", &density(rho)], 2).numbers["mass_ratio"].as_f64().unwrap();
    // m_a/(m + m_a) of one density gives that of any share.
    let (rho, at) = (1000.0, share(1000.0));
    let wanted = rho * at / (1.0 - at) * (1.0 - 0.2955) / 0.2955;
    let found = flutter(&["rod.nodes=33", &density(wanted)], 5).numbers;
    let [critical, theory, unit] = ["critical_speed_m_s", "critical_speed_by_theory_m_s", "unit_speed_m_s"]
        .map(|key| found[key].as_f64().unwrap());
    println!("{} {} {}", found["mass_ratio"], critical / unit, theory / unit);
    assert!((critical / theory - 1.0).abs() < 1e-2 && (theory / unit - 7.2945).abs() < 5e-3, "{critical} {theory}");
}

#[test]
fn the_map_over_the_flow_has_the_water_at_every_speed_and_says_what_it_is_about() {
    let text = include_str!("../../models/flag.toml")
        .replace("[reactive]\n", "")
        .replace("name =", "reactive = \"auto\"\nname =");
    let of = |flow: &str| {
        let asked = StabilityOptions { vary: Vary::Flow, points: 2, ..StabilityOptions::default() };
        let scene = scene_of(&text, &["rod.nodes=17", flow, "loads.point=[]"]);
        (scene.reactive_on().is_some(), complete(made(&Study::Stability(asked), &scene)))
    };
    // So slow a flow needs no water, and the study of all speeds does.
    let (water, slow) = of("medium.flow_m_s=[0.02, 0.0]");
    assert!(!water && slow.numbers["critical_speed_m_s"].as_f64().is_some(), "{:?}", slow.answers);
    let reversed = |findings: &Findings| findings.answers.iter().any(|answer| answer.contains("from the free end"));
    let (_, against) = of("medium.flow_m_s=[-1.8, 0.0]");
    println!("{:#?}\n{:#?}", slow.answers, against.answers);
    assert!(reversed(&against) && !reversed(&slow), "{:?}", against.answers);
    // From the side it is against neither end, and a little from behind it is.
    for (flow, is_against) in [("[0.0, 0.02]", false), ("[0.0, -0.02]", false), ("[-0.001, 0.02]", true)] {
        let (_, findings) = of(&format!("medium.flow_m_s={flow}"));
        assert_eq!(reversed(&findings), is_against, "{flow}: {:?}", findings.answers);
    }
    assert!(
        against.answers.iter().any(|answer| answer.contains("small motions about the equilibrium")),
        "{:?}",
        against.answers
    );
}

#[test]
fn scaling_names_the_meshes_that_fail() {
    let text = include_str!("../../models/baseline-smooth.toml");
    let wild = scene_of(text, &["actuation.kappa_amp=1e5", "solver.time_step_s=0.05"]);
    let findings = complete(made(&Study::Scaling(ScalingOptions { nodes: vec![9, 17], steps: 3 }), &wild));
    let table = &findings.tables[0];
    let [time, tip, failure] = ["step_s", "tip_error", "failure"].map(|name| {
        let at = table.columns.iter().position(|column| column.contains(name));
        at.unwrap_or_else(|| panic!("{name}: {:?}", table.columns))
    });
    let failed: Vec<_> = table.rows.iter().filter(|row| !row[failure].is_null()).collect();
    assert!(!failed.is_empty(), "{:?}", table.rows);
    assert!(failed.iter().all(|row| row[time].is_null() && row[tip].is_null()), "{failed:?}");
}

#[test]
fn the_steps_of_a_mesh_take_no_longer_than_the_study_of_it() {
    let scene = scene_of(include_str!("../../models/baseline-smooth.toml"), &[]);
    let begun = std::time::Instant::now();
    let steps = 300;
    let findings = complete(made(&Study::Scaling(ScalingOptions { nodes: vec![9], steps }), &scene));
    let whole = begun.elapsed().as_secs_f64();
    let table = &findings.tables[0];
    let column = table.columns.iter().position(|column| column == "step_s").unwrap();
    let times: Vec<f64> = table.rows.iter().map(|row| steps as f64 * row[column].as_f64().unwrap()).collect();
    println!("{times:?} of {whole} s");
    assert!(times.len() == 2 && times.iter().sum::<f64>() < whole && times.iter().all(|time| *time > 1e-6 * whole));
}

#[test]
fn a_run_whose_steps_end_a_rounding_before_its_duration_is_whole() {
    // Sums of steps of 15 ms a rounding below these, and the last of 200 samples a rounding above those.
    for (duration, step) in [(0.165, 0.015), (0.225, 0.015), (0.15, 0.015)] {
        let whole = format!("solver.duration_s={duration}");
        let scene = scene(&[SILICONE, WAVE, DRAG, GLYCEROL, &whole, "rod.nodes=5", "actuation.kappa_amp=0.1"]);
        let asked = AccuracyOptions {
            nodes: vec![5],
            steps: vec![2.0 * step, step],
            tolerances: vec![1e-3],
            without: vec!["symplectic-euler".into()],
        };
        let findings = complete(made(&Study::Accuracy(asked), &scene));
        let runs = findings.tables.iter().find(|table| table.file == "accuracy.csv").unwrap();
        let column = |name: &str| runs.columns.iter().position(|column| column == name).unwrap();
        let [model, error] = ["model", "time_error_tip"].map(column);
        let full = runs.rows.iter().filter(|row| row[model] == "full");
        assert!(full.clone().all(|row| row[error].is_number()), "{duration} s: {:?}", runs.rows);
        assert!(full.count() >= 8, "{:?}", runs.rows);
    }
    let outcomes = |duration: f64| {
        let duration = format!("solver.duration_s={duration}");
        let scene = scene(&[SILICONE, WAVE, DRAG, GLYCEROL, &duration, "rod.nodes=5"]);
        let findings = complete(made(&Study::Stability(SMALL), &scene));
        let column = findings.tables[0].columns.iter().position(|column| column == "outcome").unwrap();
        findings.tables[0].rows.iter().map(|row| row[column].to_string()).collect::<Vec<_>>()
    };
    let usual = outcomes(0.05);
    assert!(usual.iter().any(|outcome| outcome.contains("accurate")), "{usual:?}");
    for duration in [0.052, 0.054] {
        assert_eq!(outcomes(duration), usual, "{duration} s");
    }
}

#[test]
fn scaling_shows_second_order_in_the_mesh_and_agreement_of_both_forms() {
    let fine = scene_of(include_str!("../../models/fine-1e3.toml"), &[]);
    let findings = complete(made(&Study::Scaling(ScalingOptions { nodes: vec![17, 33, 65, 1025], steps: 3 }), &fine));
    let rows = &findings.tables[0].rows;
    assert_eq!(rows.len(), 8);
    let error = |nodes: u64, form: &str| {
        let row = rows.iter().find(|row| row[0] == nodes && row[1] == form).unwrap();
        row[10].as_f64().unwrap()
    };
    for form in ["positions", "chain"] {
        for (coarse, fine) in [(17, 33), (33, 65)] {
            let order = (error(coarse, form) / error(fine, form)).log2();
            assert!((order - 2.0).abs() < 0.05, "{form} {coarse}: {order}");
        }
        assert!((error(65, form) / error(65, "chain") - 1.0).abs() < 1e-7);
    }
}

fn caudal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).output().unwrap()
}

#[test]
fn the_command_writes_a_page_numbers_tables_and_figures_and_no_journal() {
    let folder = tempfile::tempdir().unwrap();
    let scene = "models/cantilever.toml";
    let small = ["--set", "solver.duration_s=0.02", "--points", "2"];
    let modes = [
        "damped.csv",
        "damped.svg",
        "damping.mtx",
        "frequencies.svg",
        "manifest.json",
        "mass.mtx",
        "modes.csv",
        "report.html",
        "shapes.csv",
        "shapes.svg",
        "stiffness.mtx",
        "summary.json",
    ];
    let stability = ["manifest.json", "report.html", "stability.csv", "stability.svg", "summary.json"];
    for (kind, more, wanted) in [("modes", &[][..], &modes[..]), ("stability", &small, &stability)] {
        let out = folder.path().join(kind);
        let output = caudal(&[&["study", kind, scene, "--out", out.to_str().unwrap()], more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        let mut names: Vec<_> =
            std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        assert_eq!(names, wanted);
    }
    let shapes = std::fs::read_to_string(folder.path().join("modes/shapes.csv")).unwrap();
    assert!(shapes.lines().count() > 2 && !shapes.split([',', '\n']).any(|cell| cell == "-0.0"), "{shapes}");
}

#[test]
fn what_cannot_be_studied_is_refused_as_wrong_input() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new");
    for arguments in [
        &["study", "stability", "models/cantilever.toml", "--vary", "amplitude"][..],
        &["study", "stability", "models/cantilever.toml", "--vary", "spin"],
        &["study", "stability", "models/cantilever.toml", "--range", "2,1"],
        &["study", "stability", "models/cantilever.toml", "--vary", "flow"],
        &["study", "stability", "models/fish.toml", "--vary", "flow"],
        &["study", "stability", "models/flag.toml", "--vary", "flow", "--steps", "1e-3,1e-2"],
        &[
            "study",
            "stability",
            "models/flag.toml",
            "--vary",
            "flow",
            "--set",
            "medium.flow_m_s=[{ amplitude = 1, frequency_hz = 1 }, 0]",
        ],
        &["study", "accuracy", "models/baseline.toml", "--steps", "-1"],
        &["study", "accuracy", "models/baseline.toml", "--tolerances", "2"],
        &["study", "accuracy", "models/baseline.toml", "--nodes", ""],
        &["study", "scaling", "models/baseline.toml", "--nodes", "2"],
        &["study", "modes", "models/nothing.toml"],
    ] {
        let output = caudal(&[arguments, &["--out", out.to_str().unwrap()]].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        assert!(!out.exists(), "{arguments:?}");
    }
}

#[test]
fn options_given_by_name_are_in_range_and_no_empty_list() {
    use serde_json::json;
    for (kind, options, problem) in [
        ("accuracy", json!({ "nodes": [] }), "nodes: found an empty list; allowed: one number or more"),
        ("accuracy", json!({ "tolerances": [] }), "tolerances: found an empty list"),
        ("accuracy", json!({ "steps": [] }), "steps: found an empty list"),
        ("scaling", json!({ "nodes": [] }), "nodes: found an empty list"),
        ("accuracy", json!({ "steps": [1e9] }), "steps: found 1000000000; allowed: up to the duration of the scene"),
        ("scaling", json!({ "steps": 2.5 }), "steps: found 2.5; allowed: a whole number that is not negative"),
        ("accuracy", json!({ "tolerances": [2.0] }), "tolerances: found 2; allowed: a number between 0 and 1"),
        ("accuracy", json!({ "tolerances": [0.5, 0.0] }), "tolerances: found 0; allowed: a number between 0 and 1"),
    ] {
        let serde_json::Value::Object(options) = options else { panic!() };
        let stop = AtomicBool::new(false);
        let error = match Study::named(kind, &options) {
            Err(error) => error,
            Ok(study) => {
                let folder = tempfile::tempdir().unwrap();
                let scene = scene_of(include_str!("../../models/baseline.toml"), &[]);
                let held = claimed(&study, &scene, folder.path());
                study.run(&scene, StudyRunner::new(&held, &stop, &|_, _| {})).unwrap_err()
            }
        };
        assert!(error.to_string().contains(problem), "{kind} {options:?}: {error}");
    }
    assert!(Study::named("accuracy", json!({ "without": [] }).as_object().unwrap()).is_ok());
}

/// A column that bends a little from the start goes on bending as its load grows: it does not jump to another rest.
#[test]
fn the_rest_of_a_bent_column_is_followed_as_its_load_grows() {
    let text = include_str!("../../models/beck-column.toml")
        .replace("follows = true\n", "")
        .replace("force_n = [-10.0, 0.0]", "force_n = [-1.0, 0.05]")
        .replace("force_n = [0.0, 1e-3]", "force_n = [0.0, 0.0]");
    let asked = StabilityOptions { vary: Vary::Load, points: 4, ..StabilityOptions::default() };
    let findings = complete(made(&Study::Stability(asked), &scene_of(&text, &["rod.nodes=17"])));
    let map = findings.tables.iter().find(|table| table.file == "stability.csv").unwrap();
    assert!(map.rows.iter().all(|row| row[3] == "stays at rest"), "{:?}", map.rows);
}

#[test]
fn without_meshes_and_steps_a_study_of_accuracy_takes_the_scene_s_own_and_finer_ones() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let few = "implicit-euler,symplectic-euler,newmark,esdirk3,overdamped,shape";
    let sets =
        ["rod.nodes=3", "solver.time_step_s=0.02", "solver.duration_s=0.7"].into_iter().flat_map(|set| ["--set", set]);
    let study = ["study", "accuracy", "models/eel.toml", "--without", few, "--out", out, "--force"];
    let output = caudal(&study.into_iter().chain(sets).collect::<Vec<_>>());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let table = std::fs::read_to_string(folder.path().join("accuracy.csv")).unwrap();
    let steps = (0..9).map(|i| 0.16 / f64::from(1 << i));
    let expected: Vec<String> = [3, 5, 9]
        .iter()
        .flat_map(|nodes| steps.clone().map(move |step| format!("generalized-alpha(0.8),{step},,{nodes}")))
        .collect();
    let found: Vec<_> =
        table.lines().skip(1).map(|row| row.split(',').skip(1).take(4).collect::<Vec<_>>().join(",")).collect();
    assert_eq!(found, expected);
}

#[test]
fn a_study_of_several_meshes_calls_the_scene_s_own_mesh_so_and_no_other() {
    let scene =
        scene(&[SILICONE, WAVE, DRAG, GLYCEROL, "solver.duration_s=0.2", "rod.nodes=9", "solver.time_step_s=1e-2"]);
    let without = ["shape", "overdamped", "symplectic-euler", "newmark", "esdirk3"].map(str::to_string).to_vec();
    for (meshes, said) in [
        (vec![5, 9], "The scene as it stands, implicit-euler with steps of 1e-2 s on 9 nodes: "),
        (vec![5, 7], "The scene's method and step on 5 nodes instead of its 9, implicit-euler with steps of 1e-2 s: "),
    ] {
        let own = meshes.contains(&9);
        let asked =
            AccuracyOptions { nodes: meshes, steps: vec![1e-2], tolerances: vec![1e-2], without: without.clone() };
        let findings = complete(made(&Study::Accuracy(asked), &scene));
        let answers = &findings.answers;
        assert!(answers.iter().any(|answer| answer.starts_with(said)), "{answers:?}");
        assert_eq!(findings.tables[0].title.contains("the scene's own mesh"), own, "{}", findings.tables[0].title);
        let nodes = if own { "9 nodes" } else { "5 nodes" };
        let figures = findings.figures.iter().filter(|figure| figure.file.ends_with("-time.svg"));
        assert!(figures.clone().count() > 0 && figures.clone().all(|figure| figure.svg.contains(nodes)));
    }
}

/// A small rod of silicone that swims in a viscous fluid.
const SWIMMER: &str = r#"
name = "swimmer"
rod = { nodes = 7, length_m = 0.3, outer_radius_m = 0.004, youngs_modulus_pa = 1e6, density_kg_m3 = 1000.0 }
medium = { viscosity_pa_s = 1.0, density_kg_m3 = 1000.0 }
drag.law = "cox"
[actuation]
kind = "travelling-wave"
kappa_amp = 12
frequency_hz = 2
wavelength_m = 0.3
envelope = [0.3, 0.7]
[solver]
duration_s = 2.0
time_step_s = 0.02
"#;

/// The same without its actuation: it stays where it is.
fn at_rest() -> String {
    let (before, after) = SWIMMER.split_once("[actuation]").unwrap();
    format!("{before}[solver]{}", after.split_once("[solver]").unwrap().1)
}

#[test]
fn a_drive_near_a_frequency_that_the_fluid_damps_is_no_resonance() {
    let study = Study::named("modes", serde_json::json!({ "count": 4 }).as_object().unwrap()).unwrap();
    let of = |changes: &[&str]| complete(made(&study, &scene_of(SWIMMER, changes))).answers.join("\n");
    let damped = of(&[]);
    assert!(damped.contains("near it, but damping leaves no resonance (damping ratio "), "{damped}");
    let thin = of(&["medium.viscosity_pa_s=1e-3"]);
    assert!(thin.contains("the rod resonates"), "{thin}");
}

/// Measured: growth rates of up to 2e-12 1/s of the undamped column without loads, of rounding alone.
#[test]
fn modes_say_where_the_rod_is_what_they_leave_out_and_no_growth_by_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let follower = "loads.point=[{ node = -1, follows = true, force_n = [-10.0, 0.0] }]";
    let gravity = "loads={ gravity_m_s2 = [0.0, -0.1], point = [] }";
    let none = "loads={ point = [] }";
    let damped = "rod.damping_time_s=1e-3";
    for (n, (scene, sets, natural, rest)) in [
        ("beck-column", &[][..], "in vacuum, without its loads.", Some("In vacuum, at rest under its loads ")),
        ("beck-column", &[follower], "in vacuum, without its loads.", Some("In vacuum, at rest under its loads ")),
        ("beck-column", &[gravity], "in vacuum, without its loads.", Some("In vacuum, at rest under its loads ")),
        ("beck-column", &[none], "in vacuum.", None),
        ("beck-column", &[none, damped], "in vacuum.", Some("In vacuum, at rest 0 m from straight,")),
        ("eel", &[], "with added mass.", Some("In the fluid, with which a free rod goes,")),
        ("flag", &[], "with added mass", Some("In the flow of ")),
    ]
    .into_iter()
    .enumerate()
    {
        let out = folder.path().join(n.to_string());
        let file = format!("models/{scene}.toml");
        let mut arguments = vec!["study", "modes", &file, "--set", "rod.nodes=9", "--out", out.to_str().unwrap()];
        sets.iter().for_each(|set| arguments.extend(["--set", set]));
        let output = caudal(&arguments);
        let said = String::from_utf8_lossy(&output.stdout);
        let case = format!("{scene} {sets:?}: {said}{}", String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success() && said.contains(natural), "{case}");
        let is_told = said.lines().any(|line| line.starts_with("In "));
        assert!(is_told == rest.is_some() && said.contains(rest.unwrap_or_default()), "{case}");
        let Ok(table) = std::fs::read_to_string(out.join("damped.csv")) else { continue };
        let undamped = scene == "beck-column" && !sets.contains(&damped);
        for row in table.lines().skip(1) {
            let cells: Vec<f64> = row.split(',').skip(2).map(|cell| cell.parse().unwrap()).collect();
            assert!(!undamped || cells[1..] == [0.0, 0.0], "{case}{table}");
            assert!(!row.contains("-0.0,") && !row.ends_with("-0.0"), "{case}{table}");
        }
    }
}

#[test]
fn a_rod_at_rest_tests_no_step() {
    let asked = StabilityOptions { range: Some([1e5, 1e6]), steps: Some([1e-2, 2e-2]), points: 2, ..SMALL };
    let scene = scene_of(&at_rest(), &["rod.nodes=3", "solver.duration_s=0.2"]);
    let findings = complete(made(&Study::Stability(asked), &scene));
    let all = findings.answers.join("\n");
    assert!(
        !all.contains("accurate up to") && all.contains("symplectic-euler: not tested, because nothing moves"),
        "{all}"
    );
    assert!(all.contains("The rod does not move in"), "{all}");
}

#[test]
fn an_amplitude_of_zero_is_not_varied_and_its_key_is_named() {
    let scene = scene_of(SWIMMER, &["actuation.kappa_amp=0"]);
    let study = Study::Stability(StabilityOptions { vary: Vary::Amplitude, range: None, ..SMALL });
    let folder = tempfile::tempdir().unwrap();
    let (held, interrupted) = (claimed(&study, &scene, folder.path()), AtomicBool::new(false));
    let error = study.run(&scene, StudyRunner::new(&held, &interrupted, &|_, _| ())).unwrap_err().to_string();
    assert!(error.contains("actuation.kappa_amp") && error.contains("zero"), "{error}");
}

#[test]
fn errors_that_are_all_zero_have_no_figure_but_a_word() {
    let asked = ScalingOptions { nodes: vec![5, 9], steps: 2 };
    let findings = complete(made(&Study::Scaling(asked), &scene_of(&at_rest(), &[])));
    assert!(!findings.figures.iter().any(|figure| figure.file == "error.svg"));
    assert!(findings.answers.iter().any(|answer| answer.starts_with("No errors are drawn")), "{:?}", findings.answers);
}
