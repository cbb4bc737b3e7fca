//! Figures and tables of a design, and the animation before and after.

use serde_json::{Value, json};

use super::design_vector::BASELINE;
use super::explanations::joint_verdict;
use super::identify::Identifiability;
use super::markers::distances;
use super::scenarios::ScenarioResult;
use super::search::EstimatedNumber;
use super::solve::{ALONE, Answer, ComparedProfile, Design, DesignMotion};
use super::stl;
use super::table::{DesignVariable, Goal};
use crate::cycle::MEASURES;
use crate::error::Result;
use crate::report::chart::{Chart, Mark, SERIES, Scale, Series};
use crate::report::{Animation, Figure, Findings, Table};
use crate::rod::Rod;
use crate::sensitivity::Trajectory;

/// The colour of the scene's own.
const GREY: usize = 6;

/// Number of shapes drawn over the last cycle.
const SHAPES: usize = 9;

/// Stations of a drawn body.
const STATIONS: usize = 100;

/// Points of a curve.
const POINTS: usize = 600;

type Drawn = (&'static str, Chart);

impl Design {
    /// The content of the design's page.
    pub(super) fn findings(&self) -> Result<Findings> {
        let rod = self.scene.model()?.rod;
        let mut figures = vec![self.profile_figure(&rod)];
        figures.extend(self.body_figure(&rod)?);
        figures.extend(self.actuation_figures(&rod));
        figures.extend(self.numbers_figure());
        figures.extend(self.front_figure());
        figures.extend(self.cases_figure());
        figures.extend(self.goal_figures());
        figures.extend(self.cycle_figures());
        figures.extend(self.search_figures());
        let figures = figures.into_iter().map(|(name, chart)| Figure::of_chart(name, caption(name), &chart));
        Ok(Findings {
            subject: match self.table.goal {
                Goal::Identify if self.table.is_searched() => "identified by simulation",
                Goal::Identify => "identified stiffness",
                Goal::StaticShape => "design for a shape at rest",
                Goal::TrackTip => "design for a tracked tip",
                Goal::Distance => "design for distance",
                Goal::Efficiency => "design for efficiency",
                Goal::Cycle(_) => "design for a mean over cycles",
            },
            answers: self.answers(),
            figures: figures.collect(),
            tables: self.tables(&rod)?,
            motion: self.motion().map(Box::new),
            ..Findings::default()
        })
    }

    /// The answers at the top of the page.
    fn answers(&self) -> Vec<String> {
        // Statements that question the answer come first.
        let mut answers = vec![format!("Status: {}.", self.status())];
        let warnings = self.evidence.numbers.get("warnings").and_then(Value::as_array);
        answers.extend(warnings.into_iter().flatten().filter_map(Value::as_str).map(|text| format!("Note: {text}")));
        answers.extend(self.lines.iter().cloned());
        if self.table.goal == Goal::Efficiency {
            let direction = self.table.direction.as_deref().unwrap_or("+x");
            answers.push(format!(
                "The objective is D|D|/W: D is the displacement of the centre of mass along {direction} from the start to the end, and W \
                 the work of the actuation. With linear drag it is a constant times the efficiency."
            ));
        }
        let number = |key: &str| self.evidence.numbers.get(key).and_then(Value::as_f64);
        if let (Some(sperm), Some(inertia)) = (number("sperm_number"), number("inertia_ratio")) {
            let mut text = format!("Sperm number Sp = {sperm:.3}, inertia against drag β = {inertia:.3}");
            if let Some(ratio) = number("frequency_ratio") {
                text += &format!(", ω/ω₁ = {ratio:.3}");
            }
            answers.push(text + ": scenes of the same form and with the same of these have the same answer.");
        }
        answers
    }

    fn chart(&self, title: &str, x: &str, y: &str, scale: Scale, series: Vec<Series>) -> Chart {
        Chart::new(format!("{}: {title}", self.scene.name), x, y, scale, series)
    }

    /// In all figures, lines of the design have the first colour and dash pattern, and lines of the scene's own are grey, as in the
    /// animation.
    fn designed(&self, points: Vec<(f64, f64)>, mark: Mark) -> Series {
        Series::new(self.after(), points, mark).coloured(0)
    }

    fn own(points: Vec<(f64, f64)>, mark: Mark) -> Series {
        Series::new(BASELINE, points, mark).coloured(GREY)
    }

    /// The lines of both the scene's own and the design, in this order.
    fn own_and_designed<T>(&self, of: [T; 2], points: impl Fn(T) -> Vec<(f64, f64)>) -> Vec<Series> {
        let [own, designed] = of.map(points);
        vec![Self::own(own, Mark::Line), self.designed(designed, Mark::Line)]
    }

    fn after(&self) -> &'static str {
        if self.table.goal == Goal::Identify { "identified" } else { "design" }
    }

    fn profile_figure(&self, rod: &Rod) -> Drawn {
        let xi: Vec<f64> = rod.joints().map(|k| rod.xi(k)).collect();
        let line = |values: &[f64]| xi.iter().copied().zip(values.iter().map(|ei| ei / rod.ei)).collect::<Vec<_>>();
        let own: Vec<f64> = rod.joints().map(|k| rod.joint_stiffness(k)).collect();
        let highest = self.stiffness.iter().fold(0.0, |max: f64, ei| max.max(ei / rod.ei));
        let deviations: Vec<f64> = match &self.answer {
            Answer::Identification(found) => found.joints.iter().map(|joint| joint.deviation_n_m2 / rod.ei).collect(),
            Answer::Search(found) => {
                found.deviations.iter().zip(&self.stiffness).map(|(d, ei)| d * ei / rod.ei).collect()
            }
            Answer::StaticShape(_) => Vec::new(),
        };
        let mut series = Vec::new();
        for ((x, ei), by) in line(&self.stiffness).into_iter().zip(&deviations) {
            let (low, high) = ((ei - by).max(0.0), (ei + by).min(2.0 * highest));
            series.push(Series::new("", vec![(x, low), (x, high)], Mark::Ghost));
        }
        series.push(self.designed(line(&self.stiffness), Mark::Dotted));
        // Profiles with one part of the design have a stiffness that is already drawn.
        let is_drawn = |other: &&ComparedProfile| other.name != "design" && !other.name.starts_with(ALONE);
        let others = self.evidence.profiles.iter().filter(is_drawn);
        let others: Vec<&ComparedProfile> = others.collect();
        if others.is_empty() {
            series.push(Self::own(line(&own), Mark::Line));
        }
        let mut next = (0..).map(of_another);
        for other in others {
            let points = line(&other.profile.stiffness_n_m2);
            series.push(match other.name == BASELINE {
                true => Self::own(points, Mark::Line),
                false => Series::new(&other.name, points, Mark::Line).coloured(next.next().unwrap_or(1)),
            });
        }
        for (bound, label) in self.table.bounds.into_iter().zip(["least", "largest"]) {
            if bound <= 3.0 * highest {
                let points = vec![(xi[0], bound), (xi[xi.len() - 1], bound)];
                series.push(Series::new(label, points, Mark::Line).coloured(next.next().unwrap_or(1)));
            }
        }
        // Longer titles are cut.
        let title = if deviations.is_empty() { "stiffness along the rod" } else { "stiffness ± one deviation" };
        ("profile.svg", self.chart(title, "s/L", "EI over the largest EI of the sections", Scale::Linear, series))
    }

    /// Side view of the straight rod, before above its middle and after below it, with a stroke at each joint in proportion to its
    /// stiffness.
    fn body_figure(&self, rod: &Rod) -> Result<Option<Drawn>> {
        if !matches!(self.answer, Answer::Search(_)) || self.table.fits_positions() {
            return Ok(None);
        }
        let after = self.designed.scene()?.model()?.rod;
        let depth = |rod: &Rod, xi: f64| 0.5 * rod.sections.depth_at(xi);
        let places: Vec<f64> = (0..=STATIONS).map(|i| i as f64 / STATIONS as f64).collect();
        let own: Vec<f64> = rod.joints().map(|k| rod.joint_stiffness(k)).collect();
        let stiffest = own.iter().chain(&self.stiffness).copied().fold(f64::MIN_POSITIVE, f64::max);
        let mut series = Vec::new();
        for (designed, rod, stiffness, sign) in [(false, rod, &own, 1.0), (true, &after, &self.stiffness, -1.0)] {
            for (k, ei) in rod.joints().zip(stiffness) {
                let (x, size) = (rod.xi(k) * rod.length, depth(rod, rod.xi(k)) * ei / stiffest);
                series.push(Series::new("", vec![(x, 0.0), (x, sign * size)], Mark::Ghost));
            }
            let side = places.iter().map(|xi| (xi * rod.length, sign * depth(rod, *xi)));
            let middle = [(rod.length, 0.0), (0.0, 0.0)];
            let mut outline: Vec<(f64, f64)> = side.chain(middle).collect();
            outline.extend(outline.first().copied());
            series.push(if designed { self.designed(outline, Mark::Line) } else { Self::own(outline, Mark::Line) });
        }
        Ok(Some((
            "body.svg",
            self.chart("the body from its side", "s (m)", "across the plane (m)", Scale::Linear, series),
        )))
    }

    fn actuation_figures(&self, rod: &Rod) -> Vec<Drawn> {
        let Answer::Search(found) = &self.answer else { return Vec::new() };
        let line = |values: &[f64]| {
            let xi = rod.joints().map(|k| rod.xi(k));
            xi.zip(values.iter().copied()).collect::<Vec<_>>()
        };
        let mut figures = Vec::new();
        for (variable, file, title, y, values) in [
            (
                DesignVariable::Amplitude,
                "amplitude.svg",
                "amplitude of the actuation",
                "amplitude over the scene's",
                &found.profile.amplitude,
            ),
            (
                DesignVariable::Phase,
                "phase.svg",
                "phase of the actuation",
                "phase subtracted (rad)",
                &found.profile.phase_rad,
            ),
        ] {
            if self.table.variables.contains(&variable) {
                let own = if variable == DesignVariable::Amplitude { 1.0 } else { 0.0 };
                let series = vec![
                    self.designed(line(values), Mark::Dotted),
                    Self::own(line(&vec![own; values.len()]), Mark::Line),
                ];
                figures.push((file, self.chart(title, "s/L", y, Scale::Linear, series)));
            }
        }
        figures
    }

    /// The estimated numbers of the scene, with their deviations.
    fn numbers_figure(&self) -> Option<Drawn> {
        let Answer::Search(found) = &self.answer else { return None };
        if found.numbers.is_empty() {
            return None;
        }
        let value = |number: &EstimatedNumber| number.value / number.own;
        let largest = found.numbers.iter().map(value).fold(1.0, f64::max);
        let mut series = Vec::new();
        for (i, number) in found.numbers.iter().enumerate() {
            let (x, deviation) = (1.0 + i as f64, number.deviation.map_or(f64::INFINITY, |d| (d / number.own).abs()));
            if self.table.fits_positions() {
                let (low, high) =
                    ((value(number) - deviation).max(0.0), (value(number) + deviation).min(2.0 * largest));
                series.push(Series::new("", vec![(x, low), (x, high)], Mark::Ghost));
            }
            let role = if i == 0 { 0 } else { of_another(i - 1) };
            series.push(Series::new(&number.key, vec![(x, value(number))], Mark::Dots).coloured(role));
        }
        let ends = [0.5, 0.5 + found.numbers.len() as f64];
        series.push(Self::own(ends.map(|x| (x, 1.0)).into(), Mark::Line));
        series.push(Series::new("", vec![(ends[0], 0.0)], Mark::Unseen));
        Some((
            "numbers.svg",
            self.chart("numbers of the scene", "number in its order", "over the scene's", Scale::Linear, series),
        ))
    }

    /// The Pareto front.
    fn front_figure(&self) -> Option<Drawn> {
        let (Some(wanted), [_, ..]) = (&self.table.front, &self.evidence.front[..]) else { return None };
        let points = |best: bool| {
            let chosen = self.evidence.front.iter().filter(|point| point.best == best);
            chosen.map(|point| (point.second, point.first)).collect::<Vec<_>>()
        };
        let mut series = vec![Series::new("front", points(true), Mark::Dotted)];
        series.extend((!points(false).is_empty()).then(|| Series::new("worse than others", points(false), Mark::Dots)));
        let [x, y] = [wanted.goal, self.table.goal].map(axis_label);
        Some(("front.svg", self.chart("designs between two goals", &x, &y, Scale::Linear, series)))
    }

    /// The objective in each scenario.
    fn cases_figure(&self) -> Option<Drawn> {
        let cases = &self.evidence.cases;
        if cases.is_empty() {
            return None;
        }
        // Cases have no order, so they are drawn as bars.
        let bars = |of: fn(&ScenarioResult) -> Option<f64>| {
            let values = cases.iter().enumerate().filter_map(|(i, case)| Some((i as f64, of(case)?)));
            values.collect::<Vec<_>>()
        };
        let series = vec![
            Self::own(bars(|case| case.before), Mark::Line),
            self.designed(bars(|case| case.designed), Mark::Line),
        ];
        let numbers = (1..=cases.len()).map(|number| number.to_string()).collect();
        let y = axis_label(self.table.goal);
        Some(("cases.svg", self.chart("every case", "number of the case", &y, Scale::Categories(numbers), series)))
    }

    /// The goal over time: tip and target, distance, or markers.
    fn goal_figures(&self) -> Vec<Drawn> {
        let mut figures = Vec::new();
        let target = self.evidence.target.as_ref();
        if let (Goal::StaticShape, Some(target)) = (self.table.goal, target) {
            let points = target.positions[0].as_chunks::<2>().0.iter().map(|p| (p[0], p[1])).collect();
            let series = vec![Series::new("target", points, Mark::Dotted)];
            figures.push(("shape.svg", self.chart("shape at rest", "x (m)", "y (m)", Scale::Equal, series)));
        }
        let [before, after] = &self.evidence.motions[..] else { return figures };
        let both = [before, after];
        if let (Goal::TrackTip | Goal::Identify, Some(target)) = (self.table.goal, target) {
            for (axis, file, title, y) in
                [(0, "tip_x.svg", "the tip, x", "x of the tip (m)"), (1, "tip_y.svg", "the tip, y", "y of the tip (m)")]
            {
                let own = |q: &[f64]| q[q.len() - 2 + axis];
                let points: Vec<(f64, f64)> =
                    target.times.iter().zip(&target.positions).map(|(t, q)| (*t, own(q))).collect();
                let label = if self.table.goal == Goal::Identify { "markers" } else { "target" };
                let mut series = vec![Series::new(label, thinned(points, 120), Mark::Dots).coloured(2)];
                series.extend(self.own_and_designed(both, |motion| curve(&motion.trajectory, own)));
                figures.push((file, self.chart(title, "time (s)", y, Scale::Linear, series)));
            }
            let error = |motion: &Trajectory| -> Vec<(f64, f64)> {
                match self.table.goal {
                    Goal::Identify => {
                        let all = distances(motion, target, (1, 0)).unwrap_or_default();
                        target.times.iter().copied().zip(all).collect()
                    }
                    _ => {
                        let of = |(t, q): (&f64, &Vec<f64>)| {
                            let at = motion.at(*t)?;
                            let (i, j) = (at.len(), q.len());
                            Some((*t, (at[i - 2] - q[j - 2]).hypot(at[i - 1] - q[j - 1])))
                        };
                        target.times.iter().zip(&target.positions).filter_map(of).collect()
                    }
                }
            };
            let (title, y) = if self.table.goal == Goal::Identify {
                ("distance of the rod from the markers", "root mean square over the nodes (m)")
            } else {
                ("distance of the tip from its target", "distance (m)")
            };
            let series = self.own_and_designed(both, |motion| thinned(error(&motion.trajectory), POINTS));
            figures.push((
                "error.svg",
                self.chart(
                    title,
                    "time (s)",
                    y,
                    Scale::LogY(if self.table.goal == Goal::Identify { 4 } else { 8 }),
                    series,
                ),
            ));
        } else {
            let series = self.own_and_designed(both, |DesignMotion { trajectory: motion, rod, .. }| {
                let start = rod.mean(motion.positions(0)).x;
                curve(motion, |q| rod.mean(q).x - start)
            });
            let y = "x − x at the start (m)";
            let chart = self.chart("path of the centre of mass", "time (s)", y, Scale::Linear, series);
            figures.push(("way.svg", chart));
        }
        figures
    }

    /// The shapes of the last cycle before and after, with equal axes.
    fn cycle_figures(&self) -> Vec<Drawn> {
        let [before, after] = &self.evidence.motions[..] else { return Vec::new() };
        let all = [self.shapes(&before.trajectory, GREY), self.shapes(&after.trajectory, 0)];
        let extent: Vec<(f64, f64)> = all.iter().flatten().flat_map(|series| series.points.iter().copied()).collect();
        let what = if self.scene.actuation.is_some() { "last cycle" } else { "the whole time" };
        let files = [("before.svg", format!("{what}, {BASELINE}")), ("after.svg", format!("{what}, {}", self.after()))];
        let figure = |((file, title), mut series): ((&'static str, String), Vec<Series>)| {
            series.push(Series::new("", extent.clone(), Mark::Unseen));
            (file, self.chart(&title, "x (m)", "y (m)", Scale::Equal, series))
        };
        files.into_iter().zip(all).map(figure).collect()
    }

    fn shapes(&self, trajectory: &Trajectory, colour: usize) -> Vec<Series> {
        let last = trajectory.times.len() - 1;
        let period = self.scene.actuation.as_ref().map(|a| 1.0 / a.frequency_hz.get()).filter(|p| p.is_finite());
        let start = period.map_or(0.0, |period| trajectory.times[last] - period);
        let first = trajectory.times.partition_point(|t| *t < start).min(last);
        let points =
            |n: usize| trajectory.positions(n).as_chunks::<2>().0.iter().map(|p| (p[0], p[1])).collect::<Vec<_>>();
        let mut series: Vec<Series> =
            (0..SHAPES).map(|i| Series::new("", points(first + (last - first) * i / SHAPES), Mark::Ghost)).collect();
        series.push(Series::new("rod", points(last), Mark::Dotted).coloured(colour));
        series
    }

    fn search_figures(&self) -> Vec<Drawn> {
        let mut figures = Vec::new();
        let singular = match &self.answer {
            Answer::Identification(found) => &found.singular_values[..],
            Answer::Search(found) => &found.singular_values[..],
            Answer::StaticShape(_) => &[],
        };
        if singular.first().is_some_and(|largest| *largest > 0.0) {
            let points = singular.iter().enumerate().map(|(i, s)| (1.0 + i as f64, *s)).collect();
            let series = vec![Series::new("singular values", points, Mark::Dotted)];
            let y = if matches!(self.answer, Answer::Identification(_)) {
                "singular value (1/standard deviation)"
            } else {
                "singular value (m for a change by 1)"
            };
            figures.push((
                "singular_values.svg",
                self.chart("information in the data", "number", y, Scale::LogY(12), series),
            ));
        }
        let Answer::Search(found) = &self.answer else { return figures };
        let tracked = self.table.fits_positions();
        let objective = axis_label(self.table.goal);
        for (file, title, y, scale, of) in [
            (
                "objective.svg",
                "objective",
                &*objective,
                if tracked { Scale::LogY(10) } else { Scale::Linear },
                (|iteration| iteration.objective) as fn(&super::SearchIteration) -> f64,
            ),
            (
                "convergence.svg",
                if tracked {
                    "cosine of what is left and what can be moved"
                } else {
                    "gradient of the Lagrangian over the objective"
                },
                "stationarity in the unknowns",
                Scale::LogY(8),
                |iteration| iteration.stationarity,
            ),
        ] {
            let series = (0..self.table.starts.unwrap_or(3).max(1)).filter_map(|start| {
                let mine = found.history.iter().filter(|iteration| iteration.start == start);
                let points: Vec<(f64, f64)> =
                    mine.map(|iteration| (iteration.iteration as f64, of(iteration))).collect();
                (!points.is_empty()).then(|| Series::new(format!("start {}", start + 1), points, Mark::Dotted))
            });
            figures.push((file, self.chart(title, "iteration", y, scale, series.collect())));
        }
        figures
    }

    fn tables(&self, rod: &Rod) -> Result<Vec<Table>> {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_string()).collect::<Vec<_>>();
        let mut tables = vec![self.joints(rod)];
        let value = if self.table.is_searched() { self.table.goal.label() } else { "rms distance (m)" };
        let before_and_after =
            |of: &str| names(&[of, &format!("{value}, before"), &format!("{value}, after"), "better by (%)"]);
        let breaks = self.evidence.profiles.iter().any(|profile| profile.breaks.is_some());
        let limited = breaks || self.evidence.checks.iter().any(|check| check.limit.is_some());
        let limit = |title: &str| if limited { vec![title.to_string()] } else { Vec::new() };
        if !self.evidence.profiles.is_empty() {
            let design = self.evidence.profiles.last().and_then(|design| design.objective);
            let row = |other: &ComparedProfile| {
                let gain =
                    design.zip(other.objective).and_then(|(design, other)| self.table.gain_percent(design, other));
                let mut row = vec![json!(other.name), json!(other.objective), json!(gain)];
                row.extend(limited.then(|| json!(other.breaks)));
                row
            };
            tables.push(Table {
                file: "comparison.csv",
                title: "Against other profiles",
                columns: [&names(&["profile", value, "the design is better by (%)"])[..], &limit("breaks the limit")]
                    .concat(),
                rows: self.evidence.profiles.iter().map(row).collect(),
            });
        }
        if !self.evidence.checks.is_empty() {
            let failed = self.evidence.checks.iter().any(|check| check.failure.is_some());
            let row = |check: &super::robustness::Check| {
                let gain = json!(check.gain_percent);
                let mut row = vec![json!(check.simulation), json!(check.before), json!(check.designed), gain];
                row.extend(limited.then(|| json!(check.limit.as_ref().map(|limit| 100.0 * limit.used))));
                row.extend(failed.then(|| json!(check.failure)));
                row
            };
            let reason = failed.then(|| "why one is missing".to_string());
            tables.push(Table {
                file: "checks.csv",
                title: "Simulated again; before: the scene's own",
                columns: before_and_after("simulation")
                    .into_iter()
                    .chain(limit("most of a limit (%); above 100 it is broken"))
                    .chain(reason)
                    .collect(),
                rows: self.evidence.checks.iter().map(row).collect(),
            });
        }
        let active = match &self.answer {
            Answer::Identification(found) => &found.active,
            Answer::StaticShape(found) => &found.active,
            Answer::Search(found) => &found.active,
        };
        if !active.is_empty() {
            tables.push(Table {
                file: "binding.csv",
                title: "Binding constraints",
                columns: names(&["constraint", "dual"]),
                rows: active.iter().map(|(name, dual)| vec![json!(name), json!(dual)]).collect(),
            });
        }
        if let Answer::Search(found) = &self.answer
            && !found.numbers.is_empty()
        {
            let row = |number: &EstimatedNumber| {
                let verdict = number.verdict.map(Identifiability::words);
                let EstimatedNumber { key, unit, own, value, deviation, discretisation, .. } = number;
                vec![
                    json!(key),
                    json!(unit),
                    json!(own),
                    json!(value),
                    json!(value / own),
                    json!(deviation),
                    json!(discretisation),
                    json!(verdict),
                ]
            };
            let columns = [
                "key",
                "unit",
                "in the scene",
                "found",
                "over the scene's",
                "standard deviation",
                "of it mesh and steps",
                "verdict",
            ];
            tables.push(Table {
                file: "numbers.csv",
                title: "Numbers of the scene",
                columns: names(&columns),
                rows: found.numbers.iter().map(row).collect(),
            });
        }
        if let Answer::Search(found) = &self.answer
            && !found.tolerances.is_empty()
        {
            let row = |tolerance: &super::Tolerance| {
                let percent = |x: f64| 100.0 * x;
                let relative = tolerance.change.filter(|_| !tolerance.name.starts_with("phase"));
                let phase = tolerance.change.filter(|_| tolerance.name.starts_with("phase"));
                vec![
                    json!(tolerance.name),
                    json!(relative.map(|change| percent(change.exp() - 1.0))),
                    json!(phase),
                    json!(tolerance.loss.map(percent)),
                ]
            };
            tables.push(Table {
                file: "tolerances.csv",
                title: "Tolerance of each unknown, one at a time, for a loss of 1 %; empty: more than a factor of two",
                columns: names(&["unknown", "off by (%)", "off by (rad)", "loss there (%)"]),
                rows: found.tolerances.iter().map(row).collect(),
            });
        }
        if !self.evidence.cases.is_empty() {
            let row = |case: &ScenarioResult| {
                vec![json!(case.case), json!(case.before), json!(case.designed), json!(case.gain_percent)]
            };
            tables.push(Table {
                file: "cases.csv",
                title: "The cases of the design; before: the scene's own",
                columns: before_and_after("case"),
                rows: self.evidence.cases.iter().map(row).collect(),
            });
        }
        if !self.evidence.front.is_empty() {
            let row = |(i, point): (usize, &super::ParetoPoint)| {
                let scene = format!("{}-front-{}.toml", self.scene.name, i + 1);
                vec![json!(point.second), json!(point.first), json!(point.best), json!(point.converged), json!(scene)]
            };
            let second = self.table.front.as_ref().map_or("", |front| front.goal.label());
            tables.push(Table {
                file: "front.csv",
                title: "Designs between two goals",
                columns: names(&[second, value, "on the front", "converged", "scene"]),
                rows: self.evidence.front.iter().enumerate().map(row).collect(),
            });
        }
        let body = self.designed.scene()?.model()?.rod;
        tables.push(Table {
            file: "body.csv",
            title: "The body along its length, as in body.stl",
            columns: names(&stl::COLUMNS),
            rows: stl::sections(&body, &self.stiffness),
        });
        if let Answer::Search(found) = &self.answer {
            let row = |(start, value): (usize, &f64)| {
                let iterations = found.history.iter().filter(|iteration| iteration.start == start).count();
                vec![json!(start + 1), json!(iterations), json!(value), json!(found.optima[start])]
            };
            tables.push(Table {
                file: "starts.csv",
                title: "Starts",
                columns: names(&["start", "iterations", value, "optimum; none: not converged"]),
                rows: found.starts.iter().enumerate().map(row).collect(),
            });
        }
        Ok(tables)
    }

    fn joints(&self, rod: &Rod) -> Table {
        let mut columns = vec!["node", "s/L", "EI (N m²)", "EI over the scene's"];
        match &self.answer {
            Answer::Identification(_) => columns.extend(["standard deviation (N m²)", "signal to noise", "verdict"]),
            Answer::Search(_) => {
                let has = |variable| self.table.variables.contains(&variable);
                columns.extend(has(DesignVariable::Amplitude).then_some("amplitude over the scene's"));
                columns.extend(has(DesignVariable::Phase).then_some("phase subtracted (rad)"));
                columns.extend(self.table.fits_positions().then_some("standard deviation (N m²)"));
                columns.push("verdict");
            }
            Answer::StaticShape(_) => columns.push("verdict"),
        }
        let row = |(i, k): (usize, usize)| {
            let ei = self.stiffness[i];
            let mut row = vec![json!(k), json!(rod.xi(k)), json!(ei), json!(ei / rod.joint_stiffness(k))];
            let bound = self.table.bounds.iter().any(|bound| (ei / (bound * rod.ei) - 1.0).abs() < 1e-6);
            let verdict = match &self.answer {
                Answer::Identification(found) => {
                    let joint = &found.joints[i];
                    row.extend([json!(joint.deviation_n_m2), json!(joint.signal_to_noise)]);
                    joint.verdict.words()
                }
                Answer::StaticShape(found) if found.undecided.contains(&k) => Identifiability::Unobservable.words(),
                Answer::StaticShape(found) if found.missed.iter().any(|(node, _)| *node == k) => "misses the shape",
                Answer::Search(found) => {
                    let has = |variable| self.table.variables.contains(&variable);
                    row.extend(has(DesignVariable::Amplitude).then(|| json!(found.profile.amplitude[i])));
                    row.extend(has(DesignVariable::Phase).then(|| json!(found.profile.phase_rad[i])));
                    let deviation = found.deviations.get(i);
                    row.extend(self.table.fits_positions().then(|| json!(deviation.map(|d| d * ei))));
                    joint_verdict(found, &self.table, i, bound).map_or("", Identifiability::words)
                }
                Answer::StaticShape(_) if bound => Identifiability::AtABound.words(),
                Answer::StaticShape(_) => "",
            };
            row.push(json!(verdict));
            row
        };
        let mut rows: Vec<Vec<Value>> = rod.joints().enumerate().map(row).collect();
        if rows.iter().all(|row| row.last() == Some(&json!(""))) {
            columns.pop();
            rows.iter_mut().for_each(|row| drop(row.pop()));
        }
        Table { file: "joints.csv", title: "Joints", columns: columns.into_iter().map(str::to_string).collect(), rows }
    }

    fn motion(&self) -> Option<(Animation, String)> {
        let [before, after] = &self.evidence.motions[..] else { return None };
        let shown = format!("In grey: the same with {BASELINE}.");
        Some((Animation::of(&after.drawn).with_companion("", GREY, &before.drawn), shown))
    }
}

/// The colour of the `i`-th line that belongs neither to the design nor to the scene's own.
fn of_another(i: usize) -> usize {
    let others = SERIES - 2;
    [1, 2, 3, 4, 5, 7][i % others] + SERIES * (i / others)
}

/// The caption of a figure.
fn caption(file: &str) -> &'static str {
    match file {
        "profile.svg" => {
            "The bending stiffness EI along the rod, over the largest EI of the sections of the scene's rod (reference_stiffness_n_m2 of design.json), and what it is compared with."
        }
        "body.svg" => {
            "The straight rod from its side, above its middle before and below it after; the two axes have scales of their own. A stroke is as high, over the half depth there, as the joint is stiff, over the stiffest."
        }
        "amplitude.svg" => "Factor on the amplitude of the actuation along the rod.",
        "phase.svg" => "The phase that is subtracted from that of the actuation along the rod.",
        "numbers.svg" => {
            "The identified numbers over those of the scene, in the order of their table; bars: one standard deviation."
        }
        "front.svg" => {
            "Designs in which neither goal can improve without a loss in the other; each is a scene next to this page."
        }
        "cases.svg" => "The objective in each case, in the order of their table.",
        "shape.svg" => "The target shape of the rod at rest.",
        "tip_x.svg" | "tip_y.svg" => "The target motion of the tip, and its motion before and after.",
        "error.svg" => "Distance between simulation and data over time, on a logarithmic axis.",
        "way.svg" => "Displacement of the centre of mass before and after.",
        "before.svg" => "Shapes before, the last one with its nodes, on the same axes as those after.",
        "after.svg" => "Shapes after, the last one with its nodes, on the same axes as those before.",
        "singular_values.svg" => {
            "How well the data determine each independent combination of the unknowns: higher is better."
        }
        "objective.svg" => "The objective from iteration to iteration, one line per start.",
        "convergence.svg" => "How far each iteration is from a stationary point, one line per start.",
        _ => "",
    }
}

/// The axis label of a goal, with its unit.
fn axis_label(goal: Goal) -> String {
    let Some(measure) = MEASURES.into_iter().find(|measure| goal == Goal::Cycle(measure.key)) else {
        return goal.label().to_string();
    };
    let words = measure.label();
    if measure.unit == "1" { words } else { format!("{words} ({})", measure.unit) }
}

/// At most `most` of the points.
fn thinned(points: Vec<(f64, f64)>, most: usize) -> Vec<(f64, f64)> {
    let every = points.len().div_ceil(most).max(1);
    points.into_iter().step_by(every).collect()
}

/// A function of the positions over time.
fn curve(motion: &Trajectory, of: impl Fn(&[f64]) -> f64) -> Vec<(f64, f64)> {
    let points = (0..motion.times.len()).map(|n| (motion.times[n], of(motion.positions(n))));
    thinned(points.collect(), POINTS)
}
