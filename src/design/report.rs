//! A design from scene to files: what was asked, what was found, how it stands re-simulated, and a scene with the designed
//! profile.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::cases::{Case, cases};
use super::checks::Checks;
use super::front::{Compromise, front};
use super::identify::{Identified, Joint, Verdict, identify};
use super::limits::Used;
use super::markers::{LEAST, Markers};
use super::memory::{self, Memory};
use super::outline;
use super::refit::Refit;
use super::search::{CASE, EXHAUSTED, Found, FoundNumber, Iteration, Objective, SAME, Search};
use super::shape::{Rest, Resting, rest};
use super::table::{Goal, Table, Variable};
use super::trust::{LOOSE, Tolerance, Trust};
use super::unknowns::Profile;
use crate::check::Assessment;
use crate::error::{Error, Result};
use crate::integrator::StepControl;
use crate::linear_stability::{REST_TOLERANCE, SteadyState, come_to_rest, grows};
use crate::model::Dynamics;
use crate::newton::Newton;
use crate::report::{Claim, Folder, Kept, Owner};
use crate::rod;
use crate::scene::{Document, Scene};
use crate::sensitivity::number::{Number, keys_with};
use crate::sensitivity::{Output, Parameter, Problem, Quantity, Trajectory};
use crate::stepper::Stepper;
use crate::system::System;

/// A limit that is passed by a smaller part is kept.
const PASSED: f64 = 1e-6;

/// What a design is compared with, everywhere.
pub(super) const BEFORE: &str = "the scene's own";

/// A stiffness that is off by a smaller part is the same.
const ALIKE: f64 = 1e-9;

/// Steps of a period, and of a duration without one, where a scene gives none.
const STEPS: [f64; 2] = [200.0, 1000.0];

/// A tip that moves by less than this part of the length for twice the stiffness hardly feels it.
const HARDLY: f64 = 1e-2;

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
    pub(super) evidence: Evidence,
    pub(super) scene: Scene,
    document: Document,
    pub(super) designed: Document,
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
    Found(Box<Found>),
}

/// A scene's `[design]`.
#[derive(Deserialize)]
struct Wanted {
    #[serde(rename = "design")]
    _table: Option<Table>,
}

/// What stands beside the answer.
#[derive(Debug, Default)]
pub(super) struct Evidence {
    /// The answer in other simulations.
    pub checks: Vec<Check>,
    /// Profiles with their objectives: those it is compared with, and the design at the end.
    pub profiles: Vec<Compared>,
    /// The motions before and after; empty where a simulation fails, or there is none.
    pub motions: Vec<Trajectory>,
    /// What was to be met.
    pub target: Option<Markers>,
    /// The numbers that decide what stiffness does.
    pub numbers: Map<String, Value>,
    /// Designs between two goals.
    pub front: Vec<Compromise>,
    /// True where the front was stopped.
    pub unfinished: bool,
    /// The scenes that it is for, where these are cases of a sweep.
    pub cases: Vec<InCase>,
    /// What is left of the gain in the other simulations.
    pub trust: Option<Trust>,
}

/// A profile beside the designed one.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Compared {
    pub name: String,
    pub profile: Profile,
    /// The objective; none where the simulation fails.
    pub objective: Option<f64>,
}

/// The design in one of the scenes that it is for.
#[derive(Debug, Clone, Serialize)]
pub(super) struct InCase {
    pub case: String,
    /// Of the design; none where the simulation fails.
    pub designed: Option<f64>,
    /// Of what was before.
    pub before: Option<f64>,
    /// Gain over it, %.
    pub gain_percent: Option<f64>,
}

/// The answer in another simulation. It is the objective of a dynamic goal, and the root mean square distance of the rod from
/// the markers (m) in identification.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Check {
    pub simulation: String,
    /// Of the design; none where the simulation fails.
    pub designed: Option<f64>,
    /// Of what was before, the scene's own.
    pub before: Option<f64>,
    /// Gain over it, %.
    pub gain_percent: Option<f64>,
}

impl Design {
    /// Designs what `document` asks for; `tell` sees every iteration and may stop the search.
    ///
    /// # Errors
    /// [`Error::Scene`] for a wrong `[design]`; [`Error::Design`] where there is no answer; those of data and simulation.
    pub fn of(document: &Document, tell: impl FnMut(&Iteration) -> ControlFlow<()>) -> Result<Self> {
        Self::made(document, None, tell)
    }

    /// The same for [`write`](Self::write) to `folder`, where a search that is ended, by whatever, leaves what it has simulated: the
    /// next goes on there, to the same bits.
    ///
    /// # Errors
    /// Those of [`of`](Self::of); those of [`claim`](Self::claim).
    pub fn resumed(
        document: &Document,
        folder: &Path,
        tell: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Self> {
        Self::made(document, Some(folder), tell)
    }

    /// The folder of the results on `scene` where none is asked for.
    pub fn folder(scene: &Scene) -> PathBuf {
        PathBuf::from("out").join(format!("{}-design", scene.name))
    }

    /// Claims `folder` for the results on `scene`, see [`Folder::claim`]: before a long search, or to replace results of others.
    ///
    /// # Errors
    /// Those of [`Folder::claim`].
    pub fn claim(scene: &Scene, folder: &Path, claim: Claim) -> Result<Folder> {
        Folder::claim(folder, Owner::of("design", scene), claim, &memory::CERTAIN)
    }

    fn made(
        document: &Document,
        folder: Option<&Path>,
        mut tell: impl FnMut(&Iteration) -> ControlFlow<()>,
    ) -> Result<Self> {
        let scene = document.scene()?;
        document.read_as::<Wanted>()?; // whose complaints know their place
        let table = Table::of(&scene).map_err(|fault| document.refuse(&fault))?;
        let mut dynamics = Dynamics::new(Arc::new(scene.model()?));
        let asked = document;
        let document = &pinned(document, &scene);
        let rod = scene.model()?.rod;
        let data = |least: usize| match &table.data {
            Some(file) => {
                let tip = table.goal == Goal::TrackTip;
                Markers::read(&scene.folder.join(file), &rod, tip, least).map(Some)
            }
            None => Ok(None),
        };
        let mut lines = Vec::new();
        let mut evidence = Evidence { numbers: dimensionless(&scene), ..Evidence::default() };
        let (mut answer, profile) = match table.goal {
            Goal::Identify if !table.is_searched() => {
                if let Some(law) = dynamics.model.forces.whole() {
                    let problem = format!(
                        "{:?} found, whose drag at a node depends on all of the rod, and noise with it; allowed here: a law for each edge, as \"cox\"",
                        law.name()
                    );
                    return Err(document.refuse(&crate::scene::Fault { key: "drag.law".into(), problem }));
                }
                let markers = data(LEAST)?.unwrap_or_default().without_glitches();
                let mut found = identify(&mut dynamics, &markers, &table)?;
                let unfit = say_unfit(&found);
                let mut profile = Profile::of(found.joints.iter().map(|joint| joint.stiffness_n_m2).collect());
                profile.amplitude.fill(found.actuation_gain.unwrap_or(1.0));
                let steps = fixed_steps(&scene);
                let with_step = |step: f64| {
                    let changes = [&steps[..], &[format!("solver.time_step_s={step:e}")]].concat();
                    changed(document, &[], &changes, &Profile::of(Vec::new()))
                };
                let step = changed(document, &[], &steps, &Profile::of(Vec::new()))?.typical_step();
                let deviations: Vec<f64> = found.joints.iter().map(|joint| joint.deviation_n_m2).collect();
                if let Ok(refit) =
                    Refit::of(with_step, step, &profile, (&markers, found.noise_m), (&deviations, table.actuation_gain))
                {
                    found.judge(refit);
                }
                lines.extend(say_identified(&found).into_iter().chain(unfit));
                lines.extend(say_effect(&scene));
                match changed(document, &[], &steps, &Profile::of(Vec::new()))
                    .and_then(|scene| simulated(&scene, &profile))
                {
                    Ok(motions) => evidence.motions = motions.into(),
                    Err(error) => lines.push(format!("no simulation beside the data: {error}")),
                }
                evidence.checks = replay(document, &scene, &table, &markers, &profile);
                lines.extend(found.refit.as_ref().and_then(say_refit));
                evidence.target = Some(markers);
                (Answer::Identified(found), profile)
            }
            Goal::StaticShape => {
                let markers = data(1)?.unwrap_or_default();
                let mut found = rest(&mut dynamics, &markers.positions[0], &table)?;
                for (node, ei) in &found.missed {
                    lines.push(format!("node {node} misses the shape: it would take EI = {ei:.4e} N m²"));
                }
                if !found.undecided.is_empty() {
                    let nodes = &found.undecided;
                    lines.push(format!("neither curvature nor moment at nodes {nodes:?}: any stiffness does"));
                }
                let profile = Profile::of(found.stiffness_n_m2.clone());
                let own = Problem::of(&scene).map(|problem| Profile::of(problem.stiffness()))?;
                for (simulation, profile) in [("at rest, before", &own), ("at rest", &profile)] {
                    let designed = resting(document, profile, &markers.positions[0]);
                    let check = Check { simulation: simulation.into(), designed, before: None, gain_percent: None };
                    evidence.checks.push(check);
                }
                found.state = rest_of(document, &profile, &markers.positions[0], &found);
                lines.extend(found.state.words());
                evidence.target = Some(markers);
                (Answer::Resting(found), profile)
            }
            Goal::Identify | Goal::TrackTip | Goal::Distance | Goal::Efficiency | Goal::Cycle(_) => {
                let target = data(1)?;
                let (objective, problem) = aim(document, &scene, &table, target.as_ref())?;
                let mut search = Search::new(&table, &objective, problem);
                search.cases = cases(asked, &scene, &table)?;
                if let Some(folder) = folder.filter(|_| !table.fits_positions()) {
                    search.memory = Memory::open(folder, &scene, &table)?;
                }
                let mut found = search.run(&mut tell)?;
                lines.extend(say_found(&found, &table));
                let profile = found.profile.clone();
                if table.goal != Goal::Identify {
                    evidence.profiles = compare(&mut search, &found, &table);
                }
                let own = Profile { numbers: table.own_numbers(), ..Profile::of(found.own_stiffness_n_m2.clone()) };
                let before = evidence.profiles.first().map_or(&own, |compared| &compared.profile);
                if let Ok(motions) = motions(&mut search, before, &profile) {
                    evidence.motions = motions.into();
                }
                evidence.cases = in_cases(&mut search, before, &profile);
                lines.extend(say_cases(&evidence.cases, &table));
                if table.goal == Goal::Identify {
                    let markers = target.clone().unwrap_or_default();
                    evidence.checks = replay(document, &scene, &table, &markers, &profile);
                } else if found.interrupted {
                    lines.push(
                        "interrupted: it was not simulated again with other steps, methods or meshes".to_string(),
                    );
                } else {
                    let checks = Checks::of((document, &search.cases), &scene, &table, target.as_ref(), &profile);
                    evidence.checks = checks.make(&mut search.memory);
                    let again = || Problem::of(&scene);
                    (evidence.front, evidence.unfinished) =
                        front(&table, &objective, &found, (again, &mut search.memory), &mut tell)?;
                    lines.extend(say_front(&evidence.front, &table));
                    if !table.fits_positions() {
                        found.tolerances = search.tolerances(&found);
                    }
                }
                for compared in evidence.profiles.iter().filter(|compared| compared.name != "design") {
                    if let Some(value) = compared.objective {
                        let gain = gain_percent(&table, found.objective, value);
                        lines.push(format!("{}: {value:.6e}; the design is {gain:+.2} % better", compared.name));
                    }
                }
                evidence.target = target;
                (Answer::Found(Box::new(found)), profile)
            }
        };
        for check in &evidence.checks {
            let gain = check.gain_percent.filter(|gain| gain.abs() >= 0.005);
            let gain = gain.map_or(String::new(), |gain| format!(", {gain:+.2} % better than before"));
            let value = check.designed.map_or("fails".to_string(), |value| format!("{value:.6e}"));
            let what = match table.goal {
                Goal::Identify => " rms distance from the markers (m)",
                Goal::StaticShape => " rms distance from the shape (m)",
                _ => "",
            };
            lines.push(format!("simulated again, {}:{what} {value}{gain}", check.simulation));
        }
        if table.goal.is_dynamic()
            && let Some(trust) = Trust::of(&evidence.checks)
        {
            lines.push(trust.words());
            evidence.trust = Some(trust);
        }
        if let Answer::Found(found) = &answer {
            lines.extend(say_tolerances(&found.tolerances));
        }
        let designed = designed(document, &scene, &table.numbers, &profile)?;
        let stiffness = if profile.stiffness_n_m2.is_empty() {
            let rod = profile.numbers_in(document, &table.numbers)?.model()?.rod;
            rod.joints().map(|k| rod.joint_stiffness(k)).collect()
        } else {
            profile.stiffness_n_m2
        };
        if let Answer::Found(found) = &mut answer {
            found.profile.stiffness_n_m2.clone_from(&stiffness);
        }
        Ok(Self { table, answer, stiffness, lines, evidence, scene, document: document.clone(), designed })
    }

    /// Writes the scene with the designed profile, design.json, tables, figures and report.html to `folder`, in this order, each
    /// put in place whole.
    ///
    /// # Errors
    /// Those of [`claim`](Self::claim), [`Error::Page`].
    pub fn write(&self, folder: &Path) -> Result<Kept> {
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
        texts.push(("body.stl".to_string(), outline::stl(&self.scene.name, &rod)));
        for table in &findings.tables {
            texts.push((table.file.to_string(), table.csv().map_err(|e| failed(e.to_string()))?));
        }
        texts.extend(findings.figures.iter().map(|figure| (figure.file.clone(), figure.svg.clone())));
        texts.push(("report.html".to_string(), findings.page(&self.scene.name, &self.document)?));
        let mut folder = Self::claim(&self.scene, folder, Claim::Own)?;
        let kept = folder.results().all(&texts);
        let going_on = matches!(&self.answer, Answer::Found(found) if found.interrupted) || self.evidence.unfinished;
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

    /// What can be done where its search did not converge.
    pub fn advice(&self) -> &'static str {
        match &self.answer {
            Answer::Found(found) if found.why == EXHAUSTED => "try more design.iterations",
            Answer::Found(found) if !found.kept => {
                "it does not keep its limits; try more design.starts, or weaker limits"
            }
            _ => "it ended by itself; try more design.starts, a smaller solver.newton_tolerance, or fewer variables",
        }
    }

    pub(super) fn status(&self) -> &'static str {
        match &self.answer {
            Answer::Found(found) if found.interrupted => "interrupted",
            Answer::Found(found) if !found.converged => "not converged",
            Answer::Resting(found) => found.state.name(),
            _ => "solved",
        }
    }
}

pub(super) fn objective_label(goal: Goal) -> &'static str {
    match goal {
        Goal::TrackTip => "rms distance of the tip from its target (m)",
        Goal::Identify => "rms distance of the rod from the markers (m)",
        Goal::Distance => "distance (m)",
        Goal::Cycle(key) => key,
        _ => "distance² over work (m²/J)",
    }
}

fn say_identified(found: &Identified) -> Vec<String> {
    let count = |verdict: Verdict| found.joints.iter().filter(|joint| joint.verdict == verdict).count();
    let all = found.joints.len();
    let unfit = match count(Verdict::DoesNotFit) {
        0 => String::new(),
        some => format!("{some} that do not fit, "),
    };
    let mut lines = vec![format!(
        "{} of {all} joints identified, {} prior-driven, {} at a bound, {}{} unobservable; noise {:.2e} m, {} samples, \
         windows of {}",
        count(Verdict::Identified),
        count(Verdict::PriorDriven),
        count(Verdict::AtABound),
        unfit,
        count(Verdict::Unobservable),
        found.noise_m,
        found.samples,
        2 * found.window_samples + 1,
    )];
    if found.joints.iter().all(|joint| joint.drowns()) {
        lines.push(
            "stiffness cannot be identified from these data: what the rod bends beyond its natural curvature drowns in the \
             noise of the positions"
                .to_string(),
        );
    }
    if let Some(gain) = found.actuation_gain {
        let edge = if found.gain_at_edge { ", an edge of what is looked for: nothing is identified" } else { "" };
        lines.push(format!("the actuation is {gain:.5} times the scene's{edge}"));
    }
    lines.extend(found.left_out.iter().map(|what| format!("left out: {what}")));
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

/// How many joints do not fit by their balance, and by how much.
fn say_unfit(found: &Identified) -> Option<String> {
    let unfit: Vec<&Joint> = found.joints.iter().filter(|joint| joint.verdict == Verdict::DoesNotFit).collect();
    let worst = unfit.iter().fold(0.0, |max: f64, joint| max.max(joint.residual_over_noise));
    (!unfit.is_empty()).then(|| {
        format!(
            "{} of {} joints do not fit: what is left of their balance is up to {worst:.1} times what noise leaves, so that mass, \
             fluid, loads, drive or mesh of the scene are not those of the data; deviations include it",
            unfit.len(),
            found.joints.len()
        )
    })
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
    if !found.converged && !found.interrupted {
        lines.push(format!("the search ended because {}", found.why));
    }
    if found.starts.len() > 1 {
        let known = found.optima.iter().flatten();
        let (came, count) = (known.clone().count(), known.copied().max().unwrap_or(0));
        let optima = if count == 1 { "optimum" } else { "optima" };
        lines.push(format!(
            "{came} of {} starts converged, to {count} {optima}, which are the same where objectives agree to {} % or unknowns to {}",
            found.starts.len(),
            100.0 * SAME[0],
            SAME[1]
        ));
    }
    lines.extend(found.numbers.iter().map(say_number));
    if let Some(noise) = found.noise_m {
        let whose = if table.noise_m.is_some() { "as given" } else { "as what is left" };
        lines.push(format!("deviations are those of positions that are uncertain by {noise:.2e} m, {whose}"));
    }
    if let Some(misfit) = found.misfit {
        lines.push(format!(
            "the simulation does not fit: {misfit:.1} times the noise of the markers is left, so that start, drive, fluid, mass, loads, steps \
             or mesh of the scene are not those of the data; deviations include it"
        ));
    }
    for names in &found.confused {
        lines.push(match &names[..] {
            [name] => format!("the data do not know {name}"),
            several => format!("the data do not tell {} apart: they know them only together", several.join(" and ")),
        });
    }
    for Used { limit, used } in &found.limits {
        lines.push(format!("limit: {limit}: {:.2} % of it", 100.0 * used));
    }
    lines.extend(found.active.iter().map(|(name, dual)| {
        if let Some(case) = name.strip_prefix(CASE) {
            return format!("among the worst: {case} ({:.0} % of what decides the design)", 100.0 * dual);
        }
        let worth = if table.fits_positions() {
            format!("dual {dual:.3e}")
        } else {
            // Unknowns are logarithms, and limits are over themselves; phases are angles.
            let unit = if name.starts_with("phase") { "0.01 rad" } else { "1 %" };
            format!("{unit} more room is worth {dual:.3} % of the objective")
        };
        if found.limits.iter().any(|limit| limit.limit == *name && limit.used > 1.0 + PASSED) {
            return format!("passed: {name}, which this design does not keep");
        }
        if !found.kept {
            return format!("binding: {name}"); // beside what it does not keep no room has a worth
        }
        format!("binding: {name} ({worth})")
    }));
    lines
}

/// What the design is in each case, in words.
fn say_cases(cases: &[InCase], table: &Table) -> Vec<String> {
    let line = |InCase { case, designed, gain_percent, .. }: &InCase| {
        let value = designed.map_or("fails".to_string(), |value| format!("{value:.6e}"));
        let gain = gain_percent.map_or(String::new(), |gain| format!(", {gain:+.2} % better than before"));
        format!("in {case}: {value}{gain}")
    };
    let counted = (!cases.is_empty()).then(|| {
        format!(
            "for {} cases of {}; what counts is their {}",
            cases.len(),
            table.over.as_deref().unwrap_or_default(),
            table.counted().words()
        )
    });
    counted.into_iter().chain(cases.iter().map(line)).collect()
}

/// The front in words.
fn say_front(front: &[Compromise], table: &Table) -> Option<String> {
    let [first, .., last] = front else { return None };
    let [one, two] = [table.goal, table.front.as_ref()?.goal].map(objective_label);
    let best = front.iter().filter(|point| point.best).count();
    Some(format!(
        "front of {} designs, {best} of them better than any other in one goal or the other: {two} from {:.6e} to {:.6e}, {one} \
         from {:.6e} to {:.6e}",
        front.len(),
        first.second,
        last.second,
        first.first,
        last.first
    ))
}

/// The tightest and the loosest tolerance in words.
fn say_tolerances(tolerances: &[Tolerance]) -> Option<String> {
    let change = |tolerance: &Tolerance| tolerance.change.unwrap_or(f64::INFINITY);
    if tolerances.iter().all(|tolerance| tolerance.change.is_none()) && !tolerances.is_empty() {
        return Some(format!("no unknown costs 1 % of the objective, alone, within a factor of {:.0}", LOOSE.exp()));
    }
    let order = |a: &&Tolerance, b: &&Tolerance| change(a).total_cmp(&change(b));
    let [tight, loose] = [tolerances.iter().min_by(order)?, tolerances.iter().max_by(order)?];
    let words = |tolerance: &Tolerance| match tolerance.change {
        Some(change) if tolerance.name.starts_with("phase") => format!("{} off by {change:.3} rad", tolerance.name),
        Some(change) => format!("{} off by {:.1} %", tolerance.name, 100.0 * (change.exp() - 1.0)),
        None => format!("{}: a factor of {:.0} costs less", tolerance.name, LOOSE.exp()),
    };
    let loosest = if tolerances.len() > 1 { format!("; the loosest: {}", words(loose)) } else { String::new() };
    Some(format!("what costs 1 % of the objective, alone: {}, the tightest{loosest}", words(tight)))
}

/// A number that was found, in words.
fn say_number(number: &FoundNumber) -> String {
    let FoundNumber { key, unit, own, value, deviation, verdict } = number;
    let unit = if *unit == "1" { String::new() } else { format!(" {unit}") };
    let deviation = deviation.map_or(String::new(), |deviation| format!(" ± {deviation:.1e}"));
    let verdict = verdict.map_or(String::new(), |verdict| format!(", {}", verdict.words()));
    format!("{key}: {value:.6e}{deviation}{unit}, {:.5} times the scene's{verdict}", value / own)
}

/// The objective of `table` in the `scene` of `document`, and its problem.
///
/// # Errors
/// [`Error::Design`] where the scene has no such objective; those of [`Problem::of`].
pub(super) fn aim(
    document: &Document,
    scene: &Scene,
    table: &Table,
    target: Option<&Markers>,
) -> Result<(Objective, Problem)> {
    let mut problem = Problem::of(scene)?;
    let objective = Objective::new(table, &problem, target)?;
    objective.check(&mut problem)?;
    let whole = table.numbers.is_empty();
    Ok((if whole { objective } else { objective.of_document(document) }, problem))
}

/// The design and what was before in every case.
fn in_cases(search: &mut Search<'_>, before: &Profile, profile: &Profile) -> Vec<InCase> {
    let mut of = |profile: &Profile| match search.in_cases(profile) {
        Some(values) => values.into_iter().map(Some).collect(),
        None => vec![None; search.cases.len()],
    };
    let (before, designed) = (of(before), of(profile));
    let row = |((case, before), designed): ((&Case, Option<f64>), Option<f64>)| InCase {
        case: case.name.clone(),
        designed,
        before,
        gain_percent: designed.zip(before).map(|(designed, before)| gain_percent(search.table, designed, before)),
    };
    search.cases.iter().zip(before).zip(designed).map(row).collect()
}

/// `document`, whose scenes with other numbers all keep the fluid that `scene` takes.
pub(super) fn pinned(document: &Document, scene: &Scene) -> Document {
    let mut document = document.clone();
    document.keep_fluid_of(scene);
    document
}

/// How much better `value` is than `other`, %.
pub(super) fn gain_percent(table: &Table, value: f64, other: f64) -> f64 {
    let better = if table.smaller_is_better() { other - value } else { value - other };
    100.0 * better / other.abs()
}

/// The numbers that decide what stiffness does (Sp, β, …), where the scene has them.
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

/// The scene's own profile, the even one, the study's gradient and the best linear one of the same mean, and the design, with their
/// objectives.
fn compare(search: &mut Search<'_>, found: &Found, table: &Table) -> Vec<Compared> {
    let before = Profile::before(table, &search.own_stiffness);
    let rod = &search.problem.model().rod;
    let xi: Vec<f64> = rod.joints().map(|k| rod.xi(k)).collect();
    let reference = search.reference;
    let even = if table.variables.contains(&Variable::Stiffness) { table.mean.unwrap_or(1.0) } else { 1.0 };
    let centre = xi.iter().sum::<f64>() / xi.len() as f64;
    let of = |factors: Vec<f64>| Profile {
        numbers: table.own_numbers(),
        ..Profile::of(factors.iter().map(|factor| factor * reference).collect())
    };
    let linear = |slope: f64| of(xi.iter().map(|xi| even * (1.0 + slope * (centre - xi))).collect());
    let mut profiles = Vec::new();
    let mut add = |name: &str, profile: Profile, search: &mut Search<'_>| {
        let objective = search.value(&profile);
        profiles.push(Compared { name: name.to_string(), profile, objective });
    };
    let alike = before.stiffness_n_m2.iter().all(|ei| (ei / (even * reference) - 1.0).abs() < ALIKE);
    add(BEFORE, before, search);
    if table.variables.contains(&Variable::Stiffness) {
        if !alike {
            add("even stiffness", of(vec![even; xi.len()]), search);
        }
        if table.goal != Goal::TrackTip && !found.interrupted {
            add("the study's gradient", of(xi.iter().map(|xi| even * (2.0 - xi) / (2.0 - centre)).collect()), search);
            if let Some((slope, _)) = search.best_linear() {
                add(&format!("best linear profile (slope {slope:.3})"), linear(slope), search);
            }
        }
    }
    let designed = Compared { name: "design".into(), profile: found.profile.clone(), objective: Some(found.objective) };
    profiles.push(designed);
    profiles
}

/// The motions of two profiles.
fn motions(search: &mut Search<'_>, before: &Profile, after: &Profile) -> Result<[Trajectory; 2]> {
    let mut motion = |profile: &Profile| {
        search.objective.set(&mut search.problem, profile)?;
        search.problem.simulate()
    };
    Ok([motion(before)?, motion(after)?])
}

/// The motions of the scene as it is, and with `profile`.
fn simulated(scene: &Scene, profile: &Profile) -> Result<[Trajectory; 2]> {
    let mut problem = Problem::of(scene)?;
    let before = problem.simulate()?;
    problem.set_stiffness(&profile.stiffness_n_m2)?;
    problem.set_actuation(&profile.amplitude, &profile.phase_rad)?;
    Ok([before, problem.simulate()?])
}

/// The simulations that a design is looked at in: as it is, with half the step, by another method, on a finer mesh.
pub(super) fn simulations(scene: &Scene) -> Vec<(String, Vec<String>)> {
    let step = 0.5 * scene.typical_step();
    let other = if scene.integrator_name() == "generalized-alpha" { "newmark" } else { "generalized-alpha" };
    let finer = 2 * scene.rod.nodes.get() - 1;
    vec![
        ("as designed".to_string(), Vec::new()),
        (format!("time step {step:e} s"), vec![format!("solver.time_step_s={step:e}")]),
        (other.to_string(), vec![format!("solver.integrator={other}")]),
        (format!("{finer} nodes"), vec![format!("rod.nodes={finer}")]),
    ]
}

/// The scene of `document` with `changes` and a profile of its joints and `numbers`.
pub(super) fn changed(document: &Document, numbers: &[Number], changes: &[String], profile: &Profile) -> Result<Scene> {
    let keys = keys(document, numbers, profile)?;
    let mut document = document.clone();
    document.begin_layer();
    for change in changes {
        document.set(change)?;
    }
    for (key, value) in keys {
        document.put("the design", &key, &value);
    }
    document.scene()
}

/// That the simulation with what was found is not the motion of the markers, where it is not.
fn say_refit(refit: &Refit) -> Option<String> {
    (!refit.fits()).then(|| {
        format!(
            "simulated with what was found each coordinate is {:.2e} m from the markers, {:.1} times what noise and steps of {:e} s \
             leave: start, drive, fluid, mass, loads or mesh of the scene are not those of the data; deviations include it",
            refit.residual_m, refit.residual_over_noise, refit.step_s
        )
    })
}

/// What gives a scene fixed steps of a method of one stage, where it has none.
fn fixed_steps(scene: &Scene) -> Vec<String> {
    let one_stage = |step: f64| scene.integrator().is_ok_and(|integrator| integrator.rule(step).is_some());
    if let StepControl::Fixed(step) = scene.pace()
        && one_stage(step)
    {
        return Vec::new();
    }
    let step = match (scene.pace(), scene.spectrum().fastest()) {
        (StepControl::Fixed(step), _) => step,
        (_, Some(frequency)) => 1.0 / frequency / STEPS[0],
        (_, None) => scene.solver.duration_s.get() / STEPS[1],
    };
    vec!["solver.integrator=generalized-alpha".to_string(), format!("solver.time_step_s={step:e}")]
}

/// How far the rod is from `markers` as it is and with an identified profile, in several simulations.
fn replay(document: &Document, scene: &Scene, table: &Table, markers: &Markers, profile: &Profile) -> Vec<Check> {
    let fixed = fixed_steps(scene);
    let measure = |changes: &[String], profile: &Profile| -> Option<f64> {
        let changes = [&fixed[..], changes].concat();
        let changed = changed(document, &table.numbers, &changes, profile).ok()?;
        let trajectory = Problem::of(&changed).ok()?.simulate().ok()?;
        let finer = (changed.rod.nodes.get() - 1) / (scene.rod.nodes.get() - 1);
        distances(&trajectory, markers, finer).map(|distances| rms(distances.iter().copied()))
    };
    let scene_of = |changes: &[String]| changed(document, &[], changes, &Profile::of(Vec::new()));
    let fixed_scene = scene_of(&fixed);
    let own = fixed_scene.as_ref().ok().and_then(|scene| Problem::of(scene).ok());
    let own = own.map(|problem| Profile::of(problem.stiffness()));
    let check = |(simulation, changes): (String, Vec<String>)| {
        let designed = measure(&changes, profile);
        let before = own.as_ref().and_then(|own| measure(&changes, own));
        let gain_percent = designed.zip(before).map(|(designed, before)| gain_percent(table, designed, before));
        Check { simulation, designed, before, gain_percent }
    };
    simulations(fixed_scene.as_ref().unwrap_or(scene)).into_iter().map(check).collect()
}

pub(super) fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|x| x * x).sum::<f64>() / count).sqrt()
}

/// Root mean square distance (m) of every `finer`-th node from the markers at each of their times; none where the simulation
/// is shorter.
pub(super) fn distances(trajectory: &Trajectory, markers: &Markers, finer: usize) -> Option<Vec<f64>> {
    let rows = markers.times.iter().zip(&markers.positions);
    rows.map(|(time, row)| {
        let q = trajectory.at(*time)?;
        let nodes = row.as_chunks::<2>().0;
        let square =
            |(k, [x, y]): (usize, &[f64; 2])| (q[2 * k * finer] - x).powi(2) + (q[2 * k * finer + 1] - y).powi(2);
        Some((nodes.iter().enumerate().map(square).sum::<f64>() / nodes.len() as f64).sqrt())
    })
    .collect()
}

/// What the rest is that the rod of a profile has next to `positions`.
fn rest_of(document: &Document, profile: &Profile, positions: &[f64], found: &Resting) -> Rest {
    let steady = || -> Option<SteadyState> {
        SteadyState::near(changed(document, &[], &[], profile).ok()?.model().ok()?, positions).ok()
    };
    match steady().map(|mut steady| steady.eigenvalues()) {
        None => Rest::Unknown,
        Some(Ok(values)) if values.iter().any(|(value, uncertainty)| grows(*value, *uncertainty)) => Rest::Unstable,
        Some(_) if !found.missed.is_empty() => Rest::Missed,
        Some(_) => Rest::Stable,
    }
}

/// How far (m, root mean square) the rod of a profile rests from `positions`; none where no equilibrium is found from there.
fn resting(document: &Document, profile: &Profile, positions: &[f64]) -> Option<f64> {
    let scene = changed(document, &[], &[], profile).ok()?;
    let mut dynamics = Dynamics::new(Arc::new(scene.model().ok()?));
    let mut newton = Newton::new(dynamics.nodes(), REST_TOLERANCE).ok()?;
    let mut state = dynamics.first_state();
    state.q.copy_from_slice(positions);
    come_to_rest(&mut dynamics, &mut newton, &mut state).ok()?;
    let nodes = state.q.as_chunks::<2>().0.iter().zip(positions.as_chunks::<2>().0);
    Some(rms(nodes.map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))))
}

/// The keys that make the scene of `document` have `profile`.
fn keys(document: &Document, numbers: &[Number], profile: &Profile) -> Result<Vec<(String, toml::Value)>> {
    let scene = profile.numbers_in(document, numbers)?;
    let rod = scene.model()?.rod;
    let list = |values: &dyn Fn(usize, f64) -> f64| {
        let points = rod.joints().enumerate().map(|(i, k)| {
            let xi = rod.xi(k);
            toml::Value::Array(vec![toml::Value::Float(xi), toml::Value::Float(values(i, xi))])
        });
        toml::Value::Array(points.collect())
    };
    let sections: Vec<f64> = rod.joints().map(|k| rod.section_stiffness(k)).collect();
    let along = |points: &[[f64; 2]], default: f64, xi: f64| {
        rod::Profile::through(points.to_vec()).map_or(default, |profile| profile.at(xi))
    };
    let mut keys = keys_with(numbers, &profile.values());
    if !profile.stiffness_n_m2.is_empty() {
        keys.push(("rod.stiffness_profile".into(), list(&|i, _| profile.stiffness_n_m2[i] / sections[i])));
    }
    if let Some(actuation) = &scene.actuation {
        let [amplitude, phase] = actuation.profiles();
        if profile.amplitude.iter().any(|factor| *factor != 1.0) {
            let own = |xi: f64| along(&amplitude, 1.0, xi);
            keys.push(("actuation.amplitude_profile".into(), list(&|i, xi| own(xi) * profile.amplitude[i])));
        }
        if profile.phase_rad.iter().any(|phase| *phase != 0.0) {
            let own = |xi: f64| along(&phase, 0.0, xi);
            keys.push(("actuation.phase_profile_rad".into(), list(&|i, xi| own(xi) + profile.phase_rad[i])));
        }
    }
    Ok(keys)
}

/// The scene with the designed profile and without `[design]`; files that it names are found from anywhere.
fn designed(document: &Document, scene: &Scene, numbers: &[Number], profile: &Profile) -> Result<Document> {
    let failed = |reason: String| Error::Page { reason };
    let mut document = document.clone();
    document.begin_layer();
    for (key, value) in keys(&document, numbers, profile)? {
        document.put("the design", &key, &value);
    }
    let mut table: toml::Table = document.read_as()?;
    table.remove("design");
    table.insert("name".to_string(), toml::Value::String(format!("{}-designed", scene.name)));
    // It names the fluid that it was designed in.
    let (law, reactive) = scene.fluid_model(&scene.model()?.rod);
    if let (Some(toml::Value::Table(drag)), Some(law)) = (table.get_mut("drag"), law) {
        drag.insert("law".to_string(), toml::Value::String(law.name.to_string()));
    }
    if let Some(own) = scene.reactive.as_ref().filter(|reactive| reactive.auto) {
        table.remove("reactive");
        if reactive {
            let shedding = toml::Value::Float(own.shedding.get());
            table.insert("reactive".to_string(), toml::Table::from_iter([("shedding".to_string(), shedding)]).into());
        }
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
