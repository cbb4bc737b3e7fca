//! Sweeps: the source study's 192 cases give the study's findings and an independent implementation's numbers; any sweep
//! ends with the same table to the bit, whatever ends it in between, on any number of threads or in shards; mistakes are
//! refused where they stand before anything runs.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use caudal::jobs::{Shard, cores};
use caudal::report::Claim;
use caudal::sweep::{Sweep, SweepResults, run};

/// A row of table.csv.
type Row = BTreeMap<String, String>;

fn table(folder: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(folder.join("table.csv")).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(str::to_string).collect();
    let row = |row: csv::StringRecord| header.iter().cloned().zip(row.iter().map(str::to_string)).collect();
    reader.records().map(|record| row(record.unwrap())).collect()
}

fn number(row: &Row, name: &str) -> f64 {
    row[name].parse().unwrap_or_else(|_| panic!("{name}: {:?}", row[name]))
}

/// The table of a sweep of this project.
fn swept(file: &str, set: &[&str]) -> Vec<Row> {
    let folder = tempfile::tempdir().unwrap();
    let set: Vec<String> = set.iter().map(ToString::to_string).collect();
    let sweep = Sweep::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(file), &set).unwrap();
    let job = sweep.job(cores()).unwrap();
    let mut held = sweep.claim(folder.path(), &job, Claim::Own).unwrap();
    let mut journal = sweep.journal(&mut held, "cases.journal", &job).unwrap();
    let todo: Vec<usize> = (0..sweep.size()).collect();
    run(&sweep, &mut journal, &todo, cores(), &AtomicBool::new(false), |_, _| {}).unwrap();
    SweepResults::new(&sweep, &job, vec![journal]).unwrap().write(&mut held).unwrap();
    table(folder.path())
}

/// Pairs of rows that differ in `axis` alone, from its `low` to its `high` level.
fn pairs<'a>(rows: &'a [Row], axis: &str, low: &str, high: &str) -> Vec<(&'a Row, &'a Row)> {
    const AXES: [&str; 7] = [
        "rod.youngs_modulus_pa.factor",
        "rod.density_kg_m3.factor",
        "actuation.kappa_amp",
        "actuation.frequency_hz",
        "radius",
        "fluid",
        "viscosity",
    ];
    let same = |a: &Row, b: &Row| AXES.iter().all(|name| *name == axis || a[*name] == b[*name]);
    let mut found = Vec::new();
    for a in rows.iter().filter(|row| row[axis] == low) {
        found.push((a, rows.iter().find(|b| b[axis] == high && same(a, b)).unwrap()));
    }
    found
}

const DX: &str = "net_displacement_m";

#[test]
fn the_192_cases_are_the_study_s_and_show_what_it_found() {
    let rows = swept("models/sweep-192.toml", &[]);
    assert_eq!(rows.len(), 192);
    let mut scenes: Vec<_> = rows.iter().map(|row| &row["scene_hash"]).collect();
    scenes.sort();
    scenes.dedup();
    assert_eq!(scenes.len(), 192, "no two cases are the same");
    for row in &rows {
        let fixed =
            ["complete", "steps", "step_halvings", "linear_fallbacks", "integrator", "time_step_s", "end_time_s"];
        assert_eq!(fixed.map(|name| row[name].as_str()), ["true", "5000", "0", "0", "implicit-euler", "0.0001", "0.5"]);
        assert!(number(row, DX) < 0.0);
        // The study's own energies were all zero.
        for name in ["stretching", "bending", "kinetic"] {
            assert!(
                number(row, &format!("{name}_energy_j")) > 0.0 && number(row, &format!("mean_{name}_energy_j")) > 0.0
            );
        }
        let [first, last, actuation, viscous, numerical] = [
            number(row, "initial_energy_j"),
            ["stretching_energy_j", "bending_energy_j", "kinetic_energy_j"].map(|name| number(row, name)).iter().sum(),
            number(row, "actuation_work_j"),
            number(row, "viscous_work_j"),
            number(row, "numerical_dissipation_j"),
        ];
        assert!(first > 0.0 && actuation != 0.0 && viscous > 0.0);
        assert!(number(row, "mean_actuation_power_w") != 0.0 && number(row, "mean_viscous_power_w") > 0.0);
        // Closed: what the rod had and was given is where it is now, was taken by the fluid, or by the method, which takes
        // no less than nothing and no more than the jump put in.
        assert!((first + actuation - viscous - numerical - last).abs() <= 1e-12 * first);
        assert!(0.0 < numerical && numerical < first + actuation, "{numerical}");
        assert!(number(row, "efficiency") > 0.0 && number(row, "cost_of_transport") > 0.0);
    }
    // Measured: −1.55007e-5 … −1.73837e-4 and −1.235639e-2 … −9.809504e-2.
    for (fluid, least, largest, digits) in
        [("water", -1.550e-5, -1.738e-4, [1e-8, 1e-7]), ("glycerol-like", -1.236e-2, -9.810e-2, [1e-5, 1e-5])]
    {
        let all = || rows.iter().filter(|row| row["fluid"] == fluid).map(|row| number(row, DX));
        assert_eq!(all().count(), 96);
        let (min, max) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        assert!((max - least).abs() <= 0.5 * digits[0], "{max:e}");
        assert!((min - largest).abs() <= 0.5 * digits[1], "{min:e}");
    }
    // The logarithmic effect of an axis on |Δx|, pair by pair.
    let effects = |axis, low, high| -> Vec<f64> {
        pairs(&rows, axis, low, high).iter().map(|(a, b)| (number(b, DX) / number(a, DX)).ln()).collect()
    };
    let ratios = effects("fluid", "water", "glycerol-like");
    assert_eq!(ratios.len(), 96);
    assert!(ratios.iter().all(|ratio| (400.0..=1000.0).contains(&ratio.exp())), "{ratios:?}");
    let amplitude = effects("actuation.kappa_amp", "0.8", "1.2");
    let smallest = amplitude.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(amplitude.len() == 96 && smallest >= 0.728, "{smallest}");
    for (low, high) in [("1.0", "1.5"), ("1.5", "2.0")] {
        let frequency = effects("actuation.frequency_hz", low, high);
        assert!(frequency.len() == 64 && frequency.iter().all(|effect| *effect > 0.0), "{frequency:?}");
    }
    let stiffness = effects("rod.youngs_modulus_pa.factor", "0.7", "1.0");
    let largest = stiffness.iter().copied().fold(0.0, |max: f64, x| max.max(x.abs()));
    assert!(stiffness.len() == 96 && largest <= 0.351, "{largest}");
    // Two cases of an independent implementation.
    let find = |levels: [&str; 7]| {
        let [e, rho, kappa, f, radius, fluid, viscosity] = levels;
        let of = |row: &&Row| {
            row["rod.youngs_modulus_pa.factor"] == e
                && row["rod.density_kg_m3.factor"] == rho
                && row["actuation.kappa_amp"] == kappa
                && row["actuation.frequency_hz"] == f
                && row["radius"] == radius
                && row["fluid"] == fluid
                && row["viscosity"] == viscosity
        };
        rows.iter().find(of).unwrap()
    };
    // Measured: −6.65286169e-5, 3.99348e-5; −7.02083212e-2, 4.1174778e-2.
    let water = find(["1.0", "0.9", "0.8", "2.0", "0.95", "water", "1.0"]);
    assert!((number(water, DX) + 6.652862e-5).abs() <= 0.5e-11);
    assert!((number(water, "max_lateral_excursion_m") - 3.993e-5).abs() <= 0.5e-8);
    let glycerol = find(["0.7", "0.9", "1.2", "1.5", "0.95", "glycerol-like", "1.0"]);
    assert!((number(glycerol, DX) + 7.0208322e-2).abs() <= 0.5e-8);
    assert!((number(glycerol, "max_lateral_excursion_m") - 4.11748e-2).abs() <= 0.5e-7);
}

#[test]
fn without_its_abrupt_start_the_study_s_tail_does_not_feel_its_stiffness_and_every_balance_closes() {
    let rows = swept("models/sweep-192.toml", &["start.kind=shaped"]);
    assert_eq!(rows.len(), 192);
    for row in &rows {
        // Measured: at most 2.3 % of the energy that the rod starts with.
        let part = number(row, "numerical_dissipation_j") / number(row, "initial_energy_j");
        assert!((0.0..0.03).contains(&part), "{part}");
        assert!(!row["notes"].contains("energy balance"), "{}", row["notes"]);
    }
    let effects: Vec<f64> = pairs(&rows, "rod.youngs_modulus_pa.factor", "0.7", "1.0")
        .iter()
        .map(|(a, b)| (number(b, DX) / number(a, DX)).ln())
        .collect();
    // Measured: −7.4e-6 … −7.1e-5, where the jump has −0.064 … 0.350.
    assert!(effects.len() == 96 && effects.iter().all(|effect| (-1e-4..0.0).contains(effect)), "{effects:?}");
}

fn command(file: &Path, out: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).arg("sweep").args(more).arg(file).arg("--out").arg(out);
    command
}

fn sweep(file: &Path, out: &Path, more: &[&str]) -> Output {
    command(file, out, more).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A sampled sweep of 400 short cases: some fail, some play, all have traces.
fn sampled(folder: &Path) -> std::path::PathBuf {
    let path = folder.join("sampled.toml");
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/baseline.toml");
    let text = format!(
        r#"
scene = {scene:?}
[set]
solver.duration_s = 0.2
solver.time_step_s = 2e-3
[samples]
count = 100
seed = 7
[record]
played = 30
traces = 4
[axes]
rod.youngs_modulus_pa = {{ between = [1e8, 1e11], scale = "log" }}
actuation.kappa_amp.factors = {{ between = [-1.0, 2.0] }}
rod.nodes = {{ from = 9, to = 17, count = 2 }}
solver.integrator = ["implicit-euler", "newmark"]
"#
    );
    std::fs::write(&path, text).unwrap();
    path
}

/// Files that must be the same to the bit.
fn outcome(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    // The manifest lists the journals, of which shards have several.
    files.retain(|path| !path.ends_with("manifest.json") && path.extension().is_none_or(|it| it != "journal"));
    files.sort();
    files
        .iter()
        .map(|path| (path.file_name().unwrap().to_string_lossy().into(), std::fs::read(path).unwrap()))
        .collect()
}

#[test]
fn a_sweep_ends_the_same_to_the_bit_on_any_number_of_threads_in_shards_and_after_kills() {
    let folder = tempfile::tempdir().unwrap();
    let file = sampled(folder.path());
    let out = |name: &str| folder.path().join(name);
    let whole = sweep(&file, &out("whole"), &[]);
    // Newmark's method does not get through some of the jumps: rows with their error, and an exit code that says so.
    assert_eq!(whole.status.code(), Some(1), "{}", text(&whole.stderr));
    let rows = table(&out("whole"));
    assert_eq!(rows.len(), 400);
    let failed: Vec<_> = rows.iter().filter(|row| row["complete"] == "false").collect();
    assert!(!failed.is_empty() && failed.len() < 200, "{}", failed.len());
    let named = |row: &Row| row["integrator"] == "newmark" && row["ending"].contains("t = ");
    assert!(failed.iter().all(|row| named(row)), "{failed:?}");
    assert!(text(&whole.stderr).contains(&format!("{} cases failed", failed.len())));
    let expected = outcome(&out("whole"));
    assert!(expected.iter().any(|(name, _)| name == "traces.csv") && expected.len() > 10);

    assert_eq!(sweep(&file, &out("one"), &["--jobs", "1"]).status.code(), Some(1));
    assert_eq!(sweep(&file, &out("five"), &["--jobs", "5"]).status.code(), Some(1));
    for i in 1..=3 {
        let shard = sweep(&file, &out("shards"), &["--shard", &format!("{i}/3")]);
        assert_eq!(shard.status.code(), Some(0), "{}", text(&shard.stderr));
        let merged = sweep(&file, &out("shards"), &["merge"]);
        assert_eq!(merged.status.code(), Some(if i < 3 { 2 } else { 1 }), "{}", text(&merged.stderr));
        assert_eq!(out("shards").join("table.csv").exists(), i == 3);
        if i == 2 {
            // What is there by then, which the next merge replaces.
            let partial = sweep(&file, &out("shards"), &["merge", "--partial"]);
            assert!(text(&partial.stdout).contains("of 400 cases are missing from the 2 journals"), "{partial:?}");
            assert!((200..300).contains(&table(&out("shards")).len()));
            std::fs::remove_file(out("shards").join("table.csv")).unwrap();
        }
    }
    // Killed three times at moments of its own choosing, each time after some more cases.
    let journal = out("killed").join("cases.journal");
    let mut length = 0;
    for _ in 0..3 {
        let mut child =
            command(&file, &out("killed"), &[]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let enough = |length| std::fs::metadata(&journal).is_ok_and(|file| file.len() > length + 20_000);
        wait_for(&mut child, || enough(length));
        child.kill().unwrap();
        child.wait().unwrap();
        length = std::fs::metadata(&journal).unwrap().len();
    }
    assert!(!out("killed").join("table.csv").exists());
    // And cut in the middle of a line, as a crash can leave it.
    let bytes = std::fs::read(&journal).unwrap();
    std::fs::write(&journal, &bytes[..bytes.len() - 7]).unwrap();
    let resumed = sweep(&file, &out("killed"), &[]);
    assert!(text(&resumed.stdout).contains("cases are done already"), "{}", text(&resumed.stdout));
    for other in ["one", "five", "shards", "killed"] {
        for ((name, bytes), (other_name, other_bytes)) in expected.iter().zip(outcome(&out(other))) {
            assert_eq!(*name, other_name);
            assert!(*bytes == other_bytes, "{other}: {name} differs");
        }
    }
}

/// Waits until `ready`, or until the child ends by itself.
fn wait_for(child: &mut Child, ready: impl Fn() -> bool) {
    let start = Instant::now();
    while !ready() && child.try_wait().unwrap().is_none() && start.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[cfg(unix)]
#[test]
fn a_full_disk_ends_a_sweep_with_1_and_it_goes_on_when_there_is_room() {
    let folder = tempfile::tempdir().unwrap();
    let file = sampled(folder.path());
    let out = folder.path().join("out");
    // A limit on the size of files stands in for the end of the disk.
    let command = format!(
        "trap '' XFSZ; ulimit -f 200; exec '{}' sweep '{}' --out '{}'",
        env!("CARGO_BIN_EXE_caudal"),
        file.display(),
        out.display()
    );
    let output = Command::new("sh").current_dir(env!("CARGO_MANIFEST_DIR")).args(["-c", &command]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("cannot be written"), "{}", text(&output.stderr));
    let resumed = sweep(&file, &out, &[]);
    assert!(text(&resumed.stdout).contains("cases are done already"), "{}", text(&resumed.stdout));
    assert_eq!(table(&out).len(), 400);
}

#[cfg(unix)]
#[test]
fn an_interrupted_sweep_ends_with_130_and_goes_on_with_the_same_command() {
    let folder = tempfile::tempdir().unwrap();
    let file = sampled(folder.path());
    let out = folder.path().join("out");
    let set = ["--set", "solver.newton_tolerance=1e-9", "--set", "solver.duration_s=5"];
    let mut child = command(&file, &out, &set).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let journal = out.join("cases.journal");
    wait_for(&mut child, || std::fs::metadata(&journal).is_ok_and(|file| file.len() > 5_000));
    // A second program must not write to the same journal.
    let second = sweep(&file, &out, &set);
    assert_eq!(second.status.code(), Some(2));
    // Where the system tells, it is named.
    let holder = match std::path::Path::new("/proc/self/fd").exists() {
        true => format!("process {} (caudal) is using it", child.id()),
        false => "another program is using it".to_string(),
    };
    assert!(text(&second.stderr).contains(&holder), "{}", text(&second.stderr));
    crate::interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("the same command resumes"), "{}", text(&output.stderr));
    assert!(!out.join("table.csv").exists());
    // Another scene is not mixed in, unless all begins anew.
    let other = ["--set", "solver.duration_s=0.002"];
    let refused = sweep(&file, &out, &other);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("results of another job"), "{}", text(&refused.stderr));
    let merged = sweep(&file, &out, &["merge", "--set", "solver.duration_s=0.002"]);
    assert_eq!(merged.status.code(), Some(2));
    assert!(text(&merged.stderr).contains("of other scenes"), "{}", text(&merged.stderr));
    let anew = sweep(&file, &out, &[&other[..], &["--restart"]].concat());
    assert_eq!(anew.status.code(), Some(0), "{}", text(&anew.stderr));
    assert_eq!(table(&out).len(), 400);
}

/// A sweep's file beside a scene, in a folder that is gone when this is.
fn written(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("base.toml"), include_str!("../../models/baseline.toml")).unwrap();
    let path = folder.path().join("sweep.toml");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn axes_are_what_the_file_says_in_its_order() {
    let (_folder, path) = written(
        r#"scene = "base.toml"
[set]
start = { kind = "ramp", ramp_s = 0.1 }
[axes]
solver.integrator = ["implicit-euler", "newmark"]
drag.ratio = { from = 1.0, to = 100.0, count = 3, scale = "log" }
[axes.fluid]
zip.medium.viscosity_pa_s = [0.001, 1.0]
zip.medium.density_kg_m3 = [1000.0, 1260.0]
labels = ["water", "glycerol"]
[axes.size]
keys = ["rod.outer_radius_m", "rod.nodes"]
factors = [1, 3]
[axes.thin]
keys = ["medium.viscosity_pa_s"]
factors = [0.5, 1]
"#,
    );
    let sweep = Sweep::read(&path, &[]).unwrap();
    assert_eq!(sweep.size(), 2 * 3 * 2 * 2 * 2);
    let names: Vec<_> = sweep.axes.iter().map(|axis| axis.name.as_str()).collect();
    assert_eq!(names, ["solver.integrator", "drag.ratio", "fluid", "size", "thin"]);
    let ratios: Vec<f64> = (0..3).map(|i| sweep.axes[1].labels[i].as_float().unwrap()).collect();
    assert!(ratios[0] == 1.0 && (ratios[1] - 10.0).abs() < 1e-14 && ratios[2] == 100.0);
    // The last axis changes fastest: case 1 differs from case 0 in `thin`.
    assert_eq!(sweep.case(0).unwrap().levels, [0, 0, 0, 0, 0]);
    assert_eq!(sweep.case(1).unwrap().levels, [0, 0, 0, 0, 1]);
    assert_eq!(sweep.case(47).unwrap().levels, [1, 2, 1, 1, 1]);
    // A factor multiplies what stands before it: the fluid's viscosity, not the base scene's.
    let (scene, _) = sweep.scene(&sweep.case(46).unwrap()).unwrap();
    let medium = scene.medium.as_ref().unwrap();
    assert_eq!((medium.viscosity_pa_s.get(), medium.density_kg_m3.get()), (0.5, 1260.0));
    assert_eq!(
        (scene.rod.nodes.get(), scene.rod.outer_radius_m.as_ref().unwrap().number().unwrap().get()),
        (27, 0.013 * 3.0)
    );
    assert_eq!((scene.integrator_name(), scene.drag.clone().unwrap().ratio.unwrap().get()), ("newmark", 100.0));
    assert_eq!(scene.start.ramp_s.unwrap().get(), 0.1);
    let columns = sweep.columns();
    let values = sweep.values(&sweep.case(46).unwrap());
    let of = |name: &str| values[columns.iter().position(|column| *column == name).unwrap()].clone();
    assert_eq!(of("fluid").as_str(), Some("glycerol"));
    assert_eq!((of("thin").as_float(), of("medium.viscosity_pa_s").as_float()), (Some(0.5), Some(0.5)));
    assert_eq!((of("rod.nodes").as_integer(), of("size").as_integer()), (Some(27), Some(3)));
}

#[test]
fn a_sample_has_one_point_in_each_part_of_each_axis_and_is_its_seed_s() {
    let sweep = |seed: u64| {
        let (_folder, path) = written(&format!(
            r#"scene = "base.toml"
[samples]
count = 50
seed = {seed}
[axes]
rod.youngs_modulus_pa = {{ between = [1e6, 1e10], scale = "log" }}
drag.ratio = {{ between = [1.0, 3.0] }}
rod.nodes = [9, 17]
"#
        ));
        let sweep = Sweep::read(&path, &[]).unwrap();
        assert_eq!(sweep.size(), 100);
        let value = |index: usize, i: usize| sweep.case(index).unwrap().settings[i].2.as_float().unwrap();
        (0..50).map(|point| [value(2 * point, 0), value(2 * point + 1, 1)]).collect::<Vec<_>>()
    };
    let points = sweep(1);
    let place = |[e, ratio]: &[f64; 2]| [(e.log10() - 6.0) / 4.0, (ratio - 1.0) / 2.0];
    for axis in 0..2 {
        let mut parts: Vec<usize> = points.iter().map(|point| (50.0 * place(point)[axis]) as usize).collect();
        assert_ne!(parts, (0..50).collect::<Vec<_>>(), "in random order");
        parts.sort_unstable();
        assert_eq!(parts, (0..50).collect::<Vec<_>>());
    }
    assert_eq!(points, sweep(1));
    assert_ne!(points, sweep(2));
}

#[test]
fn mistakes_are_refused_where_they_stand_before_anything_runs() {
    // The text below `scene = "base.toml"`, the line of the error, and what it says.
    let mistakes: &[(&str, usize, &str)] = &[
        ("[axes]\nrod.nodes = [9, 2]", 3, "rod.nodes: found 2; allowed: a whole number from 3"),
        ("[axes]\nrod.nodes = [9, 2]", 3, "in case 1: rod.nodes = 2"),
        ("[axes]\nrod.nods = [9]", 3, "did you mean `nodes`?"),
        ("[axes]\nsolver.integrator = [\"newmrk\"]", 3, "implicit-euler"),
        ("[axes]\nsolver.beta = [0.25]", 3, "found with integrator"),
        ("[axes]\nrod.inner_radius_m = [0.011, 0.02]", 3, "from 0 to below outer_radius_m"),
        ("[axes]\nrod.nodes = 9", 3, "found 9; allowed: a list"),
        ("[axes]\nrod.nodes = []", 3, "found an empty list"),
        ("[axes]\nrod.length_m = { from = 1.0, to = 2.0 }", 3, "allowed: a list, { from, to, count"),
        ("[axes]\nrod.length_m = { from = 1.0, to = 2.0, count = 1 }", 3, "allowed: 2 to"),
        (
            "[axes]\nrod.length_m = { from = 0.0, to = 2.0, count = 3, scale = \"log\" }",
            3,
            "positive numbers on a log scale",
        ),
        ("[axes]\nrod.length_m = { between = [1.0, 2.0] }", 3, "without samples"),
        ("[samples]\ncount = 3\n[axes]\nrod.length_m = { between = [2.0, 1.0] }", 5, "allowed: [low, high]"),
        ("[samples]\ncount = 3\n[axes]\nrod.length_m = [1.0]", 2, "found without an axis"),
        ("[samples]\ncount = 0\n[axes]\nrod.length_m = { between = [1.0, 2.0] }", 3, "found 0; allowed: 1 to"),
        ("[samples]\ncounts = 3\n[axes]\nrod.length_m = [1.0]", 3, "did you mean `count`?"),
        ("[axes]\nrod.length_m = { factors = [0.0, 1.0] }", 3, "finite numbers that are not zero"),
        ("[axes]\nrod.length_m = { factor = [0.5, 1.0], keys = [\"rod.length_m\"] }", 3, "unknown key"),
        ("[axes]\nrod.length_m = { values = [1.0], factors = [0.5] }", 3, "found values together with factors"),
        ("[axes]\nstart.ramp_s.factors = [0.5]", 3, "which the base scene does not give"),
        ("[axes]\nsolver.integrator.factors = [0.5]", 3, "is not a number"),
        (
            "[set]\nrod.outer_radius_m = [[0.0, 0.01], [1.0, 0.02]]\n[axes]\nrod.outer_radius_m.factors = [0.5]",
            5,
            "its numbers, with keys = [\"rod.outer_radius_m.0.1\", \"rod.outer_radius_m.1.1\"], or whole lists as values",
        ),
        ("[axes.a]\nzip.rod.length_m = [1.0, 2.0]\nzip.rod.nodes = [9]", 3, "lists of the same length"),
        ("[axes.a]\nkeys = [\"rod.length_m\"]\nvalues = [1.0, 2.0]\nlabels = [\"x\"]", 5, "a list of 2 texts"),
        ("[axes.a]\nkeys = \"rod.length_m\"\nvalues = [1.0, 2.0]", 3, "a list of the scene's keys"),
        (
            "[axes]\nrod.length_m.factors = [1.0]\n[axes.a]\nkeys = [\"rod.length_m\"]\nvalues = [1.0]",
            4,
            "sets rod.length_m",
        ),
        ("[axes]", 2, "found no axis"),
        ("", 1, "axes: missing"),
        ("[set]\nrod.nodes = 1\n[axes]\nrod.length_m = [1.0]", 3, "found 1; allowed: a whole number"),
        (
            "[axes]\nrod.length_m = [1.0]\n[report]\nsplit = \"lenght\"",
            5,
            "allowed: an axis with listed levels: rod.length_m",
        ),
        ("[axes]\nrod.length_m = [1.0]\n[record]\nframes = 1", 5, "allowed: 0, or 2 to"),
        ("[axes]\nrod.length_m = [1.0]\n[recrod]", 4, "did you mean `record`?"),
        ("name = \"a/b\"\n[axes]\nrod.length_m = [1.0]", 2, "a valid folder name"),
    ];
    for (mistake, line, says) in mistakes {
        let (folder, path) = written(&format!("scene = \"base.toml\"\n{mistake}\n"));
        let out = folder.path().join("out");
        let output = sweep(&path, &out, &[]);
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{mistake}\n{error}");
        assert!(error.contains(says), "{mistake}\n{error}");
        assert!(error.contains(&format!("sweep.toml:{line}: ")), "{mistake}\n{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
        assert!(!out.exists(), "nothing is written");
    }
    let (folder, path) = written("scene = \"none.toml\"\n[axes]\nrod.length_m = [1.0]\n");
    let output = sweep(&path, &folder.path().join("out"), &[]);
    assert!(output.status.code() == Some(2) && text(&output.stderr).contains("none.toml"), "{}", text(&output.stderr));
    assert!("3/2".parse::<Shard>().is_err());
}

#[test]
fn where_heads_are_held_a_sweep_shows_their_thrust_and_no_displacement() {
    let folder = tempfile::tempdir().unwrap();
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/driven-head.toml");
    let text = format!(
        "scene = {model:?}\n[set]\nsolver.duration_s = 2.1\n[axes]\nrod.youngs_modulus_pa.factors = [0.5, 1.0]\n"
    );
    for (axes, shown, hidden) in [
        (text.clone(), "thrust_", "displacement"),
        (text.replace("driven-head", "glycerol"), "displacement_", "thrust"),
    ] {
        let file = folder.path().join("sweep.toml");
        std::fs::write(&file, axes).unwrap();
        let sweep = Sweep::read(&file, &[]).unwrap();
        let job = sweep.job(1).unwrap();
        let out = tempfile::tempdir().unwrap();
        let mut held = sweep.claim(out.path(), &job, Claim::Own).unwrap();
        let mut journal = sweep.journal(&mut held, "cases.journal", &job).unwrap();
        run(&sweep, &mut journal, &[0, 1], 1, &AtomicBool::new(false), |_, _| {}).unwrap();
        let kept = SweepResults::new(&sweep, &job, vec![journal]).unwrap().write(&mut held).unwrap().kept;
        let names: Vec<String> =
            kept.files.iter().map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect();
        assert!(names.iter().any(|name| name.starts_with(shown) && name.ends_with(".svg")), "{names:?}");
        assert!(names.iter().all(|name| !name.contains(hidden)), "{names:?}");
        let rows = table(out.path());
        assert!(rows.iter().all(|row| row["mean_thrust_n"].is_empty() == (shown != "thrust_")));
        assert!(rows.iter().all(|row| !row["cycle_speed_m_s"].is_empty() && !row["cycle_speed_spread_m_s"].is_empty()));
    }
}

#[test]
fn the_motion_of_a_case_has_no_more_times_than_steps_and_ends_with_it() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("models/baseline-smooth.toml"),
        folder.path().join("scene.toml"),
    )
    .unwrap();
    let text = |steps: usize| {
        format!(
            "scene = \"scene.toml\"\n[set]\nsolver.time_step_s = 1e-3\nsolver.duration_s = {}\n[record]\nframes = 20\n[axes]\nrod.nodes = [9, 17]\n",
            1e-3 * steps as f64
        )
    };
    for (steps, frames) in [(3, 4), (19, 20), (1000, 20)] {
        let file = folder.path().join("sweep.toml");
        std::fs::write(&file, text(steps)).unwrap();
        let sweep = Sweep::read(&file, &[]).unwrap();
        let job = sweep.job(1).unwrap();
        let out = folder.path().join(format!("{steps}"));
        let mut held = sweep.claim(&out, &job, Claim::Own).unwrap();
        let mut journal = sweep.journal(&mut held, "cases.journal", &job).unwrap();
        run(&sweep, &mut journal, &[0, 1], 1, &AtomicBool::new(false), |_, row| {
            let times: Vec<f64> = row.motion.iter().flat_map(|motion| &motion.frames).map(|frame| frame.time).collect();
            assert!((frames / 2..=frames).contains(&times.len()), "{steps} steps: {times:?}");
            // A run of two beats is too long for twenty times: they are those of its end.
            assert_eq!(times[0] > 0.0, steps == 1000, "{times:?}");
            assert!((times[times.len() - 1] / (1e-3 * steps as f64) - 1.0).abs() < 1e-12);
            assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
        })
        .unwrap();
    }
}

#[test]
fn an_axis_finds_the_entries_of_lists_by_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let base = r#"
[rod]
nodes = 9
length_m = 0.2
outer_radius_m = 0.005
youngs_modulus_pa = 5e5
density_kg_m3 = 1100.0
[[tendons]]
offset_m = 0.004
tension_n = 0.5
[[loads.point]]
node = -1
force_n = [0.0, 0.02]
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
flow_m_s = [0.1, 0.0]
[[medium.layers]]
normal = [0.0, 1.0]
offset_m = 0.4
thickness_m = 0.05
viscosity_pa_s = 2e-5
density_kg_m3 = 10.0
[drag]
law = "cox"
[head]
kind = "clamped"
[solver]
time_step_s = 1e-3
duration_s = 0.01
"#;
    std::fs::write(folder.path().join("base.toml"), base).unwrap();
    let path = folder.path().join("sweep.toml");
    let axes = ["tendons.0.offset_m", "loads.point.0.force_n.1", "medium.flow_m_s.0", "medium.layers.0.offset_m"];
    let text: Vec<String> = axes.iter().map(|axis| format!("{axis}.factors = [0.5, 2.0]")).collect();
    std::fs::write(&path, format!("scene = \"base.toml\"\n[axes]\n{}\n", text.join("\n"))).unwrap();
    let sweep = Sweep::read(&path, &[]).unwrap();
    assert_eq!(sweep.size(), 16);
    let (scene, _) = sweep.scene(&sweep.case(0b0110).unwrap()).unwrap();
    assert_eq!(scene.tendons[0].offset_m.get(), 0.002);
    assert_eq!(scene.loads.as_ref().unwrap().point[0].force_n[1].get(), 0.04);
    let number = |path: &str| scene.parameters().into_iter().find(|number| number.path() == path).unwrap().value;
    assert_eq!([number("medium.flow_m_s.0"), number("tendons.0.offset_m")], [0.2, 0.002]);
    // What a scene calls its numbers, an override and a sweep take.
    let known: Vec<String> = scene.parameters().iter().map(|parameter| parameter.path()).collect();
    assert!(axes[..1].iter().chain(&axes[2..3]).all(|axis| known.iter().any(|path| path == axis)), "{known:?}");
    for parameter in scene.parameters() {
        let mut document = sweep.document(&sweep.case(0).unwrap());
        document.set(&format!("{}={:e}", parameter.path(), parameter.value)).unwrap();
        document.scene().unwrap_or_else(|error| panic!("{}: {error}", parameter.path()));
    }
}
