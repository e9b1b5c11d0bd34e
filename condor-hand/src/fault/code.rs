use crate::Subject;
use crate::fault_code::FaultCode;
use crate::number::Requirement;

/// The part of a finger that has a fault. Joints are counted from 0 at the palm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum FaultPlace {
    /// The actuator of this number.
    Actuator(usize),
    /// The joint itself, by its number.
    Joint(usize),
    /// The finger as a whole.
    Finger,
}

impl FaultPlace {
    /// The check for this kind of fault here, as errors name it.
    pub(super) const fn check(self, code: FaultCode) -> Subject {
        match self {
            Self::Actuator(actuator) => Subject::ActuatorCheck(actuator as u16, code),
            Self::Joint(joint) => Subject::JointCheck(joint as u16, code),
            Self::Finger => Subject::FingerCheck(code),
        }
    }
}

/// The quantity whose value shows a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum FaultQuantity {
    /// The position of a joint or an actuator, rad or m.
    Position,
    /// The effort of an actuator, N or N m.
    Effort,
    /// A time, s.
    Time,
}

/// A fault of a finger: its kind, the part that has it, the value that showed it, and the bound that the value passed.
///
/// The value and the bound have one unit, that of the quantity:
///
/// | code | value |
/// |---|---|
/// | not finite | the reading, or its set-point |
/// | out of range, effort too low, effort too high, past its limit | the reading |
/// | stuck | the distance by which the reading had to change, and did not |
/// | tracking error | the distance of the reading from its set-point |
/// | jumped | the distance of the reading from where it had to be |
/// | missed deadline | the time since the tick before |
/// | stale set-point | the age of the set-point |
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Fault {
    /// The part that has the fault.
    pub place: FaultPlace,
    /// The quantity of the value.
    pub quantity: FaultQuantity,
    /// The kind of fault.
    pub code: FaultCode,
    /// The value of the sample that made it a fault.
    pub value: f64,
    /// The requirement that the value did not meet, by the limits when the fault occurred.
    pub allowed: Requirement,
}
