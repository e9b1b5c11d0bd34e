use thiserror::Error;

use super::{PositionLaw, SoftStop};
use crate::Real;
use crate::decimal::Decimal;
use crate::dynamics::DriveDynamics;
use crate::number::{NumberError, Requirement, check, finite, not_negative};
use crate::tendon::{Pair, TensionAllocation, TensionGains};

/// The gains of a joint, which can be changed while the joint runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointGains<T: Real = f64> {
    /// The law by which it follows positions.
    pub law: PositionLaw<T>,
    /// The fraction of the torque error (desired less measured) that is added to a torque.
    pub k_torque: T,
    /// The gains of its tendons' servos.
    pub tension: Pair<TensionGains<T>>,
}

/// All settings of the servo of one joint: gains, limits and filters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSettings<T: Real = f64> {
    /// The settings that can be changed while it runs.
    pub gains: JointGains<T>,
    /// Its limits, with their soft stops.
    pub stop: SoftStop<T>,
    /// The way in which a torque becomes two tensions.
    pub allocation: TensionAllocation<T>,
    /// The greatest change of its rate from one tick to the next, rad/s; a reading with a greater
    /// change is implausible.
    pub rate_change: T,
    /// The resolution of its sensor, rad.
    pub resolution_rad: T,
    /// The distance that the joint and its target may go while its sensor shows no change, rad;
    /// after that the sensor counts as frozen. It must be more than friction can hold back.
    pub frozen_rad: T,
    /// The cutoff of a low-pass filter of the position, before everything else, Hz; `None` means no
    /// filter.
    pub position_cutoff_hz: Option<T>,
    /// The cutoff of the filter that differentiates its position, Hz.
    pub velocity_cutoff_hz: T,
    /// The cutoffs of low-pass filters of the measured tensions, Hz; `None` means no filter.
    pub tension_cutoff_hz: Pair<Option<T>>,
}

/// All settings of a [`FingerServo`](super::FingerServo), except for its mechanism and its moment
/// arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerSettings<T: Real, const N: usize> {
    /// The joints, proximal first.
    pub joints: [JointSettings<T>; N],
    /// The inertia and friction of the drives, for feed-forward.
    pub drive: DriveDynamics<T, N>,
    /// The rate of the servo's ticks, Hz.
    pub sample_hz: T,
    /// The time over which a step of tensions is spread when a mode or gains change, and over which the
    /// mean tensions of a joint are taken that a change of mode keeps, s.
    pub transition_s: T,
}

/// The reason why a servo refuses settings or a target.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SettingError {
    /// The finger does not have the joint.
    #[error("there is no joint {joint}; the finger has {joints}, from 0")]
    NoJoint {
        /// The joint that was named.
        joint: usize,
        /// The number of joints.
        joints: usize,
    },
    /// The finger rests after a fault, or is on its way to rest.
    #[error("the finger rests after a fault, which must be cleared first")]
    AfterFault,
    /// A number of the joint is not possible.
    #[error("joint {joint}: {error}")]
    Joint {
        /// The joint, from 0.
        joint: usize,
        /// The number.
        error: NumberError,
    },
    /// A number of the whole finger is not possible.
    #[error(transparent)]
    Finger(#[from] NumberError),
    /// The joint cannot have the target.
    #[error(transparent)]
    Target(#[from] TargetError),
}

/// A target that is beyond the limits of a joint or of its tendons.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "joint {joint} cannot have the {quantity} {} {unit}; it can have {} {unit} to {} {unit}",
    Decimal(*.value),
    Decimal(*.low),
    Decimal(*.high),
    quantity = .quantity.name(),
    unit = .quantity.unit(),
)]
pub struct TargetError {
    /// The joint, from 0.
    pub joint: u32,
    /// The quantity of the target that is out of its limits.
    pub quantity: TargetQuantity,
    /// The value that was asked for, in the unit of the quantity.
    pub value: f64,
    /// The least value that is possible, in the same unit.
    pub low: f64,
    /// The greatest value that is possible, in the same unit.
    pub high: f64,
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

impl<T: Real> JointGains<T> {
    /// Checks that the law's numbers are possible.
    pub(super) fn check(&self) -> Result<(), NumberError> {
        match self.law {
            PositionLaw::Pd {
                kp,
                kv,
                ki,
                integral_nm,
            } => {
                not_negative("kp", kp)?;
                not_negative("kv", kv)?;
                not_negative("ki", ki)?;
                not_negative("the limit of the integral", integral_nm)?;
            }
            PositionLaw::ComputedTorque {
                bandwidth_hz,
                damping_ratio,
            } => {
                not_negative("the bandwidth, Hz,", bandwidth_hz)?;
                not_negative("the damping ratio", damping_ratio)?;
            }
        }
        not_negative("the torque gain", self.k_torque)
    }
}

impl<T: Real> SoftStop<T> {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        finite("the lower limit, rad,", self.low)?;
        let above = Requirement::AtLeast(self.low.to_f64());
        check("the upper limit, rad,", self.high, above)?;
        not_negative("the zone of a stop, rad,", self.zone)?;
        not_negative("the bandwidth of a stop, Hz,", self.bandwidth_hz)?;
        not_negative("the damping ratio of a stop", self.damping_ratio)
    }
}
