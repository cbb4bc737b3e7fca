//! The figures of a run: its shapes and paths, speed, power and energy balance, and the force and moment on a held head.

use std::fmt::Write;

use nalgebra::Vector2;

use super::chart::{Chart, Figure, Mark, Scale, Series};
use super::frame::{Frame, Medium};
use super::heat_map::{HeatMapAxis, Raster};
use super::run_record::RunRecord;
use super::sampling::{LEAST_PER_PERIOD, is_too_coarse, last_periods_in_words};
use crate::number_format::in_sentence;

/// Number of earlier shapes in the background.
const EARLIER_SHAPES: usize = 8;

/// A cycle is drawn if it was recorded at least at this many times.
const LEAST_SAMPLES: usize = 8;

/// Names of all possible figures of a run.
pub const FILES: [&str; 19] = [
    "shape.svg",
    "com_path.svg",
    "speed.svg",
    "envelope.svg",
    "curvature.svg",
    "amplitude.svg",
    "phase.svg",
    "power_along.svg",
    "mid_y.svg",
    "tip_y.svg",
    "head_force.svg",
    "head_moment.svg",
    "hinge_angle.svg",
    "hinge_torque.svg",
    "tendons.svg",
    "fluid_force.svg",
    "momentum.svg",
    "power.svg",
    "energy.svg",
];

/// The figures of a run.
pub fn all(name: &str, record: &RunRecord, period: Option<f64>) -> Vec<Figure> {
    let chart =
        |title: &str, x: &str, y: &str, scale, series| Chart::new(format!("{name}: {title}"), x, y, scale, series);
    // Curves of one variable each; constant quantities are left out, since a number is enough.
    let in_time = |file: &str, title: &str, y: &str, curves: &[(&str, &str)], signs: &str| {
        let series = curves.iter().map(|(label, variable)| (label, record.curve("time_s", variable)));
        let series: Vec<_> = series.map(|(label, points)| Series::new(*label, points, Mark::Line)).collect();
        let moves = |series: &Series| series.points.windows(2).any(|pair| pair[0].1 != pair[1].1);
        let caption = format!("The {title} over time{signs}.");
        let figure = || Figure::of_chart(file, &caption, &chart(title, "time (s)", y, Scale::Linear, series.clone()));
        // Quantities that not every scene has: all of a group or none.
        let whole = series.iter().all(|series| !series.points.is_empty());
        (whole && series.iter().any(moves)).then(figure)
    };
    let tensions = [
        ("tendon 1", "tendon_1_tension_n"),
        ("tendon 2", "tendon_2_tension_n"),
        ("tendon 3", "tendon_3_tension_n"),
        ("tendon 4", "tendon_4_tension_n"),
    ];
    let tensions: Vec<_> =
        tensions.into_iter().filter(|(_, variable)| !record.curve("time_s", variable).is_empty()).collect();
    let along = |file: &str, title: &str, y: &str, points: Option<Vec<(f64, f64)>>, caption: &str| {
        let series = Series::new("", points?, Mark::Line);
        chart(title, ARC_LENGTH, y, Scale::Linear, vec![series]).figure(file, caption)
    };
    let end = record.frames().last().map_or(0.0, |frame| frame.time);
    let at_end = in_sentence(end, 7);
    let path = vec![Series::new("centre of mass", record.curve("x_com_m", "y_com_m"), Mark::Line)];
    let path = chart("path of the centre of mass", "x (m)", "y (m)", Scale::Linear, path);
    let balance = "supplied above zero, dissipated below (J)";
    let cycle = period.is_some_and(|period| record.frames().first().is_some_and(|frame| end - period >= frame.time));
    let since_time = period.filter(|_| cycle).map_or(f64::NEG_INFINITY, |period| end - period);
    let powers = powers(record, since_time);
    let since = if cycle { "the last period" } else { "the run" };
    let shape = shapes(record.frames(), since_time);
    let shape = chart(&format!("shape at t = {at_end} s"), "x (m)", "y (m)", Scale::Equal, shape);
    let envelope = if cycle { envelope(record, since_time) } else { Vec::new() };
    let energy = chart("energy balance", "time (s)", balance, Scale::SignedLogY(6), energy_balance(record));
    [
        Some(Figure::new(
            "shape.svg",
            format!("The rod at t = {at_end} s with its centre of mass; in grey, shapes of {since}.{}", interfaces_in_words(record)),
            shape.svg(),
        )),
        Some(Figure::of_chart(
            "com_path.svg",
            "The path of the centre of mass; the two axes have scales of their own.",
            &path,
        )),
        in_time(
            "speed.svg",
            "velocity of the centre of mass",
            "velocity (m/s)",
            &[("x", "vx_com_m_s"), ("y", "vy_com_m_s")],
            ", relative to the ground",
        ),
        (!envelope.is_empty()).then(|| {
            let caption = "The shapes of the last period as seen from the centre of mass, with x along the mean direction from head to \
                           tip; blue: how far each node goes to both sides.";
            let (x, y) = ("along the body (m)", "across (m)");
            let svg = chart("envelope of the last period", x, y, Scale::Equal, envelope).svg();
            Figure::new("envelope.svg", caption, svg)
        }),
        kymograph(name, record, since_time),
        along(
            "amplitude.svg",
            "amplitude along the body",
            "half the excursion across (m)",
            amplitude(record, since_time).filter(|_| cycle),
            "How far each place of the body goes across in the last period, half from side to side: of a free swimmer as seen from its \
             centre of mass.",
        ),
        along(
            "phase.svg",
            "phase along the body",
            "phase of the curvature (rad)",
            period.filter(|_| cycle).and_then(|period| phase(record, period)),
            "By how much the curvature lags behind that nearest to the head, from its first harmonic over the last period: a straight \
             rising line is a wave that travels towards the tip, and a level one a standing wave.",
        ),
        along(
            "power_along.svg",
            "power along the body",
            "mean power per length (W/m)",
            power_along(record, period.filter(|_| cycle)),
            &format!("What the actuation puts in along the body, as a mean over {since}: negative where it takes power."),
        ),
        in_time("mid_y.svg", "y displacement of the middle node", "y displacement (m)", &[("middle", "mid_dy_m")], ""),
        in_time("tip_y.svg", "y displacement of the tip", "y displacement (m)", &[("tip", "tip_dy_m")], ""),
        in_time(
            "head_force.svg",
            "force on the held head",
            "force (N)",
            &[("x", "head_force_x_n"), ("y", "head_force_y_n")],
            ": what the tail exerts on it, along x and y",
        ),
        in_time(
            "head_moment.svg",
            "moment on the held head",
            "moment (N m)",
            &[("moment", "head_moment_n_m")],
            ": what the tail exerts on it about node 0, positive counter-clockwise",
        ),
        in_time(
            "hinge_angle.svg",
            "angle of the hinged head",
            "angle (rad)",
            &[("angle", "hinge_angle_rad")],
            ", from +x, positive counter-clockwise",
        ),
        in_time(
            "hinge_torque.svg",
            "torque of the motor of the hinge",
            "torque (N m)",
            &[("torque", "hinge_torque_n_m")],
            ", positive counter-clockwise",
        ),
        in_time("tendons.svg", "tension of the tendons", "tension (N)", &tensions, ""),
        in_time(
            "fluid_force.svg",
            "forces of the fluid along x",
            "force along x (N)",
            &[("drag", "drag_force_x_n"), ("water it accelerates", "reactive_force_x_n"), ("wake", "wake_force_x_n")],
            ": what it exerts on the tail",
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
            "",
        ),
        (!powers.is_empty()).then(|| {
            let caption = format!("Power over {since}: above zero what puts energy in, below zero what takes it, in the colours of the balance.");
            let power = chart(&format!("power over {since}"), "time (s)", "supplied above zero, dissipated below (W)", Scale::Linear, powers);
            Figure::of_chart("power.svg", caption, &power)
        }),
        Some(Figure::of_chart(
            "energy.svg",
            "The energy balance: above zero what put energy in since the start, below zero what took it or has stored it. At every time the \
             curves add up to zero; what the method itself takes, or puts in, is its numerical dissipation. The axis is logarithmic \
             towards both signs.",
            &energy,
        )),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// A part of the energy balance: its label, the work or energy (J), its power (W) if it has one, and its sign: 1 for what puts energy
/// into the rod, −1 for what dissipates or stores it.
type BalancePart = (&'static str, &'static str, Option<&'static str>, f64);

/// The parts of the energy balance, in the order of their colours.
const PARTS: [BalancePart; 14] = [
    ("actuation", "actuation_work_j", Some("actuation_power_w"), 1.0),
    ("loads", "load_work_j", Some("load_power_w"), 1.0),
    ("head", "head_work_j", Some("head_power_w"), 1.0),
    ("flow", "flow_work_j", Some("flow_power_w"), 1.0),
    ("viscosity", "viscous_work_j", Some("viscous_power_w"), -1.0),
    ("wake", "wake_work_j", Some("wake_power_w"), -1.0),
    ("spray", "spray_work_j", Some("spray_power_w"), -1.0),
    ("bending", "bending_energy_j", None, -1.0),
    ("stretching", "stretching_energy_j", None, -1.0),
    ("motion", "kinetic_energy_j", None, -1.0),
    ("motion of the water", "fluid_energy_j", None, -1.0),
    ("numerical dissipation", "numerical_dissipation_j", None, -1.0),
    ("material", "material_work_j", Some("material_power_w"), -1.0),
    ("other forces", "other_work_j", Some("other_power_w"), 1.0),
];

/// The powers of the balance's parts from time `since` (s) on, with their signs and colours; none if they were hardly recorded.
/// Powers that are always zero are left out.
fn powers(record: &RunRecord, since: f64) -> Vec<Series> {
    let part = |(k, (label, _, power, sign)): (usize, BalancePart)| {
        let points = record.curve_since(since, power?).into_iter();
        let points: Vec<_> = points.map(|(t, power)| (t, sign * power)).collect();
        let shown = points.len() >= LEAST_SAMPLES && points.iter().any(|(_, power)| *power != 0.0);
        shown.then(|| Series::new(label, points, Mark::Line).coloured(k))
    };
    PARTS.into_iter().enumerate().filter_map(part).collect()
}

/// The shapes from time `since` (s) on with x along the mean direction from head to tip: of a free rod about its centre of mass, of a
/// held one about where its head is first. `None` if they were hardly recorded.
fn seen_along(record: &RunRecord, since: f64) -> Option<Vec<Vec<(f64, f64)>>> {
    let cycle = record.frames_since(since);
    let along = |frame: &&Frame| Some(Vector2::from(*frame.points.last()?) - Vector2::from(*frame.points.first()?));
    let axis: Vector2<f64> = cycle.iter().filter_map(along).sum();
    if cycle.len() < LEAST_SAMPLES || axis.norm() == 0.0 {
        return None;
    }
    let axis = axis.normalize();
    let first = *cycle.first()?.points.first()?;
    let seen = |frame: &&Frame| -> Vec<(f64, f64)> {
        let centre = if is_held(record) { first } else { frame.com };
        let from = |point: &[f64; 2]| Vector2::from(*point) - Vector2::from(centre);
        frame.points.iter().map(from).map(|from| (from.dot(&axis), axis.perp(&from))).collect()
    };
    Some(cycle.iter().map(seen).collect())
}

/// True for a held head.
fn is_held(record: &RunRecord) -> bool {
    !record.curve("time_s", "head_force_x_n").is_empty()
}

/// The shapes of a free rod from time `since` (s) on, and how far each node goes to both sides; none for a held head, which [`shapes`]
/// shows.
fn envelope(record: &RunRecord, since: f64) -> Vec<Series> {
    let Some(shapes) = seen_along(record, since).filter(|_| !is_held(record)) else { return Vec::new() };
    let nodes = 0..shapes.first().map_or(0, Vec::len);
    let side = |furthest: fn(f64, f64) -> f64, start: f64| {
        let of_node = |i: usize| {
            let mean = shapes.iter().map(|shape| shape[i].0).sum::<f64>() / shapes.len() as f64;
            (mean, shapes.iter().map(|shape| shape[i].1).fold(start, furthest))
        };
        nodes.clone().map(of_node).collect::<Vec<_>>()
    };
    let limits = [side(f64::max, f64::NEG_INFINITY), side(f64::min, f64::INFINITY)];
    let stride = shapes.len().div_ceil(2 * EARLIER_SHAPES).max(1);
    let ghosts = shapes.iter().step_by(stride).map(|shape| Series::new("", shape.clone(), Mark::Ghost));
    let limits = limits.clone().map(|points| Series::new("", points, Mark::Line).coloured(0));
    ghosts.chain(limits).collect()
}

/// The axis along the body.
const ARC_LENGTH: &str = "arc length from the head (m)";

/// Most periods of a kymograph, and most places and times of it.
const KYMOGRAPH_PERIODS: f64 = 2.0;
const MAX_KYMOGRAPH_CELLS: [usize; 2] = [40, 96];

/// A rod whose turning angles are below this, rad, is straight up to rounding.
const STRAIGHT: f64 = 1e-9;

/// The curvature over arc length and time, in the last two periods before the end, or in the whole run if the period is unknown. If
/// that had too few times per period of the fastest drive, it is of the last periods of this drive.
fn kymograph(name: &str, record: &RunRecord, since: f64) -> Option<Figure> {
    let frames = record.frames();
    let end = frames.last()?.time;
    let mut from = frames[0].time.max(end - KYMOGRAPH_PERIODS * (end - since));
    // One time less, since both ends of the window are drawn.
    let most = (MAX_KYMOGRAPH_CELLS[1] - 1) as f64 / LEAST_PER_PERIOD;
    let fast = record.drive().filter(|frequency| (end - from) * frequency > most);
    if let Some(frequency) = fast {
        from = end - most.floor() / frequency;
    }
    let recent = record.frames_since(from);
    let arcs = &record.rod().arc_lengths;
    let inner = 1..arcs.len().saturating_sub(1);
    if recent.len() < LEAST_SAMPLES || inner.len() < 2 {
        return None;
    }
    let [places, times] = [(inner.len(), 0), (recent.len(), 1)].map(|(count, i)| count.min(MAX_KYMOGRAPH_CELLS[i]));
    let of = |count: usize, chosen: usize| {
        (0..chosen).map(move |i| i * (count - 1) / (chosen - 1).max(1)).collect::<Vec<_>>()
    };
    let (places, times) = (of(inner.len(), places), of(recent.len(), times));
    let curvatures: Vec<Vec<f64>> = times.iter().map(|t| curvatures(&recent[*t].points)).collect();
    // A rod of constant shape, or straight up to rounding, has no figure.
    let largest = curvatures.iter().flatten().fold(0.0, |most: f64, kappa| most.max(kappa.abs()));
    if largest * arcs[arcs.len() - 1] < STRAIGHT || curvatures.iter().all(|row| *row == curvatures[0]) {
        return None;
    }
    let cells = |t: usize| {
        let row = &curvatures[t];
        places.iter().enumerate().map(move |(p, place)| (t, p, row[inner.start + place])).collect::<Vec<_>>()
    };
    let map = Raster {
        title: format!("{name}: curvature over arc length and time"),
        x: HeatMapAxis {
            name: "time (s)".to_string(),
            at: times.iter().map(|t| recent[*t].time).collect(),
            scale: Scale::Linear,
        },
        y: HeatMapAxis {
            name: ARC_LENGTH.to_string(),
            at: places.iter().map(|p| arcs[inner.start + p]).collect(),
            scale: Scale::Linear,
        },
        value: "curvature (1/m)".to_string(),
        cells: (0..times.len()).flat_map(cells).collect(),
    };
    let mut caption = "The curvature over arc length and time: bands that rise are waves that travel towards the tip, at the speed of \
                       their slope; upright ones are standing waves."
        .to_string();
    let span = end - recent[0].time;
    let rate = record.drive().map(|frequency| (times.len() - 1) as f64 / (frequency * span));
    if let Some(rate) = rate.filter(|rate| is_too_coarse(*rate)) {
        let _ = write!(
            caption,
            " With {} times per period of the fastest drive, fewer than {LEAST_PER_PERIOD}, waves may look slower than they are, or go \
             backwards.",
            in_sentence(rate, 2)
        );
    } else if fast.is_some() {
        let what = if since.is_finite() { "two periods" } else { "the whole run" };
        let _ = write!(caption, " {}", last_periods_in_words([recent[0].time, end], what));
    }
    Some(Figure::new("curvature.svg", caption, map.svg()))
}

/// The curvature at each of these points of a line, 1/m: of a turn by θ between two edges of the mean length ℓ, 2 tan(θ/2)/ℓ; 0 at its ends.
fn curvatures(points: &[[f64; 2]]) -> Vec<f64> {
    let inner = points.windows(3).map(|around| {
        let [a, b, c] = [0, 1, 2].map(|i| Vector2::from(around[i]));
        let (before, after) = (b - a, c - b);
        let turn = before.perp(&after).atan2(before.dot(&after));
        4.0 * (0.5 * turn).tan() / (before.norm() + after.norm())
    });
    std::iter::once(0.0).chain(inner).chain([0.0]).collect()
}

/// Half the lateral excursion of each point from time `since` (s) on, over arc length.
fn amplitude(record: &RunRecord, since: f64) -> Option<Vec<(f64, f64)>> {
    let shapes = seen_along(record, since)?;
    let arcs = &record.rod().arc_lengths;
    let side =
        |i: usize, furthest: fn(f64, f64) -> f64, start| shapes.iter().map(|shape| shape[i].1).fold(start, furthest);
    let half = |i: usize| 0.5 * (side(i, f64::max, f64::NEG_INFINITY) - side(i, f64::min, f64::INFINITY));
    Some(arcs.iter().enumerate().map(|(i, arc)| (*arc, half(i))).collect())
}

/// Points whose first harmonic of curvature is below this fraction of the largest have no phase.
const LEAST_HARMONIC: f64 = 0.02;

/// The frames of the `period` (s) before the end, with the time (s) that each stands for: half the way to its neighbours, of which the last
/// is followed by the first. Sums with these weights are means of a periodic motion times the period, however frames are spaced. `None` if
/// there are few.
fn of_last_period(record: &RunRecord, period: f64) -> Option<Vec<(&Frame, f64)>> {
    let end = record.frames().last()?.time;
    let mut frames = record.frames_since(end - period);
    // The first frame of a period is also its last.
    frames.retain(|frame| frame.time > end - period * (1.0 - 1e-6));
    let (first, last) = (frames.first()?.time, frames.last()?.time);
    let weight = |i: usize| {
        let before = if i == 0 { last - period } else { frames[i - 1].time };
        let after = frames.get(i + 1).map_or(first + period, |frame| frame.time);
        0.5 * (after - before)
    };
    (frames.len() >= LEAST_SAMPLES).then(|| frames.iter().enumerate().map(|(i, frame)| (*frame, weight(i))).collect())
}

/// The lag of the curvature's first harmonic behind that nearest to the head, rad, over arc length, over the last `period` (s).
fn phase(record: &RunRecord, period: f64) -> Option<Vec<(f64, f64)>> {
    let cycle = of_last_period(record, period)?;
    let arcs = &record.rod().arc_lengths;
    let curvatures: Vec<Vec<f64>> = cycle.iter().map(|(frame, _)| curvatures(&frame.points)).collect();
    let mut harmonics = vec![Vector2::zeros(); arcs.len()];
    for (k, harmonic) in harmonics.iter_mut().enumerate() {
        let mean = cycle.iter().zip(&curvatures).map(|((_, weight), row)| weight * row[k]).sum::<f64>() / period;
        for ((frame, weight), row) in cycle.iter().zip(&curvatures) {
            let (sin, cos) = (std::f64::consts::TAU * frame.time / period).sin_cos();
            *harmonic += *weight * (row[k] - mean) * Vector2::new(cos, sin);
        }
    }
    let largest = harmonics.iter().map(Vector2::norm).fold(0.0, f64::max);
    if largest / period * arcs[arcs.len() - 1] < STRAIGHT {
        return None;
    }
    let known = arcs
        .iter()
        .zip(&harmonics)
        .filter(|(_, harmonic)| largest > 0.0 && harmonic.norm() >= LEAST_HARMONIC * largest);
    let mut lags: Vec<(f64, f64)> = Vec::new();
    let mut before: Option<Vector2<f64>> = None;
    for (arc, harmonic) in known {
        // From one point to the next the phase changes by less than half a turn.
        let step = before.map_or(0.0, |before| before.perp(harmonic).atan2(before.dot(harmonic)));
        lags.push((*arc, lags.last().map_or(0.0, |last| last.1) + step));
        before = Some(*harmonic);
    }
    (lags.len() > 2).then_some(lags)
}

/// The mean power per length that the actuation puts in over the last `period` (s), or over the run, W/m, over arc length: at all joints.
fn power_along(record: &RunRecord, period: Option<f64>) -> Option<Vec<(f64, f64)>> {
    let frames = record.frames();
    let span = frames.last()?.time - frames[0].time;
    let weighted = match period {
        Some(period) => of_last_period(record, period)?,
        None => {
            let weight = |i: usize| {
                let at = |i: usize| frames[i.min(frames.len() - 1)].time;
                0.5 * (at(i + 1) - at(i.saturating_sub(1)))
            };
            frames.iter().enumerate().map(|(i, frame)| (frame, weight(i))).collect()
        }
    };
    let span = period.unwrap_or(span);
    let arcs = &record.rod().arc_lengths;
    let power = |frame: &Frame, i: usize| frame.loads.as_ref().map_or(0.0, |loads| loads.power[i]);
    let mean = |i: usize| weighted.iter().map(|(frame, weight)| weight * power(frame, i)).sum::<f64>() / span;
    // A clamped head also has a joint.
    let first = usize::from(weighted.iter().all(|(frame, _)| power(frame, 0) == 0.0));
    let points: Vec<_> = (first..arcs.len().saturating_sub(1)).map(|i| (arcs[i], mean(i))).collect();
    (weighted.len() >= LEAST_SAMPLES && points.iter().any(|point| point.1 != 0.0)).then_some(points)
}

/// The energy balance since the start: work that was put into the rod (J, positive), and work or energy that was dissipated or
/// stored (negative). They add up to zero. Terms that are always zero are left out.
pub fn energy_balance(record: &RunRecord) -> Vec<Series> {
    let since_start = |(label, variable, _, sign): BalancePart| {
        let points = record.curve("time_s", variable);
        let first = points.first().map_or(0.0, |point| point.1);
        let points = points.into_iter().map(|(t, value)| (t, sign * (value - first))).collect();
        Series::new(label, points, Mark::Line)
    };
    let drawn = PARTS.map(since_start).into_iter().enumerate().map(|(k, series)| series.coloured(k));
    drawn.filter(|series| series.points.iter().any(|point| point.1 != 0.0)).collect()
}

/// The last shape with its centre of mass, over earlier ones from time `since` (s) on.
fn shapes(frames: &[Frame], since: f64) -> Vec<Series> {
    let Some(last) = frames.last() else { return Vec::new() };
    let recent = &frames[frames.partition_point(|frame| frame.time < since)..];
    let points = |frame: &Frame| frame.points.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>();
    let stride = recent.len().div_ceil(EARLIER_SHAPES).max(1);
    let ghosts = recent.iter().step_by(stride).filter(|frame| frame.time < last.time);
    let mut series: Vec<_> = ghosts.map(|frame| Series::new("", points(frame), Mark::Ghost)).collect();
    let mark = if last.points.len() <= 40 { Mark::Dotted } else { Mark::Line };
    series.push(Series::new("rod", points(last), mark));
    series.push(Series::new("centre of mass", vec![(last.com[0], last.com[1])], Mark::Dots));
    let lines = interfaces(last, &series);
    series.extend(lines);
    series
}

/// The middles of the interfaces of a layered medium, as lines past the points of `series`.
fn interfaces(frame: &Frame, series: &[Series]) -> Vec<Series> {
    let Some(layers) = frame.medium.as_ref().and_then(Medium::interfaces) else { return Vec::new() };
    let (normal, tangent) = (layers.normal, Vector2::new(layers.normal.y, -layers.normal.x));
    let along = || series.iter().flat_map(|series| &series.points).map(|(x, y)| tangent.dot(&Vector2::new(*x, *y)));
    let (low, high) = along().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (x.min(low), x.max(high)));
    let line = |offset: f64| {
        let at = |x: f64| normal * offset + tangent * x;
        let points = [low, high, low].map(at).map(|point| (point.x, point.y));
        Series::new("interface", points.into(), Mark::Level)
    };
    layers.iter().map(|layer| line(layer.offset)).collect()
}

/// What the lines of [`interfaces`] are, if there are any.
fn interfaces_in_words(record: &RunRecord) -> &'static str {
    match record.frames().last().and_then(|frame| frame.medium.as_ref()).and_then(Medium::interfaces) {
        Some(_) => " Thin lines: the middles of the interfaces between the fluids.",
        None => "",
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use std::f64::consts::TAU;

    use super::*;
    use crate::scene::Document;
    use crate::stepper::Stepper;

    /// The record of two seconds of a scene.
    fn recorded(text: &str) -> RunRecord {
        recorded_for(text, 200)
    }

    /// The record of so many steps of 0.01 s of a scene.
    fn recorded_for(text: &str, steps: usize) -> RunRecord {
        let scene = Document::new("waves", text).scene().unwrap();
        let mut stepper = Stepper::of(&scene).unwrap();
        let mut record = RunRecord::start(&scene, &stepper);
        for _ in 0..steps {
            stepper.do_step(0.01).unwrap();
            record.pass(&mut stepper).unwrap();
        }
        record.finish(&stepper.view());
        record
    }

    /// A rod whose shape is that of its actuation, a wave of the curvature κ(s, t) = A sin(2π(ft − s/λ)) with λ = 0.5 m.
    const WAVE: &str = r#"
        rod = { nodes = 41, length_m = 1.0, outer_radius_m = 0.01, youngs_modulus_pa = 1e6, density_kg_m3 = 1000.0 }
        actuation = { kind = "travelling-wave", kappa_amp = 2.0, frequency_hz = 2.0, wavelength_m = 0.5, envelope = [1.0, 0.0] }
        medium = { viscosity_pa_s = 1.0, density_kg_m3 = 1000.0 }
        drag = { law = "cox" }
        solver = { model = "shape", time_step_s = 0.01, duration_s = 2.0 }
    "#;

    #[test]
    fn a_long_run_that_is_interrupted_has_the_figures_of_one_that_ends_there() {
        let files = |duration: &str, steps: usize| -> Vec<String> {
            let text = WAVE.replace("duration_s = 2.0", &format!("duration_s = {duration}"));
            all("wave", &recorded_for(&text, steps), Some(0.5)).into_iter().map(|figure| figure.file).collect()
        };
        let ended = files("60.0", 6000);
        assert!(["power.svg", "amplitude.svg", "phase.svg"].iter().all(|file| ended.iter().any(|own| own == file)));
        for duration in ["61.0", "100.0", "2000.0"] {
            assert_eq!(files(duration, 6000), ended, "interrupted at 60 s of {duration} s");
        }
    }

    #[test]
    fn a_kymograph_has_twelve_times_per_period_of_the_fastest_drive_or_says_that_it_has_not() {
        // With a head that is fast beside a slow wave, in steps of 0.01 s.
        for (frequency, shortened, coarse) in [("0.15", false, false), ("5.0", true, false), ("20.0", true, true)] {
            let head = format!(
                "head = {{ kind = \"driven\", angle_rad = {{ amplitude = 0.1, frequency_hz = {frequency} }} }}\n        solver"
            );
            let text = WAVE
                .replace("frequency_hz = 2.0", "frequency_hz = 0.1")
                .replace("duration_s = 2.0", "duration_s = 60.0");
            let text = text.replace("model = \"shape\", ", "").replace("solver", &head);
            let record = recorded_for(&text, 6000);
            let figure = kymograph("both", &record, 40.0).unwrap();
            assert_eq!(
                figure.caption.contains("Shown are the last periods"),
                shortened && !coarse,
                "{}",
                figure.caption
            );
            assert_eq!(figure.caption.contains("times per period of the fastest drive"), coarse, "{}", figure.caption);
        }
    }

    #[test]
    fn the_phase_of_a_wave_rises_by_a_turn_per_wavelength() {
        let record = recorded(WAVE);
        let phase = phase(&record, 0.5).unwrap();
        let (first, last) = (phase[0], phase[phase.len() - 1]);
        let slope = (last.1 - first.1) / (last.0 - first.0);
        // Measured: 2e-15.
        assert!((slope / (TAU / 0.5) - 1.0).abs() < 1e-9, "{slope}");
        assert!(phase.windows(2).all(|pair| pair[1].1 > pair[0].1));
    }

    #[test]
    fn the_amplitude_along_a_short_wave_is_that_of_its_curvature_over_the_square_of_the_wave_number() {
        // y'' = κ: if κ is a wave of amplitude A, y is one of amplitude A/k², where k = 2π/λ, except for the swing of the whole rod.
        let record =
            recorded(&WAVE.replace("wavelength_m = 0.5", "wavelength_m = 0.25").replace("nodes = 41", "nodes = 101"));
        let amplitude = amplitude(&record, 1.5).unwrap();
        let inner = &amplitude[30..71];
        let mean = inner.iter().map(|point| point.1).sum::<f64>() / inner.len() as f64;
        // Measured: 4 % off, because of the swing.
        assert!((mean / (2.0 / (TAU / 0.25).powi(2)) - 1.0).abs() < 0.1, "{mean}");
    }

    #[test]
    fn the_curvature_of_a_circle_is_that_of_its_radius() {
        let at = |i: i32| [0.3 * (0.1 * f64::from(i)).cos(), 0.3 * (0.1 * f64::from(i)).sin()];
        let points: Vec<_> = (0..9).map(at).collect();
        // Of the polygon: the tangent of half the angle for half the angle, 1e-3, and the chord for the arc.
        let expected = 2.0 * (0.05_f64).tan() / (2.0 * 0.3 * (0.05_f64).sin());
        let found = curvatures(&points);
        assert!(found[1..8].iter().all(|kappa| (kappa / expected - 1.0).abs() < 1e-12), "{found:?}");
        assert!((found[4] * 0.3 - 1.0).abs() < 3e-3 && found[0] == 0.0 && found[8] == 0.0);
        let mirrored: Vec<_> = points.iter().map(|[x, y]| [*x, -y]).collect();
        assert!(curvatures(&mirrored)[4] == -found[4]);
    }

    #[test]
    fn the_power_along_the_body_makes_the_power_of_the_actuation_in_every_scene() {
        let mut seen = 0;
        for file in std::fs::read_dir("models").unwrap().map(|entry| entry.unwrap().path()) {
            let name = file.file_name().unwrap().to_string_lossy().into_owned();
            let text = std::fs::read_to_string(&file).unwrap_or_default();
            let Ok(scene) = Document::read(&file).and_then(|document| document.scene()) else { continue };
            if scene.rod.nodes.get() > 120 || !text.contains("[solver]") {
                continue;
            }
            let mut stepper = Stepper::of(&scene).unwrap();
            for _ in 0..3 {
                stepper.do_step(7.3e-3).unwrap();
                let view = stepper.view();
                let rod = &view.dynamics.model.rod;
                let power = Frame::with_loads(&view, &(0..rod.nodes).collect::<Vec<_>>()).loads.unwrap().power;
                let parts: Vec<f64> = rod.joints().map(|k| power[k] * rod.joint_part(k) * rod.spacing).collect();
                let expected = view.metrics.now.power.actuation;
                let size = parts.iter().map(|part| part.abs()).sum::<f64>().max(f64::MIN_POSITIVE);
                // Measured: 1e-15.
                assert!((parts.iter().sum::<f64>() - expected).abs() <= 1e-9 * size, "{name}: {parts:?} {expected}");
                seen += usize::from(expected != 0.0);
            }
        }
        assert!(seen > 30, "{seen}");
    }
}
