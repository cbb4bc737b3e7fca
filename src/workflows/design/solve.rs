//! Solves the design problem that a scene's `[design]` states, and writes its results: the designed scene, numbers, tables and a page.

use std::ops::{ControlFlow, RangeInclusive};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::checkpoint::{self, Checkpoint};
use super::design_vector::{BASELINE, DesignVector};
use super::designed_scene::{designed, fixed_steps, scene_with, simulations, with_fixed_fluid};
use super::explanations::{
    WholeRun, beside_own, explain_cycles, explain_effect, explain_fluid_share, explain_front, explain_identification,
    explain_joints, explain_misfit, explain_refit, explain_scenarios, explain_search, explain_tolerances,
};
use super::front::{ParetoPoint, front};
use super::identify::{Identification, identify};
use super::markers::{MIN_SAMPLES, MarkedNodes, Markers, distances, rms};
use super::objective::objective_of;
use super::refit::Refit;
use super::robustness::{Check, Robustness, RobustnessChecks};
use super::scenarios::{Scenario, ScenarioResult, scenarios};
use super::search::{
    DEFAULT_MAX_ITERATIONS, FEASIBILITY_TOLERANCE, ITERATIONS_EXHAUSTED, Search, SearchIteration, SearchResult,
};
use super::static_shape::{Equilibrium, StaticShape, rest};
use super::stl;
use super::table::{DesignTable, DesignVariable, Goal};
use crate::assessment::Assessment;
use crate::error::{Error, Result};
use crate::files::WrittenFiles;
use crate::linear_stability::{REST_TOLERANCE, SteadyState, continue_to_rest, grows};
use crate::model::Dynamics;
use crate::newton::Newton;
use crate::number_format::in_sentence;
use crate::report::sampling::{fastest_drive, shown_rows};
use crate::report::{Claim, Folder, Owner, RodMotion};
use crate::rod::Rod;
use crate::scene::{Document, Scene};
use crate::sensitivity::{Problem, Trajectory};
use crate::stepper::Stepper;
use crate::system::System;

/// Stiffnesses that differ by less than this fraction are equal.
const SAME_STIFFNESS: f64 = 1e-9;

/// A solved design problem.
#[derive(Debug)]
pub struct Design {
    /// The design table.
    pub table: DesignTable,
    /// The answer.
    pub answer: Answer,
    /// EI of the joints, N m².
    pub stiffness: Vec<f64>,
    /// The results in sentences.
    pub lines: Vec<String>,
    pub(super) evidence: Evidence,
    pub(super) scene: Scene,
    document: Document,
    pub(super) designed: Document,
}

/// The answer, by goal.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum Answer {
    /// Of `identify`.
    Identification(Identification),
    /// Of `static-shape`.
    StaticShape(StaticShape),
    /// Of the dynamic goals.
    Search(Box<SearchResult>),
}

/// What is reported along with the answer.
#[derive(Debug, Default)]
pub(super) struct Evidence {
    /// The design in other simulations.
    pub checks: Vec<Check>,
    /// Profiles for comparison, with their objectives; the design is the last.
    pub profiles: Vec<ComparedProfile>,
    /// The motions of baseline and design; empty if a simulation fails, or there is none.
    pub motions: Vec<DesignMotion>,
    /// The target trajectory or markers.
    pub target: Option<Markers>,
    /// Dimensionless numbers.
    pub numbers: Map<String, Value>,
    /// The Pareto front.
    pub front: Vec<ParetoPoint>,
    /// True if the front was interrupted.
    pub unfinished: bool,
    /// The objectives in the scenarios.
    pub cases: Vec<ScenarioResult>,
    /// Whether the gain survives in the other simulations.
    pub trust: Option<Robustness>,
}

/// A simulated motion, and the rod that moved.
#[derive(Debug)]
pub(super) struct DesignMotion {
    pub trajectory: Trajectory,
    pub rod: Rod,
    /// Some of its times, to be drawn.
    pub drawn: RodMotion,
}

/// Frames of a motion that is drawn, unless it has fewer steps.
const FRAMES: RangeInclusive<usize> = 300..=600;

impl DesignMotion {
    /// Simulates `problem` as `set` makes it, first for the scene's own design and then for the answer. Both are drawn at the same times.
    fn pair(
        scene: &Scene,
        problem: &mut Problem,
        mut set: impl FnMut(&mut Problem, bool) -> Result<()>,
    ) -> Result<[Self; 2]> {
        let mut drive: Option<f64> = None;
        for is_answer in [false, true] {
            set(problem, is_answer)?;
            drive = drive.into_iter().chain(fastest_drive(scene, problem.model())).reduce(f64::max);
        }
        let mut motion = |is_answer| {
            set(problem, is_answer)?;
            Self::of(problem, drive)
        };
        Ok([motion(false)?, motion(true)?])
    }

    /// Simulates `problem`, and draws it with so many frames per period of the `drive` (Hz).
    fn of(problem: &mut Problem, drive: Option<f64>) -> Result<Self> {
        let trajectory = problem.simulate()?;
        let model = problem.model();
        let all: Vec<usize> = (0..model.rod.nodes).collect();
        let (shown, is_of_last_periods) = shown_rows(&trajectory.times, drive, &FRAMES);
        let row = |n: usize| {
            let q = trajectory.positions(n);
            (trajectory.times[n], move |k: usize| [q[2 * k], q[2 * k + 1]])
        };
        let drawn = RodMotion::of_positions(model, &all, shown.into_iter().map(row));
        let drawn = RodMotion { drive, is_of_last_periods, ..drawn };
        Ok(Self { rod: model.rod.clone(), drawn, trajectory })
    }
}

/// A profile that the design is compared with.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ComparedProfile {
    pub name: String,
    pub profile: DesignVector,
    /// The objective; `None` if the simulation fails.
    pub objective: Option<f64>,
    /// A limit that it breaks.
    pub breaks: Option<String>,
}

impl Design {
    /// Solves the design problem of `document`. `tell` is called after each iteration, and without an iteration in between; it may
    /// stop the search.
    ///
    /// # Errors
    /// [`Error::Scene`] for a wrong `[design]`; [`Error::Design`] if there is no answer; those of data and simulation.
    pub fn of(document: &Document, tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>) -> Result<Self> {
        Self::made(document, None, tell)
    }

    /// Solves the problem for [`write`](Self::write) to `folder`, where the results of simulations are stored: an interrupted
    /// search resumes there, with bit-identical results.
    ///
    /// # Errors
    /// Those of [`of`](Self::of); those of [`claim`](Self::claim).
    pub fn resumed(
        document: &Document,
        folder: &Path,
        tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<Self> {
        Self::made(document, Some(folder), tell)
    }

    /// The maximum number of iterations of the search that `scene` requests, including those of a front; `None` if it requests no search.
    pub fn max_iterations(scene: &Scene) -> Option<usize> {
        let table = DesignTable::of(scene).ok().filter(DesignTable::is_searched)?;
        let searches = table.start_count() + table.front.as_ref().map_or(0, |front| front.points - 1);
        Some(searches * (1 + table.iterations.unwrap_or(DEFAULT_MAX_ITERATIONS)))
    }

    /// The default folder of results.
    pub fn folder(scene: &Scene) -> PathBuf {
        PathBuf::from("out").join(format!("{}-design", scene.name))
    }

    /// Claims `folder` for the results on `scene`, see [`Folder::claim`]: before a long search, or to replace the results of others.
    ///
    /// # Errors
    /// Those of [`Folder::claim`].
    pub fn claim(scene: &Scene, folder: &Path, claim: Claim) -> Result<Folder> {
        Folder::claim(folder, Owner::of("design", scene), claim, &checkpoint::RESULT_FILES)
    }

    fn made(
        document: &Document,
        folder: Option<&Path>,
        mut tell: impl FnMut(Option<&SearchIteration>) -> ControlFlow<()>,
    ) -> Result<Self> {
        let scene = document.scene()?;
        let table = DesignTable::of(&scene).map_err(|fault| document.error_at(&fault))?;
        let mut dynamics = Dynamics::new(Arc::new(scene.model()?));
        let asked = document;
        let document = &with_fixed_fluid(document, &scene);
        let rod = scene.model()?.rod;
        let data = |least: usize| match &table.data {
            Some(file) => {
                let marked = match table.goal {
                    Goal::TrackTip => MarkedNodes::Tip,
                    Goal::Identify if table.is_searched() => MarkedNodes::Every,
                    _ => MarkedNodes::All,
                };
                Markers::read(&scene.folder.join(file), &rod, marked, least).map(Some)
            }
            None => Ok(None),
        };
        let mut lines = Vec::new();
        let mut evidence = Evidence { numbers: dimensionless(&scene), ..Evidence::default() };
        let (mut answer, profile) = match table.goal {
            Goal::Identify if !table.is_searched() => {
                if let Some(law) = dynamics.model.forces.global() {
                    let problem = format!(
                        "{:?} found, whose drag at a node depends on all of the rod, and noise with it; allowed here: a law for each edge, as \"cox\"",
                        law.name()
                    );
                    return Err(document.error_at(&crate::scene::KeyError { key: "drag.law".into(), problem }));
                }
                let markers = data(MIN_SAMPLES)?.unwrap_or_default().without_glitches();
                let mut found = identify(&mut dynamics, &markers, &table)?;
                let unfit = explain_misfit(&found);
                let follows_fluid = explain_fluid_share(&mut dynamics, &markers, &table, &found);
                let mut profile = DesignVector::of(found.joints.iter().map(|joint| joint.stiffness_n_m2).collect());
                profile.amplitude.fill(found.actuation_gain.unwrap_or(1.0));
                let steps = fixed_steps(&scene);
                let with_step = |step: f64| {
                    let changes = [&steps[..], &[format!("solver.time_step_s={step:e}")]].concat();
                    scene_with(document, &[], &changes, &DesignVector::of(Vec::new()))
                };
                let step = scene_with(document, &[], &steps, &DesignVector::of(Vec::new()))?.typical_step();
                let deviations: Vec<f64> = found.joints.iter().map(|joint| joint.deviation_n_m2).collect();
                if let Ok(refit) =
                    Refit::of(with_step, step, &profile, (&markers, found.noise_m), (&deviations, table.actuation_gain))
                {
                    found.judge(refit);
                }
                lines.extend(explain_identification(&found).into_iter().chain(unfit));
                lines.extend(explain_effect(&scene).into_iter().chain(follows_fluid));
                match scene_with(document, &[], &steps, &DesignVector::of(Vec::new()))
                    .and_then(|scene| simulated(&scene, &profile))
                {
                    Ok(motions) => evidence.motions = motions.into(),
                    Err(error) => lines.push(format!("no simulation to compare with the data: {error}")),
                }
                evidence.checks = replay(document, &scene, &table, &markers, &profile);
                lines.extend(found.refit.as_ref().and_then(explain_refit));
                evidence.target = Some(markers);
                (Answer::Identification(found), profile)
            }
            Goal::StaticShape => {
                let markers = data(1)?.unwrap_or_default();
                let mut found = rest(&mut dynamics, &markers.positions[0], &table)?;
                for (node, ei) in &found.missed {
                    lines
                        .push(format!("node {node} misses the shape: it would take EI = {} N m²", in_sentence(*ei, 5)));
                }
                if !found.undecided.is_empty() {
                    let nodes = &found.undecided;
                    lines.push(format!("neither curvature nor moment at nodes {nodes:?}: any stiffness does"));
                }
                let profile = DesignVector::of(found.stiffness_n_m2.clone());
                let own = Problem::of(&scene).map(|problem| DesignVector::of(problem.stiffness()))?;
                let [designed, before] =
                    [&profile, &own].map(|profile| resting(document, profile, &markers.positions[0]));
                evidence.checks.push(Check { simulation: "at rest".into(), designed, before, ..Check::default() });
                found.state = rest_of(document, &profile, &markers.positions[0], &found);
                lines.extend(found.state.words());
                evidence.target = Some(markers);
                (Answer::StaticShape(found), profile)
            }
            Goal::Identify | Goal::TrackTip | Goal::Distance | Goal::Efficiency | Goal::Cycle(_) => {
                let target = data(1)?;
                let (objective, problem) = objective_of(document, &scene, &table, target.as_ref())?;
                let mut search = Search::new(&table, &objective, problem);
                search.scenarios = scenarios(asked, &scene, &table)?;
                if let Some(folder) = folder.filter(|_| !table.fits_positions()) {
                    search.checkpoint = Checkpoint::open(folder, &scene, &table)?;
                }
                let mut found = search.run(&mut tell)?;
                if let Some(markers) = target.as_ref().filter(|_| table.goal == Goal::Identify) {
                    found.count_discretisation(document, &scene, &table, markers);
                }
                lines.extend(explain_search(&found, &table));
                lines.extend(explain_joints(&found, &table, search.reference));
                let profile = found.profile.clone();
                if table.goal != Goal::Identify {
                    evidence.profiles = compare(&mut search, &found, &table);
                }
                let own = DesignVector {
                    numbers: table.initial_numbers(),
                    ..DesignVector::of(found.own_stiffness_n_m2.clone())
                };
                let before = evidence.profiles.first().map_or(&own, |compared| &compared.profile);
                if let Ok(motions) = motions(&scene, &mut search, before, &profile) {
                    evidence.motions = motions.into();
                }
                evidence.cases = in_scenarios(&mut search, before, &profile);
                lines.extend(explain_scenarios(&evidence.cases, &table));
                if table.goal == Goal::Identify {
                    let markers = target.clone().unwrap_or_default();
                    evidence.checks = replay(document, &scene, &table, &markers, &profile);
                } else if found.interrupted {
                    lines.push(
                        "interrupted: it was not simulated again with other steps, methods or meshes".to_string(),
                    );
                } else {
                    let checks =
                        RobustnessChecks::of((document, &search.scenarios), &scene, &table, target.as_ref(), &profile);
                    evidence.checks = checks.make(&mut search.checkpoint);
                    let run = |case: Option<String>, document: &Document, profile: &DesignVector| {
                        WholeRun::of(case, &scene_with(document, &table.numbers, &[], profile).ok()?)
                    };
                    let [own, designed] = [before, &profile].map(|profile| run(None, document, profile));
                    // Statements that question the answer come first.
                    let notes = [(BASELINE, &own), ("the design", &designed)].map(|(of, run)| {
                        let notes = run.iter().flat_map(|run| &run.notes);
                        notes.map(|note| format!("of {of}: {note}")).collect::<Vec<_>>()
                    });
                    lines.splice(0..0, notes.into_iter().flatten());
                    let again = || Problem::of(&scene);
                    (evidence.front, evidence.unfinished) =
                        front(&table, &objective, &found, (again, &mut search.checkpoint), &mut tell)?;
                    lines.extend(explain_front(&evidence.front, &table));
                    if table.is_over_cycles() {
                        let (mut bases, mut designs) = (Vec::new(), Vec::new());
                        if search.scenarios.is_empty() {
                            bases.extend(own);
                            designs.extend(designed);
                            let others =
                                evidence.front.iter().enumerate().filter(|(_, point)| point.profile != profile);
                            designs.extend(others.filter_map(|(i, point)| {
                                run(Some(format!("point {} of the front", i + 1)), document, &point.profile)
                            }));
                        }
                        for case in &search.scenarios {
                            let of = |profile: &DesignVector| {
                                run(Some(case.name.clone()), &case.document, &case.profile(profile))
                            };
                            bases.extend(of(before));
                            designs.extend(of(&profile));
                        }
                        lines.extend(explain_cycles(
                            BASELINE,
                            "with a longer solver.duration_s the gain may differ",
                            &bases,
                        ));
                        lines.extend(explain_cycles(
                            "its",
                            "with a longer solver.duration_s another design may be better",
                            &designs,
                        ));
                    }
                    if !table.fits_positions() && found.kept {
                        found.tolerances = search.tolerances(&found);
                    }
                }
                for compared in evidence.profiles.iter().filter(|compared| compared.name != "design") {
                    if let Some(value) = compared.objective {
                        let gain = table.gain_in_words(found.objective, value, "");
                        let value = in_sentence(value, 7);
                        lines.push(match (&compared.breaks, gain) {
                            (Some(limit), _) => format!("{}: {value}, but it breaks a limit: {limit}", compared.name),
                            (None, Some(gain)) => format!("{}: {value}; the design is {gain}", compared.name),
                            (None, None) => format!("{}: {value}; the design is no better", compared.name),
                        });
                    }
                }
                evidence.target = target;
                (Answer::Search(Box::new(found)), profile)
            }
        };
        for check in &evidence.checks {
            let value = beside_own(&table, check.designed, check.before);
            let what = match table.goal {
                Goal::Identify => " rms distance from the markers (m)",
                Goal::StaticShape => " rms distance from the shape (m)",
                _ => "",
            };
            let failure = check.failure.as_ref().map_or(String::new(), |failure| {
                let which = if check.designed.is_none() { "the design" } else { BASELINE };
                format!("; {which} fails in this simulation: {failure}")
            });
            lines.push(format!("simulated again, {}:{what} {value}{failure}", check.simulation));
        }
        let kept = !matches!(&answer, Answer::Search(found) if !found.kept);
        if table.goal.is_dynamic()
            && let Some(trust) = Robustness::of(&evidence.checks, kept)
        {
            lines.push(trust.words());
            evidence.trust = Some(trust);
        }
        if let Answer::Search(found) = &answer {
            lines.extend(explain_tolerances(&found.tolerances));
        }
        let designed = designed(document, &scene, &table.numbers, &profile)?;
        let stiffness = if profile.stiffness_n_m2.is_empty() {
            let rod = profile.numbers_in(document, &table.numbers)?.model()?.rod;
            rod.joints().map(|k| rod.joint_stiffness(k)).collect()
        } else {
            profile.stiffness_n_m2
        };
        if let Answer::Search(found) = &mut answer {
            found.profile.stiffness_n_m2.clone_from(&stiffness);
        }
        Ok(Self { table, answer, stiffness, lines, evidence, scene, document: document.clone(), designed })
    }

    /// Writes the designed scene, design.json, tables, figures and report.html to `folder`, in this order, each atomically.
    ///
    /// # Errors
    /// Those of [`claim`](Self::claim), [`Error::Page`].
    pub fn write(&self, folder: &Path) -> Result<WrittenFiles> {
        let failed = |reason: String| Error::Page { reason };
        let findings = self.findings()?;
        let numbers = serde_json::to_string_pretty(&self.numbers()?).map_err(|e| failed(e.to_string()))?;
        let mut texts = vec![
            (format!("{}-designed.toml", self.scene.name), self.designed.text().to_string()),
            ("design.json".to_string(), numbers + "\n"),
        ];
        for (i, point) in self.evidence.front.iter().enumerate() {
            let scene = designed(&self.document, &self.scene, &self.table.numbers, &point.profile)?;
            texts.push((format!("{}-front-{}.toml", self.scene.name, i + 1), scene.text().to_string()));
        }
        let rod = self.designed.scene()?.model()?.rod;
        texts.push(("body.stl".to_string(), stl::stl(&self.scene.name, &rod)));
        for table in &findings.tables {
            texts.push((table.file.to_string(), table.csv().map_err(|e| failed(e.to_string()))?));
        }
        texts.extend(findings.figures.iter().map(|figure| (figure.file.clone(), figure.svg.clone())));
        texts.push(("report.html".to_string(), findings.page(&self.scene.name, &self.document)?));
        let mut folder = Self::claim(&self.scene, folder, Claim::Own)?;
        let kept = folder.results().all(&texts);
        let going_on = matches!(&self.answer, Answer::Search(found) if found.interrupted) || self.evidence.unfinished;
        if kept.lost.is_empty() && !going_on {
            folder.forget_journals();
        }
        Ok(kept)
    }

    /// The content of design.json.
    ///
    /// # Errors
    /// [`Error::Page`].
    pub fn numbers(&self) -> Result<Value> {
        let failed = |e: serde_json::Error| Error::Page { reason: e.to_string() };
        let rod = self.scene.model()?.rod;
        Ok(json!({
            "name": self.scene.name,
            "caudal_version": env!("CARGO_PKG_VERSION"),
            "goal": self.table.goal,
            "status": self.status(),
            "reference_stiffness_n_m2": rod.ei,
            "xi": rod.joints().map(|k| rod.xi(k)).collect::<Vec<_>>(),
            "stiffness_n_m2": self.stiffness,
            "bounds": self.table.bounds,
            "lines": self.lines,
            "dimensionless": self.evidence.numbers,
            "checks": serde_json::to_value(&self.evidence.checks).map_err(failed)?,
            "cases": serde_json::to_value(&self.evidence.cases).map_err(failed)?,
            "front": serde_json::to_value(&self.evidence.front).map_err(failed)?,
            "trust": serde_json::to_value(&self.evidence.trust).map_err(failed)?,
            "compared": serde_json::to_value(&self.evidence.profiles).map_err(failed)?,
            "answer": serde_json::to_value(&self.answer).map_err(failed)?,
        }))
    }

    /// Advice for a search that did not converge.
    pub fn advice(&self) -> &'static str {
        match &self.answer {
            Answer::Search(found) if found.why == ITERATIONS_EXHAUSTED => "try more design.iterations",
            Answer::Search(found) if !found.kept => {
                "it does not keep its limits; try more design.starts, or weaker limits"
            }
            _ => "it ended by itself; try more design.starts, a smaller solver.newton_tolerance, or fewer variables",
        }
    }

    pub(super) fn status(&self) -> &'static str {
        match &self.answer {
            Answer::Search(found) if found.interrupted => "interrupted",
            Answer::Search(found) if !found.converged => "not converged",
            Answer::StaticShape(found) => found.state.name(),
            _ => "solved",
        }
    }
}

/// The objectives of design and baseline in each scenario.
fn in_scenarios(search: &mut Search<'_>, before: &DesignVector, profile: &DesignVector) -> Vec<ScenarioResult> {
    let mut of = |profile: &DesignVector| match search.in_scenarios(profile) {
        Some(values) => values.into_iter().map(Some).collect(),
        None => vec![None; search.scenarios.len()],
    };
    let (before, designed) = (of(before), of(profile));
    let row = |((case, before), designed): ((&Scenario, Option<f64>), Option<f64>)| ScenarioResult {
        case: case.name.clone(),
        designed,
        before,
        gain_percent: designed.zip(before).and_then(|(designed, before)| search.table.gain_percent(designed, before)),
    };
    search.scenarios.iter().zip(before).zip(designed).map(row).collect()
}

/// The dimensionless numbers that determine the effect of stiffness (Sp, β, …), if the scene has them.
fn dimensionless(scene: &Scene) -> Map<String, Value> {
    let mut numbers = Map::new();
    let assessed = Stepper::of(scene).and_then(|stepper| Assessment::of(scene, &stepper));
    if let Ok(assessed) = assessed {
        for (name, value) in [
            ("sperm_number", assessed.sperm_number),
            ("inertia_ratio", assessed.inertia_ratio),
            ("frequency_ratio", assessed.frequency_ratio),
            ("reynolds_number", assessed.reynolds),
        ] {
            numbers.insert(name.to_string(), json!(value));
        }
        numbers.insert("warnings".to_string(), json!(assessed.all_warnings().collect::<Vec<_>>()));
    }
    numbers
}

/// Prefix of the names of profiles that have only one part of the design.
pub(super) const ALONE: &str = "the scene's own with only the design's ";

/// The baseline, a uniform profile, one that falls linearly to a half (as in the source study) and the best linear one of the same
/// mean, each part of the design alone, and the design, with their objectives.
fn compare(search: &mut Search<'_>, found: &SearchResult, table: &DesignTable) -> Vec<ComparedProfile> {
    let before = DesignVector::before(table, &search.own_stiffness);
    let rod = &search.problem.model().rod;
    let xi: Vec<f64> = rod.joints().map(|k| rod.xi(k)).collect();
    let reference = search.reference;
    let even = if table.variables.contains(&DesignVariable::Stiffness) { table.mean.unwrap_or(1.0) } else { 1.0 };
    let centre = xi.iter().sum::<f64>() / xi.len() as f64;
    let of = |factors: Vec<f64>| DesignVector {
        numbers: table.initial_numbers(),
        ..DesignVector::of(factors.iter().map(|factor| factor * reference).collect())
    };
    let linear = |slope: f64| of(xi.iter().map(|xi| even * (1.0 + slope * (centre - xi))).collect());
    // The effects of stiffness, amplitude and phase alone, if several of them are designed.
    let parts = [DesignVariable::Stiffness, DesignVariable::Amplitude, DesignVariable::Phase];
    let parts: Vec<_> = parts.into_iter().filter(|part| table.variables.contains(part)).collect();
    let acts = parts.iter().any(|part| *part != DesignVariable::Stiffness);
    let with_own_actuation = if acts { ", the scene's actuation" } else { "" };
    let mut profiles = Vec::new();
    let mut add = |name: &str, profile: DesignVector, search: &mut Search<'_>| {
        let objective = search.value(&profile);
        let breaks = search.most_used(&profile).and_then(|limit| limit.broken(FEASIBILITY_TOLERANCE));
        profiles.push(ComparedProfile { name: name.to_string(), profile, objective, breaks });
    };
    let alike = before.stiffness_n_m2.iter().all(|ei| (ei / (even * reference) - 1.0).abs() < SAME_STIFFNESS);
    add(BASELINE, before.clone(), search);
    if table.variables.contains(&DesignVariable::Stiffness) {
        if !alike {
            let stiffness = in_sentence(even * reference, 3);
            add(&format!("even stiffness of {stiffness} N m²{with_own_actuation}"), of(vec![even; xi.len()]), search);
        }
        if table.goal != Goal::TrackTip && !found.interrupted {
            let gradient = of(xi.iter().map(|xi| even * (2.0 - xi) / (2.0 - centre)).collect());
            add(&format!("stiffness falling linearly to a half{with_own_actuation}"), gradient, search);
            if let Some((slope, _)) = search.best_linear() {
                add(&format!("best linear profile (slope {slope:.3}){with_own_actuation}"), linear(slope), search);
            }
        }
    }
    for part in parts.iter().filter(|_| parts.len() > 1) {
        let (mut alone, design) = (before.clone(), &found.profile);
        let what = match part {
            DesignVariable::Stiffness => {
                alone.stiffness_n_m2.clone_from(&design.stiffness_n_m2);
                "stiffness"
            }
            DesignVariable::Amplitude => {
                alone.amplitude.clone_from(&design.amplitude);
                "amplitude"
            }
            _ => {
                alone.phase_rad.clone_from(&design.phase_rad);
                "phase"
            }
        };
        add(&format!("{ALONE}{what}"), alone, search);
    }
    let designed = ComparedProfile {
        name: "design".into(),
        profile: found.profile.clone(),
        objective: Some(found.objective),
        breaks: found.limits.iter().find_map(|limit| limit.broken(FEASIBILITY_TOLERANCE)),
    };
    profiles.push(designed);
    profiles
}

/// The motions of two designs.
fn motions(
    scene: &Scene,
    search: &mut Search<'_>,
    before: &DesignVector,
    after: &DesignVector,
) -> Result<[DesignMotion; 2]> {
    let objective = &search.objective;
    DesignMotion::pair(scene, &mut search.problem, |problem, is_answer| {
        objective.set(problem, if is_answer { after } else { before })
    })
}

/// The motions of the original scene and with `profile`.
fn simulated(scene: &Scene, profile: &DesignVector) -> Result<[DesignMotion; 2]> {
    DesignMotion::pair(scene, &mut Problem::of(scene)?, |problem, is_answer| {
        *problem = Problem::of(scene)?;
        if is_answer {
            problem.set_stiffness(&profile.stiffness_n_m2)?;
            problem.set_actuation(&profile.amplitude, &profile.phase_rad)?;
        }
        Ok(())
    })
}

/// The distance of the rod from `markers` without and with the identified profile, in several simulations.
fn replay(
    document: &Document,
    scene: &Scene,
    table: &DesignTable,
    markers: &Markers,
    profile: &DesignVector,
) -> Vec<Check> {
    let fixed = fixed_steps(scene);
    let measure = |changes: &[String], profile: &DesignVector| -> Option<f64> {
        let changes = [&fixed[..], changes].concat();
        let variant = scene_with(document, &table.numbers, &changes, profile).ok()?;
        let trajectory = Problem::of(&variant).ok()?.simulate().ok()?;
        let finer = (variant.rod.nodes.get() - 1) / (scene.rod.nodes.get() - 1);
        distances(&trajectory, markers, (finer, usize::from(scene.head_body.is_some())))
            .map(|distances| rms(distances.iter().copied()))
    };
    let scene_of = |changes: &[String]| scene_with(document, &[], changes, &DesignVector::of(Vec::new()));
    let fixed_scene = scene_of(&fixed);
    let own = fixed_scene.as_ref().ok().and_then(|scene| Problem::of(scene).ok());
    let own = own.map(|problem| DesignVector::of(problem.stiffness()));
    let check = |(simulation, changes): (String, Vec<String>)| {
        let designed = measure(&changes, profile);
        let before = own.as_ref().and_then(|own| measure(&changes, own));
        let gain_percent = designed.zip(before).and_then(|(designed, before)| table.gain_percent(designed, before));
        Check { simulation, designed, before, gain_percent, ..Check::default() }
    };
    simulations(fixed_scene.as_ref().unwrap_or(scene)).into_iter().map(check).collect()
}

/// The stability of the equilibrium of a profile near `positions`.
fn rest_of(document: &Document, profile: &DesignVector, positions: &[f64], found: &StaticShape) -> Equilibrium {
    let steady = || -> Option<SteadyState> {
        SteadyState::near(scene_with(document, &[], &[], profile).ok()?.model().ok()?, positions).ok()
    };
    match steady().map(|mut steady| steady.eigenvalues()) {
        None => Equilibrium::Unknown,
        Some(Ok(values)) if values.iter().any(|(value, uncertainty)| grows(*value, *uncertainty)) => {
            Equilibrium::Unstable
        }
        Some(_) if !found.missed.is_empty() => Equilibrium::Missed,
        Some(_) => Equilibrium::Stable,
    }
}

/// The distance (m, root mean square) of the equilibrium of a profile from `positions`; `None` if none is found.
fn resting(document: &Document, profile: &DesignVector, positions: &[f64]) -> Option<f64> {
    let scene = scene_with(document, &[], &[], profile).ok()?;
    let mut dynamics = Dynamics::new(Arc::new(scene.model().ok()?));
    let mut newton = Newton::new(dynamics.nodes(), REST_TOLERANCE).ok()?;
    let mut state = dynamics.first_state();
    state.q.get_mut(..positions.len())?.copy_from_slice(positions);
    continue_to_rest(&mut dynamics, &mut newton, &mut state).ok()?;
    let nodes = state.q.as_chunks::<2>().0.iter().zip(positions.as_chunks::<2>().0);
    Some(rms(nodes.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))))
}
