//! Zeros of functions in an interval, in a bounded number of steps.

use heapless::Vec;

use crate::math::{abs, max};

/// The zero of a continuous function with `f(low) <= 0 <= f(high)`: the largest `x` found for which
/// `f(x) <= 0`. Illinois' variant of the false position, with a bisection whenever it is slow.
pub(super) fn bracketed(low: f64, high: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let half = 0.5;
    let (mut low, mut high) = (low, high);
    let (mut f_low, mut f_high) = (f(low), f(high));
    let mut width = high - low;
    for _ in 0..200 {
        let middle = low + (high - low) * half;
        let guess = low - f_low * (high - low) / (f_high - f_low);
        let slow = (high - low) > width * half;
        width = high - low;
        let x = if guess > low && guess < high && !slow {
            guess
        } else {
            middle
        };
        if !(x > low && x < high) {
            break;
        }
        let value = f(x);
        if value > 0.0 {
            high = x;
            f_high = value;
            f_low *= half;
        } else {
            low = x;
            f_low = value;
            f_high *= half;
            if value == 0.0 {
                break;
            }
        }
    }
    low
}

/// The value of `c0 + c1 s + c2 s² ...`.
#[inline]
pub(super) fn evaluate(coefficients: &[f64; 6], s: f64) -> f64 {
    let mut value = 0.0;
    for &c in coefficients.iter().rev() {
        value = value * s + c;
    }
    value
}

/// The coefficients of the derivative.
pub(super) fn derivative(coefficients: &[f64; 6]) -> [f64; 6] {
    let [_, c1, c2, c3, c4, c5] = *coefficients;
    [c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 5.0 * c5, 0.0]
}

/// The places where a polynomial of the given degree changes its sign within 0..=1.
///
/// Between two neighbouring extremes there is at most one zero, so the zeros of the derivative
/// bracket those of the polynomial.
pub(super) fn sign_changes(coefficients: &[f64; 6], degree: usize) -> Vec<f64, 6> {
    let mut found = Vec::new();
    if degree == 0 {
        return found;
    }
    let extremes = sign_changes(&derivative(coefficients), degree - 1);
    let mut low = 0.0;
    for high in extremes.iter().copied().chain([1.0]) {
        let (at_low, at_high) = (evaluate(coefficients, low), evaluate(coefficients, high));
        let scale = max(abs(at_low), abs(at_high));
        if scale > 0.0 && (at_low <= 0.0) != (at_high <= 0.0) {
            let sign = if at_low <= 0.0 { 1.0 } else { -1.0 };
            let zero = bracketed(low, high, |s| sign * evaluate(coefficients, s));
            // One more zero than the degree cannot be.
            let _ = found.push(zero);
        }
        low = high;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zeros_of_a_quartic_are_found() {
        // (s - 0.1)(s - 0.4)(s - 0.5)(s - 0.9)
        let c = [0.018, -0.281, 1.19, -1.9, 1.0, 0.0];
        let found = sign_changes(&c, 4);
        for (zero, expected) in found.iter().zip([0.1_f64, 0.4, 0.5, 0.9]) {
            assert!((zero - expected).abs() < 1e-12, "{found:?}");
        }
        assert_eq!(found.len(), 4);
    }
}
