//! The friction of drives.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::dynamics::DriveDynamics;
use nalgebra::Vector2;

fn drive() -> DriveDynamics<2> {
    DriveDynamics {
        viscous: Vector2::new(2e-3, 0.0),
        coulomb: Vector2::new(0.0, 0.03),
        coulomb_rate: Vector2::new(0.0, 0.5),
        armature: Vector2::zeros(),
    }
}

#[test]
fn viscous_and_coulomb_friction_add_up() {
    let mut drive = drive();
    let tanh_one = 0.761_594_155_955_764_9;
    let torque = drive.torque(&Vector2::new(3.0, -0.5));
    assert!((torque - Vector2::new(6e-3, -0.03 * tanh_one)).amax() < 1e-17);
    drive.coulomb.x = 1.0;
    assert_eq!(drive.torque(&Vector2::new(3.0, 0.0)).x, 1.006);
    assert_eq!(drive.torque(&Vector2::new(-1e-9, 0.0)).x, -1.0 - 2e-12);
    assert_eq!(drive.torque(&Vector2::zeros()), Vector2::zeros());
}

#[test]
fn friction_is_finite_at_every_rate() {
    let mut drive = drive();
    drive.coulomb_rate.y = f64::MIN_POSITIVE;
    for rate in [f64::MAX, f64::MIN, f64::MIN_POSITIVE, 0.0, -0.0] {
        let torque = drive.torque(&Vector2::repeat(rate));
        assert!(torque.iter().all(|t| t.is_finite()), "{rate}: {torque}");
        assert!(torque.y * rate >= 0.0, "{rate}: {torque}");
    }
}
