//! What a view promises, against condor-hand's own kinematics.

mod ball;
mod frames;
mod lines;
mod simulator;
mod urdf;

use std::sync::LazyLock;

use condor_hand::config::{EffortFaults, EffortRange, Hand};

type UtahMit = Hand<4, 4, 8>;

fn utah_mit() -> UtahMit {
    static HAND: LazyLock<UtahMit> = LazyLock::new(|| {
        let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
        UtahMit::from_toml(text, "utah-mit.toml").unwrap()
    });
    HAND.clone()
}

/// The hand with motors at the joints of its first finger: they pull and push, and the joint of the last one has two.
fn with_motors() -> UtahMit {
    let mut hand = utah_mit();
    let finger = &mut hand.fingers[0];
    let model = finger.actuators[0].clone();
    finger.actuators.clear();
    for (name, joint, arm) in [
        ("spread", "abduction", 20.0),
        ("bend", "proximal", -30.0),
        ("assist", "distal", 10.0),
        ("curl", "middle", 20.0),
        ("nip", "distal", 15.0),
    ] {
        let mut motor = model.clone();
        motor.name = name.try_into().unwrap();
        motor.arms.clear();
        motor.arms.insert(joint.try_into().unwrap(), arm).unwrap();
        motor.limits = EffortRange {
            low: -0.125,
            high: 0.0625,
            bias: None,
        };
        motor.faults = EffortFaults::default();
        finger.actuators.push(motor).unwrap();
    }
    hand
}

/// A gripper whose fingers are chains, one with a sliding joint and all of them with axes of their own.
fn gripper() -> UtahMit {
    let mut hand = utah_mit();
    for finger in &mut hand.fingers {
        finger.form = condor_hand::config::Form::Chain {
            tip: [0.01, 0.002, 0.03],
            on: None,
        };
        for (place, joint) in (0_u8..).zip(&mut finger.joints) {
            let axis = [0.6, 0.0, 0.8];
            joint.mount = Some(condor_hand::config::Mount {
                on: None,
                position: [0.03, 0.001 * f64::from(place), -0.004],
                rotation: condor_hand::config::Rotation::Rpy([0.3, -0.2, 0.5]),
                motion: match place {
                    1 => condor_hand::config::JointMotion::Prismatic(axis),
                    _ => condor_hand::config::JointMotion::Revolute(axis),
                },
            });
        }
    }
    hand.check().unwrap();
    hand
}
