//! What figures and the page need of a run, thinned so that its size does not grow with the run's.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::fluid::{Fluid, Layers};
use crate::integrator::Pace;
use crate::rod::{Rod, node};
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::variable::{Variable, View};

/// Between half of this and this many times are kept for a curve.
const SAMPLES: usize = 2500;
/// The same for frames of the animation.
const FRAMES: usize = 1200;

/// Which times are recorded.
#[derive(Debug, Clone, Copy)]
pub enum Times {
    /// Every so many steps; the last one that was passed.
    Steps(u64, u64),
    /// The multiples of so many seconds; the next multiple.
    Every(f64, u64),
}

impl Times {
    /// Those that a scene asks for, after the first state. Where `stepper` takes steps of its own instead of the scene's,
    /// they are where the scene's would have ended.
    pub fn of(scene: &Scene, stepper: &Stepper) -> Self {
        let every = scene.record.every.map_or(1, |every| every.get() as u64);
        match (scene.record.interval_s, scene.pace(), stepper.pace()) {
            (Some(interval), ..) => Self::Every(interval.get(), 1),
            (None, Pace::Fixed(step), Pace::Adaptive(_)) => Self::Every(step * every as f64, 1),
            (None, ..) => Self::Steps(every, 0),
        }
    }

    /// Shows what the step just made has passed, and whether it is recorded: its end, or the multiples within it, which may
    /// be many, so that `look` may end it.
    ///
    /// # Errors
    /// Those of `look` and of [`Stepper::at`].
    pub fn pass(
        &mut self,
        stepper: &mut Stepper,
        mut look: impl FnMut(&View<'_>, bool) -> Result<ControlFlow<()>>,
    ) -> Result<ControlFlow<()>> {
        match self {
            Self::Steps(every, last) => {
                let step = stepper.meter().totals.steps;
                if std::mem::replace(last, step) == step {
                    return Ok(ControlFlow::Continue(())); // half a step
                }
                look(&stepper.view(), step.is_multiple_of(*every))
            }
            Self::Every(interval, next) => {
                while *next as f64 * *interval <= stepper.time() {
                    let flow = stepper.at(*next as f64 * *interval, |view| look(view, true))??;
                    *next += 1;
                    if flow.is_break() {
                        return Ok(flow);
                    }
                }
                Ok(ControlFlow::Continue(()))
            }
        }
    }
}

/// The rod at a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Time, s.
    pub time: f64,
    /// Some of its nodes, head and tip among them, m.
    pub points: Vec<[f64; 2]>,
    /// Centre of mass, m.
    pub com: [f64; 2],
    /// Semi-axes (m) and angle (rad) of the body around the first node, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<[f64; 3]>,
    /// The medium, where it has layers.
    #[serde(default)]
    pub medium: Option<(Fluid, Layers)>,
}

impl Frame {
    /// At most about this many nodes of it are kept.
    pub const POINTS: usize = 120;

    /// Semi-axes (m) and angle (rad) of the body before `rod`, whose nodes are at `q`.
    pub fn body(rod: &Rod, q: &[f64]) -> Option<[f64; 3]> {
        let body = rod.body?;
        let along = node(q, 1) - node(q, 0);
        Some([body.along, body.across, along.y.atan2(along.x)])
    }

    /// The rod now.
    pub fn of(view: &View<'_>) -> Self {
        let nodes = view.state.q.len() / 2;
        let points = Self::POINTS.min(nodes);
        let point = |i: usize| {
            let k = i * (nodes - 1) / (points - 1);
            [view.state.q[2 * k], view.state.q[2 * k + 1]]
        };
        let inputs = &view.dynamics.inputs;
        Self {
            time: view.state.t,
            points: (0..points).map(point).collect(),
            com: view.meter.now.com.into(),
            body: Self::body(&view.dynamics.model.rod, &view.state.q),
            medium: inputs.layers.filter(|layers| layers.iter().len() > 0).map(|layers| (inputs.fluid, layers)),
        }
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
        let view = stepper.view();
        record.samples.offer(0, || sample(&record.columns, &view));
        record.frames.offer(0, || Frame::of(&view));
        record
    }

    /// Sees the next state.
    pub fn step(&mut self, view: &View<'_>) {
        self.step += 1;
        self.samples.offer(self.step, || sample(&self.columns, view));
        self.frames.offer(self.step, || Frame::of(view));
    }

    /// Sees the state at the end, unless it is there already.
    pub fn finish(&mut self, view: &View<'_>) {
        let now = Some(view.state.t);
        if self.samples.kept.last().map(|sample| sample[0]) != now {
            self.samples.kept.push(sample(&self.columns, view));
        }
        if self.frames.kept.last().map(|frame| frame.time) != now {
            self.frames.kept.push(Frame::of(view));
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

fn sample(columns: &[&Variable], view: &View<'_>) -> Vec<f64> {
    columns.iter().map(|variable| variable.first(view)).collect()
}
