//! `caudal study accuracy`: which model, method, step and mesh give which error, at what cost.
//!
//! Errors are measured against references that the study computes itself, by two methods that have nothing in common but the
//! equations: ESDIRK3 with small steps, and generalized-α with small steps extrapolated to none (Richardson). What they
//! differ by is the reference's own error; where that is no small part of the result, no reference exists, and the study
//! measures how fast two runs separate that start a billionth of a length apart.
//!
//! The references are of the whole model, so the errors of a cheaper one have the model's own in them, which no step removes.

mod apart;
mod figures;
mod reference;
mod words;

use serde::{Deserialize, Serialize};

use self::apart::{PUSH, WINDOWS, without_reference};
use self::reference::Reference;
use self::words::Report;
use super::trial::{Manner, Recipe, Trial};
use super::{Desk, Studied};
use crate::error::Result;
use crate::integrator::{METHODS, StepControl};
use crate::jobs;
use crate::modes::Modes;
use crate::report::Findings;
use crate::scene::{HeadKind, Scene};

/// Newton's tolerance in runs with fixed steps: far below every error of interest. In those that choose their steps it follows
/// from their tolerance, and so it is part of their error.
const NEWTON: f64 = 1e-12;
/// The references' steps are this part of the finest of the study, and half of that.
const FINER: f64 = 0.5;
/// From this difference of the references on, relative, there is no reference.
const NO_REFERENCE: f64 = 1e-2;
/// Samples of the tip's path.
const SAMPLES: usize = 500;
/// Symplectic Euler runs at this part of its limit, and at half of it, where the limit is known.
const BELOW_LIMIT: f64 = 0.95;
/// Up to this many nodes that limit is computed.
const MODES_UP_TO: u64 = 401;

/// Steps of an explicit method that cost about as much as one of an implicit method on the same mesh.
const EXPLICIT_STEPS: f64 = 10.0;
/// A method is left out on a mesh where its runs would cost more than this multiple of all implicit runs of fixed steps there.
const DEAR: f64 = 3.0;
/// An explicit method makes at most so many steps in a run of pairs.
const MOST_STEPS: f64 = 1e7;

/// What is asked for.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Accuracy {
    /// Meshes, their numbers of nodes; empty for the scene's own and two finer ones.
    pub nodes: Vec<u64>,
    /// Fixed steps (s); empty for eight times the scene's down to a thirty-second.
    pub steps: Vec<f64>,
    /// Tolerances of adaptive methods and of cheaper models; empty for 1e-2 … 1e-7.
    pub tolerances: Vec<f64>,
    /// Names of methods and of cheaper models that are left out.
    pub without: Vec<String>,
}

/// A quantity that runs are compared by.
struct Quantity {
    /// Its name.
    name: &'static str,
    /// The same within a sentence, after "in".
    within: &'static str,
    /// Its name in keys, columns and files.
    key: &'static str,
    /// The columns of its value; none where it is a course.
    columns: &'static [&'static str],
}

const DISPLACEMENT: Quantity = Quantity {
    name: "net displacement",
    within: "displacement",
    key: "displacement",
    columns: &["net_displacement_m"],
};
const HEAD_FORCE: Quantity = Quantity {
    name: "mean head force",
    within: "the mean head force",
    key: "head_force",
    columns: &["mean_head_force_x_n", "mean_head_force_y_n"],
};
const TIP: Quantity = Quantity { name: "tip path", within: "the tip's path", key: "tip", columns: &[] };
const ENERGY: Quantity =
    Quantity { name: "energy put in", within: "energy", key: "energy", columns: &["energy_put_in_j"] };

/// What is compared: what a free head gets by swimming or a held one bears, the tip's path, and the energy put in.
fn quantities(scene: &Scene) -> [&'static Quantity; 3] {
    [if scene.head.kind == HeadKind::Free { &DISPLACEMENT } else { &HEAD_FORCE }, &TIP, &ENERGY]
}

/// Three errors in words.
fn in_words(quantities: [&Quantity; 3], errors: [String; 3]) -> String {
    let parts: Vec<_> = quantities.iter().zip(errors).map(|(q, error)| format!("{error} in {}", q.within)).collect();
    parts.join(", ")
}

#[derive(Debug, Clone, PartialEq)]
struct Case {
    recipe: Recipe,
    pace: StepControl,
    nodes: u64,
    /// Part of the scene's duration.
    part: f64,
    push: Option<f64>,
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
        pace: StepControl::Fixed(step),
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
        let mut scene = case.recipe.of(scene).with_pace(case.pace).with_nodes(case.nodes).with_duration(duration);
        if let StepControl::Fixed(_) = case.pace {
            scene = scene.with_newton_tolerance(NEWTON);
        }
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
                    (Some(recipe), Some(limit))
                        if scene.solver.duration_s.get() <= MOST_STEPS * BELOW_LIMIT * limit =>
                    {
                        Some((recipe, BELOW_LIMIT * limit))
                    }
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

    let (cases, left_out) = ladder(scene, &meshes, &steps, &tolerances, &asked.without)?;
    let trials = match desk.work("runs", scene, &cases, jobs::cores(), run)? {
        Ok(trials) => trials,
        Err(interrupted) => return Ok(interrupted),
    };
    Ok(Studied::Complete(
        Report { scene, meshes: &meshes, references: &references, cases: &cases, trials: &trials, left_out: &left_out }
            .findings()?,
    ))
}

/// How many times as much as all implicit runs with these fixed `steps` (s) runs of an explicit method with steps of its `limit` (s) and
/// of half of that would cost on the same mesh.
fn dearness(steps: &[f64], limit: f64) -> f64 {
    let methods = METHODS.iter().filter(|method| method.implicit).count() as f64;
    let implicit = methods * steps.iter().map(|step| 1.0 / step).sum::<f64>();
    let explicit = 3.0 / (BELOW_LIMIT * limit);
    explicit / EXPLICIT_STEPS / implicit
}

/// Every model and method on every mesh with every step or tolerance, and the scene as it stands; and which are left out, in words.
fn ladder(
    scene: &Scene,
    meshes: &[u64],
    steps: &[f64],
    tolerances: &[f64],
    without: &[String],
) -> Result<(Vec<Case>, Vec<String>)> {
    let mut left_out = Vec::new();
    let asked = |recipe: &Recipe| !without.iter().any(|name| recipe.is(name));
    let case = |recipe: &Recipe, pace: StepControl, nodes: u64| Case {
        recipe: recipe.clone(),
        pace,
        nodes,
        part: 1.0,
        push: None,
    };
    let mut cases = Vec::new();
    for nodes in meshes {
        for recipe in Recipe::all(scene).into_iter().filter(asked) {
            let case = |pace: StepControl| case(&recipe, pace, *nodes);
            if recipe.method.implicit {
                cases.extend(steps.iter().map(|step| case(StepControl::Fixed(*step))));
            } else if let Some(limit) = limit_step(scene, *nodes)? {
                let dear = dearness(steps, limit);
                if dear > DEAR {
                    left_out.push(format!(
                        "{recipe} on {nodes} nodes, whose limit of {limit:.1e} s makes {:.1e} steps: foreseen to cost {dear:.1} times all implicit runs together",
                        3.0 * scene.solver.duration_s.get() / (BELOW_LIMIT * limit)
                    ));
                    continue;
                }
                cases.extend([BELOW_LIMIT, 0.5 * BELOW_LIMIT].map(|part| case(StepControl::Fixed(part * limit))));
            }
            if recipe.method.adaptive {
                cases.extend(tolerances.iter().map(|tolerance| case(StepControl::Adaptive(*tolerance))));
            }
        }
        for recipe in Recipe::cheaper(scene).into_iter().filter(asked) {
            let case = |tolerance: &f64| case(&recipe, StepControl::Adaptive(*tolerance), *nodes);
            cases.extend(tolerances.iter().map(case));
        }
    }
    let own = Recipe::own(scene).zip(meshes.first()).map(|(own, nodes)| case(&own, scene.pace(), *nodes));
    cases.extend(own.filter(|own| !cases.contains(own)));
    left_out.extend(without.iter().map(|name| format!("{name}, as asked")));
    Ok((cases, left_out))
}

/// The step (s) from which on explicit methods fail, 2/ω_max, where it is computed.
fn limit_step(scene: &Scene, nodes: u64) -> Result<Option<f64>> {
    if nodes > MODES_UP_TO {
        return Ok(None);
    }
    Ok(Some(2.0 / Modes::of_model(scene.with_nodes(nodes).model()?)?.highest()))
}
