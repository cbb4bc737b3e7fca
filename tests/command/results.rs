//! What results show: times are recorded once, figures and player show the motion and not what is recorded of it, studies judge what there is
//! to judge, and advice brings what it says.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::path::Path;
use std::process::{Command, Output};

use caudal::number_format::number;
use caudal::report::{Animation, DrawnRod, Frame, RodMotion};

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
    for figure in ["tip_y.svg", "speed.svg", "energy.svg"] {
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
        medium: None,
        loads: None,
    };
    let played = |x: f64| {
        let frames = vec![frame(0.0, x, 0.0), frame(1.0, x + 1e-3, 1e-3)];
        let motion = RodMotion::whole(DrawnRod::at(None, vec![0, 1]), frames);
        let motion = serde_json::to_value(Animation::of(&motion)).unwrap();
        let bytes = STANDARD.decode(motion["points"].as_str().unwrap()).unwrap();
        let points: Vec<f64> =
            bytes.as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect();
        let com = |axis: usize| motion["com"][1][axis].as_f64().unwrap();
        points[4..].iter().enumerate().map(|(i, offset)| com(i % 2) + offset).collect::<Vec<_>>()
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
    assert!(implicit.len() > 50 && implicit.iter().all(|row| row.contains(",does not move,")), "{table}");
    // Nor does rounding make its balance open.
    let tiny = "[rod]\nnodes = 9\nlength_m = 1e-6\nouter_radius_m = 1e-8\nyoungs_modulus_pa = 1e6\ndensity_kg_m3 = 1000.0\n\
                [medium]\nviscosity_pa_s = 1e-3\ndensity_kg_m3 = 1000.0\n[drag]\nlaw = \"cox\"\n\
                [solver]\ntime_step_s = 0.1\nduration_s = 0.3\n";
    let folder = scene(tiny);
    done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let page = std::fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(!page.contains("the energy balance does not close"), "{page}");
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
    let kind = advised(ringing.iter().find(|warning| warning.contains("excites vibrations")).unwrap(), "start.kind");
    assert!(
        warnings(&jump, &["--set", &format!("start.kind={kind}")])
            .iter()
            .all(|warning| !warning.contains("excites vibrations"))
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
            assert!(warning.contains("drag.law = \"cross-flow\", without drag.ratio, is valid"), "{warning}");
        }
        let law = law_of(&found);
        let followed = stokes.replace("\"stokes-like\"\nratio = 2.0", &law);
        assert!(warnings(&followed, &[]).is_empty(), "{law}: {:?}", warnings(&followed, &[]));
    }
}

/// The law that the warning of `stokes-like` names.
fn law_of(warnings: &[String]) -> String {
    let warning = warnings.iter().find(|warning| warning.contains("is intended for")).unwrap();
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
        let by_size = |a: &usize, b: &usize| values[*a].abs().total_cmp(&values[*b].abs());
        let [least, largest] = [(0..6).min_by(by_size).unwrap(), (0..6).max_by(by_size).unwrap()];
        let in_size = if values[largest] < 0.0 { " in size" } else { "" };
        let map = map.unwrap();
        for (what, case) in [("largest", largest), ("least", least)] {
            let said = map.split(&format!("{what}{in_size}: ")).nth(1).unwrap().split(')').next().unwrap();
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
    assert!(paths.contains("least far: case"));
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
fn the_variables_that_a_scene_asks_for_are_columns_of_its_trajectory() {
    let folder = scene(EEL);
    done(folder.path(), &["run", "scene.toml", "--out", "plain"]);
    let asked = "record.variables=[\"joint_moment_n_m\", \"x_com_m\", \"force_y_n\", \"tip_y_m\"]";
    done(folder.path(), &["run", "scene.toml", "--out", "more", "--set", asked]);
    let header = |folder: &Path| {
        let text = std::fs::read_to_string(folder.join("trajectory.csv")).unwrap();
        text.lines().next().unwrap().split(',').map(str::to_string).collect::<Vec<_>>()
    };
    let [plain, more] = ["plain", "more"].map(|name| header(&folder.path().join(name)));
    // One column for each joint, at nodes 1 to 7, and for each node; x_com_m is there already.
    let moments = (1..8).map(|k| format!("joint_moment_n_m[{k}]"));
    let forces = (0..9).map(|k| format!("force_y_n[{k}]"));
    let wanted = plain.iter().cloned().chain(moments).chain(forces).chain(["tip_y_m".to_string()]).collect::<Vec<_>>();
    assert!(plain.contains(&"x_com_m".to_string()) && !plain.contains(&"tip_y_m".to_string()), "{plain:?}");
    assert_eq!(more, wanted);
    // They are what a host reads.
    let mut stepper =
        caudal::stepper::Stepper::of(&caudal::scene::Scene::load(folder.path().join("scene.toml")).unwrap()).unwrap();
    while stepper.time() < 1.0 - 1e-9 {
        stepper.do_step(5e-3).unwrap();
    }
    let table = columns(&folder.path().join("more/trajectory.csv"));
    for (k, moment) in stepper.get("joint_moment_n_m").unwrap().into_iter().enumerate() {
        let found = *table[&format!("joint_moment_n_m[{}]", k + 1)].last().unwrap();
        assert!(moment != 0.0 && (found - moment).abs() <= 1e-9 * moment.abs(), "{k}: {found} for {moment}");
    }
    // One that the scene does not have is refused before anything is written, and by `check`.
    for command in ["run", "check"] {
        let refused = caudal(folder.path(), &[command, "scene.toml", "--set", "record.variables=[\"tip_z_m\"]"]);
        let said = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(2), "{command}: {said}");
        assert!(said.contains("record.variables: ") && said.contains("did you mean `tip_"), "{command}: {said}");
    }
    assert!(!folder.path().join("out").exists());
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
    assert!(said.contains(&format!("held head {force:.4e} N, {moment:.4e} N m\n")), "{said}");
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

/// A tail in water with all that a summary tells of, free or with a held head; drag is linear, so that towing is a product.
fn told_of(head: &str) -> String {
    let solver = "integrator = \"generalized-alpha\"\ntime_step_s = 5e-3\nduration_s = 2.0";
    EEL.replace("law = \"cross-flow\"", "law = \"coefficients\"\nalong_n_s_m2 = 0.2\nacross_n_s_m2 = 1.5\n[reactive]")
        .replace("[medium]\n", "[loads]\ngravity_m_s2 = [0.1, -0.2]\n[medium]\nflow_m_s = [0.05, 0.02]\n")
        .replace("integrator = \"newmark\"\ntime_step_s = 5e-3\nduration_s = 1.0", solver)
        + head
}

/// The mean of a column of equidistant rows.
fn mean(column: &[f64]) -> f64 {
    column.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum::<f64>() / (column.len() - 1) as f64
}

/// What each of four cycles is by the means over the first, two, three and all of them.
fn each_of(means: &[std::collections::BTreeMap<&str, f64>], name: &str) -> Option<[f64; 4]> {
    let sum = |count: usize| Some(count as f64 * if count > 0 { *means[count - 1].get(name)? } else { 0.0 });
    let each: Option<Vec<f64>> = (0..4).map(|k| Some(sum(k + 1)? - sum(k)?)).collect();
    each?.try_into().ok()
}

#[test]
fn every_number_of_the_summary_is_had_a_second_way() {
    const DRIVEN: &str = "[head]\nkind = \"driven\"\nposition_m = [0.0, { amplitude = 0.02, frequency_hz = 2.0 }]\n\
        angle_rad = { amplitude = 0.2, frequency_hz = 2.0 }\n";
    for head in ["", DRIVEN] {
        let folder = scene(&told_of(head));
        done(folder.path(), &["run", "scene.toml", "--out", "out"]);
        let out = folder.path().join("out");
        let (table, nodes) = (columns(&out.join("trajectory.csv")), columns(&out.join("nodes.csv")));
        let summary: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
        let mut stepper =
            caudal::stepper::Stepper::of(&caudal::scene::Scene::load(folder.path().join("scene.toml")).unwrap())
                .unwrap();
        // The means over one, two, three and four cycles tell what each cycle is.
        let (mut means, mut largest_of) = (Vec::new(), [f64::NEG_INFINITY; 3]);
        for (row, time) in table["time_s"].iter().enumerate() {
            if row > 0 {
                stepper.do_step(time - stepper.time()).unwrap();
            }
            let couple = stepper.get("joint_moment_n_m").unwrap().iter().fold(0.0_f64, |most, own| most.max(own.abs()));
            let head = stepper.get_scalar("head_power_w").unwrap_or(0.0);
            let now = [couple, stepper.get_scalar("actuation_power_w").unwrap(), head];
            largest_of.iter_mut().zip(now).for_each(|(most, now)| *most = most.max(now));
            if row > 0 && row % 100 == 0 {
                let all = caudal::variable::VARIABLES.iter().filter(|variable| variable.name.starts_with("cycle_"));
                means.push(
                    all.filter_map(|v| Some((v.name, stepper.get_scalar(v.name).ok()?)))
                        .collect::<std::collections::BTreeMap<_, _>>(),
                );
            }
        }
        let value = |name: &str| stepper.get_scalar(name).ok();
        let edges = |row: usize| -> Vec<[f64; 2]> {
            let at = |axis: &str, k: usize| nodes[&format!("{axis}{k}_m")][row];
            (1..9).map(|k| ["x", "y"].map(|axis| at(axis, k) - at(axis, k - 1))).collect()
        };
        let largest = |of: &dyn Fn(&[f64; 2], &[f64; 2]) -> f64| {
            let pairs = (0..=400).flat_map(|row: usize| edges(row.saturating_sub(1)).into_iter().zip(edges(row)));
            pairs.map(|(old, new)| of(&old, &new).abs()).fold(0.0, f64::max)
        };
        let path = |[x, y]: [&Vec<f64>; 2]| -> f64 {
            x.windows(2).zip(y.windows(2)).map(|(x, y)| (x[1] - x[0]).hypot(y[1] - y[0])).sum()
        };
        let com = [&table["x_com_m"], &table["y_com_m"]];
        // The length of the displacement through the fluid, which flows.
        let through = [(0.05, com[0]), (0.02, com[1])].map(|(flow, x)| x[400] - x[0] - flow * 2.0);
        let moved = through[0].hypot(through[1]);
        let mass = 1030.0 * std::f64::consts::PI * 0.008 * 0.008 * 0.4;
        let work = |name: &str| *table[&format!("{name}_work_j")].last().unwrap();
        let most = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        let each = |name: &str| -> Option<[f64; 4]> {
            if name == "cycle_efficiency" && !head.is_empty() {
                let [thrust, given, held] = ["thrust_n", "actuation_power_w", "head_power_w"]
                    .map(|of| each_of(&means, &format!("cycle_{of}")).unwrap());
                return Some(std::array::from_fn(|k| thrust[k] * 0.05 / (given[k] + held[k])));
            }
            each_of(&means, name)
        };
        // A second way of the number with this name, and its tolerance.
        let second = |name: &str| -> Option<(f64, f64)> {
            if let Some(value) = value(name).filter(|_| name != "time_step_s") {
                return Some((value, 0.0));
            }
            if name == "mean_material_power_w" {
                return Some((0.0, 0.0)); // no material is damped here
            }
            if let Some(of) = name.strip_prefix("mean_").and_then(|rest| rest.strip_suffix("_power_w")) {
                let none = ["spray", "other"].contains(&of);
                return Some((if none { 0.0 } else { work(of) / 2.0 }, 1e-14));
            }
            if let Some(of) = name.strip_prefix("mean_").filter(|rest| rest.ends_with("_energy_j")) {
                return Some((mean(&table[of]), 1e-12));
            }
            if let Some((of, axis)) = name.rsplit_once('.') {
                let axis = usize::from(axis == "1");
                if ["spray_impulse_n_s", "other_impulse_n_s"].contains(&of) {
                    return Some((0.0, 0.0)); // neither is here
                }
                if let Some(of) = of.strip_suffix("_n_s") {
                    return Some((value(&format!("{of}_{}_n_s", ["x", "y"][axis])).unwrap(), 0.0));
                }
                let force = format!("head_force_{}_n", ["x", "y"][axis]);
                // Measured: 5e-5 off the trapezoidal rule.
                return Some(match of {
                    "head_force_n" => (value(&force).unwrap(), 0.0),
                    _ => (mean(&table[&force]), 1e-3),
                });
            }
            if name.starts_with("cycle_") {
                let of = each(&name.replace("_spread", ""))?;
                let middle = of.iter().sum::<f64>() / 4.0;
                let squares: f64 = of.iter().map(|x| (x - middle).powi(2)).sum();
                return Some((if name.contains("_spread") { (squares / 3.0).sqrt() } else { middle }, 1e-9));
            }
            Some(match name {
                "end_time_s" | "cycles_until_s" => (2.0, 1e-15),
                "cycles_from_s" => (0.0, 1e-12),
                "nodes" => (9.0, 0.0),
                "time_step_s" => (5e-3, 0.0),
                "steps" => (400.0, 0.0),
                "rejected_steps" | "step_halvings" | "linear_fallbacks" | "newton_floor_stops" => (0.0, 0.0),
                // Every iteration here has a matrix of its own.
                "factorisations" => (value("newton_iterations").unwrap(), 0.0),
                "spray_work_j" | "other_work_j" | "material_work_j" => (0.0, 0.0),
                "max_strain" => (largest(&|_, new| new[0].hypot(new[1]) / 0.05 - 1.0), 1e-9),
                "max_rotation_per_step_rad" => (
                    largest(&|old, new| (old[0] * new[1] - old[1] * new[0]).atan2(old[0] * new[0] + old[1] * new[1])),
                    1e-9,
                ),
                "com_path_m" => (path(com), 1e-12),
                "initial_energy_j" => {
                    let parts = ["stretching", "bending", "kinetic", "fluid"];
                    (parts.iter().map(|part| table[&format!("{part}_energy_j")][0]).sum(), 1e-12)
                }
                "cost_of_transport" if head.is_empty() => (work("actuation") / (mass * 9.80665 * moved), 1e-12),
                "efficiency" if head.is_empty() => {
                    let speed = moved / 2.0;
                    (0.2 * 0.4 * speed * speed * 2.0 / work("actuation"), 1e-12)
                }
                // The thrust along the mean axis, −x, against the stream in x.
                "efficiency" => {
                    (-mean(&table["head_force_x_n"]) * 0.05 * 2.0 / (work("actuation") + work("head")), 1e-3)
                }
                "mean_thrust_n" => (-mean(&table["head_force_x_n"]), 1e-3),
                "mean_head_moment_n_m" => (mean(&table["head_moment_n_m"]), 1e-3),
                "max_head_force_n" => {
                    (most(&mut (0..=400).map(|i| table["head_force_x_n"][i].hypot(table["head_force_y_n"][i]))), 1e-14)
                }
                "max_joint_moment_n_m" => (largest_of[0], 0.0),
                "max_actuation_power_w" => (largest_of[1], 0.0),
                "max_head_power_w" => (largest_of[2], 0.0),
                "max_head_moment_n_m" => (most(&mut table["head_moment_n_m"].iter().map(|m| m.abs())), 1e-14),
                _ => return None,
            })
        };
        let mut tried = 0;
        for (name, found) in summary.as_object().unwrap().iter().filter(|(name, _)| *name != "wall_s") {
            let numbers: Vec<(String, f64)> = match found {
                serde_json::Value::Number(number) => vec![(name.clone(), number.as_f64().unwrap())],
                serde_json::Value::Array(items) => {
                    let numbers = items.iter().enumerate().filter_map(|(i, item)| Some((i, item.as_f64()?)));
                    numbers.map(|(i, number)| (format!("{name}.{i}"), number)).collect()
                }
                _ => Vec::new(),
            };
            for (name, found) in numbers {
                let (wanted, tolerance) = second(&name).unwrap_or_else(|| panic!("{name} has no second way"));
                let scale = wanted.abs().max(1e-7);
                assert!((found - wanted).abs() <= tolerance * scale, "{name}: {found}, a second way {wanted}");
                tried += 1;
            }
        }
        assert!(tried > 80, "{tried}");
        for (k, place) in summary["final_positions_m"].as_array().unwrap().iter().enumerate() {
            for (axis, found) in ["x", "y"].iter().zip(place.as_array().unwrap()) {
                assert_eq!(found.as_f64(), nodes[&format!("{axis}{k}_m")].last().copied(), "{axis}{k}");
            }
        }
    }
}

/// A free rod in nothing that a jet pushes along: what the summary says of impulses is all of its momentum, and no efficiency is claimed.
#[test]
fn impulses_of_the_summary_add_up_to_the_momentum_of_a_rod_with_a_jet() {
    let jet = "[[loads.point]]\nnode = -1\nfollows = true\nforce_n = [-0.1, 0.02]\n";
    let folder = scene(&EEL.replace("[solver]", &format!("{jet}[solver]")));
    done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let text = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    let vector = |name: &str| [0, 1].map(|axis| summary[name][axis].as_f64().unwrap());
    for axis in 0..2 {
        let momentum = vector("rod_momentum_n_s")[axis] + vector("fluid_momentum_n_s")[axis];
        let all = ["drag", "wake", "flow", "load", "head", "spray", "other"];
        let given: f64 = all.iter().map(|of| vector(&format!("{of}_impulse_n_s"))[axis]).sum();
        let size = vector("other_impulse_n_s")[0].abs();
        // What the first momentum is, and what the method leaves.
        let left = momentum - given - vector("momentum_defect_n_s")[axis];
        assert!(left.abs() < 1e-3 * size && size > 0.01, "{axis}: {momentum} {given}");
    }
    for name in ["efficiency", "cost_of_transport"] {
        assert!(summary[name].is_null(), "{name}: {}", summary[name]);
    }
    assert!(summary["other_work_j"].as_f64().unwrap() > 0.0);
}

/// The balances that a result rests on, where they do not close: of momentum, if Newton's method ends too early for a stiff edge; of energy,
/// if a method loses a twelfth of what the drive does.
#[test]
fn a_balance_that_does_not_close_is_noted() {
    let strip = r#"
name = "strip"
[rod]
nodes = 33
length_m = 0.2
bending_stiffness_n_m2 = 4.2e-5
mass_per_length_kg_m = 0.096
axial_stiffness_n = 1.2e5
section = "rectangle"
outer_radius_m = 0.0015
depth_m = 0.03
[head]
kind = "driven"
angle_rad = { amplitude = 0.2, frequency_hz = 1.0 }
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[reactive]
[solver]
duration_s = 3.0
"#;
    let smooth = include_str!("../../models/baseline-smooth.toml");
    let damped = "rod.loss_factor=0.1";
    for (text, changes, noted) in [
        (strip, &[][..], [false; 2]),
        // At rest there is nothing but rounding.
        (strip, &["head.angle_rad=0.3"][..], [false; 2]),
        (strip, &["head.angle_rad=0.3", "head.position_m=[1.0, 2.0]", "solver.time_step_s=0.01"][..], [false; 2]),
        (strip, &["solver.newton_tolerance=1e-4"][..], [true, false]),
        (smooth, &[damped][..], [false, true]),
        (smooth, &[damped, "solver.time_step_s=1e-4"][..], [false; 2]),
    ] {
        let folder = scene(text);
        let sets: Vec<&str> = changes.iter().flat_map(|change| ["--set", change]).collect();
        let said = done(folder.path(), &[&["run", "scene.toml", "--out", "out", "--force"], &sets[..]].concat());
        let found = ["the momentum balance along x does not close", "the energy balance does not close"]
            .map(|note| said.contains(note));
        let summary = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        println!(
            "{changes:?}: {} J, {} N s\n{said}",
            summary["numerical_dissipation_j"], summary["momentum_defect_n_s"]
        );
        assert_eq!(found, noted, "{changes:?}: {said}");
    }
}

/// Numbers and words of a run of `models/eel.toml`.
fn eel(overrides: &[String]) -> (serde_json::Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/models/eel.toml");
    let sets = overrides.iter().flat_map(|set| ["--set", set]);
    let said = done(folder.path(), &["run", scene, "--out", "out"].into_iter().chain(sets).collect::<Vec<_>>());
    let summary = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    (serde_json::from_str(&summary).unwrap(), said)
}

/// `models/eel.toml` with `changes` after `duration` (s), and the displacement (m) of its centre of mass over ground.
fn displaced(changes: &[String], duration: f64) -> (caudal::stepper::Stepper, [f64; 2]) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/eel.toml");
    let mut document = caudal::scene::Document::read(&path).unwrap();
    changes.iter().for_each(|change| document.set(change).unwrap());
    let mut stepper = caudal::stepper::Stepper::of(&document.scene().unwrap()).unwrap();
    let place = |of: &mut caudal::stepper::Stepper| ["x_com_m", "y_com_m"].map(|name| of.get_scalar(name).unwrap());
    let from = place(&mut stepper);
    stepper.do_step(duration).unwrap();
    let to = place(&mut stepper);
    (stepper, [to[0] - from[0], to[1] - from[1]])
}

#[test]
fn cost_of_transport_and_efficiency_of_the_whole_run_are_relative_to_the_flow_and_along_the_path() {
    // A beat that is not symmetric turns the path.
    for more in [None, Some("actuation.harmonics=[0.4]")] {
        for [u, v] in [[0.0, 0.0], [0.5, 0.0], [-0.2, 0.3]] {
            let changes = ["rod.nodes=9".into(), "solver.duration_s=4.0".into(), format!("medium.flow_m_s=[{u}, {v}]")];
            let changes: Vec<String> = changes.into_iter().chain(more.map(str::to_string)).collect();
            let (stepper, [x, y]) = displaced(&changes, 4.0);
            let speed = (x / 4.0 - u).hypot(y / 4.0 - v);
            let (summary, _) = eel(&changes);
            let number = |name: &str| summary[name].as_f64().unwrap();
            let power = number("mean_actuation_power_w");
            let weight = stepper.model().rod.total_mass() * 9.80665;
            let towing = stepper.view().dynamics.towing_force(speed).unwrap();
            for (name, expected) in
                [("cost_of_transport", power / (weight * speed)), ("efficiency", towing * speed / power)]
            {
                let part = number(name) / expected - 1.0;
                assert!(part.abs() < 1e-12, "{name} {changes:?}: {part:e}"); // measured: 1.5e-14
            }
        }
    }
}

#[test]
fn a_balance_is_said_to_be_open_from_a_twentieth_of_the_work_on() {
    for (step, open) in [(2.25e-3, false), (2.31e-3, true)] {
        let (summary, said) = eel(&[
            "rod.nodes=5".into(),
            "solver.duration_s=1.0".into(),
            "solver.integrator=implicit-euler".into(),
            format!("solver.time_step_s={step}"),
        ]);
        let number = |name: &str| summary[name].as_f64().unwrap();
        let part = number("numerical_dissipation_j") / number("actuation_work_j");
        assert!((part / 0.05 - 1.0).abs() < 0.02 && (part > 0.05) == open, "{part}");
        assert_eq!(said.contains("the energy balance does not close"), open, "{part}: {said}");
    }
}

#[test]
fn what_moves_less_than_a_billionth_of_its_length_does_not_swim() {
    let changes = |amplitude: f64| {
        ["rod.nodes=5".to_string(), "solver.duration_s=0.5".into(), format!("actuation.kappa_amp={amplitude:e}")]
    };
    let moved = |amplitude: f64| {
        let (_, [x, y]) = displaced(&changes(amplitude), 0.5);
        x.hypot(y) / 0.4
    };
    // So small a beat moves it sideways, in proportion to its amplitude.
    let unit = moved(1e-6) / 1e-6;
    for (part, swims) in [(0.98_f64, false), (1.02, true)] {
        let amplitude = part * 1e-9 / unit;
        let (summary, _) = eel(&changes(amplitude));
        let moved = moved(amplitude);
        assert!((moved / 1e-9 - part).abs() < 5e-3, "{moved}");
        assert_eq!(summary["efficiency"].is_number(), swims, "{}", summary["efficiency"]);
    }
}

#[test]
fn what_gets_nowhere_in_its_cycles_has_no_cost_of_transport_from_its_start() {
    // The whole rod bends at once, so that no wave travels; its shaped start throws it aside.
    let text = "name = \"standing\"\n[rod]\nnodes = 33\nlength_m = 0.3\nouter_radius_m = 0.004\nyoungs_modulus_pa = 2e6\n\
                density_kg_m3 = 1100.0\n[actuation]\nkind = \"travelling-wave\"\nkappa_amp = 5.0\nfrequency_hz = 1.0\n\
                wavelength_m = 1e9\n[start]\nkind = \"shaped\"\n[medium]\nviscosity_pa_s = 1.0\ndensity_kg_m3 = 1260.0\n\
                [drag]\nlaw = \"stokes-like\"\nratio = 2.0\n[solver]\nintegrator = \"newmark\"\ntime_step_s = 2e-3\nduration_s = 6.0\n";
    let folder = scene(text);
    done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let summary = std::fs::read_to_string(folder.path().join("out/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert!(summary["net_displacement_m"].as_array().is_none_or(|by| by.iter().any(|x| x.as_f64() != Some(0.0))));
    for name in ["cost_of_transport", "efficiency"] {
        let [cycle, whole] = [format!("cycle_{name}"), name.to_string()].map(|name| summary[name].clone());
        assert!(cycle.is_null() && whole.is_null(), "{name}: {cycle}, {whole}");
    }
}

#[test]
fn a_page_lists_every_number_of_the_summary_once_with_its_unit_and_nothing_that_is_not_there() {
    let folder = scene(EEL);
    done(folder.path(), &["run", "scene.toml", "--out", "out"]);
    let read = |file: &str| std::fs::read_to_string(folder.path().join("out").join(file)).unwrap();
    let (page, summary) = (read("report.html"), read("summary.json"));
    let summary: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&summary).unwrap();
    let table = page.split("<table id=\"numbers\">").nth(1).unwrap().split("</table>").next().unwrap();
    let row = |key: &str| {
        let mut rows = table.split("<tr>").filter(|row| row.contains(&format!(">{key}</td><td")));
        (rows.next().map(str::to_string), rows.count())
    };
    let (mut listed, mut left_out) = (0, Vec::new());
    for (key, value) in &summary {
        let (found, again) = row(key);
        assert_eq!(again, 0, "{key}");
        match found {
            Some(found) => {
                assert!(!value.is_null() && !found.contains("null"), "{found}");
                listed += 1;
            }
            None => left_out.push((key.as_str(), value.clone())),
        }
    }
    assert_eq!(table.matches("</td></tr>").count(), listed);
    let zero = |value: &serde_json::Value| match value.as_array() {
        Some(values) => values.iter().all(|x| x.as_f64() == Some(0.0)),
        None => value.as_f64() == Some(0.0),
    };
    for (key, value) in left_out {
        let elsewhere = ["notes", "final_positions_m"].contains(&key) || key.contains("_spread");
        assert!(elsewhere || value.is_null() || zero(&value), "{key}: {value}");
    }
    let speed = summary["cycle_speed_m_s"].as_f64().unwrap();
    let found = row("cycle_speed_m_s").0.unwrap();
    let shown = found.rsplit_once("\">").unwrap().1;
    assert!(shown.contains(" ± ") && shown.contains("\u{a0}m&#x2f;s<"), "{found}");
    let shown: f64 = shown.split(' ').next().unwrap().parse().unwrap();
    assert!((shown / speed - 1.0).abs() < 1e-5, "{found}");
}
