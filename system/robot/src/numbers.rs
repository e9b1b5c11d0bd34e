//! [`Numbers`]: numbers of the robot's description as parameters of a loop, under the keys of the description.

use core::fmt::{self, Write};
use core::sync::atomic::AtomicU32;

use condor_hand::config::{
    ActuatorNumber, AxisNumber, FaultNumber, JointNumber, MotionNumber, NumberName,
};
use condor_vars::{ParamRefusal, Params, Scalar, Tune, VarDescription, Watch};

use crate::RobotDescription;

/// A block of at most `N` numbers of the description. The loop takes over new values of all of them together.
///
/// The name of a number of a joint is `FINGER.JOINT.KEY`, such as `index.proximal.stop.zone`; that of an actuator is
/// `FINGER.ACTUATOR.KEY`, that of an axis
/// `table.AXIS.KEY`, and that of a condition of faults `faults.KEY`.
pub(crate) struct Numbers<'h, T: Scalar, const N: usize> {
    robot: &'h RobotDescription,
    entries: heapless::Vec<Number<T>, N>,
    params: Params<T, N>,
}

/// A number: its place in the description, its value there, and its range while the loop runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number<T> {
    pub(crate) place: NumberPlace,
    pub(crate) value: T,
    pub(crate) range: [T; 2],
}

/// The place of a number in the description. Fingers, joints, actuators and axes are counted from 0.
#[derive(Clone, Copy, Debug)]
pub(crate) enum NumberPlace {
    Joint(u8, u8, JointNumber),
    Motion(u8, u8, MotionNumber),
    Actuator(u8, u8, ActuatorNumber),
    Axis(u8, AxisNumber),
    Faults(FaultNumber),
}

impl NumberPlace {
    const fn name(self) -> &'static NumberName {
        match self {
            Self::Joint(.., number) => number.name(),
            Self::Motion(.., number) => number.name(),
            Self::Actuator(.., number) => number.name(),
            Self::Axis(_, number) => number.name(),
            Self::Faults(number) => number.name(),
        }
    }
}

impl<'h, T: Scalar, const N: usize> Numbers<'h, T, N> {
    /// Makes parameters of the first `N` of these numbers, with the values that the description has.
    pub(crate) fn new(
        robot: &'h RobotDescription,
        numbers: impl Iterator<Item = Number<T>>,
        all: core::ops::RangeInclusive<T>,
    ) -> Self {
        let (mut entries, mut initial) = (heapless::Vec::new(), [T::default(); N]);
        for (number, place) in numbers.zip(&mut initial) {
            *place = number.value;
            // There is a place for each.
            let _ = entries.push(number);
        }
        Self {
            robot,
            entries,
            params: Params::named(&[""; N], "", initial, all),
        }
    }

    /// Returns a number that differs from before when a change has been taken over.
    pub(crate) fn version(&self) -> u32 {
        self.params.version()
    }

    /// Iterates over the numbers, with their values in this tick.
    pub(crate) fn present(&self) -> impl Iterator<Item = (NumberPlace, T)> {
        let entries = self.entries.iter().enumerate();
        entries.filter_map(|(index, entry)| Some((entry.place, self.params.get_at(index)?)))
    }
}

impl<T: Scalar, const N: usize> Watch for Numbers<'_, T, N> {
    fn words(&self) -> &[AtomicU32] {
        let words = self.params.words();
        let len = words.len() / N.max(1) * self.entries.len();
        words.get(..len).unwrap_or(words)
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let entry = self.entries.get(index)?;
        let (_, unit, about) = *entry.place.name();
        Some(VarDescription {
            unit,
            about,
            bounds: entry.range.map(T::to_words),
            ..self.params.describe(index)?
        })
    }

    fn name(&self, index: usize, to: &mut dyn Write) -> fmt::Result {
        let place = self.entries.get(index).ok_or(fmt::Error)?.place;
        let (key, ..) = *place.name();
        match place {
            NumberPlace::Joint(finger, joint, _) | NumberPlace::Motion(finger, joint, _) => {
                let finger = self.robot.fingers.get(usize::from(finger));
                let finger = finger.ok_or(fmt::Error)?;
                let joint = finger.joints.get(usize::from(joint)).ok_or(fmt::Error)?;
                write!(to, "{}.{}.{key}", finger.name, joint.name)
            }
            NumberPlace::Actuator(finger, actuator, _) => {
                let finger = self.robot.fingers.get(usize::from(finger));
                let finger = finger.ok_or(fmt::Error)?;
                let actuator = finger.actuators.get(usize::from(actuator));
                let actuator = actuator.ok_or(fmt::Error)?;
                write!(to, "{}.{}.{key}", finger.name, actuator.name)
            }
            NumberPlace::Axis(axis, _) => {
                let table = self.robot.table.as_ref().ok_or(fmt::Error)?;
                let axis = table.axes.get(usize::from(axis)).ok_or(fmt::Error)?;
                write!(to, "table.{}.{key}", axis.name)
            }
            NumberPlace::Faults(_) => write!(to, "faults.{key}"),
        }
    }
}

impl<T: Scalar, const N: usize> Tune for Numbers<'_, T, N> {
    fn compare_and_set_words(
        &self,
        index: usize,
        expected: [u32; 2],
        new: [u32; 2],
    ) -> Result<(), ParamRefusal> {
        let entry = self.entries.get(index).ok_or(ParamRefusal::OutOfBounds)?;
        let [least, greatest] = entry.range;
        let value = T::from_words(new).filter(|value| (least..=greatest).contains(value));
        value.ok_or(ParamRefusal::OutOfBounds)?;
        self.params.compare_and_set_words(index, expected, new)
    }

    fn wanted(&self, index: usize) -> [u32; 2] {
        self.params.wanted(index)
    }

    fn initial(&self, index: usize) -> [u32; 2] {
        self.params.initial(index)
    }

    fn latch(&self) {
        self.params.latch();
    }

    fn is_sound(&self) -> bool {
        let mut entries = self.entries.iter();
        entries.all(|entry| (entry.range[0]..=entry.range[1]).contains(&entry.value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(hand: &RobotDescription) -> Numbers<'_, f64, 3> {
        let (axis, finger) = (&hand.table.as_ref().unwrap().axes[1], &hand.fingers[1]);
        let high = JointNumber::High;
        let all = [
            Number {
                place: NumberPlace::Axis(1, AxisNumber::Kp),
                value: axis.servo.kp,
                range: AxisNumber::Kp.range(axis, 400),
            },
            Number {
                place: NumberPlace::Joint(1, 2, high),
                value: finger.joints[2].limits.high,
                range: finger.ranges(2, 400)[high as usize].unwrap(),
            },
        ];
        Numbers::new(hand, all.into_iter(), f64::MIN..=f64::MAX)
    }

    #[test]
    fn a_number_has_the_key_of_the_description_and_keeps_its_range() {
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        let hand = RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
        let numbers = numbers(&hand);
        let name = |index| {
            let mut name = std::string::String::new();
            numbers.name(index, &mut name).map(|()| name)
        };
        assert_eq!(name(0).unwrap(), "table.y.servo.kp");
        assert_eq!(name(1).unwrap(), "middle.middle.limits.high");
        name(2).unwrap_err();
        assert!(numbers.describe(2).is_none());
        assert_eq!(numbers.describe(1).unwrap().unit, "rad");
        assert_eq!(numbers.words().len(), 4);
        assert!(numbers.is_sound());

        let high = hand.fingers[1].joints[2].limits.high;
        let set = |to: f64| numbers.compare_and_set_words(1, high.to_words(), to.to_words());
        for wrong in [1.01 * high, f64::NAN, -1.0] {
            assert_eq!(set(wrong), Err(ParamRefusal::OutOfBounds));
        }
        let version = numbers.version();
        set(0.9 * high).unwrap();
        numbers.latch();
        assert_ne!(numbers.version(), version);
        assert_eq!(numbers.initial(1), high.to_words());
        let present: std::vec::Vec<_> = numbers.present().map(|(_, value)| value).collect();
        let bits = [4000.0, 0.9 * high].map(f64::to_bits);
        assert!(present.into_iter().map(f64::to_bits).eq(bits));
        let other = numbers.compare_and_set_words(2, [0; 2], [0; 2]);
        assert_eq!(other, Err(ParamRefusal::OutOfBounds));
    }
}
