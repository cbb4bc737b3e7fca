//! Numbers of a scene as unknowns: exact derivatives, recovery beside stiffness, deviations that hold, and what data cannot tell
//! apart is said.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::ops::ControlFlow;

use caudal::design::{
    Answer, Design, DesignTable, DesignVector, Identifiability, Markers, Objective, Search, SearchResult,
};
use caudal::fluid::laws::{DragLaw, LAWS};
use caudal::scene::Document;
use caudal::sensitivity::{Output, Parameter, Problem};
use common::{Dice, largest};

/// A tail whose head is free, or turned by a motor.
const TAIL: &str = r#"
name = "tail"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.004
inner_radius_m = 0.0
youngs_modulus_pa = 1e6
density_kg_m3 = 1100.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[solver]
integrator = "generalized-alpha"
time_step_s = 5e-3
duration_s = 2.0
newton_tolerance = 1e-14
[design]
goal = "identify"
bounds = [0.05, 20.0]
number_bounds = [0.05, 20.0]
"#;

const DRIVEN: &str = r#"head={ kind = "driven", angle_rad = { amplitude = 0.6, frequency_hz = 1.0 } }"#;
const COEFFICIENTS: &str = r#"drag={ law = "coefficients", along_n_s_m2 = 3.0, across_n_s_m2 = 3.0 }"#;

fn document(changes: &[&str]) -> Document {
    let mut document = Document::new("tail.toml", TAIL);
    let needs_data = !changes.contains(&"design.goal=distance");
    let data = needs_data.then_some("design.data=markers.csv");
    changes.iter().copied().chain(data).for_each(|change| document.set(change).unwrap());
    document
}

/// Positions at every fourth step, as the scene moves.
fn clean(document: &Document) -> Markers {
    let motion = Problem::of(&document.scene().unwrap()).unwrap().simulate().unwrap();
    let every = (0..motion.times.len()).step_by(4);
    Markers {
        times: every.clone().map(|n| motion.times[n]).collect(),
        positions: every.map(|n| motion.positions(n).to_vec()).collect(),
        ..Markers::default()
    }
}

/// Normal noise of `sigma` (m): a sum of twelve uniform numbers.
fn noisy(markers: &Markers, sigma: f64, dice: &mut Dice) -> Markers {
    let mut noisy = markers.clone();
    for x in noisy.positions.iter_mut().flatten() {
        *x += sigma * dice.many(12, -0.5, 0.5).iter().sum::<f64>();
    }
    noisy
}

fn identified(document: &Document, markers: &Markers) -> SearchResult {
    let scene = document.scene().unwrap();
    let table = DesignTable::of(&scene).unwrap_or_else(|fault| panic!("{fault:?}"));
    let problem = Problem::of(&scene).unwrap();
    let objective = Objective::new(&table, &problem, Some(markers)).unwrap().of_document(document);
    let mut search = Search::new(&table, &objective, problem);
    search.run(|_| ControlFlow::Continue(())).unwrap()
}

/// A law with a number for each of its coefficients, in a scene in which all of them count.
fn law_of(law: &DragLaw) -> String {
    let values = [
        ("ratio", "2.5"),
        ("along_n_s_m2", "2.0"),
        ("across_n_s_m2", "4.0"),
        ("height_m", "0.05"),
        ("form_drag", "1.3"),
        ("skin_friction", "3.0"),
    ];
    let given = values.iter().filter(|(key, _)| law.keys.contains(key));
    let given: String = given.map(|(key, value)| format!(", {key} = {value}")).collect();
    format!("drag={{ law = \"{}\"{given} }}", law.name)
}

#[test]
fn derivatives_by_every_number_of_every_law_are_those_of_whole_simulations() {
    const WAVE: &str = r#"actuation={ kind = "travelling-wave", kappa_amp = 4.0, frequency_hz = 1.5, wavelength_m = 0.3, envelope = [0.5, 0.5] }"#;
    // No velocity against the fluid passes zero, where some laws have no second derivative and differences no order.
    const CURRENT: [&str; 3] =
        ["medium.flow_m_s=[-0.2, 0.6]", "loads={ gravity_m_s2 = [10.0, -40.0] }", "rod.youngs_modulus_pa=1e9"];
    let (mut worst, mut count) = (0.0_f64, 0);
    for law in LAWS.iter().filter(|law| !law.is_nonlocal()) {
        // The slopes of weak inertia jump where its length stops at its limit, which is far outside its range.
        let viscosities = if law.name == "weak-inertia" { [10.0, 20.0] } else { [1.0, 0.02] };
        let viscosities = viscosities.map(|viscosity| format!("medium.viscosity_pa_s={viscosity}"));
        let law = law_of(law);
        for head in ["head={ kind = \"free\" }", DRIVEN] {
            for (fluid, reactive) in viscosities.iter().map(String::as_str).zip(["", "reactive={}"]) {
                let mut changes = vec![law.as_str(), WAVE, fluid, head, "solver.duration_s=0.3"];
                changes.extend(CURRENT);
                changes.extend((!reactive.is_empty()).then_some(reactive));
                let document = document(&changes);
                let scene = document.scene().unwrap_or_else(|error| panic!("{law}: {error}"));
                let mut problem = Problem::of(&scene).unwrap();
                // Names that the law gives itself do not change with its numbers.
                let name = problem.model().forces.iter().next().unwrap().name().to_string();
                let mut keys: Vec<&'static str> =
                    problem.model().forces.iter().flat_map(|force| force.parameters().iter().copied()).collect();
                keys.sort_unstable();
                keys.dedup();
                let tip = problem.model().rod.nodes - 1;
                let outputs: Vec<Output> = ["tip_x_m", "tip_y_m", "viscous_work_j", "actuation_work_j"]
                    .iter()
                    .map(|name| Output::named(name, problem.model()).unwrap())
                    .collect();
                let motion = problem.simulate().unwrap();
                assert!(motion.positions(0).len() == 2 * (tip + 1));
                for (o, output) in outputs.iter().enumerate() {
                    let weights = Dice(11 + o as u64).many(motion.times.len(), -1.0, 1.0);
                    let parameters: Vec<Parameter> = keys.iter().map(|key| Parameter::OfForces(key)).collect();
                    let exact = problem.adjoint(&parameters, std::slice::from_ref(output), &weights, &motion).unwrap();
                    let known = scene.parameters();
                    let own = |key: &str| known.iter().find(|known| known.key == key).map(|known| known.value);
                    let value = |key: &str, factor: f64| -> f64 {
                        let mut document = document.clone();
                        document.set_value("test", key, &toml::Value::Float(own(key).unwrap() * factor));
                        document.set_value("test", "drag.law", &toml::Value::String(name.clone()));
                        let mut problem = Problem::of(&document.scene().unwrap()).unwrap();
                        let values = problem.forward(&[], std::slice::from_ref(output), 1, |_| {}).unwrap().values;
                        values.iter().zip(&weights).map(|(x, w)| x * w).sum()
                    };
                    let central = |key: &str, by: f64| (value(key, 1.0 + by) - value(key, 1.0 - by)) / (2.0 * by);
                    // Those that the scene has as a number.
                    let numbers = keys.iter().zip(&exact).filter(|(key, _)| own(key).is_some());
                    let pairs: Vec<(f64, f64)> = numbers
                        .map(|(key, exact)| {
                            count += 1;
                            let (fine, coarse) = (central(key, 2e-3), central(key, 4e-3));
                            (exact * own(key).unwrap(), fine + (fine - coarse) / 3.0)
                        })
                        .collect();
                    let scale = largest(pairs.iter().map(|(exact, _)| *exact));
                    for (exact, expected) in pairs {
                        worst = worst.max((exact - expected).abs() / scale);
                    }
                    assert!(
                        worst <= 1e-8, // measured: 5.2e-9
                        "{law} {head} {reactive} output {o}: {worst:e}"
                    );
                }
            }
        }
    }
    println!("{count} derivatives, worst {worst:.1e}");
    assert!(count >= 4 * 2 * 2 * LAWS.iter().filter(|law| !law.is_nonlocal()).count());
}

/// What the data are made with, and the unknowns of the scene that does not know it.
const TRUTH: [&str; 3] =
    ["drag.along_n_s_m2=1.9", "drag.across_n_s_m2=4.4", "rod.stiffness_profile=[[0, 1.3], [1, 0.6]]"];
const UNKNOWN: [&str; 2] =
    [r#"design.variables=["stiffness", "drag.along_n_s_m2", "drag.across_n_s_m2"]"#, "design.knots=[0.0, 1.0]"];

/// Stiffness at head and tip over the scene's, drag along and across, each over the truth, with their deviations over themselves.
fn over_truth(found: &SearchResult, ei: f64) -> [(f64, f64); 4] {
    let last = found.profile.stiffness_n_m2.len() - 1;
    let xi = [0.0, last as f64 / (last + 1) as f64];
    let stiffness = [0, 1].map(|i| {
        let at = [0, last][i];
        (found.profile.stiffness_n_m2[at] / ei / (1.3 - 0.7 * xi[i]), found.deviations[at])
    });
    let number = |i: usize, truth: f64| {
        let number = &found.numbers[i];
        (number.value / truth, number.deviation.unwrap() / number.value)
    };
    [stiffness[0], stiffness[1], number(0, 1.9), number(1, 4.4)]
}

#[test]
fn drag_is_found_beside_stiffness_from_clean_markers() {
    let markers = clean(&document(&[&[COEFFICIENTS, DRIVEN][..], &TRUTH].concat()));
    let unknown = document(&[&[COEFFICIENTS, DRIVEN][..], &UNKNOWN].concat());
    let found = identified(&unknown, &markers);
    let ei = unknown.scene().unwrap().model().unwrap().rod.ei;
    println!("{:.1e} m after {}", found.objective, found.history.len());
    for (value, deviation) in over_truth(&found, ei) {
        println!("{:.1e} ± {deviation:.1e}", value - 1.0);
        assert!((value - 1.0).abs() <= 1e-6, "{value}");
    }
    assert!(found.converged && found.numbers.iter().all(|number| number.verdict == Some(Identifiability::Identified)));
    assert!(found.confused.is_empty());
}

/// The same with every joint's stiffness unknown, which holds the truth.
#[test]
fn every_joint_and_both_drags_are_found_to_rounding_from_clean_markers() {
    let markers = clean(&document(&[&[COEFFICIENTS, DRIVEN][..], &TRUTH].concat()));
    let unknown = document(&[COEFFICIENTS, DRIVEN, UNKNOWN[0]]);
    let found = identified(&unknown, &markers);
    let truth =
        Problem::of(&document(&[&[COEFFICIENTS, DRIVEN][..], &TRUTH].concat()).scene().unwrap()).unwrap().stiffness();
    let stiffness = largest(found.profile.stiffness_n_m2.iter().zip(&truth).map(|(found, truth)| found / truth - 1.0));
    let drag = largest([found.numbers[0].value / 1.9 - 1.0, found.numbers[1].value / 4.4 - 1.0]);
    println!("{:.1e} m after {}, stiffness {stiffness:.1e}, drag {drag:.1e}", found.objective, found.history.len());
    assert!(found.converged && stiffness <= 1e-6 && drag <= 1e-6, "{stiffness:e} {drag:e}");
}

/// Over draws of the noise of `sigma` m the truth lies within 1.96 deviations in 95 % of the cases and within one in 68 %; the
/// bounds leave less than 1e-3 to chance for each unknown. `truth` has the number that stiffens the scene, and those to be found.
fn honest(scene: &[&str], truth: &[(&str, f64)], sigma: f64, draws: usize) {
    let with = |values: &dyn Fn(usize) -> f64| {
        let changes = truth.iter().enumerate().map(|(i, (key, _))| format!("{key}={:e}", values(i)));
        changes.collect::<Vec<String>>()
    };
    let known = with(&|i| truth[i].1);
    let own: Vec<&str> = known.iter().map(String::as_str).collect();
    let truly = document(&[scene, &own].concat());
    let markers = clean(&truly);
    let numbers: Vec<String> = truth[1..].iter().map(|(key, _)| format!("\"{key}\"")).collect();
    let variables = format!("design.variables=[\"stiffness\", {}]", numbers.join(", "));
    let unknown = document(&[scene, &[&variables, "design.knots=[0.5]"]].concat());
    let bending = |document: &Document| document.scene().unwrap().model().unwrap().rod.ei;
    let (ei, stiffer) = (bending(&unknown), bending(&truly) / bending(&unknown));
    let mut dice = Dice(23);
    let mut within = vec![[0; 2]; truth.len()];
    let mut deviations = vec![0.0; truth.len()];
    for case in 0..draws {
        let found = identified(&unknown, &noisy(&markers, sigma, &mut dice));
        let stiffness = found.profile.stiffness_n_m2[0] / ei / stiffer;
        let mut errors = vec![((stiffness - 1.0) / stiffness / found.deviations[0], found.deviations[0])];
        errors.extend(found.numbers.iter().zip(&truth[1..]).map(|(number, (_, truth))| {
            let deviation = number.deviation.unwrap();
            ((number.value - truth) / deviation, deviation / truth)
        }));
        for (i, (error, deviation)) in errors.into_iter().enumerate() {
            within[i][0] += usize::from(error.abs() <= 1.96);
            within[i][1] += usize::from(error.abs() <= 1.0);
            deviations[i] = deviation;
        }
        assert!(found.converged, "{case}");
        for number in &found.numbers {
            let known = number.deviation.unwrap() <= 0.1 * number.value;
            assert_eq!(number.verdict == Some(Identifiability::Identified), known, "{number:?}");
        }
        let noise = found.noise_m.unwrap();
        assert!((noise / sigma - 1.0).abs() < 0.1, "{noise:e}");
    }
    println!("within 1.96 and 1 deviations of {draws}: {within:?}, deviations {deviations:.3?}");
    // Three and a half deviations of a count.
    let room = |part: f64| 3.5 * (draws as f64 * part * (1.0 - part)).sqrt();
    for [two, one] in within {
        let [two, one] = [two as f64 - 0.95 * draws as f64, one as f64 - 0.683 * draws as f64];
        assert!(two >= -room(0.95) && one.abs() <= room(0.683), "{two} {one}");
    }
}

#[test]
fn the_truth_lies_within_the_stated_deviations_as_often_as_it_should() {
    let truth = [("rod.youngs_modulus_pa", 1.3e6), ("drag.along_n_s_m2", 1.9), ("drag.across_n_s_m2", 4.4)];
    honest(&[COEFFICIENTS, DRIVEN], &truth, 1e-3, 40);
}

/// A tail in water, with form drag, boundary layers and added mass.
#[test]
fn so_it_does_in_water() {
    let water = [
        "medium.viscosity_pa_s=1e-3",
        "medium.density_kg_m3=1000.0",
        r#"drag={ law = "cross-flow", form_drag = 0.9 }"#,
        "reactive={}",
        DRIVEN,
    ];
    honest(&water, &[("rod.youngs_modulus_pa", 1.3e6), ("drag.form_drag", 1.3)], 1e-3, 40);
}

/// A silicone tail in air: its motion knows its stiffness, its damping and its drag apart.
#[test]
fn so_it_does_of_the_damping_of_a_material() {
    let silicone = [
        "medium.viscosity_pa_s=0.02",
        "medium.density_kg_m3=1.2",
        COEFFICIENTS,
        "drag.along_n_s_m2=0.02",
        "drag.across_n_s_m2=0.02",
        "rod.damping_time_s=0.02",
        "solver.duration_s=1.5",
        DRIVEN,
    ];
    // A modulus would change the stretch too, which is not asked for: of this motion it is known to 5e-4.
    let truth = [("rod.bending_stiffness_n_m2", 2.6e-4), ("rod.damping_time_s", 0.013), ("drag.across_n_s_m2", 0.03)];
    honest(&silicone, &truth, 1e-3, 40);
}

/// A tail that is turned slowly through a thick fluid hardly shows its damping.
#[test]
fn damping_that_the_data_do_not_know_is_not_identified() {
    let slow = [
        COEFFICIENTS,
        "rod.damping_time_s=1e-3",
        "solver.integrator=implicit-euler",
        r#"head={ kind = "driven", angle_rad = { amplitude = 0.6, frequency_hz = 0.05 } }"#,
        "solver.duration_s=40.0",
        "solver.time_step_s=0.1",
    ];
    let markers = noisy(&clean(&document(&slow)), 1e-3, &mut Dice(5));
    let unknown = document(
        &[&slow[..], &[r#"design.variables=["stiffness", "rod.damping_time_s"]"#, "design.knots=[0.5]"]].concat(),
    );
    let found = identified(&unknown, &markers);
    println!("{:?} {:?} {:?}", found.numbers, found.deviations, found.confused);
    assert!(found.deviations[0] < 0.1, "{:?}", found.deviations);
    assert!(found.numbers[0].verdict != Some(Identifiability::Identified), "{:?}", found.numbers);
}

/// Without inertia only the ratio of stiffness and drag moves a tail that its head drives.
#[test]
fn what_the_data_know_only_together_is_said() {
    let slow = [
        r#"head={ kind = "driven", angle_rad = { amplitude = 0.6, frequency_hz = 0.05 } }"#,
        "solver.duration_s=40.0",
        "solver.time_step_s=0.1",
    ];
    let changes = [&[COEFFICIENTS, "rod.density_kg_m3=1.0", "solver.integrator=implicit-euler"][..], &slow].concat();
    let markers = clean(&document(&changes));
    let mut dice = Dice(3);
    let markers = noisy(&markers, 1e-4, &mut dice);
    let with = |variables: &str| {
        let variables = format!("design.variables={variables}");
        let unknown = document(&[&changes[..], &[&variables, "design.knots=[0.5]"]].concat());
        identified(&unknown, &markers)
    };
    let all = with(r#"["stiffness", "drag.along_n_s_m2", "drag.across_n_s_m2"]"#);
    println!("{:?} {:?}", all.confused, all.numbers);
    assert_eq!(all.confused, [["knot xi = 0.5", "drag.along_n_s_m2", "drag.across_n_s_m2"]]);
    assert!(all.numbers.iter().all(|number| number.verdict == Some(Identifiability::NotToldApart)));
    let drags = with(r#"["drag.along_n_s_m2", "drag.across_n_s_m2"]"#);
    assert!(drags.confused.is_empty() && drags.numbers.iter().all(|n| n.verdict == Some(Identifiability::Identified)));
    let stiffness = with(r#"["stiffness", "drag.along_n_s_m2"]"#);
    assert!(stiffness.confused.is_empty() && stiffness.deviations[0] < 0.1, "{:?}", stiffness.confused);
}

#[test]
fn numbers_that_cannot_be_unknown_are_refused() {
    for (changes, key, words) in [
        (vec![r#"design.variables=["mass"]"#], "design.variables", "medium.viscosity_pa_s"),
        (vec![r#"design.variables=["drag.height_m"]"#], "design.variables", "numbers of this scene"),
        (vec!["design.number_bounds=[0.1, 10.0]"], "design.number_bounds", "without any"),
        (
            vec![UNKNOWN[0], COEFFICIENTS, "design.number_bounds=[10.0, 0.1]"],
            "design.number_bounds",
            "[least, largest]",
        ),
        (vec![UNKNOWN[0], COEFFICIENTS, "drag.along_n_s_m2=0.0"], "design.variables", "which is 0"),
        (vec![UNKNOWN[0], COEFFICIENTS, "design.actuation_gain=true"], "design.actuation_gain", "actuation.kappa_amp"),
        (vec![UNKNOWN[0], COEFFICIENTS, "design.window_s=0.1"], "design.window_s", "by simulation"),
        (vec![UNKNOWN[0], COEFFICIENTS, "design.goal=static-shape"], "design.variables", "stiffness alone"),
    ] {
        let mut all = vec![r#"drag={ law = "cox" }"#];
        all.extend(changes.iter().copied());
        let fault = DesignTable::of(&document(&all).scene().unwrap()).unwrap_err();
        // The bounds of the base scene are in the way of what has no numbers.
        println!("{fault:?}");
        assert!(fault.key == key && fault.problem.contains(words), "{changes:?}: {fault:?}");
    }
}

#[test]
fn numbers_are_designed_for_distance_and_hold_in_other_simulations() {
    let mut document = document(&[
        r#"drag={ law = "cox" }"#,
        r#"actuation={ kind = "travelling-wave", kappa_amp = 9.0, frequency_hz = 1.0, wavelength_m = 0.3, envelope = [0.5, 0.5] }"#,
        "design.goal=distance",
        "design.direction=-x",
        r#"design.variables=["actuation.frequency_hz", "medium.viscosity_pa_s"]"#,
        "design.number_bounds=[0.5, 2.0]",
    ]);
    let scene = document.scene().unwrap();
    let table = DesignTable::of(&scene).unwrap();
    let mut problem = Problem::of(&scene).unwrap();
    let objective = Objective::new(&table, &problem, None).unwrap().of_document(&document);
    let own = DesignVector { numbers: table.initial_numbers(), ..DesignVector::of(problem.stiffness()) };
    let parameters = [Parameter::Frequency, Parameter::OfForces("medium.viscosity_pa_s")];
    let (_, exact) = objective.derivatives(&mut problem, &own, &parameters).unwrap();
    for (i, exact) in exact.iter().enumerate() {
        let mut at = |by: f64| {
            let mut profile = own.clone();
            profile.numbers[i].1 *= 1.0 + by;
            objective.measure(&mut problem, &profile).unwrap()
        };
        let mut central = |by: f64| (at(by) - at(-by)) / (2.0 * by);
        let (fine, coarse) = (central(1e-3), central(2e-3));
        let expected = fine + (fine - coarse) / 3.0;
        println!("{:.1e}", exact * own.numbers[i].1 / expected - 1.0);
        assert!((exact * own.numbers[i].1 / expected - 1.0).abs() <= 1e-7);
    }
    document.set("design.starts=1").unwrap();
    let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
    let Answer::Search(found) = &design.answer else { panic!("found") };
    println!("{:?}", design.lines);
    assert!(found.objective > 1.2 * found.history[0].objective);
    let numbers = design.numbers().unwrap();
    let gain = |i: usize| numbers["checks"][i]["gain_percent"].as_f64().unwrap();
    assert!(gain(0) > 20.0 && (gain(1) - gain(0)).abs() < 2.0 && (gain(2) - gain(0)).abs() < 2.0, "{numbers}");
}

#[test]
fn numbers_of_a_scene_that_is_not_that_of_the_data_are_not_identified() {
    let own = [COEFFICIENTS, DRIVEN, "drag.across_n_s_m2=4.4"];
    let markers = noisy(&clean(&document(&own)), 1e-4, &mut Dice(5));
    let unknown = [r#"design.variables=["stiffness", "drag.along_n_s_m2"]"#, "design.knots=[0.5]"];
    for noise in ["design.smoothness=0.0", "design.noise_m=1e-4"] {
        let fits = identified(&document(&[&own[..], &unknown, &[noise]].concat()), &markers);
        assert!(fits.misfit.is_none(), "{:?}", fits.misfit);
        assert!(
            fits.numbers.iter().all(|number| number.verdict == Some(Identifiability::Identified)),
            "{:?}",
            fits.numbers
        );
        let other = identified(&document(&[&own[..2], &unknown, &[noise]].concat()), &markers);
        println!("{:?} {:?} for {:?}", other.misfit, other.numbers, fits.numbers);
        assert!(other.misfit.unwrap() > 2.0 && other.converged, "{:?} {}", other.misfit, other.why);
        assert!(
            other.numbers.iter().all(|number| number.verdict == Some(Identifiability::DoesNotFit)),
            "{:?}",
            other.numbers
        );
        // The truth is within what is said now.
        for (number, truth) in other.numbers.iter().zip([3.0]) {
            assert!((number.value - truth).abs() <= 2.0 * number.deviation.unwrap(), "{number:?}");
        }
    }
    let short = identified(&document(&[&own[..], &unknown, &["design.iterations=1"]].concat()), &markers);
    assert!(
        !short.converged && short.numbers.iter().all(|number| number.verdict == Some(Identifiability::NotConverged))
    );
}
