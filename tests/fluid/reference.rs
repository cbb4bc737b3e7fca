//! The fluid's forces against an independent program: the scenes of `tests/reference/fluid`, each with its answer.

use crate::common;
use std::path::Path;
use std::sync::Arc;

use caudal::fluid::force::{StateDerivatives, powers, resultant};
use caudal::metrics::Reading;
use caudal::model::Dynamics;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::system::{State, System};
use common::{Dice, SOFT, run_with, scene_files, scene_of, time_step};
use nalgebra::Vector2;
use serde_json::Value;

/// Scenes with another answer than positions at the end, see `tests/fluid/validation.rs`.
const ELSEWHERE: [&str; 1] = ["pyelastica_flagella"];

/// Largest deviation of a position over the length: without and with `[reactive]`. Measured: at most 4.9e-15, in
/// the chain form 1.6e-12.
const POSITIONS: [f64; 2] = [1e-9, 1e-8];

/// Largest relative deviation of an energy, a power, a force or a velocity. Measured: at most 2.5e-12, in the chain
/// form 4.1e-11, and 1.9e-10 of the mean force on the host of a steel tail.
const OTHERS: f64 = 1e-7;

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        Value::Number(x) => vec![x.as_f64().unwrap()],
        _ => Vec::new(),
    }
}

/// What is measured of a run, each under the key of the independent answer.
type Found = Vec<(&'static str, Vec<f64>)>;

fn mean(readings: &[(Reading, Vec<f64>)], of: impl Fn(&Reading) -> Vec<f64>) -> Vec<f64> {
    let mut sum = Vec::new();
    for (reading, _) in readings {
        let values = of(reading);
        sum.resize(values.len(), 0.0);
        sum.iter_mut().zip(values).for_each(|(sum, x)| *sum += x);
    }
    sum.iter().map(|x| x / readings.len() as f64).collect()
}

fn pair(vector: Vector2<f64>) -> Vec<f64> {
    vec![vector.x, vector.y]
}

/// Steps in the last period of what drives the scene.
fn period(scene: &Scene) -> usize {
    let slowest = scene.spectrum().slowest().filter(|_| scene.tables().is_empty());
    let frequency = slowest.unwrap_or(0.2); // of the table of the driven angle
    (1.0 / (frequency * time_step(scene))).round() as usize
}

/// The centre of mass of the rod alone, where that of rod and body is `com` and the nodes are at `q`.
fn rod_com(dynamics: &Dynamics, com: Vector2<f64>, q: &[f64]) -> Vector2<f64> {
    let rod = &dynamics.model.rod;
    if rod.front == 0 {
        return com;
    }
    let (all, body) = (rod.total_mass(), rod.mass[0]);
    (com * all - Vector2::new(q[0], q[1]) * body) / (all - body)
}

fn found(scene: &Scene, stepper: &Stepper, readings: &[(Reading, Vec<f64>)]) -> Found {
    let now = &stepper.meter().now;
    let period = period(scene).min(readings.len() - 1);
    let (before, last) = readings.split_at(readings.len() - period);
    let dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
    let start = &before[before.len() - 1];
    let moved = rod_com(&dynamics, now.com, &stepper.state().q) - rod_com(&dynamics, start.0.com, &start.1);
    vec![
        ("final_velocities_m_s", stepper.state().v.clone()),
        ("com_m", pair(now.com)),
        ("rod_com_m", pair(rod_com(&dynamics, now.com, &stepper.state().q))),
        ("mean_velocity_last_period_m_s", pair(moved / (period as f64 * time_step(scene)))),
        ("mean_force_on_host_last_period_N", mean(last, |r| pair(r.head_force))),
        ("bending_j", vec![now.energy.bending]),
        ("kinetic_j", vec![now.energy.kinetic]),
        ("fluid_kinetic_j", vec![now.energy.fluid]),
        ("fluid_momentum_n_s", pair(now.momentum.fluid)),
        ("drag_power_w", vec![now.power.viscous]),
        ("wake_power_w", vec![now.power.wake]),
        ("spray_power_w", vec![now.power.spray]),
        ("mean_spray_power_w", mean(readings, |r| vec![r.power.spray])),
        ("mean_drag_power_w", mean(readings, |r| vec![r.power.viscous])),
        ("mean_wake_power_w", mean(readings, |r| vec![r.power.wake])),
        ("drag_force_n", pair(now.push.drag)),
        ("wake_force_n", pair(now.push.wake)),
        ("head_exerts_n", pair(-now.head_force)),
        ("mean_head_exerts_n", mean(readings, |r| pair(-r.head_force))),
    ]
}

/// Largest difference over the largest of the expected.
fn deviation(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let off = common::largest(found.iter().zip(expected).map(|(a, b)| a - b));
    off / common::largest(expected.iter().copied()).max(f64::MIN_POSITIVE)
}

#[test]
fn scenes_in_fluids_agree_with_an_independent_program() {
    let mut compared = 0;
    for path in scene_files("tests/reference/fluid") {
        let name = path.file_stem().and_then(|name| name.to_str()).unwrap();
        if ELSEWHERE.contains(&name) {
            continue;
        }
        for form in ["positions", "chain"] {
            let mut document = Document::read(&path).unwrap();
            document.set(&format!("solver.form={form}")).unwrap();
            // That program knows round cores with a membrane.
            document.set("rod.section=round").unwrap();
            // An answer may be of whole steps, up to the last before the end of the scene.
            let answer = answer(&path);
            if let (Some(steps), Some(step)) = (answer["steps"].as_f64(), answer["time_step_s"].as_f64()) {
                document.set(&format!("solver.duration_s={}", steps * step)).unwrap();
            }
            let scene = document.scene().unwrap();
            compare(&scene, &path);
            compared += 1;
        }
    }
    assert_eq!(compared, 2 * 11);
}

fn answer(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path.with_extension("json")).unwrap()).unwrap()
}

fn compare(scene: &Scene, path: &Path) {
    let answer = answer(path);
    let mut readings = Vec::new();
    let stepper = run_with(scene, |stepper| readings.push((stepper.meter().now.clone(), stepper.state().q.clone())));
    let expected = numbers(&answer["final_positions_m"]);
    assert_eq!(expected.len(), stepper.state().q.len());
    let off = stepper.state().q.iter().zip(&expected).map(|(a, b)| a - b);
    let off = common::largest(off) / scene.rod.length_m.get();
    let tolerance = POSITIONS[usize::from(scene.reactive.is_some())];
    assert!(off < tolerance, "{}: {off:e} of the length", scene.name);
    // Of the laws of slender bodies the answer is in a table of its own.
    let table = if answer["lumped"].is_object() { &answer["lumped"] } else { &answer };
    let mut looked = 0;
    for (key, found) in found(scene, &stepper, &readings) {
        let expected = numbers(&table[key]);
        if expected.is_empty() {
            continue;
        }
        looked += 1;
        let off = deviation(&found, &expected);
        assert!(off < OTHERS || off == 0.0, "{}: {key} {found:?}, expected {expected:?}: {off:e}", scene.name);
    }
    assert!(looked >= 2, "{}: {looked}", scene.name);
}

#[test]
fn what_the_reactive_force_takes_is_the_energy_and_momentum_of_the_water() {
    let changes =
        ["reactive.shedding=1.0", "medium.flow_m_s=[0.4,-0.2]", "rod.depth_m=[[0, 0.05], [0.7, 0.3], [1, 0.2]]"];
    let mut dynamics = Dynamics::new(Arc::new(scene_of(SOFT, &changes).model().unwrap()));
    let nodes = dynamics.nodes();
    let mut dice = Dice(3);
    for _ in 0..20 {
        let mut state = State { q: dice.chain(nodes, 0.125), ..State::zeros(2 * nodes) };
        (state.v, state.a) = (dice.many(2 * nodes, -1.0, 1.0), dice.many(2 * nodes, -5.0, 5.0));
        // Energy and momentum at time t from now, where accelerations stay; and how the energy changes.
        let mut at = |t: f64| {
            let mut later = state.clone();
            for (i, a) in state.a.iter().enumerate() {
                later.q[i] += t * (state.v[i] + 0.5 * t * a);
                later.v[i] += t * a;
            }
            let bent = dynamics.shape(&later).unwrap();
            let rod = bent.kinematics();
            let force = bent.dynamics.model.forces.iter().find(|force| force.name() == "reactive").unwrap();
            let [mut q, mut v, mut a] = [(); 3].map(|()| vec![0.0; 2 * nodes]);
            force.energy(&rod, 1.0, Some(StateDerivatives { q: &mut q, v: &mut v, a: &mut a }));
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let momentum: Vector2<f64> = v.as_chunks().0.iter().map(|v| Vector2::from(*v)).sum();
            let own = [Vector2::x(), Vector2::y()].map(|axis| force.momentum(&rod, axis, 0.0, None));
            // Measured: at most 1e-15 of it.
            assert!((Vector2::from(own) - momentum).norm() < 1e-13 * momentum.norm(), "{own:?} {momentum}");
            // How the momentum changes as it says itself.
            let rate = Vector2::from([Vector2::x(), Vector2::y()].map(|axis| {
                let [mut q, mut v, mut a] = [(); 3].map(|()| vec![0.0; 2 * nodes]);
                force.momentum(&rod, axis, 1.0, Some(StateDerivatives { q: &mut q, v: &mut v, a: &mut a }));
                dot(&q, &later.v) + dot(&v, &later.a)
            }));
            let sum = resultant(force, &rod);
            // Σ f = dP_f/dt, semi-discretely; measured: see below.
            assert!((rate - sum).norm() < 1e-12 * sum.norm().max(1.0), "{rate} {sum}");
            (dot(&q, &later.v) + dot(&v, &later.a), momentum, powers(force, &rod).against_fluid, resultant(force, &rod))
        };
        let (gained, _, taken, sum) = at(0.0);
        // Measured: at most 1.5e-14 of it.
        assert!((gained - taken).abs() < 1e-12 * taken.abs().max(1.0), "{gained} {taken}");
        let h = 2e-4;
        let mut slope = |h: f64| (at(h).1 - at(-h).1) / (2.0 * h);
        let found = (slope(h) * 4.0 - slope(2.0 * h)) / 3.0;
        // Measured: at most 3.9e-10, of the differences.
        assert!((found - sum).norm() < 1e-8 * sum.norm(), "{found} {sum}");
    }
}

#[test]
fn profiles_begin_at_the_head_and_rise() {
    let with = |change: &str| {
        let mut document = Document::new("profile.toml", SOFT);
        document.set(change).unwrap();
        document.scene().map_err(|error| error.to_string())
    };
    let good = with("rod.outer_radius_m=[[0, 0.08], [1, 0.04]]").unwrap();
    assert_eq!(good.model().unwrap().rod.sections.outer.at(0.5), 0.06);
    with("rod.density_kg_m3=[[0.0, 1000.0], [1.0, 900.0]]").unwrap();
    let zero = with("rod.outer_radius_m=[[0, 0.08], [1, 0]]").unwrap_err();
    assert!(zero.contains("rod.outer_radius_m: found 0; allowed: a positive number"), "{zero}");
    for (key, other) in [("along_n_s_m2", "across_n_s_m2"), ("across_n_s_m2", "along_n_s_m2")] {
        for points in ["[[0.5, 1.0], [0.2, 2.0]]", "[[0, 1.0], [1.5, 2.0]]", "[]"] {
            let drag = format!("drag={{ law = \"coefficients\", {key} = {points}, {other} = 1.0 }}");
            let mut document = Document::new("profile.toml", SOFT.replace("ratio = 5.0\n", ""));
            document.set(&drag).unwrap();
            let fault = document.scene().unwrap_err().to_string();
            assert!(fault.contains(&format!("drag.{key}: found")), "{points}: {fault}");
        }
    }
}
