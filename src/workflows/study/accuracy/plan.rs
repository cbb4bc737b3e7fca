//! The runs of the study: which methods, models, steps and tolerances on which meshes.

use crate::error::{Error, Result, did_you_mean, nearest};
use crate::integrator::{METHODS, StepControl};
use crate::modes::Modes;
use crate::reduced::MODELS;
use crate::scene::Scene;
use crate::study::study_run::SimulationMethod;

/// Symplectic Euler runs with this fraction of its stability limit, and with half of that.
pub const BELOW_LIMIT: f64 = 0.95;
/// The stability limit is computed for at most this many nodes.
const MAX_NODES_FOR_MODES: u64 = 401;

/// Steps of an explicit method that cost about as much as one of an implicit method on the same mesh.
const EXPLICIT_STEPS_PER_IMPLICIT: f64 = 10.0;
/// An explicit method is left out on a mesh if its runs would cost more than this multiple of all implicit runs with fixed steps.
const MAX_RELATIVE_COST: f64 = 3.0;

/// A run of the study: a method with a step or tolerance on a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedRun {
    pub simulation: SimulationMethod,
    pub step_control: StepControl,
    pub nodes: u64,
    /// Fraction of the scene's duration.
    pub part: f64,
    /// Initial displacement, over the length, see [`RunOptions::push`](crate::study::study_run::RunOptions::push).
    pub push: Option<f64>,
}

impl PlannedRun {
    /// The keys of a scene that define this run, one per line.
    pub fn keys(&self) -> String {
        let SimulationMethod { kind, method, values } = &self.simulation;
        let mut keys = match self.simulation.is_full() {
            true => {
                let parameters = method.parameters.iter().zip(values);
                let parameters = parameters.map(|(parameter, value)| format!("solver.{} = {value:?}", parameter.name));
                let integrator = format!("solver.integrator = {:?}", method.name);
                [format!("solver.model = {:?}", kind.name), integrator].into_iter().chain(parameters).collect()
            }
            false => vec![format!("solver.model = {:?}", kind.name)],
        };
        keys.push(match self.step_control {
            StepControl::Fixed(step) => format!("solver.time_step_s = {step:?}"),
            StepControl::Adaptive(tolerance) => format!("solver.tolerance = {tolerance:?}"),
        });
        keys.push(format!("rod.nodes = {}", self.nodes));
        keys.join("\n")
    }
}

/// The cost of two explicit runs, with steps of the stability `limit` (s) and half of it, over the cost of all implicit runs with
/// these fixed `steps` (s) on the same mesh.
fn relative_cost(steps: &[f64], limit: f64) -> f64 {
    let methods = METHODS.iter().filter(|method| method.implicit).count() as f64;
    let implicit = methods * steps.iter().map(|step| 1.0 / step).sum::<f64>();
    let explicit = 3.0 / (BELOW_LIMIT * limit);
    explicit / EXPLICIT_STEPS_PER_IMPLICIT / implicit
}

/// Refuses unknown names of methods and models to leave out.
pub fn check_without(without: &[String]) -> Result<()> {
    let cheaper = MODELS.iter().filter(|kind| kind.method.is_some()).map(|kind| kind.name);
    let known: Vec<&str> = METHODS.iter().map(|method| method.name).chain(cheaper).collect();
    if let Some(name) = without.iter().find(|name| !known.contains(&name.as_str())) {
        let near = did_you_mean(nearest(name, known.iter().copied()));
        return Err(Error::Study { problem: format!("without: found {name:?}{near}; allowed: {}", known.join(", ")) });
    }
    Ok(())
}

/// All runs of the study: every model and method on every mesh with every step or tolerance, and the unchanged scene. Also the
/// methods that are left out, with the reasons.
pub fn plan(
    scene: &Scene,
    meshes: &[u64],
    steps: &[f64],
    tolerances: &[f64],
    without: &[String],
) -> Result<(Vec<PlannedRun>, Vec<String>)> {
    let mut left_out = Vec::new();
    let asked = |simulation: &SimulationMethod| !without.iter().any(|name| simulation.is(name));
    let case = |simulation: &SimulationMethod, step_control: StepControl, nodes: u64| PlannedRun {
        simulation: simulation.clone(),
        step_control,
        nodes,
        part: 1.0,
        push: None,
    };
    let mut cases = Vec::new();
    for nodes in meshes {
        for simulation in SimulationMethod::all(scene).into_iter().filter(asked) {
            let case = |step_control: StepControl| case(&simulation, step_control, *nodes);
            if simulation.method.implicit {
                cases.extend(steps.iter().map(|step| case(StepControl::Fixed(*step))));
            } else if let Some(limit) = limit_step(scene, *nodes)? {
                let dear = relative_cost(steps, limit);
                if dear > MAX_RELATIVE_COST {
                    left_out.push(format!(
                        "{simulation} on {nodes} nodes, whose stability limit of {limit:.1e} s requires {:.1e} steps: estimated to cost {dear:.1} times as much as all implicit runs together",
                        3.0 * scene.solver.duration_s.get() / (BELOW_LIMIT * limit)
                    ));
                    continue;
                }
                cases.extend([BELOW_LIMIT, 0.5 * BELOW_LIMIT].map(|part| case(StepControl::Fixed(part * limit))));
            }
            if simulation.method.adaptive {
                cases.extend(tolerances.iter().map(|tolerance| case(StepControl::Adaptive(*tolerance))));
            }
        }
        for simulation in SimulationMethod::cheaper(scene).into_iter().filter(asked) {
            if let Err(refused) = scene.with_model(simulation.kind).check_model() {
                let reason = format!("the model {:?}: {}", simulation.kind.name, refused.problem);
                if !left_out.contains(&reason) {
                    left_out.push(reason);
                }
                continue;
            }
            let case = |tolerance: &f64| case(&simulation, StepControl::Adaptive(*tolerance), *nodes);
            cases.extend(tolerances.iter().map(case));
        }
    }
    let own =
        SimulationMethod::own(scene).zip(meshes.first()).map(|(own, nodes)| case(&own, scene.step_control(), *nodes));
    cases.extend(own.filter(|own| !cases.contains(own)));
    left_out.extend(without.iter().map(|name| format!("{name}, as asked")));
    Ok((cases, left_out))
}

/// The stability limit (s) of explicit methods; `None` for meshes too fine to compute it.
pub fn limit_step(scene: &Scene, nodes: u64) -> Result<Option<f64>> {
    if nodes > MAX_NODES_FOR_MODES {
        return Ok(None);
    }
    let model = scene.with_nodes(nodes).model()?;
    let damping = model.rod.damping.clone();
    Ok(Modes::of_model(model)?.explicit_steps(damping.as_ref()).map(|steps| steps.largest))
}
