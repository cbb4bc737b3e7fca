//! Every method converges in the step size at the order it says it has.

use crate::common;
use caudal::integrator::METHODS;
use caudal::modes::Modes;
use common::{DRAG, GLYCEROL, RAMP, SILICONE, WAVE, distance, order, rod, run, scene_by};

#[test]
fn every_method_shows_its_order_where_the_step_resolves_every_mode() {
    for method in METHODS {
        let wanted = f64::from((method.build)(&method.defaults()).order());
        let ends = [4e-4, 2e-4, 1e-4, 5e-5].map(|time_step| {
            let scene = scene_by(method, time_step, &[SILICONE, WAVE, DRAG, GLYCEROL, RAMP, "solver.duration_s=0.2"]);
            // Measured: ω_max = 1055 rad/s.
            assert!(time_step * Modes::of(&rod(&scene)).unwrap().highest() < 1.0);
            let stepper = run(&scene);
            assert_eq!(stepper.metrics().totals.halvings, 0);
            stepper.state().q.clone()
        });
        let changes: Vec<f64> = ends.windows(2).map(|pair| distance(&pair[0], &pair[1])).collect();
        for pair in changes.windows(2) {
            // Measured: 0.942, 0.970 (implicit-euler), 1.999, 2.000 (newmark).
            let observed = order(pair[0], pair[1]);
            assert!((observed - wanted).abs() < 0.1, "{}: order {observed}, {changes:?}", method.name);
        }
    }
}
