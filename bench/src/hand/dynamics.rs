//! Inverse and forward dynamics of the whole hand.

use std::hint::black_box;

use condor_hand::dynamics::Dynamics;
use nalgebra::SVector;

use super::kinematics::Dynibo;
use super::race::Race;
use super::subject::{FINGERS, GRAVITY, JOINTS, Joints, STATES, State, Subject, agree, flat};
use crate::Result;

/// Rounding of the torques, relative to the largest.
pub(super) const INVERSE_ROUNDING: f64 = 1e-12;

/// Rounding of the accelerations: light links make the mass matrix ill-conditioned.
pub(super) const FORWARD_ROUNDING: f64 = 1e-10;

/// Both tasks.
pub(super) const INVERSE: &str = "inverse dynamics";
pub(super) const FORWARD: &str = "forward dynamics";

/// The torques of a motion.
pub(super) fn inverse<D: Dynamics<f64, JOINTS>>(
    fingers: &[D; FINGERS],
    state: &State,
    torque: &mut Joints,
) {
    for (finger, (torque, mechanism)) in torque.iter_mut().zip(fingers).enumerate() {
        let (q, qd, qdd) = (&state.q[finger], &state.qd[finger], &state.qdd[finger]);
        *torque = mechanism.inverse_dynamics(q, qd, qdd, &GRAVITY);
    }
}

/// The accelerations that torques cause; NaN where there are none.
pub(super) fn forward<D: Dynamics<f64, JOINTS>>(
    fingers: &[D; FINGERS],
    state: &State,
    acceleration: &mut Joints,
) {
    let no_armature = SVector::zeros();
    for (finger, (acceleration, mechanism)) in acceleration.iter_mut().zip(fingers).enumerate() {
        let (q, qd, torque) = (&state.q[finger], &state.qd[finger], &state.torque[finger]);
        *acceleration = mechanism
            .forward_dynamics(q, qd, torque, &GRAVITY, &no_armature)
            .unwrap_or(SVector::repeat(f64::NAN));
    }
}

/// A state as dynibo takes it.
struct Flat {
    q: [f64; 16],
    qd: [f64; 16],
    qdd: [f64; 16],
    torque: [f64; 16],
}

/// Checks that all have the same dynamics, and lets them take part.
///
/// # Errors
/// One of them does not read the hand, or has other dynamics.
pub(super) fn enter(race: &mut Race, subject: &'static Subject) -> Result<()> {
    let [dynibo, forwards] = [Dynibo::new(subject)?, Dynibo::new(subject)?];
    let states: &'static [Flat] = Box::leak(Box::new(subject.states.map(|state| Flat {
        q: dynibo.ordered(&state.q),
        qd: dynibo.ordered(&state.qd),
        qdd: dynibo.ordered(&state.qdd),
        torque: dynibo.ordered(&state.torque),
    })));
    let in_our_order = |theirs: &_| forwards.in_our_order(theirs);
    let mut dynibo = dynibo.robot;
    for (state, of_dynibo) in subject.states.iter().zip(states) {
        let [mut ours, mut chain] = [[SVector::zeros(); FINGERS]; 2];
        let mut theirs = [0.0; 16];
        inverse(&subject.planar, state, &mut ours);
        inverse(&subject.chains, state, &mut chain);
        let Flat { q, qd, qdd, torque } = of_dynibo;
        dynibo.inverse_dynamics(q, qd, qdd, &[], &mut theirs)?;
        let what = "the inverse dynamics of the chains";
        agree(what, &flat(&ours), &flat(&chain), INVERSE_ROUNDING)?;
        let what = "the inverse dynamics of dynibo";
        agree(what, &flat(&ours), &in_our_order(&theirs), INVERSE_ROUNDING)?;

        forward(&subject.planar, state, &mut ours);
        forward(&subject.chains, state, &mut chain);
        dynibo.forward_dynamics(q, qd, torque, &[], &mut theirs)?;
        let what = "the forward dynamics of the chains";
        agree(what, &flat(&ours), &flat(&chain), FORWARD_ROUNDING)?;
        let what = "the forward dynamics of dynibo";
        agree(what, &flat(&ours), &in_our_order(&theirs), FORWARD_ROUNDING)?;
    }
    let mut ours = |task, name, compute: fn(&Subject, &State, &mut Joints)| {
        let mut result = [SVector::zeros(); FINGERS];
        race.enter(task, name, move |call| {
            compute(subject, black_box(subject).state(call), &mut result);
            black_box(&mut result);
        });
    };
    ours(INVERSE, "PlanarFinger", |subject, state, torque| {
        inverse(&subject.planar, state, torque);
    });
    ours(INVERSE, "Chain", |subject, state, torque| {
        inverse(&subject.chains, state, torque);
    });
    ours(FORWARD, "PlanarFinger", |subject, state, result| {
        forward(&subject.planar, state, result);
    });
    ours(FORWARD, "Chain", |subject, state, result| {
        forward(&subject.chains, state, result);
    });
    let mut forwards = forwards.robot;
    let mut torque = [0.0; 16];
    race.enter_failing(INVERSE, "dynibo", move |call| {
        let Flat { q, qd, qdd, .. } = &states[call % STATES];
        dynibo.inverse_dynamics(q, qd, qdd, &[], &mut torque)?;
        black_box(&mut torque);
        Ok(())
    });
    let mut acceleration = [0.0; 16];
    race.enter_failing(FORWARD, "dynibo", move |call| {
        let Flat { q, qd, torque, .. } = &states[call % STATES];
        forwards.forward_dynamics(q, qd, torque, &[], &mut acceleration)?;
        black_box(&mut acceleration);
        Ok(())
    });
    Ok(())
}
