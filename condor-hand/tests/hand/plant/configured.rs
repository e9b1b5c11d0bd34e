//! The simulated hand of a configuration.

use condor_hand::Subject;
use condor_hand::config::Hand;
use condor_hand::plant::{DriveKind, PlantModel, SimStop, SimSurface};
use nalgebra::{Vector3, Vector4};

use crate::support::geometry;

fn machine() -> PlantModel {
    let stop = SimStop {
        stiffness: 1e4,
        damping: 100.0,
    };
    PlantModel {
        actuator: DriveKind::exact,
        joint_stop: stop,
        axis_stop: stop,
        updates: 25,
        tip_radius: 0.008,
        surface: SimSurface {
            stiffness: 1e4,
            damping: 1.0,
            shear_stiffness: 1e4,
            shear_damping: 1.0,
            friction: 0.1,
        },
    }
}

fn shipped() -> Hand<4, 4, 8> {
    let text = include_str!("../../../hands/utah-mit.toml");
    Hand::from_toml(text, "utah-mit.toml").unwrap()
}

#[test]
fn a_finger_has_the_numbers_of_its_configuration() {
    let mut hand = shipped();
    hand.fingers[2].actuators[3].pole_hz = 40.0;
    hand.fingers[2].joints[1].friction.coulomb = 0.01;
    hand.fingers[2].joints[1].friction.coulomb_rate = 0.2;
    let geometry = geometry();
    let finger = &hand.fingers[2];
    let parameters = machine().finger_parameters(finger);
    let transmission = finger.transmission().unwrap();
    assert_eq!(transmission, geometry.symmetric_tendons());
    for (joint, parameters) in parameters.joints.iter().enumerate() {
        assert_eq!(parameters.friction.armature, 1.6e-5);
        assert_eq!(parameters.friction.viscous, 2e-3);
        assert_eq!(
            parameters.range,
            (geometry.qmin[joint], geometry.qmax[joint])
        );
    }
    let friction = &parameters.joints[1].friction;
    assert_eq!((friction.coulomb, friction.coulomb_rate), (0.01, 0.2));
    let [flexor, extensor] = [2, 3].map(|actuator| parameters.drives[actuator]);
    assert_eq!((flexor.low, flexor.high), (0.0, geometry.fmax));
    let pole_hz = |kind| match kind {
        DriveKind::Exact { time_constant_s } => 1.0 / (core::f64::consts::TAU * time_constant_s),
        _ => f64::NAN,
    };
    assert!((pole_hz(flexor.kind) - 20.0).abs() < 1e-12);
    assert!((pole_hz(extensor.kind) - 40.0).abs() < 1e-12);
}

#[test]
fn a_finger_without_one_of_its_joints_stays_there() {
    let mut hand = shipped();
    hand.fingers[0].joints.pop();
    // The tendons of that joint have nothing to pull at.
    hand.fingers[0].actuators.truncate(6);
    let finger = &hand.fingers[0];
    let q = Vector4::new(0.1, 0.5, 0.6, 0.0);
    let transmission = finger.transmission().unwrap();
    let mut plant = machine()
        .finger(finger, finger.chain(), transmission, q)
        .unwrap();
    let least = [4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 0.0, 0.0];
    assert_eq!(*plant.efforts(), least);
    let gravity = Vector3::from(hand.gravity);
    plant.step(0.05, 500, &[4.0; 8], &gravity).unwrap();
    assert_eq!(plant.q()[3], 0.0);
    assert!((plant.q() - q).amax() > 0.01, "{:?}", plant.q());
}

#[test]
fn a_hand_rubs_as_its_configuration_says() {
    let mut hand = shipped();
    let parameters = machine().hand_parameters(&hand);
    assert_eq!(parameters.tip_object.friction, 0.5);
    assert_eq!(parameters.period_s, 1.0 / 400.0);
    assert_eq!(parameters.gravity, Vector3::new(0.0, 0.0, -9.81));
    hand.contact = None;
    let parameters = machine().hand_parameters(&hand);
    assert_eq!(parameters.tip_object.friction, 0.1);
}

#[test]
fn axes_of_a_table_lie_along_those_of_the_palm() {
    let hand = shipped();
    let mut table = hand.table.unwrap();
    table.axes.truncate(2);
    table.axes[0].direction = [0.0, 0.0, -1.0];
    table.axes[0].limits.low = -0.05;
    let mut plant = machine().table(&table).unwrap();
    for _ in 0..20_000 {
        plant.advance(1e-4, &Vector3::new(0.0, 0.0, 50.0)).unwrap();
    }
    // Up is its negative sense, where it has 50 mm and then a stop of 1e4 N/m.
    assert!((plant.position().z - 0.055).abs() < 1e-6, "{plant:?}");
    table.axes[1].direction = [0.0, 0.0, 1.0];
    let twice = machine().table(&table).unwrap_err();
    assert_eq!((twice.at, twice.value), (Subject::Axis(1), 0.0));
    table.axes[1].direction = [0.6, 0.8, 0.0];
    let oblique = machine().table(&table).unwrap_err();
    assert_eq!(
        oblique.to_string(),
        "axis 1: the part of its direction along an axis of the palm that no other has is 0.8; it must be 1"
    );
}
