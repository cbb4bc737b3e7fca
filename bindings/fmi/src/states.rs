//! States of an instance behind a host's pointers, shared by both versions of the standard.

use std::ffi::c_void;

use crate::instance::{Instance, InstanceMode, SavedState};
use crate::status::{FmiResult, refuse};
use crate::{values, values_mut};

/// Modes in which states are saved and restored.
pub const STATEFUL: [InstanceMode; 6] = [
    InstanceMode::Instantiated,
    InstanceMode::Configuration,
    InstanceMode::Initialization,
    InstanceMode::Step,
    InstanceMode::StepFailed,
    InstanceMode::Terminated,
];

/// Saves the state of `instance` to `place`, as a new state if that is null.
///
/// # Safety
/// `place` is null, or points to null or to a state created here.
pub unsafe fn save(instance: &mut Instance, place: *mut *mut c_void) -> FmiResult {
    instance.require_mode(&STATEFUL)?;
    if place.is_null() {
        return refuse("a null pointer instead of a state");
    }
    let state = instance.save()?;
    // SAFETY: guaranteed by the caller.
    unsafe { keep(state, place) };
    Ok(())
}

/// Stores a state at `place`, over an existing one.
///
/// # Safety
/// `place` points to null or to a state created here.
unsafe fn keep(state: SavedState, place: *mut *mut c_void) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        if (*place).is_null() {
            *place = Box::into_raw(Box::new(state)).cast();
        } else {
            *(*place).cast::<SavedState>() = state;
        }
    }
}

/// The state at `place`.
///
/// # Safety
/// `place` is null or a state created here.
pub unsafe fn state<'a>(place: *const c_void) -> FmiResult<&'a SavedState> {
    // SAFETY: guaranteed by the caller.
    unsafe { place.cast::<SavedState>().as_ref() }.map_or_else(|| refuse("a null pointer instead of a state"), Ok)
}

/// Restores the state at `place`.
///
/// # Safety
/// `place` is null or a state created here.
pub unsafe fn restore(instance: &mut Instance, place: *const c_void) -> FmiResult {
    instance.require_mode(&STATEFUL)?;
    // SAFETY: guaranteed by the caller.
    instance.restore(unsafe { state(place) }?)
}

/// Frees the state at `place`, and sets `place` to null.
///
/// # Safety
/// `place` is null, or points to null or to a state created here.
pub unsafe fn forget(place: *mut *mut c_void) -> FmiResult {
    // SAFETY: guaranteed by the caller.
    unsafe {
        if !place.is_null() && !(*place).is_null() {
            drop(Box::from_raw((*place).cast::<SavedState>()));
            *place = std::ptr::null_mut();
        }
    }
    Ok(())
}

/// Writes a state as bytes.
///
/// # Safety
/// `place` is null or a state created here; `bytes` is null or holds `size` bytes.
pub unsafe fn serialize(instance: &Instance, place: *const c_void, bytes: *mut u8, size: usize) -> FmiResult {
    // SAFETY: guaranteed by the caller.
    let content = instance.serialize(unsafe { state(place) }?)?;
    if size < content.len() {
        return refuse(format!("{size} bytes are too few for a state of {}", content.len()));
    }
    // SAFETY: guaranteed by the caller.
    unsafe { values_mut(bytes, size) }?[..content.len()].copy_from_slice(&content);
    Ok(())
}

/// Reads a state from bytes.
///
/// # Safety
/// `bytes` is null or holds `size` bytes; `place` as for [`save`].
pub unsafe fn deserialize(instance: &Instance, bytes: *const u8, size: usize, place: *mut *mut c_void) -> FmiResult {
    if place.is_null() {
        return refuse("a null pointer instead of a state");
    }
    // SAFETY: guaranteed by the caller.
    unsafe {
        let state = instance.deserialize(values(bytes, size)?)?;
        keep(state, place);
    }
    Ok(())
}
