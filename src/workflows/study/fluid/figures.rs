//! Figures: error against cost, forces by source, and an animation of all models.

use super::explanations::{FluidModelRow, FluidReport};
use super::model_run::{ForceBreakdown, PHASES};
use crate::number_format::percent;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::{Animation, Findings, Medium, RodMotion};

/// Width of a lane of the animation over the widest motion, and its minimum over the length.
const LANE_WIDTH: f64 = 1.15;
const MIN_LANE_WIDTH: f64 = 0.2;

fn has_moved(row: &FluidModelRow<'_>) -> bool {
    row.swim.motion.as_ref().is_some_and(|motion| motion.frames.len() > 1)
}

/// The models in the order of the animation: the reference first, models without motion last.
fn in_order<'a, 'b>(rows: &'a [FluidModelRow<'b>]) -> Vec<&'a FluidModelRow<'b>> {
    let mut order: Vec<_> = rows.iter().collect();
    order.sort_by_key(|row| (!has_moved(row), !row.is_reference));
    order
}

impl FluidReport<'_> {
    pub(super) fn charts(&self, rows: &[FluidModelRow<'_>], findings: &mut Findings) {
        let Some(reference) = rows.iter().find(|row| row.is_reference) else { return };
        // In the order of the animation.
        let order: Vec<String> = in_order(rows).iter().map(|row| row.model.to_string()).collect();
        let colour = |name: &str| match order.iter().position(|other| other == name) {
            None | Some(0) => 0,
            Some(i) => Animation::series_of_companion(i - 1),
        };
        let dot = |name: String, at: (f64, f64)| {
            let colour = colour(&name);
            Series::new(name, vec![at], Mark::Dots).coloured(colour)
        };
        let uncertain = reference.model.uncertainty.map(|uncertainty| uncertainty.measured(self.held));
        for (i, what) in [self.motion(), "power"].into_iter().enumerate() {
            let shown = rows.iter().filter_map(|row| {
                let error = row.differences?[i].abs();
                (!row.is_reference && error > 0.0).then(|| (row.model.to_string(), row.swim.run.processor_s, error))
            });
            let mut series: Vec<Series> = shown.map(|(name, cost, error)| dot(name, (cost, error))).collect();
            if series.is_empty() {
                continue;
            }
            if let Some(level) = uncertain.map(|both| both[i]) {
                let costs = || rows.iter().map(|row| row.swim.run.processor_s).filter(|cost| *cost > 0.0);
                let (low, high) = (0.7 * costs().fold(f64::INFINITY, f64::min), 1.4 * costs().fold(0.0, f64::max));
                series.push(dot(reference.model.to_string(), (reference.swim.run.processor_s, level)));
                let name = format!("published uncertainty ±{}", percent(level));
                let points = vec![(low, level), (high, level), (high, level)];
                series.push(Series::new(name, points, Mark::Level));
            }
            let chart = Chart::new(
                format!("{}: {what} under every law", self.scene.name),
                "processor time (s)",
                format!("relative difference of the {what}"),
                Scale::LogLog,
                series,
            );
            let caption = format!(
                "Difference of the {what} from {} against the processor time of the run, one dot per law; {} itself is shown at its published uncertainty. Dots below the line differ by less than that.",
                reference.model, reference.model
            );
            findings.figures.extend(chart.figure(format!("{what}-time.svg"), caption));
        }
        let own = rows.iter().find(|row| row.model.own && !row.is_reference && !row.swim.parts.is_empty());
        for (row, file) in [(Some(reference), "reference"), (own, "own")] {
            let Some(row) = row else { continue };
            self.forces(row, file, findings);
        }
    }

    /// Forces of a model by their source.
    fn forces(&self, row: &FluidModelRow<'_>, file: &str, findings: &mut Findings) {
        let whose = if row.model.own { format!("{}, the scene's own", row.model) } else { row.model.to_string() };
        let mut figure = |name: &str,
                          title: &str,
                          x: &str,
                          y: &str,
                          caption: &str,
                          of: &dyn Fn(&ForceBreakdown) -> Vec<(f64, f64)>| {
            let mut series: Vec<Series> =
                row.swim.parts.iter().map(|part| Series::new(part.name.clone(), of(part), Mark::Line)).collect();
            series.retain(|series| series.points.iter().any(|point| point.1 != 0.0));
            if series.is_empty() {
                return;
            }
            let chart = Chart::new(format!("{title}: {whose}"), x, y, Scale::Linear, series);
            findings.figures.extend(chart.figure(format!("{name}-{file}.svg"), format!("{caption} ({whose}).")));
        };
        let at = |values: &[f64]| -> Vec<(f64, f64)> {
            let last = values.len().saturating_sub(1).max(1) as f64;
            values.iter().enumerate().map(|(k, y)| (k as f64 / last, *y)).collect()
        };
        figure(
            "along-body",
            "Force along the path",
            "position along the rod, from head to tip",
            "mean forward force per length (N/m)",
            "Where each force drives or brakes the rod: mean over a period. A force on the tip alone is distributed over its half cell",
            &|part| at(&part.along),
        );
        figure(
            "across-body",
            "Force across the path",
            "position along the rod, from head to tip",
            "rms force per length (N/m)",
            "Each force across the direction of the head: root mean square over a period",
            &|part| at(&part.across),
        );
        figure(
            "over-cycle",
            "Force over a period",
            "phase of the period",
            "forward force on the rod (N)",
            "When each force drives the whole rod forward, over the last period",
            &|part| part.cycle.iter().enumerate().map(|(i, y)| ((i as f64 + 0.5) / PHASES as f64, *y)).collect(),
        );
    }

    /// An animation of all completed runs, each on its own lane; in layers of fluids or a sheared flow, which a lane would leave, all
    /// are at their own places.
    pub(super) fn motions(rows: &[FluidModelRow<'_>]) -> Option<Box<(Animation, String)>> {
        let mut swam = in_order(rows);
        swam.retain(|row| has_moved(row));
        let mut motions: Vec<RodMotion> = swam.iter().filter_map(|row| row.swim.motion.clone()).collect();
        let count = motions.iter().map(|motion| motion.frames.len()).min()?;
        let height = |motion: &RodMotion| {
            let ys = || motion.frames.iter().flat_map(|frame| &frame.points).map(|point| point[1]);
            ys().fold(f64::NEG_INFINITY, f64::max) - ys().fold(f64::INFINITY, f64::min)
        };
        let first = &motions.first()?.frames[0];
        let length: f64 = first.points.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum();
        let in_lanes = first.medium.as_ref().is_some_and(Medium::is_uniform);
        let lane = match in_lanes {
            true => motions.iter().map(height).fold(MIN_LANE_WIDTH * length, f64::max) * LANE_WIDTH,
            false => 0.0,
        };
        // In lanes they start at the same place, also where they are shown from a later time on.
        let start = first.com;
        for (i, motion) in motions.iter_mut().enumerate() {
            motion.frames.truncate(count);
            let own = motion.frames[0].com;
            let by = if in_lanes { [start[0] - own[0], start[1] - own[1] - i as f64 * lane] } else { [0.0; 2] };
            for frame in &mut motion.frames {
                for place in frame.points.iter_mut().chain([&mut frame.com]) {
                    *place = [place[0] + by[0], place[1] + by[1]];
                }
            }
        }
        let names: Vec<String> = swam.iter().map(|row| row.model.to_string()).collect();
        let animation = Animation::of_named(if in_lanes { "" } else { &names[0] }, 0, &motions[0]);
        let others = motions.iter().zip(&names).skip(1).enumerate();
        let animation = others.fold(animation, |animation, (i, (motion, name))| {
            animation.with_companion(name, Animation::series_of_companion(i), motion)
        });
        let places = if in_lanes { "one lane each, from above" } else { "all at their own places in the medium" };
        let start = match motions[0].is_of_last_periods {
            false => "All start at the same place.",
            true if in_lanes => "All are moved to the same place at the first time that is shown.",
            true => "All started at the same place.",
        };
        let shown = format!("The same rod under every law, {places}: {}. {start}", names.join(", "));
        Some(Box::new((animation, shown)))
    }
}
