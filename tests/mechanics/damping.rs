//! Kelvin–Voigt damping of the material, and stiffness and mass as measured, against closed forms and an independent program.

use crate::common;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use caudal::rod::node;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use common::{Dice, SOFT, scene_of, stepper_of};
use serde_json::Value;

fn reference(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/reference/body/{name}.toml"))
}

fn changed(path: &Path, changes: &[&str]) -> Scene {
    let mut document = Document::read(path).unwrap();
    changes.iter().for_each(|change| document.set(change).unwrap());
    document.scene().unwrap()
}

/// The largest deviation from an independent program with automatic derivatives, over the length: positions, and velocities over the
/// largest of them.
fn deviations(name: &str, changes: &[&str]) -> [f64; 2] {
    let path = reference(name);
    let text = std::fs::read_to_string(path.with_extension("json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let scene = changed(&path, changes);
    let length = scene.rod.length_m.get();
    let mut stepper = Stepper::of(&scene).unwrap();
    let mut worst = [0.0_f64; 2];
    for result in expected["results"].as_array().unwrap() {
        let ahead = result["t_s"].as_f64().unwrap() - stepper.time();
        if ahead > 1e-12 {
            stepper.do_step(ahead).unwrap();
        }
        let state = stepper.state();
        for (i, (key, found)) in [("position_m", &state.q), ("velocity_m_s", &state.v)].into_iter().enumerate() {
            let rows = result[key].as_array().unwrap().iter();
            let all: Vec<f64> = rows.flat_map(|row| [0, 1].map(|axis| row[axis].as_f64().unwrap())).collect();
            let size = if i == 0 { length } else { common::largest(all.iter().copied()).max(1e-3) };
            let error = common::largest(found.iter().zip(&all).map(|(found, expected)| found - expected));
            worst[i] = worst[i].max(error / size);
        }
    }
    worst
}

#[test]
fn damped_and_driven_rods_move_as_an_independent_program_says_in_both_forms() {
    for name in [
        "damped-release",
        "elastic-damping",
        "whole-damping",
        "follower",
        "moment-drive",
        "tendons",
        "torque-head",
        "servo",
    ] {
        for form in ["positions", "chain"] {
            let [places, speeds] = deviations(name, &[&format!("solver.form={form}")]);
            println!("{name}, {form}: {places:e} L, {speeds:e} of the speed");
            assert!(places <= 1e-9 && speeds <= 1e-8, "{name}, {form}: {places:e}, {speeds:e}");
        }
    }
}

#[test]
fn a_clamped_rod_decays_as_its_damping_ratio_says() {
    // Modes of a cantilever: β_n L. A mode's ζ = τω/2, its damped frequency ω√(1−ζ²), to the order of the mesh and of the step.
    let error = |nodes: usize| {
        let changes = [
            format!("rod.nodes={nodes}"),
            "loads.point=[]".to_string(),
            "solver.time_step_s=1e-3".to_string(),
            "solver.duration_s=4.0".to_string(),
            "rod.damping_time_s=0.01".to_string(),
        ];
        let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
        let mut document = Document::read(&reference("damped-release")).unwrap();
        changes.iter().for_each(|change| document.set(change).unwrap());
        document.set("drag.along_n_s_m2=0.0").unwrap();
        document.set("drag.across_n_s_m2=0.0").unwrap();
        let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
        let rod = &stepper.model().rod;
        let (length, mass) = (rod.length, rod.total_mass() / rod.length);
        let omega = 1.875_104_068_711_961_f64.powi(2) * (rod.joint_stiffness(1) / mass).sqrt() / length.powi(2);
        let zeta = 0.5 * 0.01 * omega;
        // Struck by a short force in the shape of the first mode at the tip, it soon moves in that mode alone.
        let tip = nodes - 1;
        let mut force = vec![0.0; nodes];
        force[tip] = 1e-4;
        stepper.set("force_y_n", &force).unwrap();
        stepper.do_step(0.3).unwrap();
        stepper.set("force_y_n", &vec![0.0; nodes]).unwrap();
        stepper.do_step(1.5).unwrap(); // the other modes are gone
        // Two samples half a damped period apart: their ratio is −exp(−ζω T/2) where the period is right.
        let half = std::f64::consts::PI / (omega * (1.0 - zeta * zeta).sqrt());
        let mut at = |span: f64| {
            if span > 0.0 {
                stepper.do_step(span).unwrap();
            }
            stepper.get("y_m").unwrap()[tip]
        };
        let (first, second) = (at(0.0), at(half));
        let third = at(half);
        let expected = (-zeta * omega * half).exp();
        ((second / first).abs() / expected - 1.0).abs().max(((third / second).abs() / expected - 1.0).abs())
    };
    let [coarse, fine] = [17, 33].map(error);
    println!("decay of the first mode: {coarse:e}, {fine:e}");
    // Measured with the head's half cell, of second order.
    assert!(fine < 0.01 && fine < 0.5 * coarse, "{coarse:e} {fine:e}");
}

/// Random damped scenes: heads, kinds of damping, methods.
fn damped(dice: &mut Dice, method: &str, form: &str, time_step: f64) -> Stepper {
    let heads = ["free", "clamped", "driven"];
    let head = heads[dice.between(0.0, 3.0) as usize % 3];
    let mut changes = vec![
        format!("head.kind={head}"),
        format!("rod.damping_time_s={{stretch={},bending={}}}", dice.between(0.0, 0.01), dice.between(0.0, 0.1)),
        format!("solver.integrator={method}"),
        format!("solver.form={form}"),
        format!("solver.time_step_s={time_step}"),
        "solver.newton_tolerance=1e-13".to_string(),
        "start={kind=\"ramp\",ramp_s=0.2}".to_string(),
    ];
    if dice.between(0.0, 1.0) < 0.5 {
        changes.push("rod.damping_of=elastic".to_string());
    }
    if head == "driven" {
        changes.push("head.angle_rad={amplitude=0.3,frequency_hz=1.0}".to_string());
    }
    let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
    stepper_of(SOFT, &changes)
}

/// `CAUDAL_DAMPED=10000` asks for more scenes.
#[test]
fn the_power_of_the_material_is_never_negative_in_random_scenes() {
    let scenes = std::env::var("CAUDAL_DAMPED").map_or(100, |count| count.parse().unwrap());
    let mut largest = 0.0_f64;
    for seed in 0..scenes {
        let method = ["implicit-euler", "newmark", "generalized-alpha", "esdirk3"][seed as usize % 4];
        let form = ["positions", "chain"][seed as usize / 4 % 2];
        let mut stepper = damped(&mut Dice(1000 + seed), method, form, 4e-3);
        let mut last = 0.0;
        for _ in 0..20 {
            stepper.do_step(0.01).unwrap();
            let power = stepper.get_scalar("material_power_w").unwrap();
            let work = stepper.get_scalar("material_work_j").unwrap();
            assert!(power >= 0.0 && work >= last, "{seed} {method} {form}: {power} W, {work} J after {last} J");
            (last, largest) = (work, largest.max(power));
        }
    }
    println!("{scenes} scenes, at most {largest:.2} W");
    assert!(largest > 0.0);
}

/// The work of the material, its largest power and that of the first joint's turning, of a damped tail whose head a host turns, by words
/// of its angle every `step` s, and of its rate too if it tells those; without a step, as the scene's own formula turns it.
fn turned(step: Option<f64>, rates: bool) -> [f64; 2] {
    let changes = [
        "actuation={ kind = \"travelling-wave\", kappa_amp = 0.0, frequency_hz = 1.0, wavelength_m = 1.0 }",
        "rod.damping_time_s=0.05",
        "solver.integrator=newmark",
        "solver.time_step_s=1e-3",
        "head.kind=driven",
    ];
    let formula = "head.angle_rad={ amplitude = 0.3, frequency_hz = 1.0 }";
    let mut stepper = stepper_of(SOFT, &[&changes[..], &[formula][..usize::from(step.is_none())]].concat());
    let (mut largest, span) = (0.0_f64, step.unwrap_or(5e-3));
    if step.is_some() {
        stepper.set("head_spin_rad_s", &[0.3 * TAU]).unwrap();
    }
    for k in 1..=(2.0 / span).round() as usize {
        let t = (k - 1) as f64 * span;
        if step.is_some() {
            stepper.set("head_angle_rad", &[0.3 * (TAU * t).sin()]).unwrap();
            if rates {
                stepper.set("head_spin_rad_s", &[0.3 * TAU * (TAU * t).cos()]).unwrap();
            }
        }
        stepper.do_step(span).unwrap();
        largest = largest.max(stepper.get_scalar("material_power_w").unwrap());
    }
    [stepper.get_scalar("material_work_j").unwrap(), largest]
}

#[test]
fn poses_that_a_host_gives_without_rates_turn_the_first_joint_smoothly() {
    let [work, power] = turned(None, true);
    for rates in [true, false] {
        let off =
            [0.02, 0.01, 0.005].map(|step| turned(Some(step), rates)).map(|[w, p]| [w / work - 1.0, p / power - 1.0]);
        println!("with rates: {rates}; work and largest power off by {off:.6?}");
        // The rate follows from the poses. Measured without rates: work off by 1.6e-4, 5e-6, 1e-6, power never beyond its own.
        assert!(off.iter().all(|[_, power]| power.abs() < 3e-3 && *power < 1e-6), "{off:?}");
        assert!(off[0][0].abs() < 3e-4 && off[2][0].abs() < 3e-6, "{off:?}");
    }
}

#[test]
fn the_work_of_the_material_is_never_negative_and_closes_the_balance() {
    let (mut worst, mut halved) = (0.0_f64, 0.0_f64);
    for seed in 0..12 {
        for form in ["positions", "chain"] {
            let mut stepper = damped(&mut Dice(seed), "newmark", form, 1e-3);
            let mut last = 0.0;
            for _ in 0..50 {
                stepper.do_step(0.01).unwrap();
                assert!(stepper.get_scalar("material_power_w").unwrap() >= 0.0);
                let work = stepper.get_scalar("material_work_j").unwrap();
                assert!(work >= last, "{seed} {form}: {work} after {last}");
                last = work;
            }
            let metrics = stepper.metrics();
            let defect = metrics.numerical_dissipation().abs() / last;
            worst = worst.max(defect);
            let mut finer = damped(&mut Dice(seed), "newmark", form, 5e-4);
            for _ in 0..50 {
                finer.do_step(0.01).unwrap();
            }
            halved = halved.max(finer.metrics().numerical_dissipation().abs() / last);
        }
    }
    println!("defect over the work of the material: {worst:e}, at half the step {halved:e}");
    assert!(halved < 0.35 * worst && worst < 0.02, "{worst} {halved}");
}

#[test]
fn both_forms_of_a_damped_rod_move_alike_with_every_method() {
    for method in ["implicit-euler", "newmark", "generalized-alpha", "esdirk3"] {
        for seed in 0..4 {
            let [a, b] = ["positions", "chain"].map(|form| {
                let mut stepper = damped(&mut Dice(seed), method, form, 1e-3);
                stepper.do_step(0.3).unwrap();
                let energy = stepper.metrics().now.energy;
                let work = stepper.work().newton_iterations;
                (stepper.state().q.clone(), energy.bending, energy.stretching, work)
            });
            let apart = common::largest(a.0.iter().zip(&b.0).map(|(a, b)| a - b));
            println!("{method} {seed}: {apart:e} m, iterations {} and {}", a.3, b.3);
            assert!(apart < 1e-8, "{method} {seed}: {apart:e}");
            assert!((a.1 - b.1).abs() <= 1e-6 * a.1.abs() && (a.2 - b.2).abs() <= 1e-4 * a.2.abs().max(1e-3 * a.1));
        }
    }
}

#[test]
fn measured_stiffness_and_mass_are_those_of_the_section_that_gives_them() {
    let by_section = scene_of(SOFT, &["rod.stiffness_gradient=0.0"]);
    let rod = common::rod(&by_section);
    let area = std::f64::consts::PI * 0.08_f64.powi(2);
    let table = by_section.rod.clone();
    assert!(table.axial_stiffness_n.is_none());
    let measured = SOFT
        .replace("youngs_modulus_pa = 1e5", &format!("axial_stiffness_n = {:e}", 1e5 * area))
        .replace("density_kg_m3 = 1000.0", &format!("bending_stiffness_n_m2 = {:e}", rod.joint_stiffness(1)))
        .replace("stiffness_gradient = 0.5", &format!("mass_per_length_kg_m = {:e}", 1000.0 * area));
    let by_measure = scene_of(&measured, &[]);
    let other = common::rod(&by_measure);
    for (a, b) in [(rod.ea, other.ea), (rod.ei, other.ei), (rod.total_mass(), other.total_mass())] {
        assert!((a - b).abs() <= 1e-14 * a, "{a} {b}");
    }
    assert!(by_measure.rod.youngs_modulus_pa.is_none());
    assert!((by_measure.rod.youngs_modulus() - 1e5).abs() < 1e-6);
}

#[test]
fn keys_of_the_material_that_contradict_each_other_are_refused_by_name() {
    // In a file; an override of one takes the other away.
    for (keys, expected) in [
        ("damping_time_s = 0.1\nloss_factor = 0.1", "together with damping_time_s"),
        ("mass_per_length_kg_m = 1.0", "together with density_kg_m3"),
    ] {
        let text = SOFT.replace("stiffness_gradient = 0.5", keys);
        let error = Document::new("soft", text).scene().unwrap_err().to_string();
        assert!(error.contains(expected), "{keys}: {error}");
    }
    let cases: [(&[&str], &str); 6] = [
        (&["rod.damping_time_s=-0.1"], "a number that is not negative"),
        (&["rod.loss_factor=0.1", "actuation.frequency_hz=0.0"], "without a frequency"),
        (&["rod.loss_frequency_hz=1.0"], "without loss_factor"),
        (&["rod.damping_of=elastic"], "without damping_time_s and loss_factor"),
        (&["rod.damping_time_s={shear=1.0}"], "shear"),
        (&["rod.axial_stiffness_n=1.0", "rod.bending_stiffness_n_m2=1.0"], "with only one of them"),
    ];
    for (changes, expected) in cases {
        let mut document = Document::new("soft", SOFT.to_string());
        let set = changes.iter().try_for_each(|change| document.set(change));
        let error = set.and_then(|()| document.scene().map(|_| ())).unwrap_err().to_string();
        assert!(error.contains(expected), "{changes:?}: {error}");
    }
}

#[test]
fn a_rod_without_stiffness_mass_or_radius_is_refused_with_what_would_give_it() {
    let cases = [
        ("youngs_modulus_pa = 1e5\n", "axial_stiffness_n and bending_stiffness_n_m2 in its place"),
        ("density_kg_m3 = 1000.0\n", "mass_per_length_kg_m in its place"),
        ("outer_radius_m = 0.08\n", "youngs_modulus_pa needs it"),
    ];
    for (line, expected) in cases {
        let error = Document::new("soft", SOFT.replacen(line, "", 1)).scene().unwrap_err().to_string();
        assert!(error.contains(expected), "{line}: {error}");
    }
}

/// At the start nothing is stretched, but a head in motion opens the first edge, which its material resists.
#[test]
fn both_forms_begin_with_what_the_material_resists() {
    for start in ["start={ kind = \"ramp\", ramp_s = 0.5 }", "start.kind=jump", "start.kind=shaped"] {
        for material in ["rod.damping_of=whole", "rod.damping_of=elastic"] {
            let changes = [
                "rod.damping_time_s=0.01",
                material,
                start,
                "solver.integrator=newmark",
                "head={ kind = \"driven\", position_m = [{ amplitude = 0.01, frequency_hz = 2.0 }, 0.0] }",
            ];
            let ends = ["positions", "chain"].map(|form| {
                let form = format!("solver.form={form}");
                let mut stepper = stepper_of(SOFT, &[&changes[..], &[&form]].concat());
                let first = ["head_force_x_n", "stretching_energy_j", "numerical_dissipation_j"]
                    .map(|name| stepper.get_scalar(name).unwrap());
                stepper.do_step(0.02).unwrap();
                (first, stepper.get("x_m").unwrap(), stepper.get_scalar("numerical_dissipation_j").unwrap())
            });
            let [positions, chain] = &ends;
            println!("{start} {material}: {positions:?} {chain:?}");
            let size = positions.0[0].abs().max(1e-3);
            assert!((positions.0[0] - chain.0[0]).abs() <= 1e-9 * size && size > 0.1, "{ends:?}");
            assert!(positions.0[1].abs() < 1e-20 && chain.0[1].abs() < 1e-20 && chain.0[2] == 0.0, "{ends:?}");
            let apart = common::largest(positions.1.iter().zip(&chain.1).map(|(a, b)| a - b));
            assert!(apart < 1e-9 && (positions.2 - chain.2).abs() < 1e-9 * size, "{apart:e} {ends:?}");
        }
    }
}

/// A loss factor says τ by the frequency of what moves the rod, and of nothing that does not.
#[test]
fn a_loss_factor_holds_at_the_one_frequency_of_what_moves_the_rod() {
    let wave = |amplitude: f64| {
        format!(
            "actuation={{ kind = \"travelling-wave\", kappa_amp = {amplitude}, frequency_hz = 2.0, wavelength_m = 1.0 }}"
        )
    };
    let heave = |amplitude: f64| {
        format!(
            "head={{ kind = \"driven\", position_m = [0.0, {{ amplitude = {amplitude}, frequency_hz = 0.1 }}], angle_rad = {{ amplitude = 0.1, frequency_hz = 3.0 }} }}"
        )
    };
    let time = |changes: &[&str]| {
        let stepper = stepper_of(SOFT, &[&["rod.loss_factor=0.1"], changes].concat());
        stepper.model().rod.damping.as_ref().unwrap().bending[2]
    };
    for (changes, frequency) in [
        (vec![wave(1.0)], 2.0),
        (vec![wave(0.0)], 2.0),
        (vec![wave(0.0), heave(0.0)], 3.0),
        (vec![wave(1.0), heave(0.1), "rod.loss_frequency_hz=7.0".into()], 7.0),
    ] {
        let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
        let found = time(&changes) * TAU * frequency;
        assert!((found / 0.1 - 1.0).abs() < 1e-12, "{changes:?}: {found}");
    }
    for changes in [vec![wave(1.0), heave(0.0)], vec![wave(0.0), heave(0.1)]] {
        let changes: Vec<&str> = changes.iter().map(String::as_str).collect();
        let all = [&["rod.loss_factor=0.1"], &changes[..]].concat();
        let error = common::document_of("soft.toml", SOFT, &all).scene().unwrap_err().to_string();
        assert!(
            error.contains("so that its frequency is ambiguous") && error.contains("rod.loss_frequency_hz"),
            "{error}"
        );
    }
}

/// A strip of rubber in the air, clamped and let go from a bend.
const RELEASED: &str = r#"
[rod]
nodes = 33
length_m = 0.15
section = "rectangle"
outer_radius_m = 0.002
depth_m = 0.02
youngs_modulus_pa = 1e6
density_kg_m3 = 1100.0
damping_time_s = 3e-3
[head]
kind = "clamped"
[start]
curvature_1_m = [[0.0, 0.3], [1.0, 0.0]]
[solver]
integrator = "generalized-alpha"
time_step_s = 1e-3
duration_s = 3.0
"#;

/// A free decay, from which τ is measured: the first mode's period is 2π/(ω₁√(1 − ζ²)), its amplitude falls by e^(−ζω₁t), ζ = τω₁/2. In
/// both forms, with a head that is turned and one that moves.
#[test]
fn a_rod_that_is_let_go_from_a_bend_decays_by_its_damping_time() {
    let first =
        1.875_104_069 * 1.875_104_069 * (1e6 * 0.02 * 0.004_f64.powi(3) / 12.0 / (1100.0 * 0.02 * 0.004)).sqrt()
            / (0.15 * 0.15);
    let ratio = 0.5 * 3e-3 * first;
    for changes in [&[][..], &["solver.form=chain"], &["head.kind=driven", "head.angle_rad=0.7"]] {
        let mut tip = Vec::new();
        let end = common::run_with(&scene_of(RELEASED, &[changes, &["solver.duration_s=20.0"]].concat()), |stepper| {
            let (q, turned) = (&stepper.state().q, if changes.len() > 1 { 0.7_f64 } else { 0.0 });
            tip.push((stepper.time(), node(q, 32).y * turned.cos() - node(q, 32).x * turned.sin()));
        });
        // Crossings of the axis, by straight lines, and the peaks between them.
        let crossings: Vec<f64> = tip
            .windows(2)
            .filter(|pair| pair[0].1 * pair[1].1 <= 0.0)
            .map(|pair| pair[0].0 + (pair[1].0 - pair[0].0) * pair[0].1 / (pair[0].1 - pair[1].1))
            .collect();
        let count = crossings.len();
        let half = (crossings[count - 1] - crossings[2]) / (count - 3) as f64;
        let largest = |from: f64, until: f64| {
            tip.iter().filter(|(t, _)| (from..until).contains(t)).fold(0.0, |max: f64, (_, y)| max.max(y.abs()))
        };
        let peaks: Vec<f64> = crossings.windows(2).skip(2).map(|pair| largest(pair[0], pair[1])).collect();
        let decay = (peaks[0] / peaks[peaks.len() - 1]).ln() / (peaks.len() - 1) as f64;
        let by_theory = [PI / (first * (1.0 - ratio * ratio).sqrt()), PI * ratio / (1.0 - ratio * ratio).sqrt()];
        println!(
            "{changes:?}: {count} crossings, half a period off by {:.1e}, decrement by {:.1e}",
            half / by_theory[0] - 1.0,
            decay / by_theory[1] - 1.0
        );
        // Measured: 8.2e-4 and 1.5e-4.
        assert!(
            (half / by_theory[0] - 1.0).abs() < 2e-3 && (decay / by_theory[1] - 1.0).abs() < 1e-3,
            "{half} {decay}"
        );
        // What it was bent with is what the material took, or is there still.
        let metrics = end.metrics();
        let bent = 0.3 * 0.3 / 3.0 * 0.15 * 0.5 * (1e6 * 0.02 * 0.004_f64.powi(3) / 12.0);
        assert!((metrics.first_energy / bent - 1.0).abs() < 2e-2, "{} {bent}", metrics.first_energy); // measured 1.2e-2, the mesh
        assert!(metrics.numerical_dissipation().abs() < 1e-4 * bent, "{}", metrics.numerical_dissipation());
    }
}

#[test]
fn a_bent_start_is_at_rest_and_says_what_it_cannot() {
    // Free: where the straight rod is, without momentum, and on from there beside a natural curvature.
    let wave = "[actuation]\nkind = \"travelling-wave\"\nkappa_amp = 2.0\nfrequency_hz = 1.0\nwavelength_m = 0.2\n";
    let free = RELEASED.replace("kind = \"clamped\"", "kind = \"free\"");
    for text in
        [free.clone(), format!("{free}{wave}"), format!("{free}{wave}").replace("[start]", "[start]\nkind = \"jump\"")]
    {
        let start = stepper_of(&text, &[]);
        let (rod, state) = (&start.model().rod, start.state());
        let [centre, drift] = [rod.mean(&state.q), rod.mean(&state.v)];
        assert!(
            (centre - nalgebra::Vector2::new(0.075, 0.0)).norm() < 1e-12 && drift.norm() < 1e-12,
            "{centre} {drift}"
        );
        let kappa = &start.metrics().now.kappa;
        let own = stepper_of(&text, &["start.curvature_1_m=0.0"]);
        let added = (kappa[16] - own.metrics().now.kappa[16]) / rod.spacing;
        assert!((added - 0.15).abs() < 1e-9, "{added}");
    }
    // Let go in a thick fluid it lies straight at last, with inertia and without.
    let oil = "[medium]\nviscosity_pa_s = 5.0\ndensity_kg_m3 = 1000.0\n[drag]\nlaw = \"cox\"\n";
    for model in ["full", "overdamped"] {
        let end = common::run(&scene_of(
            &format!("{RELEASED}{oil}"),
            &[&format!("solver.model={model}"), "solver.duration_s=60.0"],
        ));
        let tip = node(&end.state().q, 32).y;
        assert!(tip.abs() < 1e-5, "{model}: {tip}"); // measured 1.4e-6, of 2.2e-3 at the start
    }
    let refused = |changes: &[&str]| {
        let document = common::document_of("test.toml", &format!("{RELEASED}{oil}"), changes);
        document.scene().and_then(|scene| caudal::stepper::Stepper::of(&scene).map(|_| ())).unwrap_err().to_string()
    };
    let shape = refused(&["solver.model=shape"]);
    assert!(shape.contains("start.curvature_1_m") && shape.contains("overdamped"), "{shape}");
    let profile = refused(&["start.curvature_1_m=[[0.5, 1.0], [0.2, 1.0]]"]);
    assert!(profile.contains("start.curvature_1_m") && profile.contains("rising xi"), "{profile}");
    // `auto` keeps the whole model, and says why.
    let auto = scene_of(&format!("{RELEASED}{oil}"), &["solver.model=auto"]).choice().unwrap();
    assert!(auto.kind.name == "full" && auto.reason.as_ref().unwrap().contains("released"), "{auto:?}");
}

/// Derivatives of a decay by what decides it, start included, against differences.
#[test]
fn a_decay_has_its_derivatives() {
    let document = common::document_of("test.toml", RELEASED, &["solver.duration_s=0.4"]);
    let keys = ["rod.youngs_modulus_pa", "rod.damping_time_s", "rod.length_m"];
    let value = |key: &str, factor: f64| {
        let own: toml::Table = toml::from_str(RELEASED).unwrap();
        let (table, name) = key.split_once('.').unwrap();
        own[table][name].as_float().unwrap() * factor
    };
    let tip = |key: &str, factor: f64| {
        let change = format!("{key}={:e}", value(key, factor));
        node(
            &common::run(&scene_of(RELEASED, &["solver.duration_s=0.4", &change, "solver.newton_tolerance=1e-13"]))
                .state()
                .q,
            32,
        )
        .y
    };
    let found = caudal::sensitivity::value_and_grad(&document, "tip_y_m", &keys).unwrap();
    for (key, by) in keys.iter().zip(&found.1) {
        let half = 1e-4;
        let [one, two] =
            [half, 2.0 * half].map(|h| (tip(key, 1.0 + h) - tip(key, 1.0 - h)) / (2.0 * h * value(key, 1.0)));
        let richardson = (4.0 * one - two) / 3.0;
        let by = by.values[0];
        println!("{key}: {by:e} {richardson:e}");
        assert!((by / richardson - 1.0).abs() < 1e-5, "{key}: {by:e} {richardson:e}");
    }
}
