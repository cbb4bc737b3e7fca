//! Events between steps: what drives a rod at rest, in bursts, by rates and in jumps, and hosts that step as they like.

use crate::common;
use std::f64::consts::TAU;
use std::sync::Arc;

use caudal::error::Error;
use caudal::head::{Row, Signal, hermite};
use caudal::model::{Dynamics, InputExtrapolation};
use caudal::stepper::{InputChange, Stepper};
use common::{Dice, largest, order, scene_of, stepper_of};

/// A silicone tail of 30 cm in a viscous fluid.
const TAIL: &str = r#"
name = "tail"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.004
youngs_modulus_pa = 2e6
density_kg_m3 = 1100.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
law = "cox"
[solver]
duration_s = 1.0
"#;

const WAVE: &str = r#"actuation={ kind = "travelling-wave", kappa_amp = 5.0, frequency_hz = 2.0, wavelength_m = 0.3 }"#;

fn tail(changes: &[&str]) -> Stepper {
    stepper_of(TAIL, changes)
}

fn of(stepper: &Stepper, name: &str) -> f64 {
    stepper.get_scalar(name).unwrap()
}

fn most(stepper: &Stepper, name: &str) -> f64 {
    largest(stepper.get(name).unwrap())
}

fn near(found: f64, expected: f64, part: f64, what: &str) {
    assert!((found - expected).abs() <= part * expected.abs(), "{what}: {found:e}, not {expected:e}");
}

#[test]
fn a_push_of_a_rod_at_rest_gives_its_momentum_however_short_it_is() {
    for fixed in [false, true] {
        for dt in [1e-5, 5e-4, 2e-3] {
            let mut tail = tail(if fixed {
                &["medium.viscosity_pa_s=1e-9", "solver.time_step_s=1e-4"]
            } else {
                &["medium.viscosity_pa_s=1e-9"]
            });
            tail.set("force_y_n", &[0.1 / 9.0; 9]).unwrap();
            tail.do_step(dt).unwrap();
            assert_eq!((tail.time(), tail.state().t), (dt, dt));
            tail.set("force_y_n", &[0.0; 9]).unwrap();
            (0..10).for_each(|_| tail.do_step(1e-3).unwrap());
            let momentum = tail.model().rod.total_mass() * tail.model().rod.mean(&tail.state().v).y;
            near(momentum, 0.1 * dt, 1e-4, "momentum");
            near(of(&tail, "load_work_j"), 0.5 * 0.1 * dt * 0.1 * dt / tail.model().rod.total_mass(), 0.2, "work");
        }
    }
}

#[test]
fn a_load_at_once_makes_a_rod_at_rest_ring_in_one_long_step_as_in_many() {
    for model in ["full", "overdamped"] {
        let model = format!("solver.model={model}");
        let ring = |pace: &[&str]| {
            let mut tail = tail(&[&["head.kind=clamped", "medium.viscosity_pa_s=0.01", &model], pace].concat());
            tail.do_step(1.0).unwrap();
            let mut force = [0.0; 9];
            force[8] = 5e-3;
            tail.set("force_y_n", &force).unwrap();
            tail.do_step(0.4).unwrap();
            (tail.state().q.clone(), of(&tail, "load_work_j"))
        };
        let ((own, work), (fine, fine_work)) =
            (ring(&[]), ring(&["solver.integrator=esdirk3", "solver.time_step_s=2e-4"]));
        let apart =
            largest(own.iter().zip(&fine).map(|(a, b)| a - b)) / largest(fine.iter().skip(1).step_by(2).copied());
        println!("{model}: {apart:e} {work:e} {fine_work:e}");
        assert!(apart < 0.03, "{model}: {apart:e}");
        near(work, fine_work, 0.03, &model);
    }
}

#[test]
fn a_head_at_rest_follows_its_host_from_the_first_step_on() {
    for pace in ["solver.integrator=esdirk3", "solver.time_step_s=1e-4"] {
        let mut tail = tail(&["head.kind=driven", pace]);
        let at = |t: f64| 0.01 * (1.0 - (TAU * 2.0 * t).cos());
        for _ in 0..10 {
            let t = tail.time();
            tail.set("head_y_m", &[at(t)]).unwrap();
            tail.do_step(5e-4).unwrap();
            assert_eq!(tail.time(), tail.state().t);
        }
        near(of(&tail, "pose_y_m"), at(tail.time()), 0.05, pace);
    }
}

#[test]
fn steps_of_a_host_of_any_length_give_the_same_motion() {
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        let changes = [WAVE, "start={ kind = \"ramp\", ramp_s = 0.1 }", &model];
        let mut whole = tail(&changes);
        whole.do_step(0.5).unwrap();
        let mut parts = tail(&changes);
        let mut dice = Dice(7);
        while parts.time() < 0.5 {
            let h = 10.0_f64.powf(dice.between(-6.0, -1.0)).min(0.5 - parts.time());
            parts.do_step(h).unwrap();
        }
        let apart = largest(whole.state().q.iter().zip(&parts.state().q).map(|(a, b)| a - b));
        println!("{model}: {apart:e} m");
        assert!(apart < 3e-4 * 0.3, "{model}: {apart:e}");
    }
}

#[test]
fn the_longest_step_turns_the_drive_by_a_share_of_what_each_of_its_derivatives_does() {
    let model = Arc::new(scene_of(TAIL, &[WAVE, "start.kind=jump"]).model().unwrap());
    // Frequency (Hz) and offset of the phase (rad), each with three derivatives.
    let longest = |frequency: [f64; 4], offset: [f64; 4]| {
        let mut dynamics = Dynamics::new(Arc::clone(&model));
        let mut extrapolation = InputExtrapolation::resting(&model, &dynamics.inputs, 0.0);
        for order in 0..4 {
            extrapolation.change(&mut dynamics, order, |dynamics| {
                dynamics.inputs.drive.frequency = frequency[order];
                dynamics.inputs.phase_offset = offset[order];
            });
        }
        extrapolation.at(0.0, &mut dynamics.inputs);
        dynamics.extrapolation = Some(Box::new(extrapolation));
        dynamics.longest_step(0.0, f64::INFINITY)
    };
    // A sixteenth of a turn at a steady frequency.
    let turn = TAU / 16.0;
    assert!((longest([2.0, 0.0, 0.0, 0.0], [0.0; 4]) - 1.0 / 32.0).abs() < 1e-15);
    let mut dice = Dice(35);
    for _ in 0..400 {
        let [frequency, offset] = [30.0, 100.0].map(|size| {
            [(); 4].map(|()| if dice.between(-1.0, 1.0) > 0.0 { dice.between(0.01, 1.0) * size } else { 0.0 })
        });
        // φ′ = 2πf − ψ′, and so on: of each |φ⁽ᵏ⁾| hᵏ/k! is its share.
        let next = |k: usize| offset.get(k).copied().unwrap_or(0.0);
        let rates = [0, 1, 2, 3].map(|k| (TAU * frequency[k] - next(k + 1)).abs());
        let several = rates.iter().filter(|rate| **rate > 0.0).count().max(1) as f64;
        let factorials = [1.0, 2.0, 6.0, 24.0];
        let steps = [0, 1, 2, 3].map(|k| (turn / several * factorials[k] / rates[k]).powf(1.0 / (k + 1) as f64));
        let (found, expected) = (longest(frequency, offset), steps.into_iter().fold(f64::INFINITY, f64::min));
        let equal = found == expected || (found / expected - 1.0).abs() < 1e-12;
        assert!(equal, "{found} for {expected}: {frequency:?} Hz, {offset:?} rad");
    }
}

/// Rows with those rates, on top of a motion at `speed`.
fn rows(points: &[[f64; 3]], speed: f64) -> Signal {
    let row = |&[time, value, rate]: &[f64; 3]| Row { time, value: value + speed * time, rate: rate + speed };
    Signal::Table(points.iter().map(row).collect())
}

#[test]
fn steps_in_a_table_are_those_of_its_own_motion_and_end_where_its_next_rows_begin() {
    // A small burst long before a large one, and a sinusoid of fine rows after it.
    let omega = TAU * 2.0;
    let wave = (0..=1000).map(|k| 11.2 + f64::from(k) * 1e-3);
    let mut points = vec![[0.0; 3], [5.0, 0.0, 0.0], [5.02, 1e-5, 0.0], [5.04, 0.0, 0.0], [11.0, 0.0, 0.0]];
    points.extend([[11.05, 0.02, 0.0], [11.1, 0.0, 0.0], [11.199, 0.0, 0.0]]);
    points.extend(
        wave.map(|t| [t, 0.01 * (1.0 - (omega * (t - 11.2)).cos()), 0.01 * omega * (omega * (t - 11.2)).sin()]),
    );
    let steps = |speed: f64| {
        let table = rows(&points, speed);
        let (mut t, mut ends) = (0.0, Vec::new());
        while t < 12.2 {
            t += table.longest_step(t, f64::INFINITY).min(12.2 - t);
            ends.push(t);
        }
        ends
    };
    let still = steps(0.0);
    for event in [5.0, 5.02, 5.04, 11.0, 11.1] {
        assert!(still.iter().any(|t| (t - event).abs() < 1e-9), "{event} in {still:?}");
    }
    let before = |t: f64| still.iter().filter(|end| **end < t - 1e-9).count();
    assert_eq!(
        [before(5.0), before(5.02), before(5.04), before(11.0), before(11.05), before(11.1)],
        [0, 8, 16, 17, 25, 33]
    );
    let fine = still.len() - before(11.2);
    assert!((32..=100).contains(&fine), "{fine} steps in two periods of fine rows");
    for speed in [-3.0, 0.1, 30.0] {
        let moving = steps(speed);
        // Where values are larger, their rounding is.
        assert!(moving.len().abs_diff(still.len()) <= still.len() / 10, "{} {}", moving.len(), still.len());
        assert!(moving.iter().any(|t| (t - 5.02).abs() < 1e-9) && moving.iter().filter(|t| **t < 12.0).count() > 33);
    }
    // An even motion counts as rest, whatever the speed, up to the last row and no further.
    let even = rows(&[[0.0; 3], [4.0, 0.0, 0.0], [4.1, 0.01, 0.2], [9.0, 0.0, 0.0]], 0.3);
    assert_eq!(even.longest_step(1.0, f64::INFINITY), 3.0);
    assert!((even.longest_step(4.0, f64::INFINITY) - 0.1 / 8.0).abs() < 1e-12);
    assert_eq!(even.longest_step(9.0, f64::INFINITY), f64::INFINITY);
    let points = [[0.0, 0.1], [0.7, 0.1 + 0.7 * 0.3], [1.1, 0.1 + 1.1 * 0.3], [5.0, 0.1 + 5.0 * 0.3]];
    assert_eq!(Signal::table_without_rates(&points).longest_step(0.2, f64::INFINITY), 0.7 - 0.2);
}

#[test]
fn a_head_that_moves_keeps_its_speed_where_a_host_takes_it_over() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("even.csv");
    std::fs::write(&file, "time_s,x_m,y_m,vx_m_s,vy_m_s\n0,0,0,0,1.2\n5,0,6,0,1.2\n").unwrap();
    let position = format!("head.position_m={{ table = '{}' }}", file.display());
    let mut tail = tail(&["head.kind=driven", &position, "medium.flow_m_s=[0.0, 1.2]", "solver.duration_s=5.0"]);
    // Its first poses are close to each other, and away from the scene's by as much as it moves in between.
    for t in [0.2, 0.20001, 0.20002, 0.2005, 0.215].into_iter().chain((22..40).map(|k| 0.01 * f64::from(k))) {
        tail.do_step(t - tail.time()).unwrap();
        assert!(of(&tail, "pose_vy_m_s") > 1.1, "{t}: {}", of(&tail, "pose_vy_m_s"));
        tail.set("head_y_m", &[1.2 * t + 1e-5 + 2e-3 * (t - 0.2).powi(2)]).unwrap();
    }
}

/// The tail with a head that rests, goes 20 mm to and fro within 0.1 s, and rests.
fn bump(changes: &[&str]) -> Stepper {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("bump.csv");
    std::fs::write(
        &table,
        "time_s,x_m,y_m,vx_m_s,vy_m_s\n0,0,0,0,0\n1.0,0,0,0,0\n1.05,0,0.02,0,0\n1.1,0,0,0,0\n10,0,0,0,0\n",
    )
    .unwrap();
    let position = format!("head.position_m={{ table = '{}' }}", table.display());
    tail(&[&["head.kind=driven", &position, "solver.duration_s=3.0", "rod.nodes=17"], changes].concat())
}

#[test]
fn a_burst_after_a_long_rest_is_not_stepped_over_whatever_the_model() {
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        let mut fine = bump(&[&model, "solver.time_step_s=1e-4"]);
        fine.do_step(3.0).unwrap();
        let mut own = bump(&[&model]);
        own.do_step(3.0).unwrap();
        let [fine_work, work] = [&fine, &own].map(|tail| of(tail, "head_work_j"));
        println!("{model}: {work:e} {fine_work:e} J in {} steps", own.metrics().totals.steps);
        near(work, fine_work, 0.03, &model);
        assert!(own.metrics().totals.steps < 300);
    }
}

#[test]
fn a_step_that_ends_where_a_head_begins_to_accelerate_counts_what_held_it_until_then() {
    let folder = tempfile::tempdir().unwrap();
    let burst = vec![[0.0; 3], [1.0313, 0.0, 0.0], [1.0641, 0.01, 0.0], [1.0973, 0.0, 0.0], [3.0, 0.0, 0.0]];
    let turning = burst.iter().map(|[t, angle, _]| [*t, 5.0 * angle - 1.4 * t, -1.4]).collect::<Table>();
    let changes = tabled(&[evenly(0.0), burst, turning], folder.path());
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        let run = |pace: &[&str]| {
            let changes: Vec<&str> = changes.iter().map(String::as_str).chain(pace.iter().copied()).collect();
            let mut tail =
                tail(&[&changes[..], &["medium.viscosity_pa_s=0.1", &model, "solver.duration_s=2.0"]].concat());
            tail.do_step(2.0).unwrap();
            let push = tail.metrics().totals.impulse.head;
            let defect = of(&tail, "numerical_dissipation_j") / of(&tail, "viscous_work_j");
            ([of(&tail, "head_work_j"), push.x, push.y], defect, tail.metrics().totals.steps)
        };
        let (fine, own) = (run(&["solver.integrator=esdirk3", "solver.time_step_s=1e-4"]), run(&[]));
        println!("{model}: {own:?} {fine:?}");
        let most = fine.0[1].hypot(fine.0[2]);
        near(own.0[0], fine.0[0], 0.03, &model);
        assert!((1..3).all(|i| (own.0[i] - fine.0[i]).abs() < 0.03 * most), "{model}");
        assert!(own.1.abs() < 0.03, "{model}: {}", own.1);
    }
}

#[test]
fn a_wave_too_weak_for_the_tolerance_is_resolved() {
    let weak = r#"actuation={ kind = "travelling-wave", kappa_amp = 0.02, frequency_hz = 2.0, wavelength_m = 0.3 }"#;
    for model in ["full", "overdamped"] {
        let model = format!("solver.model={model}");
        let (mut own, mut fine) =
            (tail(&[weak, &model]), tail(&[weak, &model, "solver.time_step_s=1e-3", "solver.integrator=esdirk3"]));
        for tail in [&mut own, &mut fine] {
            tail.do_step(3.0).unwrap();
        }
        let steps = own.metrics().totals.steps;
        println!("{model}: {} {} {steps}", of(&own, "cycle_speed_m_s"), of(&fine, "cycle_speed_m_s"));
        near(of(&own, "cycle_speed_m_s"), of(&fine, "cycle_speed_m_s"), 0.05, &model);
        assert!(steps >= 96, "{model}: {steps} steps");
    }
}

#[test]
fn harmonics_of_a_wave_too_weak_for_the_tolerance_are_resolved_by_their_sizes() {
    // The 40th, by which the rod moves as fast as by the first.
    let wave = |harmonics: &[f64]| {
        format!(
            "actuation={{ kind = \"standing-wave\", kappa_amp = 1e-3, frequency_hz = 0.5, harmonics = {harmonics:?} }}"
        )
    };
    let mut high = [0.0; 39];
    high[38] = 0.025;
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        let run = |harmonics: &[f64], pace: &[&str]| {
            let wave = wave(harmonics);
            let mut tail = tail(&[&[&*wave, &model, "head.kind=clamped"], pace].concat());
            tail.do_step(2.0).unwrap();
            (of(&tail, "viscous_work_j"), tail.metrics().totals.steps)
        };
        let fine = run(&high, &["solver.integrator=esdirk3", "solver.time_step_s=5e-4"]);
        let (own, first, faint) = (run(&high, &[]), run(&[], &[]), run(&high.map(|size| 1e-6 * size), &[]));
        println!("{model}: {own:?} {fine:?} {first:?} {faint:?}");
        near(own.0, fine.0, 0.05, &model);
        assert!(fine.0 > 1.01 * first.0, "{model}");
        // What is too small to matter costs nothing.
        assert!(faint.1 <= first.1 + 2, "{model}: {} {}", faint.1, first.1);
    }
}

#[test]
fn a_ramp_that_is_over_costs_nothing() {
    for model in ["overdamped", "shape"] {
        let steps = |ramp: &str| {
            let (model, start) =
                (format!("solver.model={model}"), format!("start={{ kind = \"ramp\", ramp_s = {ramp} }}"));
            let mut tail = tail(&[WAVE, &model, &start]);
            tail.do_step(2.0).unwrap();
            tail.metrics().totals.steps
        };
        let (short, long) = (steps("0.001"), steps("0.5"));
        println!("{model}: {short} {long}");
        assert!(short < long + 40, "{model}: {short} {long}");
    }
}

#[test]
fn a_frequency_of_minus_zero_is_zero() {
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        for zero in [0.0, -0.0] {
            let mut tail = tail(&[WAVE, &model]);
            tail.do_step(0.1).unwrap();
            tail.set("actuation_frequency_hz", &[zero]).unwrap();
            tail.do_step(0.1).unwrap();
        }
        let mut still = tail(&[&WAVE.replace("2.0", "-0.0"), &model]);
        still.do_step(0.1).unwrap();
        let turned = |frequency: &str| {
            let angle = format!("head.angle_rad={{ amplitude = 0.3, frequency_hz = {frequency} }}");
            let mut tail = tail(&["head.kind=driven", &angle, &model]);
            tail.do_step(0.3).unwrap();
        };
        turned("1.0");
        turned("-0.0");
    }
}

#[test]
fn a_frequency_that_falls_to_zero_stops_the_drive_there_and_may_rise_again() {
    let changes = [WAVE, "solver.integrator=newmark", "solver.time_step_s=1e-3"];
    let mut falling = tail(&changes);
    falling.do_step(0.1).unwrap();
    falling.set_derivative("actuation_frequency_hz", 1, &[-4.0]).unwrap(); // zero at 0.6 s
    falling.do_step(0.5).unwrap();
    let (work, natural) = (of(&falling, "actuation_work_j"), falling.get("natural_curvature_1_m").unwrap());
    let moment = falling.get("joint_moment_n_m").unwrap();
    falling.do_step(0.9).unwrap();
    assert_eq!(of(&falling, "actuation_frequency_hz"), 0.0);
    assert_eq!(falling.get("natural_curvature_1_m").unwrap(), natural);
    near(of(&falling, "actuation_work_j"), work, 1e-12, "work");
    assert!(most(&falling, "vy_m_s") < 1e-3 && moment.len() > 1);
    // f = (t − 1)² − ¼ Hz is negative from ½ to 1½ s: the phase is that of ∫max(f, 0).
    let mut dipping = tail(&changes);
    dipping.set("actuation_frequency_hz", &[0.75]).unwrap();
    dipping.set_derivative("actuation_frequency_hz", 1, &[-2.0]).unwrap();
    dipping.set_derivative("actuation_frequency_hz", 2, &[2.0]).unwrap();
    dipping.do_step(1.0).unwrap();
    // Told anew in the middle of it.
    dipping.set("actuation_phase_rad", &[0.0]).unwrap();
    dipping.do_step(1.0).unwrap();
    let phase = dipping.view().dynamics.inputs.cycle(dipping.time());
    // ∫₀^½ + ∫_{3/2}^2 of t² − 2t + ¾ is twice [t³/3 − t² + ¾t] at ½.
    near(phase, TAU * 2.0 * (1.0 / 24.0 - 0.25 + 0.375), 1e-12, "phase");
}

#[test]
fn the_shape_closes_its_balance_where_inputs_go_on_by_rates() {
    let rates: [(&str, usize, f64); 6] = [
        ("actuation_frequency_hz", 1, 50.0),
        ("actuation_amplitude", 1, 50.0),
        ("actuation_amplitude", 2, 1000.0),
        ("natural_curvature_1_m", 1, 50.0),
        ("natural_curvature_1_m", 2, 1000.0),
        ("actuation_phase_rad", 2, 300.0),
    ];
    for head in ["free", "clamped"] {
        let head = format!("head.kind={head}");
        for (name, order, rate) in rates {
            let wave = WAVE.replace("frequency_hz = 2.0", "frequency_hz = 1.0");
            let mut tail = tail(&[&wave, &head, "solver.model=shape", "solver.time_step_s=1e-3"]);
            tail.do_step(0.1).unwrap();
            let before = (of(&tail, "actuation_work_j"), of(&tail, "numerical_dissipation_j"));
            let len = tail.find(name).unwrap().len(tail.model());
            tail.set_derivative(name, order, &vec![rate; len]).unwrap();
            tail.do_step(0.1).unwrap();
            let work = of(&tail, "actuation_work_j") - before.0;
            let defect = of(&tail, "numerical_dissipation_j") - before.1;
            println!("{head} {name} {order}: {defect:e} of {work:e}");
            assert!(defect.abs() < 2e-4 * work.abs(), "{head} {name} {order}: {defect:e} of {work:e}");
        }
    }
}

#[test]
fn a_head_goes_on_by_the_rates_that_were_given_once_whatever_its_poses_are_for() {
    for input in ["now", "at-end"] {
        let input_key = format!("head.input={input}");
        let changes = ["head.kind=driven", &input_key, "solver.integrator=newmark", "solver.time_step_s=1e-3"];
        let mut once = tail(&changes);
        once.set("head_x_m", &[if input == "now" { 0.0 } else { 1e-3 }]).unwrap();
        once.set("head_vx_m_s", &[0.1]).unwrap();
        for k in 1..=8 {
            once.do_step(0.01).unwrap();
            near(of(&once, "pose_x_m"), 1e-3 * f64::from(k), 1e-9, input);
            near(of(&once, "pose_vx_m_s"), 0.1, 1e-9, input);
        }
        // The velocity alone, again and again.
        let mut rate = tail(&changes);
        for k in 1..=6 {
            rate.set("head_vx_m_s", &[0.1]).unwrap();
            rate.do_step(0.01).unwrap();
            let begun = if input == "now" { of(&rate, "pose_x_m") } else { 1e-3 * (f64::from(k) - 0.5) };
            near(of(&rate, "pose_x_m"), begun, 1e-9, input);
        }
        near(of(&rate, "pose_vx_m_s"), 0.1, 1e-9, input);
    }
}

const QUADRATIC: [&str; 3] =
    ["medium={ viscosity_pa_s = 1e-3, density_kg_m3 = 1000.0 }", "drag.law=cross-flow", "solver.model=overdamped"];

#[test]
fn an_overdamped_rod_starts_and_goes_on_with_the_velocities_that_balance_its_forces() {
    let mut start = tail(&[&[WAVE, "start.kind=jump", "solver.time_step_s=1e-5"][..], &QUADRATIC].concat());
    let first = most(&start, "vy_m_s");
    start.do_step(1e-10).unwrap();
    println!("{first:e} {:e}", most(&start, "vy_m_s"));
    near(first, most(&start, "vy_m_s"), 1e-3, "first velocity");
    // Jumps of the flow: of third order, as smooth motion is.
    let end = |step: f64| {
        let step = format!("solver.time_step_s={step:e}");
        let mut tail = tail(&[&[WAVE, &step][..], &QUADRATIC].concat());
        for i in 0..5 {
            tail.set("flow_y_m_s", &[0.3 * f64::from((i + 1) % 2)]).unwrap();
            tail.do_step(0.04).unwrap();
        }
        tail.state().q.clone()
    };
    let fine = end(1.25e-4);
    let errors = [4e-3, 2e-3, 1e-3].map(|h| largest(end(h).iter().zip(&fine).map(|(a, b)| a - b)));
    println!("{errors:?}");
    assert!(order(errors[0], errors[2]) > 2.0 * 1.7, "{errors:?}");
}

#[test]
fn the_balance_in_a_flow_keeps_its_order_over_jumps_of_inputs() {
    let water = [
        "medium={ viscosity_pa_s = 0.1, density_kg_m3 = 1000.0, flow_m_s = [0.0, 0.3] }",
        "reactive={}",
        "solver.integrator=newmark",
    ];
    for head in ["free", "clamped"] {
        let head = format!("head.kind={head}");
        let defects = [8e-4, 4e-4, 2e-4].map(|step| {
            let step = format!("solver.time_step_s={step:e}");
            let mut tail = tail(&[&[WAVE, &head, &step][..], &water].concat());
            tail.do_step(0.1).unwrap();
            let before = of(&tail, "numerical_dissipation_j");
            for i in 0..8 {
                let mut force = [0.0; 9];
                force[8] = if i % 2 == 0 { 0.05 } else { -0.05 };
                tail.set("force_y_n", &force).unwrap();
                tail.do_step(8e-3).unwrap();
            }
            of(&tail, "numerical_dissipation_j") - before
        });
        println!("{head}: {defects:?}");
        assert!(order(defects[0], defects[2]) > 2.0 * 1.7, "{head}: {defects:?}");
    }
}

#[test]
fn the_tolerance_is_the_same_in_a_frame_that_moves() {
    let run = |flow: &str| {
        let flow = format!("medium={{ viscosity_pa_s = 10.0, density_kg_m3 = 1260.0, flow_m_s = {flow} }}");
        let mut tail = tail(&[WAVE, &flow, "rod.nodes=17", "solver.duration_s=5.0"]);
        tail.do_step(2.0).unwrap();
        let fine = {
            let mut tail = stepper_of(
                TAIL,
                &[WAVE, &flow, "rod.nodes=17", "solver.integrator=newmark", "solver.time_step_s=5e-4"],
            );
            tail.do_step(2.0).unwrap();
            of(&tail, "actuation_work_j")
        };
        (tail.metrics().totals.steps, of(&tail, "actuation_work_j") / fine)
    };
    let (still, stream) = (run("[0.0, 0.0]"), run("[10.0, 0.0]"));
    println!("{still:?} {stream:?}");
    assert!((still.1 - 1.0).abs() < 0.01 && (stream.1 - 1.0).abs() < 0.01, "{still:?} {stream:?}");
    near(stream.0 as f64, still.0 as f64, 0.15, "steps");
}

#[test]
fn a_step_ends_where_the_host_asked_and_never_a_rounded_multiple_of_the_own_step_later() {
    let mut tail = tail(&[WAVE, "solver.integrator=newmark", "solver.time_step_s=1e-3", "rod.nodes=3"]);
    let h = 1e-3 * (1.0 + 9e-10);
    let mut end = 0.0;
    for _ in 0..2000 {
        end += h;
        tail.do_step(h).unwrap();
    }
    assert!((tail.time() - end).abs() < 1e-14, "{:e}", tail.time() - end);
    assert_eq!(tail.metrics().totals.steps, 2000);
}

#[test]
fn a_host_that_begins_elsewhere_places_the_rod_there_at_rest() {
    for model in ["full", "overdamped", "shape"] {
        let model = format!("solver.model={model}");
        let scene = ["head.kind=driven", "head.angle_rad=0.35", "medium.viscosity_pa_s=1e-3", &model];
        let mut host = tail(&scene);
        host.set("head_angle_rad", &[0.0]).unwrap();
        host.set("head_x_m", &[0.02]).unwrap();
        let mut own = tail(&[
            "head.kind=driven",
            "head.angle_rad=0.0",
            "head.position_m=[0.02, 0.0]",
            "medium.viscosity_pa_s=1e-3",
            &model,
        ]);
        assert_eq!((host.state(), host.metrics()), (own.state(), own.metrics()), "{model}");
        for k in 0..40 {
            let t = f64::from(k) * 5e-3;
            for tail in [&mut host, &mut own] {
                tail.set("head_angle_rad", &[0.35 * (1.0 - (TAU * t).cos())]).unwrap();
                tail.set("head_x_m", &[0.02]).unwrap();
                tail.do_step(5e-3).unwrap();
            }
        }
        let [found, expected] = [&host, &own].map(|tail| of(tail, "head_work_j"));
        near(found, expected, 1e-6, &model);
        assert!(host.take_head_jump().is_none());
        // A pose that jumps later is said.
        host.set("head_x_m", &[0.06]).unwrap();
        host.do_step(5e-3).unwrap();
        let jump = host.take_head_jump().unwrap();
        near(jump.distance, 0.04, 1e-6, "jump");
        assert!(jump.to_string().contains("position x") && host.take_head_jump().is_none());
    }
    // A velocity that is given with it is the rod's.
    let mut moving = tail(&["head.kind=driven"]);
    moving.set("head_y_m", &[0.1]).unwrap();
    moving.set("head_vy_m_s", &[0.2]).unwrap();
    assert_eq!((moving.state().q[1], moving.state().v[1]), (0.1, 0.2));
    // A target too far for a step is where the run starts.
    let mut target = tail(&["head.kind=driven", "head.angle_rad=0.35", "head.input=at-end"]);
    target.set("head_angle_rad", &[0.0]).unwrap();
    target.do_step(5e-3).unwrap();
    assert!(largest(target.state().v.iter().copied()) < 1e-9);
}

#[test]
fn a_velocity_of_a_host_that_jumps_is_said_as_a_pose_is_and_a_smooth_motion_is_not() {
    let at = |t: f64| {
        let (sin, cos) = (TAU * 2.0 * t).sin_cos();
        [0.02 * (1.0 - cos), 0.02 * TAU * 2.0 * sin]
    };
    for (input, h) in [("now", 1e-3), ("now", 0.02), ("at-end", 1e-3), ("at-end", 0.02)] {
        let input_key = format!("head.input={input}");
        let mut tail = tail(&["head.kind=driven", &input_key]);
        let tell = |tail: &mut Stepper, more: f64| {
            let [y, v] = at(if input == "now" { tail.time() } else { tail.time() + h });
            tail.set("head_y_m", &[y]).unwrap();
            tail.set("head_vy_m_s", &[v + more]).unwrap();
            tail.do_step(h).unwrap();
        };
        for _ in 0..12 {
            tell(&mut tail, 0.0);
            assert_eq!(tail.take_head_jump(), None, "{input} {h}");
        }
        tell(&mut tail, 0.3);
        let jump = tail.take_head_jump().unwrap();
        assert_eq!((jump.coordinate, jump.order), (1, 1), "{input} {h}");
        near(jump.distance, 0.3, 0.05, input);
        let said = jump.to_string();
        assert!(said.contains("velocity y") && said.contains("m/s") && said.contains("first velocity"), "{said}");
        // A pose that jumps, its velocity not.
        tail.set("head_x_m", &[0.1]).unwrap();
        tail.do_step(h).unwrap();
        let jump = tail.take_head_jump().unwrap();
        assert_eq!((jump.coordinate, jump.order), (0, 0), "{input} {h}: {jump}");
    }
    // A step that fails says nothing: it is not made.
    let mut tail = tail(&["head.kind=driven", "solver.time_step_s=1e-3"]);
    tail.do_step(1e-3).unwrap();
    tail.set("head_x_m", &[1e6]).unwrap();
    assert!(tail.do_step(1e-3).is_err());
    assert_eq!(tail.take_head_jump(), None);
}

#[test]
fn a_first_velocity_unlike_the_scenes_starts_the_run_and_what_else_was_set_before_counts_at_once() {
    let scene = ["head.kind=driven", WAVE, "medium.viscosity_pa_s=0.1"];
    let host = |sets: &[(&str, f64)]| {
        let mut tail = tail(&scene);
        for (name, value) in sets {
            let len = tail.find(name).unwrap().len(tail.model());
            tail.set(name, &vec![*value; len]).unwrap();
        }
        tail
    };
    // The whole rod moves with its head; an acceleration alone is the head's.
    let moving = host(&[("head_vy_m_s", 0.2)]);
    let still = host(&[]);
    for (v, own) in moving.state().v.as_chunks::<2>().0.iter().zip(still.state().v.as_chunks::<2>().0) {
        assert!((v[1] - own[1] - 0.2).abs() < 1e-12 && (v[0] - own[0]).abs() < 1e-12, "{v:?} {own:?}");
    }
    assert_eq!(of(&moving, "head_work_j"), 0.0);
    assert_eq!(host(&[("head_ay_m_s2", 3.0)]).state().a[1], 3.0);
    // What is so anyway starts nothing, nor does a velocity for the end of a step.
    assert_eq!(host(&[("head_vy_m_s", 0.0), ("head_y_m", 0.0), ("head_ay_m_s2", 0.0)]).state(), still.state());
    // In whatever order: what else is set acts on the start as it would on one that the scene has there.
    let others = [("force_y_n", 1e-3), ("natural_curvature_1_m", 0.5), ("actuation_amplitude", 7.0)];
    let first: Vec<_> = others.into_iter().chain([("head_angle_rad", 0.4)]).collect();
    let last: Vec<_> = [("head_angle_rad", 0.4)].into_iter().chain(others).collect();
    let mut placed = tail(&[&scene[..], &["head.angle_rad=0.4"]].concat());
    for (name, value) in others {
        let len = placed.find(name).unwrap().len(placed.model());
        placed.set(name, &vec![value; len]).unwrap();
    }
    let [mut first, mut last] = [first, last].map(|sets| host(&sets));
    for k in 0..3 {
        for name in ["actuation_work_j", "load_work_j", "bending_energy_j", "numerical_dissipation_j"] {
            let expected = of(&placed, name);
            for found in [&first, &last] {
                let scale = of(&placed, "bending_energy_j");
                assert!(
                    (of(found, name) - expected).abs() < 1e-9 * scale,
                    "{k} {name}: {} {expected}",
                    of(found, name)
                );
            }
        }
        for tail in [&mut first, &mut last, &mut placed] {
            tail.set("head_angle_rad", &[0.4]).unwrap();
            tail.do_step(0.01).unwrap();
        }
    }
}

#[test]
fn a_first_step_is_as_short_as_the_scene_needs() {
    // A rod at rest, whose accelerations are rounding errors; one that hardly moves; a wave too weak to say anything.
    let weak = WAVE.replace("5.0", "1e-9");
    let still: [&[&str]; 3] = [&["head.kind=driven"], &["loads.gravity_m_s2=[0.0, -1e-9]"], &[&weak]];
    for (changes, most) in still.into_iter().zip([1e-4, 1.0, 1.0 / 32.0]) {
        for model in ["full", "overdamped", "shape"] {
            let model = format!("solver.model={model}");
            let mut tail = tail(&[changes, &["solver.duration_s=1.0", &model]].concat());
            let first = of(&tail, "time_step_s");
            assert!(first > 0.0 && first <= most, "{model} {changes:?}: {first}");
            tail.do_step(1.0).unwrap();
            let totals = tail.metrics().totals;
            println!("{model} {changes:?}: {first} {} {}", totals.steps, totals.rejections);
            assert!(totals.steps < 60 && totals.rejections < 5, "{model} {changes:?}");
        }
    }
}

#[test]
fn a_wished_step_outlives_an_end_that_cuts_it_and_nothing_else_that_does() {
    // Cut by the ends of a host's steps alone.
    let mut host = tail(&[WAVE]);
    host.do_step(0.3).unwrap();
    let wish = of(&host, "time_step_s");
    for _ in 0..5 {
        host.do_step(1e-6).unwrap();
        assert!(of(&host, "time_step_s") >= wish, "{} {wish}", of(&host, "time_step_s"));
    }
    // Cut by the rows of a burst: small steps go on from there.
    let mut cut = bump(&["solver.model=shape"]);
    cut.do_step(1.03).unwrap();
    let wish = of(&cut, "time_step_s");
    assert!(wish < 0.05, "{wish}");
}

#[test]
fn inputs_that_go_on_by_a_rate_do_the_work_that_small_steps_of_them_do() {
    let dipping = include_str!("../../models/dipping-tail.toml");
    let still =
        ["head.position_m=[0.0, 0.0]", "head.angle_rad=0.0", "solver.integrator=newmark", "rod.youngs_modulus_pa=3e8"];
    let fish = include_str!("../../models/fish.toml");
    type Case<'a> = (&'a str, &'a [&'a str], &'a str, f64, f64);
    let cases: [Case<'_>; 3] = [
        (dipping, &still, "interface_1_offset_m", -0.2, 0.4),
        (dipping, &[], "beyond_1_density_kg_m3", -1500.0, 0.3),
        (fish, &["rod.nodes=17"], "density_kg_m3", -800.0, 0.5),
    ];
    for (text, changes, name, rate, duration) in cases {
        let defects = [2e-3, 1e-3].map(|step| {
            let step_key = format!("solver.time_step_s={step:e}");
            let mut tail = stepper_of(text, &[changes, &[&step_key, "solver.integrator=newmark"]].concat());
            tail.set_derivative(name, 1, &[rate]).unwrap();
            tail.do_step(duration).unwrap();
            (of(&tail, "numerical_dissipation_j"), of(&tail, "flow_work_j").abs().max(of(&tail, "load_work_j").abs()))
        });
        println!("{name}: {defects:?}");
        // Second order, to nothing; measured at 1 ms: 1e-3, 3e-5, 6e-3.
        assert!(defects[1].0.abs() < 1e-2 * defects[1].1, "{name}: {defects:?}");
        assert!(order(defects[0].0, defects[1].0) > 1.7, "{name}: {defects:?}");
    }
}

#[test]
fn the_rate_of_the_power_that_a_changing_density_brings_is_that_of_the_power() {
    let power = caudal::variable::VARIABLES.iter().find(|variable| variable.name == "flow_power_w").unwrap();
    let mut fish = stepper_of(
        include_str!("../../models/fish.toml"),
        &["rod.nodes=9", "solver.integrator=newmark", "solver.time_step_s=1e-4"],
    );
    fish.set_derivative("density_kg_m3", 1, &[-800.0]).unwrap();
    fish.do_step(0.3).unwrap();
    let (rate, before) = (fish.rates().unwrap().of(power, 0).unwrap(), power.first(&fish.view()));
    fish.do_step(1e-4).unwrap();
    let (next, after) = (fish.rates().unwrap().of(power, 0).unwrap(), power.first(&fish.view()));
    println!("{rate:e} {next:e} {:e}", (after - before) / 1e-4);
    near((after - before) / 1e-4, 0.5 * (rate + next), 1e-3, "rate of the power");
}

#[test]
fn what_inputs_that_go_on_by_rates_bring_has_its_derivatives_by_the_others() {
    let variable = |name: &str| caudal::variable::VARIABLES.iter().find(|variable| variable.name == name).unwrap();
    let cases = [
        (include_str!("../../models/fish.toml"), "density_kg_m3", -800.0, &["flow_x_m_s", "flow_y_m_s"][..]),
        (
            include_str!("../../models/dipping-tail.toml"),
            "interface_1_offset_m",
            -0.2,
            &["flow_x_m_s", "density_kg_m3", "beyond_1_density_kg_m3"],
        ),
        (
            include_str!("../../models/dipping-tail.toml"),
            "beyond_1_density_kg_m3",
            -900.0,
            &["flow_x_m_s", "density_kg_m3", "interface_1_offset_m"],
        ),
    ];
    for (text, going, rate, inputs) in cases {
        let mut tail = stepper_of(text, &["rod.nodes=9", "solver.integrator=newmark", "solver.time_step_s=1e-3"]);
        tail.do_step(0.1).unwrap();
        tail.set_derivative(going, 1, &[rate]).unwrap();
        tail.do_step(0.01).unwrap();
        let before = tail.save();
        for input in inputs {
            let change = tail.directional(|seed| seed.set(variable(input), &[1.0])).unwrap();
            let exact = change.of(variable("flow_power_w"), 0).unwrap();
            let now = of(&tail, input);
            let step = 1e-5 * now.abs().max(1e-2);
            let [more, less] = [1.0, -1.0].map(|sign| {
                tail.restore(&before).unwrap();
                tail.set(input, &[now + sign * step]).unwrap();
                of(&tail, "flow_power_w")
            });
            tail.restore(&before).unwrap();
            println!("{going}: by {input}: {exact:e} {:e}", (more - less) / (2.0 * step));
            near(exact, (more - less) / (2.0 * step), 1e-5, input);
        }
    }
}

#[test]
fn interfaces_keep_their_order_wherever_a_host_moves_them() {
    let three = r#"
name = "three"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.006
depth_m = 0.03
youngs_modulus_pa = 3e7
density_kg_m3 = 1100.0
[medium]
viscosity_pa_s = 1.8e-5
density_kg_m3 = 1.2
[[medium.layers]]
normal = [0.0, -1.0]
offset_m = 0.06
thickness_m = 0.03
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[[medium.layers]]
offset_m = 0.16
thickness_m = 0.03
viscosity_pa_s = 1.8e-5
density_kg_m3 = 1.2
[drag]
law = "cross-flow"
[reactive]
[head]
kind = "clamped"
[solver]
time_step_s = 1e-3
duration_s = 1.0
"#;
    let mut tail = stepper_of(three, &[]);
    tail.do_step(0.01).unwrap();
    let (state, inputs) = (tail.state().clone(), tail.get("interface_1_offset_m").unwrap());
    for (name, value) in [("interface_1_offset_m", 0.5), ("interface_2_offset_m", 0.08)] {
        let error = tail.set(name, &[value]).unwrap_err();
        assert!(matches!(error, Error::BadValue { .. }) && error.to_string().contains("interface_"), "{error}");
    }
    // Both at once may go anywhere.
    let both = [("interface_1_offset_m", [0.5]), ("interface_2_offset_m", [0.6])];
    let changes =
        both.each_ref().map(|(name, values)| InputChange { variable: tail.find(name).unwrap(), order: 0, values });
    assert_eq!((tail.state(), tail.get("interface_1_offset_m").unwrap()), (&state, inputs));
    tail.set_all(changes.into_iter()).unwrap();
    // By a rate.
    let mut tail = stepper_of(three, &[]);
    tail.set_derivative("interface_1_offset_m", 1, &[2.0]).unwrap();
    let error = tail.do_step(0.1).unwrap_err();
    assert!(matches!(error, Error::BadValue { name: "interface_2_offset_m", .. }), "{error}");
    assert_eq!(tail.time(), 0.0);
}

#[test]
fn averages_over_cycles_that_will_never_be_read_as_absent() {
    let mut tail = tail(&["head.kind=driven", "head.angle_rad={ amplitude = 0.1, frequency_hz = 2.0 }"]);
    assert_eq!(of(&tail, "cycle_thrust_n"), 0.0);
    for k in 0..100 {
        tail.set("head_angle_rad", &[0.1 * (TAU * 2.0 * f64::from(k) * 0.01).sin() + 1e-9]).unwrap();
        tail.do_step(0.01).unwrap();
    }
    assert_eq!(of(&tail, "cycles_used"), 0.0);
    assert!(of(&tail, "cycle_thrust_n").is_nan());
    assert!(tail.find("cycle_thrust_n").unwrap().description.contains("NaN"));
}

#[test]
fn what_a_host_does_wrong_loses_nothing() {
    // A refused input leaves the last step readable, and a step that waits can be read at its time.
    let mut tail = tail(&[WAVE, "solver.integrator=newmark", "solver.time_step_s=1e-3"]);
    tail.do_step(2e-3).unwrap();
    let before = tail.at(1.5e-3, |view| view.state.q.clone()).unwrap();
    assert!(tail.set("natural_curvature_1_m", &[1e200; 7]).is_err());
    assert_eq!(tail.at(1.5e-3, |view| view.state.q.clone()).unwrap(), before);
    tail.do_step(1e-17).unwrap();
    let now = tail.time();
    assert_eq!(tail.at(now, |view| view.state.q.clone()).unwrap(), tail.state().q);
    // Rates of readings do not depend on how long the next step is wished to be.
    let mut long =
        common::stepper_of(TAIL, &["head.kind=driven", "head.angle_rad={ amplitude = 0.3, frequency_hz = 5.0 }"]);
    long.do_step(1e-3).unwrap();
    let rate = long
        .rates()
        .unwrap()
        .of(caudal::variable::VARIABLES.iter().find(|v| v.name == "pose_spin_rad_s").unwrap(), 0)
        .unwrap();
    let omega = TAU * 5.0;
    near(rate, -0.3 * omega * omega * (omega * 1e-3).sin(), 1e-9, "spin");
    assert!(scene_of(TAIL, &[]).steps().is_none());
}

/// A scene with drives of any kind.
struct Drives {
    changes: Vec<String>,
    /// What a host says of the head: when, and which variables are what.
    words: Vec<(f64, Vec<(&'static str, f64)>)>,
    /// The velocity (m/s) of the frame in which fluid and head are seen; the rod's motion in it is that in a frame at rest.
    frame: [f64; 2],
}

/// A table of a coordinate of the head: (time, value, rate).
type Table = Vec<[f64; 3]>;

/// The coordinates of a head: value and rate.
const HEAD: [[&str; 2]; 3] =
    [["head_x_m", "head_vx_m_s"], ["head_y_m", "head_vy_m_s"], ["head_angle_rad", "head_spin_rad_s"]];

/// An angle (rad) counts as so many lengths (m) of a drive.
const ANGLES: [f64; 3] = [1.0, 1.0, 8.0];

/// Rests and bursts to 2 s and beyond, on top of a motion at `speed`.
fn bursts(dice: &mut Dice, unit: f64, speed: f64) -> Table {
    let (mut rows, mut t) = (vec![[0.0, 0.0, speed]], 0.0);
    while t < 2.0 {
        t += dice.between(0.2, 1.0);
        rows.push([t, speed * t, speed]);
        let (size, span) = (10.0_f64.powf(dice.between(-4.0, -1.7)), 10.0_f64.powf(dice.between(-1.5, -0.7)));
        for (part, value) in [(0.5, unit * size), (1.0, 0.0)] {
            rows.push([t + part * span, value + speed * (t + part * span), speed]);
        }
        t += span;
    }
    rows
}

/// A motion at `speed`.
fn evenly(speed: f64) -> Table {
    vec![[0.0, 0.0, speed], [3.0, 3.0 * speed, speed]]
}

/// The changes that make those tables the motion of the head.
fn tabled([x, y, angle]: &[Table; 3], folder: &std::path::Path) -> [String; 3] {
    let write = |name: &str, header: &str, rows: String| {
        let file = folder.join(name);
        std::fs::write(&file, format!("{header}\n{rows}")).unwrap();
        file.display().to_string()
    };
    // x and y stand in one file: each at the other's times too.
    let at = |table: &Table, t: f64| {
        let after = table.partition_point(|row| row[0] <= t).clamp(1, table.len() - 1);
        let [from, to] = [after - 1, after].map(|i| table[i]).map(|[time, value, rate]| Row { time, value, rate });
        let sample = hermite(&from, &to, t);
        if t < to.time { [sample.value, sample.rate] } else { [to.value, to.rate] }
    };
    let end = [x, y].map(|table| table[table.len() - 1][0]).into_iter().fold(f64::INFINITY, f64::min);
    let mut times: Vec<f64> = [x, y].into_iter().flatten().map(|row| row[0]).filter(|t| *t <= end).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let rows = times.iter().map(|t| {
        let [[x, vx], [y, vy]] = [at(x, *t), at(y, *t)];
        format!("{t:e},{x:e},{y:e},{vx:e},{vy:e}\n")
    });
    let position = write("xy.csv", "time_s,x_m,y_m,vx_m_s,vy_m_s", rows.collect());
    let rows = angle.iter().map(|[t, value, rate]| format!("{t:e},{value:e},{rate:e}\n"));
    let angle = write("angle.csv", "time_s,angle_rad,spin_rad_s", rows.collect());
    [
        "head.kind=driven".to_string(),
        format!("head.position_m={{ table = '{position}' }}"),
        format!("head.angle_rad={{ table = '{angle}' }}"),
    ]
}

fn any_drives(dice: &mut Dice, folder: &std::path::Path) -> Drives {
    let mut pick = |count: usize| (dice.between(0.0, count as f64) as usize).min(count - 1);
    let (model, drive, start, surroundings, driven, tells) = (pick(3), pick(5), pick(2), pick(3), 1 + pick(7), pick(2));
    let driven = [0, 1, 2].map(|i| driven >> i & 1 == 1);
    let model = ["full", "overdamped", "shape"][model];
    let mut changes =
        vec![format!("solver.model={model}"), "rod.nodes=7".to_string(), "solver.duration_s=2.0".to_string()];
    let mut speed = |most: f64| dice.between(0.1, most) * if dice.between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
    let speeds = [speed(5.0), speed(5.0), speed(3.0)];
    // Still, in a frame that moves, or in a stream that passes a held head. A head is moved with the frame along each coordinate that
    // is driven, and turns evenly where its angle is.
    let moving = surroundings == 1 && matches!(drive, 1 | 4);
    let along = |i: usize| if moving && driven[i] { speeds[i] } else { 0.0 };
    let frame = if surroundings == 1 && drive == 0 { [speeds[0], speeds[1]] } else { [along(0), along(1)] };
    let flow = if surroundings == 2 { [speeds[0], speeds[1]] } else { frame };
    let viscosity = 10.0_f64.powf(dice.between(-1.0, 1.0));
    changes.push(format!("medium={{ viscosity_pa_s = {viscosity:e}, density_kg_m3 = 1000.0, flow_m_s = {flow:?} }}"));
    if start == 1 {
        changes.push(format!("start={{ kind = \"ramp\", ramp_s = {:e} }}", 10.0_f64.powf(dice.between(-2.0, 0.0))));
    }
    let wave = |dice: &mut Dice| {
        let (size, frequency) = (10.0_f64.powf(dice.between(-1.5, 0.8)), 10.0_f64.powf(dice.between(-0.5, 0.8)));
        format!(
            "actuation={{ kind = \"travelling-wave\", kappa_amp = {size:e}, frequency_hz = {frequency:e}, wavelength_m = 0.3 }}"
        )
    };
    let mut words = Vec::new();
    match drive {
        0 => changes.push(wave(dice)),
        1 => {
            let table = |i: usize| if driven[i] { bursts(dice, ANGLES[i], along(i)) } else { evenly(0.0) };
            changes.extend(tabled(&[0, 1, 2].map(table), folder));
        }
        2 => {
            // Sinusoids far apart in frequency.
            let [slow, fast] = [dice.between(0.2, 1.0), dice.between(3.0, 15.0)];
            let [wide, narrow] = [dice.between(0.001, 0.05), 10.0_f64.powf(dice.between(-4.0, -1.5))];
            let first = format!("{{ amplitude = {wide:e}, frequency_hz = {slow:e} }}");
            let second = format!("{{ amplitude = {narrow:e}, frequency_hz = {fast:e} }}");
            let [x, y, angle] = match driven {
                [true, false, false] => [&first, &second, "0.0"],
                [true, ..] => [&first, "0.0", &second],
                [_, true, _] => ["0.0", &first, &second],
                _ => ["0.0", &second, &first],
            };
            changes.push("head.kind=driven".to_string());
            changes.push(format!("head.position_m=[{x}, {y}]"));
            changes.push(format!("head.angle_rad={angle}"));
        }
        3 => {
            changes.push(wave(dice));
            changes.push("head.kind=clamped".to_string());
        }
        _ => {
            // A host's poses at odd times, with velocities or without, and the scene's motion before.
            changes.extend(tabled(&[0, 1, 2].map(|i| evenly(along(i))), folder));
            let (size, frequency, mut t) = (dice.between(1e-3, 2e-2), dice.between(0.5, 2.0), dice.between(0.05, 0.5));
            let first = t;
            while t < 2.0 {
                let (sin, cos) = (TAU * frequency * (t - first)).sin_cos();
                let word = |i: usize| {
                    let (size, speed) = (size * ANGLES[i], along(i));
                    let value = (HEAD[i][0], size * (1.0 - cos) + speed * t);
                    let rate = (HEAD[i][1], TAU * frequency * size * sin + speed);
                    [Some(value), (tells == 1).then_some(rate)]
                };
                words.push((t, (0..3).filter(|i| driven[*i]).flat_map(word).flatten().collect()));
                t += 10.0_f64.powf(dice.between(-4.0, -1.6));
            }
        }
    }
    Drives { changes, words, frame }
}

/// Runs it to `end` (s) with the host's words.
fn driven(drives: &Drives, pace: &[&str], end: f64) -> Result<Stepper, Error> {
    let changes: Vec<&str> = drives.changes.iter().map(String::as_str).chain(pace.iter().copied()).collect();
    let mut tail = tail(&changes);
    for (time, values) in drives.words.iter().take_while(|(time, _)| *time < end) {
        tail.do_step(time - tail.time())?;
        let change = |(name, value): &(&str, f64)| Ok((tail.find(name)?, [*value]));
        let values = values.iter().map(change).collect::<Result<Vec<_>, Error>>()?;
        tail.set_all(values.iter().map(|(variable, values)| InputChange { variable, order: 0, values }))?;
    }
    tail.do_step(end - tail.time())?;
    Ok(tail)
}

/// The largest distance (of lengths) between two runs of those drives, and between their works (of the larger of work and
/// dissipation), as seen in the frame that moves with them.
fn between_runs(drives: &Drives, own: &Stepper, fine: &Stepper) -> [f64; 2] {
    let apart = largest(own.state().q.iter().zip(&fine.state().q).map(|(a, b)| a - b)) / 0.3;
    let work = |tail: &Stepper| {
        let push = tail.metrics().totals.impulse.head;
        of(tail, "actuation_work_j") + of(tail, "head_work_j") - push.x * drives.frame[0] - push.y * drives.frame[1]
    };
    let scale = of(fine, "viscous_work_j").max(work(fine).abs());
    [apart, (work(own) - work(fine)).abs() / scale.max(1e-12)]
}

#[test]
fn the_default_run_is_the_run_of_fine_steps_whatever_the_drives() {
    const BOUNDS: [f64; 2] = [2e-2, 5e-2];
    // The number of scenes by CAUDAL_SCENES, the first by CAUDAL_SCENE.
    let number = |key: &str, other: u64| std::env::var(key).ok().and_then(|text| text.parse().ok()).unwrap_or(other);
    let (count, first) = (number("CAUDAL_SCENES", 12), number("CAUDAL_SCENE", 0));
    let (mut failed, mut worst, mut unstable) = (Vec::new(), [0.0_f64; 2], 0);
    for scene in first..first + count {
        let folder = tempfile::tempdir().unwrap();
        let drives = any_drives(&mut Dice(1000 + scene), folder.path());
        let changes = &drives.changes;
        let fine =
            |step: f64| driven(&drives, &["solver.integrator=esdirk3", &format!("solver.time_step_s={step:e}")], 2.0);
        let (own, fine, finer) = match (driven(&drives, &[], 2.0), fine(2.5e-4)) {
            (Ok(own), Ok(found)) => (own, found, || fine(1.25e-4)),
            (Err(a), Err(_)) => {
                println!("{scene}: both fail: {a}");
                continue;
            }
            (own, fine) => {
                failed.push(format!("{scene}: {:?} {:?} {changes:?}", own.err(), fine.err()));
                continue;
            }
        };
        let found = between_runs(&drives, &own, &fine);
        if std::env::var("CAUDAL_SCENES").is_ok() {
            let [own, fine] = [&own, &fine].map(|tail| tail.metrics().totals.steps);
            println!("{scene}: {:.1e} {:.1e} {own} of {fine} {}", found[0], found[1], changes[0]);
        }
        let beyond = |found: [f64; 2]| (0..2).any(|i| found[i] > BOUNDS[i]);
        if !beyond(found) {
            worst = [worst[0].max(found[0]), worst[1].max(found[1])];
            continue;
        }
        // The fine steps may be the coarser ones; where finer ones are elsewhere still, as in chaos, nothing is known.
        let finer = finer().unwrap();
        let (own, fine) = (between_runs(&drives, &own, &finer), between_runs(&drives, &fine, &finer));
        let open = (0..2).any(|i| fine[i] > 0.2 * BOUNDS[i]);
        unstable += u64::from(open);
        if open || beyond(own) {
            let line =
                format!("{scene}: {own:?}, {fine:?} where steps are halved: {changes:?} {:?}", drives.words.len());
            println!("{line}");
            if !open {
                failed.push(line)
            }
        }
    }
    println!("worst: {worst:?}, open: {unstable}");
    // Where a stretching that nothing damps rings by less than the tolerance bounds, its energy may be off: one in thousands.
    assert!(failed.len() as u64 <= count / 1000 && unstable <= count / 100, "{}", failed.join("\n"));
}
