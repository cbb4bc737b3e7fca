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
        ("record.interval_s=2e-10", "out/eel: not enough disk space: 5.000e8 rows of trajectory.csv"),
        ("solver.time_step_s=1e-12", "out/eel: not enough disk space: 1.000e11 rows of trajectory.csv"),
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
    crate::interrupt(&child);
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
fn a_page_that_is_not_written_leaves_that_of_the_same_run_and_none_of_another() {
    for (change, stays) in [("", true), (" --set solver.duration_s=0.09", false)] {
        let folder = folder_of(&[("eel.toml", EEL)]);
        let page = folder.path().join("out/report.html");
        let first = caudal(folder.path(), "run eel.toml --out out");
        assert_eq!(first.status.code(), Some(0), "{}", errors(&first));
        let before = std::fs::read(&page).unwrap();
        // Less than the page has, and enough for the rest.
        let output = limited(folder.path(), "ulimit -f 40;", &format!("run eel.toml --out out --force{change}"));
        assert_eq!(output.status.code(), Some(1), "{change}: {}", errors(&output));
        assert!(errors(&output).contains("report.html; kept in"), "{change}: {}", errors(&output));
        let after = std::fs::read(&page).ok();
        assert_eq!(after, stays.then_some(before), "{change}: the earlier page");
        // What is listed is there, and what is there is listed.
        let listed = std::fs::read_to_string(folder.path().join("out/manifest.json")).unwrap();
        assert_eq!(listed.contains("report.html"), stays, "{change}: {listed}");
        let third = caudal(folder.path(), &format!("run eel.toml --out out{change}"));
        assert_eq!(third.status.code(), Some(0), "{change}: {}", errors(&third));
        assert!(page.is_file());
    }
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
    for verb in
        ["run eel.toml", "sweep sweep.toml", "study modes eel.toml", "study scaling eel.toml --nodes 9 --steps 1"]
    {
        let output = limited(folder.path(), "ulimit -f 0;", &format!("{verb} --out some/where"));
        assert!(errors(&output).contains("cannot be written"), "{verb}: {}", errors(&output));
        assert_ne!(output.status.code(), Some(0));
        assert_eq!(names(folder.path()), ["eel.toml", "sweep.toml"], "{verb}");
        // A folder that was there stays, empty as it was.
        let there = folder.path().join("there");
        std::fs::create_dir(&there).unwrap();
        let output = limited(folder.path(), "ulimit -f 0;", &format!("{verb} --out there"));
        assert_ne!(output.status.code(), Some(0));
        std::fs::remove_dir(&there).unwrap_or_else(|error| panic!("{verb}: {error}"));
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
    for verb in ["run eel.toml --force", "study modes eel.toml --force --out out/eel"] {
        let refused = caudal(folder.path(), verb);
        let expected = "error: out/eel: another program is using it; wait until it has finished, or choose another folder with --out\n";
        assert_eq!((refused.status.code(), errors(&refused).as_str()), (Some(2), expected));
    }
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
        assert!(errors(&refused).contains("start again with --restart"), "{}", errors(&refused));
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

#[cfg(feature = "design")]
#[test]
fn a_disk_that_fills_anywhere_in_a_design_leaves_whole_files_and_the_way_on() {
    let folder = tempfile::tempdir().unwrap();
    let scene = models("eel.toml");
    let wanted = r#"design={ goal = "cycle_forward_speed_m_s", variables = ["rod.depth_m", "actuation.kappa_amp"], number_bounds = [0.8, 1.3], largest_power_w = 0.3, starts = 1, iterations = 3, front = { goal = "cycle_cost_of_transport", better = "smaller", points = 3 } }"#;
    let arguments = format!(
        "design '{}' --set rod.nodes=9 --set solver.time_step_s=0.02 --set solver.duration_s=1 --set '{wanted}' --out",
        scene.display()
    );
    let whole = caudal(folder.path(), &format!("{arguments} whole"));
    assert!(matches!(whole.status.code(), Some(0 | 1)), "{}", errors(&whole));
    let all = names(&folder.path().join("whole"));
    for name in ["design.json", "front.csv", "body.csv", "body.stl", "eel-front-1.toml", "report.html"] {
        assert!(all.contains(&name.to_string()), "{name}: {all:?}");
    }
    let mut ends = std::collections::BTreeSet::new();
    for blocks in [0, 1, 2, 3, 4, 6, 8, 12, 16, 32, 64, 128, 256] {
        let out = format!("out-{blocks}");
        let output = limited(folder.path(), &format!("ulimit -f {blocks};"), &format!("{arguments} {out}"));
        let kept = if folder.path().join(&out).exists() { names(&folder.path().join(&out)) } else { Vec::new() };
        assert!(output.status.code().is_some(), "{blocks}: killed");
        if kept.len() < all.len() {
            assert!(!errors(&output).is_empty(), "{blocks}: {kept:?}");
        }
        // The manifest also lists the journal, and what did not come to be.
        for name in kept.iter().filter(|name| !["design.journal", "manifest.json"].contains(&name.as_str())) {
            let [own, complete] =
                [&*out, "whole"].map(|out| std::fs::read(folder.path().join(out).join(name)).unwrap());
            assert!(own == complete, "{blocks}: {name} is not whole");
        }
        ends.insert(kept.len());
        // With room it goes on from there.
        let again = caudal(folder.path(), &format!("{arguments} {out}"));
        assert_eq!(again.status.code(), whole.status.code(), "{blocks}: {}", errors(&again));
        assert_eq!(names(&folder.path().join(&out)), all, "{blocks}");
    }
    println!("{ends:?} files kept");
    assert!(ends.len() >= 4, "{ends:?}");
}

#[test]
fn a_sweep_that_grew_keeps_its_cases_and_one_that_changed_is_refused_with_the_way_out() {
    let sweep = |axes: &str, more: &str| {
        format!(
            "scene = \"eel.toml\"\n[set]\nrod.nodes = 9\n[record]\nplayed = 3\nframes = 5\n{more}\n[axes]\n{axes}\n"
        )
    };
    let small = sweep("drag.ratio = [1.0, 2.0]", "");
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", &small)]);
    let written = |text: &str| std::fs::write(folder.path().join("sweep.toml"), text).unwrap();
    let done = |output: &Output| String::from_utf8_lossy(&output.stdout).lines().next().unwrap_or_default().to_string();
    assert_eq!(caudal(folder.path(), "sweep sweep.toml").status.code(), Some(0));
    // A level in the middle, and an axis of which the base scene has one level: fewer than all cases of before are run again, those
    // whose motion is chosen now.
    for grown in ["drag.ratio = [1.0, 1.5, 2.0]", "rod.nodes = [9, 11]\ndrag.ratio = [1.0, 1.5, 2.0]"] {
        // A key that an axis sets is not set beside it.
        let set = if grown.contains("nodes") { "[set]\nrod.nodes = 9\n" } else { "" };
        written(&sweep(grown, "").replace(set, ""));
        let output = caudal(folder.path(), "sweep sweep.toml");
        assert_eq!(output.status.code(), Some(0), "{}", errors(&output));
        assert!(done(&output).contains("cases are done already"), "{grown}: {}", done(&output));
        let anew = caudal(folder.path(), "sweep sweep.toml --out anew --restart");
        assert_eq!(anew.status.code(), Some(0), "{}", errors(&anew));
        for file in ["table.csv", "report.html"] {
            let [kept, fresh] =
                ["out/sweep", "anew"].map(|out| std::fs::read(folder.path().join(out).join(file)).unwrap());
            assert!(kept == fresh, "{grown}: {file} is that of a sweep that was never smaller");
        }
    }
    let more = "rod.nodes = [9, 11]\ndrag.ratio = [1.0, 1.5, 2.0]\n";
    for (changed, reason) in [
        (
            small.clone(),
            "4 of its cases ran with values that this sweep does not have: the scene changed, a level was taken away",
        ),
        (sweep("drag.ratio = [1.0, 1.5, 2.0, 3.0]", "traces = 3"), "traces, now"),
        (small.replace("= 9", "= 13"), "6 of its cases ran with values that this sweep does not have"),
        (
            sweep(&format!("{more}medium.viscosity_pa_s = [0.4, 1.6]"), "").replace("[set]\nrod.nodes = 9\n", ""),
            "6 of its cases ran with the scene's value of axis medium.viscosity_pa_s, which this sweep does not have; add 0.8 to its levels",
        ),
        (
            sweep(&format!("{more}[axes.stiff]\nkeys = [\"rod.youngs_modulus_pa\"]\nfactors = [2.0, 3.0]"), "")
                .replace("[set]\nrod.nodes = 9\n", ""),
            "axis stiff, which this sweep does not have; add 1 to its levels",
        ),
    ] {
        written(&changed);
        let before = std::fs::read(folder.path().join("out/sweep/cases.journal")).unwrap();
        let output = caudal(folder.path(), "sweep sweep.toml");
        assert_eq!(output.status.code(), Some(2), "{changed}");
        assert!(errors(&output).contains("start again with --restart"), "{}", errors(&output));
        assert!(errors(&output).contains(reason), "{}", errors(&output));
        assert_eq!(std::fs::read(folder.path().join("out/sweep/cases.journal")).unwrap(), before);
    }
}

#[test]
fn a_run_asks_before_it_replaces_results_of_another_scene() {
    let other = EEL.replace("name = \"eel\"", "name = \"worm\"");
    let folder = folder_of(&[("eel.toml", EEL), ("worm.toml", &other)]);
    assert_eq!(caudal(folder.path(), "run eel.toml --out here").status.code(), Some(0));
    let again = caudal(folder.path(), "run eel.toml --out here --set drag.ratio=4");
    assert_eq!(again.status.code(), Some(0), "{}", errors(&again));
    let before = std::fs::read(folder.path().join("here/summary.json")).unwrap();
    let refused = caudal(folder.path(), "run worm.toml --out here");
    let expected = "error: here: holds a run of `eel`, not a run of `worm`; choose another folder with --out, or replace it with --force\n";
    assert_eq!((refused.status.code(), errors(&refused).as_str()), (Some(2), expected));
    assert_eq!(std::fs::read(folder.path().join("here/summary.json")).unwrap(), before);
    assert_eq!(caudal(folder.path(), "run worm.toml --out here --force").status.code(), Some(0));

    // Of the same name: a file that was edited is the same scene, and so is a copy; another file that says other things is not.
    let worm = |ratio: f64| other.replace("ratio = 5.0", &format!("ratio = {ratio:?}"));
    for (file, text, code) in [
        ("worm.toml", worm(3.5), 0),
        ("copy.toml", worm(3.5), 0),
        ("else.toml", worm(4.0), 2),
        ("copy.toml", worm(4.0), 0),
    ] {
        std::fs::write(folder.path().join(file), &text).unwrap();
        let output = caudal(folder.path(), &format!("run {file} --out here"));
        assert_eq!(output.status.code(), Some(code), "{file}: {}", errors(&output));
        let copy = folder.path().canonicalize().unwrap().join("copy.toml");
        let expected = format!("holds a run of `worm` by another file, {}, not by ", copy.display());
        assert!(code == 0 || errors(&output).contains(&expected), "{}", errors(&output));
    }
}

#[test]
fn a_sweep_that_is_run_and_a_scene_that_is_swept_are_told_apart() {
    let sweep = "scene = \"eel.toml\"\n[axes]\ndrag.ratio = [1.0, 2.0]\n";
    let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", sweep)]);
    for verb in ["run", "check", "design"] {
        let output = caudal(folder.path(), &format!("{verb} sweep.toml"));
        let expected = "error: sweep.toml:2: axes: this is a sweep, not a scene; `caudal sweep` runs it\n";
        assert_eq!((output.status.code(), errors(&output).as_str()), (Some(2), expected));
    }
    let output = caudal(folder.path(), "sweep eel.toml");
    let expected = "error: eel.toml:3: rod: this is a scene, not a sweep; `caudal run` runs it\n";
    assert_eq!((output.status.code(), errors(&output).as_str()), (Some(2), expected));
}

#[test]
fn mistakes_in_axes_get_the_nearest_names() {
    for (axes, near) in [
        ("drag.ratoi = [1.0, 2.0]", "did you mean `ratio`?"),
        ("drag.ratio = { form = 1.0, to = 2.0, count = 3 }", "did you mean `from`?"),
        ("drag.ratio = { from = 1.0, to = 2.0, cuont = 3 }", "did you mean `count`?"),
        ("drag.ratio = { betwen = 1.0 }", "did you mean `between`?"),
        ("drag.ratio = { valeus = [1.0], scale = \"log\" }", "did you mean `values`?"),
        ("drag.ratio = [1.0, 2.0]\n[report]\nsplit = \"drag.ratoi\"", "did you mean `drag.ratio`?"),
    ] {
        let sweep = format!("scene = \"eel.toml\"\n[axes]\n{axes}\n");
        let folder = folder_of(&[("eel.toml", EEL), ("sweep.toml", &sweep)]);
        let output = caudal(folder.path(), "sweep sweep.toml");
        assert!(errors(&output).contains(near), "{axes}: {}", errors(&output));
        assert_eq!(output.status.code(), Some(2));
    }
}

#[test]
fn several_mistakes_in_a_scene_are_reported_at_once_each_with_its_line() {
    let scene = EEL
        .replace("nodes = 17", "nodes = 2")
        .replace("length_m = 1.0\nouter", "length_mm = 1.0\nouter")
        .replace("kind = \"travelling-wave\"", "kind = \"standing\"")
        .replace("[drag]\nratio = 5.0", "[drag]\nratio = \"five\"")
        .replace("time_step_s = 1e-2", "time_step_s = 1e-2\ntypo = 1");
    let folder = folder_of(&[("scene.toml", &scene)]);
    let output = caudal(folder.path(), "run scene.toml --set medium.density_kg_m3=-1");
    assert_eq!(output.status.code(), Some(2));
    let told = errors(&output);
    let places: Vec<&str> = told.lines().map(|line| line.split(": ").nth(2).unwrap()).collect();
    let expected = [
        "rod.nodes",
        "rod.length_mm",
        "actuation.kind",
        "drag.ratio",
        "solver.typo",
        "medium.density_kg_m3",
        "rod.length_m", // which is missing
    ];
    assert_eq!(places, expected, "{told}");
    assert!(
        told.lines().all(|line| line.starts_with("error: scene.toml:") || line.starts_with("error: --set")),
        "{told}"
    );
    assert!(
        told.contains("error: scene.toml:4: rod.nodes: found 2;")
            && told.contains("error: scene.toml:18: drag.ratio: found \"five\""),
        "{told}"
    );
}
