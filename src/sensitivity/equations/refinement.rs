//! Iterative refinement of solutions on fine meshes.
//!
//! A solution of J x = b in positions has a relative rounding error of up to 16ε(λ/ΔL)⁴ ([`chain::rounding`]): for a motion of
//! the whole rod, the entries EI/ΔL³ of the band cancel, and only m remains. Newton's method uses the same matrix, and its next
//! iteration removes the error, because its residuals are evaluated on the rod, not with the matrix. Here the residual b − J x is
//! summed over differences of x between nodes, which cancel before they are multiplied. x is corrected by J⁻¹ times the residual
//! until the correction is negligible (N. J. Higham, Accuracy and Stability of Numerical Algorithms, chapter 12).

use super::{Equations, largest};
use crate::error::{Error, Result};
use crate::linear::Direction;
use crate::model::chain;
use crate::rod::Rod;

/// Solutions are refined if the relative rounding error of one solve may exceed this.
pub(super) const FROM: f64 = 1e-10;

/// Refinement ends with a correction smaller than this fraction of the solution.
const ENOUGH: f64 = 1e-11;

/// The largest number of corrections.
const MOST: usize = 12;

/// If the corrections stay above this fraction of the solution, refinement fails.
const LARGEST_REST: f64 = 1e-4;

/// True if the relative rounding error of one solve along `direction` may exceed [`FROM`].
pub(super) fn is_needed(rod: &Rod, direction: Direction) -> bool {
    // c_q is at least a quarter of the square of the step in every method. Here it is assumed to be as large as for implicit
    // Euler.
    direction.a != 0.0 && chain::rounding(rod, 2.0 * direction.q.max(0.0).sqrt()) > FROM
}

impl Equations {
    /// Corrects the solution `x` for the right-hand side `given`.
    ///
    /// # Errors
    /// [`Error::Derivative`] if corrections do not shrink.
    pub(super) fn refine(&mut self, given: &[f64], x: &mut [f64], transposed: bool) -> Result<()> {
        if !self.refines {
            return Ok(());
        }
        let mut progress = Progress::default();
        while progress.goes_on() {
            let mut rest = given.to_vec();
            self.subtract_product(x, &mut rest, transposed);
            self.solve_alone(&mut rest, transposed);
            let size = largest(&rest) / largest(x).max(f64::MIN_POSITIVE);
            if progress.takes(size) {
                x.iter_mut().zip(&rest).for_each(|(x, by)| *x += by);
            }
        }
        self.judge(&progress)
    }

    /// The same for `width` vectors stored side by side.
    pub(super) fn refine_many(&mut self, given: &[f64], x: &mut [f64], width: usize) -> Result<()> {
        let mut progress = Progress::default();
        let mut rest = vec![0.0; x.len()];
        while progress.goes_on() {
            rest.copy_from_slice(given);
            self.subtract_product_of_many(x, &mut rest, width)?;
            self.solve_many_alone(&mut rest, width)?;
            // Columns with respect to positions, velocities and inputs have their own units.
            let mut sizes = vec![[0.0_f64; 2]; width];
            for (x, by) in x.chunks_exact(width).zip(rest.chunks_exact(width)) {
                for ((size, x), by) in sizes.iter_mut().zip(x).zip(by) {
                    *size = [size[0].max(x.abs()), if by.is_nan() { f64::NAN } else { size[1].max(by.abs()) }];
                }
            }
            let parts: Vec<f64> = sizes.iter().map(|[x, by]| by / x.max(f64::MIN_POSITIVE)).collect();
            if progress.takes(largest(&parts)) {
                x.iter_mut().zip(&rest).for_each(|(x, by)| *x += by);
            }
        }
        self.judge(&progress)
    }

    /// Subtracts J x, or Jᵀ x, from `rest`, summed over differences of x; rows of held nodes are zero.
    fn subtract_product(&mut self, x: &[f64], rest: &mut [f64], transposed: bool) {
        let Direction { v, a, .. } = self.direction;
        let mut x = x.to_vec();
        if self.held.is_some() {
            x[..2].fill(0.0);
        }
        self.add_along(&x, rest, transposed);
        rest.iter_mut().zip(self.damp(&x, transposed)).for_each(|(rest, by)| *rest -= v * by);
        let mut accelerated = vec![0.0; x.len()];
        let masses = std::mem::take(&mut self.masses);
        self.add_inertia(&masses, &x, &mut accelerated);
        self.masses = masses;
        rest.iter_mut().zip(accelerated).for_each(|(rest, by)| *rest -= a * by);
        if self.held.is_some() {
            rest[..2].fill(0.0);
        }
    }

    fn subtract_product_of_many(&mut self, x: &[f64], rest: &mut [f64], width: usize) -> Result<()> {
        let Direction { v, a, .. } = self.direction;
        // Held entries are given, and do not appear in the other rows.
        let mut x = x.to_vec();
        if self.held.is_some() {
            x[..2 * width].fill(0.0);
        }
        self.add_differences_of_many(&x, rest, width)?;
        self.add_damping_of_many(-v, &x, rest, width)?;
        x.iter_mut().for_each(|x| *x *= -a);
        let masses = std::mem::take(&mut self.masses);
        let done = self.add_inertia_of_many(&masses, &x, rest, width);
        self.masses = masses;
        if self.held.is_some() {
            rest[..2 * width].fill(0.0);
        }
        done
    }

    fn judge(&self, progress: &Progress) -> Result<()> {
        if progress.last <= LARGEST_REST {
            return Ok(());
        }
        let problem = format!(
            "the mesh of {} nodes is too fine for derivatives: iterative refinement leaves a relative error of {:.1e}, above {LARGEST_REST:e}; allowed: fewer nodes, or shorter steps",
            self.masses.len(),
            progress.last
        );
        Err(Error::Derivative { problem })
    }
}

/// The corrections so far.
#[derive(Debug)]
struct Progress {
    /// The last correction, relative to the solution.
    last: f64,
    count: usize,
    ended: bool,
}

impl Default for Progress {
    fn default() -> Self {
        Self { last: f64::INFINITY, count: 0, ended: false }
    }
}

impl Progress {
    fn goes_on(&self) -> bool {
        !self.ended && self.count < MOST
    }

    /// Accepts a correction of this relative `size`; returns false if it should not be applied.
    fn takes(&mut self, size: f64) -> bool {
        self.count += 1;
        let shrinks = size < 0.5 * self.last; // false for NaN
        self.ended = !shrinks || size <= ENOUGH;
        if shrinks {
            self.last = size;
        }
        shrinks
    }
}
