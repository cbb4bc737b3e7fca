//! The linear solver of a run, and the fallback if the fast solver fails.

use serde::{Deserialize, Serialize};

#[cfg(feature = "faer")]
use super::FaerLu;
use super::{BandMatrix, BlockBand, Coupling, Direction, LinearSolver, PivotedLu};
use crate::error::Result;

/// Largest [backward error](BandMatrix::backward_error) allowed in a solution by [`BlockBand`]: a few thousand rounding units.
/// Measured: below 1e-14 on the iterates of the scenes in `models/` with their own meshes; above it only if the matrix is
/// indefinite, far from a solution, or if double precision hardly resolves the mesh.
pub(super) const BACKWARD_ERROR: f64 = 1e-12;

/// Choice of the linear solver. To add one, write its file and list it here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum SolverChoice {
    /// [`BlockBand`] with a check of the solution; [`PivotedLu`] for every system that it does not solve to rounding accuracy.
    #[default]
    Auto,
    /// See [`FaerLu`].
    #[cfg(feature = "faer")]
    FaerLu,
    /// [`BlockBand`] alone: a solution that fails the check is replaced by NaN.
    BlockBand,
}

impl SolverChoice {
    /// True if it solves by [`BlockBand`] first.
    fn is_by_blocks(self) -> bool {
        matches!(self, Self::Auto | Self::BlockBand)
    }
}

/// Properties of a solution.
#[derive(Debug, Clone, Copy)]
pub struct Solution {
    /// True if the fast solver failed the check and a second factorisation was needed.
    pub fallback: bool,
    /// The largest moduli of the solution and of the right-hand side, from the check, if it ran: all their values are then finite.
    pub sizes: Option<[f64; 2]>,
}

/// The solver or solvers of a choice, for one system at a time.
#[derive(Debug)]
pub struct FallbackSolver {
    choice: SolverChoice,
    band: BlockBand,
    /// The pivoting solver, analysed on first use.
    lu: Option<Box<dyn LinearSolver>>,
    rhs: Vec<f64>,
}

impl FallbackSolver {
    /// Prepares for every matrix with the pattern of `matrix`.
    ///
    /// # Errors
    /// Errors of [`LinearSolver::analyse`].
    pub fn new(choice: SolverChoice, matrix: &BandMatrix) -> Result<Self> {
        let lu: Option<Box<dyn LinearSolver>> = match choice {
            #[cfg(feature = "faer")]
            SolverChoice::FaerLu => Some(Box::new(FaerLu::analyse(matrix)?)),
            SolverChoice::Auto | SolverChoice::BlockBand => None,
        };
        Ok(Self { choice, band: BlockBand::analyse(matrix)?, lu, rhs: vec![0.0; matrix.unknowns()] })
    }

    /// Replaces `rhs` by A⁻¹ rhs, by non-finite values if A is singular.
    ///
    /// # Errors
    /// Errors of [`LinearSolver::analyse`] and [`LinearSolver::factor`].
    pub fn solve(&mut self, matrix: &BandMatrix, rhs: &mut [f64]) -> Result<Solution> {
        self.rhs.copy_from_slice(rhs);
        if self.choice.is_by_blocks() {
            self.band.factor_and_solve(matrix, rhs)?;
            let checked = matrix.checked(rhs, &self.rhs);
            if checked.is_solved() {
                return Ok(Solution { fallback: false, sizes: Some([checked.x, checked.b]) });
            }
            if self.choice == SolverChoice::BlockBand {
                rhs.fill(f64::NAN);
                return Ok(Solution { fallback: false, sizes: None });
            }
            rhs.copy_from_slice(&self.rhs);
        }
        if !rhs.iter().all(|b| b.is_finite()) {
            rhs.fill(f64::NAN);
            return Ok(Solution { fallback: false, sizes: None });
        }
        let lu = match &mut self.lu {
            Some(lu) => lu,
            none => none.insert(Box::new(PivotedLu::analyse(matrix)?)),
        };
        lu.factor_and_solve(matrix, rhs)?;
        Ok(Solution { fallback: self.choice == SolverChoice::Auto, sizes: None })
    }

    /// Replaces `rhs` by the solution with the sum of `matrix` and the nonlocal part, see [`Coupling::solve`].
    pub fn solve_coupled(
        &mut self,
        matrix: &BandMatrix,
        coupling: &dyn Coupling,
        along: Direction,
        rhs: &mut [f64],
    ) -> Solution {
        self.rhs.copy_from_slice(rhs);
        coupling.solve(matrix, along, rhs);
        Solution { fallback: false, sizes: None }
    }

    /// True if it tries [`BlockBand`] first.
    pub fn is_by_blocks(&self) -> bool {
        self.choice.is_by_blocks()
    }

    /// The right-hand side of the last system.
    pub(crate) fn rhs(&self) -> &[f64] {
        &self.rhs
    }
}
