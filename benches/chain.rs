//! One Newton iteration in the chain form and its parts, time per node: the study's tail in water, Δt = 1 ms.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;
use std::sync::Arc;

use caudal::linear::Direction;
use caudal::linear::{ChainMatrix, Riccati, SolverChoice};
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::scene::Document;
use caudal::system::{Form, System};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// The direction of implicit Euler.
const DIRECTION: Direction = Direction { q: 1e-6, v: 1e-3, a: 1.0 };

fn chain(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("chain");
    for nodes in [101, 1001, 100_001] {
        group.throughput(Throughput::Elements(nodes as u64));
        let id = |name: &str| BenchmarkId::new(name, nodes);
        let mut document =
            Document::read(concat!(env!("CARGO_MANIFEST_DIR"), "/models/baseline-smooth.toml").as_ref()).unwrap();
        document.set(&format!("rod.nodes={nodes}")).unwrap();
        let mut dynamics = Dynamics::new(Arc::new(document.scene().unwrap().model().unwrap()));
        let mut state = dynamics.first_state_in(Form::Chain);
        dynamics.move_to(1e-3, &mut state);
        let mut newton = Newton::with(Form::Chain, SolverChoice::default(), nodes, 1e-12).unwrap();
        newton.solve(&mut dynamics, &mut state, DIRECTION).unwrap();

        let mut matrix = ChainMatrix::new(nodes);
        let mut residual = vec![0.0; matrix.unknowns()];
        group.bench_function(id("assemble"), |b| {
            b.iter(|| dynamics.assemble_chain(black_box(&state), DIRECTION, &mut residual, &mut matrix).unwrap());
        });
        let (mut riccati, mut solution) = (Riccati::new(nodes), residual.clone());
        group.bench_function(id("solve"), |b| {
            b.iter(|| assert!(!riccati.solve(&matrix, black_box(&residual), &mut solution)));
        });
        group.bench_function(id("iteration"), |b| {
            b.iter(|| newton.iterate(&mut dynamics, black_box(&mut state), DIRECTION).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, chain);
criterion_main!(benches);
