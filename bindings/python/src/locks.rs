//! Locks of what several of Python's threads use.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::Python;
use pyo3::sync::MutexExt;

/// Takes a lock in a thread that belongs to Python. It waits without the interpreter's own lock: whoever has this one may
/// need that to give it back.
pub fn lock<'a, T>(py: Python<'_>, mutex: &'a Mutex<T>) -> MutexGuard<'a, T> {
    mutex.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

/// Takes a lock in a thread that does not belong to Python, as inside [`Python::detach`].
pub fn lock_detached<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
