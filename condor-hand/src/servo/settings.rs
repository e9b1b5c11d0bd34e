use super::{EffortGains, PositionLaw, SoftStop};
use heapless::Vec;

use crate::dynamics::DriveDynamics;
use crate::number::{NumberError, Requirement, check, finite, not_negative};

/// The gains of a joint, which can be changed while the joint runs.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointGains {
    /// The law by which it follows positions.
    pub law: PositionLaw,
    /// The fraction of the torque error (desired less measured) that is added to a torque, if sensors measure the efforts of
    /// all actuators of the joint.
    pub k_torque: f64,
}

/// All settings of the servo of one joint: gains, limits and filters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointSettings {
    /// The settings that can be changed while it runs.
    pub gains: JointGains,
    /// Its limits, with their soft stops.
    pub stop: SoftStop,
    /// The greatest change of its rate from one tick to the next, rad/s; a reading with a greater
    /// change is implausible.
    pub rate_change: f64,
    /// The resolution of its sensor, rad.
    pub resolution_rad: f64,
    /// The distance that the joint and its target may go while its sensor shows no change, rad;
    /// after that the sensor counts as frozen. It must be more than friction can hold back.
    pub frozen_rad: f64,
    /// The cutoff of a low-pass filter of the position, before everything else, Hz; `None` means no
    /// filter.
    pub position_cutoff_hz: Option<f64>,
    /// The cutoff of the filter that differentiates its position, Hz.
    pub velocity_cutoff_hz: f64,
}

/// All settings of the servo of one actuator, except for the limits of its effort.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorSettings {
    /// The gains of its servo, which can be changed while it runs.
    pub gains: EffortGains,
    /// True if a sensor measures its effort. Without one the command is the desired effort, less the damping of
    /// [`EffortGains::kv`], and the desired effort counts as the measured one.
    pub is_sensed: bool,
    /// The cutoff of a low-pass filter of the measured effort, Hz; `None` means no filter.
    pub cutoff_hz: Option<f64>,
}

/// The cutoffs of the filters of a joint, Hz; `None` means no filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct JointCutoffs {
    pub(crate) position: Option<f64>,
    pub(crate) velocity: f64,
}

/// All settings of a [`FingerServo`](super::FingerServo), except for its mechanism and its transmission.
#[derive(Clone, Debug, PartialEq)]
pub struct FingerSettings<const N: usize, const A: usize> {
    /// The joints that the finger has, proximal first.
    pub joints: Vec<JointSettings, N>,
    /// The actuators that it has, in the order of the transmission.
    pub actuators: Vec<ActuatorSettings, A>,
    /// The inertia and friction of the drives, for feed-forward.
    pub drive: DriveDynamics<N>,
    /// The rate of the servo's ticks, Hz.
    pub sample_hz: f64,
    /// The time over which a step of efforts is spread when a mode or gains change, and over which the
    /// mean efforts of a joint are taken that a change of mode keeps, s.
    pub transition_s: f64,
}

impl JointGains {
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

impl SoftStop {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        finite("the lower limit, rad,", self.low)?;
        let above = Requirement::AtLeast(self.low);
        check("the upper limit, rad,", self.high, above)?;
        not_negative("the zone of a stop, rad,", self.zone)?;
        not_negative("the bandwidth of a stop, Hz,", self.bandwidth_hz)?;
        not_negative("the damping ratio of a stop", self.damping_ratio)
    }
}
