//! Figures, pages and exports: a digest of each file that small runs, sweeps, studies and designs leave, as `digest.rs` makes it, is kept in
//! `tests/recorded/figures`. What is meant to change is recorded anew, and its diff read:
//!
//!     CAUDAL_WRITE_RECORDED=1 cargo test --test command figures

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use crate::common::recorded::is_as_recorded;
use crate::digest::{file, files, root};

/// Runs the command in the project's folder and expects that it ends well, or with a search or cases that failed and are kept.
fn caudal(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(root()).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let kept =
        ["the search did not converge", "their rows in table.csv give the reasons", "its row in table.csv says why"];
    assert!(output.status.success() || kept.iter().any(|words| said.contains(words)), "{arguments:?}: {said}");
}

/// Runs the command on a rod of this length (m), made `longer` by a part of it, with its results in `out`.
fn run(arguments: &[&str], length: f64, longer: f64, out: &Path) {
    let length = format!("rod.length_m={:e}", length * (1.0 + longer));
    caudal(&[arguments, &["--set", &length, "--out", out.to_str().unwrap()]].concat());
}

/// Digests of the files in a folder, without those that `left_out` names by a part of their names.
fn digests(folder: &Path, left_out: &[&str]) -> String {
    let mut text = String::new();
    for path in files(folder) {
        let name = path.strip_prefix(folder).unwrap().to_str().unwrap();
        if !["manifest.json", "journal"].iter().chain(left_out).any(|part| name.contains(part)) {
            write!(text, "== {name}\n{}\n", file(&path)).unwrap();
        }
    }
    text
}

/// Compares what a command leaves with what it left.
fn left(name: &str, arguments: &[&str], length: f64, left_out: &[&str]) {
    is_as_recorded(&format!("figures/{name}"), |longer| {
        let folder = tempfile::tempdir().unwrap();
        run(arguments, length, longer, &folder.path().join("out"));
        digests(&folder.path().join("out"), left_out)
    });
}

/// What `recorded.rs` compares number by number.
const OF_RUN: &[&str] = &["nodes.csv", "trajectory.csv", "summary.json"];

#[test]
fn a_fish_with_a_ball_in_a_stream_beside_a_wall_leaves_the_pages_it_left() {
    let arguments = [
        "run",
        "models/fish.toml",
        "--set",
        "rod.nodes=9",
        "--set",
        "solver.duration_s=1.5",
        "--set",
        "record.interval_s=0.1",
        "--set",
        "medium.flow_m_s=[0.05,0.01]",
        "--set",
        "head_body.semi_axis_along_m=0.02",
        "--set",
        "head_body.semi_axis_across_m=0.01",
        "--set",
        "drag.viscous=wall",
        "--set",
        "drag.height_m=0.2",
    ];
    left("run-fish", &arguments, 0.3, OF_RUN);
}

#[test]
fn a_tail_that_dips_through_layers_leaves_the_pages_it_left() {
    let arguments = [
        "run",
        "models/dipping-tail.toml",
        "--set",
        "rod.nodes=9",
        "--set",
        "solver.duration_s=2.0",
        "--set",
        "record.interval_s=0.05",
    ];
    left("run-dipping-tail", &arguments, 0.3, OF_RUN);
}

#[test]
fn a_driven_head_in_a_cheaper_model_beside_the_whole_one_leaves_the_pages_it_left() {
    let arguments = [
        "run",
        "models/driven-head.toml",
        "--set",
        "rod.nodes=9",
        "--set",
        "solver.duration_s=2.0",
        "--set",
        "record.interval_s=0.05",
        "--set",
        "solver.model=overdamped",
        "--verify",
    ];
    left("run-driven-head", &arguments, 0.3, OF_RUN);
}

#[test]
fn an_eel_with_muscles_leaves_the_pages_it_left() {
    let arguments = [
        "run",
        "models/muscle-eel.toml",
        "--set",
        "rod.nodes=9",
        "--set",
        "solver.duration_s=1.0",
        "--set",
        "record.interval_s=0.05",
        "--set",
        "rod.loss_factor=0.2",
    ];
    left("run-muscle-eel", &arguments, 0.4, OF_RUN);
}

#[test]
fn a_study_of_modes_leaves_the_pages_it_left() {
    let arguments = ["study", "modes", "models/silicone-tail.toml", "--count", "4", "--set", "rod.nodes=9"];
    left("study-modes", &arguments, 0.12, &[]);
}

#[test]
fn a_study_of_rest_in_a_flow_leaves_the_pages_it_left() {
    let arguments =
        ["study", "stability", "models/flag.toml", "--vary", "flow", "--points", "3", "--set", "rod.nodes=9"];
    left("study-flow", &arguments, 0.4, &[]);
}

#[test]
fn a_study_of_rest_under_loads_leaves_the_pages_it_left() {
    let arguments = [
        "study",
        "stability",
        "models/beck-column.toml",
        "--vary",
        "load",
        "--points",
        "4",
        "--set",
        "rod.nodes=9",
        "--set",
        "rod.damping_time_s=0.01",
    ];
    left("study-load", &arguments, 1.0, &[]);
}

#[test]
fn a_study_of_stable_steps_leaves_the_pages_it_left() {
    let arguments = [
        "study",
        "stability",
        "models/driven-head.toml",
        "--points",
        "3",
        "--set",
        "rod.nodes=5",
        "--set",
        "solver.duration_s=0.2",
        "--set",
        "solver.time_step_s=0.02",
        "--steps",
        "0.01,0.1",
        "--vary",
        "modulus",
        "--range",
        "0.01,1",
    ];
    left("study-steps", &arguments, 0.3, &[]);
}

#[test]
fn a_study_of_fluids_leaves_the_pages_it_left() {
    let arguments =
        ["study", "fluid", "models/driven-head.toml", "--set", "rod.nodes=9", "--set", "solver.duration_s=2.0"];
    left("study-fluid", &arguments, 0.3, &["-time.svg", "report.html", "summary.json", "laws.csv"]);
}

#[test]
fn a_study_of_accuracy_leaves_the_pages_it_left() {
    let arguments = [
        "study",
        "accuracy",
        "models/driven-head.toml",
        "--nodes",
        "9",
        "--steps",
        "2e-2,1e-2",
        "--tolerances",
        "1e-3",
        "--set",
        "solver.duration_s=0.5",
        "--set",
        "rod.nodes=9",
    ];
    left("study-accuracy", &arguments, 0.3, &["-time.svg", "report.html", "summary.json", "targets.csv"]);
}

#[test]
fn a_design_of_a_tip_leaves_the_pages_it_left() {
    let arguments = ["design", "models/design-tip.toml", "--set", "design.iterations=3"];
    left("design-tip", &arguments, 1.0, &[]);
}

#[test]
fn an_identification_of_drag_leaves_the_pages_it_left() {
    left("design-identify-drag", &["design", "models/design-identify-drag.toml"], 0.3, &[]);
}

/// A sweep of the silicone tail with these axes, in a folder.
fn sweep(folder: &Path, name: &str, axes: &str) -> String {
    let path = folder.join(format!("{name}.toml"));
    let scene = root().join("models/silicone-tail.toml");
    let text = format!("name = {name:?}\nscene = {scene:?}\n[set]\nsolver.duration_s = 0.6\nrod.nodes = 9\n{axes}\n");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_string()
}

fn sweep_left(name: &str, axes: &str, left_out: &[&str]) {
    is_as_recorded(&format!("figures/{name}"), |longer| {
        let folder = tempfile::tempdir().unwrap();
        run(&["sweep", &sweep(folder.path(), name, axes)], 0.12, longer, &folder.path().join("out"));
        digests(&folder.path().join("out"), left_out)
    });
}

#[test]
fn a_sweep_along_one_axis_leaves_the_pages_it_left() {
    let few = ["energy", "power", "work", "moment"];
    sweep_left("sweep-frequency", "[axes]\nhead.angle_rad.frequency_hz = [2.0, 3.5, 5.0, 6.0]", &few);
}

#[test]
fn a_sweep_along_two_axes_leaves_the_pages_it_left() {
    let axes =
        "[axes]\nhead.angle_rad.frequency_hz = { from = 2.0, to = 6.0, count = 3 }\nrod.youngs_modulus_pa = [1e5, 1e6]";
    sweep_left("sweep-frequency-and-modulus", axes, &["energy", "power", "work", "moment", "max-"]);
}

#[test]
fn a_sweep_of_names_and_of_a_case_that_fails_leaves_the_pages_it_left() {
    let axes = "[axes]\nsolver.time_step_s = [0.001, 0.2]\nsolver.integrator = [\"newmark\", \"symplectic-euler\"]";
    sweep_left("sweep-methods", axes, &["energy", "power", "work", "moment", "max-"]);
}

#[test]
fn a_map_of_cases_that_fail_too_leaves_the_pages_it_left() {
    let axes = "[axes]\nrod.youngs_modulus_pa = [1e2, 1e5, 1e6]\nhead.angle_rad.amplitude = [0.3, 60.0]";
    sweep_left("sweep-failing", axes, &["energy", "power", "work", "moment", "max-", "force"]);
}

/// The soft tail whose design is quick.
const SOFT: [&str; 8] = [
    "design",
    "models/design-driven-head.toml",
    "--set",
    "rod.nodes=9",
    "--set",
    "solver.duration_s=3.0",
    "--set",
    "design.iterations=2",
];

#[test]
fn a_design_for_the_longest_way_leaves_the_pages_it_left() {
    left("design-distance", &SOFT, 1.0, &["starts.csv"]);
}

#[test]
fn a_front_of_designs_leaves_the_pages_it_left() {
    let more = ["--set", "design.front={goal=\"efficiency\",points=3}", "--set", "design.starts=1"];
    left("design-front", &[&SOFT[..], &more].concat(), 1.0, &["starts.csv", "stl", "body.csv"]);
}

#[test]
fn a_design_for_several_fluids_leaves_the_pages_it_left() {
    is_as_recorded("figures/design-robust", |longer| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cases.toml");
        let scene = root().join(SOFT[1]);
        let text = format!("name = \"cases\"\nscene = {scene:?}\n[axes]\nmedium.viscosity_pa_s = [0.9, 1.1]\n");
        std::fs::write(&path, text).unwrap();
        let over = format!("design.over={:?}", path.to_str().unwrap());
        let more = ["--set", "design.robust=mean", "--set", &over, "--set", "design.starts=1"];
        run(&[&SOFT[..], &more].concat(), 1.0, longer, &folder.path().join("out"));
        digests(&folder.path().join("out"), &["starts.csv", "stl", "body.csv"])
            .replace(folder.path().to_str().unwrap(), ".")
    });
}

/// Size, number of colours, and mean of each channel in whole numbers of a picture of red, green, blue and opacity.
fn picture(width: u32, height: u32, pixels: &[u8]) -> String {
    let colours: std::collections::BTreeSet<&[u8]> = pixels.chunks(4).collect();
    let mean = |channel: usize| {
        let sum: f64 = pixels.chunks(4).map(|pixel| f64::from(pixel[channel])).sum();
        (sum / f64::from(width * height)).round()
    };
    format!("{width} x {height}, more than {} colours, means {:?}", colours.len() / 8 * 8, [mean(0), mean(1), mean(2)])
}

#[cfg(feature = "parquet")]
fn parquet(path: &Path) -> String {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;
    let shown = |cell: &Field| match cell {
        Field::Double(x) => format!("{x:e}"),
        other => other.to_string(),
    };
    let reader = SerializedFileReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let schema = reader.metadata().file_metadata().schema().clone();
    let mut csv = schema.get_fields().iter().map(|field| field.name().to_string()).collect::<Vec<_>>().join(",") + "\n";
    for row in reader.get_row_iter(None).unwrap() {
        let cells = row.unwrap().get_column_iter().map(|(_, cell)| shown(cell)).collect::<Vec<_>>();
        csv += &(cells.join(",") + "\n");
    }
    crate::digest::table(&csv)
}

/// A run and what its folder is exported as.
#[test]
fn exports_of_a_run_are_what_they_were() {
    is_as_recorded("figures/exports", |longer| {
        let folder = tempfile::tempdir().unwrap();
        let [out, vtk, films] = ["out", "vtk", "films"].map(|name| folder.path().join(name));
        let length = format!("rod.length_m={:e}", 0.3 * (1.0 + longer));
        let mut sets = vec!["--set", &length];
        for set in [
            "rod.nodes=9",
            "solver.duration_s=1.0",
            "record.interval_s=0.5",
            "record.nodes_table=parquet",
            "record.nodes=[0,3,-1]",
            "record.nodes_from_s=0.5",
        ] {
            sets.extend(["--set", set]);
        }
        let scene = "models/dipping-tail.toml";
        caudal(&[&["run", scene, "--out", out.to_str().unwrap()], &sets[..]].concat());
        caudal(&[&["export", out.to_str().unwrap(), "--vtk", "--out", vtk.to_str().unwrap()], &sets[..]].concat());
        let film = ["--gif", "--fps", "4", "--speed", "0.5", "--from", "0.5", "--out", films.to_str().unwrap()];
        caudal(&[&["export", out.to_str().unwrap()], &film[..], &sets].concat());
        let pictures = ["--png", "--pdf", "--figures", "shape", "--out", films.to_str().unwrap()];
        caudal(&[&["export", out.to_str().unwrap()], &pictures[..], &sets].concat());
        let mut text = digests(&vtk, &[]);
        for path in files(&films) {
            let name = path.file_name().unwrap().to_str().unwrap().to_string();
            if name.ends_with(".gif") {
                let mut options = gif::DecodeOptions::new();
                options.set_color_output(gif::ColorOutput::RGBA);
                let mut decoder = options.read_info(std::fs::File::open(&path).unwrap()).unwrap();
                writeln!(text, "== {name}, repeats {:?}", decoder.repeat()).unwrap();
                while let Some(frame) = decoder.read_next_frame().unwrap() {
                    let (width, height) = (frame.width.into(), frame.height.into());
                    writeln!(text, "after {} ms {}", 10 * frame.delay, picture(width, height, &frame.buffer)).unwrap();
                }
            } else if name.ends_with(".png") {
                let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
                let mut reader = png::Decoder::new(file).read_info().unwrap();
                let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
                let frame = reader.next_frame(&mut pixels).unwrap();
                writeln!(text, "== {name} {:?}", frame.color_type).unwrap();
                writeln!(text, "{}", picture(frame.width, frame.height, &pixels)).unwrap();
            } else if name.ends_with(".pdf") {
                let content = String::from_utf8_lossy(&std::fs::read(&path).unwrap()).into_owned();
                let page = content.split("/MediaBox").nth(1).unwrap().split(']').next().unwrap().to_string();
                writeln!(text, "== {name}, {page}]").unwrap();
            }
        }
        #[cfg(feature = "parquet")]
        writeln!(text, "== nodes.parquet\n{}", parquet(&out.join("nodes.parquet"))).unwrap();
        text
    });
}
