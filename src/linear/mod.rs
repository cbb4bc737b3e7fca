//! The linear seam: one matrix with a fixed band pattern, and the solvers that take it.

mod faer_lu;

use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use nalgebra::Matrix2;

use crate::error::{Error, Result};
pub use faer_lu::FaerLu;

/// Nodes on either side that a node is coupled to: bending reaches two.
const REACH: usize = 2;

/// Square matrix of 2×2 blocks, one row of blocks a node, in which node k meets nodes k−2 … k+2 (half-bandwidth 5).
///
/// Stored compressed by columns with a pattern that never changes; blocks are added in place.
#[derive(Debug, Clone)]
pub struct BandMatrix {
    nodes: usize,
    pattern: SymbolicSparseColMat<u32>,
    values: Vec<f64>,
}

impl BandMatrix {
    /// The zero matrix for a rod of `nodes` nodes.
    ///
    /// # Errors
    /// [`Error::Linear`] where the pattern does not fit 32-bit indices (over 2·10⁸ nodes).
    pub fn new(nodes: usize) -> Result<Self> {
        let too_large = |reason: &str| Error::Linear { unknowns: 2 * nodes, reason: reason.to_string() };
        let entries = 4 * (0..nodes).map(|j| Self::block_rows(nodes, j).len()).sum::<usize>();
        if u32::try_from(entries).is_err() {
            return Err(too_large("more entries than 32-bit indices can count"));
        }
        let mut column_starts = Vec::with_capacity(2 * nodes + 1);
        let mut rows = Vec::with_capacity(entries);
        column_starts.push(0);
        for j in 0..nodes {
            let blocks = Self::block_rows(nodes, j);
            for _ in 0..2 {
                rows.extend(2 * blocks.start as u32..2 * blocks.end as u32);
                column_starts.push(rows.len() as u32);
            }
        }
        let pattern = SymbolicSparseColMat::new_checked(2 * nodes, 2 * nodes, column_starts, None, rows);
        Ok(Self { nodes, pattern, values: vec![0.0; entries] })
    }

    /// Block rows that block column `j` has entries in.
    fn block_rows(nodes: usize, j: usize) -> std::ops::Range<usize> {
        j.saturating_sub(REACH)..(j + REACH + 1).min(nodes)
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds `block` at block row `i`, block column `j`; |i − j| ≤ 2.
    #[inline]
    pub fn add_block(&mut self, i: usize, j: usize, block: &Matrix2<f64>) {
        let blocks = Self::block_rows(self.nodes, j);
        debug_assert!(blocks.contains(&i));
        let starts = self.pattern.col_ptr();
        let row = 2 * (i - blocks.start);
        for b in 0..2 {
            let at = starts[2 * j + b] as usize + row;
            let column = &mut self.values[at..at + 2];
            column[0] += block[(0, b)];
            column[1] += block[(1, b)];
        }
    }

    /// Makes the rows and columns of node `k` those of the identity: its unknowns are prescribed.
    pub fn prescribe(&mut self, k: usize) {
        let starts = self.pattern.col_ptr();
        for j in Self::block_rows(self.nodes, k) {
            let first = Self::block_rows(self.nodes, j).start;
            for b in 0..2 {
                let (start, end) = (starts[2 * j + b] as usize, starts[2 * j + b + 1] as usize);
                if j == k {
                    self.values[start..end].fill(0.0);
                    self.values[start + 2 * (k - first) + b] = 1.0;
                } else {
                    self.values[start + 2 * (k - first)..start + 2 * (k - first) + 2].fill(0.0);
                }
            }
        }
    }

    /// Number of unknowns, two a node.
    pub fn unknowns(&self) -> usize {
        2 * self.nodes
    }

    /// The matrix as faer sees it.
    pub fn as_faer(&self) -> SparseColMatRef<'_, u32, f64> {
        SparseColMatRef::new(self.pattern.as_ref(), &self.values)
    }

    /// The entry at row `i`, column `j`; zero outside the band.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        self.as_faer().get(i, j).copied().unwrap_or(0.0)
    }

    /// y = A x, or y = Aᵀ x.
    pub fn multiply(&self, x: &[f64], y: &mut [f64], transposed: bool) {
        let matrix = self.as_faer();
        y.fill(0.0);
        for j in 0..self.unknowns() {
            for (i, a) in matrix.row_idx_of_col(j).zip(matrix.val_of_col(j)) {
                if transposed {
                    y[j] += a * x[i];
                } else {
                    y[i] += a * x[j];
                }
            }
        }
    }
}

/// A direct solver: the pattern is analysed once a run, values are factored once an iteration.
pub trait LinearSolver: std::fmt::Debug + Send {
    /// Prepares for every matrix with the pattern of `matrix`.
    ///
    /// # Errors
    /// [`Error::Linear`] where memory or indices do not suffice.
    fn analyse(matrix: &BandMatrix) -> Result<Self>
    where
        Self: Sized;

    /// Factors the values; a singular matrix shows as non-finite values in the solution.
    ///
    /// # Errors
    /// [`Error::Linear`] where memory does not suffice or a pivot is missing.
    fn factor(&mut self, matrix: &BandMatrix) -> Result<()>;

    /// Replaces `rhs` by A⁻¹ rhs; [`factor`](Self::factor) comes first.
    fn solve(&mut self, rhs: &mut [f64]);

    /// Replaces `rhs` by A⁻ᵀ rhs; [`factor`](Self::factor) comes first.
    fn solve_transposed(&mut self, rhs: &mut [f64]);
}
