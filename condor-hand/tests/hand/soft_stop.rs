//! What keeps a joint from its limits.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::config::{Hand, ServoLaw};
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

/// The bounds that were found around the simulated plant, whose friction adds a little.
#[test]
#[cfg_attr(miri, ignore = "square roots are inline assembly")]
fn a_stop_alone_is_accepted_where_it_was_seen_to_be_stable() {
    let text = include_str!("../../hands/utah-mit.toml");
    let shipped = Hand::<4, 4, 8>::from_toml(text, "utah-mit.toml").unwrap();
    let rests = |bandwidth_hz, velocity_cutoff_hz, kp| {
        let mut hand = shipped.clone();
        for actuator in &mut hand.fingers[0].actuators {
            actuator.gains.kp = kp;
        }
        let joint = &mut hand.fingers[0].joints[1];
        joint.servo.law = ServoLaw::Pd;
        joint.servo.velocity_cutoff_hz = velocity_cutoff_hz;
        joint.stop.bandwidth_hz = bandwidth_hz;
        joint.stop.damping_ratio = joint.servo.zeta;
        hand.check().is_ok()
    };
    assert!(rests(19.0, 100.0, 1.0) && !rests(21.0, 100.0, 1.0));
    assert!(rests(16.0, 60.0, 1.0) && !rests(20.0, 60.0, 1.0));
    assert!(rests(11.5, 60.0, 0.0) && !rests(16.0, 60.0, 0.0));
    assert!(rests(24.0, 100.0, 3.0));
}
