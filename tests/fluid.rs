//! The fluid's laws against independent answers, see `tests/reference/fluid`.

mod common;

use std::path::Path;

use caudal::scene::Scene;
use common::{run, scene_files};
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().flat_map(numbers).collect(),
        Value::Number(x) => vec![x.as_f64().unwrap()],
        _ => Vec::new(),
    }
}

#[test]
fn scenes_in_fluids_agree_with_an_independent_program() {
    for path in scene_files("tests/reference/fluid") {
        let answer = path.with_extension("json");
        if !answer.exists() {
            continue;
        }
        let scene = match Scene::load(&path) {
            Ok(s) => s,
            Err(e) => {
                println!("{e}");
                continue;
            }
        };
        let answer: Value = serde_json::from_str(&std::fs::read_to_string(&answer).unwrap()).unwrap();
        let expected = numbers(&answer["final_positions_m"]);
        let stepper = run(&scene);
        let found = &stepper.state().q;
        let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let now = &stepper.meter().now;
        println!("{}: {:.2e} of the length", scene.name, off / scene.rod.length_m.get());
        if let Some(p) = answer["drag_power_w"].as_f64() {
            println!(
                "   drag power {} {p}; wake {} {}; fluid {} {}",
                now.power.viscous, now.power.wake, answer["wake_power_w"], now.energy.fluid, answer["fluid_kinetic_j"]
            );
        }
    }
    let _ = Path::new("");
}
