use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::{JointLimits, Kinematics, PlanarFinger};
use nalgebra::{SVector, Vector3};

use crate::Shipped;
use crate::corpus::{Between, HOSTILE, postures};
use crate::digest::Digest;

/// Returns a finger of the shipped hand.
pub(crate) fn planar(hand: &Shipped, finger: usize) -> Option<PlanarFinger> {
    hand.fingers.get(finger)?.planar()
}

/// Computes poses, Jacobians and the quantities that are made of them.
pub(crate) fn kinematics(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    // The index finger and the thumb, which is turned.
    for finger in [0, 3] {
        let finger = planar(hand, finger)?;
        moved(digest, &finger);
        moved(digest, &finger.chain());
    }
    Some(())
}

fn moved(digest: &mut Digest, finger: &impl Kinematics<4>) {
    for q in postures() {
        let (pose, jacobian) = finger.kinematics(&q);
        digest.numbers(&pose.rotation);
        digest.numbers(&pose.position);
        digest.numbers(&jacobian);
        digest.numbers(&finger.tip(&q).position);
        let along = finger.self_motion(&q);
        if let Some(along) = digest.answer(along) {
            digest.numbers(&along);
        }
    }
}

/// Computes postures for points: reachable ones, ones too far, ones on the first axis, and no points at
/// all.
pub(crate) fn nearest(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let finger = hand.fingers.first()?.chain();
    let configured = hand.fingers.first()?.limits();
    let limits = JointLimits::new(configured.low, configured.high).ok()?;
    let present = SVector::repeat(0.3);
    let within = postures().map(|q| finger.tip(&limits.clamp(&q)).position);
    let reached = postures().map(|q| finger.tip(&q).position);
    let hostile = HOSTILE.map(|x| Vector3::new(0.1, x, 0.0));
    let base = finger.base().position;
    let on_axis =
        [0.0, -0.0, 0.05, -0.05, 10.0].map(|height| base + Vector3::new(0.0, 0.0, height));
    let targets = within.chain(reached).chain(hostile).chain(on_axis);
    for target in targets {
        let found = finger.nearest(&target, &present, &limits).ok();
        if let Some(found) = digest.answer(found) {
            digest.numbers(&found.posture);
            digest.number(found.distance);
        }
    }
    Some(())
}

/// Computes torques for accelerations, and accelerations for torques.
pub(crate) fn dynamics(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let finger = planar(hand, 3)?;
    driven(digest, &finger);
    driven(digest, &finger.chain());
    Some(())
}

fn driven(digest: &mut Digest, finger: &impl Dynamics<4>) {
    let mut between = Between::seeded(3);
    let gravity = Vector3::new(0.5, -0.25, -9.81);
    for q in postures() {
        let rates = between.vector(-10.0, 10.0);
        let accelerations = between.vector(-300.0, 300.0);
        let torque = between.vector(-1.0, 1.0);
        digest.numbers(&finger.inverse_dynamics(&q, &rates, &accelerations, &gravity));
        digest.numbers(&finger.bias(&q, &rates, &gravity));
        digest.numbers(&finger.gravity_torque(&q, &gravity));
        digest.numbers(&finger.mass_matrix(&q));
        for armature in [0.0, 1.6e-5] {
            let armature = SVector::repeat(armature);
            let found = finger.forward_dynamics(&q, &rates, &torque, &gravity, &armature);
            if let Some(found) = digest.answer(found) {
                digest.numbers(&found);
            }
        }
        for hostile in HOSTILE {
            let torque = SVector::repeat(hostile);
            let found = finger.forward_dynamics(&q, &rates, &torque, &gravity, &SVector::zeros());
            if let Some(found) = digest.answer(found) {
                digest.numbers(&found);
            }
        }
    }
}
