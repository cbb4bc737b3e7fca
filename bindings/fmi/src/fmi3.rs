//! The 75 functions of FMI 3.0, with the names and arguments of the standard, in its order.
#![allow(non_snake_case, reason = "the standard's names")]
#![allow(clippy::missing_safety_doc, missing_docs, reason = "what a host must fulfil is said by the standard")]
#![allow(clippy::too_many_arguments, reason = "the standard's arguments")]

use std::ffi::{CString, c_char, c_void};
use std::ops::ControlFlow;
use std::path::Path;

use caudal::fmu::{Standard, Target};

use crate::instance::{Experiment, Instance, InstanceMode, IntermediateUpdate, Logger};
use crate::states::{deserialize, forget, restore, save, serialize, state};
use crate::status::{FmiResult, Status, refuse};
use crate::{call, call_raw, free, instantiate, put, text, values, values_mut};

type Handle = *mut c_void;
type ValueReference = u32;
/// The standard's Boolean: C's bool, in which a host may have written any byte.
type Boolean = u8;

/// Modes in which values can be read.
const READABLE: [InstanceMode; 6] = [
    InstanceMode::Instantiated,
    InstanceMode::Configuration,
    InstanceMode::Initialization,
    InstanceMode::Step,
    InstanceMode::Intermediate,
    InstanceMode::Terminated,
];
/// Modes in which values can be set.
const SETTABLE: [InstanceMode; 4] =
    [InstanceMode::Instantiated, InstanceMode::Initialization, InstanceMode::Step, InstanceMode::Intermediate];
/// Modes in which derivatives are available.
const MOVING: [InstanceMode; 4] =
    [InstanceMode::Initialization, InstanceMode::Step, InstanceMode::Intermediate, InstanceMode::Terminated];

type LoggerFunction = unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char);

/// Passes messages to the host's logger.
fn logger(function: Option<LoggerFunction>, environment: *mut c_void) -> Logger {
    Box::new(move |status, category, message| {
        let Some(function) = function else { return };
        let category = CString::new(category).unwrap_or_default();
        let message = CString::new(message.replace('\0', "")).unwrap_or_default();
        // SAFETY: the host's function, called as the standard requires.
        unsafe { function(environment, status, category.as_ptr(), message.as_ptr()) };
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetDebugLogging(
    instance: Handle,
    logging_on: Boolean,
    count: usize,
    categories: *const *const c_char,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            let categories: Option<Vec<String>> = values(categories, count)?.iter().map(|name| text(*name)).collect();
            let Some(categories) = categories else { return refuse("a null pointer instead of a category") };
            instance.log_categories(
                Standard::Fmi3,
                logging_on != 0,
                &categories.iter().map(String::as_str).collect::<Vec<_>>(),
            )
        })
    }
}

/// Refuses to instantiate an unsupported interface.
///
/// # Safety
/// `log` must be a logger as required by the standard.
unsafe fn not_there(log: Option<LoggerFunction>, environment: *mut c_void) -> Handle {
    logger(log, environment)(Status::Error, "logStatusError", "this FMU is for co-simulation only");
    std::ptr::null_mut()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateModelExchange(
    _name: *const c_char,
    _token: *const c_char,
    _resource_path: *const c_char,
    _visible: Boolean,
    _logging_on: Boolean,
    environment: *mut c_void,
    log: Option<LoggerFunction>,
) -> Handle {
    // SAFETY: guaranteed by the host.
    unsafe { not_there(log, environment) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resource_path: *const c_char,
    _visible: Boolean,
    _logging_on: Boolean,
    environment: *mut c_void,
    log: Option<LoggerFunction>,
    _clock_update: *const c_void,
    _lock_preemption: *const c_void,
    _unlock_preemption: *const c_void,
) -> Handle {
    // SAFETY: guaranteed by the host.
    unsafe { not_there(log, environment) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    resource_path: *const c_char,
    _visible: Boolean,
    logging_on: Boolean,
    event_mode_used: Boolean,
    early_return_allowed: Boolean,
    required: *const ValueReference,
    required_count: usize,
    environment: *mut c_void,
    log: Option<LoggerFunction>,
    intermediate_update: Option<IntermediateUpdate>,
) -> Handle {
    // SAFETY: guaranteed by the host.
    let (name, token, path, required) =
        unsafe { (text(name), text(token), text(resource_path), values(required, required_count)) };
    let make = || {
        if name.is_none_or(|name| name.is_empty()) {
            return Err("an instance must have a name".to_string());
        }
        if event_mode_used != 0 {
            return Err("this FMU has no event mode".to_string());
        }
        let (Some(token), Some(path)) = (token, path) else {
            return Err("instantiation token and resource path must be given".to_string());
        };
        let mut instance = Instance::new(Path::new(&path), &token, logger(log, environment), environment)
            .map_err(|error| error.to_string())?;
        for reference in required.map_err(|refusal| refusal.message)? {
            instance.target(*reference).map_err(|refusal| refusal.message)?;
        }
        instance.early_return_allowed = early_return_allowed != 0;
        instance.intermediate_update = intermediate_update;
        if logging_on != 0 {
            instance.log_categories(Standard::Fmi3, true, &[]).map_err(|refusal| refusal.message)?;
        }
        Ok(instance)
    };
    instantiate(make, |message| logger(log, environment)(Status::Error, "logStatusError", message))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: Handle) {
    // SAFETY: guaranteed by the host.
    unsafe { free(instance) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterInitializationMode(
    instance: Handle,
    tolerance_defined: Boolean,
    tolerance: f64,
    start_time: f64,
    stop_time_defined: Boolean,
    stop_time: f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&[InstanceMode::Instantiated])?;
            let stop = (stop_time_defined != 0).then_some(stop_time);
            let experiment = Experiment { start: start_time, stop };
            instance.enter_initialization_of(experiment, (tolerance_defined != 0).then_some(tolerance))
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitInitializationMode(instance: Handle) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&[InstanceMode::Initialization])?;
            instance.exit_initialization()
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3EnterConfigurationMode(instance: Handle) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| instance.change_mode(&[InstanceMode::Instantiated], InstanceMode::Configuration))
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3ExitConfigurationMode(instance: Handle) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| instance.change_mode(&[InstanceMode::Configuration], InstanceMode::Instantiated))
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Terminate(instance: Handle) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| instance.change_mode(&[InstanceMode::Step], InstanceMode::Terminated)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3Reset(instance: Handle) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            if instance.mode == InstanceMode::Intermediate {
                return refuse("not allowed inside a step");
            }
            instance.reset()
        })
    }
}

// Values -----------------------------------------------------------------------------------------------------------

/// The parts of a flat array of `len` values that belong to each of `references`, with their targets.
fn parts(instance: &Instance, references: &[ValueReference], len: usize) -> FmiResult<()> {
    let mut total = 0;
    for reference in references {
        total += instance.len3(*reference).map_or_else(|| instance.target(*reference).map(|_| 1), Ok)?;
    }
    if total == len { Ok(()) } else { refuse(format!("{len} values for variables that have {total}")) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFloat64(
    instance: Handle,
    references: *const ValueReference,
    count: usize,
    out: *mut f64,
    out_count: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&READABLE)?;
            let (references, mut out) = (values(references, count)?, values_mut(out, out_count)?);
            parts(instance, references, out.len())?;
            instance.apply_inputs()?;
            for reference in references {
                let target = instance.float(*reference)?;
                let (these, rest) = out.split_at_mut(instance.len3(*reference).unwrap_or(1));
                instance.read(target, these);
                out = rest;
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFloat64(
    instance: Handle,
    references: *const ValueReference,
    count: usize,
    given: *const f64,
    given_count: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&SETTABLE)?;
            let (references, given) = (values(references, count)?, values(given, given_count)?);
            parts(instance, references, given.len())?;
            // All values are checked first, so that all or none are set.
            for set in [Instance::check_mut, Instance::set] {
                let mut given = given;
                for reference in references {
                    let target = instance.float(*reference)?;
                    let (these, rest) = given.split_at(instance.len3(*reference).unwrap_or(1));
                    set(instance, target, these)?;
                    given = rest;
                }
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetUInt64(
    instance: Handle,
    references: *const ValueReference,
    count: usize,
    out: *mut u64,
    out_count: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&READABLE)?;
            let (references, out) = (values(references, count)?, values_mut(out, out_count)?);
            parts(instance, references, out.len())?;
            for (reference, out) in references.iter().zip(out) {
                *out = instance.integer(instance.target(*reference)?)?;
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetUInt64(
    instance: Handle,
    references: *const ValueReference,
    count: usize,
    given: *const u64,
    given_count: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&[InstanceMode::Configuration])?;
            let (references, given) = (values(references, count)?, values(given, given_count)?);
            parts(instance, references, given.len())?;
            for (reference, value) in references.iter().zip(given) {
                instance.integer(instance.target(*reference)?)?;
                instance.check_nodes(*value)?;
            }
            given.iter().for_each(|value| instance.set_nodes(*value));
            Ok(())
        })
    }
}

/// Defines functions for values of a type that no variable has; they only accept empty lists.
macro_rules! no_values {
    ($($name:ident: $($argument:ident: $type:ty),*; $modes:ident;)*) => {
        $(#[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(
            instance: Handle,
            _references: *const ValueReference,
            count: usize,
            $($argument: $type),*
        ) -> Status {
            $(let _ = $argument;)*
            // SAFETY: guaranteed by the host.
            unsafe {
                call(instance, |instance| {
                    instance.require_mode(&$modes)?;
                    if count == 0 { Ok(()) } else { refuse("no variable has this type") }
                })
            }
        })*
    };
}

no_values! {
    fmi3GetFloat32: out: *mut f32, out_count: usize; READABLE;
    fmi3GetInt8: out: *mut i8, out_count: usize; READABLE;
    fmi3GetUInt8: out: *mut u8, out_count: usize; READABLE;
    fmi3GetInt16: out: *mut i16, out_count: usize; READABLE;
    fmi3GetUInt16: out: *mut u16, out_count: usize; READABLE;
    fmi3GetInt32: out: *mut i32, out_count: usize; READABLE;
    fmi3GetUInt32: out: *mut u32, out_count: usize; READABLE;
    fmi3GetInt64: out: *mut i64, out_count: usize; READABLE;
    fmi3GetBoolean: out: *mut Boolean, out_count: usize; READABLE;
    fmi3GetString: out: *mut *const c_char, out_count: usize; READABLE;
    fmi3GetBinary: sizes: *mut usize, out: *mut *const u8, out_count: usize; READABLE;
    fmi3GetClock: out: *mut Boolean; READABLE;
    fmi3SetFloat32: given: *const f32, given_count: usize; SETTABLE;
    fmi3SetInt8: given: *const i8, given_count: usize; SETTABLE;
    fmi3SetUInt8: given: *const u8, given_count: usize; SETTABLE;
    fmi3SetInt16: given: *const i16, given_count: usize; SETTABLE;
    fmi3SetUInt16: given: *const u16, given_count: usize; SETTABLE;
    fmi3SetInt32: given: *const i32, given_count: usize; SETTABLE;
    fmi3SetUInt32: given: *const u32, given_count: usize; SETTABLE;
    fmi3SetInt64: given: *const i64, given_count: usize; SETTABLE;
    fmi3SetBoolean: given: *const Boolean, given_count: usize; SETTABLE;
    fmi3SetString: given: *const *const c_char, given_count: usize; SETTABLE;
    fmi3SetBinary: sizes: *const usize, given: *const *const u8, given_count: usize; SETTABLE;
    fmi3SetClock: given: *const Boolean; SETTABLE;
    fmi3GetIntervalDecimal: intervals: *mut f64, qualifiers: *mut i32; READABLE;
    fmi3GetIntervalFraction: counters: *mut u64, resolutions: *mut u64, qualifiers: *mut i32; READABLE;
    fmi3GetShiftDecimal: shifts: *mut f64; READABLE;
    fmi3GetShiftFraction: counters: *mut u64, resolutions: *mut u64; READABLE;
    fmi3SetIntervalDecimal: intervals: *const f64; SETTABLE;
    fmi3SetIntervalFraction: counters: *const u64, resolutions: *const u64; SETTABLE;
    fmi3SetShiftDecimal: shifts: *const f64; SETTABLE;
    fmi3SetShiftFraction: counters: *const u64, resolutions: *const u64; SETTABLE;
}

// Structure and derivatives ----------------------------------------------------------------------------------------

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetNumberOfVariableDependencies(
    instance: Handle,
    reference: ValueReference,
    count: *mut usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&MOVING)?;
            put(count, instance.dependencies(instance.target(reference)?)?.len())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetVariableDependencies(
    instance: Handle,
    dependent: ValueReference,
    elements_of_dependent: *mut usize,
    independents: *mut ValueReference,
    elements_of_independents: *mut usize,
    kinds: *mut i32,
    count: usize,
) -> Status {
    /// fmi3Dependent.
    const DEPENDENT: i32 = 5;
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&MOVING)?;
            let dependencies = instance.dependencies(instance.target(dependent)?)?;
            if dependencies.len() != count {
                return refuse(format!("room for {count} dependencies; there are {}", dependencies.len()));
            }
            let (own, inputs) = (values_mut(elements_of_dependent, count)?, values_mut(independents, count)?);
            let (elements, kinds) = (values_mut(elements_of_independents, count)?, values_mut(kinds, count)?);
            for (i, (node, independent, k)) in dependencies.into_iter().enumerate() {
                // Elements are counted from 1.
                (own[i], inputs[i], elements[i], kinds[i]) = (node + 1, independent, k + 1, DEPENDENT);
            }
            Ok(())
        })
    }
}

/// Targets with all their nodes.
fn targets(instance: &Instance, references: &[ValueReference]) -> FmiResult<Vec<(Target, usize)>> {
    let mut targets = Vec::new();
    for reference in references {
        let target = instance.float(*reference)?;
        match (target, instance.len3(*reference)) {
            (Target::Variable(_, node), Some(1)) => targets.push((target, node)),
            (_, len) => targets.extend((0..len.unwrap_or(1)).map(|k| (target, k))),
        }
    }
    Ok(targets)
}

type Derivative = fn(&mut Instance, &[(Target, usize)], &[(Target, usize)], &[f64], &mut [f64]) -> FmiResult;

/// # Safety
/// The arguments are as required by the standard.
unsafe fn derivative(
    instance: Handle,
    [unknowns, knowns]: [(*const ValueReference, usize); 2],
    seed: (*const f64, usize),
    sensitivity: (*mut f64, usize),
    forward: bool,
) -> Status {
    let derivative: Derivative = if forward { Instance::directional } else { Instance::adjoint };
    // SAFETY: guaranteed by the caller.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&MOVING)?;
            let unknowns = targets(instance, values(unknowns.0, unknowns.1)?)?;
            let knowns = targets(instance, values(knowns.0, knowns.1)?)?;
            let (seed, out) = (values(seed.0, seed.1)?, values_mut(sensitivity.0, sensitivity.1)?);
            let lengths = if forward { [knowns.len(), unknowns.len()] } else { [unknowns.len(), knowns.len()] };
            if lengths != [seed.len(), out.len()] {
                return refuse(format!("{} seeds and room for {} where there are {lengths:?}", seed.len(), out.len()));
            }
            derivative(instance, &unknowns, &knowns, seed, out)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetDirectionalDerivative(
    instance: Handle,
    unknowns: *const ValueReference,
    unknown_count: usize,
    knowns: *const ValueReference,
    known_count: usize,
    seed: *const f64,
    seed_count: usize,
    sensitivity: *mut f64,
    sensitivity_count: usize,
) -> Status {
    let references = [(unknowns, unknown_count), (knowns, known_count)];
    // SAFETY: guaranteed by the host.
    unsafe { derivative(instance, references, (seed, seed_count), (sensitivity, sensitivity_count), true) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetAdjointDerivative(
    instance: Handle,
    unknowns: *const ValueReference,
    unknown_count: usize,
    knowns: *const ValueReference,
    known_count: usize,
    seed: *const f64,
    seed_count: usize,
    sensitivity: *mut f64,
    sensitivity_count: usize,
) -> Status {
    let references = [(unknowns, unknown_count), (knowns, known_count)];
    // SAFETY: guaranteed by the host.
    unsafe { derivative(instance, references, (seed, seed_count), (sensitivity, sensitivity_count), false) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetOutputDerivatives(
    instance: Handle,
    references: *const ValueReference,
    count: usize,
    orders: *const i32,
    out: *mut f64,
    out_count: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(instance, |instance| {
            instance.require_mode(&READABLE[2..])?;
            let unknowns = targets(instance, values(references, count)?)?;
            let out = values_mut(out, out_count)?;
            if let Some(order) = values(orders, count)?.iter().find(|order| **order != 1) {
                return refuse(format!("derivatives of order {order} are not available; allowed: 1"));
            }
            if out.len() != unknowns.len() {
                return refuse(format!("{} values for variables that have {}", out.len(), unknowns.len()));
            }
            instance.rates(&unknowns, out)
        })
    }
}

// States -----------------------------------------------------------------------------------------------------------

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3GetFMUState(instance: Handle, place: *mut *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| save(instance, place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SetFMUState(instance: Handle, place: *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| restore(instance, place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeFMUState(instance: Handle, place: *mut *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |_| forget(place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SerializedFMUStateSize(instance: Handle, place: *mut c_void, size: *mut usize) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| put(size, instance.serialize(state(place)?)?.len())) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3SerializeFMUState(
    instance: Handle,
    place: *mut c_void,
    bytes: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| serialize(instance, place, bytes, size)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DeserializeFMUState(
    instance: Handle,
    bytes: *const u8,
    size: usize,
    place: *mut *mut c_void,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(instance, |instance| deserialize(instance, bytes, size, place)) }
}

// Steps ------------------------------------------------------------------------------------------------------------

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3DoStep(
    instance: Handle,
    current: f64,
    h: f64,
    _no_set_state: Boolean,
    event_handling_needed: *mut Boolean,
    terminate_simulation: *mut Boolean,
    early_return: *mut Boolean,
    last_successful_time: *mut f64,
) -> Status {
    // SAFETY: guaranteed by the host; no reference to the instance exists while its callback runs.
    unsafe {
        call_raw(instance, |instance| {
            (*instance).require_mode(&[InstanceMode::Step])?;
            put(event_handling_needed, 0)?;
            put(terminate_simulation, 0)?;
            put(early_return, 0)?;
            put(last_successful_time, (*instance).time())?;
            let (update, environment) = ((*instance).intermediate_update, (*instance).environment);
            let may_return = (*instance).early_return_allowed;
            let mut look = |time: f64, last: bool| {
                let Some(update) = update else { return ControlFlow::Continue(()) };
                let (mut asked, mut wanted) = (0, time);
                let may_return = may_return && !last;
                update(environment, time, u8::from(!last), 1, 1, u8::from(may_return), &raw mut asked, &raw mut wanted);
                if may_return && asked != 0 { ControlFlow::Break(wanted.max(time)) } else { ControlFlow::Continue(()) }
            };
            let look: Option<&mut dyn FnMut(f64, bool) -> ControlFlow<f64>> =
                if update.is_some() { Some(&mut look) } else { None };
            let outcome = Instance::do_step(instance, current, h, look);
            put(last_successful_time, (*instance).time())?;
            put(early_return, u8::from(outcome?.early))
        })
    }
}

/// Defines functions of model exchange, events and scheduled execution.
macro_rules! not_here {
    ($($name:ident($($argument:ident: $type:ty),*);)*) => {
        $(#[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(instance: Handle $(, $argument: $type)*) -> Status {
            $(let _ = $argument;)*
            // SAFETY: guaranteed by the host.
            unsafe { call(instance, |_| refuse("this FMU is for co-simulation without events")) }
        })*
    };
}

not_here! {
    fmi3EnterEventMode();
    fmi3EnterStepMode();
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(
        need_update: *mut Boolean,
        terminate: *mut Boolean,
        nominals_changed: *mut Boolean,
        values_changed: *mut Boolean,
        next_event_defined: *mut Boolean,
        next_event: *mut f64
    );
    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(no_set_state: Boolean, event: *mut Boolean, terminate: *mut Boolean);
    fmi3SetTime(time: f64);
    fmi3SetContinuousStates(x: *const f64, count: usize);
    fmi3GetContinuousStateDerivatives(derivatives: *mut f64, count: usize);
    fmi3GetEventIndicators(indicators: *mut f64, count: usize);
    fmi3GetContinuousStates(x: *mut f64, count: usize);
    fmi3GetNominalsOfContinuousStates(nominals: *mut f64, count: usize);
    fmi3GetNumberOfEventIndicators(count: *mut usize);
    fmi3GetNumberOfContinuousStates(count: *mut usize);
    fmi3ActivateModelPartition(clock: ValueReference, time: f64);
}
