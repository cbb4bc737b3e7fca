//! `caudal study accuracy`: error against cost of models, methods, steps and meshes.
//!
//! Errors are measured against references that the study computes itself with two independent methods: ESDIRK3 with small steps,
//! and generalized-α with small steps and Richardson extrapolation. Their difference is the error of the reference. If it is not
//! small, no reference exists, and the study measures how fast two runs diverge that start a billionth of a length apart.
//!
//! The references use the full model, so that the errors of a cheaper model include its modelling error, which is independent of the step.

mod divergence_of_nearby_runs;
mod explanations;
mod figures;
mod plan;
mod quantities;
mod reference;

use serde::{Deserialize, Serialize};

use self::divergence_of_nearby_runs::{INITIAL_PERTURBATION, WINDOWS, without_reference};
use self::explanations::AccuracyReport;
use self::plan::{BELOW_LIMIT, PlannedRun, check_without, limit_step, plan};
use self::reference::{RUN_OPTIONS, Reference};
use super::runner::{StudyOutcome, StudyRunner};
use super::study_run::{RunOptions, SimulationMethod, StudyRun};
use crate::error::{Error, Result};
use crate::integrator::StepControl;
use crate::jobs;
use crate::report::Findings;
use crate::scene::Scene;

/// Newton's tolerance in runs with fixed steps, far below all errors of interest. With adaptive steps it follows from their
/// tolerance, and contributes to their error.
const NEWTON_TOLERANCE: f64 = 1e-12;
/// The references use this fraction of the study's finest step, and half of it.
const REFERENCE_STEP: f64 = 0.5;
/// If the two references differ by more than this, relative, there is no reference.
const MAX_REFERENCE_ERROR: f64 = 1e-2;
/// Pairs of nearby runs use the explicit method up to this many steps.
const MAX_EXPLICIT_STEPS: f64 = 1e7;

/// Options of the study.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccuracyOptions {
    /// Numbers of nodes; empty for the scene's own mesh and two finer ones.
    pub nodes: Vec<u64>,
    /// Fixed steps (s); empty for eight times the scene's step down to a thirty-second of it.
    pub steps: Vec<f64>,
    /// Tolerances of adaptive methods and of cheaper models; empty for 1e-2 … 1e-7.
    pub tolerances: Vec<f64>,
    /// Names of methods and cheaper models to leave out.
    pub without: Vec<String>,
}

fn esdirk() -> Option<SimulationMethod> {
    SimulationMethod::named("esdirk3")
}

fn alpha() -> Option<SimulationMethod> {
    SimulationMethod::named("generalized-alpha")
}

/// Computes the error of `scene` against its cost for each model, method, step and mesh.
///
/// # Errors
/// Those of [`Scene::model`], [`Error::Write`](crate::Error::Write), [`Error::Journal`](crate::Error::Journal).
pub(super) fn accuracy(scene: &Scene, asked: &AccuracyOptions, runner: StudyRunner<'_>) -> Result<StudyOutcome> {
    check_without(&asked.without)?;
    let duration = scene.solver.duration_s.get();
    if let Some(step) = asked.steps.iter().find(|step| **step > duration) {
        let problem = format!("steps: found {step}; allowed: up to the duration of the scene, {duration} s");
        return Err(Error::Study { problem });
    }
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
    let Some((esdirk, alpha)) = esdirk().zip(alpha()) else { return Ok(StudyOutcome::Complete(Findings::default())) };

    let finest = REFERENCE_STEP * steps.iter().copied().fold(f64::INFINITY, f64::min);
    let reference = |nodes: u64, simulation: &SimulationMethod, step: f64| PlannedRun {
        simulation: simulation.clone(),
        step_control: StepControl::Fixed(step),
        nodes,
        part: 1.0,
        push: None,
    };
    let mut cases: Vec<PlannedRun> = Vec::new();
    for nodes in &meshes {
        for simulation in [&esdirk, &alpha] {
            cases.extend([finest, 0.5 * finest].map(|step| reference(*nodes, simulation, step)));
        }
    }
    let run = |case: &PlannedRun| {
        let duration = case.part * scene.solver.duration_s.get();
        let mut scene = case
            .simulation
            .of(scene)
            .with_step_control(case.step_control)
            .with_nodes(case.nodes)
            .with_duration(duration);
        if let StepControl::Fixed(_) = case.step_control {
            scene = scene.with_newton_tolerance(NEWTON_TOLERANCE);
        }
        StudyRun::of(&scene, RunOptions { push: case.push, ..RUN_OPTIONS }, runner.interrupted)
    };
    let runs = match runner.run_all("references", scene, &cases, jobs::cores(), run)? {
        Ok(runs) => runs,
        Err(interrupted) => return Ok(interrupted),
    };
    let mut references = Vec::new();
    for (nodes, four) in meshes.iter().zip(runs.chunks(4)) {
        match Reference::of(four) {
            Some(reference) if reference.errors[..2].iter().all(|e| *e < MAX_REFERENCE_ERROR) => {
                references.push(reference)
            }
            other => {
                // Pairs of runs, one of each displaced at the start, over the whole duration down to a thousandth of it. They use
                // the method without numerical damping if its stability limit is known.
                let explicit = match (SimulationMethod::named("symplectic-euler"), limit_step(scene, *nodes)?) {
                    (Some(simulation), Some(limit))
                        if scene.solver.duration_s.get() <= MAX_EXPLICIT_STEPS * BELOW_LIMIT * limit =>
                    {
                        Some((simulation, BELOW_LIMIT * limit))
                    }
                    _ => None,
                };
                let (simulation, step) = explicit.unwrap_or((alpha.clone(), finest));
                let pair = |part: f64| {
                    [0.0, INITIAL_PERTURBATION].map(|push| PlannedRun {
                        part,
                        push: Some(push),
                        ..reference(*nodes, &simulation, step)
                    })
                };
                let pairs: Vec<PlannedRun> = WINDOWS.into_iter().flat_map(pair).collect();
                let pairs = match runner.run_all("pairs", scene, &pairs, jobs::cores(), run)? {
                    Ok(pairs) => pairs,
                    Err(interrupted) => return Ok(interrupted),
                };
                let findings = without_reference(scene, *nodes, finest, four, other.as_ref(), &pairs)?;
                return Ok(StudyOutcome::Complete(findings));
            }
        }
    }

    let (cases, left_out) = plan(scene, &meshes, &steps, &tolerances, &asked.without)?;
    let runs = match runner.run_all("runs", scene, &cases, jobs::cores(), run)? {
        Ok(runs) => runs,
        Err(interrupted) => return Ok(interrupted),
    };
    Ok(StudyOutcome::Complete(
        AccuracyReport {
            scene,
            meshes: &meshes,
            references: &references,
            cases: &cases,
            runs: &runs,
            left_out: &left_out,
        }
        .findings()?,
    ))
}
