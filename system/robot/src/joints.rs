//! [`JointNumbers`]: the numbers of a robot's joints, and the fingers that a robot does not have.

use core::fmt;
use core::ops::Range;

use condor_hand::config::{Finger, Form, Name, Placement};

use crate::{ACTUATORS, ALL, FINGERS, JOINTS, Mechanism, RobotDescription};

const _: () = assert!(ALL <= 32, "a bit of a word for each joint");

/// The numbers of the joints of a robot: those of the first finger, proximal first, then those of the next one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointNumbers {
    /// The number of the first joint of each finger, and that after the last joint.
    first: [u8; FINGERS + 1],
}

impl JointNumbers {
    /// Numbers the joints of a robot.
    pub(crate) fn of(robot: &RobotDescription) -> Self {
        let (mut first, mut next) = ([0; FINGERS + 1], 0);
        for (finger, place) in first.iter_mut().enumerate() {
            *place = next;
            let finger = robot.fingers.get(finger);
            next += finger.map_or(0, |finger| finger.joints.len() as u8);
        }
        Self { first }
    }

    /// Returns the numbers of the joints of a finger.
    pub(crate) fn range(self, finger: usize) -> Range<usize> {
        let first = |finger: usize| self.first.get(finger).copied().map_or(0, usize::from);
        first(finger)..first(finger + 1)
    }

    /// Returns the number of a joint of a finger.
    pub(crate) fn number(self, finger: usize, joint: usize) -> usize {
        self.range(finger).start + joint
    }

    /// Returns the finger that has the joint of a number, and the number of the joint in it.
    pub(crate) fn place(self, number: usize) -> Option<(usize, usize)> {
        let finger = (0..FINGERS).find(|&finger| self.range(finger).contains(&number))?;
        Some((finger, number - self.range(finger).start))
    }

    /// Returns the joints of a finger, a bit for each number.
    pub(crate) fn mask(self, finger: usize) -> u32 {
        self.range(finger)
            .fold(0, |bits, number| bits | 1 << number)
    }

    /// Returns the fingers of a mask of joints, a bit for each.
    pub(crate) fn fingers(self, mask: u32) -> u32 {
        let fingers = (0..FINGERS).filter(|&finger| mask & self.mask(finger) != 0);
        fingers.fold(0, |bits, finger| bits | 1 << finger)
    }

    /// Returns what there is of each joint by fingers; `rest` in the places without a joint.
    pub(crate) fn by_finger<T: Copy>(self, all: &[T; ALL], rest: T) -> [[T; JOINTS]; FINGERS] {
        let mut fingers = [[rest; JOINTS]; FINGERS];
        for (finger, joints) in fingers.iter_mut().enumerate() {
            let own = all.get(self.range(finger)).unwrap_or(&[]);
            for (to, from) in joints.iter_mut().zip(own) {
                *to = *from;
            }
        }
        fingers
    }

    /// Returns the number of joints.
    pub(crate) fn count(self) -> usize {
        self.range(FINGERS - 1).end
    }

    /// Checks that the robot has all joints of a mask.
    ///
    /// # Errors
    /// Returns the number of the first joint that it does not have.
    pub(crate) fn check(self, mask: u32) -> Result<(), u32> {
        let all = (0..self.count()).fold(0, |bits, number| bits | 1 << number);
        match mask & !all {
            0 => Ok(()),
            missing => Err(missing.trailing_zeros()),
        }
    }
}

/// The name of a joint, FINGER.JOINT, by its number.
pub(crate) struct JointName<'r>(pub(crate) &'r RobotDescription, pub(crate) usize);

impl fmt::Display for JointName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(robot, number) = *self;
        let place = JointNumbers::of(robot).place(number);
        let named = place.and_then(|(finger, joint)| {
            Some((robot.fingers.get(finger)?, robot.joint(finger, joint)?))
        });
        match named {
            Some((finger, joint)) => write!(f, "{}.{}", finger.name, joint.name),
            None => write!(f, "joint {number}, which the robot does not have"),
        }
    }
}

/// The name of an actuator, FINGER.ACTUATOR, by the numbers of both.
pub(crate) struct ActuatorName<'r>(
    pub(crate) &'r RobotDescription,
    pub(crate) usize,
    pub(crate) usize,
);

impl fmt::Display for ActuatorName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(robot, finger, actuator) = *self;
        let named = robot
            .fingers
            .get(finger)
            .zip(robot.actuator(finger, actuator));
        match named {
            Some((finger, actuator)) => write!(f, "{}.{}", finger.name, actuator.name),
            None => write!(
                f,
                "actuator {actuator} of finger {finger}, which the robot does not have"
            ),
        }
    }
}

/// The names of the joints of a finger.
pub(crate) fn joint_names(
    finger: &Finger<JOINTS, ACTUATORS>,
) -> impl Iterator<Item = &Name> + Clone {
    finger.joints.iter().map(|joint| &joint.name)
}

/// The names of the actuators of a finger.
pub(crate) fn actuator_names(
    finger: &Finger<JOINTS, ACTUATORS>,
) -> impl Iterator<Item = &Name> + Clone {
    finger.actuators.iter().map(|actuator| &actuator.name)
}

/// The place of a finger that a robot does not have: far from all that could touch it, m.
const NOWHERE: [f64; 3] = [0.0, 0.0, 1e3];

/// Returns a finger that a robot does not have: without joints, and out of reach.
pub(crate) fn absent() -> Finger<JOINTS, ACTUATORS> {
    Finger {
        name: Name::new(),
        base: Placement {
            position: NOWHERE,
            ..Placement::default()
        },
        form: Form::Chain {
            tip: [0.0; 3],
            on: None,
        },
        touch: None,
        joints: heapless::Vec::new(),
        followers: heapless::Vec::new(),
        actuators: heapless::Vec::new(),
    }
}

/// Returns the fingers of a robot with their mechanisms; `absent` takes the places of those that it does not have.
pub(crate) fn with_mechanisms<'r>(
    robot: &'r RobotDescription,
    absent: &'r Finger<JOINTS, ACTUATORS>,
) -> [(&'r Finger<JOINTS, ACTUATORS>, Mechanism); FINGERS] {
    core::array::from_fn(|finger| {
        let finger = robot.fingers.get(finger).unwrap_or(absent);
        (finger, finger.chain())
    })
}

/// Returns a robot with fingers of two, four and one joints, and none in the fourth place.
#[cfg(test)]
pub(crate) fn short() -> RobotDescription {
    let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
    let mut robot = RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
    robot.fingers.pop();
    for (finger, joints) in [(0, 2), (2, 1)] {
        robot.fingers[finger].joints.truncate(joints);
        robot.fingers[finger].actuators.truncate(2 * joints);
    }
    robot
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_are_numbered_without_gaps() {
        let robot = short();
        let numbers = JointNumbers::of(&robot);
        let ranges = [0..2, 2..6, 6..7, 7..7];
        for (finger, range) in ranges.into_iter().enumerate() {
            assert_eq!(numbers.range(finger), range);
            let mask = range.clone().fold(0, |bits, number| bits | 1 << number);
            assert_eq!(numbers.mask(finger), mask);
            for (joint, number) in range.enumerate() {
                assert_eq!(numbers.number(finger, joint), number);
                assert_eq!(numbers.place(number), Some((finger, joint)));
            }
        }
        assert_eq!((numbers.count(), numbers.place(7)), (7, None));
        assert_eq!(numbers.fingers(u32::MAX), 0b111);
        assert_eq!(numbers.fingers(1 << 1 | 1 << 6), 0b101);
        assert_eq!(numbers.check(0b111_1111), Ok(()));
        assert_eq!(numbers.check(0b1000_0001), Err(7));
        let all = core::array::from_fn(|number| number as u32 + 1);
        let fingers = numbers.by_finger(&all, 0);
        assert_eq!(fingers[0], [1, 2, 0, 0]);
        assert_eq!(fingers[1], [3, 4, 5, 6]);
        assert_eq!(fingers[2..], [[7, 0, 0, 0], [0; JOINTS]]);
        let names = [1, 2, 6].map(|number| JointName(&robot, number).to_string());
        assert_eq!(
            names,
            ["index.proximal", "middle.abduction", "ring.abduction"]
        );
    }

    #[test]
    fn a_finger_that_a_robot_does_not_have_is_out_of_reach() {
        let (robot, absent) = (short(), absent());
        let fingers = with_mechanisms(&robot, &absent);
        let counts = fingers.map(|(finger, _)| finger.joints.len());
        assert_eq!(counts, [2, 4, 1, 0]);
        let [.., (_, mechanism)] = fingers;
        assert!(mechanism.base().position.z > 100.0);
    }
}
