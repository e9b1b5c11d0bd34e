//! [`FaultText`]: a fault of a finger, in words.

use core::fmt;

use super::Finger;
use crate::decimal::Decimal;
use crate::math::abs;
use crate::tendon::fault::{FaultCode, FaultSite, FingerFault};

impl FingerFault {
    /// Returns the fault as a sentence for people, with the names of the parts of `finger`. An example: "the flexor of
    /// index.middle is slack: it pulls 0 N".
    #[must_use]
    pub const fn of<const J: usize>(self, finger: &Finger<J>) -> FaultText<'_, J> {
        FaultText {
            fault: self,
            finger,
        }
    }
}

/// A [`FingerFault`] as a sentence for people; [`FingerFault::of`] returns it.
#[derive(Clone, Copy, Debug)]
pub struct FaultText<'f, const J: usize> {
    fault: FingerFault,
    finger: &'f Finger<J>,
}

impl<const J: usize> fmt::Display for FaultText<'_, J> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FingerFault { code, site, value } = self.fault;
        let (part, joint, unit) = match site {
            FaultSite::Flexor(joint) => ("the flexor of ", Some(joint), "N"),
            FaultSite::Extensor(joint) => ("the extensor of ", Some(joint), "N"),
            FaultSite::Joint(joint) => ("", Some(joint), "rad"),
            FaultSite::Finger => ("", None, "s"),
        };
        write!(f, "{part}{}", self.finger.name)?;
        if let Some(joint) = joint {
            match self.finger.joints.get(joint) {
                Some(joint) => write!(f, ".{}", joint.name)?,
                None => write!(f, ".{joint}")?,
            }
        }
        let is_never = !value.is_finite();
        let (distance, value) = (Decimal(abs(value)), Decimal(value));
        match code {
            FaultCode::NotFinite => f.write_str(" has a reading or a set-point that is no number"),
            FaultCode::OutOfRange => {
                write!(f, " reads {value:.3} {unit}, outside of its sensor's range")
            }
            FaultCode::Stuck => write!(f, " is stuck: it still reads {value:.3} {unit}"),
            FaultCode::Tracking => write!(f, " is {distance:.3} {unit} away from its set-point"),
            FaultCode::Slack => write!(f, " is slack: it pulls {value:.3} {unit}"),
            FaultCode::OverTension => write!(f, " pulls too much: {value:.3} {unit}"),
            FaultCode::JointLimit => write!(f, " is past its limit: {value:.3} {unit}"),
            FaultCode::MissedDeadline => write!(
                f,
                " was served too late: {value:.3} {unit} after the tick before"
            ),
            FaultCode::StaleSetPoint if is_never => f.write_str(" has no set-point"),
            FaultCode::StaleSetPoint => write!(
                f,
                " has no new set-point: the last one is {value:.3} {unit} old"
            ),
            FaultCode::Jump => write!(f, " jumped: it suddenly reads {value:.3} {unit}"),
        }
    }
}
