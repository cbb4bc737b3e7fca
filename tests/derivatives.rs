//! Derivatives of every output by every input and by time are those that differences show.

mod common;

use caudal::stepper::Stepper;
use caudal::variable::{Causality, Variable};
use common::{Dice, SOFT, stepper_of};

/// Scenes of every kind of part, in motion under inputs of a host.
fn scenes() -> Vec<(&'static str, Stepper)> {
    let driven = ["head.kind=driven", "head.position_m={amplitude=[0.0,0.02],frequency_hz=1.0}", "head.angle_rad=0.1"];
    let kinds: [(&str, &[&str]); 5] = [
        ("free", &["medium.flow_m_s=[0.05,0.02]"]),
        ("ramp", &["start.kind=ramp", "start.ramp_s=0.1", "loads.gravity_m_s2=[0.0,-1.0]"]),
        ("clamped", &["head.kind=clamped", "loads.gravity_m_s2=[0.0,-1.0]"]),
        ("driven", &driven),
        ("chain", &["solver.form=chain", driven[0], driven[1], driven[2]]),
    ];
    kinds
        .map(|(name, changes)| {
            let mut stepper = stepper_of(SOFT, &[changes, &["solver.integrator=newmark", "rod.nodes=7"]].concat());
            let mut dice = Dice(5);
            for _ in 0..20 {
                stepper.do_step(2e-3).unwrap();
            }
            for (name, size) in [("natural_curvature_1_m", 0.5), ("force_x_n", 0.2), ("force_y_n", 0.2)] {
                let len = stepper.get(name).unwrap().len();
                stepper.set(name, &dice.many(len, -size, size)).unwrap();
            }
            stepper.do_step(4e-3).unwrap();
            (name, stepper)
        })
        .into()
}

fn outputs(stepper: &Stepper) -> Vec<&'static Variable> {
    stepper.variables().iter().copied().filter(|variable| variable.causality == Causality::Output).collect()
}

/// Every entry of every output.
fn read(stepper: &Stepper) -> Vec<f64> {
    outputs(stepper).iter().flat_map(|variable| stepper.get(variable.name).unwrap()).collect()
}

fn names(stepper: &Stepper) -> Vec<String> {
    let entries = |variable: &&Variable| {
        variable.entries(stepper.model()).map(|k| format!("{}[{k}]", variable.name)).collect::<Vec<_>>()
    };
    outputs(stepper).iter().flat_map(entries).collect()
}

#[test]
fn the_change_by_every_input_is_what_setting_it_shows() {
    for (scene, mut stepper) in scenes() {
        let (names, before) = (names(&stepper), stepper.save());
        for input in stepper.variables().to_vec().into_iter().filter(|v| v.causality == Causality::Input) {
            let now = stepper.get(input.name).unwrap();
            for entry in 0..now.len() {
                let mut seed = vec![0.0; now.len()];
                seed[entry] = 1.0;
                let outputs = outputs(&stepper);
                let model = std::sync::Arc::new(stepper.model().rod.clone());
                let change = stepper.directional(|inputs| inputs.set(input, &seed)).unwrap();
                let exact: Vec<f64> = outputs
                    .iter()
                    .flat_map(|v| {
                        match v.size {
                            caudal::variable::Size::Scalar => 0..1,
                            caudal::variable::Size::Nodes => 0..model.nodes,
                            caudal::variable::Size::Joints => model.joints(),
                        }
                        .map(|k| change.of(v, k))
                        .collect::<Vec<_>>()
                    })
                    .collect();
                let step = 1e-4 * now[entry].abs().max(1.0);
                let mut at = |sign: f64| {
                    stepper.restore(&before).unwrap();
                    let mut moved = now.clone();
                    moved[entry] += sign * step;
                    stepper.set(input.name, &moved).unwrap();
                    read(&stepper)
                };
                let (more, less) = (at(1.0), at(-1.0));
                stepper.restore(&before).unwrap();
                let scale = common::largest(exact.iter().copied()).max(1e-3);
                for (i, name) in names.iter().enumerate() {
                    let difference = (more[i] - less[i]) / (2.0 * step);
                    let error = (difference - exact[i]).abs() / scale;
                    // Work at once is quadratic in a change, so its central difference is exact as well.
                    assert!(
                        error < 3e-8,
                        "{scene}: d{name}/d{}[{entry}]: {} against {difference}",
                        input.name,
                        exact[i]
                    );
                }
            }
        }
    }
}

#[test]
fn the_rate_of_every_output_is_what_small_steps_show() {
    for (scene, mut stepper) in scenes() {
        let names = names(&stepper);
        stepper.set("actuation_amplitude", &[3.5]).unwrap();
        stepper
            .set_derivative("natural_curvature_1_m", 1, &vec![2.0; stepper.get("natural_curvature_1_m").unwrap().len()])
            .unwrap();
        stepper.set_derivative("viscosity_pa_s", 1, &[3.0]).unwrap();
        stepper.set_derivative("force_y_n", 1, &[1.0; 7]).unwrap();
        stepper.do_step(2e-3).unwrap();
        let before = stepper.save();
        let outputs = outputs(&stepper);
        let rod = stepper.model().rod.clone();
        let rates = stepper.rates().unwrap();
        let exact: Vec<f64> = outputs
            .iter()
            .flat_map(|v| {
                match v.size {
                    caudal::variable::Size::Scalar => 0..1,
                    caudal::variable::Size::Nodes => 0..rod.nodes,
                    caudal::variable::Size::Joints => rod.joints(),
                }
                .map(|k| rates.of(v, k))
                .collect::<Vec<_>>()
            })
            .collect();
        let here = read(&stepper);
        let mut slope = |h: f64| -> Vec<f64> {
            stepper.restore(&before).unwrap();
            stepper.do_step(h).unwrap();
            read(&stepper).iter().zip(&here).map(|(y, x)| (y - x) / h).collect()
        };
        let h = 2e-5;
        let (coarse, fine) = (slope(h), slope(0.5 * h));
        for (i, name) in names.iter().enumerate() {
            if name.starts_with("steps") || name.starts_with("newton") {
                continue;
            }
            let difference = 2.0 * fine[i] - coarse[i];
            let error = (difference - exact[i]).abs() / (1e-3 + exact[i].abs());
            assert!(error < 2e-3, "{scene}: d{name}/dt: {} against {difference}: {error:e}", exact[i]);
        }
    }
}
