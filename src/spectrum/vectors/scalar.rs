//! The numbers that factors and Krylov spaces are stored in.

#![expect(clippy::inline_always, reason = "functions of another instruction set are not inlined otherwise")]

use std::ops::{AddAssign, Neg, SubAssign};

use faer::traits::RealField;
use pulp::Simd;

/// Single or double precision, and its vectors.
pub trait Scalar:
    RealField + Copy + AddAssign + SubAssign + Neg<Output = Self> + Into<f64> + PartialOrd
{
    /// Largest relative error of a rounded number.
    const ROUNDING: f64;

    /// A vector of an instruction set.
    type Vector<S: Simd>: Copy;

    /// The number nearest to `x`.
    fn nearest(x: f64) -> Self;

    /// Numbers of a vector.
    fn lanes<S: Simd>() -> usize;

    /// The whole vectors at the beginning of `x`.
    fn vectors<S: Simd>(x: &[Self]) -> &[Self::Vector<S>];

    /// The same to be changed.
    fn vectors_mut<S: Simd>(x: &mut [Self]) -> &mut [Self::Vector<S>];

    /// `x` in every lane.
    fn splat<S: Simd>(simd: S, x: Self) -> Self::Vector<S>;

    /// `a b`.
    fn times<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// `a b + c`.
    fn mul_add<S: Simd>(
        simd: S,
        a: Self::Vector<S>,
        b: Self::Vector<S>,
        c: Self::Vector<S>,
    ) -> Self::Vector<S>;

    /// `a − b`.
    fn minus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;

    /// `−a`.
    fn negated<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;
}

impl Scalar for f32 {
    const ROUNDING: f64 = 0.5 * f32::EPSILON as f64;

    type Vector<S: Simd> = S::f32s;

    #[allow(clippy::cast_possible_truncation)] // this is what it is for
    fn nearest(x: f64) -> Self {
        x as Self
    }

    fn lanes<S: Simd>() -> usize {
        S::F32_LANES
    }

    #[inline(always)]
    fn vectors<S: Simd>(x: &[Self]) -> &[S::f32s] {
        S::as_simd_f32s(x).0
    }

    #[inline(always)]
    fn vectors_mut<S: Simd>(x: &mut [Self]) -> &mut [S::f32s] {
        S::as_mut_simd_f32s(x).0
    }

    #[inline(always)]
    fn splat<S: Simd>(simd: S, x: Self) -> S::f32s {
        simd.splat_f32s(x)
    }

    #[inline(always)]
    fn times<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> S::f32s {
        simd.mul_f32s(a, b)
    }

    #[inline(always)]
    fn mul_add<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
        simd.mul_add_f32s(a, b, c)
    }

    #[inline(always)]
    fn minus<S: Simd>(simd: S, a: S::f32s, b: S::f32s) -> S::f32s {
        simd.sub_f32s(a, b)
    }

    #[inline(always)]
    fn negated<S: Simd>(simd: S, a: S::f32s) -> S::f32s {
        simd.neg_f32s(a)
    }
}

impl Scalar for f64 {
    const ROUNDING: f64 = 0.5 * f64::EPSILON;

    type Vector<S: Simd> = S::f64s;

    fn nearest(x: f64) -> Self {
        x
    }

    fn lanes<S: Simd>() -> usize {
        S::F64_LANES
    }

    #[inline(always)]
    fn vectors<S: Simd>(x: &[Self]) -> &[S::f64s] {
        S::as_simd_f64s(x).0
    }

    #[inline(always)]
    fn vectors_mut<S: Simd>(x: &mut [Self]) -> &mut [S::f64s] {
        S::as_mut_simd_f64s(x).0
    }

    #[inline(always)]
    fn splat<S: Simd>(simd: S, x: Self) -> S::f64s {
        simd.splat_f64s(x)
    }

    #[inline(always)]
    fn times<S: Simd>(simd: S, a: S::f64s, b: S::f64s) -> S::f64s {
        simd.mul_f64s(a, b)
    }

    #[inline(always)]
    fn mul_add<S: Simd>(simd: S, a: S::f64s, b: S::f64s, c: S::f64s) -> S::f64s {
        simd.mul_add_f64s(a, b, c)
    }

    #[inline(always)]
    fn minus<S: Simd>(simd: S, a: S::f64s, b: S::f64s) -> S::f64s {
        simd.sub_f64s(a, b)
    }

    #[inline(always)]
    fn negated<S: Simd>(simd: S, a: S::f64s) -> S::f64s {
        simd.neg_f64s(a)
    }
}
