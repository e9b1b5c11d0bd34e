//! [`Words`]: what was typed, and [`Problem`]: why it is not done.

use core::fmt;

use condor_fs::{Errno, FileError};
use condor_hand::config::{Finger, Name};
use condor_hand::controller::GuardStop;
use condor_hand::decimal::Decimal;
use condor_hand::fault::FaultCode;
use condor_hand::grasp::GraspError;
use condor_hand::grasp::distributed::GraspReason;
use condor_hand::servo::TargetQuantity;
use condor_hand::trajectory::{MotionError, MotionGuard};
use condor_hand::{ImageError, NumberError};
use condor_mbox::AccessError;
use condor_mbox::exchange::ExchangeError;
use condor_rt::ShortText;
use condor_rt::supervisor::SupervisorError;
use condor_vars::{RequestError, VariableTableError};
use thiserror::Error;

use crate::RobotDescription;
use crate::joints::{actuator_names, joint_names};
use crate::packet::ClientError;
use crate::queue::{RefusalReason, SessionOwner};
use crate::{ACTUATORS, JOINTS, plant, table};

/// The reason why a command is not done.
#[derive(Debug, Error)]
pub(super) enum Problem<'l> {
    #[error("there is no command \"{0}\"; `help` lists them")]
    Command(&'l str),
    #[error("give {0}")]
    Missing(&'static str),
    #[error("\"{word}\" is not {what}")]
    Not { word: &'l str, what: &'static str },
    #[error("\"{0}\" is one word too many")]
    TooMany(&'l str),
    #[error("no finger is called \"{word}\"; there are {known}")]
    Finger { word: &'l str, known: NameList },
    #[error("no joint is called \"{word}\"; there are {known}")]
    Joint { word: &'l str, known: NameList },
    #[error("no joint or actuator is called \"{word}\"; there are {known}")]
    Part { word: &'l str, known: NameList },
    #[error("no actuator is called \"{word}\"; there are {known}")]
    Actuator { word: &'l str, known: NameList },
    #[error(
        "\"{0}\" cannot be the name of a motion: a name has letters, digits, - and _, at most {max}", max = NAME_BYTES)]
    Name(&'l str),
    #[error("there is no gain \"{0}\"; `gains` with the name alone shows all")]
    Gain(&'l str),
    #[error(
        "{name} cannot be {value}; it may be {low} to {high}",
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Bounds {
        word: &'l str,
        name: &'l str,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error(
        "{name} cannot be {value} {unit}; it may be {low} to {high} {unit}",
        name = .range.name,
        unit = .range.unit,
        value = Decimal(*.value),
        low = Decimal(.range.low),
        high = Decimal(.range.high),
    )]
    Range {
        word: &'l str,
        value: f64,
        range: plant::NumberRange,
    },
    #[error("{names}", names = NotEnabled(.0))]
    NotEnabled(NameList),
    #[error("{finger}.{joint} is in the mode {mode}: `enable {finger}` makes it hold its position")]
    OtherMode {
        finger: Name,
        joint: Name,
        mode: &'static str,
    },
    #[error(
        "the effort of {finger}.{actuator} cannot be {value}; it may be {low} to {high}",
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Effort {
        finger: Name,
        actuator: Name,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error(
        "{quantity} cannot be {value} {unit} at {finger}.{joint}; it may be {low} to {high}",
        quantity = .quantity.name(),
        unit = .quantity.unit(),
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Target {
        finger: Name,
        joint: Name,
        quantity: TargetQuantity,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error("{0} is held by a grasp: type `release` first")]
    InGrasp(Name),
    #[error(
        "the position of {0} is not known: its processor does not run; `status` shows its number, `restart` starts it"
    )]
    NotMeasured(Name),
    #[error("no motion runs: `run` begins one")]
    NoMotion,
    #[error("no finger holds the ball: `grasp` takes it")]
    NoGrasp,
    #[error("{finger} still has its fault: {fault}; {remedy}", remedy = .code.remedy())]
    Fault {
        finger: Name,
        fault: ShortText<200>,
        code: FaultCode,
    },
    #[error("{0} rests after a fault: `enable {0}` makes it hold its position")]
    AfterFault(Name),
    #[error(
        "the fault of {0} is cleared, but its actuators have not come to rest; wait, and `enable {0}` again"
    )]
    Resting(Name),
    #[error("a motion runs or waits: type `abort` first")]
    Running,
    #[error("{who} is in control, by session {session}: `control` takes control from it", who = Client(*.owner))]
    InControl {
        owner: Option<SessionOwner>,
        session: u32,
    },
    #[error("the motion is refused: {0}")]
    Refused(RefusalReason),
    #[error("the ledger of motions cannot be read or written yet, and nothing moves; try again")]
    NoQueue,
    #[error("{LEDGER}: {0}")]
    LedgerFile(#[from] RowError),
    #[error("{LEDGER}: {0}; remove the file, and the master makes a new one")]
    Ledger(ImageError),
    #[error("no motion is in memory: `record` or `open` puts one there; `run MOTION` needs none")]
    Nothing,
    #[error("cannot read the motions: {0}")]
    Offered(ImageError<MotionError>),
    #[error("the motion moves joint {joint}, which the robot does not have")]
    NoSuchJoint { joint: u32 },
    #[error(
        "motion {number} is to stop at contact, but {finger} has no tactile sensor; give it a guard of torque"
    )]
    Guard { number: u32, finger: Name },
    #[error(
        "{number}{joint} cannot go to {value} rad; it may be {low} to {high} rad",
        number = MotionNumber(*.number),
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Beyond {
        /// From 1; 0 for a motion that is alone.
        number: u32,
        joint: heapless::String<136>,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error(
        "the supervisor still carries out `{0}`, which was typed before; try again when it is done"
    )]
    Ordered(heapless::String<48>),
    #[error(transparent)]
    Supervisor(#[from] SupervisorError),
    #[error(
        "processor {0} does not run its part of the robot (servos, table or simulation), which this command needs: \
         `restart {0}` starts it"
    )]
    Absent(u8),
    #[error(
        "nothing simulates the robot, which this command needs: `restart` the processor that does, if there is one"
    )]
    NoPlant,
    #[error(
        "the position of the ball is not known: `restart` the processor that measures it, if there is one"
    )]
    NoCamera,
    #[error("no ball is in sight: `ball` adds a simulated one")]
    NotSeen,
    #[error(
        "the robot has no table: give its configuration `[[table.axes]]`, and a processor for them"
    )]
    NoTable,
    #[error(
        "{finger}.{actuator} has no sensor of its effort; `fault {finger}.{actuator} drive` cuts its drive"
    )]
    NotSensed { finger: Name, actuator: Name },
    #[error("the simulated robot refused the request: {0}")]
    Plant(plant::PlantRefusal),
    #[error("the table refused the request: {0}")]
    Table(table::TableRefusal),
    #[error(
        "{fingers} cannot take part in the grasp: {reason}",
        reason = .reason.as_str()
    )]
    Grasp {
        fingers: NameList,
        reason: GraspReason,
    },
    #[error("there is no file {0}: {remedy}", remedy = missing(.0))]
    NoFile(Path),
    #[error("there is a file {0} already: `save` with another name")]
    Exists(Path),
    #[error("{name}: {error}; {remedy}", remedy = again(.error))]
    File { name: Path, error: FileError },
    #[error("{name}: {error}; `motions` lists others")]
    Image {
        name: Path,
        error: ImageError<MotionError>,
    },
    #[error("{name}: {error}; give the name of another grasp, or a stiffness")]
    GraspImage {
        name: Path,
        error: ImageError<GraspError>,
    },
    #[error("the recording {0} has no room for this motion: type `save`, and `record` another one")]
    Full(MotionName),
    #[error(transparent)]
    Motion(#[from] MotionError),
    #[error(transparent)]
    Number(#[from] NumberError),
    #[error(transparent)]
    Client(#[from] ClientError),
    #[error(transparent)]
    Request(#[from] RequestError),
    #[error(transparent)]
    Variables(#[from] VariableTableError),
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
    #[error(transparent)]
    Program(#[from] condor_rt::ProgramError),
}

impl Problem<'_> {
    /// Returns the number of the word of `line` in which the mistake is, from 1; `None` if it is in
    /// no word.
    pub(super) fn place(&self, line: &str) -> Option<usize> {
        let wrong: &str = match self {
            Self::Command(word)
            | Self::Not { word, .. }
            | Self::TooMany(word)
            | Self::Finger { word, .. }
            | Self::Joint { word, .. }
            | Self::Actuator { word, .. }
            | Self::Part { word, .. }
            | Self::Name(word)
            | Self::Gain(word)
            | Self::Bounds { word, .. }
            | Self::Range { word, .. } => word,
            Self::Missing(_) => return Some(line.split_whitespace().count() + 1),
            _ => return None,
        };
        // The same word may be there twice: it is the one at this place.
        let at = |text: &str| text.as_ptr().addr().wrapping_sub(line.as_ptr().addr());
        let mut words = line.split_whitespace();
        let place = words.position(|word| (at(word)..=at(word) + word.len()).contains(&at(wrong)));
        place.map(|place| place + 1)
    }

    /// The same of a motion that has no number, since it is the only one.
    pub(super) fn alone(mut self) -> Self {
        if let Self::Beyond { number, .. } = &mut self {
            *number = 0;
        }
        self
    }

    /// Returns true if the same may be possible a moment later.
    pub(super) fn is_passing(&self) -> bool {
        matches!(self, Self::File { error, .. } if error.errno().is_none())
    }

    /// Returns the reason why a motion that cannot run is refused.
    pub(super) const fn reason(&self) -> RefusalReason {
        match self {
            Self::NoFile(_)
            | Self::File { .. }
            | Self::Image { .. }
            | Self::Nothing
            | Self::Offered(_)
            | Self::Full(_) => RefusalReason::NoMotion,
            Self::NotEnabled(_) | Self::InGrasp(_) | Self::OtherMode { .. } => {
                RefusalReason::NotReady
            }
            _ => RefusalReason::Limits,
        }
    }
}

impl Problem<'_> {
    /// The reason why a file of motions or grasps was not read or written.
    pub(super) fn of_file(name: Path, error: FileError) -> Self {
        match error.errno() {
            Some(Errno::NOENT) => Self::NoFile(name),
            _ => Self::File { name, error },
        }
    }
}

/// Returns the remedy for a file that is missing.
fn missing(name: &str) -> &'static str {
    if name.starts_with(MOTIONS) {
        "`motions` lists those that are there"
    } else {
        "give a name of the directory `grasps`, or a stiffness"
    }
}

/// Returns the remedy for a file that the host cannot read or write.
fn again(error: &FileError) -> &'static str {
    if error.errno().is_some() {
        "look at this file in the directory that the host serves"
    } else {
        "try again"
    }
}

/// A program that moves the robot by messages, by the number of its processor if that is known.
struct Client(Option<SessionOwner>);

impl fmt::Display for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(owner) => write!(f, "the program of processor {}", owner.processor),
            None => f.write_str("another program"),
        }
    }
}

/// The text about a finger that is not enabled, or about several.
struct NotEnabled<'n>(&'n NameList);

impl fmt::Display for NotEnabled<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(names) = self;
        if names.bytes().any(|byte| byte == b',') {
            write!(
                f,
                "{names} are not enabled: `enable` makes them hold their positions"
            )
        } else {
            write!(
                f,
                "{names} is not enabled: `enable {names}` makes it hold its position"
            )
        }
    }
}

/// The number of a motion before what is said of it; nothing for 0.
struct MotionNumber(u32);

impl fmt::Display for MotionNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            number => write!(f, "motion {number}: "),
        }
    }
}

/// Which guard has stopped a finger, and at which value.
pub(super) struct GuardText<'h> {
    pub(super) entry: &'h Finger<JOINTS, ACTUATORS>,
    pub(super) stop: GuardStop,
}

impl fmt::Display for GuardText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entry, stop } = self;
        let finger = &entry.name;
        let (what, joint, unit) = match stop.guard {
            MotionGuard::Torque { joint } => ("a torque", Some(joint), "N m"),
            MotionGuard::Effort { joint } => ("an effort", Some(joint), ""),
            MotionGuard::Contact { .. } => ("a contact", None, "N"),
            MotionGuard::Time => ("a time", None, "s"),
        };
        write!(f, "{what} of ")?;
        if stop.value.is_finite() {
            write!(f, "{:.3}", Decimal(stop.value))?;
            if !unit.is_empty() {
                write!(f, " {unit}")?;
            }
        } else {
            f.write_str("an unknown value")?;
        }
        write!(f, " at {finger}")?;
        if let Some(joint) = joint.and_then(|joint| entry.joints.get(joint)) {
            write!(f, ".{}", joint.name)?;
        }
        f.write_str(" has stopped a motion")
    }
}

/// The reason why a row is not written.
#[derive(Clone, Copy, Debug, Error)]
pub(super) enum RowError {
    #[error("{0}; {remedy}", remedy = again(.0))]
    File(#[from] FileError),
    #[error("it has {found} bytes instead of {size}; the master writes a new one")]
    Length { found: u64, size: usize },
}

/// Returns true if `word` can be the name of a motion: 1 to 24 ASCII letters, digits, `-` and `_`.
#[must_use]
pub fn is_name(word: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
    !word.is_empty() && word.len() <= NAME_BYTES && word.bytes().all(is_plain)
}

/// The directory of motions.
pub(super) const MOTIONS: &str = "motions";
/// The file of the ledger of motions.
pub(super) const LEDGER: &str = "motions.ledger";
/// The longest name of a motion.
const NAME_BYTES: usize = 24;
/// The name of a motion's file, without its suffix.
pub(super) type MotionName = heapless::String<NAME_BYTES>;

/// The path of a file.
pub(super) type Path = heapless::String<48>;

/// Names that are there, as a sentence has them.
pub(super) type NameList = heapless::String<256>;

/// Lists the fingers of a mask.
pub(super) fn names(hand: &RobotDescription, fingers: u64) -> NameList {
    let entries = hand.fingers.iter().enumerate();
    known(
        entries
            .filter(|(finger, _)| fingers >> finger & 1 != 0)
            .map(|(_, it)| &it.name),
    )
}

/// Lists names; what does not fit is left out.
fn known<'n>(names: impl Iterator<Item = &'n Name>) -> NameList {
    let mut known = NameList::new();
    for name in names {
        let comma = if known.is_empty() { "" } else { ", " };
        if known.len() + comma.len() + name.len() <= known.capacity() {
            let _ = known.push_str(comma).and_then(|()| known.push_str(name));
        }
    }
    known
}

/// The words of a line, one after another.
#[derive(Clone)]
pub(super) struct Words<'l>(core::str::SplitWhitespace<'l>);

impl<'l> Words<'l> {
    pub(super) fn of(line: &'l str) -> Self {
        Self(line.split_whitespace())
    }

    pub(super) fn next(&mut self) -> Option<&'l str> {
        self.0.next()
    }

    /// The words that are left, without taking them.
    pub(super) fn peek(&self) -> core::str::SplitWhitespace<'l> {
        self.0.clone()
    }

    /// The next word, which says `what`.
    pub(super) fn word(&mut self, what: &'static str) -> Result<&'l str, Problem<'l>> {
        self.0.next().ok_or(Problem::Missing(what))
    }

    /// The next word as a finite number.
    pub(super) fn number(&mut self, what: &'static str) -> Result<f64, Problem<'l>> {
        let word = self.word(what)?;
        number(word, what)
    }

    /// The next word as a number in a range.
    pub(super) fn within(
        &mut self,
        what: &'static str,
        range: plant::NumberRange,
    ) -> Result<f64, Problem<'l>> {
        let word = self.word(what)?;
        match number(word, what)? {
            value if range.contains(value) => Ok(value),
            value => Err(Problem::Range { word, value, range }),
        }
    }

    /// The next word, if there is one, as a number in a range.
    pub(super) fn maybe_within(
        &mut self,
        what: &'static str,
        range: plant::NumberRange,
    ) -> Result<Option<f64>, Problem<'l>> {
        if self.peek().next().is_none() {
            return Ok(None);
        }
        self.within(what, range).map(Some)
    }

    /// The next three words as numbers in a range, such as a vector has.
    pub(super) fn three_within(
        &mut self,
        what: &'static str,
        range: plant::NumberRange,
    ) -> Result<[f64; 3], Problem<'l>> {
        let mut next = || self.within(what, range);
        Ok([next()?, next()?, next()?])
    }

    /// The next word, if there is one, as a finite number above zero.
    pub(super) fn positive(&mut self, what: &'static str) -> Result<Option<f64>, Problem<'l>> {
        let Some(word) = self.0.next() else {
            return Ok(None);
        };
        match number(word, what)? {
            value if value > 0.0 => Ok(Some(value)),
            _ => Err(Problem::Not { word, what }),
        }
    }

    /// The next word as the name of a motion.
    pub(super) fn name(&mut self) -> Result<&'l str, Problem<'l>> {
        let word = self.word("the name of a motion")?;
        if is_name(word) {
            Ok(word)
        } else {
            Err(Problem::Name(word))
        }
    }

    /// The next word as a finger of the hand, from 0.
    pub(super) fn finger(&mut self, hand: &RobotDescription) -> Result<Option<usize>, Problem<'l>> {
        let Some(word) = self.0.next() else {
            return Ok(None);
        };
        named(word, hand).map(Some)
    }

    /// The next word as FINGER.JOINT: both from 0.
    pub(super) fn joint(&mut self, hand: &RobotDescription) -> Result<(usize, usize), Problem<'l>> {
        let (finger, joint) = self.part("FINGER.JOINT", hand)?;
        let names = of_finger(hand, finger, joint_names);
        let problem = || Problem::Joint {
            word: joint,
            known: known(names.clone()),
        };
        let found = names.clone().position(|name| name == joint);
        Ok((finger, found.ok_or_else(problem)?))
    }

    /// The next word as FINGER.ACTUATOR: both from 0.
    pub(super) fn actuator(
        &mut self,
        hand: &RobotDescription,
    ) -> Result<(usize, usize), Problem<'l>> {
        let (finger, actuator) = self.part("FINGER.ACTUATOR", hand)?;
        let names = of_finger(hand, finger, actuator_names);
        let problem = || Problem::Actuator {
            word: actuator,
            known: known(names.clone()),
        };
        let found = names.clone().position(|name| name == actuator);
        Ok((finger, found.ok_or_else(problem)?))
    }

    /// The next word as a finger, from 0, and the name of a part of it.
    fn part(
        &mut self,
        what: &'static str,
        hand: &RobotDescription,
    ) -> Result<(usize, &'l str), Problem<'l>> {
        let word = self.word(what)?;
        let dot = word.bytes().position(|byte| byte == b'.');
        let names = dot.and_then(|dot| Some((word.get(..dot)?, word.get(dot + 1..)?)));
        let (finger, part) = names.ok_or(Problem::Not { word, what })?;
        Ok((named(finger, hand)?, part))
    }

    /// The next word as a finger, from 0, and the name of one of its joints or actuators.
    pub(super) fn joint_or_actuator(
        &mut self,
        hand: &RobotDescription,
    ) -> Result<(usize, &'l str), Problem<'l>> {
        let (finger, word) = self.part("FINGER.PART", hand)?;
        let joints = of_finger(hand, finger, joint_names);
        let names = joints.chain(of_finger(hand, finger, actuator_names));
        if names.clone().any(|name| name == word) {
            return Ok((finger, word));
        }
        let known = known(names);
        Err(Problem::Part { word, known })
    }

    /// All words that are left.
    pub(super) fn rest(&mut self) -> impl Iterator<Item = &'l str> {
        self.0.by_ref()
    }

    /// There must be no more words.
    pub(super) fn end(&mut self) -> Result<(), Problem<'l>> {
        match self.0.next() {
            None => Ok(()),
            Some(word) => Err(Problem::TooMany(word)),
        }
    }
}

/// The names of the parts of a finger; none of one that the hand does not have.
fn of_finger<'h, I: Iterator<Item = &'h Name> + Clone>(
    hand: &'h RobotDescription,
    finger: usize,
    names: impl Fn(&'h Finger<JOINTS, ACTUATORS>) -> I + Clone,
) -> impl Iterator<Item = &'h Name> + Clone {
    hand.fingers.get(finger).into_iter().flat_map(names)
}

/// The finger that is called so, from 0.
fn named<'l>(word: &'l str, hand: &RobotDescription) -> Result<usize, Problem<'l>> {
    let mut fingers = hand.fingers.iter();
    let found = fingers.position(|finger| finger.name == word);
    let problem = || Problem::Finger {
        word,
        known: known(hand.fingers.iter().map(|it| &it.name)),
    };
    found.ok_or_else(problem)
}

pub(super) fn number<'l>(word: &'l str, what: &'static str) -> Result<f64, Problem<'l>> {
    let value = Decimal::parse(word).map(|value| value.0);
    let value = value.filter(|value| value.is_finite());
    value.ok_or(Problem::Not { word, what })
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn words_are_what_they_are_asked_for() {
        let mut words = Words::of("  0.5 1e400 0 wave a/b  ");
        let half = words.number("a position, rad").unwrap();
        assert_eq!(half.to_bits(), 0.5_f64.to_bits());
        assert_eq!(
            words.number("a position, rad").unwrap_err().to_string(),
            "\"1e400\" is not a position, rad"
        );
        assert_eq!(
            words
                .positive("a time, s, above 0")
                .unwrap_err()
                .to_string(),
            "\"0\" is not a time, s, above 0"
        );
        assert_eq!(words.name().unwrap(), "wave");
        assert!(matches!(words.name(), Err(Problem::Name("a/b"))));
        assert!(words.end().is_ok());
        assert!(words.positive("a time, s, above 0").unwrap().is_none());
        assert!(matches!(words.word("it"), Err(Problem::Missing("it"))));
    }
}
