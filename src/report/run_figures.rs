//! The figures of a run: those of the source study (its Figures 3–9), the energy balance, and the force and moment on a held head.

use super::chart::{Chart, Figure, Mark, Scale, Series};
use super::run_record::{Frame, RunRecord};

/// Number of earlier shapes in the background.
const EARLIER_SHAPES: usize = 8;

/// Names of all possible figures of a run.
pub const FILES: [&str; 12] = [
    "shape.svg",
    "com_path.svg",
    "com_x.svg",
    "mid_y.svg",
    "tip_y.svg",
    "head_x.svg",
    "mid_x.svg",
    "head_force.svg",
    "head_moment.svg",
    "fluid_force.svg",
    "momentum.svg",
    "energy.svg",
];

/// The figures of a run.
pub fn all(name: &str, record: &RunRecord, period: Option<f64>) -> Vec<Figure> {
    let chart =
        |title: &str, x: &str, y: &str, scale, series| Chart::new(format!("{name}: {title}"), x, y, scale, series);
    // Curves of one variable each; those of a quantity that never changes say nothing that a number does not.
    let in_time = |file: &str, title: &str, y: &str, curves: &[(&str, &str)]| {
        let series = curves.iter().map(|(label, variable)| (label, record.curve("time_s", variable)));
        let series: Vec<_> = series.map(|(label, points)| Series::new(*label, points, Mark::Line)).collect();
        let moves = |series: &Series| series.points.windows(2).any(|pair| pair[0].1 != pair[1].1);
        let caption = format!("The {title} over time.");
        let svg = || chart(title, "time (s)", y, Scale::Linear, series.clone()).svg();
        // Of several quantities that not every scene has, all or none.
        let whole = series.iter().all(|series| !series.points.is_empty());
        (whole && series.iter().any(moves)).then(|| Figure::new(file, caption, svg()))
    };
    let end = record.frames().last().map_or(0.0, |frame| frame.time);
    let shape =
        chart(&format!("shape at t = {end} s"), "x (m)", "y (m)", Scale::Equal, shapes(record.frames(), period));
    let since = if period.is_some() { "the last period" } else { "the run" };
    let path = vec![Series::new("centre of mass", record.curve("x_com_m", "y_com_m"), Mark::Line)];
    let path = chart("path of the centre of mass", "x (m)", "y (m)", Scale::Linear, path);
    let balance = "put in above, taken below zero (J)";
    let energy = chart("energy balance", "time (s)", balance, Scale::SignedLogY(6), energy_balance(record));
    [
        Some(Figure::new(
            "shape.svg",
            format!("The rod at t = {end} s with its centre of mass; in grey, shapes of {since}."),
            shape.svg(),
        )),
        Some(Figure::new(
            "com_path.svg",
            "The path of the centre of mass; the two axes have scales of their own.",
            path.svg(),
        )),
        in_time("com_x.svg", "x coordinate of the centre of mass", "x (m)", &[("centre of mass", "x_com_m")]),
        in_time("mid_y.svg", "y displacement of the middle node", "y displacement (m)", &[("middle", "mid_dy_m")]),
        in_time("tip_y.svg", "y displacement of the tip", "y displacement (m)", &[("tip", "tip_dy_m")]),
        in_time("head_x.svg", "x displacement of the head", "x displacement (m)", &[("head", "head_dx_m")]),
        in_time("mid_x.svg", "x displacement of the middle node", "x displacement (m)", &[("middle", "mid_dx_m")]),
        in_time(
            "head_force.svg",
            "force on the held head",
            "force (N)",
            &[("x", "head_force_x_n"), ("y", "head_force_y_n")],
        ),
        in_time(
            "head_moment.svg",
            "moment on the held head",
            "moment (N m)",
            &[("moment", "head_moment_n_m")],
        ),
        in_time(
            "fluid_force.svg",
            "forces of the fluid along x",
            "force along x (N)",
            &[("drag", "drag_force_x_n"), ("water it accelerates", "reactive_force_x_n"), ("wake", "wake_force_x_n")],
        ),
        in_time(
            "momentum.svg",
            "momentum of tail and water",
            "momentum (N s)",
            &[
                ("tail, x", "rod_momentum_x_n_s"),
                ("tail, y", "rod_momentum_y_n_s"),
                ("water, x", "fluid_momentum_x_n_s"),
                ("water, y", "fluid_momentum_y_n_s"),
            ],
        ),
        Some(Figure::new(
            "energy.svg",
            "The energy balance: above zero what put energy in since the start, below zero what took it or has stored it. At every time the \
             curves add up to zero; what the method itself takes, or puts in, is its numerical dissipation. The axis is logarithmic \
             towards both signs.",
            energy.svg(),
        )),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// The energy balance since the start: work that was put into the rod (J, positive), and work or energy that was dissipated or
/// stored (negative). They add up to zero. Terms that are always zero are left out.
pub fn energy_balance(record: &RunRecord) -> Vec<Series> {
    let parts = [
        ("actuation", "actuation_work_j", 1.0),
        ("loads", "load_work_j", 1.0),
        ("head", "head_work_j", 1.0),
        ("flow", "flow_work_j", 1.0),
        ("viscosity", "viscous_work_j", -1.0),
        ("wake", "wake_work_j", -1.0),
        ("spray", "spray_work_j", -1.0),
        ("bending", "bending_energy_j", -1.0),
        ("stretching", "stretching_energy_j", -1.0),
        ("motion", "kinetic_energy_j", -1.0),
        ("motion of the water", "fluid_energy_j", -1.0),
        ("numerical dissipation", "numerical_dissipation_j", -1.0),
        ("material", "material_work_j", -1.0),
        ("other forces", "other_work_j", 1.0),
    ];
    let since_start = |(label, variable, sign): (&str, &str, f64)| {
        let points = record.curve("time_s", variable);
        let first = points.first().map_or(0.0, |point| point.1);
        let points = points.into_iter().map(|(t, value)| (t, sign * (value - first))).collect();
        Series::new(label, points, Mark::Line)
    };
    let drawn = parts.map(since_start).into_iter().enumerate().map(|(k, series)| series.coloured(k));
    drawn.filter(|series| series.points.iter().any(|point| point.1 != 0.0)).collect()
}

/// The last shape with its centre of mass, over earlier ones of the last period (without a period, of the run).
fn shapes(frames: &[Frame], period: Option<f64>) -> Vec<Series> {
    let Some(last) = frames.last() else { return Vec::new() };
    let start = period.map_or(f64::NEG_INFINITY, |period| last.time - period);
    let recent = &frames[frames.partition_point(|frame| frame.time < start)..];
    let points = |frame: &Frame| frame.points.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>();
    let stride = recent.len().div_ceil(EARLIER_SHAPES).max(1);
    let ghosts = recent.iter().step_by(stride).filter(|frame| frame.time < last.time);
    let mut series: Vec<_> = ghosts.map(|frame| Series::new("", points(frame), Mark::Ghost)).collect();
    let mark = if last.points.len() <= 40 { Mark::Dotted } else { Mark::Line };
    series.push(Series::new("rod", points(last), mark));
    series.push(Series::new("centre of mass", vec![(last.com[0], last.com[1])], Mark::Dots));
    series
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use std::path::Path;

    use super::*;
    use crate::scene::Document;
    use crate::stepper::Stepper;

    #[test]
    fn the_parts_of_a_drawn_energy_balance_add_up_to_zero_and_are_those_of_the_variables() {
        for (model, least) in [("dipping-tail", 9), ("eel", 7), ("baseline", 5), ("driven-head", 5), ("glycerol", 5)] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("models/{model}.toml"));
            let mut document = Document::read(&path).unwrap();
            document.set("solver.duration_s=0.5").unwrap();
            let scene = document.scene().unwrap();
            let mut stepper = Stepper::of(&scene).unwrap();
            let mut record = RunRecord::start(&scene, &stepper);
            for _ in 0..50 {
                stepper.do_step(0.01).unwrap();
                record.pass(&mut stepper).unwrap();
            }
            let parts = energy_balance(&record);
            assert!(parts.len() >= least, "{model}: {}", parts.len());
            for k in 0..parts[0].points.len() {
                let each = parts.iter().map(|part| part.points[k].1);
                let (sum, size) = (each.clone().sum::<f64>(), each.map(f64::abs).sum::<f64>());
                assert!(sum.abs() <= 1e-9 * size, "{model}: {sum} of {size}");
            }
            let found = |label: &str| {
                parts.iter().find(|part| part.label == label).map_or(0.0, |part| part.points.last().unwrap().1)
            };
            for (label, variable) in [
                ("material", "material_work_j"),
                ("viscosity", "viscous_work_j"),
                ("wake", "wake_work_j"),
                ("spray", "spray_work_j"),
            ] {
                let taken = stepper.get_scalar(variable).unwrap_or(0.0);
                assert!((found(label) + taken).abs() <= 1e-12 * taken.abs(), "{model}: {label}");
            }
        }
    }
}
