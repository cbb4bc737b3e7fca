//! Waves of natural curvature are the curves that they say, with their exact rates and derivatives.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::f64::consts::TAU;

use caudal::actuation::Wave;
use caudal::model::Model;
use caudal::scene::{Document, Scene};
use caudal::sensitivity::scene_parameter::SceneParameters;
use common::{SOFT, distance};

/// A soft tail of 41 nodes with that actuation and no other.
fn document(actuation: &str) -> Document {
    let (rod, rest) = SOFT.split_once("[actuation]").unwrap();
    let (_, rest) = rest.split_once("[medium]").unwrap();
    let (name, rod) = rod.split_once("[rod]").unwrap();
    let text = format!("{name}actuation = {{ {actuation}, frequency_hz = 2.0 }}\n[rod]{rod}[medium]{rest}");
    let mut document = Document::new("soft.toml", text);
    document.set("rod.nodes=41").unwrap();
    document
}

fn scene_with(actuation: &str) -> Scene {
    document(actuation).scene().unwrap()
}

fn model(actuation: &str) -> Model {
    scene_with(actuation).model().unwrap()
}

fn wave(phase: f64) -> Wave {
    Wave { amplitude: 1.0, gain: 1.0, gain_rate: 0.0, phase, phase_rate: TAU * 2.0 }
}

/// Natural curvature, 1/m, and its rate at each node.
fn natural(model: &Model, wave: Wave) -> [Vec<f64>; 2] {
    let nodes = model.rod.nodes;
    let [mut natural, mut rate] = [vec![0.0; nodes], vec![0.0; nodes]];
    model.actuation.as_ref().unwrap().0.add(wave, &mut natural, &mut rate);
    [natural, rate].map(|values| values.iter().map(|x| x / model.rod.spacing).collect())
}

/// Σ `sizes` times the derivatives by phase, 1/m.
fn derivatives(model: &Model, sizes: [f64; 3], phase: f64) -> Vec<f64> {
    let mut out = vec![0.0; model.rod.nodes];
    model.actuation.as_ref().unwrap().0.add_derivatives(sizes, phase, &mut out);
    out.iter().map(|x| x / model.rod.spacing).collect()
}

#[test]
fn the_curvature_of_a_sine_wave_is_that_of_a_sine_at_every_arc_length() {
    let wavelength = 0.37;
    for (slope, allowed) in [(0.01, 1e-13), (0.5, 1e-13), (1.208, 1e-13), (4.0, 1e-12)] {
        let model = model(&format!("kind = \"sine-wave\", slope = {slope}, wavelength_m = {wavelength}"));
        // Arc length of a sine of wavenumber 1 from X = 0, by Simpson's rule and one step of Richardson's extrapolation.
        let root = |x: f64| (1.0 + (slope * x.cos()).powi(2)).sqrt();
        let simpson = |x: f64, parts: i32| {
            let h = x / f64::from(parts);
            let inner = |i: i32| if i % 2 == 0 { 2.0 } else { 4.0 };
            let sum = root(0.0) + root(x) + (1..parts).map(|i| inner(i) * root(f64::from(i) * h)).sum::<f64>();
            sum * h / 3.0
        };
        let arc = |x: f64| (16.0 * simpson(x, 2000) - simpson(x, 1000)) / 15.0;
        let whole = arc(TAU);
        let k = whole / wavelength;
        let phase = 0.4;
        let [found, _] = natural(&model, wave(phase));
        let mut worst: f64 = 0.0;
        for (node, found) in found.iter().enumerate() {
            let behind = (phase / TAU - model.rod.xi(node) * model.rod.length / wavelength).rem_euclid(1.0);
            let [mut low, mut high] = [0.0, TAU];
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if arc(middle) < behind * whole { low = middle } else { high = middle }
            }
            // y = b sin(kx − ωt) at X = ωt − kx.
            let exact = slope * k * low.sin() / root(low).powi(3);
            worst = worst.max((found - exact).abs() / (slope * k));
        }
        println!("slope {slope}: {worst:.1e}"); // measured: 4e-15, 1e-14, 2e-14, 2e-13
        assert!(worst <= allowed, "{slope}: {worst:e}");
    }
}

#[test]
fn a_shallow_sine_wave_is_the_travelling_wave() {
    let (slope, wavelength) = (1e-5, 0.37);
    let sine = model(&format!("kind = \"sine-wave\", slope = {slope:e}, wavelength_m = {wavelength}"));
    let size = slope * TAU / wavelength;
    let travelling = model(&format!("kind = \"travelling-wave\", kappa_amp = {size:e}, wavelength_m = {wavelength}"));
    let [own, other] = [&sine, &travelling]
        .map(|model| natural(model, Wave { amplitude: model.actuation.as_ref().unwrap().1.amplitude, ..wave(0.3) }));
    assert!(distance(&own[0], &other[0]) <= 1e-9 * size && distance(&own[1], &other[1]) <= 1e-9 * size * TAU * 2.0);
}

#[test]
fn rates_and_derivatives_by_phase_are_those_of_the_curvature() {
    for (kind, allowed) in [
        ("kind = \"sine-wave\", slope = 1.208, wavelength_m = 0.37, envelope = [0.2, 0.8]", 1e-8),
        ("kind = \"travelling-wave\", kappa_amp = 3.0, wavelength_m = 0.37, harmonics = [0.3, -0.2, 0.1]", 1e-8),
        ("kind = \"standing-wave\", kappa_amp = 3.0, harmonics = [0.0, -0.2]", 1e-8),
    ] {
        for profiled in [false, true] {
            let mut model = model(kind);
            if profiled {
                let (nodes, own) = (model.rod.nodes, model.actuation.take().unwrap());
                let factors: Vec<f64> = (0..nodes).map(|k| 1.0 + 0.02 * k as f64).collect();
                let phases: Vec<f64> = (0..nodes).map(|k| 0.1 * k as f64).collect();
                model.actuation = Some((own.0.profiled(&factors, &phases), own.1));
                // A profile is what it says: another size at another phase.
                let [turned, _] = natural(&model, wave(0.7));
                for k in [0, 7, nodes - 1] {
                    let mut alone = vec![0.0; nodes];
                    own.0.add_derivatives([1.0, 0.0, 0.0], 0.7 - phases[k], &mut alone);
                    let exact = factors[k] * alone[k] / model.rod.spacing;
                    assert!((turned[k] - exact).abs() <= 1e-12 * exact.abs().max(1.0), "{kind} {k}");
                }
            }
            let h = 1e-4;
            let at = |phase: f64| natural(&model, wave(phase))[0].clone();
            let [before, own, after] = [0.7 - h, 0.7, 0.7 + h].map(at);
            let central: Vec<f64> = after.iter().zip(&before).map(|(a, b)| (a - b) / (2.0 * h)).collect();
            let slope = derivatives(&model, [0.0, 1.0, 0.0], 0.7);
            let [slopes_before, slopes_after] =
                [0.7 - h, 0.7 + h].map(|phase| derivatives(&model, [0.0, 1.0, 0.0], phase));
            let second: Vec<f64> = slopes_after.iter().zip(&slopes_before).map(|(a, b)| (a - b) / (2.0 * h)).collect();
            let size = common::largest(own.iter().copied());
            let scale = 1e3 * size; // of third derivatives
            assert!(distance(&derivatives(&model, [1.0, 0.0, 0.0], 0.7), &own) <= 1e-13 * size, "{kind}");
            assert!(distance(&slope, &central) <= allowed * scale, "{kind}: {:e}", distance(&slope, &central) / scale);
            let found = derivatives(&model, [0.0, 0.0, 1.0], 0.7);
            assert!(
                distance(&found, &second) <= allowed * 10.0 * scale,
                "{kind}: {:e}",
                distance(&found, &second) / scale
            );
            let [_, rate] = natural(&model, wave(0.7));
            let exact: Vec<f64> = slope.iter().map(|slope| slope * TAU * 2.0).collect();
            assert!(distance(&rate, &exact) <= 1e-12 * common::largest(exact.iter().copied()), "{kind}");
        }
    }
}

#[test]
fn harmonics_are_sines_of_their_multiples_of_the_phase() {
    let model = model("kind = \"travelling-wave\", kappa_amp = 3.0, wavelength_m = 0.5, harmonics = [0.25, -0.5]");
    let [found, _] = natural(&model, Wave { amplitude: 3.0, ..wave(0.9) });
    for (k, found) in found.iter().enumerate() {
        let psi = 0.9 - 2.0 * TAU * model.rod.xi(k) * model.rod.length;
        let exact = 3.0 * (psi.sin() + 0.25 * (2.0 * psi).sin() - 0.5 * (3.0 * psi).sin());
        assert!((found - exact).abs() <= 1e-12, "{k}: {found} {exact}");
    }
}

#[test]
fn every_number_of_a_wave_is_one_of_the_scene_and_goes_through_overrides() {
    for (kind, keys) in [
        (
            "kind = \"sine-wave\", slope = 1.208, wavelength_m = 0.37",
            &["actuation.slope", "actuation.wavelength_m"][..],
        ),
        (
            "kind = \"travelling-wave\", kappa_amp = 3.0, wavelength_m = 0.37, harmonics = [0.3, -0.2, 0.1]",
            &["actuation.harmonics[0]", "actuation.harmonics[2]"],
        ),
    ] {
        let scene = scene_with(kind);
        let parameters = scene.parameters();
        let names: Vec<String> = parameters.iter().map(caudal::scene::parameter::ScalarParameter::name).collect();
        let model = scene.model().unwrap();
        let numbers = SceneParameters::of(&scene, &model);
        for key in keys {
            assert!(names.contains(&(*key).to_string()), "{key}: {names:?}");
            assert!(!numbers.of_key(key.split('[').next().unwrap()).is_empty(), "{key}");
        }
        let values: Vec<f64> =
            parameters.iter().map(|p| if keys.contains(&&*p.name()) { 1.1 * p.value } else { p.value }).collect();
        let overrides = caudal::scene::parameter::overrides(&parameters, &values);
        let mut document = document(kind);
        overrides.iter().for_each(|change| document.set(change).unwrap());
        let moved: Scene = document.scene().unwrap();
        let found: Vec<f64> = moved.parameters().iter().map(|p| p.value).collect();
        assert!(distance(&found, &values) <= 1e-12, "{overrides:?}");
    }
}

#[test]
fn keys_of_one_wave_are_refused_with_another() {
    for (kind, words) in [
        ("kind = \"sine-wave\", slope = 5.0, wavelength_m = 0.3", "at most 4"),
        ("kind = \"sine-wave\", wavelength_m = 0.3", "actuation.slope"),
        ("kind = \"sine-wave\", slope = 0.5, wavelength_m = 0.3, kappa_amp = 2.0", "actuation.kappa_amp"),
        ("kind = \"sine-wave\", slope = 0.5, wavelength_m = 0.3, harmonics = [0.2]", "actuation.harmonics"),
        ("kind = \"travelling-wave\", wavelength_m = 0.3", "actuation.kappa_amp"),
        ("kind = \"travelling-wave\", kappa_amp = 1.0, slope = 0.5, wavelength_m = 0.3", "actuation.slope"),
    ] {
        let error = document(kind).scene().err().unwrap_or_else(|| panic!("{kind}"));
        assert!(error.is_bad_input() && error.to_string().contains(words), "{kind}: {error}");
    }
}
