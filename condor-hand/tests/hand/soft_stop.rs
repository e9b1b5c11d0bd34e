//! What keeps a joint from its limits.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::servo::SoftStop;

const STOP: SoftStop = SoftStop {
    low: 0.0,
    high: 1.0,
    zone: 0.1,
    bandwidth_hz: 0.5 / core::f64::consts::PI,
    damping_ratio: 0.5,
};

#[test]
fn a_stop_pushes_inwards_and_never_pulls() {
    // With w = 1 and 2 zeta w = 1.
    assert_eq!(STOP.acceleration(0.5, 9.0), 0.0);
    assert!((STOP.acceleration(0.05, 0.0) - 0.05).abs() < 1e-15);
    assert!((STOP.acceleration(0.95, 0.0) + 0.05).abs() < 1e-15);
    assert!((STOP.acceleration(0.05, -1.0) - 1.05).abs() < 1e-15);
    assert_eq!(STOP.acceleration(0.05, 9.0), 0.0);
    assert_eq!(STOP.acceleration(0.95, -9.0), 0.0);
}
