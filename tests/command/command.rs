//! The command does what its contract says: files, exit codes, and nothing half-written.

use crate::common;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

/// The files of a run, in the order of their names.
const FILES: [&str; 17] = [
    "amplitude.svg",
    "com_path.svg",
    "curvature.svg",
    "energy.svg",
    "envelope.svg",
    "manifest.json",
    "mid_y.svg",
    "nodes.csv",
    "phase.svg",
    "power.svg",
    "power_along.svg",
    "report.html",
    "shape.svg",
    "speed.svg",
    "summary.json",
    "tip_y.svg",
    "trajectory.csv",
];

/// The figures of a whole cycle.
const OF_A_CYCLE: [&str; 3] = ["amplitude.svg", "envelope.svg", "phase.svg"];

/// The files of a run that ends before its first cycle.
fn files_before_a_cycle() -> Vec<&'static str> {
    FILES.into_iter().filter(|name| !OF_A_CYCLE.contains(name)).collect()
}

fn caudal(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments).output().unwrap()
}

fn run(scene: &str, out: &Path, more: &[&str]) -> Output {
    caudal(&[&["run", scene, "--out", out.to_str().unwrap()], more].concat())
}

fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn summary(folder: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join("summary.json")).unwrap()).unwrap()
}

fn rows(path: PathBuf) -> Vec<Vec<f64>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.records().map(|row| row.unwrap().iter().map(|field| field.parse().unwrap()).collect()).collect()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn adaptive_steps_are_recorded_at_the_times_asked_for_and_do_not_depend_on_them() {
    let ends = ["0.05", "0.013"].map(|interval| {
        let folder = tempfile::tempdir().unwrap();
        let more = ["solver.tolerance=1e-3", "solver.integrator=esdirk3", "solver.duration_s=1"];
        let interval_key = format!("record.interval_s={interval}");
        let sets = more.into_iter().chain([interval_key.as_str()]).flat_map(|set| ["--set", set]).collect::<Vec<_>>();
        let output = run("models/baseline-smooth.toml", folder.path(), &sets);
        assert!(output.status.success(), "{output:?}");
        let trajectory = rows(folder.path().join("trajectory.csv"));
        let step: f64 = interval.parse().unwrap();
        let times: Vec<f64> = trajectory.iter().map(|row| row[0]).collect();
        let wanted: Vec<f64> = (0..).map(|i| f64::from(i) * step).take_while(|t| *t <= 1.0).collect();
        assert_eq!(times[..wanted.len()], wanted);
        assert_eq!(*times.last().unwrap(), 1.0);
        trajectory.last().unwrap().clone()
    });
    assert_eq!(ends[0], ends[1]);
}

#[test]
fn the_baseline_runs_to_the_numbers_of_the_independent_implementation() {
    let folder = tempfile::tempdir().unwrap();
    let output = run("models/baseline.toml", folder.path(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(text(&output.stderr), "", "quiet where there is no terminal");
    assert_eq!(files(folder.path()), FILES);
    let summary = summary(folder.path());
    // Measured: 7e-13 and 3e-13 m with newton_tolerance = 1e-12, 4e-12 m with the default.
    assert!((summary["x_com_m"].as_f64().unwrap() - 0.45592738522).abs() < 1e-8);
    assert!((summary["y_com_m"].as_f64().unwrap() - 0.00362578129).abs() < 1e-8);
    assert_eq!(summary["steps"], 4000);
    let trajectory = rows(folder.path().join("trajectory.csv"));
    assert_eq!(trajectory.len(), 4001);
    assert_eq!(
        trajectory[4000][..3],
        [20.0, summary["x_com_m"].as_f64().unwrap(), summary["y_com_m"].as_f64().unwrap()]
    );
    let nodes = rows(folder.path().join("nodes.csv"));
    let last: Vec<f64> = summary["final_positions_m"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|p| p.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()))
        .collect();
    assert_eq!(nodes[4000][1..], last);
}

#[test]
fn every_scene_of_models_runs_and_is_checked() {
    let mut scenes = 0;
    for path in common::scene_files("models") {
        let folder = tempfile::tempdir().unwrap();
        // Those of the finest meshes make a step or two.
        let nodes = caudal::scene::Scene::load(&path).unwrap().rod.nodes.get();
        let duration = format!("solver.duration_s={}", if nodes > 200 { 1e-3 } else { 0.1 });
        let output = run(path.to_str().unwrap(), folder.path(), &["--set", &duration]);
        assert_eq!(output.status.code(), Some(0), "{}: {}", path.display(), text(&output.stderr));
        let scene = caudal::scene::Scene::load(&path).unwrap();
        let held = scene.head.kind != caudal::scene::HeadKind::Free;
        let mut expected: Vec<_> = FILES.into_iter().filter(|name| nodes <= 200 || *name != "nodes.csv").collect();
        // Of a few steps there is neither power nor curvature over time, and of less than a cycle nothing that is of one.
        let optional =
            |name: &&str| OF_A_CYCLE.contains(name) || ["curvature.svg", "power.svg", "power_along.svg"].contains(name);
        expected.retain(|name| !optional(name) || folder.path().join(name).exists());
        expected.extend(scene.reactive.is_some().then_some(["fluid_force.svg", "momentum.svg"]).into_iter().flatten());
        expected.extend(held.then_some(["head_force.svg", "head_moment.svg"]).into_iter().flatten());
        let hinged = scene.head.kind == caudal::scene::HeadKind::Hinged;
        expected.extend(hinged.then_some(["hinge_angle.svg", "hinge_torque.svg"]).into_iter().flatten());
        expected.extend((!scene.tendons.is_empty()).then_some("tendons.svg"));
        expected.sort_unstable();
        assert_eq!(files(folder.path()), expected, "{}", path.display());
        for figure in expected.iter().filter(|name| name.ends_with(".svg")) {
            let svg = std::fs::read_to_string(folder.path().join(figure)).unwrap();
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{figure}");
            assert!(
                ["m)", "J)", "N)", "N s)", "m/s)", "W)", "rad)"].iter().any(|unit| svg.contains(unit)),
                "{figure} has units"
            );
        }
        let check = caudal(&["check", path.to_str().unwrap()]);
        assert_eq!(check.status.code(), Some(0));
        assert!(text(&check.stdout).contains("first natural frequency"));
        scenes += 1;
    }
    assert!(scenes >= 8);
}

#[test]
fn wrong_input_ends_with_2_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for more in [&["--set", "rod.nodes=2"][..], &["--set", "rod.length_mm=1"], &["--set", "nonsense"]] {
        let output = run("models/baseline.toml", &out, more);
        assert_eq!(output.status.code(), Some(2));
        assert_eq!(text(&output.stderr).lines().count(), 1, "one clear message: {}", text(&output.stderr));
        assert!(!out.exists());
    }
    assert_eq!(run("models/none.toml", &out, &[]).status.code(), Some(2));
    assert!(!out.exists());
    // A folder that cannot be made: its parent is a file.
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let output = run("models/baseline.toml", &file.join("out"), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("cannot be written"), "{}", text(&output.stderr));
}

#[test]
fn a_run_replaces_its_own_files_only() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let short = ["--set", "solver.duration_s=0.1"];
    assert_eq!(run("models/baseline.toml", folder.path(), &short).status.code(), Some(0));
    let first = std::fs::read(folder.path().join("trajectory.csv")).unwrap();
    let without = [&short[..], &["--set", "record.nodes_table=none", "--set", "medium.viscosity_pa_s=1.0"]].concat();
    assert_eq!(run("models/baseline.toml", folder.path(), &without).status.code(), Some(0));
    assert_ne!(std::fs::read(folder.path().join("trajectory.csv")).unwrap(), first);
    assert_eq!(std::fs::read_to_string(folder.path().join("notes.txt")).unwrap(), "mine");
    // The nodes.csv of the first run does not belong to the second; nothing unfinished is left either.
    let mut expected: Vec<&str> =
        files_before_a_cycle().into_iter().filter(|name| *name != "nodes.csv").chain(["notes.txt"]).collect();
    expected.sort_unstable();
    assert_eq!(files(folder.path()), expected);
}

#[test]
fn a_failing_run_ends_with_1_and_keeps_what_it_computed() {
    let folder = tempfile::tempdir().unwrap();
    // Newmark (1/4, 1/2) does not damp the ringing of the jump start, and Newton fails on it after 54 steps.
    let output = run("models/glycerol.toml", folder.path(), &["--set", "solver.integrator=newmark"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert_eq!(files(folder.path()), files_before_a_cycle());
    let summary = summary(folder.path());
    assert_eq!(summary["complete"], false);
    let end = summary["end_time_s"].as_f64().unwrap();
    assert!((0.0..5.0).contains(&end));
    assert_eq!(rows(folder.path().join("trajectory.csv")).last().unwrap()[0], end);
    assert!(text(&output.stderr).contains("t = "), "{}", text(&output.stderr));
}

#[cfg(unix)]
#[test]
fn interrupted_runs_end_with_130_and_valid_files() {
    let folder = tempfile::tempdir().unwrap();
    let child = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", "models/baseline.toml", "--set", "solver.duration_s=1e5", "--set", "record.every=10", "--out"])
        .arg(folder.path())
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // Wait until it is under way, then press Ctrl-C.
    let start = Instant::now();
    while files(folder.path()).is_empty() && start.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(Duration::from_millis(300));
    crate::interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    assert!(text(&output.stderr).contains("interrupted"), "{}", text(&output.stderr));
    // Of a long run the last period was recorded at a few times, too few to be drawn.
    let always =
        |name: &&str| !OF_A_CYCLE.contains(name) && !["curvature.svg", "power.svg", "power_along.svg"].contains(name);
    let written = files(folder.path());
    assert!(FILES.into_iter().filter(always).all(|name| written.contains(&name.to_string())), "{written:?}");
    assert!(written.iter().all(|name| FILES.contains(&name.as_str())), "{written:?}");
    let summary = summary(folder.path());
    assert_eq!(summary["ending"], "interrupted");
    let end = summary["end_time_s"].as_f64().unwrap();
    assert!(end > 0.0);
    assert_eq!(rows(folder.path().join("nodes.csv")).last().unwrap()[0], end);
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_no_half_written_file() {
    let folder = tempfile::tempdir().unwrap();
    let short = ["--set", "solver.duration_s=0.1"];
    assert_eq!(run("models/baseline.toml", folder.path(), &short).status.code(), Some(0));
    let before = std::fs::read_to_string(folder.path().join("trajectory.csv")).unwrap();
    // A limit on the size of files stands in for the end of the disk: writing beyond it fails in the same way.
    let command = format!(
        "trap '' XFSZ; ulimit -f 200; exec '{}' run models/baseline.toml --out '{}'",
        env!("CARGO_BIN_EXE_caudal"),
        folder.path().display()
    );
    let output = Command::new("sh").current_dir(env!("CARGO_MANIFEST_DIR")).args(["-c", &command]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("cannot be written"), "{}", text(&output.stderr));
    // Rows that were written take the place of those of the earlier run, and are whole.
    assert!(files(folder.path()).iter().all(|name| FILES.contains(&name.as_str())), "{:?}", files(folder.path()));
    let kept = std::fs::read_to_string(folder.path().join("trajectory.csv")).unwrap();
    assert!(kept.lines().count() > before.lines().count() && kept.ends_with('\n'));
    let columns = |line: &str| line.split(',').count();
    assert!(kept.lines().all(|line| columns(line) == columns(before.lines().next().unwrap())));
}

#[test]
fn the_variables_of_a_scene_are_listed_with_their_sizes() {
    let all = caudal(&["variables"]);
    let of_scene = caudal(&["variables", "models/baseline.toml"]);
    assert_eq!((all.status.code(), of_scene.status.code()), (Some(0), Some(0)));
    let (all, of_scene) = (text(&all.stdout), text(&of_scene.stdout));
    assert!(all.lines().count() > of_scene.lines().count(), "a free head has no reaction force");
    let curvature = of_scene.lines().find(|line| line.starts_with("natural_curvature_1_m")).unwrap();
    assert_eq!(
        curvature.split_whitespace().take(4).collect::<Vec<_>>(),
        ["natural_curvature_1_m", "7", "1/m", "input"]
    );
}

#[cfg(feature = "pictures")]
#[test]
fn films_and_positions_go_to_folders_that_are_made_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("films/of/today");
    let more = ["--set", "solver.duration_s=0.2", "--gif", "--vtk", "--out", out.to_str().unwrap()];
    let made = caudal(&[&["export", "models/baseline.toml"], &more[..]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(std::fs::read(out.join("baseline.gif")).unwrap().starts_with(b"GIF89a"));
    assert!(out.join("baseline.pvd").exists());
    assert!(files(&out).iter().all(|file| !file.starts_with('.')), "{:?}", files(&out));
}

/// The pictures of a GIF.
#[cfg(feature = "pictures")]
fn pictures(file: &std::path::Path) -> usize {
    let mut decoder = gif::DecodeOptions::new().read_info(std::fs::File::open(file).unwrap()).unwrap();
    std::iter::from_fn(|| decoder.read_next_frame().unwrap().map(|_| ())).count()
}

#[cfg(feature = "pictures")]
#[test]
fn a_film_shows_the_part_of_the_run_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let film = |more: &[&str]| {
        let all = ["export", "models/baseline.toml", "--set", "solver.duration_s=0.4", "--gif", "--force", "--out"];
        caudal(&[&all[..], &[folder.path().to_str().unwrap()], more].concat())
    };
    let count = |more: &[&str]| {
        let made = film(more);
        assert!(made.status.success(), "{}", text(&made.stderr));
        pictures(&folder.path().join("baseline.gif"))
    };
    // Two beats per second are slowed down to one; what is less than a beat takes a second.
    assert_eq!([count(&[]), count(&["--from", "0.2"]), count(&["--from", "0.1", "--until", "0.3"])], [25, 25, 25]);
    let refused = film(&["--from", "0.5"]);
    assert!(text(&refused.stderr).contains("allowed: a part of the run, 0 to 0.4 s"), "{}", text(&refused.stderr));
    let missing = caudal(&["export", "out/nothing-here", "--gif"]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(text(&missing.stderr).contains("`caudal run SCENE` makes"), "{}", text(&missing.stderr));
}

#[test]
fn chosen_nodes_and_times_come_out_the_same_as_csv_and_as_parquet() {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    let folder = tempfile::tempdir().unwrap();
    let chosen =
        ["--set", "solver.duration_s=0.2", "--set", "record.nodes=[0,4,-1]", "--set", "record.nodes_from_s=0.1"];
    let scene = "models/baseline-smooth.toml";
    assert_eq!(run(scene, folder.path(), &chosen).status.code(), Some(0));
    let table = rows(folder.path().join("nodes.csv"));
    assert_eq!((table.len(), table[0].len(), table[0][0]), (21, 7, 0.1));
    let as_parquet = [&chosen[..], &["--set", "record.nodes_table=parquet"]].concat();
    assert_eq!(run(scene, folder.path(), &as_parquet).status.code(), Some(0));
    assert!(!folder.path().join("nodes.csv").exists());
    let file = std::fs::File::open(folder.path().join("nodes.parquet")).unwrap();
    let mut read = Vec::new();
    for row in SerializedFileReader::new(file).unwrap().get_row_iter(None).unwrap() {
        let row = row.unwrap();
        let number = |i| row.get_double(i).unwrap();
        read.push((number(0), row.get_int(1).unwrap(), number(2), number(3)));
    }
    let expected: Vec<_> = table
        .iter()
        .flat_map(|row| [0, 4, 8].into_iter().enumerate().map(|(i, k)| (row[0], k, row[1 + 2 * i], row[2 + 2 * i])))
        .collect();
    assert_eq!(read, expected);
}

#[cfg(all(unix, feature = "design"))]
#[test]
fn an_interrupted_design_ends_with_130_and_keeps_the_best_so_far() {
    use std::io::{BufRead, BufReader};
    let folder = tempfile::tempdir().unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["design", "models/design-silicone-eel.toml", "--set", "design.starts=1000", "--out"])
        .arg(folder.path())
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Ctrl-C after five iterations.
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    assert!(lines.by_ref().take(5).all(|line| line.unwrap().starts_with("start 1 iteration")));
    crate::interrupt(&child);
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{rest:?}");
    assert!(text(&output.stderr).contains("best design so far"), "{}", text(&output.stderr));
    let text = std::fs::read_to_string(folder.path().join("design.json")).unwrap();
    let numbers: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(numbers["status"], "interrupted");
    let best = numbers["answer"]["history"].as_array().unwrap().iter().map(|i| i["objective"].as_f64().unwrap());
    assert!(numbers["answer"]["objective"].as_f64().unwrap() >= best.fold(0.0, f64::max));
    let designed = folder.path().join("design-silicone-eel-designed.toml");
    assert_eq!(caudal(&["check", designed.to_str().unwrap()]).status.code(), Some(0));
}

#[cfg(all(unix, feature = "design"))]
#[test]
fn a_design_that_cannot_be_written_or_is_wrong_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (scene, change) in [
        ("models/design-identify.toml", "design.data=none.csv"),
        ("models/design-silicone-eel.toml", "design.mean=0.1"),
        ("models/baseline.toml", "name=nothing-asked"),
    ] {
        let output = caudal(&["design", scene, "--set", change, "--out", out.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{change}: {}", text(&output.stderr));
        assert!(!out.exists(), "{change}");
    }
    // A place that nothing can be written to is refused before the search.
    let output = caudal(&["design", "models/design-silicone-eel.toml", "--out", "/proc/caudal"]);
    assert_eq!((output.status.code(), text(&output.stdout)), (Some(2), ""), "{}", text(&output.stderr));
}

#[test]
fn what_check_warns_of_is_in_the_notes_of_the_summary() {
    let folder = tempfile::tempdir().unwrap();
    let scene = ["models/baseline.toml", "--set", "solver.duration_s=0.02"];
    let checked = caudal(&[&["check"], &scene[..]].concat());
    let warnings: Vec<_> = text(&checked.stdout).lines().filter_map(|line| line.strip_prefix("warning: ")).collect();
    assert!(warnings.len() >= 2, "{warnings:?}");
    assert!(run(scene[0], folder.path(), &scene[1..]).status.success());
    let summary = summary(folder.path());
    let notes: Vec<_> = summary["notes"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    // Ranges are judged by the motion that is foreseen, then by the run's own.
    let is_range = |text: &&&str| text.contains("is outside its range: Reynolds number");
    let others: Vec<_> = warnings.iter().filter(|text| !is_range(text)).copied().collect();
    assert_eq!(notes[..others.len()], others, "{notes:?}");
    assert_eq!(warnings.iter().filter(is_range).count(), 1, "{warnings:?}");
    assert_eq!(notes.iter().filter(is_range).count(), 1, "{notes:?}");
}

#[test]
fn a_study_of_modes_does_not_judge_a_step_that_adaptive_steps_have_not() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let study = |steps: &str| {
        let arguments = ["study", "modes", "models/baseline-smooth.toml", "--out", out];
        let output = caudal(&[&arguments[..], &["--set", "solver.integrator=esdirk3", "--set", steps]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout).to_string()
    };
    assert!(study("solver.time_step_s=1e-3").contains("The step of 0.001 s resolves"));
    assert!(!study("solver.tolerance=1e-3").contains("The step of"));
}

#[test]
fn every_key_of_the_schema_is_in_the_reference() {
    fn keys(schema: &Value, found: &mut Vec<String>) {
        if let Some(properties) = schema["properties"].as_object() {
            found.extend(properties.keys().cloned());
        }
        match schema {
            Value::Object(entries) => entries.values().for_each(|entry| keys(entry, found)),
            Value::Array(entries) => entries.iter().for_each(|entry| keys(entry, found)),
            _ => {}
        }
    }
    let schema: Value = serde_json::from_slice(&caudal(&["schema"]).stdout).unwrap();
    let mut found = Vec::new();
    keys(&schema, &mut found);
    assert!(found.len() > 100, "{}", found.len());
    let reference = std::fs::read_to_string("docs/src/reference.md").unwrap();
    // A key is a word of its own.
    let words: std::collections::BTreeSet<&str> =
        reference.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).collect();
    found.retain(|key| !words.contains(&**key));
    assert!(found.is_empty(), "{found:?}");
}

/// A body's moment of inertia is not the fluid's: in next to no fluid leaving that out changes nothing.
#[test]
fn what_a_body_at_the_head_takes_of_a_frequency_is_not_laid_to_the_fluid() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("body.toml");
    let text = "[rod]\nnodes = 17\nlength_m = 0.3\nouter_radius_m = 0.004\nyoungs_modulus_pa = 1e8\ndensity_kg_m3 = 1100.0\n\
        [head_body]\nsemi_axis_along_m = 0.05\nsemi_axis_across_m = 0.03\nmass_kg = 0.02\nmoment_of_inertia_kg_m2 = 1e-4\n\
        [medium]\nviscosity_pa_s = 1e-9\ndensity_kg_m3 = 1e-4\n[drag]\nlaw = \"cox\"\n[reactive]\nshedding = 0.0\n\
        [solver]\ntime_step_s = 0.002\nduration_s = 0.2\n";
    std::fs::write(&scene, text).unwrap();
    let out = folder.path().join("out");
    let output = caudal(&["study", "modes", scene.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    let said = String::from_utf8_lossy(&output.stdout);
    let after = |words: &str| -> f64 {
        let rest = said.split(words).nth(1).unwrap_or_else(|| panic!("{said}"));
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    let [with, without] = [after("natural frequency at "), after("Without that fluid it would be ")];
    assert!((without / with - 1.0).abs() < 1e-5, "{with} {without}");
}

#[test]
fn the_scenes_that_new_writes_have_nothing_to_warn_of() {
    let folder = tempfile::tempdir().unwrap();
    for kind in ["swimmer", "held", "tail"] {
        let scene = folder.path().join(kind).with_extension("toml");
        assert!(caudal(&["new", scene.to_str().unwrap(), "--kind", kind]).status.success());
        let output = caudal(&["check", scene.to_str().unwrap()]);
        assert!(output.status.success() && !text(&output.stdout).contains("warning"), "{}", text(&output.stdout));
    }
}

#[test]
fn an_efficiency_is_there_or_said_to_be_none_and_why() {
    let folder = tempfile::tempdir().unwrap();
    let foil = "models/heaving-foil.toml";
    let of = |changes: &[&str]| {
        let sets: Vec<&str> = changes.iter().flat_map(|change| ["--set", change]).collect();
        let output = run(foil, folder.path(), &[&["--set", "rod.nodes=9"], &sets[..]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        (summary(folder.path()), text(&output.stdout).to_string())
    };
    let (stream, said) = of(&[]);
    let number = |name: &str| stream[name].as_f64().unwrap();
    let by_hand = number("cycle_thrust_n") * 0.05 / (number("cycle_head_power_w") + number("cycle_actuation_power_w"));
    println!("{} by hand {by_hand}", stream["cycle_efficiency"]);
    assert!((number("cycle_efficiency") / by_hand - 1.0).abs() < 1e-6 && by_hand > 0.01); // measured 6e-10
    assert!(stream["cycle_efficiency_reason"].is_null() && said.contains("efficiency (thrust times speed"));
    let (still, said) = of(&["medium.flow_m_s=[0.0, 0.0]"]);
    assert!(still["cycle_efficiency"].is_null());
    let reason = still["cycle_efficiency_reason"].as_str().unwrap();
    assert!(reason.contains("set medium.flow_m_s") || reason.contains("with medium.flow_m_s"), "{reason}");
    assert!(said.contains(reason), "{said}");
}

#[test]
fn natural_frequencies_are_said_to_be_in_vacuum_or_in_the_fluid() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (scene, with, head) in [
        ("models/glycerol.toml", "in vacuum", "free"),
        ("models/fish.toml", "with added mass", "free"),
        ("models/cantilever.toml", "in vacuum", "held at its head"),
    ] {
        let output = caudal(&["study", "modes", scene, "--out", out.to_str().unwrap(), "--force"]);
        let said = text(&output.stdout);
        assert!(said.contains(&format!(" nodes, {head}, has its lowest")), "{scene}: {said}");
        for frequency in ["lowest natural frequency at ", "highest of all is "] {
            let sentence = said.split(frequency).nth(1).unwrap_or_else(|| panic!("{said}")).lines().next().unwrap();
            assert!(sentence.contains(with), "{scene}: {sentence}");
        }
    }
}

/// Beside a film that caudal wrote, which it replaces, there may be a file of the user.
#[cfg(feature = "pictures")]
#[test]
fn a_film_never_replaces_a_file_of_the_user_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let here = |name: &str| folder.path().join(name);
    let export = |name: &str, more: &[&str]| {
        let scene = ["export", "models/baseline.toml", "--set", "solver.duration_s=0.2"];
        caudal(&[&scene[..], &[here(name).to_str().unwrap()], more].concat())
    };
    for name in ["film.svg", "film.gif"] {
        std::fs::write(here(name), "mine").unwrap();
        let refused = export(name, &[]);
        let said = text(&refused.stderr);
        let words = "there is a file that caudal did not write; choose another name, or replace it with --force";
        assert!(refused.status.code() == Some(2) && said.contains(name) && said.contains(words), "{said}");
        assert!(text(&refused.stdout).is_empty() && said.lines().count() == 1, "before the run: {said}");
        assert_eq!(std::fs::read_to_string(here(name)).unwrap(), "mine");
        for more in [&["--force"][..], &[]] {
            let made = export(name, more);
            assert!(made.status.success(), "{name} {more:?}: {}", text(&made.stderr));
        }
    }
}

#[cfg(feature = "pictures")]
#[test]
fn a_film_that_cannot_be_made_is_refused_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("film");
    for (wrong, words) in [
        (&["--fps", "0"][..], "found 0 pictures per second"),
        (&["--fps", "51", "--until", "1"], "allowed: at most 50 in a GIF"),
        (&["--speed", "0"], "found 0 times the speed"),
        (&["--speed", "nan"], "found NaN times the speed"),
        (&["--from", "1e9"], "allowed: a part of the run, 0 to 100000000 s"),
    ] {
        // This run would take hours.
        let all = ["export", "models/baseline.toml", "--set", "solver.duration_s=1e8", "--gif", "--out"];
        let refused = caudal(&[&all[..], &[out.to_str().unwrap()], wrong].concat());
        let said = text(&refused.stderr);
        assert!(refused.status.code() == Some(2) && said.contains(words), "{wrong:?}: {said}");
        assert!(!out.exists(), "{wrong:?}");
    }
}

#[cfg(feature = "pictures")]
#[test]
fn what_can_be_refused_of_a_film_is_refused_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(
        caudal(&["export", "models/baseline.toml", "--set", "solver.duration_s=0.2", "--gif", "--out", out])
            .status
            .success()
    );
    // A scene of the same name in another file.
    let elsewhere = tempfile::tempdir().unwrap();
    let other = elsewhere.path().join("other.toml");
    std::fs::copy("models/baseline.toml", &other).unwrap();
    let film = std::fs::read(folder.path().join("baseline.gif")).unwrap();
    let here = folder.path().join("baseline.gif");
    for (what, words) in [
        (&["--gif", "--out", out][..], "baseline.gif"),
        (&[here.to_str().unwrap()], "baseline.gif"),
        (&["--mp4", "--out", out], "it needs the program ffmpeg, which is not installed; a .gif needs none"),
        (&["--gif", "--speed", "1e-5", "--out", out], "allowed in a GIF: 3000"),
    ] {
        // This run would take hours.
        let all = [&["export", other.to_str().unwrap(), "--set", "solver.duration_s=1e8"], what].concat();
        let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
        let refused = command.current_dir(env!("CARGO_MANIFEST_DIR")).args(all).env("PATH", "").output().unwrap();
        let said = text(&refused.stderr);
        assert!(refused.status.code() == Some(2) && said.contains(words), "{what:?}: {said}");
        assert!(said.lines().count() == 1 && text(&refused.stdout).is_empty(), "{what:?}: {said}");
        assert_eq!(files(folder.path()), ["baseline.gif", "manifest.json"]);
        assert!(std::fs::read(&here).unwrap() == film);
    }
}

/// A soft rod that folds over at 1.77 s.
#[cfg(feature = "pictures")]
const FOLDING: &str = r#"
name = "fast"
[rod]
nodes = 5
length_m = 0.3
outer_radius_m = 0.004
inner_radius_m = 0.0
youngs_modulus_pa = 2e6
density_kg_m3 = 1100.0
[start]
kind = "shaped"
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
law = "stokes-like"
ratio = 2.0
[head]
kind = "driven"
position_m = [0.0, { amplitude = 0.02, frequency_hz = 33.0 }]
angle_rad = { amplitude = 0.4, frequency_hz = 33.0 }
[solver]
integrator = "newmark"
time_step_s = 5e-4
duration_s = 2.9
"#;

#[cfg(feature = "pictures")]
#[test]
fn a_run_that_fails_says_why_before_its_films_which_show_what_was_simulated() {
    let folder = tempfile::tempdir().unwrap();
    let [scene, film] = ["fast.toml", "part.gif"].map(|name| folder.path().join(name));
    std::fs::write(&scene, FOLDING).unwrap();
    let [scene, out, film] = [&scene, folder.path(), &film].map(|path: &Path| path.to_str().unwrap());
    for (more, made) in [(&["--from", "1.8", "--until", "2"][..], false), (&["--from", "1.7"], true), (&[], true)] {
        let output = caudal(&[&["export", scene, film, "--gif", "--out", out, "--force"], more].concat());
        let said = text(&output.stderr);
        let lines: Vec<&str> = said.lines().collect();
        assert!(output.status.code() == Some(1) && lines[0].contains("t = 1.7"), "{more:?}: {said}");
        assert!(
            lines[1..].iter().all(|line| line.contains("allowed: a part of the run, 0 to 1.7")),
            "{more:?}: {said}"
        );
        assert_eq!(lines.len(), if made { 1 } else { 3 }, "{more:?}: {said}");
        for name in ["part.gif", "fast.gif"] {
            assert_eq!(folder.path().join(name).exists(), made, "{more:?}: {name}, {said}");
        }
    }
}

#[cfg(feature = "pictures")]
#[test]
fn the_delays_of_a_gif_do_not_add_up_their_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let all = [
        "export",
        "models/baseline.toml",
        "--set",
        "solver.duration_s=0.2",
        "--gif",
        "--fps",
        "30",
        "--speed",
        "1",
        "--out",
    ];
    let made = caudal(&[&all[..], &[folder.path().to_str().unwrap()]].concat());
    assert!(made.status.success(), "{}", text(&made.stderr));
    let file = std::fs::File::open(folder.path().join("baseline.gif")).unwrap();
    let mut decoder = gif::DecodeOptions::new().read_info(file).unwrap();
    let delays = std::iter::from_fn(|| decoder.read_next_frame().unwrap().map(|frame| frame.delay));
    assert_eq!(delays.collect::<Vec<_>>(), [3, 4, 3, 3, 4, 3]); // three pictures last ten hundredths
}

#[cfg(feature = "pictures")]
#[test]
fn a_film_of_a_run_has_its_overrides_and_a_run_of_another_scene_is_told_with_the_file_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (out, scene) = (folder.path().join("out"), folder.path().join("scene.toml"));
    std::fs::copy("models/baseline.toml", &scene).unwrap();
    let [out, scene] = [&out, &scene].map(|path| path.to_str().unwrap());
    let made = caudal(&["run", scene, "--set", "solver.duration_s=0.01", "--out", out]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    // A film of the 20 s of the file shows a beat.
    let made = caudal(&["export", out, "--gif"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let said = text(&made.stdout);
    assert!(said.contains("was written: the whole run, from t = 0 s to 0.01 s"), "{said}");
    let changed = std::fs::read_to_string(scene).unwrap().replace("duration_s = ", "duration_s = 1");
    std::fs::write(scene, changed + "# overridden: rod.nodes=5\n").unwrap();
    let edited = caudal(&["run", scene, "--set", "rod.nodes=7", "--set", "solver.duration_s=0.01", "--out", out]);
    assert!(edited.status.success(), "{}", text(&edited.stderr));
    let made = caudal(&["export", out, "--gif", "--force"]);
    assert!(made.status.success(), "a comment is no override: {}", text(&made.stderr));
    std::fs::copy("models/eel.toml", scene).unwrap();
    let refused = caudal(&["export", out, "--gif"]);
    let words = format!("{out}: the run is of another scene than {scene} is now");
    assert!(refused.status.code() == Some(2) && text(&refused.stderr).contains(&words), "{}", text(&refused.stderr));
}

#[test]
fn an_fmu_of_nodes_that_there_are_not_is_wrong_input() {
    let refused = caudal(&["fmu", "models/baseline.toml", "--nodes", "99"]);
    assert!(refused.status.code() == Some(2), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("node 99: the rod has the nodes 0 to"), "{}", text(&refused.stderr));
}

#[test]
fn wrong_options_are_named_as_they_were_given() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("new.toml");
    for (arguments, expected) in [
        (&["new", file.to_str().unwrap(), "--length", "-1"][..], "--length: found -1; allowed: "),
        (&["new", file.to_str().unwrap(), "--frequency", "-2.5"], "--frequency: found -2.5; allowed: "),
        (&["sweep", "models/sweep-muscles.toml", "--jobs", "0"], "allowed: a whole number, 1 or more"),
        (
            &["run", "models/silicone-tail.toml", "--set", "record.variables=[\"joint_moment\"]"],
            "--set record.variables=[\"joint_moment\"]: record.variables: ",
        ),
        (
            &["check", "models/silicone-tail.toml", "--set", "record.variables=[\"joint_moment\"]"],
            "--set record.variables=[\"joint_moment\"]: record.variables: ",
        ),
        (&["run", "models/silicone-tail.toml", "--set", "record.variables=[\"TIP_Y_M\"]"], "did you mean `tip_y_m`?"),
    ] {
        let output = caudal(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(expected), "{arguments:?}: {}", text(&output.stderr));
    }
    assert!(!file.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn output_that_is_lost_on_a_full_disk_is_an_error() {
    for arguments in ["schema", "variables", "completions bash", "check models/glycerol.toml --json"] {
        let output = Command::new(env!("CARGO_BIN_EXE_caudal"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(arguments.split(' '))
            .stdout(std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments}");
        let said = text(&output.stderr);
        assert!(
            said.starts_with("error: the standard output: cannot be written: No space left"),
            "{arguments}: {said}"
        );
    }
}

#[test]
fn new_takes_any_file_name() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["my \"best\" fish.toml", "a\\b.toml", "it's.toml", "plain.toml"] {
        let at = |arguments: &[&str]| {
            Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(folder.path()).args(arguments).output().unwrap()
        };
        let output = at(&["new", name]);
        assert!(output.status.success(), "{name}: {}", text(&output.stderr));
        let said = text(&output.stdout);
        let run = said.trim_end().strip_prefix(&format!("{name}: caudal run ")).unwrap();
        if cfg!(unix) {
            let echoed = Command::new("sh").args(["-c", &format!("printf %s {run}")]).output().unwrap();
            assert_eq!(text(&echoed.stdout), name);
        }
        assert!(at(&["check", name]).status.success());
    }
}

/// What the command tells that Ctrl-C ends after so many seconds.
#[cfg(unix)]
fn interrupted_after(seconds: u64, arguments: &[&str]) -> std::process::Output {
    let child = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(arguments)
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(seconds));
    crate::interrupt(&child);
    child.wait_with_output().unwrap()
}

#[cfg(unix)]
#[test]
fn a_comparison_that_ctrl_c_ends_is_said_to_be_missing() {
    let folder = tempfile::tempdir().unwrap();
    // The run takes a moment, the whole model beside it minutes.
    let sets = ["solver.time_step_s=0.05", "solver.duration_s=200", "record.every=100"].map(|set| ["--set", set]);
    let more = ["--verify", "--out", folder.path().to_str().unwrap()];
    let output = interrupted_after(5, &[&["run", "models/eel.toml"], sets.as_flattened(), &more].concat());
    assert_eq!(output.status.code(), Some(130));
    let summary = summary(folder.path());
    assert_eq!(summary["ending"], "complete");
    assert_eq!(summary["verification"], Value::Null);
    assert!(text(&output.stderr).contains("was not compared with the full model"), "{}", text(&output.stderr));
}

#[cfg(unix)]
#[test]
fn a_film_that_ctrl_c_ends_leaves_the_earlier_one_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let all = ["export", "models/baseline.toml", "--set", "solver.duration_s=0.2", "--gif", "--out", out];
    assert!(caudal(&all).status.success());
    let film = folder.path().join("baseline.gif");
    let whole = std::fs::read(&film).unwrap();
    let output = interrupted_after(4, &[&all[..], &["--speed", "2e-3"]].concat());
    assert_eq!(output.status.code(), Some(130));
    assert!(text(&output.stderr).contains("baseline.gif was not written; the earlier one is kept"));
    assert_eq!(std::fs::read(&film).unwrap(), whole);
}

#[test]
fn vtk_files_go_with_the_run_that_they_show() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let short = ["--set", "solver.duration_s=0.05"];
    assert!(run("models/baseline.toml", &out, &short).status.success());
    let export = [&["export", out.to_str().unwrap(), "--vtk"][..], &short].concat();
    assert!(caudal(&export).status.success());
    assert!(out.join("vtk/baseline.pvd").exists());
    assert!(run("models/baseline.toml", &out, &short).status.success());
    assert!(out.join("vtk/baseline.pvd").exists(), "the same run again");
    assert!(run("models/baseline.toml", &out, &["--set", "solver.duration_s=0.06"]).status.success());
    assert!(!out.join("vtk").exists(), "{:?}", files(&out.join("vtk")));
}
