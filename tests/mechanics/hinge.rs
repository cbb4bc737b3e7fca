//! A head on a hinge: it turns as an oscillator with the inertia of its tail does, as far as its motor's torque goes.

use std::f64::consts::TAU;
use std::time::Duration;

use caudal::report::Summary;
use caudal::rod::node;
use caudal::run::{Ending, Outcome};
use caudal::scene::Document;
use caudal::stepper::Stepper;

use crate::common::{document_of, largest, stepper_of};

/// A tail of 0.2 m, stiff against all that moves it here, on a servo.
const SERVO: &str = r#"
[rod]
nodes = 9
length_m = 0.2
outer_radius_m = 0.005
inner_radius_m = 0.0
youngs_modulus_pa = 1e12
density_kg_m3 = 1100.0
[head]
kind = "hinged"
inertia_kg_m2 = 1e-4
stiffness_n_m = 0.4
damping_n_m_s = 4e-3
[start]
kind = "jump"
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-3
duration_s = 1.0
newton_tolerance = 1e-12
"#;

/// Without its motor.
const FREE: &str = "stiffness_n_m=0.0,damping_n_m_s=0.0";

fn servo(changes: &[&str]) -> Stepper {
    stepper_of(SERVO, changes)
}

fn document(changes: &[&str]) -> Document {
    document_of("servo.toml", SERVO, changes)
}

fn get(stepper: &Stepper, name: &str) -> f64 {
    stepper.get(name).unwrap()[0]
}

fn refusal(changes: &[&str]) -> String {
    document(changes).scene().and_then(|scene| Stepper::of(&scene)).map(|_| ()).unwrap_err().to_string()
}

/// The inertia (kg m²) of the straight tail about its head.
fn inertia(stepper: &Stepper) -> f64 {
    let rod = &stepper.model().rod;
    (0..rod.nodes).map(|k| rod.mass[k] * rod.arc_length(k).powi(2)).sum()
}

#[test]
fn a_torque_turns_a_stiff_tail_as_an_oscillator_with_its_inertia() {
    // Below resonance, near it and above, by a torque and by a command, with both forms.
    for frequency in [0.5, 2.0, 3.125, 6.25] {
        for (key, by_command) in [("head.torque_n_m", false), ("head.angle_rad", true)] {
            for form in ["positions", "chain"] {
                let signal = format!("{key}={{amplitude=0.02,frequency_hz={frequency:e}}}");
                let mut stepper = servo(&[&signal, &format!("solver.form={form}"), "solver.time_step_s=2.5e-4"]);
                let whole = 1e-4 + inertia(&stepper);
                let omega = TAU * frequency;
                let (re, im) = (0.4 - whole * omega * omega, 4e-3 * omega);
                let expected = 0.02 * if by_command { 0.4 } else { 1.0 } / re.hypot(im);
                let delay = im.atan2(re);
                stepper.do_step(3.0).unwrap(); // what it began with has decayed to exp(-3 c/2I)
                let decayed = (-3.0 * 4e-3 / (2.0 * whole)).exp();
                let (mut cosine, mut sine) = (0.0, 0.0);
                let steps = (2.0 / frequency / 1e-3).round() as usize;
                for _ in 0..steps {
                    stepper.do_step(1e-3).unwrap();
                    let phase = omega * stepper.time();
                    let angle = get(&stepper, "hinge_angle_rad");
                    cosine += 2.0 * angle * phase.cos() / steps as f64;
                    sine += 2.0 * angle * phase.sin() / steps as f64;
                }
                // Of sin(ωt − delay).
                let (amplitude, late) = (cosine.hypot(sine), (-cosine).atan2(sine));
                let error = (amplitude / expected - 1.0).abs().max((late - delay).abs());
                println!("{key}, {form}, {frequency} Hz: {error:e}, decayed to {decayed:e}");
                // What is left is that the tail bends, and the step; measured: up to 1e-4, at the highest frequency.
                assert!(
                    error < 1e-3 && decayed < 1e-4,
                    "{key}, {form}, {frequency} Hz: {amplitude} for {expected}, {late} for {delay}"
                );
            }
        }
    }
}

#[test]
fn a_passive_hinge_is_a_pendulum_of_any_size() {
    // Its period for small swings is 2π√(I/(m g l)).
    for size in [1e-5_f64, 1.0, 50.0] {
        let length = 0.2 * size;
        let changes = [
            format!("rod.length_m={length:e}"),
            format!("rod.outer_radius_m={:e}", 0.005 * size),
            format!("head={{inertia_kg_m2={:e},angle_rad={:e},{FREE}}}", 1e-12 * size.powi(5), -TAU / 4.0 + 0.01),
            "loads={gravity_m_s2=[0.0,-9.80665]}".to_string(),
            format!("rod.youngs_modulus_pa={:e}", 1e10 * size),
            format!("solver.time_step_s={:e}", 1e-3 * size.sqrt()),
        ];
        let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
        let mut stepper = servo(&changes);
        let rod = &stepper.model().rod;
        let lever: f64 = (0..rod.nodes).map(|k| rod.mass[k] * rod.arc_length(k)).sum();
        let omega = (lever * 9.80665 / inertia(&stepper)).sqrt();
        stepper.do_step(0.5 * TAU / omega).unwrap();
        let swing = get(&stepper, "hinge_angle_rad") + TAU / 4.0;
        println!("{length} m: half a period on at {swing}");
        assert!((swing + 0.01).abs() < 1e-4, "{length} m: {swing}"); // measured: 1.1e-6
        let work = get(&stepper, "head_work_j");
        let energy = stepper.metrics().now.energy.total();
        assert!(work.abs() < 1e-6 * energy, "a hinge without a motor does no work: {work} of {energy}");
    }
}

#[test]
fn the_motor_gives_no_more_than_it_can_and_what_it_gives_is_booked() {
    for changes in [&["head.largest_torque_n_m=0.01"][..], &[]] {
        let torque = "head.torque_n_m={amplitude=0.1,frequency_hz=2.0,offset=0.02}";
        let run = |step: f64| {
            let step = format!("solver.time_step_s={step:e}");
            let mut stepper = servo(&[&[torque, &step, "rod.damping_time_s=0.01"], changes].concat());
            let (mut most, mut given, mut turned) = (0.0_f64, 0.0, [0.0; 2]);
            for _ in 0..100 {
                stepper.do_step(2e-3).unwrap();
                let now = [get(&stepper, "hinge_torque_n_m"), get(&stepper, "hinge_angle_rad")];
                most = most.max(now[0].abs());
                given += 0.5 * (now[0] + turned[0]) * (now[1] - turned[1]);
                turned = now;
            }
            let defect = stepper.metrics().numerical_dissipation();
            assert!((get(&stepper, "hinge_power_w") - turned[0] * get(&stepper, "hinge_spin_rad_s")).abs() < 1e-15);
            (most, given, get(&stepper, "head_work_j"), defect)
        };
        let [coarse, fine] = [1e-3, 2.5e-4].map(run);
        println!("{changes:?}: {coarse:?} {fine:?}");
        if !changes.is_empty() {
            assert!(fine.0 > 0.0099 && fine.0 <= 0.01);
        }
        // The work of the head is that of the motor; what the bearing takes is none of it.
        assert!((fine.2 / fine.1 - 1.0).abs() < 1e-2, "{fine:?}");
        assert!(fine.3.abs() < 0.1 * coarse.3.abs() && fine.3.abs() < 1e-4 * fine.1, "{coarse:?} {fine:?}");
    }
}

#[test]
fn a_host_that_adds_the_scene_s_torque_and_angle_moves_the_head_as_the_scene_does() {
    let mut own = servo(&["head.torque_n_m=0.03", "head.angle_rad=0.2"]);
    let mut told = servo(&["head.angle_rad=0.2"]);
    told.set("hinge_added_torque_n_m", &[0.03]).unwrap();
    let mut turned = servo(&["head.torque_n_m=0.03"]);
    turned.set("hinge_added_angle_rad", &[0.2]).unwrap();
    for stepper in [&mut own, &mut told, &mut turned] {
        (0..50).for_each(|_| stepper.do_step(1e-3).unwrap());
    }
    let [own, told, turned] = [own, told, turned].map(|stepper| get(&stepper, "hinge_angle_rad"));
    assert!((own - told).abs() < 1e-9, "{own} {told}");
    // It starts at zero, where the other starts at the angle that it is told.
    assert!((turned - own).abs() > 1e-3, "{own} {turned}");
}

#[test]
fn a_snapshot_keeps_the_angle_and_what_a_host_adds() {
    for form in ["positions", "chain"] {
        for integrator in ["newmark", "generalized-alpha", "esdirk3", "implicit-euler"] {
            let changes = [
                format!("solver.form={form}"),
                format!("solver={{integrator=\"{integrator}\",time_step_s=1e-3,duration_s=1.0,form=\"{form}\"}}"),
            ];
            let mut stepper = servo(&["head.torque_n_m={amplitude=0.03,frequency_hz=2.0}", &changes[1]]);
            stepper.set("hinge_added_torque_n_m", &[0.01]).unwrap();
            stepper.do_step(0.05).unwrap();
            let snapshot = stepper.save();
            stepper.do_step(0.05).unwrap();
            let first = (stepper.state().clone(), get(&stepper, "head_work_j"));
            stepper.set("hinge_added_torque_n_m", &[-0.05]).unwrap();
            stepper.do_step(0.02).unwrap();
            stepper.restore(&snapshot).unwrap();
            stepper.do_step(0.05).unwrap();
            assert_eq!(first, (stepper.state().clone(), get(&stepper, "head_work_j")), "{form}, {integrator}");
        }
    }
}

#[test]
fn the_angle_between_steps_is_that_of_steps_that_end_there() {
    for form in ["positions", "chain"] {
        let changes = [
            "head.torque_n_m={amplitude=0.03,frequency_hz=2.0}",
            &format!("solver.form={form}")[..],
            "rod.youngs_modulus_pa=1e6",
        ];
        let mut fine = servo(&[&changes[..], &["solver.time_step_s=5e-4"]].concat());
        let mut coarse = servo(&[&changes[..], &["solver.time_step_s=1e-2"]].concat());
        let mut worst = [0.0_f64; 3];
        for _ in 0..20 {
            coarse.do_step(1e-2).unwrap();
            fine.do_step(1e-2).unwrap();
            let ends = get(&coarse, "hinge_angle_rad") - get(&fine, "hinge_angle_rad");
            let t = coarse.time() - 5e-3;
            let names = ["hinge_angle_rad", "hinge_torque_n_m", "tip_dy_m"];
            let between = |view: &caudal::variable::View<'_>| {
                names.map(|name| caudal::variable::VARIABLES.iter().find(|v| v.name == name).unwrap().first(view))
            };
            let found = coarse.at(t, between).unwrap();
            let mut there = servo(&[&changes[..], &["solver.time_step_s=5e-4"]].concat());
            there.do_step(t).unwrap();
            let expected = names.map(|name| get(&there, name));
            for (worst, (found, expected)) in worst.iter_mut().zip(found.iter().zip(expected)) {
                *worst = worst.max((found - expected).abs() - ends.abs());
            }
        }
        println!("{form}: {worst:?}");
        // Beyond the error of the steps themselves; measured: 1.3e-4 rad, 5e-5 N m and 4e-5 m of 0.2 rad and 0.04 m.
        assert!(worst[0] < 1e-3 && worst[1] < 1e-3 && worst[2] < 5e-4, "{form}: {worst:?}");
    }
}

#[test]
fn every_method_turns_the_head_alike() {
    let torque = "head.torque_n_m={amplitude=0.03,frequency_hz=2.0}";
    let of = |solver: &str| {
        let solver = format!("solver={{{solver},duration_s=0.2}}");
        let mut stepper = servo(&[torque, "rod.youngs_modulus_pa=1e6", &solver]);
        stepper.do_step(0.2).unwrap();
        (get(&stepper, "hinge_angle_rad"), node(&stepper.state().q, 8))
    };
    let exact = of("integrator=\"esdirk3\",tolerance=1e-7");
    for (solver, error) in [
        ("integrator=\"newmark\",time_step_s=1e-3", 1e-5),
        ("integrator=\"implicit-euler\",time_step_s=1e-4", 1e-4),
        ("integrator=\"esdirk3\",time_step_s=1e-3", 1e-6),
        ("integrator=\"symplectic-euler\",time_step_s=1e-6", 1e-6),
    ] {
        let (angle, tip) = of(solver);
        println!("{solver}: {:e} {:e}", angle - exact.0, (tip - exact.1).norm());
        assert!(
            (angle - exact.0).abs() < error && (tip - exact.1).norm() < 0.2 * error,
            "{solver}: {angle} {}",
            exact.0
        );
    }
}

#[test]
fn hinges_that_cannot_be_are_refused_by_name() {
    let bare = SERVO.replace("inertia_kg_m2 = 1e-4\n", "");
    let message = Document::new("servo.toml", bare).scene().unwrap_err().to_string();
    assert!(message.contains("head.inertia_kg_m2") && message.contains("missing"), "{message}");
    // An override of the kind takes its keys away; a file that has them with another kind does not.
    let driven = SERVO.replace("kind = \"hinged\"", "kind = \"driven\"");
    let message = Document::new("servo.toml", driven).scene().unwrap_err().to_string();
    assert!(message.contains("head.stiffness_n_m") && message.contains("\"hinged\""), "{message}");
    for (changes, key, words) in [
        (&["head.kind=clamped", "head.torque_n_m=1.0"][..], "head.torque_n_m", "\"hinged\""),
        (&["head.stiffness_n_m=0.0", "head.angle_rad={amplitude=0.1,frequency_hz=1.0}"], "head.angle_rad", "stiffness"),
        (&["head.inertia_kg_m2=0.0"], "head.inertia_kg_m2", "positive"),
        (&["head.largest_torque_n_m=-1.0"], "head.largest_torque_n_m", "positive"),
        (&["solver={model=\"shape\",time_step_s=1e-3,duration_s=1.0}"], "solver.model", "hinged"),
    ] {
        let message = refusal(changes);
        assert!(message.contains(key) && message.contains(words), "{changes:?}: {message}");
    }
    let mut stepper = servo(&[]);
    for name in ["head_angle_rad", "head_spin_rad_s"] {
        let message = stepper.set(name, &[0.1]).unwrap_err().to_string();
        assert!(message.contains("angle is held"), "{message}");
    }
    stepper.set("head_x_m", &[0.0]).unwrap();
    let mut free = Stepper::of(&document(&[&format!("head={{{FREE}}}")]).scene().unwrap()).unwrap();
    let message = free.set("hinge_added_angle_rad", &[0.1]).unwrap_err().to_string();
    assert!(message.contains("stiffness_n_m"), "{message}");
}

#[test]
fn a_host_moves_the_hinge_and_its_tail_follows() {
    // The head is accelerated to the side: a free hinge lags, and its force is that of the whole mass.
    let mut stepper = servo(&[&format!("head={{input=\"at-end\",{FREE}}}")]);
    for i in 1..=100 {
        let t = f64::from(i) * 1e-3;
        stepper.set("head_y_m", &[0.5 * 2.0 * t * t]).unwrap();
        stepper.do_step(1e-3).unwrap();
    }
    let angle = get(&stepper, "hinge_angle_rad");
    let rod = &stepper.model().rod;
    let lever: f64 = (0..rod.nodes).map(|k| rod.mass[k] * rod.arc_length(k)).sum();
    // I φ̈ = −2 m l cos φ, from rest for 0.1 s.
    let expected = -0.5 * 2.0 * lever / (1e-4 + inertia(&stepper)) * 0.01;
    assert!((angle / expected - 1.0).abs() < 5e-3, "{angle} for {expected}");
    assert!(largest([stepper.metrics().numerical_dissipation()]) < 1e-6);
}

#[test]
fn what_a_motor_is_bought_by_is_that_of_its_samples() {
    let told = "head.angle_rad={offset=0.1,amplitude=0.3,frequency_hz=2.0}";
    let mut stepper = servo(&[told, "head.largest_torque_n_m=0.1", "solver.time_step_s=5e-4"]);
    stepper.do_step(1.0).unwrap();
    let (mut sums, mut ends) = ([0.0; 4], [f64::INFINITY, f64::NEG_INFINITY]);
    let mut most = [0.0_f64; 3];
    let mut sample = |stepper: &Stepper, weight: f64| {
        let [torque, angle, spin, power] =
            ["hinge_torque_n_m", "hinge_angle_rad", "hinge_spin_rad_s", "hinge_power_w"].map(|name| get(stepper, name));
        let error = 0.1 + 0.3 * (2.0 * TAU * stepper.time()).sin() - angle;
        let values = [torque * torque, power, angle, error * error];
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        ends = [ends[0].min(angle), ends[1].max(angle)];
        most.iter_mut().zip([torque.abs(), power, spin.abs()]).for_each(|(most, own)| *most = most.max(own));
    };
    sample(&stepper, 0.5);
    for step in 1..=4000 {
        stepper.do_step(5e-4).unwrap();
        sample(&stepper, if step == 4000 { 0.5 } else { 1.0 });
    }
    let [torque, power, angle, error] = sums.map(|sum| sum / 4000.0);
    for (name, expected) in [
        ("cycle_rms_hinge_torque_n_m", torque.sqrt()),
        ("cycle_hinge_power_w", power),
        ("cycle_hinge_angle_rad", angle),
        ("cycle_rms_tracking_error_rad", error.sqrt()),
    ] {
        let found = get(&stepper, name);
        println!("{name}: {found} for {expected}");
        assert!((found / expected - 1.0).abs() < 1e-4, "{name}: {found} for {expected}");
    }
    // The largest of four cycles against their mean.
    let amplitude = get(&stepper, "cycle_hinge_amplitude_rad");
    assert!((amplitude / (0.5 * (ends[1] - ends[0])) - 1.0).abs() < 0.02, "{amplitude} for {ends:?}");
    let of_run = stepper.metrics().totals.hinge;
    assert!(of_run.torque >= most[0] && of_run.power >= most[1] && of_run.speed >= most[2], "{of_run:?} {most:?}");
    assert!(of_run.asked > of_run.torque && of_run.torque < 0.1);
}

/// The notes on a run to 0.5 s.
fn notes(changes: &[&str]) -> Vec<String> {
    let scene = document(&[&["solver.duration_s=0.5"], changes].concat()).scene().unwrap();
    let mut stepper = Stepper::of(&scene).unwrap();
    stepper.do_step(0.5).unwrap();
    let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
    Summary::of(&scene, &stepper, &outcome, &[]).notes
}

#[test]
fn a_motor_that_is_asked_for_more_than_it_can_is_reported() {
    let told = "head.angle_rad={amplitude=0.3,frequency_hz=2.0}";
    let said = |changes: &[&str]| notes(changes).iter().any(|note| note.contains("reaches its limit"));
    assert!(said(&[told, "head.largest_torque_n_m=0.01"]));
    assert!(!said(&[told, "head.largest_torque_n_m=10.0"]) && !said(&[told]));
}

#[test]
fn a_run_of_whole_cycles_raises_no_false_alarm_of_its_energy_balance() {
    // The head is at rest at both ends, and all that is left of the work of the head is what the method takes.
    let driven =
        "head={kind=\"driven\",position_m={amplitude=[0.0,0.05],frequency_hz=2.0,phase_rad=1.5707963267948966}}";
    let keep = [driven, "solver.integrator=implicit-euler", "solver.time_step_s=2e-4"];
    let text = SERVO.replace("inertia_kg_m2 = 1e-4\nstiffness_n_m = 0.4\ndamping_n_m_s = 4e-3\n", "");
    let scene =
        document_of("cycle.toml", &text.replace("kind = \"hinged\"", "kind = \"clamped\""), &keep).scene().unwrap();
    let mut stepper = Stepper::of(&scene).unwrap();
    stepper.do_step(0.5).unwrap();
    let metrics = stepper.metrics();
    let (defect, end) = (metrics.numerical_dissipation().abs(), metrics.now.energy.total());
    let scale = metrics.totals.max_energy;
    println!("a defect of {defect:e} J, {end:e} J at the end, up to {scale:e} J");
    assert!(defect > 0.05 * end.max(metrics.totals.work.head.abs()) && defect < 0.05 * scale);
    let outcome = Outcome { ending: Ending::Complete, wall: Duration::ZERO };
    let notes = Summary::of(&scene, &stepper, &outcome, &[]).notes;
    assert!(!notes.iter().any(|note| note.contains("energy balance")), "{notes:?}");
}
