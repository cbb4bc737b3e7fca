//! caudal as a C library: functions to drive the stepper of a scene. The header is `caudal.h`.
//!
//! Null pointers, invalid calls and even panics are reported by a status, with a message available from `caudal_message`; no
//! function aborts the program.
#![allow(clippy::missing_safety_doc, reason = "the comments say what each pointer must be")]
#![allow(non_camel_case_types, reason = "the names of C")]

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use engine::error::Error;
use engine::scene::Document;
use engine::sensitivity::{LinearisationRequest, StepDerivative};
use engine::stepper::snapshot::Snapshot;
use engine::stepper::{InputChange, StateCoordinates, Stepper};
use engine::variable::{Causality, Variable};

/// The status of a call.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum caudal_status {
    /// Success.
    CAUDAL_OK = 0,
    /// The step failed. Everything is as it was before the call.
    CAUDAL_STEP_FAILED = 1,
    /// The call is invalid: a null pointer, an unknown name, a wrong length, a value that is not allowed.
    CAUDAL_WRONG_CALL = 2,
    /// The scene is invalid, or a file cannot be read.
    CAUDAL_WRONG_SCENE = 3,
    /// An internal error of the library. The simulation must be freed.
    CAUDAL_BROKEN = 4,
}

use caudal_status::{CAUDAL_BROKEN, CAUDAL_OK, CAUDAL_STEP_FAILED, CAUDAL_WRONG_CALL, CAUDAL_WRONG_SCENE};

/// What determines the value of a variable.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum caudal_causality {
    /// Fixed by the scene.
    CAUDAL_PARAMETER = 0,
    /// Set by the host.
    CAUDAL_INPUT = 1,
    /// Computed.
    CAUDAL_OUTPUT = 2,
    /// Time.
    CAUDAL_INDEPENDENT = 3,
}

/// The coordinates of the state with respect to which a step is differentiated.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum caudal_coordinates {
    /// Positions and velocities. Accelerations follow from them at the beginning of the step.
    CAUDAL_MOTION = 0,
    /// All quantities of the motion in a state: also accelerations, and the method's memory of earlier ones.
    CAUDAL_FULL = 1,
}

/// A variable of a simulation. Its strings live as long as the simulation.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct caudal_variable {
    /// Name, ending in its unit.
    pub name: *const c_char,
    /// SI unit, or "1" if dimensionless.
    pub unit: *const c_char,
    /// Description.
    pub description: *const c_char,
    /// What determines its value.
    pub causality: caudal_causality,
    /// Number of values.
    pub length: usize,
}

/// A simulation. Only one thread may use it at a time; different simulations are independent.
pub struct caudal_simulation {
    stepper: Stepper,
    variables: Vec<&'static Variable>,
    texts: Vec<[CString; 3]>,
    /// A note on the fluid of the scene, to be reported before the first step.
    fluid_note: Option<String>,
    note: CString,
    broken: bool,
}

/// A saved state of a simulation.
pub struct caudal_state(Snapshot);

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::default();
}

/// The error of a call, with its status and message.
struct CallError(caudal_status, String);

impl From<Error> for CallError {
    fn from(error: Error) -> Self {
        let status = match &error {
            Error::Scene { .. } | Error::Several(_) | Error::Read { .. } => CAUDAL_WRONG_SCENE,
            Error::NotConverged { .. }
            | Error::NotFinite { .. }
            | Error::FoldOver { .. }
            | Error::EdgeCollapse { .. }
            | Error::Tolerance { .. } => CAUDAL_STEP_FAILED,
            _ => CAUDAL_WRONG_CALL,
        };
        Self(status, error.to_string())
    }
}

type CallResult<T = ()> = Result<T, CallError>;

fn refuse<T>(message: impl Into<String>) -> CallResult<T> {
    Err(CallError(CAUDAL_WRONG_CALL, message.into()))
}

/// Runs `work`, stores its error message and returns its status.
fn call(work: impl FnOnce() -> CallResult) -> caudal_status {
    let (status, message) = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => return CAUDAL_OK,
        Ok(Err(CallError(status, message))) => (status, message),
        Err(_) => (CAUDAL_BROKEN, "internal error".to_string()),
    };
    set_message(message);
    status
}

/// Stores the message of this thread. Does nothing in a thread that is exiting, whose thread-local values may be gone.
fn set_message(message: impl Into<String>) {
    let message = CString::new(message.into().replace('\0', "")).unwrap_or_default();
    let _ = MESSAGE.try_with(|last| last.replace(message));
}

/// The same for a simulation; a panic makes it unusable.
///
/// # Safety
/// `simulation` is null or a simulation that no other thread is using.
unsafe fn on(
    simulation: *mut caudal_simulation,
    work: impl FnOnce(&mut caudal_simulation) -> CallResult,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    let Some(simulation) = (unsafe { simulation.as_mut() }) else { return call(|| refuse("no simulation")) };
    if simulation.broken {
        set_message("this simulation failed before");
        return CAUDAL_BROKEN;
    }
    let status = call(|| work(simulation));
    simulation.broken = status == CAUDAL_BROKEN;
    status
}

/// # Safety
/// `text` is null or a zero-terminated string.
unsafe fn text<'a>(text: *const c_char, what: &str) -> CallResult<&'a str> {
    if text.is_null() {
        return refuse(format!("no {what}"));
    }
    // SAFETY: not null, and guaranteed by the caller.
    unsafe { CStr::from_ptr(text) }.to_str().or_else(|_| refuse(format!("the {what} is not UTF-8")))
}

/// # Safety
/// `start` is null or points to `length` values.
unsafe fn values<'a, T>(start: *const T, length: usize) -> CallResult<&'a [T]> {
    match (start.is_null(), length) {
        (_, 0) => Ok(&[]),
        (false, length) if length <= isize::MAX as usize / size_of::<T>() => {
            // SAFETY: guaranteed by the caller, and the size has been checked.
            Ok(unsafe { std::slice::from_raw_parts(start, length) })
        }
        _ => refuse("a null pointer instead of an array"),
    }
}

/// # Safety
/// `start` is null or points to `length` values that nobody else is using.
unsafe fn values_mut<'a, T>(start: *mut T, length: usize) -> CallResult<&'a mut [T]> {
    // SAFETY: guaranteed by the caller.
    unsafe { values(start.cast_const(), length) }?;
    // SAFETY: the same, checked by the call above.
    Ok(if length == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(start, length) } })
}

/// # Safety
/// `place` is null or writable.
unsafe fn put<T>(place: *mut T, value: T) -> CallResult {
    if place.is_null() {
        return refuse("a null pointer instead of a result");
    }
    // SAFETY: not null, and guaranteed by the caller.
    unsafe { place.write(value) };
    Ok(())
}

/// The version of the library.
#[unsafe(no_mangle)]
pub extern "C" fn caudal_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The message of the last call in this thread that did not return CAUDAL_OK; valid until the next such call. Empty in a thread
/// that is exiting, for example in destructors of its thread-local values.
#[unsafe(no_mangle)]
pub extern "C" fn caudal_message() -> *const c_char {
    MESSAGE.try_with(|message| message.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Reads the scene in the file `path`, with `count` `overrides` of its keys as "table.key=value", and starts a simulation. Writes
/// the simulation to `*simulation`, or null on failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_load(
    path: *const c_char,
    overrides: *const *const c_char,
    count: usize,
    simulation: *mut *mut caudal_simulation,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    call(|| unsafe {
        put(simulation, std::ptr::null_mut())?;
        let mut document = Document::read(Path::new(text(path, "path")?))?;
        for assignment in values(overrides, count)? {
            document.set(text(*assignment, "override")?)?;
        }
        let stepper = document.stepper(&document.scene()?)?;
        let fluid_note = stepper.fluid_note();
        let variables = stepper.variables().to_vec();
        let owned = |text: &str| CString::new(text).unwrap_or_default();
        let texts = variables.iter().map(|variable| [variable.name, variable.unit, variable.description].map(owned));
        let texts = texts.collect();
        put(
            simulation,
            Box::into_raw(Box::new(caudal_simulation {
                stepper,
                variables,
                texts,
                fluid_note,
                note: CString::default(),
                broken: false,
            })),
        )
    })
}

/// Frees a simulation. Null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_free(simulation: *mut caudal_simulation) {
    if !simulation.is_null() {
        // SAFETY: created by `caudal_load`, and not used afterwards.
        let _ = call(|| unsafe {
            drop(Box::from_raw(simulation));
            Ok(())
        });
    }
}

/// Current time, s; NaN for null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_time(simulation: *const caudal_simulation) -> f64 {
    // SAFETY: guaranteed by the caller.
    unsafe { simulation.as_ref() }.map_or(f64::NAN, |simulation| simulation.stepper.time())
}

/// Advances by `h` (s) to exactly t + h.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_do_step(simulation: *mut caudal_simulation, h: f64) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe { on(simulation, |simulation| Ok(simulation.stepper.do_step(h)?)) }
}

/// Notes on the start and on the steps since the last call of this function, which succeeded nevertheless: that `auto` chose the
/// fluid for a rod at rest, because nothing in the scene moves it; that the pose or the velocity of the head given by the host
/// jumped. Empty without notes, and for null; valid until the next call of this function for the same simulation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_note(simulation: *mut caudal_simulation) -> *const c_char {
    let mut note = c"".as_ptr();
    // SAFETY: guaranteed by the caller.
    let _ = unsafe {
        on(simulation, |simulation| {
            let jump = simulation.stepper.take_head_jump().map(|jump| jump.to_string());
            let notes: Vec<String> = simulation.fluid_note.take().into_iter().chain(jump).collect();
            simulation.note = CString::new(notes.join("\n")).unwrap_or_default();
            note = simulation.note.as_ptr();
            Ok(())
        })
    };
    note
}

/// The number of variables, which are indexed from 0; 0 for null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_variable_count(simulation: *const caudal_simulation) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { simulation.as_ref() }.map_or(0, |simulation| simulation.variables.len())
}

/// Writes the index of the variable `name` to `*index`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_find(
    simulation: *mut caudal_simulation,
    name: *const c_char,
    index: *mut usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let name = text(name, "name")?;
            match simulation.variables.iter().position(|variable| variable.name == name) {
                Some(place) => put(index, place),
                None => Err(simulation.stepper.get_scalar(name).err().map_or_else(
                    || CallError(CAUDAL_WRONG_CALL, format!("there is no variable `{name}`")),
                    CallError::from,
                )),
            }
        })
    }
}

impl caudal_simulation {
    fn variable(&self, index: usize) -> CallResult<&'static Variable> {
        self.variables.get(index).copied().map_or_else(|| refuse(format!("there is no variable {index}")), Ok)
    }

    fn length(&self, variable: &Variable, given: usize) -> CallResult {
        let expected = variable.len(self.stepper.model());
        if given == expected {
            return Ok(());
        }
        refuse(format!("variable `{}` has {expected} values, not {given}", variable.name))
    }
}

/// Writes the properties of variable `index` to `*variable`. Its strings live as long as the simulation.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_describe(
    simulation: *mut caudal_simulation,
    index: usize,
    variable: *mut caudal_variable,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let it = simulation.variable(index)?;
            let [name, unit, description] = simulation.texts[index].each_ref().map(|text| text.as_ptr());
            let causality = match it.causality {
                Causality::Parameter => caudal_causality::CAUDAL_PARAMETER,
                Causality::Input => caudal_causality::CAUDAL_INPUT,
                Causality::Output => caudal_causality::CAUDAL_OUTPUT,
                Causality::Independent => caudal_causality::CAUDAL_INDEPENDENT,
            };
            let length = it.len(simulation.stepper.model());
            put(variable, caudal_variable { name, unit, description, causality, length })
        })
    }
}

/// Reads all `length` values of variable `index`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_get(
    simulation: *mut caudal_simulation,
    index: usize,
    out: *mut f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let variable = simulation.variable(index)?;
            simulation.length(variable, length)?;
            variable.read(&simulation.stepper.view(), values_mut(out, length)?);
            Ok(())
        })
    }
}

/// Sets all `length` values of the input `index`, which hold until they are set again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_set(
    simulation: *mut caudal_simulation,
    index: usize,
    given: *const f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe { caudal_set_derivative(simulation, index, 0, given, length) }
}

/// Sets the time derivative of `order` 1 to 3 of an input. The input is then extrapolated from its value and derivatives, until
/// its value is set again. Order 0 is the value.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_set_derivative(
    simulation: *mut caudal_simulation,
    index: usize,
    order: usize,
    given: *const f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let variable = simulation.variable(index)?;
            let change = InputChange { variable, order, values: values(given, length)? };
            match simulation.stepper.set_all(std::iter::once(change)) {
                Ok(()) => Ok(()),
                // The value is at fault, not a step.
                Err(error) => Err(CallError(CAUDAL_WRONG_CALL, error.to_string())),
            }
        })
    }
}

/// Writes the current first time derivatives of variable `index`: for an input, those of its extrapolation; for a parameter,
/// zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_rate(
    simulation: *mut caudal_simulation,
    index: usize,
    out: *mut f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let variable = simulation.variable(index)?;
            simulation.length(variable, length)?;
            let nodes = variable.entries(simulation.stepper.model());
            let (rates, out) = (simulation.stepper.rates()?, values_mut(out, length)?);
            out.iter_mut().zip(nodes).for_each(|(out, k)| *out = rates.of(variable, k).unwrap_or(0.0));
            Ok(())
        })
    }
}

/// The derivatives of a step, each in row-major order: a (states x states) and b (states x inputs) of the state at its end, c
/// (outputs x states) and d (outputs x inputs) of the outputs there. Null pointers are skipped. Inputs and outputs are counted by
/// entry; the entries of an array are consecutive.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct caudal_derivatives {
    /// Derivatives of the state at the end with respect to the state at the beginning.
    pub a: *mut f64,
    /// Derivatives of the state at the end with respect to the inputs.
    pub b: *mut f64,
    /// Derivatives of the outputs with respect to the state at the beginning.
    pub c: *mut f64,
    /// Derivatives of the outputs with respect to the inputs.
    pub d: *mut f64,
}

/// The number of coordinates of the state; 0 for null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_state_count(
    simulation: *const caudal_simulation,
    coordinates: caudal_coordinates,
) -> usize {
    // SAFETY: guaranteed by the caller.
    unsafe { simulation.as_ref() }.map_or(0, |simulation| simulation.stepper.state_entries(coordinates.into()).len())
}

/// Writes positions and velocities, `length` in total, in the order of the coordinates CAUDAL_MOTION: x and y of each node that
/// is not held, the angle of a hinge, and the corresponding velocities.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_motion(
    simulation: *mut caudal_simulation,
    out: *mut f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let motion = simulation.stepper.motion();
            if length != motion.len() {
                return refuse(format!("the motion has {} values, not {length}", motion.len()));
            }
            values_mut(out, length)?.copy_from_slice(&motion);
            Ok(())
        })
    }
}

/// Sets positions and velocities, in the order of caudal_motion. Accelerations follow from the equation of motion.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_set_motion(
    simulation: *mut caudal_simulation,
    given: *const f64,
    length: usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe { on(simulation, |simulation| Ok(simulation.stepper.set_motion(values(given, length)?)?)) }
}

/// Makes a step of `h` (s) as caudal_do_step does, and writes the derivatives of the state and of the outputs with respect to the
/// state in these coordinates and to the inputs. Inputs and outputs are given by their indices. If a and c are null, neither is
/// computed, which on a fine mesh takes a small fraction of the time and memory. With `jump`, an input acts as if it were set at
/// the beginning, where accelerations jump with it; without it, the input had its value before. The matrices of successive steps
/// compose with CAUDAL_FULL, and with CAUDAL_MOTION for all methods except generalized-alpha: for an input that is set once and
/// then constant, B is A2 B1 + B2, with B1 computed with the jump and B2 without.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_linearise(
    simulation: *mut caudal_simulation,
    h: f64,
    coordinates: caudal_coordinates,
    inputs: *const usize,
    input_count: usize,
    outputs: *const usize,
    output_count: usize,
    jump: bool,
    derivatives: *const caudal_derivatives,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let Some(to) = derivatives.as_ref() else { return refuse("a null pointer instead of derivatives") };
            let names = |indices: &[usize]| -> CallResult<Vec<&str>> {
                indices.iter().map(|index| Ok(simulation.variable(*index)?.name)).collect()
            };
            let (inputs, outputs) = (names(values(inputs, input_count)?)?, names(values(outputs, output_count)?)?);
            let asked = LinearisationRequest {
                states: !(to.a.is_null() && to.c.is_null()),
                jump,
                ..LinearisationRequest::new(coordinates.into(), &inputs, &outputs)
            };
            let StepDerivative { a, b, c, d, .. } = simulation.stepper.linearise_as(h, &asked)?;
            for (matrix, to) in [(a, to.a), (b, to.b), (c, to.c), (d, to.d)] {
                if !to.is_null() {
                    // Column-major here.
                    values_mut(to, matrix.len())?.copy_from_slice(matrix.transpose().as_slice());
                }
            }
            Ok(())
        })
    }
}

impl From<caudal_coordinates> for StateCoordinates {
    fn from(coordinates: caudal_coordinates) -> Self {
        match coordinates {
            caudal_coordinates::CAUDAL_MOTION => Self::Motion,
            caudal_coordinates::CAUDAL_FULL => Self::Full,
        }
    }
}

/// Saves the state: time, motion, inputs, totals. Replaces `*state`, which is null or a saved state.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_save(
    simulation: *mut caudal_simulation,
    state: *mut *mut caudal_state,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe { on(simulation, |simulation| keep(simulation.stepper.save(), state)) }
}

/// # Safety
/// `state` is null, or points to null or to a saved state.
unsafe fn keep(snapshot: Snapshot, state: *mut *mut caudal_state) -> CallResult {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let Some(place) = state.as_mut() else { return refuse("a null pointer instead of a buffer for the state") };
        match place.as_mut() {
            Some(old) => old.0 = snapshot,
            None => *place = Box::into_raw(Box::new(caudal_state(snapshot))),
        }
    }
    Ok(())
}

/// Restores a state of the same scene. The run that follows is bit-identical to the run that followed the saved state. A state of
/// another scene is rejected.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_restore(
    simulation: *mut caudal_simulation,
    state: *const caudal_state,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| match state.as_ref() {
            Some(state) => Ok(simulation.stepper.restore(&state.0)?),
            None => refuse("no state"),
        })
    }
}

/// Writes a state as bytes to `bytes`, which has room for `*size`, and their number to `*size`. If `bytes` is null, it writes
/// only the number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_serialize(
    simulation: *mut caudal_simulation,
    state: *const caudal_state,
    bytes: *mut u8,
    size: *mut usize,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |_| {
            let (Some(state), Some(size)) = (state.as_ref(), size.as_mut()) else { return refuse("no state or size") };
            let content = state.0.serialize()?;
            let capacity = std::mem::replace(size, content.len());
            if bytes.is_null() {
                return Ok(());
            }
            if capacity < content.len() {
                return refuse(format!("{capacity} bytes are too few for a state of {}", content.len()));
            }
            values_mut(bytes, content.len())?.copy_from_slice(&content);
            Ok(())
        })
    }
}

/// Reads a state from `size` bytes and replaces `*state`, which is null or a saved state. Bytes that are damaged, or come from
/// another scene or version, are rejected.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_deserialize(
    simulation: *mut caudal_simulation,
    bytes: *const u8,
    size: usize,
    state: *mut *mut caudal_state,
) -> caudal_status {
    // SAFETY: guaranteed by the caller.
    unsafe {
        on(simulation, |simulation| {
            let snapshot = simulation.stepper.deserialize(values(bytes, size)?)?;
            keep(snapshot, state)
        })
    }
}

/// Frees a state. Null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn caudal_free_state(state: *mut caudal_state) {
    if !state.is_null() {
        // SAFETY: created by `keep`, and not used afterwards.
        let _ = call(|| unsafe {
            drop(Box::from_raw(state));
            Ok(())
        });
    }
}
