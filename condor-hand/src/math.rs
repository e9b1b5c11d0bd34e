//! Elementary functions that give the same bits on every target.
//!
//! Transcendental functions come from `libm`, also where the standard library has its own. Minimum,
//! maximum and clamp are selections, so that zeros of either sign and NaN have one answer: a NaN
//! never leaves [`clamp`].

pub use libm::{atan2, exp, fabs as abs, round, sincos as sin_cos, tanh};

/// Returns the square root of `x`; zero if `x` is below zero or NaN.
#[inline(always)]
#[must_use]
pub fn sqrt(x: f64) -> f64 {
    libm::sqrt(max(x, 0.0))
}

/// Returns whether `x` is neither infinite nor NaN.
#[inline(always)]
#[must_use]
pub const fn is_finite(x: f64) -> bool {
    x.is_finite()
}

/// Returns the lesser of two numbers. If one of them is NaN, or if both are zeros of any sign, it
/// returns `y`.
#[inline(always)]
#[must_use]
pub fn min(x: f64, y: f64) -> f64 {
    if x < y { x } else { y }
}

/// Returns the greater of two numbers. If one of them is NaN, or if both are zeros of any sign, it
/// returns `y`.
#[inline(always)]
#[must_use]
pub fn max(x: f64, y: f64) -> f64 {
    if x > y { x } else { y }
}

/// Returns `x` limited to `low..=high`. It returns `low` for a NaN, and if `low` is not below
/// `high`.
#[inline(always)]
#[must_use]
pub fn clamp(x: f64, low: f64, high: f64) -> f64 {
    max(min(high, x), low)
}

/// Sine and cosine of the sum of two angles, of which those are given.
#[inline(always)]
pub(crate) fn of_sum((s, c): (f64, f64), (sine, cosine): (f64, f64)) -> (f64, f64) {
    (s * cosine + c * sine, c * cosine - s * sine)
}
