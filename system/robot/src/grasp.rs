//! A grasp of the hand by [`DistributedGrasp`](condor_hand::grasp::distributed::DistributedGrasp): where
//! its processors find each other's joints, orders and reports.
//!
//! The master writes the same `GraspOrder` for each servo processor, into [`GraspLayout`](crate::message::GraspLayout) in the object
//! named [`NAME`] of its object table; [`tips`] computes the present places of the tips. Each servo
//! processor publishes its [`Joints`] in every tick. A master that dies does not end a grasp.

use condor_hand::grasp::distributed::HandJoints;
use condor_hand::kinematics::Kinematics;
use condor_vars::cell_struct;
use nalgebra::SVector;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS, RobotDescription};

mod partner;

pub(crate) use partner::{Partner, PartnerState, TickTime};

/// The name of the object with the [`GraspLayout`](crate::message::GraspLayout) in the object table of a servo processor.
pub const NAME: &str = "grasp-2";
/// The name of the published [`Joints`] in the object table of a servo processor.
pub const JOINTS_NAME: &str = "joints";

/// The positions and velocities of the joints that a servo processor measures, published in every tick of its loop: a
/// `Published<Joints>`.
///
/// The arrays have an element for each finger of the hand. Only the fingers in [`served`](Self::served) count.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Joints {
    /// The measured positions of the joints in this tick, rad; NaN if a sensor has no reading.
    pub position: [[f64; JOINTS]; FINGERS],
    /// The filtered rates of the joints in the previous tick, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
    /// The number of the grasp order in force for each finger; 0 for none.
    pub order: [u64; FINGERS],
    /// A bit for each finger that the processor serves.
    pub served: u64,
    /// When the tick was due, ns of the processor's clock.
    pub due_ns: u64,
    /// Ticks of the servo loop.
    pub ticks: u64,
}

cell_struct!(Joints {
    "position": position, "rad", "As measured; joints in the order of the fingers.";
    "velocity": velocity, "rad/s", "Filtered.";
    "order": order, "", "The grasp order in force for each finger; 0 for none.";
    "served": served, "", "A bit for each finger of this processor; others do not count.";
    "due_ns": due_ns, "ns";
    "ticks": ticks, "";
});

impl Joints {
    /// The joints of the hand in a tick that was due at an instant, ns.
    pub(crate) const fn new(hand: &HandJoints<FINGERS, JOINTS>, due_ns: u64, ticks: u64) -> Self {
        Self {
            position: hand.position,
            velocity: hand.velocity,
            order: hand.order,
            served: hand.served,
            due_ns,
            ticks,
        }
    }

    pub(crate) const fn of_hand(&self) -> HandJoints<FINGERS, JOINTS> {
        HandJoints {
            position: self.position,
            velocity: self.velocity,
            order: self.order,
            served: self.served,
        }
    }
}

impl TickTime for Joints {
    fn due_ns(&self) -> u64 {
        self.due_ns
    }
}

/// Returns the positions of the fingertips (m, in the axes of the palm) for the positions `joints` (rad). The tip of a
/// finger that the robot does not have is at the origin.
#[must_use]
pub fn tips(robot: &RobotDescription, joints: &[[f64; JOINTS]; FINGERS]) -> [[f64; 3]; FINGERS] {
    let mut tips = [[0.0; 3]; FINGERS];
    for ((tip, finger), joints) in tips.iter_mut().zip(&robot.fingers).zip(joints) {
        let joints = SVector::from(*joints);
        *tip = finger.chain().tip(&joints).position.into();
    }
    tips
}

/// Returns the positions of the joints of all fingers (rad), as the servo processors publish them. `published` returns
/// the value that the processor with the given number publishes. The result is `None` if `published` returns `None` for
/// the processor of a finger.
#[must_use]
pub fn joints(
    hand: &RobotDescription,
    mut published: impl FnMut(u8) -> Option<Joints>,
) -> Option<[[f64; JOINTS]; FINGERS]> {
    let mut all = [[0.0; JOINTS]; FINGERS];
    for (number, (joints, finger)) in all.iter_mut().zip(&hand.fingers).enumerate() {
        *joints = *published(finger.processor()?)?.position.get(number)?;
    }
    Some(all)
}
