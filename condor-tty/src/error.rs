//! Errors on the processor's side.

use condor_mbox::{AccessError, MailboxError};
use embedded_io::ErrorKind;

use crate::layout::{ALIGNMENT, MAX_CAPACITY, MIN_CAPACITY};

/// The reason why [`Terminal::new`](crate::Terminal::new) did not make a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TerminalError {
    /// The terminal's memory cannot be accessed, or there is no room for it.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The size of the terminal's ring of output is not a power of two, or not from
    /// [`MIN_CAPACITY`] to [`MAX_CAPACITY`].
    #[error(
        "the output size of {capacity} bytes is not a power of two from {MIN_CAPACITY} to {MAX_CAPACITY}"
    )]
    Capacity {
        /// The size that was asked for, in bytes.
        capacity: u32,
    },
    /// The terminal's block would begin at an offset that messages cannot express: not a multiple
    /// of [`ALIGNMENT`] below 1 GiB.
    #[error(
        "a terminal cannot begin at offset {offset:#x}: the offset must be a multiple of {ALIGNMENT}, and below 2^30"
    )]
    Offset {
        /// The offset of the terminal's block in the users' region, in bytes.
        offset: u32,
    },
}

/// The reason why a read, write or flush of a [`Console`](crate::Console) failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ConsoleError {
    /// The host made no room in time, or no input came in time.
    ///
    /// `write`, `read` and `flush` have lost nothing then; `write_all` and formatted writes drop
    /// the rest.
    #[error("the terminal timed out, and {lost} bytes were lost")]
    TimedOut {
        /// The number of bytes that were dropped and counted as lost.
        lost: usize,
    },
    /// The character that interrupts was typed; this is reported once.
    #[error("the wait was interrupted from the keyboard")]
    Interrupted,
    /// The terminal's memory is gone.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The mailbox returned this error during the wait.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
}

impl embedded_io::Error for ConsoleError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::TimedOut { .. } => ErrorKind::TimedOut,
            Self::Interrupted => ErrorKind::Interrupted,
            Self::Access(_) | Self::Mailbox(_) => ErrorKind::Other,
        }
    }
}
