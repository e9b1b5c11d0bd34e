use thiserror::Error;

use super::{FaultCode, FaultSite};
use crate::decimal::Decimal;
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
pub struct SensorFaultLimits<T> {
    /// After how many samples in a row that are not finite, or cannot be; none switch the check off.
    pub lost_samples: u16,
    /// What the sensor can measure.
    pub range: Range<T>,
    /// When it is stuck.
    pub stuck: Stuck<T>,
    /// The largest distance from what is desired.
    pub tracking: Threshold<T>,
}

/// What is asked of a tendon, N.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TendonFaultLimits<T> {
    /// Of its sensor.
    pub sensor: SensorFaultLimits<T>,
    /// A tendon that pulls less is slack or broken.
    pub slack: Threshold<T>,
    /// A tendon that pulls more may break.
    pub over_tension: Threshold<T>,
}

/// What is asked of a joint, rad.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointFaultLimits<T> {
    /// Of its sensor.
    pub sensor: SensorFaultLimits<T>,
    /// Where the joint may be.
    pub limit: Range<T>,
}

/// What is asked of a finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultLimits<T, const N: usize> {
    /// Of the tendons of each joint.
    pub tendons: [Pair<TendonFaultLimits<T>>; N],
    /// Of each joint.
    pub joints: [JointFaultLimits<T>; N],
    /// The longest time between two ticks, s; one that is several times as long counts as so many
    /// samples.
    pub period_s: Threshold<T>,
    /// The greatest age of a set-point, s.
    pub set_point_age_s: Threshold<T>,
}

/// Limits by which nothing can be judged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FaultLimitsError {
    /// A threshold that is negative or not finite.
    #[error(
        "{site}: the threshold of '{code}' is {value}; it must be finite and not negative",
        value = Decimal(*.value),
    )]
    Threshold {
        /// Where.
        site: FaultSite,
        /// Of what.
        code: FaultCode,
        /// The threshold.
        value: f64,
    },
    /// A range that is not finite or not in order.
    #[error(
        "{site}: the range of '{code}' is {low}..={high}; it must be finite and in order",
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Range {
        /// Where.
        site: FaultSite,
        /// Of what.
        code: FaultCode,
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
}

impl<T: Real, const N: usize> FaultLimits<T, N> {
    /// Refuses limits by which nothing can be judged, also those of checks that are switched off.
    ///
    /// # Errors
    /// The first limit that is not finite, negative, or out of order.
    pub fn check(&self) -> Result<(), FaultLimitsError> {
        for (joint, (tendons, limits)) in self.tendons.iter().zip(&self.joints).enumerate() {
            let sites = FaultSite::tendons(joint);
            tendons.flexor.check(sites.flexor)?;
            tendons.extensor.check(sites.extensor)?;
            limits.check(FaultSite::Joint(joint))?;
        }
        let finger = FaultSite::Finger;
        threshold(finger, FaultCode::MissedDeadline, self.period_s.value)?;
        threshold(finger, FaultCode::StaleSetPoint, self.set_point_age_s.value)
    }
}

impl<T: Real> TendonFaultLimits<T> {
    fn check(&self, site: FaultSite) -> Result<(), FaultLimitsError> {
        self.sensor.check(site)?;
        threshold(site, FaultCode::Slack, self.slack.value)?;
        threshold(site, FaultCode::OverTension, self.over_tension.value)
    }
}

impl<T: Real> JointFaultLimits<T> {
    fn check(&self, site: FaultSite) -> Result<(), FaultLimitsError> {
        self.sensor.check(site)?;
        range(site, FaultCode::JointLimit, &self.limit)
    }
}

impl<T: Real> SensorFaultLimits<T> {
    fn check(&self, site: FaultSite) -> Result<(), FaultLimitsError> {
        range(site, FaultCode::OutOfRange, &self.range)?;
        threshold(site, FaultCode::Stuck, self.stuck.band)?;
        threshold(site, FaultCode::Stuck, self.stuck.travel)?;
        threshold(site, FaultCode::Tracking, self.tracking.value)
    }
}

fn threshold<T: Real>(site: FaultSite, code: FaultCode, value: T) -> Result<(), FaultLimitsError> {
    if is_finite(value) && value >= T::zero() {
        return Ok(());
    }
    let value = value.to_f64();
    Err(FaultLimitsError::Threshold { site, code, value })
}

fn range<T: Real>(
    site: FaultSite,
    code: FaultCode,
    range: &Range<T>,
) -> Result<(), FaultLimitsError> {
    if is_finite(range.low) && is_finite(range.high) && range.low <= range.high {
        return Ok(());
    }
    Err(FaultLimitsError::Range {
        site,
        code,
        low: range.low.to_f64(),
        high: range.high.to_f64(),
    })
}
