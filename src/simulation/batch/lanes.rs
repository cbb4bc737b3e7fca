//! Number types for batches: one number, or a pair, of each of four cases in the SIMD lanes of AVX2.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

use fearless_simd::prelude::*;
use fearless_simd::{Avx2, f64x4, mask64x4};

use super::WIDTH;
use crate::linear::{Number, Pair, Real};

/// One number of each case.
#[derive(Debug, Clone, Copy)]
pub struct Lanes(f64x4<Avx2>);

impl Lanes {
    /// Packs the number of each case into lanes.
    #[inline(always)]
    pub fn new(simd: Avx2, cases: [f64; WIDTH]) -> Self {
        Self(f64x4::simd_from(simd, cases))
    }

    /// The number of each case.
    #[inline(always)]
    pub fn to_array(self) -> [f64; WIDTH] {
        *self.0
    }

    /// The number of a case.
    #[inline(always)]
    pub fn get(&self, case: usize) -> f64 {
        self.0[case]
    }

    /// Sets the number of a case in memory, since inserting into a register would serialise the writes.
    #[inline(always)]
    pub fn set(&mut self, case: usize, x: f64) {
        self.0[case] = x;
    }

    /// The numbers of the `chosen` cases, and zero for the others.
    #[inline(always)]
    pub fn of(self, chosen: mask64x4<Avx2>) -> Self {
        Self(chosen.select(self.0, self.like(0.0).0))
    }
}

impl PartialEq for Lanes {
    fn eq(&self, other: &Self) -> bool {
        *self.0 == *other.0
    }
}

/// The operators of a number type with one field, or of one with two fields that are computed separately.
macro_rules! operators {
    ($number:ident, $($operator:ident $function:ident $sign:tt),*) => {
        $(impl $operator for $number {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                self.with(other, #[inline(always)] |a, b| a $sign b)
            }
        })*

        impl AddAssign for $number {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
    };
}

operators!(Lanes, Add add +, Sub sub -, Mul mul *, Div div /);
operators!(PairLanes, Add add +, Sub sub -, Mul mul *, Div div /);

impl Lanes {
    #[inline(always)]
    fn with(self, other: Self, of: impl Fn(f64x4<Avx2>, f64x4<Avx2>) -> f64x4<Avx2>) -> Self {
        Self(of(self.0, other.0))
    }
}

impl Neg for Lanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Number for Lanes {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self(f64x4::simd_from(self.0.simd, x))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    /// Evaluated case by case with the scalar function.
    #[inline(always)]
    fn ln(self) -> Self {
        let [a, b, c, d] = *self.0;
        Self(f64x4::simd_from(self.0.simd, [a.ln(), b.ln(), c.ln(), d.ln()]))
    }

    #[inline(always)]
    fn where_at_most(x: Self, limit: Self, then: Self, otherwise: Self) -> Self {
        Self(x.0.simd_le(limit.0).select(then.0, otherwise.0))
    }
}

impl Real for Lanes {
    type Pair = PairLanes;
}

/// A pair of numbers of each case.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairLanes([Lanes; 2]);

impl PairLanes {
    /// Sets the pair of a case.
    pub fn set(&mut self, case: usize, pair: [f64; 2]) {
        self.0.iter_mut().zip(pair).for_each(|(to, from)| to.set(case, from));
    }

    #[inline(always)]
    fn with(self, other: Self, of: impl Fn(Lanes, Lanes) -> Lanes) -> Self {
        Self([of(self.0[0], other.0[0]), of(self.0[1], other.0[1])])
    }
}

impl Neg for PairLanes {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self([-self.0[0], -self.0[1]])
    }
}

impl Mul<Lanes> for PairLanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: Lanes) -> Self {
        Self([self.0[0] * factor, self.0[1] * factor])
    }
}

impl Number for PairLanes {
    #[inline(always)]
    fn like(self, x: f64) -> Self {
        Self([self.0[0].like(x); 2])
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self([self.0[0].abs(), self.0[1].abs()])
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.with(
            other,
            #[inline(always)]
            |a, b| a.larger(b),
        )
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self([self.0[0].sqrt(), self.0[1].sqrt()])
    }

    #[inline(always)]
    fn ln(self) -> Self {
        Self([self.0[0].ln(), self.0[1].ln()])
    }

    #[inline(always)]
    fn where_at_most(x: Self, limit: Self, then: Self, otherwise: Self) -> Self {
        let ([x, y], [limit, of_y], [then, of_then], [otherwise, of_otherwise]) = (x.0, limit.0, then.0, otherwise.0);
        Self([Lanes::where_at_most(x, limit, then, otherwise), Lanes::where_at_most(y, of_y, of_then, of_otherwise)])
    }
}

impl Pair<Lanes> for PairLanes {
    #[inline(always)]
    fn new(both: [Lanes; 2]) -> Self {
        Self(both)
    }

    #[inline(always)]
    fn to_array(self) -> [Lanes; 2] {
        self.0
    }

    #[inline(always)]
    fn transpose([first, second]: [Self; 2]) -> [Self; 2] {
        [Self([first.0[0], second.0[0]]), Self([first.0[1], second.0[1]])]
    }
}

/// Gathers the pairs of all cases.
pub fn two(simd: Avx2, case: impl Fn(usize) -> [f64; 2]) -> PairLanes {
    let cases: [[f64; 2]; WIDTH] = std::array::from_fn(case);
    PairLanes::new([0, 1].map(|i| Lanes::new(simd, cases.map(|pair| pair[i]))))
}
