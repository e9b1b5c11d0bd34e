//! [`Watch`]: the motions of a finger's joints, and those that a guard has stopped.

use crate::servo::FingerReadings;
use crate::trajectory::{MotionGuard, StopGuard};
use crate::transmission::Linear;

/// The report that a guard has stopped a joint: the condition that held, the value that was
/// measured, and the place where the joint rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuardStop {
    /// The number of the motion that was stopped.
    pub motion: u32,
    /// The condition that held; its joint is counted in the finger, from 0.
    pub guard: MotionGuard,
    /// The measured torque, effort or force, N m or N; it is not finite if the sensor gave no
    /// number.
    pub value: f64,
    /// The set-point at which the joint rests, rad.
    pub position: f64,
}

/// The guards of a finger.
#[derive(Clone, Debug)]
pub(super) struct Watch<const N: usize> {
    guards: [StopGuard; N],
    /// Joints whose motion has a condition, a bit each.
    armed: u32,
    /// Joints that rest where their motion was stopped, a bit each.
    stopped: u32,
    stops: [Option<GuardStop>; N],
    /// The force of a contact, N.
    contact_n: f64,
}

impl<const N: usize> Watch<N> {
    /// Without motions.
    pub(super) const fn new(contact_n: f64) -> Self {
        Self {
            guards: [StopGuard::NONE; N],
            armed: 0,
            stopped: 0,
            stops: [None; N],
            contact_n,
        }
    }

    pub(super) const fn stopped(&self) -> u32 {
        self.stopped
    }

    pub(super) fn stop(&self, joint: usize) -> Option<&GuardStop> {
        self.stops.get(joint)?.as_ref()
    }

    /// The stopped joints for which there is another motion.
    pub(super) fn released(&self, guards: &[StopGuard; N]) -> u32 {
        if self.stopped == 0 {
            return 0;
        }
        let mut released = 0;
        for (joint, (stop, guard)) in self.stops.iter().zip(guards).enumerate() {
            if stop.is_some_and(|stop| stop.motion != guard.motion) {
                released |= 1 << joint;
            }
        }
        released
    }

    /// Forgets that these joints were stopped.
    pub(super) fn release(&mut self, joints: u32) {
        if self.stopped & joints == 0 {
            return;
        }
        self.stopped &= !joints;
        for (joint, stop) in self.stops.iter_mut().enumerate() {
            if joints >> joint & 1 == 1 {
                *stop = None;
            }
        }
    }

    /// The motions from this tick of the master on.
    pub(super) fn guard(&mut self, guards: &[StopGuard; N]) {
        self.guards = *guards;
        self.armed = 0;
        for (joint, guard) in guards.iter().enumerate() {
            self.armed |= u32::from(guard.is_armed()) << joint;
        }
    }

    /// Returns true if one of these joints has a condition to check.
    #[inline]
    pub(super) const fn watches(&self, following: u32) -> bool {
        self.armed & following & !self.stopped != 0
    }

    /// Checks the conditions of the joints that follow. `position` is asked for the set-point of each
    /// joint whose motion one of them stops.
    #[cold]
    pub(super) fn check<const A: usize>(
        &mut self,
        following: u32,
        sensed: &FingerReadings<N, A>,
        linear: &Linear<N, A>,
        mut position: impl FnMut(usize) -> Option<f64>,
    ) {
        let torques = linear.torque(&sensed.effort);
        let efforts = linear.greatest_efforts(&sensed.effort);
        let guards = self.guards;
        let measured = torques.iter().zip(&efforts);
        for (joint, (guard, (&torque, &effort))) in guards.iter().zip(measured).enumerate() {
            if self.armed & following & !self.stopped & 1 << joint == 0 {
                continue;
            }
            let first = guard.first(joint, torque, effort, sensed.touch, self.contact_n);
            let Some((tripped, value)) = first else {
                continue;
            };
            for (other, of) in guards.iter().enumerate() {
                let moves = following & !self.stopped & 1 << other != 0;
                if !(moves && of.motion == guard.motion) {
                    continue;
                }
                if let (Some(position), Some(place)) = (position(other), self.stops.get_mut(other))
                {
                    *place = Some(GuardStop {
                        motion: guard.motion,
                        guard: tripped,
                        value,
                        position,
                    });
                    self.stopped |= 1 << other;
                }
            }
        }
    }
}
