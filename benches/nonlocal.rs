//! One step with nonlocal drag, of the sperm of `models/`, and the dense solve in it by faer, beside nalgebra's.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;

use caudal::linear::DenseLu;
use caudal::scene::Document;
use caudal::stepper::Stepper;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{DMatrix, DVector};

/// Step size, s.
const H: f64 = 2.5e-4;

/// Steps before anything is measured: the ramp is over by then.
const STEPS: u32 = 240;

const NODES: [usize; 2] = [33, 129];

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("nonlocal");
    for nodes in NODES {
        let mut document = Document::read("models/sperm.toml".as_ref()).unwrap();
        document.set("drag.law=nonlocal").unwrap();
        document.set(&format!("rod.nodes={nodes}")).unwrap();
        let mut stepper = Stepper::of(&document.scene().unwrap()).unwrap();
        for _ in 0..STEPS {
            stepper.do_step(H).unwrap();
        }
        let work = |stepper: &Stepper| (stepper.metrics().totals.steps, stepper.work().newton_iterations);
        let before = work(&stepper);
        group.bench_function(BenchmarkId::new("step", nodes), |b| b.iter(|| stepper.do_step(black_box(H)).unwrap()));
        let after = work(&stepper);
        println!("{nodes} nodes: {:.2} iterations a step", (after.1 - before.1) as f64 / (after.0 - before.0) as f64);
    }
}

fn dense(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("dense");
    for size in NODES.map(|nodes| 2 * nodes) {
        let matrix = DMatrix::from_fn(size, size, |i, j| 1.0 / (1.0 + i.abs_diff(j) as f64));
        let rhs = DVector::from_fn(size, |i, _| i as f64);
        let mut lu = DenseLu::new(size);
        group.bench_function(BenchmarkId::new("faer", size), |b| {
            b.iter(|| {
                lu.values_mut().copy_from_slice(matrix.as_slice());
                lu.factor();
                let mut x = black_box(&rhs).as_slice().to_vec();
                lu.solve(&mut x);
                x
            });
        });
        group.bench_function(BenchmarkId::new("nalgebra", size), |b| {
            b.iter(|| matrix.clone().lu().solve(black_box(&rhs)).unwrap());
        });
    }
}

criterion_group!(benches, step, dense);
criterion_main!(benches);
