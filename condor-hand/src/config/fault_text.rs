//! [`FaultText`]: a fault of a finger, in words.

use core::fmt;

use super::Finger;
use crate::decimal::Decimal;
use crate::fault::{FaultCode, FaultSite, FingerFault};
use crate::math::abs;

impl FingerFault {
    /// Returns the fault as a sentence for people, with the names of the parts of `finger`. An example:
    /// "index.middle-flexor has too little effort: 0.000".
    #[must_use]
    pub const fn of<const J: usize, const A: usize>(
        self,
        finger: &Finger<J, A>,
    ) -> FaultText<'_, J, A> {
        FaultText {
            fault: self,
            finger,
        }
    }
}

/// A [`FingerFault`] as a sentence for people; [`FingerFault::of`] returns it.
#[derive(Clone, Copy, Debug)]
pub struct FaultText<'f, const J: usize, const A: usize> {
    fault: FingerFault,
    finger: &'f Finger<J, A>,
}

impl<const J: usize, const A: usize> fmt::Display for FaultText<'_, J, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FingerFault { code, site, value } = self.fault;
        let finger = self.finger;
        let (part, number, unit) = match site {
            FaultSite::Actuator(actuator) => {
                let part = finger.actuators.get(actuator).map(|part| &part.name);
                (part, Some(actuator), "")
            }
            FaultSite::Joint(joint) => {
                let part = finger.joints.get(joint).map(|part| &part.name);
                (part, Some(joint), " rad")
            }
            FaultSite::Finger => (None, None, " s"),
        };
        f.write_str(&finger.name)?;
        match (part, number) {
            (Some(name), _) => write!(f, ".{name}")?,
            (None, Some(number)) => write!(f, ".{number}")?,
            (None, None) => {}
        }
        let is_never = !value.is_finite();
        let (distance, value) = (Decimal(abs(value)), Decimal(value));
        match code {
            FaultCode::NotFinite => f.write_str(" has a reading or a set-point that is no number"),
            FaultCode::OutOfRange => {
                write!(f, " reads {value:.3}{unit}, outside of its sensor's range")
            }
            FaultCode::Stuck => write!(f, " is stuck: it still reads {value:.3}{unit}"),
            FaultCode::Tracking => write!(f, " is {distance:.3}{unit} away from its set-point"),
            FaultCode::LowEffort => write!(f, " has too little effort: {value:.3}{unit}"),
            FaultCode::HighEffort => write!(f, " has too much effort: {value:.3}{unit}"),
            FaultCode::JointLimit => write!(f, " is past its limit: {value:.3}{unit}"),
            FaultCode::MissedDeadline => write!(
                f,
                " was served too late: {value:.3}{unit} after the tick before"
            ),
            FaultCode::StaleSetPoint if is_never => f.write_str(" has no set-point"),
            FaultCode::StaleSetPoint => write!(
                f,
                " has no new set-point: the last one is {value:.3}{unit} old"
            ),
            FaultCode::Jump => write!(f, " jumped: it suddenly reads {value:.3}{unit}"),
        }
    }
}
