//! The measurements and stops of servo processors for the guards of motions.
//!
//! A [motion](condor_hand::trajectory::Primitive) may begin, and stop, on torque, effort and contact. The
//! servos check in each of their ticks the conditions that stop it, and each servo processor publishes in
//! [`Stops`] the joints that rest since then. The master checks in each of its own ticks the conditions on
//! which a motion begins. It reads [`Felt`], which keeps the greatest values in between.

use condor_hand::controller::GuardStop;
use condor_hand::trajectory::MotionGuard;
use condor_vars::cell_struct;
use zerocopy::{FromBytes, FromZeros, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS};

/// The name of the published [`Felt`] in the object table of a servo processor.
pub const FELT_NAME: &str = "felt";
/// The name of the published [`Stops`] in the object table of a servo processor.
pub const STOPS_NAME: &str = "stops";

/// The greatest torques and efforts that the joints of a servo processor had within about the last tick of the
/// trajectories. The processor publishes it in every tick of its servos: a `Published<Felt>`. The master reads it to
/// decide whether a motion that waits for a torque, an effort or a contact may begin.
///
/// The arrays have an element for each finger of the hand. The values of a finger that the processor does not serve are
/// 0. Readings that are NaN are left out.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Felt {
    /// The greatest torque of each joint, to either side, N m.
    pub torque: [[f64; JOINTS]; FINGERS],
    /// The greatest effort of the actuators of each joint, to either side, N or N m.
    pub effort: [[f64; JOINTS]; FINGERS],
    /// A bit for each finger that was in contact.
    pub contacts: u64,
    /// Ticks of the servo loop.
    pub ticks: u64,
}

cell_struct!(Felt {
    "torque": torque, "N m", "Greatest recent value, to either side; joints in the order of the fingers.";
    "effort": effort, "N", "Greatest recent value of its actuators, to either side.";
    "contacts": contacts, "", "A bit for each finger in recent contact.";
    "ticks": ticks, "";
});

/// The joints of a servo processor that rest because a guard (a torque, an effort or a contact) has stopped their
/// motion. The processor publishes it when it changes: a `Published<Stops>`.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Stops {
    /// The number of the motion that was stopped; 0 for a joint that no guard has stopped.
    pub motion: [[u32; JOINTS]; FINGERS],
    /// The quantity that stopped the motion: 1 torque, 2 effort, 3 contact; plus 256 times the number of the
    /// joint in the finger.
    pub guard: [[u32; JOINTS]; FINGERS],
    /// The torque, effort or force that was measured, N m or N.
    pub value: [[f64; JOINTS]; FINGERS],
    /// The set-point at which the joint rests, rad.
    pub position: [[f64; JOINTS]; FINGERS],
}

cell_struct!(Stops {
    "motion": motion, "", "The motion that a guard has stopped; 0 for none.";
    "guard": guard, "", "1 torque, 2 effort, 3 contact, and 256 times the joint.";
    "value": value, "", "Measured value, N m or N.";
    "position": position, "rad", "Position at which it stopped.";
});

const TORQUE: u32 = 1;
const EFFORT: u32 = 2;
const CONTACT: u32 = 3;

impl Stops {
    /// Without any stop.
    pub(crate) fn none() -> Self {
        Self::new_zeroed()
    }

    /// Adds the stop of a joint of the hand.
    pub(crate) fn add(&mut self, finger: usize, joint: usize, stop: &GuardStop) {
        let (kind, of) = match stop.guard {
            MotionGuard::Torque { joint } => (TORQUE, joint),
            MotionGuard::Effort { joint } => (EFFORT, joint),
            MotionGuard::Contact { joint } => (CONTACT, joint),
            // The servos check no time.
            MotionGuard::Time => return,
        };
        put(&mut self.motion, finger, joint, stop.motion);
        put(&mut self.guard, finger, joint, kind | (of as u32) << 8);
        put(&mut self.value, finger, joint, stop.value);
        put(&mut self.position, finger, joint, stop.position);
    }

    /// The stop of a joint of the hand, if there is one.
    pub(crate) fn of(&self, finger: usize, joint: usize) -> Option<GuardStop> {
        let motion = get(&self.motion, finger, joint).filter(|&motion| motion != 0)?;
        let guard = get(&self.guard, finger, joint)?;
        let of = (guard >> 8) as usize;
        Some(GuardStop {
            motion,
            guard: match guard & 0xff {
                TORQUE => MotionGuard::Torque { joint: of },
                EFFORT => MotionGuard::Effort { joint: of },
                CONTACT => MotionGuard::Contact { joint: of },
                _ => return None,
            },
            value: get(&self.value, finger, joint)?,
            position: get(&self.position, finger, joint)?,
        })
    }
}

fn get<T: Copy>(of: &[[T; JOINTS]; FINGERS], finger: usize, joint: usize) -> Option<T> {
    of.get(finger)?.get(joint).copied()
}

fn put<T>(of: &mut [[T; JOINTS]; FINGERS], finger: usize, joint: usize, value: T) {
    if let Some(place) = of.get_mut(finger).and_then(|joints| joints.get_mut(joint)) {
        *place = value;
    }
}
