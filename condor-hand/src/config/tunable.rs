//! The numbers of a description that can change while the robot runs, beside the gains of joints.
//!
//! Each has the key of the description, and a range: within it the robot is as safe as the description says, whatever
//! the other numbers of the list are.

use serde::{Deserialize, Serialize};

use super::check::{LOWER_CUTOFF, cutoff_rules, range};
use super::{Actuator, Axis, AxisServoSettings, FaultPolicy, Finger, Joint, Limits};
use crate::math::{abs, max, min};

/// While the robot runs, a threshold of a fault can be this many times the described one at most. A weaker one is a
/// matter of the description.
const WEAKER: f64 = 4.0;

/// While the robot runs, the limits of a joint's motions can be this part of the described ones at least.
const SLOWER: f64 = 0.01;

/// The greatest gain of the integral of an axis, as a multiple of `kp`, 1/s.
const INTEGRAL: f64 = 10.0;

/// Rounding of strict bounds, as a part of their size.
const MARGIN: f64 = 1e-3;

/// The key of a number in its table of the description, its unit, and a text for people.
pub type NumberName = (&'static str, &'static str, &'static str);

/// The least and the greatest value that a number can have while the robot runs, in its unit.
pub type NumberRange = [f64; 2];

/// A number of a [`Joint`] that can change while the joint runs: limits, soft stops and filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointNumber {
    /// The lowest position.
    Low,
    /// The highest position.
    High,
    /// The width of the zone of a soft stop.
    Zone,
    /// The natural frequency of the joint on the spring of a soft stop.
    StopBandwidth,
    /// The cutoff of the filter of the position.
    PositionCutoff,
    /// The cutoff of the filter that computes the velocity.
    VelocityCutoff,
}

/// The numbers of a joint, in the order of [`JointNumber::ALL`]; 0 for a filter that there is not.
pub(crate) type JointNumbers = [f64; JointNumber::ALL.len()];

impl JointNumber {
    /// All numbers, in the order of their values as `usize`.
    pub const ALL: [Self; 6] = [
        Self::Low,
        Self::High,
        Self::Zone,
        Self::StopBandwidth,
        Self::PositionCutoff,
        Self::VelocityCutoff,
    ];

    /// Returns its key in the table of the joint, its unit, and a text for people. Units are those of a rotating
    /// joint; for a sliding joint read m for rad.
    #[must_use]
    pub const fn name(self) -> &'static NumberName {
        match self {
            Self::Low => &("limits.low", "rad", "Lowest position."),
            Self::High => &("limits.high", "rad", "Highest position."),
            Self::Zone => &("stop.zone", "rad", "Width of the soft stops."),
            Self::StopBandwidth => &("stop.bandwidth_hz", "Hz", "Stiffness of the soft stops."),
            Self::PositionCutoff => &("servo.position_cutoff_hz", "Hz", "Filter of the position."),
            Self::VelocityCutoff => &("servo.velocity_cutoff_hz", "Hz", "Filter of the velocity."),
        }
    }

    /// Returns its value in the description; `None` for a filter that the joint does not have.
    #[must_use]
    pub const fn of(self, joint: &Joint) -> Option<f64> {
        match self {
            Self::Low => Some(joint.limits.low),
            Self::High => Some(joint.limits.high),
            Self::Zone => Some(joint.stop.zone),
            Self::StopBandwidth => Some(joint.stop.bandwidth_hz),
            Self::PositionCutoff => joint.servo.position_cutoff_hz,
            Self::VelocityCutoff => Some(joint.servo.velocity_cutoff_hz),
        }
    }
}

/// A number of an [`Actuator`] that can change while it runs: thresholds of its faults, and its filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ActuatorNumber {
    /// The effort below which there is a fault.
    Below,
    /// The effort above which there is a fault.
    Above,
    /// The cutoff of the filter of the measured effort.
    Cutoff,
}

/// The numbers of an actuator, in the order of [`ActuatorNumber::ALL`]; `None` for one that it does not have.
pub(crate) type ActuatorNumbers = [Option<f64>; ActuatorNumber::ALL.len()];

impl ActuatorNumber {
    /// All numbers, in the order of their values as `usize`.
    pub const ALL: [Self; 3] = [Self::Below, Self::Above, Self::Cutoff];

    /// Returns its key in the table of the actuator, its unit, and a text for people. An effort is in N or N m.
    #[must_use]
    pub const fn name(self) -> &'static NumberName {
        match self {
            Self::Below => &("faults.below", "N", "Below it is a fault."),
            Self::Above => &("faults.above", "N", "Above it is a fault."),
            Self::Cutoff => &("cutoff_hz", "Hz", "Filter of the effort."),
        }
    }

    /// Returns its value in the description; `None` for a threshold or a filter that the actuator does not have.
    #[must_use]
    pub const fn of<const J: usize>(self, actuator: &Actuator<J>) -> Option<f64> {
        match self {
            Self::Below => actuator.faults.below,
            Self::Above => actuator.faults.above,
            Self::Cutoff => actuator.cutoff_hz,
        }
    }
}

impl<const J: usize, const A: usize> Finger<J, A> {
    /// Returns the ranges of the numbers of a joint that can change while it runs, in the order of
    /// [`JointNumber::ALL`]; `None` for a filter, or a joint, that the finger does not have. `rate_hz` is the rate of
    /// its servos.
    ///
    /// * Limits only come nearer, and leave room for the stops: the links, the sensors and the motions are made for
    ///   the described ones.
    /// * Stops only become softer, and filters are as slow as the described stops bear. See
    ///   [`SoftStopSettings`](super::SoftStopSettings).
    /// * A filter that the description leaves out stays out: its lag is a part of what the description's check looks at.
    #[must_use]
    pub fn ranges(
        &self,
        joint: usize,
        rate_hz: u32,
    ) -> [Option<NumberRange>; JointNumber::ALL.len()] {
        let Some(of_joint) = self.joints.get(joint) else {
            return [None; JointNumber::ALL.len()];
        };
        let rules = of_joint.rules();
        let half = 0.5 * (of_joint.limits.high - of_joint.limits.low);
        let nearer = 0.5 * (half - of_joint.stop.zone);
        let slowest = self.slowest_filters(of_joint, rate_hz);
        JointNumber::ALL.map(|number| {
            let value = number.of(of_joint)?;
            let (key, ..) = *number.name();
            let [least, greatest] = match number {
                JointNumber::Low => [value, value + nearer],
                JointNumber::High => [value - nearer, value],
                JointNumber::Zone => {
                    let [least, greatest] = range(&rules, key, 0.0);
                    let wider = (1.0 - MARGIN) * (half - nearer - value);
                    [least, min(greatest, value + wider)]
                }
                JointNumber::StopBandwidth => [range(&rules, key, 0.0)[0], value],
                JointNumber::PositionCutoff | JointNumber::VelocityCutoff => {
                    cutoff_range(value, slowest, rate_hz)
                }
            };
            Some([min(least, value), max(greatest, value)])
        })
    }
}

impl Joint {
    /// Its numbers as the description has them.
    pub(crate) fn numbers(&self) -> JointNumbers {
        JointNumber::ALL.map(|number| number.of(self).unwrap_or(0.0))
    }
}

/// The range of a cutoff, Hz, which is this part of its value at least.
fn cutoff_range(value: f64, part: f64, rate_hz: u32) -> NumberRange {
    let margin = MARGIN * 0.5 * f64::from(rate_hz);
    let [least, greatest] = range(&cutoff_rules("", value, rate_hz), "", margin);
    // The margin is for the upper end, which is half of the rate.
    [max(least - margin, part * value), greatest]
}

impl<const J: usize> Actuator<J> {
    /// Returns the ranges of the numbers that can change while the actuator runs, in the order of
    /// [`ActuatorNumber::ALL`]; `None` for a threshold or a filter that the actuator does not have. `rate_hz` is the
    /// rate of its servo.
    ///
    /// Thresholds differ from the least and the greatest effort by a count of the sensor.
    #[must_use]
    pub fn ranges(&self, rate_hz: u32) -> [Option<NumberRange>; ActuatorNumber::ALL.len()] {
        let (count, [first, last]) = match &self.adc {
            Some(adc) => (abs(adc.gain), [adc.value(0), adc.value(adc.full_scale())]),
            None => (0.0, [self.limits.low, self.limits.high]),
        };
        ActuatorNumber::ALL.map(|number| {
            let value = number.of(self)?;
            let [least, greatest] = match number {
                ActuatorNumber::Below => [min(first, last), self.limits.low - count],
                ActuatorNumber::Above => [self.limits.high + count, max(first, last)],
                ActuatorNumber::Cutoff => cutoff_range(value, LOWER_CUTOFF, rate_hz),
            };
            Some([min(least, value), max(greatest, value)])
        })
    }

    /// Its numbers as the description has them.
    pub(crate) fn numbers(&self) -> ActuatorNumbers {
        ActuatorNumber::ALL.map(|number| number.of(self))
    }
}

/// A number of a [`FaultPolicy`], all of which can change while the robot runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultNumber {
    /// [`FaultPolicy::safe_s`].
    Safe,
    /// [`FaultPolicy::stale_s`].
    Stale,
    /// [`FaultPolicy::frozen_rad`].
    Frozen,
    /// [`FaultPolicy::tracking_rad`].
    Tracking,
    /// [`FaultPolicy::overtravel_rad`].
    Overtravel,
    /// [`FaultPolicy::effort_samples`].
    EffortSamples,
    /// [`FaultPolicy::sensor_samples`].
    SensorSamples,
    /// [`FaultPolicy::lost_samples`].
    LostSamples,
    /// [`FaultPolicy::tracking_samples`].
    TrackingSamples,
    /// [`FaultPolicy::missed_deadlines`].
    MissedDeadlines,
}

impl FaultNumber {
    /// The numbers with a unit: times and angles.
    pub const THRESHOLDS: [Self; 5] = [
        Self::Safe,
        Self::Stale,
        Self::Frozen,
        Self::Tracking,
        Self::Overtravel,
    ];
    /// The counts, which are whole numbers.
    pub const COUNTS: [Self; 5] = [
        Self::EffortSamples,
        Self::SensorSamples,
        Self::LostSamples,
        Self::TrackingSamples,
        Self::MissedDeadlines,
    ];

    /// Returns its key in the table `faults`, its unit, and a text for people.
    #[must_use]
    pub const fn name(self) -> &'static NumberName {
        match self {
            Self::Safe => &(
                "safe_s",
                "s",
                "After a fault efforts go to rest in this time.",
            ),
            Self::Stale => &("stale_s", "s", "An older set-point is a fault."),
            Self::Frozen => &("frozen_rad", "rad", "Motion that a frozen sensor may miss."),
            Self::Tracking => &(
                "tracking_rad",
                "rad",
                "A greater position error is a fault.",
            ),
            Self::Overtravel => &("overtravel_rad", "rad", "Farther past a limit is a fault."),
            Self::EffortSamples => &("effort_samples", "", "Samples of a faulty effort."),
            Self::SensorSamples => &("sensor_samples", "", "Samples out of a range."),
            Self::LostSamples => &("lost_samples", "", "Invalid samples of a sensor."),
            Self::TrackingSamples => &("tracking_samples", "", "Samples of a position error."),
            Self::MissedDeadlines => &("missed_deadlines", "", "Ticks that come too late."),
        }
    }
}

impl FaultPolicy {
    /// Returns a number of the policy.
    #[must_use]
    pub fn number(&self, number: FaultNumber) -> f64 {
        match number {
            FaultNumber::Safe => self.safe_s,
            FaultNumber::Stale => self.stale_s,
            FaultNumber::Frozen => self.frozen_rad,
            FaultNumber::Tracking => self.tracking_rad,
            FaultNumber::Overtravel => self.overtravel_rad,
            FaultNumber::EffortSamples => self.effort_samples.into(),
            FaultNumber::SensorSamples => self.sensor_samples.into(),
            FaultNumber::LostSamples => self.lost_samples.into(),
            FaultNumber::TrackingSamples => self.tracking_samples.into(),
            FaultNumber::MissedDeadlines => self.missed_deadlines.into(),
        }
    }

    /// Returns the range of a number while the robot runs: as the description's check says, and at most four times
    /// the described one. `servo_hz` is the rate of the servos.
    #[must_use]
    pub fn range(&self, number: FaultNumber, servo_hz: u32) -> NumberRange {
        let (value, (key, ..)) = (self.number(number), *number.name());
        let is_count = FaultNumber::COUNTS.contains(&number);
        let margin = if is_count { 1.0 } else { MARGIN * value };
        let [least, greatest] = range(&self.rules(servo_hz), key, margin);
        let most = if is_count {
            f64::from(u16::MAX)
        } else {
            greatest
        };
        [min(least, value), max(min(most, WEAKER * value), value)]
    }

    /// The same policy with another number.
    pub(crate) fn with(&self, number: FaultNumber, value: f64) -> Self {
        let mut policy = *self;
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "not below 0, and what is too large is the most"
        )]
        let samples = value as u16;
        match number {
            FaultNumber::Safe => policy.safe_s = value,
            FaultNumber::Stale => policy.stale_s = value,
            FaultNumber::Frozen => policy.frozen_rad = value,
            FaultNumber::Tracking => policy.tracking_rad = value,
            FaultNumber::Overtravel => policy.overtravel_rad = value,
            FaultNumber::EffortSamples => policy.effort_samples = samples,
            FaultNumber::SensorSamples => policy.sensor_samples = samples,
            FaultNumber::LostSamples => policy.lost_samples = samples,
            FaultNumber::TrackingSamples => policy.tracking_samples = samples,
            FaultNumber::MissedDeadlines => policy.missed_deadlines = samples,
        }
        policy
    }
}

/// A limit of a joint's motions that can change while the robot runs. The limit of jerk is not a number of the
/// description: it follows from that of the acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionNumber {
    /// The largest velocity.
    Velocity,
    /// The largest acceleration.
    Acceleration,
}

impl MotionNumber {
    /// All numbers, in the order of their values as `usize`.
    pub const ALL: [Self; 2] = [Self::Velocity, Self::Acceleration];

    /// Returns its key in the table of the joint, its unit, and a text for people.
    #[must_use]
    pub const fn name(self) -> &'static NumberName {
        match self {
            Self::Velocity => &("limits.velocity", "rad/s", "Of motions that begin."),
            Self::Acceleration => &("limits.acceleration", "rad/s^2", "Of motions that begin."),
        }
    }

    /// Returns its value in the description.
    #[must_use]
    pub const fn of(self, limits: &Limits) -> f64 {
        match self {
            Self::Velocity => limits.velocity,
            Self::Acceleration => limits.acceleration,
        }
    }

    /// Returns its range while the robot runs: from a hundredth of the described limit to that limit. Beyond it the
    /// servos would not believe the sensors.
    #[must_use]
    pub fn range(self, limits: &Limits) -> NumberRange {
        let value = self.of(limits);
        [SLOWER * value, value]
    }
}

/// A number of the servo of a table's [`Axis`] that can change while the axis runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisNumber {
    /// [`AxisServoSettings::kp`].
    Kp,
    /// [`AxisServoSettings::kv`].
    Kv,
    /// [`AxisServoSettings::ki`].
    Ki,
    /// [`AxisServoSettings::integral_max`].
    IntegralMax,
    /// [`AxisServoSettings::velocity_cutoff_hz`].
    VelocityCutoff,
}

impl AxisNumber {
    /// All numbers, in the order of their values as `usize`.
    pub const ALL: [Self; 5] = [
        Self::Kp,
        Self::Kv,
        Self::Ki,
        Self::IntegralMax,
        Self::VelocityCutoff,
    ];

    /// Returns its key in the table of the axis, its unit, and a text for people.
    #[must_use]
    pub const fn name(self) -> &'static NumberName {
        match self {
            Self::Kp => &("servo.kp", "N/m", "Gain of the position error."),
            Self::Kv => &("servo.kv", "N s/m", "Gain of the velocity error."),
            Self::Ki => &("servo.ki", "N/(m s)", "Gain of the integral."),
            Self::IntegralMax => &("servo.integral_max", "N", "Limit of the integral."),
            Self::VelocityCutoff => &("servo.velocity_cutoff_hz", "Hz", "Filter of the velocity."),
        }
    }

    /// Returns its value in the settings of a servo.
    #[must_use]
    pub const fn of(self, servo: &AxisServoSettings) -> f64 {
        match self {
            Self::Kp => servo.kp,
            Self::Kv => servo.kv,
            Self::Ki => servo.ki,
            Self::IntegralMax => servo.integral_max,
            Self::VelocityCutoff => servo.velocity_cutoff_hz,
        }
    }

    /// The place of the number in the settings of a servo.
    pub(crate) const fn of_mut(self, servo: &mut AxisServoSettings) -> &mut f64 {
        match self {
            Self::Kp => &mut servo.kp,
            Self::Kv => &mut servo.kv,
            Self::Ki => &mut servo.ki,
            Self::IntegralMax => &mut servo.integral_max,
            Self::VelocityCutoff => &mut servo.velocity_cutoff_hz,
        }
    }

    /// Returns its range while the axis runs: at most four times the described gain, an integral of at most the
    /// force of the drive, and a filter that is not slower than the described one. `rate_hz` is the rate of the servo.
    #[must_use]
    pub fn range(self, axis: &Axis, rate_hz: u32) -> NumberRange {
        let value = self.of(&axis.servo);
        let (key, ..) = *self.name();
        let [least, _] = range(&axis.rules(), key, 0.0);
        let [least, greatest] = match self {
            Self::Kp | Self::Kv => [least, WEAKER * value],
            Self::Ki => [least, INTEGRAL * axis.servo.kp],
            Self::IntegralMax => [least, axis.max_n],
            Self::VelocityCutoff => cutoff_range(value, 1.0, rate_hz),
        };
        [min(least, value), max(greatest, value)]
    }
}
