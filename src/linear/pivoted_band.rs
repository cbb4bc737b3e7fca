//! Band LU with partial pivoting: matrices that are indefinite or have zeros on the diagonal.
//!
//! Source: R. S. Martin & J. H. Wilkinson, Numer. Math. 9 (1967) 279–301, the procedure `bandet1`; LAPACK's dgbtrf does the
//! same by blocks. Rows are kept flush with the column that is eliminated, so the fill-in of pivoting lands where the
//! eliminated column was, and U needs no more room than the matrix.

/// A square matrix with `LOWER` diagonals below the main one and `WIDTH` − 1 − `LOWER` above it, and its factors.
///
/// P A = L U takes the matrix's place: fill it, [`factor`](Self::factor) it, solve, and [`clear`](Self::clear) it for the
/// next. Nothing is allocated after [`new`](Self::new). `LOWER`·(2 `WIDTH`) flops an unknown; backward stable up to the
/// growth of partial pivoting, which for bands is bounded and in practice near 1.
#[derive(Debug, Clone)]
pub struct PivotedBand<const LOWER: usize, const WIDTH: usize> {
    /// Row i from column i − `LOWER` on; once factored, row i of U from the diagonal on, the diagonal as its inverse.
    rows: Vec<[f64; WIDTH]>,
    /// Column k of L below the diagonal.
    multipliers: Vec<[f64; LOWER]>,
    /// Column k took its pivot from this many rows below.
    pivots: Vec<u8>,
}

impl<const LOWER: usize, const WIDTH: usize> PivotedBand<LOWER, WIDTH> {
    /// The zero matrix of `unknowns` rows.
    pub fn new(unknowns: usize) -> Self {
        const { assert!(LOWER < WIDTH && LOWER < 256) };
        Self {
            rows: vec![[0.0; WIDTH]; unknowns],
            multipliers: vec![[0.0; LOWER]; unknowns],
            pivots: vec![0; unknowns],
        }
    }

    /// Number of rows.
    pub fn unknowns(&self) -> usize {
        self.rows.len()
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.rows.fill([0.0; WIDTH]);
    }

    /// The rows of the matrix, to fill: row i holds columns i − `LOWER` … i + `WIDTH` − 1 − `LOWER`. What lies outside the
    /// matrix must stay zero.
    pub fn rows_mut(&mut self) -> &mut [[f64; WIDTH]] {
        &mut self.rows
    }

    /// The entry at row `i`, column `j` of a matrix that is not factored yet; zero outside the band.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        (j + LOWER).checked_sub(i).and_then(|offset| self.rows[i].get(offset)).copied().unwrap_or(0.0)
    }

    /// Replaces the matrix by its factors. A singular matrix shows as solutions that are not finite.
    pub fn factor(&mut self) {
        let unknowns = self.unknowns();
        for (i, row) in self.rows.iter_mut().enumerate().take(LOWER) {
            // The first rows start at column zero already.
            row.copy_within(LOWER - i.., 0);
            row[WIDTH - (LOWER - i)..].fill(0.0);
        }
        for k in 0..unknowns {
            let window = &mut self.rows[k..unknowns.min(k + LOWER + 1)];
            let mut pivot = 0;
            for (i, row) in window.iter().enumerate().skip(1) {
                if row[0].abs() > window[pivot][0].abs() {
                    pivot = i;
                }
            }
            if pivot > 0 {
                window.swap(0, pivot);
            }
            self.pivots[k] = pivot as u8;
            let Some((top, below)) = window.split_first_mut() else { return };
            let inverse = 1.0 / top[0];
            top[0] = inverse;
            let top = *top;
            for (row, multiplier) in below.iter_mut().zip(&mut self.multipliers[k]) {
                let factor = row[0] * inverse;
                *multiplier = factor;
                for j in 1..WIDTH {
                    row[j - 1] = row[j] - factor * top[j];
                }
                row[WIDTH - 1] = 0.0;
            }
        }
    }

    /// Replaces `rhs` by A⁻¹ rhs; [`factor`](Self::factor) comes first.
    pub fn solve(&self, rhs: &mut [f64]) {
        let unknowns = self.unknowns();
        for (k, (multipliers, pivot)) in self.multipliers.iter().zip(&self.pivots).enumerate() {
            let window = &mut rhs[k..unknowns.min(k + LOWER + 1)];
            window.swap(0, usize::from(*pivot));
            let Some((top, below)) = window.split_first_mut() else { return };
            for (x, multiplier) in below.iter_mut().zip(multipliers) {
                *x -= multiplier * *top;
            }
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            let window = &mut rhs[i..unknowns.min(i + WIDTH)];
            // From the far end, so that only the last product waits for the unknown before.
            let sum: f64 = window.iter().zip(row).skip(1).rev().map(|(x, u)| x * u).sum();
            window[0] = (window[0] - sum) * row[0];
        }
    }

    /// Replaces `rhs` by A⁻ᵀ rhs; [`factor`](Self::factor) comes first.
    pub fn solve_transposed(&self, rhs: &mut [f64]) {
        let unknowns = self.unknowns();
        for (i, row) in self.rows.iter().enumerate() {
            let window = &mut rhs[i..unknowns.min(i + WIDTH)];
            window[0] *= row[0];
            let top = window[0];
            for (x, u) in window.iter_mut().zip(row).skip(1) {
                *x -= top * u;
            }
        }
        for (k, (multipliers, pivot)) in self.multipliers.iter().zip(&self.pivots).enumerate().rev() {
            let window = &mut rhs[k..unknowns.min(k + LOWER + 1)];
            let sum: f64 = window.iter().skip(1).zip(multipliers).map(|(x, l)| x * l).sum();
            window[0] -= sum;
            window.swap(0, usize::from(*pivot));
        }
    }
}
