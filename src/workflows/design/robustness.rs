//! Robustness of a design: does its gain survive half the step, another method, a finer mesh, a higher fluid law? Each check, of
//! the design or of the baseline, in each scenario, is an independent simulation that a worker can run.

use std::ops::ControlFlow;

use serde::{Deserialize, Serialize};

use super::checkpoint::Checkpoint;
use super::design_vector::{BASELINE, DesignVector};
use super::designed_scene::{scene_with, simulations};
use super::limits::{LimitUse, Limits};
use super::markers::Markers;
use super::objective::Objective;
use super::scenarios::Scenario;
use super::search::FEASIBILITY_TOLERANCE;
use super::table::DesignTable;
use crate::fluid::laws::{CREEPING, Dependence, DragLaw, LAWS, cross_flow};
use crate::jobs;
use crate::number_format::in_sentence;
use crate::scene::{Document, Scene};
use crate::sensitivity::Problem;

/// A limit counts as kept in a check simulation if it is exceeded there by at most this fraction: other steps, methods and meshes
/// give slightly different peaks.
const LIMIT_TOLERANCE: f64 = 0.02;

/// The check simulations of a design.
pub(super) struct RobustnessChecks<'a> {
    table: &'a DesignTable,
    /// The table with the limits of each simulation: limits on the body are always those of the base scene.
    limited: DesignTable,
    target: Option<&'a Markers>,
    /// Description of each simulation, and its changes of the scene.
    simulations: Vec<(String, Vec<String>)>,
    scenes: Vec<CheckedScene>,
}

/// A scene in which the design is checked.
struct CheckedScene {
    document: Document,
    /// The design, and the baseline.
    profiles: [Option<DesignVector>; 2],
}

impl<'a> RobustnessChecks<'a> {
    /// The checks of `profile`, designed for the scene of `document` or for `cases`, with a `target` trajectory if there is one.
    pub fn of(
        (document, cases): (&Document, &[Scenario]),
        scene: &Scene,
        table: &'a DesignTable,
        target: Option<&'a Markers>,
        profile: &DesignVector,
    ) -> Self {
        let before = Problem::of(scene).ok().map(|problem| DesignVector::before(table, &problem.stiffness()));
        let allowed = |(_, changes): &(String, Vec<String>)| {
            scene_with(document, &table.numbers, changes, profile).is_ok_and(|scene| scene.model().is_ok())
        };
        let fluid = higher_fluids(scene).into_iter().filter(|_| before.is_some()).find(allowed);
        let simulations = simulations(scene).into_iter().chain(fluid).collect();
        let profiles = [Some(profile.clone()), before];
        let of = |case: &Scenario| CheckedScene {
            document: case.document.clone(),
            profiles: [0, 1].map(|i| profiles[i].as_ref().map(|profile| case.profile(profile))),
        };
        let scenes = if cases.is_empty() {
            vec![CheckedScene { document: document.clone(), profiles }]
        } else {
            cases.iter().map(of).collect()
        };
        let limited = if cases.is_empty() { table.clone() } else { table.of_motion() };
        Self { table, limited, target, simulations, scenes }
    }

    /// Number of simulations.
    pub fn count(&self) -> usize {
        self.simulations.len() * 2 * self.scenes.len()
    }

    /// The changes, the scene and the design of simulation `index`.
    fn at(&self, index: usize) -> (&(String, Vec<String>), &CheckedScene, Option<&DesignVector>) {
        let (rest, scene) = (index / self.scenes.len(), &self.scenes[index % self.scenes.len()]);
        (&self.simulations[rest / 2], scene, scene.profiles[rest % 2].as_ref())
    }

    /// A description of simulation `index`.
    pub fn describe(&self, index: usize) -> String {
        let ((name, _), ..) = self.at(index);
        let which = ["the design", BASELINE][index / self.scenes.len() % 2];
        match self.scenes.len() {
            1 => format!("{which}, {name}"),
            _ => format!("{which}, {name}, case {}", index % self.scenes.len()),
        }
    }

    /// The key of its result in the checkpoint.
    pub fn asked(&self, index: usize) -> String {
        let ((_, changes), _, profile) = self.at(index);
        format!("check {index}: {changes:?} of {profile:?}")
    }

    /// The result of simulation `index`; `None` if it fails.
    pub fn measure(&self, index: usize) -> Option<CheckResult> {
        let ((_, changes), CheckedScene { document, .. }, profile) = self.at(index);
        let scene = scene_with(document, &self.table.numbers, changes, profile?).ok()?;
        let mut problem = Problem::without_derivatives(&scene, scene.model().ok()?).ok()?;
        let own = DesignVector::of(problem.stiffness());
        let objective = Objective::new(self.table, &problem, self.target).ok()?;
        let value = objective.measure(&mut problem, &own).filter(|value| value.is_finite())?;
        let limits = Limits::of(&self.limited, &mut problem, &objective).ok()?.at(&mut problem, &own, &[])?;
        Some(CheckResult { objective: value, limit: LimitUse::most(LimitUse::of(&limits)) })
    }

    /// Why simulation `index` has no result.
    fn failure(&self, index: usize) -> String {
        let ((_, changes), CheckedScene { document, .. }, profile) = self.at(index);
        let simulated = |profile: &DesignVector| {
            let scene = scene_with(document, &self.table.numbers, changes, profile)?;
            Problem::without_derivatives(&scene, scene.model()?)?.simulate()
        };
        match profile.map(simulated) {
            Some(Err(error)) => error.to_string(),
            _ => format!("it has no {}", self.table.goal.label()),
        }
    }

    /// Runs all simulations whose results are not in `checkpoint`, on all cores.
    pub fn make(&self, checkpoint: &mut Checkpoint) -> Vec<Check> {
        let mut found: Vec<Option<CheckResult>> = vec![None; self.count()];
        let todo: Vec<usize> = (0..self.count()).filter(|index| !checkpoint.has(&self.asked(*index))).collect();
        let keep = |index: usize, value| {
            found[index] = value;
            Ok(ControlFlow::Continue(()))
        };
        if jobs::run(&todo, jobs::cores(), |index| self.measure(index), keep).is_err() {
            todo.iter().for_each(|index| found[*index] = self.measure(*index)); // if no threads can be started
        }
        let mut values = found.into_iter().enumerate();
        let mut next = || {
            let (index, value) = values.next()?;
            Some((index, checkpoint.get_or_compute(|| self.asked(index), || value)))
        };
        // The result over all scenes, or the first simulation that has none.
        let mut measured = || -> Result<CheckResult, Option<usize>> {
            let results: Vec<_> = self.scenes.iter().filter_map(|_| next()).collect();
            let result = |(index, result): (usize, Option<CheckResult>)| result.ok_or(Some(index));
            let results = results.into_iter().map(result).collect::<Result<Vec<_>, _>>()?;
            let values: Vec<f64> = results.iter().map(|result| result.objective).collect();
            let objective = match values[..] {
                [value] => value,
                _ => self.table.aggregate().of(&values, self.table.smaller_is_better()).ok_or(None)?,
            };
            Ok(CheckResult { objective, limit: LimitUse::most(results.into_iter().filter_map(|result| result.limit)) })
        };
        let check = |(simulation, _): &(String, Vec<String>)| {
            let (designed, before) = (measured(), measured());
            let failed = designed.as_ref().err().or(before.as_ref().err()).copied().flatten();
            let [designed, before] = [designed.ok(), before.ok()];
            let objective = |result: &Option<CheckResult>| result.as_ref().map(|result| result.objective);
            let both = objective(&designed).zip(objective(&before));
            Check {
                simulation: simulation.clone(),
                designed: objective(&designed),
                before: objective(&before),
                failure: failed.map(|index| self.failure(index)),
                gain_percent: both.and_then(|(value, before)| self.table.gain_percent(value, before)),
                limit: designed.and_then(|result| result.limit),
                limit_before: before.and_then(|result| result.limit),
            }
        };
        self.simulations.iter().map(check).collect()
    }
}

/// The result of a check simulation.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CheckResult {
    objective: f64,
    /// The limit that is used most; `None` if there are none.
    limit: Option<LimitUse>,
}

/// The objective in another simulation. For identification, the root mean square distance of the rod from the markers (m).
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Check {
    pub simulation: String,
    /// Objective of the design; `None` if the simulation fails.
    pub designed: Option<f64>,
    /// Objective of the baseline, the scene's own.
    pub before: Option<f64>,
    /// Why one of the two is missing, if one is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Relative gain, %.
    pub gain_percent: Option<f64>,
    /// The limit that the design uses most; `None` if there are none.
    pub limit: Option<LimitUse>,
    /// The limit that the baseline uses most.
    pub limit_before: Option<LimitUse>,
}

/// Whether a gain survives in other simulations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Robustness {
    /// Gain in the simulation of the design, %.
    pub gain_percent: Option<f64>,
    /// Least gain in the other simulations, %; `None` if one of them fails.
    pub least_percent: Option<f64>,
    /// The simulation with the least gain.
    pub least_in: String,
    /// True if all simulations keep the limits and have a positive gain; the gain does not count if the original scene violates the limits.
    pub survives: bool,
    /// True if the design keeps its limits.
    pub kept: bool,
    /// A limit that the design violates in another simulation, and that simulation.
    pub broken_in: Option<[String; 2]>,
    /// A limit that the original scene violates: its objective is then no basis for comparison.
    pub broken_before: Option<String>,
}

impl Robustness {
    /// The robustness from `checks`. The first is the simulation of the design, which has `kept` its limits or not. A failed
    /// simulation of the original scene, for example because the step is too long for the method, says nothing about the gain.
    pub(super) fn of(checks: &[Check], kept: bool) -> Option<Self> {
        let (first, others) = checks.split_first()?;
        let says = |check: &&Check| check.before.is_some();
        let gain = |check: &Check| check.gain_percent.filter(|gain| gain.is_finite());
        let size = |check: &Check| gain(check).unwrap_or(f64::NEG_INFINITY);
        let least = others.iter().filter(says).min_by(|a, b| size(a).total_cmp(&size(b)))?;
        let broken =
            |limit: &Option<LimitUse>, tolerance: f64| limit.as_ref().and_then(|limit| limit.broken(tolerance));
        let used = |check: &&Check| check.limit.as_ref().map_or(0.0, |limit| limit.used);
        let most = others.iter().max_by(|a, b| used(a).total_cmp(&used(b)));
        let broken_in = most.and_then(|check| Some([broken(&check.limit, LIMIT_TOLERANCE)?, check.simulation.clone()]));
        let broken_before = broken(&first.limit_before, FEASIBILITY_TOLERANCE);
        let gains = [first, least].into_iter().all(|check| size(check) > 0.0);
        let simulated = others.iter().filter(says).all(|check| check.designed.is_some());
        Some(Self {
            gain_percent: gain(first),
            least_percent: gain(least),
            least_in: least.simulation.clone(),
            survives: kept && broken_in.is_none() && simulated && (gains || broken_before.is_some()),
            kept,
            broken_in,
            broken_before,
        })
    }

    /// A sentence that states it.
    pub(super) fn words(&self) -> String {
        let gain = self.gain_percent.unwrap_or(f64::NAN);
        match (self.survives, self.least_percent) {
            _ if !self.kept => "no gain: the design violates its limits".to_string(),
            _ if let Some([limit, simulation]) = &self.broken_in => {
                format!("the limits are violated in other simulations: {limit} with {simulation}")
            }
            (true, Some(_)) if let Some(limit) = &self.broken_before => format!(
                "{BASELINE} exceeds a limit ({limit}), and the design satisfies all limits, also in the other simulations: that is the gain, along with {} % of the goal",
                in_sentence(gain, 3)
            ),
            (true, Some(least)) => {
                format!(
                    "the gain of {} % is confirmed: the smallest gain in the other simulations is {} %, with {}",
                    in_sentence(gain, 3),
                    in_sentence(least, 3),
                    self.least_in
                )
            }
            (_, Some(_)) if gain <= 0.0 => format!("no gain: the design is no better than {BASELINE}"),
            (_, Some(least)) => {
                let [gain, least] = [gain, least].map(|percent| in_sentence(percent, 3));
                format!("no gain: {gain} % as designed, but {least} % with {}", self.least_in)
            }
            (_, None) => {
                let gain = in_sentence(gain, 3);
                format!("no gain: {gain} % as designed, but the simulation with {} fails", self.least_in)
            }
        }
    }
}

/// The more accurate fluid models to check with, as descriptions and changes of the scene; the first that the scene allows is used.
/// Above a local law of creeping flow: the nonlocal law if the flow is creeping and the mesh is affordable, otherwise a law with
/// the fluid's inertia. Above that: the reactive force. There are none above these, nor above laws with coefficients from the scene
/// or near a wall.
pub(super) fn higher_fluids(scene: &Scene) -> Vec<(String, Vec<String>)> {
    let rod = scene.model().map(|model| model.rod);
    let of = rod.iter().find_map(|rod| Some((scene.fluid_model(rod).0?, scene.regime().ok()?)));
    let Some((law, regime)) = of.filter(|_| scene.medium.is_some()) else { return Vec::new() };
    if law == &cross_flow::LAW {
        let water = ("added mass".to_string(), vec!["reactive={}".to_string()]);
        return if scene.reactive.is_none() { vec![water] } else { Vec::new() };
    }
    if law.reynolds > CREEPING || !law.needs.is_empty() || law.is_nonlocal() {
        return Vec::new();
    }
    let cheap = |law: &&DragLaw| match law.reach {
        Dependence::Rod { most_nodes, .. } => {
            regime.reynolds <= law.reynolds && 2 * scene.rod.nodes.get() <= most_nodes
        }
        Dependence::Edge => false,
    };
    let whole = LAWS
        .iter()
        .copied()
        .find(cheap)
        .map(|law| (format!("the law {}", law.name), vec![format!("drag.law={}", law.name)]));
    let name = cross_flow::LAW.name;
    let viscous = law.resistance.map(|_| format!("drag.viscous={}", law.name));
    let changes = std::iter::once(format!("drag.law={name}")).chain(viscous).collect();
    whole.into_iter().chain([(format!("the law {name}"), changes)]).collect()
}

#[cfg(test)]
mod tests {
    use super::{Check, LIMIT_TOLERANCE, LimitUse, Robustness};

    #[test]
    fn a_gain_survives_where_limits_are_kept_and_no_simulation_fails_of_the_design_alone() {
        let check = |name: &str, designed: Option<f64>, before: Option<f64>| Check {
            simulation: name.to_string(),
            designed,
            before,
            gain_percent: designed.zip(before).map(|(designed, before)| 100.0 * (designed / before - 1.0)),
            ..Check::default()
        };
        let (own, finer) = (check("as designed", Some(1.2), Some(1.0)), check("finer", Some(1.1), Some(1.0)));
        let trust = |other: Check| Robustness::of(&[own.clone(), other, finer.clone()], true);
        let both = trust(check("newmark", None, None));
        assert!(both.is_some_and(|trust| trust.survives && trust.least_in == "finer"));
        let design = trust(check("newmark", None, Some(1.0)));
        assert!(design.is_some_and(|trust| !trust.survives && trust.least_in == "newmark"));
        let before = trust(check("newmark", Some(1.0), None));
        assert!(before.is_some_and(|trust| trust.survives && trust.least_in == "finer"));
        let broken = Robustness::of(&[own.clone(), finer.clone()], false);
        assert!(broken.is_some_and(|trust| !trust.survives && trust.words().contains("violates its limits")));
        let limit = |used: f64| Some(LimitUse { limit: "power at most 6 W".to_string(), used, at_s: Some(0.25) });
        let at = |used: f64| trust(Check { limit: limit(used), ..check("cross-flow", Some(1.2), Some(1.0)) });
        assert!(at(1.0 + 0.9 * LIMIT_TOLERANCE).is_some_and(|trust| trust.survives));
        let beyond = at(1.66).unwrap_or_else(|| unreachable!());
        assert!(
            !beyond.survives
                && beyond.words()
                    == "the limits are violated in other simulations: power at most 6 W, 166.00 % of it at t = 0.2500 s with cross-flow"
        );
        // A scene that violates the limit is no basis for comparison.
        let first = Check { limit_before: limit(2.0), ..check("as designed", Some(0.8), Some(1.0)) };
        let worse = Robustness::of(&[first, check("finer", Some(0.8), Some(1.0))], true);
        assert!(
            worse.is_some_and(|trust| trust.survives && trust.words().starts_with("the scene's own exceeds a limit"))
        );
    }
}
