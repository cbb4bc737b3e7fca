//! faer's sparse LU with partial pivoting, for any pattern, including indefinite and nearly singular matrices.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::mat::MatMut;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::lu::{LuRef, LuSymbolicParams, NumericLu, SymbolicLu, factorize_symbolic_lu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, Par, Spec};

use super::{BandMatrix, LinearSolver};
use crate::error::{Error, Result};

/// Sparse LU: one symbolic analysis, then numeric refactorisations that allocate nothing after the first.
///
/// Always uses the simplicial (column-by-column) variant: with a half-bandwidth of 5 the supernodal one finds no dense parts, and
/// it allocates at every call.
pub struct FaerLu {
    pattern: SymbolicSparseColMat<u32>,
    values: Vec<f64>,
    symbolic: SymbolicLu<u32>,
    numeric: NumericLu<u32, f64>,
    scratch: MemBuffer,
    factored: bool,
}

impl std::fmt::Debug for FaerLu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FaerLu").field("unknowns", &self.symbolic.nrows()).finish_non_exhaustive()
    }
}

impl FaerLu {
    fn solve_with(&mut self, rhs: &mut [f64], transposed: bool) {
        if !self.factored {
            rhs.fill(f64::NAN); // as for a singular matrix
            return;
        }
        let lu = LuRef::new_unchecked(&self.symbolic, &self.numeric);
        let n = rhs.len();
        let rhs = MatMut::from_column_major_slice_mut(rhs, n, 1);
        let stack = MemStack::new(&mut self.scratch);
        if transposed {
            lu.solve_transpose_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
        } else {
            lu.solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
        }
    }
}

impl LinearSolver for FaerLu {
    fn analyse(matrix: &BandMatrix) -> Result<Self> {
        let failed = |reason: String| Error::Linear { unknowns: matrix.unknowns(), reason };
        let nodes = matrix.nodes();
        let entries = 4 * (0..nodes).map(|j| matrix.coupled(j).len()).sum::<usize>();
        if u32::try_from(entries).is_err() {
            return Err(failed("more entries than 32-bit indices can count".to_string()));
        }
        let mut column_starts = Vec::with_capacity(2 * nodes + 1);
        let mut rows = Vec::with_capacity(entries);
        column_starts.push(0);
        for j in 0..nodes {
            let blocks = matrix.coupled(j);
            for _ in 0..2 {
                rows.extend(2 * blocks.start as u32..2 * blocks.end as u32);
                column_starts.push(rows.len() as u32);
            }
        }
        let pattern = SymbolicSparseColMat::new_checked(2 * nodes, 2 * nodes, column_starts, None, rows);
        let params = LuSymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic = factorize_symbolic_lu(pattern.as_ref(), params).map_err(|e| failed(format!("{e:?}")))?;
        let scratch = StackReq::any_of(&[
            symbolic.factorize_numeric_lu_scratch::<f64>(Par::Seq, Spec::default()),
            symbolic.solve_in_place_scratch::<f64>(1, Par::Seq),
            symbolic.solve_transpose_in_place_scratch::<f64>(1, Par::Seq),
        ]);
        let scratch = MemBuffer::try_new(scratch).map_err(|_| failed("out of memory".to_string()))?;
        Ok(Self { pattern, values: vec![0.0; entries], symbolic, numeric: NumericLu::new(), scratch, factored: false })
    }

    fn factor(&mut self, matrix: &BandMatrix) -> Result<()> {
        self.factored = false;
        let mut at = 0;
        for j in 0..matrix.nodes() {
            for b in 0..2 {
                for i in matrix.coupled(j) {
                    let block = matrix.rows()[i][j + super::HALF_BANDWIDTH - i];
                    self.values[at..at + 2].copy_from_slice(&[block[b], block[2 + b]]);
                    at += 2;
                }
            }
        }
        self.symbolic
            .factorize_numeric_lu(
                &mut self.numeric,
                SparseColMatRef::new(self.pattern.as_ref(), &self.values),
                Par::Seq,
                MemStack::new(&mut self.scratch),
                Spec::default(),
            )
            .map_err(|e| Error::Linear { unknowns: matrix.unknowns(), reason: format!("{e:?}") })?;
        self.factored = true;
        Ok(())
    }

    fn solve(&mut self, rhs: &mut [f64]) {
        self.solve_with(rhs, false);
    }

    fn solve_transposed(&mut self, rhs: &mut [f64]) {
        self.solve_with(rhs, true);
    }
}
