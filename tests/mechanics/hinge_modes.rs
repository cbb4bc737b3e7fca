//! Small motions of a head on a hinge: its angle is one more unknown, with the inertia of the rotor, the stiffness of the servo and the
//! damping of the bearing.

use caudal::linear_stability::SteadyState;
use caudal::model::Model;
use caudal::modes::{Matrices, ModeKind, Modes, lowest_of_model};
use nalgebra::{Complex, DMatrix};

use crate::common::{document_of, stepper_of};

/// A soft tail on a servo, in vacuum.
const TAIL: &str = r#"
[rod]
nodes = 11
length_m = 0.2
outer_radius_m = 0.005
inner_radius_m = 0.0
youngs_modulus_pa = 1e6
density_kg_m3 = 1100.0
stiffness_gradient = 0.5
[head]
kind = "hinged"
inertia_kg_m2 = 2e-5
stiffness_n_m = 0.03
damping_n_m_s = 2e-4
[start]
kind = "jump"
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-3
duration_s = 1.0
"#;

const PASSIVE: &str = "head.stiffness_n_m=0.0";

fn model(changes: &[&str]) -> Model {
    document_of("hinge.toml", TAIL, changes).scene().unwrap().model().unwrap()
}

/// M, C and K of bending, written anew: the unknowns are the angle φ of the head and y of every node but the first, which is held. Joint k
/// turns by the difference of the slopes of its edges, that at the head by the slope of the first edge less φ.
fn matrices(model: &Model) -> [DMatrix<f64>; 3] {
    let (rod, hinge) = (&model.rod, model.hinge.as_ref().unwrap());
    let n = rod.nodes;
    let mut of = [DMatrix::zeros(n, n), DMatrix::zeros(n, n), DMatrix::zeros(n, n)];
    (of[0][(0, 0)], of[1][(0, 0)], of[2][(0, 0)]) = (hinge.inertia, hinge.damping, hinge.stiffness);
    (1..n).for_each(|k| of[0][(k, k)] = rod.mass[k]);
    for k in 0..n - 1 {
        // The turning of joint k as a row vector.
        let mut turning = vec![0.0; n];
        turning[k + 1] += 1.0 / rod.spacing;
        if k > 0 {
            turning[k] -= 2.0 / rod.spacing;
            if k > 1 {
                turning[k - 1] += 1.0 / rod.spacing;
            }
        } else {
            turning[0] = -1.0;
        }
        let time = rod.damping.as_ref().map_or(0.0, |damping| damping.bending[k]);
        for i in 0..n {
            for j in 0..n {
                let stiffness = rod.joint[k] * turning[i] * turning[j];
                of[2][(i, j)] += stiffness;
                of[1][(i, j)] += time * stiffness;
            }
        }
    }
    of
}

/// λ = σ + iω with ω ≥ 0 of M ẍ + C ẋ + K x = 0, the slowest first.
fn eigenvalues([mass, damping, stiffness]: &[DMatrix<f64>; 3]) -> Vec<Complex<f64>> {
    let n = mass.nrows();
    let inverse = mass.clone().try_inverse().unwrap();
    let (k, c) = (&inverse * stiffness, &inverse * damping);
    let companion = DMatrix::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, true) => 0.0,
        (true, false) => f64::from(u8::from(i == j - n)),
        (false, true) => -k[(i - n, j)],
        (false, false) => -c[(i - n, j - n)],
    });
    let mut found: Vec<Complex<f64>> =
        companion.complex_eigenvalues().iter().copied().filter(|x| x.im >= 0.0).collect();
    found.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    found
}

#[test]
fn the_modes_of_a_hinged_head_are_those_of_a_dense_matrix_with_its_angle() {
    for changes in [&[][..], &[PASSIVE], &["head.inertia_kg_m2=1e-9"], &["head.inertia_kg_m2=1e-2"]] {
        let [mass, _, stiffness] = matrices(&model(changes));
        let scaled = DMatrix::from_fn(11, 11, |i, j| stiffness[(i, j)] / (mass[(i, i)] * mass[(j, j)]).sqrt());
        let mut expected: Vec<f64> = scaled.symmetric_eigenvalues().iter().map(|x| x.max(0.0).sqrt()).collect();
        expected.sort_by(f64::total_cmp);
        let modes = Modes::of_model(model(changes)).unwrap();
        // Without a servo the straight rod turns freely, which is no mode.
        let expected = if changes == [PASSIVE] { &expected[1..] } else { &expected[..] };
        assert_eq!(modes.bending.len(), expected.len(), "{changes:?}");
        assert_eq!(modes.stretching.len(), 10);
        let mut worst = 0.0_f64;
        for (found, expected) in modes.bending.iter().zip(expected) {
            worst = worst.max((found / expected - 1.0).abs());
        }
        println!("{changes:?}: {worst:e}");
        assert!(worst < 1e-9, "{changes:?}: {worst:e}");
        // Shapes satisfy K φ = ω² M φ, that of the arc included.
        let own = Matrices::of(model(changes)).unwrap();
        for mode in lowest_of_model(model(changes), 4).unwrap().iter().filter(|mode| mode.axis == ModeKind::Bending) {
            let at = |i: usize| if i == 0 { mode.arc / 0.2 } else { mode.shape[i] };
            for i in 0..11 {
                let terms: Vec<f64> = (0..11).map(|j| stiffness[(i, j)] * at(j)).collect();
                let left = terms.iter().sum::<f64>() - mode.frequency.powi(2) * mass[(i, i)] * at(i);
                let size: f64 = terms.iter().map(|x| x.abs()).sum();
                assert!(left.abs() < 1e-10 * size, "{changes:?}: {left:e} of {size:e} at {i}");
            }
            assert!(own.damping_ratio(mode).unwrap() > 0.0);
        }
    }
}

#[test]
fn damped_motions_of_a_hinged_head_are_those_of_a_dense_matrix_with_its_angle() {
    for changes in [&["rod.damping_time_s=2e-3"][..], &[], &[PASSIVE], &["head.damping_n_m_s=0.02"]] {
        let mut expected = eigenvalues(&matrices(&model(changes)));
        if changes == [PASSIVE] {
            expected.remove(0); // at any angle it rests
        }
        let mut steady = SteadyState::of(model(changes)).unwrap();
        let modes = steady.eigenmodes().unwrap();
        let bending: Vec<_> = modes.iter().filter(|mode| mode.bends()).collect();
        for (found, expected) in bending.iter().zip(&expected).take(8) {
            let error = (Complex::new(found.growth, found.frequency) - expected).norm() / expected.norm();
            println!("{changes:?}: {expected} {error:e}");
            assert!(error < 1e-7, "{changes:?}: {found:?} for {expected}");
        }
    }
}

#[test]
fn a_rigid_tail_on_a_servo_swings_as_an_oscillator() {
    let stiff = ["rod.youngs_modulus_pa=1e11"];
    let (own, inertia) = (model(&stiff), 2e-5 + model(&stiff).rod.inertia_about_head());
    let omega = (0.03 / inertia).sqrt();
    let ratio = 2e-4 / (2.0 * inertia * omega);
    let lowest = Modes::of_model(own).unwrap().lowest();
    let mode = SteadyState::of(model(&stiff)).unwrap().eigenmodes().unwrap().remove(0);
    let (size, damped) = (mode.growth.hypot(mode.frequency), mode.damping_ratio());
    println!("{lowest}, {size} for {omega}, damping ratio {damped} for {ratio}");
    // What is left is how far the tail bends.
    assert!([lowest / omega, size / omega, damped / ratio].iter().all(|part| (part - 1.0).abs() < 1e-4));
}

#[test]
fn a_fine_mesh_has_the_modes_of_a_hinged_head_too() {
    for changes in [&["rod.nodes=129"][..], &["rod.nodes=129", PASSIVE], &["rod.nodes=129", "head.inertia_kg_m2=1e-2"]]
    {
        let all = Modes::of_model(model(changes)).unwrap();
        let found = lowest_of_model(model(changes), 5).unwrap();
        let bending = found.iter().filter(|mode| mode.axis == ModeKind::Bending);
        for (mode, expected) in bending.zip(&all.bending) {
            let error = (mode.frequency / expected - 1.0).abs();
            println!("{changes:?}: {expected} {error:e}");
            // Measured: 8.5e-9, where the stiffness of all frequencies is rounded.
            assert!(error < 1e-7, "{changes:?}: {} for {expected}", mode.frequency);
        }
    }
}

#[test]
fn a_light_rotor_bounds_the_steps_of_an_explicit_method() {
    let light = ["head.inertia_kg_m2=1e-10", "head.damping_n_m_s=0.0"];
    let own = model(&light);
    let formula = ((own.rod.joint[0] + 0.03) / 1e-10).sqrt();
    let modes = Modes::of_model(model(&light)).unwrap();
    assert!((modes.highest() / formula - 1.0).abs() < 1e-4, "{} for {formula}", modes.highest());
    let largest = modes.explicit_steps(None).unwrap().largest;
    assert!((largest * modes.highest() / 2.0 - 1.0).abs() < 1e-9);
    // The angle that begins 1 mrad off its command stays as small below that step, and grows above it.
    let angle = |factor: f64| {
        let step = format!("solver.time_step_s={:e}", factor * largest);
        let changes = ["solver.integrator=symplectic-euler", "head.angle_rad=0.0", &*step];
        let mut stepper = stepper_of(TAIL, &[&light[..], &changes].concat());
        stepper.set("hinge_added_angle_rad", &[1e-3]).unwrap();
        let mut most = 0.0_f64;
        for _ in 0..400 {
            if stepper.do_step(factor * largest).is_err() {
                return f64::INFINITY;
            }
            most = most.max(stepper.get_scalar("hinge_angle_rad").unwrap().abs());
        }
        most
    };
    let [below, above] = [angle(0.98), angle(1.02)];
    println!("{below:e} below the limit of {largest:e} s, {above:e} above");
    assert!(below < 1e-2 && above > 1.0);
}

#[test]
fn a_passive_hinge_in_a_stream_rests_and_its_motions_are_found() {
    let stream = [
        PASSIVE,
        "medium={viscosity_pa_s=1e-3,density_kg_m3=1000.0,flow_m_s=[0.3,0.0]}",
        "drag.law=cox",
        "reactive={}",
    ];
    let mut steady = SteadyState::of(model(&stream)).unwrap();
    let slowest = steady.eigenmodes().unwrap().remove(0);
    // Its drag turns it back into the stream.
    let aside = steady.positions().iter().skip(1).step_by(2).fold(0.0, |most: f64, y| most.max(y.abs()));
    println!("{} {} {aside:e}", slowest.growth, slowest.frequency);
    assert!(slowest.growth < 0.0 && aside < 1e-12);
}
