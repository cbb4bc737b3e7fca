//! What figures and the page need of a run, thinned so that its size does not grow with the run's.

use crate::stepper::Stepper;
use crate::variable::Variable;

/// About this many times are kept for a curve.
const SAMPLES: u64 = 2000;
/// Fewest and most frames of the animation, and how many a second of the run between them.
const FRAMES: [f64; 2] = [200.0, 900.0];
const FRAMES_PER_SECOND: f64 = 30.0;
/// At most about this many nodes of a frame are kept.
const POINTS: usize = 120;

/// The rod at a time.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Time, s.
    pub time: f64,
    /// Some of its nodes, head and tip among them, m.
    pub points: Vec<[f64; 2]>,
    /// Centre of mass, m.
    pub com: [f64; 2],
}

/// Curves and frames of a run.
#[derive(Debug)]
pub struct Record {
    columns: Vec<&'static Variable>,
    samples: Vec<Vec<f64>>,
    frames: Vec<Frame>,
    every: [u64; 2],
    step: u64,
}

impl Record {
    /// A record for a run of `steps` steps over `duration` (s), with the state at its start.
    pub fn start(stepper: &Stepper, steps: u64, duration: f64) -> Self {
        let frames = (FRAMES_PER_SECOND * duration).clamp(FRAMES[0], FRAMES[1]) as u64;
        let mut record = Self {
            columns: stepper.variables().iter().copied().filter(|variable| variable.recorded).collect(),
            samples: Vec::new(),
            frames: Vec::new(),
            every: [SAMPLES, frames].map(|wanted| (steps / wanted).max(1)),
            step: 0,
        };
        record.keep(stepper, [true, true]);
        record
    }

    /// Sees the state after a step.
    pub fn step(&mut self, stepper: &Stepper) {
        self.step += 1;
        self.keep(stepper, self.every.map(|every| self.step.is_multiple_of(every)));
    }

    /// Sees the state at the end, unless it is there already.
    pub fn finish(&mut self, stepper: &Stepper) {
        let now = Some(stepper.time());
        let samples_end = self.samples.last().map(|sample| sample[0]);
        let frames_end = self.frames.last().map(|frame| frame.time);
        self.keep(stepper, [samples_end != now, frames_end != now]);
    }

    fn keep(&mut self, stepper: &Stepper, [sample, frame]: [bool; 2]) {
        if sample {
            let view = stepper.view();
            self.samples.push(self.columns.iter().map(|variable| variable.first(&view)).collect());
        }
        if frame {
            let nodes = stepper.model().rod.nodes;
            let points = POINTS.min(nodes);
            let point = |i: usize| {
                let k = i * (nodes - 1) / (points - 1);
                [stepper.state().q[2 * k], stepper.state().q[2 * k + 1]]
            };
            self.frames.push(Frame {
                time: stepper.time(),
                points: (0..points).map(point).collect(),
                com: stepper.meter().now.com.into(),
            });
        }
    }

    /// The curve of variable `y` against variable `x`; empty where the scene has not both.
    pub fn curve(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        let column = |name: &str| self.columns.iter().position(|variable| variable.name == name);
        match (column(x), column(y)) {
            (Some(x), Some(y)) => self.samples.iter().map(|sample| (sample[x], sample[y])).collect(),
            _ => Vec::new(),
        }
    }

    /// The frames in order of time; never empty.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }
}
