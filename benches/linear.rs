//! Factoring and solving the Jacobian of a step of implicit Euler, the study's tail, Δt = 5 ms: time per node.
//!
//! LAPACK's band solver is measured too where OpenBLAS is installed; `OPENBLAS_NUM_THREADS=1` keeps it to one core, as
//! the others are.

#![allow(clippy::unwrap_used, missing_docs, reason = "a benchmark may panic; criterion's macros write no documents")]
#![allow(unsafe_code, reason = "LAPACK is loaded at run time and called through its Fortran interface")]

use std::ffi::{c_char, c_int};
use std::hint::black_box;
use std::sync::Arc;

use caudal::linear::Direction;
use caudal::linear::{BandMatrix, BlockBand, FaerLu, FallbackSolver, LinearSolver, SolverChoice};
use caudal::model::Dynamics;
use caudal::scene::Document;
use caudal::system::{Linearisation, System};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use libloading::Library;

/// Step size, s.
const H: f64 = 5e-3;

/// The Jacobian and the residual at the start of the study's tail with `nodes` nodes.
fn system(nodes: usize) -> (BandMatrix, Vec<f64>) {
    let mut document = Document::read("models/baseline.toml".as_ref()).unwrap();
    document.set(&format!("rod.nodes={nodes}")).unwrap();
    let mut dynamics = Dynamics::new(Arc::new(document.scene().unwrap().model().unwrap()));
    let state = dynamics.first_state();
    let (mut matrix, mut residual) = (BandMatrix::new(nodes), vec![0.0; 2 * nodes]);
    let direction = Direction { q: H * H, v: H, a: 1.0 };
    dynamics.assemble(&state, &mut residual, Some(Linearisation { matrix: &mut matrix, direction })).unwrap();
    (matrix, residual)
}

type Dgbtrf = unsafe extern "C" fn(
    m: *const c_int,
    n: *const c_int,
    kl: *const c_int,
    ku: *const c_int,
    ab: *mut f64,
    ldab: *const c_int,
    ipiv: *mut c_int,
    info: *mut c_int,
);

type Dgbtrs = unsafe extern "C" fn(
    trans: *const c_char,
    n: *const c_int,
    kl: *const c_int,
    ku: *const c_int,
    nrhs: *const c_int,
    ab: *const f64,
    ldab: *const c_int,
    ipiv: *const c_int,
    b: *mut f64,
    ldb: *const c_int,
    info: *mut c_int,
    trans_length: usize,
);

/// LAPACK's band LU with partial pivoting.
struct Lapack {
    dgbtrf: Dgbtrf,
    dgbtrs: Dgbtrs,
    _library: Library,
}

impl Lapack {
    /// Half-bandwidth.
    const K: usize = 5;

    /// Rows of the band storage, K of them for fill.
    const ROWS: usize = 3 * Self::K + 1;

    fn load() -> Option<Self> {
        ["libopenblas.so.0", "libopenblas.so", "libopenblas.dylib"].into_iter().find_map(|name| {
            // SAFETY: loading OpenBLAS runs its own initialisation only; the two functions have LAPACK's signatures.
            unsafe {
                let library = Library::new(name).ok()?;
                let dgbtrf = *library.get::<Dgbtrf>(b"dgbtrf_\0").ok()?;
                let dgbtrs = *library.get::<Dgbtrs>(b"dgbtrs_\0").ok()?;
                Some(Self { dgbtrf, dgbtrs, _library: library })
            }
        })
    }

    /// The matrix in LAPACK's band storage: entry (i, j) in row 2K + i − j of column j.
    fn pack(matrix: &BandMatrix) -> Vec<f64> {
        let n = matrix.unknowns();
        let mut packed = vec![0.0; Self::ROWS * n];
        for j in 0..n {
            for i in j.saturating_sub(Self::K)..(j + Self::K + 1).min(n) {
                packed[Self::ROWS * j + 2 * Self::K + i - j] = matrix.entry(i, j);
            }
        }
        packed
    }

    fn factor_and_solve(&self, packed: &mut [f64], pivots: &mut [c_int], rhs: &mut [f64]) {
        let [n, k, rows, one, mut info] = [rhs.len(), Self::K, Self::ROWS, 1, 0].map(|n| n as c_int);
        assert!(packed.len() == Self::ROWS * rhs.len() && pivots.len() == rhs.len());
        // SAFETY: the slices have the lengths that LAPACK is told.
        unsafe {
            (self.dgbtrf)(&n, &n, &k, &k, packed.as_mut_ptr(), &rows, pivots.as_mut_ptr(), &mut info);
            assert_eq!(info, 0);
            let (ab, ipiv, b) = (packed.as_ptr(), pivots.as_ptr(), rhs.as_mut_ptr());
            (self.dgbtrs)(&(b'N' as c_char), &n, &k, &k, &one, ab, &rows, ipiv, b, &n, &mut info, 1);
        }
        assert_eq!(info, 0);
    }
}

fn linear(criterion: &mut Criterion) {
    let lapack = Lapack::load();
    if lapack.is_none() {
        println!("linear/lapack: skipped, OpenBLAS is not installed");
    }
    let mut group = criterion.benchmark_group("linear");
    for nodes in [9, 129, 1_000, 10_000, 100_000] {
        group.throughput(Throughput::Elements(nodes as u64));
        let id = |name: &str| BenchmarkId::new(name, nodes);
        let (matrix, residual) = system(nodes);
        let mut x = residual.clone();

        let band: Box<dyn LinearSolver> = Box::new(BlockBand::analyse(&matrix).unwrap());
        let lu: Box<dyn LinearSolver> = Box::new(FaerLu::analyse(&matrix).unwrap());
        for (name, mut solver) in [("block-band", band), ("faer-lu", lu)] {
            group.bench_function(id(name), |b| {
                b.iter(|| {
                    x.copy_from_slice(black_box(&residual));
                    solver.factor_and_solve(black_box(&matrix), &mut x).unwrap();
                });
            });
        }
        let mut chosen = FallbackSolver::new(SolverChoice::Auto, &matrix).unwrap();
        group.bench_function(id("auto"), |b| {
            b.iter(|| {
                x.copy_from_slice(black_box(&residual));
                assert!(!chosen.solve(black_box(&matrix), &mut x).unwrap().fallback);
            });
        });
        let mut band = BlockBand::analyse(&matrix).unwrap();
        group.bench_function(id("block-band-factors-kept"), |b| {
            b.iter(|| {
                x.copy_from_slice(black_box(&residual));
                band.factor(black_box(&matrix)).unwrap();
                band.solve(&mut x);
            });
        });
        group.bench_function(id("backward-error"), |b| b.iter(|| matrix.backward_error(black_box(&x), &residual)));

        // LAPACK factors in place, so its matrix is copied every time: the copy is timed alone too.
        if let Some(lapack) = &lapack {
            let packed = Lapack::pack(&matrix);
            let (mut factors, mut pivots) = (packed.clone(), vec![0; 2 * nodes]);
            group.bench_function(id("lapack-copy"), |b| b.iter(|| factors.copy_from_slice(black_box(&packed))));
            group.bench_function(id("lapack"), |b| {
                b.iter(|| {
                    factors.copy_from_slice(black_box(&packed));
                    x.copy_from_slice(black_box(&residual));
                    lapack.factor_and_solve(&mut factors, &mut pivots, &mut x);
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, linear);
criterion_main!(benches);
