//! What is told, got a second way: every reading from other readings of the same motion, and every column of a file from a stepper.

#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "a test may panic")]

use crate::common;
use std::collections::BTreeMap;

use caudal::scene::Scene;
use caudal::stepper::Stepper;
use caudal::variable::{VARIABLES, View};
use common::{SOFT, scene_of, soft_moments};

/// Readings by name, entry by entry, of every step.
type Motion = Vec<BTreeMap<&'static str, Vec<f64>>>;

const STEP: f64 = 1e-3;

/// Scenes that have, among them, every output; each with forces that push it about.
fn scenes() -> Vec<(&'static str, Scene)> {
    let model = |name: &str| std::fs::read_to_string(format!("models/{name}.toml")).unwrap();
    let fine = ["solver.integrator=esdirk3", "solver.time_step_s=1e-3", "solver.duration_s=3.0"];
    let water = SOFT.replace("ratio = 5.0\nhead_weight = 10.0\nhead_length_m = 0.2\n", "law = \"cross-flow\"\n");
    let soft = |more: &[&str]| scene_of(SOFT, &[&fine[..], more].concat());
    let wet = |more: &[&str]| scene_of(&water, &[&fine[..], more].concat());
    let driven = "head={ kind = \"driven\", position_m = [0.0, { amplitude = 0.05, frequency_hz = 1.5 }], angle_rad = { amplitude = 0.3, frequency_hz = 1.5, phase_rad = 1.0 } }";
    let stream = "medium.flow_m_s=[0.3, { amplitude = 0.1, frequency_hz = 1.5 }]";
    let gravity = "loads={ gravity_m_s2 = [0.3, -0.2] }";
    let body = "head_body={ semi_axis_along_m = 0.1, semi_axis_across_m = 0.09, mass_kg = 5.0 }";
    vec![
        ("free", soft(&[stream, gravity])),
        ("headed", soft(&[body, gravity])),
        ("clamped", soft(&["head={ kind = \"clamped\" }", stream, gravity])),
        ("driven in water", wet(&[driven, stream, gravity, "medium.viscosity_pa_s=0.01", "reactive.shedding=0.7"])),
        ("moments", scene_of(&soft_moments(), &[&fine[..], &[stream, gravity, driven]].concat())),
        (
            "dipping",
            scene_of(
                &model("dipping-tail"),
                &["solver.integrator=esdirk3", "solver.time_step_s=1e-3", "solver.duration_s=3.0"],
            ),
        ),
    ]
}

fn reading(stepper: &Stepper) -> BTreeMap<&'static str, Vec<f64>> {
    row_of(&stepper.view())
}

fn row_of(view: &View<'_>) -> BTreeMap<&'static str, Vec<f64>> {
    let model = &view.dynamics.model;
    let there = VARIABLES.iter().filter(|variable| variable.exists_in(model));
    there
        .map(|variable| {
            let mut values = vec![0.0; variable.len(model)];
            variable.read(view, &mut values);
            (variable.name, values)
        })
        .collect()
}

fn motion(scene: &Scene) -> (Stepper, Motion) {
    let mut stepper = Stepper::of(scene).unwrap();
    let mut motion = vec![reading(&stepper)];
    while motion.len() < 3001 {
        stepper.do_step(STEP).unwrap();
        motion.push(reading(&stepper));
    }
    (stepper, motion)
}

/// A column of one entry of a reading.
fn column(motion: &Motion, name: &str, k: usize) -> Option<Vec<f64>> {
    motion.iter().map(|row| row.get(name).map(|values| values[k])).collect()
}

fn size(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| value.abs().max(most))
}

/// How far the increases of `value` over every two steps are from those that Simpson's rule makes of `rate`, over the largest increase
/// that the largest rate makes in a fifth of a second.
fn off(value: &[f64], rate: &[f64]) -> f64 {
    let defect = |i: usize| value[i + 1] - value[i - 1] - STEP / 3.0 * (rate[i - 1] + 4.0 * rate[i] + rate[i + 1]);
    let mut sum = 0.0_f64;
    let mut most = 0.0_f64;
    for i in (1..value.len() - 1).step_by(2) {
        sum += defect(i);
        most = most.max(sum.abs());
    }
    most / (0.2 * size(rate)).max(1e-300)
}

#[test]
fn what_grows_at_a_rate_that_is_told_grows_by_its_integral() {
    let mut tried: BTreeMap<String, f64> = BTreeMap::new();
    for (name, scene) in scenes() {
        let (stepper, motion) = motion(&scene);
        let mut pairs: Vec<(String, String, f64)> = Vec::new();
        let mut pair = |value: &str, rate: &str, sign: f64| pairs.push((value.to_string(), rate.to_string(), sign));
        for variable in VARIABLES.iter().filter(|variable| variable.exists_in(stepper.model())) {
            if let Some(of) = variable.name.strip_suffix("_work_j") {
                pair(variable.name, &format!("{of}_power_w"), 1.0);
            }
            for axis in ["x", "y"] {
                // The tail's force on the head is told, and the head's impulse on the rod.
                if let Some(of) = variable
                    .name
                    .strip_suffix(&format!("_impulse_{axis}_n_s"))
                    .filter(|of| ["drag", "wake", "head"].contains(of))
                {
                    pair(variable.name, &format!("{of}_force_{axis}_n"), if of == "head" { -1.0 } else { 1.0 });
                }
            }
        }
        for axis in ["x", "y"] {
            pair(&format!("{axis}_m"), &format!("v{axis}_m_s"), 1.0);
            pair(&format!("tip_{axis}_m"), &format!("tip_v{axis}_m_s"), 1.0);
            pair(&format!("tip_d{axis}_m"), &format!("tip_v{axis}_m_s"), 1.0);
            pair(&format!("pose_{axis}_m"), &format!("pose_v{axis}_m_s"), 1.0);
            pair(&format!("{axis}_com_m"), &format!("v{axis}_com_m_s"), 1.0);
            pair(&format!("head_d{axis}_m"), &format!("v{axis}_m_s"), 1.0);
            pair(&format!("{axis}_com_m"), &format!("rod_momentum_{axis}_n_s"), 1.0 / stepper.model().rod.total_mass());
        }
        pair("tip_angle_rad", "tip_spin_rad_s", 1.0);
        pair("pose_angle_rad", "pose_spin_rad_s", 1.0);
        for (value, rate, sign) in pairs {
            let entries = motion[0].get(&*value).map_or(0, Vec::len);
            for k in 0..entries {
                let (Some(values), Some(rates)) = (column(&motion, &value, k), column(&motion, &rate, k)) else {
                    continue;
                };
                let rates: Vec<f64> = rates.iter().map(|rate| sign * rate).collect();
                let off = off(&values, &rates);
                let worst = tried.entry(value.clone()).or_default();
                *worst = worst.max(off);
                assert!(off < 2e-3, "{name}: {value}[{k}] against {rate}: {off:e}");
            }
        }
    }
    println!("{tried:#?}");
    assert!(tried.len() >= 24, "{tried:?}");
}

#[test]
fn readings_of_one_thing_by_two_names_agree() {
    for (name, scene) in scenes() {
        let (stepper, motion) = motion(&scene);
        let start = &motion[0];
        let last = start["x_m"].len() - 1;
        let one = |row: &BTreeMap<&'static str, Vec<f64>>, name: &str| row.get(name).map_or(0.0, |values| values[0]);
        let energy = |row| {
            let parts = ["stretching_energy_j", "bending_energy_j", "kinetic_energy_j", "fluid_energy_j"];
            parts.iter().map(|part| one(row, part)).sum::<f64>()
        };
        let taken = |row: &BTreeMap<&'static str, Vec<f64>>, unit: &str| {
            let sum = |parts: &[&str]| parts.iter().map(|part| one(row, &format!("{part}_{unit}"))).sum::<f64>();
            sum(&["actuation", "load", "head", "flow"]) - sum(&["viscous", "wake", "spray"])
        };
        let mut most_lateral = 0.0_f64;
        let powers: Vec<f64> = motion.iter().map(|row| taken(row, "power_w")).collect();
        let energies: Vec<f64> = motion.iter().map(energy).collect();
        // Measured: at most 1e-4 of what the largest power does in 0.2 s.
        let off = off(&energies, &powers);
        println!("{name}: energy {off:e}");
        assert!(off < 1e-3, "{name}: the energy does not grow by the powers: {off:e}");
        for row in &motion {
            let same = |a: f64, b: f64, scale: f64, what: &str| {
                assert!((a - b).abs() <= 1e-9 * scale, "{name}: {what}: {a} {b}");
            };
            for axis in ["x", "y"] {
                let nodes = &row[&*format!("{axis}_m")];
                let first = &start[&*format!("{axis}_m")];
                for (place, k) in [("head", 0), ("mid", last / 2), ("tip", last)] {
                    same(one(row, &format!("{place}_d{axis}_m")), nodes[k] - first[k], 1.0, place);
                }
                same(one(row, &format!("tip_{axis}_m")), nodes[last], 1.0, "tip");
                same(one(row, &format!("pose_{axis}_m")), nodes[0], 1.0, "pose");
                same(one(row, &format!("pose_v{axis}_m_s")), row[&*format!("v{axis}_m_s")][0], 1.0, "pose's velocity");
                same(one(row, &format!("tip_v{axis}_m_s")), row[&*format!("v{axis}_m_s")][last], 1.0, "tip's velocity");
            }
            let edge = |k: usize| (row["y_m"][k + 1] - row["y_m"][k]).atan2(row["x_m"][k + 1] - row["x_m"][k]);
            let turn = |a: f64, b: f64| (a - b).sin();
            same(turn(one(row, "tip_angle_rad"), edge(last - 1)), 0.0, 1.0, "direction of the tip");
            // The first edge of a headed rod is rigid.
            let rigid = |e: usize| e == 0 && stepper.model().rod.body.is_some();
            let rest = |e: usize| if rigid(e) { 0.0 } else { stepper.model().rod.cells[e].rest };
            // A held head has a joint, from its own direction to the first edge.
            let held = row["curvature_1_m"].len() == last;
            let before = |k: usize| match (held, k) {
                (true, 0) => (one(row, "pose_angle_rad"), 0.0),
                (true, _) => (edge(k - 1), rest(k - 1)),
                (false, _) => (edge(k), rest(k)),
            };
            for (k, kappa) in row["curvature_1_m"].iter().enumerate() {
                let (from, rest_before) = before(k);
                let next = if held { k } else { k + 1 };
                let curvature = 4.0 * (0.5 * (edge(next) - from)).tan() / (rest_before + rest(next));
                same(*kappa, curvature, 10.0, "curvature");
            }
            same(one(row, "net_displacement_m"), one(row, "x_com_m") - one(start, "x_com_m"), 1.0, "net displacement");
            most_lateral = most_lateral.max(one(row, "y_com_m").abs());
            same(one(row, "max_lateral_excursion_m"), most_lateral, 1.0, "lateral excursion");
            // The tail pushes the head, which does the work that the push takes.
            let push = ["x_n", "y_n"].map(|axis| one(row, &format!("head_force_{axis}")));
            let pose = ["x", "y"].map(|axis| one(row, &format!("pose_v{axis}_m_s")));
            let pushed =
                push[0] * pose[0] + push[1] * pose[1] + one(row, "head_moment_n_m") * one(row, "pose_spin_rad_s");
            same(one(row, "head_power_w"), -pushed, size(&powers), "power of the head");
            let defect = energy(row) - energy(start) - taken(row, "work_j");
            same(one(row, "numerical_dissipation_j"), -defect, size(&energies), "defect of the balance");
        }
    }
}

#[test]
fn means_over_cycles_are_those_of_the_readings_over_the_last_four() {
    let mut tried = std::collections::BTreeSet::new();
    for (name, scene) in scenes() {
        let (_, motion) = motion(&scene);
        let last = &motion[3000];
        let period = last["cycle_period_s"][0];
        assert_eq!((last["cycles_used"][0], name), (if name == "dipping" { 3.0 } else { 4.0 }, name));
        let steps = last["cycles_used"][0] * period / STEP;
        let end = (3.0 / period + 1e-9).floor() * period / STEP;
        for reading in last.keys() {
            let Some(mean) = last.get(&*format!("cycle_{reading}")) else { continue };
            let values = column(&motion, reading, 0).unwrap();
            // The trapezoidal rule from a fraction of a step to another.
            let until = |t: f64| {
                let k = (t.floor() as usize).min(values.len() - 2);
                let whole: f64 = values[..=k].windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).sum();
                let part = t - k as f64;
                whole + part * (values[k] + 0.5 * part * (values[k + 1] - values[k]))
            };
            let expected = (until(end) - until(end - steps)) / steps;
            let off = (mean[0] - expected).abs() / size(&values).max(1e-300);
            println!("{name}: cycle_{reading} {} {expected} {off:e}", mean[0]);
            assert!(off < 1e-3, "{name}: cycle_{reading}: {} for {expected}", mean[0]);
            tried.insert(*reading);
        }
    }
    assert!(tried.len() >= 9, "{tried:?}");
}

#[test]
fn readings_between_steps_are_of_one_motion_too() {
    for (name, scene) in scenes() {
        let mut stepper = Stepper::of(&scene).unwrap();
        let start = reading(&stepper);
        let (mut worst, mut sizes) = ([0.0_f64; 3], [0.0_f64; 2]);
        for step in 1..=600 {
            stepper.do_step(STEP).unwrap();
            if step % 20 != 0 {
                continue;
            }
            let masses = stepper.model().rod.mass.clone();
            let whole: f64 = masses.iter().sum();
            for part in [0.37, 0.81] {
                let time = stepper.time() - (1.0 - part) * STEP;
                let row = stepper.at(time, row_of).unwrap();
                let one =
                    |row: &BTreeMap<&'static str, Vec<f64>>, name: &str| row.get(name).map_or(0.0, |values| values[0]);
                let sum = |row: &BTreeMap<&'static str, Vec<f64>>, parts: &[&str], unit: &str| {
                    parts.iter().map(|part| one(row, &format!("{part}_{unit}"))).sum::<f64>()
                };
                for axis in ["x", "y"] {
                    let middle =
                        row[&*format!("{axis}_m")].iter().zip(&masses).map(|(x, m)| m * x).sum::<f64>() / whole;
                    worst[0] = worst[0].max((one(&row, &format!("{axis}_com_m")) - middle).abs());
                }
                let moved = one(&row, "x_com_m") - one(&start, "x_com_m");
                worst[1] = worst[1].max((one(&row, "net_displacement_m") - moved).abs());
                let energy = |row| sum(row, &["stretching", "bending", "kinetic", "fluid"], "energy_j");
                let taken = sum(&row, &["actuation", "load", "head", "flow"], "work_j")
                    - sum(&row, &["viscous", "wake", "spray"], "work_j");
                let defect = taken - (energy(&row) - energy(&start));
                worst[2] = worst[2].max((one(&row, "numerical_dissipation_j") - defect).abs());
                sizes = [sizes[0].max(moved.abs()), sizes[1].max(energy(&row).abs())];
            }
        }
        println!("{name}: {worst:?} of {sizes:?}");
        // Measured: 0, 0 and at most 2e-6 of the energy, whose cubic in time is not that of its parts.
        assert!(worst[0] < 1e-12 && worst[1] < 1e-12 && worst[2] < 1e-5 * sizes[1], "{name}: {worst:?} of {sizes:?}");
    }
}

#[test]
fn a_rod_that_falls_is_on_its_parabola_between_steps_too() {
    // Newmark's steps of a constant acceleration are exact; half a step from its ends a line would be 1.2e-4 m off.
    let [x, y] = [0.5, -9.81];
    let gravity = format!("loads={{ gravity_m_s2 = [{x}, {y}] }}");
    let mut stepper = Stepper::of(&common::scene(&[
        "solver.integrator=newmark",
        "solver.time_step_s=0.01",
        "solver.newton_tolerance=1e-12",
        &gravity,
    ]))
    .unwrap();
    let com = |view: &View<'_>| view.metrics.now.com;
    let start = com(&stepper.view());
    for _ in 0..20 {
        stepper.do_step(0.01).unwrap();
        for part in [0.25, 0.5, 0.9] {
            let time = stepper.time() - 0.01 * (1.0 - part);
            let fallen = stepper.at(time, com).unwrap() - start;
            let wanted = [x, y].map(|gravity| 0.5 * gravity * time * time);
            // Measured: 3e-15 m.
            assert!((fallen.x - wanted[0]).hypot(fallen.y - wanted[1]) < 1e-12, "{time}: {fallen:?} {wanted:?}");
        }
    }
}

#[test]
fn what_a_step_loses_is_lost_evenly_within_it() {
    // Implicit Euler loses much.
    let mut stepper = Stepper::of(&scene_of(SOFT, &[])).unwrap();
    let lost = |view: &View<'_>| view.metrics.numerical_dissipation();
    let mut most = 0.0_f64;
    for _ in 0..50 {
        let before = lost(&stepper.view());
        stepper.do_step(2e-3).unwrap();
        let (end, after) = (stepper.time(), lost(&stepper.view()));
        let energy = stepper.metrics().now.energy.total();
        for part in [0.1, 0.5, 0.8] {
            let found = stepper.at(end - 2e-3 * (1.0 - part), lost).unwrap();
            let wanted = before + part * (after - before);
            assert!((found - wanted).abs() < 1e-11 * energy, "{end}, {part}: {found} {wanted}, energy {energy}");
        }
        most = most.max((after - before).abs() / energy);
    }
    println!("{most:e} of the energy in a step");
    assert!(most > 1e-5, "{most:e}");
}
