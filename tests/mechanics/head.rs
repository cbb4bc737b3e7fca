//! A held head: where it is, what it feels, and that scene, table and host drive it alike.

use crate::common;
use std::f64::consts::TAU;
use std::sync::Arc;

use caudal::error::Error;
use caudal::head::Signal;
use caudal::integrator::{METHODS, Method};
use caudal::metrics::Measurements;
use caudal::model::Dynamics;
use caudal::rod::node;
use caudal::stepper::Stepper;
use caudal::system::{State, System};
use common::{DRAG, GLYCEROL, SILICONE, WAVE, distance, document, equilibrium, order, run, run_with, scene, scene_by};
use nalgebra::Vector2;

/// A head that moves by [`pose`].
const DRIVEN: &str = r#"head={ kind = "driven", position_m = { amplitude = [0.01, 0.03], frequency_hz = 2.0 }, angle_rad = { amplitude = 0.4, frequency_hz = 3.0, phase_rad = 0.5 } }"#;

/// Values and rates of [`DRIVEN`] at time `t`.
fn pose(t: f64) -> [[f64; 2]; 3] {
    let sinusoid = |amplitude: f64, frequency: f64, phase: f64| {
        let (sin, cos) = (TAU * frequency * t + phase).sin_cos();
        [amplitude * sin, amplitude * TAU * frequency * cos]
    };
    [sinusoid(0.01, 2.0, 0.0), sinusoid(0.03, 2.0, 0.0), sinusoid(0.4, 3.0, 0.5)]
}

#[test]
fn a_clamped_head_stays_put_while_the_rest_moves() {
    for method in METHODS {
        let changes = [SILICONE, WAVE, DRAG, GLYCEROL, "head.kind=clamped", "solver.duration_s=0.2"];
        let stepper = run_with(&scene_by(method, 5e-4, &changes), |stepper| {
            let state = stepper.state();
            assert_eq!([&state.q[..2], &state.v[..2], &state.a[..2]], [[0.0; 2]; 3].each_ref());
        });
        let moved = stepper.get_scalar("tip_dy_m").unwrap();
        // Measured: −0.380 m.
        assert!(moved < -0.3, "{moved}");
    }
}

#[test]
fn a_driven_head_is_where_the_scene_says_at_every_step() {
    for method in METHODS {
        run_with(&scene_by(method, 5e-4, &[SILICONE, DRIVEN, "solver.duration_s=0.2"]), |stepper| {
            let [x, y, _] = pose(stepper.time());
            let state = stepper.state();
            // Measured: 0; the formulas are the same.
            assert!((state.q[0] - x[0]).hypot(state.q[1] - y[0]) < 1e-15);
            assert!((state.v[0] - x[1]).hypot(state.v[1] - y[1]) < 1e-14);
        });
    }
}

#[test]
fn a_clamped_head_feels_the_load_and_its_moment() {
    let scene = scene(&[SILICONE, "head.kind=clamped"]);
    let load = Vector2::new(0.05, -0.12);
    let mut forces = vec![0.0; 18];
    forces[16..].copy_from_slice(load.as_slice());
    let (mut dynamics, state) = equilibrium(&scene, &forces, 4);
    let mut reading = Measurements::new(9);
    reading.measure(&mut dynamics, &state).unwrap();
    let tip = node(&state.q, 8);
    // The rod hangs well down: −0.235 m.
    assert!(tip.y < -0.2, "{tip}");
    // Measured: 1.3e-13 N and 5.6e-17 N m.
    assert!((reading.head_force - load).norm() < 1e-11);
    assert!((reading.head_moment - tip.perp(&load)).abs() < 1e-11);
}

#[test]
fn a_clamped_head_carries_the_weight_of_its_own_node_too() {
    let scene = scene(&[SILICONE, "head.kind=clamped", "loads.gravity_m_s2=[0, -0.1]"]);
    let (mut dynamics, state) = equilibrium(&scene, &[0.0; 18], 1);
    let mut reading = Measurements::new(9);
    reading.measure(&mut dynamics, &state).unwrap();
    let rod = &dynamics.model.rod;
    let weight = Vector2::new(0.0, -0.1 * rod.total_mass());
    let moment = rod.mean(&state.q).perp(&weight);
    // Measured: 8.7e-14 N and 3.5e-18 N m, of 0.05 N and 0.03 N m.
    assert!((reading.head_force - weight).norm() < 1e-11);
    assert!((reading.head_moment - moment).abs() < 1e-11);
}

#[test]
fn the_head_force_is_what_changes_the_momentum() {
    for method in METHODS {
        let wanted = f64::from((method.build)(&method.defaults()).order().min(2)); // of the trapezoidal rule
        let defects = [2e-4, 1e-4, 5e-5].map(|time_step| {
            let scene = scene_by(method, time_step, &[SILICONE, WAVE, DRIVEN, "solver.duration_s=0.2"]);
            let momentum = |stepper: &Stepper| -> Vector2<f64> {
                let masses = stepper.model().rod.mass.iter().enumerate();
                masses.map(|(k, m)| node(&stepper.state().v, k) * *m).sum()
            };
            let start = Stepper::of(&scene).unwrap();
            let (mut last, mut impulse) = (start.metrics().now.head_force, Vector2::zeros());
            let stepper = run_with(&scene, |stepper| {
                let force = stepper.metrics().now.head_force;
                impulse -= (last + force) * (0.5 * time_step);
                last = force;
            });
            let change = momentum(&stepper) - momentum(&start);
            (change - impulse).norm() / impulse.norm()
        });
        // Measured: 1.2e-4 (implicit-euler), 3.9e-10 (newmark).
        assert!(defects[2] < 2e-4, "{defects:?}");
        for pair in defects.windows(2) {
            // Measured: 1.003, 1.001 (implicit-euler), 2.000, 2.000 (newmark).
            let observed = order(pair[0], pair[1]);
            assert!((observed - wanted).abs() < 0.1, "{}: order {observed}, {defects:?}", method.name);
        }
    }
}

#[test]
fn a_table_drives_the_head_as_its_formula_does_up_to_the_interpolation() {
    let common = [SILICONE, DRAG, GLYCEROL, "solver.duration_s=0.25", "solver.time_step_s=0.001"];
    let formula = run(&scene(&[&common[..], &[DRIVEN]].concat()));
    let folder = tempfile::tempdir().unwrap();
    let mut errors = Vec::new();
    for rows in [25, 50, 100] {
        let (mut position, mut angle) =
            ("time_s,x_m,y_m,vx_m_s,vy_m_s\n".to_string(), "time_s,angle_rad,spin_rad_s\n".to_string());
        for i in 0..=rows {
            let t = 0.25 * f64::from(i) / f64::from(rows);
            let [x, y, turn] = pose(t);
            position += &format!("{t:e},{:e},{:e},{:e},{:e}\n", x[0], y[0], x[1], y[1]);
            angle += &format!("{t:e},{:e},{:e}\n", turn[0], turn[1]);
        }
        std::fs::write(folder.path().join("position.csv"), position).unwrap();
        std::fs::write(folder.path().join("angle.csv"), angle).unwrap();
        let driven =
            r#"head={ kind = "driven", position_m = { table = "position.csv" }, angle_rad = { table = "angle.csv" } }"#;
        let scene = document(folder.path().join("scene.toml"), &[&common[..], &[driven]].concat()).scene().unwrap();
        errors.push(distance(&run(&scene).state().q, &formula.state().q));
    }
    // Of cubic Hermite, h⁴/384 of the fourth derivative, most of the angle: 0.4 (2π·3 Hz)⁴ (10 ms)⁴/384 = 1.3e-6 at 25 rows.
    // Measured: 3.2e-7 m; 4.002, 4.000.
    assert!(errors[0] < 1.3e-6, "{errors:?}");
    for pair in errors.windows(2) {
        assert!((order(pair[0], pair[1]) - 4.0).abs() < 0.1, "{errors:?}");
    }
}

/// A run of 0.25 s in which the host moves the head by [`pose`], with values and rates once every `parts` steps of 1 ms.
fn host_driven(method: &Method, changes: &[&str], parts: u32) -> caudal::Result<Stepper> {
    let mut stepper = Stepper::of(&scene_by(method, 1e-3, changes))?;
    for i in 1..=250 / parts {
        let [x, y, angle] = pose(f64::from(i * parts) * 1e-3);
        for (name, value) in [
            ("head_x_m", x[0]),
            ("head_y_m", y[0]),
            ("head_angle_rad", angle[0]),
            ("head_vx_m_s", x[1]),
            ("head_vy_m_s", y[1]),
            ("head_spin_rad_s", angle[1]),
        ] {
            stepper.set(name, &[value])?;
        }
        stepper.do_step(f64::from(parts) * 1e-3)?;
    }
    Ok(stepper)
}

#[test]
fn a_host_that_gives_values_and_rates_drives_the_head_as_the_scene_does() {
    let changes = [SILICONE, DRAG, GLYCEROL, DRIVEN, "head.input=at-end", "solver.duration_s=0.25"];
    for method in METHODS {
        let own = run(&scene_by(method, 1e-3, &changes));
        let deviation = |host: &Stepper| distance(&host.state().q, &own.state().q);
        let every_step = host_driven(method, &changes, 1).unwrap();
        // Measured: 1e-19 m and 2.3e-16 J; 2.4e-15 m and 3.8e-15 J (esdirk3, whose stages ask for times in between).
        let [apart, work_apart] = if method.adaptive { [1e-10, 1e-8] } else { [1e-15, 1e-14] };
        assert!(deviation(&every_step) < apart, "{:e}", deviation(&every_step));
        let work = every_step.metrics().totals.work.head - own.metrics().totals.work.head;
        assert!(work.abs() < work_apart, "{work:e}");
        // At 5 and 10 steps a time it is the polynomial's of degree 5. Measured: 1.9e-9 m; 6.11 to 6.14.
        let [fine, coarse] = [5, 10].map(|parts| deviation(&host_driven(method, &changes, parts).unwrap()));
        assert!(coarse < 1e-8, "{coarse:e}");
        assert!(order(coarse, fine) > 5.0, "{coarse:e} {fine:e}");
    }
}

#[test]
fn a_host_takes_a_moving_head_over_without_stopping_it() {
    let mut stepper = run(&scene(&[SILICONE, DRAG, GLYCEROL, DRIVEN, "solver.duration_s=0.1"]));
    let (state, metrics) = (stepper.state().clone(), stepper.metrics().clone());
    stepper.set("head_angle_rad", &[0.1]).unwrap();
    // Measured: 0 m/s and 2.2e-16 m/s².
    assert!(distance(&state.v, &stepper.state().v) < 1e-15);
    assert!(distance(&state.a, &stepper.state().a) < 1e-12);
    assert_eq!(metrics.totals.work, stepper.metrics().totals.work);
}

#[test]
fn the_integral_of_a_signal_is_that_of_its_values() {
    let rows = [[0.1, 1.0], [0.4, -2.0], [0.9, 0.5], [1.5, 0.7]];
    let signals = [
        Signal::Constant(0.7),
        Signal::Sinusoid { amplitude: 0.3, frequency: 1.7, phase: 0.4, offset: -0.2 },
        Signal::Sinusoid { amplitude: 0.3, frequency: 0.0, phase: 0.4, offset: -0.2 },
        Signal::table_without_rates(&rows),
    ];
    for signal in signals {
        for t in [0.0, 0.05, 0.3, 1.2, 2.0, -0.3] {
            let parts = 20_000;
            let middle = |i: i32| signal.at(t * (f64::from(i) + 0.5) / f64::from(parts)).value;
            let sum = (0..parts).map(middle).sum::<f64>() * t / f64::from(parts);
            assert!((signal.integral(t) - sum).abs() < 1e-8, "{signal:?} {t}: {} {sum}", signal.integral(t)); // measured 2e-9
        }
    }
}

#[test]
fn a_head_that_turns_far_within_a_step_does_not_fold_the_joint_beside_it() {
    // The first joint stays bent by −60° while the head turns by 140°; and beside it one that does go over ±180°.
    let changes = [
        "head={ kind = \"driven\", angle_rad = { amplitude = 2.443460952792061, frequency_hz = 0.25 } }",
        "rod.nodes=3",
        "solver.time_step_s=1.0",
        "solver.duration_s=1.0",
    ];
    let mut dynamics = Dynamics::new(Arc::new(scene(&changes).model().unwrap()));
    let spacing = dynamics.model.rod.spacing;
    let bent = |t: f64, head: f64, joint: f64| {
        let mut state = State::zeros(6);
        state.t = t;
        let along = Vector2::new((head + joint).cos(), (head + joint).sin()) * spacing;
        for k in 0..3 {
            state.q[2 * k..][..2].copy_from_slice((along * k as f64).as_slice());
        }
        state
    };
    let turn = 140.0_f64.to_radians();
    let mut check = |joints: [f64; 2]| {
        let [from, mut to] = [bent(0.0, 0.0, joints[0]), bent(1.0, turn, joints[1])];
        dynamics.move_to(0.0, &mut from.clone());
        let q = to.q.clone();
        dynamics.move_to(1.0, &mut to);
        to.q = q;
        dynamics.check_step(&from, &to)
    };
    let sixty = 60.0_f64.to_radians();
    check([-sixty, -sixty]).unwrap();
    // From −170° to 170° of the head: the edge itself turns by 120°.
    let over = 170.0_f64.to_radians();
    assert!(matches!(check([-over, over]), Err(Error::FoldOver { node: 0, .. })), "{:?}", check([-over, over]));
}
