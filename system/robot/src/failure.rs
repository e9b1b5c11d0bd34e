//! [`Failure`]: the reason why a program of the robot ended before it was told to.

use condor_fs::FileError;
use condor_hand::NumberError;
use thiserror::Error;

use crate::boards::{BoardError, BusFault};
use crate::recording::ServoRecordingError;

/// The text of another crate's error, cut to 80 bytes.
pub type FailureText = condor_rt::ShortText<80>;

/// The name of a file, cut to 32 bytes.
pub type FileName = condor_rt::ShortText<32>;

/// The reason why a program of the robot could not begin, or ended by itself. Errors that any program can have are in
/// [`ProgramError`](condor_rt::ProgramError).
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Failure {
    /// The file of the configuration cannot be read.
    #[error("{name}: {error}")]
    File {
        /// The name of the file.
        name: &'static str,
        /// The reason.
        error: FileError,
    },
    /// The file of the configuration holds no valid image.
    #[error("{name}: {error}")]
    Image {
        /// The name of the file.
        name: &'static str,
        /// The text of the reader's error.
        error: FailureText,
    },
    /// The boards cannot serve the description, or cannot be opened.
    #[error(transparent)]
    Boards(#[from] BoardError),
    /// The bus did not answer the simulated robot.
    #[error(transparent)]
    Bus(#[from] BusFault),
    /// The configuration assigns no finger to a servo processor.
    #[error("the configuration has no finger for processor {processor}")]
    NoFinger {
        /// The number of the processor.
        processor: u8,
    },
    /// The configuration does not have this processor.
    #[error("the configuration has no processor {processor}")]
    NoProcessor {
        /// The number of the processor.
        processor: u8,
    },
    /// A finger cannot be controlled.
    #[error("cannot control finger {finger}: {error}")]
    Controller {
        /// The finger, from 0.
        finger: usize,
        /// The number that is not possible.
        error: NumberError,
    },
    /// The configuration has no table.
    #[error(
        "the configuration has no `[[table.axes]]`, so there is no table to control; add them, or leave out this program"
    )]
    NoTable,
    /// The table, the trajectories or the simulated robot cannot have a number of the configuration.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// The program does not know an argument.
    #[error("unknown argument \"{argument}\"; the program takes {known}")]
    Argument {
        /// The argument that was given.
        argument: FailureText,
        /// The arguments that the program takes.
        known: &'static str,
    },
    /// A necessary argument of the program is missing.
    #[error("the argument {wanted} is missing")]
    NoArgument {
        /// The missing argument.
        wanted: &'static str,
    },
    /// The recording of a servo processor cannot be made or replayed.
    #[error("{name}: {error}")]
    Recording {
        /// The name of its file.
        name: FileName,
        /// The reason.
        error: ServoRecordingError,
    },
}

impl From<Failure> for condor_rt::ProgramError {
    fn from(failure: Failure) -> Self {
        Self::program(&failure)
    }
}
