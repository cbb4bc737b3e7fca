//! What cannot be is refused before it begins, by its place and with its size; what was computed is kept, whatever fails after
//! it.

#![cfg(unix)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const EEL: &str = r#"
name = "eel"
[rod]
nodes = 17
length_m = 1.0
outer_radius_m = 0.012
youngs_modulus_pa = 5e6
density_kg_m3 = 1150.0
[actuation]
kind = "travelling-wave"
kappa_amp = 3.0
frequency_hz = 1.5
wavelength_m = 1.0
[medium]
viscosity_pa_s = 0.8
density_kg_m3 = 1200.0
[drag]
ratio = 5.0
[solver]
time_step_s = 1e-2
duration_s = 0.1
"#;

/// A folder with `files`.
fn folder_of(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// The command in `folder`, under a shell's `limits`.
fn limited(folder: &Path, limits: &str, arguments: &str) -> Output {
    let command = format!("trap '' XFSZ; {limits} exec '{}' {arguments}", env!("CARGO_BIN_EXE_caudal"));
    Command::new("sh").current_dir(folder).args(["-c", &command]).output().unwrap()
}

fn caudal(folder: &Path, arguments: &str) -> Output {
    limited(folder, "", arguments)
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn models(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join(file)
}

#[test]
fn more_rows_than_fit_are_refused_with_their_number_and_size_by_run_and_check_alike() {
    let folder = folder_of(&[("eel.toml", EEL)]);
    for (set, problem) in [
        (
            "record.interval_s=1e-300",
            "eel.toml --set record.interval_s=1e-300: record.interval_s: found 1e-300, which makes 1.0e299 rows; allowed: at least 1e-10, so that there are at most 1e9 rows",
        ),
        ("record.interval_s=2e-10", "out/eel: there is no room: 5.000e8 rows of trajectory.csv"),
        ("solver.time_step_s=1e-12", "out/eel: there is no room: 1.000e11 rows of trajectory.csv"),
    ] {
        for verb in ["run", "check"] {
            let output = caudal(folder.path(), &format!("{verb} eel.toml --set {set}"));
            let problem = problem.strip_prefix("eel.toml ").unwrap_or(problem);
            assert!(errors(&output).starts_with(&format!("error: {problem}")), "{verb} {set}: {}", errors(&output));
            assert_eq!(output.status.code(), Some(2), "{verb} {set}");
            assert!(!folder.path().join("out").exists());
        }
    }
    let check = caudal(folder.path(), "check eel.toml --set record.interval_s=1e-3");
    assert!(String::from_utf8_lossy(&check.stdout).contains("about 101 rows, "), "{check:?}");
}

#[test]
fn what_a_sweep_cannot_keep_of_its_cases_is_refused_before_the_first() {
    let axes = "scene = \"eel.toml\"\n[axes]\ndrag.ratio = [1.0, 2.0]\n[record]\n";
    for (record, problem) in [
        ("traces = 2000000000", "sweep.toml:5: record.traces: found 2000000000; allowed: up to 1000000 of a case"),
        ("frames = 2000000000", "sweep.toml:5: record.frames: found 2000000000; allowed: 0, or 2 to 1000000"),
        (
            "frames = 900000",
            "sweep.toml:5: record.frames: the motions of 200 cases at 900000 times make a report of 1.5 GB; allowed: up to 500.0 MB",
        ),
    ] {
        let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", &format!("{axes}{record}\n"))]);
        for more in ["", " --dry-run"] {
            let output = caudal(folder.path(), &format!("sweep sweep.toml{more}"));
            assert!(errors(&output).starts_with(&format!("error: {problem}")), "{}", errors(&output));
            assert_eq!(output.status.code(), Some(2));
            assert!(!folder.path().join("out").exists());
        }
    }
}

#[test]
fn ctrl_c_ends_a_run_at_once_however_many_rows_a_step_has() {
    let folder = folder_of(&[("eel.toml", EEL)]);
    let mut child = Command::new(env!("CARGO_BIN_EXE_caudal"))
        .current_dir(folder.path())
        // One step of five million rows, which takes about ten seconds.
        .args(["run", "eel.toml", "--set", "record.interval_s=2e-8", "--set", "solver.time_step_s=0.1"])
        .args(["--set", "record.nodes_table=none"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while names(&folder.path().join("out/eel")).len() < 2 && start.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(10));
    }
    std::thread::sleep(Duration::from_millis(500));
    assert!(child.try_wait().unwrap().is_none());
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let pressed = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    // Measured: 0.1 s.
    assert!(pressed.elapsed() < Duration::from_secs(3), "{:?}", pressed.elapsed());
    assert!(names(&folder.path().join("out/eel")).contains(&"trajectory.csv".to_string()));
}

#[test]
fn a_disk_that_is_full_for_the_report_keeps_the_summary_and_every_row() {
    let folder = folder_of(&[("eel.toml", EEL)]);
    let whole = caudal(folder.path(), "run eel.toml --out whole");
    assert_eq!(whole.status.code(), Some(0), "{}", errors(&whole));
    // A limit on the size of files stands in for the end of the disk: 20 kB, less than the page has.
    let output = limited(folder.path(), "ulimit -f 40;", "run eel.toml --out short");
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    assert!(errors(&output).contains("report.html; kept in"), "{}", errors(&output));
    let read = |name: &str| ["whole", "short"].map(|out| std::fs::read(folder.path().join(out).join(name)).unwrap());
    for table in ["trajectory.csv", "nodes.csv"] {
        let [expected, kept] = read(table);
        assert!(expected == kept, "{table}");
    }
    let [_, summary] = read("summary.json");
    assert!(serde_json::from_slice::<serde_json::Value>(&summary).unwrap()["complete"].as_bool().unwrap());
    let kept = names(&folder.path().join("short"));
    assert!(!kept.contains(&"report.html".to_string()) && !kept.iter().any(|name| name.starts_with('.')), "{kept:?}");
}

#[test]
fn a_disk_that_fills_during_a_run_keeps_the_rows_that_were_whole() {
    let folder = folder_of(&[("eel.toml", EEL)]);
    let more = "--set solver.duration_s=5 --out";
    assert_eq!(caudal(folder.path(), &format!("run eel.toml {more} whole")).status.code(), Some(0));
    let output = limited(folder.path(), "ulimit -f 100;", &format!("run eel.toml {more} short"));
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    let read = |out: &str, name: &str| std::fs::read_to_string(folder.path().join(out).join(name)).unwrap();
    for table in ["trajectory.csv", "nodes.csv"] {
        let (whole, short) = (read("whole", table), read("short", table));
        assert!(whole.starts_with(&short) && short.ends_with('\n'), "{table}: every row that is there is whole");
        assert!(short.lines().count() > 20 && short.len() < whole.len(), "{table}: {} rows", short.lines().count());
    }
    let summary: serde_json::Value = serde_json::from_str(&read("short", "summary.json")).unwrap();
    assert!(summary["ending"].as_str().unwrap().contains("cannot be written"), "{}", summary["ending"]);
}

#[test]
fn a_disk_that_is_full_at_the_start_leaves_no_folder() {
    let sweep = "scene = \"eel.toml\"\n[axes]\ndrag.ratio = [1.0, 2.0]\n";
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", sweep)]);
    for verb in ["run eel.toml", "sweep sweep.toml"] {
        let output = limited(folder.path(), "ulimit -f 0;", &format!("{verb} --out some/where"));
        assert!(errors(&output).contains("cannot be written"), "{verb}: {}", errors(&output));
        assert_ne!(output.status.code(), Some(0));
        assert_eq!(names(folder.path()), ["eel.toml", "sweep.toml"], "{verb}");
    }
}

#[test]
fn the_next_run_removes_what_a_killed_one_left_and_nothing_of_one_that_goes_on() {
    let folder = folder_of(&[("eel.toml", EEL)]);
    let out = folder.path().join("out/eel");
    let leftovers = || names(&out).into_iter().filter(|name| name.ends_with(".partial")).count();
    let mut long = Command::new(env!("CARGO_BIN_EXE_caudal"));
    long.current_dir(folder.path()).args(["run", "eel.toml", "--set", "solver.duration_s=1e4"]);
    let mut child = long.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let start = Instant::now();
    while leftovers() < 3 && start.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(leftovers(), 3);
    assert_eq!(caudal(folder.path(), "run eel.toml").status.code(), Some(0));
    assert_eq!(leftovers(), 3, "those of a run that goes on stay");
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(leftovers(), 3);
    assert_eq!(caudal(folder.path(), "run eel.toml").status.code(), Some(0));
    assert_eq!(leftovers(), 0);
}

#[test]
fn levels_whose_names_files_cannot_have_keep_figures_of_their_own() {
    let long = "long ".repeat(60);
    let sweep = format!(
        "scene = \"eel.toml\"\n[axes]\ndrag.ratio = [1.0, 2.0]\n[axes.fluid]\nlabels = [\"水\", \"油\", \"a b\", \"a-b\", \"{long}\"]\n\
         zip.medium.viscosity_pa_s = [0.8, 0.9, 1.0, 1.1, 1.2]\nzip.medium.density_kg_m3 = [1e3, 1e3, 1e3, 1e3, 1e3]\n\
         [report]\nsplit = \"fluid\"\n"
    );
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", &sweep)]);
    let output = caudal(folder.path(), "sweep sweep.toml");
    assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
    let kept = names(&folder.path().join("out/sweep"));
    for beginning in ["displacement", "paths"] {
        let figures: Vec<_> = kept.iter().filter(|name| name.starts_with(beginning)).collect();
        assert_eq!(figures.len(), 5, "one for every level: {figures:?}");
        assert!(figures.iter().all(|name| name.len() < 120), "{figures:?}");
    }
    assert!(kept.contains(&"table.csv".to_string()));
}

#[test]
fn restart_begins_anew_over_a_damaged_journal_and_takes_no_other_file_for_one() {
    let sweep = "scene = \"eel.toml\"\n[axes]\ndrag.ratio = [1.0, 2.0]\n";
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", sweep)]);
    let journal = folder.path().join("out/sweep/cases.journal");
    assert_eq!(caudal(folder.path(), "sweep sweep.toml").status.code(), Some(0));
    let whole = std::fs::read(&journal).unwrap();
    for at in [0, 3, 16, 17, 40] {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        std::fs::write(&journal, &damaged).unwrap();
        let refused = caudal(folder.path(), "sweep sweep.toml");
        assert_eq!(refused.status.code(), Some(2), "byte {at}");
        assert!(errors(&refused).contains("--restart begins anew"), "{}", errors(&refused));
        assert_eq!(std::fs::read(&journal).unwrap(), damaged);
        let anew = caudal(folder.path(), "sweep sweep.toml --restart");
        assert_eq!(anew.status.code(), Some(0), "byte {at}: {}", errors(&anew));
    }
    std::fs::write(&journal, "precious notes\n").unwrap();
    assert_eq!(caudal(folder.path(), "sweep sweep.toml --restart").status.code(), Some(2));
    assert_eq!(std::fs::read_to_string(&journal).unwrap(), "precious notes\n");
}

#[test]
fn more_threads_than_the_system_gives_are_an_error() {
    let sweep = "scene = \"eel.toml\"\n[axes]\ndrag.ratio = { from = 1.0, to = 5.0, count = 2000 }\n";
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", sweep)]);
    let output = limited(folder.path(), "ulimit -v 1000000;", "sweep sweep.toml --jobs 2000");
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    assert!(errors(&output).contains("of 2000 threads could be started"), "{}", errors(&output));
    assert_eq!(errors(&output).lines().count(), 1, "{}", errors(&output));
}

#[cfg(feature = "design")]
#[test]
fn markers_that_no_such_rod_can_have_are_named_by_row_and_column() {
    let scene = std::fs::read_to_string(models("design-identify.toml")).unwrap();
    let data = std::fs::read_to_string(models("design-identify.csv")).unwrap();
    let lines: Vec<&str> = data.lines().collect();
    let first = lines.iter().position(|line| line.starts_with("time_s")).unwrap() + 1;
    let changed = |line: usize, change: &dyn Fn(usize, f64) -> Option<f64>| -> String {
        let row = |(i, text): (usize, &&str)| -> String {
            if i < first || (line > 0 && i + 1 != line) {
                return text.to_string();
            }
            let field = |(k, field): (usize, &str)| match field.parse().ok().and_then(|x| change(k, x)) {
                Some(x) if k > 0 => format!("{x:e}"),
                _ => field.to_string(),
            };
            text.split(',').enumerate().map(field).collect::<Vec<_>>().join(",")
        };
        lines.iter().enumerate().map(row).collect::<Vec<_>>().join("\n") + "\n"
    };
    let here = first + 40;
    let column = |k: usize| lines[first - 1].split(',').nth(k).unwrap();
    for (csv, line, key, problem) in [
        (changed(here, &|k, _| (k == 8).then_some(-9999.0)), here, 8, "found -9999: node 3 is off the rod"),
        (changed(here, &|k, _| (k == 33).then_some(1e300)), here, 33, "node 16 is off the rod"),
        (changed(here, &|k, x| (k == 2).then_some(x + 0.5)), here, 2, "node 0 is off the rod"),
        (changed(0, &|_, x| Some(1000.0 * x)), first + 1, 1, "are these millimetres?"),
        (changed(0, &|_, x| Some(0.001 * x)), first + 1, 1, "which hardly stretches"),
    ] {
        let folder = folder_of(&[("design.toml", &scene), ("design-identify.csv", &csv)]);
        let output = caudal(folder.path(), "design design.toml --out out");
        let place = format!("error: design-identify.csv:{line}: {}: found", column(key));
        assert!(
            errors(&output).starts_with(&place) && errors(&output).contains(problem),
            "{place} … {problem}: {}",
            errors(&output)
        );
        assert_eq!(output.status.code(), Some(2));
        assert!(!folder.path().join("out").exists());
    }
}

#[cfg(feature = "design")]
#[test]
fn a_disk_that_is_full_for_the_report_keeps_the_designed_scene() {
    let folder = tempfile::tempdir().unwrap();
    let scene = models("design-aluminium.toml");
    let output = limited(folder.path(), "ulimit -f 20;", &format!("design '{}' --out out", scene.display()));
    assert_eq!(output.status.code(), Some(1), "{}", errors(&output));
    assert!(errors(&output).contains("report.html; kept in"), "{}", errors(&output));
    let kept = names(&folder.path().join("out"));
    let designed = kept.iter().find(|name| name.ends_with("-designed.toml")).unwrap();
    assert!(!kept.contains(&"report.html".to_string()), "{kept:?}");
    assert_eq!(caudal(&folder.path().join("out"), &format!("check {designed}")).status.code(), Some(0));
}
