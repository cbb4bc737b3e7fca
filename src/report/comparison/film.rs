//! The film of a comparison: all rods at the same times, over the time that all of them have in common.

use super::super::frame::Frame;
use super::super::page::Animation;
use super::super::recorded_run::{RecordedRun, positions_at};
use super::super::rod_motion::RodMotion;
use super::super::run_record::MAX_FRAMES;
use crate::error::Result;

/// Recorded times (s) with positions of nodes (m).
type Motion = Vec<(f64, Vec<[f64; 2]>)>;

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
    let motions: Vec<Motion> = shown.iter().map(|i| runs[*i].motion(window)).collect::<Result<_>>()?;
    // A table that was truncated by a full disk ends earlier than its run.
    let last =
        motions.iter().map(|motion| motion.last().map_or(f64::NEG_INFINITY, |row| row.0)).fold(window[1], f64::min);
    window[1] = last;
    if window[1] <= window[0] {
        return Ok(None);
    }
    // As many frames as the most finely recorded run has, within the common time.
    let within = |motion: &Motion| motion.iter().filter(|(time, _)| (window[0]..=window[1]).contains(time)).count();
    let finest = motions.iter().map(within).max().unwrap_or(0);
    let frames = finest.clamp(2, 2 * MAX_FRAMES / shown.len());
    let time = |k: usize| window[0] + (window[1] - window[0]) * k as f64 / (frames - 1) as f64;
    let frames_of = |run: &RecordedRun, motion: &Motion| -> Vec<Frame> {
        let frame = |time: f64| {
            let points = positions_at(motion, time);
            let mean = |axis: usize| points.iter().map(|point| point[axis]).sum::<f64>() / points.len().max(1) as f64;
            let com = ["x_com_m", "y_com_m"].map(|name| run.curves.at(time, name));
            let com = [com[0].unwrap_or_else(|| mean(0)), com[1].unwrap_or_else(|| mean(1))];
            // The media of the runs may differ.
            Frame { time, points, com, medium: None, loads: None }
        };
        (0..frames).map(time).map(frame).collect()
    };
    let motion = |(i, motion): (&usize, &Motion)| {
        Ok((*i, RodMotion { rod: runs[*i].rod()?, frames: frames_of(&runs[*i], motion) }))
    };
    let rods: Vec<(usize, RodMotion)> = shown.iter().zip(&motions).map(motion).collect::<Result<_>>()?;
    let size = |motion: &RodMotion| motion.frames.first().map_or(0.0, |frame| length(&frame.points));
    let largest = rods.iter().map(|(_, motion)| size(motion)).fold(0.0, f64::max);
    let specks = rods.iter().filter(|(_, motion)| size(motion) < SPECK * largest).map(|(i, _)| labels[*i].clone());
    let specks = specks.collect();
    let Some(((i, first), others)) = rods.split_first() else { return Ok(None) };
    let one = Animation::of_named(&labels[*i], colours[*i], first);
    let animation = others.iter().fold(one, |film, (i, motion)| film.with_companion(&labels[*i], colours[*i], motion));
    Ok(Some(Film { animation, shown, window, specks }))
}

/// The length of the line through points, m.
fn length(points: &[[f64; 2]]) -> f64 {
    points.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
}
