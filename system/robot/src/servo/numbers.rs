//! [`ServoNumbers`]: limits, filters and conditions of faults, as parameters of the servo loop.

use condor_hand::config::{ActuatorNumber, FaultNumber, JointNumber};

use crate::numbers::{Number, NumberPlace, Numbers};
use crate::{ACTUATORS, ALL, FINGERS, RobotDescription};

/// The numbers of all joints of a processor that serves all fingers.
const OF_JOINTS: usize = ALL * JointNumber::ALL.len();

/// The numbers of all actuators of a processor that serves all fingers.
const OF_ACTUATORS: usize = FINGERS * ACTUATORS * ActuatorNumber::ALL.len();

/// The numbers of the description that a servo processor uses, beside the gains of its joints and actuators.
pub(super) struct ServoNumbers<'h> {
    pub(super) joints: Numbers<'h, f64, OF_JOINTS>,
    pub(super) actuators: Numbers<'h, f64, OF_ACTUATORS>,
    pub(super) thresholds: Numbers<'h, f64, { FaultNumber::THRESHOLDS.len() }>,
    pub(super) counts: Numbers<'h, u32, { FaultNumber::COUNTS.len() }>,
}

impl<'h> ServoNumbers<'h> {
    /// Makes the parameters of a processor, whose loop has this rate.
    pub(super) fn new(robot: &'h RobotDescription, processor: u8, rate_hz: u32) -> Self {
        let joints = robot.fingers_on(processor).flat_map(|(finger, entry)| {
            let joints = entry.joints.iter().enumerate();
            joints.flat_map(move |(joint, of_joint)| {
                let ranges = entry.ranges(joint, rate_hz);
                let ranges = JointNumber::ALL.into_iter().zip(ranges);
                ranges.filter_map(move |(number, range)| {
                    Some(Number {
                        place: NumberPlace::Joint(finger as u8, joint as u8, number),
                        value: number.of(of_joint)?,
                        range: range?,
                    })
                })
            })
        });
        let actuators = robot.fingers_on(processor).flat_map(|(finger, entry)| {
            let actuators = entry.actuators.iter().enumerate();
            actuators.flat_map(move |(actuator, entry)| {
                let ranges = ActuatorNumber::ALL.into_iter().zip(entry.ranges(rate_hz));
                ranges.filter_map(move |(number, range)| {
                    Some(Number {
                        place: NumberPlace::Actuator(finger as u8, actuator as u8, number),
                        value: number.of(entry)?,
                        range: range?,
                    })
                })
            })
        });
        let faults = &robot.faults;
        let fault = |number| Number {
            place: NumberPlace::Faults(number),
            value: faults.number(number),
            range: faults.range(number, rate_hz),
        };
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "a whole number of 16 bits"
        )]
        let count = |number| {
            let number = fault(number);
            Number {
                place: number.place,
                value: number.value as u32,
                range: number.range.map(|end| end as u32),
            }
        };
        let (thresholds, counts) = (FaultNumber::THRESHOLDS, FaultNumber::COUNTS);
        let thresholds = thresholds.into_iter().map(fault);
        let counts = counts.into_iter().map(count);
        Self {
            joints: Numbers::new(robot, joints, f64::MIN..=f64::MAX),
            actuators: Numbers::new(robot, actuators, f64::MIN..=f64::MAX),
            thresholds: Numbers::new(robot, thresholds, f64::MIN..=f64::MAX),
            counts: Numbers::new(robot, counts, 0..=u32::MAX),
        }
    }

    /// Returns what differs from before when a change has been taken over.
    pub(super) fn version(&self) -> [u32; 4] {
        let Self {
            joints,
            actuators,
            thresholds,
            counts,
        } = self;
        [
            joints.version(),
            actuators.version(),
            thresholds.version(),
            counts.version(),
        ]
    }

    /// Iterates over the conditions of faults, with their values in this tick.
    pub(super) fn faults(&self) -> impl Iterator<Item = (FaultNumber, f64)> {
        let counts = self.counts.present();
        let counts = counts.map(|(place, value)| (place, f64::from(value)));
        let all = self.thresholds.present().chain(counts);
        all.filter_map(|(place, value)| match place {
            NumberPlace::Faults(number) => Some((number, value)),
            _ => None,
        })
    }
}
