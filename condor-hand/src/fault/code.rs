use crate::Subject;
use crate::fault_code::FaultCode;

/// The part of a finger that has a fault. Joints are counted from 0 at the palm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum FaultSite {
    /// The actuator of this number.
    Actuator(usize),
    /// The joint itself, by its number.
    Joint(usize),
    /// The finger as a whole.
    Finger,
}

impl FaultSite {
    /// The check for this kind of fault here, as errors name it.
    pub(super) const fn check(self, code: FaultCode) -> Subject {
        match self {
            Self::Actuator(actuator) => Subject::ActuatorCheck(actuator as u16, code),
            Self::Joint(joint) => Subject::JointCheck(joint as u16, code),
            Self::Finger => Subject::FingerCheck(code),
        }
    }
}

/// A fault of a finger: its kind, the part that has it, and the value that showed it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FingerFault {
    /// The kind of fault.
    pub code: FaultCode,
    /// The site of the fault.
    pub site: FaultSite,
    /// The value of the sample that made it a fault: N or N m for an actuator, rad or m for a joint, s for a time;
    /// for [`Tracking`](FaultCode::Tracking), the desired value less the measured one.
    pub value: f64,
}
