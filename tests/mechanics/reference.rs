//! The scenes of `tests/reference` end where an independent implementation of the same equations ends.

use crate::common;
use std::path::Path;

use caudal::scene::Scene;
use serde_json::Value;

/// Largest deviation allowed, m. Measured: at most 3.6e-12 m (glycerol_jump_n9).
const TOLERANCE: f64 = 1e-8;

#[test]
fn every_reference_scene_ends_where_the_independent_implementation_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let number = |value: &Value| value.as_f64().unwrap();
    let mut scenes = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let expected: Value =
            serde_json::from_str(&std::fs::read_to_string(path.with_extension("json")).unwrap()).unwrap();
        let stepper = common::run(&Scene::load(&path).unwrap());
        let (state, metrics) = (stepper.state(), stepper.metrics());
        let mut pairs = vec![
            (metrics.now.com.x, number(&expected["x_com_m"])),
            (metrics.now.com.y, number(&expected["y_com_m"])),
            (metrics.net_displacement(), number(&expected["net_displacement_m"])),
            (metrics.totals.max_lateral, number(&expected["max_lateral_excursion_m"])),
        ];
        let positions = expected["final_positions_m"].as_array().unwrap();
        assert_eq!(2 * positions.len(), state.q.len());
        for (k, position) in positions.iter().enumerate() {
            pairs.extend((0..2).map(|i| (state.q[2 * k + i], number(&position[i]))));
        }
        let worst = pairs.iter().map(|(found, expected)| (found - expected).abs()).fold(0.0, f64::max);
        println!("{}: largest deviation {worst:e} m", path.display());
        assert!(worst <= TOLERANCE, "{}: {worst:e} m", path.display());
        scenes += 1;
    }
    assert_eq!(scenes, 5);
}
