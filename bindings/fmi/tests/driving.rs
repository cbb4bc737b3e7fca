//! A host that drives the head through the FMU, in both versions: what it says, steps that fail, and calls that are refused.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use std::f64::consts::TAU;
use std::ffi::{c_int, c_void};

use caudal::fmu::Standard;
use caudal::stepper::Stepper;
use common::{Fmi2, Fmi3, Unpacked, document, reference, references2};

const HEAD: [&str; 6] =
    ["head_y_m", "head_angle_rad", "head_vy_m_s", "head_spin_rad_s", "head_ay_m_s2", "head_spin_rate_rad_s2"];

/// What it says of its head at time `t` (s).
fn pose(t: f64) -> [f64; 6] {
    let (sin, cos) = (TAU * 0.7 * t).sin_cos();
    let omega = TAU * 0.7;
    [0.02 * sin, 0.3 * sin, 0.02 * omega * cos, 0.3 * omega * cos, -0.02 * omega * omega * sin, -0.3 * omega * omega * sin]
}

#[test]
fn a_driven_head_moves_as_the_stepper_s_to_the_bit_in_both_versions_whatever_is_said_of_it() {
    for (said, input) in [(2, "now"), (4, "now"), (6, "now"), (4, "at-end")] {
        let document = document("driven-head", &["rod.nodes=9", &format!("head.input={input}")]);
        let (two, three) = (Unpacked::of(&document, Standard::Fmi2), Unpacked::of(&document, Standard::Fmi3));
        let (fmi2, fmi3) = (Fmi2::of(&two), Fmi3::of(&three));
        let (a, b) = (fmi2.start(&two), fmi3.start());
        let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
        for step in 0..40 {
            let (t, h) = (stepper.time(), if step % 3 == 0 { 4e-3 } else { 1e-2 });
            let values = &pose(t)[..said];
            for (name, value) in HEAD.iter().zip(values) {
                stepper.set(name, &[*value]).unwrap();
                assert_eq!(fmi3.write(b, name, &[*value]), 0);
                assert_eq!(unsafe { (fmi2.set)(a, references2(name, 0..1).as_ptr(), 1, value) }, 0);
            }
            stepper.do_step(h).unwrap();
            assert_eq!(fmi3.advance(b, t, h).0, 0);
            assert_eq!(unsafe { (fmi2.step)(a, t, h, 1) }, 0);
            for name in ["head_moment_n_m", "tip_y_m", "pose_angle_rad", "pose_vy_m_s", "tip_spin_rad_s"] {
                let mut found = f64::NAN;
                assert_eq!(unsafe { (fmi2.get)(a, references2(name, 0..1).as_ptr(), 1, &mut found) }, 0);
                assert_eq!(stepper.get(name).unwrap(), [found], "{name}");
                assert_eq!(fmi3.read(b, name, 1), [found], "{name}");
            }
        }
        unsafe {
            (fmi2.free)(a);
            (fmi3.free)(b);
        }
    }
}

/// Everything that can be read of an instance of FMI 3.0.
fn all(fmi: &Fmi3, instance: *mut c_void, stepper: &Stepper) -> Vec<u64> {
    let names = stepper.variables().iter().filter(|variable| variable.name != caudal::fmu::NODES);
    names
        .flat_map(|variable| {
            let len = if variable.size == caudal::variable::Size::Scalar { 1 } else { 9 };
            fmi.read(instance, variable.name, len)
        })
        .map(f64::to_bits)
        .collect()
}

#[test]
fn a_discarded_step_leaves_the_state_of_before_the_call_and_can_be_made_otherwise() {
    let document = document("driven-head", &["rod.nodes=9", "rod.youngs_modulus_pa=2e5"]);
    let mut force = [0.0; 9];
    force[8] = 2e4;
    let three = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let (instance, other) = (fmi.start(), fmi.start());
    let stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    for step in 0..10 {
        let t = f64::from(step) * 0.1;
        for instance in [instance, other] {
            assert_eq!(fmi.write(instance, "head_y_m", &[0.01 * t]), 0);
            assert_eq!(fmi.advance(instance, t, 0.1).0, 0);
        }
    }
    let t = fmi.read(instance, "time_s", 1)[0];
    assert_eq!(fmi.write(instance, "force_y_n", &force), 0);
    let before = all(&fmi, instance, &stepper);
    assert_eq!(fmi.advance(instance, t, 0.1), (2, false, t), "discarded, its last successful time is where it began");
    assert!(all(&fmi, instance, &stepper) == before);
    // Without that force it goes on as an instance that never had it.
    for instance in [instance, other] {
        assert_eq!(fmi.write(instance, "force_y_n", &[0.0; 9]), 0);
        assert_eq!(fmi.advance(instance, t, 0.1).0, 0);
    }
    assert_eq!(fmi.read(instance, "x_m", 9), fmi.read(other, "x_m", 9));
    unsafe {
        (fmi.free)(instance);
        (fmi.free)(other);
    }

    let two = Unpacked::of(&document, Standard::Fmi2);
    let fmi = Fmi2::of(&two);
    let instance = fmi.start(&two);
    let (positions, mut found) = (references2("x_m", 0..9), [[f64::NAN; 9]; 2]);
    unsafe {
        assert_eq!((fmi.step)(instance, 0.0, 0.1, 0), 0);
        assert_eq!((fmi.get)(instance, positions.as_ptr(), 9, found[0].as_mut_ptr()), 0);
        assert_eq!((fmi.set)(instance, references2("force_y_n", 0..9).as_ptr(), 9, force.as_ptr()), 0);
        assert_eq!((fmi.step)(instance, 0.1, 0.1, 0), 2);
        assert_eq!((fmi.get)(instance, positions.as_ptr(), 9, found[1].as_mut_ptr()), 0);
        assert_eq!(found[0], found[1]);
        let mut last = f64::NAN;
        assert_eq!((fmi.real_status)(instance, 2, &mut last), 0);
        assert_eq!(last, 0.1);
        // A failed step still has derivatives, and so has the end.
        let derivative = || {
            let [unknown, known] = ["head_force_y_n", "force_y_n"].map(|name| references2(name, 0..1));
            let mut out = f64::NAN;
            let status = (fmi.directional)(instance, unknown.as_ptr(), 1, known.as_ptr(), 1, &1.0, &mut out);
            assert!(out.is_finite());
            status
        };
        assert_eq!(derivative(), 0);
        assert_eq!((fmi.terminate)(instance), 0);
        assert_eq!(derivative(), 0);
        (fmi.free)(instance);
    }
}

type Derivative =
    unsafe extern "C" fn(*mut c_void, *const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize) -> c_int;

#[test]
fn derivatives_are_there_after_the_end_too() {
    let three = Unpacked::of(&document("driven-head", &["rod.nodes=9"]), Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let instance = fmi.start();
    let terminate: unsafe extern "C" fn(*mut c_void) -> c_int = three.function("fmi3Terminate");
    let [unknown, known] = ["head_force_y_n", "viscosity_pa_s"].map(reference);
    for name in ["fmi3GetDirectionalDerivative", "fmi3GetAdjointDerivative"] {
        let derivative: Derivative = three.function(name);
        assert_eq!(fmi.advance(instance, fmi.read(instance, "time_s", 1)[0], 0.01).0, 0);
        let mut out = [f64::NAN; 2];
        let [now, after] = &mut out;
        unsafe { assert_eq!(derivative(instance, &unknown, 1, &known, 1, &1.0, 1, now, 1), 0) };
        let mut state = std::ptr::null_mut();
        unsafe {
            assert_eq!((fmi.save)(instance, &mut state), 0);
            assert_eq!(terminate(instance), 0);
            assert_eq!(derivative(instance, &unknown, 1, &known, 1, &1.0, 1, after, 1), 0);
            assert_eq!((fmi.restore)(instance, state), 0);
            assert_eq!((fmi.forget)(instance, &mut state), 0);
        }
        assert_eq!(out[0], out[1]);
    }
    unsafe { (fmi.free)(instance) };
}

#[test]
fn of_several_values_all_are_set_or_none() {
    let document = document("driven-head", &["rod.nodes=9"]);
    let names = ["viscosity_pa_s", "head_y_m", "flow_x_m_s"];
    let three = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let instance = fmi.start();
    let before = names.map(|name| fmi.read(instance, name, 1));
    let references = names.map(reference);
    for wrong in [[2.0, 0.01, f64::NAN], [2.0, f64::INFINITY, 0.1]] {
        assert_eq!(unsafe { (fmi.set)(instance, references.as_ptr(), 3, wrong.as_ptr(), 3) }, 3);
        assert_eq!(names.map(|name| fmi.read(instance, name, 1)), before);
    }
    unsafe { (fmi.free)(instance) };
    let two = Unpacked::of(&document, Standard::Fmi2);
    let fmi = Fmi2::of(&two);
    let instance = fmi.start(&two);
    let references = names.map(|name| references2(name, 0..1)[0]);
    let mut found = [[f64::NAN; 3]; 2];
    unsafe {
        assert_eq!((fmi.get)(instance, references.as_ptr(), 3, found[0].as_mut_ptr()), 0);
        assert_eq!((fmi.set)(instance, references.as_ptr(), 3, [2.0, 0.01, f64::NAN].as_ptr()), 3);
        assert_eq!((fmi.rates)(instance, references.as_ptr(), 3, [1, 1, 4].as_ptr(), [1.0; 3].as_ptr()), 3);
        assert_eq!((fmi.get)(instance, references.as_ptr(), 3, found[1].as_mut_ptr()), 0);
        assert_eq!(found[0], found[1]);
        assert_eq!((fmi.step)(instance, 0.0, 0.1, 0), 0);
        assert_eq!((fmi.get)(instance, references.as_ptr(), 3, found[1].as_mut_ptr()), 0);
        assert_eq!((found[0][0], found[0][2]), (found[1][0], found[1][2]), "nothing goes on by itself");
        (fmi.free)(instance);
    }
}

#[test]
fn a_host_s_tolerance_is_that_of_the_internal_steps() {
    let changes = ["rod.nodes=9", "solver.integrator=esdirk3", "solver.tolerance=1e-2"];
    let three = Unpacked::of(&document("driven-head", &changes), Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let steps = |tolerance: Option<f64>| {
        let instance = fmi.instance(None, std::ptr::null_mut());
        unsafe {
            let defined = u8::from(tolerance.is_some());
            assert_eq!((fmi.enter)(instance, defined, tolerance.unwrap_or(0.0), 0.0, 0, 0.0), 0);
            assert_eq!((fmi.exit)(instance), 0);
        }
        assert_eq!(fmi.advance(instance, 0.0, 0.5).0, 0);
        let steps = fmi.read(instance, "steps", 1)[0];
        unsafe { (fmi.free)(instance) };
        steps
    };
    let own = |tolerance: &str| {
        let changes = ["rod.nodes=9", "solver.integrator=esdirk3", tolerance];
        let mut stepper = Stepper::of(&document("driven-head", &changes).scene().unwrap()).unwrap();
        stepper.do_step(0.5).unwrap();
        stepper.get_scalar("steps").unwrap()
    };
    assert_eq!(steps(None), own("solver.tolerance=1e-2"));
    assert_eq!(steps(Some(1e-5)), own("solver.tolerance=1e-5"));
    assert!(steps(Some(1e-5)) > 2.0 * steps(None));
    let instance = fmi.instance(None, std::ptr::null_mut());
    assert_eq!(unsafe { (fmi.enter)(instance, 1, -1.0, 0.0, 0, 0.0) }, 3);
    unsafe { (fmi.free)(instance) };
}
