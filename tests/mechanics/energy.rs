//! Energy: what goes in comes out or is stored, up to a defect that vanishes at the method's order.

use crate::common;
use caudal::integrator::METHODS;
use caudal::metrics::Power;
use common::{DRAG, GLYCEROL, RAMP, SILICONE, WATER, WAVE, order, run, run_with, scene, scene_by};

/// A head whose position and angle move sinusoidally.
const DRIVEN: &str = r#"head={ kind = "driven", position_m = { amplitude = [0.01, 0.03], frequency_hz = 2.0 }, angle_rad = { amplitude = 0.4, frequency_hz = 3.0, phase_rad = 0.5 } }"#;
const GRAVITY: &str = "loads.gravity_m_s2=[3.0, -9.81]";
const TIP_LOAD: &str = "loads.point=[{ node = -1, force_n = [0.1, 0.5] }]";
const FLOW: &str = "medium.flow_m_s=[0.2, 0.3]";

/// The defect of the energy balance vanishes with the step at the order of every method; the works that `meant` names
/// by their place in [actuation, viscous, load, head, flow] are all there.
fn assert_balance_closes(changes: &[&str], meant: [bool; 5]) {
    for method in METHODS {
        // The works are trapezoidal sums, so a better method shows their order.
        let order_of_method = (method.build)(&method.defaults()).order();
        let wanted = f64::from(order_of_method.min(2));
        let defects = [1e-4, 4e-5, 2e-5].map(|time_step| {
            let scene = scene_by(method, time_step, &[&[SILICONE, "solver.duration_s=0.2"], changes].concat());
            let stepper = run(&scene);
            let metrics = stepper.metrics();
            let Power { actuation, viscous, load, head, flow, .. } = metrics.totals.work;
            let works = [actuation, viscous, load, head, flow];
            assert_eq!(works.map(|work| work.abs() > 1e-3), meant, "{works:?}");
            let defect = metrics.numerical_dissipation();
            // Measured: at most 2.4 % (implicit-euler at the largest step).
            let turnover = works.map(f64::abs).iter().sum::<f64>();
            assert!(defect.abs() < 0.05 * turnover, "{}: {defect} of {turnover}", method.name);
            defect
        });
        // Where loads alone work, the sum of their works is exact.
        let observed = order(defects[1], defects[2]);
        let better = order_of_method > 2 && observed > wanted;
        assert!(better || (observed - wanted).abs() < 0.1, "{}: order {observed}, {defects:?}", method.name);
    }
}

// The orders measured stand beside each scene: the less exact of the two halvings, implicit-euler and newmark.

#[test]
fn the_balance_of_an_actuated_free_rod_closes_at_the_method_s_order() {
    assert_balance_closes(&[WAVE, RAMP], [true, false, false, false, false]); // 0.982, 2.000
}

#[test]
fn the_balance_of_a_swimmer_closes_at_the_method_s_order() {
    assert_balance_closes(&[WAVE, RAMP, DRAG, GLYCEROL], [true, true, false, false, false]); // 0.982, 2.000
}

#[test]
fn the_balance_of_a_falling_rod_closes_at_the_method_s_order() {
    assert_balance_closes(&[GRAVITY, DRAG, GLYCEROL], [false, true, true, false, false]); // 1.000, 2.000
}

#[test]
fn the_balance_of_a_rod_in_a_flow_closes_at_the_method_s_order() {
    assert_balance_closes(&[DRAG, GLYCEROL, FLOW], [false, true, false, false, true]); // 0.956, 2.000
}

#[test]
fn the_balance_of_a_clamped_loaded_rod_closes_at_the_method_s_order() {
    assert_balance_closes(&["head.kind=clamped", GRAVITY, TIP_LOAD], [false, false, true, false, false]); // 0.977, 1.997
}

#[test]
fn the_balance_of_a_driven_head_closes_at_the_method_s_order() {
    assert_balance_closes(&[DRIVEN], [false, false, false, true, false]); // 0.945, 2.000
}

#[test]
fn the_balance_of_everything_at_once_closes_at_the_method_s_order() {
    assert_balance_closes(&[WAVE, DRIVEN, DRAG, GLYCEROL, FLOW, GRAVITY], [true; 5]); // 0.934, 2.008
}

#[test]
fn a_sudden_natural_curvature_of_the_host_counts_its_change_of_bending_energy() {
    for head in ["free", "clamped"] {
        let scene = scene(&[SILICONE, DRAG, GLYCEROL, WAVE, &format!("head.kind={head}"), "solver.duration_s=0.1"]);
        let mut changed = 0.0;
        run_with(&scene, |stepper| {
            let step = stepper.metrics().totals.steps;
            if step % 20 != 0 {
                return;
            }
            let before = stepper.metrics().clone();
            let joints = stepper.get("natural_curvature_1_m").unwrap().len();
            let values: Vec<f64> = (0..joints).map(|k| (step as f64 + k as f64).sin()).collect();
            stepper.set("natural_curvature_1_m", &values).unwrap();
            let after = stepper.metrics();
            let work = after.totals.work.actuation - before.totals.work.actuation;
            let energy = after.now.energy.bending - before.now.energy.bending;
            let defect = after.numerical_dissipation() - before.numerical_dissipation();
            changed += energy.abs();
            // Measured: at most 2.1e-17 J and 4.2e-17 J.
            assert!((work - energy).abs() < 1e-15, "{work} {energy}");
            assert!(defect.abs() < 1e-15, "{defect:e}");
        });
        // Measured: 0.19 J and 0.15 J.
        assert!(changed > 0.1, "{changed}");
    }
}

#[test]
fn the_jump_start_s_energy_is_initial_energy_and_no_work() {
    let changes = [WAVE, DRAG, WATER, "rod.mass_lumping=uniform", "start.kind=jump", "solver.duration_s=0.001"];
    let stepper = caudal::stepper::Stepper::of(&scene(&changes)).unwrap();
    let metrics = stepper.metrics();
    // Measured: 2380.364 J.
    assert!((metrics.first_energy - 2380.0).abs() < 1.0, "{}", metrics.first_energy);
    assert_eq!(metrics.first_energy, metrics.now.energy.bending);
    assert_eq!(metrics.totals.work.net(), 0.0);
}
