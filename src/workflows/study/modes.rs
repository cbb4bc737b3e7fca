//! `caudal study modes`: natural frequencies and mode shapes of a scene's rod, damped modes in its fluid, and mass and stiffness
//! matrices for other programs.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use serde_json::json;

use crate::error::Result;
use crate::integrator::StepControl;
use crate::linear_stability::{Eigenmode, NoSteadyState, SteadyState};
use crate::modes::{Matrices, Mode, ModeKind, Modes, StableSteps, lowest_of_model};
use crate::number_format::in_sentence;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::{Findings, Table};
use crate::rod::Rod;
use crate::scene::Scene;

/// All frequencies are computed up to this many nodes: the cost grows as N³ (about a second here).
const MAX_NODES_FOR_SPECTRUM: usize = 1001;
/// The matrices are written up to this many nodes: about 0.3 kB of text per node.
const MAX_NODES_FOR_MATRICES: usize = 100_001;
/// Damped modes are computed up to this many nodes: the cost grows as N³, with four unknowns per node.
const MAX_NODES_FOR_DAMPING: usize = 129;
/// Mode shapes in the figure.
const DRAWN_SHAPES: usize = 5;
/// Most points of a mode shape in tables and figures.
const MAX_SHAPE_POINTS: usize = 2001;
/// A step resolves modes up to this ωΔt: the frequency error of a second-order method, ω²Δt²/12, is then 0.3 %.
const RESOLVED: f64 = 0.2;

/// Options of the study.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModesOptions {
    /// Number of lowest modes.
    pub count: usize,
}

impl Default for ModesOptions {
    fn default() -> Self {
        Self { count: 12 }
    }
}

/// A mode with at least this damping ratio hardly resonates: its largest amplitude is 15 % above the quasi-static one.
const STRONGLY_DAMPED: f64 = 0.5;

/// Factor on the density that stands for no fluid, since drag laws may divide by the density.
const VACUUM: f64 = 1e-12;

/// The `count` lowest modes of `scene`.
///
/// # Errors
/// Those of [`Scene::model`] and [`lowest_of_model`].
pub(super) fn modes(scene: &Scene, count: usize) -> Result<Findings> {
    let model = scene.model()?;
    let drive = model.actuation.as_ref().map(|(_, drive)| drive.frequency).filter(|frequency| *frequency > 0.0);
    let found = lowest_of_model(scene.model()?, count)?;
    let all = if model.rod.nodes <= MAX_NODES_FOR_SPECTRUM { Some(Modes::of_model(scene.model()?)?) } else { None };
    let wet = model.forces.are_inertial();
    let (rod, hinge) = (model.rod.clone(), model.hinge.clone());
    let matrices = Matrices::of(model)?;

    let mut findings = Findings { subject: "natural modes", ..Findings::default() };
    let head = match &hinge {
        Some(hinge) if hinge.stiffness > 0.0 => "on the servo that turns its head",
        Some(_) => "on the hinge of its head, which no servo holds",
        None if matrices.free.first == 0 => "free",
        None => "held at its head",
    };
    let Some(first) = found.first() else { return Ok(findings) };
    let (about_rest, damping) = about_rest(scene, count, first.frequency)?;
    let with = if wet { "with added mass" } else { "in vacuum" };
    let slack = if scene.has_winches() { ", as if its winches were slack" } else { "" };
    let unloaded = if scene.has_loads() { ", without its loads" } else { "" };
    findings.answers.push(format!(
        "The rod of {} nodes, {head}, has its lowest natural frequency at {:.6} Hz ({}), {with}{unloaded}{slack}.",
        rod.nodes,
        first.frequency / TAU,
        first.axis.name()
    ));
    // Inertia that is not the fluid's, such as that of a body at the head, remains.
    let mut dry = scene.model()?;
    (dry.fluid.density, dry.layers) = (VACUUM * dry.fluid.density, None);
    if wet && let Some(dry) = lowest_of_model(dry, 1)?.first() {
        findings.answers.push(format!("Without that fluid it would be {:.6} Hz.", dry.frequency / TAU));
    }
    if let Some(drive) = drive {
        let ratio = TAU * drive / first.frequency;
        let damped = damping.filter(|damping| *damping >= STRONGLY_DAMPED);
        let says = if ratio < 0.1 {
            "far below it: the rod takes the curvature of the actuation, and the fluid determines its motion"
                .to_string()
        } else if ratio < 0.7 {
            "below it: inertia adds to that curvature, by about the square of the ratio".to_string()
        } else {
            match (ratio < 1.5, damped, scene.has_active_moments()) {
                (true, None, _) => {
                    "near it: the rod resonates, and its curvature differs from that of the actuation".to_string()
                }
                (true, Some(damping), _) => format!(
                    "near it, but damping leaves no resonance (damping ratio {}), and the shape is not the one prescribed",
                    in_sentence(damping, 2)
                ),
                (false, _, false) => {
                    "above it: inertia and fluid decide, and the shape is not the one prescribed".to_string()
                }
                (false, _, true) => {
                    "above it: inertia and fluid hold it, and it bends less than the moments bend it at rest"
                        .to_string()
                }
            }
        };
        findings.answers.push(format!("The actuation at {drive} Hz is {} times that, {says}.", in_sentence(ratio, 4)));
    }
    let needed = in_sentence(RESOLVED / first.frequency, 3);
    let step = match scene.step_control() {
        StepControl::Fixed(step) => Some(step),
        StepControl::Adaptive(_) => None,
    };
    findings.answers.push(match step {
        Some(step) => {
            let resolved = found.iter().filter(|mode| mode.frequency * step <= RESOLVED).count();
            let which = match resolved {
                0 => "none of its modes".to_string(),
                n if n == found.len() => format!("all of these {n} modes"),
                n => format!("the {n} lowest modes"),
            };
            let step = in_sentence(step, 7);
            format!("The step of {step} s resolves {which} (ωΔt ≤ {RESOLVED}); the first needs {needed} s.")
        }
        None => format!(
            "The steps are those that the tolerance asks for; one that resolves the first mode (ωΔt ≤ {RESOLVED}) has at most {needed} s."
        ),
    });
    let explicit = all.as_ref().and_then(|all| all.explicit_steps(rod.damping.as_ref()));
    match all.as_ref().zip(explicit) {
        Some((all, StableSteps { largest, limit, frequency })) => findings.answers.push(format!(
            "The highest of all is {} Hz {with}: an explicit method needs steps below {} s (ωΔt ≤ {limit:.4} at {} Hz).",
            in_sentence(all.highest() / TAU, 5),
            in_sentence(largest, 5),
            in_sentence(frequency / TAU, 5),
        )),
        None => findings.answers.push(format!(
            "All frequencies, and with them the limit of explicit methods, are computed up to {MAX_NODES_FOR_SPECTRUM} nodes."
        )),
    }
    findings.numbers.insert("nodes".into(), json!(rod.nodes));
    findings.numbers.insert("lowest_frequency_hz".into(), json!(first.frequency / TAU));
    findings.numbers.insert("highest_frequency_hz".into(), json!(all.as_ref().map(|all| all.highest() / TAU)));
    findings.numbers.insert("explicit_step_limit_s".into(), json!(explicit.map(|steps| steps.largest)));

    findings.tables.push(modes_table(&found, &matrices, step));
    findings.tables.push(shapes_table(&found, &rod));
    let title = |what: &str| format!("{}: {what}", scene.name);
    let shapes = found.iter().filter(|mode| mode.axis == ModeKind::Bending).take(DRAWN_SHAPES).map(|mode| {
        let label = format!("{:.5} Hz", mode.frequency / TAU);
        Series::new(label, points(&mode.shape).map(|k| (rod.arc_length(k), mode.shape[k])).collect(), Mark::Line)
    });
    let shapes = Chart {
        title: title("lowest modes of bending"),
        x: "arc length s (m)".into(),
        y: "displacement across the rod, largest 1".into(),
        scale: Scale::Linear,
        series: shapes.collect(),
    };
    let frequencies = Chart {
        title: title("natural frequencies"),
        x: "mode number".into(),
        y: "frequency (Hz)".into(),
        scale: Scale::LogLog,
        series: frequencies(&found, all.as_ref(), drive, step.map(|step| RESOLVED / (TAU * step))),
    };
    let caption = "The shapes of the lowest modes of bending along the rod, with their frequencies.";
    findings.figures.extend(shapes.figure("shapes.svg", caption));
    let levels = [
        drive.map(|_| "the frequency of the drive"),
        step.map(|_| "the highest frequency that the time step resolves"),
    ];
    let levels: Vec<_> = levels.into_iter().flatten().collect();
    let levels = if levels.is_empty() { String::new() } else { format!(", {}", levels.join(" and ")) };
    let caption = format!("The natural frequencies{levels}.");
    findings.figures.extend(frequencies.figure("frequencies.svg", caption));
    findings.append(about_rest);
    if rod.nodes <= MAX_NODES_FOR_MATRICES {
        findings.files.extend(matrices.matrix_market().into_iter().map(|(file, text)| (file.to_string(), text)));
    }
    Ok(findings)
}

/// The modes about the rod's equilibrium in its fluid and under its loads: damped frequencies and growth rates. Also the damping
/// ratio of the mode closest to the `natural` frequency (rad/s), if it is known.
fn about_rest(scene: &Scene, count: usize, natural: f64) -> Result<(Findings, Option<f64>)> {
    let mut findings = Findings::default();
    let model = scene.model()?;
    if model.forces.is_empty() && model.load.is_none() && !model.is_damped() {
        return Ok((findings, None)); // they are the natural modes
    }
    if model.rod.nodes > MAX_NODES_FOR_DAMPING {
        findings
            .answers
            .push(format!("Motions with damping and in flow are computed up to {MAX_NODES_FOR_DAMPING} nodes."));
        return Ok((findings, None));
    }
    let is_in_fluid = model.forces.iter().any(|force| force.is_of_fluid());
    let flow = model.fluid.flow.norm();
    let (free, loads) = (model.head.is_none(), if scene.has_loads() { " under its loads" } else { "" });
    let mut steady = match SteadyState::of(model) {
        Ok(steady) => steady,
        Err(NoSteadyState { key, problem }) => {
            findings.answers.push(format!("Motions with damping and in flow are left out: {key}: {problem}."));
            return Ok((findings, None));
        }
    };
    let bend = steady.bend();
    let modes = steady.eigenmodes()?;
    let fastest = |grows: bool| {
        let some = modes.iter().filter(|mode| mode.grows() || !grows);
        some.rev().max_by(|a, b| a.growth.total_cmp(&b.growth)) // of equal ones the slowest
    };
    let Some(leading) = fastest(true).or_else(|| fastest(false)) else { return Ok((findings, None)) };
    let slowest_swing = modes.iter().find(|mode| mode.frequency > 0.0);
    let away = |mode: &&Eigenmode| (mode.growth.hypot(mode.frequency) / natural).ln().abs();
    let nearest = modes.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
    let damping = nearest.map(Eigenmode::damping_ratio);
    let bend = in_sentence(bend, 3);
    let medium = match is_in_fluid {
        true if free => "In the fluid, with which a free rod goes".to_string(),
        true if flow > 0.0 => format!("In the flow of {flow:.4} m/s"),
        true => "In the fluid".to_string(),
        false => "In vacuum".to_string(),
    };
    let rest = if free { String::new() } else { format!(" at rest{loads} {bend} m from straight,") };
    let place = format!("{medium},{rest}");
    findings.answers.push(if leading.grows() {
        let how = if leading.frequency > 0.0 {
            format!("flutters: a motion of {:.4} Hz", leading.frequency / TAU)
        } else {
            "diverges: a motion that does not oscillate".to_string()
        };
        format!("{place} the rod {how} grows by {} 1/s.", in_sentence(leading.growth, 5))
    } else {
        match slowest_swing {
            Some(slowest) => format!(
                "{place} the slowest vibration has {:.6} Hz and, at vanishing amplitude, damping ratio {:.4}; no motion grows.",
                slowest.frequency / TAU,
                slowest.damping_ratio()
            ),
            None => format!("{place} no motion oscillates, and none grows."),
        }
    });
    findings.numbers.insert("largest_growth_rate_1_s".into(), json!(leading.growth));
    findings.numbers.insert("its_frequency_hz".into(), json!(leading.frequency / TAU));
    let slowest = &modes[..count.min(modes.len())];
    let rows = slowest.iter().enumerate().map(|(i, mode)| {
        let kind = if mode.bends() { ModeKind::Bending } else { ModeKind::Stretching };
        vec![
            json!(i + 1),
            json!(kind.name()),
            json!(mode.frequency / TAU + 0.0), // no −0
            json!(mode.growth),
            json!(mode.damping_ratio()),
        ]
    });
    findings.tables.push(Table {
        file: "damped.csv",
        title: "Motions about the rest, with damping",
        columns: ["motion", "kind", "frequency_hz", "growth_rate_1_s", "damping_ratio"].map(str::to_string).to_vec(),
        rows: rows.collect(),
    });
    let dots = |axis: ModeKind| {
        let own = slowest.iter().filter(|mode| mode.bends() == (axis == ModeKind::Bending));
        Series::new(axis.name(), own.map(|mode| (mode.growth, mode.frequency / TAU)).collect(), Mark::Dots)
    };
    let series =
        [dots(ModeKind::Bending), dots(ModeKind::Stretching)].into_iter().filter(|series| !series.points.is_empty());
    let chart = Chart {
        title: format!("{}: motions about the rest, with damping", scene.name),
        x: "growth rate (1/s)".into(),
        y: "frequency (Hz)".into(),
        scale: Scale::Linear,
        series: series.collect(),
    };
    let caption = "The slowest motions about the rest: those with a positive growth rate grow.";
    findings.figures.extend(chart.figure("damped.svg", caption));
    Ok((findings, damping))
}

/// `step` (s) is `None` for adaptive steps, without ωΔt.
fn modes_table(found: &[Mode], matrices: &Matrices, step: Option<f64>) -> Table {
    let rows = found.iter().enumerate().map(|(i, mode)| {
        let ratio = matrices.damping_ratio(mode);
        vec![
            json!(i + 1),
            json!(mode.axis.name()),
            json!(mode.frequency / TAU),
            json!(mode.frequency),
            json!(ratio),
            json!(step.map(|step| mode.frequency * step)),
        ]
    });
    Table {
        file: "modes.csv",
        title: "Modes",
        columns: ["mode", "kind", "frequency_hz", "frequency_rad_s", "damping_ratio", "omega_time_step"]
            .map(str::to_string)
            .to_vec(),
        rows: rows.collect(),
    }
}

fn shapes_table(found: &[Mode], rod: &Rod) -> Table {
    let nodes = found.first().map_or(0..0, |mode| 0..mode.shape.len());
    let rows = points(&found[0].shape).map(|k| {
        let shapes = found.iter().map(|mode| json!(mode.shape[k]));
        [json!(k), json!(rod.arc_length(k))].into_iter().chain(shapes).collect()
    });
    let names = (1..=found.len()).map(|i| format!("mode_{i}"));
    Table {
        file: "shapes.csv",
        title: "Shapes",
        columns: ["node".to_string(), "s_m".to_string()].into_iter().chain(names).collect(),
        rows: if nodes.is_empty() { Vec::new() } else { rows.collect() },
    }
}

/// The nodes of a mode shape that are shown, including head and tip.
fn points(shape: &[f64]) -> impl Iterator<Item = usize> {
    let (last, shown) = (shape.len() - 1, shape.len().min(MAX_SHAPE_POINTS) - 1);
    (0..=shown).map(move |i| i * last / shown)
}

/// Frequencies (Hz) by mode number, with lines for the drive and for the highest frequency that the step resolves.
fn frequencies(found: &[Mode], all: Option<&Modes>, drive: Option<f64>, step: Option<f64>) -> Vec<Series> {
    let curve = |axis: ModeKind| -> Vec<f64> {
        match (all, axis) {
            (Some(all), ModeKind::Bending) => all.bending.clone(),
            (Some(all), ModeKind::Stretching) => all.stretching.clone(),
            (None, _) => found.iter().filter(|mode| mode.axis == axis).map(|mode| mode.frequency).collect(),
        }
    };
    let mut series = Vec::new();
    let mut last = 1.0_f64;
    for axis in [ModeKind::Bending, ModeKind::Stretching] {
        let points: Vec<_> = (1..).zip(curve(axis)).map(|(i, omega)| (f64::from(i), omega / TAU)).collect();
        last = points.last().map_or(last, |p| last.max(p.0));
        let mark = if points.len() <= 60 { Mark::Dotted } else { Mark::Line };
        series.push(Series::new(axis.name(), points, mark));
    }
    let level = |label: &str, value: f64| Series::new(label, vec![(1.0, value), (last, value)], Mark::Line);
    series.extend(drive.map(|drive| level("the drive", drive)));
    series.extend(step.map(|step| level(&format!("ωΔt = {RESOLVED}, resolved below"), step)));
    series
}
