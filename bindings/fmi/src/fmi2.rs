//! The 44 functions of FMI 2.0, with the names and arguments of the standard, in its order.
#![allow(non_snake_case, reason = "the standard's names")]
#![allow(clippy::missing_safety_doc, missing_docs, reason = "what a host must fulfil is said by the standard")]
#![allow(clippy::too_many_arguments, reason = "the standard's arguments")]

use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::path::PathBuf;

use caudal::fmu::{Standard, Target};
use percent_encoding::percent_decode_str;

use crate::instance::{Experiment, Instance, InstanceMode, Logger};
use crate::states::{STATEFUL, deserialize, forget, restore, save, serialize, state};
use crate::status::{FmiResult, Status, refuse};
use crate::{call, call_raw, free, instantiate, put, text, values, values_mut};

type Component = *mut c_void;
type ValueReference = c_uint;

/// Modes in which values can be read.
const READABLE: [InstanceMode; 4] =
    [InstanceMode::Initialization, InstanceMode::Step, InstanceMode::StepFailed, InstanceMode::Terminated];
/// Modes in which values can be set.
const SETTABLE: [InstanceMode; 3] = [InstanceMode::Instantiated, InstanceMode::Initialization, InstanceMode::Step];

type LoggerFunction = unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char, ...);

#[repr(C)]
pub struct Callbacks {
    logger: Option<LoggerFunction>,
    allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    environment: *mut c_void,
}

/// Passes messages to the host's logger.
fn logger(function: Option<LoggerFunction>, environment: *mut c_void, name: &str) -> Logger {
    let name = CString::new(name.replace('\0', "")).unwrap_or_default();
    Box::new(move |status, category, message| {
        let Some(function) = function else { return };
        let category = CString::new(category).unwrap_or_default();
        let message = CString::new(message.replace('\0', "")).unwrap_or_default();
        // SAFETY: the host's function, called as the standard requires; the message is an argument, never a format.
        unsafe { function(environment, name.as_ptr(), status, category.as_ptr(), c"%s".as_ptr(), message.as_ptr()) };
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetDebugLogging(
    c: Component,
    logging_on: c_int,
    count: usize,
    categories: *const *const c_char,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            let categories: Option<Vec<String>> = values(categories, count)?.iter().map(|name| text(*name)).collect();
            let Some(categories) = categories else { return refuse("a null pointer instead of a category") };
            instance.log_categories(
                Standard::Fmi2,
                logging_on != 0,
                &categories.iter().map(String::as_str).collect::<Vec<_>>(),
            )
        })
    }
}

/// The folder of a `file:` URI.
fn resources(uri: &str) -> std::result::Result<PathBuf, String> {
    let path = uri.strip_prefix("file:").ok_or_else(|| format!("the resource location {uri} is not a file: URI"))?;
    // file:/path, file:///path and file://localhost/path are equivalent.
    let path = path.strip_prefix("//").map_or(path, |rest| rest.find('/').map_or("", |slash| &rest[slash..]));
    let path = percent_decode_str(path).decode_utf8().map_err(|error| error.to_string())?;
    let bytes = path.as_bytes();
    let drive = bytes.len() > 2 && bytes[0] == b'/' && bytes[2] == b':'; // /C:/ on Windows
    Ok(PathBuf::from(if drive { &path[1..] } else { &path }))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    instance_name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resource_location: *const c_char,
    functions: *const Callbacks,
    _visible: c_int,
    logging_on: c_int,
) -> Component {
    if functions.is_null() {
        return std::ptr::null_mut();
    }
    // SAFETY: not null, and guaranteed by the host.
    let (functions, name, guid, location) =
        unsafe { (&*functions, text(instance_name), text(guid), text(resource_location)) };
    let name = name.unwrap_or_default();
    let log = || logger(functions.logger, functions.environment, &name);
    let make = || {
        if name.is_empty() {
            return Err("an instance must have a name".to_string());
        }
        if kind != 1 {
            return Err("this FMU is for co-simulation only".to_string());
        }
        let (Some(guid), Some(location)) = (guid, location) else {
            return Err("GUID and resource location must be given".to_string());
        };
        let mut instance = Instance::new(&resources(&location)?, &guid, log(), functions.environment)
            .map_err(|error| error.to_string())?;
        if logging_on != 0 {
            instance.log_categories(Standard::Fmi2, true, &[]).map_err(|refusal| refusal.message)?;
        }
        Ok(instance)
    };
    instantiate(make, |message| log()(Status::Error, "logStatusError", message))
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(c: Component) {
    // SAFETY: guaranteed by the host.
    unsafe { free(c) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetupExperiment(
    c: Component,
    tolerance_defined: c_int,
    tolerance: f64,
    start_time: f64,
    stop_time_defined: c_int,
    stop_time: f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&[InstanceMode::Instantiated])?;
            instance.set_tolerance((tolerance_defined != 0).then_some(tolerance))?;
            instance
                .set_experiment(Experiment { start: start_time, stop: (stop_time_defined != 0).then_some(stop_time) })
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2EnterInitializationMode(c: Component) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&[InstanceMode::Instantiated])?;
            instance.enter_initialization()
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2ExitInitializationMode(c: Component) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&[InstanceMode::Initialization])?;
            instance.exit_initialization()
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Terminate(c: Component) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.change_mode(&[InstanceMode::Step, InstanceMode::StepFailed], InstanceMode::Terminated)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Reset(c: Component) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&STATEFUL)?;
            instance.reset()
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetReal(c: Component, vr: *const ValueReference, count: usize, value: *mut f64) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&READABLE)?;
            let (references, out) = (values(vr, count)?, values_mut(value, count)?);
            instance.apply_inputs()?;
            for (reference, out) in references.iter().zip(out) {
                *out = instance.value(instance.real(*reference)?);
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetInteger(
    c: Component,
    vr: *const ValueReference,
    count: usize,
    value: *mut c_int,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&READABLE)?;
            let (references, out) = (values(vr, count)?, values_mut(value, count)?);
            for (reference, out) in references.iter().zip(out) {
                *out = instance.integer(instance.scalar(*reference)?)? as c_int;
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetReal(
    c: Component,
    vr: *const ValueReference,
    count: usize,
    value: *const f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&SETTABLE)?;
            let (references, values) = (values(vr, count)?, values(value, count)?);
            // All values are checked first, so that all or none are set.
            for (reference, value) in references.iter().zip(values) {
                instance.check(instance.real(*reference)?, std::slice::from_ref(value))?;
            }
            for (reference, value) in references.iter().zip(values) {
                instance.set(instance.real(*reference)?, std::slice::from_ref(value))?;
            }
            Ok(())
        })
    }
}

/// Defines a function for values of a type that no variable has; it only accepts empty lists.
macro_rules! no_values {
    ($($name:ident: $value:ty, $type:literal, $modes:ident;)*) => {
        $(#[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: Component, _vr: *const ValueReference, count: usize, _value: $value) -> Status {
            // SAFETY: guaranteed by the host.
            unsafe {
                call(c, |instance| {
                    instance.require_mode(&$modes)?;
                    if count == 0 { Ok(()) } else { refuse(concat!("there are no ", $type, " that could be meant")) }
                })
            }
        })*
    };
}

no_values! {
    fmi2GetBoolean: *mut c_int, "Booleans", READABLE;
    fmi2GetString: *mut *const c_char, "strings", READABLE;
    fmi2SetInteger: *const c_int, "integers", SETTABLE;
    fmi2SetBoolean: *const c_int, "Booleans", SETTABLE;
    fmi2SetString: *const *const c_char, "strings", SETTABLE;
}

// States -----------------------------------------------------------------------------------------------------------

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetFMUstate(c: Component, place: *mut *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |instance| save(instance, place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetFMUstate(c: Component, place: *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |instance| restore(instance, place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeFMUstate(c: Component, place: *mut *mut c_void) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |_| forget(place)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializedFMUstateSize(c: Component, place: *mut c_void, size: *mut usize) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |instance| put(size, instance.serialize(state(place)?)?.len())) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SerializeFMUstate(
    c: Component,
    place: *mut c_void,
    bytes: *mut u8,
    size: usize,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |instance| serialize(instance, place, bytes, size)) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DeSerializeFMUstate(
    c: Component,
    bytes: *const u8,
    size: usize,
    place: *mut *mut c_void,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |instance| deserialize(instance, bytes, size, place)) }
}

// Derivatives ------------------------------------------------------------------------------------------------------

/// Targets with their nodes.
fn targets(instance: &Instance, references: &[ValueReference]) -> FmiResult<Vec<(Target, usize)>> {
    let of = |reference: &ValueReference| match instance.real(*reference)? {
        target @ Target::Variable(_, node) => Ok((target, node)),
        target => Ok((target, 0)),
    };
    references.iter().map(of).collect()
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetDirectionalDerivative(
    c: Component,
    unknown_ref: *const ValueReference,
    unknown_count: usize,
    known_ref: *const ValueReference,
    known_count: usize,
    known: *const f64,
    unknown: *mut f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&READABLE)?;
            let unknowns = targets(instance, values(unknown_ref, unknown_count)?)?;
            let knowns = targets(instance, values(known_ref, known_count)?)?;
            let (seed, out) = (values(known, known_count)?, values_mut(unknown, unknown_count)?);
            instance.directional(&unknowns, &knowns, seed, out)
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2SetRealInputDerivatives(
    c: Component,
    vr: *const ValueReference,
    count: usize,
    order: *const c_int,
    value: *const f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&SETTABLE)?;
            let references = values(vr, count)?;
            let (orders, values) = (values(order, count)?, values(value, count)?);
            for ((reference, order), value) in references.iter().zip(orders).zip(values) {
                instance.check_derivative(instance.real(*reference)?, *order, *value)?;
            }
            for ((reference, order), value) in references.iter().zip(orders).zip(values) {
                instance.set_derivative(instance.real(*reference)?, *order, *value)?;
            }
            Ok(())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetRealOutputDerivatives(
    c: Component,
    vr: *const ValueReference,
    count: usize,
    order: *const c_int,
    value: *mut f64,
) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| {
            instance.require_mode(&READABLE)?;
            let unknowns = targets(instance, values(vr, count)?)?;
            if let Some(order) = values(order, count)?.iter().find(|order| **order != 1) {
                return refuse(format!("derivatives of order {order} are not available; allowed: 1"));
            }
            instance.rates(&unknowns, values_mut(value, count)?)
        })
    }
}

// Steps ------------------------------------------------------------------------------------------------------------

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2DoStep(c: Component, current: f64, h: f64, _no_set_state: c_int) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call_raw(c, |instance| {
            (*instance).require_mode(&[InstanceMode::Step])?;
            let outcome = Instance::do_step(instance, current, h, None);
            if outcome.as_ref().is_err_and(|refusal| refusal.status == Status::Discard) {
                (*instance).mode = InstanceMode::StepFailed;
            }
            outcome.map(|_| ())
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2CancelStep(c: Component) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe { call(c, |_| refuse("no step is under way: steps are not asynchronous")) }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetRealStatus(c: Component, kind: c_int, value: *mut f64) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |instance| match kind {
            2 => put(value, instance.time()),
            _ => refuse(format!("there is no real status of kind {kind}")),
        })
    }
}

#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2GetBooleanStatus(c: Component, kind: c_int, value: *mut c_int) -> Status {
    // SAFETY: guaranteed by the host.
    unsafe {
        call(c, |_| match kind {
            3 => put(value, 0), // the FMU never asks for the end of the simulation
            _ => refuse(format!("there is no Boolean status of kind {kind}")),
        })
    }
}

/// Defines functions of asynchronous steps.
macro_rules! never_pending {
    ($($name:ident: $value:ty;)*) => {
        $(#[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: Component, _kind: c_int, _value: $value) -> Status {
            // SAFETY: guaranteed by the host.
            unsafe { call(c, |_| refuse("no step is pending: steps are not asynchronous")) }
        })*
    };
}

never_pending! {
    fmi2GetStatus: *mut Status;
    fmi2GetIntegerStatus: *mut c_int;
    fmi2GetStringStatus: *mut *const c_char;
}

/// Defines functions of model exchange.
macro_rules! model_exchange {
    ($($name:ident($($argument:ident: $type:ty),*);)*) => {
        $(#[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: Component $(, $argument: $type)*) -> Status {
            $(let _ = $argument;)*
            // SAFETY: guaranteed by the host.
            unsafe { call(c, |_| refuse("this FMU is for co-simulation only")) }
        })*
    };
}

model_exchange! {
    fmi2EnterEventMode();
    fmi2NewDiscreteStates(info: *mut c_void);
    fmi2EnterContinuousTimeMode();
    fmi2CompletedIntegratorStep(no_set_state: c_int, event: *mut c_int, terminate: *mut c_int);
    fmi2SetTime(time: f64);
    fmi2SetContinuousStates(x: *const f64, count: usize);
    fmi2GetDerivatives(derivatives: *mut f64, count: usize);
    fmi2GetEventIndicators(indicators: *mut f64, count: usize);
    fmi2GetContinuousStates(x: *mut f64, count: usize);
    fmi2GetNominalsOfContinuousStates(x: *mut f64, count: usize);
}
