//! The pivoted band LU solves what its dense twin solves, whatever the diagonal, and its transpose too.

use crate::common;
use caudal::linear::PivotedBand;
use common::{Dice, largest};
use nalgebra::{DMatrix, DVector};

/// A random band matrix and its dense twin; `diagonal` scales what stands on the diagonal.
fn random<const LOWER: usize, const WIDTH: usize>(
    unknowns: usize,
    diagonal: f64,
    dice: &mut Dice,
) -> (PivotedBand<LOWER, WIDTH>, DMatrix<f64>) {
    let mut band = PivotedBand::new(unknowns);
    let mut dense = DMatrix::zeros(unknowns, unknowns);
    for (i, row) in band.rows_mut().iter_mut().enumerate() {
        for (offset, entry) in row.iter_mut().enumerate() {
            if let Some(j) = (i + offset).checked_sub(LOWER).filter(|j| *j < unknowns) {
                *entry = dice.between(-1.0, 1.0) * if i == j { diagonal } else { 1.0 };
                dense[(i, j)] = *entry;
            }
        }
    }
    (band, dense)
}

/// Largest |A x − b| over |A| |x| + |b| of both solves.
fn backward_error<const LOWER: usize, const WIDTH: usize>(unknowns: usize, diagonal: f64) -> f64 {
    let mut dice = Dice(unknowns as u64);
    let (mut band, dense) = random::<LOWER, WIDTH>(unknowns, diagonal, &mut dice);
    for i in 0..unknowns {
        for j in 0..unknowns {
            assert_eq!(band.entry(i, j), dense[(i, j)], "entry ({i}, {j})");
        }
    }
    let rhs = DVector::from(dice.many(unknowns, -1.0, 1.0));
    let mut at_once = rhs.clone();
    band.clone().factor_and_solve(at_once.as_mut_slice());
    band.factor();
    let mut worst = 0.0;
    for transposed in [false, true] {
        let mut x = rhs.clone();
        if transposed {
            band.solve_transposed(x.as_mut_slice());
        } else {
            band.solve(x.as_mut_slice());
            assert_eq!(x, at_once);
        }
        let matrix = if transposed { dense.transpose() } else { dense.clone() };
        let size = (WIDTH as f64 + diagonal) * largest(x.iter().copied()) + 1.0;
        worst = f64::max(worst, largest((matrix * x - &rhs).iter().copied()) / size);
    }
    worst
}

#[test]
fn solutions_have_a_backward_error_of_rounding_size_with_any_diagonal_and_any_size() {
    for unknowns in [1, 2, 3, 4, 5, 6, 9, 15, 60, 400] {
        for diagonal in [0.0, 1e-12, 1.0, 100.0] {
            if unknowns == 1 && diagonal == 0.0 {
                continue;
            }
            let worst = [
                backward_error::<3, 7>(unknowns, diagonal),
                backward_error::<3, 9>(unknowns, diagonal),
                backward_error::<1, 4>(unknowns, diagonal),
                backward_error::<5, 11>(unknowns, diagonal),
            ];
            // Measured: at most 2.2e-16.
            assert!(largest(worst) < 1e-15, "{unknowns} unknowns, diagonal {diagonal}: {worst:?}");
        }
    }
}

#[test]
fn a_singular_matrix_is_answered_with_values_that_are_not_finite() {
    for unknowns in [1, 5, 30] {
        for empty in [0, unknowns / 2, unknowns - 1] {
            let (mut band, _) = random::<3, 9>(unknowns, 1.0, &mut Dice(7));
            band.rows_mut()[empty] = [0.0; 9];
            band.factor();
            let mut x = vec![1.0; unknowns];
            band.solve(&mut x);
            assert!(x.iter().any(|x| !x.is_finite()), "row {empty} of {unknowns} empty");
        }
    }
}

#[test]
fn clearing_leaves_nothing_of_the_factors() {
    let (mut band, _) = random::<3, 9>(12, 1.0, &mut Dice(1));
    band.factor();
    band.clear();
    for row in band.rows_mut() {
        row[3] = 2.0;
    }
    band.factor();
    let mut x = vec![1.0; 12];
    band.solve(&mut x);
    assert_eq!(x, vec![0.5; 12]);
}
