//! The commands that give joints other modes, and the weight that shows them.

use core::fmt::{self, Display};

use condor_hand::decimal::Decimal;
use condor_hand::servo::{JointTarget, ServoMode};
use condor_rt::Machine;

use super::{Commands, Problem, Words, with};
use crate::RobotDescription;
use crate::joints::ActuatorName;
use crate::plant;

/// The damping of an impedance for each unit of its stiffness, s, unless the command has one. Position laws of
/// up to 10 Hz have more.
const DAMPING: f64 = 0.03;
/// The modes that the command `mode` sets.
const MODES: &str = "a mode: off, effort, torque, position or impedance";
const STIFFNESS: &str = "a stiffness, N m/rad";
const WEIGHT: &str = "a weight, kg";

impl<'r, M: Machine> Commands<'r, '_, M> {
    /// A torque of one joint.
    pub(super) fn torque<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = words.joint(self.hand)?;
        let torque = words.number("a torque, N m")?;
        words.end()?;
        self.check_free(finger)?;
        self.servos
            .set_target(finger, joint, &JointTarget::Torque(torque))?;
        let (name, torque) = (self.named(finger, Some(joint)), Decimal(torque));
        self.say(format_args!("{name} has a torque of {torque} N m"));
        Ok(())
    }

    /// The effort of one actuator.
    pub(super) fn effort<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, actuator) = words.actuator(self.hand)?;
        let effort = words.number("an effort, N or N m")?;
        words.end()?;
        self.check_free(finger)?;
        self.servos.set_effort(finger, actuator, effort)?;
        let name = ActuatorName(self.hand, finger, actuator);
        let effort = Decimal(effort);
        let described = self.hand.fingers.get(finger);
        let described = described.zip(self.hand.actuator(finger, actuator));
        let unit = described.map_or("", |(finger, actuator)| finger.effort_unit(actuator));
        self.say(format_args!("{name} has an effort of {effort} {unit}"));
        Ok(())
    }

    /// A stiffness and a damping of one joint, or of all joints of a finger.
    pub(super) fn impedance<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = place(words, self.hand)?;
        let stiffness = words.number(STIFFNESS)?;
        let mut rest = words.peek();
        let damping = match rest.next() {
            Some(_) => words.number("a damping, N m s/rad")?,
            None => DAMPING * stiffness,
        };
        let position = match (joint, rest.next()) {
            (Some(_), Some(_)) => Some(words.number("a position, rad")?),
            _ => None,
        };
        words.end()?;
        self.check_free(finger)?;
        let count = self
            .hand
            .fingers
            .get(finger)
            .map_or(0, |it| it.joints.len());
        for joint in joints(joint, count) {
            let position = match position {
                Some(position) => position,
                None => self.present(finger, joint)?,
            };
            let target = JointTarget::Impedance {
                position,
                stiffness,
                damping,
            };
            self.servos.set_target(finger, joint, &target)?;
        }
        let name = self.named(finger, joint);
        let [stiffness, damping] = [stiffness, damping].map(Decimal);
        self.say(format_args!(
            "{name} acts as a spring of {stiffness} N m/rad, {damping} N m s/rad"
        ));
        Ok(())
    }

    /// Another mode of one joint, or of all joints of a finger, in which they keep what they have.
    pub(super) fn mode<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = place(words, self.hand)?;
        let what = MODES;
        let word = words.word(what)?;
        words.end()?;
        let mode = [
            ServoMode::Off,
            ServoMode::Effort,
            ServoMode::Torque,
            ServoMode::Position,
            ServoMode::Impedance,
        ];
        let mode = mode.into_iter().find(|mode| mode.name() == word);
        let mode = mode.ok_or(Problem::Not { word, what })?;
        self.check_free(finger)?;
        self.servos.set_mode(finger, joint, mode)?;
        let name = self.named(finger, joint);
        self.say(format_args!("{name} is in the mode {word}"));
        Ok(())
    }

    /// Hangs a weight on the tip of a finger of the simulated robot, in the place of any former one.
    pub(super) fn weight<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let word = words.word("FINGER")?;
        let finger = Words::of(word).finger(self.hand)?.unwrap_or_default();
        let mass = words.within(WEIGHT, plant::NumberRange::WEIGHT)?;
        words.end()?;
        self.others.plant(&plant::PlantRequest::PushTip {
            finger: finger as u32,
            force: self.hand.gravity.map(|gravity| mass * gravity),
            moment: [0.0; 3],
        })?;
        let mass = Decimal(mass);
        self.say(format_args!("{mass} kg hang on the tip of {word}"));
        Ok(())
    }

    /// Returns the name of a finger, or of one of its joints.
    fn named(&self, finger: usize, joint: Option<usize>) -> FingerOrJoint<'r> {
        FingerOrJoint(self.hand, finger, joint)
    }

    /// Checks that only this terminal, and no grasp, moves a finger; then the terminal is in control.
    fn check_free(&mut self, finger: usize) -> Result<(), Problem<'static>> {
        let status = self.servos.status(finger);
        if status.is_some_and(|status| status.modes.contains(&ServoMode::Grasp)) {
            let name = self.hand.fingers.get(finger).map(|it| it.name.clone());
            return Err(Problem::InGrasp(name.unwrap_or_default()));
        }
        self.requests.check_free()
    }

    /// Returns the measured position of a joint, within its limits, rad.
    fn present(&self, finger: usize, joint: usize) -> Result<f64, Problem<'static>> {
        let measured = with(self.shared, |drive| {
            drive.measured.get(finger).copied().flatten()
        });
        let is = measured.flatten().and_then(|all| all.get(joint).copied());
        if let (Some(is), Some(entry)) = (is, self.hand.joint(finger, joint)) {
            let limits = &entry.limits;
            return Ok(condor_hand::math::clamp(is, limits.low, limits.high));
        }
        let name = self.hand.fingers.get(finger).map(|it| it.name.clone());
        Err(Problem::NotMeasured(name.unwrap_or_default()))
    }
}

/// The name of a finger, or of one of its joints.
struct FingerOrJoint<'r>(&'r RobotDescription, usize, Option<usize>);

impl Display for FingerOrJoint<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(hand, finger, joint) = *self;
        let name = hand.fingers.get(finger).map_or("", |it| &it.name);
        match joint.and_then(|joint| hand.joint(finger, joint)) {
            Some(joint) => write!(f, "{name}.{}", joint.name),
            None => f.write_str(name),
        }
    }
}

/// The next word as FINGER or FINGER.JOINT.
fn place<'l>(
    words: &mut Words<'l>,
    hand: &RobotDescription,
) -> Result<(usize, Option<usize>), Problem<'l>> {
    if words.peek().next().is_some_and(|word| word.contains('.')) {
        let (finger, joint) = words.joint(hand)?;
        return Ok((finger, Some(joint)));
    }
    let finger = words.finger(hand)?;
    Ok((finger.ok_or(Problem::Missing("FINGER"))?, None))
}

/// One joint, or all of a finger of so many joints.
fn joints(only: Option<usize>, count: usize) -> impl Iterator<Item = usize> {
    (0..count).filter(move |&joint| only.is_none_or(|only| only == joint))
}
