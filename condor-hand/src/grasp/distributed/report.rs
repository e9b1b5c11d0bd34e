use serde::{Deserialize, Serialize};

use super::MOST_FINGERS;

/// The state of a grasp on one processor, from the order to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum GraspState {
    /// There is no grasp.
    Idle,
    /// The processor has the order, and waits until the processors of the other fingers of the
    /// grasp have it, too.
    Waiting,
    /// The law is in force.
    Holding,
    /// The order was refused.
    Refused,
    /// A finger has left the grasp.
    Left,
}

/// The reason why an order for a grasp was refused, or why a finger has left a grasp.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum GraspReason {
    /// The grasp was neither refused nor left.
    None,
    /// The order names fewer than three fingers, or one that the hand does not have.
    Fingers,
    /// A number of the order is not finite, or not possible as a gain, limit or coefficient.
    Tuning,
    /// The tips lie on a line, or the law has no answer for another reason.
    Law,
    /// Another finger has left the grasp, or its joints are not known.
    Partner,
    /// A finger has a fault.
    Fault,
    /// A joint was given another mode.
    Switched,
}

impl GraspReason {
    /// Returns the reason as a short English text, for messages to people.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::None => "no reason",
            Self::Fingers => "a grasp needs at least three fingers, all of this hand",
            Self::Tuning => {
                "a number of the grasp is not possible; gains are at least 0, friction above 0, all finite"
            }
            Self::Law => {
                "no torques hold the object so: move the fingertips apart, or reduce the gains"
            }
            Self::Partner => {
                "another finger does not take part; see whether it has a fault or another mode"
            }
            Self::Fault => "a finger has a fault; enable it again",
            Self::Switched => "a joint was given another mode; order the grasp again",
        }
    }
}

/// The report of one processor about a grasp: its state, and how well the object is held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspReport {
    /// The number of the order that the report is about.
    pub order: u64,
    /// The state of the grasp at the processor that reports.
    pub state: GraspState,
    /// The reason, if the grasp was refused or left.
    pub reason: GraspReason,
    /// The fraction of the squeeze that the joints can bear, 0 to 1.
    pub squeeze_share: f64,
    /// The motion that would take the object to its desired place: m, and rad about the axes.
    pub deviation: [f64; 6],
    /// The distance of each finger from slipping, N; 0 for a finger that does not hold.
    pub margins: [f64; MOST_FINGERS],
}

impl GraspReport {
    /// The report of a processor without a grasp.
    pub const NOTHING: Self = Self::new(0, GraspState::Idle, GraspReason::None);

    pub(super) const fn new(order: u64, state: GraspState, reason: GraspReason) -> Self {
        Self {
            order,
            state,
            reason,
            squeeze_share: 0.0,
            deviation: [0.0; 6],
            margins: [0.0; MOST_FINGERS],
        }
    }

    /// Returns the number of the order, the state and the reason. Compare the result with the
    /// previous one to learn whether something has happened that people should know.
    #[must_use]
    pub const fn event(&self) -> (u64, GraspState, GraspReason) {
        (self.order, self.state, self.reason)
    }

    /// The importance of the report: the end of a grasp before its course, a cause before its effect.
    pub(super) const fn weight(&self) -> u32 {
        match (self.state, self.reason) {
            (GraspState::Idle, _) => 0,
            (GraspState::Holding, _) => 1,
            (GraspState::Waiting, _) => 2,
            (_, GraspReason::Partner) => 3,
            _ => 4,
        }
    }
}
