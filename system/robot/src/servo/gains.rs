//! [`Gains`]: the gains of the joints and actuators, as parameters of the servo loop.

use core::fmt::{self, Write};
use core::sync::atomic::AtomicU32;

use condor_hand::config::{Finger, Joint, Name, ServoLaw};
use condor_hand::math::max;
use condor_hand::servo::{EffortGains, JointGains, PositionLaw};
use condor_vars::{ParamRefusal, Params, Scalar, Tune, VarDescription, Watch, choice};

use super::ServedFingers;
use crate::{ACTUATORS, FINGERS, JOINTS};

/// The gains of each joint: key in the robot's description, unit and text. All are numbers.
const GAIN: [Names; 7] = [
    ("servo.kp", "N m/rad", "Stiffness, law pd."),
    ("servo.kv", "N m s/rad", "Damping, law pd."),
    ("servo.ki", "N m/(rad s)", "Integral gain, law pd."),
    (
        "servo.integral_max",
        "N m",
        "Limit of the integral, law pd.",
    ),
    (
        "servo.bandwidth_hz",
        "Hz",
        "Speed with which errors vanish, law decoupled.",
    ),
    (
        "servo.zeta",
        "",
        "Damping ratio: 1 is without overshoot, law decoupled.",
    ),
    ("servo.k_tau", "", "Gain of the torque's error."),
];
/// The gains of each actuator, in the same way. Efforts are in N or N m.
const EFFORT_GAIN: [Names; 4] = [
    ("gains.kp", "", "Proportional gain of effort."),
    ("gains.ki", "1/s", "Integral gain of effort."),
    ("gains.kd", "s", "Derivative gain of effort."),
    ("gains.kv", "N s/m", "Damping: gain of the actuator's rate."),
];
const LAW: [Names; 1] = [("servo.law", "", "The law that follows positions.")];
/// The greatest value of each gain, in the order of [`GAIN`]: above what a finger of this size bears, and
/// below what can only be a mistake. If a joint is configured with more, that is the greatest value. The least
/// value is 0.
const MOST: [f64; GAIN.len()] = [100.0, 10.0, 1000.0, 10.0, 50.0, 10.0, 10.0];
/// The same in the order of [`EFFORT_GAIN`].
const MOST_EFFORT: [f64; EFFORT_GAIN.len()] = [100.0, 1000.0, 10.0, 1000.0];
/// The greatest gain that a configuration can have.
const GREATEST: f64 = 1e9;
/// The number of joints, and of actuators, of a processor that serves all fingers.
const ALL: usize = FINGERS * JOINTS;
const ALL_ACTUATORS: usize = FINGERS * ACTUATORS;
const NUMBERS: usize = ALL * GAIN.len();
const EFFORT_NUMBERS: usize = ALL_ACTUATORS * EFFORT_GAIN.len();

type Names = (&'static str, &'static str, &'static str);

choice! {
    /// A law of position.
    pub(super) enum Law {
        /// [`PositionLaw::Pd`].
        Pd = "pd",
        /// [`PositionLaw::ComputedTorque`].
        ComputedTorque = "decoupled",
    }
}

/// The gains of the joints and actuators of a processor, under names such as `index.proximal.servo.kp` and
/// `index.proximal-flexor.gains.kp`.
///
/// Both laws have their gains all the time; the one of `law` is in force.
pub(super) struct Gains<'h> {
    pub(super) laws: OfParts<'h, Params<Law, ALL>, 1>,
    pub(super) numbers: OfParts<'h, Params<f64, NUMBERS>, { GAIN.len() }>,
    pub(super) efforts: OfParts<'h, Params<f64, EFFORT_NUMBERS>, { EFFORT_GAIN.len() }>,
}

/// Parameters of joints or actuators, `N` of each.
pub(super) struct OfParts<'h, P, const N: usize> {
    fingers: ServedFingers<'h>,
    kind: PartKind,
    names: &'static [Names; N],
    /// The greatest values of numbers.
    most: Option<[f64; N]>,
    params: P,
}

/// The parts of a finger that have parameters.
#[derive(Clone, Copy)]
enum PartKind {
    Joints,
    Actuators,
}

impl PartKind {
    /// The number of parts that a finger has.
    fn count(self, finger: &Finger<JOINTS, ACTUATORS>) -> usize {
        match self {
            Self::Joints => finger.joints.len(),
            Self::Actuators => finger.actuators.len(),
        }
    }

    /// The name of a part of a finger.
    fn name(self, finger: &Finger<JOINTS, ACTUATORS>, part: usize) -> Option<&Name> {
        match self {
            Self::Joints => finger.joints.get(part).map(|joint| &joint.name),
            Self::Actuators => finger.actuators.get(part).map(|actuator| &actuator.name),
        }
    }

    /// The number of parts of a processor that serves all fingers.
    const fn all(self) -> usize {
        match self {
            Self::Joints => ALL,
            Self::Actuators => ALL_ACTUATORS,
        }
    }
}

impl<'h> Gains<'h> {
    /// Makes the parameters of these fingers, with the values that the description has.
    pub(super) fn new(fingers: &ServedFingers<'h>) -> Self {
        let mut laws = [Law::Pd; ALL];
        let mut numbers = [0.0; NUMBERS];
        let (of_joints, _) = numbers.as_chunks_mut();
        let mut most = MOST;
        let joints = fingers.iter().flat_map(|finger| &finger.joints);
        for (joint, (law, numbers)) in joints.zip(laws.iter_mut().zip(of_joints)) {
            (*law, *numbers) = described(joint);
            for (most, &configured) in most.iter_mut().zip(&*numbers) {
                *most = max(*most, configured);
            }
        }
        let mut efforts = [0.0; EFFORT_NUMBERS];
        let (of_actuators, _) = efforts.as_chunks_mut();
        let mut most_effort = MOST_EFFORT;
        let actuators = fingers.iter().flat_map(|finger| &finger.actuators);
        for (actuator, numbers) in actuators.zip(of_actuators) {
            let EffortGains { kp, ki, kd, kv } = actuator.gains;
            *numbers = [kp, ki, kd, kv];
            for (most, &configured) in most_effort.iter_mut().zip(&*numbers) {
                *most = max(*most, configured);
            }
        }
        Self {
            laws: OfParts {
                fingers: fingers.clone(),
                kind: PartKind::Joints,
                names: &LAW,
                most: None,
                params: Params::named(&[""; ALL], "", laws, Law::Pd..=Law::ComputedTorque),
            },
            numbers: OfParts {
                fingers: fingers.clone(),
                kind: PartKind::Joints,
                names: &GAIN,
                most: Some(most),
                params: Params::named(&[""; NUMBERS], "", numbers, 0.0..=GREATEST),
            },
            efforts: OfParts {
                fingers: fingers.clone(),
                kind: PartKind::Actuators,
                names: &EFFORT_GAIN,
                most: Some(most_effort),
                params: Params::named(&[""; EFFORT_NUMBERS], "", efforts, 0.0..=GREATEST),
            },
        }
    }

    /// Returns what differs from before when a change has been taken over.
    pub(super) fn version(&self) -> [u32; 3] {
        [
            self.laws.params.version(),
            self.numbers.params.version(),
            self.efforts.params.version(),
        ]
    }

    /// Returns the gains of a joint in this tick, of the finger at a place among those that are served.
    pub(super) fn of(&self, place: usize, joint: usize) -> Option<JointGains> {
        let joint = self.laws.number(place, joint)?;
        let law = self.laws.params.get_at(joint)?;
        let first = joint * GAIN.len();
        let number = |index| self.numbers.params.get_at(first + index);
        Some(JointGains {
            law: match law {
                Law::Pd => PositionLaw::Pd {
                    kp: number(0)?,
                    kv: number(1)?,
                    ki: number(2)?,
                    integral_nm: number(3)?,
                },
                Law::ComputedTorque => PositionLaw::ComputedTorque {
                    bandwidth_hz: number(4)?,
                    damping_ratio: number(5)?,
                },
            },
            k_torque: number(6)?,
        })
    }

    /// Returns the gains of an actuator in this tick, in the same way.
    pub(super) fn of_actuator(&self, place: usize, actuator: usize) -> Option<EffortGains> {
        let first = self.efforts.number(place, actuator)? * EFFORT_GAIN.len();
        let number = |index| self.efforts.params.get_at(first + index);
        Some(EffortGains {
            kp: number(0)?,
            ki: number(1)?,
            kd: number(2)?,
            kv: number(3)?,
        })
    }
}

/// The law of a joint and the gains of both laws, in the order of [`GAIN`].
const fn described(joint: &Joint) -> (Law, [f64; GAIN.len()]) {
    let servo = &joint.servo;
    let law = match servo.law {
        ServoLaw::Pd => Law::Pd,
        ServoLaw::Decoupled => Law::ComputedTorque,
    };
    let gains = [
        servo.kp,
        servo.kv,
        servo.ki,
        servo.integral_max,
        servo.bandwidth_hz,
        servo.zeta,
        servo.k_tau,
    ];
    (law, gains)
}

impl<'h, P, const N: usize> OfParts<'h, P, N> {
    /// Returns a part that is served, by its number among these: its finger and its name.
    fn part(&self, mut number: usize) -> Option<(&'h Finger<JOINTS, ACTUATORS>, &'h Name)> {
        for &finger in &self.fingers {
            if let Some(name) = self.kind.name(finger, number) {
                return Some((finger, name));
            }
            number -= self.kind.count(finger);
        }
        None
    }

    /// Returns the number of a part of the finger at a place among those that are served.
    fn number(&self, place: usize, part: usize) -> Option<usize> {
        let of_finger = self.kind.count(self.fingers.get(place)?);
        let before = self.fingers.iter().take(place);
        let before = before.map(|finger| self.kind.count(finger));
        (part < of_finger).then_some(before.sum::<usize>() + part)
    }

    /// The greatest value of a number.
    fn most(&self, index: usize) -> Option<f64> {
        self.most.as_ref()?.get(index % N).copied()
    }
}

impl<P: Tune, const N: usize> Watch for OfParts<'_, P, N> {
    fn words(&self) -> &[AtomicU32] {
        let words = self.params.words();
        // The others are of parts that this processor does not serve.
        let parts = self.fingers.iter().map(|finger| self.kind.count(finger));
        let len = words.len() / self.kind.all() * parts.sum::<usize>();
        words.get(..len).unwrap_or(words)
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let (_, unit, about) = *self.names.get(index % N)?;
        self.part(index / N)?;
        let mut description = self.params.describe(index)?;
        if let Some(most) = self.most(index) {
            description.bounds = [0.0, most].map(Scalar::to_words);
        }
        Some(VarDescription {
            unit,
            about,
            ..description
        })
    }

    fn name(&self, index: usize, to: &mut dyn Write) -> fmt::Result {
        let (finger, part) = self.part(index / N).ok_or(fmt::Error)?;
        let (name, ..) = self.names.get(index % N).ok_or(fmt::Error)?;
        write!(to, "{}.{part}.{name}", finger.name)
    }
}

impl<P: Tune, const N: usize> Tune for OfParts<'_, P, N> {
    fn compare_and_set_words(
        &self,
        index: usize,
        expected: [u32; 2],
        new: [u32; 2],
    ) -> Result<(), ParamRefusal> {
        if let Some(most) = self.most(index) {
            let value = f64::from_words(new).filter(|value| (0.0..=most).contains(value));
            value.ok_or(ParamRefusal::OutOfBounds)?;
        }
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
        self.params.is_sound()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn utah() -> crate::RobotDescription {
        let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
        crate::RobotDescription::from_toml(text, "utah-mit.toml").unwrap()
    }

    /// The gains of a joint that runs as it is described.
    fn gains_of(joint: &Joint) -> JointGains {
        let servo = &joint.servo;
        JointGains {
            law: match servo.law {
                ServoLaw::Pd => PositionLaw::Pd {
                    kp: servo.kp,
                    kv: servo.kv,
                    ki: servo.ki,
                    integral_nm: servo.integral_max,
                },
                ServoLaw::Decoupled => PositionLaw::ComputedTorque {
                    bandwidth_hz: servo.bandwidth_hz,
                    damping_ratio: servo.zeta,
                },
            },
            k_torque: servo.k_tau,
        }
    }

    #[test]
    fn a_gain_can_be_set_to_what_is_described() {
        let mut hand = utah();
        let finger = &mut hand.fingers[0];
        (
            finger.joints[0].servo.bandwidth_hz,
            finger.actuators[0].gains.kp,
        ) = (80.0, 500.0);
        let values = described(&finger.joints[0]).1;
        let EffortGains { kp, ki, kd, kv } = finger.actuators[0].gains;
        let fingers = super::super::fingers_on(&hand, 1);
        let gains = Gains::new(&fingers);
        let can_be_set = |gains: &dyn Tune, values: &[f64], most: &[f64]| {
            let set = |index: usize, from: f64, to: f64| {
                gains.compare_and_set_words(index, from.to_words(), to.to_words())
            };
            for (index, (&value, &most)) in values.iter().zip(most).enumerate() {
                assert_eq!(gains.initial(index), value.to_words());
                set(index, value, 0.5).unwrap();
                set(index, 0.5, value).unwrap();
                let most = value.max(most);
                assert_eq!(
                    set(index, value, 1.01 * most),
                    Err(ParamRefusal::OutOfBounds)
                );
                let bounds = gains.describe(index).unwrap().bounds;
                assert_eq!(bounds, [0.0, most].map(Scalar::to_words));
            }
        };
        can_be_set(&gains.numbers, &values, &MOST);
        can_be_set(&gains.efforts, &[kp, ki, kd, kv], &MOST_EFFORT);
    }

    #[test]
    fn a_gain_that_is_set_is_that_of_its_joint_alone() {
        let mut hand = utah();
        for (number, finger) in (0_u8..).zip(&mut hand.fingers) {
            for (joint, entry) in (0_u8..).zip(&mut finger.joints) {
                entry.servo.bandwidth_hz = 10.0 + f64::from(number);
                entry.servo.k_tau = f64::from(joint);
            }
        }
        let first = |finger: usize, joint: usize| gains_of(&hand.fingers[finger].joints[joint]);
        let fingers = super::super::fingers_on(&hand, 1);
        let gains = Gains::new(&fingers);
        let number = |wanted: &str| {
            (0..NUMBERS).find(|&index| {
                let mut name = String::new();
                gains.numbers.name(index, &mut name).unwrap();
                name == wanted
            })
        };
        let kp = number("middle.proximal.servo.kp").unwrap();
        assert_eq!(gains.numbers.describe(kp).unwrap().unit, "N m/rad");
        let params = &gains.numbers.params;
        let bandwidth = number("index.middle.servo.bandwidth_hz").unwrap();
        let set = |hz: f64| {
            let now = 10.0_f64.to_words();
            (gains.numbers).compare_and_set_words(bandwidth, now, hz.to_words())
        };
        assert_eq!(set(9999.0), Err(ParamRefusal::OutOfBounds));
        assert_eq!(set(f64::NAN), Err(ParamRefusal::OutOfBounds));
        let described = gains.numbers.describe(bandwidth).unwrap();
        assert_eq!(described.bounds, [0.0_f64, 50.0].map(Scalar::to_words));
        params.compare_and_set_at(kp, 1.0, 7.0).unwrap();
        let torque = number("middle.proximal.servo.k_tau").unwrap();
        params.compare_and_set_at(torque, 1.0, 0.5).unwrap();
        assert_eq!(
            params.compare_and_set_at(torque, 0.5, -1.0),
            Err(ParamRefusal::OutOfBounds)
        );
        let before = gains.version();
        assert_eq!(gains.of(1, 1), Some(first(1, 1)));
        gains.numbers.latch();
        assert_ne!(gains.version(), before);
        let mut changed = first(1, 1);
        changed.k_torque = 0.5;
        assert_eq!(gains.of(1, 1), Some(changed));
        assert_eq!(gains.of(1, 2), Some(first(1, 2)));
        assert_eq!(gains.of(0, 1), Some(first(0, 1)));
        let laws = &gains.laws.params;
        laws.compare_and_set_at(5, Law::ComputedTorque, Law::Pd)
            .unwrap();
        laws.latch();
        let law = gains.of(1, 1).unwrap().law;
        assert!(
            matches!(law, PositionLaw::Pd { kp, .. } if (kp - 7.0).abs() < 1e-12),
            "{law:?}"
        );
        assert_eq!(gains.of(FINGERS, 0), None);
        // That of the extensor of the second joint of the second finger.
        let efforts = &gains.efforts;
        let kp = (ACTUATORS + 3) * EFFORT_GAIN.len();
        let mut name = String::new();
        efforts.name(kp, &mut name).unwrap();
        assert_eq!(name, "middle.proximal-extensor.gains.kp");
        efforts.params.compare_and_set_at(kp, 1.0, 0.5).unwrap();
        efforts.latch();
        let described = hand.fingers[1].actuators[3].gains;
        let changed = EffortGains {
            kp: 0.5,
            ..described
        };
        assert_eq!(gains.of_actuator(1, 3), Some(changed));
        assert_eq!(gains.of_actuator(1, 2), Some(described));
        assert_eq!(gains.of_actuator(1, ACTUATORS), None);
        assert_eq!(gains.laws.words().len(), 2 * JOINTS);
    }

    #[test]
    fn short_fingers_have_gains_of_their_joints_alone() {
        let robot = crate::joints::short();
        let fingers = super::super::fingers_on(&robot, 1);
        let gains = Gains::new(&fingers);
        for (place, joints) in [2, 4].into_iter().enumerate() {
            for joint in 0..joints {
                let described = gains_of(&fingers[place].joints[joint]);
                assert_eq!(gains.of(place, joint), Some(described));
            }
            assert!(gains.of(place, joints).is_none());
        }
        assert!(gains.of(2, 0).is_none());
        let mut name = String::new();
        gains.laws.name(2, &mut name).unwrap();
        assert_eq!(name, "middle.abduction.servo.law");
        assert!(gains.laws.name(6, &mut name).is_err());
        assert_eq!(gains.laws.words().len(), 6);
    }
}
