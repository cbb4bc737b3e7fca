//! What of a design is trusted: gains that survive, tolerances that cost what they say, and a body that can be printed.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::collections::BTreeMap;
use std::ops::ControlFlow;

use caudal::design::{Answer, Design, stl};
use caudal::scene::Document;
use caudal::sensitivity::Problem;
use caudal::stepper::Stepper;
use common::rod;

fn document(changes: &[&str]) -> Document {
    let mut document = Document::read("models/eel.toml".as_ref()).unwrap();
    let coarse =
        ["rod.nodes=9", "solver.time_step_s=0.01", "solver.duration_s=2.5", "solver.integrator=generalized-alpha"];
    coarse.iter().chain(changes).for_each(|change| document.set(change).unwrap());
    document
}

fn design(document: &Document) -> Design {
    Design::of(document, |_| ControlFlow::Continue(())).unwrap_or_else(|error| panic!("{error}"))
}

/// The goal of the designed scene with `changes`.
fn measured(text: &str, changes: &[String]) -> f64 {
    let mut document = Document::new("designed.toml", text);
    changes.iter().for_each(|change| document.set(change).unwrap());
    let measure = caudal::cycle::MEASURES.into_iter().find(|measure| measure.key == "cycle_efficiency").unwrap();
    let mut problem = Problem::of(&document.scene().unwrap()).unwrap();
    problem.cycle_mean(&measure, &[]).unwrap().unwrap().0
}

#[test]
fn a_tolerance_costs_one_per_cent() {
    let wanted = r#"design={ goal = "cycle_efficiency", variables = ["actuation.wavelength_m", "actuation.kappa_amp", "rod.depth_m"], number_bounds = [0.6, 1.6], starts = 1 }"#;
    let design = design(&document(&[wanted]));
    let folder = tempfile::tempdir().unwrap();
    design.write(folder.path()).unwrap().complete().unwrap();
    let text = std::fs::read_to_string(folder.path().join("eel-designed.toml")).unwrap();
    let Answer::Search(found) = &design.answer else { panic!("found") };
    assert!(found.tolerances.len() == 6, "{:?}", found.tolerances);
    let own = measured(&text, &[]);
    let scene = Document::new("designed.toml", &text[..]).scene().unwrap();
    let mut seen = 0;
    for tolerance in &found.tolerances {
        let (Some(number), Some(change)) =
            (scene.parameters().into_iter().find(|number| number.key == tolerance.name), tolerance.change)
        else {
            continue;
        };
        // To one side or the other, alone.
        let lost = [1.0, -1.0].map(|side| {
            let value = number.value * (side * change).exp();
            1.0 - measured(&text, &[format!("{}={value:e}", number.key)]) / own
        });
        let worse = lost[0].max(lost[1]);
        println!("{}: {change:.4} costs {worse:.5}", tolerance.name);
        assert!((worse - 0.01).abs() <= 4e-4, "{tolerance:?}: {lost:?}"); // the search for it ends within 2e-4
        seen += 1;
    }
    assert!(seen >= 1, "{:?}", found.tolerances);
    assert!(design.lines.iter().any(|line| line.starts_with("tolerance for a 1 % loss")), "{:?}", design.lines);
}

/// Triangles of an STL, in metres.
fn triangles(text: &str) -> Vec<[[f64; 3]; 3]> {
    let corners: Vec<[f64; 3]> = text
        .lines()
        .filter_map(|line| line.strip_prefix("vertex "))
        .map(|line| {
            let mut numbers = line.split(' ').map(|x| 1e-3 * x.parse::<f64>().unwrap());
            std::array::from_fn(|_| numbers.next().unwrap())
        })
        .collect();
    corners.as_chunks::<3>().0.to_vec()
}

#[test]
fn the_body_is_a_closed_surface_around_the_rod_s_volume() {
    for (changes, tolerance) in [
        // Sections are polygons of 48 corners: 0.29 % less than ellipses.
        (&["rod.outer_radius_m=0.01", "rod.depth_m=0.03"][..], 0.004),
        (&["rod.outer_radius_m=0.01", "rod.inner_radius_m=0.006", "rod.depth_m=0.03"], 0.004),
        // Of a round core with a membrane it is the core; a rectangle is one.
        (&["rod.section=round", "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.006", "rod.depth_m=0.03"], 0.004),
        (&["rod.section=rectangle", "rod.outer_radius_m=0.004", "rod.depth_m=0.03"], 1e-9),
        (&["rod.section=rectangle", "rod.outer_radius_m=0.01", "rod.inner_radius_m=0.006", "rod.depth_m=0.03"], 1e-9),
        (&[], 0.004),
    ] {
        let rod = rod(&document(changes).scene().unwrap());
        let all = triangles(&stl::stl("body", &rod));
        let mut edges: BTreeMap<[[u64; 3]; 2], i32> = BTreeMap::new();
        let bits = |x: [f64; 3]| x.map(|x| (x + 0.0).to_bits());
        let mut volume = 0.0;
        for [a, b, c] in &all {
            let cross = [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
            volume += (0..3).map(|i| a[i] * cross[i]).sum::<f64>() / 6.0;
            for [from, to] in [[a, b], [b, c], [c, a]] {
                *edges.entry([bits(*from), bits(*to)]).or_default() += 1;
                *edges.entry([bits(*to), bits(*from)]).or_default() -= 1;
            }
        }
        assert!(edges.values().all(|count| *count == 0), "an open edge");
        // The volume of the material: what is printed weighs what swims.
        let expected = rod.sections.mean(0.0, 1.0, |xi| rod.sections.at(xi).area()) * rod.length;
        println!("{} triangles, {:.5} of the volume", all.len(), volume / expected);
        assert!((volume / expected - 1.0).abs() <= tolerance, "{volume:e} {expected:e}");
    }
}

/// The eel in the law of creeping flow, a rung below that of its water.
fn eel_in_creeping_flow(changes: &[&str]) -> Document {
    let text = std::fs::read_to_string("models/eel.toml").unwrap();
    let text = text.replace("[reactive]", "").replace("law = \"cross-flow\"", "law = \"cox\"");
    common::document_of(
        "eel.toml",
        &text,
        &[&["solver.time_step_s=0.01", "solver.integrator=generalized-alpha"], changes].concat(),
    )
}

#[test]
fn a_gain_that_the_next_fluid_does_not_leave_is_said_to_be_none() {
    let document = eel_in_creeping_flow(&[
        "rod.nodes=9",
        "solver.duration_s=2.5",
        r#"design={ goal = "cycle_forward_speed_m_s", variables = ["rod.youngs_modulus_pa"], number_bounds = [0.5, 2.0], starts = 1 }"#,
    ]);
    let design = design(&document);
    let numbers = design.numbers().unwrap();
    let trust = &numbers["trust"];
    // Measured: +4.68 % as designed, -1.15 % with drag that has inertia.
    assert!(trust["gain_percent"].as_f64().unwrap() > 4.0, "{trust}");
    assert!(trust["least_percent"].as_f64().unwrap() < 0.0 && trust["survives"] == false, "{trust}");
    assert_eq!(trust["least_in"], "the law cross-flow");
    assert!(design.lines.iter().any(|line| line.starts_with("no gain: 4.")), "{:?}", design.lines);
}

#[test]
fn limits_are_looked_at_in_every_simulation_and_in_what_is_compared() {
    let document = eel_in_creeping_flow(&[
        "rod.nodes=9",
        "solver.duration_s=2.5",
        r#"design={ goal = "cycle_forward_speed_m_s", variables = ["rod.youngs_modulus_pa", "actuation.kappa_amp"], number_bounds = [0.2, 2.0], starts = 1, largest_power_w = 0.05 }"#,
    ]);
    let design = design(&document);
    let numbers = design.numbers().unwrap();
    // Measured: 100.00 % of the limit as designed, 131.8 % with 17 nodes, and 225.2 % of the scene's own.
    let used = |i: usize, of: &str| numbers["checks"][i][of]["used"].as_f64().unwrap();
    assert!(
        (used(0, "limit") - 1.0).abs() < 1e-6 && used(3, "limit") > 1.2 && used(0, "limit_before") > 2.0,
        "{numbers}"
    );
    assert_eq!(numbers["trust"]["survives"], false);
    let said = |words: &[&str]| design.lines.iter().any(|line| words.iter().all(|word| line.contains(word)));
    assert!(said(&["the limits are violated in other simulations: power", "with 17 nodes"]), "{:?}", design.lines);
    assert!(said(&["the scene's own: ", "but it breaks a limit: power", "225."]), "{:?}", design.lines);
}

#[test]
fn in_creeping_flow_the_next_fluid_is_that_of_the_whole_rod() {
    let document = eel_in_creeping_flow(&[
        "rod.nodes=17",
        "solver.duration_s=1.5",
        "medium.viscosity_pa_s=1e3",
        r#"design={ goal = "cycle_forward_speed_m_s", variables = ["actuation.kappa_amp"], number_bounds = [0.5, 2.0], starts = 1 }"#,
    ]);
    let design = design(&document);
    let numbers = design.numbers().unwrap();
    let check = numbers["checks"].as_array().unwrap().last().unwrap();
    let folder = tempfile::tempdir().unwrap();
    design.write(folder.path()).unwrap().complete().unwrap();
    let mut designed = Document::read(&folder.path().join("eel-designed.toml")).unwrap();
    designed.set("drag.law=nonlocal").unwrap();
    let scene = designed.scene().unwrap();
    let mut stepper = Stepper::of(&scene).unwrap();
    stepper.do_step(1.5).unwrap();
    let mean = stepper.cycles().averages(stepper.view().dynamics).mean(&caudal::cycle::FORWARD_SPEED).unwrap();
    println!("{check}, by itself {mean:e}; {:?}", numbers["trust"]);
    assert_eq!(check["simulation"], "the law nonlocal");
    let own = check["designed"].as_f64().unwrap();
    assert!((own / mean - 1.0).abs() <= 1e-6, "{own:e} {mean:e}");
    // Drag of the whole rod is another one, but the gain is there.
    let local = numbers["checks"][0]["designed"].as_f64().unwrap();
    assert!((own / local - 1.0).abs() > 0.01 && numbers["trust"]["survives"] == true, "{own:e} {local:e}");
}

/// A muscle-driven eel, whose own motion is not periodic after 2.5 s, with a goal over its cycles.
fn muscles(changes: &[&str]) -> Document {
    let mut document = Document::read("models/muscle-eel.toml".as_ref()).unwrap();
    let wanted = r#"design={ goal = "cycle_forward_speed_m_s", variables = ["stiffness"], knots = [0.05, 0.5, 0.95], bounds = [0.05, 5.0], starts = 1, iterations = 1 }"#;
    let coarse = ["rod.nodes=9", "solver.duration_s=2.5", wanted];
    coarse.iter().chain(changes).for_each(|change| document.set(change).unwrap());
    document
}

#[test]
fn a_design_says_what_is_not_periodic_yet_in_both_runs_and_what_they_note() {
    let found = design(&muscles(&[]));
    for whose in ["the scene's own motion is not periodic yet: ", "its motion is not periodic yet: "] {
        assert!(found.lines.iter().any(|line| line.starts_with(whose)), "{whose}: {:#?}", found.lines);
    }
    // An edge that turns by a quarter of a right angle and more within a step is noted by a run, and so by the design of it.
    let long_steps = muscles(&["solver.time_step_s=0.05"]);
    let found = design(&long_steps);
    let of = |whose: &str| found.lines.iter().filter(|line| line.starts_with(&format!("of {whose}: "))).count();
    assert!(of("the scene's own") > 0 && of("the design") > 0, "{:#?}", found.lines);
    let first = found.lines.iter().position(|line| !line.starts_with("of ")).unwrap();
    assert_eq!(first, of("the scene's own") + of("the design"), "what questions the answer comes first");
}

#[test]
fn distance_squared_over_work_is_refused_in_a_flow_and_says_its_formula_elsewhere() {
    let wanted = r#"design={ goal = "efficiency", direction = "-x", variables = ["actuation.kappa_amp"], number_bounds = [0.8, 1.2], starts = 1, iterations = 2 }"#;
    for flow in [
        "medium.flow_m_s=[0.5, 0.0]",
        "medium.flow_m_s={ amplitude = [0.1, 0.0], frequency_hz = 1.0 }",
        "medium.shear={ rate_per_s = 0.5, normal = [0.0, 1.0] }",
    ] {
        let document = eel_in_creeping_flow(&[wanted, flow]);
        let error = Design::of(&document, |_| ControlFlow::Continue(())).unwrap_err().to_string();
        assert!(error.contains("in a flow") && error.contains("cycle_efficiency"), "{flow}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    design(&document(&[wanted])).write(folder.path()).unwrap().complete().unwrap();
    let page = std::fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.contains("D is the displacement of the centre of mass along -x from the start to the end"), "{page}");
}

#[test]
fn the_stiffness_of_a_design_is_drawn_over_the_largest_of_the_sections() {
    let folder = tempfile::tempdir().unwrap();
    let found = design(&muscles(&[]));
    found.write(folder.path()).unwrap().complete().unwrap();
    let read = |file: &str| std::fs::read_to_string(folder.path().join(file)).unwrap();
    assert!(read("profile.svg").contains(">EI over the largest EI of the sections</text>"));
    let rod = muscles(&[]).scene().unwrap().model().unwrap().rod;
    let largest = (0..rod.nodes).map(|k| rod.section_stiffness(k)).fold(0.0, f64::max);
    let numbers: serde_json::Value = serde_json::from_str(&read("design.json")).unwrap();
    let reference = numbers["reference_stiffness_n_m2"].as_f64().unwrap();
    assert!((reference / largest - 1.0).abs() < 1e-12, "{reference} {largest}");
    assert!(
        reference > 5.0 * rod.section_stiffness(0),
        "the sections differ, so that the head would be another reference"
    );
}
