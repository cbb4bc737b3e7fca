//! Where forces hold: what is printed of a range is what runs and `check` are judged by.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;

use caudal::assessment::Assessment;
use caudal::fluid::laws::LAWS;
use caudal::fluid::validity::{DimensionlessNumber, TransverseMotion};
use caudal::report::Summary;
use caudal::run::{Ending, run as run_scene};
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use common::scene_of;
use std::ops::ControlFlow;

const TAIL: &str = r#"name = "ranges"
[rod]
nodes = 17
length_m = 0.2
outer_radius_m = 0.002
youngs_modulus_pa = 1e7
density_kg_m3 = 1000.0
[actuation]
kind = "travelling-wave"
kappa_amp = 10.0
frequency_hz = 1.0
wavelength_m = 0.2
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1000.0
[drag]
law = "cox"
[start]
kind = "shaped"
[solver]
integrator = "esdirk3"
time_step_s = 0.01
duration_s = 0.5
"#;

/// What `check` foresees of ranges, and what the run says of them.
fn said(scene: &Scene) -> [Vec<String>; 2] {
    let mut stepper = Stepper::of(scene).unwrap();
    let assessment = Assessment::of(scene, &stepper).unwrap();
    let outcome = run_scene(scene, &mut stepper, |_| Ok(ControlFlow::Continue(())));
    assert_eq!(outcome.ending, Ending::Complete);
    let summary = Summary::of(scene, &stepper, &outcome, &[]);
    let of_range = |notes: Vec<String>| notes.into_iter().filter(|note| note.contains(" outside ")).collect();
    [of_range(assessment.ranges), of_range(summary.notes)]
}

#[test]
fn every_law_s_own_range_is_judged_by_check_and_by_the_run_s_own_motion() {
    let inside: &[&[&str]] = &[
        &[],
        &["drag.law=lighthill"],
        &["drag.law=gray-hancock"],
        &["drag.law=spheroid"],
        &["drag.law=weak-inertia", "medium.viscosity_pa_s=2.0"],
        &["drag.law=cross-flow", "medium.viscosity_pa_s=1e-3"],
        &["drag.law=cross-flow", "medium.viscosity_pa_s=1e-4", "reactive.shedding=1.0"],
        &["drag={ law = \"wall\", height_m = 0.01 }"],
    ];
    for changes in inside {
        let [foreseen, measured] = said(&scene_of(TAIL, changes));
        assert!(foreseen.is_empty() && measured.is_empty(), "{changes:?}: {foreseen:?} {measured:?}");
    }
    let cases: &[(&[&str], &str, &str)] = &[
        (
            &["medium.viscosity_pa_s=1e-3"],
            "cox is outside its range: Reynolds number of the depth is",
            "\"cross-flow\"",
        ),
        (&["rod.outer_radius_m=0.025"], "length over radius is 8 (allowed: at least 10)", ""),
        (&["rod.outer_radius_m=0.008", "drag.law=lighthill"], "wavelength over radius is 25 ", ""),
        (&["drag.law=gray-hancock", "medium.viscosity_pa_s=1e-3"], "gray-hancock is outside", ""),
        (&["drag.law=spheroid", "medium.viscosity_pa_s=1e-3"], "spheroid is outside", ""),
        (
            &["drag={ law = \"stokes-like\", ratio = 2.0 }", "medium.viscosity_pa_s=1e-3"],
            "stokes-like is outside",
            "\"cross-flow\"",
        ),
        (&["drag.law=weak-inertia", "medium.viscosity_pa_s=1e-3"], "weak-inertia is outside", "ωa²/ν is 25.13"),
        (&["drag.law=cross-flow", "medium.viscosity_pa_s=1e-9"], "cross-flow is outside", "up to 1e5"),
        (
            &["drag.law=cross-flow", "reactive.shedding=1.0"],
            "reactive and wake are outside their range: fD²/ν is 0.016",
            "at least 100",
        ),
        (&["drag={ law = \"wall\", height_m = 0.1 }"], "wall is outside", "height over length is 0.5 "),
        (
            &["drag={ law = \"nonlocal\", height_m = 0.003 }", "medium.viscosity_pa_s=1e2"],
            "nonlocal is outside",
            "height over radius is 1.5 ",
        ),
        (&["drag.law=nonlocal", "medium.viscosity_pa_s=1e-3"], "Reynolds number of the length is", ""),
        (
            &["head_body={ semi_axis_along_m = 0.02, semi_axis_across_m = 0.02 }", "medium.viscosity_pa_s=0.1"],
            "head-body drag is outside its range: Reynolds number of the head body is",
            "",
        ),
    ];
    for (changes, name, more) in cases {
        for said in said(&scene_of(TAIL, changes)) {
            println!("{said:?}");
            assert!(said.iter().any(|note| note.contains(name) && note.contains(more)), "{changes:?}: {said:?}");
        }
    }
}

#[test]
fn every_printed_number_of_a_range_is_the_one_that_is_judged() {
    for law in LAWS {
        let words = law.validity.in_words();
        println!("{}: {words}", law.name);
        let reynolds = law.validity.bounds.iter().find(|bound| bound.number == DimensionlessNumber::Reynolds);
        for bound in law.validity.bounds {
            assert!(words.contains(&bound.to_string()), "{}: {words}", law.name);
        }
        // What chooses laws by their Reynolds number takes the same.
        if law.reynolds > 0.0 && law.reynolds.is_finite() && law.reynolds != caudal::fluid::laws::nonlocal::LAW.reynolds
        {
            let judged = reynolds.map(|bound| bound.most);
            assert!(judged == Some(law.reynolds) || law.validity.bounds.is_empty(), "{}: {judged:?}", law.name);
        }
    }
}

#[test]
fn a_run_judges_the_motion_that_it_has_made() {
    // A rod that is held across a stream: the velocity across it is the stream's.
    let stream =
        ["actuation.kappa_amp=0.0", "head.kind=clamped", "medium.flow_m_s=[0.0, 0.01]", "rod.youngs_modulus_pa=1e11"];
    let scene = scene_of(TAIL, &stream);
    let mut stepper = Stepper::of(&scene).unwrap();
    let outcome = run_scene(&scene, &mut stepper, |_| Ok(ControlFlow::Continue(())));
    assert_eq!(outcome.ending, Ending::Complete);
    let TransverseMotion { speed, per_depth, .. } = stepper.metrics().across().unwrap();
    println!("{speed} m/s, {per_depth} 1/m");
    assert!((speed / 0.01 - 1.0).abs() < 2e-3 && (per_depth / 10.0 - 1.0).abs() < 2e-3, "{speed} {per_depth}");
}

#[test]
fn a_passive_tail_whose_shape_is_taken_as_it_is_has_a_note() {
    let text = TAIL.replace(
        "[actuation]\nkind = \"travelling-wave\"\nkappa_amp = 10.0\nfrequency_hz = 1.0\nwavelength_m = 0.2\n",
        "",
    );
    let head = "head={ kind = \"driven\", angle_rad = { amplitude = 0.3, frequency_hz = 1.0 } }";
    let noted = |text: &str, model: &str| {
        let scene = scene_of(text, &[head, &format!("solver.model={model}")]);
        let warnings = Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().warnings;
        warnings.iter().any(|text| text.contains("a passive tail does not bend"))
    };
    assert!(noted(&text, "shape") && !noted(&text, "full") && !noted(TAIL, "shape"));
}

#[test]
fn waves_between_two_liquids_have_the_gravity_that_their_difference_leaves() {
    let beyond = |density: f64| {
        let layer = format!(
            "medium.beyond={{ normal = [0.0, -1.0], offset_m = 0.05, thickness_m = 0.02, viscosity_pa_s = 1e-3, density_kg_m3 = {density} }}"
        );
        let scene = scene_of(
            TAIL,
            &[&layer, "loads.gravity_m_s2=[0.0, -9.81]", "drag.law=cross-flow", "medium.density_kg_m3=900.0"],
        );
        let facts = Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().facts;
        let crossing = facts.into_iter().find(|fact| fact.name == "crossing").unwrap().text;
        let number = crossing.split("g′ = gΔρ/ρ = ").nth(1).unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
        println!("{crossing}");
        number
    };
    assert!((beyond(1000.0) / 0.981 - 1.0).abs() < 1e-3 && (beyond(1800.0) / 4.905 - 1.0).abs() < 1e-3);
}

#[test]
fn every_law_that_a_range_advises_is_taken_by_the_scene() {
    let rectangle = ["rod.section=rectangle", "rod.depth_m=0.03", "medium.viscosity_pa_s=1e2"];
    let scenes: [&[&str]; 3] = [
        &["medium.viscosity_pa_s=1e-3"],
        &rectangle,
        &["drag={ law = \"stokes-like\", ratio = 2.0 }", "medium.viscosity_pa_s=1e-3"],
    ];
    let mut advised = 0;
    for changes in scenes {
        let scene = scene_of(TAIL, changes);
        for notes in said(&scene) {
            for law in LAWS {
                if notes
                    .iter()
                    .any(|note| note.contains(&format!("\"{}\"", law.name)) && note.contains("is valid there"))
                {
                    assert!(scene.with_fluid(law, false).is_ok(), "{changes:?}: {}: {notes:?}", law.name);
                    advised += 1;
                }
            }
        }
    }
    assert!(advised > 0);
}

#[test]
fn an_ellipse_or_a_membrane_stands_above_the_wall_by_its_depth() {
    let beside = |height: f64, section: &str| {
        let mut document = caudal::scene::Document::new("wall.toml", TAIL);
        let height = format!("drag={{ law = \"wall\", height_m = {height} }}");
        for change in [section, "rod.depth_m=0.02", "medium.viscosity_pa_s=1e2", &height] {
            document.set(change).unwrap();
        }
        document.scene()
    };
    for section in ["rod.section=ellipse", "rod.section=round"] {
        let error = beside(0.0099, section).unwrap_err().to_string();
        assert!(error.contains("drag.height_m") && error.contains("across the plane of motion"), "{error}");
        beside(0.0101, section).unwrap();
    }
}

#[test]
fn laws_are_compared_on_a_coarse_rod_whatever_the_mesh_and_where_they_allow_it() {
    let facts = |changes: &[&str]| {
        let scene = scene_of(include_str!("../../models/cantilever.toml"), changes);
        Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().facts
    };
    let compared = |changes: &[&str]| {
        facts(changes).into_iter().find(|fact| fact.name == "other valid laws").map(|fact| fact.text)
    };
    const SYRUP: &str = "medium.viscosity_pa_s=50.0";
    let coarse = compared(&[SYRUP]).unwrap();
    println!("{coarse}");
    assert!(coarse.contains("nonlocal"));
    // A nonlocal matrix of this mesh would have 64 million entries.
    assert_eq!(compared(&[SYRUP, "rod.nodes=4001"]), Some(coarse));
    // As thick as this, its blobs are longer than 33 nodes are apart.
    let thick = compared(&[SYRUP, "rod.outer_radius_m=0.03", "rod.youngs_modulus_pa=1e6"]).unwrap_or_default();
    assert!(!thick.contains("nonlocal"), "{thick}");
}

#[test]
fn a_motion_is_compared_in_digits_where_the_run_and_the_change_give_them_a_meaning() {
    let lines = |text: &str, changes: &[&str]| -> Vec<String> {
        let scene = scene_of(text, &[&["rod.nodes=33"], changes].concat());
        let found = Assessment::fluid_models(&scene, &Stepper::of(&scene).unwrap()).into_iter();
        found.filter(|line| line.name != "fluid chosen").map(|line| line.text).collect()
    };
    // Two beats take 1 s.
    const FINE: &str = include_str!("../../models/fine-1e3.toml");
    for duration in ["solver.duration_s=0.002", "solver.duration_s=0.1", "solver.duration_s=0.99"] {
        let short = lines(FINE, &[duration]);
        println!("{short:?}");
        assert_eq!(short.len(), 2);
        assert!(short[0].ends_with("is shorter than two beats of 0.500 s each, so all of it belongs to the start"));
        assert!(short[1].starts_with("it lowers the natural frequencies"));
    }
    // Drag of the study is a thousandth of what holds: the rod hardly swims.
    let weak = lines(FINE, &["solver.duration_s=1.0"]).pop().unwrap();
    println!("{weak}");
    assert!(weak.contains("the speed would grow more than tenfold and the power would grow more than tenfold"));
    let eel = lines(include_str!("../../models/eel.toml"), &[]).pop().unwrap();
    println!("{eel}");
    assert!(eel.contains("the speed would change by -8.8 % and the power would change by -0.9 %"));
}

#[test]
fn a_run_is_told_what_check_warns_of_and_no_facts() {
    for changes in [&[][..], &["solver.time_step_s=0.1"], &["start.kind=jump", "rod.nodes=301"]] {
        let scene = scene_of(TAIL, changes);
        let stepper = Stepper::of(&scene).unwrap();
        let [check, run] = [Assessment::of(&scene, &stepper), Assessment::of_run(&scene, &stepper)].map(Result::unwrap);
        assert_eq!(check.warnings, run.warnings);
        assert!(!check.facts.is_empty() && run.facts.is_empty() && run.ranges.is_empty());
    }
}
