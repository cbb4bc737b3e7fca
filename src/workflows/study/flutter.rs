//! `caudal study stability --vary flow`: flutter and divergence of a held tail in a flow, over the flow speed and the mass of the
//! tail, from the eigenvalues of small motions about its equilibrium; compared with beam theory.

use std::f64::consts::TAU;

use faer::c64;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::beam::Beam;
use super::root_search::{SAMPLES, first_rise};
use super::runner::{StudyOutcome, StudyRunner};
use super::stability::{StabilityOptions, geometric_sequence};
use crate::error::{Error, Result};
use crate::jobs;
use crate::linear_stability::{NoSteadyState, SteadyState, grows};
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::outcome_map::{Category, OutcomeMap, Panel};
use crate::report::{Figure, Findings, Table};
use crate::scene::{HeadKind, Scene};

/// Most nodes for which eigenvalues are computed: the cost grows as N³, and the error with this many is 0.1 %.
const MAX_NODES: usize = 65;

/// Range of the mass ratio β, the share of the water in the inertia.
const MASS_RATIO_RANGE: [f64; 2] = [0.05, 0.95];

/// Default range of the flow speed, in units of √(EI/m_a)/L.
const DEFAULT_SPEED_RANGE: [f64; 2] = [1.0, 20.0];

/// An equilibrium is straight, a load along it zero (over EI/L²), and edges are equally long, up to this fraction.
const MAX_DEVIATION: f64 = 1e-2;

/// Number of modes that are tracked over the speed.
const TRACKED_MODES: usize = 5;

/// Speeds of the tracked modes per speed of the map.
const TRACKING_REFINEMENT: usize = 4;

/// What happens to the equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum RestStability {
    Stable,
    Flutter,
    Divergence,
    NoRest,
}

impl RestStability {
    const ALL: [Self; 4] = [Self::Stable, Self::Flutter, Self::Divergence, Self::NoRest];

    fn category(self) -> Category {
        let (label, colour) = match self {
            Self::Stable => ("stays at rest", [0, 158, 115]),
            Self::Flutter => ("flutter", [213, 94, 0]),
            Self::Divergence => ("divergence", [204, 121, 167]),
            Self::NoRest => ("no rest found", [200, 200, 200]),
        };
        Category { label, colour }
    }
}

/// One mass ratio, over flow speeds.
#[derive(Debug)]
struct SpeedScan {
    share: f64,
    speeds: Vec<f64>,
    /// True to search for the critical speed too.
    critical: bool,
}

/// The result at one speed.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct FlutterPoint {
    outcome: RestStability,
    /// σ (1/s) and ω (rad/s) of the fastest growing mode.
    leading: [f64; 2],
    /// σ and ω of the slowest modes.
    slowest: Vec<[f64; 2]>,
}

impl FlutterPoint {
    /// Positive if the equilibrium is unstable; otherwise minus the relative damping of the least damped oscillation.
    fn rise(&self) -> f64 {
        if self.outcome != RestStability::Stable {
            return 1.0;
        }
        let swinging = self.slowest.iter().filter(|[_, omega]| *omega > 0.0);
        let least = swinging.map(|[growth, omega]| growth / growth.hypot(*omega)).fold(-1.0, f64::max);
        least.min(-f64::MIN_POSITIVE)
    }
}

/// The results for one mass ratio.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct ScanResult {
    points: Vec<FlutterPoint>,
    /// The critical speed (m/s), the kind of instability, and ω (rad/s) there.
    critical: Option<(f64, RestStability, f64)>,
}

/// Properties of the tail, and the scales of the theory.
struct HeldTail {
    /// Direction of the flow.
    direction: [f64; 2],
    /// True if the flow comes from the free end.
    is_reversed: bool,
    /// Mass of the rod and added mass across it, kg.
    masses: [f64; 2],
    /// √(EI/m_a)/L, m/s.
    unit: f64,
    /// Share χ of the wake, if the theory covers this rod; otherwise the reason why not.
    theory: std::result::Result<f64, &'static str>,
}

impl HeldTail {
    fn share(&self) -> f64 {
        self.masses[1] / (self.masses[0] + self.masses[1])
    }

    /// The factor on the rod's density that gives the mass ratio β.
    fn factor(&self, share: f64) -> f64 {
        self.masses[1] * (1.0 - share) / (share * self.masses[0])
    }
}

/// The properties of the tail of `scene` at its equilibrium.
fn tail(scene: &Scene, steady: &mut SteadyState) -> std::result::Result<HeldTail, NoSteadyState> {
    let refuse = |key: &'static str, problem: &str| NoSteadyState { key, problem: problem.to_string() };
    let Some(reactive) = scene.reactive_on().cloned() else {
        return Err(refuse("reactive", "missing; without the water's inertia no flow makes a tail flutter or diverge"));
    };
    let added = steady.added_mass().map_err(|error| refuse("reactive", &error.to_string()))?;
    let bend = steady.bend();
    let model = steady.model();
    let rod = &model.rod;
    let pitch = model.head.as_ref().map_or(0.0, |head| head[2].at(0.0).value);
    let along = [pitch.cos(), pitch.sin()];
    let speed = model.fluid.flow.norm();
    let direction = if speed > 0.0 { (model.fluid.flow / speed).into() } else { along };
    let masses = [rod.total_mass(), added.iter().sum()];
    let unit = (rod.ei / (masses[1] / rod.length)).sqrt() / rod.length;
    let alike = |values: &[f64]| values.iter().all(|value| (value / values[0] - 1.0).abs() < MAX_DEVIATION);
    let inner = 1..rod.nodes - 1;
    let uniform = alike(&rod.joint[inner.clone()]) && alike(&rod.mass[inner.clone()]) && alike(&added[inner]);
    let is_reversed = direction[0] * along[0] + direction[1] * along[1] < 0.0;
    let aligned = (direction[0] - along[0]).hypot(direction[1] - along[1]) < 1e-9;
    let load: f64 = (0..rod.nodes).map(|k| steady.load(k).dot(&nalgebra::Vector2::from(along)).abs()).sum();
    let tensioned = load * rod.length * rod.length > MAX_DEVIATION * rod.ei || bend > MAX_DEVIATION * rod.length;
    let theory = match (uniform, aligned, tensioned) {
        (false, ..) => Err("it is for a rod that is the same all along"),
        (_, false, _) => Err("it is for a flow along the rod, from its head"),
        (.., true) => Err("it is for a straight rod without loads along it"),
        _ => Ok(reactive.shedding.get()),
    };
    Ok(HeldTail { direction, is_reversed, masses, unit, theory })
}

/// The tail at this flow speed (m/s), with this factor on its density.
fn point(scene: &Scene, tail: &HeldTail, factor: f64, speed: f64) -> FlutterPoint {
    let none = FlutterPoint { outcome: RestStability::NoRest, leading: [0.0; 2], slowest: Vec::new() };
    let scene = scene.with_rod_density(factor).with_flow(tail.direction.map(|x| x * speed));
    let Ok(Ok(mut steady)) = scene.model().map(SteadyState::of) else { return none };
    let Ok(found) = steady.eigenvalues() else { return none };
    let mut values: Vec<c64> = found.iter().map(|(value, _)| *value).collect();
    let growing = found.iter().filter(|(value, uncertainty)| grows(*value, *uncertainty)).map(|(value, _)| *value);
    let fastest = |values: &mut dyn Iterator<Item = c64>| values.max_by(|a, b| a.re.total_cmp(&b.re));
    let growing = fastest(&mut growing.into_iter());
    let Some(leading) = growing.or_else(|| fastest(&mut values.iter().copied())) else { return none };
    values.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    let outcome = match growing {
        None => RestStability::Stable,
        Some(value) if value.im > 0.0 => RestStability::Flutter,
        Some(_) => RestStability::Divergence,
    };
    let slowest = values.iter().take(TRACKED_MODES).map(|value| [value.re, value.im]).collect();
    FlutterPoint { outcome, leading: [leading.re, leading.im], slowest }
}

/// Maps flutter and divergence of the tail of `scene`.
pub(super) fn flutter(scene: &Scene, asked: &StabilityOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    let refused = |NoSteadyState { key, problem }: NoSteadyState| Error::Scene {
        place: scene.name.clone(),
        key: key.to_string(),
        problem,
    };
    if scene.head.kind == HeadKind::Free {
        let problem = "the head is free, and the rod goes with the flow; allowed: a held head".to_string();
        return Err(refused(NoSteadyState { key: "head.kind", problem }));
    }
    // Which speed needs the water is what the study asks: a scene that leaves the water to the program has it at all of them.
    let left = scene.reactive.as_ref().is_some_and(|reactive| reactive.auto);
    let own = if left { scene.with_reactive(true) } else { scene.clone() };
    let nodes = scene.rod.nodes.get();
    let coarse = if nodes > MAX_NODES { own.with_nodes(MAX_NODES as u64) } else { own };
    let model = coarse.model()?;
    let own_speed = model.fluid.flow.norm();
    let mut steady = SteadyState::of(model).map_err(refused)?;
    let tail = tail(&coarse, &mut steady).map_err(refused)?;
    let range = asked.range.unwrap_or(DEFAULT_SPEED_RANGE.map(|speed| speed * tail.unit));
    let speeds = geometric_sequence(range, asked.points);
    let even = |[low, high]: [f64; 2], count: usize| {
        let last = count.max(2) - 1;
        (0..=last).map(move |i| low + (high - low) * i as f64 / last as f64)
    };
    let finer = even(range, TRACKING_REFINEMENT * asked.points).collect();
    let shares: Vec<f64> = even(MASS_RATIO_RANGE, asked.points).collect();
    let mut cases = vec![SpeedScan { share: tail.share(), speeds: finer, critical: true }];
    cases.extend(shares.iter().map(|share| SpeedScan { share: *share, speeds: speeds.clone(), critical: true }));
    let run = |case: &SpeedScan| {
        let factor = tail.factor(case.share);
        let at = |speed: f64| point(&coarse, &tail, factor, speed);
        let points: Vec<FlutterPoint> = case.speeds.iter().map(|speed| at(*speed)).collect();
        // Between speeds that are far apart, others are looked at, up to the first that leaves the rest.
        let between = SAMPLES.div_ceil(case.speeds.len());
        let mut samples: Vec<(f64, f64)> = Vec::new();
        for (i, point) in points.iter().enumerate().filter(|_| case.critical) {
            let (before, here) = (case.speeds[i.saturating_sub(1)], case.speeds[i]);
            let inner = (1..between).filter(|_| i > 0).map(|k| before + (here - before) * k as f64 / between as f64);
            samples.extend(inner.map(|speed| (speed, at(speed).rise())));
            samples.push((here, point.rise()));
            if samples.iter().any(|(_, rise)| *rise > 0.0) {
                break;
            }
        }
        let left = first_rise(&samples, |speed| at(speed).rise());
        let critical = left.map(|[mut below, mut above]| {
            let mut then = at(above);
            if below == above {
                let still = at(0.0);
                if still.outcome != RestStability::Stable {
                    return (0.0, still.outcome, still.leading[1]);
                }
                below = 0.0;
            }
            while above - below > 1e-5 * above {
                let middle = at(0.5 * (below + above));
                if middle.outcome == RestStability::Stable {
                    below = 0.5 * (below + above);
                } else {
                    above = 0.5 * (below + above);
                    then = middle;
                }
            }
            (0.5 * (below + above), then.outcome, then.leading[1])
        });
        Some(ScanResult { points, critical })
    };
    let columns = match runner.run_all("flutter", scene, &cases, jobs::cores(), run)? {
        Ok(columns) => columns,
        Err(interrupted) => return Ok(interrupted),
    };
    let own = (own_speed > 0.0).then(|| (own_speed, point(&coarse, &tail, 1.0, own_speed)));
    let report = FlutterReport { scene, tail: &tail, own, nodes: coarse.rod.nodes.get(), cases: &cases, columns };
    Ok(StudyOutcome::Complete(report.findings()))
}

struct FlutterReport<'a> {
    scene: &'a Scene,
    tail: &'a HeldTail,
    /// The scene's own flow speed (m/s), and the result there.
    own: Option<(f64, FlutterPoint)>,
    nodes: usize,
    cases: &'a [SpeedScan],
    columns: Vec<ScanResult>,
}

impl FlutterReport<'_> {
    fn findings(&self) -> Findings {
        let mut findings = Findings { subject: "stability in flow", ..Findings::default() };
        let Self { scene, tail, cases, columns, .. } = self;
        let [(own, own_column), map @ ..] = &*cases.iter().zip(columns).collect::<Vec<_>>() else { return findings };
        let beam = tail.theory.ok().map(|shedding| (Beam::new(), shedding));
        let highest = own.speeds.last().copied().unwrap_or(0.0);
        let theory = |share: f64| {
            let (beam, shedding) = beam.as_ref()?;
            Some(beam.critical(share, *shedding, highest / tail.unit)? * tail.unit)
        };
        let own_theory = theory(own.share);
        findings.answers.push(match own_column.critical {
            Some((0.0, outcome, _)) => format!(
                "With the water's share {:.4} in the inertia the tail does not stay at rest in still fluid already: {} of small motions about it.",
                own.share,
                outcome.category().label
            ),
            Some((speed, outcome, frequency)) => {
                let how = match outcome {
                    RestStability::Divergence => "small motions about that rest diverge".to_string(),
                    RestStability::NoRest => "no rest is found".to_string(),
                    _ => format!("small motions about that rest flutter, at {:.4} Hz", frequency / TAU),
                };
                format!(
                    "With the water's share {:.4} in the inertia the tail stays at rest in flows of up to {speed:.4} m/s (u = {:.4}); beyond, {how}.",
                    own.share,
                    speed / tail.unit
                )
            }
            None => format!(
                "With the water's share {:.4} in the inertia the tail stays at rest at all speeds that were looked at, the highest {highest:.4} m/s.",
                own.share
            ),
        });
        findings.answers.push(match (&tail.theory, own_theory) {
            (Ok(_), Some(speed)) => {
                format!("Theory of a beam without drag says {speed:.4} m/s (u = {:.4}).", speed / tail.unit)
            }
            (Ok(_), None) => {
                format!("Theory of a beam without drag has it stay at rest at all speeds up to {highest:.4} m/s.")
            }
            (Err(why), _) => format!("Theory's line is left out: {why}."),
        });
        if let Some((flow, point)) = &self.own {
            let omega = point.leading[1];
            let says = match point.outcome {
                RestStability::Stable => "they die out".to_string(),
                RestStability::Flutter => {
                    format!("they grow as flutter, at {:.4} Hz: the run will not stay there", omega / TAU)
                }
                RestStability::Divergence => "they diverge: the run will not stay there".to_string(),
                RestStability::NoRest => "no rest is found".to_string(),
            };
            findings
                .answers
                .push(format!("In the scene's own flow of {flow:.4} m/s, of small motions about the rest: {says}."));
        }
        if tail.is_reversed {
            findings.answers.push(
                "The flow comes against the free end, and a tail that leaves this rest may fold back and come to another one: what a run comes to, small motions do not say."
                    .into(),
            );
        }
        if scene.actuation.is_some() || scene.head.kind == HeadKind::Driven {
            findings
                .answers
                .push("Actuation and motion of the head are left out: the head is held where it starts.".into());
        }
        if self.nodes < scene.rod.nodes.get() {
            findings.answers.push(format!(
                "Computed on {} nodes instead of {}: the cost grows as the cube of their number.",
                self.nodes,
                scene.rod.nodes.get()
            ));
        }
        findings.numbers.insert("mass_ratio".into(), json!(own.share));
        findings.numbers.insert("unit_speed_m_s".into(), json!(tail.unit));
        let critical = own_column.critical;
        findings.numbers.insert("critical_speed_m_s".into(), json!(critical.map(|(speed, ..)| speed)));
        findings.numbers.insert("critical_frequency_hz".into(), json!(critical.map(|(.., omega)| omega / TAU)));
        findings.numbers.insert("critical_speed_by_theory_m_s".into(), json!(own_theory));
        let lines: Vec<(f64, Option<f64>)> = map.iter().map(|(case, _)| (case.share, theory(case.share))).collect();
        let boundary: Vec<(f64, f64)> = lines.iter().filter_map(|(share, speed)| Some((*share, (*speed)?))).collect();

        let index =
            |point: &FlutterPoint| RestStability::ALL.iter().position(|other| *other == point.outcome).unwrap_or(0);
        let cells = map.iter().map(|(_, column)| column.points.iter().map(index).collect()).collect();
        let figure = OutcomeMap {
            title: format!("{}: what the flow does to the tail", scene.name),
            x: ("mass ratio m_a/(m + m_a)".into(), map.iter().map(|(case, _)| case.share).collect()),
            linear: true,
            y: ("flow speed (m/s)".into(), map.first().map(|(case, _)| case.speeds.clone()).unwrap_or_default()),
            boundary: "theory, without drag".into(),
            categories: RestStability::ALL.map(RestStability::category).to_vec(),
            panels: vec![Panel { title: "small motions about the rest".into(), cells, boundary: boundary.clone() }],
        };
        let caption = "Where the tail stays at rest, flutters and diverges.";
        findings.figures.push(Figure::new("stability.svg", caption, figure.svg()));
        let speeds_of = |of: &dyn Fn(RestStability) -> bool| {
            let critical =
                map.iter().filter_map(|(case, column)| column.critical.map(|(speed, how, _)| (case.share, speed, how)));
            critical.filter(|(.., how)| of(*how)).map(|(share, speed, _)| (share, speed)).collect::<Vec<_>>()
        };
        let chart = Chart {
            title: format!("{}: critical speed of the flow", scene.name),
            x: "mass ratio m_a/(m + m_a)".into(),
            y: "flow speed (m/s)".into(),
            scale: Scale::Linear,
            series: [
                Series::new("flutter", speeds_of(&|how| how == RestStability::Flutter), Mark::Dotted),
                Series::new("divergence", speeds_of(&|how| how == RestStability::Divergence), Mark::Dotted),
                Series::new("theory, without drag", boundary, Mark::Line),
                Series::new(
                    "this scene",
                    critical.map(|(speed, ..)| (own.share, speed)).into_iter().collect(),
                    Mark::Dots,
                ),
            ]
            .into_iter()
            .filter(|series| !series.points.is_empty())
            .collect(),
        };
        let caption = "The speed from which the tail leaves its rest, by the share of the water in the inertia.";
        findings.figures.push(Figure::new("critical.svg", caption, chart.svg()));
        for (file, title, y, part, caption) in [
            (
                "growth.svg",
                "growth rates",
                "growth rate (1/s)",
                0,
                "How the slowest motions grow (above zero) or decay over the speed.",
            ),
            ("frequency.svg", "frequencies", "frequency (Hz)", 1, "How fast the slowest motions swing over the speed."),
        ] {
            let value = move |value: &[f64; 2]| if part == 0 { value[0] } else { value[1] / TAU };
            let points = own.speeds.iter().zip(&own_column.points);
            let dots = points.flat_map(|(speed, point)| point.slowest.iter().map(move |one| (*speed, value(one))));
            let mut series = vec![Series::new("slowest motions", dots.collect(), Mark::Dots)];
            if part == 0 {
                let fastest =
                    own.speeds.iter().zip(&own_column.points).map(|(speed, point)| (*speed, point.leading[0]));
                series.push(Series::new("fastest growing", fastest.collect(), Mark::Line));
            }
            let title = format!("{}: {title} of small motions", scene.name);
            let chart = Chart { title, x: "flow speed (m/s)".into(), y: y.into(), scale: Scale::Linear, series };
            findings.figures.push(Figure::new(file, caption, chart.svg()));
        }
        findings.tables.push(self.map_table(map));
        findings.tables.push(critical_table(tail, &lines, map));
        findings.tables.push(motions_table(own, own_column));
        findings
    }

    fn map_table(&self, map: &[(&SpeedScan, &ScanResult)]) -> Table {
        let rows = map.iter().flat_map(|(case, column)| {
            case.speeds.iter().zip(&column.points).map(|(speed, point)| {
                vec![
                    json!(case.share),
                    json!(speed),
                    json!(speed / self.tail.unit),
                    json!(point.outcome.category().label),
                    json!(point.leading[0]),
                    json!(point.leading[1] / TAU),
                ]
            })
        });
        Table {
            file: "stability.csv",
            title: "Map",
            columns: ["mass_ratio", "flow_m_s", "reduced_speed", "outcome", "growth_rate_1_s", "frequency_hz"]
                .map(str::to_string)
                .to_vec(),
            rows: rows.collect(),
        }
    }
}

fn critical_table(tail: &HeldTail, lines: &[(f64, Option<f64>)], map: &[(&SpeedScan, &ScanResult)]) -> Table {
    let rows = map.iter().zip(lines).map(|((case, column), (_, theory))| {
        let (speed, how, omega) = column.critical.map_or((None, None, None), |(a, b, c)| (Some(a), Some(b), Some(c)));
        vec![
            json!(case.share),
            json!(tail.factor(case.share)),
            json!(speed),
            json!(speed.map(|speed| speed / tail.unit)),
            how.map_or(Value::Null, |how| json!(how.category().label)),
            json!(omega.map(|omega| omega / TAU)),
            json!(theory),
        ]
    });
    Table {
        file: "critical.csv",
        title: "Critical speeds",
        columns: [
            "mass_ratio",
            "density_factor",
            "critical_flow_m_s",
            "reduced_speed",
            "outcome",
            "frequency_hz",
            "theory_flow_m_s",
        ]
        .map(str::to_string)
        .to_vec(),
        rows: rows.collect(),
    }
}

fn motions_table(own: &SpeedScan, column: &ScanResult) -> Table {
    let rows = own.speeds.iter().zip(&column.points).flat_map(|(speed, point)| {
        (1..).zip(&point.slowest).map(move |(i, [growth, omega])| {
            vec![json!(speed), json!(i), json!(growth), json!(omega / TAU), json!(-growth / growth.hypot(*omega))]
        })
    });
    Table {
        file: "motions.csv",
        title: "The slowest motions of the scene's tail",
        columns: ["flow_m_s", "motion", "growth_rate_1_s", "frequency_hz", "damping_ratio"]
            .map(str::to_string)
            .to_vec(),
        rows: rows.collect(),
    }
}
