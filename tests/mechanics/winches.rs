//! Winches give tendons a length through their stiffness: what they pull, alone and against each other, and what they do.

use std::f64::consts::TAU;

use caudal::assessment::Assessment;
use caudal::modes::Modes;
use caudal::stepper::Stepper;
use caudal::variable::{Variable, View};

use crate::common::{document_of, largest, stepper_of};
use crate::tendons::resting;

/// A soft rod with a winch on either side, each of which takes in what the other gives out.
const PAIR: &str = r#"
[rod]
nodes = 11
length_m = 0.2
outer_radius_m = 0.005
inner_radius_m = 0.0
youngs_modulus_pa = 5e5
density_kg_m3 = 1100.0
damping_time_s = 0.005
[head]
kind = "clamped"
[[tendons]]
offset_m = 0.004
stiffness_n_m = 400.0
length_m = { offset = 0.199, amplitude = 0.003, frequency_hz = 2.0 }
[[tendons]]
offset_m = -0.004
to_xi = 0.7
stiffness_n_m = 400.0
length_m = { offset = 0.139, amplitude = -0.002, frequency_hz = 2.0 }
[start]
kind = "ramp"
ramp_s = 0.2
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "coefficients"
along_n_s_m2 = 0.01
across_n_s_m2 = 0.3
[solver]
integrator = "newmark"
time_step_s = 1e-3
duration_s = 1.0
newton_tolerance = 1e-13
"#;

fn pair(changes: &[&str]) -> Stepper {
    stepper_of(PAIR, changes)
}

fn get(stepper: &Stepper, name: &str) -> f64 {
    stepper.get_scalar(name).unwrap()
}

fn apart(one: &Stepper, other: &Stepper) -> f64 {
    largest(one.state().q.iter().zip(&other.state().q).map(|(a, b)| a - b))
}

#[test]
fn a_winch_bends_a_rod_at_rest_by_what_the_cable_and_the_rod_share_at_any_size() {
    for (scale, form) in [1e-5, 1.0, 50.0].into_iter().flat_map(|scale| [(scale, "positions"), (scale, "chain")]) {
        let (length, offset) = (0.2 * scale, 0.004 * scale);
        let (stiffness, told, take_up) = (400.0 * scale, 0.196 * scale, 1e-4 * scale);
        let tendon = format!("offset_m={offset:e},stiffness_n_m={stiffness:e},length_m={told:e},take_up_m={take_up:e}");
        let (tendon, form) = (format!("tendons=[{{{tendon}}}]"), format!("solver.form={form}"));
        let mut stepper = resting(PAIR, scale, &[&tendon, &form]);
        stepper.do_step(1000.0).unwrap();
        // T = k (Λ − Λc − w/2) with Λ = L (1 − T/EA) − d Σ κ and κ_k = T d/B_k.
        let rod = &stepper.model().rod;
        let flexibility: f64 = rod.joints().map(|k| 1.0 / rod.joint[k]).sum();
        let tension = stiffness * (length - told - 0.5 * take_up)
            / (1.0 + stiffness * (length / rod.ea + offset * offset * flexibility));
        let off = (get(&stepper, "tendon_1_tension_n") / tension - 1.0).abs();
        let bent = largest(stepper.get("curvature_1_m").unwrap()) * length;
        println!("{scale:e} {form}: tension {tension:e} N, off by {off:e}, bent by {bent}");
        assert!(off < 1e-7 && bent > 0.5, "{scale:e} {form}: {off:e}, {bent}");
    }
}

#[test]
fn a_slack_tendon_pulls_nothing() {
    let loose = ["tendons.0.length_m=0.3", "tendons.1.length_m=0.3", "loads.gravity_m_s2=[0.0,-9.81]"];
    for form in ["positions", "chain"] {
        let form = format!("solver.form={form}");
        let mut slack = pair(&[&loose[..], &[&form]].concat());
        let mut none = pair(&["tendons=[]", loose[2], &form]);
        for stepper in [&mut slack, &mut none] {
            stepper.do_step(0.5).unwrap();
        }
        assert_eq!([1, 2].map(|i| get(&slack, &format!("tendon_{i}_tension_n"))), [0.0; 2]);
        assert!(apart(&slack, &none) < 1e-15 && none.state().q[21] < -1e-3, "{:e}", apart(&slack, &none));
    }
}

#[test]
fn both_forms_agree_and_take_the_iterations_of_tendons_of_given_tension() {
    let run = |changes: &[&str]| {
        let mut stepper = pair(changes);
        stepper.do_step(0.6).unwrap();
        let work = stepper.work();
        let iterations = work.newton_iterations as f64 / stepper.metrics().totals.steps as f64;
        (stepper, iterations)
    };
    // The tension of the stiffer ones is known to the rounding of a length, 1e-11 N, which bends a joint by more than 1e-13.
    for (stiffness, tolerance) in [("400.0", "1e-13"), ("4e5", "1e-10")] {
        let tolerance = format!("solver.newton_tolerance={tolerance}");
        let stiff = [0, 1].map(|i| format!("tendons.{i}.stiffness_n_m={stiffness}"));
        let [positions, chain] =
            ["positions", "chain"].map(|form| run(&[&format!("solver.form={form}"), &stiff[0], &stiff[1], &tolerance]));
        let differ = apart(&positions.0, &chain.0) / 0.2;
        let tension = get(&positions.0, "tendon_1_tension_n").max(get(&positions.0, "tendon_2_tension_n"));
        println!("{stiffness} N/m: {differ:e} apart, {} and {} iterations a step, {tension} N", positions.1, chain.1);
        assert!(differ < 1e-9, "{stiffness}: {differ:e}");
        assert!(positions.1 < 4.0 && chain.1 < 4.0 && tension > 0.05, "{stiffness}: {} {}", positions.1, chain.1);
    }
}

#[test]
fn the_balance_of_energy_closes_to_the_order_of_the_method() {
    for (method, least) in [("implicit-euler", 1.8), ("newmark", 3.5), ("generalized-alpha", 3.5), ("esdirk3", 3.5)] {
        let defect = |h: f64| {
            let changes = [format!("solver.integrator={method}"), format!("solver.time_step_s={h:e}")];
            let mut stepper = pair(&changes.each_ref().map(String::as_str));
            stepper.do_step(0.8).unwrap();
            (stepper.metrics().numerical_dissipation(), get(&stepper, "actuation_work_j"))
        };
        let [(coarse, work), (fine, _)] = [2e-3, 1e-3].map(defect);
        println!("{method}: {coarse:e} and {fine:e} of {work:e} J, ratio {}", coarse / fine);
        assert!((coarse / fine).abs() > least && fine.abs() < 0.1 * work.abs(), "{method}: {coarse:e} {fine:e}");
    }
}

#[test]
fn rows_between_steps_are_those_of_short_steps() {
    for (stiffness, form) in [("400.0", "positions"), ("400.0", "chain"), ("2e4", "positions"), ("2e4", "chain")] {
        let stiff = [0, 1].map(|i| format!("tendons.{i}.stiffness_n_m={stiffness}"));
        let form = format!("solver.form={form}");
        let start = |h: f64| pair(&[&stiff[0], &stiff[1], &form, &format!("solver.time_step_s={h:e}")]);
        let names = ["tendon_1_tension_n", "tendon_2_tension_n", "head_force_x_n"];
        let read = |view: &View<'_>, stepper: &[&'static Variable; 3]| stepper.map(|variable| variable.first(view));
        let variables = |stepper: &Stepper| names.map(|name| stepper.find(name).unwrap());
        let (mut coarse, mut fine) = (start(2e-3), start(2.5e-4));
        let known = variables(&coarse);
        let (mut worst, mut most) = ([0.0_f64; 2], 0.0_f64);
        for _ in 0..300 {
            coarse.do_step(2e-3).unwrap();
            for part in 1..=8 {
                fine.do_step(2.5e-4).unwrap();
                let there = read(&fine.view(), &known);
                let end = coarse.time();
                let time = if part == 8 { end } else { end - 2.5e-4 * f64::from(8 - part) };
                let between = coarse.at(time, |view| read(view, &known)).unwrap();
                // Within steps, and at their ends, where it is the error of the steps themselves.
                let worst = &mut worst[usize::from(part == 8)];
                *worst = worst.max(largest(there.iter().zip(between).map(|(a, b)| a - b)));
                most = most.max(largest(there));
            }
        }
        let [within, ends] = worst;
        println!("{stiffness} {form}: {within:e} N within steps, {ends:e} N at their ends, of {most}");
        // Measured: 1.34 and 1.10 times.
        assert!(within < 1.5 * ends && most > 0.3, "{stiffness} {form}: {within:e} {ends:e} N of {most}");
    }
}

#[test]
fn a_host_that_moves_a_winch_gives_what_the_scene_s_own_signal_gives() {
    // The whole of it by the host, with derivatives, against the sinusoid of the scene.
    let own = ["start.ramp_s=1e-9", "tendons.0.length_m={offset=0.2,amplitude=0.003,frequency_hz=2.0}"];
    let mut scene = pair(&own);
    let mut hosted = pair(&["tendons.0.length_m=0.2", "start.ramp_s=1e-9"]);
    let h = 1e-3;
    for step in 0..400 {
        let omega = TAU * 2.0;
        let (sin, cos) = (omega * h * f64::from(step)).sin_cos();
        hosted.set("tendon_1_added_length_m", &[0.003 * sin]).unwrap();
        for (order, value) in [(1, omega * cos), (2, -omega * omega * sin), (3, -omega.powi(3) * cos)] {
            hosted.set_derivative("tendon_1_added_length_m", order, &[0.003 * value]).unwrap();
        }
        hosted.do_step(h).unwrap();
        scene.do_step(h).unwrap();
    }
    let differ = apart(&scene, &hosted) / 0.2;
    println!("{differ:e}");
    assert!(differ < 1e-8, "{differ:e}");
    let error = hosted.set("tendon_1_added_tension_n", &[1.0]).unwrap_err().to_string();
    assert!(error.contains("tendon 1 of [[tendons]], without a winch"), "{error}");
}

#[test]
fn the_speed_of_a_winch_is_that_at_which_its_length_changes_while_it_is_let_in_too() {
    let mut stepper = pair(&["start.ramp_s=0.4"]);
    let lengths = |view: &View<'_>| [0, 1].map(|i| view.metrics.now.tendons[i].wound);
    let (mut worst, mut most) = (0.0_f64, 0.0_f64);
    for step in 0..600 {
        stepper.set("tendon_1_added_length_m", &[1e-3 * (f64::from(step) * 0.01).sin()]).unwrap();
        stepper.set_derivative("tendon_1_added_length_m", 1, &[5e-3]).unwrap();
        stepper.do_step(1e-3).unwrap();
        let end = stepper.time();
        let [before, here, after] = [0.9, 0.5, 0.1].map(|part| stepper.at(end - part * 1e-3, lengths).unwrap());
        for ((before, here), after) in before.iter().zip(&here).zip(&after) {
            let rate = (after[0] - before[0]) / 0.8e-3;
            worst = worst.max((here[1] - rate).abs());
            most = most.max(rate.abs());
        }
    }
    println!("{worst:e} of {most} m/s");
    assert!(worst < 1e-4 * most, "{worst:e} of {most}");
}

#[test]
fn a_winch_is_bought_by_what_its_drum_does() {
    // A slack one winds without a load: 6 mm at up to 0.003·2π·2 m/s.
    let own = ["start.ramp_s=1e-9", "tendons.0.length_m={offset=0.25,amplitude=0.003,frequency_hz=2.0}"];
    let mut stepper = pair(&own);
    stepper.do_step(1.0).unwrap();
    let most = stepper.metrics().totals.tendons[0];
    // From the length beside the straight rod on.
    assert!((most.travel() - 0.053).abs() < 1e-6 && (most.speed - 0.003 * TAU * 2.0).abs() < 1e-6, "{most:?}");
    assert!(most.tension < 1e-20 && most.power < 1e-20, "{most:?}");
}

#[test]
fn what_a_winch_cannot_be_told_is_refused_and_what_it_leaves_out_is_said() {
    for (length, words) in [
        ("-0.1", "a length of -0.1 m"),
        ("{amplitude=0.002,frequency_hz=2.0}", "use that as the offset of the sinusoid"),
    ] {
        let document = document_of("winches.toml", PAIR, &[&format!("tendons.0.length_m={length}")]);
        let error = document.scene().and_then(|scene| scene.model().map(|_| ())).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("tendons.0.length_m"), "{error}");
    }
    // Taut winches make the largest frequency larger: 2/ω of the bound is stable, and that of the slack rod is not.
    let model = |changes: &[&str]| document_of("winches.toml", PAIR, changes).scene().unwrap().model().unwrap();
    let stiff = ["tendons.0.stiffness_n_m=2e5", "tendons.1.stiffness_n_m=2e5"];
    let steps = |model| Modes::of_model(model).unwrap().explicit_steps(None).unwrap().largest;
    let [bound, slack] = [steps(model(&stiff)), steps(model(&["tendons=[]"]))];
    let survives_with = |h: f64, damping: &[&str]| {
        let h = format!("solver.time_step_s={h:e}");
        let explicit = ["solver.integrator=symplectic-euler", &h];
        let mut stepper = pair(&[&stiff[..], &explicit, damping].concat());
        stepper.halve_failing_steps(false);
        stepper.do_step(0.5).is_ok()
    };
    let survives = |h: f64| survives_with(h, &["rod.damping_time_s=0.0"]);
    println!("{bound:e} s for {slack:e} s");
    assert!(survives(0.95 * bound) && !survives(0.95 * slack), "{bound:e} {slack:e}");
    // What is advised is that.
    let step = format!("solver.time_step_s={:e}", 2.0 * bound);
    let explicit = ["solver.integrator=symplectic-euler", "rod.damping_time_s=0.0", &step];
    let scene = document_of("winches.toml", PAIR, &[&stiff[..], &explicit].concat()).scene().unwrap();
    let said = Assessment::of(&scene, &Stepper::of(&scene).unwrap()).unwrap().warnings.join("; ");
    let advised: f64 = said
        .split("solver.time_step_s = ")
        .nth(1)
        .and_then(|rest| rest.split([',', ' ']).next())
        .unwrap()
        .parse()
        .unwrap();
    assert!(said.contains("taut winches") && (0.9 * bound..=bound).contains(&advised), "{said}: {bound:e}");
    // The material is damped, and cables are not.
    let soft = ["rod.damping_time_s=1e-4"];
    let model = model(&[&stiff[..], &soft].concat());
    let damping = model.rod.damping.clone();
    let bound = Modes::of_model(model).unwrap().explicit_steps(damping.as_ref()).unwrap().largest;
    // Three times the bound still comes through here.
    let [within, beyond] = [0.95, 4.0].map(|part| survives_with(part * bound, &soft));
    println!("{bound:e} s damped: {within}, {beyond}");
    assert!(within && !beyond, "{bound:e}");
}
