use thiserror::Error;

use crate::decimal::Decimal;
use crate::number::NumberError;

/// The reason why a servo, or the processor that runs it, refuses a request. Fingers and joints are counted from
/// 0.
#[derive(Clone, Copy, Debug, PartialEq, Error, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum ServoRefusal {
    /// The processor does not serve the finger.
    #[error("the processor does not serve finger {finger}, counted from 0")]
    NoFinger {
        /// The finger that was named.
        finger: u32,
        /// The fingers of the hand that it serves: bit *i* stands for finger *i*.
        served: u32,
    },
    /// The finger does not have the joint, or the request allows only one joint.
    #[error("there is no joint {joint}; the finger has {joints}, numbered from 0")]
    NoJoint {
        /// The joint that was named.
        joint: u32,
        /// The number of joints.
        joints: u32,
    },
    /// The finger does not have the actuator.
    #[error("there is no actuator {actuator}; the finger has {actuators}, numbered from 0")]
    NoActuator {
        /// The actuator that was named.
        actuator: u32,
        /// The number of actuators.
        actuators: u32,
    },
    /// The effort is beyond the limits of the actuator.
    #[error(
        "actuator {actuator} cannot have the effort {value}; it can have {low} to {high}",
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Effort {
        /// The number of the actuator in the finger.
        actuator: u32,
        /// The effort that was asked for, N or N m.
        value: f64,
        /// The least effort that is possible, N or N m.
        low: f64,
        /// The greatest effort that is possible, N or N m.
        high: f64,
    },
    /// The finger rests after a fault, or is on its way to rest.
    #[error("the finger rests after a fault; enable it first")]
    AfterFault,
    /// The target is beyond the limits of the joint or of its actuators.
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
    /// A rate of the target is not finite.
    #[error(
        "the {quantity} of joint {joint} cannot be {value} {unit}; it must be finite",
        quantity = .quantity.name(),
        unit = .quantity.unit(),
        value = Decimal(*.value),
    )]
    Rate {
        /// The number of the joint, counted from the palm.
        joint: u32,
        /// The quantity of the target that is not finite.
        quantity: TargetQuantity,
        /// The value that was asked for, in the unit of the quantity.
        value: f64,
    },
    /// No joint can have a gain. No message asks for gains, so none has this refusal.
    // The last one: serde counts it when it writes, and not when it reads.
    #[error(transparent)]
    #[serde(skip)]
    Gain(#[from] NumberError),
}

impl ServoRefusal {
    /// Returns the refusal of a joint that a finger with this number of joints does not have.
    #[must_use]
    pub const fn no_joint(joint: usize, joints: usize) -> Self {
        Self::NoJoint {
            joint: joint as u32,
            joints: joints as u32,
        }
    }

    /// Returns the refusal of an actuator that a finger with this number of actuators does not have.
    #[must_use]
    pub const fn no_actuator(actuator: usize, actuators: usize) -> Self {
        Self::NoActuator {
            actuator: actuator as u32,
            actuators: actuators as u32,
        }
    }
}

/// The quantity of a [`JointTarget`](super::JointTarget) that exceeds its limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum TargetQuantity {
    /// The torque of a joint, N m.
    Torque,
    /// The position of a joint, rad.
    Position,
    /// The stiffness of a joint, N m/rad.
    Stiffness,
    /// The damping of a joint, N m s/rad.
    Damping,
    /// The velocity of a joint, rad/s.
    Velocity,
    /// The acceleration of a joint, rad/s².
    Acceleration,
}

impl TargetQuantity {
    /// Returns the name of the quantity, for messages to people.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Torque => "torque",
            Self::Position => "position",
            Self::Stiffness => "stiffness",
            Self::Damping => "damping",
            Self::Velocity => "velocity",
            Self::Acceleration => "acceleration",
        }
    }

    /// Returns the unit in which the quantity is given.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Torque => "N m",
            Self::Position => "rad",
            Self::Stiffness => "N m/rad",
            Self::Damping => "N m s/rad",
            Self::Velocity => "rad/s",
            Self::Acceleration => "rad/s²",
        }
    }
}
