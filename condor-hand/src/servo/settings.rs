use super::{PositionLaw, SoftStop};
use crate::Real;
use crate::dynamics::DriveDynamics;
use crate::number::{NumberError, Requirement, check, finite, not_negative};
use crate::tendon::{Pair, TensionAllocation, TensionGains};

/// The gains of a joint, which can be changed while the joint runs.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(bound(deserialize = "T: Real + Default + serde::Deserialize<'de>"))]
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

/// The cutoffs of the filters of a joint, Hz; `None` means no filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct JointCutoffs<T> {
    pub(crate) position: Option<T>,
    pub(crate) velocity: T,
    pub(crate) tension: Pair<Option<T>>,
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
