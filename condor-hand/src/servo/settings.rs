use thiserror::Error;

use super::{PositionLaw, SoftStop};
use crate::control::{FilterError, PidError};
use crate::decimal::Decimal;
use crate::dynamics::Drive;
use crate::math::{Real, is_finite};
use crate::tendon::{Allocation, AllocationError, Pair, TensionGains, TensionServoError};

/// The settings that can be changed while a joint runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointGains<T: Real = f64> {
    /// The law by which it follows positions.
    pub law: PositionLaw<T>,
    /// The fraction of the torque error (desired less measured) that is added to a torque.
    pub k_torque: T,
    /// The gains of its tendons' servos.
    pub tension: Pair<TensionGains<T>>,
}

/// All settings of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSettings<T: Real = f64> {
    /// The settings that can be changed while it runs.
    pub gains: JointGains<T>,
    /// Its limits, with their soft stops.
    pub stop: SoftStop<T>,
    /// The way in which a torque becomes two tensions.
    pub allocation: Allocation<T>,
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

/// All settings of one finger, except its mechanism and its arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerSettings<T: Real, const N: usize> {
    /// The joints, proximal first.
    pub joints: [JointSettings<T>; N],
    /// The inertia and friction of the drives, for feed-forward.
    pub drive: Drive<T, N>,
    /// Ticks in a second, Hz.
    pub sample_hz: T,
    /// The time over which a step of tensions is spread when a mode or gains change, s.
    pub transition_s: T,
}

/// The reason for which a servo refuses settings or a target.
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
    /// A number is not finite, or negative although it must not be.
    #[error("joint {joint} cannot have {value} as {what}", value = Decimal(*.value))]
    Value {
        /// The joint, from 0.
        joint: usize,
        /// The quantity.
        what: &'static str,
        /// The number.
        value: f64,
    },
    /// A number of the whole finger is not finite or not positive.
    #[error("a finger cannot have {value} as {what}", value = Decimal(*.value))]
    Finger {
        /// The quantity.
        what: &'static str,
        /// The number.
        value: f64,
    },
    /// The position is beyond the limits of the joint.
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
    /// The torque is beyond what its tendons can produce.
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
    /// The tension is beyond the limits of the tendon.
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
    /// No filter has this cutoff.
    #[error("joint {joint}: {error}")]
    Filter {
        /// The joint, from 0.
        joint: usize,
        /// The error.
        error: FilterError,
    },
    /// The limit of an integral is wrong.
    #[error("joint {joint}: {error}")]
    Integral {
        /// The joint, from 0.
        joint: usize,
        /// The error.
        error: PidError,
    },
    /// The allocation is wrong.
    #[error("joint {joint}: {error}")]
    Allocation {
        /// The joint, from 0.
        joint: usize,
        /// The error.
        error: AllocationError,
    },
    /// The gains of a tendon's servo are wrong.
    #[error("joint {joint}: {error}")]
    TensionServo {
        /// The joint, from 0.
        joint: usize,
        /// The error.
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
