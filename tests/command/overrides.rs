//! Overrides mean the same in whatever order they come: they merge as documents, and what excludes each other is settled or refused after
//! that. Nothing that is asked for is dropped in silence.

use std::path::Path;

use caudal::scene::{Document, Scene};
use caudal::sweep::Sweep;

const TAIL: &str = r#"
name = "tail"
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
[head]
kind = "driven"
angle_rad = { amplitude = 0.1, frequency_hz = 1.0, phase_rad = 0.3 }
[solver]
integrator = "newmark"
beta = 0.3
time_step_s = 5e-3
duration_s = 0.1
"#;

/// Keys of every table with values, some of which exclude each other or are refused by themselves.
const SETTINGS: [(&str, &[&str]); 50] = [
    ("name", &["other", "a/b"]),
    ("rod", &["{ nodes = 11 }", "{ length_m = 0.3, nodes = 13 }"]),
    ("rod.nodes", &["9", "17", "2"]),
    ("rod.length_m", &["0.3", "-1"]),
    ("rod.outer_radius_m", &["0.01", "[[0.0, 0.01], [1.0, 0.005]]"]),
    ("rod.inner_radius_m", &["0.001", "0.1"]),
    ("rod.depth_m", &["0.02"]),
    ("rod.youngs_modulus_pa", &["2e6"]),
    ("rod.density_kg_m3", &["1000"]),
    ("rod.stiffness_gradient", &["0.5"]),
    ("rod.stiffness_profile", &["[[0.0, 1.0], [1.0, 0.5]]"]),
    ("rod.mass_profile", &["[[0.0, 1.0], [1.0, 0.5]]"]),
    ("rod.mass_lumping", &["uniform"]),
    ("actuation", &["{ kappa_amp = 4.0, envelope = [0.5, 0.5] }"]),
    ("actuation.kind", &["standing-wave", "sine-wave"]),
    ("actuation.kappa_amp", &["5", "nan"]),
    ("actuation.slope", &["0.3"]),
    ("actuation.frequency_hz", &["1"]),
    ("actuation.wavelength_m", &["0.2"]),
    ("actuation.envelope", &["[0.2, 0.8]"]),
    ("start", &["{ kind = \"ramp\", ramp_s = 0.05 }"]),
    ("start.kind", &["jump", "ramp"]),
    ("start.ramp_s", &["0.02"]),
    ("medium.viscosity_pa_s", &["1.0"]),
    ("medium.flow_m_s", &["[0.1, 0.0]", "{ amplitude = [0.1, 0.0], frequency_hz = 1.0 }"]),
    ("medium.flow_m_s.phase_rad", &["0.5"]),
    ("drag.law", &["cox", "stokes-like"]),
    ("drag.ratio", &["2.0"]),
    ("drag.head_weight", &["2.0"]),
    ("drag.head_length_m", &["0.05"]),
    ("drag.form_drag", &["1.0"]),
    ("reactive", &["{}", "{ shedding = 0.5 }"]),
    ("reactive.shedding", &["0.7"]),
    ("loads.gravity_m_s2", &["[0.0, -9.81]"]),
    ("loads.buoyancy", &["true"]),
    ("head.kind", &["free", "clamped"]),
    ("head.position_m", &["[0.0, { amplitude = 0.01, frequency_hz = 1.0 }]"]),
    ("head.position_m.1.amplitude", &["0.02"]),
    ("actuation.envelope.1", &["0.4"]),
    ("head.angle_rad", &["0.1", "{ amplitude = 0.2, frequency_hz = 2.0 }", "{ phase_rad = 0.1 }"]),
    ("head.angle_rad.phase_rad", &["0.7"]),
    ("head.angle_rad.amplitude", &["0.05"]),
    ("solver.integrator", &["esdirk3", "generalized-alpha", "implicit-euler"]),
    ("solver.beta", &["0.25", "0.4"]),
    ("solver.rho_inf", &["0.5"]),
    ("solver.time_step_s", &["1e-3", "2e-3"]),
    ("solver.tolerance", &["1e-3"]),
    ("record.every", &["2"]),
    ("record.interval_s", &["0.01"]),
    ("record.nodes", &["[0, -1]"]),
];

/// What becomes of the scene with these overrides.
fn outcome(overrides: &[&str]) -> Result<(Scene, Vec<u8>), String> {
    let mut document = Document::new("tail.toml", TAIL);
    overrides.iter().try_for_each(|text| document.set(text)).map_err(|e| e.to_string())?;
    document.resolve().map_err(|e| e.to_string())
}

#[test]
fn overrides_mean_the_same_in_any_order() {
    let pairs = std::env::var("CAUDAL_PAIRS").map_or(2000, |count| count.parse().unwrap());
    let mut dice = fastrand::Rng::with_seed(7);
    let mut pick = |not: Option<usize>| loop {
        let i = dice.usize(..SETTINGS.len());
        if Some(i) != not {
            let (key, values) = SETTINGS[i];
            return (i, format!("{key}={}", values[dice.usize(..values.len())]));
        }
    };
    let (mut sound, mut refused) = (0, 0);
    for _ in 0..pairs {
        let (i, first) = pick(None);
        let (_, second) = pick(Some(i));
        let [one, other] = [[&*first, &*second], [&*second, &*first]].map(|pair| outcome(&pair));
        match (&one, &other) {
            (Ok(_), Ok(_)) => sound += 1,
            _ => refused += 1,
        }
        // Of two mistakes each is told, in either order.
        let lines = |text: &String| {
            let mut lines: Vec<String> = text.lines().map(str::to_string).collect();
            lines.sort();
            lines
        };
        assert_eq!(one.map_err(|e| lines(&e)), other.map_err(|e| lines(&e)), "{first} {second}");
    }
    println!("{pairs} pairs: {sound} scenes, {refused} refused");
    assert!(sound > pairs / 4 && refused > pairs / 20, "{sound} {refused}");
}

#[test]
fn functions_of_time_replace_each_other_and_their_keys_change_them() {
    let angle = |overrides: &[&str]| format!("{:?}", outcome(overrides).unwrap().0.head.angle_rad.unwrap());
    let new = "head.angle_rad={ amplitude = 0.2, frequency_hz = 2.0 }";
    assert!(angle(&[new]).contains("phase: 0.0"), "{}", angle(&[new]));
    assert!(angle(&["head.angle_rad={ table = \"y.csv\" }"]).contains("Table"));
    assert!(angle(&["head.angle_rad.phase_rad=0.7"]).contains("amplitude: 0.1, frequency: 1.0, phase: 0.7"));
    assert!(angle(&["head.angle_rad.phase_rad=0.7", new]).contains("amplitude: 0.2, frequency: 2.0, phase: 0.7"));
}

#[test]
fn what_excludes_each_other_is_refused_in_one_layer_and_settled_between_layers() {
    let both = outcome(&["solver.tolerance=1e-3", "solver.integrator=esdirk3", "solver.time_step_s=1e-3"]).unwrap_err();
    assert!(both.contains("found together with time_step_s; allowed: one of the two"), "{both}");
    // A later layer takes the place of an earlier one.
    let mut document = Document::new("tail.toml", TAIL);
    document.set("solver.integrator=esdirk3").unwrap();
    document.set("solver.time_step_s=1e-3").unwrap();
    document.begin_layer();
    document.set("solver.tolerance=1e-4").unwrap();
    assert!(document.scene().unwrap().solver.time_step_s.is_none());
    let mut again = Document::new("tail.toml", TAIL);
    again.set_override_lines(document.override_lines().iter().map(String::as_str)).unwrap();
    assert_eq!(again.scene().unwrap().step_control(), document.scene().unwrap().step_control());
    // A parameter stays with its method.
    let beta = |overrides: &[&str]| outcome(overrides).unwrap().0.solver.parameters.get("beta").cloned();
    assert_eq!(beta(&["solver.integrator=newmark"]), Some(toml::Value::Float(0.3)));
    assert_eq!(beta(&["solver.beta=0.4", "solver.integrator=newmark"]), Some(toml::Value::Float(0.4)));
    assert_eq!(beta(&["solver.integrator=generalized-alpha"]), None);
    for nothing in ["#rod.nodes=17", "# rod.nodes = 17"] {
        assert!(outcome(&[nothing]).unwrap_err().contains("allowed: table.key=value"), "{nothing}");
    }
}

#[test]
fn an_override_of_a_kind_or_a_law_takes_away_the_keys_of_the_one_before() {
    let scene = |own: &[&str], overrides: &[&str]| {
        let mut document = Document::new("tail.toml", TAIL);
        own.iter().for_each(|change| document.set(change).unwrap());
        document.scene().unwrap();
        document.begin_layer();
        overrides.iter().for_each(|change| document.set(change).unwrap());
        document.scene().map_err(|error| error.to_string())
    };
    let ramp = ["start={ kind = \"ramp\", ramp_s = 0.05 }"];
    for kind in ["start.kind=shaped", "start.kind=jump"] {
        assert!(scene(&ramp, &[kind]).unwrap().start.ramp_s.is_none(), "{kind}");
    }
    assert!(scene(&ramp, &["start.kind=ramp"]).unwrap().start.ramp_s.is_some());
    // Of the fluid: the keys of a law, and those of the law of its viscous part.
    let water = ["drag={ law = \"cross-flow\", viscous = \"wall\", height_m = 0.05, form_drag = 1.2 }"];
    let drag = |overrides: &[&str]| scene(&water, overrides).unwrap().drag.unwrap();
    let cox = drag(&["drag.law=cox"]);
    assert!(cox.form_drag.is_none() && cox.viscous.is_none() && cox.height_m.is_none());
    assert!(drag(&["drag.law=wall"]).height_m.is_some());
    let viscous = drag(&["drag.viscous=cox"]);
    assert!(viscous.height_m.is_none() && viscous.form_drag.is_some());
    assert!(drag(&["drag.law=cross-flow"]).height_m.is_some());
    let study = ["drag={ law = \"stokes-like\", ratio = 3.0, head_weight = 2.0, head_length_m = 0.1 }"];
    let weighted = scene(&study, &["drag.law=cross-flow"]).unwrap().drag.unwrap();
    assert!(weighted.ratio.is_none() && weighted.head_weight.is_some());
    // Of the head.
    let hinged = ["head.kind=hinged", "head.inertia_kg_m2=1e-4", "head.stiffness_n_m=0.1", "head.input=at-end"];
    let head = |kind: &str| scene(&hinged, &[&format!("head.kind={kind}")]).unwrap().head;
    let keys = |kind: &str| {
        let head = head(kind);
        [head.inertia_kg_m2.is_some(), head.stiffness_n_m.is_some(), head.angle_rad.is_some(), head.input.is_some()]
    };
    assert_eq!(keys("hinged"), [true; 4]);
    assert_eq!(keys("driven"), [false, false, true, true]);
    assert_eq!(keys("clamped"), [false, false, false, true]);
    assert_eq!(keys("free"), [false; 4]);
    // Of the drive, of the mass and of the damping.
    let standing = scene(&[], &["actuation.kind=standing-wave"]).unwrap().actuation.unwrap();
    assert!(standing.wavelength_m.is_none() && standing.kappa_amp.is_some());
    assert!(scene(&[], &["rod.mass_per_length_kg_m=0.2"]).unwrap().rod.density_kg_m3.is_none());
    let lossy = ["rod.loss_factor=0.1", "rod.loss_frequency_hz=2.0"];
    let damped = scene(&lossy, &["rod.damping_time_s=0.01"]).unwrap().rod;
    assert!(damped.loss_factor.is_none() && damped.loss_frequency_hz.is_none());
    let limited =
        scene(&["actuation.largest_1_m=20.0"], &["actuation.moment_amp_n_m=1e-3"]).unwrap().actuation.unwrap();
    assert!(limited.kappa_amp.is_none() && limited.largest_1_m.is_none());
    // What is asked for together is refused, not dropped.
    let both = scene(&[], &["start.kind=jump", "start.ramp_s=0.1"]).unwrap_err();
    assert!(both.contains("start.ramp_s: found without kind = \"ramp\""), "{both}");
    let both = scene(&water, &["drag.law=cox", "drag.form_drag=1.0"]).unwrap_err();
    assert!(both.contains("drag.form_drag: found with law = \"cox\""), "{both}");
    // A value that is unknown takes away nothing.
    let unknown = scene(&ramp, &["start.kind=ramped"]).unwrap_err();
    assert!(unknown.contains("start.kind"), "{unknown}");
}

/// The sweep `text` over the tail, in a folder of its own.
fn sweep(text: &str, set: &[&str]) -> caudal::Result<Sweep> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tail.toml"), TAIL).unwrap();
    let path = folder.path().join("sweep.toml");
    std::fs::write(&path, format!("scene = \"tail.toml\"\n{text}")).unwrap();
    let set: Vec<String> = set.iter().map(ToString::to_string).collect();
    Sweep::read(&path, &set)
}

fn scenes(sweep: &Sweep) -> Vec<Scene> {
    (0..sweep.size()).map(|i| sweep.scene(&sweep.case(i).unwrap()).unwrap().0).collect()
}

#[test]
fn a_sweep_drops_nothing_that_is_set() {
    let axes = "[axes]\nrod.length_m = [0.4]\n";
    for set in ["[set.reactive]\n", "[set]\nreactive = {}\n"] {
        let all = scenes(&sweep(&format!("{set}{axes}"), &[]).unwrap());
        assert!(all.iter().all(|scene| scene.reactive.is_some()), "{set}");
    }
    let beta = |scene: &Scene| scene.solver.parameters.get("beta").and_then(toml::Value::as_float);
    let all =
        scenes(&sweep(&format!("[set]\nsolver.integrator = \"newmark\"\nsolver.beta = 0.4\n{axes}"), &[]).unwrap());
    assert_eq!(all.iter().map(beta).collect::<Vec<_>>(), [Some(0.4)]);
    for axes in [
        "[axes]\nsolver.beta = [0.25, 0.4]\nsolver.integrator = [\"newmark\"]\n",
        "[axes]\nsolver.integrator = [\"newmark\"]\nsolver.beta = [0.25, 0.4]\n",
    ] {
        let all = scenes(&sweep(axes, &[]).unwrap());
        assert_eq!(all.iter().map(beta).collect::<Vec<_>>(), [Some(0.25), Some(0.4)], "{axes}");
    }
}

#[test]
fn axes_and_settings_that_exclude_each_other_are_refused() {
    let adaptive = "solver.integrator = [\"esdirk3\"]\n";
    let both = sweep(&format!("[axes]\nsolver.time_step_s = [1e-3, 5e-3]\n{adaptive}solver.tolerance = [1e-3]\n"), &[]);
    let error = both.unwrap().job(1).unwrap_err().to_string();
    assert!(error.contains("found together with time_step_s; allowed: one of the two (in case "), "{error}");
    let steps = format!("[axes]\nsolver.time_step_s = [1e-3, 5e-3]\n{adaptive}");
    for (text, set) in [
        (format!("[set]\nsolver.tolerance = 1e-3\n{steps}"), &[][..]),
        (steps.clone(), &["solver.tolerance=1e-3"]),
        (steps.clone(), &["solver.time_step_s=2e-3"]),
        (steps.clone(), &["solver={ time_step_s = 2e-3 }"]),
        (format!("[set]\nsolver.time_step_s = 2e-3\n{steps}"), &[]),
    ] {
        let error = sweep(&text, set).unwrap_err().to_string();
        assert!(error.contains("found together with the axis `solver.time_step_s`, which replaces it"), "{error}");
    }
    // What is set would be lost, as a key within the axis', or as the one around it; of a list the axis sets an entry.
    let [inside, around] = [
        (
            "[set]\nrod.damping_time_s.bending = 1e-3\n[axes]\nrod.damping_time_s = [1e-3]\n",
            "rod.damping_time_s.bending: found",
        ),
        (
            "[set]\nrod.damping_time_s = 1e-3\n[axes]\nrod.damping_time_s.bending = [2e-3]\n",
            "rod.damping_time_s: found",
        ),
    ];
    for (text, words) in [inside, around] {
        let error = sweep(text, &[]).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("which replaces it"), "{error}");
    }
    let entry = "[set]\nmedium.flow_m_s = [0.1, 0.2]\n[axes]\nmedium.flow_m_s.1 = [0.3, 0.4]\n";
    assert!(sweep(entry, &[]).is_ok(), "{:?}", sweep(entry, &[]));
    // The base of factors may be set.
    let factors = "[axes]\nrod.length_m.factors = [1.0, 2.0]\n";
    let all = scenes(&sweep(factors, &["rod.length_m=0.3"]).unwrap());
    assert_eq!(all.iter().map(|scene| scene.rod.length_m.get()).collect::<Vec<_>>(), [0.3, 0.6]);
}

#[test]
fn columns_say_what_ran_and_have_names_of_their_own() {
    let two = "[axes]\nrod.youngs_modulus_pa = [1e6, 2e6]\n[axes.scatter]\nkeys = [\"rod.youngs_modulus_pa\"]\nfactors = [0.5, 1.0]\n";
    let two = sweep(two, &[]).unwrap();
    assert_eq!(two.columns(), ["rod.youngs_modulus_pa", "scatter"]);
    for (i, scene) in scenes(&two).iter().enumerate() {
        let values = two.values(&two.case(i).unwrap());
        assert_eq!(values[0].as_float(), Some(scene.rod.youngs_modulus()));
    }
    let named = "[axes.nodes]\nkeys = [\"rod.nodes\"]\nvalues = [9, 11]\n[axes.case]\nkeys = [\"rod.length_m\"]\nvalues = [0.3, 0.4]\n\
        [axes.cycle_period_s]\nkeys = [\"rod.density_kg_m3\"]\nvalues = [1e3]\n[report]\nsplit = \"nodes\"\n";
    let named = sweep(named, &[]).unwrap();
    assert_eq!(named.columns()[..3], ["axis.nodes", "axis.case", "axis.cycle_period_s"]);
    assert_eq!(named.split, Some(0));
    let labelled =
        sweep("[axes]\nrod.length_m = { values = [0.3, 0.4], labels = [\"short\", \"long\"] }\n", &[]).unwrap();
    assert_eq!(labelled.columns(), ["rod.length_m", "rod.length_m.label"]);
    // One label that is not the value itself is enough.
    for (labels, has_column) in
        [(["cox", "fast"], true), (["slow", "cross-flow"], true), (["cox", "cross-flow"], false)]
    {
        let axis = format!("[axes]\ndrag.law = {{ values = [\"cox\", \"cross-flow\"], labels = {labels:?} }}\n");
        let columns = sweep(&axis, &[]).unwrap().columns().to_vec();
        assert_eq!(columns.contains(&"drag.law.label".to_string()), has_column, "{labels:?}: {columns:?}");
    }
    // Two fluids of one viscosity are two levels.
    let fluids =
        "[axes.fluid]\nzip.medium.viscosity_pa_s = [1e-3, 1.0, 1e-3]\nzip.medium.density_kg_m3 = [1e3, 1e3, 900.0]\n";
    let labels = &sweep(fluids, &[]).unwrap().axes[0].labels;
    assert!(labels.iter().all(|label| label.is_str()) && labels[0] != labels[2], "{labels:?}");
    let log = sweep("[axes]\nrod.nodes = { from = 10, to = 1000, count = 3, scale = \"log\" }\n", &[]).unwrap();
    assert_eq!(scenes(&log).iter().map(|scene| scene.rod.nodes.get()).collect::<Vec<_>>(), [10, 100, 1000]);
}

/// The tail with its head's angle by a table, whose file is written to `folder`.
fn tabled(folder: &Path, table: &str) -> String {
    std::fs::write(folder.join("angle.csv"), table).unwrap();
    TAIL.replace(
        "angle_rad = { amplitude = 0.1, frequency_hz = 1.0, phase_rad = 0.3 }",
        "angle_rad = { table = \"angle.csv\" }",
    )
}

#[test]
fn a_table_is_read_once_and_what_becomes_of_its_file_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let text = tabled(folder.path(), "time_s,angle_rad\n0,0.0\n1,0.1\n");
    std::fs::write(folder.path().join("tail.toml"), text).unwrap();
    let path = folder.path().join("sweep.toml");
    std::fs::write(&path, "scene = \"tail.toml\"\n[axes]\nrod.length_m = [0.3, 0.4]\n").unwrap();
    let sweep = Sweep::read(&path, &[]).unwrap();
    let job = sweep.job(1).unwrap();
    let head = |i: usize| format!("{:?}", sweep.scene(&sweep.case(i).unwrap()).unwrap().0.model().unwrap().head);
    let before = [head(0), head(1)];
    for becomes in ["", "time_s,angle_rad\n0,0.0\n1,0.5\n"] {
        std::fs::write(folder.path().join("angle.csv"), becomes).unwrap();
        assert_eq!([head(0), head(1)], before);
        assert_eq!(sweep.job(1).unwrap().hash, job.hash);
    }
    assert_ne!(Sweep::read(&path, &[]).unwrap().job(1).unwrap().hash, job.hash, "another reading sees another table");
}

/// An entry of a list has a key: its place, from 0. So one coordinate of a head, one point load, one end of an envelope can be overridden, and
/// be the axis of a sweep.
#[test]
fn entries_of_lists_are_overridden_by_their_places() {
    let heave = "head.position_m=[0.0, { amplitude = 0.01, frequency_hz = 1.0 }]";
    let whole = "head.position_m=[0.0, { amplitude = 0.01, frequency_hz = 3.0 }]";
    let same = |one: &[&str], other: &[&str]| {
        let [one, other] = [one, other].map(|overrides| outcome(overrides).unwrap().0);
        assert_eq!(one.fingerprint(), other.fingerprint());
    };
    // In a layer of its own, as a sweep's axis is, or a second document's.
    let layered = |first: &[&str], second: &str| {
        let mut document = Document::new("tail.toml", TAIL);
        first.iter().for_each(|text| document.set(text).unwrap());
        document.begin_layer();
        document.set(second).unwrap();
        document.scene()
    };
    let entry = layered(&[heave], "head.position_m.1.frequency_hz=3.0").unwrap();
    assert_eq!(entry.fingerprint(), outcome(&[whole]).unwrap().0.fingerprint());
    same(&["actuation.envelope=[0.5, 0.5]"], &["actuation={ envelope = [0.5, 0.5] }"]);
    let mut envelope = layered(&["actuation.envelope=[0.5, 0.5]"], "actuation.envelope.0=0.25").unwrap();
    assert_eq!(envelope.actuation.take().unwrap().envelope.map(|x| x.get()), [0.25, 0.5]);
    let loads = "loads.point=[{ node = -1, force_n = [0.0, 1.0] }, { node = 4, force_n = [1.0, 0.0] }]";
    let load = layered(&[loads], "loads.point.1.force_n.0=2.0").unwrap();
    let other = "loads.point=[{ node = -1, force_n = [0.0, 1.0] }, { node = 4, force_n = [2.0, 0.0] }]";
    assert_eq!(load.fingerprint(), outcome(&[other]).unwrap().0.fingerprint());
    // Beyond the end there is none.
    let beyond = layered(&[heave], "head.position_m.2.frequency_hz=3.0").unwrap_err().to_string();
    assert!(beyond.contains("head.position_m"), "{beyond}");
}

/// Properties of `table` in a JSON schema whose default is a list with entries, in the schema or in words.
fn lists_with_defaults(schema: &serde_json::Value, table: &str) -> Vec<String> {
    let has_default = |property: &serde_json::Value| {
        let said = property["description"].as_str().unwrap_or_default();
        property["default"].as_array().is_some_and(|list| !list.is_empty()) || said.contains("By default [")
    };
    let properties = schema["properties"].as_object().unwrap();
    properties.iter().filter(|(_, property)| has_default(property)).map(|(key, _)| format!("{table}.{key}")).collect()
}

#[test]
fn an_entry_of_a_list_that_is_not_given_is_overridden_beside_its_defaults() {
    let cases = [
        ("actuation.envelope", "[1.0, 0.0]", ["0.5", "0.25"].as_slice()),
        ("design.bounds", "[0.01, 100.0]", &["0.1", "2.0"]),
        ("design.variables", "[\"stiffness\"]", &["\"rod.outer_radius_m\""]),
        ("medium.flow_m_s", "[0.0, 0.0]", &["0.1", "{ amplitude = 0.1, frequency_hz = 1.0 }"]),
    ];
    let schema = Scene::schema();
    let tables = schema["$defs"].as_object().unwrap();
    let mut known = lists_with_defaults(&caudal::design::DesignTable::schema(), "design");
    for (table, properties) in [("actuation", "ActuationTable"), ("medium", "MediumTable")] {
        known.extend(lists_with_defaults(&tables[properties], table));
    }
    let others = tables.iter().filter(|(name, _)| !["ActuationTable", "MediumTable"].contains(&name.as_str()));
    known.extend(
        others
            .filter(|(_, table)| table["properties"].is_object())
            .flat_map(|(name, table)| lists_with_defaults(table, name)),
    );
    known.sort();
    assert_eq!(known, cases.map(|(key, ..)| key), "a list with a default");
    let text = TAIL.to_string() + "[design]\ngoal = \"distance\"\n";
    let content = |overrides: &[String]| {
        let mut document = Document::new("tail.toml", text.as_str());
        overrides.iter().for_each(|text| document.set(text).unwrap());
        let read: toml::Table = document.read_as().unwrap();
        read
    };
    for (key, default, entries) in cases {
        let default: toml::Value = toml::from_str::<toml::Table>(&format!("list = {default}")).unwrap()["list"].clone();
        for (place, entry) in entries.iter().enumerate() {
            let mut whole = default.clone();
            whole[place] = toml::from_str::<toml::Table>(&format!("entry = {entry}")).unwrap()["entry"].clone();
            let one = content(&[format!("{key}.{place}={entry}")]);
            assert_eq!(one, content(&[format!("{key}={whole}")]), "{key}.{place}");
        }
        // The list as it is by default.
        if !key.starts_with("design.") {
            let given = outcome(&[&format!("{key}={default}")]).unwrap().0;
            assert_eq!(given.fingerprint(), outcome(&[]).unwrap().0.fingerprint(), "{key}");
            let swept = sweep(&format!("[axes]\n{key}.0 = [0.1, 0.2]\n"), &[]).unwrap();
            assert_eq!(scenes(&swept).len(), 2);
        }
        let beyond = format!("{key}.{}", default.as_array().unwrap().len());
        let mut document = Document::new("tail.toml", text.as_str());
        document.set(&format!("{beyond}={}", entries[0])).unwrap();
        let said = document.scene().unwrap_err().to_string();
        assert!(said.contains(&format!("{beyond}: found place ")), "{said}");
    }
}

/// Keys of a function of time, one or several, change these alone; the function as a whole replaces it.
#[test]
fn keys_of_a_function_of_time_leave_the_others() {
    let layered = |first: &[&str], second: &[&str]| {
        let mut document = Document::new("tail.toml", TAIL);
        first.iter().for_each(|text| document.set(text).unwrap());
        document.begin_layer();
        second.iter().try_for_each(|text| document.set(text)).and_then(|()| document.scene())
    };
    let whole = |text: &str| outcome(&[text]).unwrap().0.fingerprint();
    let same = |first: &[&str], second: &[&str], expected: &str| {
        assert_eq!(layered(first, second).unwrap().fingerprint(), whole(expected), "{second:?}");
    };
    // The scene's own has a phase of 0.3.
    let angle = "head.angle_rad={ amplitude = 0.2, frequency_hz = 2.0, phase_rad = 0.3 }";
    same(&[], &["head.angle_rad.amplitude=0.2", "head.angle_rad.frequency_hz=2.0"], angle);
    same(&[], &["head.angle_rad.frequency_hz=2.0", "head.angle_rad.amplitude=0.2"], angle);
    let bare = "head.angle_rad={ amplitude = 0.2, frequency_hz = 2.0 }";
    same(&[], &[bare], bare);
    same(&[], &["head={ angle_rad = { amplitude = 0.2, frequency_hz = 2.0 } }"], bare);
    same(&[], &[bare, "head.angle_rad.phase_rad=0.3"], angle);
    // In lists, and vectors by their places.
    let heave = "head.position_m=[0.0, { amplitude = 0.01, frequency_hz = 1.0, phase_rad = 0.5 }]";
    let keys = ["head.position_m.1.amplitude=0.02", "head.position_m.1.frequency_hz=2.0"];
    same(&[heave], &keys, "head.position_m=[0.0, { amplitude = 0.02, frequency_hz = 2.0, phase_rad = 0.5 }]");
    let flow = "medium.flow_m_s={ amplitude = [0.1, 0.0], frequency_hz = 1.0, phase_rad = 0.2 }";
    let keys = ["medium.flow_m_s.amplitude.1=0.05", "medium.flow_m_s.frequency_hz=3.0"];
    same(&[flow], &keys, "medium.flow_m_s={ amplitude = [0.1, 0.05], frequency_hz = 3.0, phase_rad = 0.2 }");
    // An entry of a list excludes what the list excludes.
    let profile = "rod.stiffness_profile=[[0.0, 1.0], [1.0, 0.5]]";
    let both = layered(&[profile], &["rod.stiffness_profile.1.1=0.1", "rod.stiffness_gradient=1.0"]).unwrap_err();
    assert!(both.to_string().contains("stiffness_gradient"), "{both}");
    same(&["rod.stiffness_gradient=1.0"], &[profile], profile);
}

#[test]
fn a_misspelt_key_of_an_axis_is_asked_for() {
    let error = |axis: &str| {
        let sweep = sweep(&format!("[axes]\nrod.length_m = {axis}\n"), &[]).unwrap();
        sweep.job(1).unwrap_err().to_string()
    };
    for (axis, near) in [("{ value = [0.3, 0.4] }", "values"), ("{ factor = [1.0, 2.0] }", "factors")] {
        let said = error(axis);
        assert!(said.contains(&format!("did you mean `{near}`?")), "{axis}: {said}");
    }
}

#[test]
fn an_override_is_named_as_who_gave_it_calls_it() {
    for (named, place) in [("", "rod.nodes=1: "), ("--set ", "--set rod.nodes=1: ")] {
        let mut document = Document::new("tail.toml", TAIL);
        document.set_as(named, "rod.nodes=1").unwrap();
        assert!(document.scene().unwrap_err().to_string().starts_with(place));
        let wrong = document.set_as(named, "rod.nodes").unwrap_err().to_string();
        assert!(wrong.starts_with(&format!("{named}rod.nodes: ")), "{wrong}");
    }
    let mut document = Document::new("tail.toml", TAIL);
    document.set("rod.nodes=1").unwrap();
    assert!(document.scene().unwrap_err().to_string().starts_with("override rod.nodes=1: "));
}

#[test]
fn a_place_that_a_list_does_not_have_says_how_many_there_are() {
    for (text, problem) in [
        ("loads.point.0.node=7", "found a place in a list without entries; allowed: the whole list, in brackets"),
        ("medium.layers.1.density_kg_m3=2.0", "found place 1 of a list with one entry; allowed: 0"),
        ("medium.layers.0.x=1.0", "unknown key"),
    ] {
        let layered = TAIL.replace("[drag]", "layers = [{ normal = [0.0, 1.0], offset_m = 0.1, thickness_m = 0.01, density_kg_m3 = 900.0, viscosity_pa_s = 1e-3 }]\n[drag]");
        let mut document = Document::new("tail.toml", layered);
        document.set(text).unwrap();
        let said = document.scene().unwrap_err().to_string();
        assert!(said.starts_with(&format!("override {text}: ")) && said.contains(problem), "{said}");
    }
}

#[test]
fn what_shows_at_the_start_alone_is_located_too() {
    let mut document = Document::new("tail.toml", TAIL);
    for text in ["solver.form=positions", "rod.nodes=1000001"] {
        document.set(text).unwrap();
    }
    let said = document.stepper(&document.scene().unwrap()).unwrap_err().to_string();
    assert!(said.starts_with("override rod.nodes=1000001: rod.nodes: "), "{said}");
}
