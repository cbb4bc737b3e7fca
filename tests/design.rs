//! Inverse design: what made the data is found again, and what cannot be found is said so.

#![cfg(feature = "design")]
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

mod common;

use std::ops::ControlFlow;
use std::sync::Arc;

use caudal::design::{Identified, Markers, Table, Verdict, identify};
use caudal::model::Dynamics;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use common::Dice;

/// A silicone eel in a glycerol-like medium.
const EEL: &str = r#"
name = "eel"
[rod]
nodes = 17
length_m = 1.0
outer_radius_m = 0.012
inner_radius_m = 0.0
youngs_modulus_pa = 1e7
density_kg_m3 = 1100.0
stiffness_gradient = 1.0
[actuation]
kind = "travelling-wave"
kappa_amp = 4.0
frequency_hz = 1.0
wavelength_m = 1.0
envelope = [0.2, 0.8]
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1260.0
[drag]
ratio = 2.0
head_weight = 10.0
head_length_m = 0.0625
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-3
duration_s = 8.0
[design]
goal = "identify"
data = "markers.csv"
"#;

fn scene(text: &str, changes: &[&str]) -> Scene {
    let mut document = Document::new("design.toml", text);
    for change in changes {
        document.set(change).unwrap();
    }
    document.scene().unwrap_or_else(|error| panic!("{error}"))
}

/// Positions at 100 Hz, as the scene moves.
fn clean(scene: &Scene) -> Markers {
    let mut stepper = Stepper::of(scene).unwrap();
    let mut markers = Markers::default();
    let mut keep = |stepper: &Stepper| {
        markers.times.push(stepper.time());
        markers.positions.push(stepper.state().q.clone());
    };
    keep(&stepper);
    let mut count = 0;
    stepper
        .do_step_with(scene.solver.duration_s.get(), |stepper| {
            count += 1;
            if count % 10 == 0 {
                keep(stepper);
            }
            ControlFlow::Continue(())
        })
        .unwrap();
    markers
}

/// The same with normal noise of `sigma` (m): a sum of twelve uniform numbers.
fn noisy(markers: &Markers, sigma: f64, seed: u64) -> Markers {
    let mut dice = Dice(seed);
    let mut noisy = markers.clone();
    for x in noisy.positions.iter_mut().flatten() {
        *x += sigma * dice.many(12, -0.5, 0.5).iter().sum::<f64>();
    }
    noisy
}

fn found(scene: &Scene, markers: &Markers) -> Identified {
    let mut dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
    identify(&mut dynamics, markers, &Table::of(scene).unwrap()).unwrap_or_else(|error| panic!("{error}"))
}

/// Root of the mean squared relative error over the joints.
fn error(scene: &Scene, found: &Identified) -> f64 {
    let rod = common::rod(scene);
    let of = |joint: &caudal::design::identify::Joint| {
        let ei = rod.joint[joint.node] * rod.spacing * if joint.node == 0 { 0.5 } else { 1.0 };
        (joint.stiffness_n_m2 / ei - 1.0).powi(2)
    };
    (found.joints.iter().map(of).sum::<f64>() / found.joints.len() as f64).sqrt()
}

#[test]
fn stiffness_is_recovered_from_clean_and_noisy_markers() {
    for nodes in [9, 17, 33] {
        let scene = scene(EEL, &[&format!("rod.nodes={nodes}")]);
        let markers = clean(&scene);
        for sigma in [0.0, 1e-6, 1e-5, 1e-4, 1e-3] {
            let found = found(&scene, &noisy(&markers, sigma, 3));
            let predicted = (found.joints.iter().map(|j| (j.deviation_n_m2 / j.stiffness_n_m2).powi(2)).sum::<f64>()
                / found.joints.len() as f64)
                .sqrt();
            println!(
                "N {nodes} sigma {sigma:e}: rms {:.2e} predicted {predicted:.2e} noise found {:.2e} window {} misfit {:.2e} signal {:.1e} .. balances {:?}",
                error(&scene, &found),
                found.noise_m,
                found.window_samples,
                found.misfit,
                found.joints.iter().map(|j| j.signal_to_noise).fold(f64::INFINITY, f64::min),
                found.balances
            );
            println!(
                "   {}",
                found
                    .joints
                    .iter()
                    .map(|j| {
                        let rod = common::rod(&scene);
                        format!(
                            "{:.1e}/{:.1e}",
                            j.stiffness_n_m2 / rod.joint[j.node] / rod.spacing - 1.0,
                            j.deviation_n_m2 / j.stiffness_n_m2
                        )
                    })
                    .collect::<Vec<_>>()
                    .join(" ")
            );
        }
    }
}

#[test]
fn the_stiffness_of_aluminium_cannot_be_identified() {
    let scene = scene(
        EEL,
        &[
            "rod.youngs_modulus_pa=70e9",
            "rod.outer_radius_m=0.013",
            "rod.inner_radius_m=0.011",
            "rod.density_kg_m3=2700.0",
        ],
    );
    let found = found(&scene, &noisy(&clean(&scene), 1e-6, 5));
    println!("{:.2e} {:?}", error(&scene, &found), found.joints);
    assert!(found.joints.iter().all(|joint| joint.verdict == Verdict::Unobservable));
}
