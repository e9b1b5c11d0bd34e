//! [`MotionFiles`]: motion files of a robot, and [`MotionSender`]: motions for the robot of a running system.

use serde::Serialize;

use crate::error::AnyError;

/// The motion files of a robot, for a person who composes motions.
///
/// # For implementers
///
/// The names of files come from a network. Refuse every name that [`list`](Self::list) could not return: a name must
/// have the ending of motion files, and no path.
pub trait MotionFiles {
    /// Returns the names of the files, in alphabetical order.
    ///
    /// # Errors
    /// Returns an error if the files cannot be listed; the text says why.
    fn list(&self) -> Result<Vec<String>, AnyError>;

    /// Returns the text of a file.
    ///
    /// # Errors
    /// Returns an error if the name is refused, or if the file cannot be read; the text names the file and says
    /// why.
    fn read(&self, file: &str) -> Result<String, AnyError>;

    /// Writes a file. If there is a file of this name, it is replaced only if `replaces` is true.
    ///
    /// # Errors
    /// Returns an error if the name or the text is wrong, if there is such a file and `replaces` is false, or
    /// if the file cannot be written; the text says which.
    fn write(&mut self, file: &str, text: &str, replaces: bool) -> Result<(), AnyError>;
}

/// A sender of motions, which a person has composed, to the robot of a running system.
///
/// # For users
///
/// A call may wait for the system for some seconds.
pub trait MotionSender {
    /// Enqueues the text of a motion file, and returns a number for [`outcome`](Self::outcome). If
    /// somebody else is in control of the robot, the motion is enqueued only with `takes_control`.
    ///
    /// # Errors
    /// Returns an error if the text is wrong, if somebody else is in control, or if the system cannot be asked.
    /// The text of the error says what is wrong, or names the user in control.
    fn enqueue(&mut self, text: &str, takes_control: bool) -> Result<u64, AnyError>;

    /// Returns the present state of an enqueued motion.
    ///
    /// # Errors
    /// Returns an error if there is no motion with this number, or if the system cannot be asked.
    fn outcome(&mut self, id: u64) -> Result<MotionOutcome, AnyError>;
}

/// The state of a motion that a [`MotionSender`] has enqueued.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct MotionOutcome {
    /// The state of the motion, in a word: `accepted`, `started`, `done`, or others of the robot.
    pub state: String,
    /// The reason why it is refused or has ended early.
    pub reason: Option<String>,
    /// The part of the motion that is done, in 0..=1; `None` if it is not known.
    pub progress: Option<f64>,
    /// Whether the motion is over, so that this state does not change any more.
    pub is_final: bool,
}
