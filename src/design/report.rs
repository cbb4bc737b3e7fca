//! A design from scene to files: what was asked, what was found, how it stands re-simulated, figures, and a scene with the
//! designed profile.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Value, json};

use super::identify::{Identified, Verdict, identify};
use super::markers::{LEAST, Markers};
use super::search::{Found, Iteration, Objective, Search};
use super::shape::{Resting, rest};
use super::table::{Goal, Table};
use crate::error::{Error, Result};
use crate::model::Dynamics;
use crate::report::chart::{Chart, Mark, Scale, Series};
use crate::report::{put_in_place, render, text_file, write_error};
use crate::scene::{Document, Scene};
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Trajectory};
use crate::system::System;

/// A tip that moves by less than this part of the length for twice the stiffness hardly feels it.
const HARDLY: f64 = 1e-2;

/// Shapes drawn over the last cycle.
const SHAPES: usize = 9;

/// A design.
#[derive(Debug)]
pub struct Design {
    /// What was asked for.
    pub table: Table,
    /// The answer.
    pub answer: Answer,
    /// EI of the joints, N m².
    pub stiffness: Vec<f64>,
    /// What is worth saying, a line each.
    pub lines: Vec<String>,
    checks: Vec<Check>,
    scene: Scene,
    designed: Document,
}

/// The answer of a goal.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Answer {
    /// Of `identify`.
    Identified(Identified),
    /// Of `static-shape`.
    Resting(Resting),
    /// Of the dynamic goals.
    Found(Found),
}

/// The objective in another simulation.
#[derive(Debug, Clone, Serialize)]
struct Check {
    simulation: String,
    /// The objective of the design; none where the simulation fails.
    designed: Option<f64>,
    /// The same of the even profile of the same mean.
    even: Option<f64>,
    /// Gain over the even profile, %.
    gain_percent: Option<f64>,
}

impl Design {
    /// Designs what `document` asks for; `tell` sees every iteration and may stop the search.
    ///
    /// # Errors
    /// [`Error::Scene`] for a wrong `[design]`; [`Error::Design`] where there is no answer; those of data and simulation.
    pub fn of(document: &Document, mut tell: impl FnMut(&Iteration, &Objective) -> ControlFlow<()>) -> Result<Self> {
        let scene = document.scene()?;
        let table = Table::of(&scene).map_err(|fault| document.refuse(&fault))?;
        let mut dynamics = Dynamics::new(Arc::new(scene.model()?));
        let nodes = dynamics.nodes();
        let data = |least: usize| match &table.data {
            Some(file) => Markers::read(&scene.folder.join(file), nodes, least).map(Some),
            None => Ok(None),
        };
        let reference = dynamics.model.rod.ei;
        let mut lines = Vec::new();
        let mut checks = Vec::new();
        let (answer, stiffness) = match table.goal {
            Goal::Identify => {
                let markers = data(LEAST)?.unwrap_or_default();
                let found = identify(&mut dynamics, &markers, &table)?;
                lines.extend(say_identified(&found));
                lines.extend(say_effect(&scene));
                let stiffness = found.joints.iter().map(|joint| joint.stiffness_n_m2).collect();
                (Answer::Identified(found), stiffness)
            }
            Goal::StaticShape => {
                let markers = data(1)?.unwrap_or_default();
                let found = rest(&mut dynamics, &markers.positions[0], &table)?;
                for (node, ei) in &found.missed {
                    lines.push(format!("node {node} misses the shape: it would take EI = {ei:.4e} N m²"));
                }
                if !found.undecided.is_empty() {
                    lines.push(format!(
                        "neither curvature nor moment at nodes {:?}: any stiffness does",
                        found.undecided
                    ));
                }
                let stiffness = found.stiffness_n_m2.clone();
                (Answer::Resting(found), stiffness)
            }
            Goal::TrackTip | Goal::Distance | Goal::Efficiency => {
                let target = data(1)?;
                let problem = Problem::of(&scene)?;
                let objective = Objective::new(&table, &problem, target.as_ref())?;
                let mut search = Search { scene: &scene, table: &table, objective: &objective, problem };
                let found = search.run(|iteration| tell(iteration, &objective))?;
                lines.extend(say_found(&found, &table));
                lines.extend(compare(&mut search, &found, &table));
                checks = verify(document, &scene, &table, target.as_ref(), &found.stiffness_n_m2, reference)?;
                for check in &checks {
                    let gain = check
                        .gain_percent
                        .map_or(String::new(), |gain| format!(", {gain:+.2} % over the even profile"));
                    let value = check.designed.map_or("fails".to_string(), |value| format!("{value:.6e}"));
                    lines.push(format!("{}: {value}{gain}", check.simulation));
                }
                let stiffness = found.stiffness_n_m2.clone();
                (Answer::Found(found), stiffness)
            }
        };
        let designed = designed(document, &scene, &dynamics, &stiffness)?;
        Ok(Self { table, answer, stiffness, lines, checks, scene, designed })
    }

    /// Writes design.json, figures, report.html and the scene with the designed profile to `folder`; returns their paths.
    ///
    /// # Errors
    /// [`Error::Write`], [`Error::Chart`], [`Error::Page`].
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        std::fs::create_dir_all(folder).map_err(|e| write_error(folder, &e))?;
        let figures =
            self.figures()?.into_iter().map(|(name, chart)| Ok((name, chart.svg()?))).collect::<Result<Vec<_>>>()?;
        let numbers = self.numbers()?;
        let failed = |e: serde_json::Error| Error::Page { reason: e.to_string() };
        let json = serde_json::to_string_pretty(&numbers).map_err(failed)?;
        let html = self.page(&figures)?;
        let mut texts = vec![
            ("design.json".to_string(), json + "\n"),
            ("report.html".to_string(), html),
            (format!("{}-designed.toml", self.scene.name), self.designed.text().to_string()),
        ];
        texts.extend(figures.into_iter().map(|(name, svg)| (name.to_string(), svg)));
        let mut files = Vec::new();
        for (name, text) in texts {
            let path = folder.join(name);
            files.push(text_file(path, &text)?);
        }
        files.into_iter().map(|(file, path)| put_in_place(file, path)).collect()
    }

    fn numbers(&self) -> Result<Value> {
        let failed = |e: serde_json::Error| Error::Page { reason: e.to_string() };
        let rod = self.scene.model()?.rod;
        Ok(json!({
            "name": self.scene.name,
            "caudal_version": env!("CARGO_PKG_VERSION"),
            "goal": self.table.goal,
            "status": match &self.answer {
                Answer::Found(found) if found.interrupted => "interrupted",
                Answer::Found(found) if !found.converged => "not converged",
                _ => "solved",
            },
            "reference_stiffness_n_m2": rod.ei,
            "xi": rod.joints().map(|k| k as f64 / (rod.nodes - 1) as f64).collect::<Vec<_>>(),
            "stiffness_n_m2": self.stiffness,
            "bounds": self.table.bounds,
            "lines": self.lines,
            "checks": serde_json::to_value(&self.checks).map_err(failed)?,
            "answer": serde_json::to_value(&self.answer).map_err(failed)?,
        }))
    }

    fn figures(&self) -> Result<Vec<(&'static str, Chart)>> {
        let rod = self.scene.model()?.rod;
        let name = &self.scene.name;
        let xi: Vec<f64> = rod.joints().map(|k| k as f64 / (rod.nodes - 1) as f64).collect();
        let factors: Vec<f64> = self.stiffness.iter().map(|ei| ei / rod.ei).collect();
        let line = |values: &[f64]| xi.iter().copied().zip(values.iter().copied()).collect::<Vec<_>>();
        let own: Vec<f64> =
            rod.joints().map(|k| rod.joint[k] * rod.spacing / rod.ei * if k == 0 { 0.5 } else { 1.0 }).collect();
        let mut profile = Vec::new();
        if let Answer::Identified(found) = &self.answer {
            let top = factors.iter().copied().fold(0.0, f64::max);
            for (joint, factor) in found.joints.iter().zip(&factors) {
                let by = (joint.deviation_n_m2 / rod.ei).min(2.0 * top);
                profile.push(Series::new("", vec![(joint.xi, factor - by), (joint.xi, factor + by)], Mark::Ghost));
            }
        }
        profile.push(Series::new("designed", line(&factors), Mark::Dotted));
        profile.push(Series::new("the scene's own", line(&own), Mark::Line));
        let highest = factors.iter().chain(&own).copied().fold(0.0, f64::max);
        for (bound, label) in self.table.bounds.into_iter().zip(["least", "largest"]) {
            if bound <= 3.0 * highest {
                profile.push(Series::new(label, vec![(xi[0], bound), (xi[xi.len() - 1], bound)], Mark::Line));
            }
        }
        let chart =
            |title: &str, x: &str, y: &str, scale, series| Chart::new(format!("{name}: {title}"), x, y, scale, series);
        let bars = if matches!(self.answer, Answer::Identified(_)) { ", bars: one standard deviation" } else { "" };
        let title = format!("stiffness along the rod{bars}");
        let mut figures =
            vec![("profile.svg", chart(&title, "s/L", "EI over EI of the scene", Scale::Linear, profile))];
        let singular = match &self.answer {
            Answer::Identified(found) => &found.singular_values[..],
            Answer::Found(found) => &found.singular_values[..],
            Answer::Resting(_) => &[],
        };
        if !singular.is_empty() {
            let points = singular.iter().enumerate().map(|(i, s)| (1.0 + i as f64, *s)).collect();
            let series = vec![Series::new("singular values", points, Mark::Dotted)];
            figures.push((
                "singular_values.svg",
                chart("what the data know", "number", "singular value", Scale::LogY(10), series),
            ));
        }
        if let Answer::Found(found) = &self.answer {
            let mut series = Vec::new();
            for start in 0..found.starts.len() {
                let of = found.history.iter().filter(|iteration| iteration.start == start);
                let points = of.map(|iteration| (iteration.iteration as f64, iteration.stationarity)).collect();
                series.push(Series::new(format!("start {}", start + 1), points, Mark::Dotted));
            }
            figures.push((
                "convergence.svg",
                chart(
                    "gradient of the Lagrangian over the objective",
                    "iteration",
                    "stationarity in ln EI",
                    Scale::LogY(10),
                    series,
                ),
            ));
            let mut series = Vec::new();
            for start in 0..found.starts.len() {
                let of = found.history.iter().filter(|iteration| iteration.start == start);
                let points = of.map(|iteration| (iteration.iteration as f64, iteration.objective)).collect();
                series.push(Series::new(format!("start {}", start + 1), points, Mark::Dotted));
            }
            figures.push((
                "objective.svg",
                chart("objective", "iteration", objective_label(self.table.goal), Scale::Linear, series),
            ));
            let mut problem = Problem::of(&self.scene)?;
            let even = vec![rod.ei * self.table.mean.unwrap_or(1.0); xi.len()];
            for (file, title, ei) in [
                ("before.svg", "last cycle, even stiffness", &even),
                ("after.svg", "last cycle, designed", &self.stiffness),
            ] {
                problem.set_stiffness(ei)?;
                if let Ok(trajectory) = problem.simulate() {
                    figures.push((file, chart(title, "x (m)", "y (m)", Scale::Equal, self.shapes(&trajectory))));
                }
            }
        }
        Ok(figures)
    }

    /// The shapes of the last cycle.
    fn shapes(&self, trajectory: &Trajectory) -> Vec<Series> {
        let last = trajectory.times.len() - 1;
        let period = self.scene.actuation.as_ref().map(|a| 1.0 / a.frequency_hz.get()).filter(|p| p.is_finite());
        let start = period.map_or(0.0, |period| trajectory.times[last] - period);
        let first = trajectory.times.partition_point(|t| *t < start).min(last);
        let points = |n: usize| trajectory.positions(n).chunks_exact(2).map(|p| (p[0], p[1])).collect::<Vec<_>>();
        let mut series: Vec<Series> =
            (0..SHAPES).map(|i| Series::new("", points(first + (last - first) * i / SHAPES), Mark::Ghost)).collect();
        series.push(Series::new("rod", points(last), Mark::Dotted));
        series
    }

    fn page(&self, figures: &[(&'static str, String)]) -> Result<String> {
        #[derive(Serialize)]
        struct Content<'a> {
            name: &'a str,
            goal: Goal,
            lines: &'a [String],
            rows: Vec<[String; 5]>,
            figures: &'a [(&'static str, String)],
            scene: &'a str,
        }
        let rod = self.scene.model()?.rod;
        let rows = rod.joints().zip(&self.stiffness).enumerate().map(|(i, (k, ei))| {
            let (deviation, verdict) = match &self.answer {
                Answer::Identified(found) => {
                    let joint = &found.joints[i];
                    let verdict = match joint.verdict {
                        Verdict::Identified => "identified",
                        Verdict::PriorDriven => "prior-driven",
                        Verdict::AtABound => "at a bound",
                        Verdict::Unobservable => "unobservable",
                    };
                    (format!("{:.2e}", joint.deviation_n_m2), verdict.to_string())
                }
                _ => {
                    let factor = ei / rod.ei;
                    let bound = self.table.bounds.iter().any(|bound| (factor / bound - 1.0).abs() < 1e-6);
                    (String::new(), if bound { "at a bound".to_string() } else { String::new() })
                }
            };
            let xi = k as f64 / (rod.nodes - 1) as f64;
            [k.to_string(), format!("{xi:.4}"), format!("{ei:.6e}"), deviation, verdict]
        });
        let content = Content {
            name: &self.scene.name,
            goal: self.table.goal,
            lines: &self.lines,
            rows: rows.collect(),
            figures,
            scene: self.designed.text(),
        };
        render(include_str!("page.html"), &content)
    }
}

fn objective_label(goal: Goal) -> &'static str {
    match goal {
        Goal::TrackTip => "rms distance of the tip from its target (m)",
        Goal::Distance => "distance (m)",
        _ => "distance² over work (m²/J)",
    }
}

fn say_identified(found: &Identified) -> Vec<String> {
    let count = |verdict: Verdict| found.joints.iter().filter(|joint| joint.verdict == verdict).count();
    let all = found.joints.len();
    let mut lines = vec![format!(
        "{} of {all} joints identified, {} prior-driven, {} at a bound, {} unobservable; noise {:.2e} m, {} samples, \
         windows of {}",
        count(Verdict::Identified),
        count(Verdict::PriorDriven),
        count(Verdict::AtABound),
        count(Verdict::Unobservable),
        found.noise_m,
        found.samples,
        2 * found.window_samples + 1,
    )];
    if count(Verdict::Identified) == 0 {
        lines.push(
            "stiffness cannot be identified from these data: what the rod bends beyond its natural curvature drowns in the \
             noise of the positions"
                .to_string(),
        );
    }
    if let Some(gain) = found.actuation_gain {
        lines.push(format!("the actuation is {gain:.5} times the scene's"));
    }
    if let Some([x, y, moment]) = found.balances {
        lines.push(format!(
            "balances that need no stiffness, over the sizes of their parts: force x {x:.1e}, y {y:.1e}, moment {moment:.1e}"
        ));
        if x.max(y).max(moment) > 0.2 {
            lines.push("warning: mass, drag or loads of the scene are not those of the data".to_string());
        }
    }
    if !found.missing.is_empty() {
        let shown = found.missing.iter().take(10).cloned().collect::<Vec<_>>().join(", ");
        let more = found.missing.len().saturating_sub(10);
        lines.push(format!("left out: {shown}{}", if more > 0 { format!(" and {more} more") } else { String::new() }));
    }
    lines.extend(found.active.iter().map(|(name, dual)| format!("binding: {name} (dual {dual:.3e})")));
    lines
}

/// How much stiffness matters in the scene, where its simulation can be differentiated.
fn say_effect(scene: &Scene) -> Option<String> {
    let mut problem = Problem::of(scene).ok()?;
    let rod = &problem.model().rod;
    let (tip, length) = (rod.nodes - 1, rod.length);
    let parameters: Vec<Parameter> = rod.joints().map(Parameter::Stiffness).collect();
    let stiffness = problem.stiffness();
    let outputs = [0, 1].map(|axis| Output::from(Quantity::Position(tip, axis)));
    let found = problem.forward(&parameters, &outputs, 1, |_| {}).ok()?;
    let along = |n: usize, o: usize| found.row(n, o).iter().zip(&stiffness).map(|(by, ei)| by * ei).sum::<f64>();
    let moved = (0..found.times.len()).map(|n| along(n, 0).hypot(along(n, 1))).fold(0.0, f64::max);
    let verdict = if moved < HARDLY * length { "stiffness does not matter here" } else { "stiffness matters here" };
    Some(format!("{verdict}: 1 % more of it moves the tip by at most {:.1e} m", 0.01 * moved))
}

fn say_found(found: &Found, table: &Table) -> Vec<String> {
    let starts: Vec<String> = found.starts.iter().map(|value| format!("{value:.6e}")).collect();
    let mut lines = vec![
        format!("{}: {:.6e}", objective_label(table.goal), found.objective),
        format!(
            "{} after {} iterations, stationarity {:.1e}; {} starts ended at {}",
            if found.interrupted {
                "interrupted, the best so far,"
            } else if found.converged {
                "converged"
            } else {
                "not converged"
            },
            found.history.len(),
            found.stationarity,
            found.starts.len(),
            starts.join(", ")
        ),
    ];
    lines.extend(found.active.iter().map(|(name, dual)| format!("binding: {name} (dual {dual:.3e})")));
    lines
}

/// The design against the even profile, the study's gradient and the best linear one of the same mean.
fn compare(search: &mut Search<'_>, found: &Found, table: &Table) -> Vec<String> {
    if table.goal == Goal::TrackTip {
        return Vec::new();
    }
    let rod = &search.problem.model().rod;
    let xi: Vec<f64> = rod.joints().map(|k| k as f64 / (rod.nodes - 1) as f64).collect();
    let even = table.mean.unwrap_or(1.0);
    let centre = xi.iter().sum::<f64>() / xi.len() as f64;
    let gradient: Vec<f64> = xi.iter().map(|xi| even * (2.0 - xi) / (2.0 - centre)).collect();
    let mut lines = Vec::new();
    let mut say = |name: &str, value: Option<f64>| {
        if let Some(value) = value {
            let gain = 100.0 * (found.objective - value) / value.abs();
            lines.push(format!("{name}: {value:.6e}; the design is {gain:+.2} % better"));
        }
    };
    say("even profile", search.measure(&vec![even; xi.len()]));
    say("the study's gradient", search.measure(&gradient));
    let linear = search.best_linear();
    say(&format!("best linear profile (slope {:.3})", linear.map_or(f64::NAN, |l| l.0)), linear.map(|l| l.1));
    lines
}

/// The designed profile as points [ξ, factor].
fn profile(scene_nodes: usize, first: usize, stiffness: &[f64], reference: f64) -> Vec<[f64; 2]> {
    let xi = |i: usize| (i + first) as f64 / (scene_nodes - 1) as f64;
    stiffness.iter().enumerate().map(|(i, ei)| [xi(i), ei / reference]).collect()
}

/// Simulates the design and the even profile again: as it is, with half the step, on a finer mesh, by another method.
fn verify(
    document: &Document,
    scene: &Scene,
    table: &Table,
    target: Option<&Markers>,
    stiffness: &[f64],
    reference: f64,
) -> Result<Vec<Check>> {
    let step = scene.typical_step();
    let other = if scene.integrator_name() == "generalized-alpha" { "newmark" } else { "generalized-alpha" };
    let finer = 2 * scene.rod.nodes.get() - 1;
    let first = scene.model()?.rod.first_joint;
    let points = profile(scene.rod.nodes.get(), first, stiffness, reference);
    let mut simulations = vec![
        ("as designed".to_string(), Vec::new()),
        (format!("time step {:e} s", 0.5 * step), vec![format!("solver.time_step_s={:e}", 0.5 * step)]),
        (other.to_string(), vec![format!("solver.integrator={other}")]),
    ];
    if table.goal != Goal::TrackTip {
        simulations.push((format!("{finer} nodes"), vec![format!("rod.nodes={finer}")]));
    }
    let measure = |changes: &[String], points: &[[f64; 2]]| -> Option<f64> {
        let mut document = document.clone();
        for change in changes {
            document.set(change).ok()?;
        }
        let list: Vec<String> = points.iter().map(|[xi, factor]| format!("[{xi:?}, {factor:?}]")).collect();
        document.set(&format!("rod.stiffness_profile=[{}]", list.join(", "))).ok()?;
        let scene = document.scene().ok()?;
        let mut problem = Problem::of(&scene).ok()?;
        let ei = problem.stiffness();
        let objective = Objective::new(table, &problem, target).ok()?;
        objective.measure(&mut problem, &ei)
    };
    let even = [[0.0, table.mean.unwrap_or(1.0)]];
    Ok(simulations
        .into_iter()
        .map(|(simulation, changes)| {
            let designed = measure(&changes, &points);
            let even = (table.goal != Goal::TrackTip).then(|| measure(&changes, &even)).flatten();
            let gain_percent = designed.zip(even).map(|(designed, even)| 100.0 * (designed - even) / even.abs());
            Check { simulation, designed, even, gain_percent }
        })
        .collect())
}

/// The scene with the designed profile and without `[design]`; files that it names are found from anywhere.
fn designed(document: &Document, scene: &Scene, dynamics: &Dynamics, stiffness: &[f64]) -> Result<Document> {
    let failed = |reason: String| Error::Page { reason };
    let mut table: toml::Table = document.text().parse().map_err(|e: toml::de::Error| failed(e.to_string()))?;
    for change in document.overrides() {
        let over: toml::Table = change.parse().map_err(|e: toml::de::Error| failed(e.to_string()))?;
        merge(&mut table, over);
    }
    table.remove("design");
    table.insert("name".to_string(), toml::Value::String(format!("{}-designed", scene.name)));
    let rod = &dynamics.model.rod;
    let points = profile(rod.nodes, rod.first_joint, stiffness, rod.ei);
    if let Some(toml::Value::Table(rod)) = table.get_mut("rod") {
        rod.remove("stiffness_gradient");
        let list = points.into_iter().map(|point| toml::Value::Array(point.map(toml::Value::Float).to_vec())).collect();
        rod.insert("stiffness_profile".to_string(), toml::Value::Array(list));
    }
    if let Some(toml::Value::Table(head)) = table.get_mut("head") {
        for (_, value) in head.iter_mut() {
            if let Some(toml::Value::String(file)) = value.get_mut("table") {
                let path = scene.folder.join(&*file);
                *file = path.canonicalize().unwrap_or(path).to_string_lossy().into_owned();
            }
        }
    }
    let text = toml::to_string(&table).map_err(|e| failed(e.to_string()))?;
    let head = format!("# Designed by caudal {} from {}.\n", env!("CARGO_PKG_VERSION"), scene.name);
    Ok(Document::new(format!("{}-designed.toml", scene.name), head + &text))
}

fn merge(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => merge(base, over),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}
