//! The figures of a run: those of the source study (its Figures 3–9) and the energy balance.

use super::chart::{Chart, Mark, Scale, Series};
use super::record::{Frame, Record};

/// Earlier shapes drawn behind the last one.
const GHOSTS: usize = 8;

/// The figures with their file names.
pub fn all(name: &str, record: &Record, period: Option<f64>) -> Vec<(&'static str, Chart)> {
    let chart =
        |title: &str, x: &str, y: &str, scale, series| Chart::new(format!("{name}: {title}"), x, y, scale, series);
    let in_time = |title: &str, y: &str, variable: &str| {
        let series = vec![Series::new(title, record.curve("time_s", variable), Mark::Line)];
        chart(title, "time (s)", y, Scale::Linear, series)
    };
    let energies = [
        ("bending energy", "bending_energy_j"),
        ("kinetic energy", "kinetic_energy_j"),
        ("stretching energy", "stretching_energy_j"),
        ("actuation work", "actuation_work_j"),
        ("viscous work", "viscous_work_j"),
        ("load work", "load_work_j"),
        ("head work", "head_work_j"),
        ("flow work", "flow_work_j"),
        ("numerical dissipation", "numerical_dissipation_j"),
    ]
    .into_iter()
    .map(|(label, variable)| Series::new(label, record.curve("time_s", variable), Mark::Line))
    .filter(|series| series.points.iter().any(|point| point.1 != 0.0))
    .collect();
    let end = record.frames().last().map_or(0.0, |frame| frame.time);
    vec![
        (
            "shape.svg",
            chart(&format!("shape at t = {end} s"), "x (m)", "y (m)", Scale::Equal, shapes(record.frames(), period)),
        ),
        (
            "com_path.svg",
            chart(
                "path of the centre of mass",
                "x (m)",
                "y (m)",
                Scale::Linear,
                vec![Series::new("centre of mass", record.curve("x_com_m", "y_com_m"), Mark::Line)],
            ),
        ),
        ("com_x.svg", in_time("centre of mass, x", "x of the centre of mass (m)", "x_com_m")),
        ("mid_y.svg", in_time("middle node, y", "y displacement of the middle node (m)", "mid_dy_m")),
        ("tip_y.svg", in_time("tip node, y", "y displacement of the tip (m)", "tip_dy_m")),
        ("head_x.svg", in_time("head node, x", "x displacement of the head (m)", "head_dx_m")),
        ("mid_x.svg", in_time("middle node, x", "x displacement of the middle node (m)", "mid_dx_m")),
        (
            "energy.svg",
            chart("energy balance", "time (s)", "energy and work, absolute value (J)", Scale::LogY(12), energies),
        ),
    ]
}

/// The last shape with its centre of mass, over earlier ones of the last period (or of the whole run without one).
fn shapes(frames: &[Frame], period: Option<f64>) -> Vec<Series> {
    let Some(last) = frames.last() else { return Vec::new() };
    let start = period.map_or(f64::NEG_INFINITY, |period| last.time - period);
    let recent = &frames[frames.partition_point(|frame| frame.time < start)..];
    let points = |frame: &Frame| frame.points.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>();
    let stride = recent.len().div_ceil(GHOSTS).max(1);
    let ghosts = recent.iter().step_by(stride).filter(|frame| frame.time < last.time);
    let mut series: Vec<_> = ghosts.map(|frame| Series::new("", points(frame), Mark::Ghost)).collect();
    let mark = if last.points.len() <= 40 { Mark::Dotted } else { Mark::Line };
    series.push(Series::new("rod", points(last), mark));
    series.push(Series::new("centre of mass", vec![(last.com[0], last.com[1])], Mark::Dots));
    series
}
