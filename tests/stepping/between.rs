//! What is read between steps is as good as what is read at their ends.

use crate::common;
use std::path::Path;

use caudal::integrator::{METHODS, StepControl};
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::variable::{Size, Variable};
use common::{SOFT, run_with};

/// A steel wire in oil whose base angle oscillates (Yu, Lauga and Hosoi 2006).
const WIRE: &str = r#"
[rod]
nodes = 41
length_m = 0.2
outer_radius_m = 2.5e-4
youngs_modulus_pa = 2e11
density_kg_m3 = 7900.0
[medium]
viscosity_pa_s = 3.18
density_kg_m3 = 980.0
[drag]
ratio = 2.0
[head]
kind = "driven"
angle_rad = { amplitude = 0.435, frequency_hz = 0.25 }
[solver]
duration_s = 2.0
"#;

/// Three nodes of a stiff rod that is released into half a turn, without inertia.
const FOLD: &str = r#"
[rod]
nodes = 3
length_m = 0.04064490924936967
outer_radius_m = 0.0007274556999336898
youngs_modulus_pa = 13381810056.242634
density_kg_m3 = 405.2550618757621
stiffness_profile = [[0.5548311530441857,0.1064082362974569],[0.6635728435814767,0.426139613074491]]
[actuation]
kind = "travelling-wave"
frequency_hz = 1.2543918840182975
wavelength_m = 0.19349217693771306
kappa_amp = 14.361513153005363
[start]
kind = "jump"
[medium]
viscosity_pa_s = 0.00014420253418829864
density_kg_m3 = 0.0047446906747510365
[drag]
ratio = 0.8873894172159776
[solver]
time_step_s = 0.03201950572428686
duration_s = 0.06403901144857373
model = "overdamped"
"#;

fn model(name: &str) -> String {
    std::fs::read_to_string(Path::new("models").join(name)).unwrap()
}

fn scene_of(text: &str, overrides: &[&str]) -> Scene {
    let mut document = Document::new("between.toml", text);
    overrides.iter().for_each(|assignment| document.set(assignment).unwrap());
    document.scene().unwrap()
}

fn recorded(stepper: &Stepper) -> Vec<&'static Variable> {
    let wanted = |variable: &&'static Variable| variable.recorded || variable.size == Size::Joints;
    stepper.variables().iter().copied().filter(wanted).collect()
}

/// All values of the variables, one row each.
fn values(variables: &[&'static Variable], view: &caudal::variable::View<'_>) -> Vec<Vec<f64>> {
    let row = |variable: &&'static Variable| {
        let mut row = vec![0.0; variable.len(&view.dynamics.model)];
        variable.read(view, &mut row);
        row
    };
    variables.iter().map(row).collect()
}

fn largest(row: &[f64]) -> f64 {
    common::largest(row.iter().copied())
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    common::largest(a.iter().zip(b).map(|(a, b)| a - b))
}

/// Parts of a step that are looked at.
const PARTS: [f64; 4] = [0.1, 0.37, 0.5, 0.81];

#[test]
fn readings_between_steps_are_as_good_as_those_at_their_ends_whatever_rod_head_method_form_and_rung() {
    let esdirk3 = &["solver.integrator=esdirk3"][..];
    let mut cases = vec![
        ("the wire", WIRE.to_string(), vec![]),
        ("the wire, chain", WIRE.to_string(), vec!["solver.form=chain"]),
        ("the wire, overdamped", WIRE.to_string(), vec!["solver.model=overdamped", "solver.tolerance=1e-4"]),
        ("driven head", model("driven-head.toml"), vec![]),
        ("driven head, chain", model("driven-head.toml"), vec!["solver.form=chain"]),
        ("cantilever", model("cantilever.toml"), vec![]),
        ("glycerol, overdamped", model("glycerol.toml"), vec!["start.kind=shaped", "solver.model=overdamped"]),
        ("soft", SOFT.to_string(), vec!["solver.integrator=esdirk3", "solver.time_step_s=4e-3"]),
        ("soft, in water that it moves", SOFT.to_string(), vec!["solver.integrator=esdirk3", "reactive.shedding=1.0"]),
        ("soft, shape", SOFT.to_string(), vec!["solver.model=shape", "solver.time_step_s=4e-3"]),
    ];
    for method in METHODS.iter().filter(|method| method.implicit) {
        let own = format!("solver.integrator={}", method.name).leak();
        cases.push((method.name, model("baseline-smooth.toml"), vec![own]));
    }
    cases.push(("chain", model("baseline-smooth.toml"), [esdirk3, &["solver.form=chain"]].concat()));
    let mut bad = Vec::new();
    for (name, text, mut overrides) in cases {
        overrides.push("solver.duration_s=0.8");
        let scene = scene_of(&text, &overrides);
        // The same motion in small steps.
        let mut truth = match scene.solver.model.as_str() {
            "full" => Stepper::of(&scene.reference()).unwrap(),
            _ => Stepper::of(&scene.with_step_control(StepControl::Adaptive(1e-7))).unwrap(),
        };
        let variables = recorded(&truth);
        let (mut steps, mut looks, mut from) = (0, 0, 0.0);
        // Largest modulus, and the largest errors at the ends and between, of each variable.
        let mut found = vec![[0.0_f64; 3]; variables.len()];
        run_with(&scene, |stepper| {
            let start = std::mem::replace(&mut from, stepper.time());
            steps += 1;
            let end = values(&variables, &stepper.view());
            for (found, end) in found.iter_mut().zip(&end) {
                found[0] = found[0].max(largest(end));
            }
            if steps < 4 || steps % 4 != 0 {
                return;
            }
            looks += 1;
            let h = stepper.time() - start;
            for i in 0..=PARTS.len() {
                let t = PARTS.get(i).map_or(stepper.time(), |part| start + part * h);
                truth.do_step(t - truth.time()).unwrap();
                let exact = values(&variables, &truth.view());
                let read = stepper.at(truth.time().min(stepper.time()), |view| values(&variables, view)).unwrap();
                for (found, (read, exact)) in found.iter_mut().zip(read.iter().zip(&exact)) {
                    let error = &mut found[if i == PARTS.len() { 1 } else { 2 }];
                    *error = error.max(difference(read, exact));
                }
            }
        });
        for (variable, [size, end, between]) in variables.iter().zip(&found) {
            println!("{name:24} {:26} {size:10.3e} {:9.2e} {:9.2e}", variable.name, end / size, between / size);
            // Measured: at most 1.8 times the error at the ends, where the true motion rings in the energy of stretching and
            // four times as many readings meet more of it; 1.7 times elsewhere, where errors pass 1 %.
            // On a free rod without inertia drag is nothing in all: what is read between (2e-8 N) is the rounding of its parts.
            let nothing = variable.name.starts_with("drag_force") && *size < 1e-12;
            if *between > 2.0 * end + 1e-2 * size && !nothing {
                bad.push(format!("{name}, {}: {between:e} where the ends have {end:e} of {size:e}", variable.name));
            }
        }
        assert!(looks > 2, "{name}: {steps}");
    }
    assert!(bad.is_empty(), "{bad:#?}");
}

#[test]
fn a_stiff_rod_stores_no_more_energy_between_steps_and_takes_no_more_power_than_at_their_ends() {
    let largest = |overrides: &[&str]| {
        let scene = scene_of(&model("baseline-smooth.toml"), &[&["solver.duration_s=4.0"], overrides].concat());
        let mut largest = [0.0_f64; 2];
        let mut next = 1.0;
        run_with(&scene, |stepper| {
            let interval = scene.record.interval_s.map_or(0.0, |interval| interval.get());
            loop {
                let t = if interval > 0.0 { next * interval } else { stepper.time() };
                if t > stepper.time() {
                    break;
                }
                let now = stepper.at(t, |view| [view.metrics.now.energy.stretching, view.metrics.now.power.actuation]);
                largest = std::array::from_fn(|i| largest[i].max(now.as_ref().unwrap()[i].abs()));
                next += 1.0;
                if interval == 0.0 {
                    break;
                }
            }
        });
        largest
    };
    let (ends, between) = (largest(&[]), largest(&["record.interval_s=0.011"]));
    println!("{ends:?} {between:?}");
    for (end, between) in ends.into_iter().zip(between) {
        // Measured: 1.07e-8 J and 1.14 W at both.
        assert!(between < 1.05 * end, "{between:e} {end:e}");
    }
}

#[test]
fn reading_between_steps_neither_fails_a_run_that_completes_nor_changes_its_result() {
    let scenes = [
        scene_of(FOLD, &[]),
        scene_of(FOLD, &["drag.ratio=0.888"]),
        scene_of(&model("baseline.toml"), &["solver.duration_s=0.2"]),
        scene_of(&model("driven-head.toml"), &["solver.duration_s=0.2", "solver.form=chain"]),
    ];
    for scene in scenes {
        let plain = run_with(&scene, |_| {});
        let mut from = 0.0;
        let mut count = 0;
        let read = run_with(&scene, |stepper| {
            let to = stepper.time();
            for i in 1..40 {
                stepper
                    .at(from + (to - from) * f64::from(i) / 40.0, |view| assert!(largest(&view.state.q).is_finite()))
                    .unwrap();
                count += 1;
            }
            from = to;
        });
        assert!(count > 0);
        assert_eq!((plain.state(), plain.metrics(), plain.work()), (read.state(), read.metrics(), read.work()));
    }
}
