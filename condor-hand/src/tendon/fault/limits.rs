use thiserror::Error;

use super::{Channel, FaultCode};
use crate::math::{Real, is_finite};
use crate::tendon::Pair;

/// A value, and for how many samples in a row it must be passed; no samples switch the check off.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Threshold<T> {
    /// What must not be passed.
    pub value: T,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// Where a value must be, and for how many samples in a row it must be elsewhere; no samples switch
/// the check off.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Range<T> {
    /// The lowest good value.
    pub low: T,
    /// The highest good value.
    pub high: T,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// When a sensor is stuck: it stays within `band` of a value for so many samples in a row in which
/// the set-point is more than `travel` from where it was when the sensor came there. No samples
/// switch the check off.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Stuck<T> {
    /// How far a stuck sensor still moves, by noise.
    pub band: T,
    /// How far a set-point goes that moves a good sensor.
    pub travel: T,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// What is asked of any sensor.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SensorLimits<T> {
    /// After how many samples in a row that are not finite; none switch the check off.
    pub not_finite_samples: u16,
    /// What the sensor can measure.
    pub range: Range<T>,
    /// When it is stuck.
    pub stuck: Stuck<T>,
    /// The largest distance from what is desired.
    pub tracking: Threshold<T>,
}

/// What is asked of a tendon, N.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TendonLimits<T> {
    /// Of its sensor.
    pub sensor: SensorLimits<T>,
    /// A tendon that pulls less is slack or broken.
    pub slack: Threshold<T>,
    /// A tendon that pulls more may break.
    pub over_tension: Threshold<T>,
}

/// What is asked of a joint, rad.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointLimits<T> {
    /// Of its sensor.
    pub sensor: SensorLimits<T>,
    /// Where the joint may be.
    pub limit: Range<T>,
}

/// What is asked of a finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerLimits<T, const N: usize> {
    /// Of the tendons of each joint.
    pub tendons: [Pair<TendonLimits<T>>; N],
    /// Of each joint.
    pub joints: [JointLimits<T>; N],
    /// The longest time between two ticks, s.
    pub period_s: Threshold<T>,
    /// The greatest age of a set-point, s.
    pub set_point_age_s: Threshold<T>,
}

/// Limits by which nothing can be judged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum LimitsError {
    /// A threshold that is negative or not finite.
    #[error("{channel}: the threshold of '{code}' is {value}; it must be finite and not negative")]
    Threshold {
        /// Where.
        channel: Channel,
        /// Of what.
        code: FaultCode,
        /// The threshold.
        value: f64,
    },
    /// A range that is not finite or not in order.
    #[error("{channel}: the range of '{code}' is {low}..={high}; it must be finite and in order")]
    Range {
        /// Where.
        channel: Channel,
        /// Of what.
        code: FaultCode,
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
}

impl<T: Real, const N: usize> FingerLimits<T, N> {
    /// Refuses limits by which nothing can be judged, also those of checks that are switched off.
    ///
    /// # Errors
    /// The first limit that is not finite, negative, or out of order.
    pub fn check(&self) -> Result<(), LimitsError> {
        for (joint, (tendons, limits)) in self.tendons.iter().zip(&self.joints).enumerate() {
            let channels = Channel::tendons(joint);
            tendons.flexor.check(channels.flexor)?;
            tendons.extensor.check(channels.extensor)?;
            limits.check(Channel::Joint(joint))?;
        }
        let finger = Channel::Finger;
        threshold(finger, FaultCode::MissedDeadline, self.period_s.value)?;
        threshold(finger, FaultCode::StaleSetPoint, self.set_point_age_s.value)
    }
}

impl<T: Real> TendonLimits<T> {
    fn check(&self, channel: Channel) -> Result<(), LimitsError> {
        self.sensor.check(channel)?;
        threshold(channel, FaultCode::Slack, self.slack.value)?;
        threshold(channel, FaultCode::OverTension, self.over_tension.value)
    }
}

impl<T: Real> JointLimits<T> {
    fn check(&self, channel: Channel) -> Result<(), LimitsError> {
        self.sensor.check(channel)?;
        range(channel, FaultCode::JointLimit, &self.limit)
    }
}

impl<T: Real> SensorLimits<T> {
    fn check(&self, channel: Channel) -> Result<(), LimitsError> {
        range(channel, FaultCode::OutOfRange, &self.range)?;
        threshold(channel, FaultCode::Stuck, self.stuck.band)?;
        threshold(channel, FaultCode::Stuck, self.stuck.travel)?;
        threshold(channel, FaultCode::Tracking, self.tracking.value)
    }
}

fn threshold<T: Real>(channel: Channel, code: FaultCode, value: T) -> Result<(), LimitsError> {
    if is_finite(value) && value >= T::zero() {
        return Ok(());
    }
    let value = value.to_f64();
    Err(LimitsError::Threshold {
        channel,
        code,
        value,
    })
}

fn range<T: Real>(channel: Channel, code: FaultCode, range: &Range<T>) -> Result<(), LimitsError> {
    if is_finite(range.low) && is_finite(range.high) && range.low <= range.high {
        return Ok(());
    }
    Err(LimitsError::Range {
        channel,
        code,
        low: range.low.to_f64(),
        high: range.high.to_f64(),
    })
}
