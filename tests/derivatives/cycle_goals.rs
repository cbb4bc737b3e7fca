//! Means over the last whole cycles as goals: they are those of a run's summary, their derivatives are exact, and designs for them
//! hold.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use caudal::cycle::derivatives;
use caudal::fluid::{DENSITY, VISCOSITY};
use caudal::scene::Document;
use caudal::sensitivity::{Parameter, Problem, value_and_grad};
use common::{largest, run};

const TAIL: &str = r#"
name = "tail"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.006
inner_radius_m = 0.0
youngs_modulus_pa = 2e6
density_kg_m3 = 1100.0
[actuation]
kind = "travelling-wave"
kappa_amp = 9.0
frequency_hz = 1.3
wavelength_m = 0.3
envelope = [0.5, 0.5]
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1200.0
flow_m_s = [0.02, 0.01]
[drag]
law = "cox"
[loads]
gravity_m_s2 = [0.1, -0.2]
[solver]
integrator = "generalized-alpha"
time_step_s = 8e-3
duration_s = 2.5
newton_tolerance = 1e-14
"#;

const HEADS: [&str; 3] = [
    r#"head={ kind = "free" }"#,
    r#"head={ kind = "clamped" }"#,
    r#"head={ kind = "driven", position_m = { amplitude = [0.0, 0.01], frequency_hz = 1.3 }, angle_rad = { amplitude = 0.2, frequency_hz = 1.3 } }"#,
];

/// Creeping flow, and water that a body of a lossy material accelerates.
const FLUIDS: [&[&str]; 2] = [&[], &["reactive={}", "medium.viscosity_pa_s=0.3", "rod.damping_time_s=0.01"]];

fn document(changes: &[&str]) -> Document {
    let mut document = Document::new("tail.toml", TAIL);
    changes.iter().for_each(|change| document.set(change).unwrap());
    document
}

fn cases() -> impl Iterator<Item = (String, Document)> {
    let each = HEADS.into_iter().flat_map(|head| FLUIDS.into_iter().map(move |fluid| [&[head], fluid].concat()));
    each.map(|changes| (format!("{changes:?}"), document(&changes)))
}

#[test]
fn a_goal_is_what_the_summary_reports() {
    let (mut worst, mut count) = (0.0_f64, 0);
    for (name, document) in cases() {
        let scene = document.scene().unwrap();
        let stepper = run(&scene);
        let averages = stepper.cycles().averages(stepper.view().dynamics);
        let mut problem = Problem::of(&scene).unwrap();
        for measure in derivatives::differentiable() {
            let reported = averages.mean(&measure);
            let found = problem.cycle_mean(&measure, &[]).unwrap().map(|(mean, _)| mean);
            assert_eq!(reported.is_some(), found.is_some(), "{name} {}", measure.key);
            if let (Some(reported), Some(found)) = (reported, found) {
                let error = if reported == 0.0 { found.abs() } else { (found / reported - 1.0).abs() };
                worst = worst.max(error);
                count += 1;
                assert!(error <= 1e-12, "{name} {}: {found:e} {reported:e}, {error:e}", measure.key);
            }
        }
    }
    println!("{count} means, worst {worst:.1e}");
}

const PARAMETERS: [(Parameter, f64); 8] = [
    (Parameter::Stiffness(3), 2e-3),
    (Parameter::Stiffness(6), 2e-3),
    (Parameter::WaveAmplitude(4), 1.0),
    (Parameter::WavePhase(5), 1.0),
    (Parameter::Amplitude, 9.0),
    (Parameter::Frequency, 0.1), // so little that no end of a cycle passes a step, where there is no third derivative
    (Parameter::OfForces(VISCOSITY), 0.3),
    (Parameter::OfForces(DENSITY), 1200.0),
];

/// The problem with a parameter moved by `by`.
fn moved(document: &Document, parameter: Parameter, by: f64) -> Problem {
    let mut problem = Problem::of(&document.scene().unwrap()).unwrap();
    let first = problem.model().rod.first_joint;
    let joints = problem.stiffness().len();
    let (mut factors, mut phases, mut stiffness) = (vec![1.0; joints], vec![0.0; joints], problem.stiffness());
    match parameter {
        Parameter::Stiffness(k) => stiffness[k - first] += by,
        Parameter::WaveAmplitude(k) => factors[k - first] += by,
        Parameter::WavePhase(k) => phases[k - first] += by,
        Parameter::Amplitude => problem.inputs().drive.amplitude += by,
        Parameter::Frequency => problem.inputs().drive.frequency += by,
        Parameter::OfForces(VISCOSITY) => problem.inputs().fluid.viscosity += by,
        Parameter::OfForces(DENSITY) => problem.inputs().fluid.density += by,
        other => panic!("{other:?}"),
    }
    problem.set_stiffness(&stiffness).unwrap();
    problem.set_actuation(&factors, &phases).unwrap();
    problem
}

#[test]
fn derivatives_of_means_over_cycles_are_those_of_differences() {
    let (mut worst, mut count) = (0.0_f64, 0);
    for (name, document) in cases() {
        for measure in derivatives::differentiable() {
            let mean = |parameter: Parameter, by: f64| {
                moved(&document, parameter, by).cycle_mean(&measure, &[]).unwrap().map(|(mean, _)| mean)
            };
            let kinds = PARAMETERS.map(|(parameter, _)| parameter);
            let mut problem = Problem::of(&document.scene().unwrap()).unwrap();
            let Some((own, exact)) = problem.cycle_mean(&measure, &kinds).unwrap() else {
                assert_eq!(problem.cycle_mean(&measure, &[]).unwrap(), None, "{name} {}", measure.key);
                continue;
            };
            let pairs: Vec<(f64, f64)> = PARAMETERS
                .iter()
                .zip(&exact)
                .map(|((parameter, size), exact)| {
                    let central = |by: f64| {
                        (mean(*parameter, by * size).unwrap() - mean(*parameter, -by * size).unwrap()) / (2.0 * by)
                    };
                    let (fine, coarse) = (central(1e-3), central(2e-3));
                    (exact * size, fine + (fine - coarse) / 3.0)
                })
                .collect();
            // A held head's speed depends on nothing but by rounding.
            let scale = largest(pairs.iter().map(|(exact, _)| *exact)).max(1e-4 * own.abs());
            for (i, (exact, expected)) in pairs.iter().enumerate() {
                let error = (exact - expected).abs() / scale.max(f64::MIN_POSITIVE);
                worst = worst.max(error);
                count += 1;
                let key = measure.key;
                assert!(error <= 1e-8, "{name} {key} {:?}: {exact:e} {expected:e} of {scale:e}", kinds[i]);
            }
        }
    }
    println!("{count} derivatives, worst {worst:.1e}");
    assert!(count > 8 * 6 * 8);
}

/// How far a derivative by the logarithm of the frequency may be off the slope of the mean over a range of frequencies, of the mean.
const TREND: f64 = 0.01; // measured: 3.7e-3, of the efficiency; derivatives of the mean itself: 0.17

/// After sixty cycles of a hundred steps the slope of the ripple of the steps is a sixth of that of the efficiency.
#[test]
fn a_derivative_by_the_frequency_of_a_long_run_is_the_trend_of_the_mean() {
    const CHANGES: [f64; 5] = [-8e-3, -4e-3, 0.0, 4e-3, 8e-3];
    let mut count = 0;
    // The second ends with a whole cycle, and has one less where the frequency is less; of the third the damping follows the frequency.
    for (head, changes, keys) in [
        (HEADS[0], &["solver.duration_s=30.2"][..], ["cycle_forward_speed_m_s", "cycle_efficiency"]),
        (HEADS[0], &["solver.duration_s=30.0"], ["cycle_forward_speed_m_s", "cycle_efficiency"]),
        (HEADS[0], &["solver.duration_s=30.2", "rod.loss_factor=0.2"], ["cycle_speed_m_s", "cycle_efficiency"]),
        (HEADS[1], &["solver.duration_s=30.2"], ["cycle_thrust_n", "cycle_actuation_power_w"]),
    ] {
        let changes = [&[head, "rod.nodes=9"], changes].concat();
        let document = common::document_of("models/eel.toml", include_str!("../../models/eel.toml"), &changes);
        let own = document.scene().unwrap().actuation.unwrap().frequency_hz.get();
        for key in keys {
            let of = |change: f64, by: &[&str]| {
                let mut document = document.clone();
                document.set(&format!("actuation.frequency_hz={}", own * (1.0 + change))).unwrap();
                let (mean, slopes) = value_and_grad(&document, key, by).unwrap();
                (mean, slopes.first().map_or(0.0, |slope| slope.values[0]))
            };
            let means = CHANGES.map(|change| of(change, &[]).0);
            let by = of(0.0, &["actuation.frequency_hz"]).1 * own;
            let squares: f64 = CHANGES.iter().map(|change| change * change).sum();
            let trend = CHANGES.iter().zip(means).map(|(change, mean)| change * mean).sum::<f64>() / squares;
            let off = (by - trend) / means[2];
            println!("{changes:?}: {key} {:.4e}, by ln f {:.3} of it: off {off:.1e}", means[2], trend / means[2]);
            assert!(off.abs() <= TREND, "{key}: {by:e} for {trend:e}");
            count += 1;
        }
    }
    assert_eq!(count, 8);
}

#[cfg(feature = "design")]
mod designs {
    use std::ops::ControlFlow;

    use caudal::design::{Answer, Design};
    use caudal::scene::Scene;

    use super::*;

    #[test]
    fn a_design_for_a_mean_over_cycles_improves_it_and_holds_in_other_simulations() {
        let thrust = [HEADS[2], "design={ goal = \"cycle_thrust_n\", variables = [\"stiffness\"] }"];
        let economy = [
            "design={ goal = \"cycle_cost_of_transport\", better = \"smaller\", variables = [\"amplitude\", \"stiffness\"] }",
            "design.amplitude_bounds=[0.5, 1.5]",
        ];
        let speed =
            ["reactive={}", "design={ goal = \"cycle_forward_speed_m_s\", variables = [\"stiffness\", \"phase\"] }"];
        for (changes, better) in [(&thrust[..], 1.0), (&economy, -1.0), (&speed, 1.0)] {
            let mut document = document(changes);
            for change in [
                "medium.flow_m_s=[0.0, 0.0]",
                "loads={ gravity_m_s2 = [0.0, 0.0] }",
                "design.knots=[0.0, 0.5, 1.0]",
                "design.bounds=[0.2, 5.0]",
                "design.starts=1",
                "design.iterations=30",
                "solver.newton_tolerance=1e-12",
            ] {
                document.set(change).unwrap();
            }
            let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
            let Answer::Search(found) = &design.answer else { panic!("found") };
            let first = found.history[0].objective;
            println!("{changes:?}: {first:.4e} to {:.4e}: {:?}", found.objective, design.lines);
            assert!(better * (found.objective - first) > 0.05 * first.abs(), "{first} {}", found.objective);
            let numbers = design.numbers().unwrap();
            let gain = |i: usize| numbers["checks"][i]["gain_percent"].as_f64().unwrap();
            assert!((gain(1) - gain(0)).abs() < 2.0 && (gain(2) - gain(0)).abs() < 2.0, "{}", numbers["checks"]);
            // The scene it leaves has this mean in its summary.
            let folder = tempfile::tempdir().unwrap();
            let files = design.write(folder.path()).unwrap().complete().unwrap();
            let designed = files.iter().find(|path| path.to_string_lossy().ends_with("-designed.toml")).unwrap();
            let stepper = run(&Scene::load(designed).unwrap());
            let key = design.table.goal;
            let key: &str = key.into();
            let measure = derivatives::differentiable().find(|measure| measure.key == key).unwrap();
            let mean = stepper.cycles().averages(stepper.view().dynamics).mean(&measure).unwrap();
            assert!((mean / found.objective - 1.0).abs() < 1e-9, "{key}: {mean:e} {:e}", found.objective);
        }
    }

    /// A tail of 1 m whose base turns by 0.02 rad in creeping flow, with drag of 2 N s/m² across and 1 along: its mean thrust is
    /// greatest where L(ξ⊥ω/EI)^¼ = 1.877 (Wiggins & Goldstein, Phys. Rev. Lett. 80, 1998, in the limit of small angles and fine
    /// meshes).
    #[test]
    fn the_stiffness_for_the_greatest_thrust_is_that_of_a_sperm_number_of_1_877() {
        let goal = "[design]\ngoal = \"cycle_thrust_n\"\nknots = [0.5]\nstarts = 2\n";
        let document = Document::new("driven.toml", common::driven(33) + goal);
        let design = Design::of(&document, |_| ControlFlow::Continue(())).unwrap();
        let Answer::Search(found) = &design.answer else { panic!("found") };
        let sperm = (2.0 * std::f64::consts::TAU / found.profile.stiffness_n_m2[0]).powf(0.25);
        println!("Sp = {sperm:.4}, thrust {:.5e}, {:?}", found.objective, found.starts);
        assert!(found.converged && (sperm - 1.877).abs() <= 0.01, "{sperm}");
        assert_eq!(found.optima, [Some(1); 2]);
        let unit = std::f64::consts::TAU * 0.02 * 0.02;
        assert!((found.objective / unit / 0.06019 - 1.0).abs() <= 5e-3, "{}", found.objective / unit);
    }

    #[test]
    fn goals_that_a_scene_has_not_are_refused() {
        for (changes, words) in [
            (["design.goal=cycle_thrust_n", "name=free"], "no cycle_thrust_n"),
            (["design.goal=cycle_cost_of_transport", HEADS[1]], "no cycle_cost_of_transport"),
            (["design.goal=cycle_speed_m_s", "solver.duration_s=0.5"], "shorter than one cycle"),
            (["design.goal=cycle_strouhal_number", "name=free"], "allowed: `identify`"),
            (["design={ goal = \"cycle_speed_m_s\", better = \"more\" }", "name=free"], "design.better"),
            (["design={ goal = \"cycle_speed_m_s\", direction = \"+x\" }", "name=free"], "design.direction"),
            (["design.goal=distance", "design.better=larger"], "design.better"),
        ] {
            let error = Design::of(&document(&changes), |_| ControlFlow::Continue(())).unwrap_err();
            assert!(error.is_bad_input() || words.starts_with("no ") || words.starts_with("shorter"), "{error:?}");
            assert!(error.to_string().contains(words), "{changes:?}: {error}");
        }
    }
}
