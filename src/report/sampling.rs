//! How densely pictures sample a motion. A motion that is sampled too rarely seems to be another one, slower or backwards, so all that plays
//! a motion takes its times from here: the player of a page, films, the frames of a sweep and the film of a comparison.

use std::collections::VecDeque;
use std::ops::RangeInclusive;

use super::frame::Frame;
use super::rod_motion::{DrawnRod, RodMotion};
use crate::integrator::StepControl;
use crate::model::Model;
use crate::number_format::in_sentence;
use crate::scene::Scene;
use crate::spectrum::Spectrum;

/// Pictures per period of the fastest drive that are wanted.
pub const PER_PERIOD: f64 = 24.0;

/// The fewest pictures per period that show the motion as it is.
pub const LEAST_PER_PERIOD: f64 = 12.0;

/// The spectrum of the drive is computed on at most this many nodes.
const MAX_NODES_FOR_SPECTRUM: usize = 201;

/// Frequency (Hz) of the fastest drive of a scene with this `model`; `None` if nothing drives the rod periodically.
pub fn fastest_drive(scene: &Scene, model: &Model) -> Option<f64> {
    // The phases of a fine mesh would take too many whole states, so the scene's spectrum is computed on a coarse rod.
    let is_fine = model.rod.nodes > MAX_NODES_FOR_SPECTRUM;
    if is_fine { scene.spectrum() } else { Spectrum::of_model(model) }.fastest()
}

/// The times at which a motion is sampled, as multiples of a spacing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Time between two pictures, s.
    pub spacing: f64,
    /// Length of what is shown before the end of the motion, whole periods, s; `None` for all of it.
    pub last: Option<f64>,
}

impl Sampling {
    /// Times for a number of `pictures` of a motion of `span` (s) with this fastest drive (Hz): of all of it if that gives enough per
    /// period, otherwise of its last whole periods.
    pub fn of(span: f64, drive: Option<f64>, pictures: &RangeInclusive<usize>) -> Self {
        let [least, most] = [*pictures.start(), *pictures.end()].map(|count| count.max(2) as f64 - 1.0);
        let periods = drive.map_or(0.0, |frequency| frequency * span);
        match drive.filter(|_| LEAST_PER_PERIOD * periods > most) {
            None => Self { spacing: span / (PER_PERIOD * periods).clamp(least, most), last: None },
            Some(frequency) => {
                let count = (most / PER_PERIOD).floor().max(1.0);
                let rate = (most / count).clamp(LEAST_PER_PERIOD, PER_PERIOD);
                Self { spacing: 1.0 / (rate * frequency), last: Some(count.min(periods) / frequency) }
            }
        }
    }

    /// The same with a picture every so many ticks of a clock (s), so that there are at most as many as intended.
    fn on_ticks(span: f64, drive: Option<f64>, pictures: &RangeInclusive<usize>, tick: f64) -> (Self, u64) {
        let ticks = |sampling: &Self| (sampling.spacing / tick - TICK_TOLERANCE).ceil().max(1.0);
        let sampling = Self::of(span, drive, pictures);
        let is_dense = |every: f64| drive.is_none_or(|frequency| LEAST_PER_PERIOD * frequency * every * tick <= 1.0);
        let every = ticks(&sampling);
        if sampling.last.is_some() || every <= 1.0 || is_dense(every) {
            return (sampling, every as u64);
        }
        let recent = Self::of(f64::INFINITY, drive, pictures);
        (recent, ticks(&recent) as u64)
    }
}

/// Relative rounding of a number of ticks.
const TICK_TOLERANCE: f64 = 1e-6;

/// What a page says of a motion that is shown from time `from` to `until` (s) alone.
pub fn last_periods_in_words([from, until]: [f64; 2], what: &str) -> String {
    let digits = digits_of([from, until]);
    let [from, until] = [from, until].map(|time| in_sentence(time, digits));
    format!(
        "Shown are the last periods, from t = {from} s to {until} s: pictures of {what} would be fewer than {LEAST_PER_PERIOD} per period \
         of the fastest drive, and the beat would look slower than it is."
    )
}

/// What a page says of the last periods of a run.
pub fn whole_run_in_words(frames: &[Frame]) -> Option<String> {
    Some(last_periods_in_words([frames.first()?.time, frames.last()?.time], "the whole run"))
}

/// Digits that tell two times apart, with two more, at least four.
pub fn digits_of([from, until]: [f64; 2]) -> usize {
    let ratio = until.abs().max(from.abs()) / (until - from).abs();
    if ratio.is_finite() { (ratio.max(1.0).log10().ceil() as usize + 2).clamp(4, 12) } else { 4 }
}

/// The time between two steps, or between the samples of adaptive steps, which may be longer than the motion that they contain.
pub fn tick(duration: f64, drive: Option<f64>, steps: StepControl, least: f64) -> f64 {
    match steps {
        StepControl::Fixed(step) => step,
        StepControl::Adaptive(_) => {
            duration / drive.map_or(least, |frequency| least.max(PER_PERIOD * frequency * duration)).ceil()
        }
    }
}

/// The frames of a run for its animation: evenly over the run, or those of its last periods, whenever it ends.
#[derive(Debug)]
pub struct FrameRecord {
    frames: VecDeque<Frame>,
    most: usize,
    every: u64,
    last: Option<f64>,
    is_of_last_periods: bool,
}

impl FrameRecord {
    /// Starts a record of a number of `pictures` of a run of this `duration` (s), to which a frame is offered per `tick` (s).
    pub fn start(duration: f64, drive: Option<f64>, pictures: &RangeInclusive<usize>, tick: f64) -> Self {
        let (Sampling { last, .. }, every) = Sampling::on_ticks(duration, drive, pictures, tick);
        let most = (*pictures.end()).max(1);
        Self { frames: VecDeque::new(), most, every, last, is_of_last_periods: false }
    }

    /// Keeps the frame of tick number `tick`, unless it is skipped.
    pub fn offer(&mut self, tick: u64, frame: impl FnOnce() -> Frame) {
        if !tick.is_multiple_of(self.every) {
            return;
        }
        if self.last.is_some() && self.frames.len() == self.most {
            self.frames.pop_front();
            self.is_of_last_periods = true;
        }
        self.frames.push_back(frame());
    }

    /// Adds the final frame at time `end` (s), unless it is there.
    pub fn finish(&mut self, end: f64, frame: impl FnOnce() -> Frame) {
        if self.frames.back().is_none_or(|last| last.time != end) {
            self.frames.push_back(frame());
        }
    }

    /// The motion of this rod, without what is before the last periods.
    pub fn motion(&self, rod: DrawnRod) -> RodMotion {
        let frames = &self.frames;
        let left_out = self.last.zip(frames.back()).map_or(0, |(last, end)| {
            let since = end.time - last * (1.0 + TICK_TOLERANCE);
            frames.partition_point(|frame| frame.time < since).max(frames.len().saturating_sub(self.most))
        });
        let is_of_last_periods = self.is_of_last_periods || left_out > 0;
        RodMotion { rod, frames: frames.range(left_out..).cloned().collect(), is_of_last_periods }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_has_at_least_twelve_pictures_per_period_of_its_drive() {
        for span in [0.1, 1.0, 20.0, 1e3, 1e5] {
            for frequency in [0.1, 1.0, 7.0, 240.0] {
                for pictures in [60..=60, 600..=1200] {
                    for part in [0.003, 0.01, 0.03, 0.07] {
                        let tick = part / frequency;
                        let (sampling, every) = Sampling::on_ticks(span, Some(frequency), &pictures, tick);
                        let rate = 1.0 / (frequency * every as f64 * tick);
                        let length = sampling.last.unwrap_or(span);
                        let case = format!("{span} s at {frequency} Hz, {pictures:?}, {part}: {rate} over {length} s");
                        assert!(rate >= LEAST_PER_PERIOD * (1.0 - 1e-6), "{case}");
                        assert!(length <= span * (1.0 + 1e-9), "{case}");
                        assert!(rate * frequency * length <= *pictures.end() as f64, "{case}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_motion_without_a_drive_is_sampled_as_a_whole() {
        assert_eq!(Sampling::of(1e6, None, &(600..=1200)), Sampling { spacing: 1e6 / 599.0, last: None });
    }

    #[test]
    fn times_have_the_digits_that_tell_them_apart() {
        for (times, digits) in [([0.0, 8.0], 4), ([7.0, 7.333], 4), ([1999.5, 2000.0], 6), ([1.0, 1.0], 4)] {
            assert_eq!(digits_of(times), digits, "{times:?}");
        }
    }
}
