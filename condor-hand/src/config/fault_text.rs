//! [`FaultText`]: a fault of a finger, in words.

use core::fmt;

use super::{Finger, Joint};
use crate::decimal::Decimal;
use crate::fault::{Fault, FaultCode, FaultPlace, FaultQuantity};
use crate::number::Requirement;

impl Fault {
    /// Returns the fault in words, with the names of the parts of `finger`, the value and what is allowed. An example:
    /// "arm.twist: tracking error of 0.147 rad, at most 0.1 rad is allowed".
    ///
    /// [`FaultCode::remedy`] says what can be done.
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

/// A [`Fault`] in words; [`Fault::of`] returns it.
#[derive(Clone, Copy, Debug)]
pub struct FaultText<'f, const J: usize, const A: usize> {
    fault: Fault,
    finger: &'f Finger<J, A>,
}

impl<const J: usize, const A: usize> fmt::Display for FaultText<'_, J, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fault = &self.fault;
        self.place(f)?;
        let unit = self.unit();
        let (value, allowed) = (Number(fault.value, unit), Bound(fault.allowed, unit));
        let quantity = match fault.quantity {
            FaultQuantity::Position => "position",
            FaultQuantity::Effort => "effort",
            FaultQuantity::Time => "time",
        };
        match fault.code {
            FaultCode::NotFinite => {
                let number = Decimal(fault.value);
                write!(
                    f,
                    "{quantity}, or its set-point, is {number}, it must be a finite number"
                )
            }
            FaultCode::OutOfRange => {
                write!(
                    f,
                    "{quantity} of {value} is out of its sensor's range, {allowed} is allowed"
                )
            }
            FaultCode::Stuck => write!(
                f,
                "{quantity} is stuck, it should have changed by {value}, {allowed} is allowed"
            ),
            FaultCode::Tracking => write!(f, "tracking error of {value}, {allowed} is allowed"),
            FaultCode::LowEffort => {
                write!(f, "effort of {value} is too low, {allowed} is allowed")
            }
            FaultCode::HighEffort => {
                write!(f, "effort of {value} is too high, {allowed} is allowed")
            }
            FaultCode::JointLimit => {
                write!(
                    f,
                    "position of {value} is past its limit, {allowed} is allowed"
                )
            }
            FaultCode::MissedDeadline => write!(
                f,
                "missed deadline, {value} after the tick before, {allowed} is allowed"
            ),
            FaultCode::StaleSetPoint if !fault.value.is_finite() => {
                write!(f, "no set-point, {allowed} without one is allowed")
            }
            FaultCode::StaleSetPoint => write!(
                f,
                "no new set-point, the last one is {value} old, {allowed} is allowed"
            ),
            FaultCode::Jump => write!(f, "{quantity} jumped by {value}, {allowed} is allowed"),
        }
    }
}

impl<const J: usize, const A: usize> FaultText<'_, J, A> {
    /// Writes the part that has the fault, and a colon.
    fn place(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let finger = self.finger;
        f.write_str(&finger.name)?;
        let (number, part) = match self.fault.place {
            FaultPlace::Actuator(actuator) => {
                let part = finger.actuators.get(actuator);
                (actuator, part.map(|part| &part.name))
            }
            FaultPlace::Joint(joint) => (joint, finger.joints.get(joint).map(|part| &part.name)),
            FaultPlace::Finger => return f.write_str(": "),
        };
        match part {
            Some(name) => write!(f, ".{name}: "),
            None => write!(f, ".{number}: "),
        }
    }

    fn unit(&self) -> &'static str {
        let finger = self.finger;
        let Fault {
            place, quantity, ..
        } = self.fault;
        let unit = match (place, quantity) {
            (_, FaultQuantity::Time) => Some("s"),
            (FaultPlace::Actuator(actuator), quantity) => {
                let actuator = finger.actuators.get(actuator);
                actuator.map(|actuator| match quantity {
                    FaultQuantity::Effort => finger.effort_unit(actuator),
                    _ => finger.actuator_position_unit(actuator),
                })
            }
            (FaultPlace::Joint(joint), _) => {
                let joint = finger.joints.get(joint);
                joint.map(Joint::position_unit)
            }
            (FaultPlace::Finger, _) => None,
        };
        unit.unwrap_or_default()
    }
}

/// A number with its unit.
struct Number(f64, &'static str);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(value, unit) = *self;
        write!(f, "{:#}", Decimal(value))?;
        if unit.is_empty() {
            return Ok(());
        }
        write!(f, " {unit}")
    }
}

/// The requirement on a value, with its unit.
struct Bound(Requirement, &'static str);

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(allowed, unit) = *self;
        let number = |bound| Number(bound, unit);
        match allowed {
            Requirement::AtMost(most) => write!(f, "at most {}", number(most)),
            Requirement::AtLeast(least) => write!(f, "at least {}", number(least)),
            Requirement::Above(least) => write!(f, "above {}", number(least)),
            Requirement::Within(low, high) => {
                write!(f, "{:#} to {}", Decimal(low), number(high))
            }
            other => write!(f, "{other}"),
        }
    }
}
