//! Joints that follow others, and links that branch: in a description, in a servo and in the simulated robot.

#![cfg(feature = "sim")]
#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::config::{BASE, Follower, Form, Hand, JointMotion, Mount, Name};
use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::Kinematics;
use condor_hand::math::sin_cos;
use condor_hand::plant::PlantModel;
use condor_hand::servo::{JointTarget, ServoMode};
use condor_hand::trajectory::SetPoint;
use nalgebra::{Vector3, Vector4};

const HZ: f64 = 400.0;

fn hand() -> Hand<1, 4, 6> {
    let text = include_str!("../hands/coupled.toml");
    Hand::from_toml(text, "coupled.toml").unwrap()
}

#[test]
fn the_tip_is_where_the_follower_takes_it() {
    let hand = hand();
    let chain = hand.fingers[0].chain();
    let middle = 0.5_f64;
    let distal = middle + 0.9 * middle + 0.1;
    let (middle_sin, middle_cos) = sin_cos(middle);
    let (distal_sin, distal_cos) = sin_cos(distal);
    let along = 0.0095 + 0.0432 + 0.033 * middle_cos + 0.0241 * distal_cos;
    let down = 0.033 * middle_sin + 0.0241 * distal_sin;
    let tip = chain.tip(&[0.0, 0.0, middle, 7.0].into()).position;
    assert!(
        (tip - Vector3::new(along, 0.0, -down)).norm() < 1e-15,
        "{tip}"
    );
    assert_eq!(
        chain.positions(&[0.0, 0.0, middle, 7.0].into()),
        [0.0, 0.0, middle, 0.55]
    );
    let (_, jacobian) = chain.kinematics(&[0.1, 0.2, middle, 7.0].into());
    assert_eq!(jacobian.column(3).amax(), 0.0);
}

#[test]
fn the_arms_at_a_follower_count_at_the_joint_that_it_follows() {
    let hand = hand();
    let finger = &hand.fingers[0];
    let transmission = finger.transmission().unwrap();
    let arm = 0.0095 + 0.9 * 0.008;
    assert_eq!(transmission.arms()[4], [0.0, 0.0095, arm, 0.0]);
    assert_eq!(transmission.arms()[5], [0.0, -0.0095, -arm, 0.0]);
    assert_eq!(finger.joint_of(4), Some(2));
    let torque = transmission.torque(&[0.0, 0.0, 0.0, 0.0, 10.0, 0.0]);
    assert_eq!(torque[2], 10.0 * arm);
}

#[test]
fn a_finger_with_a_follower_follows_its_set_points() {
    let hand = hand();
    let finger = &hand.fingers[0];
    let (chain, transmission) = (finger.chain(), finger.transmission().unwrap());
    let start = Vector4::new(0.0, 0.2, 0.3, 0.0);
    let mut plant = PlantModel::default()
        .finger(finger, chain, transmission, start)
        .unwrap();
    let mut controller = FingerController::new(&hand, finger, chain, transmission).unwrap();
    let gravity = Vector3::from(hand.gravity);
    assert_eq!(controller.joints(), 3);
    assert!(controller.set_mode(3, ServoMode::Position).is_err());
    let mut goals = [[0.2, 0.8, 0.9], [-0.3, 0.1, 1.2], [0.0, 0.3, 0.2]].into_iter();
    for tick in 0..2400 {
        if tick % 800 == 0 {
            for (joint, goal) in goals.next().unwrap().into_iter().enumerate() {
                let target = JointTarget::Position(SetPoint::rest(goal));
                controller.set_target(joint, target).unwrap();
            }
        }
        let sensed = plant.readings();
        let done = controller.tick(&sensed, &gravity, 1.0 / HZ);
        assert_eq!(done.fault, None, "in tick {tick}");
        plant
            .step(1.0 / HZ, 10, &done.output.command, &gravity)
            .unwrap();
        if tick % 800 == 799 {
            for (joint, target) in done.target.iter().enumerate().take(3) {
                let away = (plant.q()[joint] - target.unwrap()).abs();
                assert!(
                    away < 1e-3,
                    "joint {joint} is {away} rad away in tick {tick}"
                );
            }
        }
    }
}

/// A gripper: two jaws that slide apart along y, of which the right one follows the left one.
fn gripper() -> Hand<1, 4, 6> {
    let mut hand = hand();
    let finger = &mut hand.fingers[0];
    let name = |text: &str| Name::try_from(text).unwrap();
    let slide = |on: Option<&str>| Mount {
        on: on.map(name),
        position: [0.05, 0.0, 0.0],
        rotation: condor_hand::config::Rotation::None,
        motion: JointMotion::Prismatic([0.0, 1.0, 0.0]),
    };
    finger.joints.truncate(1);
    finger.joints[0].mount = Some(slide(None));
    let body = finger.joints[0].body;
    finger.joints[0].limits.low = 0.0;
    finger.joints[0].limits.high = 0.04;
    finger.joints[0].stop.zone = 0.0;
    let follower = &mut finger.followers[0];
    *follower = Follower {
        name: name("right"),
        mount: slide(Some(BASE)),
        body,
        ..follower.clone()
    };
    follower.follows.joint = finger.joints[0].name.clone();
    (follower.follows.ratio, follower.follows.offset) = (-1.0, 0.0);
    finger.actuators.truncate(2);
    finger.form = Form::Chain {
        tip: [0.03, 0.0, 0.0],
        on: Some(name("right")),
    };
    hand
}

#[test]
fn jaws_on_one_base_go_apart() {
    let hand = gripper();
    hand.check().unwrap();
    let finger = &hand.fingers[0];
    let links: Vec<_> = finger
        .links()
        .iter()
        .map(|link| link.name.as_str())
        .collect();
    assert_eq!(links, ["abduction", "right"]);
    let chain = finger.chain();
    let q = Vector4::new(0.02, 0.0, 0.0, 0.0);
    assert_eq!(chain.tip(&q).position, Vector3::new(0.08, -0.02, 0.0));
    assert_eq!(
        chain.up_to(0).tip(&q).position,
        Vector3::new(0.05, 0.02, 0.0)
    );
    // Both jaws count where their common drive moves them, and their weights cancel.
    assert!((chain.mass_matrix(&q)[(0, 0)] - 0.06).abs() < 1e-15);
    let sideways = Vector3::new(0.0, -9.81, 0.0);
    assert_eq!(chain.gravity_torque(&q, &sideways).amax(), 0.0);
}

#[test]
fn joints_come_after_what_carries_them() {
    let mut hand = hand();
    let finger = &mut hand.fingers[0];
    let on = |name: &str| Some(Name::try_from(name).unwrap());
    // The last joint sits on the follower of the first one, and another follower on it.
    let mut other = finger.followers[0].clone();
    (other.name, other.mount.on) = (on("other").unwrap(), on("proximal"));
    other.follows.joint = on("abduction").unwrap();
    finger.joints.pop();
    finger.followers[0].follows.joint = on("abduction").unwrap();
    finger.followers.push(other).unwrap();
    finger.joints[1].mount.as_mut().unwrap().on = on("distal");
    let links: Vec<_> = finger
        .links()
        .iter()
        .map(|link| link.name.as_str())
        .collect();
    assert_eq!(links, ["abduction", "distal", "proximal", "other"]);
    let chain = finger.chain();
    let q = Vector4::new(0.5, 0.3, 0.0, 0.0);
    assert_eq!(
        chain.positions(&q),
        [0.5, 0.9 * 0.5 + 0.1, 0.3, 0.9 * 0.5 + 0.1]
    );
}
