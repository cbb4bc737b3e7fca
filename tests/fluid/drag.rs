//! Drag: settling speeds, weights that no mesh changes, and a flow that carries the rod with it.

use crate::common;
use std::f64::consts::PI;

use caudal::fluid::{Fluid, Kinematics, force};
use caudal::rod::{Edge, node};
use common::{DRAG, SILICONE, WATER, WAVE, run, run_with, scene};
use nalgebra::{Rotation2, Vector2};

/// Drag of the same weight all along.
const EVEN: &str = "drag={ ratio = 5.0 }";
/// A fluid in which the tail reaches its settling speed within a second.
const SYRUP: &str = "medium.viscosity_pa_s=100";

/// ξ∥ = 6πμR_eq (N s/m²) with R_eq = √(A/π) of the study's annulus.
fn along(viscosity: f64) -> f64 {
    6.0 * PI * viscosity * (0.013_f64.powi(2) - 0.011_f64.powi(2)).sqrt()
}

/// ρAL of the study's tail, kg.
fn mass() -> f64 {
    2700.0 * PI * (0.013_f64.powi(2) - 0.011_f64.powi(2))
}

#[test]
fn a_rod_across_its_fall_settles_at_its_weight_over_the_drag_across() {
    let stepper = run(&scene(&[EVEN, WATER, SYRUP, "loads.gravity_m_s2=[0, -9.81]"]));
    let expected = mass() * 9.81 / (5.0 * along(100.0));
    for v in stepper.state().v.chunks(2) {
        // Measured: at most 8.6e-14.
        assert!((-v[1] / expected - 1.0).abs() < 1e-8, "{v:?}");
        assert!(v[0].abs() < 1e-8 * expected, "{v:?}");
    }
}

#[test]
fn a_rod_along_its_fall_settles_at_its_weight_over_the_drag_along_with_the_head_s_weight() {
    let stepper = run(&scene(&[DRAG, WATER, SYRUP, "loads.gravity_m_s2=[9.81, 0]"]));
    // ∫w ds = L + 9·0.0625 m.
    let expected = mass() * 9.81 / (along(100.0) * (1.0 + 9.0 * 0.0625));
    for v in stepper.state().v.chunks(2) {
        // Measured: at most 1.2e-12.
        assert!((v[0] / expected - 1.0).abs() < 1e-8, "{v:?}");
        assert!(v[1].abs() < 1e-8 * expected, "{v:?}");
    }
}

#[test]
fn the_drag_of_the_whole_rod_is_the_same_on_every_mesh() {
    let expected = along(0.001) * (1.0 + 9.0 * 0.0625);
    for nodes in [3, 4, 9, 10, 17, 18, 33, 100, 1001] {
        let model = scene(&[DRAG, WATER, &format!("rod.nodes={nodes}")]).model().unwrap();
        let towed = model.forces.towing(&model.rod, model.fluid, 1.0);
        // Measured: at most 3.3e-13 (N = 1001), rounding of the sum.
        assert!((towed / expected - 1.0).abs() < 1e-12, "N = {nodes}: {towed}");
    }
}

#[test]
fn on_the_study_s_mesh_the_head_s_weight_is_all_on_the_head_node() {
    let force = |weight: f64| {
        let drag = format!("drag={{ ratio = 5.0, head_weight = {weight:e}, head_length_m = 0.0625 }}");
        let model = scene(&[&drag, WATER]).model().unwrap();
        let edges = [Edge::new(Vector2::new(0.125, 0.0)); 8];
        let (v, zeros) = ([0.2, -0.1].repeat(9), [0.0; 18]);
        let mut force = vec![0.0; 18];
        let rod = Kinematics::within(model.fluid, &edges, [&zeros, &v, &zeros]);
        model.forces.add(&rod, &mut force);
        force
    };
    let (even, weighted) = (force(1.0), force(10.0));
    // Measured: equal to the bit.
    assert!((node(&weighted, 0) - node(&even, 0) * 10.0).norm() < 1e-15 * node(&weighted, 0).norm());
    assert_eq!(even[2..], weighted[2..]);
}

#[test]
fn a_uniform_flow_carries_a_free_rod_to_its_own_speed() {
    let stepper = run(&scene(&[DRAG, WATER, SYRUP, "medium.flow_m_s=[0.3, -0.2]", "solver.duration_s=3"]));
    for v in stepper.state().v.chunks(2) {
        // Measured: at most 3.1e-13.
        assert!((v[0] - 0.3).hypot(v[1] + 0.2) < 1e-8, "{v:?}");
    }
    let power = stepper.metrics().now.power;
    // Measured: 3.0e-25 W and −2.9e-13 W.
    assert!(power.viscous < 1e-12 && power.flow.abs() < 1e-8, "{power:?}");
}

#[test]
fn viscous_power_is_never_negative_whatever_the_shape_motion_and_flow() {
    let model = scene(&[DRAG, WATER]).model().unwrap();
    let [drag] = &model.forces.0[..] else { panic!("one force") };
    // The tangent and velocities turn through every direction against each other.
    for i in 0..360 {
        let turn = |k: usize| Rotation2::new((i * k) as f64 * PI / 180.0);
        let edges: Vec<Edge> = (0..8).map(|e| Edge::new(turn(e + 1) * Vector2::new(0.12, 0.0))).collect();
        let v: Vec<f64> = (0..9).flat_map(|k| <[f64; 2]>::from(turn(3 * k + 2) * Vector2::new(0.3, 0.0))).collect();
        let flow = turn(5) * Vector2::new(0.2, 0.0);
        let (fluid, zeros) = (Fluid { flow, viscosity: 0.3, density: 1000.0, ..Fluid::NONE }, [0.0; 18]);
        let rod = Kinematics::within(fluid, &edges, [&zeros, &v, &zeros]);
        let powers = force::powers(&**drag, &rod);
        // The least possible: every node's relative velocity along its edge.
        let least = along(0.3) * 0.0625 * (0..9).map(|k| (node(&v, k) - flow).norm_squared()).sum::<f64>();
        assert!(powers.against_fluid >= least, "{powers:?} {least}");
        // What the flow puts in and drag does not take is the power of the drag on the rod.
        let mut opposing = vec![0.0; 18];
        model.forces.add(&rod, &mut opposing);
        let on_rod: f64 = -opposing.iter().zip(&v).map(|(f, v)| f * v).sum::<f64>();
        let defect = powers.of_flow - powers.against_fluid - on_rod;
        // Measured: at most 2.1e-17 W of 0.04 W.
        assert!(defect.abs() < 1e-15, "{defect:e} {powers:?}");
    }
    // And over a run.
    let mut least = f64::INFINITY;
    let scene = scene(&[SILICONE, DRAG, WATER, SYRUP, WAVE, "medium.flow_m_s=[-0.3, 0.2]"]);
    run_with(&scene, |stepper| least = least.min(stepper.metrics().now.power.viscous));
    assert!(least > 0.0, "{least}");
}

#[test]
fn a_head_that_weighs_as_the_rest_needs_no_length_and_any_other_does() {
    let of = |weight: &str| {
        let mut document =
            caudal::scene::Document::new("scene.toml", common::SOFT.replace("head_length_m = 0.2\n", ""));
        document.set(&format!("drag.head_weight={weight}")).unwrap();
        document.scene()
    };
    assert!(of("1.0").is_ok(), "{:?}", of("1.0").err());
    for weight in ["0.98", "1.05"] {
        let problem = of(weight).unwrap_err().to_string();
        assert!(problem.contains("head_length_m") && problem.contains("needs the head's length"), "{problem}");
    }
}
