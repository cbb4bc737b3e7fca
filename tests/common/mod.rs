//! What the tests share: a passive rod to add tables to, runs to a scene's end, and observed orders.
#![allow(dead_code, clippy::unwrap_used, reason = "every test file takes what it needs; a failure ends the test")]

use std::path::PathBuf;
use std::sync::Arc;

use caudal::integrator::Method;
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::rod::Rod;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::system::{Direction, State, System};

/// The study's tail without anything that acts on it.
const TAIL: &str = r#"
[rod]
nodes = 9
length_m = 1.0
outer_radius_m = 0.013
inner_radius_m = 0.011
youngs_modulus_pa = 70e9
density_kg_m3 = 2700.0
stiffness_gradient = 1.0
mass_lumping = "tributary"
[solver]
time_step_s = 0.001
duration_s = 1.0
newton_tolerance = 1e-12
"#;

/// The study's travelling wave.
pub const WAVE: &str = r#"actuation={ kind = "travelling-wave", kappa_amp = 0.6, kappa_reference_length_m = 0.125, frequency_hz = 2.0, wavelength_m = 1.0, envelope = [0.2, 0.8] }"#;
/// Water.
pub const WATER: &str = "medium={ viscosity_pa_s = 0.001, density_kg_m3 = 1000.0 }";
/// The study's drag, its head ten times as heavy.
pub const DRAG: &str = "drag={ ratio = 5.0, head_weight = 10.0, head_length_m = 0.0625 }";
/// A soft solid rod: its fastest mode is slow enough to be resolved by steps of 0.8 ms (9 nodes).
pub const SILICONE: &str =
    "rod={ outer_radius_m = 0.012, inner_radius_m = 0.0, youngs_modulus_pa = 5e6, density_kg_m3 = 1150.0 }";
/// Glycerol.
pub const GLYCEROL: &str = "medium={ viscosity_pa_s = 0.8, density_kg_m3 = 1260.0 }";
/// A smooth start from rest.
pub const RAMP: &str = "start={ kind = \"ramp\", ramp_s = 0.1 }";

/// The study's tail, passive, with `changes` of the form `table.key=value`.
pub fn scene(changes: &[&str]) -> Scene {
    document("test.toml", changes).scene().unwrap()
}

/// The same, its tables looked for beside `path`.
pub fn document(path: impl Into<PathBuf>, changes: &[&str]) -> Document {
    let mut document = Document::new(path, TAIL);
    for change in changes {
        document.set(change).unwrap();
    }
    document
}

/// The rod of a scene.
pub fn rod(scene: &Scene) -> Rod {
    scene.model().unwrap().rod
}

/// The scene of `changes` with a method of its own and with steps of `time_step` (s).
pub fn scene_by(method: &Method, time_step: f64, changes: &[&str]) -> Scene {
    let (method, step) = (format!("solver.integrator={}", method.name), format!("solver.time_step_s={time_step:e}"));
    scene(&[changes, &[&method, &step]].concat())
}

/// Runs `scene` to its end.
pub fn run(scene: &Scene) -> Stepper {
    run_with(scene, |_| {})
}

/// Runs `scene` to its end, with a look at every step.
pub fn run_with(scene: &Scene, mut look: impl FnMut(&mut Stepper)) -> Stepper {
    let mut stepper = Stepper::of(scene).unwrap();
    let (whole, last) = scene.steps();
    for h in std::iter::repeat_n(scene.solver.time_step_s.get(), whole as usize).chain(last) {
        stepper.do_step(h).unwrap();
        look(&mut stepper);
    }
    stepper
}

/// Root of the sum of squared differences of two arrays.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// The order that two errors show, one of twice the other's step or spacing.
pub fn order(coarse: f64, fine: f64) -> f64 {
    (coarse / fine).abs().log2()
}

/// The rest under forces that grow to `force` (N, two entries a node) in `parts` equal parts.
pub fn equilibrium(scene: &Scene, force: &[f64], parts: u32) -> (Dynamics, State) {
    let mut dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
    let mut newton = Newton::new(dynamics.nodes(), scene.solver.newton_tolerance.get()).unwrap();
    let mut state = dynamics.first_state();
    for part in 1..=parts {
        dynamics.inputs.force = Some(force.iter().map(|f| f * f64::from(part) / f64::from(parts)).collect());
        newton.solve(&mut dynamics, &mut state, Direction { q: 1.0, v: 0.0, a: 0.0 }).unwrap();
    }
    (dynamics, state)
}
