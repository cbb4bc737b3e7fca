//! `caudal study stability --vary flow`: where a tail that is held in a flow stays straight, flutters or diverges, over the speed
//! of the flow and the mass of the tail, from the eigenvalues of small motions about its rest, beside theory's line.

use std::f64::consts::TAU;

use faer::c64;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::beam::Beam;
use super::stability::{Stability, spread};
use super::{Desk, Studied};
use crate::error::{Error, Result};
use crate::jobs;
use crate::linear_stability::{NoSteadyState, SteadyState, grows};
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::map::{Category, Map, Panel};
use crate::report::{Figure, Findings, Table};
use crate::scene::{HeadKind, Scene};

/// Most nodes that eigenvalues are computed for: their cost grows as N³, and the error at so many is 0.1 %.
const NODES: usize = 65;

/// Smallest and largest share of the water in the inertia, β.
const SHARES: [f64; 2] = [0.05, 0.95];

/// Smallest and largest speed where none are asked for, in units of √(EI/m_a)/L.
const SPEEDS: [f64; 2] = [1.0, 20.0];

/// Part of the length up to which a rest is straight, of EI/L² up to which loads along it are none, and up to which stretched
/// edges are alike.
const STRAIGHT: f64 = 1e-2;

/// Motions whose growth and frequency are followed over the speed.
const FOLLOWED: usize = 5;

/// Speeds at which they are, for every one of the map.
const FINER: usize = 4;

/// Intervals in which a first speed is looked for, and halvings of the one where it is.
const LOOKS: usize = 60;
const HALVINGS: usize = 30;

/// Looks for the top of a narrow peak between samples.
const CLIMBS: usize = 24;

/// The golden section.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Two neighbours between which `f` first rises above zero, after `samples` (x, f(x)) with rising x: where it peaks between samples
/// below zero, the top of the peak is looked for.
fn first_rise(samples: &[(f64, f64)], mut f: impl FnMut(f64) -> f64) -> Option<[f64; 2]> {
    for i in 0..samples.len() {
        let (x, here) = samples[i];
        if here > 0.0 {
            return Some([if i == 0 { x } else { samples[i - 1].0 }, x]);
        }
        let Some(((from, before), (to, after))) = i.checked_sub(1).map(|i| samples[i]).zip(samples.get(i + 1).copied())
        else {
            continue;
        };
        if after > 0.0 || here <= before || here < after {
            continue;
        }
        // The golden section: the inner one of two places that is higher stays inside.
        let (mut low, mut high) = (from, to);
        let mut places = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
        let mut heights = places.map(&mut f);
        for _ in 0..CLIMBS {
            if let Some(top) = (0..2).find(|i| heights[*i] > 0.0) {
                return Some([from, places[top]]);
            }
            if heights[0] > heights[1] {
                high = places[1];
                places = [high - GOLDEN * (high - low), places[0]];
                heights = [f(places[0]), heights[0]];
            } else {
                low = places[0];
                places = [places[1], low + GOLDEN * (high - low)];
                heights = [heights[1], f(places[1])];
            }
        }
    }
    None
}

/// The first x between `low` and `high` from which `f` is above zero.
pub(super) fn first(low: f64, high: f64, mut f: impl FnMut(f64) -> f64) -> Option<f64> {
    let at = |i: usize| low + (high - low) * i as f64 / LOOKS as f64;
    let mut samples = Vec::with_capacity(LOOKS);
    // Beyond the first place that is above it there is nothing to look for.
    for x in (1..=LOOKS).map(at) {
        let here = f(x);
        samples.push((x, here));
        if here > 0.0 {
            break;
        }
    }
    let [mut below, mut above] = first_rise(&samples, &mut f)?;
    if below == above {
        below = low;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (below + above);
        if f(middle) > 0.0 { above = middle } else { below = middle }
    }
    Some(0.5 * (below + above))
}

/// What becomes of the rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Outcome {
    Stable,
    Flutter,
    Divergence,
    NoRest,
}

impl Outcome {
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

/// One mass of the rod, over speeds of the flow.
#[derive(Debug)]
struct Case {
    share: f64,
    speeds: Vec<f64>,
    /// Also where it first leaves its rest.
    critical: bool,
}

/// What is found at a speed.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Point {
    outcome: Outcome,
    /// σ (1/s) and ω (rad/s) of the motion that grows fastest.
    leading: [f64; 2],
    /// Those of the slowest motions.
    slowest: Vec<[f64; 2]>,
}

impl Point {
    /// Above zero where the rest is left; below, how little of its size the least damped oscillation loses, less than none.
    fn rise(&self) -> f64 {
        if self.outcome != Outcome::Stable {
            return 1.0;
        }
        let swinging = self.slowest.iter().filter(|[_, omega]| *omega > 0.0);
        let least = swinging.map(|[growth, omega]| growth / growth.hypot(*omega)).fold(-1.0, f64::max);
        least.min(-f64::MIN_POSITIVE)
    }
}

/// What is found of a mass.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Column {
    points: Vec<Point>,
    /// The first speed (m/s) at which the rest is left, how, and ω (rad/s) there.
    critical: Option<(f64, Outcome, f64)>,
}

/// What the tail is like, and what theory measures it by.
struct Tail {
    /// Direction of the flow.
    direction: [f64; 2],
    /// The flow comes against the free end.
    is_reversed: bool,
    /// Mass of the rod and of the water that goes with it across, kg.
    masses: [f64; 2],
    /// √(EI/m_a)/L, m/s.
    unit: f64,
    /// Share χ of the wake, where theory has this rod; else why it has not.
    theory: std::result::Result<f64, &'static str>,
}

impl Tail {
    fn share(&self) -> f64 {
        self.masses[1] / (self.masses[0] + self.masses[1])
    }

    /// The factor on the rod's density that gives the water the share β.
    fn factor(&self, share: f64) -> f64 {
        self.masses[1] * (1.0 - share) / (share * self.masses[0])
    }
}

/// What the tail of `scene` is like, by its rest.
fn tail(scene: &Scene, steady: &mut SteadyState) -> std::result::Result<Tail, NoSteadyState> {
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
    let alike = |values: &[f64]| values.iter().all(|value| (value / values[0] - 1.0).abs() < STRAIGHT);
    let inner = 1..rod.nodes - 1;
    let uniform = alike(&rod.joint[inner.clone()]) && alike(&rod.mass[inner.clone()]) && alike(&added[inner]);
    let is_reversed = direction[0] * along[0] + direction[1] * along[1] < 0.0;
    let aligned = (direction[0] - along[0]).hypot(direction[1] - along[1]) < 1e-9;
    let load: f64 = (0..rod.nodes).map(|k| steady.load(k).dot(&nalgebra::Vector2::from(along)).abs()).sum();
    let tensioned = load * rod.length * rod.length > STRAIGHT * rod.ei || bend > STRAIGHT * rod.length;
    let theory = match (uniform, aligned, tensioned) {
        (false, ..) => Err("it is for a rod that is the same all along"),
        (_, false, _) => Err("it is for a flow along the rod, from its head"),
        (.., true) => Err("it is for a straight rod without loads along it"),
        _ => Ok(reactive.shedding.get()),
    };
    Ok(Tail { direction, is_reversed, masses, unit, theory })
}

/// The tail in a flow of that speed (m/s), with that factor on its density.
fn point(scene: &Scene, tail: &Tail, factor: f64, speed: f64) -> Point {
    let none = Point { outcome: Outcome::NoRest, leading: [0.0; 2], slowest: Vec::new() };
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
        None => Outcome::Stable,
        Some(value) if value.im > 0.0 => Outcome::Flutter,
        Some(_) => Outcome::Divergence,
    };
    let slowest = values.iter().take(FOLLOWED).map(|value| [value.re, value.im]).collect();
    Point { outcome, leading: [leading.re, leading.im], slowest }
}

/// Maps flutter and divergence of the tail of `scene`.
pub(super) fn flutter(scene: &Scene, asked: &Stability, desk: Desk<'_>) -> Result<Studied> {
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
    let coarse = if nodes > NODES { own.with_nodes(NODES as u64) } else { own };
    let model = coarse.model()?;
    let own_speed = model.fluid.flow.norm();
    let mut steady = SteadyState::of(model).map_err(refused)?;
    let tail = tail(&coarse, &mut steady).map_err(refused)?;
    let range = asked.range.unwrap_or(SPEEDS.map(|speed| speed * tail.unit));
    let speeds = spread(range, asked.points);
    let even = |[low, high]: [f64; 2], count: usize| {
        let last = count.max(2) - 1;
        (0..=last).map(move |i| low + (high - low) * i as f64 / last as f64)
    };
    let finer = even(range, FINER * asked.points).collect();
    let shares: Vec<f64> = even(SHARES, asked.points).collect();
    let mut cases = vec![Case { share: tail.share(), speeds: finer, critical: true }];
    cases.extend(shares.iter().map(|share| Case { share: *share, speeds: speeds.clone(), critical: true }));
    let run = |case: &Case| {
        let factor = tail.factor(case.share);
        let at = |speed: f64| point(&coarse, &tail, factor, speed);
        let points: Vec<Point> = case.speeds.iter().map(|speed| at(*speed)).collect();
        // Between speeds that are far apart, others are looked at, up to the first that leaves the rest.
        let between = LOOKS.div_ceil(case.speeds.len());
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
                if still.outcome != Outcome::Stable {
                    return (0.0, still.outcome, still.leading[1]);
                }
                below = 0.0;
            }
            while above - below > 1e-5 * above {
                let middle = at(0.5 * (below + above));
                if middle.outcome == Outcome::Stable {
                    below = 0.5 * (below + above);
                } else {
                    above = 0.5 * (below + above);
                    then = middle;
                }
            }
            (0.5 * (below + above), then.outcome, then.leading[1])
        });
        Some(Column { points, critical })
    };
    let columns = match desk.work("flutter", scene, &cases, jobs::cores(), run)? {
        Ok(columns) => columns,
        Err(interrupted) => return Ok(interrupted),
    };
    let own = (own_speed > 0.0).then(|| (own_speed, point(&coarse, &tail, 1.0, own_speed)));
    let report = Report { scene, tail: &tail, own, nodes: coarse.rod.nodes.get(), cases: &cases, columns };
    Ok(Studied::Complete(report.findings()))
}

struct Report<'a> {
    scene: &'a Scene,
    tail: &'a Tail,
    /// The scene's own flow (m/s), and what is found there.
    own: Option<(f64, Point)>,
    nodes: usize,
    cases: &'a [Case],
    columns: Vec<Column>,
}

impl Report<'_> {
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
                    Outcome::Divergence => "small motions about that rest diverge".to_string(),
                    Outcome::NoRest => "no rest is found".to_string(),
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
                Outcome::Stable => "they die out".to_string(),
                Outcome::Flutter => {
                    format!("they grow as flutter, at {:.4} Hz: the run will not stay there", omega / TAU)
                }
                Outcome::Divergence => "they diverge: the run will not stay there".to_string(),
                Outcome::NoRest => "no rest is found".to_string(),
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

        let index = |point: &Point| Outcome::ALL.iter().position(|other| *other == point.outcome).unwrap_or(0);
        let cells = map.iter().map(|(_, column)| column.points.iter().map(index).collect()).collect();
        let figure = Map {
            title: format!("{}: what the flow does to the tail", scene.name),
            x: ("mass ratio m_a/(m + m_a)".into(), map.iter().map(|(case, _)| case.share).collect()),
            linear: true,
            y: ("flow speed (m/s)".into(), map.first().map(|(case, _)| case.speeds.clone()).unwrap_or_default()),
            boundary: "theory, without drag".into(),
            categories: Outcome::ALL.map(Outcome::category).to_vec(),
            panels: vec![Panel { title: "small motions about the rest".into(), cells, boundary: boundary.clone() }],
        };
        let caption = "Where the tail stays at rest, flutters and diverges.";
        findings.figures.push(Figure::new("stability.svg", caption, figure.svg()));
        let speeds_of = |of: &dyn Fn(Outcome) -> bool| {
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
                Series::new("flutter", speeds_of(&|how| how == Outcome::Flutter), Mark::Dotted),
                Series::new("divergence", speeds_of(&|how| how == Outcome::Divergence), Mark::Dotted),
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

    fn map_table(&self, map: &[(&Case, &Column)]) -> Table {
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

fn critical_table(tail: &Tail, lines: &[(f64, Option<f64>)], map: &[(&Case, &Column)]) -> Table {
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

fn motions_table(own: &Case, column: &Column) -> Table {
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
