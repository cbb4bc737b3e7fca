//! `caudal compare`: keys, results, curves and films of runs are those of their own files, side by side.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use crate::eel::{self, EEL, caudal, done, said};
use crate::page::{assert_self_contained, attribute, browse, chromium, narrow};

/// A folder with the scene eel.toml.
fn place() -> tempfile::TempDir {
    eel::place(EEL)
}

/// Runs eel.toml with these overrides; its folder is `name`.
fn run(folder: &Path, name: &str, overrides: &[&str]) {
    let sets = overrides.iter().flat_map(|set| ["--set", set]);
    let arguments: Vec<&str> = ["run", "eel.toml", "--out", name].into_iter().chain(sets).collect();
    done(folder, &arguments);
}

fn json(path: PathBuf) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn table(path: PathBuf) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    reader.deserialize().map(Result::unwrap).collect()
}

/// The columns of a table of numbers.
fn columns(path: PathBuf) -> BTreeMap<String, Vec<f64>> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(str::to_string).collect();
    let mut found: BTreeMap<String, Vec<f64>> = header.iter().map(|name| (name.clone(), Vec::new())).collect();
    for row in reader.records() {
        for (name, text) in header.iter().zip(row.unwrap().iter()) {
            found.get_mut(name).unwrap().push(text.parse().unwrap());
        }
    }
    found
}

/// Changes the summary of the run in `folder`.
fn change_summary(folder: &Path, change: impl FnOnce(&mut serde_json::Map<String, Value>)) {
    let path = folder.join("summary.json");
    let mut summary = json(path.clone());
    change(summary.as_object_mut().unwrap());
    std::fs::write(path, summary.to_string()).unwrap();
}

#[test]
fn keys_and_results_that_differ_are_those_of_the_scenes_and_summaries() {
    let folder = place();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), "a", &[]);
    // The same numbers, written differently, in a file of another name.
    let other = EEL.replace("length_m = 1.0", "length_m = 1").replace("5e6", "5000000.0").replace("1e-2", "0.01");
    std::fs::write(at("other.toml"), other.replace("name = \"eel\"", "# a <comment> & \"more\"\nname = \"eel\""))
        .unwrap();
    let sets = ["--set", "actuation.kappa_amp=4", "--set", "drag.form_drag=1.2"];
    done(folder.path(), &[&["run", "other.toml", "--out", "b"][..], &sets].concat());
    let printed = done(folder.path(), &["compare", "a", "b"]);
    let keys = table(at("out/compare-a-b/keys.csv"));
    let row = |key: &str, a: &str, b: &str| -> BTreeMap<String, String> {
        [("key", key), ("a", a), ("b", b)].map(|(name, text)| (name.to_string(), text.to_string())).into()
    };
    assert_eq!(keys, [row("actuation.kappa_amp", "3.0", "4"), row("drag.form_drag", "", "1.2")]);
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines[0], "runs: a | b");
    assert_eq!(lines[1], "2 keys differ: actuation.kappa_amp = 3 | 4; drag.form_drag = not given | 1.2.");
    assert!(lines.last().unwrap().ends_with(" files in out/compare-a-b: open report.html"), "{printed}");
    assert!(printed.contains("No run states an error of its results"), "{printed}");
    // Every number of both summaries is there, with its difference.
    let [a, b] = ["a", "b"].map(|name| json(at(name).join("summary.json")));
    let results = table(at("out/compare-a-b/results.csv"));
    let mut checked = 0;
    for own in results.iter().filter(|row| row["run"] == "b" && !row["key"].contains('.') && row["key"] != "wall_s") {
        let [Some(first), Some(second)] = [&a, &b].map(|summary| summary[&own["key"]].as_f64()) else { continue };
        assert_eq!(own["value"].parse::<f64>().unwrap(), second);
        let difference: f64 = own["difference"].parse().unwrap();
        assert!((difference - (second - first)).abs() <= 1e-12 * first.abs().max(second.abs()), "{own:?}");
        if first != 0.0 {
            let relative: f64 = own["relative_difference"].parse().unwrap();
            assert!((relative - (second - first) / first).abs() <= 1e-9 * relative.abs() + 1e-12, "{own:?}");
        }
        assert_eq!(own["stated_error"], "");
        checked += 1;
    }
    assert!(checked > 40, "{checked}");
    let missing: Vec<&String> = a
        .as_object()
        .unwrap()
        .iter()
        .filter(|(key, value)| value.as_f64().is_some_and(|x| x != 0.0) && !key.contains("spread"))
        .map(|(key, _)| key)
        .filter(|key| !results.iter().any(|row| row["key"] == **key))
        .collect();
    assert!(missing.is_empty(), "{missing:?}");
    let pair = results.iter().find(|row| row["key"] == "drag_impulse_n_s.y" && row["run"] == "b");
    assert!(pair.is_none() || b["drag_impulse_n_s"][1].as_f64() == pair.unwrap()["value"].parse().ok());
    // The same content as JSON, from the command and in the file.
    let summary = json(at("out/compare-a-b/summary.json"));
    let printed = done(folder.path(), &["compare", "a", "b", "--json"]);
    assert_eq!(serde_json::from_str::<Value>(&printed).unwrap(), summary);
    assert_eq!(summary["keys"]["drag.form_drag"], serde_json::json!({ "a": null, "b": 1.2 }));
    assert_eq!(summary["results"]["x_com_m"]["values"]["b"], b["x_com_m"]);
}

#[test]
fn the_same_run_twice_does_not_differ() {
    let folder = place();
    run(folder.path(), "a", &[]);
    run(folder.path(), "again", &[]);
    for (second, name) in [("a", "compare-a-a-2"), ("again", "compare-a-again")] {
        let printed = done(folder.path(), &["compare", "a", second]);
        assert!(printed.contains("No key of the scenes differs."), "{printed}");
        assert!(printed.contains("The runs do not differ: all results are equal."), "{printed}");
        assert!(!printed.contains("error"), "{printed}");
        assert!(folder.path().join("out").join(name).join("report.html").is_file(), "{printed}");
    }
    // A table that the scene names has other values.
    let held = EEL.replace("[solver]", "[head]\nkind = \"driven\"\nangle_rad = { table = \"angle.csv\" }\n[solver]");
    std::fs::write(folder.path().join("held.toml"), held).unwrap();
    for (name, last) in [("h1", "0.1"), ("h2", "0.2")] {
        std::fs::write(folder.path().join("angle.csv"), format!("time_s,angle_rad\n0,0\n1,{last}\n")).unwrap();
        done(folder.path(), &["run", "held.toml", "--out", name]);
    }
    let printed = done(folder.path(), &["compare", "h1", "h2"]);
    assert!(printed.contains("No key of the scenes differs; what differs is the content of a table"), "{printed}");
}

#[test]
fn a_difference_is_above_the_stated_errors_if_it_is_larger_than_their_sum() {
    let folder = place();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), "a", &[]);
    run(folder.path(), "b", &["actuation.kappa_amp=3.3"]);
    let [a, b] = ["a", "b"].map(|name| json(at(name).join("summary.json")));
    // What errors of the displacement are relative to, from the files alone.
    let scale = |name: &str, summary: &Value| {
        let trajectory = columns(at(name).join("trajectory.csv"));
        let moved = ["x_com_m", "y_com_m"].map(|key| summary[key].as_f64().unwrap() - trajectory[key][0]);
        moved[0].hypot(moved[1]).max(0.01 * summary["com_path_m"].as_f64().unwrap())
    };
    let difference = (b["net_displacement_m"].as_f64().unwrap() - a["net_displacement_m"].as_f64().unwrap()).abs();
    let power = |summary: &Value| summary["mean_actuation_power_w"].as_f64().unwrap();
    for (part, above) in [(0.9, true), (1.1, false)] {
        // Each run states half of the part of the difference, of a full model whose displacement may be larger by that.
        for (name, summary) in [("a", &a), ("b", &b)] {
            let own = 0.5 * part * difference / scale(name, summary);
            let error = own / (1.0 + own);
            change_summary(&at(name), |summary| {
                let verification = serde_json::json!({
                    "relative_differences": { "displacement": error, "tip": 0.5 }, "noise": ["tip"],
                });
                summary.insert("verification".to_string(), verification);
                summary.insert("fluid_error".to_string(), serde_json::json!({ "motion": 0.0, "power": 0.2 }));
                summary.insert("fluid_uncertainty".to_string(), serde_json::json!({ "motion": 9.0, "power": 9.0 }));
            });
        }
        let printed = done(folder.path(), &["compare", "a", "b", "--out", "both"]);
        let found = json(at("both/summary.json"));
        let of = |key: &str| found["results"][key]["differences"]["b"].clone();
        let stated = of("net_displacement_m")["stated_error"].as_f64().unwrap();
        assert!((stated - part * difference).abs() < 1e-9 * difference, "{stated} {difference}");
        assert_eq!(of("net_displacement_m")["above_stated_error"], above);
        // A comparison with the full model says nothing of the power.
        assert_eq!(of("mean_actuation_power_w")["stated_error"], Value::Null);
        assert_eq!(of("com_path_m")["stated_error"], Value::Null);
        assert!(
            printed.contains(
                "Stated relative errors, which are added up: a: difference from the full model: displacement"
            )
        );
        assert!(!printed.contains("tip"), "what is rounding states no error: {printed}");
    }
    // The law's errors of both add up; its uncertainty is common to both.
    for name in ["a", "b"] {
        change_summary(&at(name), |summary| drop(summary.remove("verification")));
    }
    done(folder.path(), &["compare", "a", "b", "--out", "both"]);
    let stated =
        &json(at("both/summary.json"))["results"]["mean_actuation_power_w"]["differences"]["b"]["stated_error"];
    assert!((stated.as_f64().unwrap() - 0.2 * (power(&a) + power(&b))).abs() < 1e-9 * power(&b));
    // Under another law its uncertainty counts.
    change_summary(&at("b"), |summary| drop(summary.insert("forces".to_string(), serde_json::json!(["other"]))));
    done(folder.path(), &["compare", "a", "b", "--out", "both"]);
    let stated =
        &json(at("both/summary.json"))["results"]["mean_actuation_power_w"]["differences"]["b"]["stated_error"];
    assert!((stated.as_f64().unwrap() - 9.2 * (power(&a) + power(&b))).abs() < 1e-9 * 9.2 * power(&b));
    // Of a model that was chosen by its estimate, the reason states the error.
    for name in ["a", "b"] {
        change_summary(&at(name), |summary| {
            summary.remove("verification");
            let reason = "its largest estimated error, of the displacement, is 3.0e-2 of the larger of the net displacement through the fluid and 1 % of the path: within the accuracy 1e-1";
            summary.insert("model_reason".to_string(), reason.into());
            summary.insert("fluid_error".to_string(), Value::Null);
            summary.insert("fluid_uncertainty".to_string(), Value::Null);
        });
    }
    done(folder.path(), &["compare", "a", "b", "--out", "both"]);
    let found = json(at("both/summary.json"));
    let stated = found["results"]["x_com_m"]["differences"]["b"]["stated_error"].as_f64().unwrap();
    assert!((stated - 0.03 / 0.97 * (scale("a", &a) + scale("b", &b))).abs() < 1e-9 * stated);
}

#[test]
fn what_is_no_folder_of_a_run_is_named() {
    let folder = place();
    run(folder.path(), "a", &[]);
    run(folder.path(), "b", &["rod.nodes=7"]);
    std::fs::write(
        folder.path().join("eels.toml"),
        "name = \"eels\"\nscene = \"eel.toml\"\n[axes]\nrod.nodes = [5, 7]\n",
    )
    .unwrap();
    done(folder.path(), &["sweep", "eels.toml", "--out", "swept"]);
    done(folder.path(), &["study", "modes", "eel.toml", "--count", "1", "--out", "studied"]);
    done(folder.path(), &["compare", "a", "b"]);
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    run(folder.path(), "killed", &[]);
    std::fs::remove_file(folder.path().join("killed/summary.json")).unwrap();
    run(folder.path(), "damaged", &[]);
    let path = folder.path().join("damaged/trajectory.csv");
    let rows = std::fs::read_to_string(&path).unwrap();
    let cut: String = rows.lines().take(3).chain(["0.02,abc"]).collect::<Vec<_>>().join("\n");
    std::fs::write(&path, cut).unwrap();
    run(folder.path(), "torn", &[]);
    std::fs::write(folder.path().join("torn/summary.json"), "{ \"name\": ").unwrap();
    let nine: Vec<&str> = ["compare"].into_iter().chain(["a"; 9]).collect();
    for (arguments, expected) in [
        (
            &["compare", "a", "eel.toml"][..],
            "eel.toml: cannot be read: it is a scene, not the folder of a run; `caudal run eel.toml` first",
        ),
        (&["compare", "a", "a/shape.svg"], "a/shape.svg: cannot be read: it is a file, not the folder of a run"),
        (&["compare", "a", "swept"], "swept: cannot be read: it holds a sweep of `eels`; allowed: folders of runs"),
        (
            &["compare", "a", "studied"],
            "studied: cannot be read: it holds a study of modes of `eel`; allowed: folders of runs",
        ),
        (
            &["compare", "out/compare-a-b", "a"],
            "out/compare-a-b: cannot be read: it holds a comparison of `a, b`; allowed: folders of runs",
        ),
        (
            &["compare", "a", "nowhere"],
            "nowhere: cannot be read: there is no such folder; `caudal run SCENE` makes the folder of a run",
        ),
        (
            &["compare", "a", "empty"],
            "empty: cannot be read: it holds no run; `caudal run SCENE` makes the folder of a run",
        ),
        (
            &["compare", "a", "killed"],
            "killed: cannot be read: it holds a run of `eel` without a summary.json, as the run has not ended or was killed; run it again",
        ),
        (&["compare", "a", "damaged"], "damaged/trajectory.csv: cannot be read: CSV error: record 3 (line: 4"),
        (&["compare", "a", "torn"], "torn/summary.json: cannot be read: EOF while parsing"),
        (&["compare", "a"], "the runs cannot be compared: found 1 of them; allowed: 2 to 8"),
        (&nine, "the runs cannot be compared: found 9 of them; allowed: 2 to 8; a sweep compares more"),
        (
            &["compare", "a", "b", "--out", "b", "--force"],
            "the runs cannot be compared: b is one of them; choose another folder for the comparison",
        ),
        (
            &["compare", "a", "b", "--out", "killed"],
            "killed: holds a run of `eel`, not a comparison of `a, b`; choose another folder with --out, or replace it with --force",
        ),
    ] {
        let output = caudal(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let said = said(&output);
        assert!(said.starts_with(&format!("error: {expected}")) && said.lines().count() == 1, "{arguments:?}: {said}");
        assert!(output.stdout.is_empty());
    }
    assert!(folder.path().join("b/summary.json").is_file(), "a run is not replaced by its comparison");
    // Another comparison of runs of these names does not take the place of the first.
    let elsewhere = folder.path().join("c");
    std::fs::create_dir(&elsewhere).unwrap();
    for name in ["a", "b"] {
        std::fs::rename(folder.path().join(name), elsewhere.join(name)).unwrap();
    }
    let output = caudal(folder.path(), &["compare", "c/a", "c/b"]);
    assert!(
        said(&output).contains("out/compare-a-b: holds a comparison of `a, b` by another file"),
        "{}",
        said(&output)
    );
}

#[test]
fn runs_of_one_name_are_told_apart_by_their_folders() {
    let folder = place();
    for (name, nodes) in [("x/one", 5), ("y/one", 6), ("two", 7), ("worm", 8)] {
        run(folder.path(), name, &[&format!("rod.nodes={nodes}")]);
    }
    std::fs::write(folder.path().join("worm.toml"), EEL.replace("\"eel\"", "\"worm\"")).unwrap();
    done(folder.path(), &["run", "worm.toml", "--out", "w"]);
    for (runs, labels) in [
        (&["x/one", "two"][..], "runs: one | two"),
        (&["x/one", "y/one"], "runs: x/one | y/one"),
        (&["x/one", "w"], "runs: eel | worm"),
        (&["x/one", "y/one", "two", "x/one"], "one | "),
    ] {
        let printed = done(folder.path(), &[&["compare"], runs, &["--out", "all", "--force"]].concat());
        let first = printed.lines().next().unwrap();
        assert!(first.contains(labels), "{first}");
        let names: std::collections::BTreeSet<&str> = first.trim_start_matches("runs: ").split(" | ").collect();
        assert_eq!(names.len(), runs.len(), "{first}");
    }
}

#[test]
fn runs_that_end_early_or_lack_files_are_compared_as_far_as_they_go() {
    let folder = place();
    run(folder.path(), "a", &[]);
    run(folder.path(), "long", &["solver.duration_s=1.2", "record.nodes_table=none"]);
    run(
        folder.path(),
        "tiny",
        &["rod.length_m=1e-3", "rod.outer_radius_m=2e-5", "actuation.wavelength_m=1e-3", "actuation.kappa_amp=3000"],
    );
    run(folder.path(), "late", &["record.nodes_from_s=0.7", "solver.duration_s=0.9"]);
    // One that ends in the middle.
    let arguments = ["run", "eel.toml", "--out", "failed", "--set", "actuation.kappa_amp=300"];
    let failed = caudal(folder.path(), &arguments);
    assert_eq!(failed.status.code(), Some(1), "{}", said(&failed));
    let printed = done(folder.path(), &["compare", "a", "long", "failed", "tiny", "--out", "all"]);
    for expected in [
        "note: failed did not reach its end: ",
        "note: the runs end at different times, ",
        "note: long: it has no table of nodes (record.nodes_table): it is not in the film",
        "note: tiny is so much smaller than the others that it is a dot in the film",
    ] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
    let printed = done(folder.path(), &["compare", "a", "late", "--out", "all", "--force"]);
    assert!(printed.contains("note: there is no film: the tables of nodes have no time in common"), "{printed}");
    let page = std::fs::read_to_string(folder.path().join("all/report.html")).unwrap();
    assert!(!page.contains("id=\"stage\"") && page.contains("id=\"results\""));
    // Without its page the scene is that of the file, as long as this is the same.
    for file in ["report.html", "trajectory.csv", "nodes.csv"] {
        std::fs::remove_file(folder.path().join("a").join(file)).unwrap();
    }
    let printed = done(folder.path(), &["compare", "a", "long", "--out", "all", "--force"]);
    assert!(
        printed.contains("2 keys differ: record.nodes_table = not given | none; solver.duration_s = 0.6 | 1.2."),
        "{printed}"
    );
    assert!(printed.contains("note: a: trajectory.csv is missing: it has no curves in the figures"), "{printed}");
    std::fs::write(folder.path().join("eel.toml"), EEL.replace("kappa_amp = 3.0", "kappa_amp = 3.1")).unwrap();
    let printed = done(folder.path(), &["compare", "a", "long", "--out", "all", "--force"]);
    assert!(printed.contains("The keys of the scenes cannot be compared: fewer than two are known."), "{printed}");
    assert!(printed.contains("note: a: its scene is not known: neither report.html has it, nor is "), "{printed}");
}

/// The film on a page.
fn film(page: &Path) -> Value {
    let text = std::fs::read_to_string(page).unwrap();
    let json = text.split("<script id=\"motion\" type=\"application/json\">").nth(1).unwrap();
    serde_json::from_str(json.split("</script>").next().unwrap()).unwrap()
}

/// The coordinates of the nodes of a rod of a `film` in each frame: they are packed, and relative to its centre of mass.
fn positions(film: &Value, packed: &Value) -> Vec<Vec<f64>> {
    let com: Vec<Vec<f64>> = film["com"].as_array().unwrap().iter().map(numbers).collect();
    let bytes = STANDARD.decode(packed.as_str().unwrap()).unwrap();
    let all: Vec<f64> =
        bytes.chunks_exact(4).map(|four| f64::from(f32::from_le_bytes(four.try_into().unwrap()))).collect();
    let frames = all.chunks_exact(all.len() / com.len()).zip(&com);
    frames.map(|(frame, com)| frame.iter().enumerate().map(|(i, x)| x + com[i % 2]).collect()).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The value at a time of what was recorded, on the cubic between two records whose slopes at both are those of parabolas.
fn interpolated(times: &[f64], values: &[f64], time: f64) -> f64 {
    let next = times.iter().position(|t| *t >= time - 1e-12).unwrap_or(times.len() - 1).max(1);
    let rise = |a: usize, b: usize| (values[b] - values[a]) / (times[b] - times[a]);
    let slope = |k: usize| match k {
        0 => rise(0, 1),
        _ if k + 1 == times.len() => rise(k - 1, k),
        _ => {
            let part = (times[k + 1] - times[k]) / (times[k + 1] - times[k - 1]);
            part * rise(k - 1, k) + (1.0 - part) * rise(k, k + 1)
        }
    };
    let step = times[next] - times[next - 1];
    let u = (time - times[next - 1]) / step;
    let hermite = [
        2.0 * u.powi(3) - 3.0 * u * u + 1.0,
        u.powi(3) - 2.0 * u * u + u,
        3.0 * u * u - 2.0 * u.powi(3),
        u.powi(3) - u * u,
    ];
    let [a, p, b, q] = [values[next - 1], step * slope(next - 1), values[next], step * slope(next)];
    hermite.iter().zip([a, p, b, q]).map(|(weight, value)| weight * value).sum()
}

#[test]
fn the_film_shows_all_rods_at_the_same_times_where_their_tables_have_them() {
    let folder = place();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), "a", &[]);
    run(
        folder.path(),
        "b",
        &["record.interval_s=0.0137", "actuation.kappa_amp=4", "solver.duration_s=0.5", "record.nodes=[-1,0,2]"],
    );
    run(folder.path(), "c", &["record.nodes_table=parquet", "record.nodes_from_s=0.1"]);
    run(folder.path(), "d", &["record.nodes_from_s=0.1"]);
    done(folder.path(), &["compare", "a", "b", "c", "d", "--out", "all"]);
    let film = film(&at("all/report.html"));
    let times = numbers(&film["times"]);
    assert!(times.len() >= 35, "{}", times.len());
    assert!((times[0] - 0.1).abs() < 1e-9 && (times[times.len() - 1] - 0.5).abs() < 1e-9, "{times:?}");
    let beside = film["beside"].as_array().unwrap();
    let names: Vec<&str> = beside.iter().map(|rod| rod["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["b", "c", "d"]);
    assert_eq!(beside[1]["points"], beside[2]["points"], "Parquet and CSV hold the same positions");
    // The body has the widths of the scene at the nodes that are drawn.
    let widths = [&film["half_widths"], &beside[0]["half_widths"]].map(numbers);
    assert_eq!(widths[1], [0, 2, 4].map(|node| widths[0][node]), "widths of nodes 0, 2 and 4");
    assert!(widths[0].iter().all(|width| *width > 0.0), "{widths:?}");
    let [a, b] = ["a", "b"].map(|name| columns(at(name).join("nodes.csv")));
    let (first, second) = (positions(&film, &film["points"]), positions(&film, &beside[0]["points"]));
    for (k, time) in times.iter().enumerate() {
        let of = |table: &BTreeMap<String, Vec<f64>>, node: usize, axis: &str| {
            interpolated(&table["time_s"], &table[&format!("{axis}{node}_m")], *time)
        };
        let (first, second) = (&first[k], &second[k]);
        assert_eq!([first.len(), second.len()], [10, 6]);
        // From the head to the tip, in whichever order they were recorded.
        for (points, table, nodes) in [(first, &a, &[0, 1, 2, 3, 4][..]), (second, &b, &[0, 2, 4])] {
            for (i, node) in nodes.iter().enumerate() {
                for (j, axis) in ["x", "y"].into_iter().enumerate() {
                    let expected = of(table, *node, axis);
                    assert!((points[2 * i + j] - expected).abs() < 1e-5, "{time} {node} {axis}: {points:?} {expected}");
                }
            }
        }
    }
}

#[test]
fn every_quantity_that_two_runs_have_has_a_chart_with_a_line_for_each() {
    let folder = place();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), "a", &["record.variables=[\"curvature_1_m\"]"]);
    run(folder.path(), "b", &["record.variables=[\"curvature_1_m\"]", "actuation.kappa_amp=4"]);
    run(folder.path(), "c", &["actuation.kappa_amp=5"]);
    done(folder.path(), &["compare", "a", "b", "c", "--out", "all"]);
    let tables = ["a", "b", "c"].map(|name| columns(at(name).join("trajectory.csv")));
    let mut charts = 0;
    for name in tables[0].keys().filter(|name| *name != "time_s") {
        let own: Vec<(&str, &Vec<f64>)> =
            ["a", "b", "c"].into_iter().zip(&tables).filter_map(|(run, table)| Some((run, table.get(name)?))).collect();
        let path = at("all").join(format!("{}.svg", name.replace('[', "-").replace(']', "")));
        let value = own[0].1[0];
        if own.iter().all(|(_, values)| values.iter().all(|x| *x == value)) {
            assert!(!path.exists(), "{name} says nothing");
            continue;
        }
        let svg = std::fs::read_to_string(&path).unwrap();
        for run in ["a", "b", "c"] {
            let there = own.iter().any(|(name, _)| *name == run);
            assert_eq!(svg.contains(&format!(">{run}</text>")), there, "{name} {run}");
        }
        charts += 1;
    }
    assert!(charts > 15, "{charts}");
    // A chart that not every run has, and two that follow from the centre of mass.
    assert!(at("all/curvature_1_m-2.svg").is_file());
    for name in ["com_path.svg", "vx_com_m_s.svg", "vy_com_m_s.svg"] {
        assert!(at("all").join(name).is_file(), "{name}");
    }
    let page = std::fs::read_to_string(at("all/report.html")).unwrap();
    assert_eq!(
        page.matches("<figure>").count(),
        std::fs::read_dir(at("all"))
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().path().extension().is_some_and(|kind| kind == "svg"))
            .count()
    );
}

#[test]
fn a_film_shows_the_medium_that_all_runs_have_in_common() {
    let folder = place();
    let flow = "medium.flow_m_s=[0.2, 0.0]";
    for (name, overrides) in [("still", &[][..]), ("one", &[flow]), ("two", &[flow, "actuation.kappa_amp=4"])] {
        run(folder.path(), name, overrides);
    }
    for (runs, flows) in [(["one", "two"], true), (["one", "still"], false), (["still", "still"], false)] {
        done(folder.path(), &["compare", runs[0], runs[1], "--out", "both", "--force"]);
        let film = film(&folder.path().join("both/report.html"));
        assert_eq!(film["flow"].is_object(), flows, "{runs:?}: {}", film["flow"]);
    }
}

#[test]
fn a_table_that_changed_after_the_runs_gives_a_note_and_no_flow_to_their_film() {
    let folder = place();
    let flow = |speed: f64, frequency: f64| {
        let row = |k: i32| {
            let (time, omega) = (1e-2 * f64::from(k), std::f64::consts::TAU * frequency);
            format!("{time},{},{}\n", speed * (omega * time).sin(), speed * omega * (omega * time).cos())
        };
        let text = "time_s,value,rate\n".to_string() + &(0..=60).map(row).collect::<String>();
        std::fs::write(folder.path().join("flow.csv"), text).unwrap();
    };
    flow(0.05, 5.0);
    let scene = std::fs::read_to_string(folder.path().join("eel.toml")).unwrap();
    let scene = scene.replace("[medium]\n", "[medium]\nflow_m_s = [{ table = \"flow.csv\" }, 0.0]\n");
    std::fs::write(folder.path().join("eel.toml"), scene).unwrap();
    ["a", "b"].iter().for_each(|name| run(folder.path(), name, &[]));
    // The table of the runs, another one, that of the runs again, and none.
    for (table, notes) in [(Some((0.05, 5.0)), 0), (Some((5.0, 7.0)), 2), (Some((0.05, 5.0)), 0), (None, 2)] {
        match table {
            Some((speed, frequency)) => flow(speed, frequency),
            None => std::fs::remove_file(folder.path().join("flow.csv")).unwrap(),
        }
        let printed = done(folder.path(), &["compare", "a", "b", "--out", "both", "--force"]);
        let film = film(&folder.path().join("both/report.html"));
        assert_eq!(film["flow"].is_object(), notes == 0, "{table:?}: {}", film["flow"]);
        assert_eq!(printed.matches("a table of its scene has changed since the run").count(), notes, "{printed}");
    }
}

#[test]
fn the_page_plays_eight_rods_in_a_browser_and_fits_a_telephone() {
    let folder = place();
    let names = ["a", "b", "c", "d", "e", "f", "g", "h"];
    for (i, name) in names.iter().enumerate() {
        run(folder.path(), name, &[&format!("actuation.kappa_amp={}", 2 + i)]);
    }
    done(folder.path(), &[&["compare"], &names[..], &["--out", "all"]].concat());
    let path = folder.path().join("all/report.html");
    let source = std::fs::read_to_string(&path).unwrap();
    assert_self_contained(&source);
    let Some(browser) = chromium() else { return };
    let script = r##"<script>
        playing = false; part("time").value = 20; part("time").oninput();
        const lines = [...document.querySelectorAll("#beside polyline")];
        const seen = (line) => [getComputedStyle(line).stroke, getComputedStyle(line).strokeDasharray].join(" ");
        document.body.dataset.lines = lines.length;
        document.body.dataset.outlines = [...document.querySelectorAll("#beside polygon")].map((outline) => outline.getAttribute("points").split(" ").length).join(" ");
        document.body.dataset.nodes = lines.map((line) => line.getAttribute("points").trim().split(" ").length).join(" ");
        document.body.dataset.colours = new Set([...lines.map(seen), getComputedStyle(part("rod")).stroke]).size;
        document.body.dataset.swatches = [...document.querySelectorAll("#runs .swatch")].map((swatch) => getComputedStyle(swatch).backgroundColor).slice(0, 7).join("|");
        document.body.dataset.strokes = [part("rod"), ...lines].map((line) => getComputedStyle(line).stroke).slice(0, 7).join("|");
        document.body.dataset.meaning = [...document.querySelectorAll("#results td")].find((cell) => cell.textContent === "cycle_speed_m_s").title;
    </script></body>"##;
    let tried = folder.path().join("tried.html");
    std::fs::write(&tried, source.replace("</body>", script)).unwrap();
    let page = browse(&browser, &tried, 1000, &["--dump-dom".to_string()]);
    let body = page.split('<').find(|element| element.starts_with("body")).unwrap();
    let of_body = |name: &str| body.split(&format!("data-{name}=\"")).nth(1).unwrap().split('"').next().unwrap();
    assert_eq!(of_body("lines"), "7");
    assert_eq!(of_body("nodes"), "5 5 5 5 5 5 5");
    assert_eq!(of_body("outlines"), "10 10 10 10 10 10 10", "both sides of each body");
    assert_eq!(of_body("colours"), "8", "no two rods look the same");
    assert_eq!(of_body("swatches"), of_body("strokes"), "the legend has the colours of the rods");
    assert!(of_body("meaning").contains("velocity"), "{}", of_body("meaning"));
    assert_eq!(attribute(&page, "stage", "data-frame"), "20");
    let dark = ["--blink-settings=preferredColorScheme=0".to_string()];
    for (more, paper) in [(&[][..], "rgb(255, 255, 255)"), (&dark, "rgb(22, 27, 33)")] {
        let (width, over, found) = narrow(&browser, &path, more);
        assert!(width <= 390.0, "{width} px");
        assert_eq!((over.as_str(), found.as_str()), ("", paper));
    }
}
