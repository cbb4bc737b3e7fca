//! What describes scenes and the command to others: FMUs, lists of variables, new scenes, help, completions, man pages and schemas are kept
//! in `tests/recorded/documents`. See `digest.rs`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::Read;
use std::process::Command;

use caudal::fmu::{Fmu, FmuOptions, Standard};
use caudal::scene::Document;
use serde_json::Value;

use crate::common::recorded::{is_as_recorded, rounded};
use crate::digest::{fingerprint, plain, root};

/// What the command prints.
fn printed(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_caudal"));
    let output = command.current_dir(root()).args(arguments).env("COLUMNS", "100").output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().replace(env!("CARGO_PKG_VERSION"), "VERSION")
}

/// The texts of an FMU of the scene without libraries, and digests of what else is in it.
fn packed(scene: &str, sets: &[&str], standard: Standard, options: FmuOptions, longer: f64) -> String {
    let mut document = Document::read(&root().join(scene)).unwrap();
    for set in sets {
        document.set(set).unwrap();
    }
    let length = document.scene().unwrap().rod.length_m.get();
    document.set(&format!("rod.length_m={:e}", length * (1.0 + longer))).unwrap();
    let fmu = Fmu::of(&document).unwrap().showing(options).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.fmu");
    fmu.write(standard, &[], &path).unwrap();
    let token = fmu.token();
    let mut archive = zip::ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
    let mut text = format!("{} of {scene}\n", fmu.identifier());
    for i in 0..archive.len() {
        let mut file = archive.by_index(i).unwrap();
        let name = file.name().unwrap().to_string();
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).unwrap();
        writeln!(text, "== {name}").unwrap();
        let content = String::from_utf8_lossy(&bytes).replace(&token, "TOKEN");
        let content = content.replace(env!("CARGO_PKG_VERSION"), "VERSION");
        if name.starts_with("resources") {
            write!(text, "{}", plain(&content)).unwrap();
        } else if !name.contains("licenses") && !name.ends_with(".png") {
            content.lines().for_each(|line| writeln!(text, "{}", rounded(line)).unwrap());
        }
    }
    text
}

/// A driven head by the newer standard, whose arrays it has.
#[test]
fn the_fmu_of_a_driven_head_is_what_it_was() {
    is_as_recorded("documents/fmu-driven-head", |longer| {
        let sets = ["rod.nodes=5", "rod.damping_time_s=0.01", "medium.flow_m_s=[0.1,0]"];
        packed("models/driven-head.toml", &sets, Standard::Fmi3, FmuOptions::default(), longer)
    });
}

/// A swimmer with a body by the older standard, which has no arrays.
#[test]
fn the_fmu_of_a_swimmer_is_what_it_was() {
    is_as_recorded("documents/fmu-fish", |longer| {
        let sets = ["rod.nodes=5", "head_body.semi_axis_along_m=0.02", "head_body.semi_axis_across_m=0.01"];
        let options = FmuOptions { nodes: Some(vec![0, 3]), ..FmuOptions::default() };
        packed("models/fish.toml", &sets, Standard::Fmi2, options, longer)
    });
}

/// A choice of variables, as scalars of the newer standard.
#[test]
fn the_plain_fmu_of_an_eel_with_muscles_is_what_it_was() {
    is_as_recorded("documents/fmu-muscle-eel", |longer| {
        let names = ["curvature_1_m", "actuation_moment_n_m", "rod.length_m", "tip_x_m", "actuation.envelope[1]"];
        let variables = Some(names.map(str::to_string).to_vec());
        let options = FmuOptions { variables, nodes: Some(vec![1, 2]), plain: true };
        packed("models/muscle-eel.toml", &["rod.nodes=5"], Standard::Fmi3, options, longer)
    });
}

#[test]
fn every_parameter_of_a_hinged_head_has_its_unit_in_an_fmu() {
    let document = Document::read(&root().join("models/servo-tail.toml")).unwrap();
    for standard in [Standard::Fmi2, Standard::Fmi3] {
        let xml = Fmu::of(&document).unwrap().description(standard).unwrap();
        for (name, kind, unit) in [
            ("head.stiffness_n_m", "RotationalStiffness", "N m/rad"),
            ("head.damping_n_m_s", "RotationalDamping", "N m s/rad"),
            ("head.inertia_kg_m2", "MomentOfInertia", "kg m^2"),
            ("cycle_rms_tracking_error_rad", "Angle", "rad"),
        ] {
            let at = xml.find(&format!("name=\"{name}\"")).unwrap_or_else(|| panic!("{name} in {standard:?}"));
            let own: String = xml[at..].chars().take(600).collect();
            assert!(own.contains(&format!("=\"{kind}\"")), "{name} in {standard:?}: {own}");
            assert!(xml.contains(&format!("<Unit name=\"{unit}\"")), "{unit}");
        }
    }
}

#[test]
fn variables_are_listed_as_they_were() {
    is_as_recorded("documents/variables", |_| {
        let scenes = ["models/driven-head.toml", "models/fish.toml", "models/muscle-eel.toml"];
        let own = scenes.map(|scene| format!("== {scene}\n{}", printed(&["variables", scene])));
        format!("{}{}", printed(&["variables"]), own.concat())
    });
}

#[test]
fn new_scenes_are_what_they_were() {
    is_as_recorded("documents/new", |_| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("made.toml");
        let mut text = String::new();
        for (kind, fluid) in ["swimmer", "held", "tail"]
            .iter()
            .flat_map(|kind| ["water", "glycerol", "oil"].iter().map(move |fluid| (*kind, *fluid)))
        {
            let arguments = ["new", path.to_str().unwrap(), "--force", "--kind", kind, "--fluid", fluid];
            let more = if fluid == "oil" { &["--length", "0.03", "--frequency", "0.7"][..] } else { &[] };
            printed(&[&arguments[..], more].concat());
            writeln!(text, "== {kind} in {fluid}").unwrap();
            let made = std::fs::read_to_string(&path).unwrap();
            // The words are the same in all fluids.
            let lines = made.lines().filter(|line| fluid == "water" || line.contains('='));
            lines.for_each(|line| writeln!(text, "{line}").unwrap());
        }
        text
    });
}

#[test]
fn help_completions_and_man_pages_are_what_they_were() {
    is_as_recorded("documents/help", |_| {
        let parts = [
            "run",
            "compare",
            "sweep",
            "design",
            "check",
            "fmu",
            "variables",
            "new",
            "export",
            "schema",
            "completions",
        ];
        let studies = ["modes", "scaling", "accuracy", "fluid", "stability"];
        let mut calls: Vec<Vec<&str>> = vec![vec![], vec!["sweep", "merge"], vec!["man"], vec!["study"]];
        calls.extend(parts.map(|part| vec![part]));
        calls.extend(studies.map(|study| vec!["study", study]));
        let mut text = String::new();
        for call in calls {
            let help = printed(&[&call[..], &["--help"]].concat());
            writeln!(text, "$ caudal {} --help\n{}", call.join(" "), help.trim_end()).unwrap();
        }
        let text: String = text.lines().map(|line| format!("{}\n", line.trim_end())).collect();
        let shells = ["bash", "elvish", "fish", "powershell", "zsh"];
        let shells = shells.map(|shell| format!("{shell}: {}", plain(&printed(&["completions", shell])))).concat();
        let folder = tempfile::tempdir().unwrap();
        printed(&["man", folder.path().to_str().unwrap()]);
        let pages = crate::digest::files(folder.path()).into_iter().map(|path| {
            let page = std::fs::read_to_string(&path).unwrap().replace(env!("CARGO_PKG_VERSION"), "VERSION");
            format!("{}: {}", path.file_name().unwrap().to_str().unwrap(), plain(&page))
        });
        format!("{text}{shells}{}", pages.collect::<String>())
    });
}

/// A line for each place of a schema: what is allowed there, and a word that stands for its description.
fn places(value: &Value, path: &str, lines: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(entries) => {
            let mut own = String::new();
            for (key, value) in entries {
                match value {
                    Value::Object(_) => places(value, &format!("{path}/{key}"), lines),
                    Value::Array(items) if items.iter().any(Value::is_object) => {
                        items.iter().enumerate().for_each(|(i, item)| places(item, &format!("{path}/{key}{i}"), lines));
                    }
                    Value::String(text) if key == "description" => write!(own, " {}", fingerprint(text)).unwrap(),
                    other => write!(own, " {key}={other}").unwrap(),
                }
            }
            lines.insert(path.to_string(), own);
        }
        other => {
            lines.insert(path.to_string(), other.to_string());
        }
    }
}

#[test]
fn schemas_are_what_they_were() {
    is_as_recorded("documents/schema", |_| {
        let mut text = String::new();
        for arguments in [&["schema"][..], &["schema", "--sweep"]] {
            let mut lines = BTreeMap::new();
            places(&serde_json::from_str(&printed(arguments)).unwrap(), "", &mut lines);
            writeln!(text, "== {}", arguments.join(" ")).unwrap();
            let short = |path: &str| path.replace("/properties/", "/").replace("/$defs/", "/");
            lines.iter().for_each(|(path, own)| writeln!(text, "{}:{own}", short(path)).unwrap());
        }
        text
    });
}

/// A table of many cases, which is kept as Parquet too.
#[cfg(feature = "parquet")]
#[test]
fn a_table_of_many_cases_is_the_same_as_parquet() {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("many.toml");
    let scene = root().join("models/beck-column.toml");
    let text = format!(
        "scene = {scene:?}\nset.rod.nodes = 3\nset.solver.duration_s = 0.02\nset.solver.time_step_s = 0.01\nrecord.played = 0\n[axes]\n\
         rod.damping_time_s = {{ from = 0.0, to = 1.0, count = 1100 }}\n"
    );
    std::fs::write(&path, text).unwrap();
    let out = folder.path().join("out");
    printed(&["sweep", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let file = std::fs::File::open(out.join("table.parquet")).unwrap();
    let reader = SerializedFileReader::new(file).unwrap();
    let mut csv = csv::Reader::from_path(out.join("table.csv")).unwrap();
    let names: Vec<String> = csv.headers().unwrap().iter().map(str::to_string).collect();
    let mut rows = 0;
    for (row, record) in reader.get_row_iter(None).unwrap().zip(csv.records()) {
        let (row, record) = (row.unwrap(), record.unwrap());
        rows += 1;
        for ((name, cell), (own, text)) in row.get_column_iter().zip(names.iter().zip(&record)) {
            assert_eq!(name, own);
            let same = match cell {
                parquet::record::Field::Null => text.is_empty(),
                parquet::record::Field::Double(x) => text.parse() == Ok(*x),
                parquet::record::Field::Bool(truth) => text == truth.to_string(),
                parquet::record::Field::Str(own) => own == text,
                _ => false,
            };
            assert!(same, "row {rows}, {name}: {cell:?} and {text:?}");
        }
    }
    assert_eq!(rows, 1100);
}
