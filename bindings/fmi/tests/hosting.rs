//! Properties that a host relies on: trajectories bit-identical to the stepper, errors reported by a status, many instances in
//! threads.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use std::ffi::{c_char, c_int, c_void};
use std::ptr::{null, null_mut};

use caudal::fmu::{Catalogue, Standard, Target};
use caudal::scene::Document;
use caudal::stepper::Stepper;
use caudal::variable::Variable;
use common::{Dice, Fmi2, Fmi3, MESSAGES, NO_CALLBACKS, Unpacked, document, reference, references2, write};

/// All models, some with other methods.
fn scenes() -> Vec<Document> {
    let changes: [(&str, &[&str]); 8] = [
        ("baseline", &[]),
        ("driven-head", &[]),
        ("cantilever", &["solver.integrator=generalized-alpha"]),
        ("glycerol", &["solver.integrator=esdirk3", "medium.flow_m_s=[0.1,0.0]"]),
        ("newmark-compare-newmark", &[]),
        ("baseline-smooth", &["solver.form=chain"]),
        ("sperm", &[]),
        ("dipping-tail", &[]),
    ];
    changes.map(|(model, changes)| document(model, changes)).into()
}

#[test]
fn the_trajectory_is_the_stepper_s_to_the_bit_in_both_versions() {
    for document in scenes() {
        let scene = document.scene().unwrap();
        let (two, three) = (Unpacked::of(&document, Standard::Fmi2), Unpacked::of(&document, Standard::Fmi3));
        let (fmi2, fmi3) = (Fmi2::of(&two), Fmi3::of(&three));
        let (a, b) = (fmi2.start(&two), fmi3.start());
        let mut stepper = Stepper::of(&scene).unwrap();
        let nodes = scene.nodes();
        let h = 3.0 * scene.solver.time_step_s.unwrap().get();
        for step in 0..30 {
            // A host that controls the rod.
            let joints = stepper.get("natural_curvature_1_m").unwrap().len();
            let first = nodes - 1 - joints;
            let own: Vec<f64> = (0..joints).map(|k| 0.05 * (0.3 * f64::from(step) + k as f64).sin()).collect();
            stepper.set("natural_curvature_1_m", &own).unwrap();
            let of_nodes: Vec<f64> =
                (0..nodes).map(|k| if (first..nodes - 1).contains(&k) { own[k - first] } else { 0.0 }).collect();
            assert_eq!(fmi3.write(b, "natural_curvature_1_m", &of_nodes), 0);
            let references = references2("natural_curvature_1_m", first..nodes - 1);
            assert_eq!(unsafe { (fmi2.set)(a, references.as_ptr(), joints, own.as_ptr()) }, 0);
            let t = stepper.time();
            stepper.do_step(h).unwrap();
            assert_eq!(unsafe { (fmi2.step)(a, t, h, 1) }, 0);
            assert_eq!(fmi3.advance(b, t, h), (0, false, stepper.time()));
            for variable in stepper.variables() {
                let Variable { name, .. } = variable;
                if *name == caudal::fmu::NODES {
                    continue;
                }
                let expected = stepper.get(name).unwrap();
                let of = variable.entries(stepper.model());
                let mut found = vec![f64::NAN; expected.len()];
                let references = references2(name, of.clone());
                assert_eq!(unsafe { (fmi2.get)(a, references.as_ptr(), references.len(), found.as_mut_ptr()) }, 0);
                assert_eq!(expected, found, "{name}");
                let len = if variable.size == caudal::variable::Size::Scalar { 1 } else { nodes };
                assert_eq!(expected, fmi3.read(b, name, len)[of], "{name}");
            }
        }
        unsafe {
            (fmi2.free)(a);
            (fmi3.free)(b);
        }
    }
}

#[test]
fn inputs_go_on_along_their_derivatives_in_fmi_2_and_slopes_of_outputs_are_their_rates() {
    let document = document("glycerol", &["solver.integrator=newmark", "start.kind=shaped"]);
    let fmu = Unpacked::of(&document, Standard::Fmi2);
    let fmi = Fmi2::of(&fmu);
    let a = fmi.start(&fmu);
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    let force = references2("force_y_n", 0..9);
    let slope = [0.7; 9];
    let time = reference("time_s") as usize;
    for step in 0..50 {
        let t = stepper.time();
        // A force that grows linearly, given by its value and its slope.
        let now = [0.7 * t; 9];
        unsafe {
            assert_eq!((fmi.set)(a, force.as_ptr(), 9, now.as_ptr()), 0);
            assert_eq!((fmi.rates)(a, force.as_ptr(), 9, [1; 9].as_ptr(), slope.as_ptr()), 0);
            assert_eq!((fmi.step)(a, t, 5e-3, 0), 0, "{step}");
        }
        stepper.set("force_y_n", &now).unwrap();
        stepper.set_derivative("force_y_n", 1, &slope).unwrap();
        stepper.do_step(5e-3).unwrap();
    }
    let mut found = [0.0; 9];
    unsafe { assert_eq!((fmi.get)(a, force.as_ptr(), 9, found.as_mut_ptr()), 0) };
    assert!(found.iter().all(|x| (x - 0.7 * stepper.time()).abs() < 1e-14), "{found:?} at {}", stepper.time());
    let x = references2("x_m", 0..9);
    let mut velocity = [0.0; 9];
    unsafe {
        assert_eq!((fmi.get)(a, x.as_ptr(), 9, found.as_mut_ptr()), 0);
        assert_eq!((fmi.slopes)(a, x.as_ptr(), 9, [1; 9].as_ptr(), velocity.as_mut_ptr()), 0);
    }
    assert_eq!(stepper.get("x_m").unwrap(), found);
    assert_eq!(stepper.get("vx_m_s").unwrap(), velocity);
    let wrong = [Catalogue::reference(Standard::Fmi2, Target::Variable(time, 0))];
    unsafe { assert_eq!((fmi.slopes)(a, wrong.as_ptr(), 1, [1].as_ptr(), found.as_mut_ptr()), 3) };
    unsafe { (fmi.free)(a) };
}

#[test]
fn parameters_are_the_scene_s_keys_and_nodes_is_structural() {
    let original = document("driven-head", &[]);
    let fmu = Unpacked::of(&original, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let scene = original.scene().unwrap();
    let parameters = scene.parameters();
    let of = |name: &str| Catalogue::PARAMETERS + parameters.iter().position(|p| p.name() == name).unwrap() as u32;
    let a = fmi.instance(None, null_mut());
    unsafe {
        assert_eq!((fmi.set_u64)(a, &reference("nodes"), 1, &17, 1), 3, "only in configuration mode");
        assert_eq!((fmi.configure)(a), 0);
        assert_eq!((fmi.set_u64)(a, &reference("nodes"), 1, &2, 1), 3, "too few");
        assert_eq!((fmi.set_u64)(a, &reference("nodes"), 1, &17, 1), 0);
        assert_eq!((fmi.configured)(a), 0);
        assert_eq!((fmi.set)(a, &of("rod.youngs_modulus_pa"), 1, &3e6, 1), 0);
        assert_eq!((fmi.set)(a, &of("medium.viscosity_pa_s"), 1, &-1.0, 1), 3);
    }
    fmi.initialize(a);
    unsafe { assert_eq!((fmi.set)(a, &of("rod.length_m"), 1, &0.2, 1), 3, "fixed after initialisation") };
    let mut stepper =
        Stepper::of(&document("driven-head", &["rod.nodes=17", "rod.youngs_modulus_pa=3e6"]).scene().unwrap()).unwrap();
    for step in 0..20 {
        stepper.do_step(1e-2).unwrap();
        assert_eq!(fmi.advance(a, f64::from(step) * 1e-2, 1e-2).0, 0);
    }
    assert_eq!(stepper.get("y_m").unwrap(), fmi.read(a, "y_m", 17));
    assert_eq!(stepper.get("curvature_1_m").unwrap(), fmi.read(a, "curvature_1_m", 17)[..16]);
    // Reset restores the FMU as it was written.
    unsafe { assert_eq!((fmi.reset)(a), 0) };
    fmi.initialize(a);
    let stepper = Stepper::of(&scene).unwrap();
    assert_eq!(stepper.get("y_m").unwrap(), fmi.read(a, "y_m", 33));
    unsafe { (fmi.free)(a) };
}

#[test]
fn the_number_of_nodes_counts_the_centre_of_a_head_body() {
    let fmu = Unpacked::of(&document("sperm", &[]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let a = fmi.instance(None, null_mut());
    unsafe {
        assert_eq!((fmi.configure)(a), 0);
        assert_eq!((fmi.set_u64)(a, &reference("nodes"), 1, &3, 1), 3, "a rod of two nodes");
        assert_eq!((fmi.set_u64)(a, &reference("nodes"), 1, &18, 1), 0);
        assert_eq!((fmi.configured)(a), 0);
    }
    fmi.initialize(a);
    let mut stepper = Stepper::of(&document("sperm", &["rod.nodes=17"]).scene().unwrap()).unwrap();
    stepper.do_step(1e-2).unwrap();
    assert_eq!(fmi.advance(a, 0.0, 1e-2).0, 0);
    assert_eq!(stepper.get("y_m").unwrap(), fmi.read(a, "y_m", 18));
    assert_eq!(stepper.get("body_angle_rad").unwrap(), fmi.read(a, "body_angle_rad", 1));
    unsafe { (fmi.free)(a) };
}

/// A host's actions during steps.
struct Middle {
    fmi: Fmi3,
    instance: *mut c_void,
    times: Vec<f64>,
    heights: Vec<f64>,
    stop_at: Option<f64>,
}

unsafe extern "C" fn middle(
    environment: *mut c_void,
    t: f64,
    set: u8,
    get: u8,
    finished: u8,
    can_return: u8,
    early: *mut u8,
    at: *mut f64,
) {
    let host = unsafe { &mut *environment.cast::<Middle>() };
    assert_eq!((get, finished), (1, 1));
    host.times.push(t);
    assert_eq!(host.fmi.read(host.instance, "time_s", 1), [t]);
    host.heights.push(host.fmi.read(host.instance, "tip_y_m", 1)[0]);
    if set == 1 {
        assert_eq!(host.fmi.write(host.instance, "actuation_amplitude", &[0.5 + t]), 0);
    }
    // Calls that are not allowed here are rejected.
    assert_eq!(host.fmi.advance(host.instance, t, 1e-3).0, 3);
    unsafe { (host.fmi.free)(host.instance) };
    if let Some(stop) = host.stop_at.filter(|_| can_return == 1) {
        unsafe {
            *early = 1;
            *at = stop;
        }
    }
}

#[test]
fn hosts_look_and_steer_in_the_middle_of_a_step_and_may_end_it_early() {
    let document = document("glycerol", &[]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let mut host = Box::new(Middle {
        fmi: Fmi3::of(&fmu),
        instance: null_mut(),
        times: Vec::new(),
        heights: Vec::new(),
        stop_at: None,
    });
    let environment = (&raw mut *host).cast();
    host.instance = host.fmi.instance(Some(middle), environment);
    let instance = host.instance;
    let fmi = Fmi3::of(&fmu);
    fmi.initialize(instance);
    assert_eq!(fmi.advance(instance, 0.0, 1e-2), (0, false, 1e-2));
    assert_eq!(host.times.len(), 10);
    // A host that sets inputs between short steps gets the same result.
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    for (t, height) in host.times.iter().zip(&host.heights) {
        stepper.do_step(1e-3).unwrap();
        assert_eq!(stepper.get_scalar("tip_y_m").unwrap(), *height, "{t}");
        stepper.set("actuation_amplitude", &[0.5 + t]).unwrap();
    }
    host.stop_at = Some(0.0134);
    assert_eq!(fmi.advance(instance, 1e-2, 1e-2), (0, true, 0.0134));
    host.stop_at = None;
    assert_eq!(fmi.advance(instance, 0.0134, 1e-3), (0, false, 0.0144));
    unsafe { (fmi.free)(instance) };
}

#[test]
fn mistakes_are_answered_and_failed_steps_leave_the_last_good_state() {
    let fmu = Unpacked::of(&document("glycerol", &["solver.integrator=newmark"]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let early = fmi.instance(None, null_mut());
    assert_eq!(fmi.advance(early, 0.0, 1e-3).0, 3, "not initialised");
    unsafe { (fmi.free)(early) };
    let a = fmi.start();
    for (t, h) in [(0.0, 0.0), (0.0, -1e-3), (0.0, f64::NAN), (0.0, f64::INFINITY), (f64::NAN, 1e-3), (0.5, 1e-3)] {
        assert_eq!(fmi.advance(a, t, h).0, 3, "{t} {h}");
    }
    assert_eq!(fmi.write(a, "viscosity_pa_s", &[f64::NAN]), 3);
    assert_eq!(fmi.write(a, "viscosity_pa_s", &[-1.0]), 3);
    assert_eq!(fmi.write(a, "force_x_n", &[1.0; 8]), 3, "one too few");
    assert_eq!(fmi.write(a, "x_m", &[1.0; 9]), 3, "an output");
    unsafe {
        assert_eq!((fmi.get)(a, &9999, 1, &mut 0.0, 1), 3, "unknown");
        assert_eq!((fmi.get)(a, null(), 1, &mut 0.0, 1), 3);
        assert_eq!((fmi.get)(a, &0, 1, null_mut(), 1), 3);
        assert_eq!((fmi.get)(null_mut(), &0, 1, &mut 0.0, 1), 3);
        assert_eq!((fmi.get)(a, null(), 0, null_mut(), 0), 0, "nothing is fine");
        assert_eq!((fmi.step)(a, 0.0, 1e-3, 0, null_mut(), null_mut(), null_mut(), null_mut()), 3);
    }
    // A force that tears the rod apart.
    type SetLogging = unsafe extern "C" fn(*mut c_void, u8, usize, *const *const c_char) -> c_int;
    let set_logging: SetLogging = fmu.function("fmi3SetDebugLogging");
    assert_eq!(unsafe { set_logging(a, 1, 1, &c"logStatusDiscard".as_ptr()) }, 0);
    assert_eq!(fmi.advance(a, 0.0, 1e-2).0, 0);
    let before = fmi.read(a, "x_m", 9);
    assert_eq!(fmi.write(a, "force_y_n", &[0.0, 0.0, 1e12, 0.0, -1e12, 0.0, 0.0, 0.0, 0.0]), 0);
    let (status, early, last) = fmi.advance(a, 1e-2, 1e-2);
    assert_eq!((status, early), (2, false));
    assert!(MESSAGES.lock().unwrap().last().unwrap().starts_with("2 logStatusDiscard"));
    if last == 1e-2 {
        assert_eq!(before, fmi.read(a, "x_m", 9));
    }
    assert!(fmi.read(a, "x_m", 9).iter().all(|x| x.is_finite()));
    // With a moderate force the run continues from there.
    assert_eq!(fmi.write(a, "force_y_n", &[0.0; 9]), 0);
    assert_eq!(fmi.advance(a, last, 1e-3).0, 0);
    unsafe { (fmi.free)(a) };

    let two = Unpacked::of(&document("glycerol", &["solver.integrator=newmark"]), Standard::Fmi2);
    let fmi = Fmi2::of(&two);
    let a = fmi.start(&two);
    let force = references2("force_y_n", 0..9);
    unsafe {
        assert_eq!((fmi.set)(a, force.as_ptr(), 9, [0.0, 0.0, 1e12, 0.0, -1e12, 0.0, 0.0, 0.0, 0.0].as_ptr()), 0);
        assert_eq!((fmi.step)(a, 0.0, 1e-2, 0), 2);
        let mut last = f64::NAN;
        assert_eq!((fmi.real_status)(a, 2, &mut last), 0);
        assert!((0.0..1e-2).contains(&last));
        assert_eq!((fmi.step)(a, last, 1e-3, 0), 3, "not after a failed step");
        assert_eq!((fmi.terminate)(a), 0);
        assert_eq!((fmi.reset)(a), 0);
        assert_eq!((fmi.enter)(a), 0);
        (fmi.free)(a);
        // Other GUIDs and resource locations.
        let location = std::ffi::CString::new(format!("file://{}", two.resources.display())).unwrap();
        let new = |kind, guid: *const c_char, place: *const c_char| {
            (fmi.instantiate)(c"x".as_ptr(), kind, guid, place, &raw const NO_CALLBACKS, 0, 0)
        };
        assert!(new(0, two.token.as_ptr(), location.as_ptr()).is_null());
        assert!(new(1, c"{other}".as_ptr(), location.as_ptr()).is_null());
        assert!(new(1, two.token.as_ptr(), c"file:///nowhere".as_ptr()).is_null());
        assert!(new(1, null(), location.as_ptr()).is_null());
    }
}

#[test]
fn eight_threads_of_a_hundred_instances_agree() {
    let fmu = Unpacked::of(&document("glycerol", &[]), Standard::Fmi3);
    let run = |fmu: &Unpacked| {
        let fmi = Fmi3::of(fmu);
        let instances: Vec<_> = (0..100).map(|_| fmi.start()).collect();
        for step in 0..5 {
            instances.iter().for_each(|a| assert_eq!(fmi.advance(*a, f64::from(step) * 1e-3, 1e-3).0, 0));
        }
        let ends: Vec<_> = instances.iter().map(|a| fmi.read(*a, "x_m", 9)).collect();
        instances.iter().for_each(|a| unsafe { (fmi.free)(*a) });
        assert!(ends.iter().all(|end| *end == ends[0]));
        ends[0].clone()
    };
    let expected = run(&fmu);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| run(&fmu))).collect();
        threads.into_iter().for_each(|thread| assert_eq!(thread.join().unwrap(), expected));
    });
}

#[test]
fn the_same_scene_gives_the_same_bytes() {
    for standard in [Standard::Fmi2, Standard::Fmi3] {
        let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let [first, second] = folders.each_ref().map(|folder| {
            let path = write(&document("glycerol", &["rod.nodes=17"]), standard, folder.path());
            std::thread::sleep(std::time::Duration::from_millis(10));
            std::fs::read(path).unwrap()
        });
        assert!(first == second, "{standard:?}");
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
fn directional_derivatives_are_the_changes_of_a_get_after_a_set_and_adjoints_their_transposes() {
    const UNKNOWNS: [&str; 3] = ["head_force_x_n", "joint_moment_n_m", "load_power_w"];
    const KNOWNS: [&str; 3] = ["viscosity_pa_s", "natural_curvature_1_m", "force_y_n"];
    let document = document("driven-head", &["rod.nodes=9"]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let [directional, adjoint]: [Derivative; 2] =
        ["fmi3GetDirectionalDerivative", "fmi3GetAdjointDerivative"].map(|name| fmu.function(name));
    let tail = fmi.start();
    assert_eq!(fmi.advance(tail, 0.0, 0.1).0, 0);
    let lengths =
        |name: &str| if ["joint_moment_n_m", "natural_curvature_1_m", "force_y_n"].contains(&name) { 9 } else { 1 };
    let [rows, columns] = [UNKNOWNS, KNOWNS].map(|names| names.map(lengths).iter().sum::<usize>());
    let [unknowns, knowns] = [UNKNOWNS, KNOWNS].map(|names| names.map(reference));
    let call = |of: Derivative, seed: &[f64], len: usize| {
        let mut out = vec![f64::NAN; len];
        let (u, k) = (unknowns.as_ptr(), knowns.as_ptr());
        assert_eq!(unsafe { of(tail, u, 3, k, 3, seed.as_ptr(), seed.len(), out.as_mut_ptr(), len) }, 0);
        out
    };
    let (mut dice, mut worst) = (Dice(7), 0.0_f64);
    for _ in 0..10 {
        // In the unit of each input: viscosity 1 Pa s, curvature 1/m, force 0.01 N.
        let seed: Vec<f64> = (0..columns).map(|i| dice.between(-1.0, 1.0) * if i > 9 { 1e-2 } else { 1.0 }).collect();
        let weights: Vec<f64> = (0..rows).map(|_| dice.between(-1.0, 1.0)).collect();
        let change = call(directional, &seed, rows);
        let back = call(adjoint, &weights, columns);
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let (forth, back) = (sum(&weights, &change), sum(&back, &seed));
        assert!((forth - back).abs() <= 1e-12 * forth.abs().max(1e-3), "{forth} {back}");

        let read =
            |names: &[&str]| names.iter().flat_map(|name| fmi.read(tail, name, lengths(name))).collect::<Vec<_>>();
        let (inputs, outputs) = (read(&KNOWNS), read(&UNKNOWNS));
        let set = |values: &[f64]| {
            let mut at = 0;
            for name in KNOWNS {
                let len = lengths(name);
                assert_eq!(fmi.write(tail, name, &values[at..at + len]), 0);
                at += len;
            }
        };
        let moved = |by: f64| {
            set(&inputs.iter().zip(&seed).map(|(x, s)| x + by * s).collect::<Vec<_>>());
            read(&UNKNOWNS)
        };
        const BY: f64 = 1e-3;
        let (up, down) = (moved(BY), moved(-BY));
        set(&inputs);
        assert_eq!(read(&UNKNOWNS), outputs);
        let scale = change.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        for (i, change) in change.iter().enumerate() {
            let difference = (up[i] - down[i]) / (2.0 * BY);
            worst = worst.max((difference - change).abs() / scale);
        }
    }
    unsafe { (fmi.free)(tail) };
    println!("differences differ by {worst:e}");
    assert!(worst <= 1e-9, "{worst:e}");
}
