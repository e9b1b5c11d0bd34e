//! What friction takes, and what an integration must neither give nor take.

use condor_hand::config::JointFriction;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::max;
use condor_hand::plant::{FingerParameters, JointParameters, SimFinger};
use condor_hand::transmission::{EffortLimits, Linear};
use nalgebra::{Matrix4, Vector1, Vector3, Vector4};

use super::mechanisms::{Pendulum, Slider, exact, finger, free_joint, moved_by, own_tendons};
use crate::support::geometry;

/// A pendulum with a flexor and an extensor.
type PulledRod = SimFinger<Pendulum, Linear<1, 2>, 1, 2>;

const STILL: [f64; 2] = [0.0; 2];

fn down() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

fn pendulum(joint: JointParameters, q: f64) -> PulledRod {
    let rod = Pendulum {
        mass: 0.1,
        length: 0.1,
    };
    let mut finger = finger(rod, joint, exact(0.01));
    finger.reset(Vector1::new(q), STILL).unwrap();
    finger
}

/// Of the pendulum, which hangs at a right angle.
fn energy(finger: &PulledRod) -> f64 {
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
fn friction_grows_with_the_tension_of_the_tendons_at_the_joint() {
    let mut joint = free_joint();
    joint.friction.coulomb_rate = 1e-4;
    joint.friction.tendon = 0.5;
    let pulled = [20.0; 2];
    // Two tendons of 20 N at 10 mm rub with 0.2 N m, and hold 98 mN m.
    let mut finger = pendulum(joint, 0.0);
    finger.reset(Vector1::zeros(), pulled).unwrap();
    finger.step(0.5, 5000, &pulled, &down()).unwrap();
    assert!(finger.q().x.abs() < 1e-4, "{}", finger.q().x);
    finger.step(0.5, 5000, &STILL, &down()).unwrap();
    assert!(finger.q().x.abs() > 0.1, "{}", finger.q().x);
}

#[test]
fn tendons_of_another_joint_that_cross_a_joint_rub_there_too() {
    let mut joint = free_joint();
    joint.friction.coulomb_rate = 1e-4;
    joint.friction.tendon = 0.5;
    // A flexor and an extensor of the first joint, and those of the second one, which cross the first.
    let limits = EffortLimits {
        low: 0.0,
        high: 130.0,
        bias: 0.0,
    };
    let arms = [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.5, 1.0, 0.0],
        [-0.5, -1.0, 0.0],
    ];
    let tendons = Linear::new(arms, [limits; 4]).unwrap();
    let slider = Slider {
        mass: 0.05,
        base: Vector3::zeros(),
    };
    let mut finger = moved_by(slider, tendons, joint, exact(0.01));
    // Two tensions of 20 N at an arm of 0.5 rub with 10 N, and hold a weight of 0.5 N along the first joint.
    let (pulled, along) = ([0.0, 0.0, 20.0, 20.0], Vector3::new(-9.81, 0.0, 0.0));
    finger.reset(Vector3::zeros(), pulled).unwrap();
    finger.step(0.5, 5000, &pulled, &along).unwrap();
    assert!(finger.q().x.abs() < 1e-4, "{}", finger.q().x);
    finger.step(0.5, 5000, &[0.0; 4], &along).unwrap();
    assert!(finger.q().x < -0.1, "{}", finger.q().x);
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
            joints: [JointParameters {
                friction: JointFriction {
                    armature: 1.6e-5,
                    viscous: damping,
                    ..free_joint().friction
                },
                stiffness: 0.4,
                ..free_joint()
            }; 4]
                .into(),
            drives: [exact(0.008); 8].into(),
        };
        let mechanism: PlanarFinger = geometry.finger(1);
        let start = Vector4::new(0.2, 0.5, -0.4, 0.3);
        let mut finger =
            SimFinger::new(mechanism, geometry.asymmetric_tendons(), parameters, start).unwrap();
        let energy = |finger: &SimFinger<PlanarFinger, Linear<4, 8>, 4, 8>| {
            let (q, qd) = (finger.q(), finger.qd());
            let mass = mechanism.mass_matrix(q) + Matrix4::from_diagonal_element(1.6e-5);
            0.5 * (qd.dot(&(mass * qd)) + 0.4 * q.norm_squared())
        };
        let (before, mut last, mut worst) = (energy(&finger), energy(&finger), 0.0);
        for _ in 0..100 {
            finger
                .step(1e-2, 1000, &[0.0; 8], &Vector3::zeros())
                .unwrap();
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
        joints: [free_joint()].into(),
        drives: [exact(0.01); 2].into(),
    };
    let tendons = own_tendons::<1, 2>(0.01);
    let refused = SimFinger::new(rod, tendons, parameters, Vector1::new(0.3)).unwrap_err();
    assert!(refused.what.contains("mass matrix"), "{refused}");
}
