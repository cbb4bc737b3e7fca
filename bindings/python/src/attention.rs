//! Periodic checks during long computations: for Ctrl-C, and to report progress.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between checks. Each takes Python's lock, which may have to wait for other threads.
const INTERVAL: Duration = Duration::from_millis(50);

/// Checks every [`INTERVAL`], the first time after one interval, and stores the exception that ended the computation.
pub struct Attention {
    next: Instant,
    /// The exception raised by a check.
    pub failure: Option<PyErr>,
}

impl Attention {
    /// Starts the clock.
    pub fn new() -> Self {
        Self { next: Instant::now() + INTERVAL, failure: None }
    }

    /// If the interval has passed: breaks on the exception of a signal handler, or if `look` breaks.
    pub fn poll(&mut self, look: impl FnOnce(Python<'_>) -> PyResult<ControlFlow<()>>) -> ControlFlow<()> {
        if Instant::now() < self.next {
            return ControlFlow::Continue(());
        }
        let outcome = Python::attach(|py| py.check_signals().and_then(|()| look(py)));
        self.next = Instant::now() + INTERVAL;
        outcome.unwrap_or_else(|failure| {
            self.failure = Some(failure);
            ControlFlow::Break(())
        })
    }
}

/// The progress of a computation, as the number of finished parts, with a flag to stop it.
#[derive(Default)]
pub struct Progress {
    /// Set to stop the computation.
    pub interrupted: Arc<AtomicBool>,
    done: AtomicUsize,
    of: AtomicUsize,
}

impl Progress {
    /// The progress of a computation that stops when this flag is set; the flag is not set yet.
    pub fn ended_by(interrupted: Arc<AtomicBool>) -> Self {
        interrupted.store(false, Ordering::Relaxed);
        Self { interrupted, ..Self::default() }
    }

    /// Sets the number of finished parts and the total.
    pub fn reach(&self, done: usize, of: usize) {
        self.done.store(done, Ordering::Relaxed);
        self.of.store(of, Ordering::Relaxed);
    }

    /// Counts one more finished part.
    pub fn advance(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Reports to `callback`, if there is one.
    pub fn tell(&self, py: Python<'_>, callback: Option<&Py<PyAny>>) -> PyResult<()> {
        let numbers = (self.done.load(Ordering::Relaxed), self.of.load(Ordering::Relaxed));
        callback.map_or(Ok(()), |callback| callback.call1(py, numbers).map(|_| ()))
    }

    /// Computes in another thread, while this one, which holds Python's lock, checks for signals and reports to `callback`. An
    /// exception raised here interrupts the computation and is raised when it has ended.
    pub fn watch<T: Send>(
        &self,
        py: Python<'_>,
        callback: Option<&Py<PyAny>>,
        compute: impl FnOnce() -> T + Send,
    ) -> PyResult<T> {
        let look = |py: Python<'_>| py.check_signals().and_then(|()| self.tell(py, callback));
        let (outcome, failure) = py.detach(|| {
            std::thread::scope(|scope| {
                let waiting = std::thread::current();
                let computing = scope.spawn(move || {
                    let outcome = compute();
                    waiting.unpark();
                    outcome
                });
                let mut failure = None;
                while !computing.is_finished() {
                    std::thread::park_timeout(INTERVAL);
                    if failure.is_none()
                        && let Err(error) = Python::attach(look)
                    {
                        failure = Some(error);
                        self.interrupted.store(true, Ordering::Relaxed);
                    }
                }
                (computing.join(), failure)
            })
        });
        let outcome = outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        failure.map_or(Ok(outcome), Err)
    }
}
