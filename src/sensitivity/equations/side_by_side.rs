//! Products and solves for many vectors stored side by side: entry `i` of vector `c` of `width` vectors is at `i·width + c`, so
//! each block of a matrix is read once for all of them.

use super::{Equations, neighbours};
use crate::error::Result;
use crate::linear::{BandMatrix, HALF_BANDWIDTH};

/// The rows of both axes of node `k`.
fn node(x: &[f64], k: usize, width: usize) -> [&[f64]; 2] {
    let (first, second) = x[2 * k * width..2 * (k + 1) * width].split_at(width);
    [first, second]
}

/// The same, mutable.
fn node_mut(x: &mut [f64], k: usize, width: usize) -> [&mut [f64]; 2] {
    let (first, second) = x[2 * k * width..2 * (k + 1) * width].split_at_mut(width);
    [first, second]
}

/// Subtracts a 2×2 block times the differences from `from` to `to` from `y`.
#[inline(always)]
fn subtract_difference([y0, y1]: [&mut [f64]; 2], block: [f64; 4], to: [&[f64]; 2], from: [&[f64]; 2]) {
    let [a, b, c, d] = block;
    let width = y0.len();
    let (y1, to, from) = (&mut y1[..width], to.map(|x| &x[..width]), from.map(|x| &x[..width]));
    for i in 0..width {
        let by = [to[0][i] - from[0][i], to[1][i] - from[1][i]];
        y0[i] -= a * by[0] + b * by[1];
        y1[i] -= c * by[0] + d * by[1];
    }
}

/// Adds a 2×2 block times `x` to `y`.
#[inline(always)]
fn add_product([y0, y1]: [&mut [f64]; 2], block: [f64; 4], x: [&[f64]; 2]) {
    let [a, b, c, d] = block;
    let width = y0.len();
    let (y1, x) = (&mut y1[..width], x.map(|x| &x[..width]));
    for i in 0..width {
        y0[i] += a * x[0][i] + b * x[1][i];
        y1[i] += c * x[0][i] + d * x[1][i];
    }
}

/// Adds `factor` times `matrix` times `width` vectors to y.
fn add_band_of_many(matrix: &BandMatrix, factor: f64, x: &[f64], y: &mut [f64], width: usize) {
    let nodes = matrix.rows().len();
    for (i, row) in matrix.rows().iter().enumerate() {
        for (j, block) in row.iter().enumerate() {
            let Some(j) = (i + j).checked_sub(HALF_BANDWIDTH).filter(|j| *j < nodes) else { continue };
            add_product(node_mut(y, i, width), block.map(|entry| factor * entry), node(x, j, width));
        }
    }
}

impl Equations {
    /// True if the matrices are purely banded.
    fn is_banded(&self) -> bool {
        self.hinge.is_none() && self.winches.is_empty() && self.global.is_none()
    }

    /// Calls `work` with each of `width` vectors of `x` and the corresponding one of `y`, which is written back.
    fn one_by_one(
        &mut self,
        x: &[f64],
        y: &mut [f64],
        width: usize,
        mut work: impl FnMut(&mut Self, &[f64], &mut [f64]) -> Result<()>,
    ) -> Result<()> {
        let unknowns = y.len() / width.max(1);
        let (mut from, mut to) = (vec![0.0; unknowns], vec![0.0; unknowns]);
        for c in 0..width {
            for i in 0..unknowns {
                (from[i], to[i]) = (x[i * width + c], y[i * width + c]);
            }
            work(self, &from, &mut to)?;
            (0..unknowns).for_each(|i| y[i * width + c] = to[i]);
        }
        Ok(())
    }

    /// Calls `work` with each of `width` vectors of `rhs`, which is written back.
    fn each_in_place(
        &mut self,
        rhs: &mut [f64],
        width: usize,
        mut work: impl FnMut(&mut Self, &mut [f64]) -> Result<()>,
    ) -> Result<()> {
        let mut one = vec![0.0; rhs.len() / width.max(1)];
        for c in 0..width {
            one.iter_mut().zip(rhs.iter().skip(c).step_by(width)).for_each(|(one, x)| *one = *x);
            work(self, &mut one)?;
            rhs.iter_mut().skip(c).step_by(width).zip(&one).for_each(|(x, one)| *x = *one);
        }
        Ok(())
    }

    /// y = −A f_q x of `width` vectors, see [`differences`](Self::differences).
    pub(in crate::sensitivity) fn differences_of_many(&mut self, x: &[f64], y: &mut [f64], width: usize) -> Result<()> {
        y.fill(0.0);
        self.add_differences_of_many(x, y, width)
    }

    /// Adds −A f_q x of `width` vectors to y.
    pub(super) fn add_differences_of_many(&mut self, x: &[f64], y: &mut [f64], width: usize) -> Result<()> {
        if !self.is_banded() {
            return self.one_by_one(x, y, width, |own, x, y| {
                own.add_along(x, y, false);
                Ok(())
            });
        }
        let nodes = self.matrix.rows().len();
        let columns = self.columns.as_ref().filter(|_| self.held.is_none()).map(|[columns, _]| columns);
        // Sums over the nodes minus those of the external forces, and the values of one node; see `balance`.
        let [mut excess, mut own] = [0, 1].map(|_| if columns.is_some() { vec![0.0; 2 * width] } else { Vec::new() });
        for (i, row) in self.matrix.rows().iter().enumerate() {
            own.fill(0.0);
            let to = |y: &mut [f64], own: &mut [f64], add: &dyn Fn([&mut [f64]; 2])| match columns {
                None => add(node_mut(y, i, width)),
                Some(_) => add(node_mut(own, 0, width)),
            };
            for (j, block) in neighbours(i, row, nodes) {
                let block = self.stiffness(i, j, block);
                to(y, &mut own, &|y| subtract_difference(y, block, node(x, j, width), node(x, i, width)));
            }
            if let Some(place) = &self.place {
                let place = place[i] * -self.direction.q;
                to(y, &mut own, &|y| add_product(y, [place.m11, place.m12, place.m21, place.m22], node(x, i, width)));
            }
            if let Some(columns) = columns {
                let sums = y[2 * i * width..].iter_mut().zip(&mut excess).zip(&own);
                sums.for_each(|((y, excess), own)| (*y, *excess) = (*y + own, *excess + own));
                let outside = columns[i] * self.direction.q;
                let outside = [outside.m11, outside.m12, outside.m21, outside.m22];
                add_product(node_mut(&mut excess, 0, width), outside, node(x, i, width));
            }
        }
        if columns.is_some() {
            let total = self.masses.iter().sum::<f64>();
            for (y, mass) in y.chunks_exact_mut(2 * width).zip(&self.masses) {
                let part = mass / total;
                y.iter_mut().zip(&excess).for_each(|(y, excess)| *y -= part * excess);
            }
        }
        Ok(())
    }

    /// Adds `factor` times f_v x of `width` vectors to y.
    pub(in crate::sensitivity) fn add_damping_of_many(
        &mut self,
        factor: f64,
        x: &[f64],
        y: &mut [f64],
        width: usize,
    ) -> Result<()> {
        if !self.is_banded() {
            return self.one_by_one(x, y, width, |own, x, y| {
                y.iter_mut().zip(own.damp(x, false)).for_each(|(y, damped)| *y += factor * damped);
                Ok(())
            });
        }
        match (&self.damping, &self.drift) {
            (Some(damping), Some(drift)) => {
                let nodes = damping.rows().len();
                for (i, row) in damping.rows().iter().enumerate() {
                    for (j, block) in neighbours(i, row, nodes) {
                        let block = block.map(|entry| -factor * entry);
                        subtract_difference(node_mut(y, i, width), block, node(x, j, width), node(x, i, width));
                    }
                    let drift = drift[i] * factor;
                    add_product(node_mut(y, i, width), [drift.m11, drift.m12, drift.m21, drift.m22], node(x, i, width));
                }
            }
            (Some(damping), None) => add_band_of_many(damping, factor, x, y, width),
            (None, _) => {}
        }
        Ok(())
    }

    /// Adds f_a x of `width` vectors to y, for nodes with these `masses`.
    pub(in crate::sensitivity) fn add_inertia_of_many(
        &mut self,
        masses: &[f64],
        x: &[f64],
        y: &mut [f64],
        width: usize,
    ) -> Result<()> {
        if !self.is_banded() {
            return self.one_by_one(x, y, width, |own, x, y| {
                own.add_inertia(masses, x, y);
                Ok(())
            });
        }
        match &self.inertia {
            Some(inertia) => add_band_of_many(inertia, 1.0, x, y, width),
            None => {
                for (k, mass) in masses.iter().enumerate() {
                    let rows = 2 * k * width..2 * (k + 1) * width;
                    y[rows.clone()].iter_mut().zip(&x[rows]).for_each(|(y, x)| *y += mass * x);
                }
            }
        }
        Ok(())
    }

    /// Factors for the first of `width` right-hand sides, and replaces all of them by A⁻¹ times them.
    pub(in crate::sensitivity) fn factor_and_solve_many(&mut self, rhs: &mut [f64], width: usize) -> Result<()> {
        let unknowns = rhs.len() / width.max(1);
        let mut first: Vec<f64> = (0..unknowns).map(|i| rhs.iter().skip(i * width).take(width).sum()).collect();
        self.factor_alone(&mut first, false)?;
        let given = if self.refines { rhs.to_vec() } else { Vec::new() };
        self.solve_many_alone(rhs, width)?;
        if self.refines { self.refine_many(&given, rhs, width) } else { Ok(()) }
    }

    /// Replaces `width` right-hand sides by A⁻¹ times them, with the existing factors.
    pub(super) fn solve_many_alone(&mut self, rhs: &mut [f64], width: usize) -> Result<()> {
        if self.is_banded() && !self.pivoted {
            self.band.solve_many(rhs, width);
            return Ok(());
        }
        self.each_in_place(rhs, width, |own, rhs| {
            own.solve_alone(rhs, false);
            Ok(())
        })
    }

    /// Replaces `width` vectors by f_a⁻¹ times them, see [`divide_by_inertia`](Self::divide_by_inertia).
    pub(in crate::sensitivity) fn divide_many_by_inertia(
        &mut self,
        masses: &[f64],
        rhs: &mut [f64],
        width: usize,
    ) -> Result<()> {
        if self.inertia.is_some() || self.hinge.is_some() {
            return self.each_in_place(rhs, width, |own, rhs| own.divide_by_inertia(masses, rhs));
        }
        for (k, mass) in masses.iter().enumerate() {
            rhs[2 * k * width..2 * (k + 1) * width].iter_mut().for_each(|x| *x /= mass);
        }
        Ok(())
    }
}
