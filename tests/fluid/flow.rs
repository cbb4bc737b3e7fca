//! A flow that changes in time: to an observer who moves with it, it is a field of gravity and its buoyancy.

use crate::common;
use std::sync::Arc;

use caudal::head::{Row, Signal};
use caudal::integrator::{METHODS, Method};
use caudal::model::Model;
use caudal::newton::Newton;
use caudal::rod::node;
use caudal::scene::Scene;
use caudal::stepper::Stepper;
use caudal::system::Form;
use common::{SOFT, largest, order, run, scene_of, stepper_of};
use nalgebra::Vector2;

/// u̇, m/s².
const RATE: [f64; 2] = [0.7, -0.4];

/// What the water does to a soft tail, with much of everything.
const WATER: [&str; 5] = [
    "reactive.shedding=0.8",
    "rod.depth_m=[[0, 0.1], [1, 0.3]]",
    "rod.density_kg_m3=1400",
    "drag={ law = \"cross-flow\" }",
    "medium.viscosity_pa_s=0.01",
];

/// What [`SOFT`] is with the drag of [`WATER`].
fn soft() -> String {
    SOFT.replace("[drag]\nratio = 5.0\nhead_weight = 10.0\nhead_length_m = 0.2\n", "")
}

/// x = place + rate t + ½ curve t² from `−1` to 9 s.
fn parabola(place: f64, rate: f64, curve: f64) -> Signal {
    let row =
        |time: f64| Row { time, value: place + rate * time + 0.5 * curve * time * time, rate: rate + curve * time };
    Signal::Table(vec![row(-1.0), row(9.0)])
}

fn stepper(scene: &Scene, model: Model, method: &Method, form: Form) -> Stepper {
    let newton = Newton::with(form, scene.solver.linear, model.rod.nodes, 1e-13).unwrap();
    Stepper::init(model, (method.build)(&method.defaults()), newton, 2e-5).unwrap()
}

#[test]
fn a_flow_that_accelerates_is_a_frame_in_a_field_of_gravity_with_buoyancy() {
    let gravity = format!("loads={{ gravity_m_s2 = [{}, {}], buoyancy = true }}", -RATE[0], -RATE[1]);
    for form in [Form::Positions, Form::Chain] {
        for kind in METHODS {
            if form == Form::Chain && kind.name == "symplectic-euler" {
                continue; // explicit: it has no unknowns to choose
            }
            for head in ["free", "clamped"] {
                if head == "clamped" && (kind.build)(&kind.defaults()).order() < 2 {
                    continue; // its sum of velocities is not where the head is told to be
                }
                let held = format!("head.kind={head}");
                let scene = |more: &str| scene_of(&soft(), &[&WATER[..], &[held.as_str(), more]].concat());
                let accelerated = scene("name=accelerated");
                let mut model = accelerated.model().unwrap();
                model.flow = Some(RATE.map(|rate| parabola(0.0, rate, 0.0)));
                let mut flowing = stepper(&accelerated, model, kind, form);
                let falling = scene(&gravity);
                let mut model = falling.model().unwrap();
                if let Some(head) = &mut model.head {
                    (head[0], head[1]) = (parabola(0.0, 0.0, -RATE[0]), parabola(0.0, 0.0, -RATE[1]));
                }
                let mut falling = stepper(&falling, model, kind, form);
                let (steps, h) = (400, 2e-5);
                for _ in 0..steps {
                    flowing.do_step(h).unwrap();
                    falling.do_step(h).unwrap();
                }
                let [a, b] = [&flowing, &falling].map(|stepper| stepper.state());
                let (t, rate) = (flowing.time(), Vector2::from(RATE));
                let v = largest((0..9).map(|k| (node(&a.v, k) - rate * t - node(&b.v, k)).norm()));
                let shape = |q: &[f64]| (0..9).map(|k| node(q, k) - node(q, 8)).collect::<Vec<_>>();
                let q = largest(shape(&a.q).iter().zip(shape(&b.q)).map(|(a, b)| (a - b).norm()));
                let size = largest(a.v.iter().copied());
                // Measured: at most 2.3e-13 of it, 3.3e-15 m.
                assert!(v < 1e-9 * size && q < 1e-11, "{} {form:?} {head}: {v:e} of {size}, {q:e}", kind.name);
                let force = (flowing.metrics().now.head_force - falling.metrics().now.head_force).norm();
                let carried = rate.norm() * flowing.model().rod.mass[0];
                assert!(head == "free" || force < 1e-6 + 1.1 * carried, "{force}");
            }
        }
    }
}

#[test]
fn a_body_as_dense_as_the_water_goes_with_it() {
    // Across it (m + m_a) a = (ρV + m_a) u̇, along it m a = ρV u̇.
    for (density, flow) in [(1000.0, [0.0, 1.0]), (1000.0, [1.0, 0.0]), (700.0, [0.0, 1.0]), (700.0, [1.0, 0.0])] {
        let flow_key = format!(
            "medium.flow_m_s=[{{ amplitude = {}, frequency_hz = 0.3 }}, {{ amplitude = {}, frequency_hz = 0.3 }}]",
            flow[0], flow[1]
        );
        let density_key = format!("rod.density_kg_m3={density}");
        let changes = [
            "rod.youngs_modulus_pa=1e9",
            "reactive.shedding=0.0",
            "medium.density_kg_m3=1000",
            "solver.integrator=esdirk3",
            "solver.time_step_s=0.002",
            &density_key,
            &flow_key,
        ];
        let passive = soft().replace("[actuation]\nkind = \"travelling-wave\"\nkappa_amp = 4.0\nfrequency_hz = 1.5\nwavelength_m = 0.8\nenvelope = [0.2, 0.8]\n", "");
        let stepper = run(&scene_of(&passive, &changes));
        let (across, volume) = (flow[1] != 0.0, 1000.0);
        let added = if across { 1000.0 } else { 0.0 };
        let (t, omega) = (stepper.time(), 0.6 * std::f64::consts::PI);
        let expected = (volume + added) / (density + added) * (omega * t).sin();
        let found = node(&stepper.state().v, 4)[usize::from(across)];
        assert!((found - expected).abs() < 1e-5, "{density} {flow:?}: {found} {expected}");
    }
}

#[test]
fn a_head_body_as_dense_as_the_water_goes_with_it() {
    let passive = "[rod]\nnodes = 9\nlength_m = 1.0\nouter_radius_m = 0.02\nyoungs_modulus_pa = 1e9\ndensity_kg_m3 = 1000.0\n\
                   [head_body]\nsemi_axis_along_m = 0.1\nsemi_axis_across_m = 0.06\n\
                   [medium]\nviscosity_pa_s = 0.01\ndensity_kg_m3 = 1000.0\n\
                   flow_m_s = [{ amplitude = 0.4, frequency_hz = 0.3 }, { amplitude = -0.7, frequency_hz = 0.3 }]\n\
                   [drag]\nlaw = \"cross-flow\"\n[reactive]\n\
                   [solver]\nintegrator = \"esdirk3\"\ntime_step_s = 0.002\nduration_s = 0.5\n";
    let stepper = run(&scene_of(passive, &[]));
    let size = (0.6 * std::f64::consts::PI * stepper.time()).sin();
    for v in stepper.state().v.as_chunks::<2>().0 {
        // Measured: 5e-10; 0.29 without the body's volume.
        let off = (v[0] - 0.4 * size).hypot(v[1] + 0.7 * size);
        assert!(off < 1e-6, "{v:?} {off}");
    }
}

/// A soft tail whose flow swings.
fn swinging(method: &str, step: f64) -> Scene {
    let flow = "medium.flow_m_s=[{ amplitude = 0.3, frequency_hz = 2.0, phase_rad = 0.5, offset = 0.2 }, { amplitude = 0.2, frequency_hz = 3.0 }]";
    let method = format!("solver.integrator={method}");
    let step = format!("solver.time_step_s={step:e}");
    scene_of(
        &soft(),
        &[&WATER[..], &[flow, &method, &step, "solver.duration_s=0.2", "solver.newton_tolerance=1e-13"]].concat(),
    )
}

#[test]
fn the_balances_of_energy_and_momentum_close_in_a_flow_that_swings() {
    for method in METHODS {
        let wanted = f64::from((method.build)(&method.defaults()).order().min(2));
        let defects = [2e-4, 1e-4].map(|step| {
            let stepper = run(&swinging(method.name, step));
            let metrics = stepper.metrics();
            assert!(metrics.totals.work.flow.abs() > 0.1, "{:?}", metrics.totals.work);
            [metrics.numerical_dissipation(), metrics.momentum_defect().x, metrics.momentum_defect().y]
        });
        for i in 0..3 {
            let observed = order(defects[0][i], defects[1][i]);
            assert!(observed > wanted - 0.15, "{}: {i}: {observed}, {defects:?}", method.name);
        }
    }
}

#[test]
fn a_host_s_rate_of_the_flow_is_the_acceleration_of_the_scene_s() {
    let step = "solver.time_step_s=1e-3";
    let mut hosted = stepper_of(&soft(), &[&WATER[..], &[step]].concat());
    hosted.set_derivative("flow_x_m_s", 1, &[RATE[0]]).unwrap();
    hosted.set_derivative("flow_y_m_s", 1, &[RATE[1]]).unwrap();
    let scene = scene_of(&soft(), &[&WATER[..], &[step]].concat());
    let mut model = scene.model().unwrap();
    model.flow = Some(RATE.map(|rate| parabola(0.0, rate, 0.0)));
    let newton = Newton::with(hosted.form(), scene.solver.linear, 9, scene.newton_tolerance()).unwrap();
    let newton = newton.foreseeing(model.rod.slenderness_squared());
    let mut own = Stepper::init(Arc::new(model), scene.integrator().unwrap(), newton, 1e-3).unwrap();
    for _ in 0..100 {
        hosted.do_step(1e-3).unwrap();
        own.do_step(1e-3).unwrap();
    }
    let off = common::distance(&hosted.state().q, &own.state().q);
    // The first derivative of an input is the flow's acceleration from the first step on.
    assert!(off < 1e-12, "{off:e}");
    assert!((hosted.get_scalar("flow_x_m_s").unwrap() - 0.1 * RATE[0]).abs() < 1e-15);
    // A host that sets the scene's flow takes it over.
    own.set("flow_x_m_s", &[2.0]).unwrap();
    own.do_step(1e-3).unwrap();
    assert_eq!(own.get_scalar("flow_x_m_s").unwrap(), 2.0);
    assert!((own.get_scalar("flow_y_m_s").unwrap() - 0.1 * RATE[1]).abs() < 1e-12);
}

#[test]
fn a_gust_is_the_limit_of_a_flow_that_rises_quickly() {
    for head in ["head.kind=free", "head.kind=clamped"] {
        let changes = [&WATER[..], &["solver.integrator=esdirk3", "solver.time_step_s=1e-4", head]].concat();
        let mut gust = stepper_of(&soft(), &changes);
        gust.do_step(0.1).unwrap();
        let start = gust.save();
        gust.set("flow_x_m_s", &[0.5]).unwrap();
        gust.set("flow_y_m_s", &[0.3]).unwrap();
        // What is set is part of a snapshot.
        let kicked = gust.save();
        let mut other = stepper_of(&soft(), &changes);
        other.restore(&kicked).unwrap();
        gust.do_step(0.02).unwrap();
        other.do_step(0.02).unwrap();
        assert_eq!(gust.state(), other.state());
        assert_eq!(gust.metrics().totals.work.load, 0.0, "no load acts");
        let balance = gust.metrics().numerical_dissipation();
        assert!(
            balance.abs() < 1e-4 * gust.metrics().totals.work.flow.abs(),
            "{balance} {:?}",
            gust.metrics().totals.work
        );
        let off = [4e-3, 2e-3].map(|rise| {
            let mut ramp = stepper_of(&soft(), &changes);
            ramp.restore(&start).unwrap();
            ramp.set_derivative("flow_x_m_s", 1, &[0.5 / rise]).unwrap();
            ramp.set_derivative("flow_y_m_s", 1, &[0.3 / rise]).unwrap();
            ramp.do_step(rise).unwrap();
            ramp.set("flow_x_m_s", &[0.5]).unwrap();
            ramp.set("flow_y_m_s", &[0.3]).unwrap();
            ramp.do_step(0.02 - rise).unwrap();
            common::distance(&ramp.state().q, &gust.state().q)
        });
        // Measured: 3.2e-3 and 1.6e-3 m, 2.9e-3 and 1.4e-3: in proportion to the duration.
        assert!(off[1] < 0.6 * off[0], "{head}: {off:?}");
    }
}

#[test]
fn a_flow_gives_the_impulse_of_the_water_that_the_rod_displaces_and_loads_give_theirs() {
    // The water in place of the rod would go with the flow: ρV(u − u₀), whether that swings or jumps.
    let gravity = "loads={ gravity_m_s2 = [0.3, -0.2] }";
    let area = std::f64::consts::PI * 0.08 * 0.08;
    let (rod, water) = (1000.0 * area, 1260.0 * area);
    for (flow, jump, tolerance) in [
        // By the trapezoidal rule; measured: 1.2e-6.
        ("medium.flow_m_s=[0.0, { amplitude = 0.2, frequency_hz = 1.5 }]", [0.0, 0.0], 3e-6),
        ("medium.flow_m_s=[0.1, 0.0]", [0.5, 0.3], 1e-12),
    ] {
        let mut stepper = stepper_of(
            &soft(),
            &[
                "drag={ law = \"cross-flow\" }",
                "medium.viscosity_pa_s=0.01",
                "reactive.shedding=0.8",
                "solver.integrator=esdirk3",
                "solver.time_step_s=1e-3",
                gravity,
                flow,
            ],
        );
        let first = ["flow_x_m_s", "flow_y_m_s"].map(|name| stepper.get_scalar(name).unwrap());
        for time in [0.1, 0.25] {
            stepper.do_step(time - stepper.time()).unwrap();
            for (i, axis) in ["x", "y"].iter().enumerate() {
                let read = |name: &str| stepper.get_scalar(&name.replace('#', axis)).unwrap();
                let given = read("flow_#_m_s") - first[i];
                let (flow, load) = (read("flow_impulse_#_n_s"), read("load_impulse_#_n_s"));
                println!("{time} {axis}: {flow} of {}", water * given);
                assert!((flow - water * given).abs() < tolerance * water, "{time} {axis}: {flow} of {}", water * given);
                let wanted = rod * [0.3, -0.2][i] * time;
                assert!((load - wanted).abs() < 1e-10 * rod, "{time} {axis}: {load} of {wanted}");
            }
            for (name, jump) in ["flow_x_m_s", "flow_y_m_s"].into_iter().zip(jump).filter(|(_, jump)| *jump != 0.0) {
                stepper.set(name, &[first[usize::from(name == "flow_y_m_s")] + jump]).unwrap();
            }
        }
    }
}
