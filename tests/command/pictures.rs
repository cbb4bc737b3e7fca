//! Every page and film that plays a motion draws the body, the support of its head, the media and the flow of the model that moved.

use std::path::{Path, PathBuf};
use std::process::Command;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use caudal::nalgebra::Vector2;
use caudal::scene::Document;
use caudal::stepper::Stepper;
use serde_json::Value;

use crate::page::{after, chromium};

const SCENE: &str = r#"
name = "scene"
[rod]
nodes = 9
length_m = 0.3
section = "ellipse"
outer_radius_m = [[0.0, 0.006], [1.0, 0.004]]
depth_m = 0.03
youngs_modulus_pa = 5e6
density_kg_m3 = 1000.0
[actuation]
kind = "travelling-wave"
kappa_amp = 4.0
frequency_hz = 2.0
wavelength_m = 0.4
[medium]
viscosity_pa_s = 0.1
density_kg_m3 = 1000.0
flow_m_s = [0.2, 0.0]
[drag]
law = "cross-flow"
[solver]
integrator = "newmark"
time_step_s = 5e-3
duration_s = 0.5
"#;

/// Kinds of scenes, each with what it changes.
const KINDS: [(&str, &str); 6] = [
    ("free", ""),
    ("still", "medium.flow_m_s = [0.0, 0.0]"),
    ("driven", "head = { kind = \"driven\", position_m = [0.0, { amplitude = 0.02, frequency_hz = 2.0 }] }"),
    ("body", "head_body = { semi_axis_along_m = 0.04, semi_axis_across_m = 0.02 }"),
    (
        "layers",
        "medium.beyond = { normal = [0.0, 1.0], offset_m = 0.01, thickness_m = 0.01, viscosity_pa_s = 1e-3, density_kg_m3 = 1.0, \
         flow_m_s = [0.0, 0.0] }",
    ),
    ("shear", "medium.shear = { rate_per_s = 2.0, normal = [0.0, 1.0] }"),
];

fn caudal(folder: &Path, arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_caudal")).current_dir(folder).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    // A few iterations of a design do not converge.
    assert!(output.status.success() || said.contains("the search did not converge"), "{arguments:?}: {said}");
}

fn script(page: &Path, id: &str) -> Value {
    let text = std::fs::read_to_string(page).unwrap();
    let json = text.split(&format!("<script id=\"{id}\" type=\"application/json\">")).nth(1).unwrap();
    serde_json::from_str(json.split("</script>").next().unwrap()).unwrap()
}

fn unpacked(packed: &Value) -> Vec<f64> {
    let bytes = STANDARD.decode(packed.as_str().unwrap()).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// The state of a scene at its end.
fn model_at_end(file: &Path, more: &[&str]) -> Stepper {
    let mut document = Document::read(file).unwrap();
    more.iter().for_each(|set| document.set(set).unwrap());
    let scene = document.scene().unwrap();
    let mut stepper = Stepper::of(&scene).unwrap();
    stepper.do_step(scene.solver.duration_s.get()).unwrap();
    stepper
}

/// The velocity of the flow that a player draws at a place.
fn flow_at(motion: &Value, x: Vector2<f64>) -> Option<Vector2<f64>> {
    let flow = motion.get("flow")?;
    let normal = flow.get("normal").map_or(Vector2::zeros(), |normal| Vector2::from_vec(numbers(normal)));
    let height = normal.dot(&x);
    let edges = motion["media"]["edges"].as_array().cloned().unwrap_or_default();
    let layer = edges.iter().filter(|edge| height > numbers(edge).iter().sum::<f64>() / 2.0).count();
    let velocities = unpacked(&flow["layers"][layer]);
    let last = &velocities[velocities.len() - 2..];
    let shear = flow.get("rate").map_or(0.0, |rate| rate.as_f64().unwrap()) * height;
    Some(Vector2::new(last[0] + shear * normal.y, last[1] - shear * normal.x))
}

/// Compares the last frame of `rod`, one of a `motion` and so far (m) below its place, with the model. `nodes` are those that are drawn.
fn compare_in_lane(what: &str, (motion, rod, lane): (&Value, &Value, f64), stepper: &Stepper, nodes: &[usize]) {
    let (view, model) = (stepper.view(), stepper.model());
    let com = motion["com"].as_array().unwrap();
    let (count, centre) = (com.len(), numbers(&com[com.len() - 1]));
    let end = numbers(&motion["times"])[count - 1];
    assert!((end - stepper.time()).abs() < 1e-9, "{what}: ends at {end}");
    let points = unpacked(&rod["points"]);
    assert_eq!(points.len(), 2 * count * nodes.len(), "{what}");
    let place = |point: &[f64]| Vector2::new(point[0] + centre[0], point[1] + centre[1] + lane);
    let last: Vec<Vector2<f64>> = points[points.len() - 2 * nodes.len()..].chunks(2).map(place).collect();
    let q = &view.state.q;
    for (point, k) in last.iter().zip(nodes) {
        // Pages have six digits of the extent of the rod.
        let apart = (point - Vector2::new(q[2 * k], q[2 * k + 1])).norm();
        assert!(apart < 2e-6, "{what}: node {k} is {apart} m from its place");
    }
    if std::ptr::eq(rod, motion) && lane == 0.0 {
        assert!((Vector2::from_vec(centre) - view.metrics.now.com).norm() < 2e-6, "{what}: centre of mass");
    }
    let widths: Vec<f64> = nodes.iter().map(|k| model.rod.sections.at(model.rod.xi(*k)).semi_axes()[0]).collect();
    let found = numbers(&rod["half_widths"]);
    assert!(found.iter().zip(&widths).all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{what}: {found:?} {widths:?}");
    let shows_head = nodes.starts_with(&[0, 1]);
    let body = model.rod.body.filter(|_| shows_head).map(|body| vec![body.along, body.across]);
    assert_eq!(rod.get("body").map(numbers), body, "{what}");
    assert_eq!(rod.get("head").is_some(), model.head.is_some() && shows_head, "{what}");
    assert_eq!(rod.get("headless").is_some(), nodes[0] != 0, "{what}");
    let interfaces = model.layers.map_or(0, |layers| layers.iter().len());
    assert_eq!(motion["media"]["edges"].as_array().map_or(0, Vec::len), interfaces, "{what}");
    for point in last.iter().flat_map(|point| [*point, point + Vector2::new(0.1, 0.2), point - Vector2::new(0.0, 0.3)])
    {
        // In an interface the flow blends, while arrows change at its middle.
        let is_between = model.layers.is_some_and(|layers| {
            layers.iter().any(|layer| (layers.height(point) - layer.offset).abs() <= 0.5 * layer.thickness)
        });
        let (found, there) = (flow_at(motion, point).unwrap_or_default(), view.dynamics.fluid_at(point).flow);
        assert!(
            is_between || (found - there).norm() < 1e-6,
            "{what}: flow at {point:?}: {found:?}, of the model {there:?}"
        );
    }
}

fn compare(what: &str, motion: &Value, rod: &Value, stepper: &Stepper, nodes: &[usize]) {
    compare_in_lane(what, (motion, rod, 0.0), stepper, nodes);
}

#[test]
fn every_page_draws_the_body_the_media_and_the_flow_of_the_model_that_moved() {
    let all: Vec<usize> = (0..9).collect();
    for (kind, change) in KINDS {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| -> PathBuf { folder.path().join(name) };
        let mut document: toml::Table = toml::from_str(SCENE).unwrap();
        for (table, value) in toml::from_str::<toml::Table>(change).unwrap() {
            match (document.get_mut(&table), value) {
                (Some(toml::Value::Table(own)), toml::Value::Table(more)) => own.extend(more),
                (_, value) => drop(document.insert(table, value)),
            }
        }
        std::fs::write(at("scene.toml"), toml::to_string(&document).unwrap()).unwrap();
        let (file, end) = (at("scene.toml"), model_at_end(&at("scene.toml"), &[]));
        let nodes: Vec<usize> = (0..end.model().rod.nodes).collect();
        assert!(nodes.len() <= 10 && nodes.starts_with(&all));

        caudal(folder.path(), &["run", "scene.toml", "--out", "run"]);
        let run = script(&at("run/report.html"), "motion");
        compare(&format!("{kind}, run"), &run, &run, &end, &nodes);

        std::fs::write(
            at("sweep.toml"),
            "scene = \"scene.toml\"\n[record]\nframes = 11\n[axes]\nrod.youngs_modulus_pa = [5e6, 8e6]\n",
        )
        .unwrap();
        caudal(folder.path(), &["sweep", "sweep.toml", "--out", "sweep"]);
        let cases = script(&at("sweep/report.html"), "data");
        for (case, modulus) in [("0", "5e6"), ("1", "8e6")] {
            let own = model_at_end(&file, &[&format!("rod.youngs_modulus_pa={modulus}")]);
            let motion = &cases["motions"][case];
            compare(&format!("{kind}, case {case} of a sweep"), motion, motion, &own, &nodes);
        }

        caudal(folder.path(), &["study", "fluid", "scene.toml", "--out", "study"]);
        let study = script(&at("study/report.html"), "motion");
        let beside = study["beside"].as_array().unwrap();
        assert!(beside.iter().all(|rod| rod.get("half_widths") == study.get("half_widths")), "{kind}: {study}");
        // Where the place matters, rods are at their own.
        let lanes: Vec<f64> = std::iter::once(&study)
            .chain(beside)
            .map(|rod| unpacked(&study["points"])[1] - unpacked(&rod["points"])[1])
            .collect();
        assert_eq!(
            lanes.iter().all(|lane| lane.abs() < 1e-6),
            ["layers", "shear"].contains(&kind),
            "{kind}: {lanes:?}"
        );
        // One of them is the rod under the scene's own law.
        let own = std::iter::once(&study).chain(beside).zip(&lanes).position(|(rod, lane)| {
            let points = unpacked(&rod["points"]);
            let com = numbers(study["com"].as_array().unwrap().last().unwrap());
            let (tip, q) = (&points[points.len() - 2..], &end.view().state.q);
            (tip[0] + com[0] - q[q.len() - 2]).hypot(tip[1] + com[1] + lane - q[q.len() - 1]) < 1e-5
        });
        let own = own.unwrap_or_else(|| panic!("{kind}: no rod of the study is that of the scene"));
        let rod = own.checked_sub(1).map_or(&study, |i| &beside[i]);
        compare_in_lane(&format!("{kind}, study"), (&study, rod, lanes[own]), &end, &nodes);

        // Only some nodes are recorded of one run, and the first of all has no table.
        let partial: [&[usize]; 3] = [&[0, 1, 4, 8], &[0, 3, 8], &[2, 5, 7]];
        for (i, recorded) in partial.iter().enumerate() {
            let sets = format!("record.nodes={recorded:?}");
            let out = format!("part{i}");
            caudal(folder.path(), &["run", "scene.toml", "--out", &out, "--set", &sets]);
        }
        caudal(folder.path(), &["run", "scene.toml", "--out", "none", "--set", "record.nodes_table=none"]);
        caudal(folder.path(), &["run", "scene.toml", "--out", "late", "--set", "record.nodes_from_s=9"]);
        caudal(folder.path(), &["compare", "none", "part0", "late", "part1", "part2", "run", "--out", "cmp"]);
        let film = script(&at("cmp/report.html"), "motion");
        let rods: Vec<&Value> = std::iter::once(&film).chain(film["beside"].as_array().unwrap()).collect();
        let expected = [("part0", 1), ("part1", 3), ("part2", 4), ("run", 5)];
        assert_eq!(rods.len(), expected.len(), "{kind}");
        let swatches = std::fs::read_to_string(at("cmp/report.html")).unwrap();
        for ((rod, (name, place)), nodes) in rods.iter().zip(expected).zip(partial.into_iter().chain([&nodes[..]])) {
            compare(&format!("{kind}, {name} compared"), &film, rod, &end, nodes);
            assert_eq!(rod["name"], name);
            // Its line in charts is of the same colour, and so is its swatch.
            assert_eq!(rod["series"], place + 1, "{kind}: {name}");
            assert!(swatches.contains(&format!("background: var(--series-{})\"></span>{name}<", place + 1)), "{name}");
        }
        let told = "late: its table of nodes has no row (record.nodes_from_s): it is not in the film";
        assert!(swatches.contains(told), "{kind}");

        // A film draws the whole body, whichever nodes are recorded, and passing specks only in a flow that is the same everywhere.
        let svg = |out: &str| {
            caudal(folder.path(), &["export", out, "film.svg", "--out", "films", "--from", "0.1", "--force"]);
            std::fs::read_to_string(at("films/film.svg")).unwrap()
        };
        let film = svg("run");
        assert!(film == svg("part2"), "{kind}: the film depends on record.nodes");
        let outline = film.split("class=\"body rim\" d=\"").nth(1).unwrap().split('"').next().unwrap();
        assert_eq!(outline.matches('M').count(), 1 + usize::from(end.model().rod.body.is_some()), "{kind}");
        assert_eq!(film.contains("id=\"layers\""), kind == "layers", "{kind}");
        assert_eq!(film.contains("specks\" d"), !["layers", "shear"].contains(&kind), "{kind}");

        // Of a design, the designed rod and that of the scene.
        if ["free", "body"].contains(&kind) {
            let across = if kind == "body" { ", \"head_body.semi_axis_across_m\"" } else { "" };
            let variables = format!("[\"rod.outer_radius_m\"{across}]");
            let design =
                format!("goal = \"distance\"\ndirection = \"-x\"\nvariables = {variables}\nstarts = 1\niterations = 2");
            document.insert("design".to_string(), toml::from_str::<toml::Table>(&design).unwrap().into());
            let rod = document.get_mut("rod").and_then(toml::Value::as_table_mut).unwrap();
            rod.insert("outer_radius_m".to_string(), 0.005.into());
            std::fs::write(at("design.toml"), toml::to_string(&document).unwrap()).unwrap();
            caudal(folder.path(), &["design", "design.toml", "--out", "design"]);
            let motion = script(&at("design/report.html"), "motion");
            let designed = std::fs::read_dir(at("design")).unwrap().map(|entry| entry.unwrap().path());
            let designed =
                designed.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).min().unwrap();
            let (own, designed) = (model_at_end(&at("design.toml"), &[]), model_at_end(&designed, &[]));
            assert_ne!(
                own.model().rod.total_mass(),
                designed.model().rod.total_mass(),
                "{kind}: the design changes nothing"
            );
            compare(&format!("{kind}, design"), &motion, &motion, &designed, &nodes);
            compare(&format!("{kind}, before the design"), &motion, &motion["beside"][0], &own, &nodes);
        }
    }
}

#[test]
fn the_only_joint_of_a_rod_has_the_colour_of_its_value_on_both_sides() {
    let Some(browser) = chromium() else { return };
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    caudal(folder.path(), &["run", "scene.toml", "--out", "run", "--set", "rod.nodes=3"]);
    let script = r##"
        for (const name of ["curvature", "moment"]) {
          part("colour").value = name; part("colour").onchange();
          const k = motion.times.reduce((a, _, k) => Math.abs(FIELDS[name].of(k)[1]) > Math.abs(FIELDS[name].of(a)[1]) ? k : a, 0);
          show(k);
          const wanted = diverging(FIELDS[name].of(k)[1] / size_of(name));
          document.body.dataset[name] = [...part("segments").children].map((segment) => segment.getAttribute("fill") === wanted).join(" ");
        }
    "##;
    for (name, found) in after(&browser, &folder.path().join("run/report.html"), script, &["curvature", "moment"]) {
        assert_eq!(found, "true true", "{name}");
    }
}

#[test]
fn a_sweep_without_motions_offers_none_to_be_played() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    for (frames, plays) in [(0, false), (5, true)] {
        let axes = "rod.youngs_modulus_pa = [5e6, 8e6]\nactuation.frequency_hz = [2.0, 3.0]\n";
        let sweep = format!("scene = \"scene.toml\"\n[record]\nframes = {frames}\n[axes]\n{axes}");
        std::fs::write(folder.path().join("sweep.toml"), sweep).unwrap();
        let out = format!("sweep{frames}");
        caudal(folder.path(), &["sweep", "sweep.toml", "--out", &out]);
        let page = std::fs::read_to_string(folder.path().join(out).join("report.html")).unwrap();
        assert_eq!(page.contains("A click on a cell of a map plays its case."), plays);
        // The explanation of a click is seen also where the player is not.
        let (explanation, player) = (page.find("id=\"what\"").unwrap(), page.find("<div id=\"player\"").unwrap());
        assert!(explanation < player);
    }
}

#[test]
fn a_comparison_has_few_charts_of_a_quantity_along_the_rod() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    for (out, nodes) in [("few", 7), ("many", 60)] {
        for modulus in ["5e6", "8e6"] {
            let [nodes, modulus_set] = [format!("rod.nodes={nodes}"), format!("rod.youngs_modulus_pa={modulus}")];
            let arguments =
                ["run", "scene.toml", "--out", &format!("{out}{modulus}"), "--set", &nodes, "--set", &modulus_set];
            caudal(folder.path(), &[&arguments[..], &["--set", "record.variables=[\"curvature_1_m\"]"]].concat());
        }
        let [one, other] = ["5e6", "8e6"].map(|modulus| format!("{out}{modulus}"));
        caudal(folder.path(), &["compare", &one, &other, "--out", out]);
        let files = std::fs::read_dir(folder.path().join(out)).unwrap().map(|entry| entry.unwrap().file_name());
        let charts = files.filter(|name| name.to_string_lossy().starts_with("curvature_1_m-")).count();
        let page = std::fs::read_to_string(folder.path().join(out).join("report.html")).unwrap();
        let said = page.matches("Of 58 entries, 8 are drawn; trajectory.csv has all.").count();
        assert_eq!((charts, said > 0), if out == "few" { (5, false) } else { (8, true) });
    }
}
