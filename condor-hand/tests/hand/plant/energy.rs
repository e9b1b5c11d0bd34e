//! What friction takes, and what an integration must neither give nor take.

use condor_hand::config::JointFriction;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::max;
use condor_hand::plant::{FingerParameters, JointParameters, SimFinger};
use condor_hand::tendon::Pair;
use nalgebra::{Matrix4, Vector1, Vector3, Vector4};

use super::mechanisms::{Pendulum, exact, finger, free_joint};
use crate::support::geometry;

const STILL: [Pair<f64>; 1] = [Pair {
    flexor: 0.0,
    extensor: 0.0,
}];

fn down() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

fn pendulum(joint: JointParameters, q: f64) -> SimFinger<Pendulum, 1> {
    let rod = Pendulum {
        mass: 0.1,
        length: 0.1,
    };
    let mut finger = finger(rod, joint, exact(0.01));
    finger.reset(Vector1::new(q), STILL).unwrap();
    finger
}

/// Of the pendulum, which hangs at a right angle.
fn energy(finger: &SimFinger<Pendulum, 1>) -> f64 {
    let rod = finger.mechanism();
    let (q, qd) = (finger.q().x, finger.qd().x);
    0.5 * rod.inertia() * qd * qd + rod.mass * 9.81 * rod.length * (1.0 - libm::sin(q))
}

#[test]
fn a_pendulum_without_friction_keeps_its_energy() {
    let mut finger = pendulum(free_joint(), 0.0);
    let before = energy(&finger);
    let mut worst = 0.0;
    for _ in 0..2000 {
        finger.step(2.5e-3, 25, &STILL, &down()).unwrap();
        worst = max(worst, (energy(&finger) / before - 1.0).abs());
    }
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn viscous_friction_takes_what_the_equation_of_a_damped_swing_says() {
    let mut joint = free_joint();
    joint.friction.viscous = 1e-3;
    let right_angle = core::f64::consts::FRAC_PI_2;
    let mut finger = pendulum(joint, right_angle + 0.01);
    let before = energy(&finger);
    let seconds = 2.0;
    finger.step(seconds, 20_000, &STILL, &down()).unwrap();
    // The energy of a small swing falls as exp(-b t / I), with a ripple of b / (I w).
    let inertia = finger.mechanism().inertia();
    let expected = before * libm::exp(-joint.friction.viscous * seconds / inertia);
    let ratio = energy(&finger) / expected;
    assert!((ratio - 1.0).abs() < 0.12, "{ratio}");
}

#[test]
fn coulomb_friction_holds_a_pendulum_that_is_light_enough() {
    let mut joint = free_joint();
    joint.friction.coulomb_rate = 1e-4;
    // At zero the rod lies level: 98 mN m.
    for (coulomb, falls) in [(0.2, false), (0.05, true)] {
        joint.friction.coulomb = coulomb;
        let mut finger = pendulum(joint, 0.0);
        finger.step(0.5, 5000, &STILL, &down()).unwrap();
        let moved = finger.q().x.abs();
        assert_eq!(moved > 0.1, falls, "{coulomb} N m: {moved} rad");
        assert!(falls || moved < 1e-4, "{moved} rad");
    }
}

#[test]
fn friction_grows_with_the_tension_of_the_joints_own_tendons() {
    let mut joint = free_joint();
    joint.friction.coulomb_rate = 1e-4;
    joint.friction.tendon = 0.5;
    let pulled = [Pair::both(20.0)];
    // Two tendons of 20 N at 10 mm rub with 0.2 N m, and hold 98 mN m.
    let mut finger = pendulum(joint, 0.0);
    finger.reset(Vector1::zeros(), pulled).unwrap();
    finger.step(0.5, 5000, &pulled, &down()).unwrap();
    assert!(finger.q().x.abs() < 1e-4, "{}", finger.q().x);
    finger.step(0.5, 5000, &STILL, &down()).unwrap();
    assert!(finger.q().x.abs() > 0.1, "{}", finger.q().x);
}

#[test]
fn a_stop_pushes_back_and_never_holds() {
    let mut joint = free_joint();
    joint.range = (-0.1, 0.5);
    joint.stop.stiffness = 50.0;
    joint.stop.damping = 0.05;
    let mut finger = pendulum(joint, 0.0);
    finger.step(3.0, 30_000, &STILL, &down()).unwrap();
    // It rests on the stop, as deep as gravity presses it.
    let depth = 0.1 * 9.81 * 0.1 * libm::cos(0.5) / 50.0;
    assert!(
        (finger.q().x - 0.5 - depth).abs() < 1e-5,
        "{}",
        finger.q().x
    );
    // Upwards now: nothing keeps it at the stop.
    finger.step(1e-2, 100, &STILL, &-down()).unwrap();
    let free = 9.81 / 0.1 * libm::cos(0.5) * 0.5e-4;
    assert!(finger.q().x < 0.5 + depth - 0.9 * free, "{}", finger.q().x);
}

#[test]
fn a_finger_on_springs_loses_energy_to_friction_alone() {
    let geometry = geometry();
    for damping in [0.0, 0.002] {
        let parameters = FingerParameters {
            arms: geometry.asymmetric_arms(),
            joints: [JointParameters {
                friction: JointFriction {
                    armature: 1.6e-5,
                    viscous: damping,
                    ..free_joint().friction
                },
                stiffness: 0.4,
                ..free_joint()
            }; 4],
            drives: [Pair::both(exact(0.008)); 4],
        };
        let mechanism: PlanarFinger = geometry.finger(1);
        let start = Vector4::new(0.2, 0.5, -0.4, 0.3);
        let mut finger = SimFinger::new(mechanism, parameters, start).unwrap();
        let energy = |finger: &SimFinger<PlanarFinger, 4>| {
            let (q, qd) = (finger.q(), finger.qd());
            let mass = mechanism.mass_matrix(q) + Matrix4::from_diagonal_element(1.6e-5);
            0.5 * (qd.dot(&(mass * qd)) + 0.4 * q.norm_squared())
        };
        let (before, mut last, mut worst) = (energy(&finger), energy(&finger), 0.0);
        for _ in 0..100 {
            let still = [Pair::both(0.0); 4];
            finger.step(1e-2, 1000, &still, &Vector3::zeros()).unwrap();
            let now = energy(&finger);
            assert!(damping == 0.0 || now < last * 1.002, "{last} J to {now} J");
            worst = max(worst, (now / before - 1.0).abs());
            last = now;
        }
        if damping == 0.0 {
            assert!(worst < 1e-2, "{worst}");
        } else {
            assert!(last < 0.01 * before, "{last} J of {before} J");
        }
    }
}

#[test]
fn a_finger_of_no_mass_is_refused() {
    let rod = Pendulum {
        mass: 0.0,
        length: 0.1,
    };
    let parameters = FingerParameters {
        arms: super::mechanisms::own_arms(0.01),
        joints: [free_joint()],
        drives: [Pair::both(exact(0.01))],
    };
    let refused = SimFinger::new(rod, parameters, Vector1::new(0.3)).unwrap_err();
    assert!(refused.what.contains("mass matrix"), "{refused}");
}
