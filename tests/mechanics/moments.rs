//! Drives by moment: what they bend, what they give, against closed forms and against the natural curvature that does the same.

use crate::common;
use std::f64::consts::FRAC_PI_2;

use caudal::assessment::Assessment;
use caudal::stepper::Stepper;
use common::{SOFT, largest, scene_of, soft_moments, stepper_of};

/// An even rod without load, clamped, that a steady moment bends.
const ARC: &str = r#"
[rod]
nodes = 17
length_m = 0.2
bending_stiffness_n_m2 = 2e-4
axial_stiffness_n = 100.0
mass_per_length_kg_m = 0.1
damping_time_s = 0.4
[actuation]
kind = "standing-wave"
moment_amp_n_m = 1.5e-3
frequency_hz = 0.0
phase_profile_rad = [[0.0, -1.5707963267948966], [1.0, -1.5707963267948966]]
[start]
kind = "ramp"
ramp_s = 0.2
[head]
kind = "clamped"
[solver]
integrator = "esdirk3"
time_step_s = 1e-2
duration_s = 30.0
newton_tolerance = 1e-13
"#;

#[test]
fn a_steady_moment_bends_a_rod_to_an_arc_that_stores_half_of_its_work() {
    let (moment, stiffness, length) = (1.5e-3, 2e-4, 0.2);
    let mut stepper = stepper_of(ARC, &[]);
    stepper.do_step(30.0).unwrap();
    let curvature = stepper.get("curvature_1_m").unwrap();
    // κ of a joint is 2 tan(θ/2): the same everywhere.
    let off = largest(curvature.iter().map(|own| own - moment / stiffness));
    // Half a cell at the head, none at the tip.
    let bent = length - 0.5 * length / 16.0;
    let energy = 0.5 * moment * moment / stiffness * bent;
    let [stored, given] = ["bending_energy_j", "actuation_work_j"].map(|name| stepper.get_scalar(name).unwrap());
    let borne = largest(stepper.get("joint_moment_n_m").unwrap());
    println!("curvature off by {off:e} 1/m, energy by {:e}, joints bear {borne:e} N m", stored / energy - 1.0);
    assert!(off < 1e-6, "{off:e}");
    assert!((stored / energy - 1.0).abs() < 1e-7, "{stored} J for {energy} J");
    assert!(borne < 1e-9, "{borne:e}");
    // What is not stored is lost in the material.
    let lost = stepper.get_scalar("material_work_j").unwrap();
    let defect = stepper.get_scalar("numerical_dissipation_j").unwrap();
    assert!(((given - lost - stored) / given).abs() < 1e-3, "{given} J, {lost} J lost, {stored} J stored");
    assert!((defect / given).abs() < 1e-3, "{defect} J of {given} J");
}

/// A wave of moments and the wave of curvature that does the same to an even rod.
fn pair(changes: &[&str]) -> [Stepper; 2] {
    let stiffness = std::f64::consts::PI / 4.0 * 0.08_f64.powi(4) * 1e5;
    let even = "rod.stiffness_gradient=0.0";
    let waves = [format!("moment_amp_n_m = {:e}", 4.0 * stiffness), "kappa_amp = 4.0".into()];
    let more = [even, "actuation.harmonics=[0.2]", "solver.newton_tolerance=1e-13"];
    waves.map(|wave| stepper_of(&SOFT.replace("kappa_amp = 4.0", &wave), &[&more[..], changes].concat()))
}

#[test]
fn moments_move_an_even_rod_as_the_natural_curvature_that_they_bend_it_to() {
    let driven = "head={ kind = \"driven\", position_m = [0.0, { amplitude = 0.05, frequency_hz = 1.5 }], angle_rad = { amplitude = 0.3, frequency_hz = 1.5 } }";
    let cases: [&[&str]; 7] = [
        &[],
        &["head.kind=clamped", "solver.integrator=newmark"],
        &[driven, "solver.integrator=generalized-alpha"],
        &[driven, "solver.form=chain", "rod.damping_time_s=0.01"],
        &["solver.model=overdamped"],
        &["start={kind=\"ramp\",ramp_s=0.1}", "solver.integrator=esdirk3", "rod.damping_time_s=0.01"],
        &["head.kind=clamped", "solver.model=shape"],
    ];
    for changes in cases {
        let [mut moments, mut curvature] = pair(changes);
        let mut worst = 0.0_f64;
        let balance = |stepper: &Stepper| {
            let [given, stored] =
                ["actuation_work_j", "bending_energy_j"].map(|name| stepper.get_scalar(name).unwrap());
            given - stored
        };
        let begun = [&moments, &curvature].map(balance);
        for _ in 0..40 {
            // Between internal steps too.
            for stepper in [&mut moments, &mut curvature] {
                stepper.do_step(0.0113).unwrap();
            }
            for name in ["x_m", "y_m", "joint_moment_n_m"] {
                let [a, b] = [&moments, &curvature].map(|stepper| stepper.get(name).unwrap());
                let size = if name == "joint_moment_n_m" { largest(b.iter().copied()).max(1.0) } else { 1.0 };
                worst = worst.max(largest(a.iter().zip(&b).map(|(a, b)| a - b)) / size);
            }
        }
        let [of_moments, of_curvature] = [&moments, &curvature].map(|s| s.get_scalar("bending_energy_j").unwrap());
        println!(
            "{changes:?}: {worst:e}; {of_moments:.3} J of bending, {of_curvature:.3} J against the natural curvature"
        );
        // Measured: 7e-14 at most.
        assert!(worst < 1e-11, "{changes:?}: {worst:e}");
        // What they give beyond what they store is the same.
        let [a, b] = [balance(&moments) - begun[0], balance(&curvature) - begun[1]];
        let apart = (a - b).abs() / of_moments.max(of_curvature).max(b.abs());
        println!("    given and not stored: {a:e} J, {b:e} J, apart by {apart:e}");
        // The shape model integrates powers by Simpson's rule: measured 2e-4 there, 1e-14 at most elsewhere.
        let most = if changes.contains(&"solver.model=shape") { 1e-3 } else { 1e-11 };
        assert!(apart < most, "{changes:?}: {a:e} {b:e}");
    }
}

#[test]
fn the_balance_of_energy_closes_to_the_order_of_the_method() {
    let driven = "head={ kind = \"driven\", position_m = [0.0, { amplitude = 0.05, frequency_hz = 1.5 }], angle_rad = { amplitude = 0.3, frequency_hz = 1.5 } }";
    let heads = [
        &["start={kind=\"ramp\",ramp_s=0.2}"][..],
        &["head.kind=clamped"],
        &[driven],
        &["rod.damping_time_s=0.02", driven],
    ];
    for (method, order) in [("implicit-euler", 1), ("newmark", 2), ("generalized-alpha", 2), ("esdirk3", 2)] {
        for head in heads {
            let defect = |step: f64| {
                let method = [format!("solver.integrator={method}"), format!("solver.time_step_s={step:e}")];
                let method = method.each_ref().map(String::as_str);
                let mut stepper = stepper_of(&soft_moments(), &[head, &method[..]].concat());
                stepper.do_step(1.0).unwrap();
                let given = stepper.get_scalar("actuation_work_j").unwrap().abs();
                (stepper.get_scalar("numerical_dissipation_j").unwrap() / given, given)
            };
            let steps = match method {
                "implicit-euler" => [2e-4, 1e-4],
                "esdirk3" => [5e-4, 2.5e-4], // before, what its third order leaves counts
                _ => [2e-3, 1e-3],
            };
            let [(coarse, _), (fine, given)] = steps.map(defect);
            let factor = coarse / fine;
            println!("{method} {head:?}: {coarse:e}, {fine:e} of {given:.3} J, factor {factor:.2}");
            let least = if order == 1 { 1.7 } else { 3.4 };
            assert!(factor > least || fine.abs() < 1e-6, "{method} {head:?}: {coarse:e} {fine:e}");
            assert!(fine.abs() < 0.05, "{method} {head:?}: {fine:e}");
        }
    }
}

#[test]
fn what_a_host_asks_of_the_joints_bends_them_as_the_curvature_that_it_is_worth() {
    // Set at once and by a rate, on a rod that a wave of curvature drives, free and held.
    for head in ["head.kind=free", "head.kind=clamped"] {
        let changes = [head, "solver.integrator=newmark", "solver.newton_tolerance=1e-13"];
        let [mut moments, mut curvature] = [0; 2].map(|_| stepper_of(SOFT, &changes));
        let stiffness: Vec<f64> =
            moments.model().rod.joints().map(|k| moments.model().rod.joint_stiffness(k)).collect();
        let asked: Vec<f64> = (0..stiffness.len()).map(|k| (k as f64 - 2.0) * 0.3).collect();
        let bent: Vec<f64> = asked.iter().zip(&stiffness).map(|(moment, stiffness)| moment / stiffness).collect();
        let mut worst = 0.0_f64;
        for step in 0..30 {
            match step {
                5 => {
                    moments.set("active_moment_n_m", &asked).unwrap();
                    curvature.set("natural_curvature_1_m", &bent).unwrap();
                }
                12 => {
                    moments.set_derivative("active_moment_n_m", 1, &asked).unwrap();
                    curvature.set_derivative("natural_curvature_1_m", 1, &bent).unwrap();
                }
                _ => {}
            }
            for stepper in [&mut moments, &mut curvature] {
                stepper.do_step(0.0113).unwrap();
            }
            let [a, b] = [&moments, &curvature].map(|stepper| stepper.get("y_m").unwrap());
            worst = worst.max(largest(a.iter().zip(&b).map(|(a, b)| a - b)));
        }
        println!("{head}: {worst:e}");
        assert!(worst < 1e-10, "{head}: {worst:e}");
        let saved = moments.save();
        let mut again = moments.get("y_m").unwrap();
        moments.do_step(0.1).unwrap();
        let [y, work] = ["y_m", "actuation_work_j"].map(|name| moments.get(name).unwrap());
        moments.restore(&saved).unwrap();
        assert_eq!(moments.get("y_m").unwrap(), again);
        moments.do_step(0.1).unwrap();
        again = moments.get("y_m").unwrap();
        assert_eq!([again, moments.get("actuation_work_j").unwrap()], [y, work]);
    }
}

#[test]
fn what_a_host_sets_before_the_first_step_acts_in_any_order() {
    // A pose of the head starts the run anew, and what bends the rod beside it is a jump at that start.
    let driven = "head={ kind = \"driven\" }";
    let passive =
        SOFT.split("[actuation]").next().unwrap().to_string() + "[solver]\ntime_step_s = 2e-3\nduration_s = 1.0\n";
    for text in [SOFT, &soft_moments(), &passive] {
        for input in ["active_moment_n_m", "natural_curvature_1_m"] {
            let [first, last] = [true, false].map(|first| {
                let mut stepper = stepper_of(text, &[driven]);
                let bend = vec![0.5; stepper.get(input).unwrap().len()];
                if first {
                    stepper.set(input, &bend).unwrap();
                }
                stepper.set("head_y_m", &[0.05]).unwrap();
                if !first {
                    stepper.set(input, &bend).unwrap();
                }
                let mut ys = stepper.get("y_m").unwrap();
                stepper.do_step(0.1).unwrap();
                ys.extend(stepper.get("y_m").unwrap());
                ys
            });
            assert_eq!(first, last, "{input}");
        }
    }
}

#[test]
fn a_limp_rod_stores_what_its_curvature_says() {
    // Held out of reach of its moments by a thick fluid, it bends by a part of 1e-9 of what it would bend by without load.
    for stiffness in ["2e-4", "2e-10", "2e-16"] {
        let changes = [
            &format!("rod.bending_stiffness_n_m2={stiffness}")[..],
            "actuation.moment_amp_n_m=1.5e-12",
            "medium={viscosity_pa_s=30.0,density_kg_m3=1000.0}",
            "drag.law=cox",
            "rod.outer_radius_m=0.005",
            "solver.time_step_s=1e-3",
        ];
        let mut stepper = stepper_of(ARC, &changes);
        stepper.do_step(0.05).unwrap();
        let (stored, rod) = (stepper.get_scalar("bending_energy_j").unwrap(), &stepper.model().rod);
        let kappa = &stepper.metrics().now.kappa;
        let by_hand: f64 = rod.joints().map(|k| 0.5 * rod.joint[k] * kappa[k] * kappa[k]).sum();
        println!("EI {stiffness}: {stored:e} J, {by_hand:e} J");
        assert!(by_hand > 0.0 && (stored / by_hand - 1.0).abs() < 1e-12, "{stored:e} J for {by_hand:e} J");
    }
}

#[test]
fn a_rod_released_under_moments_is_told_to_ring_as_one_released_into_its_curvature() {
    for nodes in [9, 13, 17, 25] {
        let changes = [format!("rod.nodes={nodes}"), "start={kind=\"jump\"}".into(), "solver.time_step_s=0.1".into()];
        let changes = [&["rod.stiffness_gradient=0.0"][..], &changes.each_ref().map(String::as_str)].concat();
        let stiffness = std::f64::consts::PI / 4.0 * 0.08_f64.powi(4) * 1e5;
        let warnings = [format!("moment_amp_n_m = {:e}", 4.0 * stiffness), "kappa_amp = 4.0".into()].map(|amplitude| {
            let scene = scene_of(&SOFT.replace("kappa_amp = 4.0", &amplitude), &changes);
            let told = Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().warnings;
            told.into_iter().filter(|warning| warning.contains("excites vibrations")).collect::<Vec<_>>().concat()
        });
        // They differ in the start that is advised.
        let rings = warnings.each_ref().map(|warning| warning.split_once("; start.kind").unwrap_or_default());
        assert!(!rings[0].0.is_empty() && rings[0].0 == rings[1].0, "{nodes}: {warnings:?}");
        assert!(rings[0].1.contains("\"ramp\"") && rings[1].1.contains("\"shaped\""), "{nodes}: {warnings:?}");
    }
}

/// A strip of silicone far above its first frequency never takes the shape that its moments would bend it to: started in that it swings for long.
#[test]
fn a_shaped_start_far_above_the_first_frequency_is_warned_of() {
    for (frequency, kind, warned) in [(0.05, "shaped", false), (6.0, "shaped", true), (6.0, "ramp", false)] {
        let start =
            if kind == "shaped" { "start.kind=shaped".to_string() } else { "start={kind=\"ramp\",ramp_s=0.5}".into() };
        let changes = [format!("actuation.frequency_hz={frequency}"), start];
        let scene = scene_of(&soft_moments(), &changes.each_ref().map(String::as_str));
        let told = Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap();
        let found = told.warnings.iter().any(|warning| warning.contains("the shaped start sets the shape"));
        assert_eq!(found, warned, "{frequency} Hz {kind}: {:?} {:?}", told.frequency_ratio, told.warnings);
    }
}

#[test]
fn a_moment_that_is_asked_of_the_joints_at_once_does_no_work_until_they_move() {
    let mut stepper = stepper_of(SOFT, &["actuation.kappa_amp=0.0", "head.kind=clamped"]);
    stepper.do_step(0.01).unwrap();
    let joints = stepper.get("active_moment_n_m").unwrap().len();
    let before = stepper.get_scalar("actuation_work_j").unwrap();
    stepper.set("active_moment_n_m", &vec![1.0; joints]).unwrap();
    assert_eq!(stepper.get_scalar("actuation_work_j").unwrap(), before);
    let angle = |stepper: &Stepper| stepper.get_scalar("tip_angle_rad").unwrap();
    let at_rest = angle(&stepper);
    stepper.do_step(5.0).unwrap();
    let (turned, given) = (angle(&stepper) - at_rest, stepper.get_scalar("actuation_work_j").unwrap() - before);
    // M times the sum of the curvatures, which the work is along, is M (θ + Σ θ³/12 + …): joints turn by little here.
    println!("turned by {turned:.4} rad, {given:.6} J given");
    assert!((given / turned - 1.0).abs() < 1e-2 && turned.abs() < FRAC_PI_2, "{given} J, {turned} rad");
}
