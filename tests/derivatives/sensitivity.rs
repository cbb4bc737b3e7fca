//! Derivatives of a simulation are exact: forward and adjoint agree to rounding, and with differences of whole simulations.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use caudal::fluid::{DENSITY, VISCOSITY};
use caudal::integrator::METHODS;
use caudal::scene::Scene;
use caudal::sensitivity::{JointDirection, Output, Parameter, Problem, Sensitivities};
use caudal::variable::VARIABLES;
use common::{SOFT, largest, scene_of};

/// Every kind of head, each with loads, flow and a last step that is shorter.
const HEADS: [&str; 4] = [
    r#"head={ kind = "free" }"#,
    r#"head={ kind = "clamped" }"#,
    r#"head={ kind = "driven", position_m = { amplitude = [0.01, 0.05], frequency_hz = 1.0 }, angle_rad = { amplitude = 0.4, frequency_hz = 1.5, phase_rad = 0.3 } }"#,
    r#"head={ kind = "hinged", inertia_kg_m2 = 2e-3, stiffness_n_m = 0.5, damping_n_m_s = 0.02, largest_torque_n_m = 0.6, angle_rad = { amplitude = 0.4, frequency_hz = 1.5 } }"#,
];

/// A damped material, from a start in motion.
const DAMPED: &str = "rod.damping_time_s=0.02";
const ELASTICALLY_DAMPED: &str = "rod.damping_time_s=0.02 and rod.damping_of=elastic";

/// A thrust at the tip that turns with it.
const FOLLOWED: &str = "loads={ point = [{ node = -1, follows = true, force_n = [-1.0, 0.4] }, { node = 0, follows = true, force_n = [0.3, 0.2] }] }";

/// Names of the methods that have derivatives.
fn methods() -> impl Iterator<Item = &'static str> {
    METHODS
        .iter()
        .filter(|method| (method.build)(&method.defaults()).rule(1.0).is_some() && method.implicit)
        .map(|m| m.name)
}

fn scene(head: &str, method: &str, start: &str) -> Scene {
    let method = format!("solver.integrator={method}");
    let mut changes = vec![
        head,
        &method,
        "loads={ gravity_m_s2 = [0.1, -0.3], buoyancy = true }",
        "medium.flow_m_s=[0.05, 0.02]",
        "solver.newton_tolerance=1e-14",
        "solver.duration_s=0.245",
        "solver.time_step_s=0.01",
    ];
    changes.extend(start.split(" and "));
    scene_of(SOFT, &changes)
}

/// All outputs that trajectory.csv has, but time, with their units.
fn outputs_with_units(problem: &Problem) -> impl Iterator<Item = (Output, &'static str)> {
    let recorded = VARIABLES.iter().filter(|v| v.recorded && v.name != "time_s" && v.exists_in(problem.model()));
    recorded.map(|own| (Output::named(own.name, problem.model()).unwrap(), own.unit))
}

fn outputs(problem: &Problem) -> Vec<Output> {
    outputs_with_units(problem).map(|(output, _)| output).collect()
}

/// Those that have forward derivatives: beside a hinge, work has none.
fn forward_outputs(problem: &Problem) -> (Vec<Output>, Vec<&'static str>) {
    let hinged = problem.model().hinge.is_some();
    outputs_with_units(problem).filter(|(output, _)| !hinged || output.work.is_empty()).unzip()
}

/// Every parameter that can be set, with its size.
fn parameters(problem: &Problem) -> Vec<(Parameter, f64)> {
    let joints = problem.model().rod.joints();
    let stiffness = joints.clone().zip(problem.stiffness()).map(|(k, ei)| (Parameter::Stiffness(k), ei));
    let natural = joints.map(|k| (Parameter::NaturalCurvature(k), 4.0));
    let scalars = [
        (Parameter::Amplitude, 4.0),
        (Parameter::Frequency, 1.5),
        (Parameter::Phase, 1.0),
        (Parameter::OfForces(VISCOSITY), 5.0),
        (Parameter::OfForces(DENSITY), 1260.0),
    ];
    stiffness.chain(natural).chain(scalars).collect()
}

/// The problem with a parameter moved by `by`.
fn moved(scene: &Scene, parameter: Parameter, by: f64) -> Problem {
    let mut problem = Problem::of(scene).unwrap();
    let (nodes, first) = (problem.model().rod.nodes, problem.model().rod.first_joint);
    let inputs = problem.inputs();
    match parameter {
        Parameter::Stiffness(k) => {
            let mut stiffness = problem.stiffness();
            stiffness[k - first] += by;
            problem.set_stiffness(&stiffness).unwrap();
        }
        Parameter::NaturalCurvature(k) => inputs.natural.get_or_insert_with(|| vec![0.0; nodes])[k] += by,
        Parameter::Amplitude => inputs.drive.amplitude += by,
        Parameter::Frequency => inputs.drive.frequency += by,
        Parameter::Phase => inputs.phase_offset += by,
        Parameter::OfForces(VISCOSITY) => inputs.fluid.viscosity += by,
        Parameter::OfForces(DENSITY) => inputs.fluid.density += by,
        other => panic!("{other:?} cannot be moved"),
    }
    problem
}

/// Central differences of all values over 2`by` and 4`by`, extrapolated.
fn differences(scene: &Scene, outputs: &[Output], parameter: Parameter, by: f64) -> Vec<f64> {
    let values = |by: f64| moved(scene, parameter, by).forward(&[], outputs, 1, |_| {}).unwrap().values;
    let central = |by: f64| -> Vec<f64> {
        values(by).iter().zip(values(-by)).map(|(more, less)| (more - less) / (2.0 * by)).collect()
    };
    central(by).iter().zip(central(2.0 * by)).map(|(fine, coarse)| fine + (fine - coarse) / 3.0).collect()
}

fn derivative(found: &Sensitivities, n: usize, o: usize, j: usize) -> f64 {
    found.row(n, o)[j]
}

#[test]
fn forward_derivatives_are_those_of_differences() {
    let mut worst: f64 = 0.0;
    for head in HEADS {
        for method in methods() {
            let starts =
                ["start.kind=shaped", "start={ kind = \"ramp\", ramp_s = 0.1 }", DAMPED, ELASTICALLY_DAMPED, FOLLOWED];
            for start in starts {
                let scene = scene(head, method, start);
                let mut problem = Problem::of(&scene).unwrap();
                let ((outputs, _), all) = (forward_outputs(&problem), parameters(&problem));
                let kinds: Vec<Parameter> = all.iter().map(|p| p.0).collect();
                let found = problem.forward(&kinds, &outputs, 1, |_| {}).unwrap();
                // What an output changes by where each parameter changes by its size.
                let scale = |o: usize| {
                    largest((0..found.times.len()).flat_map(|n| found.row(n, o).iter().zip(&all).map(|(d, p)| d * p.1)))
                };
                let scales: Vec<f64> = (0..outputs.len()).map(scale).collect();
                for (j, (parameter, size)) in all.iter().enumerate() {
                    let expected = differences(&scene, &outputs, *parameter, 5e-4 * size);
                    for n in 0..found.times.len() {
                        for (o, scale) in scales.iter().enumerate() {
                            let error = (derivative(&found, n, o, j) - expected[n * outputs.len() + o]).abs() * size;
                            worst = worst.max(error / scale.max(f64::MIN_POSITIVE));
                            // Measured: 3.9e-9.
                            assert!(
                                error <= 1e-8 * scale,
                                "{head} {method} {start} {parameter:?} output {o} {:?} time {n}: {:e} against {:e}, scale {scale:e}",
                                outputs[o],
                                derivative(&found, n, o, j),
                                expected[n * outputs.len() + o]
                            );
                        }
                    }
                }
            }
        }
    }
    println!("worst {worst:.1e}");
}

/// Parameters that act along the whole rod, joint by joint.
fn along_the_rod(problem: &Problem) -> Vec<Parameter> {
    let joints = || problem.model().rod.joints();
    let wave = joints().flat_map(|k| [Parameter::WaveAmplitude(k), Parameter::WavePhase(k)]);
    parameters(problem).into_iter().map(|(parameter, _)| parameter).chain(wave).collect()
}

/// The largest difference of the adjoint and the forward derivatives of a sum of an output over all times with random
/// weights. Each parameter counts by its size; what outputs of one unit change by at most is 1, as a centre of mass
/// that hardly moves is the rounding of positions that do.
fn adjoint_error(scene: &Scene, wanted: fn(&str) -> bool) -> f64 {
    let mut problem = Problem::of(scene).unwrap();
    let ((outputs, units), all) = (forward_outputs(&problem), parameters(&problem));
    let kinds = along_the_rod(&problem);
    let sizes: Vec<f64> = (0..kinds.len()).map(|j| all.get(j).map_or(1.0, |p| p.1)).collect();
    let found = problem.forward(&kinds, &outputs, 1, |_| {}).unwrap();
    let trajectory = problem.simulate().unwrap();
    let largest_term = |o: usize| {
        largest((0..found.times.len()).flat_map(|n| found.row(n, o).iter().zip(&sizes).map(|(d, size)| d * size)))
    };
    let mut dice = common::Dice(7);
    let mut of_output = |(o, output): (usize, &Output)| {
        let weights = dice.many(found.times.len(), -1.0, 1.0);
        let adjoint = problem.adjoint(&kinds, std::slice::from_ref(output), &weights, &trajectory).unwrap();
        let forward = |j: usize| (0..weights.len()).map(|n| weights[n] * found.row(n, o)[j]).sum::<f64>();
        let errors = adjoint.iter().enumerate().map(|(j, adjoint)| (adjoint - forward(j)) * sizes[j]);
        let like = (0..units.len()).filter(|other| units[*other] == units[o]);
        largest(errors) / largest(like.map(largest_term)).max(f64::MIN_POSITIVE)
    };
    largest(outputs.iter().enumerate().filter(|(o, _)| wanted(units[*o])).map(&mut of_output).collect::<Vec<_>>())
}

#[test]
fn adjoint_derivatives_are_the_forward_ones() {
    for head in HEADS {
        for method in methods() {
            for start in ["start.kind=shaped", "start.kind=jump", DAMPED, ELASTICALLY_DAMPED, FOLLOWED] {
                let error = adjoint_error(&scene(head, method, start), |_| true);
                println!("{} {method} {start}: {error:.1e}", &head[..20]);
                // Measured: 2.1e-14, and beside a servo 1.2e-13.
                let most = if head.contains("hinged") { 4e-13 } else { 1e-13 };
                assert!(error <= most, "{head} {method} {start}: {error:e}");
            }
        }
    }
}

/// What a change of Young's modulus by a few roundings does to the forward derivatives, as [`adjoint_error`] measures it.
/// The derivatives themselves change by 1e-15; what is more is how they are conditioned.
fn rounding(scene: &Scene, wanted: fn(&str) -> bool) -> f64 {
    let forward = |scene: &Scene| {
        let mut problem = Problem::of(scene).unwrap();
        let ((outputs, units), kinds) = (forward_outputs(&problem), along_the_rod(&problem));
        let all = parameters(&problem);
        let sizes: Vec<f64> = (0..kinds.len()).map(|j| all.get(j).map_or(1.0, |p| p.1)).collect();
        let found = problem.forward(&kinds, &outputs, 1, |_| {}).unwrap();
        let mut dice = common::Dice(7);
        let (mut sums, mut terms) = (Vec::new(), 0.0_f64);
        for o in (0..outputs.len()).filter(|o| wanted(units[*o])) {
            let weights = dice.many(found.times.len(), -1.0, 1.0);
            for (j, size) in sizes.iter().enumerate() {
                let term = |n: usize| found.row(n, o)[j] * size;
                terms = terms.max(largest((0..weights.len()).map(term)));
                sums.push((0..weights.len()).map(|n| weights[n] * term(n)).sum::<f64>());
            }
        }
        (sums, terms)
    };
    let (sums, terms) = forward(scene);
    let noise = |steps: i32| {
        let moved = scene.with_modulus(1.0 + f64::from(steps) * f64::EPSILON);
        largest(sums.iter().zip(forward(&moved).0).map(|(a, b)| a - b)) / terms
    };
    largest([-3, -2, 2, 3].map(noise))
}

/// The study's aluminium tail. One rounding of a displacement of 0.1 m is 1e-9 N along an edge (EA/ΔL = 8e7 N/m), or 2e-8 m/s²
/// of a node: that in 100 steps is what is left. Measured: 2.8e-11, 9.6e-11 and 3.5e-11, where rounding alone does 2.5e-10, 1.1e-10
/// and 6.2e-11 to the forward derivatives. The bounds are twice the largest of them.
#[test]
fn adjoint_derivatives_of_the_aluminium_tail_are_the_forward_ones() {
    for method in methods() {
        let changes = [
            &format!("solver.integrator={method}")[..],
            "solver.time_step_s=1e-3",
            "solver.duration_s=0.1",
            "solver.newton_tolerance=1e-12",
        ];
        let aluminium = scene_of(include_str!("../../models/baseline-smooth.toml"), &changes);
        let error = adjoint_error(&aluminium, |unit| unit == "m");
        let rounding = rounding(&aluminium, |unit| unit == "m");
        println!("{method}: {error:.1e}, rounding of the forward derivatives {rounding:.1e}");
        assert!(error <= 2e-10, "{method}: {error:e}");
        assert!(rounding <= 5e-10, "{method}: {rounding:e}");
    }
}

#[test]
fn a_change_along_the_whole_rod_is_the_sum_of_those_at_its_joints() {
    let scene = scene(HEADS[2], "generalized-alpha", "start.kind=shaped");
    let mut problem = Problem::of(&scene).unwrap();
    let outputs = outputs(&problem);
    let joints: Vec<usize> = problem.model().rod.joints().collect();
    let each = |of: fn(usize) -> Parameter| joints.iter().map(|k| of(*k)).collect::<Vec<_>>();
    for (whole, size, parts) in [
        (Parameter::Amplitude, problem.inputs().drive.amplitude, each(Parameter::WaveAmplitude)),
        (Parameter::Phase, 1.0, each(Parameter::WavePhase)),
    ] {
        let mut all = vec![whole];
        all.extend(parts);
        let found = problem.forward(&all, &outputs, 5, |_| {}).unwrap();
        let scale_of = |o: usize| largest((0..found.times.len()).flat_map(|n| found.row(n, o).to_vec()));
        for n in 0..found.times.len() {
            for (o, output) in outputs.iter().enumerate() {
                let (row, scale) = (found.row(n, o), scale_of(o));
                let sum: f64 = row[1..].iter().sum();
                assert!(
                    (sum - size * row[0]).abs() <= 1e-9 * scale,
                    "{whole:?} {n} {:?}: {sum:e} {:e} {scale:e}",
                    output,
                    row[0]
                );
            }
        }
    }
}

#[test]
fn values_are_those_of_the_run() {
    for head in HEADS {
        let scene = scene(head, "newmark", "start.kind=shaped");
        let mut problem = Problem::of(&scene).unwrap();
        let names: Vec<&str> = VARIABLES
            .iter()
            .filter(|v| v.recorded && v.name != "time_s" && v.exists_in(problem.model()))
            .map(|v| v.name)
            .collect();
        let outputs = outputs(&problem);
        let found = problem.forward(&[], &outputs, 1, |_| {}).unwrap();
        let mut n = 0;
        common::run_with(&scene, |stepper| {
            n += 1;
            for (o, name) in names.iter().enumerate() {
                let (value, expected) = (found.value(n, o), stepper.get_scalar(name).unwrap());
                let scale = largest((0..found.times.len()).map(|n| found.value(n, o)));
                assert!((value - expected).abs() <= 1e-9 * scale, "{head} {name} {n}: {value:e} {expected:e}");
            }
        });
        assert_eq!(n + 1, found.times.len());
    }
}

#[test]
fn scenes_without_derivatives_are_refused() {
    for (change, words) in [
        ("solver.tolerance=1e-4", "fixed steps"),
        ("solver.integrator=esdirk3", "one stage"),
        ("solver.form=chain", "positions"),
    ] {
        let mut changes = vec![change];
        changes.extend((change == "solver.tolerance=1e-4").then_some("solver.integrator=esdirk3"));
        let error = Problem::of(&scene_of(SOFT, &changes)).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert!(error.is_bad_input());
    }
}

#[test]
fn a_derivative_along_joints_is_the_weighted_sum_of_those_by_the_joints() {
    let mut worst: f64 = 0.0;
    let kinds: [fn(usize) -> Parameter; 4] =
        [Parameter::Stiffness, Parameter::NaturalCurvature, Parameter::WaveAmplitude, Parameter::WavePhase];
    for head in HEADS {
        for text in [SOFT.to_string(), common::soft_moments()] {
            let scene = scene_of(
                &text,
                &[head, "solver.integrator=newmark", "solver.time_step_s=0.01", "solver.duration_s=0.2"],
            );
            let mut problem = Problem::of(&scene).unwrap();
            let (outputs, _) = forward_outputs(&problem);
            let rod = &problem.model().rod;
            let joints = rod.joints();
            let mut dice = common::Dice(3);
            let weights = dice.many(joints.len() - 1, -1.0, 1.0);
            for kind in kinds {
                // Also where the first joint is half a one.
                let along = JointDirection::of(&problem.model().rod, kind, joints.start, &weights);
                problem.directions = [along].into();
                let of_joints: Vec<Parameter> = joints.clone().take(weights.len()).map(kind).collect();
                let each = problem.forward(&of_joints, &outputs, 1, |_| {}).unwrap();
                let sum = problem.forward(&[Parameter::Along(0)], &outputs, 1, |_| {}).unwrap();
                let trajectory = problem.simulate().unwrap();
                for (o, output) in outputs.iter().enumerate() {
                    let rows = (0..sum.times.len()).map(|n| (each.row(n, o), sum.row(n, o)[0]));
                    let errors: Vec<[f64; 2]> = rows
                        .map(|(row, along)| {
                            let parts = row.iter().zip(&weights).map(|(by, weight)| by * weight);
                            [parts.clone().sum::<f64>() - along, parts.map(f64::abs).sum()]
                        })
                        .collect();
                    let [error, scale] = [0, 1].map(|i| largest(errors.iter().map(|error| error[i])));
                    worst = worst.max(error / scale.max(f64::MIN_POSITIVE));
                    let mut last = vec![0.0; sum.times.len()];
                    last[sum.times.len() - 1] = 1.0;
                    let output = std::slice::from_ref(output);
                    let adjoint = problem.adjoint(&[Parameter::Along(0)], output, &last, &trajectory).unwrap()[0];
                    let forward = sum.row(sum.times.len() - 1, o)[0];
                    worst = worst.max((adjoint - forward).abs() / scale.max(f64::MIN_POSITIVE));
                }
            }
        }
    }
    println!("worst {worst:.1e}");
    assert!(worst < 1e-8);
}
