//! Without a fluid and loads nothing changes the momentum of a free rod.

use crate::common;
use caudal::integrator::METHODS;
use caudal::rod::{Rod, node};
use caudal::system::State;
use common::{RAMP, SILICONE, WAVE, order, run, run_with, scene_by};
use nalgebra::Vector2;

fn linear(rod: &Rod, state: &State) -> Vector2<f64> {
    rod.mass.iter().enumerate().map(|(k, m)| node(&state.v, k) * *m).sum()
}

fn angular(rod: &Rod, state: &State) -> f64 {
    rod.mass.iter().enumerate().map(|(k, m)| node(&state.q, k).perp(&node(&state.v, k)) * m).sum()
}

/// Σ m|v|, kg m/s.
fn size(rod: &Rod, state: &State) -> f64 {
    rod.mass.iter().enumerate().map(|(k, m)| node(&state.v, k).norm() * m).sum()
}

#[test]
fn linear_momentum_stays_zero_to_rounding_for_every_method_and_start() {
    for method in METHODS {
        for start in [RAMP, "start.kind=jump", "start.kind=shaped"] {
            let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
            run_with(&scene_by(method, 1e-3, &[SILICONE, WAVE, start, "solver.duration_s=0.2"]), |stepper| {
                let rod = &stepper.model().rod;
                worst = worst.max(linear(rod, stepper.state()).norm());
                largest = largest.max(size(rod, stepper.state()));
            });
            // Measured: at most 4.0e-16 of Σ m|v|. Roundings add up: 2.5e-15 in 800 steps of 0.25 ms (newmark, shaped).
            assert!(largest > 0.3, "{}, {start}: {largest}", method.name);
            assert!(worst <= 1e-15 * largest, "{}, {start}: {:e}", method.name, worst / largest);
        }
    }
}

#[test]
fn the_error_of_angular_momentum_vanishes_at_the_method_s_order() {
    for method in METHODS {
        let wanted = f64::from((method.build)(&method.defaults()).order());
        let errors = [4e-4, 2e-4, 1e-4].map(|time_step| {
            let stepper = run(&scene_by(method, time_step, &[SILICONE, WAVE, RAMP, "solver.duration_s=0.2"]));
            angular(&stepper.model().rod, stepper.state())
        });
        if method.name == "symplectic-euler" {
            // Internal forces act along the lines that positions move on: exact. Measured: 2.2e-16 kg m²/s.
            assert!(errors.iter().all(|error| error.abs() < 1e-14), "{errors:?}");
            continue;
        }
        for pair in errors.windows(2) {
            // Measured: 0.975, 0.987 (implicit-euler), 2.000, 2.000 (newmark, generalized-alpha), 3.5, 3.4 (esdirk3).
            let observed = order(pair[0], pair[1]);
            assert!(observed > wanted - 0.1, "{}: order {observed}, {errors:?}", method.name);
        }
    }
}

#[test]
fn a_jet_at_the_tip_of_a_free_rod_accelerates_it_along_itself_and_its_work_is_that_of_its_force() {
    let jet = "loads={ point = [{ node = -1, follows = true, force_n = [-0.02, 0.0] }] }";
    for method in METHODS {
        let scene = scene_by(method, 1e-4, &[SILICONE, jet, "start.kind=jump", "solver.duration_s=0.2"]);
        let stepper = run(&scene);
        let (rod, state) = (&stepper.model().rod, stepper.state());
        // Straight it stays, so the jet pushes along x towards the head for good.
        let gained = linear(rod, state);
        assert!((gained - Vector2::new(-0.004, 0.0)).norm() < 1e-12, "{}: {gained}", method.name);
        // F·v of the tip, whose velocity differs from the mean by the waves of stretching.
        let work = stepper.get_scalar("other_work_j").unwrap();
        let kinetic = 0.004 * 0.004 / (2.0 * rod.total_mass());
        assert!((work / kinetic - 1.0).abs() < 0.05, "{}: {work:e} {kinetic:e}", method.name);
    }
    // Askew it turns the rod, and the work closes the balance to the method's order.
    let askew = "loads={ point = [{ node = -1, follows = true, force_n = [-0.02, 0.01] }] }";
    let defect = |time_step: f64| {
        let newmark = caudal::integrator::Method::named("newmark").unwrap();
        let stepper =
            run(&scene_by(newmark, time_step, &[SILICONE, askew, "start.kind=jump", "solver.duration_s=0.2"]));
        let metrics = stepper.metrics();
        (metrics.numerical_dissipation().abs(), metrics.totals.work.other)
    };
    let ((coarse, work), (fine, _)) = (defect(4e-4), defect(2e-4));
    println!("defect {coarse:e}, {fine:e} of {work:e} J");
    assert!(work > 0.0 && coarse < 1e-3 * work, "{coarse:e} {work:e}");
    assert!(order(coarse, fine) > 1.8, "{coarse:e} {fine:e}");
}
