//! External forces on the edges of a rod, in the form that the assembly needs.

use nalgebra::{Matrix2, Vector2};
use wide::f64x2;

use crate::linear::{Block, Real, pair};

/// Number of edges whose forces are computed together before they are used, so that their values stay in the L1 cache.
pub const EDGES_PER_BLOCK: usize = 32;

/// A force on the two ends of an edge, with the sign of the residual (a resistance is positive), and its derivatives
/// along a direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeForce<T: Real = f64> {
    pub(crate) force: [T::Pair; 2],
    pub(crate) own: [Block<T>; 2],
    pub(crate) edge: [Block<T>; 2],
}

impl<T: Real> EdgeForce<T> {
    /// The force on end `i`, 0 or 1, as a pair.
    #[inline(always)]
    pub(crate) fn force_lanes(&self, i: usize) -> T::Pair {
        self.force[i]
    }

    /// Derivative of the force on end `i` with respect to a translation of the whole edge, along the direction.
    #[inline(always)]
    pub fn own(&self, i: usize) -> Block<T> {
        self.own[i]
    }

    /// Derivative of the force on end `i` with respect to the edge vector while that end stays, along the direction.
    #[inline(always)]
    pub fn edge(&self, i: usize) -> Block<T> {
        self.edge[i]
    }

    /// Adds `other`.
    #[inline(always)]
    pub(crate) fn add(&mut self, other: &Self) {
        self.add_force(other);
        for i in 0..2 {
            self.own[i] += other.own[i];
            self.edge[i] += other.edge[i];
        }
    }

    /// Adds only the force of `other`.
    #[inline(always)]
    pub(crate) fn add_force(&mut self, other: &Self) {
        for i in 0..2 {
            self.force[i] += other.force[i];
        }
    }
}

impl EdgeForce {
    /// No force.
    pub const ZERO: Self = Self { force: [f64x2::ZERO; 2], own: [Block::ZERO; 2], edge: [Block::ZERO; 2] };

    /// An unknown force: NaN.
    pub(crate) const UNKNOWN: Self = Self { force: [f64x2::new([f64::NAN; 2]); 2], ..Self::ZERO };

    /// An edge force from its parts for both ends, see [`force`](Self::force), [`own`](Self::own) and
    /// [`edge`](Self::edge).
    #[inline(always)]
    pub fn new(force: [Vector2<f64>; 2], own: [Block; 2], edge: [Block; 2]) -> Self {
        Self { force: force.map(pair), own, edge }
    }

    /// The force (N) on end `i`, 0 or 1.
    #[inline(always)]
    pub fn force(&self, i: usize) -> Vector2<f64> {
        self.force[i].to_array().into()
    }

    /// The first-order change of the force on end `i` if the nodes of the edge move by `d`.
    pub fn change(&self, i: usize, d: [Vector2<f64>; 2]) -> Vector2<f64> {
        Matrix2::from(self.own[i]) * d[i] + Matrix2::from(self.edge[i]) * (d[1] - d[0])
    }

    /// The cotangents of both nodes for a cotangent `c` of the force on end `i`: the transpose of [`change`](Self::change).
    pub fn change_transposed(&self, i: usize, c: Vector2<f64>) -> [Vector2<f64>; 2] {
        let edge = Matrix2::from(self.edge[i]).tr_mul(&c);
        let mut nodes = [-edge, edge];
        nodes[i] += Matrix2::from(self.own[i]).tr_mul(&c);
        nodes
    }
}
