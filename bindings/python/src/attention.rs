//! Long computations look up now and then: for Ctrl-C, and to tell how far they are.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between looks. Python's lock is taken for each, which may have to wait for other threads.
const INTERVAL: Duration = Duration::from_millis(50);

/// Looks up every [`INTERVAL`], first after one, and remembers what made it end.
pub struct Attention {
    next: Instant,
    /// The exception of a look.
    pub failure: Option<PyErr>,
}

impl Attention {
    /// Begins now.
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

/// The progress of a computation, in finished parts of all, with a flag to stop it.
#[derive(Default)]
pub struct Progress {
    /// Raised to stop it.
    pub interrupted: Arc<AtomicBool>,
    done: AtomicUsize,
    of: AtomicUsize,
}

impl Progress {
    /// Of a computation that ends where this flag is raised; it is not yet.
    pub fn ended_by(interrupted: Arc<AtomicBool>) -> Self {
        interrupted.store(false, Ordering::Relaxed);
        Self { interrupted, ..Self::default() }
    }

    /// Says so.
    pub fn reach(&self, done: usize, of: usize) {
        self.done.store(done, Ordering::Relaxed);
        self.of.store(of, Ordering::Relaxed);
    }

    /// One more is done.
    pub fn advance(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Tells `callback`, where there is one.
    pub fn tell(&self, py: Python<'_>, callback: Option<&Py<PyAny>>) -> PyResult<()> {
        let numbers = (self.done.load(Ordering::Relaxed), self.of.load(Ordering::Relaxed));
        callback.map_or(Ok(()), |callback| callback.call1(py, numbers).map(|_| ()))
    }

    /// Computes in another thread, while this one, which belongs to Python, looks up for its signals and tells `callback`.
    /// What fails there interrupts the computation and is raised when it has ended.
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
