//! Locks of data shared by several Python threads.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::Python;
use pyo3::sync::MutexExt;

/// Takes a lock in a thread that holds Python's lock. Python's lock is released while waiting, because the owner of `mutex` may
/// need it to release the mutex.
pub fn lock<'a, T>(py: Python<'_>, mutex: &'a Mutex<T>) -> MutexGuard<'a, T> {
    mutex.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}

/// Takes a lock in a thread that does not hold Python's lock, as inside [`Python::detach`].
pub fn lock_detached<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
