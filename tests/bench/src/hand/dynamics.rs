//! Inverse and forward dynamics of the whole hand.

use std::hint::black_box;

use condor_hand::dynamics::Dynamics as _;
use condor_hand::kinematics::PlanarFinger;
use nalgebra::SVector;

use super::subject::{FINGERS, GRAVITY, Joints, OURS, State, Subject};
use crate::race::Race;

/// Rounding of the torques, relative to the largest.
pub(super) const INVERSE_ROUNDING: f64 = 1e-12;

/// Rounding of the accelerations: light links make the mass matrix ill-conditioned.
pub(super) const FORWARD_ROUNDING: f64 = 1e-10;

/// Both tasks.
pub(super) const INVERSE: &str = "inverse dynamics";
pub(super) const FORWARD: &str = "forward dynamics";

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

/// Lets ours take part in both.
pub(super) fn enter(race: &mut Race<'_>, subject: &'static Subject) {
    let mut ours = |task, compute: fn(&Subject, &State, &mut Joints)| {
        let mut result = [SVector::zeros(); FINGERS];
        race.enter(task, OURS, move |call| {
            compute(subject, black_box(subject).state(call), &mut result);
            black_box(&mut result);
        });
    };
    ours(INVERSE, |subject, state, torque| {
        inverse(&subject.planar, state, torque);
    });
    ours(FORWARD, |subject, state, acceleration| {
        forward(&subject.planar, state, acceleration);
    });
}
