use core::fmt;

use thiserror::Error;

use crate::Subject;
use crate::decimal::Decimal;
use crate::tendon::Pair;

/// The kind of a fault of a finger.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
#[non_exhaustive]
pub enum FaultCode {
    /// A reading or a set-point is not finite.
    NotFinite = 0,
    /// A reading is outside of the sensor's range.
    OutOfRange = 1,
    /// A reading does not change while its set-point moves away, or while the measured quantity
    /// must change.
    Stuck = 2,
    /// The measured value is too far from the desired one.
    Tracking = 3,
    /// A tendon pulls less than a whole and taut tendon would.
    Slack = 4,
    /// A tendon pulls more than it can bear.
    OverTension = 5,
    /// A joint is past its limits.
    JointLimit = 6,
    /// A tick of the servo came too late.
    MissedDeadline = 7,
    /// The level above has sent no set-point for too long.
    StaleSetPoint = 8,
    /// A reading is implausibly far from the last one.
    Jump = 9,
}

impl FaultCode {
    /// All kinds of faults, in the order of their numbers.
    pub const ALL: [Self; 10] = [
        Self::NotFinite,
        Self::OutOfRange,
        Self::Stuck,
        Self::Tracking,
        Self::Slack,
        Self::OverTension,
        Self::JointLimit,
        Self::MissedDeadline,
        Self::StaleSetPoint,
        Self::Jump,
    ];

    /// Returns the name of the fault, for people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not finite",
            Self::OutOfRange => "out of range",
            Self::Stuck => "stuck",
            Self::Tracking => "tracking error",
            Self::Slack => "slack",
            Self::OverTension => "over-tension",
            Self::JointLimit => "past its limit",
            Self::MissedDeadline => "missed deadline",
            Self::StaleSetPoint => "stale set-point",
            Self::Jump => "jumped",
        }
    }
}

impl fmt::Display for FaultCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The part of a finger that has a fault. Joints are counted from 0 at the palm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum FaultSite {
    /// The tendon that pulls this joint to positive angles.
    Flexor(usize),
    /// The antagonist of this joint.
    Extensor(usize),
    /// The joint itself, by its number.
    Joint(usize),
    /// The finger as a whole.
    Finger,
}

impl FaultSite {
    /// The check for this kind of fault here, as errors name it.
    pub(super) const fn check(self, code: FaultCode) -> Subject {
        let name = code.name();
        match self {
            Self::Flexor(joint) => Subject::FlexorCheck(joint as u16, name),
            Self::Extensor(joint) => Subject::ExtensorCheck(joint as u16, name),
            Self::Joint(joint) => Subject::JointCheck(joint as u16, name),
            Self::Finger => Subject::FingerCheck(name),
        }
    }

    /// The two tendons of a joint.
    pub(super) const fn tendons(joint: usize) -> Pair<Self> {
        Pair {
            flexor: Self::Flexor(joint),
            extensor: Self::Extensor(joint),
        }
    }
}

impl fmt::Display for FaultSite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flexor(joint) => write!(f, "the flexor of joint {joint}"),
            Self::Extensor(joint) => write!(f, "the extensor of joint {joint}"),
            Self::Joint(joint) => write!(f, "joint {joint}"),
            Self::Finger => f.write_str("the finger"),
        }
    }
}

/// A fault of a finger: its kind, the part that has it, and the value that showed it.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("{site}: {code} ({value})", value = Decimal(*.value))]
pub struct FingerFault {
    /// The kind of fault.
    pub code: FaultCode,
    /// The site of the fault.
    pub site: FaultSite,
    /// The value of the sample that made it a fault: N for a tendon, rad for a joint, s for a time;
    /// for [`Tracking`](FaultCode::Tracking), the desired value less the measured one.
    pub value: f64,
}
