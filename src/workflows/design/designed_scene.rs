//! Scenes with a design: the document of a scene with the values of a design, other time steps, methods or meshes.

use super::design_vector::DesignVector;
use super::markers::finer_node;
use crate::error::{Error, Result};
use crate::integrator::StepControl;
use crate::rod;
use crate::scene::{Document, Scene};
use crate::sensitivity::scene_parameter::{SceneParameter, keys_with};

/// Steps per period, or per duration if there is no period, for a scene with adaptive steps.
const STEPS: [f64; 2] = [200.0, 1000.0];

/// `document` with the fluid model that `scene` uses, so that changed numbers do not change the choice of the model.
pub(super) fn with_fixed_fluid(document: &Document, scene: &Scene) -> Document {
    let mut document = document.clone();
    document.keep_fluid_of(scene);
    document
}

/// The simulations in which a design is checked: the original settings, half the step, another method, and a finer mesh.
pub(super) fn simulations(scene: &Scene) -> Vec<(String, Vec<String>)> {
    let step = 0.5 * scene.typical_step();
    let other = if scene.integrator_name() == "generalized-alpha" { "newmark" } else { "generalized-alpha" };
    let finer = 2 * scene.rod.nodes.get() - 1;
    vec![
        ("as designed".to_string(), Vec::new()),
        (format!("time step {step:e} s"), vec![format!("solver.time_step_s={step:e}")]),
        (other.to_string(), vec![format!("solver.integrator={other}")]),
        (format!("{finer} nodes"), [vec![format!("rod.nodes={finer}")], moved_loads(scene, 2)].concat()),
    ]
}

/// The changes that keep point loads in place on a mesh of `finer` times as many edges.
fn moved_loads(scene: &Scene, finer: usize) -> Vec<String> {
    let front = usize::from(scene.head_body.is_some());
    let loads = scene.loads.iter().flat_map(|loads| &loads.point).enumerate();
    let moved = |node: i64| match usize::try_from(node) {
        Ok(node) => finer_node(node, finer, front) as i64,
        Err(_) => finer as i64 * (node + 1) - 1,
    };
    loads.map(|(i, load)| format!("loads.point.{i}.node={}", moved(load.node))).collect()
}

/// The scene of `document` with `changes`, a profile of its joints, and `numbers`.
pub(super) fn scene_with(
    document: &Document,
    numbers: &[SceneParameter],
    changes: &[String],
    profile: &DesignVector,
) -> Result<Scene> {
    let keys = keys(document, numbers, profile)?;
    let mut document = document.clone();
    document.begin_layer();
    for change in changes {
        document.set(change)?;
    }
    for (key, value) in keys {
        document.set_value("the design", &key, &value);
    }
    document.scene()
}

/// The changes that give a scene fixed steps and a one-stage method, if it has none.
pub(super) fn fixed_steps(scene: &Scene) -> Vec<String> {
    let one_stage = |step: f64| scene.integrator().is_ok_and(|integrator| integrator.rule(step).is_some());
    if let StepControl::Fixed(step) = scene.step_control()
        && one_stage(step)
    {
        return Vec::new();
    }
    let step = match (scene.step_control(), scene.spectrum().fastest()) {
        (StepControl::Fixed(step), _) => step,
        (_, Some(frequency)) => 1.0 / frequency / STEPS[0],
        (_, None) => scene.solver.duration_s.get() / STEPS[1],
    };
    vec!["solver.integrator=generalized-alpha".to_string(), format!("solver.time_step_s={step:e}")]
}

/// The keys and values that give the scene of `document` the design `profile`.
fn keys(document: &Document, numbers: &[SceneParameter], profile: &DesignVector) -> Result<Vec<(String, toml::Value)>> {
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

/// The document of the designed scene, without `[design]` and with absolute paths.
pub(super) fn designed(
    document: &Document,
    scene: &Scene,
    numbers: &[SceneParameter],
    profile: &DesignVector,
) -> Result<Document> {
    let failed = |reason: String| Error::Page { reason };
    let mut document = document.clone();
    document.begin_layer();
    for (key, value) in keys(&document, numbers, profile)? {
        document.set_value("the design", &key, &value);
    }
    let mut table: toml::Table = document.read_as()?;
    table.remove("design");
    table.insert("name".to_string(), toml::Value::String(format!("{}-designed", scene.name)));
    // The designed scene names the fluid model for which it was designed.
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
