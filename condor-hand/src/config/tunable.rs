//! The numbers of a description that can change while the robot runs, beside the gains of joints.
//!
//! Each has the key of the description, and a range: within it the robot is as safe as the description says, whatever
//! the other numbers of the list are.

use serde::{Deserialize, Serialize};

use super::check::{LOWER_CUTOFF, cutoff_rules, range};
use super::{Axis, AxisServoSettings, FaultPolicy, Joint, Limits, Tendon};
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

/// A number of a [`Joint`] that can change while the joint runs: limits, soft stops, filters, and thresholds of
/// faults of tendons.
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
    /// The tension below which the flexor is slack.
    FlexorSlack,
    /// The tension above which the flexor may break.
    FlexorBreak,
    /// The cutoff of the filter of the flexor's tension.
    FlexorCutoff,
    /// The tension below which the extensor is slack.
    ExtensorSlack,
    /// The tension above which the extensor may break.
    ExtensorBreak,
    /// The cutoff of the filter of the extensor's tension.
    ExtensorCutoff,
}

/// The numbers of a joint, in the order of [`JointNumber::ALL`]; 0 for a filter that there is not.
pub(crate) type JointNumbers = [f64; JointNumber::ALL.len()];

impl JointNumber {
    /// All numbers, in the order of their values as `usize`.
    pub const ALL: [Self; 12] = [
        Self::Low,
        Self::High,
        Self::Zone,
        Self::StopBandwidth,
        Self::PositionCutoff,
        Self::VelocityCutoff,
        Self::FlexorSlack,
        Self::FlexorBreak,
        Self::FlexorCutoff,
        Self::ExtensorSlack,
        Self::ExtensorBreak,
        Self::ExtensorCutoff,
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
            Self::FlexorSlack => &("flexor.slack_n", "N", "Below it is a fault."),
            Self::FlexorBreak => &("flexor.break_n", "N", "Above it is a fault."),
            Self::FlexorCutoff => &("flexor.cutoff_hz", "Hz", "Filter of the tension."),
            Self::ExtensorSlack => &("extensor.slack_n", "N", "Below it is a fault."),
            Self::ExtensorBreak => &("extensor.break_n", "N", "Above it is a fault."),
            Self::ExtensorCutoff => &("extensor.cutoff_hz", "Hz", "Filter of the tension."),
        }
    }

    /// Returns its value in the description; `None` for a filter that the joint does not have.
    #[must_use]
    pub const fn of<const J: usize>(self, joint: &Joint<J>) -> Option<f64> {
        match self {
            Self::Low => Some(joint.limits.low),
            Self::High => Some(joint.limits.high),
            Self::Zone => Some(joint.stop.zone),
            Self::StopBandwidth => Some(joint.stop.bandwidth_hz),
            Self::PositionCutoff => joint.servo.position_cutoff_hz,
            Self::VelocityCutoff => Some(joint.servo.velocity_cutoff_hz),
            Self::FlexorSlack => Some(joint.flexor.slack_n),
            Self::FlexorBreak => Some(joint.flexor.break_n),
            Self::FlexorCutoff => joint.flexor.cutoff_hz,
            Self::ExtensorSlack => Some(joint.extensor.slack_n),
            Self::ExtensorBreak => Some(joint.extensor.break_n),
            Self::ExtensorCutoff => joint.extensor.cutoff_hz,
        }
    }
}

impl<const J: usize> Joint<J> {
    /// Returns the ranges of the numbers that can change while the joint runs, in the order of
    /// [`JointNumber::ALL`]; `None` for a filter that the joint does not have. `rate_hz` is the rate of its servo.
    ///
    /// * Limits only come nearer, and leave room for the stops: the links, the sensors and the motions are made for
    ///   the described ones.
    /// * Stops only become softer, and filters are as slow as the described stops bear. See
    ///   [`SoftStopSettings`](super::SoftStopSettings).
    /// * A filter that the description leaves out stays out: its lag is a part of what the description's check looks at.
    /// * Thresholds of tension differ from the least and the largest tension by a count of their sensor.
    #[must_use]
    pub fn ranges(&self, rate_hz: u32) -> [Option<NumberRange>; JointNumber::ALL.len()] {
        let rules = self.rules();
        let half = 0.5 * (self.limits.high - self.limits.low);
        let nearer = 0.5 * (half - self.stop.zone);
        let slowest = self.slowest_filters(rate_hz);
        JointNumber::ALL.map(|number| {
            let value = number.of(self)?;
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
                JointNumber::FlexorCutoff | JointNumber::ExtensorCutoff => {
                    cutoff_range(value, LOWER_CUTOFF, rate_hz)
                }
                JointNumber::FlexorSlack | JointNumber::FlexorBreak => self
                    .flexor
                    .range(key.strip_prefix("flexor.").unwrap_or(key)),
                JointNumber::ExtensorSlack | JointNumber::ExtensorBreak => self
                    .extensor
                    .range(key.strip_prefix("extensor.").unwrap_or(key)),
            };
            Some([min(least, value), max(greatest, value)])
        })
    }

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

impl Tendon {
    /// The range of one of its thresholds, N.
    fn range(&self, key: &str) -> NumberRange {
        let count = abs(self.adc.gain);
        let ends = [self.adc.value(0), self.adc.value(self.adc.full_scale())];
        let [mut least, mut greatest] = range(&self.rules(), key, count);
        least = max(least, min(ends[0], ends[1]));
        greatest = min(greatest, max(ends[0], ends[1]));
        for [(name, value), (above, limit)] in self.order() {
            if name == key {
                greatest = min(greatest, limit - count);
            } else if above == key {
                least = max(least, value + count);
            }
        }
        [least, greatest]
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
    /// [`FaultPolicy::tension_samples`].
    TensionSamples,
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
        Self::TensionSamples,
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
                "After a fault tensions go down in this time.",
            ),
            Self::Stale => &("stale_s", "s", "An older set-point is a fault."),
            Self::Frozen => &("frozen_rad", "rad", "Motion that a frozen sensor may miss."),
            Self::Tracking => &(
                "tracking_rad",
                "rad",
                "A greater position error is a fault.",
            ),
            Self::Overtravel => &("overtravel_rad", "rad", "Farther past a limit is a fault."),
            Self::TensionSamples => &(
                "tension_samples",
                "",
                "Samples of a slack or broken tendon.",
            ),
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
            FaultNumber::TensionSamples => self.tension_samples.into(),
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
            FaultNumber::TensionSamples => policy.tension_samples = samples,
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
