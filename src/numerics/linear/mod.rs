//! Linear systems: a matrix with a fixed band pattern, and its solvers.

mod block;
mod block_band;
mod chain;
#[cfg(feature = "faer")]
mod dense_lu;
mod direction;
#[cfg(feature = "faer")]
mod faer_lu;
mod fallback;
mod pivoted_band;
mod real;

use nalgebra::Matrix2;
use wide::f64x2;

use crate::error::Result;
pub use block::{Block, pair};
pub use block_band::BlockBand;
pub use chain::{ChainMatrix, ChainRow, ChainTerms, Riccati};
#[cfg(feature = "faer")]
pub use dense_lu::DenseLu;
pub use direction::Direction;
#[cfg(feature = "faer")]
pub use faer_lu::FaerLu;
pub use fallback::{FallbackSolver, Solution, SolverChoice};
pub use pivoted_band::{PivotedBand, PivotedLu};
pub use real::{Number, Pair, Real};

/// Number of nodes on either side that a node is coupled to; bending couples two.
pub(crate) const HALF_BANDWIDTH: usize = 2;

/// The five blocks of a block row, from two before the diagonal to two after, each [a₀₀, a₀₁, a₁₀, a₁₁].
pub type BlockRow<T = f64> = [[T; 4]; 2 * HALF_BANDWIDTH + 1];

/// Square matrix of 2×2 blocks, one block row per node, that couples node k to nodes k−2 … k+2 (half-bandwidth 5).
///
/// Its pattern never changes; blocks are added in place. Blocks that would lie outside the matrix stay zero.
#[derive(Debug, Clone, PartialEq)]
pub struct BandMatrix {
    rows: Vec<BlockRow>,
}

impl BandMatrix {
    /// The zero matrix for a rod of `nodes` nodes.
    pub fn new(nodes: usize) -> Self {
        Self { rows: vec![BlockRow::default(); nodes] }
    }

    /// Indices of the nodes that node `k` is coupled to.
    pub fn coupled(&self, k: usize) -> std::ops::Range<usize> {
        k.saturating_sub(HALF_BANDWIDTH)..(k + HALF_BANDWIDTH + 1).min(self.rows.len())
    }

    /// The block rows, one per node.
    pub fn rows(&self) -> &[BlockRow] {
        &self.rows
    }

    /// The block rows, mutable.
    pub fn rows_mut(&mut self) -> &mut [BlockRow] {
        &mut self.rows
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.rows.fill(BlockRow::default());
    }

    /// Adds `block` at block row `i`, block column `j`; |i − j| ≤ 2.
    #[inline]
    pub fn add_block(&mut self, i: usize, j: usize, block: &Matrix2<f64>) {
        debug_assert!(self.coupled(i).contains(&j));
        let [a, b, c, d] = &mut self.rows[i][j + HALF_BANDWIDTH - i];
        *a += block[(0, 0)];
        *b += block[(0, 1)];
        *c += block[(1, 0)];
        *d += block[(1, 1)];
    }

    /// Replaces the rows and columns of node `k` by those of the identity: its unknowns are prescribed.
    pub fn prescribe(&mut self, k: usize) {
        prescribe(&mut self.rows, k);
    }

    /// True if the unknowns of node `k` are [prescribed](Self::prescribe).
    pub fn is_prescribed(&self, k: usize) -> bool {
        let row = &self.rows[k];
        row[HALF_BANDWIDTH] == [1.0, 0.0, 0.0, 1.0] && (0..row.len()).all(|j| j == HALF_BANDWIDTH || row[j] == [0.0; 4])
    }

    /// Number of nodes, and of block rows.
    pub fn nodes(&self) -> usize {
        self.rows.len()
    }

    /// Number of unknowns, two per node.
    pub fn unknowns(&self) -> usize {
        2 * self.rows.len()
    }

    /// The entry at row `i`, column `j`; zero outside the band.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        if self.coupled(i / 2).contains(&(j / 2)) {
            self.rows[i / 2][j / 2 + HALF_BANDWIDTH - i / 2][2 * (i % 2) + j % 2]
        } else {
            0.0
        }
    }

    /// y = A x, or y = Aᵀ x.
    pub fn multiply(&self, x: &[f64], y: &mut [f64], transposed: bool) {
        y.fill(0.0);
        for (i, row) in self.rows.iter().enumerate() {
            for j in self.coupled(i) {
                let [a, b, c, d] = row[j + HALF_BANDWIDTH - i];
                let (from, to, [a, b, c, d]) = if transposed { (i, j, [a, c, b, d]) } else { (j, i, [a, b, c, d]) };
                let (x0, x1) = (x[2 * from], x[2 * from + 1]);
                y[2 * to] = y[2 * to] + a * x0 + b * x1;
                y[2 * to + 1] = y[2 * to + 1] + c * x0 + d * x1;
            }
        }
    }

    /// ‖A x − b‖∞ / (max |aₖₖ| ‖x‖∞ + ‖b‖∞), NaN if anything is not finite: an upper bound of the normwise backward error of x as a
    /// solution of A x = b (Rigal and Gaches, J. ACM 14, 1967), because the largest |aₖₖ| is at most ‖A‖∞.
    pub fn backward_error(&self, x: &[f64], b: &[f64]) -> f64 {
        self.checked(x, b).error
    }

    /// The [backward error](Self::backward_error) with the largest moduli of x and b, which are valid unless the error is NaN.
    pub(crate) fn checked(&self, x: &[f64], b: &[f64]) -> ResidualCheck {
        ResidualSizes::of(&self.rows, x.as_chunks().0, b.as_chunks().0).checked()
    }
}

/// Replaces the rows and columns of node `k` in `rows` by those of the identity.
#[inline(always)]
pub(crate) fn prescribe<T: Real>(rows: &mut [BlockRow<T>], k: usize) {
    let zero = rows[k][0][0].like(0.0);
    for i in k.saturating_sub(HALF_BANDWIDTH)..(k + HALF_BANDWIDTH + 1).min(rows.len()) {
        rows[i][k + HALF_BANDWIDTH - i] = [zero; 4];
    }
    rows[k] = [[zero; 4]; 5];
    rows[k][HALF_BANDWIDTH] = [zero.like(1.0), zero, zero, zero.like(1.0)];
}

/// The check of a solution of A x = b.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualCheck {
    /// Its backward error.
    pub error: f64,
    /// Largest modulus of x.
    pub x: f64,
    /// Largest modulus of b.
    pub b: f64,
}

impl ResidualCheck {
    /// True if the system is solved to rounding accuracy.
    pub fn is_solved(&self) -> bool {
        self.error <= fallback::BACKWARD_ERROR
    }
}

/// Largest moduli of parts of A x − b, and a sum that is not finite if any value in A x − b is not.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualSizes<P> {
    residual: P,
    diagonal: P,
    x: P,
    b: P,
    sum: P,
}

impl<P: Number> ResidualSizes<P> {
    /// For the solution `x` of the system of `rows` with right-hand side `b`.
    #[inline(always)]
    pub(crate) fn of<T: Real<Pair = P>>(rows: &[BlockRow<T>], x: &[[T; 2]], b: &[[T; 2]]) -> Self
    where
        P: Pair<T>,
    {
        let zero = rows[0][0][0].like(0.0);
        let none = P::new([zero; 2]);
        let mut sizes = Self { residual: none, diagonal: none, x: none, b: none, sum: none };
        let inner = rows.len().saturating_sub(2 * HALF_BANDWIDTH);
        let outer = 2.min(rows.len())..;
        // The first and the last rows would couple to nodes that do not exist.
        for k in (0..rows.len()).filter(|k| !(HALF_BANDWIDTH..HALF_BANDWIDTH + inner).contains(k)) {
            let mut near = [[zero; 2]; 5];
            for (j, near) in near.iter_mut().enumerate() {
                if let Some(x) = (k + j).checked_sub(HALF_BANDWIDTH).and_then(|j| x.get(j)) {
                    *near = *x;
                }
            }
            sizes.add(&rows[k], &near, b[k]);
        }
        for ((row, near), b) in
            rows[outer.clone()].iter().zip(x.windows(5).filter_map(<[_]>::first_chunk)).zip(&b[outer])
        {
            sizes.add(row, near, *b);
        }
        sizes
    }

    /// Accumulates the block row `row` with the solution `near` it and the right-hand side.
    #[inline(always)]
    fn add<T: Real<Pair = P>>(&mut self, row: &BlockRow<T>, near: &[[T; 2]; 5], b: [T; 2])
    where
        P: Pair<T>,
    {
        let none = P::new([b[0].like(0.0); 2]);
        let (mut upper, mut lower) = (none, none);
        for ([a00, a01, a10, a11], x) in row.iter().zip(near) {
            upper += P::new([*a00, *a01]) * P::new(*x);
            lower += P::new([*a10, *a11]) * P::new(*x);
        }
        let ([a, b_], [c, d]) = (upper.to_array(), lower.to_array());
        let b = P::new(b);
        let residual = P::new([a, c]) + P::new([b_, d]) - b;
        let [a00, _, _, a11] = row[HALF_BANDWIDTH];
        self.sum += residual;
        self.residual = self.residual.larger(residual.abs());
        self.diagonal = self.diagonal.larger(P::new([a00, a11]).abs());
        self.x = self.x.larger(P::new(near[HALF_BANDWIDTH]).abs());
        self.b = self.b.larger(b.abs());
    }
}

impl<P: Copy> ResidualSizes<P> {
    /// The sizes for each of several cases, whose numbers are in `of`.
    #[cfg(all(feature = "report", target_arch = "x86_64"))]
    pub(crate) fn in_lanes<T: Real<Pair = P>, const N: usize>(
        &self,
        of: impl Fn(T) -> [f64; N],
    ) -> [ResidualSizes<f64x2>; N]
    where
        P: Pair<T>,
    {
        let parts = |pair: P| pair.to_array().map(&of);
        let Self { residual, diagonal, x, b, sum } = *self;
        let [residual, diagonal, x, b, sum] = [residual, diagonal, x, b, sum].map(parts);
        std::array::from_fn(|lane| {
            let of = |[first, second]: [[f64; N]; 2]| f64x2::new([first[lane], second[lane]]);
            ResidualSizes { residual: of(residual), diagonal: of(diagonal), x: of(x), b: of(b), sum: of(sum) }
        })
    }
}

impl ResidualSizes<f64x2> {
    /// The check that they amount to.
    pub(crate) fn checked(&self) -> ResidualCheck {
        let [residual, diagonal, x, b] = [self.residual, self.diagonal, self.x, self.b].map(|sizes| {
            let [a, b] = sizes.to_array();
            a.max(b)
        });
        let error = if !self.sum.reduce_add().is_finite() {
            f64::NAN
        } else if residual == 0.0 {
            0.0
        } else {
            residual / (diagonal * x + b)
        };
        ResidualCheck { error, x, b }
    }
}

/// A part of a Jacobian that couples every node to every other.
pub trait Coupling {
    /// Replaces `rhs` by the solution of (B + K) x = rhs, where K is the coupling along the direction `along` and B is `band`; by
    /// non-finite values if the sum is singular. Rows prescribed in `band` stay prescribed.
    fn solve(&self, band: &BandMatrix, along: Direction, rhs: &mut [f64]);
}

/// A direct solver: analyses the pattern once per run and factors values once per iteration.
pub trait LinearSolver: std::fmt::Debug + Send + Sync {
    /// Prepares for all matrices with the pattern of `matrix`.
    ///
    /// # Errors
    /// [`Error::Linear`](crate::Error::Linear) if memory or indices are insufficient.
    fn analyse(matrix: &BandMatrix) -> Result<Self>
    where
        Self: Sized;

    /// Factors the values; a singular matrix shows as non-finite values in the solution.
    ///
    /// # Errors
    /// [`Error::Linear`](crate::Error::Linear) if memory is insufficient or a pivot is missing.
    fn factor(&mut self, matrix: &BandMatrix) -> Result<()>;

    /// Replaces `rhs` by A⁻¹ rhs; [`factor`](Self::factor) must have been called.
    fn solve(&mut self, rhs: &mut [f64]);

    /// Factors the values and replaces `rhs` by A⁻¹ rhs; need not keep the factors.
    ///
    /// # Errors
    /// Errors of [`factor`](Self::factor).
    fn factor_and_solve(&mut self, matrix: &BandMatrix, rhs: &mut [f64]) -> Result<()> {
        self.factor(matrix)?;
        self.solve(rhs);
        Ok(())
    }

    /// Replaces `rhs` by A⁻ᵀ rhs; [`factor`](Self::factor) must have been called.
    fn solve_transposed(&mut self, rhs: &mut [f64]);
}
