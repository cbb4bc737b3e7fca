//! A user's own actuation, of two harmonics: κ̄'' and derivatives come from it, not from the built-in wave's g'' = −g.

#![allow(clippy::unwrap_used, reason = "a failure ends the test")]

use crate::common;
use caudal::actuation::{Actuation, Wave};
use caudal::model::Model;
use caudal::scene::Scene;
use caudal::sensitivity::{Output, Parameter, Problem};
use common::{SOFT, scene_of};

/// κ̄_k = size_k (sin ψ + 0.3 sin 2ψ) with ψ = phase − b_k.
#[derive(Debug, Clone)]
struct TwoHarmonics {
    sizes: Vec<f64>,
    places: Vec<f64>,
}

impl TwoHarmonics {
    fn new(nodes: usize, phase: f64) -> Self {
        Self { sizes: vec![0.05; nodes], places: (0..nodes).map(|k| 0.7 * k as f64 + phase).collect() }
    }
}

impl Actuation for TwoHarmonics {
    fn add(&self, wave: Wave, natural: &mut [f64], rate: &mut [f64]) {
        let size = wave.amplitude * wave.gain;
        self.add_derivatives([size, 0.0, 0.0], wave.phase, natural);
        self.add_derivatives([wave.amplitude * wave.gain_rate, size * wave.phase_rate, 0.0], wave.phase, rate);
    }

    fn add_derivatives(&self, [value, first, second]: [f64; 3], phase: f64, out: &mut [f64]) {
        for ((out, size), place) in out.iter_mut().zip(&self.sizes).zip(&self.places) {
            let (sin, cos) = (phase - place).sin_cos();
            let (sin2, cos2) = (2.0 * (phase - place)).sin_cos();
            *out += size * (value * (sin + 0.3 * sin2) + first * (cos + 0.6 * cos2) - second * (sin + 1.2 * sin2));
        }
    }

    fn profiled(&self, factors: &[f64], phases: &[f64]) -> Box<dyn Actuation> {
        let sizes = self.sizes.iter().zip(factors).map(|(size, factor)| size * factor).collect();
        let places = self.places.iter().zip(phases).map(|(place, phase)| place + phase).collect();
        Box::new(Self { sizes, places })
    }
}

/// The scene with that amplitude and frequency, and its model with that phase.
fn problem([amplitude, frequency, phase]: [f64; 3], head: &str) -> (Scene, Model) {
    let scene = scene_of(
        SOFT,
        &[
            &format!("head.kind={head}"),
            &format!("actuation.kappa_amp={amplitude}"),
            &format!("actuation.frequency_hz={frequency}"),
            "start={ kind = \"ramp\", ramp_s = 0.2 }",
            "solver.duration_s=0.3",
            "solver.time_step_s=5e-3",
            "solver.newton_tolerance=1e-13",
        ],
    );
    let mut model = scene.model().unwrap();
    let nodes = model.rod.nodes;
    model.actuation.as_mut().unwrap().0 = Box::new(TwoHarmonics::new(nodes, phase));
    (scene, model)
}

#[test]
fn derivatives_by_the_drive_are_those_of_the_actuation_itself() {
    let parameters = [Parameter::Amplitude, Parameter::Frequency, Parameter::Phase];
    let values = [4.0, 1.5, 0.0];
    let names = ["tip_y_m", "actuation_power_w", "actuation_work_j", "bending_energy_j"];
    for head in ["free", "clamped"] {
        let run = |values: [f64; 3], parameters: &[Parameter]| {
            let (scene, model) = problem(values, head);
            let mut problem = Problem::of_model(&scene, model).unwrap();
            let outputs: Vec<Output> = names.iter().map(|name| Output::named(name, problem.model()).unwrap()).collect();
            let forward = problem.forward(parameters, &outputs, 1_000_000, |_| {}).unwrap();
            let trajectory = problem.simulate().unwrap();
            let adjoints: Vec<_> = (0..outputs.len())
                .map(|o| {
                    let mut weights = vec![0.0; outputs.len() * trajectory.times.len()];
                    let end = weights.len() - outputs.len();
                    weights[end + o] = 1.0;
                    problem.adjoint(parameters, &outputs, &weights, &trajectory).unwrap()
                })
                .collect();
            (forward, adjoints)
        };
        let (base, adjoints) = run(values, &parameters);
        let last = base.times.len() - 1;
        for (o, name) in names.iter().enumerate() {
            for p in 0..parameters.len() {
                let at = |by: f64| {
                    let mut moved = values;
                    moved[p] += by;
                    run(moved, &[]).0.value(last, o)
                };
                let central = |h: f64| (at(h) - at(-h)) / (2.0 * h);
                let found = (4.0 * central(5e-4) - central(1e-3)) / 3.0;
                let exact = base.row(last, o)[p];
                let scale = exact.abs().max(1e-3 * base.value(last, o).abs());
                let [off, apart] = [exact - found, exact - adjoints[o][p]].map(|x| x.abs() / scale);
                println!("{head} {name} {p}: {exact:.6e} {off:.1e} {apart:.1e}");
                assert!(off < 1e-7, "{head} {name} {p}: {exact:e} {found:e}");
                assert!(apart < 1e-10, "{head} {name} {p}: {exact:e} {:e}", adjoints[o][p]);
            }
        }
    }
}
