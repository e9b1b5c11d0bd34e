use core::fmt;

use thiserror::Error;

use crate::decimal::Decimal;
use crate::fault_code::FaultCode;
use crate::math::{abs, is_finite, round, sqrt};

/// The error that a number has a value which its use does not permit.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("{}{what} is {}; it must be {must}", .at.prefix(), Decimal(*.value))]
pub struct NumberError {
    /// The part to which the number belongs. Set it to [`Subject::Whole`] to print the number without the part,
    /// for example behind the name that a user gave the part.
    pub at: Subject,
    /// The quantity, with its unit.
    pub what: &'static str,
    /// The number.
    pub value: f64,
    /// The requirement that the number does not meet.
    pub must: Requirement,
}

/// The part of a robot, or of a description, to which an error belongs. All numbers are counted from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Subject {
    /// The whole of the thing that is made or asked; it is not printed.
    #[default]
    Whole,
    /// The joint of this number, counted from the palm.
    Joint(u16),
    /// The actuator of this number.
    Actuator(u16),
    /// The arm of an actuator at a joint.
    Arm {
        /// The number of the actuator.
        actuator: u16,
        /// The number of the joint.
        joint: u16,
    },
    /// A check for faults of an actuator, and the kind of fault.
    ActuatorCheck(u16, FaultCode),
    /// A check for faults of a joint, and the kind of fault.
    JointCheck(u16, FaultCode),
    /// A check for faults of a finger as a whole, and the kind of fault.
    FingerCheck(FaultCode),
    /// The base of a finger in the palm.
    Base,
    /// The placement of a joint.
    Placement(u16),
    /// A link and its body.
    Link(u16),
    /// The tip of a finger on its last link.
    Tip,
    /// The finger of this number in its hand.
    Finger(u16),
    /// A joint, where several fingers have one of its number.
    FingerJoint {
        /// The number of the finger in its hand.
        finger: u16,
        /// The number of the joint, counted from the palm.
        joint: u16,
    },
    /// A contact of a grasp.
    Contact(u16),
    /// An axis of the table.
    Axis(u16),
    /// A via point of a motion.
    Via(u16),
    /// A knot of a spline.
    Knot(u16),
    /// A motion of a sequence.
    Motion(u32),
}

/// A requirement on a number, which must also be finite.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Requirement {
    /// The number may be any finite one.
    Finite,
    /// The number must be above this.
    Above(f64),
    /// The number must be below this.
    Below(f64),
    /// The number must be this or more.
    AtLeast(f64),
    /// The number must be this or less.
    AtMost(f64),
    /// The number must be from the first to the second, or one of them.
    Within(f64, f64),
    /// The number must be this.
    Equal(f64),
    /// The number must be a multiple of this.
    MultipleOf(f64),
}

impl NumberError {
    /// The same error of a number of this part.
    pub(crate) fn at(self, at: Subject) -> Self {
        Self { at, ..self }
    }
}

impl Subject {
    /// The place in front of an error.
    pub(crate) const fn prefix(self) -> SubjectPrefix {
        SubjectPrefix(self)
    }
}

/// A part in front of an error about it.
pub(crate) struct SubjectPrefix(Subject);

impl fmt::Display for SubjectPrefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Subject::Whole => Ok(()),
            part => write!(f, "{part}: "),
        }
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => f.write_str("the whole"),
            Self::Joint(joint) => write!(f, "joint {joint}"),
            Self::Actuator(actuator) => write!(f, "actuator {actuator}"),
            Self::Arm { actuator, joint } => {
                write!(f, "actuator {actuator} at joint {joint}")
            }
            Self::ActuatorCheck(actuator, code) => {
                write!(f, "{}, '{code}'", Self::Actuator(*actuator))
            }
            Self::JointCheck(joint, code) => write!(f, "{}, '{code}'", Self::Joint(*joint)),
            Self::FingerCheck(code) => write!(f, "the finger, '{code}'"),
            Self::Base => f.write_str("the base"),
            Self::Placement(joint) => write!(f, "the placement of joint {joint}"),
            Self::Link(link) => write!(f, "link {link}"),
            Self::Tip => f.write_str("the tip"),
            Self::Finger(finger) => write!(f, "finger {finger}"),
            Self::FingerJoint { finger, joint } => write!(f, "joint {joint} of finger {finger}"),
            Self::Contact(contact) => write!(f, "contact {contact}"),
            Self::Axis(axis) => write!(f, "axis {axis}"),
            Self::Via(index) => write!(f, "via point {index}"),
            Self::Knot(index) => write!(f, "knot {index}"),
            Self::Motion(index) => write!(f, "motion {index}"),
        }
    }
}

impl Requirement {
    /// Returns whether `value` is finite and meets the requirement.
    #[must_use]
    pub fn holds(self, value: f64) -> bool {
        is_finite(value)
            && match self {
                Self::Finite => true,
                Self::Above(bound) => value > bound,
                Self::Below(bound) => value < bound,
                Self::AtLeast(bound) => value >= bound,
                Self::AtMost(bound) => value <= bound,
                Self::Within(low, high) => low <= value && value <= high,
                Self::Equal(other) => value == other,
                Self::MultipleOf(part) => round(value / part) == value / part,
            }
    }

    /// The requirement with a bound that is farther off.
    fn loosened(self, by: f64) -> Self {
        match self {
            Self::Finite | Self::Equal(_) | Self::MultipleOf(_) => self,
            Self::Above(bound) => Self::Above(bound - by),
            Self::Below(bound) => Self::Below(bound + by),
            Self::AtLeast(bound) => Self::AtLeast(bound - by),
            Self::AtMost(bound) => Self::AtMost(bound + by),
            Self::Within(low, high) => Self::Within(low - by, high + by),
        }
    }
}

impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Finite => f.write_str("finite"),
            Self::Above(bound) => write!(f, "above {}", Decimal(bound)),
            Self::Below(bound) => write!(f, "below {}", Decimal(bound)),
            Self::AtLeast(bound) => write!(f, "at least {}", Decimal(bound)),
            Self::AtMost(bound) => write!(f, "at most {}", Decimal(bound)),
            Self::Within(low, high) => write!(f, "from {} to {}", Decimal(low), Decimal(high)),
            Self::Equal(other) => write!(f, "{}", Decimal(other)),
            Self::MultipleOf(part) => write!(f, "a multiple of {}", Decimal(part)),
        }
    }
}

pub(crate) fn check(what: &'static str, value: f64, must: Requirement) -> Result<(), NumberError> {
    if must.holds(value) {
        Ok(())
    } else {
        let at = Subject::Whole;
        Err(NumberError {
            at,
            what,
            value,
            must,
        })
    }
}

/// Returns the tolerance of all checks of motions: how far a number may be beyond a limit of the size
/// `scale`.
///
/// It is half of the digits: 1.5e-8 of the scale in `f64`. Numbers that are at a limit on paper are
/// rounded, and the short time between two points makes a large acceleration of a rounded position:
/// at 1 kHz, of 1 rad, 1e-9 rad/s². No robot can tell the difference, and what is refused differs
/// from its limit in the digits that an error shows.
pub(crate) fn tolerance(scale: f64) -> f64 {
    abs(scale) * sqrt(f64::EPSILON)
}

/// Checks a number of a motion, which may be beyond its limit by the [`tolerance`].
pub(crate) fn check_motion(
    what: &'static str,
    value: f64,
    must: Requirement,
    scale: f64,
) -> Result<(), NumberError> {
    check(what, value, must.loosened(tolerance(scale)))
        .map_err(|error| NumberError { must, ..error })
}

/// Returns whether a position is in a range, or beyond it by no more than the [`tolerance`].
pub(crate) fn is_within(position: f64, low: f64, high: f64) -> bool {
    let room = tolerance(high - low);
    low - room <= position && position <= high + room
}

pub(crate) fn finite(what: &'static str, value: f64) -> Result<(), NumberError> {
    if is_finite(value) {
        Ok(())
    } else {
        check(what, value, Requirement::Finite)
    }
}

pub(crate) fn positive(what: &'static str, value: f64) -> Result<(), NumberError> {
    check(what, value, Requirement::Above(0.0))
}

pub(crate) fn not_negative(what: &'static str, value: f64) -> Result<(), NumberError> {
    check(what, value, Requirement::AtLeast(0.0))
}

/// A number of things, for an error about it.
pub(crate) fn count(things: usize) -> f64 {
    f64::from(things as u32)
}

/// The time between samples, s.
pub(crate) fn period(sample_hz: f64) -> Result<f64, NumberError> {
    let period = 1.0 / sample_hz;
    positive("the sample rate, Hz,", sample_hz)?;
    positive("the time between samples, s,", period).map(|()| period)
}
