//! What the tests share: scenes to change, runs to a scene's end, observed orders, and numbers that look random.
#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    reason = "every test file takes what it needs; a failure ends the test"
)]

pub mod random_scene;
pub mod recorded;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use caudal::integrator::Method;
use caudal::linear::Direction;
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::rod::Rod;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::system::{State, System};

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
integrator = "implicit-euler"
time_step_s = 0.001
duration_s = 1.0
newton_tolerance = 1e-12
"#;

/// A tail of 1 m with `nodes` whose base turns by 0.02 rad, in creeping flow: thrust has a maximum over stiffness.
pub fn driven(nodes: usize) -> String {
    format!(
        r#"
name = "driven"
[rod]
nodes = {nodes}
length_m = 1.0
outer_radius_m = 0.02
inner_radius_m = 0.0
youngs_modulus_pa = 1e7
density_kg_m3 = 1e-2
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1000.0
[drag]
law = "coefficients"
along_n_s_m2 = 1.0
across_n_s_m2 = 2.0
[head]
kind = "driven"
angle_rad = {{ amplitude = 0.02, frequency_hz = 1.0 }}
[solver]
integrator = "generalized-alpha"
time_step_s = 0.0078125
duration_s = 6.0
"#
    )
}

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
/// [`SOFT`] with active moments in place of its natural curvature, which would bend it half as far.
pub fn soft_moments() -> String {
    SOFT.replace("kappa_amp = 4.0", "moment_amp_n_m = 6.0")
}

/// A smooth start from rest.
pub const RAMP: &str = "start={ kind = \"ramp\", ramp_s = 0.1 }";

/// The study's tail in water, released as the study releases it.
pub const STUDY: &str = concat!(include_str!("../../models/baseline.toml"), "newton_tolerance = 1e-12\n");

/// A soft tail in glycerol, fat enough that stretching, bending, drag and inertia are of like size.
pub const SOFT: &str = r#"name = "soft"
[rod]
nodes = 9
length_m = 1.0
outer_radius_m = 0.08
inner_radius_m = 0.0
youngs_modulus_pa = 1e5
density_kg_m3 = 1000.0
stiffness_gradient = 0.5
[actuation]
kind = "travelling-wave"
kappa_amp = 4.0
frequency_hz = 1.5
wavelength_m = 0.8
envelope = [0.2, 0.8]
[medium]
viscosity_pa_s = 5.0
density_kg_m3 = 1260.0
[drag]
ratio = 5.0
head_weight = 10.0
head_length_m = 0.2
[solver]
integrator = "implicit-euler"
time_step_s = 2e-3
duration_s = 1.0
"#;

/// The scenes of a folder of this project: its TOML files but those that name a scene, which are sweeps and the like.
pub fn scene_files(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)).unwrap();
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.retain(|path| !std::fs::read_to_string(path).unwrap().lines().any(|line| line.starts_with("scene =")));
    files.sort();
    files
}

/// The scene of `text` with `overrides`.
pub fn scene_of(text: &str, overrides: &[&str]) -> Scene {
    document_of("test.toml", text, overrides).scene().unwrap_or_else(|error| panic!("{error}"))
}

/// The start of its run.
pub fn stepper_of(text: &str, overrides: &[&str]) -> Stepper {
    Stepper::of(&scene_of(text, overrides)).unwrap_or_else(|error| panic!("{error}"))
}

pub fn document_of(path: impl Into<PathBuf>, text: &str, changes: &[&str]) -> Document {
    let mut document = Document::new(path, text);
    for change in changes {
        document.set(change).unwrap();
    }
    document
}

/// The study's tail, passive, with `changes` of the form `table.key=value`.
pub fn scene(changes: &[&str]) -> Scene {
    document("test.toml", changes).scene().unwrap()
}

/// The same, its tables looked for beside `path`.
pub fn document(path: impl Into<PathBuf>, changes: &[&str]) -> Document {
    document_of(path, TAIL, changes)
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

/// The scene files of `models/` and `tests/reference/` but those of the finest meshes.
pub fn all_scene_files() -> Vec<PathBuf> {
    let files = ["models", "tests/reference"].into_iter().flat_map(scene_files);
    files.filter(|path| Scene::load(path).unwrap().rod.nodes.get() <= 2000).collect()
}

/// Runs `scene` to its end.
pub fn run(scene: &Scene) -> Stepper {
    run_with(scene, |_| {})
}

/// Runs `scene` to its end, with a look at every step.
pub fn run_with(scene: &Scene, mut look: impl FnMut(&mut Stepper)) -> Stepper {
    let mut stepper = Stepper::of(scene).unwrap();
    for span in scene.spans() {
        let mut steps = stepper.metrics().totals.steps;
        let whole = stepper.do_step_with(span, |stepper| {
            if stepper.metrics().totals.steps > std::mem::replace(&mut steps, stepper.metrics().totals.steps) {
                look(stepper);
            }
            ControlFlow::Continue(())
        });
        assert!(whole.unwrap());
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

/// The rest under forces that grow to `force` (N, two entries per node) in `parts` equal parts.
pub fn equilibrium(scene: &Scene, force: &[f64], parts: u32) -> (Dynamics, State) {
    let mut dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
    let mut newton = Newton::new(dynamics.nodes(), scene.newton_tolerance()).unwrap();
    let mut state = dynamics.first_state();
    for part in 1..=parts {
        dynamics.inputs.force = Some(force.iter().map(|f| f * f64::from(part) / f64::from(parts)).collect());
        newton.solve(&mut dynamics, &mut state, Direction { q: 1.0, v: 0.0, a: 0.0 }).unwrap();
    }
    (dynamics, state)
}

/// Numbers that look random: splitmix64.
pub struct Dice(pub u64);

impl Dice {
    /// Uniform between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// `count` of them.
    pub fn many(&mut self, count: usize, low: f64, high: f64) -> Vec<f64> {
        (0..count).map(|_| self.between(low, high)).collect()
    }

    /// A chain of `nodes` nodes: edges 0.6 to 1.5 times `spacing` long, turning by up to 2 rad at each node.
    pub fn chain(&mut self, nodes: usize, spacing: f64) -> Vec<f64> {
        let mut q = vec![self.between(-1.0, 1.0), self.between(-1.0, 1.0)];
        let mut angle = self.between(-3.0, 3.0);
        for _ in 1..nodes {
            let length = spacing * self.between(0.6, 1.5);
            let [x, y] = [q[q.len() - 2], q[q.len() - 1]];
            q.extend([x + length * angle.cos(), y + length * angle.sin()]);
            angle += self.between(-2.0, 2.0);
        }
        q
    }
}

/// Largest modulus.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, |max, x| if x.is_nan() { f64::NAN } else { f64::max(max, x.abs()) })
}

/// The step of a scene that gives one, s.
pub fn time_step(scene: &Scene) -> f64 {
    scene.solver.time_step_s.unwrap().get()
}

/// The folder of a study, claimed for it.
#[cfg(feature = "report")]
pub fn claimed(study: &caudal::study::Study, scene: &Scene, folder: &Path) -> std::sync::Mutex<caudal::report::Folder> {
    std::sync::Mutex::new(study.claim(scene, folder, caudal::report::Claim::Own).unwrap())
}
