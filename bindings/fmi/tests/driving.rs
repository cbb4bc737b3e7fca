//! A host that drives the head through the FMU, in both versions: given poses, failing steps, and rejected calls.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use std::f64::consts::TAU;
use std::ffi::{c_int, c_void};

use caudal::fmu::{Fmu, FmuOptions, Standard};
use caudal::scene::Document;
use caudal::stepper::Stepper;
use common::{Fmi2, Fmi3, Unpacked, document, reference, references2};

const HEAD: [&str; 6] =
    ["head_y_m", "head_angle_rad", "head_vy_m_s", "head_spin_rad_s", "head_ay_m_s2", "head_spin_rate_rad_s2"];

/// The pose and its derivatives that the host gives at time `t` (s).
fn pose(t: f64) -> [f64; 6] {
    let (sin, cos) = (TAU * 0.7 * t).sin_cos();
    let omega = TAU * 0.7;
    [
        0.02 * sin,
        0.3 * sin,
        0.02 * omega * cos,
        0.3 * omega * cos,
        -0.02 * omega * omega * sin,
        -0.3 * omega * omega * sin,
    ]
}

/// Asserts that FMUs of both versions compute the same `outputs` as the stepper, if at every step each of `inputs` is set to the
/// value that `said` returns for the time.
fn told_in_both_versions(document: &Document, inputs: &[&str], said: impl Fn(f64) -> Vec<f64>, outputs: &[&str]) {
    let (two, three) = (Unpacked::of(document, Standard::Fmi2), Unpacked::of(document, Standard::Fmi3));
    let (fmi2, fmi3) = (Fmi2::of(&two), Fmi3::of(&three));
    let (a, b) = (fmi2.start(&two), fmi3.start());
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    for step in 0..40 {
        let (t, h) = (stepper.time(), if step % 3 == 0 { 4e-3 } else { 1e-2 });
        for (name, value) in inputs.iter().zip(said(t)) {
            stepper.set(name, &[value]).unwrap();
            assert_eq!(fmi3.write(b, name, &[value]), 0);
            assert_eq!(unsafe { (fmi2.set)(a, references2(name, 0..1).as_ptr(), 1, &value) }, 0);
        }
        stepper.do_step(h).unwrap();
        assert_eq!(fmi3.advance(b, t, h).0, 0);
        assert_eq!(unsafe { (fmi2.step)(a, t, h, 1) }, 0);
        for name in outputs {
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

#[test]
fn a_driven_head_moves_as_the_stepper_s_to_the_bit_in_both_versions_whatever_is_said_of_it() {
    for (said, input) in [(2, "now"), (4, "now"), (6, "now"), (4, "at-end")] {
        let document = document("driven-head", &["rod.nodes=9", &format!("head.input={input}")]);
        let outputs = ["head_moment_n_m", "tip_y_m", "pose_angle_rad", "pose_vy_m_s", "tip_spin_rad_s"];
        told_in_both_versions(&document, &HEAD, |t| pose(t)[..said].to_vec(), &outputs);
    }
}

#[test]
fn a_host_raises_the_water_and_salts_it_in_both_versions() {
    let inputs = ["interface_1_offset_m", "beyond_1_viscosity_pa_s", "beyond_1_density_kg_m3", "density_kg_m3"];
    let tide = |t: f64| vec![0.06 - 0.2 * t, 1e-3 * (1.0 + t), 1000.0 + 100.0 * t, 1.2 - t];
    let outputs = ["tip_y_m", "head_force_y_n", "spray_work_j", "interface_1_offset_m"];
    for form in ["positions", "chain"] {
        let document = document("dipping-tail", &["rod.nodes=9", &format!("solver.form={form}")]);
        told_in_both_versions(&document, &inputs, tide, &outputs);
    }
}

/// All readable values of an instance of FMI 3.0.
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
    // Without that force it continues like an instance that never had it.
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
        // Derivatives are available after a failed step, and at the end.
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

type Derivative = unsafe extern "C" fn(
    *mut c_void,
    *const u32,
    usize,
    *const u32,
    usize,
    *const f64,
    usize,
    *mut f64,
    usize,
) -> c_int;

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

#[test]
fn stiffness_and_drag_change_between_steps_and_the_motion_goes_on() {
    let model = document("driven-head", &["rod.nodes=9"]);
    let scene = model.scene().unwrap();
    let parameters = scene.parameters();
    let place = |name: &str| parameters.iter().position(|parameter| parameter.name() == name).unwrap();
    let three = Unpacked::of(&model, Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let instance = fmi.start();
    let mut stepper = Stepper::of(&scene).unwrap();
    for step in 0..5 {
        assert_eq!(fmi.advance(instance, f64::from(step) * 0.1, 0.1).0, 0);
        stepper.do_step(0.1).unwrap();
    }
    let [positions, velocities] = ["x_m", "vy_m_s"].map(|name| fmi.read(instance, name, 9));
    let defect = fmi.read(instance, "numerical_dissipation_j", 1)[0];
    let references =
        ["rod.youngs_modulus_pa", "drag.ratio"].map(|name| caudal::fmu::Catalogue::PARAMETERS + place(name) as u32);
    unsafe {
        // All values are set or none, and none that the scene would reject.
        assert_eq!((fmi.set)(instance, references.as_ptr(), 2, [1e6, -1.0].as_ptr(), 2), 3);
        assert_eq!((fmi.set)(instance, references.as_ptr(), 2, [1e6, 3.0].as_ptr(), 2), 0);
    }
    // Only the forces jump.
    assert_eq!([positions, velocities], ["x_m", "vy_m_s"].map(|name| fmi.read(instance, name, 9)));
    assert!((fmi.read(instance, "numerical_dissipation_j", 1)[0] - defect).abs() < 1e-15);
    let tuned = document("driven-head", &["rod.nodes=9", "rod.youngs_modulus_pa=1e6", "drag.ratio=3.0"]);
    stepper.change_parameters(&tuned.scene().unwrap()).unwrap();
    let mut state = std::ptr::null_mut();
    assert_eq!(unsafe { (fmi.save)(instance, &mut state) }, 0);
    for round in 0..2 {
        for step in 5..10 {
            assert_eq!(fmi.advance(instance, f64::from(step) * 0.1, 0.1).0, 0);
            if round == 0 {
                stepper.do_step(0.1).unwrap();
            }
        }
        assert_eq!(fmi.read(instance, "y_m", 9), stepper.get("y_m").unwrap());
        assert_eq!(fmi.read(instance, "head_moment_n_m", 1), stepper.get("head_moment_n_m").unwrap());
        assert_eq!(unsafe { (fmi.restore)(instance, state) }, 0);
    }
    // Back to the previous settings, and again.
    unsafe {
        assert_eq!((fmi.set)(instance, references.as_ptr(), 2, [2e6, 2.0].as_ptr(), 2), 0);
        assert_eq!(fmi.advance(instance, 0.5, 0.1).0, 0);
        assert_eq!((fmi.restore)(instance, state), 0);
        let mut found = [0.0; 2];
        assert_eq!((fmi.get)(instance, references.as_ptr(), 2, found.as_mut_ptr(), 2), 0);
        assert_eq!(found, [1e6, 3.0]);
        assert_eq!((fmi.forget)(instance, &mut state), 0);
        (fmi.free)(instance);
    }
}

#[test]
fn a_plain_fmu_has_every_entry_as_a_variable_of_its_own_and_shows_what_was_chosen() {
    let model = document("driven-head", &["rod.nodes=9"]);
    let names = ["head_y_m", "head_moment_n_m", "y_m", "force_y_n", "drag.ratio"].map(str::to_string).to_vec();
    let choice = FmuOptions { variables: Some(names), nodes: Some(vec![0, 8]), plain: true };
    let three = Unpacked::with(&model, Standard::Fmi3, choice.clone());
    let fmi = Fmi3::of(&three);
    for there in ["name=\"y_m[8]\"", "name=\"force_y_n[0]\"", "name=\"drag.ratio\"", "name=\"time_s\""] {
        assert!(three.description.contains(there), "{there}");
    }
    for not_there in ["Dimension", "structuralParameter", "UInt64", "y_m[1]", "\"x_m", "viscosity"] {
        assert!(!three.description.contains(not_there), "{not_there}");
    }
    let instance = fmi.start();
    let [y, force] = ["y_m", "force_y_n"].map(|name| references2(name, 8..9)[0]);
    let mut stepper = Stepper::of(&model.scene().unwrap()).unwrap();
    let mut forces = [0.0; 9];
    forces[8] = 0.01;
    stepper.set("force_y_n", &forces).unwrap();
    let mut found = [f64::NAN; 2];
    unsafe { assert_eq!((fmi.set)(instance, &force, 1, &0.01, 1), 0) };
    assert_eq!(fmi.advance(instance, 0.0, 0.1).0, 0);
    stepper.do_step(0.1).unwrap();
    unsafe { assert_eq!((fmi.get)(instance, [y, force].as_ptr(), 2, found.as_mut_ptr(), 2), 0) };
    assert_eq!(found, [stepper.get("y_m").unwrap()[8], 0.01]);
    unsafe { (fmi.free)(instance) };
    // FMI 2.0 with the same selection; arrays of FMI 3.0 have all nodes.
    let two = Unpacked::with(&model, Standard::Fmi2, FmuOptions { plain: false, ..choice.clone() });
    assert_eq!(two.description.matches("<ScalarVariable").count(), 7);
    let folder = tempfile::tempdir().unwrap();
    let write = |choice: FmuOptions| {
        let fmu = Fmu::of(&model)?.showing(choice)?;
        fmu.write(Standard::Fmi3, &[common::library_path()], &folder.path().join("a.fmu"))
    };
    let error = write(FmuOptions { plain: false, ..choice.clone() }).unwrap_err().to_string();
    assert!(error.contains("FMI 2.0 or plain FMI 3.0"), "{error}");
    let error = write(FmuOptions { nodes: Some(vec![9]), ..choice.clone() }).unwrap_err().to_string();
    assert!(error.contains("nodes 0 to 8"), "{error}");
    let error = write(FmuOptions { variables: Some(vec!["x_comm".to_string()]), ..choice }).unwrap_err().to_string();
    assert!(error.contains("did you mean"), "{error}");
}

#[test]
fn terminals_name_variables_that_are_there() {
    for (model, terminals) in [("driven-head", ["head", "tip"]), ("glycerol", ["tip", "drive"])] {
        let three = Unpacked::of(&document(model, &[]), Standard::Fmi3);
        let folder = three.folder.path().join("terminalsAndIcons");
        assert!(folder.join("icon.png").is_file());
        let list = std::fs::read_to_string(folder.join("terminalsAndIcons.xml")).unwrap();
        for name in terminals {
            assert!(list.contains(&format!("<Terminal name=\"{name}\"")), "{model}: {list}");
        }
        let members: Vec<&str> =
            list.split("variableName=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
        assert!(members.len() >= 9);
        for member in members {
            assert!(three.description.contains(&format!("name=\"{member}\"")), "{model}: {member}");
        }
    }
}

#[test]
fn several_libraries_go_into_one_fmu_each_in_its_platform_s_folder() {
    let model = document("driven-head", &[]);
    let folder = tempfile::tempdir().unwrap();
    // Only the headers, because nothing else is read.
    let elf = |machine: u8| [b"\x7fELF\x02\x01".as_slice(), &[0; 12], &[machine, 0]].concat();
    let windows = [b"MZ".as_slice(), &[0; 58], &[0x40, 0, 0, 0], b"PE\0\0", &[0x64, 0x86]].concat();
    let mac = [0xcf, 0xfa, 0xed, 0xfe, 0x0c, 0, 0, 1].to_vec();
    let files = [("a.so", elf(0x3e)), ("b.so", elf(0xb7)), ("c.dll", windows), ("d.dylib", mac)];
    let paths = files.map(|(name, content)| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    });
    let out = folder.path().join("all.fmu");
    let fmu = Fmu::of(&model).unwrap();
    for (standard, expected) in [
        (Standard::Fmi2, ["linux64", "aarch64-linux", "win64", "aarch64-darwin"]),
        (Standard::Fmi3, ["x86_64-linux", "aarch64-linux", "x86_64-windows", "aarch64-darwin"]),
    ] {
        fmu.write(standard, &paths, &out).unwrap();
        let archive = zip::ZipArchive::new(std::fs::File::open(&out).unwrap()).unwrap();
        for platform in expected {
            assert!(
                archive.file_names().any(|name| name.unwrap().starts_with(&format!("binaries/{platform}/"))),
                "{platform}"
            );
        }
    }
    let error = fmu.write(Standard::Fmi3, &[paths[0].clone(), paths[0].clone()], &out).unwrap_err().to_string();
    assert!(error.contains("a second library for x86_64-linux"), "{error}");
    std::fs::write(&paths[0], b"#!/bin/sh").unwrap();
    let error = fmu.write(Standard::Fmi3, &paths, &out).unwrap_err().to_string();
    assert!(error.contains("not a shared library"), "{error}");
}
