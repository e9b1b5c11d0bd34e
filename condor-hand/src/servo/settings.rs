use thiserror::Error;

use super::{PositionLaw, SoftStop};
use crate::control::{FilterError, PidError};
use crate::decimal::Decimal;
use crate::dynamics::Drive;
use crate::math::{Real, is_finite};
use crate::tendon::{Allocation, AllocationError, Pair, TensionGains, TensionServoError};

/// What can be tuned while a joint runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointGains<T: Real = f64> {
    /// How it follows positions.
    pub law: PositionLaw<T>,
    /// How much of the difference between asked-for and measured torque is added to a torque.
    pub k_torque: T,
    /// The servos of its tendons.
    pub tension: Pair<TensionGains<T>>,
}

/// All of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSettings<T: Real = f64> {
    /// What can be tuned.
    pub gains: JointGains<T>,
    /// Its limits, and how it is kept within.
    pub stop: SoftStop<T>,
    /// How a torque becomes two tensions.
    pub allocation: Allocation<T>,
    /// By how much its rate changes at most from one tick to the next, rad/s: a reading that is farther off
    /// is none.
    pub rate_change: T,
    /// What its sensor tells apart, rad.
    pub resolution_rad: T,
    /// A sensor that shows no change while its joint went, and was to go, farther than this, rad, shows
    /// nothing at all: more than friction can hold back.
    pub frozen_rad: T,
    /// A low-pass filter before everything else, Hz.
    pub position_cutoff_hz: Option<T>,
    /// The cutoff of the differentiation of its position, Hz.
    pub velocity_cutoff_hz: T,
    /// Low-pass filters of the tensions that its sensors measure, Hz.
    pub tension_cutoff_hz: Pair<Option<T>>,
}

/// All of one finger but its mechanism and its arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerSettings<T: Real, const N: usize> {
    /// The joints, proximal first.
    pub joints: [JointSettings<T>; N],
    /// The inertia and friction of the drives, fed forward.
    pub drive: Drive<T, N>,
    /// Ticks in a second, Hz.
    pub sample_hz: T,
    /// How long a step of the tensions takes that a change of mode or of gains would make, s.
    pub transition_s: T,
}

/// Settings or targets that a servo does not take.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SettingError {
    /// A joint that the finger does not have.
    #[error("there is no joint {joint}; the finger has {joints}, from 0")]
    NoJoint {
        /// The joint that was named.
        joint: usize,
        /// How many there are.
        joints: usize,
    },
    /// A finger that rests after a fault, or is on its way to rest.
    #[error("the finger rests after a fault, which must be cleared first")]
    AfterFault,
    /// A number that is not finite, or negative where that makes no sense.
    #[error("joint {joint} cannot have {value} as {what}", value = Decimal(*.value))]
    Value {
        /// The joint, from 0.
        joint: usize,
        /// What the number is.
        what: &'static str,
        /// The number.
        value: f64,
    },
    /// A number of the whole finger that is not finite or not positive.
    #[error("a finger cannot have {value} as {what}", value = Decimal(*.value))]
    Finger {
        /// What the number is.
        what: &'static str,
        /// The number.
        value: f64,
    },
    /// A position beyond the limits of the joint.
    #[error(
        "joint {joint} cannot go to {position} rad; its limits are {low} rad and {high} rad",
        position = Decimal(*.position),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Position {
        /// The joint, from 0.
        joint: usize,
        /// The position that was asked for, rad.
        position: f64,
        /// The lower limit, rad.
        low: f64,
        /// The upper limit, rad.
        high: f64,
    },
    /// A torque beyond what its tendons can give.
    #[error(
        "joint {joint} cannot give {torque} N m; its tendons give {low} N m to {high} N m",
        torque = Decimal(*.torque),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Torque {
        /// The joint, from 0.
        joint: usize,
        /// The torque that was asked for, N m.
        torque: f64,
        /// The least, N m.
        low: f64,
        /// The most, N m.
        high: f64,
    },
    /// A tension beyond what the tendon may have.
    #[error(
        "a tendon of joint {joint} cannot have {tension} N; it has {low} N to {high} N",
        tension = Decimal(*.tension),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Tension {
        /// The joint, from 0.
        joint: usize,
        /// The tension that was asked for, N.
        tension: f64,
        /// The least, N.
        low: f64,
        /// The most, N.
        high: f64,
    },
    /// A cutoff that no filter has.
    #[error("joint {joint}: {error}")]
    Filter {
        /// The joint, from 0.
        joint: usize,
        /// What is wrong.
        error: FilterError,
    },
    /// A limit of an integral that none has.
    #[error("joint {joint}: {error}")]
    Integral {
        /// The joint, from 0.
        joint: usize,
        /// What is wrong.
        error: PidError,
    },
    /// An allocation that cannot be.
    #[error("joint {joint}: {error}")]
    Allocation {
        /// The joint, from 0.
        joint: usize,
        /// What is wrong.
        error: AllocationError,
    },
    /// Gains that no servo of a tendon has.
    #[error("joint {joint}: {error}")]
    TensionServo {
        /// The joint, from 0.
        joint: usize,
        /// What is wrong.
        error: TensionServoError,
    },
}

impl<T: Real> JointGains<T> {
    /// Whether the law's numbers make sense, for the joint of this number.
    pub(super) fn check(&self, joint: usize) -> Result<(), SettingError> {
        let named = match self.law {
            PositionLaw::Pd {
                kp,
                kv,
                ki,
                integral_nm,
            } => [
                ("kp", kp),
                ("kv", kv),
                ("ki", ki),
                ("the limit of the integral", integral_nm),
            ],
            PositionLaw::ComputedTorque {
                bandwidth_hz,
                damping_ratio,
            } => [
                ("bandwidth, Hz", bandwidth_hz),
                ("damping ratio", damping_ratio),
                ("", T::zero()),
                ("", T::zero()),
            ],
        };
        for (what, value) in named.into_iter().chain([("torque gain", self.k_torque)]) {
            if !is_finite(value) || value < T::zero() {
                let value = value.to_f64();
                return Err(SettingError::Value { joint, what, value });
            }
        }
        Ok(())
    }
}

impl<T: Real> SoftStop<T> {
    pub(super) fn check(&self, joint: usize) -> Result<(), SettingError> {
        let named = [
            ("lower limit, rad", self.low, self.high >= self.low),
            ("upper limit, rad", self.high, true),
            ("zone of a stop, rad", self.zone, self.zone >= T::zero()),
            (
                "bandwidth of a stop, Hz",
                self.bandwidth_hz,
                self.bandwidth_hz >= T::zero(),
            ),
            (
                "damping ratio of a stop",
                self.damping_ratio,
                self.damping_ratio >= T::zero(),
            ),
        ];
        for (what, value, sensible) in named {
            if !is_finite(value) || !sensible {
                let value = value.to_f64();
                return Err(SettingError::Value { joint, what, value });
            }
        }
        Ok(())
    }
}
