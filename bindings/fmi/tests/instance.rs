//! The state of an instance is consistent after any calls of a host: parameters, inputs and their derivatives, time and log.
#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::undocumented_unsafe_blocks,
    missing_docs,
    reason = "the test is the host; a failure ends it"
)]

mod common;

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::ptr::{null, null_mut};
use std::sync::Mutex;

use caudal::fmu::{Catalogue, Fmu, Standard, Target};
use caudal::scene::Document;
use caudal::stepper::Stepper;
use common::{Fmi2, Fmi3, Unpacked, document, reference, references2};

/// The reference of a parameter.
fn parameter(document: &Document, name: &str, standard: Standard) -> u32 {
    let parameters = document.scene().unwrap().parameters();
    let place = parameters.iter().position(|parameter| parameter.name() == name).unwrap();
    Catalogue::reference(standard, Target::Parameter(place))
}

fn tune(fmi: &Fmi3, instance: *mut c_void, parameter: u32, value: f64) -> c_int {
    unsafe { (fmi.set)(instance, &parameter, 1, &value, 1) }
}

fn value(fmi: &Fmi3, instance: *mut c_void, reference: u32) -> f64 {
    let mut value = f64::NAN;
    assert_eq!(unsafe { (fmi.get)(instance, &reference, 1, &mut value, 1) }, 0);
    value
}

fn saved(fmi: &Fmi3, instance: *mut c_void) -> *mut c_void {
    let mut state = null_mut();
    assert_eq!(unsafe { (fmi.save)(instance, &mut state) }, 0);
    state
}

#[test]
fn a_parameter_that_was_tuned_and_set_back_leaves_states_that_can_be_restored() {
    let document = document("driven-head", &["rod.nodes=9"]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let modulus = parameter(&document, "rod.youngs_modulus_pa", Standard::Fmi3);
    let instance = fmi.start();
    assert_eq!(fmi.advance(instance, 0.0, 0.01).0, 0);
    let own = value(&fmi, instance, modulus);
    let [stiffness, tip] = ["bending_stiffness_n_m2", "tip_y_m"].map(|name| fmi.read(instance, name, 1)[0]);
    let state = saved(&fmi, instance);
    // A finite difference with respect to the parameter, as a host computes it.
    assert_eq!(tune(&fmi, instance, modulus, 2.0 * own), 0);
    assert_eq!(fmi.advance(instance, 0.01, 0.01).0, 0);
    assert_eq!(fmi.read(instance, "bending_stiffness_n_m2", 1)[0], 2.0 * stiffness);
    assert_eq!(tune(&fmi, instance, modulus, own), 0);
    assert_eq!(fmi.write(instance, "viscosity_pa_s", &[7.0]), 0);
    for _ in 0..2 {
        assert_eq!(unsafe { (fmi.restore)(instance, state) }, 0);
        let here = [value(&fmi, instance, modulus), fmi.read(instance, "bending_stiffness_n_m2", 1)[0]];
        assert_eq!(here, [own, stiffness]);
        assert_eq!(fmi.read(instance, "tip_y_m", 1)[0], tip);
        assert_eq!(fmi.advance(instance, 0.01, 0.01).0, 0);
    }
    // A state with tuned parameters, and with inputs that have not been read yet, is restored completely.
    assert_eq!(tune(&fmi, instance, modulus, 3.0 * own), 0);
    assert_eq!(fmi.write(instance, "viscosity_pa_s", &[7.0]), 0);
    let tuned = saved(&fmi, instance);
    assert_eq!(unsafe { (fmi.restore)(instance, state) }, 0);
    assert_eq!(fmi.read(instance, "viscosity_pa_s", 1)[0], document.scene().unwrap().model().unwrap().fluid.viscosity);
    assert_eq!(unsafe { (fmi.restore)(instance, tuned) }, 0);
    assert_eq!(fmi.read(instance, "viscosity_pa_s", 1), [7.0]);
    assert_eq!(fmi.read(instance, "bending_stiffness_n_m2", 1)[0], 3.0 * stiffness);
    unsafe { (fmi.free)(instance) };
}

#[test]
fn every_entry_of_an_array_goes_on_by_its_own_derivatives_whatever_is_said_of_others_and_in_whatever_order() {
    let document = document("driven-head", &["rod.nodes=9"]);
    let fmu = Unpacked::of(&document, Standard::Fmi2);
    let fmi = Fmi2::of(&fmu);
    let [one, other] = [3, 4].map(|node| references2("natural_curvature_1_m", node..node + 1)[0]);
    let set =
        |instance, reference: u32, value: f64| assert_eq!(unsafe { (fmi.set)(instance, &reference, 1, &value) }, 0);
    let rate = |instance, reference: u32, order: c_int, value: f64| {
        assert_eq!(unsafe { (fmi.rates)(instance, &reference, 1, &order, &value) }, 0);
    };
    let get = |instance, reference: u32| {
        let mut value = f64::NAN;
        assert_eq!(unsafe { (fmi.get)(instance, &reference, 1, &mut value) }, 0);
        value
    };
    let step = |instance, t: f64| assert_eq!(unsafe { (fmi.step)(instance, t, 0.1, 0) }, 0);
    for (derivative_first, read) in [(false, false), (false, true), (true, false), (true, true)] {
        let instance = fmi.start(&fmu);
        if derivative_first {
            rate(instance, one, 1, 10.0);
        }
        if read {
            get(instance, one);
        }
        set(instance, one, 0.0);
        if !derivative_first {
            rate(instance, one, 1, 10.0);
        }
        if read {
            assert_eq!(get(instance, one), 0.0);
        }
        set(instance, other, 0.5);
        step(instance, 0.0);
        assert!((get(instance, one) - 1.0).abs() < 1e-12, "{derivative_first} {read}: {}", get(instance, one));
        assert_eq!(get(instance, other), 0.5);
        // Another entry is set: this one is still extrapolated.
        set(instance, other, 0.6);
        rate(instance, other, 2, 10.0);
        step(instance, 0.1);
        assert!((get(instance, one) - 2.0).abs() < 1e-12);
        assert!((get(instance, other) - 0.65).abs() < 1e-12);
        // A new value ends it.
        set(instance, one, 2.0);
        step(instance, 0.2);
        assert_eq!(get(instance, one), 2.0);
        assert!((get(instance, other) - 0.8).abs() < 1e-12);
        unsafe { (fmi.free)(instance) };
    }
}

#[test]
fn configuration_keeps_the_inputs_that_do_not_depend_on_it() {
    let fmu = Unpacked::of(&document("driven-head", &[]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let instance = fmi.instance(None, null_mut());
    assert_eq!(fmi.write(instance, "viscosity_pa_s", &[2.5]), 0);
    unsafe {
        assert_eq!((fmi.configure)(instance), 0);
        assert_eq!((fmi.set_u64)(instance, &reference("nodes"), 1, &17, 1), 0);
        assert_eq!((fmi.configured)(instance), 0);
    }
    assert_eq!(fmi.read(instance, "viscosity_pa_s", 1), [2.5]);
    assert_eq!(fmi.read(instance, "x_m", 17).len(), 17);
    unsafe { (fmi.free)(instance) };
}

#[test]
fn a_wrong_communication_point_is_refused_however_late_it_is_and_a_host_s_own_sum_is_not() {
    let fmu = Unpacked::of(&document("driven-head", &["rod.nodes=9"]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let (start, h) = (1.7e9, 0.01);
    let instance = fmi.instance(None, null_mut());
    assert_eq!(unsafe { (fmi.enter)(instance, 0, 0.0, start, 1, start + 0.5) }, 0);
    assert_eq!(unsafe { (fmi.exit)(instance) }, 0);
    for wrong in [start + 1.0, start + h, start - h, start + 0.1 * h, f64::NAN] {
        assert_eq!(fmi.advance(instance, wrong, h).0, 3, "{wrong}");
    }
    // The sum has a rounding error of 0.1 µs per step.
    let mut time = start;
    for _ in 0..50 {
        assert_eq!(fmi.advance(instance, time, h).0, 0);
        time += h;
    }
    assert_eq!(fmi.advance(instance, time, h).0, 3, "beyond the stop time");
    unsafe { (fmi.free)(instance) };
}

#[test]
fn a_host_whose_time_drifts_from_that_of_its_steps_is_told_so() {
    let fmu = Unpacked::of(&document("driven-head", &["rod.nodes=9"]), Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let h = 1e-3;
    // At most a thousandth of a step in total, not in each step.
    for (off, made) in [(4e-4, 3), (1e-4, 11), (-4e-4, 3)] {
        let instance = fmi.start();
        let refused = (0..100).find(|k| fmi.advance(instance, f64::from(*k) * h * (1.0 + off), h).0 != 0);
        assert_eq!(refused, Some(made), "{off}");
        unsafe { (fmi.free)(instance) };
    }
    // Products and sums count as the same time.
    for start in [0.0, 1e6] {
        let instance = fmi.instance(None, null_mut());
        assert_eq!(unsafe { (fmi.enter)(instance, 0, 0.0, start, 0, 0.0) }, 0);
        assert_eq!(unsafe { (fmi.exit)(instance) }, 0);
        let mut sum = start;
        for k in 0..3000 {
            let time = if k % 2 == 0 { sum } else { start + f64::from(k) * h };
            assert_eq!(fmi.advance(instance, time, h).0, 0, "step {k} from {start} s");
            sum += h;
        }
        unsafe { (fmi.free)(instance) };
    }
}

#[test]
fn a_tolerance_holds_for_the_experiment_that_it_was_given_for() {
    // The very first step depends on it.
    let changes = ["rod.nodes=9", "solver.integrator=esdirk3", "solver.tolerance=1e-3"];
    let document = document("glycerol", &changes);
    let (three, two) = (Unpacked::of(&document, Standard::Fmi3), Unpacked::of(&document, Standard::Fmi2));
    let own = Stepper::of(&document.scene().unwrap()).unwrap().get_scalar("time_step_s").unwrap();
    let fmi = Fmi3::of(&three);
    let radius = parameter(&document, "rod.inner_radius_m", Standard::Fmi3);
    for (tolerance, shorter) in [(None, false), (Some(1e-6), true)] {
        let instance = fmi.instance(None, null_mut());
        let inner = value(&fmi, instance, radius);
        // Rejected values leave nothing behind.
        assert_eq!(tune(&fmi, instance, radius, 1.0), 0);
        assert_eq!(unsafe { (fmi.enter)(instance, 1, 1e-5, 0.0, 0, 0.0) }, 3);
        assert_eq!(tune(&fmi, instance, radius, inner), 0);
        let defined = u8::from(tolerance.is_some());
        assert_eq!(unsafe { (fmi.enter)(instance, defined, tolerance.unwrap_or_default(), 0.0, 0, 0.0) }, 0);
        let first = fmi.read(instance, "time_step_s", 1)[0];
        assert!(if shorter { first < 0.5 * own } else { first == own }, "{tolerance:?}: {first} {own}");
        unsafe { (fmi.free)(instance) };
    }
    let fmi = Fmi2::of(&two);
    let instance = fmi.instance(&two);
    let mut first = f64::NAN;
    unsafe {
        assert_eq!((fmi.setup)(instance, 1, 1e-6, 0.0, 0, 0.0), 0);
        assert_eq!((fmi.setup)(instance, 0, 0.0, 0.0, 0, 0.0), 0);
        assert_eq!((fmi.enter)(instance), 0);
        assert_eq!((fmi.get)(instance, references2("time_step_s", 0..1).as_ptr(), 1, &mut first), 0);
        (fmi.free)(instance);
    }
    assert_eq!(first, own);
}

/// The element of a description with this name.
fn described<'a>(description: &'a str, name: &str) -> &'a str {
    let at = description.find(&format!("name=\"{name}\"")).unwrap_or_else(|| panic!("{name}"));
    let start = description[..at].rfind('<').unwrap();
    &description[start..at + description[at..].find('>').unwrap()]
}

#[test]
fn what_is_told_of_variables_is_what_the_model_that_was_built_does() {
    let modulus = "rod.youngs_modulus_pa";
    let describe = |changes: &[&str], standard| {
        let document = document("driven-head", &[changes, &["rod.nodes=9"]].concat());
        Fmu::of(&document).unwrap().description(standard).unwrap()
    };
    for standard in [Standard::Fmi2, Standard::Fmi3] {
        let positions = describe(&[], standard);
        assert!(described(&positions, modulus).contains("variability=\"tunable\""));
        for (name, told) in [("bending_stiffness_n_m2", "tunable"), ("mass_kg", "fixed"), ("time_step_s", "fixed")] {
            let told = format!("causality=\"calculatedParameter\" variability=\"{told}\"");
            assert!(described(&positions, name).contains(&told), "{name}");
        }
        let adaptive = describe(&["solver.integrator=esdirk3", "solver.tolerance=1e-3"], standard);
        assert!(described(&adaptive, "time_step_s").contains("causality=\"output\" variability=\"discrete\""));
        let chain = describe(&["solver.form=chain"], standard);
        assert!(described(&chain, modulus).contains("variability=\"fixed\""));
        assert!(described(&chain, "bending_stiffness_n_m2").contains("variability=\"fixed\""));
    }
    // Setting a variable described as fixed is rejected at once, not by the next step.
    let document = document("driven-head", &["rod.nodes=9", "solver.form=chain"]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let instance = fmi.start();
    let modulus = parameter(&document, modulus, Standard::Fmi3);
    assert_eq!(tune(&fmi, instance, modulus, 3e6), 3);
    assert_eq!(fmi.advance(instance, 0.0, 0.01).0, 0);
    unsafe { (fmi.free)(instance) };
}

#[test]
fn every_variable_and_parameter_with_a_unit_is_told_it() {
    for model in ["eel", "driven-head", "dipping-tail", "sperm", "baseline"] {
        let document = document(model, &["rod.nodes=8"]);
        let fmu = Fmu::of(&document).unwrap();
        let stepper = Stepper::of(&document.scene().unwrap()).unwrap();
        let description = fmu.description(Standard::Fmi3).unwrap();
        let variables = stepper.variables().iter().map(|variable| (variable.name.to_string(), variable.unit));
        let parameters = document.scene().unwrap().parameters();
        let parameters = parameters.iter().map(|parameter| (parameter.name(), parameter.unit));
        for (name, unit) in variables.chain(parameters) {
            let told = described(&description, &name).contains("declaredType=");
            assert_eq!(told, unit != "1", "{model}: {name}, {unit}");
        }
    }
}

/// The exponents of kg, m, s and rad of a unit by its name, such as `N s/m^2`.
fn exponents(name: &str) -> [i32; 4] {
    let mut sum = [0; 4];
    for (sign, part) in [1, -1].into_iter().zip(name.split('/')) {
        for symbol in part.split([' ', '*']).filter(|symbol| *symbol != "1") {
            let (symbol, power) =
                symbol.split_once('^').map_or((symbol, 1), |(symbol, power)| (symbol, power.parse().unwrap()));
            let base = match symbol {
                "kg" => [1, 0, 0, 0],
                "m" => [0, 1, 0, 0],
                "s" => [0, 0, 1, 0],
                "rad" => [0, 0, 0, 1],
                "Hz" => [0, 0, -1, 0],
                "N" => [1, 1, -2, 0],
                "Pa" => [1, -1, -2, 0],
                "J" => [1, 2, -2, 0],
                "W" => [1, 2, -3, 0],
                other => panic!("{other} of {name}"),
            };
            sum.iter_mut().zip(base).for_each(|(sum, base)| *sum += sign * power * base);
        }
    }
    sum
}

#[test]
fn units_are_of_the_base_units_that_their_names_say() {
    let mut tried = std::collections::BTreeSet::new();
    for model in ["eel", "driven-head", "dipping-tail", "sperm", "baseline", "glycerol"] {
        let document = document(model, &["rod.nodes=8"]);
        let description = Fmu::of(&document).unwrap().description(Standard::Fmi3).unwrap();
        for unit in description.split("<Unit ").skip(1) {
            let name = unit.split('"').nth(1).unwrap();
            let base = unit.split("<BaseUnit").nth(1).unwrap().split('>').next().unwrap();
            let told = ["kg", "m", "s", "rad"].map(|symbol| {
                base.split(&format!(" {symbol}=\""))
                    .nth(1)
                    .map_or(0, |rest| rest.split('"').next().unwrap().parse().unwrap())
            });
            assert_eq!(told, exponents(name), "{name}");
            tried.insert(name.to_string());
        }
    }
    assert!(tried.len() > 15, "{tried:?}");
}

#[test]
fn outputs_tell_the_parameters_and_the_time_that_they_follow_and_have_derivatives_by_them() {
    let document = document("driven-head", &["rod.nodes=9"]);
    let fmu = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&fmu);
    let instance = fmi.start();
    assert_eq!(fmi.advance(instance, 0.0, 0.2).0, 0);
    let modulus = parameter(&document, "rod.youngs_modulus_pa", Standard::Fmi3);
    let energy = reference("bending_energy_j");
    type Count = unsafe extern "C" fn(*mut c_void, u32, *mut usize) -> c_int;
    type List = unsafe extern "C" fn(*mut c_void, u32, *mut usize, *mut u32, *mut usize, *mut i32, usize) -> c_int;
    let (count, list): (Count, List) =
        (fmu.function("fmi3GetNumberOfVariableDependencies"), fmu.function("fmi3GetVariableDependencies"));
    let dependencies = |reference: u32| {
        let mut number = 99;
        assert_eq!(unsafe { count(instance, reference, &mut number) }, 0);
        let (mut own, mut others, mut elements, mut kinds) =
            (vec![0; number], vec![0; number], vec![0; number], vec![0; number]);
        let [own, elements] = [own.as_mut_ptr(), elements.as_mut_ptr()];
        let status =
            unsafe { list(instance, reference, own, others.as_mut_ptr(), elements, kinds.as_mut_ptr(), number) };
        assert_eq!(status, 0);
        others
    };
    assert!(dependencies(energy).contains(&modulus));
    assert!(
        dependencies(energy).contains(&reference("time_s"))
            == document.scene().unwrap().model().unwrap().actuation.is_some()
    );
    assert!(dependencies(reference("mass_kg")).contains(&parameter(&document, "rod.length_m", Standard::Fmi3)));
    assert!(dependencies(reference("force_x_n")).is_empty());
    let output = format!("<Output valueReference=\"{energy}\" dependencies=\"");
    let at = fmu.description.find(&output).unwrap() + output.len();
    let told = &fmu.description[at..at + fmu.description[at..].find('"').unwrap()];
    assert!(told.split(' ').any(|known| known == modulus.to_string()), "{told}");
    // The bending energy is proportional to the stiffness.
    type Directional = unsafe extern "C" fn(
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
    let directional: Directional = fmu.function("fmi3GetDirectionalDerivative");
    let (mut slope, stiffness) = (f64::NAN, value(&fmi, instance, modulus));
    let here = fmi.read(instance, "bending_energy_j", 1)[0];
    assert_eq!(unsafe { directional(instance, &energy, 1, &modulus, 1, &1.0, 1, &mut slope, 1) }, 0);
    assert!((slope * stiffness / here - 1.0).abs() < 1e-8, "{slope} {here}");
    assert_eq!(value(&fmi, instance, modulus), stiffness);
    // The angle follows only the head's own rotation.
    let time = reference("time_s");
    assert_eq!(unsafe { directional(instance, &reference("pose_angle_rad"), 1, &time, 1, &2.0, 1, &mut slope, 1) }, 0);
    assert_eq!(slope, 2.0 * fmi.read(instance, "pose_spin_rad_s", 1)[0]);
    unsafe { (fmi.free)(instance) };
}

static SAID: Mutex<Vec<String>> = Mutex::new(Vec::new());

unsafe extern "C" fn hear3(_: *mut c_void, _: c_int, category: *const c_char, _: *const c_char) {
    SAID.lock().unwrap().push(unsafe { CStr::from_ptr(category) }.to_string_lossy().into_owned());
}

unsafe extern "C" fn hear2(
    _: *mut c_void,
    _: *const c_char,
    _: c_int,
    category: *const c_char,
    _: *const c_char,
    _: *const c_char,
) {
    SAID.lock().unwrap().push(unsafe { CStr::from_ptr(category) }.to_string_lossy().into_owned());
}

#[repr(C)]
struct Hearing([*const c_void; 5]);

#[test]
fn messages_come_of_the_categories_that_are_on_and_no_others() {
    type SetLogging = unsafe extern "C" fn(*mut c_void, c_int, usize, *const *const c_char) -> c_int;
    type SetLogging3 = unsafe extern "C" fn(*mut c_void, u8, usize, *const *const c_char) -> c_int;
    let document = document("driven-head", &["rod.nodes=9"]);
    let heard = || std::mem::take(&mut *SAID.lock().unwrap());
    let [errors, steps, discards] = [c"logStatusError", c"logSteps", c"logStatusDiscard"].map(CStr::as_ptr);

    let two = Unpacked::of(&document, Standard::Fmi2);
    let fmi = Fmi2::of(&two);
    let set_logging: SetLogging = two.function("fmi2SetDebugLogging");
    let callbacks = Hearing([hear2 as *const c_void, null(), null(), null(), null()]);
    let location = CString::new(format!("file://{}", two.resources.display())).unwrap();
    let start = |logging: c_int| unsafe {
        let callbacks = (&raw const callbacks).cast();
        let instance =
            (fmi.instantiate)(c"two".as_ptr(), 1, two.token.as_ptr(), location.as_ptr(), callbacks, 0, logging);
        assert_eq!((fmi.setup)(instance, 0, 0.0, 0.0, 0, 0.0), 0);
        assert_eq!(((fmi.enter)(instance), (fmi.exit)(instance)), (0, 0));
        instance
    };
    let instance = start(1);
    let step = |t: f64| unsafe { (fmi.step)(instance, t, 0.01, 0) };
    assert_eq!((step(0.0), heard()), (0, vec!["logSteps".to_string()]));
    // The categories of the last call, and no others.
    assert_eq!(unsafe { set_logging(instance, 1, 1, &errors) }, 0);
    assert_eq!((step(0.01), heard()), (0, vec![]));
    assert_eq!((step(9.0), heard()), (3, vec!["logStatusError".to_string()]));
    assert_eq!(unsafe { set_logging(instance, 1, 1, &steps) }, 0);
    assert_eq!((step(9.0), heard()), (3, vec![]));
    assert_eq!((step(0.02), heard()), (0, vec!["logSteps".to_string()]));
    assert_eq!(unsafe { set_logging(instance, 0, 1, &discards) }, 0);
    assert_eq!((step(0.03), step(9.0), heard()), (0, 3, vec![]));
    unsafe { (fmi.free)(instance) };

    let three = Unpacked::of(&document, Standard::Fmi3);
    let fmi = Fmi3::of(&three);
    let set_logging: SetLogging3 = three.function("fmi3SetDebugLogging");
    let resources = CString::new(format!("{}/", three.resources.display())).unwrap();
    let instance = unsafe {
        let (name, none) = (c"three".as_ptr(), null_mut());
        (fmi.instantiate)(
            name,
            three.token.as_ptr(),
            resources.as_ptr(),
            0,
            0,
            0,
            0,
            null(),
            0,
            none,
            Some(hear3),
            None,
        )
    };
    fmi.initialize(instance);
    // Off: no step is logged, nor a discarded one; an error always is.
    assert_eq!(fmi.write(instance, "force_y_n", &[1e100; 9]), 0);
    let status = fmi.advance(instance, 0.0, 0.01).0;
    assert!(status != 0);
    assert_eq!(heard(), if status == 2 { vec![] } else { vec!["logStatusError".to_string()] });
    assert_eq!(fmi.write(instance, "force_y_n", &[0.0; 9]), 0);
    assert_eq!((fmi.advance(instance, 0.0, 0.01).0, heard()), (0, vec![]));
    // Each call adds or removes categories.
    assert_eq!(unsafe { set_logging(instance, 1, 1, &discards) }, 0);
    assert_eq!(unsafe { set_logging(instance, 1, 1, &steps) }, 0);
    assert_eq!((fmi.advance(instance, 0.01, 0.01).0, heard()), (0, vec!["logSteps".to_string()]));
    assert_eq!(unsafe { set_logging(instance, 0, 1, &steps) }, 0);
    assert_eq!((fmi.advance(instance, 0.02, 0.01).0, heard()), (0, vec![]));
    assert_eq!(unsafe { set_logging(instance, 0, 0, null()) }, 0);
    assert_eq!((fmi.advance(instance, 9.0, 0.01).0, heard()), (3, vec!["logStatusError".to_string()]));
    unsafe { (fmi.free)(instance) };
}

#[test]
fn tails_are_joined_by_terminals_of_which_each_may_have_less() {
    let fmu = Unpacked::of(&document("driven-head", &[]), Standard::Fmi3);
    let terminals = std::fs::read_to_string(fmu.folder.path().join("terminalsAndIcons/terminalsAndIcons.xml")).unwrap();
    for name in ["head", "tip"] {
        assert!(described(&terminals, name).contains("matchingRule=\"bus\""), "{terminals}");
    }
}

/// The value of an attribute of an element.
fn attribute(element: &str, name: &str) -> Option<String> {
    Some(element.split(&format!(" {name}=\"")).nth(1)?.split('"').next().unwrap().to_string())
}

/// The size of a unit in SI units, from its prefixes.
fn size_of(name: &str) -> f64 {
    let mut size = 1.0;
    for (sign, part) in [1, -1].into_iter().zip(name.split('/')) {
        for symbol in part.split(' ') {
            let (symbol, power) =
                symbol.split_once('^').map_or((symbol, 1), |(symbol, power)| (symbol, power.parse().unwrap()));
            let own = match symbol {
                "deg" => std::f64::consts::PI / 180.0,
                "g" | "mm" | "ms" | "mN" | "mJ" | "mW" | "mPa" => 1e-3,
                "cm" => 1e-2,
                "MPa" => 1e6,
                _ => 1.0,
            };
            size *= f64::powi(own, sign * power);
        }
    }
    size
}

#[test]
fn every_number_of_a_description_is_had_a_second_way() {
    let near = |found: &str, wanted: f64, what: &str| {
        let found: f64 = found.parse().unwrap();
        assert!((found - wanted).abs() <= 1e-12 * wanted.abs(), "{what}: {found}, a second way {wanted}");
    };
    // Computed by hand: length, bending stiffness, frequency, mass and viscosity.
    let pi = std::f64::consts::PI;
    let driven = [0.3, 2e6 * pi / 4.0 * 0.004_f64.powi(4), 1.0, 1100.0 * pi * 0.004 * 0.004 * 0.3, 1.0];
    let baseline = [1.0, 70e9 * pi / 4.0 * (0.013_f64.powi(4) - 0.011_f64.powi(4)), 2.0];
    // Every one of the study's nine nodes carries an eighth of the mass.
    let baseline = [&baseline[..], &[9.0 / 8.0 * 2700.0 * pi * (0.013 * 0.013 - 0.011 * 0.011), 1e-3]].concat();
    let (mut factors, mut nominals, mut least, mut starts) = (0, 0, 0, 0);
    for (model, hand) in [("driven-head", &driven[..]), ("baseline", &baseline)] {
        let document = document(model, &["rod.nodes=9"]);
        let fmu = Fmu::of(&document).unwrap();
        let scene = document.scene().unwrap();
        let mut stepper = Stepper::of(&scene).unwrap();
        // The number in the file for a key.
        let file = std::fs::read_to_string(common::models().join(format!("{model}.toml"))).unwrap();
        let in_file = |key: &str| -> Option<f64> {
            let (table, key) = key.split_once('.')?;
            let rest = file.split(&format!("[{table}]")).nth(1)?.split("\n[").next()?;
            let line = rest.lines().find(|line| line.split(" =").next() == Some(key))?;
            line.split('=').nth(1)?.split('#').next()?.trim().parse().ok()
        };
        let [length, stiffness, frequency, mass, viscosity] = hand[..] else { panic!() };
        let force = stiffness / (length * length);
        for standard in [Standard::Fmi2, Standard::Fmi3] {
            let text = fmu.description(standard).unwrap();
            for unit in text.split("<Unit ").skip(1).filter(|unit| unit.contains("DisplayUnit")) {
                let (name, shown) = (unit.split('"').nth(1).unwrap(), unit.split("<DisplayUnit").nth(1).unwrap());
                let shown_name = attribute(shown, "name").unwrap();
                let wanted = size_of(name) / size_of(&shown_name);
                near(&attribute(shown, "factor").unwrap(), wanted, &format!("{shown_name} of {name}"));
                factors += 1;
            }
            let experiment = text.split("<DefaultExperiment").nth(1).unwrap();
            near(&attribute(experiment, "stopTime").unwrap(), scene.solver.duration_s.get(), "stop");
            near(&attribute(experiment, "stepSize").unwrap(), in_file("solver.time_step_s").unwrap(), "step");
            near(&attribute(experiment, "startTime").unwrap(), 0.0, "start");
            // In FMI 3.0 types have the nominal values, in FMI 2.0 variables.
            let elements = text.split('<').filter(|part| part.contains(" nominal="));
            for element in elements {
                let unit = attribute(element, "unit").unwrap();
                let wanted = match unit.as_str() {
                    "m" => length,
                    "m/s" => length * frequency,
                    "1/m" => 1.0 / length,
                    "N" => force,
                    "N m" | "J" => force * length,
                    "W" => force * length * frequency,
                    "N m^2" => stiffness,
                    "kg" => mass,
                    "Hz" => frequency,
                    "Pa s" => viscosity,
                    other => panic!("{other} has no second way"),
                };
                near(&attribute(element, "nominal").unwrap(), wanted, &format!("nominal {unit}"));
                nominals += 1;
            }
        }
        let text = fmu.description(Standard::Fmi3).unwrap();
        let variables: Vec<_> = stepper.variables().to_vec();
        for variable in variables.iter().filter(|variable| variable.is_input()) {
            let told = described(&text, variable.name);
            let start: Vec<f64> =
                attribute(told, "start").unwrap().split(' ').map(|value| value.parse().unwrap()).collect();
            let own = stepper.get(variable.name).unwrap();
            // An array has an entry for every node, zero at nodes without a joint.
            let offset = variable.entries(stepper.model()).start;
            for (k, value) in start.iter().enumerate() {
                let own = if start.len() == 1 { own[0] } else { *own.get(k.wrapping_sub(offset)).unwrap_or(&0.0) };
                assert_eq!(*value, own, "{}[{k}]", variable.name);
            }
            starts += 1;
            // A value below the minimum is rejected, and a variable without a minimum accepts it.
            let entries = own.len();
            let refused = stepper.set(variable.name, &vec![-1e-3; entries]).is_err();
            assert_eq!(attribute(told, "min").is_some(), refused, "{}", variable.name);
            if let Some(min) = attribute(told, "min") {
                near(&min, 0.0, variable.name);
                stepper.set(variable.name, &vec![0.0; entries]).unwrap();
                least += 1;
            }
            stepper = Stepper::of(&scene).unwrap();
        }
        for parameter in &scene.parameters() {
            let told = described(&text, &parameter.name());
            if let Some(value) = in_file(&parameter.name()).filter(|_| parameter.key != "rod.nodes") {
                near(&attribute(told, "start").unwrap(), value, &parameter.name());
                starts += 1;
            }
        }
    }
    assert!(factors > 25 && nominals > 100 && least >= 3 && starts > 30, "{factors} {nominals} {least} {starts}");
}

#[test]
fn every_parameter_that_is_told_tunable_changes_within_a_run_and_no_other_does() {
    let mut tried = [0, 0];
    for model in ["driven-head", "eel"] {
        let document = document(model, &["rod.nodes=9", "solver.integrator=newmark", "solver.time_step_s=1e-3"]);
        let fmu = Unpacked::of(&document, Standard::Fmi3);
        let fmi = Fmi3::of(&fmu);
        let instance = fmi.start();
        assert_eq!(fmi.advance(instance, 0.0, 0.01).0, 0);
        for own in &document.scene().unwrap().parameters() {
            let reference = parameter(&document, &own.name(), Standard::Fmi3);
            let told = attribute(described(&fmu.description, &own.name()), "variability").unwrap();
            let changed = tune(&fmi, instance, reference, value(&fmi, instance, reference)) == 0;
            assert_eq!(changed, told == "tunable", "{model}: {} is told {told}", own.name());
            tried[usize::from(changed)] += 1;
        }
        unsafe { (fmi.free)(instance) };
    }
    assert!(tried[0] > 20 && tried[1] >= 4, "{tried:?}");
}

#[test]
fn the_log_says_that_auto_chose_the_fluid_of_a_rod_at_rest() {
    let still = document("driven-head", &["rod.nodes=9", "drag.law=auto", "head.kind=clamped"]);
    let named = document("driven-head", &["rod.nodes=9", "drag.law=cross-flow", "head.kind=clamped"]);
    for (document, warned) in [(still, true), (named, false)] {
        let fmu = Unpacked::of(&document, Standard::Fmi3);
        let fmi = Fmi3::of(&fmu);
        let resources = CString::new(format!("{}/", fmu.resources.display())).unwrap();
        common::MESSAGES.lock().unwrap().clear();
        let instance = unsafe {
            let (name, none, log) = (c"still".as_ptr(), null_mut(), Some(common::log3 as _));
            (fmi.instantiate)(name, fmu.token.as_ptr(), resources.as_ptr(), 0, 1, 0, 0, null(), 0, none, log, None)
        };
        fmi.initialize(instance);
        let said = common::MESSAGES.lock().unwrap().clone();
        let found = said.iter().any(|said| {
            said.starts_with("1 logStatusWarning: ") && said.contains("nothing in the scene moves this rod")
        });
        assert_eq!(found, warned, "{said:?}");
        unsafe { (fmi.free)(instance) };
    }
}
