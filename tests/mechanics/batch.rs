//! Several cases in lanes: the bits of each alone, whoever is beside it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a failure ends the test")]

use crate::common;
use std::ops::ControlFlow;
use std::path::Path;

use caudal::batch::{Batch, WIDTH, do_step_with};
use caudal::fluid::laws::{Dependence, LAWS};
use caudal::integrator::METHODS;
use caudal::run::{BatchedRun, Ending, run, run_batched};
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::variable::{Causality, Variable};

use common::{Dice, all_scene_files, scene, scene_of, time_step};

/// The study's tail in a fluid whose drag is in proportion to the velocity.
const IN_FLUID: &[&str] = &["medium.viscosity_pa_s=1.0", "medium.density_kg_m3=1260.0"];

/// A wave for a tail that has none.
const WAVE: &[&str] = &[
    "actuation.kind=travelling-wave",
    "actuation.kappa_amp=0.6",
    "actuation.frequency_hz=2.0",
    "actuation.wavelength_m=1.0",
];

/// What acts on a tail in no fluid.
const NO_FLUID: &[&str] = &["loads.gravity_m_s2=[0.0, -9.81]"];

/// The study's tail, in no fluid where the `changes` say nothing of one.
fn baseline(changes: &[&str]) -> Scene {
    if !changes.iter().any(|change| change.starts_with("medium")) {
        return scene(&[WAVE, changes].concat());
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/baseline.toml");
    scene_of(&std::fs::read_to_string(path).unwrap(), changes)
}

/// True where this machine has lanes of four.
fn lanes() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// All that a run leaves: its state and what was measured, to the bit.
fn left(stepper: &Stepper) -> String {
    format!("{:?} {:?} {:?} {:?}", stepper.state(), stepper.work(), stepper.metrics(), stepper.cycles())
}

/// Runs `scenes` alone and side by side; the number of halved steps, and whether they were taken in lanes.
fn compare(scenes: &[Scene], what: &str) -> (u64, bool) {
    let alone: Vec<(Stepper, Ending)> = scenes
        .iter()
        .map(|scene| {
            let mut stepper = Stepper::of(scene).unwrap();
            let ending = run(scene, &mut stepper, |_| Ok(ControlFlow::Continue(()))).ending;
            (stepper, ending)
        })
        .collect();
    let mut runs: Vec<BatchedRun<'_>> =
        scenes.iter().map(|scene| BatchedRun { scene, stepper: Stepper::of(scene).unwrap() }).collect();
    let steppers: Vec<&Stepper> = runs.iter().map(|run| &run.stepper).collect();
    let taken = Batch::of(&steppers).is_some();
    let outcomes = run_batched(&mut runs, |_, _| Ok(ControlFlow::Continue(())));
    for (i, ((run, outcome), (stepper, ending))) in runs.iter().zip(&outcomes).zip(&alone).enumerate() {
        assert_eq!(outcome.ending, *ending, "{what}, case {i}");
        assert_eq!(left(&run.stepper), left(stepper), "{what}, case {i}");
    }
    (alone.iter().map(|(stepper, _)| stepper.metrics().totals.halvings).sum(), taken)
}

#[test]
fn every_scene_has_the_same_bits_beside_others_as_alone() {
    let mut taken = 0;
    for path in all_scene_files() {
        let text = std::fs::read_to_string(&path).unwrap();
        let own = Scene::load(&path).unwrap();
        let step = own.solver.time_step_s.map_or(1e-3, |_| time_step(&own));
        let duration = format!("solver.duration_s={:e}", 24.5 * step); // the last step is a shorter one
        let scenes: Vec<Scene> = [1.0, 0.9, 1.2, 0.7]
            .iter()
            .map(|factor| {
                let mut document = Document::new(&path, &text);
                document.set(&duration).unwrap();
                let measured = own.rod.bending_stiffness_n_m2.as_ref().map(|stiffness| stiffness.profile().at(0.5));
                let modulus = || ("youngs_modulus_pa", own.rod.youngs_modulus());
                let (key, stiffness) = measured.map_or_else(modulus, |stiffness| ("bending_stiffness_n_m2", stiffness));
                document.set(&format!("rod.{key}={:e}", factor * stiffness)).unwrap();
                document.scene().unwrap()
            })
            .collect();
        taken += u32::from(compare(&scenes, &path.display().to_string()).1);
    }
    assert!(taken >= 8 || !lanes(), "{taken} scenes were taken in lanes");
}

#[test]
fn every_method_head_and_load_has_the_same_bits_beside_others_as_alone() {
    let heads: [&[&str]; 3] = [
        &[],
        &["head.kind=\"clamped\""],
        &[
            "head.kind=\"driven\"",
            "head.position_m={ amplitude = [0.0, 0.01], frequency_hz = 1.0 }",
            "head.angle_rad={ amplitude = 0.1, frequency_hz = 1.0 }",
        ],
    ];
    let around: [&[&str]; 3] = [
        IN_FLUID,
        NO_FLUID,
        &["medium.viscosity_pa_s=0.5", "medium.flow_m_s=[0.05, 0.02]", "loads.gravity_m_s2=[0.0, -0.2]"],
    ];
    let materials: [&[&str]; 3] = [
        &[],
        &["rod.damping_time_s=1e-4"],
        &["rod.damping_time_s={ stretch = [[0.0, 1e-5], [1.0, 2e-5]], bending = 0.02 }", "rod.damping_of=elastic"],
    ];
    for method in METHODS.iter().filter(|method| method.implicit) {
        let kinds = heads.iter().flat_map(|head| around.iter().map(move |around| (head, around)));
        for ((head, around), material) in kinds.flat_map(|kind| materials.iter().map(move |material| (kind, material)))
        {
            let named = format!("solver.integrator=\"{}\"", method.name);
            let common = [&named, "solver.duration_s=0.02", "solver.time_step_s=5e-4"];
            let changes = |amplitude: &str| baseline(&[&common, *head, *around, *material, &[amplitude]].concat());
            let amplitudes = ["0.4", "0.8", "1.2", "1.0"].map(|k| format!("actuation.kappa_amp={k}"));
            let scenes: Vec<Scene> = amplitudes.iter().map(|amplitude| changes(amplitude)).collect();
            for width in 2..=WIDTH {
                let what = format!("{named} {head:?} {around:?} {material:?}, {width} cases");
                let (_, taken) = compare(&scenes[..width], &what);
                assert_eq!(taken, lanes() && method.name != "esdirk3", "{what}");
            }
        }
    }
}

/// One number of each case differs: every one of them has its own lane.
#[test]
fn cases_of_other_damping_beside_each_other_have_the_bits_they_have_alone() {
    let scenes: Vec<Scene> = ["1e-5", "1e-3", "{ stretch = 1e-4, bending = [[0.0, 1e-3], [1.0, 1e-2]] }", "2e-3"]
        .iter()
        .map(|time| {
            let time = format!("rod.damping_time_s={time}");
            baseline(&[IN_FLUID, &["solver.duration_s=0.05", "solver.time_step_s=1e-3", &time]].concat())
        })
        .collect();
    assert_eq!(compare(&scenes, "damping").1, lanes());
}

#[test]
fn every_local_law_is_taken_with_the_water_around_and_without_and_has_the_same_bits() {
    let heads: [&[&str]; 2] = [&[], &["head.kind=\"clamped\""]];
    let local = LAWS.iter().filter(|law| matches!(law.reach, Dependence::Edge) && law.name != "auto");
    for (law, head) in local.flat_map(|law| heads.iter().map(move |head| (law, head))) {
        let named = format!("drag.law=\"{}\"", law.name);
        let values = [("along_n_s_m2", "0.4"), ("across_n_s_m2", "0.9"), ("ratio", "2.0"), ("height_m", "0.05")];
        let needed = |key: &&str| values.iter().find(|(name, _)| name == key).map(|(_, value)| value);
        let needs: Vec<String> = law.needs.iter().map(|key| format!("drag.{key}={}", needed(key).unwrap())).collect();
        let needs: Vec<&str> = needs.iter().map(String::as_str).collect();
        for reactive in [&[][..], &["reactive.shedding=1.0"]] {
            let water = ["medium.viscosity_pa_s=0.1", "medium.density_kg_m3=1000.0", "medium.flow_m_s=[0.05, 0.02]"];
            let common = ["solver.duration_s=0.05", "solver.time_step_s=1e-3", &named];
            let changes = [&water[..], &common, &needs, reactive, head].concat();
            let scenes = ["0.4", "0.5", "0.6", "0.7"].map(|amplitude| {
                let amplitude = format!("actuation.kappa_amp={amplitude}");
                scene(&[WAVE, &changes, &[&amplitude]].concat())
            });
            let (_, taken) = compare(&scenes, &format!("{} {reactive:?} {head:?}", law.name));
            assert_eq!(taken, lanes(), "{} {reactive:?} {head:?}", law.name);
        }
    }
}

#[test]
fn a_case_that_halves_its_steps_or_fails_leaves_those_beside_it_as_they_are() {
    let at = |amplitude: f64, step: &str| {
        baseline(&[IN_FLUID, &[&format!("actuation.kappa_amp={amplitude}"), step, "solver.duration_s=0.2"]].concat())
    };
    let scenes: Vec<Scene> = [0.5, 5.0, 40.0, 0.8].iter().map(|k| at(*k, "solver.time_step_s=1e-2")).collect();
    let (halvings, taken) = compare(&scenes, "coarse steps");
    assert!(halvings > 0, "no step was halved");
    assert_eq!(taken, lanes());
}

#[test]
fn steps_are_solved_ahead_and_those_of_changed_inputs_are_not_taken() {
    if !lanes() {
        return;
    }
    let scene = baseline(IN_FLUID);
    let step = time_step(&scene);
    let mut alone = Stepper::of(&scene).unwrap();
    let mut cases = [Stepper::of(&scene).unwrap(), Stepper::of(&scene).unwrap()];
    let mut batch = Batch::of(&cases.each_ref()).unwrap();
    let changes = [("actuation_amplitude", 0.3), ("viscosity_pa_s", 0.7), ("force_y_n", 0.1)];
    for i in 0..60 {
        batch.presolve(&mut cases.each_mut().map(Some));
        if i == 9 {
            assert!(batch.steps() >= 18, "{} of 20 steps were solved ahead", batch.steps());
        }
        if let (10.., 0, Some((name, value))) = (i, i % 10, changes.get((i / 10usize).wrapping_sub(1))) {
            for stepper in [&mut alone, &mut cases[0]] {
                let count = stepper.get(name).unwrap().len();
                stepper.set(name, &vec![*value; count]).unwrap();
            }
        }
        alone.do_step(step).unwrap();
        cases.iter_mut().for_each(|case| case.do_step(step).unwrap());
        assert_eq!(left(&cases[0]), left(&alone), "step {i}");
    }
    assert!(left(&cases[1]) != left(&alone));
}

/// Random values of `variable`, or of its rate: near the present ones, and of a size that bends or moves a rod a little where these are zero.
fn values_near(dice: &mut Dice, stepper: &Stepper, variable: &Variable) -> Vec<f64> {
    let size = match variable.name {
        name if name.starts_with("force") => 1e-3 * stepper.model().rod.total_mass(),
        name if name.starts_with("natural") => 0.3 / stepper.model().rod.length,
        name if name.starts_with("active_moment") => 0.1 * stepper.model().rod.joint[2] / stepper.model().rod.length,
        _ => 1e-3,
    };
    let near = |x: &f64| x * dice.between(0.9, 1.1) + size * dice.between(-1.0, 1.0);
    stepper.get(variable.name).unwrap().iter().map(near).collect()
}

/// Copies of a scene that take random communication steps in turns, beside as many that take them alone: inputs of their own, with `rates`
/// their rates too, a restart now and then, and a curvature now and then that ends the step with an error. Returns how many internal steps
/// there were, how many of them were solved in lanes, and how many communication steps failed.
fn in_turns(scene: &Scene, step: f64, (seed, width): (u64, usize), rates: bool) -> [u64; 3] {
    let mut dice = Dice(seed);
    let make = || -> Vec<Stepper> { (0..width).map(|_| Stepper::of(scene).unwrap()).collect() };
    let (mut alone, mut together) = (make(), make());
    let start = alone[0].save();
    let mut batch = Batch::of(&together.iter().collect::<Vec<_>>());
    let (mut internal, mut failures) = (0, 0);
    for round in 0..14 {
        let h = step * [1.0, 3.0, 2.5, 4.0, 0.3, 5.0][(dice.between(0.0, 6.0) as usize).min(5)];
        for (one, other) in alone.iter_mut().zip(&mut together) {
            if dice.between(0.0, 1.0) < 0.1 {
                one.restore(&start).unwrap();
                other.restore(&start).unwrap();
            }
            let inputs = one.variables().iter().filter(|variable| variable.causality == Causality::Input);
            let inputs: Vec<&Variable> = inputs.copied().collect();
            for variable in inputs {
                let chance = dice.between(0.0, 1.0);
                let mut values = values_near(&mut dice, one, variable);
                if variable.name == "natural_curvature_1_m" && chance > 0.97 {
                    values.iter_mut().step_by(2).for_each(|x| *x = 1e5);
                }
                if (0.15..0.85).contains(&chance) && variable.name != "natural_curvature_1_m" {
                    continue;
                }
                let order = usize::from(rates && (0.1..0.15).contains(&chance));
                let set = |stepper: &mut Stepper| match order {
                    0 => stepper.set(variable.name, &values),
                    _ => stepper.set_derivative(variable.name, order, &values),
                };
                assert_eq!(format!("{:?}", set(one)), format!("{:?}", set(other)));
            }
        }
        let moving: Vec<bool> = (0..width).map(|_| dice.between(0.0, 1.0) < 0.9).collect();
        let stops = (0..width).map(|_| if dice.between(0.0, 1.0) < 0.1 { 2 } else { u64::MAX });
        let stops: Vec<u64> = stops.collect();
        let look = |seen: &mut u64, stop: u64| {
            *seen += 1;
            if *seen == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let mut seen = [[0; WIDTH]; 2];
        let mut going = together.iter_mut().zip(&moving).map(|(stepper, moves)| moves.then_some(stepper));
        let mut going: Vec<Option<&mut Stepper>> = going.by_ref().collect();
        let outcomes = do_step_with(batch.as_mut(), &mut going, h, |i, _| look(&mut seen[0][i], stops[i]));
        for i in (0..width).filter(|i| moving[*i]) {
            let expected = alone[i].do_step_with(h, |_| look(&mut seen[1][i], stops[i]));
            let what = format!("{}, step {round} of {h} s, copy {i}", scene.name);
            assert_eq!(format!("{:?}", outcomes[i]), format!("{expected:?}"), "{what}");
            assert_eq!(left(&together[i]), left(&alone[i]), "{what}");
            assert_eq!(together[i].time(), alone[i].time(), "{what}");
            assert_eq!(together[i].take_head_jump(), alone[i].take_head_jump(), "{what}");
            failures += u64::from(expected.is_err());
        }
        assert_eq!(seen[0], seen[1]);
        internal += seen[1].iter().sum::<u64>();
    }
    for (one, other) in alone.iter().zip(&together) {
        for variable in one.variables() {
            let read =
                |stepper: &Stepper| stepper.get(variable.name).unwrap().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(read(one), read(other), "{}, {}", scene.name, variable.name);
        }
        assert_eq!(one.save().serialize().unwrap(), other.save().serialize().unwrap(), "{}", scene.name);
    }
    [internal, batch.map_or(0, |batch| batch.steps()), failures]
}

#[test]
fn communication_steps_in_turns_have_the_bits_of_those_alone_whatever_the_inputs_and_times() {
    let (mut taken, mut all) = (0, [0; 3]);
    for (seed, path) in all_scene_files().iter().enumerate() {
        let scene = Scene::load(path).unwrap();
        let step = scene.solver.time_step_s.map_or(1e-3, |_| time_step(&scene));
        let counts = in_turns(&scene, step, (seed as u64, WIDTH - seed % 2), true);
        taken += u32::from(counts[1] > 0);
        all.iter_mut().zip(counts).for_each(|(all, count)| *all += count);
    }
    assert!(all[2] > 0, "no step failed");
    assert!(taken >= 8 || !lanes(), "{taken} scenes were taken in lanes");
}

#[test]
fn communication_steps_of_any_fluid_load_and_head_are_solved_in_lanes_and_have_the_bits_of_those_alone() {
    let heads: [&[&str]; 3] = [
        &[],
        &["head.kind=\"clamped\"", "rod.damping_time_s=1e-4"],
        &["head.kind=\"driven\"", "head.angle_rad={ amplitude = 0.1, frequency_hz = 1.0 }"],
    ];
    let water = &["drag.law=\"cross-flow\"", "medium.viscosity_pa_s=0.1", "medium.density_kg_m3=1000.0"];
    let around: [&[&str]; 4] = [
        &["medium.viscosity_pa_s=1.0", "medium.density_kg_m3=1260.0", "loads.gravity_m_s2=[0.0, -0.2]"],
        NO_FLUID,
        &[&water[..], &["medium.flow_m_s=[0.05, 0.02]", "reactive.shedding=1.0"]].concat(),
        &["drag.law=\"weak-inertia\"", "medium.viscosity_pa_s=0.1", "medium.density_kg_m3=1000.0"],
    ];
    for (seed, (head, around)) in
        heads.iter().flat_map(|head| around.iter().map(move |around| (head, around))).enumerate()
    {
        let changes =
            [&["actuation.kappa_amp=0.4", "solver.time_step_s=1e-3", "solver.duration_s=1.0"], *head, *around];
        let scene = baseline(&changes.concat());
        let [internal, taken, _] = in_turns(&scene, 1e-3, (100 + seed as u64, WIDTH), false);
        assert!(2 * taken > internal || !lanes(), "{head:?} {around:?}: {taken} of {internal} steps");
    }
}
