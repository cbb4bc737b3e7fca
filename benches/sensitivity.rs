//! What derivatives cost: a simulation, the same with all sensitivities to stiffness, and its adjoint. 17 nodes.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]

use std::hint::black_box;

use caudal::scene::{Document, Scene};
use caudal::sensitivity::{Output, Parameter, Problem, Quantity};
use caudal::stepper::Stepper;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};

fn scene(integrator: &str) -> Scene {
    let mut document = Document::new("silicone.toml", include_str!("../tests/reference/silicone_n17.toml"));
    document.set(&format!("solver.integrator={integrator}")).unwrap();
    document.set("solver.duration_s=1.0").unwrap();
    document.scene().unwrap()
}

fn sensitivity(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sensitivity");
    group.sample_size(20);
    for integrator in ["implicit-euler", "generalized-alpha"] {
        let scene = scene(integrator);
        let mut problem = Problem::of(&scene).unwrap();
        let joints: Vec<Parameter> = problem.model().rod.joints().map(Parameter::Stiffness).collect();
        let outputs = [Output::from(Quantity::CentreOfMass(0))];
        group.bench_function(BenchmarkId::new("run", integrator), |b| {
            b.iter(|| {
                let mut stepper = Stepper::of(&scene).unwrap();
                stepper.do_step(black_box(1.0)).unwrap();
            });
        });
        group.bench_function(BenchmarkId::new("simulation", integrator), |b| b.iter(|| problem.simulate().unwrap()));
        group.bench_function(BenchmarkId::new("forward", integrator), |b| {
            b.iter(|| problem.forward(black_box(&joints), &outputs, 20, |_| {}).unwrap());
        });
        let trajectory = problem.simulate().unwrap();
        let mut weights = vec![0.0; trajectory.times.len()];
        weights[trajectory.times.len() - 1] = 1.0;
        group.bench_function(BenchmarkId::new("adjoint", integrator), |b| {
            b.iter(|| problem.adjoint(black_box(&joints), &outputs, &weights, &trajectory).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, sensitivity);
criterion_main!(benches);
