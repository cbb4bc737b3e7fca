//! What figures and the page need of a run, thinned so that its size does not grow with the run's.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::fluid::{Fluid, Layers};
use crate::integrator::StepControl;
use crate::rod::{Rod, node};
use crate::scene::Scene;
use crate::spectrum::Spectrum;
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
            (None, StepControl::Fixed(step), StepControl::Adaptive(_)) => Self::Every(step * every as f64, 1),
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
                while let Some(time) = due(*interval, *next, stepper.time()) {
                    let flow = stepper.at(time, |view| look(view, true))??;
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

/// Multiple `k` of `interval` (s), where it is not after `now` (s), which it is where both differ by rounding alone.
fn due(interval: f64, k: u64, now: f64) -> Option<f64> {
    let time = k as f64 * interval;
    match (time - now).abs() <= SAME * interval + 4.0 * f64::EPSILON * now {
        true => Some(now),
        false => (time < now).then_some(time),
    }
}

/// Times that differ by less than this part of the interval between them are one.
const SAME: f64 = 1e-9;

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

/// Curves and frames of a run, at times of their own: what is recorded in tables does not thin them.
#[derive(Debug)]
pub struct Record {
    times: Times,
    columns: Vec<&'static Variable>,
    samples: Thinned<Vec<f64>>,
    frames: Thinned<Frame>,
    step: u64,
}

/// Samples in a period of what drives the tail, and in a run, where steps are chosen by their error; at most [`SAMPLES`] in all.
const A_PERIOD: f64 = 24.0;
const A_RUN: f64 = 1000.0;

impl Record {
    /// A record that begins with the state at the start of a run: of every step, or, where steps are chosen by their error and may be
    /// longer than what happens in them, of equal times.
    pub fn start(scene: &Scene, stepper: &Stepper) -> Self {
        let duration = scene.solver.duration_s.get();
        let drive = Spectrum::of_model(stepper.model()).fastest();
        let wanted = drive.map_or(A_RUN, |frequency| A_RUN.max(A_PERIOD * frequency * duration));
        let times = match stepper.pace() {
            StepControl::Fixed(_) => Times::Steps(1, 0),
            StepControl::Adaptive(_) => Times::Every(duration / wanted.min(SAMPLES as f64 - 1.0).ceil(), 1),
        };
        let mut record = Self {
            times,
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

    /// Sees the step that was just made.
    ///
    /// # Errors
    /// Those of [`Stepper::at`].
    pub fn pass(&mut self, stepper: &mut Stepper) -> Result<()> {
        let mut times = self.times;
        let outcome = times.pass(stepper, |view, _| {
            self.take(view);
            Ok(ControlFlow::Continue(()))
        });
        self.times = times;
        outcome.map(|_| ())
    }

    fn take(&mut self, view: &View<'_>) {
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
