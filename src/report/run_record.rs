//! The record of a run for figures and page: curves and animation frames, downsampled so that its size is bounded.

use std::cell::OnceCell;
use std::collections::VecDeque;
use std::ops::{ControlFlow, RangeInclusive};

use super::frame::Frame;
use super::rod_motion::{DrawnRod, RodMotion};
use super::sampling::{FrameRecord, fastest_change, fastest_drive, is_too_coarse, tick};
use crate::error::Result;
use crate::integrator::StepControl;
use crate::scene::Scene;
use crate::stepper::Stepper;
use crate::variable::{Variable, View};

/// Most samples of a curve; at least half as many are kept.
pub(super) const MAX_SAMPLES: usize = 2500;
/// Frames of the animation, unless the run has fewer steps.
pub(super) const FRAMES: RangeInclusive<usize> = 600..=1200;

/// The times that are recorded.
#[derive(Debug, Clone, Copy)]
pub enum RecordingTimes {
    /// Multiples of a number of steps; the last one that was passed.
    Steps(u64, u64),
    /// Multiples of an interval (s); the next multiple.
    Every(f64, u64),
}

impl RecordingTimes {
    /// The recorded times of a scene, after the initial state. If `stepper` takes its own steps instead of the scene's, they are at
    /// the ends of the scene's steps.
    pub fn of(scene: &Scene, stepper: &Stepper) -> Self {
        let every = scene.record.every.map_or(1, |every| every.get() as u64);
        match (scene.record.interval_s, scene.step_control(), stepper.step_control()) {
            (Some(interval), ..) => Self::Every(interval.get(), 1),
            (None, StepControl::Fixed(step), StepControl::Adaptive(_)) => Self::Every(step * every as f64, 1),
            (None, ..) => Self::Steps(every, 0),
        }
    }

    /// Every step or, for adaptive steps, equidistant times at this `tick` (s).
    pub fn sampled(control: StepControl, tick: f64) -> Self {
        match control {
            StepControl::Fixed(_) => Self::Steps(1, 0),
            StepControl::Adaptive(_) => Self::Every(tick, 1),
        }
    }

    /// Calls `look` for the last step with the dense output at recorded times within it, or at its end. There may be many; `look`
    /// may stop it.
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
                let step = stepper.metrics().totals.steps;
                if std::mem::replace(last, step) == step {
                    return Ok(ControlFlow::Continue(())); // the first half of a halved step
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

/// Multiple `k` of `interval` (s), if it is not after `now` (s), up to rounding.
fn due(interval: f64, k: u64, now: f64) -> Option<f64> {
    let time = k as f64 * interval;
    match (time - now).abs() <= SAME_TIME * interval + 4.0 * f64::EPSILON * now {
        true => Some(now),
        false => (time < now).then_some(time),
    }
}

/// Times that differ by less than this fraction of the interval are equal.
const SAME_TIME: f64 = 1e-9;

/// Downsampling: every n-th item; n doubles whenever `limit` is reached, so that the length of the run need not be known.
#[derive(Debug)]
pub(super) struct Thinned<T> {
    /// What was kept, in order.
    pub(super) kept: Vec<T>,
    every: u64,
    limit: usize,
}

impl<T> Thinned<T> {
    pub(super) fn new(limit: usize) -> Self {
        Self { kept: Vec::new(), every: 1, limit }
    }

    /// Keeps item number `step`, unless it is skipped; true if it was kept.
    pub(super) fn offer(&mut self, step: u64, item: impl FnOnce() -> T) -> bool {
        if !step.is_multiple_of(self.every) {
            return false;
        }
        if self.kept.len() == self.limit {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.every *= 2;
            if !step.is_multiple_of(self.every) {
                return false;
            }
        }
        self.kept.push(item());
        true
    }
}

/// Rows of a table over time, thinned: the least and the largest value of each column in each of equal parts, in the order in which they
/// came, at the first and the last time of the part. What is faster than the parts fills a band, and never looks slower than it is.
#[derive(Debug)]
pub(super) struct Envelope {
    /// Rows of the ends of each part, with the time first.
    parts: Vec<[Vec<f64>; 2]>,
    /// Rows per part, and those of the last part.
    every: usize,
    in_last: usize,
    limit: usize,
}

impl Envelope {
    /// An envelope of at most `rows` rows, and at least half as many.
    pub(super) fn new(rows: usize) -> Self {
        Self { parts: Vec::new(), every: 2, in_last: 0, limit: (rows / 2).max(2) }
    }

    /// Takes the next row, by the value in each of so many columns.
    pub(super) fn take(&mut self, columns: usize, value: impl Fn(usize) -> f64) {
        if let Some(last) = self.parts.last_mut().filter(|_| self.in_last < self.every) {
            extend(last, value);
            self.in_last += 1;
            return;
        }
        if self.parts.len() == self.limit {
            let mut parts = std::mem::take(&mut self.parts).into_iter();
            while let Some(mut part) = parts.next() {
                if let Some([first, second]) = parts.next() {
                    extend(&mut part, |k| first[k]);
                    extend(&mut part, |k| second[k]);
                    self.in_last = 2 * self.every;
                }
                self.parts.push(part);
            }
            self.every *= 2;
        }
        let row: Vec<f64> = (0..columns).map(value).collect();
        self.parts.push([row.clone(), row]);
        self.in_last = 1;
    }

    /// The curve of column `y` over the first column.
    pub(super) fn curve(&self, y: usize) -> Vec<(f64, f64)> {
        let mut points = Vec::with_capacity(2 * self.parts.len());
        for [first, second] in &self.parts {
            points.push((first[0], first[y]));
            if second[0] > first[0] {
                points.push((second[0], second[y]));
            }
        }
        points
    }

    /// The last time of a row.
    fn end(&self) -> Option<f64> {
        self.parts.last().map(|[_, last]| last[0])
    }
}

/// Adds a row to a part.
fn extend([first, second]: &mut [Vec<f64>; 2], value: impl Fn(usize) -> f64) {
    second[0] = value(0);
    for (k, (a, b)) in first.iter_mut().zip(second.iter_mut()).enumerate().skip(1) {
        let value = value(k);
        let (low, high) = (a.min(*b), a.max(*b));
        if high.is_nan() {
            (*a, *b) = (value, value);
        } else if value > high {
            (*a, *b) = (low, value);
        } else if value < low {
            (*a, *b) = (high, value);
        }
    }
}

/// Curves and frames of a run, independent of the recorded tables.
#[derive(Debug)]
pub struct RunRecord {
    times: RecordingTimes,
    columns: Vec<&'static Variable>,
    /// What is drawn over time, and rows for curves over anything else.
    over_time: Envelope,
    samples: Thinned<Vec<f64>>,
    /// Frames for figures of the whole run, and those of the animation.
    frames: Thinned<Frame>,
    motion: FrameRecord,
    /// The samples at the frames of the animation, but for that at the end.
    at_frames: VecDeque<Vec<f64>>,
    /// Frames and samples of the last periods before the end, since those of a long run are too far apart.
    last: Vec<(Frame, Vec<f64>)>,
    last_times: Option<RecordingTimes>,
    rod: DrawnRod,
    step: u64,
}

/// What is drawn but has no column in the tables.
const DRAWN: [&str; 2] = ["vx_com_m_s", "vy_com_m_s"];

/// Samples per run, at least, for adaptive steps.
const SAMPLES_PER_RUN: f64 = 1000.0;

/// Frames per period of the drive in the last periods, and their number.
const FRAMES_PER_PERIOD: f64 = 48.0;
const LAST_PERIODS: f64 = 3.0;

impl RunRecord {
    /// Starts a record with the initial state. It samples every step or, for adaptive steps, which may be longer than the motion
    /// they contain, equidistant times.
    pub fn start(scene: &Scene, stepper: &Stepper) -> Self {
        let duration = scene.solver.duration_s.get();
        let drive = fastest_drive(scene, stepper.model());
        let tick = tick(duration, fastest_change(scene, stepper.model()), stepper.step_control(), SAMPLES_PER_RUN);
        let times = RecordingTimes::sampled(stepper.step_control(), tick);
        // The last periods before the end, if they are only a part of the run.
        let last_times = drive.and_then(|frequency| {
            let spacing = 1.0 / (FRAMES_PER_PERIOD * frequency);
            let from = duration - LAST_PERIODS / frequency;
            (from > 0.0 && from / spacing < u64::MAX as f64)
                .then(|| RecordingTimes::Every(spacing, (from / spacing).ceil() as u64))
        });
        let mut record = Self {
            last: Vec::new(),
            last_times,
            times,
            columns: stepper
                .variables()
                .iter()
                .copied()
                .filter(|variable| variable.recorded || DRAWN.contains(&variable.name))
                .collect(),
            over_time: Envelope::new(MAX_SAMPLES),
            samples: Thinned::new(MAX_SAMPLES),
            frames: Thinned::new(*FRAMES.end()),
            motion: FrameRecord::start(duration, drive, &FRAMES, tick),
            at_frames: VecDeque::new(),
            rod: DrawnRod::of(stepper.model()),
            step: 0,
        };
        record.offer(&stepper.view());
        record
    }

    /// Records the last step.
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
        let _ = outcome?;
        if let Some(mut times) = self.last_times {
            let outcome = times.pass(stepper, |view, _| {
                self.last.push((Frame::with_loads(view, self.rod.nodes()), sample(&self.columns, view)));
                Ok(ControlFlow::Continue(()))
            });
            self.last_times = Some(times);
            let _ = outcome?;
        }
        Ok(())
    }

    fn take(&mut self, view: &View<'_>) {
        self.step += 1;
        self.offer(view);
    }

    fn offer(&mut self, view: &View<'_>) {
        let value = |k: usize| self.columns[k].first(view);
        self.samples.offer(self.step, || sample(&self.columns, view));
        self.over_time.take(self.columns.len(), value);
        let made = OnceCell::new();
        let frame = || made.get_or_init(|| Frame::with_loads(view, self.rod.nodes())).clone();
        self.frames.offer(self.step, frame);
        if self.motion.offer(self.step, frame) {
            self.at_frames.push_back(sample(&self.columns, view));
            if self.at_frames.len() > self.motion.frames().len() {
                self.at_frames.pop_front();
            }
        }
    }

    /// Records the final state, unless it was recorded.
    pub fn finish(&mut self, view: &View<'_>) {
        let now = Some(view.state.t);
        if self.samples.kept.last().map(|sample| sample[0]) != now {
            self.samples.kept.push(sample(&self.columns, view));
        }
        if self.over_time.end() != now {
            self.over_time.take(self.columns.len(), |k| self.columns[k].first(view));
        }
        if self.frames.kept.last().map(|frame| frame.time) != now {
            self.frames.kept.push(Frame::with_loads(view, self.rod.nodes()));
        }
        self.motion.finish(view.state.t, || Frame::with_loads(view, self.rod.nodes()));
    }

    /// The curve of variable `y` against variable `x`; empty if the scene lacks one of them.
    pub fn curve(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        let column = |name: &str| self.columns.iter().position(|variable| variable.name == name);
        match (column(x), column(y)) {
            (Some(0), Some(y)) => self.over_time.curve(y),
            (Some(x), Some(y)) => self.samples.kept.iter().map(|sample| (sample[x], sample[y])).collect(),
            _ => Vec::new(),
        }
    }

    /// The rod that moves.
    pub fn rod(&self) -> &DrawnRod {
        &self.rod
    }

    /// The motion for the animation; complete after [`finish`](Self::finish).
    pub fn motion(&self) -> RodMotion {
        self.motion.motion(self.rod.clone())
    }

    /// Where the frames or samples from `since` (s) on are, of which those of the whole run begin at two `times` (s).
    fn source(&self, since: f64, times: [Option<f64>; 2]) -> FrameSource {
        if self.last.first().is_some_and(|(first, _)| first.time <= since) {
            return FrameSource::LastPeriods;
        }
        // A run that ended before its time has none of the last periods, but those of its animation.
        let is_coarse = self
            .motion
            .drive()
            .zip(times[0].zip(times[1]))
            .is_some_and(|(frequency, (first, second))| is_too_coarse(1.0 / (frequency * (second - first))));
        let reaches_back = self.motion.frames().front().is_some_and(|first| first.time <= since);
        if is_coarse && reaches_back { FrameSource::Animation } else { FrameSource::WholeRun }
    }

    /// The frames from `since` (s) on, closely spaced if `since` is within the last periods or the animation.
    pub fn frames_since(&self, since: f64) -> Vec<&Frame> {
        let within = |frame: &&Frame| frame.time >= since;
        match self.source(since, [0, 1].map(|i| self.frames.kept.get(i).map(|frame| frame.time))) {
            FrameSource::LastPeriods => {
                let end = self
                    .frames
                    .kept
                    .last()
                    .filter(|frame| self.last.last().is_some_and(|(last, _)| last.time < frame.time));
                self.last.iter().map(|(frame, _)| frame).chain(end).filter(within).collect()
            }
            FrameSource::Animation => self.motion.frames().iter().filter(within).collect(),
            FrameSource::WholeRun => self.frames.kept.iter().filter(within).collect(),
        }
    }

    /// The curve of variable `y` against time from `since` (s) on, with samples as close as the frames.
    pub fn curve_since(&self, since: f64, y: &str) -> Vec<(f64, f64)> {
        let Some(y) = self.columns.iter().position(|variable| variable.name == y) else { return Vec::new() };
        let within = |sample: &&Vec<f64>| sample[0] >= since;
        let point = |sample: &Vec<f64>| (sample[0], sample[y]);
        match self.source(since, [0, 1].map(|i| self.samples.kept.get(i).map(|sample| sample[0]))) {
            FrameSource::LastPeriods => self.last.iter().map(|(_, sample)| sample).filter(within).map(point).collect(),
            FrameSource::Animation => self.at_frames.iter().filter(within).map(point).collect(),
            FrameSource::WholeRun => self.samples.kept.iter().filter(within).map(point).collect(),
        }
    }

    /// Frequency (Hz) of the fastest drive that is seen, if there is one.
    pub fn drive(&self) -> Option<f64> {
        self.motion.drive()
    }

    /// The frames in order of time; never empty.
    pub fn frames(&self) -> &[Frame] {
        &self.frames.kept
    }
}

/// Where frames and samples of a part of a run come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FrameSource {
    LastPeriods,
    Animation,
    WholeRun,
}

fn sample(columns: &[&Variable], view: &View<'_>) -> Vec<f64> {
    columns.iter().map(|variable| variable.first(view)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thinned_curve_keeps_the_least_and_the_largest_value() {
        for count in [1, 2, 99, 100, 101, 5000, 12_345] {
            let mut envelope = Envelope::new(100);
            let value = |n: usize| if n == count / 3 { 7.0 } else { (n as f64 * 1.7).sin() };
            (0..count).for_each(|n| envelope.take(2, |k| if k == 0 { n as f64 } else { value(n) }));
            let curve = envelope.curve(1);
            assert!(curve.len() <= 100.min(count) && 2 * curve.len() >= 100.min(count), "{count}: {}", curve.len());
            assert_eq!([curve[0].0, curve[curve.len() - 1].0], [0.0, count as f64 - 1.0]);
            assert!(curve.windows(2).all(|pair| pair[0].0 < pair[1].0), "{count}");
            let range =
                |of: &mut dyn Iterator<Item = f64>| of.fold([f64::MAX, f64::MIN], |[a, b], x| [a.min(x), b.max(x)]);
            assert_eq!(range(&mut curve.iter().map(|point| point.1)), range(&mut (0..count).map(value)), "{count}");
            if count <= 100 {
                assert!(curve.iter().enumerate().all(|(n, point)| *point == (n as f64, value(n))), "{count}: all rows");
            }
        }
    }
}
