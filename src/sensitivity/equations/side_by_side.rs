//! Products and solves for many vectors stored side by side: entry `i` of vector `c` of `width` vectors is at `i·width + c`, so
//! each block of a matrix is read once for all of them.

use std::ops::Range;

use nalgebra::Matrix2;

use super::{Equations, neighbours};
use crate::error::Result;
use crate::linear::{BandMatrix, HALF_BANDWIDTH};

/// The rows of both axes of node `k`, in these `columns`.
#[inline(always)]
fn node(x: &[f64], k: usize, width: usize, columns: Range<usize>) -> [&[f64]; 2] {
    let (first, second) = x[2 * k * width..2 * (k + 1) * width].split_at(width);
    [&first[columns.clone()], &second[columns]]
}

/// The same, to be written.
#[inline(always)]
fn node_mut(x: &mut [f64], k: usize, width: usize, columns: Range<usize>) -> [&mut [f64]; 2] {
    let (first, second) = x[2 * k * width..2 * (k + 1) * width].split_at_mut(width);
    [&mut first[columns.clone()], &mut second[columns]]
}

/// For each node, the columns in which vectors side by side are not zero, by groups of neighbouring columns: bit `g` stands for group `g`. A
/// step begins with unit vectors, whose products with a band have a few columns only.
struct NonzeroColumns {
    width: usize,
    /// Columns of a group.
    group: usize,
    groups: Vec<u64>,
}

/// The fewest columns of a group: what a product does at once.
const MIN_GROUP: usize = 8;

impl NonzeroColumns {
    fn of(x: &[f64], width: usize) -> Self {
        let group = width.div_ceil(u64::BITS as usize).max(MIN_GROUP);
        let groups = |rows: &[f64]| {
            let (first, second) = rows.split_at(width);
            let pairs = first.chunks(group).zip(second.chunks(group)).enumerate();
            pairs.fold(0, |groups, (g, (first, second))| {
                let bits = first.iter().zip(second).fold(0, |bits, (x, y)| bits | x.to_bits() | y.to_bits());
                // Without the sign, which zero may have too.
                groups | u64::from(bits << 1 != 0) << g
            })
        };
        Self { width, group, groups: x.chunks_exact(2 * width).map(groups).collect() }
    }

    /// Calls `work` with each run of columns in which any of `nodes` is not zero.
    #[inline(always)]
    fn each<const N: usize>(&self, nodes: [usize; N], mut work: impl FnMut(Range<usize>)) {
        let mut groups = nodes.into_iter().fold(0, |groups, k| groups | self.groups[k]);
        while groups != 0 {
            let first = groups.trailing_zeros();
            let end = first + (groups >> first).trailing_ones();
            groups &= u64::MAX.checked_shl(end).unwrap_or(0);
            work(first as usize * self.group..(end as usize * self.group).min(self.width));
        }
    }
}

/// Subtracts a 2×2 block times the differences from `from` to `to` from `y`.
#[inline(always)]
fn subtract_difference(
    [y0, y1]: [&mut [f64]; 2],
    [a, b, c, d]: [f64; 4],
    [to0, to1]: [&[f64]; 2],
    [from0, from1]: [&[f64]; 2],
) {
    let width = y0.len();
    let (y1, to0, to1, from0, from1) =
        (&mut y1[..width], &to0[..width], &to1[..width], &from0[..width], &from1[..width]);
    for i in 0..width {
        let by = [to0[i] - from0[i], to1[i] - from1[i]];
        y0[i] -= a * by[0] + b * by[1];
        y1[i] -= c * by[0] + d * by[1];
    }
}

/// Adds a 2×2 block times `x` to `y`.
#[inline(always)]
fn add_product([y0, y1]: [&mut [f64]; 2], [a, b, c, d]: [f64; 4], [x0, x1]: [&[f64]; 2]) {
    let width = y0.len();
    let (y1, x0, x1) = (&mut y1[..width], &x0[..width], &x1[..width]);
    for i in 0..width {
        y0[i] += a * x0[i] + b * x1[i];
        y1[i] += c * x0[i] + d * x1[i];
    }
}

/// Adds `factor` times `matrix` times `width` vectors to y.
fn add_band_of_many(matrix: &BandMatrix, factor: f64, x: &[f64], y: &mut [f64], width: usize) {
    let (nodes, nonzero) = (matrix.rows().len(), NonzeroColumns::of(x, width));
    for (i, row) in matrix.rows().iter().enumerate() {
        for (j, [a, b, c, d]) in row.iter().enumerate() {
            let Some(j) = (i + j).checked_sub(HALF_BANDWIDTH).filter(|j| *j < nodes) else { continue };
            let block = [factor * a, factor * b, factor * c, factor * d];
            nonzero.each([j], |columns| {
                add_product(node_mut(y, i, width, columns.clone()), block, node(x, j, width, columns));
            });
        }
    }
}

/// The entries of a matrix in the order of a block.
#[inline(always)]
fn entries(matrix: Matrix2<f64>) -> [f64; 4] {
    [matrix.m11, matrix.m12, matrix.m21, matrix.m22]
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
        let (nodes, nonzero) = (self.matrix.rows().len(), NonzeroColumns::of(x, width));
        let columns = self.columns.as_ref().filter(|_| self.held.is_none()).map(|[columns, _]| columns);
        // Sums over the nodes minus those of the external forces, and the values of one node; see `balance`.
        let [mut excess, mut own] = [0, 1].map(|_| if columns.is_some() { vec![0.0; 2 * width] } else { Vec::new() });
        for (i, row) in self.matrix.rows().iter().enumerate() {
            own.fill(0.0);
            // Forces of one node on their own, where their sum over all nodes is needed.
            let sum = if columns.is_some() { &mut own[..] } else { &mut y[2 * i * width..2 * (i + 1) * width] };
            for (j, block) in neighbours(i, row, nodes) {
                let block = self.stiffness(i, j, block);
                nonzero.each([i, j], |columns| {
                    let [to, from] = [j, i].map(|k| node(x, k, width, columns.clone()));
                    subtract_difference(node_mut(sum, 0, width, columns), block, to, from);
                });
            }
            if let Some(place) = &self.place {
                let block = entries(place[i] * -self.direction.q);
                nonzero.each([i], |columns| {
                    add_product(node_mut(sum, 0, width, columns.clone()), block, node(x, i, width, columns));
                });
            }
            if let Some(columns) = columns {
                let sums = y[2 * i * width..].iter_mut().zip(&mut excess).zip(&own);
                sums.for_each(|((y, excess), own)| (*y, *excess) = (*y + own, *excess + own));
                let outside = entries(columns[i] * self.direction.q);
                nonzero.each([i], |columns| {
                    let excess = node_mut(&mut excess, 0, width, columns.clone());
                    add_product(excess, outside, node(x, i, width, columns));
                });
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
                let (nodes, nonzero) = (damping.rows().len(), NonzeroColumns::of(x, width));
                for (i, row) in damping.rows().iter().enumerate() {
                    for (j, [a, b, c, d]) in neighbours(i, row, nodes) {
                        let block = [-factor * a, -factor * b, -factor * c, -factor * d];
                        nonzero.each([i, j], |columns| {
                            let [to, from] = [j, i].map(|k| node(x, k, width, columns.clone()));
                            subtract_difference(node_mut(y, i, width, columns), block, to, from);
                        });
                    }
                    let block = entries(drift[i] * factor);
                    nonzero.each([i], |columns| {
                        add_product(node_mut(y, i, width, columns.clone()), block, node(x, i, width, columns));
                    });
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
        let mut first: Vec<f64> = rhs.chunks_exact(width.max(1)).map(|row| row.iter().sum()).collect();
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
