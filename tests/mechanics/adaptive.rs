//! A tolerance chooses the steps, and what lies inside a step can be read.

use crate::common;
use std::ops::ControlFlow;

use caudal::error::Error;
use caudal::integrator::METHODS;
use caudal::newton::Newton;
use caudal::scene::{Scene, StartTable};
use caudal::stepper::Stepper;
use caudal::variable::VARIABLES;
use common::{DRAG, GLYCEROL, RAMP, SILICONE, WAVE, distance, order, run, scene, scene_by};

const SWIMMER: [&str; 6] = [SILICONE, WAVE, DRAG, GLYCEROL, RAMP, "solver.duration_s=0.5"];

/// The swimmer with steps by the tolerance of every method that has them.
fn adaptive(tolerance: f64) -> impl Iterator<Item = Scene> {
    METHODS.iter().filter(|method| method.adaptive).map(move |method| {
        let set = [format!("solver.integrator={}", method.name), format!("solver.tolerance={tolerance:e}")];
        scene(&[&SWIMMER[..], &[&set[0], &set[1]]].concat())
    })
}

#[test]
fn the_error_of_a_run_falls_with_its_tolerance_and_so_does_the_step() {
    let exact = run(&scene_by(METHODS[1], 2e-5, &SWIMMER)); // newmark
    let runs: Vec<_> = [1e-2, 1e-3, 1e-4, 1e-5].into_iter().flat_map(adaptive).map(|scene| run(&scene)).collect();
    let errors: Vec<f64> = runs.iter().map(|run| distance(&run.state().q, &exact.state().q)).collect();
    let steps: Vec<u64> = runs.iter().map(|run| run.metrics().totals.steps).collect();
    println!("{errors:?} {steps:?}");
    for (error, tolerance) in errors.iter().zip([1e-2, 1e-3, 1e-4, 1e-5]) {
        assert!(*error < tolerance, "{errors:?}");
    }
    assert!(errors.is_sorted_by(|a, b| a > b) && steps.is_sorted(), "{errors:?} {steps:?}");
}

#[test]
fn adaptive_steps_end_exactly_where_the_host_asks_and_a_snapshot_goes_on_equal_to_the_bit() {
    for scene in adaptive(1e-4) {
        let mut stepper = Stepper::of(&scene).unwrap();
        for h in [0.1, 0.003, 1e-5, 0.2] {
            let end = stepper.time() + h;
            stepper.do_step(h).unwrap();
            assert_eq!(stepper.time(), end);
        }
        let snapshot = stepper.save();
        stepper.do_step(0.05).unwrap();
        let (state, metrics) = (stepper.state().clone(), stepper.metrics().clone());
        stepper.restore(&snapshot).unwrap();
        stepper.do_step(0.05).unwrap();
        assert_eq!((stepper.state(), stepper.metrics()), (&state, &metrics));
    }
}

#[test]
fn a_step_cut_short_by_the_host_does_not_shorten_the_next_ones() {
    for scene in adaptive(1e-4) {
        let steps = |cuts: u32| {
            let mut stepper = Stepper::of(&scene).unwrap();
            (0..cuts).for_each(|_| stepper.do_step(0.5 / f64::from(cuts)).unwrap());
            stepper.metrics().totals.steps
        };
        // Measured: 196, 201.
        let (whole, cut) = (steps(1), steps(10));
        assert!(cut <= whole + 10, "{whole} {cut}");
    }
}

#[test]
fn a_tolerance_that_rounding_forbids_is_refused_with_its_numbers() {
    for mut scene in adaptive(1e-60) {
        scene.start = StartTable::default(); // in motion
        let mut stepper = Stepper::of(&scene).unwrap();
        let error = stepper.do_step(0.5).unwrap_err();
        assert!(matches!(error, Error::Tolerance { tolerance: 1e-60, .. }), "{error}");
        assert!(stepper.time() < 0.5 && stepper.get("x_m").is_ok());
    }
}

/// A run of the swimmer by ESDIRK3 in steps of `h`; made without its scene, so that it takes over from one of other steps.
fn esdirk3(h: f64) -> Stepper {
    let method = METHODS.iter().find(|method| method.name == "esdirk3").unwrap();
    let scene = scene_by(method, h, &SWIMMER);
    let (model, tolerance) = (scene.model().unwrap(), scene.newton_tolerance());
    let newton = Newton::with(scene.form(&model.rod), scene.solver.linear, model.rod.nodes, tolerance).unwrap();
    Stepper::init(model, scene.integrator().unwrap(), newton, h).unwrap()
}

#[test]
fn dense_output_is_of_fourth_order_in_positions_and_work() {
    let work = VARIABLES.iter().find(|variable| variable.name == "actuation_work_j").unwrap();
    let mut fine = esdirk3(1e-4);
    fine.do_step(0.400_03).unwrap(); // no multiple of the step, so that the clock starts anew there
    let start = fine.save();
    let errors = [8e-3, 4e-3, 2e-3].map(|h| {
        fine.restore(&start).unwrap();
        let mut coarse = esdirk3(h);
        coarse.restore(&start).unwrap();
        coarse.do_step(h).unwrap();
        fine.do_step(0.5 * h).unwrap();
        let end = coarse.state().clone();
        let errors = coarse
            .at(fine.time(), |view| {
                assert_eq!((view.state.t, view.metrics.now.time), (fine.time(), fine.time()));
                let position = distance(&view.state.q, &fine.state().q);
                [position, (work.first(view) - work.first(&fine.view())).abs()]
            })
            .unwrap();
        assert_eq!(*coarse.state(), end);
        errors
    });
    for pair in errors.windows(2) {
        let orders = [0, 1].map(|i| order(pair[0][i], pair[1][i]));
        println!("{orders:?} {errors:?}");
        assert!(orders.iter().all(|order| *order > 3.0), "{orders:?} {errors:?}");
    }
}

#[test]
fn nothing_is_read_outside_the_last_step() {
    let mut stepper = esdirk3(2e-3);
    let outside = |stepper: &mut Stepper, t: f64| {
        let error = stepper.at(t, |_| ()).unwrap_err();
        assert!(matches!(error, Error::OutsideStep { .. }), "{error}");
    };
    outside(&mut stepper, 1e-3);
    stepper.do_step(4e-3).unwrap();
    stepper.at(2e-3, |_| ()).unwrap();
    for t in [1.9e-3, 4.1e-3, f64::NAN] {
        outside(&mut stepper, t);
    }
    stepper.set("actuation_phase_rad", &[0.1]).unwrap();
    outside(&mut stepper, 3e-3);
    stepper.at(4e-3, |_| ()).unwrap();
}

#[test]
fn a_look_that_breaks_ends_the_step_there_and_the_next_goes_on() {
    let mut stepper = esdirk3(2e-3);
    let come = stepper.do_step_with(1e-2, |stepper| match stepper.metrics().totals.steps {
        3 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    assert!(!come.unwrap());
    assert_eq!((stepper.time(), stepper.metrics().totals.steps), (3.0 * 2e-3, 3));
    stepper.do_step(4e-3).unwrap();
    let mut whole = esdirk3(2e-3);
    whole.do_step(1e-2).unwrap();
    assert_eq!(stepper.state(), whole.state());
}

#[test]
fn every_method_keeps_its_order_where_a_host_changes_an_input_abruptly() {
    for method in METHODS {
        let wanted = f64::from((method.build)(&method.defaults()).order()).min(2.0);
        let ends = [4e-4, 2e-4, 1e-4, 5e-5].map(|h| {
            let mut stepper = Stepper::of(&scene_by(method, h, &SWIMMER)).unwrap();
            for i in 0..5 {
                stepper.set("force_y_n", &[f64::from(i % 2); 9]).unwrap();
                stepper.do_step(0.02).unwrap();
            }
            stepper.state().q.clone()
        });
        let changes: Vec<f64> = ends.windows(2).map(|pair| distance(&pair[0], &pair[1])).collect();
        let observed = order(changes[1], changes[2]);
        println!("{}: {observed} {changes:?}", method.name);
        assert!(observed > wanted - 0.1, "{}: order {observed}, {changes:?}", method.name);
    }
}
