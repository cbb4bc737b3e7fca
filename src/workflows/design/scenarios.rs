//! Robust design: one design for several scenes, the cases of a sweep. The objective is the worst or the mean of their objectives
//! (Ben-Tal, El Ghaoui & Nemirovski, Robust Optimization, 2009).

use std::ops::ControlFlow;
use std::sync::Mutex;

use serde::Serialize;

use super::design_vector::DesignVector;
use super::designed_scene::with_fixed_fluid;
use super::limits::{LimitValue, Limits};
use super::objective::{Objective, ObjectiveValue, objective_of};
use super::table::{DesignTable, DesignVariable};
use crate::error::{Error, Result};
use crate::jobs;
use crate::rod::Rod;
use crate::scene::{Document, KeyError, Scene};
use crate::sensitivity::{JointDirection, Parameter, Problem};
use crate::sweep::Sweep;

/// Keys of the scene that are set by a design variable along the rod.
const KEYS_OF_VARIABLES: [(DesignVariable, &[&str]); 3] = [
    (DesignVariable::Stiffness, &["rod.stiffness_profile", "rod.stiffness_gradient"]),
    (DesignVariable::Amplitude, &["actuation.amplitude_profile"]),
    (DesignVariable::Phase, &["actuation.phase_profile_rad"]),
];

/// One of the scenes for which a design is made.
pub(super) struct Scenario {
    /// Description of the case.
    pub name: String,
    pub document: Document,
    objective: Objective,
    problem: Problem,
    limits: Limits,
    /// Stiffness of its sections over that of the base scene, per joint. Empty if stiffness follows from the scene.
    stiffer: Vec<f64>,
    /// EI of the joints in its scene, N m².
    own_stiffness: Vec<f64>,
}

/// The objective of a design in one scenario.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ScenarioResult {
    pub case: String,
    /// Objective of the design; `None` if the simulation fails.
    pub designed: Option<f64>,
    /// Objective of the baseline.
    pub before: Option<f64>,
    /// Relative gain, %.
    pub gain_percent: Option<f64>,
}

/// The scenarios that `table` names for `document` with `scene`; empty if the design is for this scene alone.
///
/// # Errors
/// Those of [`Sweep::read`] and of the scenes; [`Error::Scene`] if an axis sets a key that the design decides.
pub(super) fn scenarios(document: &Document, scene: &Scene, table: &DesignTable) -> Result<Vec<Scenario>> {
    let Some(file) = &table.over else { return Ok(Vec::new()) };
    let sweep = Sweep::over(&scene.read_from, &scene.folder.join(file), &[], Some(document.clone()))?;
    let rod = scene.model()?.rod;
    for key in sweep.axes.iter().flat_map(|axis| &axis.keys) {
        let number = table.numbers.iter().any(|number| number.key == *key);
        let along = KEYS_OF_VARIABLES
            .iter()
            .any(|(variable, keys)| table.variables.contains(variable) && keys.contains(&&**key));
        if number || along || key == "rod.nodes" {
            let problem = format!("{file} moves {key}, which the design decides; allowed: axes of other keys");
            return Err(document.error_at(&KeyError { key: "design.over".into(), problem }));
        }
    }
    let case = |index: usize| {
        let case = sweep.case(index)?;
        let name = sweep.describe(&case);
        sweep.scene(&case)?; // its errors name the axis
        let named = |error: Error| match error {
            Error::Design { reason } => Error::Design { reason: format!("{reason} (in {name})") },
            other => other,
        };
        Scenario::of(name.clone(), &sweep.document(&case), &rod, table).map_err(named)
    };
    (0..sweep.size()).map(case).collect()
}

impl Scenario {
    /// The scenario of `document`, for the `table` of a base scene with `rod`.
    fn of(name: String, document: &Document, rod: &Rod, table: &DesignTable) -> Result<Self> {
        let scene = document.scene()?;
        let document = with_fixed_fluid(document, &scene);
        let own = DesignTable::of(&scene).map_err(|fault| document.error_at(&fault))?;
        let by = |table: &DesignTable| table.numbers.iter().map(|number| number.by).collect::<Vec<_>>();
        if by(&own) != by(table) {
            let problem =
                "its case has other numbers than the scene; allowed: axes that leave the variables as they are";
            return Err(document.error_at(&KeyError { key: "design.over".into(), problem: problem.into() }));
        }
        let (objective, mut problem) = objective_of(&document, &scene, table, None)?;
        let limits = Limits::of(&table.of_motion(), &mut problem, &objective)?;
        let stiffer = if table.variables.contains(&DesignVariable::Stiffness) {
            let stiffness = |of: &Rod| of.joints().map(|k| of.section_stiffness(k)).collect::<Vec<_>>();
            stiffness(&problem.model().rod).iter().zip(stiffness(rod)).map(|(case, own)| case / own).collect()
        } else {
            Vec::new()
        };
        let own_stiffness = problem.stiffness();
        Ok(Self { name, document, objective, problem, limits, stiffer, own_stiffness })
    }

    /// The design `profile` of the base scene in this scenario.
    pub fn profile(&self, profile: &DesignVector) -> DesignVector {
        let stiffness = profile.stiffness_n_m2.iter().zip(&self.stiffer).map(|(ei, stiffer)| ei * stiffer).collect();
        let stiffness_n_m2 = if self.stiffer.is_empty() && !profile.numbers.is_empty() {
            Vec::new()
        } else if self.stiffer.is_empty() {
            self.own_stiffness.clone()
        } else {
            stiffness
        };
        DesignVector { stiffness_n_m2, ..profile.clone() }
    }

    /// The stiffness of the section at node `k` over that of the base scene.
    fn stiffer(&self, k: usize) -> f64 {
        self.stiffer.get(k - self.problem.model().rod.joints().start).copied().unwrap_or(1.0)
    }

    /// Sets the `directions` of derivatives in the parameters of the base scene's joints.
    pub fn set_directions(&mut self, directions: &[JointDirection]) {
        let own = |along: &JointDirection| match along.is_of_stiffness() {
            true => along.scaled(|k| self.stiffer(k)),
            false => along.clone(),
        };
        self.problem.directions = directions.iter().map(own).collect();
    }

    /// The objective and the limits on the motion, with derivatives with respect to `parameters` of the base scene; `None` if a
    /// simulation fails.
    fn at(&mut self, profile: &DesignVector, parameters: &[Parameter]) -> Option<(ObjectiveValue, Vec<LimitValue>)> {
        let profile = self.profile(profile);
        let mut value = self.objective.at(&mut self.problem, &profile, parameters)?;
        let mut limits = self.limits.at(&mut self.problem, &profile, parameters)?;
        for by in std::iter::once(&mut value.by).chain(limits.iter_mut().map(|limit| &mut limit.by)) {
            for (by, parameter) in by.iter_mut().zip(parameters) {
                if let Parameter::Stiffness(k) = parameter {
                    *by *= self.stiffer(*k);
                }
            }
        }
        for limit in &mut limits {
            limit.name = format!("{} in {}", limit.name, self.name);
        }
        Some((value, limits))
    }
}

/// Objective and limits in each of `cases`, on all cores; `None` if a simulation fails.
pub(super) fn evaluate_all(
    cases: &mut [Scenario],
    profile: &DesignVector,
    parameters: &[Parameter],
) -> Option<Vec<(ObjectiveValue, Vec<LimitValue>)>> {
    let all: Vec<usize> = (0..cases.len()).collect();
    let mut found: Vec<Option<(ObjectiveValue, Vec<LimitValue>)>> = all.iter().map(|_| None).collect();
    let cases: Vec<Mutex<&mut Scenario>> = cases.iter_mut().map(Mutex::new).collect();
    let work = |i: usize| cases[i].lock().ok().and_then(|mut case| case.at(profile, parameters));
    let keep = |i: usize, value| {
        found[i] = value;
        Ok(if found[i].is_some() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) })
    };
    jobs::run(&all, jobs::cores(), work, keep).ok()?;
    found.into_iter().collect()
}
