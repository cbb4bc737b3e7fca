//! The rigid motion of the prescribed shape, with the momentum of rod and water together.

use crate::common;
use caudal::rod::node;
use caudal::scene::Scene;
use common::{largest, run, scene_of};

const EEL: &str = r#"name = "eel"
[rod]
nodes = 17
length_m = 0.3
outer_radius_m = 0.006
depth_m = [[0.0, 0.02], [0.9, 0.02], [1.0, 0.03]]
youngs_modulus_pa = 1e9
density_kg_m3 = 1000.0
[actuation]
kind = "travelling-wave"
kappa_amp = 8.0
frequency_hz = 1.0
wavelength_m = 0.3
envelope = [0.3, 0.7]
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[drag]
law = "cross-flow"
[reactive]
[solver]
tolerance = 1e-6
duration_s = 2.0
"#;

fn eel(changes: &[&str]) -> Scene {
    scene_of(EEL, changes)
}

#[test]
fn a_stiff_swimmer_in_water_moves_as_its_shape_says_and_the_closer_the_stiffer_it_is() {
    let shape = run(&eel(&["solver.model=shape"]));
    let offs = [1e8, 1e9, 1e10].map(|modulus: f64| {
        let whole = run(&eel(&[&format!("rod.youngs_modulus_pa={modulus:e}")]));
        let path = whole.metrics().totals.path;
        (whole.metrics().now.com - shape.metrics().now.com).norm() / path
    });
    // Measured: 3.2e-3, 3.2e-4, 3.2e-5 of the path.
    assert!(offs[2] < 1e-4 && offs[1] < 0.12 * offs[0] && offs[2] < 0.12 * offs[1], "{offs:?}");
    let fluid = run(&eel(&["rod.youngs_modulus_pa=1e10"]));
    let [a, b] = [&fluid, &shape].map(|stepper| stepper.metrics());
    // Measured: 2.8e-4, 5.1e-5.
    assert!((a.totals.work.actuation / b.totals.work.actuation - 1.0).abs() < 1e-3);
    assert!((a.totals.work.wake / b.totals.work.wake - 1.0).abs() < 1e-3);
}

#[test]
fn without_drag_and_wake_the_momentum_of_rod_and_water_stays_and_so_does_the_balance() {
    for model in ["shape", "full"] {
        let model = format!("solver.model={model}");
        let bare = EEL.replace("[drag]\nlaw = \"cross-flow\"\n", "");
        let stepper = run(&scene_of(&bare, &["reactive.shedding=0.0", &model, "solver.duration_s=1.0"]));
        let metrics = stepper.metrics();
        let size = metrics.now.momentum.rod.norm() + metrics.now.momentum.fluid.norm();
        // Measured: 8.4e-16 of it by the shape, 4.7e-8 by the whole model.
        assert!(metrics.momentum_defect().norm() < 1e-6 * size);
        // A shape that deforms in still water by turns moves by turns: it is not at rest.
        assert!(largest((0..17).map(|k| node(&stepper.state().v, k).norm())) > 1e-3);
    }
}

#[test]
fn the_shape_s_velocities_and_accelerations_belong_together() {
    let mut stepper = caudal::stepper::Stepper::of(&eel(&["solver.model=shape", "solver.tolerance=1e-9"])).unwrap();
    stepper.do_step(0.63).unwrap();
    let h = 1e-4;
    let mut at = |h: f64| {
        stepper.do_step(h).unwrap();
        stepper.state().clone()
    };
    let states = [at(h), at(h), at(h)];
    for (of, rate, tolerance) in [(0, 1, 1e-6), (1, 2, 1e-5)] {
        let part = |state: &caudal::system::State, i: usize| [&state.q, &state.v, &state.a][i].clone();
        let (before, now, after) = (part(&states[0], of), part(&states[1], rate), part(&states[2], of));
        let scale = largest(now.iter().copied());
        let off = largest(now.iter().zip(after.iter().zip(&before)).map(|(now, (b, a))| now - (b - a) / (2.0 * h)));
        // Measured: 7.4e-8, 1.0e-7.
        assert!(off < tolerance * scale, "{of}: {off:e} of {scale:e}");
    }
}

#[test]
fn auto_takes_the_shape_in_water_where_it_is_within_the_accuracy_and_says_what_overdamped_lacks() {
    let auto = ["solver.model=auto", "solver.tolerance=1e-4", "solver.accuracy=1e-2", "solver.duration_s=16.0"];
    for (modulus, taken) in [("1e9", "shape"), ("1e5", "full")] {
        let scene = eel(&[&auto[..], &[&format!("rod.youngs_modulus_pa={modulus}")]].concat());
        let stepper = run(&scene);
        let choice = stepper.choice().unwrap();
        assert_eq!(choice.kind.name, taken, "{:?}", choice.reason);
        let estimates = choice.estimates.as_ref().unwrap();
        assert!(estimates.overdamped.as_ref().unwrap_err().contains("added mass"));
        let whole = run(&scene.reference());
        let off =
            (whole.metrics().now.com - stepper.metrics().now.com).norm() / whole.metrics().net_displacement().abs();
        println!("{modulus}: {off:e}, {:?}", choice.reason);
        // Measured: 1.6e-4, estimated 1.0e-3 of the tip; 4.3e-6 by the whole model itself.
        assert!(off < 1e-2, "{modulus}: {off:e}");
    }
    let refused = scene_error(&["solver.model=overdamped"]);
    assert!(refused.contains("solver.model") && refused.contains("without inertia"), "{refused}");
}

fn scene_error(changes: &[&str]) -> String {
    let mut document = caudal::scene::Document::new("eel.toml", EEL);
    changes.iter().for_each(|change| document.set(change).unwrap());
    document.scene().unwrap_err().to_string()
}

#[test]
fn reactive_auto_takes_the_force_where_it_matters() {
    let bare = EEL.replace("[reactive]\n", "");
    for (viscosity, taken) in [("1e-3", true), ("1e3", false)] {
        let scene = scene_of(&bare, &["reactive=auto", &format!("medium.viscosity_pa_s={viscosity}")]);
        let model = scene.model().unwrap();
        assert_eq!(model.forces.iter().any(|force| force.name() == "reactive"), taken, "{viscosity}");
    }
    let mut document = caudal::scene::Document::new("eel.toml", bare);
    document.set("reactive=never").unwrap();
    let refused = document.scene().unwrap_err().to_string();
    assert!(refused.contains("reactive") && refused.contains("auto"), "{refused}");
}
