//! A folder has one owner: what belongs to others is neither lost nor changed nor mixed without `--force`, whoever comes, however the one
//! before was ended.

#![cfg(unix)]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use caudal::jobs::BUILD;
use caudal::report::MANIFEST;

use crate::eel::{EEL, said};

/// What the eel's scene has for a design.
const DESIGN: &str = "[design]\ngoal = \"distance\"\ndirection = \"-x\"\nstarts = 1\niterations = 1\nbounds = [0.5, 2.0]\nknots = [0.2, 0.8]\n";

const SWEEP: &str = "name = \"eels\"\nscene = \"eel.toml\"\n[axes]\ndrag.form_drag = [1.0, 1.2]\n";

/// A folder with scenes, a sweep of them, and two runs.
fn scenes() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let eel = EEL.replace("duration_s = 0.6", "duration_s = 0.3") + DESIGN;
    let held = eel
        .replace("name = \"eel\"", "name = \"flag\"")
        .replace("[solver]", "[reactive]\n[head]\nkind = \"clamped\"\n[solver]");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("eel.toml", &eel);
    write("worm.toml", &eel.replace("name = \"eel\"", "name = \"worm\""));
    write("flag.toml", &held);
    write("eels.toml", SWEEP);
    for run in ["one", "two"] {
        assert!(caudal(folder.path(), &format!("run eel.toml --out {run}")).status.success());
    }
    folder
}

fn command(folder: &Path, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
    command.current_dir(folder).args(arguments.split_whitespace());
    command
}

fn caudal(folder: &Path, arguments: &str) -> Output {
    command(folder, arguments).output().unwrap()
}

/// The files in `folder` but the manifest, and what killed programs left half-made.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name != MANIFEST && !name.ends_with(".partial") && path.is_file() {
            found.insert(name, std::fs::read(&path).unwrap());
        }
    }
    found
}

/// What the manifest of `folder` lists.
fn listed(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join(MANIFEST)).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(manifest["caudal_build"], BUILD);
    let exports = manifest["exports"].as_array().unwrap().iter().map(|export| &export["files"]);
    let lists = [&manifest["files"], &manifest["journals"]].into_iter().chain(exports);
    lists.flat_map(|list| list.as_array().unwrap()).map(|name| name.as_str().unwrap().to_string()).collect()
}

/// Whose results the manifest of `folder` says it has.
fn owner(folder: &Path) -> Option<String> {
    let manifest: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join(MANIFEST)).ok()?).unwrap();
    let owner = manifest["owner"].as_object()?;
    Some(format!("{} {}", owner["kind"].as_str().unwrap(), owner["name"].as_str().unwrap()))
}

/// Commands that leave results in the folder `here`, with the owner of these.
const COMMANDS: [(&str, &str); 15] = [
    ("run eel", "run eel.toml"),
    ("run worm", "run worm.toml"),
    ("sweep eels", "sweep eels.toml"),
    ("sweep eels", "sweep eels.toml --restart"),
    ("sweep eels", "sweep eels.toml --shard 1/2"),
    ("sweep eels", "sweep merge eels.toml --partial"),
    ("study of modes eel", "study modes eel.toml --count 3"),
    ("study of accuracy eel", "study accuracy eel.toml --nodes 5 --steps 1e-2 --tolerances 1e-2"),
    ("study of fluid eel", "study fluid eel.toml --set solver.duration_s=0.2"),
    ("study of scaling eel", "study scaling eel.toml --nodes 5 --steps 1"),
    ("study of stability eel", "study stability eel.toml --points 2 --set solver.duration_s=0.05"),
    ("study of stability flag", "study stability flag.toml --vary flow --points 2"),
    ("design eel", "design eel.toml"),
    ("comparison one, two", "compare one two"),
    ("export", "export eel.toml --vtk"),
];

#[test]
fn no_sequence_of_commands_loses_or_changes_what_is_another_s() {
    let sequences: usize = std::env::var("CAUDAL_SEQUENCES").map_or(12, |count| count.parse().unwrap());
    let mut dice = fastrand::Rng::with_seed(std::env::var("CAUDAL_SEED").map_or(1, |seed| seed.parse().unwrap()));
    let folder = scenes();
    let (mut refused, mut killed, mut went) = (0, 0, 0);
    for sequence in 0..sequences {
        let here = folder.path().join(format!("here-{sequence}"));
        std::fs::create_dir(&here).unwrap();
        std::fs::write(here.join("notes.txt"), "mine").unwrap();
        // Every pair comes in turn, the first of them often ended at some moment; then any other.
        let pair = dice.usize(..COMMANDS.len() * COMMANDS.len());
        let third = dice.usize(..COMMANDS.len());
        for (place, i) in [pair / COMMANDS.len(), pair % COMMANDS.len(), third].into_iter().enumerate() {
            let (own, arguments) = COMMANDS[i];
            let (was, before) = (files(&here), owner(&here));
            let text = format!("{arguments} --out here-{sequence}");
            let kill = place < 2 && dice.bool();
            let code = if kill {
                let mut child =
                    command(folder.path(), &text).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
                std::thread::sleep(Duration::from_millis(dice.u64(0..60)));
                let _ = child.kill();
                killed += 1;
                child.wait().unwrap().code()
            } else {
                caudal(folder.path(), &text).status.code()
            };
            let is = files(&here);
            let place = format!("sequence {sequence}: {arguments} (killed: {kill}, {code:?}) after {before:?}");
            assert_eq!(is.get("notes.txt").map(Vec::as_slice), Some(&b"mine"[..]), "{place}");
            let another = was.len() > 1 && before.as_ref().is_some_and(|before| before != own);
            // Exports add to whatever there is; where there are only exports, results are added to them.
            let adds = own == "export" || before.is_none();
            if another || adds {
                for (name, content) in &was {
                    assert!(is.get(name) == Some(content), "{place}: {name}");
                }
            }
            if another && own != "export" {
                assert_eq!(was, is, "{place}");
                assert_eq!(owner(&here), before, "{place}");
                assert!(kill || code == Some(2), "{place}");
                refused += 1;
            } else {
                assert!(kill || matches!(code, Some(0 | 1)), "{place}");
                went += 1;
            }
            // Every file is somebody's.
            if is.len() > 1 {
                let listed = listed(&here);
                let stray = is.keys().find(|name| *name != "notes.txt" && !listed.contains(name));
                assert_eq!(stray, None, "{place}: {listed:?}");
            }
        }
        std::fs::remove_dir_all(&here).unwrap();
    }
    println!("{sequences} sequences: {went} went on, {refused} met others' results, {killed} killed");
}

#[test]
fn a_study_leaves_the_journal_of_a_sweep_and_nobody_s_results_are_mixed() {
    let folder = scenes();
    let here = folder.path().join("here");
    let ok = |arguments: &str| {
        let output = caudal(folder.path(), &format!("{arguments} --out here"));
        assert_eq!(output.status.code(), Some(0), "{arguments}: {}", said(&output));
    };
    let refused = |arguments: &str, words: &str| {
        let was = files(&here);
        let output = caudal(folder.path(), &format!("{arguments} --out here"));
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(said(&output).contains(words), "{arguments}: {}", said(&output));
        assert_eq!(files(&here), was, "{arguments}");
    };
    ok("sweep eels.toml");
    assert!(here.join("cases.journal").exists());
    refused(
        "study modes eel.toml",
        "holds a sweep of `eels`, not a study of modes of `eel`; choose another folder with --out, or replace it with --force",
    );
    refused("run eel.toml", "holds a sweep of `eels`, not a run of `eel`");
    refused("design eel.toml", "holds a sweep of `eels`, not a design of `eel`");
    // Replaced on demand, whole.
    ok("study modes eel.toml --force");
    let study = files(&here);
    assert!(
        !study.contains_key("cases.journal") && !study.contains_key("table.csv") && study.contains_key("summary.json")
    );
    refused("sweep eels.toml", "holds a study of modes of `eel`, not a sweep of `eels`");
    refused(
        "study scaling eel.toml --nodes 5 --steps 1",
        "holds a study of modes of `eel`, not a study of scaling of `eel`",
    );
    refused("run eel.toml", "holds a study of modes of `eel`");
    ok("run eel.toml --force");
    ok("run eel.toml");
    ok("run eel.toml --set drag.form_drag=1.3");
    refused("sweep eels.toml", "holds a run of `eel`");
    refused("run worm.toml", "holds a run of `eel`, not a run of `worm`");
    ok("sweep eels.toml --force");
    let kept: Vec<String> = files(&here).into_keys().collect();
    assert!(!kept.contains(&"trajectory.csv".to_string()) && kept.contains(&"table.csv".to_string()), "{kept:?}");
    // A run and the design of its scene have folders of their own.
    for arguments in ["run eel.toml", "design eel.toml", "run eel.toml", "export eel.toml --vtk"] {
        let output = caudal(folder.path(), arguments);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{arguments}: {}", said(&output));
    }
    assert!(
        folder.path().join("out/eel/summary.json").exists()
            && folder.path().join("out/eel-design/design.json").exists()
    );
    assert!(folder.path().join("out/eel/vtk/eel.pvd").exists());
}

#[test]
fn results_without_a_manifest_and_files_of_the_user_s_are_not_taken() {
    let folder = scenes();
    let here = folder.path().join("here");
    assert_eq!(caudal(folder.path(), "run eel.toml --out here").status.code(), Some(0));
    std::fs::remove_file(here.join(MANIFEST)).unwrap();
    let was = files(&here);
    let output = caudal(folder.path(), "run eel.toml --out here");
    assert_eq!(output.status.code(), Some(2));
    let expected = "which no manifest.json lists (an older caudal wrote none), not a run of `eel`; choose another folder with --out, or replace it with --force\n";
    assert!(
        said(&output).starts_with("error: here: holds summary.json, ") && said(&output).ends_with(expected),
        "{}",
        said(&output)
    );
    assert_eq!(files(&here), was);
    assert_eq!(caudal(folder.path(), "run eel.toml --out here --force").status.code(), Some(0));
    assert_eq!(caudal(folder.path(), "run eel.toml --out here").status.code(), Some(0));
    // A table that only some results have is noticed when it is written.
    std::fs::create_dir(folder.path().join("study")).unwrap();
    std::fs::write(folder.path().join("study/modes.csv"), "mine").unwrap();
    let output = caudal(folder.path(), "study modes eel.toml --out study");
    let study = files(&folder.path().join("study"));
    assert_eq!(study["modes.csv"], b"mine", "{:?}", study.keys());
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("holds a file that no manifest.json lists"), "{}", said(&output));
    // What looks like a file in the making is one only beside a file that is listed.
    let strangers = [".notes.abc123.partial", ".download.partial", ".summary.json.abc123.partial"];
    strangers.iter().for_each(|name| std::fs::write(here.join(name), "mine").unwrap());
    assert_eq!(caudal(folder.path(), "study modes eel.toml --out here").status.code(), Some(2));
    assert!(strangers.iter().all(|name| here.join(name).exists()), "a command that is refused removes nothing");
    assert_eq!(caudal(folder.path(), "run eel.toml --out here").status.code(), Some(0));
    assert_eq!(strangers.map(|name| here.join(name).exists()), [true, true, false]);
    // A manifest of something else.
    std::fs::create_dir(folder.path().join("web")).unwrap();
    std::fs::write(folder.path().join("web").join(MANIFEST), "{\"icons\": 3").unwrap();
    let output = caudal(folder.path(), "run eel.toml --out web");
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("it is no manifest of results; choose another folder"), "{}", said(&output));
}

#[test]
fn restart_leaves_nothing_of_the_sweep_before() {
    let folder = scenes();
    let here = folder.path().join("here");
    assert_eq!(caudal(folder.path(), "sweep eels.toml --out here").status.code(), Some(0));
    let figures = |names: Vec<String>| names.into_iter().filter(|name| name.ends_with(".svg")).collect::<Vec<_>>();
    let before = figures(files(&here).into_keys().collect());
    assert!(before.iter().any(|name| name.contains("form-drag")), "{before:?}");
    let other = SWEEP.replace("drag.form_drag = [1.0, 1.2]", "rod.length_m = [1.0, 1.1]");
    std::fs::write(folder.path().join("eels.toml"), other).unwrap();
    let refused = caudal(folder.path(), "sweep eels.toml --out here");
    assert!(said(&refused).contains("start again with --restart"), "{}", said(&refused));
    assert_eq!(figures(files(&here).into_keys().collect()), before);
    assert_eq!(caudal(folder.path(), "sweep eels.toml --out here --restart").status.code(), Some(0));
    let after = figures(files(&here).into_keys().collect());
    assert!(!after.is_empty() && after.iter().all(|name| !name.contains("form-drag")), "{after:?}");
    // Another build begins anew too.
    assert!(BUILD.starts_with(concat!(env!("CARGO_PKG_VERSION"), "+")) && BUILD.len() > 16, "{BUILD}");
    let mine = caudal::jobs::Job::new("x", b"", 1);
    let other = caudal::jobs::Job { caudal_version: env!("CARGO_PKG_VERSION").to_string(), ..mine.clone() };
    assert!(mine.difference(&other).unwrap().starts_with("made by caudal"));
}

#[test]
fn a_journal_that_is_elsewhere_or_only_begun_is_no_hindrance() {
    let folder = scenes();
    let (here, elsewhere) = (folder.path().join("here"), folder.path().join("elsewhere.journal"));
    assert_eq!(caudal(folder.path(), "sweep eels.toml --out here").status.code(), Some(0));
    std::fs::rename(here.join("cases.journal"), &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, here.join("cases.journal")).unwrap();
    std::fs::write(folder.path().join("eels.toml"), SWEEP.replace("[1.0, 1.2]", "[1.0, 1.1, 1.2]")).unwrap();
    let grown = caudal(folder.path(), "sweep eels.toml --out here");
    assert_eq!(grown.status.code(), Some(0), "{}", said(&grown));
    assert!(String::from_utf8_lossy(&grown.stdout).contains("2 of 3 cases are done already"), "{grown:?}");
    assert!(std::fs::symlink_metadata(here.join("cases.journal")).unwrap().file_type().is_symlink());
    assert_eq!(std::fs::read_to_string(&elsewhere).unwrap().lines().count(), 4);
    // Of two shards the second has written half of its first line.
    assert_eq!(caudal(folder.path(), "sweep eels.toml --out parts --shard 1/2").status.code(), Some(0));
    std::fs::write(folder.path().join("parts/shard-2-of-2.journal"), "0123456789abc").unwrap();
    let merged = caudal(folder.path(), "sweep merge eels.toml --out parts --partial");
    assert_eq!(merged.status.code(), Some(0), "{}", said(&merged));
    assert!(folder.path().join("parts/table.csv").exists());
}

#[test]
fn a_folder_that_was_there_stays_when_what_should_go_into_it_fails() {
    let folder = scenes();
    for there in ["results", "deep/er"] {
        std::fs::create_dir_all(folder.path().join(there)).unwrap();
        for (arguments, created) in [
            (format!("run eel.toml --set rod.nodes=2 --out {there}"), "nothing"),
            (format!("run eel.toml --set solver.integrator=unknown --out {there}/new/folder"), "new"),
            (format!("design worm.toml --set design.bounds=[1.2,1.1] --out {there}/new"), "new"),
        ] {
            assert_ne!(caudal(folder.path(), &arguments).status.code(), Some(0), "{arguments}");
            assert!(folder.path().join(there).is_dir(), "{arguments}");
            assert!(!folder.path().join(there).join(created).exists(), "{arguments}");
        }
    }
}

#[cfg(feature = "pictures")]
#[test]
fn films_and_pictures_of_other_results_go_with_them() {
    let folder = scenes();
    let here = folder.path().join("out/eel");
    let made = |name: &str| here.join(name).exists();
    let must = |arguments: &str| {
        let output = caudal(folder.path(), arguments);
        assert!(output.status.success(), "{arguments}: {}", said(&output));
    };
    must("run eel.toml");
    must("export out/eel --gif --png");
    assert!(made("eel.gif") && files(&here).keys().any(|name| name.ends_with(".png")));
    must("run eel.toml");
    assert!(made("eel.gif"), "of the same run it is right");
    must("run eel.toml --set actuation.kappa_amp=2.0");
    let left: Vec<String> =
        files(&here).into_keys().filter(|name| name.ends_with(".gif") || name.ends_with(".png")).collect();
    assert_eq!(left, [""; 0]);
    assert!(!listed(&here).iter().any(|name| name.ends_with(".gif")));
    // What was exported of another scene stays.
    must("export worm.toml --gif --out out/eel");
    must("run eel.toml");
    assert!(made("worm.gif"));
}
