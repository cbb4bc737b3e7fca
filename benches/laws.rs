//! One step by what acts on the rod: nothing, the default drag (`cox`), `cross-flow`, and all of the water (`cross-flow` and
//! `[reactive]`), of the eel of `models/`. Beside the times it prints each over that of `cox`, from steps taken in turns, so that
//! other work on the machine weighs on all alike: `cargo bench --bench laws`.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;
use std::time::{Duration, Instant};

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
    ("everything", &[]),
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

/// Prints the time of a step of every case over that of `cox`: the fastest of many turns of ten steps each.
fn ratios(nodes: usize) {
    let mut steppers = CASES.map(|(_, changes)| stepper(changes, nodes));
    let work = |stepper: &Stepper| (stepper.meter().totals.steps, stepper.work().newton_iterations);
    let before: Vec<_> = steppers.iter().map(work).collect();
    let mut fastest = [Duration::MAX; CASES.len()];
    for _ in 0..TURNS {
        for (stepper, fastest) in steppers.iter_mut().zip(&mut fastest) {
            let start = Instant::now();
            (0..10).for_each(|_| stepper.do_step(black_box(H)).unwrap());
            *fastest = (*fastest).min(start.elapsed());
        }
    }
    for (i, (name, _)) in CASES.iter().enumerate() {
        let (steps, iterations) = work(&steppers[i]);
        let iterations = (iterations - before[i].1) as f64 / (steps - before[i].0) as f64;
        let ratio = fastest[i].as_secs_f64() / fastest[1].as_secs_f64();
        println!("laws/{name}/{nodes}: {ratio:.2} of cox, {iterations:.2} iterations per step");
    }
}

fn laws(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("laws");
    for nodes in [9, 101, 1001] {
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
