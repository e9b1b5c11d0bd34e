//! The four tips and their Jacobians, and inverse and forward dynamics of the whole hand.

use std::hint::black_box;

use condor_hand::Pose;
use condor_hand::dynamics::Dynamics as _;
use condor_hand::kinematics::{Jacobian, Kinematics as _, PlanarFinger};
use nalgebra::SVector;

use super::subject::{FINGERS, GRAVITY, JOINTS, Joints, State, Subject};
use crate::race::Race;

/// The tasks.
pub(super) const TIPS: &str = "4 tips and their Jacobians";
pub(super) const INVERSE: &str = "inverse dynamics";
pub(super) const FORWARD: &str = "forward dynamics";

/// The name of ours in the tables.
pub(super) const OURS: &str = "PlanarFinger";

/// The tips of all fingers with their Jacobians.
pub(super) type Tips = [(Pose, Jacobian<JOINTS>); FINGERS];

/// Returns the results as one list: positions, rotations and Jacobians, column by column.
pub(super) fn list(tips: &Tips) -> Vec<f64> {
    let mut list = Vec::new();
    for (pose, jacobian) in tips {
        list.extend(pose.position.iter());
        list.extend(pose.rotation.iter());
        list.extend(jacobian.iter());
    }
    list
}

pub(super) fn no_tips() -> Tips {
    [(Pose::identity(), Jacobian::zeros()); FINGERS]
}

/// Computes the tips of fingers.
pub(super) fn tips(fingers: &[PlanarFinger; FINGERS], state: &State, tips: &mut Tips) {
    for ((tip, finger), q) in tips.iter_mut().zip(fingers).zip(&state.q) {
        *tip = finger.kinematics(q);
    }
}

/// Computes the torques of a motion.
pub(super) fn inverse(fingers: &[PlanarFinger; FINGERS], state: &State, torque: &mut Joints) {
    for (finger, (torque, mechanism)) in torque.iter_mut().zip(fingers).enumerate() {
        let (q, qd, qdd) = (&state.q[finger], &state.qd[finger], &state.qdd[finger]);
        *torque = mechanism.inverse_dynamics(q, qd, qdd, &GRAVITY);
    }
}

/// Computes the accelerations that torques cause; NaN where there are none.
pub(super) fn forward(fingers: &[PlanarFinger; FINGERS], state: &State, acceleration: &mut Joints) {
    let no_armature = SVector::zeros();
    for (finger, (acceleration, mechanism)) in acceleration.iter_mut().zip(fingers).enumerate() {
        let (q, qd, torque) = (&state.q[finger], &state.qd[finger], &state.torque[finger]);
        *acceleration = mechanism
            .forward_dynamics(q, qd, torque, &GRAVITY, &no_armature)
            .unwrap_or(SVector::repeat(f64::NAN));
    }
}

/// The dynamics, called by pointer, so that the loop that times them does not become a part of them.
type Law = fn(&[PlanarFinger; FINGERS], &State, &mut Joints);

/// Lets ours take part in all tasks.
pub(super) fn enter(race: &mut Race<'_>, subject: &'static Subject) {
    enter_as(race, subject, TIPS, no_tips(), tips);
    enter_as(race, subject, INVERSE, Joints::default(), inverse as Law);
    enter_as(race, subject, FORWARD, Joints::default(), forward as Law);
}

fn enter_as<T: 'static>(
    race: &mut Race<'_>,
    subject: &'static Subject,
    task: &str,
    mut result: T,
    compute: impl Fn(&[PlanarFinger; FINGERS], &State, &mut T) + 'static,
) {
    race.enter(task, OURS, move |call| {
        compute(&subject.planar, black_box(subject).state(call), &mut result);
        black_box(&mut result);
    });
}
