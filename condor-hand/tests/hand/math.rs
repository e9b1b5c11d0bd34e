//! Minimum, maximum and clamp.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::math::{clamp, max, min};

#[test]
fn a_nan_never_leaves_clamp() {
    assert_eq!(clamp(f64::NAN, -1.0, 2.0), -1.0);
    assert_eq!(clamp(f64::INFINITY, -1.0, 2.0), 2.0);
    assert_eq!(clamp(f64::NEG_INFINITY, -1.0, 2.0), -1.0);
}

#[test]
fn the_second_of_two_zeros_is_taken() {
    assert!(max(-0.0_f64, 0.0).is_sign_positive());
    assert!(max(0.0_f64, -0.0).is_sign_negative());
    assert!(min(-0.0_f64, 0.0).is_sign_positive());
}
