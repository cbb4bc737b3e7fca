//! Calls in any order with any arguments, including null pointers, never crash the host.
//!
//! 60 000 calls per version; `CAUDAL_FUZZ_CALLS` sets another number, such as a million in continuous integration.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use std::ffi::{c_char, c_int, c_void};
use std::ptr::{null, null_mut};

use caudal::fmu::{Catalogue, Standard, Target};
use caudal::variable::VARIABLES;
use common::{Dice, Instantiate2, NO_CALLBACKS, Unpacked, document, log3};

/// Number of entries of every buffer; no count is larger.
const ROOM: usize = 64;

fn calls() -> usize {
    std::env::var("CAUDAL_FUZZ_CALLS").ok().and_then(|text| text.parse().ok()).unwrap_or(60_000)
}

/// Arguments of calls.
struct Arguments {
    dice: Dice,
    reals: [f64; ROOM],
    references: [u32; ROOM],
    orders: [c_int; ROOM],
    bytes: Vec<u8>,
    place: [u64; ROOM],
    standard: Standard,
}

impl Arguments {
    fn new(standard: Standard) -> Self {
        Self {
            dice: Dice(7),
            reals: [0.0; ROOM],
            references: [0; ROOM],
            orders: [1; ROOM],
            bytes: vec![0; 1 << 16],
            place: [0; ROOM],
            standard,
        }
    }

    fn chance(&mut self, one_in: usize) -> bool {
        self.dice.below(one_in) == 0
    }

    fn count(&mut self) -> usize {
        if self.chance(3) { self.dice.below(ROOM + 1) } else { 1 }
    }

    fn or_null<T>(&mut self, pointer: *mut T) -> *mut T {
        if self.chance(30) { null_mut() } else { pointer }
    }

    fn number(&mut self) -> f64 {
        match self.dice.below(12) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => -1.0,
            3 => 0.0,
            4 => 1e300,
            5 => f64::MIN_POSITIVE,
            _ => self.dice.between(0.0, 2.0),
        }
    }

    fn reals(&mut self) -> *mut f64 {
        for i in 0..ROOM {
            self.reals[i] = self.number();
        }
        let pointer = self.reals.as_mut_ptr();
        self.or_null(pointer)
    }

    fn reference(&mut self) -> u32 {
        let place = self.dice.below(VARIABLES.len());
        match self.dice.below(8) {
            0 => self.dice.next() as u32,
            1 => Catalogue::reference(self.standard, Target::Parameter(self.dice.below(30))),
            _ => Catalogue::reference(self.standard, Target::Variable(place, self.dice.below(12))),
        }
    }

    fn references(&mut self) -> *mut u32 {
        for i in 0..ROOM {
            self.references[i] = self.reference();
        }
        let pointer = self.references.as_mut_ptr();
        self.or_null(pointer)
    }

    fn orders(&mut self) -> *mut c_int {
        for i in 0..ROOM {
            self.orders[i] = if self.chance(10) { self.dice.next() as c_int } else { 1 + self.dice.below(3) as c_int };
        }
        let pointer = self.orders.as_mut_ptr();
        self.or_null(pointer)
    }

    /// Step sizes that do not take too long, and some invalid ones.
    fn step(&mut self) -> f64 {
        match self.dice.below(8) {
            0 => self.number().clamp(-1.0, 0.01),
            1 => f64::MAX,
            _ => self.dice.between(1e-4, 1e-2),
        }
    }

    fn place<T>(&mut self) -> *mut T {
        let pointer = self.place.as_mut_ptr().cast();
        self.or_null(pointer)
    }

    fn bytes(&mut self) -> *mut u8 {
        let pointer = self.bytes.as_mut_ptr();
        self.or_null(pointer)
    }
}

/// Existing instances and states.
struct Alive {
    instances: Vec<*mut c_void>,
    states: Vec<*mut c_void>,
}

impl Alive {
    fn instance(&self, arguments: &mut Arguments) -> *mut c_void {
        if self.instances.is_empty() || arguments.chance(50) {
            return null_mut();
        }
        self.instances[arguments.dice.below(self.instances.len())]
    }

    fn state(&self, arguments: &mut Arguments) -> *mut c_void {
        if self.states.is_empty() || arguments.chance(10) {
            return null_mut();
        }
        self.states[arguments.dice.below(self.states.len())]
    }
}

type Get = unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut c_void) -> c_int;
type Get3 = unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut c_void, usize) -> c_int;
type Plain = unsafe extern "C" fn(*mut c_void) -> c_int;
type State = unsafe extern "C" fn(*mut c_void, *mut *mut c_void) -> c_int;
type Restore = unsafe extern "C" fn(*mut c_void, *mut c_void) -> c_int;
type Size = unsafe extern "C" fn(*mut c_void, *mut c_void, *mut usize) -> c_int;
type Bytes = unsafe extern "C" fn(*mut c_void, *mut c_void, *mut u8, usize) -> c_int;
type FromBytes = unsafe extern "C" fn(*mut c_void, *const u8, usize, *mut *mut c_void) -> c_int;

/// The functions that save, restore, free and serialise states, common to both versions.
struct States {
    save: State,
    restore: Restore,
    forget: State,
    size: Size,
    serialize: Bytes,
    deserialize: FromBytes,
}

impl States {
    fn call(&self, which: usize, alive: &mut Alive, arguments: &mut Arguments) -> c_int {
        let (instance, mut state) = (alive.instance(arguments), alive.state(arguments));
        unsafe {
            match which {
                0 if alive.states.len() < 20 => {
                    let mut new = null_mut();
                    let status = (self.save)(instance, if arguments.chance(20) { null_mut() } else { &mut new });
                    alive.states.extend((!new.is_null()).then_some(new));
                    status
                }
                0 => (self.save)(instance, &mut state),
                1 => (self.restore)(instance, state),
                2 if alive.states.len() > 10 => {
                    let status = (self.forget)(instance, &mut state.clone());
                    if status == 0 {
                        alive.states.retain(|other| *other != state);
                    }
                    status
                }
                2 => (self.forget)(instance, null_mut()),
                3 => (self.size)(instance, state, arguments.place()),
                4 => {
                    let size = if arguments.chance(4) { arguments.dice.below(300) } else { 1 << 16 };
                    (self.serialize)(instance, state, arguments.bytes(), size)
                }
                _ => {
                    if arguments.chance(5) {
                        let place = arguments.dice.below(1 << 10);
                        arguments.bytes[place] ^= 1 << arguments.dice.below(8);
                    }
                    let mut new = null_mut();
                    let status = (self.deserialize)(instance, arguments.bytes(), 1 << 16, &mut new);
                    alive.states.extend((!new.is_null()).then_some(new));
                    status
                }
            }
        }
    }
}

/// Counts statuses, and checks that each is valid.
fn count(statuses: &mut [usize; 5], status: c_int) {
    statuses[usize::try_from(status).unwrap()] += 1;
}

/// Asserts that successful and rejected calls occurred, and that nothing broke.
fn judge(statuses: [usize; 5], steps: usize) {
    println!("statuses {statuses:?}, {steps} steps");
    assert!(
        steps > calls() / 200 && statuses[0] > calls() / 20 && statuses[3] > calls() / 20 && statuses[4] == 0,
        "{statuses:?} {steps}"
    );
}

#[test]
fn any_calls_of_fmi_3_end_in_a_status() {
    any_calls_of_fmi_3(&[]);
}

#[test]
fn any_calls_of_fmi_3_end_in_a_status_with_a_head_on_a_hinge() {
    any_calls_of_fmi_3(&[common::HINGE]);
}

#[test]
fn any_calls_of_fmi_3_end_in_a_status_where_poses_are_those_at_the_end() {
    any_calls_of_fmi_3(&["head.input=at-end"]);
}

fn any_calls_of_fmi_3(head: &[&str]) {
    let fmu = Unpacked::of(&document("driven-head", &[head, &["rod.nodes=9"]].concat()), Standard::Fmi3);
    let fmi = common::Fmi3::of(&fmu);
    let states = States {
        save: fmi.save,
        restore: fmi.restore,
        forget: fmi.forget,
        size: fmi.size,
        serialize: fmi.serialize,
        deserialize: fmi.deserialize,
    };
    let plain: Vec<Plain> = [
        "fmi3ExitInitializationMode",
        "fmi3EnterEventMode",
        "fmi3Terminate",
        "fmi3Reset",
        "fmi3EnterConfigurationMode",
        "fmi3ExitConfigurationMode",
        "fmi3EvaluateDiscreteStates",
        "fmi3EnterContinuousTimeMode",
        "fmi3EnterStepMode",
    ]
    .map(|name| fmu.function(name))
    .into();
    let typed: Vec<Get3> =
        ["Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean", "String"]
            .iter()
            .flat_map(|kind| ["Get", "Set"].map(|verb| fmu.function(&format!("fmi3{verb}{kind}"))))
            .collect();
    let derivative: [unsafe extern "C" fn(
        *mut c_void,
        *const u32,
        usize,
        *const u32,
        usize,
        *const f64,
        usize,
        *mut f64,
        usize,
    ) -> c_int; 2] = ["fmi3GetDirectionalDerivative", "fmi3GetAdjointDerivative"].map(|name| fmu.function(name));
    let rates: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const c_int, *mut f64, usize) -> c_int =
        fmu.function("fmi3GetOutputDerivatives");
    let dependencies: unsafe extern "C" fn(*mut c_void, u32, *mut usize) -> c_int =
        fmu.function("fmi3GetNumberOfVariableDependencies");
    let which: unsafe extern "C" fn(*mut c_void, u32, *mut usize, *mut u32, *mut usize, *mut c_int, usize) -> c_int =
        fmu.function("fmi3GetVariableDependencies");
    let logging: unsafe extern "C" fn(*mut c_void, u8, usize, *const *const c_char) -> c_int =
        fmu.function("fmi3SetDebugLogging");
    let intervals: unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut f64, *mut c_int) -> c_int =
        fmu.function("fmi3GetIntervalDecimal");
    let mut a = Arguments::new(Standard::Fmi3);
    let mut alive = Alive { instances: Vec::new(), states: Vec::new() };
    let (mut statuses, mut steps) = ([0; 5], 0);
    for _ in 0..calls() {
        let instance = alive.instance(&mut a);
        let (n, m) = (a.count(), a.count());
        let status = unsafe {
            match a.dice.below(30) {
                0 if alive.instances.len() < 4 => {
                    let token = if a.chance(4) { null() } else { fmu.token.as_ptr() };
                    let path = std::ffi::CString::new(fmu.resources.display().to_string()).unwrap();
                    let new = (fmi.instantiate)(
                        c"fuzz".as_ptr(),
                        token,
                        path.as_ptr(),
                        0,
                        0,
                        0,
                        1,
                        null(),
                        0,
                        null_mut(),
                        if a.chance(2) { Some(log3) } else { None },
                        None,
                    );
                    alive.instances.extend((!new.is_null()).then_some(new));
                    continue;
                }
                1 if alive.instances.len() > 2 && a.chance(20) => {
                    alive.instances.retain(|other| *other != instance);
                    (fmi.free)(instance);
                    continue;
                }
                2 => plain[a.dice.below(plain.len())](instance),
                3 => {
                    let defined = u8::from(a.chance(8));
                    (fmi.enter)(instance, 0, 0.0, if a.chance(4) { a.number() } else { 0.0 }, defined, a.number())
                }
                4 | 5 => plain[0](instance),
                6..=9 => (fmi.get)(instance, a.references(), n, a.reals(), if a.chance(4) { n } else { m }),
                10..=12 => (fmi.set)(instance, a.references(), n, a.reals(), m),
                13 => typed[a.dice.below(typed.len())](instance, a.references(), n, a.place(), m),
                14 | 15 => {
                    let index = usize::from(a.chance(3));
                    derivative[index](instance, a.references(), n, a.references(), m, a.reals(), m, a.place::<f64>(), n)
                }
                16 => rates(instance, a.references(), n, a.orders(), a.place::<f64>(), n),
                17 => dependencies(instance, a.reference(), a.place()),
                18 => which(instance, a.reference(), a.place(), a.references(), a.place(), a.orders(), n),
                19 => logging(instance, u8::from(a.chance(3)), 0, null()),
                20 => intervals(instance, a.references(), n, a.reals(), a.orders()),
                21..=24 => states.call(a.dice.below(6), &mut alive, &mut a),
                _ => {
                    let mut now = [0.0];
                    let time = common::reference("time_s");
                    let read = (fmi.get)(instance, &time, 1, now.as_mut_ptr(), 1);
                    let t = if read != 0 || a.chance(10) { a.number() } else { now[0] };
                    let status = (fmi.step)(instance, t, a.step(), 0, a.place(), a.place(), a.place(), a.place());
                    steps += usize::from(status == 0);
                    status
                }
            }
        };
        count(&mut statuses, status);
    }
    judge(statuses, steps);
}

#[test]
fn any_calls_of_fmi_2_end_in_a_status() {
    any_calls_of_fmi_2(&[]);
}

#[test]
fn any_calls_of_fmi_2_end_in_a_status_with_a_head_on_a_hinge() {
    any_calls_of_fmi_2(&[common::HINGE]);
}

fn any_calls_of_fmi_2(head: &[&str]) {
    let fmu = Unpacked::of(&document("driven-head", &[head, &["rod.nodes=9"]].concat()), Standard::Fmi2);
    let states = States {
        save: fmu.function("fmi2GetFMUstate"),
        restore: fmu.function("fmi2SetFMUstate"),
        forget: fmu.function("fmi2FreeFMUstate"),
        size: fmu.function("fmi2SerializedFMUstateSize"),
        serialize: fmu.function("fmi2SerializeFMUstate"),
        deserialize: fmu.function("fmi2DeSerializeFMUstate"),
    };
    let instantiate: Instantiate2 = fmu.function("fmi2Instantiate");
    let free: unsafe extern "C" fn(*mut c_void) = fmu.function("fmi2FreeInstance");
    let setup: unsafe extern "C" fn(*mut c_void, c_int, f64, f64, c_int, f64) -> c_int =
        fmu.function("fmi2SetupExperiment");
    let plain: Vec<Plain> = [
        "fmi2EnterInitializationMode",
        "fmi2ExitInitializationMode",
        "fmi2Terminate",
        "fmi2Reset",
        "fmi2CancelStep",
        "fmi2EnterEventMode",
        "fmi2EnterContinuousTimeMode",
    ]
    .map(|name| fmu.function(name))
    .into();
    let typed: Vec<Get> =
        ["fmi2GetInteger", "fmi2GetBoolean", "fmi2GetString", "fmi2SetInteger", "fmi2SetBoolean", "fmi2SetString"]
            .map(|name| fmu.function(name))
            .into();
    let get: unsafe extern "C" fn(*mut c_void, *const u32, usize, *mut f64) -> c_int = fmu.function("fmi2GetReal");
    let set: unsafe extern "C" fn(*mut c_void, *const u32, usize, *const f64) -> c_int = fmu.function("fmi2SetReal");
    let step: unsafe extern "C" fn(*mut c_void, f64, f64, c_int) -> c_int = fmu.function("fmi2DoStep");
    let derivatives: [unsafe extern "C" fn(*mut c_void, *const u32, usize, *const c_int, *mut f64) -> c_int; 2] =
        ["fmi2SetRealInputDerivatives", "fmi2GetRealOutputDerivatives"].map(|name| fmu.function(name));
    let directional: unsafe extern "C" fn(
        *mut c_void,
        *const u32,
        usize,
        *const u32,
        usize,
        *const f64,
        *mut f64,
    ) -> c_int = fmu.function("fmi2GetDirectionalDerivative");
    let status_of: Vec<unsafe extern "C" fn(*mut c_void, c_int, *mut c_void) -> c_int> =
        ["fmi2GetStatus", "fmi2GetRealStatus", "fmi2GetIntegerStatus", "fmi2GetBooleanStatus", "fmi2GetStringStatus"]
            .map(|name| fmu.function(name))
            .into();
    let location = std::ffi::CString::new(format!("file://{}", fmu.resources.display())).unwrap();
    let mut a = Arguments::new(Standard::Fmi2);
    let mut alive = Alive { instances: Vec::new(), states: Vec::new() };
    let (mut statuses, mut steps) = ([0; 5], 0);
    let time = Catalogue::reference(Standard::Fmi2, Target::Variable(common::reference("time_s") as usize, 0));
    for _ in 0..calls() {
        let instance = alive.instance(&mut a);
        let (n, m) = (a.count(), a.count());
        let status = unsafe {
            match a.dice.below(30) {
                0 if alive.instances.len() < 4 => {
                    let guid = if a.chance(4) { null() } else { fmu.token.as_ptr() };
                    let place = if a.chance(4) { c"http://nowhere".as_ptr() } else { location.as_ptr() };
                    let functions = if a.chance(6) { null() } else { &raw const NO_CALLBACKS };
                    let new = instantiate(c"fuzz".as_ptr(), 1, guid, place, functions, 0, c_int::from(a.chance(2)));
                    alive.instances.extend((!new.is_null()).then_some(new));
                    continue;
                }
                1 if alive.instances.len() > 2 && a.chance(20) => {
                    alive.instances.retain(|other| *other != instance);
                    free(instance);
                    continue;
                }
                2 => plain[a.dice.below(plain.len())](instance),
                3 => setup(
                    instance,
                    0,
                    0.0,
                    if a.chance(4) { a.number() } else { 0.0 },
                    c_int::from(a.chance(8)),
                    a.number(),
                ),
                4 => plain[0](instance),
                5 => plain[1](instance),
                6..=9 => get(instance, a.references(), n, a.reals()),
                10..=12 => set(instance, a.references(), n, a.reals()),
                13 => typed[a.dice.below(typed.len())](instance, a.references(), n, a.place()),
                14 | 15 => directional(instance, a.references(), n, a.references(), m, a.reals(), a.place()),
                16 => derivatives[1](instance, a.references(), n, a.orders(), a.place()),
                17 | 18 => derivatives[0](instance, a.references(), n, a.orders(), a.reals()),
                19 => status_of[a.dice.below(status_of.len())](instance, a.dice.below(6) as c_int, a.place()),
                20..=23 => states.call(a.dice.below(6), &mut alive, &mut a),
                _ => {
                    let mut now = 0.0;
                    let t = if get(instance, &time, 1, &mut now) != 0 || a.chance(10) { a.number() } else { now };
                    let status = step(instance, t, a.step(), 0);
                    steps += usize::from(status == 0);
                    status
                }
            }
        };
        count(&mut statuses, status);
    }
    judge(statuses, steps);
}
