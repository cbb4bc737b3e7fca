//! The matrix is what its dense twin is, and each solver solves what it is given or says that it cannot.

use crate::common;
use std::sync::Arc;

use caudal::linear::Direction;
use caudal::linear::{BandMatrix, BlockBand, FaerLu, FallbackSolver, LinearSolver, PivotedLu, SolverChoice};
use caudal::model::Dynamics;
use caudal::system::{Linearisation, System};
use common::{Dice, GLYCEROL, SILICONE, SOFT, STUDY, largest, scene_of};
use nalgebra::{DMatrix, DVector, Matrix2};

/// Every solver, prepared for matrices of `nodes` nodes.
fn solvers(nodes: usize) -> [Box<dyn LinearSolver>; 3] {
    let pattern = BandMatrix::new(nodes);
    [
        Box::new(BlockBand::analyse(&pattern).unwrap()),
        Box::new(PivotedLu::analyse(&pattern).unwrap()),
        Box::new(FaerLu::analyse(&pattern).unwrap()),
    ]
}

/// A random band matrix of `nodes` nodes and its dense twin, filled block by block in a random order, twice over.
fn random(nodes: usize, dice: &mut Dice) -> (BandMatrix, DMatrix<f64>) {
    let (mut band, mut dense) = (BandMatrix::new(nodes), DMatrix::zeros(2 * nodes, 2 * nodes));
    for _ in 0..2 {
        for i in 0..nodes {
            for j in i.saturating_sub(2)..(i + 3).min(nodes) {
                let block = Matrix2::from_fn(|_, _| dice.between(-1.0, 1.0));
                band.add_block(i, j, &block);
                let mut there = dense.view_mut((2 * i, 2 * j), (2, 2));
                there += block;
            }
        }
    }
    (band, dense)
}

fn assert_same(band: &BandMatrix, dense: &DMatrix<f64>) {
    for i in 0..dense.nrows() {
        for j in 0..dense.ncols() {
            assert_eq!(band.entry(i, j), dense[(i, j)], "entry ({i}, {j})");
        }
    }
}

#[test]
fn the_band_matrix_has_the_entries_of_its_dense_twin_and_none_outside_the_band() {
    for nodes in [1, 2, 3, 4, 5, 6, 9, 20] {
        let (mut band, dense) = random(nodes, &mut Dice(nodes as u64));
        assert_eq!(band.unknowns(), 2 * nodes);
        assert_same(&band, &dense);
        band.clear();
        assert_same(&band, &DMatrix::zeros(2 * nodes, 2 * nodes));
    }
}

#[test]
fn prescribing_a_node_makes_its_rows_and_columns_those_of_the_identity_and_touches_no_other() {
    for nodes in [3, 4, 5, 9] {
        for k in 0..nodes {
            let (mut band, mut dense) = random(nodes, &mut Dice(k as u64));
            band.prescribe(k);
            for i in 2 * k..2 * k + 2 {
                dense.row_mut(i).fill(0.0);
                dense.column_mut(i).fill(0.0);
                dense[(i, i)] = 1.0;
            }
            assert_same(&band, &dense);
        }
    }
}

#[test]
fn multiplying_is_the_dense_product_and_its_transpose() {
    for nodes in [1, 2, 3, 7, 30] {
        let mut dice = Dice(nodes as u64);
        let (band, dense) = random(nodes, &mut dice);
        let x = DVector::from(dice.many(2 * nodes, -1.0, 1.0));
        for (transposed, expected) in [(false, &dense * &x), (true, dense.transpose() * &x)] {
            let mut y = vec![f64::NAN; 2 * nodes];
            band.multiply(x.as_slice(), &mut y, transposed);
            let worst = largest((DVector::from(y) - expected).iter().copied());
            // Measured: 0, the sums have the same order.
            assert!(worst < 1e-14, "{nodes} nodes, transposed {transposed}: {worst:e}");
        }
    }
}

/// |A x − b| over |A| |x| + |b|, in the largest norm.
fn backward_error(matrix: &BandMatrix, x: &[f64], b: &[f64], transposed: bool) -> f64 {
    let mut product = vec![0.0; b.len()];
    matrix.multiply(x, &mut product, transposed);
    let size = (0..b.len())
        .map(|i| {
            let near = i.saturating_sub(8)..(i + 8).min(b.len());
            near.map(|j| if transposed { matrix.entry(j, i) } else { matrix.entry(i, j) }.abs()).sum::<f64>()
        })
        .fold(0.0, f64::max);
    let residual = largest(product.iter().zip(b).map(|(p, b)| p - b));
    residual / (size * largest(x.iter().copied()) + largest(b.iter().copied()))
}

/// A random band matrix without its dense twin.
fn large(nodes: usize, dice: &mut Dice) -> BandMatrix {
    let mut band = BandMatrix::new(nodes);
    for i in 0..nodes {
        for j in i.saturating_sub(2)..(i + 3).min(nodes) {
            band.add_block(i, j, &Matrix2::from_fn(|_, _| dice.between(-1.0, 1.0)));
        }
    }
    band
}

/// The same with heavier diagonal blocks, for a solver that does not pivot between blocks.
fn heavy(nodes: usize, dice: &mut Dice) -> BandMatrix {
    let mut band = large(nodes, dice);
    (0..nodes).for_each(|k| band.add_block(k, k, &Matrix2::new(5.0, 3.0, -3.0, 5.0)));
    band
}

/// The largest backward error of solutions for random right-hand sides: solved at once, from kept factors, transposed.
fn errors(solver: &mut dyn LinearSolver, band: &BandMatrix, dice: &mut Dice) -> [f64; 3] {
    let b = dice.many(band.unknowns(), -1.0, 1.0);
    let [mut at_once, mut kept, mut transposed] = [b.clone(), b.clone(), b.clone()];
    solver.factor_and_solve(band, &mut at_once).unwrap();
    solver.factor(band).unwrap();
    solver.solve(&mut kept);
    solver.solve_transposed(&mut transposed);
    [(at_once, false), (kept, false), (transposed, true)]
        .map(|(x, transposed)| backward_error(band, &x, &b, transposed))
}

#[test]
fn solutions_have_a_backward_error_of_rounding_size_for_every_number_of_nodes_and_for_the_transpose() {
    for (which, name) in ["block-band", "pivoted LU", "faer-lu"].iter().enumerate() {
        let mut worst = 0.0;
        for nodes in [1, 2, 3, 4, 5, 6, 7, 8, 9, 33, 200, 2000] {
            let mut dice = Dice(nodes as u64);
            // One analysis serves every matrix.
            let solver = &mut solvers(nodes)[which];
            for _ in 0..3 {
                let band = if which == 0 { heavy(nodes, &mut dice) } else { large(nodes, &mut dice) };
                let errors = errors(solver.as_mut(), &band, &mut dice);
                worst = errors.into_iter().fold(worst, f64::max);
                assert!(errors.iter().all(|error| *error < 1e-14), "{name}, {nodes} nodes: {errors:?}");
            }
        }
        // Measured: 1.7e-16, 1.2e-16 and 1.3e-16.
        println!("{name}: largest backward error {worst:e}");
    }
}

#[test]
fn small_solutions_are_those_of_the_dense_twin() {
    for seed in 0..50 {
        let mut dice = Dice(seed);
        let nodes = 3 + seed as usize % 4;
        let band = heavy(nodes, &mut dice);
        let dense = DMatrix::from_fn(2 * nodes, 2 * nodes, |i, j| band.entry(i, j));
        let b = DVector::from(dice.many(2 * nodes, -1.0, 1.0));
        let lu = dense.clone().lu();
        let expected = lu.solve(&b).unwrap();
        let condition = dense.norm() * lu.try_inverse().unwrap().norm();
        for mut solver in solvers(nodes) {
            let mut x = b.as_slice().to_vec();
            solver.factor_and_solve(&band, &mut x).unwrap();
            let worst = largest((DVector::from(x) - &expected).iter().copied()) / expected.amax() / condition;
            // Measured: 5.8e-17 times the condition number.
            assert!(worst < 1e-15, "{solver:?}, seed {seed}: {worst:e}");
        }
    }
}

/// True where every solver refuses the matrix, or answers with a value that is not finite.
fn is_refused(matrix: &BandMatrix) -> bool {
    let finite = |x: &[f64]| x.iter().all(|x| x.is_finite());
    let by_each = solvers(matrix.nodes()).into_iter().all(|mut solver| {
        let outcome = solver.factor(matrix);
        let mut x = vec![1.0; matrix.unknowns()];
        solver.solve(&mut x);
        let mut y = vec![1.0; matrix.unknowns()];
        solver.solve_transposed(&mut y);
        assert!(outcome.is_ok() || !(finite(&x) || finite(&y)), "an error leaves no answer");
        let mut z = vec![1.0; matrix.unknowns()];
        let at_once = solver.factor_and_solve(matrix, &mut z);
        !finite(&x) && !finite(&y) && (at_once.is_err() || !finite(&z))
    });
    by_each
        && [SolverChoice::Auto, SolverChoice::FaerLu, SolverChoice::BlockBand].into_iter().all(|choice| {
            let mut x = vec![1.0; matrix.unknowns()];
            FallbackSolver::new(choice, matrix).unwrap().solve(matrix, &mut x).is_err() || !finite(&x)
        })
}

#[test]
fn singular_matrices_are_refused_or_answered_with_values_that_are_not_finite() {
    for nodes in [1, 3, 9] {
        let zero = BandMatrix::new(nodes);
        assert!(is_refused(&zero), "zero matrix of {nodes} nodes");
    }
    for k in 0..6 {
        let (mut band, _) = random(6, &mut Dice(k));
        // An empty row and column.
        band.prescribe(k as usize);
        band.add_block(k as usize, k as usize, &Matrix2::new(-1.0, 0.0, 0.0, 0.0));
        assert!(is_refused(&band), "row {k} empty");
    }
    let mut nan = random(6, &mut Dice(0)).0;
    nan.add_block(3, 3, &Matrix2::from_element(f64::NAN));
    assert!(is_refused(&nan), "NaN");
    let mut infinite = random(6, &mut Dice(0)).0;
    infinite.add_block(3, 3, &Matrix2::from_element(f64::INFINITY));
    assert!(is_refused(&infinite), "infinity");
}

#[test]
fn after_a_singular_matrix_the_same_solver_solves_the_next() {
    let band = heavy(9, &mut Dice(1));
    for mut solver in solvers(9) {
        let _ = solver.factor(&BandMatrix::new(9));
        let errors = errors(solver.as_mut(), &band, &mut Dice(2));
        // Measured: 7.0e-17.
        assert!(errors.iter().all(|error| *error < 1e-14), "{solver:?}: {errors:?}");
    }
}

#[test]
fn solving_before_factoring_answers_with_nan() {
    for mut solver in solvers(4) {
        let [mut x, mut y] = [vec![1.0; 8], vec![1.0; 8]];
        solver.solve(&mut x);
        solver.solve_transposed(&mut y);
        assert!(x.iter().chain(&y).all(|x| x.is_nan()));
    }
}

/// The Jacobian of a scene along a direction, near its first state: turned by a random angle where its head is free,
/// every node moved by up to `noise` of the spacing, with velocities.
fn jacobian(text: &str, overrides: &[&str], direction: Direction, noise: f64, dice: &mut Dice) -> BandMatrix {
    let mut dynamics = Dynamics::new(Arc::new(scene_of(text, overrides).model().unwrap()));
    let mut state = dynamics.first_state();
    let (nodes, spacing, free) = (dynamics.nodes(), dynamics.model.rod.spacing, dynamics.model.head.is_none());
    let (sin, cos) = if free { dice.between(-4.0, 4.0) } else { 0.0 }.sin_cos();
    for (q, v) in state.q.chunks_exact_mut(2).zip(state.v.chunks_exact_mut(2)).skip(usize::from(!free)) {
        let move_by = |dice: &mut Dice| noise * spacing * dice.between(-1.0, 1.0);
        let [x, y] = [q[0], q[1]];
        q[0] = cos * x - sin * y + move_by(dice);
        q[1] = sin * x + cos * y + move_by(dice);
        v.fill_with(|| dice.between(-1.0, 1.0));
    }
    let mut matrix = BandMatrix::new(nodes);
    let mut residual = vec![0.0; 2 * nodes];
    dynamics.assemble(&state, &mut residual, Some(Linearisation { matrix: &mut matrix, direction })).unwrap();
    matrix
}

#[test]
fn jacobians_of_rods_are_solved_to_rounding_at_every_step_size_and_in_statics_whatever_the_head() {
    let mut worst = [[0.0; 3]; 3];
    for (text, overrides) in [(STUDY, &[][..]), (SOFT, &[]), (STUDY, &[SILICONE, GLYCEROL])] {
        for head in ["free", "clamped", "driven"] {
            for nodes in [3, 4, 5, 9, 33, 200, 1000, 2000] {
                for h in [1e-6, 1e-4, 1e-2, 1.0, f64::INFINITY] {
                    let direction = match h {
                        f64::INFINITY if head == "free" => continue, // singular: it can move as a rigid body
                        f64::INFINITY => Direction { q: 1.0, v: 0.0, a: 0.0 },
                        h => Direction { q: h * h, v: h, a: 1.0 },
                    };
                    let changes = [format!("rod.nodes={nodes}"), format!("head.kind=\"{head}\"")];
                    let overrides: Vec<_> =
                        overrides.iter().copied().chain(changes.iter().map(String::as_str)).collect();
                    let mut dice = Dice(nodes as u64);
                    let matrix = jacobian(text, &overrides, direction, 1e-6, &mut dice);
                    for (solver, worst) in solvers(nodes).iter_mut().zip(&mut worst) {
                        let errors = errors(solver.as_mut(), &matrix, &mut dice);
                        assert!(errors.iter().all(|error| *error < 1e-13), "{overrides:?} {h:e}: {errors:?}");
                        errors.iter().zip(worst).for_each(|(error, worst)| *worst = f64::max(*worst, *error));
                    }
                }
            }
        }
    }
    // Measured: 2.8e-16, 2.8e-16 and 2.2e-16; 3.2e-16, 3.2e-16 and 2.3e-16; 2.2e-16 thrice.
    println!(
        "largest backward errors: at once, from factors, transposed: block-band, pivoted LU and faer-lu {worst:?}"
    );
}

#[test]
fn the_backward_error_is_at_least_the_true_one_and_nan_where_anything_is_not_finite() {
    for nodes in [1, 2, 3, 4, 5, 6, 30] {
        let mut dice = Dice(nodes as u64);
        let band = heavy(nodes, &mut dice);
        let [x, b] = [dice.many(2 * nodes, -1.0, 1.0), dice.many(2 * nodes, -1.0, 1.0)];
        let (bound, error) = (band.backward_error(&x, &b), backward_error(&band, &x, &b, false));
        assert!((error..10.0 * error).contains(&bound), "{nodes} nodes: {bound} for {error}");
        let zero = vec![0.0; 2 * nodes];
        assert_eq!(band.backward_error(&zero, &zero), 0.0);
        for k in 0..2 * nodes {
            for bad in [f64::NAN, f64::INFINITY] {
                let spoilt =
                    |x: &[f64]| x.iter().enumerate().map(|(i, x)| if i == k { bad } else { *x }).collect::<Vec<_>>();
                assert!(band.backward_error(&spoilt(&x), &b).is_nan());
                assert!(band.backward_error(&x, &spoilt(&b)).is_nan());
            }
        }
    }
}

#[test]
fn what_the_fast_solver_cannot_solve_goes_to_the_other_and_is_told() {
    for nodes in [3, 4, 9, 200] {
        let mut dice = Dice(nodes as u64);
        let good = heavy(nodes, &mut dice);
        // Without its first diagonal block the matrix is regular, but has no LU factors without pivoting.
        let mut zero_pivot = good.clone();
        zero_pivot.add_block(0, 0, &Matrix2::from_fn(|i, j| -good.entry(i, j)));
        // With a tiny one it has, but they are useless.
        let mut tiny_pivot = zero_pivot.clone();
        tiny_pivot.add_block(0, 0, &(1e-14 * Matrix2::identity()));
        let b = dice.many(2 * nodes, -1.0, 1.0);
        for (matrix, falls_back) in [(&good, false), (&zero_pivot, true), (&tiny_pivot, true), (&good, false)] {
            let mut solver = FallbackSolver::new(SolverChoice::Auto, matrix).unwrap();
            let mut x = b.clone();
            assert_eq!(solver.solve(matrix, &mut x).unwrap().fallback, falls_back, "{nodes} nodes");
            let error = backward_error(matrix, &x, &b, false);
            // Measured: 9.9e-17.
            assert!(error < 1e-14, "{nodes} nodes: {error:e}");
            let mut x = b.clone();
            assert!(
                !FallbackSolver::new(SolverChoice::BlockBand, matrix).unwrap().solve(matrix, &mut x).unwrap().fallback
            );
            assert_eq!(x.iter().all(|x| x.is_nan()), falls_back);
        }
    }
}
