//! Long computations look up now and then: for Ctrl-C, and to tell how far they are.

use std::ops::ControlFlow;
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

    /// Where it is time: breaks on a signal's exception, and on what `look` says.
    pub fn pay(&mut self, look: impl FnOnce(Python<'_>) -> PyResult<ControlFlow<()>>) -> ControlFlow<()> {
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
