//! A 2×2 block as pairs of numbers, for assembly.

use std::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::{Matrix2, Vector2};
use wide::f64x2;

use super::real::{Pair, Real};

/// A 2×2 block, each row a pair. nalgebra stores matrices by columns; this one is stored by rows, like the blocks of a
/// [`BandMatrix`](super::BandMatrix), so that results are stored without transposition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block<T: Real = f64>([T::Pair; 2]);

/// A vector as a pair.
#[inline(always)]
pub fn pair<T: Real>(vector: Vector2<T>) -> T::Pair {
    T::Pair::new(vector.into())
}

impl Block {
    /// The block of zeros.
    pub const ZERO: Self = Self([f64x2::ZERO; 2]);
}

impl<T: Real> Block<T> {
    /// a bᵀ.
    #[inline(always)]
    pub fn outer(a: Vector2<T>, b: T::Pair) -> Self {
        Self([b * a.x, b * a.y])
    }

    /// `value` times the identity.
    #[inline(always)]
    pub fn diagonal(value: T) -> Self {
        let zero = value.like(0.0);
        Self([T::Pair::new([value, zero]), T::Pair::new([zero, value])])
    }

    /// The transpose.
    #[inline(always)]
    pub fn transpose(self) -> Self {
        Self(T::Pair::transpose(self.0))
    }
}

impl From<Matrix2<f64>> for Block {
    #[inline(always)]
    fn from(block: Matrix2<f64>) -> Self {
        Self([f64x2::new([block.m11, block.m12]), f64x2::new([block.m21, block.m22])])
    }
}

impl From<Block> for Matrix2<f64> {
    #[inline(always)]
    fn from(block: Block) -> Self {
        let [a, b, c, d] = block.into();
        Self::new(a, b, c, d)
    }
}

impl<T: Real> From<Block<T>> for [T; 4] {
    #[inline(always)]
    fn from(Block([upper, lower]): Block<T>) -> Self {
        let ([a, b], [c, d]) = (upper.to_array(), lower.to_array());
        [a, b, c, d]
    }
}

impl<T: Real> AddAssign for Block<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Real> Add for Block<T> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl<T: Real> Sub for Block<T> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
    }
}

impl<T: Real> Mul<T> for Block<T> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: T) -> Self {
        Self([self.0[0] * factor, self.0[1] * factor])
    }
}
