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
use crate::spectrum::{Spectrum, SpectrumPurpose};

/// Pictures per period of the fastest drive that are wanted.
pub const PER_PERIOD: f64 = 24.0;

/// The fewest pictures per period that show the motion as it is.
pub const LEAST_PER_PERIOD: f64 = 12.0;

/// The spectrum of the drive is computed on at most this many nodes.
const MAX_NODES_FOR_SPECTRUM: usize = 201;

/// A drive is seen if it moves the rod by at least this part of its length, in the root mean square over nodes and time: 1 px of a rod
/// of 1000 px, and some 2.5 px at the end of one that turns about the other.
const SEEN: f64 = 1e-3;

/// Frequency (Hz) of the fastest drive of a scene with this `model` that is seen; `None` if nothing drives the rod periodically until the
/// end. After a transient, such as a jump or a burst, the last periods are a rest, so all of its run is shown.
pub fn fastest_drive(scene: &Scene, model: &Model) -> Option<f64> {
    spectrum(scene, model).fastest_steady_of_amplitude(SEEN * model.rod.length)
}

/// The same along with transients, whose curves are to be recorded, too.
pub fn fastest_change(scene: &Scene, model: &Model) -> Option<f64> {
    spectrum(scene, model).fastest_of_amplitude(SEEN * model.rod.length)
}

fn spectrum(scene: &Scene, model: &Model) -> Spectrum {
    let purpose = SpectrumPurpose::Pictures { until: scene.solver.duration_s.get() };
    // The phases of a fine mesh would take too many whole states, so the scene's spectrum is computed on a coarse rod.
    let is_fine = model.rod.nodes > MAX_NODES_FOR_SPECTRUM;
    if is_fine { scene.spectrum_for(purpose) } else { Spectrum::of_model_for(purpose, model) }
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

/// What a page says of the pictures of a run: that they are of its last periods alone, or that its steps are too long for them.
pub fn pictures_in_words(motion: &RodMotion) -> Option<String> {
    let times = motion.frames.iter().map(|frame| frame.time);
    let window = [times.clone().next()?, times.clone().next_back()?];
    let of_last_periods = motion.is_of_last_periods.then(|| last_periods_in_words(window, "the whole run"));
    let longest = times.clone().zip(times.skip(1)).map(|(from, to)| to - from).fold(0.0, f64::max);
    // Only steps are longer than what is aimed at.
    let rate = motion.drive.map(|frequency| 1.0 / (frequency * longest)).filter(|rate| is_too_coarse(*rate));
    let too_coarse = rate.map(|rate| {
        format!(
            "With {} steps per period of the fastest drive, fewer than {LEAST_PER_PERIOD}, the beat may look slower than it is, or go \
             backwards; a smaller solver.time_step_s shows it as it is.",
            in_sentence(rate, 2)
        )
    });
    let sentences: Vec<String> = of_last_periods.into_iter().chain(too_coarse).collect();
    (!sentences.is_empty()).then(|| sentences.join(" "))
}

/// True if so many pictures per period of the fastest drive may show another motion.
pub fn is_too_coarse(rate: f64) -> bool {
    rate < LEAST_PER_PERIOD * (1.0 - TICK_TOLERANCE)
}

/// The rows of a table with these equidistant `times` (s) that are shown as so many `pictures`, and whether they are of the last periods
/// alone.
pub fn shown_rows(times: &[f64], drive: Option<f64>, pictures: &RangeInclusive<usize>) -> (Vec<usize>, bool) {
    let [Some(first), Some(end)] = [times.first(), times.last()] else { return (Vec::new(), false) };
    let last_row = times.len() - 1;
    let (sampling, every) = Sampling::on_ticks(end - first, drive, pictures, (end - first) / last_row.max(1) as f64);
    let since = sampling.last.map_or(*first, |last| end - last * (1.0 + TICK_TOLERANCE));
    let from = times.partition_point(|time| *time < since);
    let every = usize::try_from(every).unwrap_or(usize::MAX);
    ((from..last_row).step_by(every).chain([last_row]).collect(), from > 0)
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
    drive: Option<f64>,
    last: Option<f64>,
    is_of_last_periods: bool,
}

impl FrameRecord {
    /// Starts a record of a number of `pictures` of a run of this `duration` (s), to which a frame is offered per `tick` (s).
    pub fn start(duration: f64, drive: Option<f64>, pictures: &RangeInclusive<usize>, tick: f64) -> Self {
        let (Sampling { last, .. }, every) = Sampling::on_ticks(duration, drive, pictures, tick);
        let most = (*pictures.end()).max(1);
        Self { frames: VecDeque::new(), most, every, drive, last, is_of_last_periods: false }
    }

    /// Keeps the frame of tick number `tick`, unless it is skipped; true if it was kept.
    pub fn offer(&mut self, tick: u64, frame: impl FnOnce() -> Frame) -> bool {
        if !tick.is_multiple_of(self.every) {
            return false;
        }
        if self.last.is_some() && self.frames.len() == self.most {
            self.frames.pop_front();
            self.is_of_last_periods = true;
        }
        self.frames.push_back(frame());
        true
    }

    /// The frames that are kept, in order of time.
    pub fn frames(&self) -> &VecDeque<Frame> {
        &self.frames
    }

    /// Frequency (Hz) of the fastest drive, if there is one.
    pub fn drive(&self) -> Option<f64> {
        self.drive
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
        RodMotion { rod, frames: frames.range(left_out..).cloned().collect(), drive: self.drive, is_of_last_periods }
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
    fn the_rows_of_a_table_that_are_shown_have_twelve_per_period_and_reach_its_end() {
        for (rows, tick, frequency, of_last) in [
            (1, 0.1, 1.0, false),
            (200, 0.01, 1.0, false),
            (6001, 0.02, 1.0, true),
            (60_001, 2e-3, 0.1, false),
            (9000, 0.1, 1.0, true),
        ] {
            let times: Vec<f64> = (0..rows).map(|n| tick * f64::from(n)).collect();
            let (shown, is_of_last_periods) = shown_rows(&times, Some(frequency), &(300..=600));
            let case = format!("{rows} rows of {tick} s at {frequency} Hz: {} shown", shown.len());
            assert!(shown.len() <= 601 && shown.last() == Some(&(times.len() - 1)), "{case}");
            assert_eq!((is_of_last_periods, shown[0] > 0), (of_last, of_last), "{case}");
            let longest = shown.windows(2).map(|pair| times[pair[1]] - times[pair[0]]).fold(0.0, f64::max);
            // Rows are not shown more often than they are there.
            let wanted = (1.0 / (LEAST_PER_PERIOD * frequency)).max(tick);
            assert!(longest <= wanted * (1.0 + 1e-9), "{case}, {longest} s apart");
        }
        assert_eq!(shown_rows(&[], None, &(300..=600)), (Vec::new(), false));
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
