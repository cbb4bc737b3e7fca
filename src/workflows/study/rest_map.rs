//! Stability of the equilibrium of a held tail over two parameters of its scene: the first is increased until stability
//! is lost, for several values of the second.

use std::cell::RefCell;
use std::f64::consts::TAU;

use faer::c64;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::root_search::{SAMPLES, first_rise};
use crate::linear_stability::{SteadyState, grows};
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::outcome_map::{Category, OutcomeMap, Panel};
use crate::report::{Figure, Findings, Table};
use crate::scene::{HeadKind, Scene};

/// Maximum number of nodes for eigenvalues: the cost grows as N³, and the error with this many is 0.1 %.
pub(super) const MAX_NODES: usize = 65;

/// Number of modes that are tracked.
const TRACKED_MODES: usize = 5;

/// Relative width of the interval to which a critical value is bisected.
const CRITICAL: f64 = 1e-5;

/// Stability of the equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum RestStability {
    Stable,
    Flutter,
    Divergence,
    NoRest,
}

impl RestStability {
    const ALL: [Self; 4] = [Self::Stable, Self::Flutter, Self::Divergence, Self::NoRest];

    pub fn category(self) -> Category {
        // With different lightness, so that they can be distinguished in greyscale prints, too.
        let (label, colour) = match self {
            Self::Stable => ("stays at rest", [158, 218, 190]),
            Self::Flutter => ("flutter", [235, 125, 40]),
            Self::Divergence => ("divergence", [125, 60, 160]),
            Self::NoRest => ("no rest found", [245, 245, 245]),
        };
        Category { label, colour, hatched: false }
    }
}

/// The small motions about the equilibrium of one scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct RestPoint {
    pub outcome: RestStability,
    /// σ (1/s) and ω (rad/s) of the fastest growing mode; if none grows, those of the least damped of the slowest modes.
    pub leading: [f64; 2],
    /// σ and ω of the slowest modes.
    pub slowest: Vec<[f64; 2]>,
}

impl RestPoint {
    const NONE: Self = Self { outcome: RestStability::NoRest, leading: [0.0; 2], slowest: Vec::new() };

    /// The result for `scene`, next to the positions of another equilibrium if given; also returns its own positions.
    pub fn of(scene: &Scene, near: Option<&[f64]>) -> (Self, Vec<f64>) {
        let none = (Self::NONE, Vec::new());
        let find = |model| match near {
            None => SteadyState::of(model),
            Some(positions) => SteadyState::near(model, positions),
        };
        let Ok(Ok(mut steady)) = scene.model().map(find) else { return none };
        let Ok(found) = steady.eigenvalues() else { return none };
        let positions = steady.positions().to_vec();
        let fastest = |values: &mut dyn Iterator<Item = c64>| values.max_by(|a, b| a.re.total_cmp(&b.re));
        let growing = found.iter().filter(|(value, uncertainty)| grows(*value, *uncertainty));
        let growing = fastest(&mut growing.map(|(value, _)| *value));
        let mut slowest: Vec<c64> = found.iter().map(|(value, _)| *value).collect();
        slowest.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
        slowest.truncate(TRACKED_MODES);
        let Some(leading) = growing.or_else(|| fastest(&mut slowest.iter().copied())) else { return none };
        let outcome = match growing {
            None => RestStability::Stable,
            Some(value) if value.im > 0.0 => RestStability::Flutter,
            Some(_) => RestStability::Divergence,
        };
        let slowest = slowest.iter().map(|value| [value.re, value.im]).collect();
        (Self { outcome, leading: [leading.re, leading.im], slowest }, positions)
    }

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

/// The critical point at which the equilibrium loses its stability.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Critical {
    /// The critical value; zero if the equilibrium is already unstable at zero.
    pub value: f64,
    /// The instability beyond it.
    pub outcome: RestStability,
    /// ω there, rad/s.
    pub frequency: f64,
}

impl Critical {
    /// Describes what happens there.
    pub fn in_words(&self) -> String {
        match self.outcome {
            RestStability::Divergence => "beyond that, it diverges".to_string(),
            RestStability::NoRest => "beyond that, no equilibrium is found".to_string(),
            _ => format!("beyond that, it flutters at {:.4} Hz", self.frequency / TAU),
        }
    }
}

/// The evaluation of increasing `values` of one parameter at one `place` of the other.
#[derive(Debug)]
pub(super) struct Scan {
    pub place: f64,
    pub values: Vec<f64>,
}

/// The results along a [`Scan`].
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Scanned {
    pub points: Vec<RestPoint>,
    pub critical: Option<Critical>,
}

impl Scan {
    /// Evaluates every value, and finds the critical one. Between distant values it evaluates additional ones, up to the first at
    /// which stability is lost. Each equilibrium is searched next to the stable one at the largest value before it, so that it is
    /// the equilibrium reached by increasing the value, and not another one.
    pub fn run(&self, find: impl Fn(f64, Option<&[f64]>) -> (RestPoint, Vec<f64>)) -> Scanned {
        let known: RefCell<Vec<(f64, Vec<f64>)>> = RefCell::default();
        let at = |value: f64| {
            let before =
                known.borrow().iter().filter(|rest| rest.0 <= value).max_by(|a, b| a.0.total_cmp(&b.0)).cloned();
            let near = before.map(|(_, positions)| positions);
            let (point, positions) = find(value, near.as_deref());
            if point.outcome == RestStability::Stable {
                known.borrow_mut().push((value, positions));
            }
            point
        };
        let points: Vec<RestPoint> = self.values.iter().map(|value| at(*value)).collect();
        let between = SAMPLES.div_ceil(self.values.len());
        let mut samples: Vec<(f64, f64)> = Vec::new();
        for (i, point) in points.iter().enumerate() {
            let (before, here) = (self.values[i.saturating_sub(1)], self.values[i]);
            let inner = (1..between).filter(|_| i > 0).map(|k| before + (here - before) * k as f64 / between as f64);
            samples.extend(inner.map(|value| (value, at(value).rise())));
            samples.push((here, point.rise()));
            if samples.iter().any(|(_, rise)| *rise > 0.0) {
                break;
            }
        }
        let left = first_rise(&samples, |value| at(value).rise());
        let critical = left.map(|[mut below, mut above]| {
            let mut then = at(above);
            if below == above {
                let still = at(0.0);
                if still.outcome != RestStability::Stable {
                    return Critical { value: 0.0, outcome: still.outcome, frequency: still.leading[1] };
                }
                below = 0.0;
            }
            while above - below > CRITICAL * above {
                let value = 0.5 * (below + above);
                let middle = at(value);
                if middle.outcome == RestStability::Stable {
                    below = value;
                } else {
                    above = value;
                    then = middle;
                }
            }
            Critical { value: 0.5 * (below + above), outcome: then.outcome, frequency: then.leading[1] }
        });
        Scanned { points, critical }
    }
}

impl Scanned {
    /// The first and the last of the evaluated `values` of each window beyond the critical one in which the equilibrium is stable
    /// again.
    pub fn calm_again(&self, values: &[f64]) -> Vec<[f64; 2]> {
        let critical = self.critical.map_or(f64::INFINITY, |critical| critical.value);
        let beyond: Vec<_> = values.iter().zip(&self.points).filter(|(value, _)| **value > critical).collect();
        let alike = beyond.chunk_by(|a, b| a.1.outcome == b.1.outcome);
        let stable = alike.filter(|window| window[0].1.outcome == RestStability::Stable);
        stable.map(|window| [*window[0].0, *window[window.len() - 1].0]).collect()
    }
}

/// Describes the windows of [`Scanned::calm_again`], with the unit of their ends; empty if there are none.
pub(super) fn calm_again_in_words(windows: &[[f64; 2]], unit: &str) -> String {
    let window = |[from, to]: &[f64; 2]| match from == to {
        true => format!("at {from:.4}{unit}"),
        false => format!("from {from:.4} to {to:.4}{unit}"),
    };
    let all: Vec<String> = windows.iter().map(window).collect();
    if all.is_empty() {
        String::new()
    } else {
        format!(" Among the larger values examined, it is stable again {}.", all.join(" and "))
    }
}

/// `count` numbers, evenly spaced from `low` to `high`.
pub(super) fn even([low, high]: [f64; 2], count: usize) -> impl Iterator<Item = f64> {
    let last = count.max(2) - 1;
    (0..=last).map(move |i| low + (high - low) * i as f64 / last as f64)
}

/// Warns of effects that the stability analysis of the equilibrium of `scene` on `nodes` nodes leaves out.
pub(super) fn left_out(scene: &Scene, nodes: usize, findings: &mut Findings) {
    if scene.actuation.is_some() || scene.head.kind == HeadKind::Driven {
        findings
            .answers
            .push("Actuation and motion of the head are left out: the head is held in its initial pose.".into());
    }
    if scene.head.kind == HeadKind::Hinged {
        findings.answers.push(
            "Changes of the command and of the torque of the hinge's motor are left out: the servo holds the initial angle.".into(),
        );
    }
    if nodes < scene.rod.nodes.get() {
        findings.answers.push(format!(
            "Computed on {nodes} nodes instead of {}: the cost grows with the cube of their number.",
            scene.rod.nodes.get()
        ));
    }
}

/// An additional column of a table: its name, and its entry at a place and a value.
pub(super) type ExtraColumn<'a> = (&'a str, &'a dyn Fn(f64, f64) -> Value);

/// The map of a scene, ready to be drawn.
pub(super) struct RestMap<'a> {
    /// Name of the scene.
    pub name: &'a str,
    /// The cause that acts on the tail, as in "what the flow does to the tail".
    pub cause: &'a str,
    /// The parameter on the first axis of the map: label of its axis, column of its table, and whether the axis is linear.
    pub place: (&'a str, &'a str, bool),
    /// The parameter along which the tail loses its stability: label and column.
    pub value: (&'a str, &'a str),
    /// The columns of the map.
    pub columns: Vec<(&'a Scan, &'a Scanned)>,
    /// The column of the scene itself.
    pub own: (&'a Scan, &'a Scanned),
    /// Position of the scene, if it is on the map.
    pub here: Option<(f64, f64)>,
    /// A theoretical line to compare the critical values with, and its label.
    pub line: (&'a str, Vec<(f64, f64)>),
}

impl RestMap<'_> {
    /// Adds figures and tables to `findings`; the tables of the map and of the critical values also have the `extra` columns.
    pub fn add(&self, findings: &mut Findings, extra: [&[ExtraColumn<'_>]; 2]) {
        let Self { columns, line, .. } = self;
        let index =
            |point: &RestPoint| RestStability::ALL.iter().position(|other| *other == point.outcome).unwrap_or(0);
        let cells = columns.iter().map(|(_, found)| found.points.iter().map(index).collect()).collect();
        let figure = OutcomeMap {
            title: format!("{}: what the {} does to the tail", self.name, self.cause),
            x: (self.place.0.into(), columns.iter().map(|(scan, _)| scan.place).collect()),
            linear: self.place.2,
            y: (self.value.0.into(), columns.first().map(|(scan, _)| scan.values.clone()).unwrap_or_default()),
            boundary: line.0.into(),
            categories: RestStability::ALL.map(RestStability::category).to_vec(),
            panels: vec![Panel { title: "stability of the equilibrium".into(), cells, boundary: line.1.clone() }],
        };
        let caption = "Where the tail stays at rest, flutters and diverges.";
        findings.figures.push(Figure::new("stability.svg", caption, figure.svg()));
        findings.figures.extend(self.critical_figure());
        findings.figures.extend(self.motion_figures());
        findings.tables.push(self.map_table(extra[0]));
        findings.tables.push(self.critical_table(extra[1]));
        findings.tables.push(self.motions_table());
    }

    /// The critical values; `None` if there are none to show.
    fn critical_figure(&self) -> Option<Figure> {
        let of = |outcome: RestStability| {
            let critical = self.columns.iter().filter_map(|(scan, found)| Some((scan.place, found.critical?)));
            let points = critical.filter(|(_, critical)| critical.outcome == outcome);
            points.map(|(place, critical)| (place, critical.value)).collect::<Vec<_>>()
        };
        let chart = Chart {
            title: format!("{}: critical {}", self.name, self.cause),
            x: self.place.0.into(),
            y: self.value.0.into(),
            scale: if self.place.2 { Scale::Linear } else { Scale::LogX },
            series: [
                Series::new("flutter", of(RestStability::Flutter), Mark::Dotted),
                Series::new("divergence", of(RestStability::Divergence), Mark::Dotted),
                Series::new(self.line.0, self.line.1.clone(), Mark::Line),
                Series::new("this scene", self.here.into_iter().collect(), Mark::Dots),
                Series::new("no rest found", of(RestStability::NoRest), Mark::Dotted),
            ]
            .to_vec(),
        };
        let found = self.columns.iter().filter(|(_, found)| found.critical.is_some()).count();
        let missing = match self.columns.len() - found {
            0 => String::new(),
            missing => format!(" None was found for {missing} of {} values.", self.columns.len()),
        };
        let caption = format!("The {} at which the tail loses its stability.{missing}", self.cause);
        (found > 0).then(|| chart.figure("critical.svg", caption)).flatten()
    }

    fn motion_figures(&self) -> impl Iterator<Item = Figure> {
        let (scan, found) = self.own;
        [
            (
                "growth.svg",
                "growth rates",
                "growth rate (1/s)",
                "Growth rates (negative: decay) of the slowest motions over the",
            ),
            ("frequency.svg", "frequencies", "frequency (Hz)", "Frequencies of the slowest motions over the"),
        ]
        .into_iter()
        .filter_map(move |(file, what, label, caption)| {
            let growth = file == "growth.svg";
            let of = |value: &[f64; 2]| if growth { value[0] } else { value[1] / TAU };
            let points = scan.values.iter().zip(&found.points);
            let dots = points.clone().flat_map(|(x, point)| point.slowest.iter().map(move |one| (*x, of(one))));
            let mut series = vec![Series::new("slowest motions", dots.collect(), Mark::Dots)];
            if growth {
                let fastest = points.map(|(x, point)| (*x, point.leading[0])).collect();
                series.push(Series::new("largest growth rate", fastest, Mark::Line));
            }
            let title = format!("{}: {what} of small motions", self.name);
            let chart = Chart { title, x: self.value.0.into(), y: label.into(), scale: Scale::Linear, series };
            chart.figure(file, format!("{caption} {}.", self.cause))
        })
    }

    fn map_table(&self, extra: &[ExtraColumn<'_>]) -> Table {
        let rows = self.columns.iter().flat_map(|(scan, found)| {
            scan.values.iter().zip(&found.points).map(|(value, point)| {
                let mut row = vec![json!(scan.place), json!(value)];
                row.extend(extra.iter().map(|(_, of)| of(scan.place, *value)));
                let [growth, omega] = point.leading;
                row.extend([json!(point.outcome.category().label), json!(growth), json!(omega / TAU)]);
                row
            })
        });
        let columns = [self.place.1, self.value.1].into_iter().chain(extra.iter().map(|(name, _)| *name));
        let columns = columns.chain(["outcome", "growth_rate_1_s", "frequency_hz"]);
        Table {
            file: "stability.csv",
            title: "Map",
            columns: columns.map(str::to_string).collect(),
            rows: rows.collect(),
        }
    }

    fn critical_table(&self, extra: &[ExtraColumn<'_>]) -> Table {
        let rows = self.columns.iter().map(|(scan, found)| {
            let critical = found.critical;
            let mut row = vec![json!(scan.place), json!(critical.map(|critical| critical.value))];
            row.extend(
                extra.iter().map(|(_, of)| of(scan.place, critical.map_or(f64::NAN, |critical| critical.value))),
            );
            row.push(critical.map_or(Value::Null, |critical| json!(critical.outcome.category().label)));
            row.push(json!(critical.map(|critical| critical.frequency / TAU)));
            row
        });
        let value = format!("critical_{}", self.value.1);
        let columns = [self.place.1, &value].into_iter().chain(extra.iter().map(|(name, _)| *name));
        let columns = columns.chain(["outcome", "frequency_hz"]);
        Table {
            file: "critical.csv",
            title: "Critical values",
            columns: columns.map(str::to_string).collect(),
            rows: rows.collect(),
        }
    }

    fn motions_table(&self) -> Table {
        let (scan, found) = self.own;
        let rows = scan.values.iter().zip(&found.points).flat_map(|(value, point)| {
            (1..).zip(&point.slowest).map(move |(i, [growth, omega])| {
                vec![json!(value), json!(i), json!(growth), json!(omega / TAU), json!(-growth / growth.hypot(*omega))]
            })
        });
        Table {
            file: "motions.csv",
            title: "The slowest motions of the scene's tail",
            columns: [self.value.1, "motion", "growth_rate_1_s", "frequency_hz", "damping_ratio"]
                .map(str::to_string)
                .to_vec(),
            rows: rows.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_in_which_a_rest_is_calm_again_are_named() {
        use RestStability::{Divergence, Flutter, Stable};
        let point = |outcome| RestPoint { outcome, ..RestPoint::NONE };
        let outcomes = [Stable, Flutter, Stable, Stable, Divergence, Flutter, Stable];
        let critical = Critical { value: 1.5, outcome: Flutter, frequency: TAU };
        let mut found = Scanned { points: outcomes.map(point).to_vec(), critical: Some(critical) };
        let values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let windows = found.calm_again(&values);
        assert_eq!(windows, [[3.0, 4.0], [7.0, 7.0]]);
        let words = calm_again_in_words(&windows, " m/s");
        assert!(words.ends_with("it is stable again from 3.0000 to 4.0000 m/s and at 7.0000 m/s."), "{words}");
        found.critical = None;
        assert_eq!(calm_again_in_words(&found.calm_again(&values), ""), "");
    }

    #[test]
    fn a_rest_rises_by_minus_the_damping_ratio_of_its_least_damped_swing() {
        let point = |slowest: &[[f64; 2]]| RestPoint {
            outcome: RestStability::Stable,
            leading: [0.0; 2],
            slowest: slowest.to_vec(),
        };
        // x″ + 2ζΩ x′ + Ω² x = 0 has the eigenvalues −ζΩ ± iΩ√(1 − ζ²), however slow it is.
        for (unit, zeta) in
            [1e-3, 1.0, 1e3].into_iter().flat_map(|unit| [0.0, 1e-6, 0.03, 0.6].map(|zeta| (unit, zeta)))
        {
            let swing = |zeta: f64, omega: f64| [-zeta * omega, omega * (1.0 - zeta * zeta).sqrt()];
            let others = [[-unit, 0.0], swing(0.7, 2.0 * unit), swing(zeta, 3.0 * unit), swing(0.9, 4.0 * unit)];
            let rise = point(&others).rise();
            assert!((rise + zeta).abs() < 1e-15 && rise < 0.0, "{unit} {zeta}: {rise}");
        }
        assert_eq!(point(&[[-1.0, 0.0]]).rise(), -1.0); // nothing oscillates
        for outcome in RestStability::ALL.into_iter().filter(|outcome| *outcome != RestStability::Stable) {
            assert_eq!(RestPoint { outcome, ..point(&[[0.1, 1.0]]) }.rise(), 1.0);
        }
    }
}
