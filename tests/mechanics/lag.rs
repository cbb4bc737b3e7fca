//! A drive with a lag gives y of the x that is asked for, τ dy/dt = x − y.

use std::f64::consts::TAU;

use caudal::actuation::{Actuation, ActuationInputs, ActuationKind, KINDS};
use caudal::scene::Document;
use caudal::stepper::Stepper;
use nalgebra::Complex;

use crate::common::{SOFT, largest, scene_of, soft_moments, stepper_of};

const TAU_S: f64 = 0.15;

/// What the joints are given at its time, with its rate: natural curvature, or active moments.
fn given(stepper: &Stepper) -> [Vec<f64>; 2] {
    let dynamics = stepper.view().dynamics;
    match &dynamics.active {
        Some(active) => [active.moment.clone(), active.rate.clone()],
        None => [dynamics.natural.clone(), dynamics.natural_rate.clone()],
    }
}

fn scenes() -> [(String, &'static str); 2] {
    [(SOFT.to_string(), "natural_curvature_1_m"), (soft_moments(), "active_moment_n_m")]
}

/// Sets inputs of a run between its steps as a host does, at the step of that number.
fn steer(stepper: &mut Stepper, input: &str, step: usize, derivatives: bool) {
    let joints = stepper.model().rod.joints().len();
    let own = |size: f64| (0..joints).map(|k| size * (1.0 + k as f64)).collect::<Vec<f64>>();
    let amplitude = if input == "active_moment_n_m" { "actuation_moment_n_m" } else { "actuation_amplitude" };
    match step {
        7 => stepper.set(amplitude, &[3.0]).unwrap(),
        11 => stepper.set("actuation_frequency_hz", &[2.3]).unwrap(),
        17 => stepper.set(input, &own(0.2)).unwrap(),
        23 if derivatives => stepper.set_derivative(input, 1, &own(0.5)).unwrap(),
        24 if derivatives => stepper.set_derivative(input, 3, &own(-4.0)).unwrap(),
        26 if derivatives => stepper.set_derivative(amplitude, 2, &[20.0]).unwrap(),
        29 if derivatives => stepper.set_derivative("actuation_phase_rad", 1, &[1.5]).unwrap(),
        33 => stepper.set("actuation_phase_rad", &[0.7]).unwrap(),
        _ => {}
    }
}

#[test]
fn what_is_given_follows_what_is_asked_for_at_every_time_and_whatever_a_host_does() {
    let mut worst = [0.0_f64; 3];
    for (text, input) in scenes() {
        let starts =
            ["{kind=\"jump\"}", "{kind=\"shaped\"}", "{kind=\"ramp\",ramp_s=0.3}", "{kind=\"ramp\",ramp_s=0.012}"];
        for (start, head) in starts.iter().flat_map(|start| ["free", "clamped"].map(|head| (start, head))) {
            let changes = [
                &format!("start={start}")[..],
                &format!("head.kind={head}"),
                "actuation.harmonics=[0.3,0.1]",
                "solver.time_step_s=5e-3",
            ];
            let mut asking = stepper_of(&text, &changes);
            let mut giving = stepper_of(&text, &[&changes[..], &[&format!("actuation.lag_s={TAU_S}")]].concat());
            // Its answer by 32 steps of the classical Runge-Kutta method on the exact input, for each step.
            let rod = &giving.model().rod;
            let (joints, spacing) = (rod.joints(), rod.spacing);
            let unit = if input == "active_moment_n_m" { 1.0 } else { spacing };
            let [mut y, mut rate] = given(&giving);
            if *start == starts[0] || start.contains("ramp") {
                assert!(y.iter().all(|y| *y == 0.0), "{start}: not from rest");
            }
            for step in 0..60 {
                for stepper in [&mut asking, &mut giving] {
                    let before = given(stepper);
                    steer(stepper, input, step, true);
                    if stepper.model().lag.is_some() {
                        let jump = largest(before[0].iter().zip(&given(stepper)[0]).map(|(a, b)| a - b)) / unit;
                        assert!(jump < 1e-12, "{start}, step {step}: what is given jumps by {jump:e}");
                    }
                }
                let h = 5e-3;
                let parts = 32;
                let mut asked = vec![given(&asking)[0].clone()];
                for _ in 0..2 * parts {
                    asking.do_step(h / f64::from(2 * parts)).unwrap();
                    asked.push(given(&asking)[0].clone());
                }
                let part = h / f64::from(parts);
                for three in asked.windows(3).step_by(2) {
                    for k in joints.clone() {
                        let slope = |x: f64, y: f64| (x - y) / TAU_S;
                        let a = slope(three[0][k], y[k]);
                        let b = slope(three[1][k], y[k] + 0.5 * part * a);
                        let c = slope(three[1][k], y[k] + 0.5 * part * b);
                        let d = slope(three[2][k], y[k] + part * c);
                        y[k] += part / 6.0 * (a + 2.0 * b + 2.0 * c + d);
                    }
                }
                giving.do_step(h).unwrap();
                let [found, found_rate] = given(&giving);
                for k in joints.clone() {
                    worst[0] = worst[0].max((found[k] - y[k]).abs() / unit);
                    let expected = (asked[asked.len() - 1][k] - found[k]) / TAU_S;
                    worst[1] = worst[1].max((found_rate[k] - expected).abs() / unit);
                }
                rate.clone_from(&found_rate);
            }
            worst[2] = worst[2].max(largest(rate.iter().copied()) / unit);
        }
    }
    println!("{:e}, rate {:e}, of a rate of {:e}", worst[0], worst[1], worst[2]);
    // Of the rate, to rounding; the rest is the error of the steps of the comparison, in the short ramp.
    assert!(worst[0] < 2e-9 && worst[1] < 1e-11 && worst[2] > 1.0, "{worst:?}");
}

#[test]
fn a_steady_wave_is_given_smaller_and_later_as_the_closed_form_says() {
    for (text, _) in scenes() {
        for frequency in [0.5, 2.0, 7.0] {
            let changes =
                ["start={kind=\"shaped\"}", "head.kind=clamped", &format!("actuation.frequency_hz={frequency}")];
            let asking = stepper_of(&text, &changes);
            let mut giving = stepper_of(&text, &[&changes[..], &[&format!("actuation.lag_s={TAU_S}")]].concat());
            let omega = TAU * frequency;
            let (size, late) = ((1.0 + (omega * TAU_S).powi(2)).sqrt().recip(), (omega * TAU_S).atan() / omega);
            // What was asked for that long ago.
            let mut model = scene_of(&text, &changes).model().unwrap();
            let (actuation, _) = model.actuation.take().unwrap();
            let rod = &model.rod;
            for step in 0..3 {
                let time = giving.time();
                let mut then = vec![0.0; rod.nodes];
                let amplitude = asking.view().inputs.drive.amplitude;
                actuation.add_derivatives([size * amplitude, 0.0, 0.0], omega * (time - late), &mut then);
                rod.at_joints(&mut then);
                let [found, _] = given(&giving);
                let joints = rod.joints().skip(1);
                let apart = largest(joints.clone().map(|k| found[k] - then[k]));
                let most = largest(joints.map(|k| then[k]));
                assert!(apart <= 1e-13 * most && most > 0.0, "{frequency} Hz, step {step}: {apart:e} of {most:e}");
                giving.do_step(0.013).unwrap();
            }
        }
    }
}

#[test]
fn the_answer_of_an_own_actuation_is_that_of_the_built_in_waves() {
    /// A wave that says no more than it must.
    #[derive(Debug)]
    struct Plain(Box<dyn Actuation>);

    impl Actuation for Plain {
        fn add(&self, wave: caudal::actuation::Wave, given: &mut [f64], rate: &mut [f64]) {
            self.0.add(wave, given, rate);
        }
        fn add_derivatives(&self, sizes: [f64; 3], phase: f64, out: &mut [f64]) {
            self.0.add_derivatives(sizes, phase, out);
        }
        fn harmonics(&self) -> Vec<(f64, f64)> {
            self.0.harmonics()
        }
        fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation> {
            self.0.profiled(factors, phases)
        }
    }

    for ActuationKind { name, build, .. } in KINDS {
        let harmonics = [0.4, 0.0, -0.2];
        let inputs = ActuationInputs {
            nodes: 9,
            front: 0,
            spacing: 0.01,
            envelope: [0.3, 0.6],
            reference_length: 1.0,
            wavelength: 0.11,
            harmonics: &harmonics,
            slope: 0.8,
        };
        let built = build(&inputs);
        let plain = Plain(build(&inputs));
        let factor = |order: f64| Complex::new(1.0, 0.7 * order).inv();
        for phase in [0.0, 0.4, 2.9, -17.0] {
            let [mut own, mut default] = [vec![0.0; 9], vec![0.0; 9]];
            built.add_filtered(&factor, phase, &mut own);
            plain.add_filtered(&factor, phase, &mut default);
            let mut filtered = vec![0.0; 9];
            built.filtered(&factor, 9).add_derivatives([1.0, 0.0, 0.0], phase, &mut filtered);
            let most = largest(own.iter().copied());
            let apart = |other: &[f64]| largest(own.iter().zip(other).map(|(a, b)| a - b));
            assert!(apart(&default) <= 1e-12 * most, "{name}: {:e} of {most:e}", apart(&default));
            assert!(apart(&filtered) <= 1e-13 * most, "{name}: {:e} of {most:e}", apart(&filtered));
        }
    }
}

#[test]
fn a_short_lag_changes_a_motion_in_proportion_and_the_balance_closes_with_any() {
    let run = |changes: &[&str]| {
        let settings = ["start={kind=\"ramp\",ramp_s=0.1}", "solver.integrator=newmark", "solver.time_step_s=5e-4"];
        let mut stepper = stepper_of(SOFT, &[changes, &settings].concat());
        stepper.do_step(0.3).unwrap();
        stepper
    };
    let [none, short, shorter, long] =
        [&[][..], &["actuation.lag_s=1e-5"], &["actuation.lag_s=1e-12"], &["actuation.lag_s=0.1"]].map(run);
    let apart = |other: &Stepper| largest(none.state().q.iter().zip(&other.state().q).map(|(a, b)| a - b));
    // In proportion to the lag: measured 1.7092 and 1.7087 m/s.
    let [first, second] = [apart(&short) / 1e-5, apart(&shorter) / 1e-12];
    println!("{first:e} {second:e} m/s, {:e} m", apart(&long));
    assert!((first / second - 1.0).abs() < 2e-3 && apart(&long) > 1e-3, "{first:e} {second:e}");
    let work = long.get_scalar("actuation_work_j").unwrap();
    let defect = long.metrics().numerical_dissipation();
    println!("{work:e} J, {defect:e} J of defect");
    assert!(defect.abs() < 1e-3 * work.abs(), "{defect:e} of {work:e}");
}

#[test]
fn a_saved_run_goes_on_with_what_the_drive_still_gives() {
    for (text, input) in scenes() {
        let mut stepper = stepper_of(&text, &[&format!("actuation.lag_s={TAU_S}"), "head.kind=clamped"]);
        for step in 0..20 {
            steer(&mut stepper, input, step, false);
            stepper.do_step(0.011).unwrap();
        }
        let saved = stepper.save().serialize().unwrap();
        let mut other = stepper_of(&text, &[&format!("actuation.lag_s={TAU_S}"), "head.kind=clamped"]);
        let saved = other.deserialize(&saved).unwrap();
        other.restore(&saved).unwrap();
        for stepper in [&mut stepper, &mut other] {
            stepper.do_step(0.05).unwrap();
        }
        assert_eq!(stepper.state(), other.state());
    }
}

#[test]
fn what_a_lag_cannot_have_is_refused_in_a_line() {
    for (change, words) in [("actuation.lag_s=0.0", "a positive number"), ("actuation.lag_s=-1.0", "a positive number")]
    {
        let mut document = Document::new("lagging.toml", SOFT);
        let error = document.set(change).and_then(|()| document.scene().map(|_| ())).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("actuation.lag_s"), "{error}");
    }
    let mut stepper = stepper_of(SOFT, &["actuation.lag_s=0.1"]);
    let error = stepper.set_derivative("actuation_frequency_hz", 1, &[0.5]).unwrap_err().to_string();
    assert!(error.contains("a drive with a lag needs a frequency that is constant"), "{error}");
    stepper.set_derivative("actuation_frequency_hz", 1, &[0.0]).unwrap();
    stepper.do_step(0.1).unwrap();
}

#[test]
fn a_steady_wave_with_a_lag_moves_the_body_as_a_smaller_and_later_one_without() {
    let omega = TAU * 1.5;
    let (size, late) = ((1.0 + (omega * TAU_S).powi(2)).sqrt().recip(), (omega * TAU_S).atan());
    let kinds = [
        ["solver.model=full", "solver.form=positions"],
        ["solver.model=full", "solver.form=chain"],
        ["solver.model=overdamped", "solver.time_step_s=2e-3"],
        ["solver.model=shape", "solver.time_step_s=2e-3"],
    ];
    for (kind, head) in kinds.iter().flat_map(|kind| ["free", "clamped"].map(|head| (kind, head))) {
        let common = [kind[0], kind[1], &format!("head.kind={head}"), "start={kind=\"shaped\"}"];
        let lag = format!("actuation.lag_s={TAU_S}");
        let wave = [
            format!("actuation.kappa_amp={:e}", 4.0 * size),
            format!("actuation.phase_profile_rad=[[0.0,{late:e}],[1.0,{late:e}]]"),
        ];
        let mut lagging = stepper_of(SOFT, &[&common[..], &[&lag]].concat());
        let mut plain = stepper_of(SOFT, &[&common[..], &[&wave[0], &wave[1]]].concat());
        for stepper in [&mut lagging, &mut plain] {
            stepper.do_step(0.4).unwrap();
        }
        let apart = largest(lagging.state().q.iter().zip(&plain.state().q).map(|(a, b)| a - b));
        let moved = largest(plain.state().q.iter().skip(1).step_by(2).copied());
        let power = [&lagging, &plain].map(|stepper| stepper.get_scalar("actuation_power_w").unwrap());
        println!("{kind:?} {head}: {apart:e} m of {moved}, {power:?} W");
        assert!(apart < 1e-10 && moved > 1e-2, "{kind:?} {head}: {apart:e}");
        assert!((power[0] / power[1] - 1.0).abs() < 1e-6, "{kind:?} {head}: {power:?}");
    }
}
