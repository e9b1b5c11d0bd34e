//! Elementary functions that give the same bits on every target.
//!
//! Transcendental functions come from `libm`, also where the standard library has its own. Minimum,
//! maximum and clamp are selections, so that zeros of either sign and NaN have one answer: a NaN
//! never leaves [`clamp`].

use nalgebra::RealField;

/// The number type of a controller: `f64`, or `f32` for processors that compute only with that.
pub trait Real: RealField + Copy + sealed::Functions {
    /// Returns the nearest number of this type.
    fn of(value: f64) -> Self;

    /// Converts to `f64`; in `f32` the value is exact.
    fn to_f64(self) -> f64;
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }

    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

/// A trait of the functions that differ between the two types, and its implementations: each with its
/// arguments, its result, and the function for `f64` and for `f32`.
macro_rules! functions {
    ($($name:ident($($argument:ident),*) -> $result:ty = $wide:path, $narrow:path;)*) => {
        mod sealed {
            pub trait Functions: Sized {
                $(fn $name(self $(, $argument: Self)*) -> $result;)*
            }
        }

        impl sealed::Functions for f64 {
            $(#[inline(always)]
            fn $name(self $(, $argument: Self)*) -> $result {
                $wide(self $(, $argument)*)
            })*
        }

        impl sealed::Functions for f32 {
            $(#[inline(always)]
            fn $name(self $(, $argument: Self)*) -> $result {
                $narrow(self $(, $argument)*)
            })*
        }
    };
}

functions! {
    sin_cos_() -> (Self, Self) = libm::sincos, libm::sincosf;
    atan2_(x) -> Self = libm::atan2, libm::atan2f;
    sqrt_() -> Self = libm::sqrt, libm::sqrtf;
    exp_() -> Self = libm::exp, libm::expf;
    tanh_() -> Self = libm::tanh, libm::tanhf;
    round_() -> Self = libm::round, libm::roundf;
    abs_() -> Self = libm::fabs, libm::fabsf;
    finite_() -> bool = f64::is_finite, f32::is_finite;
}

/// Converts an `f64`, such as a constant, to the number type `T`.
#[inline(always)]
#[must_use]
pub fn real<T: Real>(value: f64) -> T {
    T::of(value)
}

/// Returns the sine and the cosine of `angle` (rad), in this order.
#[inline(always)]
#[must_use]
pub fn sin_cos<T: Real>(angle: T) -> (T, T) {
    angle.sin_cos_()
}

/// Returns the angle from the x axis to the point (`x`, `y`), in radians from -pi to pi.
#[inline(always)]
#[must_use]
pub fn atan2<T: Real>(y: T, x: T) -> T {
    y.atan2_(x)
}

/// Returns the square root of `x`; zero if `x` is below zero or NaN.
#[inline(always)]
#[must_use]
pub fn sqrt<T: Real>(x: T) -> T {
    max(x, T::zero()).sqrt_()
}

/// Returns e to the power of `x`.
#[inline(always)]
#[must_use]
pub fn exp<T: Real>(x: T) -> T {
    x.exp_()
}

/// Returns the hyperbolic tangent of `x`.
#[inline(always)]
#[must_use]
pub fn tanh<T: Real>(x: T) -> T {
    x.tanh_()
}

/// Returns the integer nearest to `x`; halves are rounded away from zero.
#[inline(always)]
#[must_use]
pub fn round<T: Real>(x: T) -> T {
    x.round_()
}

/// Returns the absolute value of `x`.
#[inline(always)]
#[must_use]
pub fn abs<T: Real>(x: T) -> T {
    x.abs_()
}

/// Returns whether `x` is neither infinite nor NaN.
#[inline(always)]
#[must_use]
pub fn is_finite<T: Real>(x: T) -> bool {
    x.finite_()
}

/// Returns the lesser of two numbers. If one of them is NaN, or if both are zeros of any sign, it
/// returns `y`.
#[inline(always)]
#[must_use]
pub fn min<T: Real>(x: T, y: T) -> T {
    if x < y { x } else { y }
}

/// Returns the greater of two numbers. If one of them is NaN, or if both are zeros of any sign, it
/// returns `y`.
#[inline(always)]
#[must_use]
pub fn max<T: Real>(x: T, y: T) -> T {
    if x > y { x } else { y }
}

/// Returns `x` limited to `low..=high`. It returns `low` for a NaN, and if `low` is not below
/// `high`.
#[inline(always)]
#[must_use]
pub fn clamp<T: Real>(x: T, low: T, high: T) -> T {
    max(min(high, x), low)
}

/// Sine and cosine of the sum of two angles, of which those are given.
#[inline(always)]
pub(crate) fn of_sum<T: Real>((s, c): (T, T), (sine, cosine): (T, T)) -> (T, T) {
    (s * cosine + c * sine, c * cosine - s * sine)
}
