//! The linear seam: one matrix with a fixed band pattern, and the solvers that take it.

mod faer_lu;
mod pivoted_band;

use nalgebra::Matrix2;

use crate::error::Result;
pub use faer_lu::FaerLu;
pub use pivoted_band::PivotedBand;

/// Nodes on either side that a node is coupled to: bending reaches two.
const REACH: usize = 2;

/// The five blocks of a row of blocks, from two before the diagonal to two after, each [a₀₀, a₀₁, a₁₀, a₁₁].
pub type BlockRow = [[f64; 4]; 2 * REACH + 1];

/// Square matrix of 2×2 blocks, one row of blocks a node, in which node k meets nodes k−2 … k+2 (half-bandwidth 5).
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

    /// Nodes that node `k` is coupled to.
    pub fn coupled(&self, k: usize) -> std::ops::Range<usize> {
        k.saturating_sub(REACH)..(k + REACH + 1).min(self.rows.len())
    }

    /// The rows of blocks, one a node.
    pub fn rows(&self) -> &[BlockRow] {
        &self.rows
    }

    /// Sets every entry to zero.
    pub fn clear(&mut self) {
        self.rows.fill(BlockRow::default());
    }

    /// Adds `block` at block row `i`, block column `j`; |i − j| ≤ 2.
    #[inline]
    pub fn add_block(&mut self, i: usize, j: usize, block: &Matrix2<f64>) {
        debug_assert!(self.coupled(i).contains(&j));
        let [a, b, c, d] = &mut self.rows[i][j + REACH - i];
        *a += block[(0, 0)];
        *b += block[(0, 1)];
        *c += block[(1, 0)];
        *d += block[(1, 1)];
    }

    /// Makes the rows and columns of node `k` those of the identity: its unknowns are prescribed.
    pub fn prescribe(&mut self, k: usize) {
        for i in self.coupled(k) {
            self.rows[i][k + REACH - i] = [0.0; 4];
        }
        self.rows[k] = BlockRow::default();
        self.rows[k][REACH] = [1.0, 0.0, 0.0, 1.0];
    }

    /// Number of nodes, and of rows of blocks.
    pub fn nodes(&self) -> usize {
        self.rows.len()
    }

    /// Number of unknowns, two a node.
    pub fn unknowns(&self) -> usize {
        2 * self.rows.len()
    }

    /// The entry at row `i`, column `j`; zero outside the band.
    pub fn entry(&self, i: usize, j: usize) -> f64 {
        if self.coupled(i / 2).contains(&(j / 2)) {
            self.rows[i / 2][j / 2 + REACH - i / 2][2 * (i % 2) + j % 2]
        } else {
            0.0
        }
    }

    /// y = A x, or y = Aᵀ x.
    pub fn multiply(&self, x: &[f64], y: &mut [f64], transposed: bool) {
        y.fill(0.0);
        for i in 0..self.unknowns() {
            let columns = self.coupled(i / 2);
            for j in 2 * columns.start..2 * columns.end {
                let (from, to) = if transposed { (i, j) } else { (j, i) };
                y[to] += self.entry(i, j) * x[from];
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
