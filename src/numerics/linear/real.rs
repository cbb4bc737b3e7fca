//! The number type of the equations of motion: one number, or the numbers of several cases in SIMD lanes.
//!
//! The steps of one case and of several share one source: edges, joints, drag, assembly and elimination are generic over [`Real`].
//! Multiplications and additions are not fused, so a case is bit-identical alone and in a batch.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use nalgebra::Scalar;
use wide::f64x2;

/// The arithmetic shared by a [`Real`] and a [`Pair`] of them.
pub trait Number:
    Copy
    + Debug
    + PartialEq
    + Add<Output = Self>
    + AddAssign
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// `x` in every lane; `self` only selects the number type.
    fn like(self, x: f64) -> Self;

    /// The absolute value.
    fn abs(self) -> Self;

    /// The larger of two numbers.
    fn larger(self, other: Self) -> Self;

    /// The square root.
    fn sqrt(self) -> Self;

    /// The natural logarithm.
    fn ln(self) -> Self;

    /// `then` where `x` is at most `limit`, otherwise `otherwise`.
    fn where_at_most(x: Self, limit: Self, then: Self, otherwise: Self) -> Self;
}

/// The real number of one case, `f64`, or of several cases in lanes.
pub trait Real: Number + Scalar {
    /// Two of them.
    type Pair: Pair<Self>;

    /// Runs `work` outside of a loop, whose registers it would occupy (a tenth of the instructions of an elimination). In lanes it
    /// is inlined, because the whole function is compiled for their instruction set.
    #[inline(always)]
    fn out_of_line<R>(work: impl FnOnce() -> R) -> R {
        work()
    }
}

/// Two numbers: the components of a vector, or values at both ends of an edge or of the rod. For one case they are two SIMD lanes.
pub trait Pair<T>: Number + Mul<T, Output = Self> {
    /// The pair of both, in order.
    fn new(both: [T; 2]) -> Self;

    /// The inverse of [`new`](Self::new).
    fn to_array(self) -> [T; 2];

    /// The sum of both.
    #[inline(always)]
    fn sum(self) -> T
    where
        T: Number,
    {
        let [first, second] = self.to_array();
        first + second
    }

    /// The first components of two pairs, and the second components.
    fn transpose(pairs: [Self; 2]) -> [Self; 2];
}

impl Number for f64 {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        x
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn ln(self) -> Self {
        self.ln()
    }

    #[inline(always)]
    fn where_at_most(x: Self, limit: Self, then: Self, otherwise: Self) -> Self {
        if x <= limit { then } else { otherwise }
    }
}

impl Real for f64 {
    type Pair = f64x2;

    #[inline(never)]
    fn out_of_line<R>(work: impl FnOnce() -> R) -> R {
        work()
    }
}

impl Number for f64x2 {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self::new([x; 2])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.fast_max(other)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    /// Operation by operation the same as for one number.
    #[inline(always)]
    fn ln(self) -> Self {
        let [first, second] = self.to_array();
        Self::new([first.ln(), second.ln()])
    }

    #[inline(always)]
    fn where_at_most(x: Self, limit: Self, then: Self, otherwise: Self) -> Self {
        x.simd_le(limit).bitselect(then, otherwise)
    }
}

impl Pair<f64> for f64x2 {
    #[inline(always)]
    fn new(both: [f64; 2]) -> Self {
        Self::new(both)
    }

    #[inline(always)]
    fn to_array(self) -> [f64; 2] {
        self.to_array()
    }

    #[inline(always)]
    fn transpose(pairs: [Self; 2]) -> [Self; 2] {
        Self::transpose(pairs)
    }
}
