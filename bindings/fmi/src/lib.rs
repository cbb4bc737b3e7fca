//! The shared library inside an FMU: the functions of FMI 2.0 and FMI 3.0 for co-simulation, on top of one stepper.
//!
//! Both versions are thin layers: they check pointers, lengths and modes, and call the instance. Every exported function reports
//! a null pointer, an invalid call and even a panic by a status, and logs the reason.

mod fmi2;
mod fmi3;
mod instance;
mod states;
mod status;

use std::ffi::{CStr, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use instance::{Instance, InstanceMode};
use status::{FmiError, FmiResult, Status, refuse};

/// Runs `work` and turns its outcome into a status; a panic makes the instance unusable.
///
/// # Safety
/// `instance` is null or an instance that no other thread is using.
unsafe fn call(instance: *mut c_void, work: impl FnOnce(&mut Instance) -> FmiResult) -> Status {
    // SAFETY: guaranteed by the caller.
    unsafe { call_raw(instance, |instance| work(&mut *instance)) }
}

/// The same for work during which the host may call again, and which therefore must not hold a reference.
///
/// # Safety
/// As for [`call`].
unsafe fn call_raw(instance: *mut c_void, work: impl FnOnce(*mut Instance) -> FmiResult) -> Status {
    let instance = instance.cast::<Instance>();
    if instance.is_null() {
        return Status::Error;
    }
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: not null, and guaranteed by the caller.
        if unsafe { &*instance }.mode == InstanceMode::Fatal {
            return Err(FmiError { status: Status::Fatal, message: "this instance failed before".to_string() });
        }
        work(instance)
    }));
    let refusal = match outcome {
        Ok(Ok(())) => return Status::Ok,
        Ok(Err(refusal)) => refusal,
        Err(panic) => {
            // SAFETY: as above; the work has ended.
            unsafe { &mut *instance }.mark_fatal();
            let text = panic.downcast_ref::<&str>().map(|text| (*text).to_string());
            let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            FmiError { status: Status::Fatal, message: format!("internal error: {text}") }
        }
    };
    // A logger that panics must not unwind into the host either.
    let _ = catch_unwind(AssertUnwindSafe(|| {
        // SAFETY: as above.
        unsafe { &*instance }.log_message(refusal.status, &refusal.message);
    }));
    refusal.status
}

/// The `len` values at `start`, which may be null if there are none.
///
/// # Safety
/// A `start` that is not null points to `len` values that nobody changes meanwhile.
unsafe fn values<'a, T>(start: *const T, len: usize) -> FmiResult<&'a [T]> {
    match (start.is_null(), len) {
        (_, 0) => Ok(&[]),
        (false, len) if len <= isize::MAX as usize / size_of::<T>() => {
            // SAFETY: guaranteed by the caller, and the size has been checked.
            Ok(unsafe { std::slice::from_raw_parts(start, len) })
        }
        (true, _) => refuse("a null pointer instead of an array"),
        _ => refuse(format!("an array of {len} values")),
    }
}

/// The same, mutable.
///
/// # Safety
/// A `start` that is not null points to `len` values that nobody else uses meanwhile.
unsafe fn values_mut<'a, T>(start: *mut T, len: usize) -> FmiResult<&'a mut [T]> {
    // SAFETY: guaranteed by the caller.
    unsafe { values(start.cast_const(), len) }?;
    // SAFETY: the same; checked by the call above.
    Ok(if len == 0 { &mut [] } else { unsafe { std::slice::from_raw_parts_mut(start, len) } })
}

/// Writes `value` to `place`.
///
/// # Safety
/// A `place` that is not null is writable.
unsafe fn put<T>(place: *mut T, value: T) -> FmiResult {
    if place.is_null() {
        return refuse("a null pointer instead of a result");
    }
    // SAFETY: not null, and guaranteed by the caller.
    unsafe { place.write(value) };
    Ok(())
}

/// A string of the host; `None` for null.
///
/// # Safety
/// A `text` that is not null is a zero-terminated string.
unsafe fn text(text: *const c_char) -> Option<String> {
    // SAFETY: guaranteed by the caller.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

/// Creates an instance for the host; returns null and logs a message on failure.
fn instantiate(make: impl FnOnce() -> std::result::Result<Instance, String>, log: impl Fn(&str)) -> *mut c_void {
    match catch_unwind(AssertUnwindSafe(make)) {
        Ok(Ok(instance)) => Box::into_raw(Box::new(instance)).cast(),
        Ok(Err(message)) => {
            log(&message);
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// Frees an instance, unless one of its steps is in progress, which still needs it.
///
/// # Safety
/// As for [`call`]; the instance is not used afterwards.
unsafe fn free(instance: *mut c_void) {
    let instance = instance.cast::<Instance>();
    // SAFETY: guaranteed by the caller.
    if !instance.is_null() && unsafe { &*instance }.mode != InstanceMode::Intermediate {
        let _ = catch_unwind(AssertUnwindSafe(|| {
            // SAFETY: created by `Box::into_raw` in `instantiate`.
            drop(unsafe { Box::from_raw(instance) });
        }));
    }
}
