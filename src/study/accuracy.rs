//! `caudal study accuracy`: which model, method, step and mesh give which error, at what cost.
//!
//! Errors are measured against references that the study computes itself, by two methods that have nothing in common but the
//! equations: ESDIRK3 with small steps, and generalized-α with small steps extrapolated to none (Richardson). What they
//! differ by is the reference's own error; where that is no small part of the result, no reference exists, and the study
//! measures how fast two runs separate that start a billionth of a length apart.
//!
//! The references are of the whole model, so the errors of a cheaper one have the model's own in them, which no step removes.

use serde::Deserialize;
use serde_json::{Value, json};

use super::trial::{Manner, Recipe, SHOWN, Trial};
use super::{Desk, Studied};
use crate::error::Result;
use crate::integrator::Pace;
use crate::jobs;
use crate::modes::Modes;
use crate::report::chart::{Chart, Figure, Mark, Scale, Series, number};
use crate::report::{Findings, Table};
use crate::scene::Scene;

/// Newton's tolerance in all runs: far below every error of interest.
const NEWTON: f64 = 1e-12;
/// The references' steps are this part of the finest of the study, and half of that.
const FINER: f64 = 0.5;
/// From this difference of the references on, relative, there is no reference.
const NO_REFERENCE: f64 = 1e-2;
/// An error is shown down to this multiple of the reference's own.
const TRUSTED: f64 = 2.0;
/// Part of the length that two runs start apart to see whether they separate.
const PUSH: f64 = 1e-9;
/// Two runs that come apart by this factor make a motion that cannot be predicted.
const CHAOTIC: f64 = 1e4;
/// The growth is followed up to this part of the length, over windows of these parts of the duration, in the longest that
/// shows so many samples of it.
const GROWN: f64 = 1e-3;
const WINDOWS: [f64; 4] = [1.0, 0.1, 0.01, 0.001];
const FOLLOWED: usize = 100;
/// Samples of the tip's path.
const SAMPLES: usize = 500;
/// From this error on, relative, a cheaper model computes another motion.
const USELESS: f64 = 1.0;
/// A cheaper model is as good as it gets where its error is at most this multiple of the one that no step removes.
const SETTLED: f64 = 1.1;
/// The errors that a user is told how to reach.
const TARGETS: [f64; 2] = [1e-2, 1e-4];
/// Symplectic Euler runs at this part of its limit, and at half of it, where the limit is known.
const BELOW_LIMIT: f64 = 0.95;
/// Up to this many nodes that limit is computed.
const MODES_UP_TO: u64 = 401;

/// What is asked for.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Accuracy {
    /// Meshes, their numbers of nodes; empty for the scene's own and two finer ones.
    pub nodes: Vec<u64>,
    /// Fixed steps (s); empty for eight times the scene's down to a thirty-second.
    pub steps: Vec<f64>,
    /// Tolerances of adaptive methods and of cheaper models; empty for 1e-2 … 1e-7.
    pub tolerances: Vec<f64>,
}

/// What is compared.
const QUANTITIES: [&str; 3] = ["net displacement", "tip path", "energy put in"];
/// The beginnings of the names of their figures.
const FILES: [&str; 3] = ["displacement", "tip", "energy"];

#[derive(Debug, Clone, PartialEq)]
struct Case {
    recipe: Recipe,
    pace: Pace,
    nodes: u64,
    /// Part of the scene's duration.
    part: f64,
    push: Option<f64>,
}

/// The quantities of a run: displacement, tip, energy put in.
#[derive(Debug, Clone)]
struct Result3 {
    displacement: f64,
    tip: Vec<[f64; 2]>,
    work: f64,
    /// Largest |work| of the run: what errors of the work are compared with.
    largest_work: f64,
}

impl Result3 {
    fn of(trial: &Trial) -> Self {
        Self {
            displacement: trial.displacement[0],
            tip: trial.tip[..=SAMPLES].to_vec(),
            work: trial.work_in,
            largest_work: trial.largest_work_in,
        }
    }

    /// fine + (fine − coarse)/(ratio − 1).
    fn extrapolated(coarse: &Self, fine: &Self, ratio: f64) -> Self {
        let to = |c: f64, f: f64| f + (f - c) / (ratio - 1.0);
        let tips = coarse.tip.iter().zip(&fine.tip);
        Self {
            displacement: to(coarse.displacement, fine.displacement),
            tip: tips.map(|(c, f)| [to(c[0], f[0]), to(c[1], f[1])]).collect(),
            work: to(coarse.work, fine.work),
            largest_work: fine.largest_work,
        }
    }

    /// Relative differences of the three quantities from `reference`.
    fn errors(&self, reference: &Self) -> [f64; 3] {
        let first = reference.tip.first().copied().unwrap_or_default();
        let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let travel = reference.tip.iter().map(|tip| distance(tip, &first)).fold(f64::MIN_POSITIVE, f64::max);
        let apart = self.tip.iter().zip(&reference.tip).map(|(a, b)| distance(a, b)).fold(0.0, f64::max);
        let relative = |x: f64, y: f64, scale: f64| if x == y { 0.0 } else { (x - y).abs() / scale.abs() };
        [
            relative(self.displacement, reference.displacement, reference.displacement),
            apart / travel,
            relative(self.work, reference.work, reference.largest_work),
        ]
    }
}

/// A reference and its own relative errors.
struct Reference {
    result: Result3,
    errors: [f64; 3],
}

const MANNER: Manner = Manner { samples: SAMPLES, push: None, halving: true, timed: true };

fn esdirk() -> Option<Recipe> {
    Recipe::named("esdirk3")
}

fn alpha() -> Option<Recipe> {
    Recipe::named("generalized-alpha")
}

/// Charts the error of `scene` against its cost for every model, method, step and mesh.
///
/// # Errors
/// Those of [`Scene::model`], [`Error::Write`](crate::Error::Write), [`Error::Journal`](crate::Error::Journal).
pub(super) fn accuracy(scene: &Scene, asked: &Accuracy, desk: Desk<'_>) -> Result<Studied> {
    let mut scene = scene.clone();
    scene.solver.newton_tolerance = scene.solver.newton_tolerance.at_most(NEWTON);
    let scene = &scene;
    let own = scene.rod.nodes.get() as u64;
    let meshes =
        if asked.nodes.is_empty() { (0..3).map(|i| ((own - 1) << i) + 1).collect() } else { asked.nodes.clone() };
    let steps = if asked.steps.is_empty() {
        let step = scene.typical_step();
        (0..9).map(|i| 8.0 * step / f64::from(1 << i)).filter(|h| *h <= 0.25 * scene.solver.duration_s.get()).collect()
    } else {
        asked.steps.clone()
    };
    let tolerances = if asked.tolerances.is_empty() {
        (4..=14).map(|i| 10.0_f64.powf(-0.5 * f64::from(i))).collect()
    } else {
        asked.tolerances.clone()
    };
    let Some((esdirk, alpha)) = esdirk().zip(alpha()) else { return Ok(Studied::Complete(Findings::default())) };

    let finest = FINER * steps.iter().copied().fold(f64::INFINITY, f64::min);
    let reference = |nodes: u64, recipe: &Recipe, step: f64| Case {
        recipe: recipe.clone(),
        pace: Pace::Fixed(step),
        nodes,
        part: 1.0,
        push: None,
    };
    let mut cases: Vec<Case> = Vec::new();
    for nodes in &meshes {
        for recipe in [&esdirk, &alpha] {
            cases.extend([finest, 0.5 * finest].map(|step| reference(*nodes, recipe, step)));
        }
    }
    let run = |case: &Case| {
        let duration = case.part * scene.solver.duration_s.get();
        let scene = case.recipe.of(scene).with_pace(case.pace).with_nodes(case.nodes).with_duration(duration);
        Trial::of(&scene, Manner { push: case.push, ..MANNER }, desk.interrupted)
    };
    let trials = match desk.work("references", scene, &cases, jobs::cores(), run)? {
        Ok(trials) => trials,
        Err(interrupted) => return Ok(interrupted),
    };
    let mut references = Vec::new();
    for (nodes, four) in meshes.iter().zip(trials.chunks(4)) {
        match Reference::of(four) {
            Some(reference) if reference.errors[..2].iter().all(|e| *e < NO_REFERENCE) => references.push(reference),
            other => {
                // Pairs of runs, one of each pushed, over times from the whole duration to a thousandth: by the method that
                // damps nothing, where its limit is known.
                let explicit = match (Recipe::named("symplectic-euler"), limit_step(scene, *nodes)?) {
                    (Some(recipe), Some(limit)) => Some((recipe, BELOW_LIMIT * limit)),
                    _ => None,
                };
                let (recipe, step) = explicit.unwrap_or((alpha.clone(), finest));
                let pair = |part: f64| {
                    [0.0, PUSH].map(|push| Case { part, push: Some(push), ..reference(*nodes, &recipe, step) })
                };
                let pairs: Vec<Case> = WINDOWS.into_iter().flat_map(pair).collect();
                let pairs = match desk.work("pairs", scene, &pairs, jobs::cores(), run)? {
                    Ok(pairs) => pairs,
                    Err(interrupted) => return Ok(interrupted),
                };
                let findings = without_reference(scene, *nodes, finest, four, other.as_ref(), &pairs)?;
                return Ok(Studied::Complete(findings));
            }
        }
    }

    let cases = ladder(scene, &meshes, &steps, &tolerances)?;
    let trials = match desk.work("runs", scene, &cases, jobs::cores(), run)? {
        Ok(trials) => trials,
        Err(interrupted) => return Ok(interrupted),
    };
    Ok(Studied::Complete(
        Report { scene, meshes: &meshes, references: &references, cases: &cases, trials: &trials }.findings()?,
    ))
}

/// Every model and method on every mesh with every step or tolerance, and the scene as it stands.
fn ladder(scene: &Scene, meshes: &[u64], steps: &[f64], tolerances: &[f64]) -> Result<Vec<Case>> {
    let case =
        |recipe: &Recipe, pace: Pace, nodes: u64| Case { recipe: recipe.clone(), pace, nodes, part: 1.0, push: None };
    let mut cases = Vec::new();
    for nodes in meshes {
        for recipe in Recipe::all(scene) {
            let case = |pace: Pace| case(&recipe, pace, *nodes);
            if recipe.method.implicit {
                cases.extend(steps.iter().map(|step| case(Pace::Fixed(*step))));
            } else if let Some(limit) = limit_step(scene, *nodes)? {
                cases.extend([BELOW_LIMIT, 0.5 * BELOW_LIMIT].map(|part| case(Pace::Fixed(part * limit))));
            }
            if recipe.method.adaptive {
                cases.extend(tolerances.iter().map(|tolerance| case(Pace::Adaptive(*tolerance))));
            }
        }
        for recipe in Recipe::cheaper(scene) {
            let case = |tolerance: &f64| case(&recipe, Pace::Adaptive(*tolerance), *nodes);
            cases.extend(tolerances.iter().map(case));
        }
    }
    let own = Recipe::own(scene).zip(meshes.first()).map(|(own, nodes)| case(&own, scene.pace(), *nodes));
    cases.extend(own.filter(|own| !cases.contains(own)));
    Ok(cases)
}

/// The step (s) from which on explicit methods fail, 2/ω_max, where it is computed.
fn limit_step(scene: &Scene, nodes: u64) -> Result<Option<f64>> {
    if nodes > MODES_UP_TO {
        return Ok(None);
    }
    Ok(Some(2.0 / Modes::of(&scene.with_nodes(nodes).model()?.rod)?.highest()))
}

impl Reference {
    /// From runs of both methods with two steps each; `None` where one of them failed.
    fn of(trials: &[Trial]) -> Option<Self> {
        let [first, second, coarse, fine] = trials else { return None };
        if !trials.iter().all(|trial| trial.is_complete(MANNER)) {
            return None;
        }
        let [first, second, coarse, fine] = [first, second, coarse, fine].map(Result3::of);
        let other = Result3::extrapolated(&coarse, &fine, 4.0);
        let [own, others] = [first.errors(&second), other.errors(&second)];
        let errors = std::array::from_fn(|i| f64::max(own[i], others[i]));
        Some(Self { result: second, errors })
    }
}

/// What there is to say where the references disagree.
fn without_reference(
    scene: &Scene,
    nodes: u64,
    step: f64,
    four: &[Trial],
    reference: Option<&Reference>,
    pairs: &[Trial],
) -> Result<Findings> {
    let mut findings = Findings { subject: "speed against accuracy", ..Findings::default() };
    let why = match reference {
        Some(Reference { errors, .. }) => {
            let [displacement, tip, work] = errors.map(|e| 100.0 * e);
            format!(
                "two references that have only the equations in common, ESDIRK3 and generalized-α extrapolated, with steps from {step:e} s down, differ by {displacement:.1} % in displacement, {tip:.1} % in the tip's path, {work:.1} % in the energy put in"
            )
        }
        None => {
            let failures: Vec<_> = four
                .iter()
                .filter_map(|trial| trial.failure.as_ref())
                .map(|(_, t, reason)| format!("at t = {t:.4} s: {reason}"))
                .collect();
            format!("a run meant as reference failed {}", failures.first().map_or("", String::as_str))
        }
    };
    findings.answers.push(format!("No trajectory reference exists on {nodes} nodes: {why}."));
    findings.numbers.insert("reference_exists".into(), json!(false));
    let (duration, length) = (scene.solver.duration_s.get(), scene.rod.length_m.get());
    let distances = |(pair, part): (&[Trial], f64)| -> Vec<(f64, f64)> {
        let apart = pair[0].tip.iter().zip(&pair[1].tip).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
        apart.enumerate().map(|(i, d)| (part * duration * i as f64 / SAMPLES as f64, d)).skip(1).collect()
    };
    let windows: Vec<_> = pairs.chunks(2).zip(WINDOWS).map(distances).collect();
    let widest = windows.iter().flatten().map(|p| p.1).fold(0.0, f64::max);
    // The longest window in which the growth can be followed.
    let followed = |apart: &&Vec<(f64, f64)>| apart.iter().take_while(|p| p.1 < GROWN * length).count() >= FOLLOWED;
    let apart = windows.iter().find(followed).or(windows.last()).cloned().unwrap_or_default();
    if let Some((rate, end)) = growth(&apart, length) {
        findings.numbers.insert("separation_growth_rate_1_s".into(), json!(rate));
        let common = format!(
            "Two runs that start {PUSH:e} of the length apart separate as e^({rate:.3} t/s) until t = {end:.4} s, and come to {:.1e} of the length",
            widest / length
        );
        findings.answers.push(if widest > CHAOTIC * PUSH * length {
            format!("{common}: no error stays small, and no method or step has an accuracy here. Means over many runs or long times may still mean something.")
        } else {
            format!("{common}: the motion is not chaotic but not resolved; smaller --steps may find a reference.")
        });
    }
    findings.answers.push("No errors are given, because there is nothing to measure them against.".to_string());
    let over = |(apart, part): (&Vec<(f64, f64)>, f64)| {
        let since_start = |p: &(f64, f64)| (p.0, p.1 / length);
        Series::new(format!("over {} s", part * duration), apart.iter().map(since_start).collect(), Mark::Line)
    };
    let series = windows.iter().zip(WINDOWS).map(over).collect();
    let chart = Chart {
        title: format!("{}: two runs that start {PUSH:e} of a length apart", scene.name),
        x: "time (s)".into(),
        y: "distance of their tips over the length".into(),
        scale: Scale::LogLog,
        series,
    };
    let caption =
        "How fast two runs part that begin almost together: where that has no end, no run can be called accurate.";
    findings.figures.push(Figure::new("separation.svg", caption, chart.svg()));
    Ok(findings)
}

/// Rate (1/s) at which a distance grows by least squares of its logarithm, up to the time (s, also returned) where it is a
/// thousandth of `length`, or the end.
fn growth(apart: &[(f64, f64)], length: f64) -> Option<(f64, f64)> {
    let until = apart.iter().position(|p| p.1 > GROWN * length).unwrap_or(apart.len()).max(3).min(apart.len());
    let logs: Vec<_> = apart[..until].iter().filter(|p| p.1 > 0.0).map(|p| (p.0, p.1.ln())).collect();
    let count = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / count;
    let (t, y) = (mean(|p| p.0), mean(|p| p.1));
    let along: f64 = logs.iter().map(|p| (p.0 - t).powi(2)).sum();
    let rate = logs.iter().map(|p| (p.0 - t) * (p.1 - y)).sum::<f64>() / along;
    rate.is_finite().then(|| (rate, logs[logs.len() - 1].0))
}

/// All that is known when every run is made.
struct Report<'a> {
    scene: &'a Scene,
    meshes: &'a [u64],
    references: &'a [Reference],
    cases: &'a [Case],
    trials: &'a [Trial],
}

/// A run with its errors.
struct Row<'a> {
    case: &'a Case,
    trial: &'a Trial,
    /// Against the reference on its own mesh: what the steps do. `None` where the run failed.
    time: Option<[f64; 3]>,
    /// Against the limit of fine meshes.
    total: Option<[f64; 3]>,
}

impl Row<'_> {
    fn setting(&self) -> String {
        let recipe = &self.case.recipe;
        let by = if recipe.is_whole() { recipe.to_string() } else { format!("model = \"{recipe}\"") };
        match self.case.pace {
            Pace::Fixed(step) => format!("{by} with steps of {} s", short(step)),
            Pace::Adaptive(tolerance) => format!("{by} with tolerance {}", short(tolerance)),
        }
    }

    /// Its step or tolerance.
    fn fineness(&self) -> f64 {
        match self.case.pace {
            Pace::Fixed(x) | Pace::Adaptive(x) => x,
        }
    }

    /// Name of the curve it belongs to.
    fn curve(&self) -> String {
        let adaptive = self.case.recipe.is_whole() && matches!(self.case.pace, Pace::Adaptive(_));
        format!("{}{}", self.case.recipe, if adaptive { ", adaptive" } else { "" })
    }
}

/// A number in few digits.
fn short(x: f64) -> String {
    let digits: f64 = format!("{x:.2e}").parse().unwrap_or(x);
    format!("{digits:e}")
}

/// A number in two digits, without an exponent where it is neither large nor small.
fn two_digits(x: f64) -> String {
    number(format!("{x:.1e}").parse().unwrap_or(x))
}

fn percent(part: f64) -> String {
    format!("{} %", two_digits(100.0 * part))
}

fn milliseconds(seconds: f64) -> String {
    let ms = 1e3 * seconds;
    if ms < 10.0 { format!("{ms:.2} ms") } else { format!("{ms:.0} ms") }
}

impl Report<'_> {
    /// Nodes of the first mesh: the scene's own unless others were asked for.
    fn nodes(&self) -> u64 {
        self.meshes.first().copied().unwrap_or_default()
    }

    fn findings(&self) -> Result<Findings> {
        let limit = self.mesh_limit();
        let rows: Vec<Row<'_>> =
            self.cases.iter().zip(self.trials).map(|(case, trial)| self.row(case, trial, limit.as_ref())).collect();
        let mut findings = Findings { subject: "speed against accuracy", ..Findings::default() };
        self.references_in_words(&mut findings);
        self.own_setting(&rows, &mut findings);
        self.cheaper_models(&rows, &mut findings);
        self.recommend(&rows, &mut findings);
        self.meshes_in_words(limit.as_ref(), &mut findings);
        findings.tables.push(self.recommended(&rows));
        findings.tables.push(self.table(&rows));
        self.charts(&rows, limit.as_ref(), &mut findings)?;
        Ok(findings)
    }

    /// The limit of fine meshes by Richardson's extrapolation with the order that three meshes show, and its uncertainty:
    /// half of what the extrapolation adds.
    fn mesh_limit(&self) -> Option<(Result3, [f64; 3], f64)> {
        let [.., a, b, c] = self.references else { return None };
        let [.., na, nb, nc] = self.meshes else { return None };
        let ratio = (nc - 1) as f64 / (nb - 1) as f64;
        if ((nb - 1) as f64 / (na - 1) as f64 - ratio).abs() > 1e-9 || ratio <= 1.0 {
            return None;
        }
        let change = (b.result.displacement - a.result.displacement) / (c.result.displacement - b.result.displacement);
        let order = change.abs().log(ratio).clamp(0.5, 4.0);
        let limit = Result3::extrapolated(&b.result, &c.result, ratio.powf(order));
        let added = c.result.errors(&limit);
        Some((limit, added.map(|e| 0.5 * e), order))
    }

    fn row<'r>(&self, case: &'r Case, trial: &'r Trial, limit: Option<&(Result3, [f64; 3], f64)>) -> Row<'r> {
        let result = trial.is_complete(MANNER).then(|| Result3::of(trial));
        let mesh = self.meshes.iter().position(|nodes| *nodes == case.nodes);
        let reference = mesh.and_then(|mesh| self.references.get(mesh));
        Row {
            case,
            trial,
            time: result.as_ref().zip(reference).map(|(result, reference)| result.errors(&reference.result)),
            total: result.as_ref().zip(limit).map(|(result, limit)| result.errors(&limit.0)),
        }
    }

    fn references_in_words(&self, findings: &mut Findings) {
        for (nodes, reference) in self.meshes.iter().zip(self.references) {
            let [displacement, tip, work] = reference.errors;
            findings.answers.push(format!(
                "Reference on {nodes} nodes: displacement {:.9e} m, energy put in {:.6e} J; two independent references agree to {displacement:.1e} in displacement, {tip:.1e} in the tip's path, {work:.1e} in energy.",
                reference.result.displacement, reference.result.work
            ));
            findings.numbers.insert(
                format!("reference_{nodes}_nodes"),
                json!({ "net_displacement_m": reference.result.displacement, "energy_put_in_j": reference.result.work,
                    "displacement_error": displacement, "tip_error": tip, "energy_error": work }),
            );
        }
    }

    /// The rows of a mesh.
    fn on<'r, 's>(&self, rows: &'r [Row<'s>], nodes: u64) -> impl Iterator<Item = &'r Row<'s>> {
        rows.iter().filter(move |row| row.case.nodes == nodes)
    }

    fn own_setting(&self, rows: &[Row<'_>], findings: &mut Findings) {
        let Some(own) = Recipe::own(self.scene) else { return };
        let (pace, nodes) = (self.scene.pace(), self.nodes());
        let row = self.on(rows, nodes).find(|row| row.case.recipe == own && row.case.pace == pace);
        if let Some((row, errors)) = row.and_then(|row| Some((row, row.time?))) {
            findings.answers.push(format!(
                "The scene as it stands, {} on {nodes} nodes: its steps make an error of {:.2} % in displacement, {:.2} % in the tip's path, {:.2} % in energy, in {}.",
                row.setting(), 100.0 * errors[0], 100.0 * errors[1], 100.0 * errors[2], milliseconds(row.trial.processor_s)
            ));
        }
    }

    /// For every cheaper model that ran, the run with the finest tolerance on the scene's own mesh, and its errors: those
    /// that no step removes.
    fn settled<'r, 's>(&self, rows: &'r [Row<'s>]) -> Vec<(&'r Row<'s>, [f64; 3])> {
        let mut settled: Vec<(&Row<'_>, [f64; 3])> = Vec::new();
        for row in self.on(rows, self.nodes()).filter(|row| !row.case.recipe.is_whole()) {
            let Some(errors) = row.time else { continue };
            match settled.iter_mut().find(|(other, _)| other.case.recipe == row.case.recipe) {
                Some(best) if row.fineness() < best.0.fineness() => *best = (row, errors),
                Some(_) => {}
                None => settled.push((row, errors)),
            }
        }
        settled
    }

    /// What the cheaper models leave out, and what the whole one costs that errs as much.
    fn cheaper_models(&self, rows: &[Row<'_>], findings: &mut Findings) {
        let on_mesh = || self.on(rows, self.nodes());
        let displacement = |row: &Row<'_>| row.time.map(|e| e[0]);
        let own_method = self.scene.method().ok().map(|(method, values)| Recipe::whole(method, values));
        for (finest, errors) in self.settled(rows) {
            let model = on_mesh().filter(|row| row.case.recipe == finest.case.recipe);
            let Some(row) = self.cheapest(model, displacement, SETTLED * errors[0]) else { continue };
            let (name, seconds) = (row.case.recipe.rung.name, row.trial.processor_s);
            let mut numbers = json!({ "displacement_error": errors[0], "tip_error": errors[1], "energy_error": errors[2],
                "processor_s": seconds });
            let mut text = format!("The model \"{name}\" ({})", row.case.recipe.rung.meaning);
            if errors[0] >= USELESS {
                text += " leaves out what decides this motion: its displacement is another.";
                findings.answers.push(text);
                findings.numbers.insert(format!("model_{name}"), numbers);
                continue;
            }
            let [of_displacement, of_tip, of_work] = errors.map(percent);
            text += &format!(
                " errs by {of_displacement} in displacement, {of_tip} in the tip's path, {of_work} in energy, which no step removes, and takes {}.",
                milliseconds(seconds)
            );
            // The scene's own method with steps that still err more, so that it is not made dearer than it is.
            let own = on_mesh().filter(|row| Some(&row.case.recipe) == own_method.as_ref());
            let own = own.filter(|row| displacement(row).is_some_and(|e| e >= errors[0]));
            let own = own.max_by(|a, b| a.trial.processor_s.total_cmp(&b.trial.processor_s));
            let whole = on_mesh().filter(|row| row.case.recipe.is_whole());
            let best = self.cheapest(whole, displacement, errors[0]);
            for (key, errs, other) in [("own_method", "errs no less", own), ("best_method", "errs no more", best)] {
                let Some((other, error)) = other.and_then(|other| Some((other, displacement(other)?))) else {
                    continue;
                };
                let ratio = other.trial.processor_s / seconds;
                text += &format!(
                    " The whole model by {}, which {errs} in displacement ({}), takes {} times as long.",
                    other.setting(),
                    percent(error),
                    two_digits(ratio)
                );
                numbers[key] =
                    json!({ "setting": other.setting(), "displacement_error": error, "times_as_long": ratio });
            }
            findings.answers.push(text);
            findings.numbers.insert(format!("model_{name}"), numbers);
        }
    }

    /// The cheapest row whose error of the quantity is at most `target`, and stays so at finer steps of the same method.
    fn cheapest<'r, 's>(
        &self,
        rows: impl Iterator<Item = &'r Row<'s>>,
        error: impl Fn(&Row<'s>) -> Option<f64>,
        target: f64,
    ) -> Option<&'r Row<'s>>
    where
        's: 'r,
    {
        let rows: Vec<_> = rows.collect();
        let holds = |row: &&&Row<'s>| {
            error(row).is_some_and(|e| e <= target)
                && rows
                    .iter()
                    .filter(|other| {
                        other.case.nodes == row.case.nodes
                            && other.curve() == row.curve()
                            && other.fineness() < row.fineness()
                    })
                    .all(|other| error(other).is_some_and(|e| e <= target))
        };
        rows.iter().filter(holds).min_by(|a, b| a.trial.processor_s.total_cmp(&b.trial.processor_s)).copied()
    }

    fn recommend(&self, rows: &[Row<'_>], findings: &mut Findings) {
        let nodes = self.nodes();
        for (i, quantity) in QUANTITIES.iter().enumerate().take(2) {
            for target in TARGETS {
                let percent = 100.0 * target;
                let time = self.cheapest(self.on(rows, nodes), |row| row.time.map(|e| e[i]), target);
                findings.answers.push(match time {
                    Some(row) => format!(
                        "For {percent} % on the {quantity} of this rod of {nodes} nodes: {}: {} and {} linear solves.",
                        row.setting(), milliseconds(row.trial.processor_s), row.trial.factorisations
                    ),
                    None => format!("For {percent} % on the {quantity} of this rod of {nodes} nodes: none of these steps does it; finer --steps may."),
                });
                let total = self.cheapest(rows.iter(), |row| row.total.map(|e| e[i]), target);
                if let Some(row) = total {
                    findings.answers.push(format!(
                        "For {percent} % on the {quantity} with the mesh's error in it: {} on {} nodes: {}.",
                        row.setting(),
                        row.case.nodes,
                        milliseconds(row.trial.processor_s)
                    ));
                }
                findings.numbers.insert(
                    format!("recommended_{}_{target:e}", quantity.replace(' ', "_")),
                    json!({ "on_this_mesh": time.map(|row| row.setting()), "with_the_mesh": total.map(|row| format!("{} on {} nodes", row.setting(), row.case.nodes)) }),
                );
            }
        }
    }

    fn meshes_in_words(&self, limit: Option<&(Result3, [f64; 3], f64)>, findings: &mut Findings) {
        let Some((limit, uncertain, order)) = limit else { return };
        findings.answers.push(format!(
            "In the limit of fine meshes the displacement is {:.6e} m (±{:.1e} relative, extrapolated; its error falls as N^-{order:.2}).",
            limit.displacement, uncertain[0]
        ));
        for (nodes, reference) in self.meshes.iter().zip(self.references) {
            let [displacement, tip, work] = reference.result.errors(limit);
            let needed = |target: f64| 1.0 + (nodes - 1) as f64 * (displacement / target).powf(1.0 / order);
            findings.answers.push(format!(
                "The mesh of {nodes} nodes makes an error of {:.3} % in displacement, {:.3} % in the tip's path, {:.3} % in energy; 1 % would take about {:.0} nodes, 0.01 % about {:.0}.",
                100.0 * displacement, 100.0 * tip, 100.0 * work, needed(1e-2), needed(1e-4)
            ));
        }
    }

    /// For every method the cheapest step to each target on the scene's own mesh.
    fn recommended(&self, rows: &[Row<'_>]) -> Table {
        let nodes = self.nodes();
        let mut curves: Vec<String> = Vec::new();
        for row in self.on(rows, nodes) {
            if !curves.contains(&row.curve()) {
                curves.push(row.curve());
            }
        }
        let targets = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];
        let mut out = Vec::new();
        for curve in curves {
            for (i, quantity) in QUANTITIES.iter().enumerate() {
                let of = self.on(rows, nodes).filter(|row| row.curve() == curve);
                let mut line = vec![json!(curve), json!(quantity)];
                let of: Vec<_> = of.collect();
                for target in targets {
                    let found = self.cheapest(of.iter().copied(), |row| row.time.map(|e| e[i]), target);
                    line.push(found.map_or(Value::Null, |row| json!(row.trial.factorisations)));
                }
                out.push(line);
            }
        }
        let columns = targets.iter().map(|target| format!("solves_for_{target:e}"));
        Table {
            file: "targets.csv",
            title: "Linear solves to reach an error of the steps, on the scene's own mesh",
            columns: ["method".to_string(), "quantity".to_string()].into_iter().chain(columns).collect(),
            rows: out,
        }
    }

    fn table(&self, rows: &[Row<'_>]) -> Table {
        let error = |errors: Option<[f64; 3]>, i: usize| errors.map_or(Value::Null, |e| json!(e[i]));
        let line = |row: &Row<'_>| {
            let trial = row.trial;
            let (step, tolerance) = match row.case.pace {
                Pace::Fixed(step) => (json!(step), Value::Null),
                Pace::Adaptive(tolerance) => (Value::Null, json!(tolerance)),
            };
            let done = row.time.is_some();
            let recipe = &row.case.recipe;
            let cycle = |i: usize| if done { json!(trial.cycles[i]) } else { Value::Null };
            vec![
                json!(recipe.rung.name),
                json!(recipe.rung.method.map_or_else(|| recipe.to_string(), str::to_string)),
                step,
                tolerance,
                json!(row.case.nodes),
                json!(trial.steps),
                json!(trial.iterations),
                json!(trial.factorisations),
                json!(trial.halvings),
                json!(trial.wall_s),
                json!(trial.processor_s),
                if done { json!(trial.displacement[0]) } else { Value::Null },
                if done { json!(trial.work_in) } else { Value::Null },
                cycle(0),
                cycle(1),
                cycle(2),
                error(row.time, 0),
                error(row.time, 1),
                error(row.time, 2),
                error(row.total, 0),
                error(row.total, 1),
                error(row.total, 2),
                trial.failure.as_ref().map_or_else(
                    || if done { Value::Null } else { json!("its energy grew without bound") },
                    |(_, _, reason)| json!(reason),
                ),
            ]
        };
        Table {
            file: "accuracy.csv",
            title: "All runs",
            columns: [
                "model",
                "integrator",
                "time_step_s",
                "tolerance",
                "nodes",
                "steps",
                "newton_iterations",
                "linear_solves",
                "step_halvings",
                "wall_s",
                "processor_s",
                "net_displacement_m",
                "energy_put_in_j",
                SHOWN[0].key,
                SHOWN[1].key,
                SHOWN[2].key,
                "time_error_displacement",
                "time_error_tip",
                "time_error_energy",
                "total_error_displacement",
                "total_error_tip",
                "total_error_energy",
                "failure",
            ]
            .map(str::to_string)
            .to_vec(),
            rows: rows.iter().map(line).collect(),
        }
    }

    fn charts(
        &self,
        rows: &[Row<'_>],
        limit: Option<&(Result3, [f64; 3], f64)>,
        findings: &mut Findings,
    ) -> Result<()> {
        let nodes = self.nodes();
        let reference = self.meshes.iter().position(|n| *n == nodes).and_then(|mesh| self.references.get(mesh));
        type Cost = fn(&Trial) -> f64;
        let costs: [(&str, &str, Cost); 2] = [
            ("time", "processor time (s)", |trial| trial.processor_s),
            ("work", "linear solves", |trial| trial.factorisations as f64),
        ];
        for (i, quantity) in QUANTITIES.iter().enumerate() {
            let floor = reference.map_or(0.0, |reference| TRUSTED * reference.errors[i]);
            for (file, label, cost) in &costs {
                let mut series: Vec<Series> = Vec::new();
                for row in self.on(rows, nodes) {
                    let Some(error) = row.time.map(|e| e[i]).filter(|e| *e > floor && *e < 10.0) else { continue };
                    let point = (cost(row.trial), error);
                    if point.0 <= 0.0 {
                        continue; // a model that solves no equations
                    }
                    match series.iter_mut().find(|series| series.label == row.curve()) {
                        Some(series) => series.points.push(point),
                        None => series.push(Series::new(row.curve(), vec![point], Mark::Dotted)),
                    }
                }
                let lines = self.settled(rows).into_iter().filter(|(_, e)| e[i] > floor && e[i] < 10.0);
                let lines =
                    level_lines(lines.map(|(row, e)| (format!("model error of {}", row.case.recipe), e[i])), &series);
                series.extend(order_lines(&series));
                series.extend(lines);
                let chart = Chart {
                    title: format!("{}: error of the {quantity}, {nodes} nodes", self.scene.name),
                    x: (*label).into(),
                    y: format!("relative error of the {quantity}"),
                    scale: Scale::LogLog,
                    series,
                };
                let caption = format!(
                    "Error of the {quantity} against {label}, one line a method; the triangles show the slopes of whole orders."
                );
                findings.figures.push(Figure::new(format!("{}-{file}.svg", FILES[i]), caption, chart.svg()));
            }
        }
        if let Some((limit, ..)) = limit {
            let caption = "Error of the displacement that the steps make, one line a method, and what each mesh makes, as levels.";
            let chart = self.decomposition(rows, limit);
            findings.figures.push(Figure::new("decomposition.svg", caption, chart.svg()));
        }
        Ok(())
    }

    /// Error of the displacement by the steps, one line a method, and by each mesh, as level lines.
    fn decomposition(&self, rows: &[Row<'_>], limit: &Result3) -> Chart {
        let nodes = self.nodes();
        let mut series: Vec<Series> = Vec::new();
        for row in self.on(rows, nodes) {
            let (Pace::Fixed(step), Some(errors)) = (row.case.pace, row.time) else { continue };
            if !row.case.recipe.method.implicit || errors[0] > 10.0 {
                continue;
            }
            match series.iter_mut().find(|series| series.label == row.curve()) {
                Some(series) => series.points.push((step, errors[0])),
                None => series.push(Series::new(row.curve(), vec![(step, errors[0])], Mark::Dotted)),
            }
        }
        let meshes = self.meshes.iter().zip(self.references);
        let levels = meshes.map(|(nodes, reference)| (format!("mesh, {nodes}"), reference.result.errors(limit)[0]));
        let levels = level_lines(levels, &series);
        series.extend(levels);
        Chart {
            title: format!("{}: error of the steps against error of the mesh", self.scene.name),
            x: "time step (s)".into(),
            y: "relative error of the net displacement".into(),
            scale: Scale::LogLog,
            series,
        }
    }
}

/// Level lines across a chart of `series`, with their names at a quarter of its width.
fn level_lines(levels: impl Iterator<Item = (String, f64)>, series: &[Series]) -> Vec<Series> {
    let x = || series.iter().flat_map(|series| &series.points).map(|p| p.0).filter(|x| *x > 0.0);
    let (low, high) = (x().fold(f64::INFINITY, f64::min), x().fold(0.0, f64::max));
    let quarter = low.powf(0.75) * high.powf(0.25);
    levels.map(|(name, y)| Series::new(name, vec![(low, y), (high, y), (quarter, y)], Mark::Level)).collect()
}

/// Lines of slopes −1, −2 and −3 at the lower left of a chart of errors against work.
fn order_lines(series: &[Series]) -> Vec<Series> {
    let points = || series.iter().flat_map(|series| &series.points).filter(|p| p.0 > 0.0 && p.1 > 0.0);
    let x = points().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let [low, high] = [f64::min, f64::max].map(|of| points().map(|p| p.1).reduce(of).unwrap_or(1.0));
    if !x.is_finite() {
        return Vec::new();
    }
    let top = low.powf(0.75) * high.powf(0.25); // three quarters down
    let triangle = |order: i32| {
        let corners = vec![(x, top), (2.0 * x, top * 0.5_f64.powi(order))];
        Series::new(order.to_string(), corners, Mark::Slope)
    };
    (1..=3).map(triangle).collect()
}
