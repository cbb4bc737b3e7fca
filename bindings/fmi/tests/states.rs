//! Saved states: after rollback, serialisation, and transfer between instances and processes, runs continue bit-identically.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use caudal::fmu::Standard;
use common::{Dice, Fmi3, Unpacked, document};

/// Drives an instance with steps and inputs of `dice` until `end`; returns all values read.
fn drive(fmi: &Fmi3, instance: *mut std::ffi::c_void, dice: &mut Dice, mut t: f64, steps: usize) -> Vec<u64> {
    let mut seen = Vec::new();
    for _ in 0..steps {
        let h = [2e-3, 4e-3, 1.3e-3, 7e-3][dice.below(4)];
        let amplitude = dice.between(2.0, 4.0);
        let curvature: Vec<f64> = (0..33).map(|_| dice.between(-0.2, 0.2)).collect();
        if dice.below(2) == 0 {
            assert_eq!(fmi.write(instance, "viscosity_pa_s", &[amplitude]), 0);
        }
        assert_eq!(fmi.write(instance, "natural_curvature_1_m", &curvature), 0);
        let (status, _, last) = fmi.advance(instance, t, h);
        assert_eq!(status, 0);
        t = last;
        for name in ["x_m", "vx_m_s", "joint_moment_n_m"] {
            seen.extend(fmi.read(instance, name, 33).iter().map(|x| x.to_bits()));
        }
        for name in ["time_s", "head_moment_n_m", "actuation_work_j", "newton_iterations", "numerical_dissipation_j"] {
            seen.push(fmi.read(instance, name, 1)[0].to_bits());
        }
    }
    seen
}

const SCENES: [&[&str]; 4] = [
    &[],
    &["solver.integrator=generalized-alpha"],
    &["solver.integrator=implicit-euler", "solver.form=chain"],
    &["solver.integrator=esdirk3"],
];

#[test]
fn rolled_back_at_any_time_an_instance_goes_on_to_the_bit() {
    for changes in SCENES {
        let fmu = Unpacked::of(&document("driven-head", changes), Standard::Fmi3);
        let fmi = Fmi3::of(&fmu);
        let (instance, other) = (fmi.start(), fmi.start());
        let mut dice = Dice(11);
        for round in 0..10 {
            let now = fmi.read(instance, "time_s", 1)[0];
            let mut state = std::ptr::null_mut();
            assert_eq!(unsafe { (fmi.save)(instance, &mut state) }, 0);
            let first = drive(&fmi, instance, &mut Dice(round), now, 5);
            // Restored in the same instance, and in another one, from memory and from bytes.
            assert_eq!(unsafe { (fmi.restore)(instance, state) }, 0);
            assert_eq!(first, drive(&fmi, instance, &mut Dice(round), now, 5), "{changes:?}");
            let bytes = fmi.bytes(instance, state);
            let mut copy = std::ptr::null_mut();
            assert_eq!(unsafe { (fmi.deserialize)(other, bytes.as_ptr(), bytes.len(), &mut copy) }, 0);
            assert_eq!(unsafe { (fmi.restore)(other, copy) }, 0);
            assert_eq!(first, drive(&fmi, other, &mut Dice(round), now, 5), "{changes:?}");
            unsafe {
                assert_eq!((fmi.forget)(instance, &mut state), 0);
                assert_eq!((fmi.forget)(other, &mut copy), 0);
            }
            assert!(state.is_null());
            drive(&fmi, instance, &mut dice, fmi.read(instance, "time_s", 1)[0], 3);
        }
        unsafe {
            (fmi.free)(instance);
            (fmi.free)(other);
        }
    }
}

/// The child process of the next test: loads the state in a file and writes the values that it reads.
#[test]
fn continue_in_this_process() {
    let Ok(folder) = std::env::var("CAUDAL_TEST_STATE") else { return };
    let folder = std::path::Path::new(&folder);
    let fmu = Unpacked::of(&document("driven-head", &[]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let instance = fmi.start();
    let bytes = std::fs::read(folder.join("state")).unwrap();
    let mut state = std::ptr::null_mut();
    assert_eq!(unsafe { (fmi.deserialize)(instance, bytes.as_ptr(), bytes.len(), &mut state) }, 0);
    assert_eq!(unsafe { (fmi.restore)(instance, state) }, 0);
    let now = fmi.read(instance, "time_s", 1)[0];
    let seen = drive(&fmi, instance, &mut Dice(3), now, 10);
    std::fs::write(folder.join("seen"), seen.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>()).unwrap();
}

#[test]
fn a_state_in_a_file_goes_on_in_another_process_to_the_bit() {
    let fmu = Unpacked::of(&document("driven-head", &[]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let instance = fmi.start();
    drive(&fmi, instance, &mut Dice(2), 0.0, 20);
    let mut state = std::ptr::null_mut();
    assert_eq!(unsafe { (fmi.save)(instance, &mut state) }, 0);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("state"), fmi.bytes(instance, state)).unwrap();
    let child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "continue_in_this_process"])
        .env("CAUDAL_TEST_STATE", folder.path())
        .output()
        .unwrap();
    assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stdout));
    let now = fmi.read(instance, "time_s", 1)[0];
    let here: Vec<u8> = drive(&fmi, instance, &mut Dice(3), now, 10).iter().flat_map(|x| x.to_le_bytes()).collect();
    assert!(std::fs::read(folder.path().join("seen")).unwrap() == here);
}

#[test]
fn states_of_other_scenes_and_damaged_ones_are_refused_and_change_nothing() {
    let [here, other] = [&[][..], &["rod.youngs_modulus_pa=3e6"][..]]
        .map(|changes| Unpacked::of(&document("driven-head", changes), Standard::Fmi3));
    let (fmi, foreign) = (Fmi3::of(&here), Fmi3::of(&other));
    let (instance, stranger) = (fmi.start(), foreign.start());
    drive(&fmi, instance, &mut Dice(2), 0.0, 3);
    let mut state = std::ptr::null_mut();
    assert_eq!(unsafe { (fmi.save)(instance, &mut state) }, 0);
    let bytes = fmi.bytes(instance, state);
    let refused = |fmi: &Fmi3, instance, bytes: &[u8]| {
        let mut state = std::ptr::null_mut();
        let status = unsafe { (fmi.deserialize)(instance, bytes.as_ptr(), bytes.len(), &mut state) };
        assert!(state.is_null());
        assert_eq!(status, 3);
        common::MESSAGES.lock().unwrap().last().unwrap().clone()
    };
    assert!(refused(&foreign, stranger, &bytes).contains("another scene"));
    assert!(refused(&fmi, instance, b"PK\x03\x04 nothing of the kind").contains("not a saved state of caudal"));
    let mut dice = Dice(4);
    for _ in 0..500 {
        let mut damaged = bytes.clone();
        let place = dice.below(bytes.len());
        damaged[place] ^= 1 << dice.below(8);
        refused(&fmi, instance, &damaged);
        refused(&fmi, instance, &bytes[..dice.below(bytes.len())]);
    }
    let before = fmi.read(instance, "x_m", 33);
    assert_eq!(before, fmi.read(instance, "x_m", 33));
}
