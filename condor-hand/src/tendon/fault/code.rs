use crate::Subject;
use crate::fault_code::FaultCode;
use crate::tendon::Pair;

/// The part of a finger that has a fault. Joints are counted from 0 at the palm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
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
        match self {
            Self::Flexor(joint) => Subject::FlexorCheck(joint as u16, code),
            Self::Extensor(joint) => Subject::ExtensorCheck(joint as u16, code),
            Self::Joint(joint) => Subject::JointCheck(joint as u16, code),
            Self::Finger => Subject::FingerCheck(code),
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

/// A fault of a finger: its kind, the part that has it, and the value that showed it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FingerFault {
    /// The kind of fault.
    pub code: FaultCode,
    /// The site of the fault.
    pub site: FaultSite,
    /// The value of the sample that made it a fault: N for a tendon, rad for a joint, s for a time;
    /// for [`Tracking`](FaultCode::Tracking), the desired value less the measured one.
    pub value: f64,
}
