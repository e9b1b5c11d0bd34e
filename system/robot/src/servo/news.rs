//! [`LoopNews`]: the state of the servo loop whose changes are reported to people.

use core::fmt::Arguments;

use condor_hand::fault::Fault;
use condor_hand::grasp::distributed::{GraspReason, GraspState};

use crate::{FINGERS, RobotDescription};

/// The state that the loop passes to the background, which reports changes of it to people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LoopNews {
    /// The fault of each finger of the hand.
    pub(super) faults: [Option<Fault>; FINGERS],
    pub(super) grasp: (u64, GraspState, GraspReason),
    /// Transfers of boards that failed; wraps.
    pub(super) failures: u32,
}

impl LoopNews {
    pub(super) const NOTHING: Self = Self {
        faults: [None; FINGERS],
        grasp: (0, GraspState::Idle, GraspReason::None),
        failures: 0,
    };

    /// Calls `say` with a sentence for each difference from `before`.
    pub(super) fn tell(
        &self,
        before: &Self,
        hand: &RobotDescription,
        mut say: impl FnMut(Arguments<'_>),
    ) {
        for (finger, (now, before)) in hand
            .fingers
            .iter()
            .zip(self.faults.iter().zip(&before.faults))
        {
            let name = &finger.name;
            match now {
                Some(fault) if now != before => say(format_args!(
                    "{name} has a fault: {}; {}",
                    fault.of(finger),
                    fault.code.remedy()
                )),
                None if before.is_some() => say(format_args!("{name} has no fault any more")),
                _ => {}
            }
        }
        if self.grasp != before.grasp {
            let (order, state, reason) = self.grasp;
            let why = reason.as_str();
            match state {
                GraspState::Idle => say(format_args!("grasp {order}: has let go of the ball")),
                GraspState::Waiting => {
                    say(format_args!("grasp {order}: waits for the other fingers"));
                }
                GraspState::Holding => say(format_args!("grasp {order}: holds the ball")),
                GraspState::Refused => say(format_args!("grasp {order} refused: {why}")),
                GraspState::Left => say(format_args!("grasp {order} ended: {why}")),
            }
        }
        if self.failures != before.failures {
            let failures = self.failures.wrapping_sub(before.failures);
            say(format_args!(
                "{failures} more transfers from or to the A/D and D/A boards failed"
            ));
        }
    }
}
