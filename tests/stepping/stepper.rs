//! The stepper: steps split without a trace, time never drifts, a snapshot brings back every bit, and a wrong call is
//! an error that changes nothing.

use crate::common;
use std::collections::HashSet;

use caudal::error::Error;
use caudal::integrator::{Method, StepControl};
use caudal::linear::SolverChoice;
use caudal::newton::Newton;
use caudal::reduced::MODELS;
use caudal::scene::Document;
use caudal::stepper::Stepper;
use caudal::system::Form;
use caudal::variable::{Causality, VARIABLES};
use common::{Dice, SOFT, STUDY, soft_moments, stepper_of};

/// One scene of each kind: which parts are present decides which variables there are.
fn kinds() -> Vec<(&'static str, Stepper)> {
    let passive =
        SOFT.split("[actuation]").next().unwrap().to_string() + "[solver]\ntime_step_s = 2e-3\nduration_s = 1.0\n";
    let dry = SOFT.split("[medium]").next().unwrap().to_string() + "[solver]\ntime_step_s = 2e-3\nduration_s = 1.0\n";
    let loads = ["loads.gravity_m_s2=[0.0,-9.8]", "loads.point=[{node=-1,force_n=[0.0,1.0]}]"];
    let head = ["head.kind=driven", "head.position_m={amplitude=[0.0,0.02],frequency_hz=1.0}", "head.angle_rad=0.1"];
    vec![
        ("study", stepper_of(STUDY, &[])),
        ("soft", stepper_of(SOFT, &["medium.flow_m_s=[0.05,0.02]"])),
        ("passive", stepper_of(&passive, &loads)),
        ("dry", stepper_of(&dry, &[])),
        ("ramp", stepper_of(SOFT, &["start.kind=ramp", "start.ramp_s=0.1"])),
        ("clamped", stepper_of(SOFT, &["head.kind=clamped", loads[0], loads[1]])),
        ("driven", stepper_of(SOFT, &[head[0], head[1], head[2], "solver.integrator=newmark"])),
        ("moments", stepper_of(&soft_moments(), &["head.kind=clamped", "rod.damping_time_s=0.01"])),
    ]
}

#[test]
fn what_a_host_holds_goes_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Stepper>();
    shared::<caudal::stepper::Snapshot>();
    shared::<caudal::scene::Scene>();
    shared::<caudal::model::Model>();
    shared::<caudal::sensitivity::Problem>();
    shared::<caudal::sensitivity::simulation::Simulation>();
    shared::<Error>();
}

/// Everything but the counts of work, to the bit.
fn bits(stepper: &Stepper) -> Vec<(&'static str, Vec<u64>)> {
    let variables = stepper.variables().iter();
    let bits = |name| stepper.get(name).unwrap().iter().map(|x: &f64| x.to_bits()).collect();
    variables.map(|variable| (variable.name, bits(variable.name))).collect()
}

fn assert_same(a: &Stepper, b: &Stepper, what: &str) {
    assert_eq!(a.state(), b.state(), "{what}");
    for (a, b) in bits(a).into_iter().zip(bits(b)) {
        assert_eq!(a, b, "{what}");
    }
}

/// Sets every input to something near what a scene of this size can bear.
fn play(stepper: &mut Stepper, dice: &mut Dice) {
    for variable in stepper.variables().to_vec() {
        let size = match variable.name {
            "actuation_amplitude" => 3.0,
            "actuation_moment_n_m" => 10.0,
            "active_moment_n_m" => 0.5,
            "actuation_frequency_hz" => 2.0,
            "actuation_phase_rad" => 0.5,
            "natural_curvature_1_m" => 0.5,
            "force_x_n" | "force_y_n" => 0.2,
            "viscosity_pa_s" => 5.0,
            "flow_x_m_s" | "flow_y_m_s" => 0.1,
            "head_x_m" | "head_y_m" | "head_angle_rad" => 1e-3,
            "head_vx_m_s" | "head_vy_m_s" | "head_spin_rad_s" => 1e-2,
            "head_ax_m_s2" | "head_ay_m_s2" | "head_spin_rate_rad_s2" => 0.1,
            name => {
                assert_ne!(variable.causality, Causality::Input, "{name} is not played");
                continue;
            }
        };
        // Now and then one is left alone.
        if dice.between(0.0, 1.0) < 0.3 {
            continue;
        }
        let low = if variable.name.starts_with("actuation") || variable.name.starts_with("visc") {
            0.5 * size
        } else {
            -size
        };
        let values = dice.many(variable.len(stepper.model()), low, size);
        stepper.set(variable.name, &values).unwrap();
    }
}

#[test]
fn one_step_of_two_parts_is_two_steps_of_one_to_the_bit() {
    for (name, mut whole) in kinds() {
        let start = whole.save();
        let dt = whole.get_scalar("time_step_s").unwrap();
        whole.do_step(2.0 * dt).unwrap();
        let (end, counts) = (whole.state().clone(), whole.work());
        let mut split = whole;
        let whole = bits(&split);
        split.restore(&start).unwrap();
        split.do_step(dt).unwrap();
        split.do_step(dt).unwrap();
        assert_eq!((&end, counts), (split.state(), split.work()), "{name}");
        assert_eq!(whole, bits(&split), "{name}");
    }
}

#[test]
fn a_step_of_many_parts_is_as_many_steps_to_the_bit_from_any_multiple_of_the_internal_step() {
    let (mut whole, mut split) = (stepper_of(STUDY, &[]), stepper_of(STUDY, &[]));
    for parts in [3, 1, 7, 20] {
        whole.do_step(f64::from(parts) * 5e-3).unwrap();
        for _ in 0..parts {
            split.do_step(5e-3).unwrap();
        }
        assert_same(&whole, &split, &format!("{parts} parts"));
    }
}

#[test]
fn a_step_of_any_length_ends_exactly_at_its_end_in_the_fewest_equal_parts() {
    let mut dice = Dice(3);
    for _ in 0..100 {
        let mut stepper = stepper_of(SOFT, &["rod.nodes=3"]);
        stepper.do_step(dice.between(1e-4, 5e-3)).unwrap();
        let (t, before) = (stepper.time(), stepper.metrics().totals.steps);
        let h = 2e-3 * dice.between(0.01, 6.0);
        stepper.do_step(h).unwrap();
        assert_eq!(stepper.time(), t + h, "{h}");
        assert_eq!((stepper.metrics().totals.steps - before) as f64, (h / 2e-3 - 1e-9).ceil(), "{h}");
    }
}

#[test]
fn the_parts_of_a_step_are_equal() {
    // A head is, at the end of each part, where the scene has it at that time.
    let head = r#"head={ kind = "driven", position_m = { amplitude = [0.01, 0.03], frequency_hz = 2.0 } }"#;
    let mut whole = stepper_of(SOFT, &[head, "rod.nodes=3"]);
    let mut parts = stepper_of(SOFT, &[head, "rod.nodes=3"]);
    let h = 5e-3; // 2.5 steps: three parts
    whole.do_step(h).unwrap();
    (0..3).for_each(|_| parts.do_step(h / 3.0).unwrap());
    let worst = common::largest(whole.state().q.iter().zip(&parts.state().q).map(|(a, b)| a - b));
    // Rounding alone.
    assert!(worst < 1e-16, "{worst:e}");
}

#[test]
fn time_never_drifts() {
    // 0.1 s and its multiples are not binary fractions; summed 20 000 times they would be 1e-9 s off.
    let mut stepper = stepper_of(SOFT, &["rod.nodes=3", "solver.time_step_s=0.1", "actuation.kappa_amp=0.0"]);
    let mut sum = 0.0;
    for n in 1..=20_000 {
        stepper.do_step(0.1).unwrap();
        sum += 0.1;
        assert_eq!(stepper.time(), f64::from(n) * 0.1, "{n}");
    }
    assert!((sum - stepper.time()).abs() > 1e-10, "summing drifts");
    // A multiple after an odd step counts from there.
    stepper.do_step(0.03).unwrap();
    let origin = stepper.time();
    for n in 1..=1000 {
        stepper.do_step(0.2).unwrap();
        assert_eq!(stepper.time(), origin + f64::from(2 * n) * 0.1, "{n}");
    }
}

#[test]
fn a_snapshot_brings_back_every_bit_at_any_time_and_after_any_input() {
    for (name, mut stepper) in kinds() {
        for seed in 0..10 {
            let mut dice = Dice(seed);
            let go = |stepper: &mut Stepper, seed: u64| {
                let mut dice = Dice(seed);
                for _ in 0..3 {
                    play(stepper, &mut dice);
                    stepper.do_step(dice.between(1e-4, 8e-3)).unwrap();
                }
            };
            go(&mut stepper, dice.0.wrapping_add(100));
            if dice.between(0.0, 1.0) < 0.5 {
                play(&mut stepper, &mut dice); // saved between an input and its step
            }
            let snapshot = stepper.save();
            let saved = bits(&stepper);
            go(&mut stepper, 7 * seed);
            let (state, end) = (stepper.state().clone(), bits(&stepper));
            stepper.restore(&snapshot).unwrap();
            assert_eq!(bits(&stepper), saved, "{name}, {seed}");
            go(&mut stepper, 7 * seed);
            assert_eq!(*stepper.state(), state, "{name}, {seed}");
            assert_eq!(bits(&stepper), end, "{name}, {seed}");
        }
    }
}

#[test]
fn a_snapshot_keeps_a_step_that_is_too_short_to_be_made_alone() {
    for ((name, mut one), (_, mut other)) in kinds().into_iter().zip(kinds()) {
        one.do_step(0.01).unwrap();
        let made = one.time();
        one.do_step(4e-15).unwrap();
        assert!(one.time() > made && one.state().t == made, "{name}: it waits for the next one");
        other.restore(&one.save()).unwrap();
        assert_eq!(other.time(), one.time(), "{name}");
        for stepper in [&mut one, &mut other] {
            stepper.do_step(0.004).unwrap();
        }
        assert_eq!(one.state().t, made + 4e-15 + 0.004, "{name}: what waited is made up for");
        assert_same(&one, &other, name);
    }
}

#[test]
fn a_snapshot_goes_on_in_another_stepper_of_the_same_scene() {
    for ((name, mut one), (_, mut other)) in kinds().into_iter().zip(kinds()) {
        let mut dice = Dice(5);
        play(&mut one, &mut dice);
        one.do_step(0.011).unwrap();
        play(&mut one, &mut dice);
        // The other has been elsewhere, with inputs of its own.
        play(&mut other, &mut dice);
        other.do_step(0.004).unwrap();
        other.restore(&one.save()).unwrap();
        assert_same(&one, &other, name);
        for stepper in [&mut one, &mut other] {
            stepper.do_step(0.02).unwrap();
        }
        assert_same(&one, &other, name);
    }
}

#[test]
fn a_snapshot_brings_back_every_bit_after_a_failed_step() {
    for overrides in [&[][..], &["head.kind=driven"]] {
        let mut stepper = stepper_of(STUDY, overrides);
        stepper.set("force_y_n", &[0.1; 9]).unwrap();
        stepper.do_step(0.01).unwrap();
        let snapshot = stepper.save();
        stepper.do_step(0.02).unwrap();
        let (state, end) = (stepper.state().clone(), bits(&stepper));
        // Some steps fail at once, some on the way.
        for push in [1e12, 1e200] {
            stepper.restore(&snapshot).unwrap();
            stepper.set("force_x_n", &[-push; 9].map(|x| x * 0.3)).unwrap();
            let mut tip = [0.0; 9];
            tip[8] = -push;
            stepper.set("force_x_n", &tip).unwrap();
            assert!(stepper.do_step(0.02).is_err());
            stepper.restore(&snapshot).unwrap();
            stepper.do_step(0.02).unwrap();
            assert_eq!(*stepper.state(), state);
            assert_eq!(bits(&stepper), end);
        }
    }
}

#[test]
fn a_snapshot_of_another_scene_is_refused_and_changes_nothing() {
    let mut soft = stepper_of(SOFT, &[]);
    let before = bits(&soft);
    for other in ["rod.nodes=5", "medium.viscosity_pa_s=1.1", "start.spin_rad_s=1e-9"] {
        let refused = soft.restore(&stepper_of(SOFT, &[other]).save());
        assert!(matches!(refused, Err(Error::Snapshot(_))), "{other}: {refused:?}");
        assert_eq!(bits(&soft), before, "{other}");
    }
}

#[test]
fn without_a_scene_a_snapshot_of_another_model_is_refused_and_changes_nothing() {
    let made = |nodes: u64| {
        let scene = common::scene_of(SOFT, &[]).with_nodes(nodes);
        let (model, newton) =
            (scene.model().unwrap(), Newton::with(Form::Positions, SolverChoice::Auto, nodes as usize, 1e-10));
        Stepper::init(model, scene.integrator().unwrap(), newton.unwrap(), 2e-3).unwrap()
    };
    let (mut nine, five) = (made(9), made(5));
    let before = bits(&nine);
    assert!(matches!(nine.restore(&five.save()), Err(Error::Snapshot(_))));
    assert_eq!(bits(&nine), before);
    assert_eq!(nine.restore(&made(9).save()), Ok(()));
}

#[test]
fn the_bytes_of_a_snapshot_are_refused_by_any_other_scene_and_taken_by_the_same_one_wherever_it_stands() {
    let scene = common::scene_of(SOFT, &[]);
    let stepper = Stepper::of(&scene).unwrap();
    let bytes = stepper.save().serialize().unwrap();
    let newmark = Method::named("newmark").unwrap();
    let others = [
        ("nodes", scene.with_nodes(11)),
        ("whole", scene.reference()),
        ("duration", scene.with_duration(0.123)),
        ("pace", scene.with_step_control(StepControl::Fixed(1e-3))),
        ("method", scene.with_method(newmark, &newmark.defaults())),
        ("model", scene.with_model(MODELS[0])),
        ("modulus", scene.with_modulus(1.0 + 2.0 * f64::EPSILON)),
        ("amplitude", scene.with_amplitude(0.9)),
        ("spin", scene.with_spin(0.1)),
    ];
    for (name, other) in others {
        let mut other = Stepper::of(&other).unwrap();
        assert!(matches!(other.deserialize(&bytes), Err(Error::Snapshot(_))), "{name}");
        assert!(matches!(other.restore(&stepper.save()), Err(Error::Snapshot(_))), "{name}");
    }
    let mut document = Document::new("else/where.toml", SOFT.replace("name = \"soft\"", "name = \"other\" # said"));
    assert_eq!(Stepper::of(&document.scene().unwrap()).unwrap().deserialize(&bytes), Ok(stepper.save()));
    document.set("medium.viscosity_pa_s=1.1").unwrap();
    assert!(Stepper::of(&document.scene().unwrap()).unwrap().deserialize(&bytes).is_err());
}

#[test]
fn a_step_that_fails_at_once_leaves_state_and_measure_as_they_were_to_the_bit_whatever_the_rung() {
    for rung in MODELS {
        for pace in ["solver.time_step_s=2e-3", "solver.tolerance=1e-4"] {
            let model = format!("solver.model={}", rung.name);
            let mut stepper = stepper_of(SOFT, &["solver.integrator=esdirk3", &model, pace]);
            stepper.do_step(0.02).unwrap();
            // A shape that changes at once, and a force that no step can follow.
            stepper.set("natural_curvature_1_m", &[0.7; 7]).unwrap();
            let mut push = [0.0; 9];
            push[8] = 1e160;
            stepper.set("force_y_n", &push).unwrap();
            let (state, metrics) = (stepper.state().clone(), stepper.metrics().clone());
            for _ in 0..2 {
                let error = stepper.do_step(2e-3).unwrap_err();
                assert_eq!((stepper.state(), stepper.metrics()), (&state, &metrics), "{}, {pace}: {error}", rung.name);
            }
            // And what follows is what follows without them.
            stepper.set("force_y_n", &[0.0; 9]).unwrap();
            let snapshot = stepper.save();
            stepper.do_step(2e-3).unwrap();
            let after = stepper.state().clone();
            stepper.restore(&snapshot).unwrap();
            stepper.do_step(2e-3).unwrap();
            assert_eq!(*stepper.state(), after, "{}, {pace}", rung.name);
        }
    }
}

#[test]
fn wrong_calls_are_errors_and_change_nothing() {
    let mut stepper = stepper_of(STUDY, &["head.kind=driven"]);
    stepper.do_step(0.012).unwrap();
    let (state, before, untouched) = (stepper.state().clone(), bits(&stepper), stepper.save());
    let mut refused = |call: &dyn Fn(&mut Stepper) -> caudal::Result<()>, words: &str| {
        let error = call(&mut stepper).unwrap_err().to_string();
        assert!(error.contains(words), "{error:?} has no {words:?}");
        assert_eq!((stepper.state(), bits(&stepper)), (&state, before.clone()), "{error}");
    };
    for h in [0.0, -0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        refused(&|s| s.do_step(h), "is not possible: it must be positive and finite");
    }
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let words = format!("found {bad}; allowed: a");
        refused(&|s| s.set("actuation_amplitude", &[bad]), &words);
        refused(&|s| s.set("actuation_frequency_hz", &[bad]), &words);
        refused(&|s| s.set("viscosity_pa_s", &[bad]), &words);
        refused(&|s| s.set("head_angle_rad", &[bad]), &words);
        refused(&|s| s.set("force_x_n", &[0.0, 1.0, 2.0, bad, 4.0, 5.0, 6.0, 7.0, 8.0]), &words);
    }
    for name in ["viscosity_pa_s", "actuation_frequency_hz"] {
        refused(&|s| s.set(name, &[-1e-9]), "allowed: a number that is not negative");
    }
    for name in ["natural_curvature_1_m", "actuation_amplitude", "flow_x_m_s"] {
        let count = if name.starts_with("natural") { 8 } else { 1 };
        refused(&|s| s.set(name, &vec![1e200; count]), "energy or power is not finite at node");
    }
    refused(&|s| s.set("viscosity", &[1.0]), "no variable `viscosity` in this scene; did you mean `viscosity_pa_s`?");
    refused(&|s| s.set("head_z_m", &[1.0]), "did you mean `head_");
    refused(&|s| s.set("qqqq", &[1.0]), "no variable `qqqq` in this scene; `caudal variables SCENE` lists them");
    refused(&|s| s.set("", &[1.0]), "no variable `` in this scene");
    refused(&|s| s.get("x_comm").map(|_| ()), "did you mean `x_com_m`?");
    refused(&|s| s.get_scalar("x_comm").map(|_| ()), "did you mean `x_com_m`?");
    refused(&|s| s.set("viscosity_pa_s", &[]), "has 1 values, not 0");
    refused(&|s| s.set("viscosity_pa_s", &[1.0, 2.0]), "has 1 values, not 2");
    refused(&|s| s.set("force_x_n", &[1.0]), "`force_x_n` has 9 values, not 1");
    refused(&|s| s.set("natural_curvature_1_m", &[0.0; 9]), "has 8 values, not 9");
    refused(&|s| s.set("x_com_m", &[1.0]), "`x_com_m` is not an input");
    refused(&|s| s.set("time_s", &[1.0]), "`time_s` is not an input");
    refused(&|s| s.set("length_m", &[1.0]), "`length_m` is not an input");
    // Nor does it change what follows.
    stepper.do_step(0.02).unwrap();
    let after = bits(&stepper);
    stepper.restore(&untouched).unwrap();
    stepper.do_step(0.02).unwrap();
    assert_eq!(bits(&stepper), after);
}

#[test]
fn variables_of_parts_that_a_scene_has_not_are_not_there() {
    let has = |kind: &str, name: &str| kinds().iter().any(|(k, s)| *k == kind && s.get(name).is_ok());
    for (name, with, without) in [
        ("actuation_amplitude", "soft", "passive"),
        ("viscosity_pa_s", "soft", "dry"),
        ("flow_x_m_s", "soft", "dry"),
        ("head_force_x_n", "clamped", "soft"),
        ("head_x_m", "driven", "soft"),
    ] {
        assert!(has(with, name) && !has(without, name), "{name}");
    }
}

#[test]
fn a_host_reads_the_efficiency_of_a_held_head_in_a_stream() {
    let text = include_str!("../../models/driven-head.toml");
    for (flow, some) in [("[0.1, 0.0]", true), ("[0.0, 0.0]", false)] {
        let mut tail = stepper_of(text, &[&format!("medium.flow_m_s={flow}")]);
        assert_eq!(tail.get_scalar("cycle_efficiency").unwrap(), 0.0); // no cycle is over
        tail.do_step(1.5).unwrap();
        let read = |name: &str| tail.get_scalar(name).unwrap();
        let power = read("cycle_actuation_power_w") + read("cycle_head_power_w");
        let (found, expected) = (read("cycle_efficiency"), read("cycle_thrust_n") * 0.1 / power);
        println!("{flow}: {found} for {expected}");
        // The mean over cycles of quotients, for the quotient of means.
        let close = (found - expected).abs() <= 1e-2 * expected.abs();
        assert!(if some { close && found != 0.0 } else { found == 0.0 }, "{flow}: {found} for {expected}");
    }
}

/// The suffix of a name for a unit: `N m^2` becomes `_n_m2`, `1/m` becomes `_1_m`.
#[test]
fn a_variable_that_a_scene_has_not_is_told_with_what_it_needs() {
    let stepper = stepper_of(SOFT, &[]);
    let missing: Vec<_> = VARIABLES.iter().filter(|variable| !variable.exists_in(stepper.model())).collect();
    for variable in &missing {
        let told = stepper.get(variable.name).unwrap_err().to_string();
        let start = format!("there is no variable `{}` in this scene: it needs ", variable.name);
        assert!(told.starts_with(&start) && told.len() > start.len() + 5, "{told}");
    }
    assert!(missing.len() > 30, "{}", missing.len());
    let held = stepper.get("head_force_x_n").unwrap_err().to_string();
    assert!(held.ends_with("it needs a held head: [head] with kind = \"clamped\", \"driven\" or \"hinged\""), "{held}");
    let misspelt = stepper.get("tip_x").unwrap_err().to_string();
    assert_eq!(misspelt, "there is no variable `tip_x` in this scene; did you mean `tip_x_m`?");
}

fn suffix(unit: &str) -> String {
    format!("_{}", unit.replace('^', "").replace(['/', ' '], "_").to_lowercase())
}

#[test]
fn names_are_unique_and_end_in_their_unit_and_every_variable_is_described() {
    let names: HashSet<_> = VARIABLES.iter().map(|variable| variable.name).collect();
    assert_eq!(names.len(), VARIABLES.len());
    for variable in VARIABLES {
        let name = variable.name;
        assert!(name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'), "{name}");
        assert!(!variable.description.trim().is_empty() && !variable.unit.is_empty(), "{name}");
        if variable.unit != "1" {
            assert!(name.ends_with(&suffix(variable.unit)), "{name} is in {}", variable.unit);
        }
    }
    // Every name that ends like a unit has that unit.
    for (ending, unit) in
        [("_m", "m"), ("_s", "s"), ("_j", "J"), ("_w", "W"), ("_rad", "rad"), ("_hz", "Hz"), ("_kg", "kg")]
    {
        for variable in VARIABLES.iter().filter(|variable| variable.name.ends_with(ending)) {
            assert!(suffix(variable.unit).ends_with(ending), "{} is in {}, not {unit}", variable.name, variable.unit);
        }
    }
}

#[test]
fn every_variable_of_every_kind_of_scene_is_finite_before_and_after_steps() {
    for (name, mut stepper) in kinds() {
        for _ in 0..2 {
            for variable in stepper.variables() {
                let values = stepper.get(variable.name).unwrap();
                assert_eq!(values.len(), variable.len(stepper.model()));
                assert!(!values.is_empty() && values.iter().all(|x| x.is_finite()), "{name}: {}", variable.name);
                assert_eq!(stepper.get_scalar(variable.name), Ok(values[0]), "{name}: {}", variable.name);
            }
            stepper.do_step(0.05).unwrap();
        }
    }
}

#[test]
fn every_input_can_be_set_and_is_read_back_and_no_other_input_changes() {
    for (name, mut stepper) in kinds() {
        let inputs: Vec<_> = stepper.variables().iter().copied().filter(|v| v.causality == Causality::Input).collect();
        assert!(inputs.len() >= 3);
        stepper.do_step(2e-3).unwrap(); // before, a pose of the head places the rod there, at rest
        for variable in &inputs {
            let others = |s: &Stepper| {
                let others = inputs.iter().filter(|other| other.name != variable.name);
                others.map(|other| s.get(other.name).unwrap()).collect::<Vec<_>>()
            };
            let before = others(&stepper);
            let values = Dice(1).many(variable.len(stepper.model()), 0.001, 0.002);
            stepper.set(variable.name, &values).unwrap();
            assert_eq!(stepper.get(variable.name).unwrap(), values, "{name}: {}", variable.name);
            assert_eq!(others(&stepper), before, "{name}: {}", variable.name);
        }
        stepper.do_step(2e-3).unwrap();
        for variable in &inputs {
            let values = Dice(1).many(variable.len(stepper.model()), 0.001, 0.002);
            assert_eq!(stepper.get(variable.name).unwrap(), values, "{name}: {} is held", variable.name);
        }
    }
}

#[test]
fn a_change_of_frequency_keeps_the_phase() {
    // With the rod held still, the bending energy is a function of the natural curvature alone.
    for changes in [&[5.0][..], &[0.0, 1.5], &[3.0, 0.25, 40.0]] {
        let mut stepper = stepper_of(SOFT, &[]);
        stepper.do_step(0.237).unwrap();
        let before = (stepper.get_scalar("bending_energy_j").unwrap(), stepper.metrics().totals.work);
        for frequency in changes {
            stepper.set("actuation_frequency_hz", &[*frequency]).unwrap();
        }
        let after = stepper.get_scalar("bending_energy_j").unwrap();
        // Measured: 0, and 0 for the work.
        assert!((after / before.0 - 1.0).abs() < 1e-13, "{changes:?}: {after} {}", before.0);
        let work = stepper.metrics().totals.work.actuation - before.1.actuation;
        assert!(work.abs() < 1e-13 * before.0, "{changes:?}: {work}");
        // The new frequency drives from now on: power is 2πf times a function of the phase.
        let power = stepper.get_scalar("actuation_power_w").unwrap();
        stepper.set("actuation_frequency_hz", &[2.0]).unwrap();
        let twice = stepper.get_scalar("actuation_power_w").unwrap();
        let last = changes[changes.len() - 1];
        // Measured: 7.7e-17.
        assert!((power - twice * last / 2.0).abs() < 1e-13 * twice.abs() * last.max(1.0), "{changes:?}");
    }
}

#[test]
fn inputs_hold_over_a_step_of_many_parts() {
    let (mut once, mut often) = (stepper_of(SOFT, &[]), stepper_of(SOFT, &[]));
    let inputs: [(&str, Vec<f64>); 4] = [
        ("force_y_n", vec![0.3; 9]),
        ("natural_curvature_1_m", vec![0.7; 7]),
        ("viscosity_pa_s", vec![2.0]),
        ("flow_x_m_s", vec![0.3]),
    ];
    for (name, values) in &inputs {
        once.set(name, values).unwrap();
    }
    once.do_step(10.0 * 2e-3).unwrap();
    for _ in 0..10 {
        for (name, values) in &inputs {
            often.set(name, values).unwrap();
        }
        often.do_step(2e-3).unwrap();
    }
    assert_same(&once, &often, "held inputs");
}

#[test]
fn a_heads_targets_are_reached_at_the_end_of_the_step_where_the_scene_says_so() {
    let mut stepper = stepper_of(SOFT, &["head.kind=driven", "head.input=at-end"]);
    stepper.set("head_x_m", &[4e-3]).unwrap();
    stepper.set("head_angle_rad", &[0.02]).unwrap();
    assert_eq!(stepper.get_scalar("head_dx_m").unwrap(), 0.0);
    stepper.do_step(8e-3).unwrap();
    // Measured: 0.
    let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-15, "{found} {expected}");
    close(stepper.state().q[0], 4e-3);
    // Nothing says that it moves on.
    close(stepper.state().v[0], 0.0);
    stepper.set("head_x_m", &[5e-3]).unwrap();
    stepper.set("head_vx_m_s", &[0.3]).unwrap();
    stepper.do_step(8e-3).unwrap();
    close(stepper.state().q[0], 5e-3);
    close(stepper.state().v[0], 0.3);
}
