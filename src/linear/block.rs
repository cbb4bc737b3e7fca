//! A 2×2 block in SIMD lanes, for assembly.

use std::ops::{Add, Mul, Sub};

use nalgebra::{Matrix2, Vector2};
use wide::f64x2;

/// A 2×2 block, each row in two lanes. nalgebra's matrices are stored by columns and this one by rows, as the blocks of a
/// [`BandMatrix`](super::BandMatrix) are: what is computed here is stored as it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block([f64x2; 2]);

/// A vector in two lanes.
#[inline(always)]
pub fn lanes(vector: Vector2<f64>) -> f64x2 {
    f64x2::new(vector.into())
}

impl Block {
    /// The block of zeros.
    pub const ZERO: Self = Self([f64x2::ZERO; 2]);

    /// a bᵀ.
    #[inline(always)]
    pub fn outer(a: Vector2<f64>, b: f64x2) -> Self {
        Self([b * a.x, b * a.y])
    }

    /// `value` times the identity.
    #[inline(always)]
    pub fn diagonal(value: f64) -> Self {
        Self([f64x2::new([value, 0.0]), f64x2::new([0.0, value])])
    }

    /// The transpose.
    #[inline(always)]
    pub fn transpose(self) -> Self {
        Self(f64x2::transpose(self.0))
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

impl From<Block> for [f64; 4] {
    #[inline(always)]
    fn from(Block([upper, lower]): Block) -> Self {
        let ([a, b], [c, d]) = (upper.to_array(), lower.to_array());
        [a, b, c, d]
    }
}

impl std::ops::AddAssign for Block {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Add for Block {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl Sub for Block {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
    }
}

impl Mul<f64> for Block {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self([self.0[0] * factor, self.0[1] * factor])
    }
}
