//! What figures and the page need of a run, thinned so that its size does not grow with the run's.

use serde::{Deserialize, Serialize};

use crate::stepper::Stepper;
use crate::variable::Variable;

/// Between half of this and this many times are kept for a curve.
const SAMPLES: usize = 2500;
/// The same for frames of the animation.
const FRAMES: usize = 1200;
/// At most about this many nodes of a frame are kept.
const POINTS: usize = 120;

/// The rod at a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Time, s.
    pub time: f64,
    /// Some of its nodes, head and tip among them, m.
    pub points: Vec<[f64; 2]>,
    /// Centre of mass, m.
    pub com: [f64; 2],
}

impl Frame {
    /// The rod now.
    pub fn of(stepper: &Stepper) -> Self {
        let nodes = stepper.model().rod.nodes;
        let points = POINTS.min(nodes);
        let point = |i: usize| {
            let k = i * (nodes - 1) / (points - 1);
            [stepper.state().q[2 * k], stepper.state().q[2 * k + 1]]
        };
        Self { time: stepper.time(), points: (0..points).map(point).collect(), com: stepper.meter().now.com.into() }
    }
}

/// Every n-th of what comes; n doubles when `limit` is reached, so the run's length need not be known.
#[derive(Debug)]
struct Thinned<T> {
    kept: Vec<T>,
    every: u64,
    limit: usize,
}

impl<T> Thinned<T> {
    fn new(limit: usize) -> Self {
        Self { kept: Vec::with_capacity(limit), every: 1, limit }
    }

    fn offer(&mut self, step: u64, item: impl FnOnce() -> T) {
        if !step.is_multiple_of(self.every) {
            return;
        }
        if self.kept.len() == self.limit {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.every *= 2;
            if !step.is_multiple_of(self.every) {
                return;
            }
        }
        self.kept.push(item());
    }
}

/// Curves and frames of a run.
#[derive(Debug)]
pub struct Record {
    columns: Vec<&'static Variable>,
    samples: Thinned<Vec<f64>>,
    frames: Thinned<Frame>,
    step: u64,
}

impl Record {
    /// A record that begins with the state at the start of a run.
    pub fn start(stepper: &Stepper) -> Self {
        let mut record = Self {
            columns: stepper.variables().iter().copied().filter(|variable| variable.recorded).collect(),
            samples: Thinned::new(SAMPLES),
            frames: Thinned::new(FRAMES),
            step: 0,
        };
        record.samples.offer(0, || sample(&record.columns, stepper));
        record.frames.offer(0, || Frame::of(stepper));
        record
    }

    /// Sees the state after a step.
    pub fn step(&mut self, stepper: &Stepper) {
        self.step += 1;
        self.samples.offer(self.step, || sample(&self.columns, stepper));
        self.frames.offer(self.step, || Frame::of(stepper));
    }

    /// Sees the state at the end, unless it is there already.
    pub fn finish(&mut self, stepper: &Stepper) {
        let now = Some(stepper.time());
        if self.samples.kept.last().map(|sample| sample[0]) != now {
            self.samples.kept.push(sample(&self.columns, stepper));
        }
        if self.frames.kept.last().map(|frame| frame.time) != now {
            self.frames.kept.push(Frame::of(stepper));
        }
    }

    /// The curve of variable `y` against variable `x`; empty where the scene has not both.
    pub fn curve(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        let column = |name: &str| self.columns.iter().position(|variable| variable.name == name);
        match (column(x), column(y)) {
            (Some(x), Some(y)) => self.samples.kept.iter().map(|sample| (sample[x], sample[y])).collect(),
            _ => Vec::new(),
        }
    }

    /// The frames in order of time; never empty.
    pub fn frames(&self) -> &[Frame] {
        &self.frames.kept
    }
}

fn sample(columns: &[&Variable], stepper: &Stepper) -> Vec<f64> {
    let view = stepper.view();
    columns.iter().map(|variable| variable.first(&view)).collect()
}
