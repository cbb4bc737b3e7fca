//! The matrix is what its dense twin is, and the solver solves what it is given or says that it cannot.

mod common;

use caudal::linear::{BandMatrix, FaerLu, LinearSolver};
use common::{Dice, largest};
use nalgebra::{DMatrix, DVector, Matrix2};

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

#[test]
fn solutions_have_a_backward_error_of_rounding_size_for_every_number_of_nodes_and_for_the_transpose() {
    let mut worst = 0.0;
    for nodes in [1, 2, 3, 4, 5, 9, 33, 200, 2000] {
        let mut dice = Dice(nodes as u64);
        let mut solver = FaerLu::analyse(&BandMatrix::new(nodes)).unwrap();
        // One analysis serves every matrix.
        for _ in 0..3 {
            let (band, _) =
                if nodes <= 200 { random(nodes, &mut dice) } else { (large(nodes, &mut dice), DMatrix::zeros(0, 0)) };
            solver.factor(&band).unwrap();
            for transposed in [false, true] {
                let b = dice.many(2 * nodes, -1.0, 1.0);
                let mut x = b.clone();
                if transposed {
                    solver.solve_transposed(&mut x)
                } else {
                    solver.solve(&mut x)
                }
                let error = backward_error(&band, &x, &b, transposed);
                worst = f64::max(worst, error);
                // Measured: at most 1.1e-16.
                assert!(error < 1e-14, "{nodes} nodes, transposed {transposed}: {error:e}");
            }
        }
    }
    println!("largest backward error {worst:e}");
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

#[test]
fn small_solutions_are_those_of_the_dense_twin() {
    for seed in 0..50 {
        let mut dice = Dice(seed);
        let (band, dense) = random(6, &mut dice);
        let b = DVector::from(dice.many(12, -1.0, 1.0));
        let mut solver = FaerLu::analyse(&band).unwrap();
        solver.factor(&band).unwrap();
        let lu = dense.clone().lu();
        let expected = lu.solve(&b).unwrap();
        let condition = dense.norm() * lu.try_inverse().unwrap().norm();
        let mut x = b.as_slice().to_vec();
        solver.solve(&mut x);
        let worst = largest((DVector::from(x) - &expected).iter().copied()) / expected.amax() / condition;
        // Measured: 4.0e-17 times the condition number.
        assert!(worst < 1e-15, "seed {seed}: {worst:e}");
    }
}

/// True where the solver refuses the matrix, or answers with a value that is not finite.
fn is_refused(matrix: &BandMatrix) -> bool {
    let mut solver = FaerLu::analyse(matrix).unwrap();
    let outcome = solver.factor(matrix);
    let mut x = vec![1.0; matrix.unknowns()];
    solver.solve(&mut x);
    let mut y = vec![1.0; matrix.unknowns()];
    solver.solve_transposed(&mut y);
    let finite = |x: &[f64]| x.iter().all(|x| x.is_finite());
    assert!(outcome.is_ok() || !(finite(&x) || finite(&y)), "an error leaves no answer");
    !finite(&x) && !finite(&y)
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
    let (band, _) = random(9, &mut Dice(1));
    let mut solver = FaerLu::analyse(&band).unwrap();
    let _ = solver.factor(&BandMatrix::new(9));
    solver.factor(&band).unwrap();
    let b = vec![1.0; 18];
    let mut x = b.clone();
    solver.solve(&mut x);
    let error = backward_error(&band, &x, &b, false);
    // Measured: 6.7e-17.
    assert!(error < 1e-14, "{error:e}");
}

#[test]
fn solving_before_factoring_answers_with_nan() {
    let band = BandMatrix::new(4);
    let mut solver = FaerLu::analyse(&band).unwrap();
    let mut x = vec![1.0; 8];
    solver.solve(&mut x);
    assert!(x.iter().all(|x| x.is_nan()));
}
