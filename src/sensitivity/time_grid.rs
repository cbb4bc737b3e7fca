//! The time grid of a simulation: equal steps, and a shorter last one if the duration is not a multiple of the step.

/// The times of a simulation.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeGrid {
    /// Number of full steps.
    pub(super) whole: usize,
    /// Size of a full step, s.
    pub(super) length: f64,
    /// Size of a shorter last step, s.
    pub(super) last: Option<f64>,
}

impl TimeGrid {
    /// Number of steps.
    pub(super) fn count(&self) -> usize {
        self.whole + usize::from(self.last.is_some())
    }

    /// Time `n`, s.
    pub(super) fn time(&self, n: usize) -> f64 {
        if n <= self.whole { n as f64 * self.length } else { self.whole as f64 * self.length + self.length(n) }
    }

    /// The size of the step that ends at time `n`, or zero if there is none.
    pub(super) fn length(&self, n: usize) -> f64 {
        match n {
            0 => 0.0,
            n if n <= self.whole => self.length,
            n if n <= self.count() => self.last.unwrap_or(0.0),
            _ => 0.0,
        }
    }
}
