//! Band LU with partial pivoting, for matrices that are indefinite or have zeros on the diagonal.
//!
//! Source: R. S. Martin & J. H. Wilkinson, Numer. Math. 9 (1967) 279–301, the procedure `bandet1`; LAPACK's dgbtrf does the same by
//! blocks. Rows are shifted to start at the column that is eliminated, so the fill-in of pivoting goes where the eliminated column
//! was, and U needs no more memory than the matrix.

use super::{BandMatrix, HALF_BANDWIDTH, LinearSolver};
use crate::error::Result;

/// A square matrix with `LOWER` diagonals below the main one and `WIDTH` − 1 − `LOWER` above it, and its factors.
///
/// P A = L U overwrites the matrix: fill it, [`factor`](Self::factor) it, solve, and [`clear`](Self::clear) it for the next.
/// Nothing is allocated after [`new`](Self::new). Costs `LOWER`·(2 `WIDTH`) flops per unknown. Backward stable up to the growth of
/// partial pivoting, which is bounded for bands and near 1 in practice.
#[derive(Debug, Clone)]
pub struct PivotedBand<const LOWER: usize, const WIDTH: usize> {
    unknowns: usize,
    /// Row i, starting at column i − `LOWER`; once factored, row i of U, starting at the diagonal, which is stored inverted.
    /// `LOWER` rows of zeros follow, so that every column has as many rows below it.
    rows: Vec<[f64; WIDTH]>,
    /// Column k of L below the diagonal.
    multipliers: Vec<[f64; LOWER]>,
    /// Number of rows below the diagonal from which column k took its pivot.
    pivots: Vec<u8>,
    /// The right-hand side of a solve, followed by `WIDTH` zeros.
    rhs: Vec<f64>,
}

impl<const LOWER: usize, const WIDTH: usize> PivotedBand<LOWER, WIDTH> {
    /// The zero matrix with `unknowns` rows.
    pub fn new(unknowns: usize) -> Self {
        const { assert!(LOWER < WIDTH && LOWER < 256) };
        Self {
            unknowns,
            rows: vec![[0.0; WIDTH]; unknowns + LOWER],
            multipliers: vec![[0.0; LOWER]; unknowns],
            pivots: vec![0; unknowns],
            rhs: vec![0.0; unknowns + WIDTH],
        }
    }

    /// Number of rows.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.rows.fill([0.0; WIDTH]);
    }

    /// The rows of the matrix, to fill: row i holds columns i − `LOWER` … i + `WIDTH` − 1 − `LOWER`. Entries outside the matrix
    /// must stay zero.
    pub fn rows_mut(&mut self) -> &mut [[f64; WIDTH]] {
        &mut self.rows[..self.unknowns]
    }

    /// The entry at row `i`, column `j` of an unfactored matrix; zero outside the band.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        (j + LOWER).checked_sub(i).and_then(|offset| self.rows[i].get(offset)).copied().unwrap_or(0.0)
    }

    /// Replaces the matrix by its factors. A singular matrix shows as non-finite values in solutions.
    pub fn factor(&mut self) {
        self.eliminate(|_, _, _| {});
    }

    /// Replaces the matrix by its factors and `rhs` by A⁻¹ rhs. Eliminating `rhs` along with the matrix is nearly free; alone it is
    /// limited by latency.
    pub fn factor_and_solve(&mut self, rhs: &mut [f64]) {
        let mut x = std::mem::take(&mut self.rhs);
        x[..self.unknowns].copy_from_slice(rhs);
        self.eliminate(|k, pivot, multipliers| substitute(&mut x, k, pivot, multipliers));
        self.rhs = x;
        self.substitute_back();
        self.finish(rhs);
    }

    /// Replaces the matrix by its factors; `also` receives each column of L with its index and its pivot.
    #[inline]
    fn eliminate(&mut self, mut also: impl FnMut(usize, usize, &[f64; LOWER])) {
        for (i, row) in self.rows.iter_mut().enumerate().take(LOWER) {
            // The first rows start at column zero already.
            row.copy_within(LOWER - i.., 0);
            row[WIDTH - (LOWER - i)..].fill(0.0);
        }
        self.rows[self.unknowns..].fill([0.0; WIDTH]); // a singular matrix left NaN here
        for (k, (multipliers, pivot)) in self.multipliers.iter_mut().zip(&mut self.pivots).enumerate() {
            let Some((top, below)) = self.rows[k..].split_first_mut() else { return };
            let Some(below) = below.first_chunk_mut::<LOWER>() else { return };
            let (mut chosen, mut size) = (0, top[0].abs());
            for (i, row) in (1..).zip(below.iter()) {
                if row[0].abs() > size {
                    (chosen, size) = (i, row[0].abs());
                }
            }
            if chosen > 0 {
                std::mem::swap(top, &mut below[chosen - 1]);
            }
            *pivot = chosen as u8;
            let inverse = 1.0 / top[0];
            top[0] = inverse;
            for (row, multiplier) in below.iter_mut().zip(multipliers.iter_mut()) {
                let factor = row[0] * inverse;
                *multiplier = factor;
                for j in 1..WIDTH {
                    row[j - 1] = row[j] - factor * top[j];
                }
                row[WIDTH - 1] = 0.0;
            }
            also(k, chosen, multipliers);
        }
    }

    /// Replaces `rhs` by A⁻¹ rhs; [`factor`](Self::factor) comes first.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        self.rhs[..self.unknowns].copy_from_slice(rhs);
        for (k, (multipliers, pivot)) in self.multipliers.iter().zip(&self.pivots).enumerate() {
            substitute(&mut self.rhs, k, usize::from(*pivot), multipliers);
        }
        self.substitute_back();
        self.finish(rhs);
    }

    /// Solves with U.
    #[inline]
    fn substitute_back(&mut self) {
        for (i, row) in self.rows[..self.unknowns].iter().enumerate().rev() {
            let Some(window) = self.rhs[i..].first_chunk_mut::<WIDTH>() else { return };
            // In descending order, so that only the last product waits for the previous unknown.
            let mut sum = 0.0;
            for j in (1..WIDTH).rev() {
                sum += window[j] * row[j];
            }
            window[0] = (window[0] - sum) * row[0];
        }
    }

    /// Replaces `rhs` by A⁻ᵀ rhs; [`factor`](Self::factor) comes first.
    pub fn solve_transposed(&mut self, rhs: &mut [f64]) {
        self.rhs[..self.unknowns].copy_from_slice(rhs);
        for (i, row) in self.rows[..self.unknowns].iter().enumerate() {
            let Some(window) = self.rhs[i..].first_chunk_mut::<WIDTH>() else { return };
            window[0] *= row[0];
            for j in 1..WIDTH {
                window[j] -= window[0] * row[j];
            }
        }
        for (k, (multipliers, pivot)) in self.multipliers.iter().zip(&self.pivots).enumerate().rev() {
            let sum: f64 = self.rhs[k + 1..].iter().zip(multipliers).map(|(x, l)| x * l).sum();
            self.rhs[k] -= sum;
            self.rhs.swap(k, k + usize::from(*pivot));
        }
        self.finish(rhs);
    }

    /// Hands the solution over; non-finite values of a singular matrix are removed from the buffer.
    fn finish(&mut self, rhs: &mut [f64]) {
        rhs.copy_from_slice(&self.rhs[..self.unknowns]);
        self.rhs[self.unknowns..].fill(0.0);
    }
}

/// Diagonals of a [`BandMatrix`] on either side of the main one.
const HALF: usize = 2 * HALF_BANDWIDTH + 1;

/// LU with partial pivoting of a [`BandMatrix`]: indefinite and nearly singular ones too.
pub type PivotedLu = PivotedBand<HALF, { 2 * HALF + 1 }>;

impl LinearSolver for PivotedLu {
    fn analyse(matrix: &BandMatrix) -> Result<Self> {
        let mut band = Self::new(matrix.unknowns());
        band.rows.fill([f64::NAN; _]); // there are no factors yet
        Ok(band)
    }

    fn factor(&mut self, matrix: &BandMatrix) -> Result<()> {
        // A block row has ten entries per row; the band starts one entry earlier in the upper row and ends one later in the lower.
        for ([upper, lower], blocks) in self.rows.as_chunks_mut().0.iter_mut().zip(matrix.rows()) {
            for (j, [a, b, c, d]) in blocks.iter().enumerate() {
                [upper[2 * j + 1], upper[2 * j + 2]] = [*a, *b];
                [lower[2 * j], lower[2 * j + 1]] = [*c, *d];
            }
            (upper[0], lower[2 * HALF]) = (0.0, 0.0);
        }
        self.eliminate(|_, _, _| {});
        Ok(())
    }

    fn solve(&mut self, rhs: &mut [f64]) {
        self.solve(rhs);
    }

    fn solve_transposed(&mut self, rhs: &mut [f64]) {
        self.solve_transposed(rhs);
    }
}

/// Eliminates column `k` of L in `x`.
#[inline]
fn substitute<const LOWER: usize>(x: &mut [f64], k: usize, pivot: usize, multipliers: &[f64; LOWER]) {
    if pivot > 0 {
        x.swap(k, k + pivot);
    }
    let Some((top, below)) = x[k..].split_first_mut() else { return };
    let Some(below) = below.first_chunk_mut::<LOWER>() else { return };
    for (x, multiplier) in below.iter_mut().zip(multipliers) {
        *x -= multiplier * *top;
    }
}
