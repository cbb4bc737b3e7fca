//! One Newton iteration and its parts, and one step of implicit Euler: the study's tail, Δt = 5 ms, time per node.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;
use std::sync::Arc;

use caudal::linear::Direction;
use caudal::linear::{BandMatrix, FallbackSolver, SolverChoice};
use caudal::model::Dynamics;
use caudal::newton::Newton;
use caudal::scene::{Document, Scene};
use caudal::stepper::Stepper;
use caudal::system::{Linearisation, System};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

/// Step size, s.
const H: f64 = 5e-3;

/// The direction of implicit Euler.
const DIRECTION: Direction = Direction { q: H * H, v: H, a: 1.0 };

/// Steps before anything is measured: by then the jump start has rung down.
const STEPS: u32 = 100;

/// The study's tail with `nodes` nodes.
fn scene(nodes: usize) -> Scene {
    let mut document = Document::new("baseline.toml", include_str!("../models/baseline.toml"));
    document.set(&format!("rod.nodes={nodes}")).unwrap();
    let scene = document.scene().unwrap();
    assert_eq!(scene.typical_step(), H);
    scene
}

fn newton(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("newton");
    for nodes in [9, 101, 1001] {
        group.throughput(Throughput::Elements(nodes as u64));
        let id = |name: &str| BenchmarkId::new(name, nodes);

        let scene = scene(nodes);
        let mut stepper = Stepper::of(&scene).unwrap();
        for _ in 0..STEPS {
            stepper.do_step(H).unwrap();
        }
        let mut dynamics = Dynamics::new(Arc::new(scene.model().unwrap()));
        let mut state = stepper.state().clone();
        dynamics.move_to(state.t, &mut state);
        let mut matrix = BandMatrix::new(nodes);
        let mut residual = vec![0.0; 2 * nodes];

        group.bench_function(id("assemble"), |b| {
            b.iter(|| {
                let jacobian = Linearisation { matrix: &mut matrix, direction: DIRECTION };
                dynamics.assemble(black_box(&state), &mut residual, Some(jacobian)).unwrap();
            });
        });
        let mut solver = FallbackSolver::new(SolverChoice::default(), &matrix).unwrap();
        let mut solution = residual.clone();
        group.bench_function(id("solve"), |b| {
            b.iter(|| {
                solution.copy_from_slice(black_box(&residual));
                solver.solve(black_box(&matrix), &mut solution).unwrap();
            });
        });

        // At the solution an iteration costs what it costs anywhere, and moves nothing.
        let mut newton = Newton::new(nodes, 1e-10).unwrap();
        group.bench_function(id("iteration"), |b| {
            b.iter(|| newton.iterate(&mut dynamics, black_box(&mut state), DIRECTION).unwrap());
        });

        // Step after step of the run; what a step needs varies over the period, so the mean is what counts.
        let before = (stepper.metrics().totals.steps, stepper.work().newton_iterations);
        group.bench_function(id("step"), |b| b.iter(|| stepper.do_step(black_box(H)).unwrap()));
        let steps = stepper.metrics().totals.steps - before.0;
        let iterations = stepper.work().newton_iterations - before.1;
        println!("newton/step/{nodes}: {:.2} iterations per step, {steps} steps", iterations as f64 / steps as f64);
    }
    group.finish();
}

criterion_group!(benches, newton);
criterion_main!(benches);
