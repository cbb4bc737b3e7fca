//! Derivatives on fine, stiff meshes, where one solve in positions has few digits, against Richardson differences of runs.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use caudal::scene::Document;
use caudal::sensitivity::{LinearisationRequest, value_and_grad};
use caudal::stepper::{StateCoordinates, Stepper};

const AMPLITUDE: f64 = 4.8;

fn fine(nodes: usize, form: &str) -> Document {
    let mut document = Document::read("models/fine-1e3.toml".as_ref()).unwrap();
    let changes = [
        format!("rod.nodes={nodes}"),
        format!("solver.form={form}"),
        "solver.duration_s=0.25".to_string(),
        "solver.newton_tolerance=1e-13".to_string(),
    ];
    changes.iter().for_each(|change| document.set(change).unwrap());
    document
}

/// The derivatives of `outputs` after 0.25 s by the amplitude, of steps in the chain form, whose rounding does not grow with the mesh.
fn differences<const N: usize>(nodes: usize, outputs: [&str; N]) -> [f64; N] {
    let read = |amplitude: f64| {
        let mut document = fine(nodes, "chain");
        document.set(&format!("actuation.kappa_amp={amplitude:e}")).unwrap();
        let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
        stepper.do_step(0.25).unwrap();
        outputs.map(|name| stepper.get_scalar(name).unwrap())
    };
    let central = |part: f64| {
        let [more, less] = [part, -part].map(|part| read(AMPLITUDE * (1.0 + part)));
        std::array::from_fn(|i| (more[i] - less[i]) / (2.0 * AMPLITUDE * part))
    };
    let [coarse, middle, small]: [[f64; N]; 3] = [0.02, 0.01, 0.005].map(central);
    std::array::from_fn(|i| {
        let [rough, found] = [(4.0 * middle[i] - coarse[i]) / 3.0, (4.0 * small[i] - middle[i]) / 3.0];
        (16.0 * found - rough) / 15.0
    })
}

#[test]
fn gradients_on_fine_meshes_have_the_digits_of_coarse_ones() {
    let outputs = ["x_com_m", "tip_y_m"];
    let mut bad = Vec::new();
    // Measured: 1.2e-8 and 1.0e-10, 1.5e-7 and 8.6e-7, 3.4e-7 and 2.3e-7, 2.1e-6 and 3.8e-5. Without refinement 1.5e-5 and 5e-8, 1.9e-2 and
    // 1.4e-5, 1.2e-1 and 2.8e-4, and the wrong sign.
    for (nodes, allowed) in [(101, [1e-7, 1e-9]), (601, [1e-6, 3e-6]), (1001, [1e-6, 1e-6]), (4001, [1e-5, 1e-4])] {
        let expected = differences(nodes, outputs);
        for (i, output) in outputs.into_iter().enumerate() {
            let (_, found) = value_and_grad(&fine(nodes, "positions"), output, &["actuation.kappa_amp"]).unwrap();
            let found = found[0].values[0];
            let off = (found - expected[i]).abs() / expected[i].abs();
            println!("{nodes} nodes, {output}: {found:e} for {:e}, off by {off:.1e}", expected[i]);
            if off.is_nan() || off > allowed[i] {
                bad.push(format!("{nodes} nodes, {output}: off by {off:.1e}"));
            }
        }
    }
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn a_step_on_a_fine_mesh_is_linearised_with_the_digits_of_a_coarse_one() {
    let outputs = ["tip_y_m", "x_com_m", "tip_vy_m_s"];
    let mut bad = Vec::new();
    // Measured: 1.0e-7, 5.4e-6 and 2.3e-5.
    for (nodes, allowed) in [(101, 3e-7), (1001, 1e-5), (4001, 5e-5)] {
        for form in ["positions", "chain"] {
            let mut stepper = Stepper::of(&fine(nodes, form).scene().unwrap()).unwrap();
            stepper.do_step(0.1).unwrap();
            let from = stepper.save();
            let asked = LinearisationRequest {
                states: false,
                ..LinearisationRequest::new(StateCoordinates::Motion, &["actuation_amplitude"], &outputs)
            };
            let found = stepper.linearise_as(0.05, &asked).unwrap();
            let mut read = |by: f64| {
                stepper.restore(&from).unwrap();
                stepper.set("actuation_amplitude", &[AMPLITUDE * (1.0 + by)]).unwrap();
                stepper.do_step(0.05).unwrap();
                outputs.map(|name| stepper.get_scalar(name).unwrap())
            };
            let mut central = |part: f64| {
                let [more, less] = [part, -part].map(&mut read);
                [0, 1, 2].map(|i| (more[i] - less[i]) / (2.0 * AMPLITUDE * part))
            };
            let [coarse, small] = [0.02, 0.01].map(&mut central);
            for (i, output) in outputs.iter().enumerate() {
                let expected = (4.0 * small[i] - coarse[i]) / 3.0;
                let off = (found.d[i] - expected).abs() / expected.abs();
                println!("{nodes} nodes, {form}, {output}: {:e} for {expected:e}, off by {off:.1e}", found.d[i]);
                if off.is_nan() || off > allowed {
                    bad.push(format!("{nodes} nodes, {form}, {output}: {off:e}"));
                }
            }
        }
    }
    assert!(bad.is_empty(), "{bad:?}");
}

#[test]
fn gradients_of_damped_rods_with_and_without_a_head_are_refined_too() {
    for (model, viscosity, damping) in [("driven-head", 1.0, 0.0), ("driven-head", 1.0, 2e-3), ("fine-1e3", 1e-3, 2e-3)]
    {
        let document = |part: f64| {
            let mut document = Document::read(format!("models/{model}.toml").as_ref()).unwrap();
            let changes = [
                "rod.nodes=257".to_string(),
                format!("rod.damping_time_s={damping:e}"),
                format!("medium.viscosity_pa_s={:e}", viscosity * part),
                "solver.duration_s=0.1".to_string(),
                "solver.form=positions".to_string(),
                "solver.newton_tolerance=1e-13".to_string(),
            ];
            changes.iter().for_each(|change| document.set(change).unwrap());
            document
        };
        let read = |part: f64| {
            let mut stepper = Stepper::of(&document(part).scene().unwrap()).unwrap();
            stepper.do_step(0.1).unwrap();
            stepper.get_scalar("x_com_m").unwrap()
        };
        let central = |size: f64| (read(1.0 + size) - read(1.0 - size)) / (2.0 * size * viscosity);
        let expected = (4.0 * central(0.01) - central(0.02)) / 3.0;
        let (_, found) = value_and_grad(&document(1.0), "x_com_m", &["medium.viscosity_pa_s"]).unwrap();
        let off = (found[0].values[0] - expected).abs() / expected.abs();
        println!("{model}, damping {damping} s: {:e} for {expected:e}, off by {off:.1e}", found[0].values[0]);
        assert!(off < 1e-5, "{model}, damping {damping} s: off by {off:e}");
    }
}
