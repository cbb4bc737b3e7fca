//! What results show: times are recorded once, figures and player show the motion and not what is recorded of it, studies judge what there is
//! to judge, and advice brings what it says.

use std::path::Path;
use std::process::{Command, Output};

use caudal::number_format::number;
use caudal::report::{Frame, Motion};

const EEL: &str = r#"
name = "eel"
[rod]
nodes = 9
length_m = 0.4
outer_radius_m = 0.008
youngs_modulus_pa = 1e6
density_kg_m3 = 1030.0
[actuation]
kind = "travelling-wave"
kappa_amp = 10.0
frequency_hz = 2.0
wavelength_m = 0.4
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[solver]
integrator = "newmark"
time_step_s = 5e-3
duration_s = 1.0
"#;

const ALPHA: &str = "integrator = \"generalized-alpha\"\ntime_step_s = 2e-3\nduration_s = 0.5\n";

/// A scene of `text` in a folder of its own.
fn scene(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    folder
}

fn caudal(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(folder).args(arguments).output().unwrap()
}

fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = caudal(folder, arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn times(folder: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(folder.join("trajectory.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').next().unwrap().parse().unwrap()).collect()
}

#[test]
fn every_time_is_recorded_once() {
    let folder = scene(EEL);
    for (interval, duration, step, rows) in [
        ("0.7", "2.1", "5e-3", 4),
        ("0.03", "0.9", "5e-3", 31),
        ("0.03", "0.9", "0.03", 31),
        ("0.1", "0.3", "1e-3", 4),
        ("0.1", "0.35", "1e-3", 5),
    ] {
        let set = [("interval_s", interval), ("duration_s", duration), ("time_step_s", step)];
        let set =
            set.map(|(key, value)| format!("{}.{key}={value}", if key == "interval_s" { "record" } else { "solver" }));
        let arguments: Vec<&str> = ["run", "scene.toml", "--out", "out"]
            .into_iter()
            .chain(set.iter().flat_map(|set| ["--set", set]))
            .collect();
        done(folder.path(), &arguments);
        let found = times(&folder.path().join("out"));
        assert_eq!(found.len(), rows, "{interval} to {duration}: {found:?}");
        let interval: f64 = interval.parse().unwrap();
        let full = &found[..found.len() - 1];
        assert!(full.windows(2).all(|pair| (pair[1] - pair[0] - interval).abs() < 1e-9), "{found:?}");
    }
}

/// The largest number of points of a curve in a figure.
fn points(svg: &str) -> usize {
    let curves = svg.split(['"', '\'']).filter(|part| part.matches([' ', 'L']).count() > 20 && !part.contains('<'));
    curves
        .map(|part| {
            part.split([' ', 'L', 'M']).filter(|point| point.contains(',') || point.parse::<f64>().is_ok()).count()
        })
        .max()
        .unwrap_or(0)
}

#[test]
fn what_is_recorded_does_not_thin_the_figures() {
    let adaptive = EEL.replace(
        "integrator = \"newmark\"\ntime_step_s = 5e-3\nduration_s = 1.0",
        "tolerance = 1e-2\nduration_s = 4.0",
    );
    let folder = scene(&adaptive);
    let read = |out: &str, file: &str| std::fs::read_to_string(folder.path().join(out).join(file)).unwrap();
    done(folder.path(), &["run", "scene.toml", "--out", "all"]);
    done(folder.path(), &["run", "scene.toml", "--out", "every", "--set", "record.every=1000"]);
    done(folder.path(), &["run", "scene.toml", "--out", "interval", "--set", "record.interval_s=1.9"]);
    assert!(times(&folder.path().join("interval")).len() < 5);
    for figure in ["tip_y.svg", "com_x.svg", "energy.svg"] {
        assert!(read("all", figure) == read("every", figure), "{figure}");
        assert!(read("all", figure) == read("interval", figure), "{figure}");
    }
    // Eight beats, each of which is seen.
    let seen = points(&read("every", "tip_y.svg"));
    println!("{seen} points");
    assert!(seen >= 8 * 20, "{seen}");
    // A fixed step shows all that it makes.
    let fixed = scene(EEL);
    done(fixed.path(), &["run", "scene.toml", "--out", "all"]);
    done(fixed.path(), &["run", "scene.toml", "--out", "few", "--set", "record.interval_s=0.4"]);
    let read = |out: &str| std::fs::read_to_string(fixed.path().join(out).join("tip_y.svg")).unwrap();
    assert!(read("all") == read("few"));
}

#[test]
fn a_rod_far_away_plays_as_one_nearby() {
    let frame = |time: f64, x: f64, y: f64| Frame {
        time,
        points: vec![[x, y], [x + 0.4, 0.0]],
        com: [x + 0.2, 0.0],
        body: None,
        medium: None,
    };
    let played = |x: f64| {
        let motion = serde_json::to_value(Motion::of(&[frame(0.0, x, 0.0), frame(1.0, x + 1e-3, 1e-3)])).unwrap();
        motion["points"][1].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect::<Vec<_>>()
    };
    for x in [0.0, 5000.0] {
        let found = played(x);
        let expected = [x + 1e-3, 1e-3, x + 0.401, 0.0];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-5), "{found:?}");
    }
    assert_eq!([1.25e-3, 0.01, 0.1234, 2e-5, 1.0].map(number), ["0.00125", "0.01", "0.1234", "2e-5", "1"]);
}

#[test]
fn what_stays_at_rest_is_neither_unstable_nor_without_a_reference() {
    let rod = EEL.split("[actuation]").next().unwrap();
    let folder = scene(&format!("{rod}[solver]\ntime_step_s = 1e-3\nduration_s = 0.1\n"));
    done(folder.path(), &["study", "stability", "scene.toml", "--points", "4", "--out", "out"]);
    let table = std::fs::read_to_string(folder.path().join("out/stability.csv")).unwrap();
    // Explicit steps beyond their limit do make energy, of the last rounding.
    let implicit: Vec<&str> = table.lines().skip(1).filter(|row| !row.starts_with("symplectic")).collect();
    assert!(implicit.len() > 50 && implicit.iter().all(|row| row.contains(",accurate,")), "{table}");
    // In vacuum a tail goes nowhere, and on the spot hardly anywhere.
    let wave =
        EEL.split("[medium]").next().unwrap().replace("kappa_amp = 10.0", "kappa_amp = 2.0").replace("= 1e6", "= 1e7");
    let water = "[medium]\nviscosity_pa_s = 1e-3\ndensity_kg_m3 = 1000.0\n[drag]\nlaw = \"cross-flow\"\n";
    let standing =
        wave.replace("travelling-wave", "standing-wave").replace("wavelength_m = 0.4\n", "").replace("= 1e7", "= 1e6");
    for text in [format!("{wave}[solver]\n{ALPHA}"), format!("{standing}{water}[solver]\n{ALPHA}")] {
        let folder = scene(&text);
        let said = done(
            folder.path(),
            &[
                "study",
                "accuracy",
                "scene.toml",
                "--nodes",
                "9",
                "--steps",
                "4e-3,2e-3",
                "--tolerances",
                "1e-3",
                "--out",
                "out",
            ],
        );
        assert!(!said.contains("No trajectory reference exists"), "{said}");
    }
}

#[test]
fn advice_brings_what_it_says() {
    let warnings = |text: &str, more: &[&str]| -> Vec<String> {
        let folder = scene(text);
        let arguments = [&["check", "scene.toml"], more].concat();
        let said = done(folder.path(), &arguments);
        said.lines().filter_map(|line| line.strip_prefix("warning: ")).map(str::to_string).collect()
    };
    let advised = |warning: &str, key: &str| {
        let rest = warning.split(&format!("{key} = ")).nth(1).unwrap_or_else(|| panic!("{key}: {warning}"));
        rest.split([';', ',', ' ']).next().unwrap().to_string()
    };
    // The step, for frequencies whose twentieth is rounded up and down in two digits.
    for frequency in ["0.9", "1.04", "1.1", "1.3", "3", "7"] {
        let text = EEL.replace("= 2.0\nwave", &format!("= {frequency}\nwave")).replace("5e-3", "0.2");
        let [warning] = &warnings(&text, &[])[..] else { panic!("{frequency}") };
        let step = advised(warning, "solver.time_step_s");
        assert!(warnings(&text, &["--set", &format!("solver.time_step_s={step}")]).is_empty(), "{frequency}: {step}");
    }
    // The start.
    let jump =
        format!("{}[start]\nkind = \"jump\"\n", EEL.replace("youngs_modulus_pa = 1e6", "youngs_modulus_pa = 1e9"));
    let ringing = warnings(&jump, &[]);
    let kind = advised(ringing.iter().find(|warning| warning.contains("rings")).unwrap(), "start.kind");
    assert!(
        warnings(&jump, &["--set", &format!("start.kind={kind}")]).iter().all(|warning| !warning.contains("rings"))
    );
    // The law, in water and in syrup.
    for viscosity in ["1e-3", "1e3"] {
        let stokes = EEL
            .replace("law = \"cross-flow\"", "law = \"stokes-like\"\nratio = 2.0")
            .replace("1e-3\n", &format!("{viscosity}\n"));
        let found = warnings(&stokes, &[]);
        let outside: Vec<_> =
            found.iter().filter(|warning| warning.contains("stokes-like is outside its range")).collect();
        assert_eq!(outside.len(), usize::from(viscosity == "1e-3"), "{found:?}");
        for warning in outside {
            // With the key that this law does not take.
            assert!(warning.contains("drag.law = \"cross-flow\", without drag.ratio, holds"), "{warning}");
        }
        let law = law_of(&found);
        let followed = stokes.replace("\"stokes-like\"\nratio = 2.0", &law);
        assert!(warnings(&followed, &[]).is_empty(), "{law}: {:?}", warnings(&followed, &[]));
    }
}

/// The law that the warning of `stokes-like` names.
fn law_of(warnings: &[String]) -> String {
    let warning = warnings.iter().find(|warning| warning.contains("is kept for")).unwrap();
    warning.rsplit("drag.law = ").next().unwrap().split(',').next().unwrap().to_string()
}

#[test]
fn figures_of_a_sweep_do_not_depend_on_the_order_of_levels_and_leave_out_what_failed() {
    let folder = scene(EEL);
    let swept = |levels: &str| {
        let sweep = format!(
            "name = \"eels\"\nscene = \"scene.toml\"\n[axes]\nactuation.kappa_amp = {levels}\nrod.youngs_modulus_pa = [1e6, 5e5]\n"
        );
        std::fs::write(folder.path().join("eels.toml"), sweep).unwrap();
        done(folder.path(), &["sweep", "eels.toml", "--restart"]);
        let read = |file: &str| std::fs::read_to_string(folder.path().join("out/eels").join(file)).unwrap();
        ["effects_net-displacement-m.svg", "effects_actuation-work-j.svg"].map(read)
    };
    assert!(swept("[10.0, 2.0, 6.0]") == swept("[2.0, 6.0, 10.0]"));
    // Two axes have heat maps, which name the cases that the table has as largest and least.
    let table = columns_of_text(&folder.path().join("out/eels/table.csv"));
    for quantity in ["net_displacement_m", "actuation_work_j"] {
        let map =
            std::fs::read_to_string(folder.path().join(format!("out/eels/map_{}.svg", quantity.replace('_', "-"))));
        let values: Vec<f64> = table[quantity].iter().map(|value| value.parse().unwrap()).collect();
        let by_value = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
        let [least, largest] = [(0..6).min_by(by_value).unwrap(), (0..6).max_by(by_value).unwrap()];
        let map = map.unwrap();
        for (what, case) in [("largest", largest), ("least", least)] {
            let said = map.split(&format!("{what}: ")).nth(1).unwrap().split(')').next().unwrap();
            let (value, place) = said.split_once(" (case ").unwrap();
            assert_eq!(place, case.to_string(), "{quantity}, {what}");
            let error = value.parse::<f64>().unwrap() / values[case] - 1.0;
            assert!(error.abs() < 5e-4, "four digits: {said}, {}", values[case]);
        }
        let cells = map.split("<path d=\"").skip(1).filter_map(|path| path.split('"').next());
        assert_eq!(cells.map(|path| path.matches('M').count()).sum::<usize>(), 6, "a cell a case");
    }
    let sweep = "name = \"some\"\nscene = \"scene.toml\"\n[set]\nsolver.integrator = \"symplectic-euler\"\n[axes]\n\
        solver.time_step_s = [1e-4, 2e-4, 3e-3]\nrod.youngs_modulus_pa = [1e6, 5e6]\n";
    std::fs::write(folder.path().join("some.toml"), sweep).unwrap();
    let output = caudal(folder.path(), &["sweep", "some.toml"]);
    assert_eq!(output.status.code(), Some(1));
    let table = std::fs::read_to_string(folder.path().join("out/some/table.csv")).unwrap();
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let complete = header.iter().position(|name| *name == "complete").unwrap();
    let failed: Vec<&str> = table
        .lines()
        .skip(1)
        .filter(|row| row.split(',').nth(complete) == Some("false"))
        .map(|row| row.split(',').next().unwrap())
        .collect();
    let paths = std::fs::read_to_string(folder.path().join("out/some/paths.svg")).unwrap();
    assert!(!failed.is_empty() && failed.len() < 6, "{failed:?}");
    assert!(failed.iter().all(|case| !paths.contains(&format!("case {case}<"))), "{failed:?}");
    assert!(paths.contains("least: case"));
}

/// The columns of a CSV file by their headings.
fn columns_of_text(file: &Path) -> std::collections::BTreeMap<String, Vec<String>> {
    let mut rows = csv::Reader::from_path(file).unwrap();
    let names: Vec<String> = rows.headers().unwrap().iter().map(str::to_string).collect();
    let mut columns: Vec<Vec<String>> = vec![Vec::new(); names.len()];
    for row in rows.records() {
        columns.iter_mut().zip(row.unwrap().iter()).for_each(|(column, value)| column.push(value.to_string()));
    }
    names.into_iter().zip(columns).collect()
}

/// The same of a file of numbers.
fn columns(file: &Path) -> std::collections::BTreeMap<String, Vec<f64>> {
    let numbers = |column: Vec<String>| column.iter().map(|value| value.parse().unwrap()).collect();
    columns_of_text(file).into_iter().map(|(name, column)| (name, numbers(column))).collect()
}

#[test]
fn every_column_and_every_number_of_the_summary_is_the_variable_of_its_name() {
    let folder = scene(EEL);
    done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let document = caudal::scene::Document::read(&folder.path().join("scene.toml")).unwrap();
    let mut stepper = caudal::stepper::Stepper::of(&document.scene().unwrap()).unwrap();
    let (table, positions) = (columns(&folder.path().join("out/trajectory.csv")), folder.path().join("out/nodes.csv"));
    let mut tried = 0;
    for (row, time) in table["time_s"].iter().enumerate() {
        if *time > stepper.time() {
            stepper.do_step(time - stepper.time()).unwrap();
        }
        for (name, values) in &table {
            assert_eq!(stepper.get_scalar(name).unwrap().to_bits(), values[row].to_bits(), "{name} at {time}");
            tried += 1;
        }
    }
    assert!(tried > 10 * table["time_s"].len(), "{:?}", table.keys());
    // Positions, one column a node.
    let positions = columns(&positions);
    let last = |name: &str| *positions[name].last().unwrap();
    let nodes = ["x_m", "y_m"].map(|name| stepper.get(name).unwrap());
    for (axis, values) in ["x", "y"].iter().zip(&nodes) {
        for (k, value) in values.iter().enumerate() {
            assert_eq!(last(&format!("{axis}{k}_m")).to_bits(), value.to_bits(), "{axis}{k}");
        }
    }
    let summary = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    let numbers = summary.as_object().unwrap().iter().filter_map(|(name, value)| Some((name, value.as_f64()?)));
    let same: Vec<&String> = numbers
        .filter(|(name, value)| match stepper.get_scalar(name) {
            Ok(reading) if name.as_str() != "time_step_s" => {
                assert_eq!(reading.to_bits(), value.to_bits(), "{name}");
                true
            }
            _ => false,
        })
        .map(|(name, _)| name)
        .collect();
    assert!(same.len() > 20, "{same:?}");
}

#[test]
fn the_largest_force_and_moment_on_a_held_head_are_those_of_its_rows() {
    let folder = scene(&format!("{EEL}[head]\nkind = \"clamped\"\n"));
    let said = done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let table = columns(&folder.path().join("out/trajectory.csv"));
    let most = |sizes: &mut dyn Iterator<Item = f64>| sizes.fold(0.0, f64::max);
    let [x, y] = ["head_force_x_n", "head_force_y_n"].map(|name| table[name].iter());
    let force = most(&mut x.zip(y).map(|(x, y)| x.hypot(*y)));
    let moment = most(&mut table["head_moment_n_m"].iter().map(|moment| moment.abs()));
    let summary = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    for (name, wanted) in [("max_head_force_n", force), ("max_head_moment_n_m", moment)] {
        let found = summary[name].as_f64().unwrap();
        assert!(wanted > 0.0 && (found / wanted - 1.0).abs() < 1e-14, "{name}: {found} for {wanted}");
    }
    assert!(said.contains(&format!("at most {force:.4e} N and {moment:.4e} N m")), "{said}");
}

#[test]
fn traces_are_the_paths_of_the_centres_of_mass_to_the_end() {
    let folder = scene(EEL);
    let sweep = "scene = \"scene.toml\"\n[record]\ntraces = 5\n[axes]\nactuation.kappa_amp = [2.0, 4.0]\n";
    std::fs::write(folder.path().join("sweep.toml"), sweep).unwrap();
    done(folder.path(), &["sweep", "sweep.toml", "--out", "swept"]);
    let table = columns(&folder.path().join("swept/traces.csv"));
    assert_eq!(table["case"].len(), 10);
    for (case, amplitude) in ["2.0", "4.0"].iter().enumerate() {
        let mut document = caudal::scene::Document::read(&folder.path().join("scene.toml")).unwrap();
        document.set(&format!("actuation.kappa_amp={amplitude}")).unwrap();
        let mut stepper = caudal::stepper::Stepper::of(&document.scene().unwrap()).unwrap();
        for k in 0..5 {
            let (row, time) = (5 * case + k, 0.25 * k as f64);
            if k > 0 {
                stepper.do_step(0.25).unwrap();
            }
            assert_eq!((table["case"][row], table["time_s"][row]), (case as f64, time));
            for name in ["x_com_m", "y_com_m"] {
                let (found, own) = (table[name][row], stepper.get_scalar(name).unwrap());
                assert!((found - own).abs() < 1e-12, "case {case} at {time}: {name} {found} {own}");
            }
        }
        let path = ["x_com_m", "y_com_m"].map(|name| stepper.get_scalar(name).unwrap());
        assert!((path[0] - path[1]).abs() > 1e-3, "x and y differ: {path:?}");
    }
}

#[test]
fn journals_of_a_job_that_differs_in_anything_are_refused_and_contents_of_tables_are_part_of_a_scene() {
    use caudal::jobs::Job;
    let own = Job { kept: "frames".to_string(), ..Job::new("sweep eels", b"inputs", 7) };
    assert_eq!(own.difference(&own.clone()), None);
    let json = serde_json::to_value(&own).unwrap();
    for (field, value) in json.as_object().unwrap() {
        let mut other = json.clone();
        other[field] =
            value.as_u64().map_or_else(|| format!("{}x", value.as_str().unwrap()).into(), |size| (size + 1).into());
        let other: Job = serde_json::from_value(other).unwrap();
        assert!(own.difference(&other).is_some(), "{field}");
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let held = EEL.replace("[solver]", "[head]\nkind = \"driven\"\nangle_rad = { table = \"pose.csv\" }\n[solver]");
    std::fs::write(&scene, held).unwrap();
    let fingerprint = |last: &str| {
        let table = format!("time_s,angle_rad\n0.0,0.0\n2.0,{last}\n");
        std::fs::write(folder.path().join("pose.csv"), table).unwrap();
        caudal::scene::Scene::load(&scene).unwrap().fingerprint_text()
    };
    let [first, other, again] = ["0.1", "0.2", "0.1"].map(fingerprint);
    assert!(first != other && first == again, "{first} {other} {again}");
}
