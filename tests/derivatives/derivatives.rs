//! Derivatives of every output by every input and by time are those that differences show, and outputs follow at once
//! just the inputs that the table of variables says.

use crate::common;
use caudal::stepper::Stepper;
use caudal::stepper::derivatives::VariableDerivatives;
use caudal::variable::{Causality, VARIABLES, Variable};
use common::{Dice, SOFT, soft_moments, stepper_of};

const NODES: usize = 7;

/// Scenes of every kind of part, in motion under inputs of a host.
fn scenes() -> Vec<(&'static str, Stepper)> {
    let driven = ["head.kind=driven", "head.position_m={amplitude=[0.0,0.02],frequency_hz=1.0}", "head.angle_rad=0.1"];
    let gravity = "loads.gravity_m_s2=[0.0,-1.0]";
    let damped = "rod.damping_time_s={stretch=1e-4,bending=0.01}";
    let turning = "head.angle_rad={amplitude=0.3,frequency_hz=1.0}";
    let hinge = [
        "head={kind=\"hinged\",inertia_kg_m2=1e-3,stiffness_n_m=0.3,damping_n_m_s=1e-3,angle_rad={amplitude=0.3,frequency_hz=1.0}}",
        "head.torque_n_m={amplitude=0.2,frequency_hz=2.0}",
        "head.position_m={amplitude=[0.0,0.02],frequency_hz=1.0}",
    ];
    let winches = "tendons=[{offset_m=0.01,stiffness_n_m=200.0,length_m=0.9},{offset_m=-0.02,stiffness_n_m=100.0,length_m={offset=0.8,amplitude=0.01,frequency_hz=1.0}}]";
    let kinds: [(&str, &[&str]); 26] = [
        ("free", &["medium.flow_m_s=[0.05,0.02]"]),
        ("ramp", &["start.kind=ramp", "start.ramp_s=0.1", gravity]),
        ("clamped", &["head.kind=clamped", gravity]),
        ("driven", &driven),
        ("swimming in water", &["reactive={}", "medium.flow_m_s=[0.05,0.02]"]),
        ("driven in water", &["reactive={}", driven[0], driven[1], turning]),
        (
            "driven in water, in chain",
            &["reactive={}", "solver.form=chain", "solver.newton_tolerance=1e-13", driven[0], driven[1], turning],
        ),
        ("chain", &["solver.form=chain", driven[0], driven[1], driven[2]]),
        ("damped", &[damped, driven[0], driven[1], turning]),
        ("elastically damped", &[damped, "rod.damping_of=elastic", "head.kind=clamped"]),
        ("damped and free", &[damped, "rod.damping_of=elastic"]),
        ("moments", &[driven[0], driven[1], turning]),
        ("moments and chain", &["solver.form=chain", "head.kind=clamped"]),
        ("moments and damped", &[damped]),
        ("limited", &["actuation.largest_1_m=4.0", "head.kind=clamped", "start.kind=ramp", "start.ramp_s=0.1"]),
        ("limited and damped", &[damped, "rod.damping_of=elastic", "actuation.largest_1_m=4.0"]),
        ("lagging", &["actuation.lag_s=0.05", "start.kind=ramp", "start.ramp_s=0.1"]),
        (
            "lagging, limited and damped",
            &[damped, "rod.damping_of=elastic", "actuation.largest_1_m=4.0", "actuation.lag_s=0.05"],
        ),
        (
            "moments, lagging and limited",
            &["actuation.largest_moment_n_m=8.0", "actuation.lag_s=0.05", "head.kind=clamped"],
        ),
        ("winches", &[winches, "head.kind=clamped"]),
        ("winches and damped", &[winches, damped]),
        ("winches in chain", &[winches, "solver.form=chain", driven[0], driven[1], driven[2]]),
        ("moments and limited", &["actuation.largest_moment_n_m=8.0", driven[0], turning]),
        (
            "hinged",
            &[hinge[0], hinge[1], "head.largest_torque_n_m=1.0", hinge[2], "start.kind=ramp", "start.ramp_s=0.1"],
        ),
        ("hinged in chain", &["solver.form=chain", hinge[0], hinge[1]]),
        ("hinged and damped", &[damped, hinge[0], hinge[2]]),
    ];
    let prepare = |(name, changes): (&'static str, &[&str])| {
        let nodes = format!("rod.nodes={NODES}");
        let text = if name.starts_with("moments") { soft_moments() } else { SOFT.to_string() };
        let mut stepper = stepper_of(&text, &[changes, &["solver.integrator=newmark", &nodes]].concat());
        let mut dice = Dice(5);
        for _ in 0..20 {
            stepper.do_step(2e-3).unwrap();
        }
        for (name, size) in [("natural_curvature_1_m", 0.5), ("force_x_n", 0.2), ("force_y_n", 0.2)] {
            let len = stepper.get(name).unwrap().len();
            stepper.set(name, &dice.many(len, -size, size)).unwrap();
        }
        // Beside the wave of the last of them alone: others have none yet.
        if name == "moments and damped" {
            let len = stepper.get("active_moment_n_m").unwrap().len();
            stepper.set("active_moment_n_m", &dice.many(len, -2.0, 2.0)).unwrap();
        }
        stepper.do_step(4e-3).unwrap();
        (name, stepper)
    };
    kinds.map(prepare).into()
}

/// Every entry of every output: the variable and its node.
fn entries(stepper: &Stepper) -> Vec<(&'static Variable, usize)> {
    let outputs = stepper.variables().iter().copied().filter(|variable| variable.causality == Causality::Output);
    outputs.flat_map(|variable| variable.entries(stepper.model()).map(move |k| (variable, k))).collect()
}

fn read(stepper: &Stepper) -> Vec<f64> {
    entries(stepper).iter().map(|(variable, k)| variable.at(&stepper.view(), *k).unwrap()).collect()
}

fn all(entries: &[(&Variable, usize)], change: &VariableDerivatives<'_>) -> Vec<f64> {
    entries.iter().map(|(variable, k)| change.of(variable, *k).unwrap()).collect()
}

#[test]
fn the_change_by_every_input_is_what_setting_it_shows() {
    let mut worst: f64 = 0.0;
    for (scene, mut stepper) in scenes() {
        let (entries, before) = (entries(&stepper), stepper.save());
        for input in stepper.variables().to_vec().into_iter().filter(|variable| variable.is_input()) {
            let now = stepper.get(input.name).unwrap();
            for entry in 0..now.len() {
                let mut seed = vec![0.0; now.len()];
                seed[entry] = 1.0;
                let exact = all(&entries, &stepper.directional(|inputs| inputs.set(input, &seed)).unwrap());
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
                for (i, (output, k)) in entries.iter().enumerate() {
                    let difference = (more[i] - less[i]) / (2.0 * step);
                    // Less what the rounding of the reading itself leaves, where nothing follows.
                    let rounding = 1e-13 * more[i].abs() / step;
                    let error = ((difference - exact[i]).abs() - rounding).max(0.0) / scale;
                    worst = worst.max(error);
                    // Measured: 7.3e-9 at most, by the differences of the phase and of large energies.
                    assert!(
                        error < 3e-8,
                        "{scene}: d{}[{k}]/d{}[{entry}]: {} against {difference}",
                        output.name,
                        input.name,
                        exact[i]
                    );
                }
            }
        }
    }
    println!("worst {worst:e}");
}

#[test]
fn outputs_follow_at_once_just_the_inputs_that_the_table_says() {
    let mut followed = 0;
    for (scene, mut stepper) in scenes() {
        // In general motion, where nothing is zero by chance.
        for (name, value) in [
            ("flow_x_m_s", 0.03),
            ("flow_y_m_s", 0.02),
            ("head_x_m", 0.01),
            ("head_y_m", 0.01),
            ("head_angle_rad", 0.02),
            ("head_vx_m_s", 0.04),
            ("head_vy_m_s", 0.05),
            ("head_spin_rad_s", 0.3),
        ] {
            if stepper.get(name).is_ok() {
                stepper.set(name, &[value]).unwrap();
            }
        }
        if scene.starts_with("moments") {
            // Only one that changes is given power.
            let joints = stepper.get("natural_curvature_1_m").unwrap().len();
            stepper.set_derivative("natural_curvature_1_m", 1, &vec![0.3; joints]).unwrap();
        }
        stepper.do_step(4e-2).unwrap();
        let entries = entries(&stepper);
        let form = stepper.form();
        for input in stepper.variables().to_vec().into_iter().filter(|variable| variable.is_input()) {
            let nodes = input.entries(stepper.model());
            for (i, node) in nodes.clone().enumerate() {
                let mut seed = vec![0.0; nodes.len()];
                seed[i] = 1.0;
                let exact = all(&entries, &stepper.directional(|inputs| inputs.set(input, &seed)).unwrap());
                let scale = common::largest(exact.iter().copied());
                for (change, (output, k)) in exact.iter().zip(&entries) {
                    // No cycle is over here; tests/stepping/dependencies.rs has some that are.
                    if output.name.starts_with("cycle_") {
                        continue;
                    }
                    let told = output.follows(*k, input, stepper.view().dynamics, form).contains(&node);
                    // The energies that an input moves from one account to another leave rounding in the balance.
                    let follows = change.abs() > 1e-13 * scale;
                    followed += usize::from(follows);
                    // What has the inertia of water may follow its viscosity, by a force of one's own.
                    let told = told && (follows || !scene.contains("water"));
                    assert_eq!(told, follows, "{scene}: d{}[{k}]/d{}[{node}] = {change}", output.name, input.name);
                }
            }
        }
    }
    assert!(followed > 200, "{followed}");
    let known = |name: &str| VARIABLES.iter().any(|variable| variable.name == name && variable.is_input());
    assert!(VARIABLES.iter().flat_map(|variable| variable.feedthrough).all(|feed| known(feed.input)));
}

#[test]
fn the_rate_of_every_output_is_what_small_steps_show() {
    let mut worst: f64 = 0.0;
    for (scene, mut stepper) in scenes() {
        let entries = entries(&stepper);
        let joints = stepper.get("natural_curvature_1_m").unwrap().len();
        if scene.starts_with("moments") {
            stepper.set("actuation_moment_n_m", &[5.0]).unwrap();
            stepper.set_derivative("active_moment_n_m", 1, &vec![3.0; joints]).unwrap();
        } else {
            stepper.set("actuation_amplitude", &[3.5]).unwrap();
        }
        stepper.set_derivative("natural_curvature_1_m", 1, &vec![2.0; joints]).unwrap();
        stepper.set_derivative("viscosity_pa_s", 1, &[3.0]).unwrap();
        stepper.set_derivative("force_y_n", 1, &[1.0; NODES]).unwrap();
        stepper.do_step(2e-3).unwrap();
        let (before, here) = (stepper.save(), read(&stepper));
        let exact = all(&entries, &stepper.rates().unwrap());
        let mut slope = |h: f64| -> Vec<f64> {
            stepper.restore(&before).unwrap();
            stepper.do_step(h).unwrap();
            read(&stepper).iter().zip(&here).map(|(y, x)| (y - x) / h).collect()
        };
        // Extrapolated to steps of no length, but for the counts, which have no rate.
        let slopes = [slope(4e-5), slope(2e-5), slope(1e-5)];
        for (i, (output, k)) in entries.iter().enumerate().filter(|(_, (output, _))| output.unit != "1") {
            let difference = (8.0 * slopes[2][i] - 6.0 * slopes[1][i] + slopes[0][i]) / 3.0;
            let error = (difference - exact[i]).abs() / (1e-3 + exact[i].abs());
            worst = worst.max(error);
            // Measured: 3.6e-6.
            assert!(error < 1e-5, "{scene}: d{}[{k}]/dt: {} against {difference}: {error:e}", output.name, exact[i]);
        }
    }
    println!("worst {worst:e}");
}

#[test]
fn the_rate_of_what_a_cheaper_model_takes_from_balance_is_what_small_steps_show() {
    let driven = ["head.kind=driven", "head.position_m={amplitude=[0.0,0.02],frequency_hz=1.0}", "head.angle_rad=0.1"];
    let materials: [&[&str]; 3] =
        [&[], &["rod.damping_time_s=0.05"], &["rod.damping_time_s=0.05", "rod.damping_of=elastic"]];
    let drives = [SOFT.to_string(), soft_moments()];
    let kinds = ["shape", "overdamped"].into_iter().flat_map(|model| [&[][..], &driven].map(|head| (model, head)));
    let cases = kinds.flat_map(|kind| materials.map(|material| (kind, material)));
    let cases = cases.flat_map(|case| drives.each_ref().map(|drive| (case, drive)));
    // Moments leave the natural curvature where it is.
    let cases = cases.filter(|((_, material), drive)| !(material.len() == 2 && drive.contains("moment_amp_n_m")));
    for (((model, head), material), drive) in cases {
        let nodes = format!("rod.nodes={NODES}");
        let named = format!("solver.model={model}");
        let mut stepper = stepper_of(drive, &[&[named.as_str(), &nodes][..], head, material].concat());
        let entries = entries(&stepper);
        stepper.do_step(0.05).unwrap();
        stepper.set_derivative("viscosity_pa_s", 1, &[3.0]).unwrap();
        stepper.set_derivative("force_y_n", 1, &[1.0; NODES]).unwrap();
        stepper.do_step(0.02).unwrap();
        let (before, here) = (stepper.save(), read(&stepper));
        let exact = all(&entries, &stepper.rates().unwrap());
        let mut slope = |h: f64| -> Vec<f64> {
            stepper.restore(&before).unwrap();
            stepper.do_step(h).unwrap();
            read(&stepper).iter().zip(&here).map(|(y, x)| (y - x) / h).collect()
        };
        // Without inertia the fastest motion decays within a millisecond: extrapolated twice.
        let h = if model == "overdamped" { 4e-6 } else { 1e-5 };
        let slopes = [slope(4.0 * h), slope(2.0 * h), slope(h)];
        let mut moments = 0;
        for (i, (output, k)) in entries.iter().enumerate().filter(|(_, (output, _))| output.unit != "1") {
            let difference = (8.0 * slopes[2][i] - 6.0 * slopes[1][i] + slopes[0][i]) / 3.0;
            let error = (difference - exact[i]).abs() / (1e-3 + exact[i].abs());
            moments += usize::from(output.name == "joint_moment_n_m" && difference.abs() > 1e-3);
            let what = || format!("{model} {head:?} {material:?}: d{}[{k}]/dt", output.name);
            assert!(error < 5e-4, "{}: {} against {difference}: {error:e}", what(), exact[i]);
        }
        assert!(moments >= NODES - 3, "{moments}");
    }
}

#[test]
fn an_input_with_derivatives_goes_on_as_its_polynomial_and_the_balance_of_energy_closes() {
    // A force that grows from nothing by its derivatives, against one that a host sets every short step.
    let at = |h: f64| {
        let mut told = stepper_of(SOFT, &["solver.integrator=newmark", &format!("solver.time_step_s={h}")]);
        let shape: Vec<f64> = (0..9).map(|k| 0.1 * f64::from(k)).collect();
        told.set_derivative("force_y_n", 1, &shape).unwrap();
        told.set_derivative("force_y_n", 2, &shape).unwrap();
        told.set_derivative("actuation_frequency_hz", 1, &[2.0]).unwrap();
        told.set_derivative("natural_curvature_1_m", 3, &[4.0; 7]).unwrap();
        told.do_step(0.25).unwrap();
        told.do_step(0.25).unwrap();
        let force = told.get("force_y_n").unwrap();
        assert!(force.iter().zip(&shape).all(|(f, s)| (f - s * (0.5 + 0.125)).abs() < 1e-14));
        assert!((told.get_scalar("actuation_frequency_hz").unwrap() - 2.5).abs() < 1e-14);
        let natural = told.get("natural_curvature_1_m").unwrap();
        assert!(natural.iter().all(|x| (x - 4.0 * 0.125 / 6.0).abs() < 1e-14), "{natural:?}");
        (told.get_scalar("numerical_dissipation_j").unwrap(), told.get_scalar("tip_y_m").unwrap())
    };
    let ((coarse, _), (fine, tip)) = (at(1e-3), at(5e-4));
    // Second order: the work of what goes on by itself is counted as accurately as the rest.
    let order = common::order(coarse, fine);
    assert!((1.8..2.2).contains(&order), "{coarse:e} {fine:e}: {order}");
    // Against a host that steers in stairs: of first order in their length.
    let stairs = |h: f64| {
        let mut steered = stepper_of(SOFT, &["solver.integrator=newmark", &format!("solver.time_step_s={h}")]);
        for step in 0..(0.5 / h).round() as u32 {
            let t = h * f64::from(step + 1);
            let force: Vec<f64> = (0..9).map(|k| 0.1 * f64::from(k) * (t + 0.5 * t * t)).collect();
            steered.set("force_y_n", &force).unwrap();
            steered.set("natural_curvature_1_m", &[4.0 * t.powi(3) / 6.0; 7]).unwrap();
            // The phase that a rising frequency adds: 2π·2·t²/2.
            steered.set("actuation_phase_rad", &[-std::f64::consts::TAU * t * t]).unwrap();
            steered.do_step(h).unwrap();
        }
        steered.get_scalar("tip_y_m").unwrap() - tip
    };
    let order = common::order(stairs(5e-4), stairs(2.5e-4));
    assert!((0.9..1.1).contains(&order), "{order}");
    // A new value ends it.
    let mut ended = stepper_of(SOFT, &[]);
    ended.set_derivative("viscosity_pa_s", 1, &[1.0]).unwrap();
    ended.do_step(0.1).unwrap();
    assert!((ended.get_scalar("viscosity_pa_s").unwrap() - 5.1).abs() < 1e-14);
    ended.set("viscosity_pa_s", &[4.0]).unwrap();
    ended.do_step(0.1).unwrap();
    assert_eq!(ended.get("viscosity_pa_s").unwrap(), [4.0]);
}
