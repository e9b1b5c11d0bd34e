use super::{FaultCode, FaultPlace};
use crate::number::{NumberError, Requirement, check, finite, not_negative};

/// A limit of a value. The value has a fault once it is beyond the limit in `samples` samples in a
/// row; 0 samples switch the check off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Threshold {
    /// The limit of the value.
    pub value: f64,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// The good range of a value. The value has a fault once it is outside of the range in `samples`
/// samples in a row; 0 samples switch the check off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultRange {
    /// The lowest good value.
    pub low: f64,
    /// The highest good value.
    pub high: f64,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// The conditions under which a sensor counts as stuck: its reading stays the same although its
/// set-point moves away.
///
/// The sensor has a fault after `samples` samples in a row in which its reading is within `band` of
/// a value, and the set-point is more than `travel` from where it was when the reading reached that
/// value. 0 samples switch the check off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stuck {
    /// The greatest noise of a stuck sensor, in the unit of its reading.
    pub band: f64,
    /// The travel of a set-point after which a good sensor must have moved.
    pub travel: f64,
    /// The samples in a row that make a fault.
    pub samples: u16,
}

/// The limits within which a reading is possible, from where its sensor and its rate were before.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plausible {
    /// The greatest change of the rate from one tick to the next, in the unit of the reading per second. A reading
    /// that needs more has jumped.
    pub rate_change: f64,
    /// The distance by which a reading must have changed when it stands although what it measures goes on.
    pub travel: f64,
}

/// The limits beyond which the sensor of an actuator or a joint has a fault.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorFaultLimits {
    /// The number of samples in a row that are not finite or implausible after which the sensor is
    /// lost; 0 switches the check off.
    pub lost_samples: u16,
    /// The limits within which a reading is possible; unused for efforts.
    pub plausible: Plausible,
    /// The range of the sensor.
    pub range: FaultRange,
    /// The conditions under which it is stuck.
    pub stuck: Stuck,
    /// The greatest distance from the desired value.
    pub tracking: Threshold,
}

/// The limits beyond which an actuator has a fault, N or N m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ActuatorFaultLimits {
    /// The limits of the sensor of its effort.
    pub sensor: SensorFaultLimits,
    /// The efforts that do no harm. Below them a tendon is slack or broken; above them it may break.
    pub effort: FaultRange,
}

/// The limits beyond which the sensor of the position of an actuator has a fault, rad or m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EncoderFaultLimits {
    /// The limits of the sensor.
    pub sensor: SensorFaultLimits,
    /// A bit for each joint whose position is computed from this sensor.
    pub tells: u32,
    /// The sum of the sizes of its arms: the way of the actuator if each joint that it moves goes by 1.
    pub arms: f64,
}

/// The limits beyond which a joint has a fault, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointFaultLimits {
    /// The limits of its sensor.
    pub sensor: SensorFaultLimits,
    /// The range of the joint.
    pub limit: FaultRange,
}

/// The limits beyond which a finger has a fault: those of its actuators, its joints and its timing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultLimits<const N: usize, const A: usize> {
    /// The limits of each actuator.
    pub actuators: [ActuatorFaultLimits; A],
    /// The limits of the sensor of each actuator's position; `None` for actuators without one.
    pub encoders: [Option<EncoderFaultLimits>; A],
    /// The limits of each joint.
    pub joints: [JointFaultLimits; N],
    /// The longest time between two ticks, s; a time that is *n* times as long counts as *n*
    /// samples.
    pub period_s: Threshold,
    /// The greatest age of a set-point, s.
    pub set_point_age_s: Threshold,
}

impl<const N: usize, const A: usize> FaultLimits<N, A> {
    /// Checks that all limits can be used, including those of checks that are switched off.
    ///
    /// # Errors
    /// [`NumberError`] for the first limit that is not finite, negative, or out of order.
    pub fn check(&self) -> Result<(), NumberError> {
        for (actuator, limits) in self.actuators.iter().enumerate() {
            limits.check(FaultPlace::Actuator(actuator))?;
        }
        for (actuator, limits) in self.encoders.iter().enumerate() {
            if let Some(limits) = limits {
                limits.sensor.check(FaultPlace::Actuator(actuator))?;
            }
        }
        for (joint, limits) in self.joints.iter().enumerate() {
            limits.check(FaultPlace::Joint(joint))?;
        }
        let finger = FaultPlace::Finger;
        threshold(finger, FaultCode::MissedDeadline, self.period_s.value)?;
        threshold(finger, FaultCode::StaleSetPoint, self.set_point_age_s.value)
    }
}

impl ActuatorFaultLimits {
    fn check(&self, place: FaultPlace) -> Result<(), NumberError> {
        self.sensor.check(place)?;
        range(place, FaultCode::LowEffort, &self.effort)
    }
}

impl JointFaultLimits {
    fn check(&self, place: FaultPlace) -> Result<(), NumberError> {
        self.sensor.check(place)?;
        range(place, FaultCode::JointLimit, &self.limit)
    }
}

impl SensorFaultLimits {
    fn check(&self, place: FaultPlace) -> Result<(), NumberError> {
        threshold(place, FaultCode::Jump, self.plausible.rate_change)?;
        threshold(place, FaultCode::Stuck, self.plausible.travel)?;
        range(place, FaultCode::OutOfRange, &self.range)?;
        threshold(place, FaultCode::Stuck, self.stuck.band)?;
        threshold(place, FaultCode::Stuck, self.stuck.travel)?;
        threshold(place, FaultCode::Tracking, self.tracking.value)
    }
}

fn threshold(place: FaultPlace, code: FaultCode, value: f64) -> Result<(), NumberError> {
    not_negative("the threshold", value).map_err(|error| error.at(place.check(code)))
}

fn range(place: FaultPlace, code: FaultCode, range: &FaultRange) -> Result<(), NumberError> {
    let above = Requirement::AtLeast(range.low);
    finite("the lower end", range.low)
        .and_then(|()| check("the upper end", range.high, above))
        .map_err(|error| error.at(place.check(code)))
}
