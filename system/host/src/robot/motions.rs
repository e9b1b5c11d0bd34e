//! [`MotionFiles`]: motion files of a robot, and [`MotionSender`]: motions for the robot of a running system.

use serde::Serialize;

use crate::error::AnyError;

/// The motion files of a robot, for a person who composes motions.
///
/// # For implementers
///
/// The names of files come from a network. A name is refused unless it is one that
/// [`list`](Self::list) could return: without any path, and with the ending of motion files.
pub trait MotionFiles {
    /// Returns the names of the files, in alphabetical order.
    ///
    /// # Errors
    /// An error that says why the files cannot be listed.
    fn list(&self) -> Result<Vec<String>, AnyError>;

    /// Returns the text of a file.
    ///
    /// # Errors
    /// An error that names the file, and says why it cannot be read.
    fn read(&self, file: &str) -> Result<String, AnyError>;

    /// Writes a file. Only with `replaces` may there be one of this name.
    ///
    /// # Errors
    /// An error that says what is wrong with the name or the text, that there is such a file, or why it
    /// cannot be written.
    fn write(&mut self, file: &str, text: &str, replaces: bool) -> Result<(), AnyError>;
}

/// The way to have the robot of a running system make composed motions.
///
/// # For users
///
/// Calls may wait for the system for some seconds.
pub trait MotionSender {
    /// Enqueues the text of a motion file, and returns a number for [`outcome`](Self::outcome). If
    /// somebody else is in control of the robot, the motion is enqueued only with `takes_control`.
    ///
    /// # Errors
    /// An error that says what is wrong with the text, who is in control, or why the system cannot be asked.
    fn enqueue(&mut self, text: &str, takes_control: bool) -> Result<u64, AnyError>;

    /// Returns what has become of an enqueued motion.
    ///
    /// # Errors
    /// An error that says that there is no such number, or why the system cannot be asked.
    fn outcome(&mut self, id: u64) -> Result<MotionOutcome, AnyError>;
}

/// What has become of an enqueued motion.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct MotionOutcome {
    /// Its state, in a word: `accepted`, `started`, `done`, or others of the robot.
    pub state: String,
    /// The reason for which it is refused or has ended early.
    pub reason: Option<String>,
    /// How much of it is done, in 0..=1; `None` if nobody knows.
    pub progress: Option<f64>,
    /// Whether nothing changes any more.
    pub is_final: bool,
}
