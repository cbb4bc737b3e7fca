//! A host that makes random calls: after any sequence of them, an instance is equal to a new one that receives only the calls
//! that led to its state.
#![allow(clippy::unwrap_used, clippy::undocumented_unsafe_blocks, missing_docs, reason = "the test is the host")]

mod common;

use std::ffi::{c_int, c_void};
use std::ptr::null_mut;

use caudal::fmu::{Catalogue, Fmu, Standard, Target};
use caudal::scene::Document;
use caudal::variable::Size;
use common::{Dice, Fmi2, Fmi3, Unpacked, document, reference, references2};

/// A call that changes an instance.
#[derive(Debug, Clone)]
enum Call {
    Nodes(u64),
    Enter(f64, Option<f64>),
    Exit,
    /// An input from a node on.
    Set(&'static str, usize, Vec<f64>),
    /// A derivative of an entry, with its order.
    Derivative(&'static str, usize, i32, f64),
    /// A parameter by its index.
    Tune(usize, f64),
    Step(f64, f64),
    /// Passes everything that was set to the stepper.
    Read,
}

/// The functions of a version, with a common interface for both.
enum Host {
    Two(Fmi2, Unpacked),
    Three(Fmi3),
}

impl Host {
    fn of(document: &Document, standard: Standard) -> Self {
        let fmu = Unpacked::of(document, standard);
        match standard {
            Standard::Fmi2 => Self::Two(Fmi2::of(&fmu), fmu),
            // The code of the library stays loaded while instances exist, so its folder must outlive the functions.
            Standard::Fmi3 => {
                let functions = Fmi3::of(&fmu);
                std::mem::forget(fmu);
                Self::Three(functions)
            }
        }
    }

    fn instance(&self) -> *mut c_void {
        match self {
            Self::Two(fmi, fmu) => fmi.instance(fmu),
            Self::Three(fmi) => fmi.instance(None, null_mut()),
        }
    }

    fn free(&self, instance: *mut c_void) {
        match self {
            Self::Two(fmi, _) => unsafe { (fmi.free)(instance) },
            Self::Three(fmi) => unsafe { (fmi.free)(instance) },
        }
    }

    fn call(&self, instance: *mut c_void, call: &Call) -> c_int {
        unsafe {
            match (self, call) {
                (Self::Two(..), Call::Nodes(_)) | (Self::Three(_), Call::Derivative(..)) => 3,
                (Self::Three(fmi), Call::Nodes(nodes)) => {
                    let statuses = [
                        (fmi.configure)(instance),
                        (fmi.set_u64)(instance, &reference("nodes"), 1, nodes, 1),
                        (fmi.configured)(instance),
                    ];
                    statuses.into_iter().max().unwrap()
                }
                (Self::Two(fmi, _), Call::Enter(start, tolerance)) => {
                    let given = (c_int::from(tolerance.is_some()), tolerance.unwrap_or_default());
                    match (fmi.setup)(instance, given.0, given.1, *start, 0, 0.0) {
                        0 => (fmi.enter)(instance),
                        status => status,
                    }
                }
                (Self::Three(fmi), Call::Enter(start, tolerance)) => {
                    let given = (u8::from(tolerance.is_some()), tolerance.unwrap_or_default());
                    (fmi.enter)(instance, given.0, given.1, *start, 0, 0.0)
                }
                (Self::Two(fmi, _), Call::Exit) => (fmi.exit)(instance),
                (Self::Three(fmi), Call::Exit) => (fmi.exit)(instance),
                (Self::Two(fmi, _), Call::Set(name, node, values)) => {
                    let references = references2(name, *node..*node + values.len());
                    (fmi.set)(instance, references.as_ptr(), values.len(), values.as_ptr())
                }
                (Self::Three(fmi), Call::Set(name, node, values)) if *node == 0 => fmi.write(instance, name, values),
                (Self::Three(fmi), Call::Set(name, node, values)) => {
                    // An entry with the reference that it has without arrays.
                    let references = references2(name, *node..*node + values.len());
                    (fmi.set)(instance, references.as_ptr(), values.len(), values.as_ptr(), values.len())
                }
                (Self::Two(fmi, _), Call::Derivative(name, node, order, value)) => {
                    (fmi.rates)(instance, references2(name, *node..*node + 1).as_ptr(), 1, order, value)
                }
                (Self::Two(fmi, _), Call::Tune(place, value)) => {
                    let reference = Catalogue::reference(Standard::Fmi2, Target::Parameter(*place));
                    (fmi.set)(instance, &reference, 1, value)
                }
                (Self::Three(fmi), Call::Tune(place, value)) => {
                    let reference = Catalogue::reference(Standard::Fmi3, Target::Parameter(*place));
                    (fmi.set)(instance, &reference, 1, value, 1)
                }
                (Self::Two(fmi, _), Call::Step(t, h)) => (fmi.step)(instance, *t, *h, 0),
                (Self::Three(fmi), Call::Step(t, h)) => fmi.advance(instance, *t, *h).0,
                (_, Call::Read) => self.read(instance, "tip_y_m", 1).0,
            }
        }
    }

    fn read(&self, instance: *mut c_void, name: &str, len: usize) -> (c_int, Vec<f64>) {
        let mut values = vec![f64::NAN; len];
        let status = match self {
            Self::Two(fmi, _) => unsafe {
                (fmi.get)(instance, references2(name, 0..len).as_ptr(), len, values.as_mut_ptr())
            },
            Self::Three(fmi) => unsafe { (fmi.get)(instance, &reference(name), 1, values.as_mut_ptr(), len) },
        };
        (status, values)
    }

    /// All values by which two instances may differ; `None` if nothing can be read.
    fn all(&self, instance: *mut c_void, nodes: usize, parameters: usize) -> Option<Vec<u64>> {
        let mut seen = Vec::new();
        for (name, size) in SEEN {
            let (status, values) = self.read(instance, name, if *size == Size::Scalar { 1 } else { nodes });
            if status != 0 {
                return None;
            }
            seen.extend(values.iter().map(|value| value.to_bits()));
        }
        for place in 0..parameters {
            let mut value = f64::NAN;
            let status = match self {
                Self::Two(fmi, _) => unsafe {
                    let reference = Catalogue::reference(Standard::Fmi2, Target::Parameter(place));
                    (fmi.get)(instance, &reference, 1, &mut value)
                },
                Self::Three(fmi) => unsafe {
                    let reference = Catalogue::reference(Standard::Fmi3, Target::Parameter(place));
                    (fmi.get)(instance, &reference, 1, &mut value, 1)
                },
            };
            assert_eq!(status, 0);
            seen.push(value.to_bits());
        }
        Some(seen)
    }

    fn save(&self, instance: *mut c_void) -> *mut c_void {
        let mut state = null_mut();
        let status = match self {
            Self::Two(_, fmu) => unsafe {
                fmu.function::<unsafe extern "C" fn(*mut c_void, *mut *mut c_void) -> c_int>("fmi2GetFMUstate")(
                    instance, &mut state,
                )
            },
            Self::Three(fmi) => unsafe { (fmi.save)(instance, &mut state) },
        };
        assert_eq!(status, 0);
        state
    }

    /// Restores a state, by its serialised form if `far`.
    fn restore(&self, instance: *mut c_void, state: *mut c_void, far: bool) -> c_int {
        type Restore = unsafe extern "C" fn(*mut c_void, *mut c_void) -> c_int;
        match self {
            Self::Two(_, fmu) => unsafe { fmu.function::<Restore>("fmi2SetFMUstate")(instance, state) },
            Self::Three(fmi) if far => unsafe {
                let (bytes, mut copy) = (fmi.bytes(instance, state), null_mut());
                assert_eq!((fmi.deserialize)(instance, bytes.as_ptr(), bytes.len(), &mut copy), 0);
                let status = (fmi.restore)(instance, copy);
                assert_eq!((fmi.forget)(instance, &mut copy), 0);
                status
            },
            Self::Three(fmi) => unsafe { (fmi.restore)(instance, state) },
        }
    }

    fn forget(&self, instance: *mut c_void, mut state: *mut c_void) {
        type Forget = unsafe extern "C" fn(*mut c_void, *mut *mut c_void) -> c_int;
        let status = match self {
            Self::Two(_, fmu) => unsafe { fmu.function::<Forget>("fmi2FreeFMUstate")(instance, &mut state) },
            Self::Three(fmi) => unsafe { (fmi.forget)(instance, &mut state) },
        };
        assert_eq!(status, 0);
    }

    fn reset(&self, instance: *mut c_void) -> c_int {
        match self {
            Self::Two(fmi, _) => unsafe { (fmi.reset)(instance) },
            Self::Three(fmi) => unsafe { (fmi.reset)(instance) },
        }
    }
}

const SEEN: &[(&str, Size)] = &[
    ("x_m", Size::Nodes),
    ("vy_m_s", Size::Nodes),
    ("force_y_n", Size::Nodes),
    ("bending_stiffness_n_m2", Size::Scalar),
    ("time_step_s", Size::Scalar),
    ("viscosity_pa_s", Size::Scalar),
    ("head_x_m", Size::Scalar),
    ("head_moment_n_m", Size::Scalar),
    ("actuation_work_j", Size::Scalar),
    ("numerical_dissipation_j", Size::Scalar),
    ("newton_iterations", Size::Scalar),
];

/// The host's knowledge of an instance: the calls that led to it, and its current stage and time.
#[derive(Debug, Clone, Default)]
struct Story {
    calls: Vec<Call>,
    /// 0: not yet initialised, 1: initialising, 2: stepping.
    stage: usize,
    nodes: usize,
    start: f64,
    time: f64,
    /// True if something was set since the last read.
    pending: bool,
}

const NODES: usize = 7;

/// Largest number of calls before the story starts again, so that it stays short.
const LONGEST: usize = 40;

fn play(changes: &[&str], standard: Standard, seed: u64, calls: usize) {
    let nodes = format!("rod.nodes={NODES}");
    let document = document("driven-head", &[changes, &[&nodes]].concat());
    let fmu = Fmu::of(&document).unwrap();
    let own = document.scene().unwrap().parameters();
    let tunable = |place: &usize| own[*place].is_tunable();
    let (tunable, any): (Vec<usize>, Vec<usize>) = (
        (0..own.len()).filter(tunable).collect(),
        (0..own.len()).filter(|i| own[*i].key.starts_with("rod.")).collect(),
    );
    drop(fmu);
    let host = Host::of(&document, standard);
    let mut dice = Dice(seed);
    let blank = Story { nodes: NODES, ..Story::default() };
    let (live, mut story) = (host.instance(), blank.clone());
    let mut saved: Vec<(*mut c_void, Story)> = Vec::new();
    let (mut asked, mut made) = (0, 0);
    while made < calls {
        made += 1;
        if story.calls.len() > LONGEST {
            assert_eq!(host.reset(live), 0);
            story = blank.clone();
        }
        let arrays = standard == Standard::Fmi3;
        let size = story.nodes;
        let mut after = story.clone();
        let call = match dice.below(20) {
            0..=2 => {
                let scalar = ["viscosity_pa_s", "head_x_m", "head_vx_m_s"][dice.below(3)];
                Call::Set(scalar, 0, vec![dice.between(1.0, 3.0) * if scalar == "viscosity_pa_s" { 1.0 } else { 1e-2 }])
            }
            3..=5 => {
                let whole = dice.below(2) == 0;
                let first = if whole { 0 } else { 1 + dice.below(size - 2) };
                let len = if whole { size } else { 1 };
                Call::Set("force_y_n", first, (0..len).map(|_| dice.between(-1e-3, 1e-3)).collect())
            }
            6 => {
                let node = 1 + dice.below(size - 2);
                let entry = dice.below(2) == 0;
                let (name, node) = if entry { ("force_y_n", node) } else { ("viscosity_pa_s", 0) };
                Call::Derivative(name, node, 1 + dice.below(3) as i32, dice.between(-1e-2, 1e-2))
            }
            7..=8 => {
                let from = if story.stage == 2 { &tunable } else { &any };
                let place = from[dice.below(from.len())];
                let factor = [1.0, 1.1, 0.9][dice.below(3)];
                Call::Tune(place, own[place].value * factor)
            }
            9 if arrays && story.stage == 0 => {
                after.nodes = [NODES, 9, 12][dice.below(3)];
                Call::Nodes(after.nodes as u64)
            }
            10..=11 if story.stage < 2 => {
                after.stage = story.stage + 1;
                if story.stage == 1 {
                    Call::Exit
                } else {
                    after.start = [0.0, 1.5, 1.7e9][dice.below(3)];
                    after.time = after.start;
                    Call::Enter(after.start, [None, Some(1e-4), Some(1e-15)][dice.below(3)])
                }
            }
            12 => {
                let state = host.save(live);
                saved.push((state, story.clone()));
                if saved.len() > 5 {
                    let (state, _) = saved.swap_remove(dice.below(5));
                    host.forget(live, state);
                }
                continue;
            }
            13 if !saved.is_empty() => {
                let (state, then) = &saved[dice.below(saved.len())];
                let status = host.restore(live, *state, dice.below(2) == 0);
                assert_eq!(
                    status,
                    0,
                    "{standard:?} {changes:?} seed {seed}: {:?}",
                    common::MESSAGES.lock().unwrap().last()
                );
                story = then.clone();
                continue;
            }
            14 if dice.below(8) == 0 => {
                assert_eq!(host.reset(live), 0);
                story = blank.clone();
                continue;
            }
            15 if story.stage == 2 || standard == Standard::Fmi3 => {
                // Compares with a new instance.
                asked += 1;
                let other = host.instance();
                for call in &story.calls {
                    let status = host.call(other, call);
                    assert_eq!(status, 0, "{call:?} of {:?}", story.calls);
                }
                let (a, b) = (host.all(live, story.nodes, own.len()), host.all(other, story.nodes, own.len()));
                host.free(other);
                assert!(a == b, "{standard:?} {changes:?} seed {seed}: {:?}\n{a:?}\n{b:?}", story.calls);
                if story.pending && a.is_some() {
                    story.calls.push(Call::Read);
                    story.pending = false;
                }
                continue;
            }
            _ if story.stage == 2 => {
                let h = [2e-3, 5e-3, 1.3e-3, -1.0, f64::NAN][dice.below(5)];
                let wrong = if dice.below(5) == 0 { 0.5 } else { 0.0 };
                after.time = story.time + h;
                Call::Step(story.time + wrong, h)
            }
            _ => continue,
        };
        let status = host.call(live, &call);
        if status == 0 {
            let sets = matches!(call, Call::Set(..) | Call::Derivative(..) | Call::Tune(..) | Call::Nodes(_));
            after.pending = sets; // all other calls pass the set values on
            after.calls.push(call);
            story = after;
        }
    }
    for (state, _) in saved {
        host.forget(live, state);
    }
    host.free(live);
    assert!(asked > calls / 50, "{asked}");
}

#[test]
fn an_instance_is_what_the_calls_that_led_to_it_make_of_a_new_one() {
    // For a long run: CAUDAL_RANDOM_CALLS=1000000.
    let calls = std::env::var("CAUDAL_RANDOM_CALLS").ok().and_then(|calls| calls.parse().ok()).unwrap_or(4000);
    let kinds: [&[&str]; 4] = [
        &["solver.integrator=implicit-euler"],
        &["solver.integrator=esdirk3", "solver.tolerance=1e-3"],
        &["solver.form=chain"],
        &[common::HINGE],
    ];
    for (seed, kind) in (1..).zip(kinds) {
        for standard in [Standard::Fmi2, Standard::Fmi3] {
            play(kind, standard, seed, calls / 8);
        }
    }
}
