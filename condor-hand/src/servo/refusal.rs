use thiserror::Error;

use crate::decimal::Decimal;
use crate::number::NumberError;

/// The rates of a target, as their errors name them, in the order in which messages number them.
#[cfg(feature = "mbox")]
pub(crate) const RATES: [&str; 2] = [VELOCITY, ACCELERATION];
pub(super) const VELOCITY: &str = "the velocity, rad/s,";
pub(super) const ACCELERATION: &str = "the acceleration, rad/s²,";

/// The reason why a servo, or the processor that runs it, refuses a request. Fingers and joints are counted from
/// 0. It crosses messages unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ServoRefusal {
    /// The operation of a message does not exist.
    #[error("there is no operation {operation}")]
    Operation {
        /// The number of the operation.
        operation: u32,
    },
    /// The processor does not serve the finger.
    #[error("the processor does not serve finger {finger}, counted from 0")]
    NoFinger {
        /// The finger that was named.
        finger: u32,
        /// The fingers of the hand that it serves: bit *i* stands for finger *i*.
        served: u32,
    },
    /// The finger does not have the joint, or the request allows only one joint.
    #[error("there is no joint {joint}; the finger has {joints}, from 0")]
    NoJoint {
        /// The joint that was named.
        joint: u32,
        /// The number of joints.
        joints: u32,
    },
    /// The mode that a message asks for does not exist.
    #[error("there is no mode {mode}")]
    Mode {
        /// The number of the mode.
        mode: u32,
    },
    /// The part of an order that a message asks for does not exist.
    #[error("an order has part 0, the drive, and part 1, the restart, not {part}")]
    Part {
        /// The number of the part.
        part: u32,
    },
    /// The finger rests after a fault, or is on its way to rest.
    #[error("the finger rests after a fault; enable it first")]
    AfterFault,
    /// The target is beyond the limits of the joint or of its tendons.
    #[error(
        "joint {joint} cannot have the {quantity} {value} {unit}; it can have {low} {unit} to {high} {unit}",
        quantity = .quantity.name(),
        unit = .quantity.unit(),
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Target {
        /// The number of the joint, counted from the palm.
        joint: u32,
        /// The quantity of the target that is out of its limits.
        quantity: TargetQuantity,
        /// The value that was asked for, in the unit of the quantity.
        value: f64,
        /// The least value that is possible, in the same unit.
        low: f64,
        /// The greatest value that is possible, in the same unit.
        high: f64,
    },
    /// A gain, or a rate of the target, is not possible.
    #[error(transparent)]
    Number(#[from] NumberError),
}

pub(crate) const fn no_joint(joint: usize, joints: usize) -> ServoRefusal {
    ServoRefusal::NoJoint {
        joint: joint as u32,
        joints: joints as u32,
    }
}

/// The quantity of a [`JointTarget`](super::JointTarget) that exceeds its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum TargetQuantity {
    /// The tension of a tendon, N.
    Tension = 0,
    /// The torque of a joint, N m.
    Torque = 1,
    /// The position of a joint, rad.
    Position = 2,
    /// The stiffness of a joint, N m/rad.
    Stiffness = 3,
    /// The damping of a joint, N m s/rad.
    Damping = 4,
}

impl TargetQuantity {
    /// Returns the quantity that has this number in messages; `None` if there is none.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::Tension),
            1 => Some(Self::Torque),
            2 => Some(Self::Position),
            3 => Some(Self::Stiffness),
            4 => Some(Self::Damping),
            _ => None,
        }
    }

    /// Returns the name of the quantity, for messages to people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tension => "tension",
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Stiffness => "stiffness",
            Self::Damping => "damping",
        }
    }

    /// Returns the unit in which the quantity is given.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Tension => "N",
            Self::Torque => "N m",
            Self::Position => "rad",
            Self::Stiffness => "N m/rad",
            Self::Damping => "N m s/rad",
        }
    }
}
