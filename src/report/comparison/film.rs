//! The film of a comparison: all rods at the same times, over the time that all of them have in common.

use super::super::frame::{Frame, Medium};
use super::super::page::Animation;
use super::super::recorded_run::{RecordedMotion, RecordedRun};
use super::super::rod_motion::RodMotion;
use super::super::run_record::FRAMES;
use super::super::sampling::{LEAST_PER_PERIOD, Sampling, is_too_coarse, last_periods_in_words};
use crate::error::Result;
use crate::model::Model;
use crate::number_format::in_sentence;

/// Rods smaller than the largest by this factor are dots.
const SPECK: f64 = 1e-2;

/// A film of several rods.
#[derive(Debug)]
pub struct Film {
    /// The rods.
    pub animation: Animation,
    /// The places of the runs that it shows.
    pub shown: Vec<usize>,
    /// First and last time that it shows, s.
    pub window: [f64; 2],
    /// The names of the rods that are too small, compared with the others, to be seen.
    pub specks: Vec<String>,
}

/// The film of the `runs` that have recorded positions, with these labels and colours; `None` without a time in common, or if fewer than two have any.
pub fn film(runs: &[RecordedRun], labels: &[String], colours: &[usize]) -> Result<Option<Film>> {
    let shown: Vec<usize> = (0..runs.len()).filter(|i| runs[*i].has_motion()).collect();
    let mut window = [f64::NEG_INFINITY, f64::INFINITY];
    for run in shown.iter().map(|i| &runs[*i]) {
        let Some(start) = run.motion_start()? else { return Ok(None) };
        window = [window[0].max(start), window[1].min(run.number("end_time_s").unwrap_or(f64::INFINITY))];
    }
    if shown.len() < 2 || window[1] <= window[0] {
        return Ok(None);
    }
    // Of several drives the fastest decides.
    let drives: Vec<Option<f64>> = shown.iter().map(|i| runs[*i].fastest_drive()).collect();
    let drive = drives.iter().flatten().copied().reduce(f64::max);
    let most = (2 * FRAMES.end() / shown.len()).min(*FRAMES.end());
    let common = window;
    let (mut sampling, mut motions);
    // A table that was truncated by a full disk ends earlier than its run: then the film ends there.
    loop {
        sampling = Sampling::of(window[1] - common[0], drive, &(most / 2..=most));
        window[0] = sampling.last.map_or(common[0], |last| window[1] - last);
        motions = shown.iter().map(|i| runs[*i].motion(window)).collect::<Result<Vec<_>>>()?;
        let end = motions.iter().map(|motion| motion.end().unwrap_or(f64::NEG_INFINITY)).fold(window[1], f64::min);
        if end <= common[0] {
            return Ok(None);
        }
        if end >= window[1] {
            break;
        }
        window[1] = end;
    }
    // No more frames than the most finely recorded run has rows.
    let span = window[1] - window[0];
    let finest = motions.iter().filter_map(|motion| motion.spacing).fold(f64::INFINITY, f64::min);
    let frames = 1 + ((span / sampling.spacing.max(finest)).round() as usize).clamp(1, most - 1);
    let time = |k: usize| window[0] + span * k as f64 / (frames - 1) as f64;
    let of_last_periods =
        sampling.last.map(|_| last_periods_in_words(window, "the whole time that the runs have in common"));
    let lacks = |((i, motion), drive): ((&usize, &RecordedMotion), &Option<f64>)| {
        let Some(spacing) = motion.spacing else { return Some(format!("{} has fewer than two rows", labels[*i])) };
        let rate = drive.map(|frequency| 1.0 / (spacing * frequency)).filter(|rate| is_too_coarse(*rate))?;
        Some(format!("{} has {} rows per period of the fastest drive", labels[*i], in_sentence(rate, 2)))
    };
    let lacking: Vec<String> = shown.iter().zip(&motions).zip(&drives).filter_map(lacks).collect();
    let too_coarse = (!lacking.is_empty()).then(|| {
        format!(
            "The tables of nodes are too coarse for a film: {}, and {LEAST_PER_PERIOD} per period are wanted. What is between the rows \
             is not known; a smaller record.every or record.interval_s records it.",
            lacking.join(", ")
        )
    });
    let note = of_last_periods.into_iter().chain(too_coarse).collect::<Vec<_>>().join(" ");
    let models: Option<Vec<&Model>> = shown.iter().map(|i| runs[*i].model()).collect();
    // The medium that all of them are in.
    let medium = |time: f64| -> Option<Medium> {
        let mut media = models.iter().flatten().map(|model| Medium::at(model, time));
        let first = media.next()?;
        media.all(|other| other == first).then_some(first)
    };
    let frames_of = |run: &RecordedRun, motion: &RecordedMotion| -> Vec<Frame> {
        let frame = |time: f64| {
            let points = motion.at(time);
            let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / points.len().max(1) as f64;
            let com = run.curves.centre_of_mass(time).unwrap_or_else(|| [mean(0), mean(1)]);
            Frame { time, points, com, medium: medium(time), loads: None }
        };
        (0..frames).map(time).map(frame).collect()
    };
    let motion = |(i, motion): (&usize, &RecordedMotion)| {
        let (rod, frames) = (runs[*i].rod()?, frames_of(&runs[*i], motion));
        Ok((*i, RodMotion { drive, ..RodMotion::whole(rod, frames) }))
    };
    let rods: Vec<(usize, RodMotion)> = shown.iter().zip(&motions).map(motion).collect::<Result<_>>()?;
    let size = |motion: &RodMotion| motion.frames.first().map_or(0.0, |frame| length(&frame.points));
    let largest = rods.iter().map(|(_, motion)| size(motion)).fold(0.0, f64::max);
    let specks = rods.iter().filter(|(_, motion)| size(motion) < SPECK * largest).map(|(i, _)| labels[*i].clone());
    let specks = specks.collect();
    let Some(((i, first), others)) = rods.split_first() else { return Ok(None) };
    let one = Animation::of_named(&labels[*i], colours[*i], first).with_note((!note.is_empty()).then_some(note));
    let animation = others.iter().fold(one, |film, (i, motion)| film.with_companion(&labels[*i], colours[*i], motion));
    Ok(Some(Film { animation, shown, window, specks }))
}

/// The length of the line through points, m.
fn length(points: &[[f64; 2]]) -> f64 {
    points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
}
