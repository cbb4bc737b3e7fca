//! faer's dense LU with partial pivoting, for a matrix that couples every unknown with every other.

use faer::Par;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::mat::{MatMut, MatRef};
use faer::perm::PermRef;
use faer::prelude::default;

/// A square matrix, replaced by its LU once [factored](Self::factor); allocates once.
pub struct DenseLu {
    size: usize,
    /// Entries, by columns.
    values: Vec<f64>,
    forward: Vec<usize>,
    backward: Vec<usize>,
    scratch: MemBuffer,
}

impl std::fmt::Debug for DenseLu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DenseLu").field("unknowns", &self.size).finish_non_exhaustive()
    }
}

impl DenseLu {
    /// Allocates for `size` unknowns.
    pub fn new(size: usize) -> Self {
        let scratch = StackReq::any_of(&[
            solve::solve_transpose_in_place_scratch::<usize, f64>(size, 1, Par::Seq),
            factor::lu_in_place_scratch::<usize, f64>(size, size, Par::Seq, default()),
            solve::solve_in_place_scratch::<usize, f64>(size, 1, Par::Seq),
        ]);
        let unmoved: Vec<usize> = (0..size).collect();
        Self {
            size,
            values: vec![0.0; size * size],
            forward: unmoved.clone(),
            backward: unmoved,
            scratch: MemBuffer::new(scratch),
        }
    }

    /// The entries, by columns, mutable.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Replaces the entries by their LU; a singular matrix shows as non-finite values in the solution.
    pub fn factor(&mut self) {
        let matrix = MatMut::from_column_major_slice_mut(&mut self.values, self.size, self.size);
        let stack = MemStack::new(&mut self.scratch);
        factor::lu_in_place(matrix, &mut self.forward, &mut self.backward, Par::Seq, stack, default());
    }

    /// Replaces `rhs` by A⁻¹ rhs; [`factor`](Self::factor) comes first.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let size = self.size;
        let factors = MatRef::from_column_major_slice(&self.values, size, size);
        let rows = PermRef::new_checked(&self.forward, &self.backward, size);
        let rhs = MatMut::from_column_major_slice_mut(rhs, size, 1);
        solve::solve_in_place(factors, factors, rows, rhs, Par::Seq, MemStack::new(&mut self.scratch));
    }

    /// Replaces `rhs` by A⁻ᵀ rhs; [`factor`](Self::factor) comes first.
    pub fn solve_transposed(&mut self, rhs: &mut [f64]) {
        let size = self.size;
        let factors = MatRef::from_column_major_slice(&self.values, size, size);
        let rows = PermRef::new_checked(&self.forward, &self.backward, size);
        let rhs = MatMut::from_column_major_slice_mut(rhs, size, 1);
        solve::solve_transpose_in_place(factors, factors, rows, rhs, Par::Seq, MemStack::new(&mut self.scratch));
    }
}
