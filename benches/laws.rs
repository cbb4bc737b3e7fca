//! One step by what acts on the rod: nothing, the default drag (`cox`), `cross-flow`, and all of the water (`cross-flow`,
//! `[reactive]` and buoyancy), of the eel of `models/`. Beside the times it prints each over that of `cox`, a step and an iteration,
//! from steps taken in turns, so that other work on the machine weighs on all alike: `cargo bench --bench laws`, or
//! `cargo bench --bench laws -- --test` for the ratios alone.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;
use std::time::Instant;

use caudal::scene::Document;
use caudal::stepper::Stepper;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// Step size, s.
const H: f64 = 5e-3;

/// Steps before anything is measured: the eel swims by then.
const STEPS: u32 = 100;

/// Turns of [`ratios`].
const TURNS: usize = 60;

/// A name and what is changed in the scene, a whole table at a time.
const CASES: [(&str, &[(&str, &str)]); 4] = [
    ("nothing", &[("[drag]\nlaw = \"cross-flow\"", ""), ("[reactive]", "")]),
    ("cox", &[("\"cross-flow\"", "\"cox\""), ("[reactive]", "")]),
    ("cross-flow", &[("[reactive]", "")]),
    ("everything", &[("[reactive]", "[reactive]\n\n[loads]\ngravity_m_s2 = [0.0, -9.81]\nbuoyancy = true")]),
];

fn stepper(changes: &[(&str, &str)], nodes: usize) -> Stepper {
    let mut text = include_str!("../models/eel.toml").to_string();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let mut document = Document::new("eel.toml", &text);
    document.set(&format!("rod.nodes={nodes}")).unwrap();
    let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
    for _ in 0..STEPS {
        stepper.do_step(H).unwrap();
    }
    stepper
}

/// Prints the time of a step of every case, and of an iteration, over that of `cox`: the fastest of many turns, each over the
/// same steps.
fn ratios(nodes: usize) {
    let steps = if nodes > 1000 { 4 } else { 10 };
    let turns = if nodes > 1001 { TURNS / 3 } else { TURNS };
    let mut steppers = CASES.map(|(_, changes)| stepper(changes, nodes));
    let mut iterations = [0; CASES.len()];
    let mut fastest = [[f64::INFINITY; 2]; CASES.len()];
    for _ in 0..turns {
        for (i, stepper) in steppers.iter_mut().enumerate() {
            let before = stepper.work().newton_iterations;
            let start = Instant::now();
            (0..steps).for_each(|_| stepper.do_step(black_box(H)).unwrap());
            let (time, made) = (start.elapsed().as_secs_f64(), stepper.work().newton_iterations - before);
            iterations[i] += made;
            for (fastest, time) in fastest[i].iter_mut().zip([time / f64::from(steps), time / made as f64]) {
                *fastest = fastest.min(time);
            }
        }
    }
    for (i, (name, _)) in CASES.iter().enumerate() {
        let [step, iteration] = [0, 1].map(|of| fastest[i][of] / fastest[1][of]);
        let iterations = iterations[i] as f64 / f64::from(steps) / turns as f64;
        println!(
            "laws/{name}/{nodes}: a step {step:.2} of cox, an iteration {iteration:.2}, {iterations:.2} iterations per step"
        );
    }
}

fn laws(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("laws");
    for nodes in [9, 101, 1001, 10_001] {
        group.throughput(Throughput::Elements(nodes as u64));
        for (name, changes) in CASES {
            let mut stepper = stepper(changes, nodes);
            group.bench_function(BenchmarkId::new(name, nodes), |b| b.iter(|| stepper.do_step(black_box(H)).unwrap()));
        }
        ratios(nodes);
    }
    group.finish();
}

criterion_group!(benches, laws);
criterion_main!(benches);
