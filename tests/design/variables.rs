//! Any number of a scene is a variable of a design: its derivatives are exact in every law, with added mass, in layers, behind a
//! body and behind a held head.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use std::ops::ControlFlow;

use caudal::design::{Design, DesignTable, DesignVector, Objective};
use caudal::fluid::laws::{Dependence, LAWS};
use caudal::scene::{Document, Scene};
use caudal::sensitivity::Problem;

/// A tapered tube, deeper than broad towards its end.
const EEL: &str = r#"
name = "eel"
[rod]
nodes = 7
length_m = 0.4
outer_radius_m = [[0.0, 0.011], [0.35, 0.013], [1.0, 0.008]]
inner_radius_m = 0.003
depth_m = [[0.0, 0.03], [0.6, 0.04], [1.0, 0.05]]
youngs_modulus_pa = 2e6
density_kg_m3 = [[0.0, 1100.0], [1.0, 1050.0]]
stiffness_gradient = 0.4
[actuation]
kind = "travelling-wave"
kappa_amp = 8.0
frequency_hz = 2.0
wavelength_m = 0.37
envelope = [0.3, 0.7]
[medium]
viscosity_pa_s = 0.3
density_kg_m3 = 1000.0
[solver]
integrator = "generalized-alpha"
time_step_s = 0.01
duration_s = 0.13
newton_tolerance = 1e-14
[drag]
"#;

const LAYERS: &str = "medium.beyond={ normal = [0.0, 1.0], offset_m = 0.01, thickness_m = 0.2, viscosity_pa_s = 0.1, density_kg_m3 = 700.0 }";
const DRIVEN: &str =
    "head={ kind = \"driven\", position_m = { amplitude = [0.0, 0.02], frequency_hz = 2.0 }, angle_rad = 0.1 }";

/// What goes with each law: water that the rod accelerates, layers, a body, gravity.
const SURROUNDINGS: [&[&str]; 4] = [
    &[],
    &["reactive={ shedding = 0.8 }", "loads={ gravity_m_s2 = [0.3, -2.0], buoyancy = true }"],
    &["reactive={ shedding = 0.8 }", LAYERS, "loads={ gravity_m_s2 = [0.0, -2.0], buoyancy = true }"],
    &["reactive={ shedding = 0.8 }", "head_body={ semi_axis_along_m = 0.03, semi_axis_across_m = 0.02 }"],
];

fn document(changes: &[&str]) -> Document {
    let mut document = Document::new("eel.toml", EEL);
    changes.iter().for_each(|change| document.set(change).unwrap());
    document
}

/// Every number of a scene that may be a variable, as `variables`.
fn every_variable(scene: &Scene) -> Vec<String> {
    let numbers = scene.parameters();
    let keys = numbers.iter().filter(|number| number.value != 0.0).map(|number| number.key.as_str());
    let mut keys: Vec<String> = keys.chain(scene.profiles().iter().map(|points| points.key)).map(Into::into).collect();
    keys.dedup();
    let allowed = |key: &String| {
        let mut scene = scene.clone();
        let variables = toml::Value::Array(vec![toml::Value::String(key.clone())]);
        scene.design.as_mut().unwrap().insert("variables".into(), variables);
        DesignTable::of(&scene).is_ok()
    };
    keys.retain(allowed);
    keys
}

/// The largest error of the derivatives of the goal by all numbers, against differences of whole simulations, over the largest
/// of all; and how many numbers.
fn worst(changes: &[&str]) -> (f64, usize, String) {
    // Where a velocity passes zero some laws have no second derivative, and differences no order: they must not reach there.
    let step = if changes.iter().any(|change| change.contains("cross-flow")) { 3e-5 } else { 3e-4 };
    worst_of(document(changes), step)
}

fn worst_of(mut document: Document, step: f64) -> (f64, usize, String) {
    if document.scene().unwrap().design.is_none() {
        document.set("design={ goal = \"efficiency\", direction = \"-x\" }").unwrap();
    }
    let variables = every_variable(&document.scene().unwrap());
    document.set(&format!("design.variables={variables:?}")).unwrap();
    let scene = document.scene().unwrap();
    let table = DesignTable::of(&scene).unwrap();
    let mut problem = Problem::of(&scene).unwrap();
    let objective = Objective::new(&table, &problem, None).unwrap().of_document(&document);
    let own = DesignVector {
        numbers: table.initial_numbers(),
        stiffness_n_m2: Vec::new(),
        ..DesignVector::of(problem.stiffness())
    };
    let parameters: Vec<_> = table.numbers.iter().map(|number| number.by).collect();
    let (value, exact) = objective.derivatives(&mut problem, &own, &parameters).unwrap();
    let mut central = |i: usize, by: f64| {
        let mut at = |by: f64| {
            let mut profile = own.clone();
            profile.numbers[i].1 *= 1.0 + by;
            objective.measure(&mut problem, &profile).unwrap()
        };
        (at(by) - at(-by)) / (2.0 * by)
    };
    let own_size = |i: usize| own.numbers[i].1;
    let largest = exact.iter().enumerate().fold(value.abs(), |max, (i, by)| max.max((by * own_size(i)).abs()));
    let mut worst = (0.0, exact.len(), String::new());
    for (i, by) in exact.iter().enumerate() {
        // Of sixth order.
        let [a, b, c] = [1.0, 2.0, 3.0].map(|times| central(i, step * times));
        let error = (by * own_size(i) - (1.5 * a - 0.6 * b + 0.1 * c)).abs() / largest;
        if error > worst.0 {
            worst = (error, exact.len(), table.numbers[i].label());
        }
    }
    worst
}

#[test]
fn derivatives_by_all_numbers_of_a_scene_are_those_of_differences_in_every_law() {
    let mut count = 0;
    for law in LAWS.iter().filter(|law| matches!(law.reach, Dependence::Edge) && law.name != "auto") {
        let name = format!("drag.law={}", law.name);
        let needs = law.needs.iter().map(|key| match *key {
            "height_m" => "drag.height_m=0.03",
            "ratio" => "drag.ratio=1.8",
            "along_n_s_m2" => "drag.along_n_s_m2=[[0.0, 1.0], [1.0, 1.4]]",
            "across_n_s_m2" => "drag.across_n_s_m2=2.0",
            key => panic!("{key}"),
        });
        let own: Vec<&str> = std::iter::once(&name[..]).chain(needs).collect();
        for surroundings in SURROUNDINGS {
            let changes = [&own[..], surroundings].concat();
            if document(&changes).scene().and_then(|scene| scene.model()).is_err() {
                continue; // a law that does not hold there
            }
            let (error, numbers, which) = worst(&changes);
            println!("{} {}: {error:.1e} over {numbers} numbers, worst {which}", law.name, surroundings.len());
            assert!(error <= 1e-8, "{changes:?}: {error:e} {which}"); // measured: 1.7e-9
            count += 1;
        }
    }
    assert!(count >= 3 * (LAWS.len() - 2), "{count}");
    let held = [
        DRIVEN,
        "drag.law=cross-flow",
        "reactive={ shedding = 0.8 }",
        "design={ goal = \"cycle_head_power_w\" }",
        "solver.duration_s=1.1",
        // Cycles end within steps: between them integrals have no second derivative by the frequency.
        "solver.time_step_s=0.0105",
    ];
    let (error, numbers, which) = worst(&held);
    println!("held {error:.1e} over {numbers}, worst {which}");
    assert!(error <= 1e-8, "{error:e}");
    for goal in ["cycle_efficiency", "cycle_cost_of_transport", "cycle_slip", "cycle_body_lengths"] {
        let goal = format!("design={{ goal = \"{goal}\" }}");
        let (error, numbers, which) =
            worst(&[&goal, "reactive={ shedding = 0.8 }", "solver.duration_s=1.1", "solver.time_step_s=0.0105"]);
        println!("{goal} {error:.1e} over {numbers}, worst {which}");
        assert!(error <= 1e-8, "{error:e}");
    }
}

#[test]
fn derivatives_by_the_shape_of_a_wave_are_those_of_differences() {
    let travelling = "kind = \"travelling-wave\"\nkappa_amp = 8.0\n";
    for (wave, keys) in [
        ("kind = \"sine-wave\"\nslope = 0.8\n", &["actuation.slope", "actuation.wavelength_m"][..]),
        (&format!("{travelling}harmonics = [0.3, -0.2]\n"), &["actuation.harmonics", "actuation.kappa_amp"]),
    ] {
        let mut document = Document::new("eel.toml", EEL.replace(travelling, wave));
        document.set("drag.law=cox").unwrap();
        document.set("design={ goal = \"efficiency\", direction = \"-x\" }").unwrap();
        let variables = every_variable(&document.scene().unwrap());
        assert!(keys.iter().all(|key| variables.iter().any(|own| own == key)), "{variables:?}");
        let (error, numbers, which) = worst_of(document, 2e-4); // crests are sharp: 1e-5 at 1e-3, which is the differences' own
        println!("{wave} {error:.1e} over {numbers}, worst {which}");
        assert!(error <= 1e-8, "{wave}: {error:e} {which}"); // measured: 5.3e-10
    }
}

/// A design's scenes keep the fluid that its own scene takes, whatever its numbers are, and the designed scene names it.
#[test]
fn a_design_keeps_the_fluid_that_its_scene_takes() {
    let wanted = r#"design={goal="cycle_actuation_power_w",better="smaller",variables=["medium.viscosity_pa_s"],number_bounds=[0.001,1000.0],starts=1,iterations=1}"#;
    let mut document = Document::read("models/eel.toml".as_ref()).unwrap();
    for change in
        ["rod.nodes=9", "solver.time_step_s=0.01", "solver.duration_s=1.1", "drag.law=auto", "reactive=auto", wanted]
    {
        document.set(change).unwrap();
    }
    let taken = |scene: &Scene| {
        let (law, reactive) = scene.fluid_model(&scene.model().unwrap().rod);
        (law.unwrap().name, reactive)
    };
    let own = document.scene().unwrap();
    let (law, reactive) = taken(&own);
    // With so thick a fluid it takes another by itself.
    let mut thick = document.clone();
    thick.set("medium.viscosity_pa_s=1.0").unwrap();
    assert_ne!(taken(&thick.scene().unwrap()), (law, reactive));
    thick.keep_fluid_of(&own);
    assert_eq!(taken(&thick.scene().unwrap()), (law, reactive));
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let files = design.write(folder.path()).unwrap().complete().unwrap();
    let path = files.iter().find(|path| path.ends_with("eel-designed.toml")).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(&format!("law = \"{law}\"")) && !text.contains("\"auto\""), "{text}");
    assert_eq!(text.contains("[reactive]"), reactive, "{text}");
}

/// Asserts that `design` was simulated again beside the same scene, its own, that it is compared with, and says so in the same words.
fn before_is_the_same_of(design: &Design) {
    let numbers = design.numbers().unwrap();
    let own = &numbers["compared"][0];
    assert_eq!(own["name"], "the scene's own");
    let (objective, check) = (own["objective"].as_f64().unwrap(), &numbers["checks"][0]);
    let before = check["before"].as_f64().unwrap();
    assert!((before / objective - 1.0).abs() < 1e-9, "{before} {objective}");
    let line = |start: &str| design.lines.iter().find(|line| line.starts_with(start)).unwrap();
    let [again, compared] = [line("simulated again, as designed: "), line("the scene's own: ")];
    let gain = compared.split_once("; the design is ").unwrap().1;
    let same = ["better", "worse"]
        .iter()
        .fold(gain.to_string(), |gain, word| gain.replace(word, &format!("{word} than the scene's own")));
    assert!(again.ends_with(&same), "{again}\n{compared}");
    let other = |line: &&String| ["before", "original"].iter().any(|word| line.contains(word));
    assert_eq!(design.lines.iter().find(other), None);
}

/// Of a design for several cases too, in all of which the scene is as it is but for what the case changes.
#[test]
fn before_is_the_scenes_own_in_all_cases() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy("models/design-silicone-eel.toml", folder.path().join("eel.toml")).unwrap();
    let axes = "scene = \"eel.toml\"\n[axes]\n\"medium.viscosity_pa_s\" = { factors = [0.5, 2.0] }\n";
    std::fs::write(folder.path().join("cases.toml"), axes).unwrap();
    let mut document = Document::read(&folder.path().join("eel.toml")).unwrap();
    let wanted = r#"design={goal="distance",direction="-x",knots=[0.1,0.9],mean=0.5,bounds=[0.2,2.0],starts=1,iterations=3,over="cases.toml"}"#;
    let changes =
        ["rod.nodes=5", "solver.duration_s=2.0", "solver.time_step_s=0.01", "rod.stiffness_gradient=0.5", wanted];
    changes.iter().for_each(|change| document.set(change).unwrap());
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    before_is_the_same_of(&design);
    let numbers = design.numbers().unwrap();
    let of_cases = numbers["cases"].as_array().unwrap().iter().map(|case| case["before"].as_f64().unwrap());
    let worst = of_cases.fold(f64::INFINITY, f64::min);
    assert!((worst / numbers["checks"][0]["before"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{worst}");
}

/// What a design is compared with is the scene as it is, on every line; even stiffness of its mean is another profile, by its name.
#[test]
fn before_is_the_scenes_own_everywhere() {
    let mut document = Document::read("models/design-silicone-eel.toml".as_ref()).unwrap();
    let wanted =
        r#"design={goal="distance",direction="-x",knots=[0.1,0.9],mean=0.5,bounds=[0.2,2.0],starts=1,iterations=3}"#;
    for change in
        ["rod.nodes=5", "solver.duration_s=2.0", "solver.time_step_s=0.01", "rod.stiffness_gradient=0.5", wanted]
    {
        document.set(change).unwrap();
    }
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let own = Problem::of(&document.scene().unwrap()).unwrap().stiffness();
    let numbers = design.numbers().unwrap();
    let compared = numbers["compared"].as_array().unwrap();
    assert_eq!(compared[0]["name"], "the scene's own");
    let reference = numbers["reference_stiffness_n_m2"].as_f64().unwrap();
    let even =
        compared.iter().find(|profile| profile["name"].as_str().unwrap().starts_with("even stiffness of ")).unwrap();
    let mut stiffness = even["profile"]["stiffness_n_m2"].as_array().unwrap().iter().map(|ei| ei.as_f64().unwrap());
    assert!(stiffness.all(|ei| (ei / (0.5 * reference) - 1.0).abs() < 1e-12), "{even}");
    let stiffness: Vec<f64> = serde_json::from_value(compared[0]["profile"]["stiffness_n_m2"].clone()).unwrap();
    assert!(stiffness.iter().zip(&own).all(|(a, b)| (a / b - 1.0).abs() < 1e-12), "{stiffness:?} {own:?}");
    before_is_the_same_of(&design);
}
