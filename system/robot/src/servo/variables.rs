//! [`Variables`]: what the servo loop shows of its fingers.

use core::fmt::{self, Write};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_hand::config::Finger;
use condor_hand::controller::FingerTick;
use condor_hand::fault::FaultCode;
use condor_hand::servo::FingerReadings;
use condor_vars::{ValueKind, VarDescription, Watch};

use super::ServedFingers;
use super::control::OfFingers;
use crate::{ACTUATORS, FINGERS, JOINTS};

/// The variables of each joint: name, unit and description.
const JOINT: [Names; 5] = [
    ("position", "rad", "Filtered position."),
    ("velocity", "rad/s", "The rate of the filtered position."),
    ("target", "rad", "NaN where positions are not controlled."),
    ("torque", "N m", "Torque of the desired efforts."),
    ("error", "rad", "Target less position."),
];
/// The variables of each actuator, after those of the joints. Their unit is that of [`Finger::effort_unit`].
const ACTUATOR: [Names; 3] = [
    (
        "effort",
        "",
        "Measured effort; the desired one without a sensor.",
    ),
    ("desired", "", "Desired effort."),
    ("command", "", "Command to the actuator."),
];
/// The variables of each finger, after those of its actuators.
const FINGER: [Names; 3] = [
    (
        "touch",
        "N",
        "The force at its tip, as its sensor measures it; NaN without one.",
    ),
    (
        "saturated",
        "",
        "A bit for each joint whose actuators cannot give the torque that it needs.",
    ),
    (
        FAULT,
        "",
        "The kind of the fault that the finger has; its processor's terminal says more.",
    ),
];
const FAULT: &str = "fault";
/// The texts of the values of [`FAULT`].
const FAULTS: [&str; FaultCode::ALL.len() + 1] = {
    let mut names = ["none"; FaultCode::ALL.len() + 1];
    let mut code = 0;
    while code < FaultCode::ALL.len() {
        names[code + 1] = FaultCode::ALL[code].name();
        code += 1;
    }
    names
};
const OF_FINGER: usize = JOINTS * JOINT.len() + ACTUATORS * ACTUATOR.len() + FINGER.len();

type Names = (&'static str, &'static str, &'static str);

/// The variables of the servo loop about its fingers, under names such as `index.proximal.torque` and
/// `index.proximal-flexor.effort`.
pub(super) struct Variables<'h> {
    fingers: ServedFingers<'h>,
    words: [AtomicU32; FINGERS * OF_FINGER],
}

impl<'h> Variables<'h> {
    pub(super) const fn new(fingers: ServedFingers<'h>) -> Self {
        Self {
            fingers,
            words: [const { AtomicU32::new(0) }; FINGERS * OF_FINGER],
        }
    }

    /// Shows what the fingers felt and did in a tick.
    pub(super) fn show(
        &self,
        sensed: &OfFingers<FingerReadings<JOINTS, ACTUATORS>>,
        ticks: &OfFingers<FingerTick<JOINTS, ACTUATORS>>,
    ) {
        let served = sensed.iter().zip(ticks);
        let served = served.filter_map(|(sensed, tick)| sensed.as_ref().zip(tick.as_ref()));
        let mut words = self.words.iter();
        for (finger, (sensed, tick)) in self.fingers.iter().zip(served) {
            for joint in 0..finger.joints.len() {
                let values = of_joint(joint, tick).unwrap_or([f64::NAN; JOINT.len()]);
                for (value, word) in values.into_iter().zip(words.by_ref()) {
                    word.store((value as f32).to_bits(), Relaxed);
                }
            }
            for actuator in 0..finger.actuators.len() {
                let values = of_actuator(actuator, tick);
                let values = values.unwrap_or([f64::NAN; ACTUATOR.len()]);
                for (value, word) in values.into_iter().zip(words.by_ref()) {
                    word.store((value as f32).to_bits(), Relaxed);
                }
            }
            let fault = tick.fault.map_or(0, |fault| fault.code as u32 + 1);
            let touch = finger.touch.as_ref().map_or(f64::NAN, |_| sensed.touch);
            let values = [(touch as f32).to_bits(), tick.output.saturated, fault];
            for (value, word) in values.into_iter().zip(words.by_ref()) {
                word.store(value, Relaxed);
            }
        }
    }

    /// Returns the finger of a variable, and the part of it that the variable is about.
    fn part(&self, mut index: usize) -> Option<(&'h Finger<JOINTS, ACTUATORS>, Part)> {
        for finger in &self.fingers {
            let of_joints = finger.joints.len() * JOINT.len();
            if index < of_joints {
                let joint = Part::Joint(index / JOINT.len(), JOINT.get(index % JOINT.len())?);
                return Some((finger, joint));
            }
            index -= of_joints;
            let of_actuators = finger.actuators.len() * ACTUATOR.len();
            if index < of_actuators {
                let name = ACTUATOR.get(index % ACTUATOR.len())?;
                return Some((finger, Part::Actuator(index / ACTUATOR.len(), name)));
            }
            index -= of_actuators;
            if let Some(of_finger) = FINGER.get(index) {
                return Some((finger, Part::Finger(of_finger)));
            }
            index -= FINGER.len();
        }
        None
    }
}

/// Returns the number of variables of a finger, its joints and its actuators.
fn variables_of(finger: &Finger<JOINTS, ACTUATORS>) -> usize {
    let of_joints = finger.joints.len() * JOINT.len();
    of_joints + finger.actuators.len() * ACTUATOR.len() + FINGER.len()
}

/// In the order of [`JOINT`]; `None` for a joint that there is not.
fn of_joint(joint: usize, tick: &FingerTick<JOINTS, ACTUATORS>) -> Option<[f64; JOINT.len()]> {
    let output = &tick.output;
    let position = *output.position.get(joint)?;
    let target = tick.target.get(joint)?.unwrap_or(f64::NAN);
    Some([
        position,
        *output.velocity.get(joint)?,
        target,
        *output.torque.get(joint)?,
        target - position,
    ])
}

/// In the order of [`ACTUATOR`]; `None` for an actuator that there is not.
fn of_actuator(
    actuator: usize,
    tick: &FingerTick<JOINTS, ACTUATORS>,
) -> Option<[f64; ACTUATOR.len()]> {
    let output = &tick.output;
    let (desired, command) = (output.effort.get(actuator)?, output.command.get(actuator)?);
    Some([*tick.effort.get(actuator)?, *desired, *command])
}

impl Watch for Variables<'_> {
    fn words(&self) -> &[AtomicU32] {
        let len = self.fingers.iter().map(|finger| variables_of(finger)).sum();
        self.words.get(..len).unwrap_or(&self.words)
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let (finger, part) = self.part(index)?;
        let (kind, unit, about) = match part {
            Part::Finger(&(FAULT, unit, about)) => (ValueKind::Choice, unit, about),
            Part::Finger(&(_, "", about)) => (ValueKind::U32, "", about),
            Part::Actuator(actuator, &(_, _, about)) => {
                let unit = finger.effort_unit(finger.actuators.get(actuator)?);
                (ValueKind::F32, unit, about)
            }
            Part::Joint(_, &(_, unit, about)) | Part::Finger(&(_, unit, about)) => {
                (ValueKind::F32, unit, about)
            }
        };
        Some(VarDescription {
            kind,
            unit,
            about,
            labels: match kind {
                ValueKind::Choice => &FAULTS,
                _ => &[],
            },
            bounds: [[0; 2]; 2],
        })
    }

    fn name(&self, index: usize, to: &mut dyn Write) -> fmt::Result {
        let (finger, part) = self.part(index).ok_or(fmt::Error)?;
        match part {
            Part::Joint(joint, (name, ..)) => {
                let joint = finger.joints.get(joint).ok_or(fmt::Error)?;
                write!(to, "{}.{}.{name}", finger.name, joint.name)
            }
            Part::Actuator(actuator, (name, ..)) => {
                let actuator = finger.actuators.get(actuator).ok_or(fmt::Error)?;
                write!(to, "{}.{}.{name}", finger.name, actuator.name)
            }
            Part::Finger((name, ..)) => write!(to, "{}.{name}", finger.name),
        }
    }
}

/// The part of its finger that a variable is about.
enum Part {
    Joint(usize, &'static Names),
    Actuator(usize, &'static Names),
    Finger(&'static Names),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_word_has_a_name_of_its_own_and_its_kind() {
        let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
        let hand = crate::RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
        let variables = Variables::new(super::super::fingers_on(&hand, 1));
        let names: Vec<String> = (0..variables.words().len())
            .map(|index| {
                let mut name = String::new();
                variables.name(index, &mut name).unwrap();
                let described = variables.describe(index).unwrap();
                let kind = match name.rsplit('.').next().unwrap() {
                    "fault" => ValueKind::Choice,
                    "saturated" => ValueKind::U32,
                    _ => ValueKind::F32,
                };
                assert_eq!(described.kind, kind, "{name}");
                let label = described.labels.get(FaultCode::Stuck as usize + 1);
                assert_eq!(
                    label.is_some_and(|it| *it == "stuck"),
                    kind == ValueKind::Choice
                );
                name
            })
            .collect();
        assert_eq!(names[4 * 5 + 2 * 3 + 2], "index.proximal-flexor.command");
        assert_eq!(names[OF_FINGER - 1], "index.fault");
        assert_eq!(names[OF_FINGER], "middle.abduction.position");
        assert!((1..names.len()).all(|index| !names[..index].contains(&names[index])));
        assert!(variables.describe(names.len()).is_none());
    }

    #[test]
    fn short_fingers_have_variables_of_their_joints_alone() {
        let robot = crate::joints::short();
        // Each joint has two actuators.
        let (joint, finger) = (JOINT.len() + 2 * ACTUATOR.len(), FINGER.len());
        for (processor, names) in [
            (
                1,
                &[
                    (0, "index.abduction.position"),
                    (2 * joint, "index.touch"),
                    (2 * joint + finger, "middle.abduction.position"),
                    (6 * joint + 2 * finger - 1, "middle.fault"),
                ][..],
            ),
            (
                2,
                &[
                    (0, "ring.abduction.position"),
                    (joint + finger - 1, "ring.fault"),
                ],
            ),
        ] {
            let variables = Variables::new(super::super::fingers_on(&robot, processor));
            for &(index, expected) in names {
                let mut name = String::new();
                variables.name(index, &mut name).unwrap();
                assert_eq!(name, expected);
            }
            let last = names.last().map(|(index, _)| index + 1);
            assert_eq!(Some(variables.words().len()), last);
            assert!(variables.describe(variables.words().len()).is_none());
        }
    }
}
