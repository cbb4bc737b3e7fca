//! Media behind interfaces and sheared flows: what is known in closed form, energy, derivatives, and what is refused.

use crate::common;
use std::sync::Arc;

use caudal::fluid::medium::{LAYER_KEYS, LocalFluid, Property};
use caudal::fluid::{DENSITY, Fluid, FluidRuns, Layer, Layers, VISCOSITY};
use caudal::integrator::METHODS;
use caudal::linear::Direction;
use caudal::linear_stability::SteadyState;
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::scene::{Document, Scene};
use caudal::sensitivity::{Output, Parameter, Problem};
use caudal::start::Start;
use caudal::stepper::Stepper;
use caudal::system::{State, System};
use caudal::variable::VARIABLES;
use common::{Dice, SOFT, largest, order, run, scene_of};
use nalgebra::Vector2;

/// A bar that falls flat, without gravity, from next to nothing into water: its added mass is 0.83776 of its own, M/(M + m) is 0.54414.
const FALL: &str = r#"
[rod]
nodes = 9
length_m = 0.3
outer_radius_m = 0.01
youngs_modulus_pa = 1e9
density_kg_m3 = 1193.6621
[medium]
viscosity_pa_s = 1e-3
density_kg_m3 = 1e-9
[medium.beyond]
normal = [0.0, -1.0]
offset_m = 0.05
thickness_m = 0.05
viscosity_pa_s = 1e-3
density_kg_m3 = 1000.0
[reactive]
shedding = 0.0
[solver]
integrator = "newmark"
time_step_s = 2e-4
duration_s = 1.0
newton_tolerance = 1e-13
"#;

fn scene(text: &str, changes: &[&str]) -> Result<Scene, String> {
    let mut document = Document::new("media.toml", text);
    changes.iter().for_each(|change| document.set(change).unwrap());
    document.scene().map_err(|error| error.to_string())
}

/// The speed at which the bar that meets the interface at 1 m/s leaves it, `steps` steps later, with and without spray.
fn through(step: f64, spray: bool) -> f64 {
    let scene = scene(FALL, &[&format!("solver.time_step_s={step}")]).unwrap();
    let mut model = scene.model().unwrap();
    model.forces.0.retain(|force| spray || force.name() != "spray");
    let mut dynamics = Dynamics::new(Arc::new(model));
    let mut from = dynamics.first_state();
    from.v.as_chunks_mut::<2>().0.iter_mut().for_each(|v| v[1] = -1.0);
    let mut integrator = scene.integrator().unwrap();
    integrator.begin(&mut from);
    let mut newton = Newton::new(dynamics.nodes(), 1e-13).unwrap();
    let mut to = from.clone();
    for k in 1..=(0.2 / step).round() as usize {
        to.t = k as f64 * step;
        integrator.step(&mut dynamics, &mut newton, &from, step, &mut to).unwrap();
        std::mem::swap(&mut from, &mut to);
    }
    assert!(from.q.as_chunks::<2>().0.iter().all(|x| x[1] < -0.075), "it is through");
    -from.v[1]
}

#[test]
fn a_bar_that_falls_into_water_keeps_its_momentum_with_spray_and_its_energy_without() {
    let share: f64 = 0.54414;
    for (spray, expected) in [(true, share), (false, share.sqrt())] {
        let errors = [4e-4, 2e-4].map(|step| through(step, spray) - expected);
        println!("{spray}: {errors:?}");
        assert!(errors[1].abs() < 1e-5, "{spray}: {errors:?}");
    }
}

/// A reference scene.
fn reference(name: &str) -> String {
    std::fs::read_to_string(format!("{}/tests/reference/fluid/{name}.toml", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

#[test]
fn the_balances_of_energy_and_momentum_close_across_interfaces_with_the_spray_in_them() {
    for name in ["dipping_plate_n9", "oil_over_water_n11"] {
        for method in METHODS.iter().filter(|method| method.implicit) {
            let text: String =
                reference(name).lines().filter(|line| !line.starts_with("integrator")).collect::<Vec<_>>().join("\n");
            let integrator = format!("solver.integrator={}", method.name);
            let mut momenta = Vec::new();
            let defects = [2e-3, 1e-3, 5e-4].map(|step| {
                let changes = [&*integrator, &format!("solver.time_step_s={step}"), "solver.duration_s=0.6"];
                let stepper = run(&scene(&text, &changes).unwrap());
                let metrics = stepper.metrics();
                assert!(metrics.totals.work.spray > 0.0);
                let impulse = metrics.totals.impulse;
                momenta.push(metrics.momentum_defect().norm() / impulse.drag.norm());
                metrics.numerical_dissipation() / metrics.totals.work.viscous
            });
            let observed = order(momenta[1], momenta[2]);
            println!("{name} {}: momentum {momenta:?}, order {observed}", method.name);
            let wanted = f64::from((method.build)(&method.defaults()).order().min(2));
            assert!(momenta[2] < 1e-6 || observed > wanted - 0.3, "{name} {}: {momenta:?}", method.name);
            let observed = order(defects[1], defects[2]);
            println!("{name} {}: {defects:?}, order {observed}", method.name);
            let wanted = f64::from((method.build)(&method.defaults()).order().min(2));
            assert!(
                defects[2].abs() < 1e-6 || observed > wanted - 0.3,
                "{name} {}: {defects:?}, order {observed}",
                method.name
            );
        }
    }
}

/// A scene that crosses an interface, with and without buoyancy, by a method.
fn crossing(method: &str, head: &str, more: &[&str]) -> Scene {
    let bare = SOFT.replace("ratio = 5.0\n", "");
    let changes = [
        &format!("solver.integrator={method}"),
        head,
        "drag.law=cross-flow",
        "reactive.shedding=0.8",
        "medium.beyond={ normal = [0.0, 1.0], offset_m = 0.02, thickness_m = 0.2, viscosity_pa_s = 0.5, density_kg_m3 = 300.0 }",
        "loads={ gravity_m_s2 = [0.0, -0.3], buoyancy = true }",
        "medium.flow_m_s=[0.05, 0.0]",
        "solver.newton_tolerance=1e-14",
        "solver.duration_s=0.245",
        "solver.time_step_s=0.01",
    ];
    scene_of(&bare, &[&changes, more].concat())
}

/// The scene's value of `key` moved by `by`.
fn moved(scene: &Scene, key: &str, by: f64) -> Problem {
    let mut problem = Problem::of(scene).unwrap();
    let inputs = problem.inputs();
    let layer = inputs.layers.as_mut().and_then(|layers| layers.get_mut(0)).unwrap();
    *match key {
        VISCOSITY => &mut inputs.fluid.viscosity,
        DENSITY => &mut inputs.fluid.density,
        key if key == LAYER_KEYS[0][0] => &mut layer.fluid.viscosity,
        key if key == LAYER_KEYS[0][1] => &mut layer.fluid.density,
        _ => &mut layer.offset,
    } += by;
    problem
}

#[test]
fn sensitivities_to_the_properties_on_either_side_and_the_place_of_the_interface_are_those_of_differences() {
    let heads =
        ["head.kind=free", "head={ kind = \"driven\", position_m = { amplitude = [0.01, 0.05], frequency_hz = 1.0 } }"];
    let sizes = [
        (VISCOSITY, 5.0),
        (DENSITY, 1260.0),
        (LAYER_KEYS[0][0], 0.5),
        (LAYER_KEYS[0][1], 300.0),
        (LAYER_KEYS[0][2], 0.02),
    ];
    let (mut worst, mut apart): (f64, f64) = (0.0, 0.0);
    for (head, method) in heads.iter().flat_map(|head| [(head, "newmark"), (head, "implicit-euler")]) {
        let scene = crossing(method, head, &[]);
        let mut problem = Problem::of(&scene).unwrap();
        let recorded = VARIABLES.iter().filter(|v| v.recorded && v.name != "time_s" && v.exists_in(problem.model()));
        let outputs: Vec<Output> = recorded.map(|v| Output::named(v.name, problem.model()).unwrap()).collect();
        let kinds = sizes.map(|(key, _)| Parameter::OfForces(key));
        let found = problem.forward(&kinds, &outputs, 1, |_| {}).unwrap();
        let last = found.times.len() - 1;
        let scale =
            |o: usize| largest((0..=last).flat_map(|n| found.row(n, o).iter().zip(&sizes).map(|(d, p)| d * p.1)));
        for (j, (key, size)) in sizes.iter().enumerate() {
            let by = 1e-4 * size;
            let values = |by: f64| moved(&scene, key, by).forward(&[], &outputs, 1, |_| {}).unwrap().values;
            let central = |by: f64| -> Vec<f64> {
                values(by).iter().zip(values(-by)).map(|(a, b)| (a - b) / (2.0 * by)).collect()
            };
            let differences: Vec<f64> =
                central(by).iter().zip(central(2.0 * by)).map(|(a, b)| a + (a - b) / 3.0).collect();
            for n in 0..=last {
                for o in (0..outputs.len()).filter(|o| scale(*o) > 0.0) {
                    let off = (found.row(n, o)[j] - differences[n * outputs.len() + o]) * size / scale(o);
                    worst = worst.max(off.abs());
                }
            }
        }
        let trajectory = problem.simulate().unwrap();
        let mut dice = Dice(7);
        for (o, output) in outputs.iter().enumerate().filter(|(o, _)| scale(*o) > 0.0) {
            let weights = dice.many(last + 1, -1.0, 1.0);
            let adjoint = problem.adjoint(&kinds, std::slice::from_ref(output), &weights, &trajectory).unwrap();
            for (j, (_, size)) in sizes.iter().enumerate() {
                let forward: f64 = weights.iter().enumerate().map(|(n, weight)| weight * found.row(n, o)[j]).sum();
                apart = apart.max(((adjoint[j] - forward) * size / scale(o)).abs());
            }
        }
    }
    println!("differences {worst:e}, adjoint {apart:e}");
    assert!(worst < 1e-6, "{worst:e}");
    assert!(apart < 1e-9, "{apart:e}");
}

#[test]
fn along_any_rod_runs_of_edges_are_in_one_fluid_or_change_along_every_edge() {
    let mut found = FluidRuns::default();
    let mut kinds = [0; 3];
    for seed in 0..400 {
        let mut dice = Dice(seed);
        let nodes = dice.between(2.0, 40.0) as usize;
        let mut q = dice.chain(nodes, 0.1);
        let fluid = Fluid { viscosity: 1.0, density: 2.0, ..Fluid::NONE };
        let layer = |offset: f64, dice: &mut Dice| Layer {
            offset,
            thickness: dice.between(0.01, 0.4),
            fluid: Fluid { viscosity: dice.between(1.0, 9.0), density: dice.between(1.0, 9.0), ..Fluid::NONE },
        };
        let [first, second] = [-0.25, 0.25].map(|offset| layer(offset, &mut dice));
        let shear = if seed % 20 == 0 { 0.5 } else { 0.0 };
        let layers = Layers::new(Vector2::new(0.6, 0.8), shear, [first, second]);
        // A node on the very side of an interface, but for rounding.
        let on_side = seed % 7 == 0;
        if on_side {
            let h = layers.height(Vector2::new(q[2], q[3]));
            q[2] += 0.6 * (first.offset + 0.5 * first.thickness - h);
            q[3] += 0.8 * (first.offset + 0.5 * first.thickness - h);
        }
        let here = |k: usize| layers.at(fluid, layers.height(Vector2::new(q[2 * k], q[2 * k + 1])));
        let around = found.find(&layers, fluid, &q);
        let still = |here: &LocalFluid| here.slope == Fluid::NONE && here.bend == 0.0;
        let (mut next, mut before) = (0, None);
        for (edges, run) in around.over(0..nodes - 1) {
            assert!(edges.start == next && edges.end > next);
            next = edges.end;
            let one = run.everywhere();
            assert!(before != Some(None) || one.is_some(), "one run that changes after the other");
            before = Some(one);
            (edges.start..=edges.end).for_each(|k| assert_eq!(run.at(k), Some(&here(k))));
            match one {
                Some(fluid) => {
                    kinds[0] += edges.len();
                    assert!((edges.start..=edges.end).all(|k| here(k).fluid == *fluid && still(&here(k))));
                }
                None => {
                    kinds[1] += edges.len();
                    for e in edges.clone() {
                        let ends = [here(e), here(e + 1)];
                        kinds[2] += usize::from(ends.iter().all(still));
                        assert!(on_side || !ends.iter().all(still) || ends[0].fluid != ends[1].fluid);
                    }
                    let along: Vec<_> = (edges.start..=edges.end).map(here).collect();
                    assert_eq!(run.along(edges), along);
                }
            }
        }
        assert_eq!(next, nodes - 1);
        (0..nodes).for_each(|k| assert_eq!(around.at(k), Some(&here(k))));
        let part = around.over(nodes / 3..nodes / 2).map(|(edges, _)| edges.len()).sum::<usize>();
        assert_eq!(part, nodes / 2 - nodes / 3);
    }
    // Edges in one fluid, that change, and of these such as pass over an interface.
    println!("{kinds:?}");
    assert!(kinds.iter().all(|count| *count > 50));
}

#[test]
fn a_rod_that_is_nowhere_has_runs_too() {
    let layer = Layer { offset: 0.0, thickness: 0.1, fluid: Fluid::NONE };
    let layers = Layers::new(Vector2::y(), 0.0, [layer]);
    for nodes in 2..6 {
        for nowhere in 0..nodes {
            let mut q = vec![1.0; 2 * nodes];
            q[2 * nowhere] = f64::NAN;
            let mut found = FluidRuns::default();
            let edges = found.find(&layers, Fluid::NONE, &q).over(0..nodes - 1).map(|(edges, _)| edges.len());
            assert_eq!(edges.sum::<usize>(), nodes - 1);
        }
    }
}

#[test]
fn a_stiff_rod_in_a_shear_flow_turns_as_jeffery_s_endless_fibre() {
    // dφ/dt = −γ sin²φ: cot φ grows by γt.
    let text = r#"
[rod]
nodes = 9
length_m = 1e-3
outer_radius_m = 1e-5
youngs_modulus_pa = 1e13
density_kg_m3 = 1000.0
[medium]
viscosity_pa_s = 1.0
density_kg_m3 = 1000.0
shear = { normal = [0.0, 1.0], rate_per_s = 2.0 }
[drag]
[solver]
integrator = "esdirk3"
tolerance = 1e-6
duration_s = 1.0
"#;
    let scene = scene(text, &[]).unwrap();
    let mut dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
    let mut state = dynamics.first_state();
    // It starts with the motion that it goes on with.
    let (sin, cos) = 1.2f64.sin_cos();
    for k in 0..9 {
        let s = 1e-3 * (k as f64 / 8.0 - 0.5);
        let turning = -2.0 * sin * sin * s;
        state.q[2 * k..2 * k + 2].copy_from_slice(&[s * cos, s * sin]);
        state.v[2 * k..2 * k + 2].copy_from_slice(&[-turning * sin, turning * cos]);
    }
    let mut integrator = scene.integrator().unwrap();
    let mut newton = Newton::new(dynamics.nodes(), 1e-12).unwrap();
    integrator.begin(&mut state);
    let (step, mut to) = (5e-3, state.clone());
    for k in 1..=200 {
        to.t = k as f64 * step;
        integrator.step(&mut dynamics, &mut newton, &state, step, &mut to).unwrap();
        std::mem::swap(&mut state, &mut to);
    }
    let direction = [state.q[16] - state.q[0], state.q[17] - state.q[1]];
    let cot = direction[0] / direction[1];
    let expected = 1.0 / 1.2f64.tan() + 2.0;
    println!("{cot} {expected}");
    assert!((cot - expected).abs() < 1e-4 * expected, "{cot} {expected}");
}

#[test]
fn what_layers_cannot_be_is_refused_with_its_key_and_a_remedy() {
    let beyond = "medium.beyond={ normal = [0.0, 1.0], offset_m = 0.0, thickness_m = 0.1, viscosity_pa_s = 1.0, density_kg_m3 = 1.0 }";
    let layer = |offset: f64, more: &str| {
        format!("{{ offset_m = {offset}, thickness_m = 0.1, viscosity_pa_s = 1.0, density_kg_m3 = 1.0{more} }}")
    };
    let layers = |all: &[String]| format!("medium.layers=[{}]", all.join(", "));
    let upwards = |offset: f64| layer(offset, ", normal = [0.0, 1.0]");
    let (two, mixed) =
        (layers(&[upwards(0.0), layer(0.05, "")]), layers(&[upwards(0.0), layer(0.2, ", normal = [0.0, -1.0]")]));
    let many = layers(&[0.0, 0.2, 0.4, 0.6, 0.8].map(upwards));
    let (none, one) = (layers(&[layer(0.0, "")]), layers(&[upwards(0.0)]));
    let flowing = layers(&[layer(0.0, ", normal = [0.0, 1.0], flow_m_s = [0.1, 0.0]")]);
    let body = "head_body={ semi_axis_along_m = 0.2, semi_axis_across_m = 0.1 }";
    let cases: [(&[&str], &str); 15] = [
        (&[beyond, body], "head_body: found in a nonuniform medium"),
        (&[beyond, "medium.flow_m_s=[0.1, 0.1]"], "medium.flow_m_s: found [0.1, 0.1], which crosses the layers"),
        (
            &[beyond, "loads.gravity_m_s2=[1.0, -9.81]"],
            "medium.beyond.normal: found [0, 1], which is not along the normal",
        ),
        (&[beyond, &one], "medium.beyond: found together with [[medium.layers]]"),
        (&[beyond, "medium.beyond.normal=[0.0, 0.0]"], "medium.beyond.normal: found [0, 0]; allowed: a direction"),
        (&[beyond, "medium.beyond.thickness_m=0.0"], "medium.beyond.thickness_m: found 0; allowed: a positive number"),
        (&[&none], "medium.layers.0.normal: missing"),
        (&[&two], "medium.layers.1.offset_m: found 5e-2 m; allowed: at least 1e-1 m"),
        (&[&mixed], "medium.layers.1.normal: found [0, -1]; allowed: the direction of medium.layers.0.normal"),
        (&[&many], "medium.layers.4: found 5 layers; allowed: at most 4"),
        (&[beyond, "solver.model=shape"], "solver.model: found \"shape\" with an interface in [medium]"),
        (&[beyond, "solver.model=overdamped"], "solver.model: found \"overdamped\" with an interface in [medium]"),
        (
            &["medium.shear={ rate_per_s = 1.0, normal = [0.0, 1.0] }", "reactive.shedding=1.0"],
            "medium.shear: found with [reactive]",
        ),
        (&["medium.shear.rate_per_s=1.0"], "medium.shear.normal: missing"),
        (&[&flowing, "reactive.shedding=1.0"], "medium.layers.0.flow_m_s: found with [reactive]"),
    ];
    for (changes, expected) in cases {
        let found = scene(SOFT, changes).expect_err(expected);
        assert!(found.contains(expected), "expected {expected:?}, found {found:?}");
    }
    scene(SOFT, &[beyond, "loads.gravity_m_s2=[0.0, -9.81]", "medium.flow_m_s=[0.1, 0.0]"]).unwrap();
}

#[test]
fn auto_takes_the_whole_model_in_layers_and_says_why() {
    let beyond = "medium.beyond={ normal = [0.0, 1.0], offset_m = 0.0, thickness_m = 0.1, viscosity_pa_s = 1.0, density_kg_m3 = 1.0 }";
    let scene = scene(SOFT, &[beyond, "solver.model=auto"]).unwrap();
    let stepper = Stepper::of(&scene).unwrap();
    let choice = stepper.choice().unwrap();
    assert_eq!(choice.kind.name, "full");
    assert!(choice.reason.as_ref().unwrap().contains("a medium that varies with position"), "{:?}", choice.reason);
}

/// A light oil.
const OIL: &str = "viscosity_pa_s = 0.2, density_kg_m3 = 600.0";

/// Next to nothing.
const AIR: &str = "viscosity_pa_s = 1e-2, density_kg_m3 = 1.2";

/// A held, damped beam that sags under its weight by `method` in `medium`, with `beyond` below a height of `-offset` (m).
fn sagging(method: &str, medium: &str, beyond: Option<(f64, &str)>) -> Scene {
    let bare = SOFT.replace("ratio = 5.0\n", "");
    let beyond = beyond.map(|(offset, fluid)| {
        format!("medium.beyond={{ normal = [0.0, -1.0], offset_m = {offset}, thickness_m = 0.02, {fluid} }}")
    });
    let (integrator, medium) = (format!("solver.integrator={method}"), format!("medium={{ {medium} }}"));
    let own = [
        "rod.nodes=17",
        "head.kind=clamped",
        "drag.law=cox",
        "reactive.shedding=0.5",
        "loads={ gravity_m_s2 = [0.0, -0.5], buoyancy = true }",
        "solver.newton_tolerance=1e-13",
        &integrator,
        &medium,
    ];
    scene_of(&bare, &own.into_iter().chain(beyond.as_deref()).collect::<Vec<_>>())
}

/// `scene` at rest but for what `change` makes of its state, after `steps` steps of `step` (s).
fn from_rest(scene: &Scene, rest: &[f64], step: f64, steps: usize, change: impl Fn(&mut State)) -> Vec<f64> {
    let mut model = scene.model().unwrap();
    (model.actuation, model.start) = (None, Start::Jump);
    let mut dynamics = Dynamics::new(Arc::new(model));
    let mut from = dynamics.first_state();
    from.q.copy_from_slice(rest);
    change(&mut from);
    let mut integrator = scene.integrator().unwrap();
    let mut newton = Newton::new(dynamics.nodes(), 1e-13).unwrap();
    newton.solve(&mut dynamics, &mut from, Direction::ACCELERATIONS).unwrap();
    integrator.begin(&mut from);
    let mut to = from.clone();
    for k in 1..=steps {
        to.t = k as f64 * step;
        integrator.step(&mut dynamics, &mut newton, &from, step, &mut to).unwrap();
        std::mem::swap(&mut from, &mut to);
    }
    from.q
}

#[test]
fn a_beam_rests_across_an_interface_where_time_leaves_it_and_swings_as_its_eigenmodes_say() {
    let scene = sagging("newmark", AIR, Some((0.01, OIL)));
    let mut rest = SteadyState::of(scene.model().unwrap()).unwrap();
    let positions = rest.positions().to_vec();
    let tip = positions[positions.len() - 1];
    println!("the tip hangs at {tip} m");
    assert!(tip < -0.02, "it hangs through the interface: {tip}");
    let slow = sagging("implicit-euler", AIR, Some((0.01, OIL)));
    let straight = Dynamics::new(Arc::new(slow.model().unwrap())).first_state().q;
    let found = from_rest(&slow, &straight, 0.5, 400, |_| {});
    let off = largest(found.iter().zip(&positions).map(|(a, b)| a - b));
    println!("rest in time and from statics differ by {off:e} m");
    assert!(off < 1e-13, "{off:e}"); // measured: 1.1e-16

    let mode = rest.eigenmodes().unwrap().into_iter().find(|mode| mode.frequency > 0.0).unwrap();
    let period = std::f64::consts::TAU / mode.frequency;
    let (small, steps) = (1e-7, 800);
    let swung = |phase: f64, part: f64, rate: bool| -> Vec<f64> {
        let growth = small * (mode.growth * part * period).exp();
        let (sin, cos) = phase.sin_cos();
        let [real, imaginary] = if rate { [mode.growth, mode.frequency] } else { [1.0, 0.0] };
        let of =
            |[re, im]: [f64; 2]| growth * ((real * re - imaginary * im) * cos - (real * im + imaginary * re) * sin);
        mode.shape.iter().flat_map(|[re, im]| [of([re[0], im[0]]), of([re[1], im[1]])]).collect()
    };
    let found = from_rest(&scene, &positions, period / steps as f64, steps, |state| {
        state.q.iter_mut().zip(swung(0.0, 0.0, false)).for_each(|(q, d)| *q += d);
        state.v.copy_from_slice(&swung(0.0, 0.0, true));
    });
    let expected = swung(std::f64::consts::TAU, 1.0, false);
    let size = largest(expected.iter().copied());
    let off = largest(found.iter().zip(&positions).zip(&expected).map(|((q, rest), d)| q - rest - d)) / size;
    println!("λ = {} + {}i; after a period {off:e} of {size:e} m", mode.growth, mode.frequency);
    assert!(off < 1e-5, "{off:e}"); // measured: 1.1e-6
}

#[test]
fn far_from_the_interface_a_beam_swings_as_in_the_fluid_that_is_there() {
    let eigenvalues = |medium: &str, beyond: Option<(f64, &str)>| {
        let model = sagging("newmark", medium, beyond).model().unwrap();
        let found = SteadyState::of(model).unwrap().eigenvalues().unwrap();
        let mut found: Vec<_> = found.into_iter().map(|(value, _)| value).collect();
        found.sort_by(|a, b| a.im.total_cmp(&b.im).then(a.re.total_cmp(&b.re)));
        found
    };
    for (offset, there) in [(-1e3, OIL), (1e3, AIR)] {
        let (layered, uniform) = (eigenvalues(AIR, Some((offset, OIL))), eigenvalues(there, None));
        assert_eq!(layered.len(), uniform.len());
        let highest = uniform.iter().map(|z| z.norm()).fold(0.0, f64::max);
        let off = layered.iter().zip(&uniform).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max) / highest;
        println!("{offset}: {off:e}");
        assert!(off < 1e-11, "{offset}: {off:e}"); // measured: 2.7e-14
    }
}

#[test]
fn what_a_host_says_of_the_media_is_what_a_scene_says_of_them() {
    let scene = crossing("newmark", "head.kind=free", &[]);
    let said = [
        ("viscosity_pa_s", "medium.viscosity_pa_s", 3.0),
        ("interface_1_offset_m", "medium.beyond.offset_m", 0.04),
        ("beyond_1_viscosity_pa_s", "medium.beyond.viscosity_pa_s", 1.5),
        ("beyond_1_density_kg_m3", "medium.beyond.density_kg_m3", 700.0),
    ];
    let changes = said.map(|(_, key, value)| format!("{key}={value}"));
    let other = crossing("newmark", "head.kind=free", &changes.each_ref().map(String::as_str));
    let (mut own, mut host) = (Stepper::of(&other).unwrap(), Stepper::of(&scene).unwrap());
    for (name, _, value) in said {
        host.set(name, &[value]).unwrap();
        assert_eq!(host.get(name).unwrap(), [value]);
    }
    for _ in 0..5 {
        own.do_step(0.0333).unwrap();
        host.do_step(0.0333).unwrap();
    }
    for name in ["x_m", "vy_m_s", "spray_work_j"] {
        let (own, host) = (own.get(name).unwrap(), host.get(name).unwrap());
        let off = largest(own.iter().zip(&host).map(|(a, b)| a - b)) / largest(own);
        assert!(off < 1e-12, "{name}: {off:e}"); // measured: 1e-15
    }
}

#[test]
fn every_key_of_a_medium_names_the_property_of_its_own_layer() {
    use Property::{Density, Offset, Viscosity};
    assert_eq!([VISCOSITY, DENSITY].map(Property::of), [Some(Viscosity(0)), Some(Density(0))]);
    let beyond = ["medium.beyond.viscosity_pa_s", "medium.beyond.density_kg_m3", "medium.beyond.offset_m"];
    assert_eq!(beyond.map(Property::of), [Some(Viscosity(1)), Some(Density(1)), Some(Offset(0))]);
    for (j, keys) in LAYER_KEYS.iter().enumerate() {
        assert_eq!(keys.map(Property::of), [Some(Viscosity(j + 1)), Some(Density(j + 1)), Some(Offset(j))]);
    }
}
