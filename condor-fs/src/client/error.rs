//! [`FileError`] of a client.

use condor_mbox::{AccessError, Processor};
use embedded_io::WriteFmtError;

use crate::errno::Errno;

/// A receipt for an operation that timed out: [`FileSystem::ticket`](super::FileSystem::ticket)
/// asks for its result by the receipt. The number is the operation's sequence number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Receipt(pub u64);

/// The error of an operation on a file, a directory or a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The server refused the operation with this number, or the client did so without asking the
    /// server. The operation has had no effect, except the effect that the same error has on Unix.
    #[error("{0}")]
    Errno(Errno),
    /// The server has not answered in time. The operation of this call is in doubt: it may have
    /// been done, or may still be done. The next call, or [`settle`](super::FileSystem::settle),
    /// first waits until it has ended.
    #[error("the file server, {server}, did not answer in time{}", Cause(.cause))]
    TimedOut {
        /// The number of the server.
        server: Processor,
        /// The last error of the mailbox, if there was one.
        cause: Option<condor_mbox::MailboxError>,
        /// The receipt for the operation. [`FileSystem::ticket`](super::FileSystem::ticket) asks by
        /// it for the result that this call would have returned.
        receipt: Receipt,
    },
    /// The server has not answered an earlier request in time: an operation in doubt, or the
    /// closing of a dropped file. The operation of this call was not begun, and will not be.
    #[error("nothing was done: the file server, {server}, has not answered the previous request in time{}", Cause(.cause))]
    NotBegun {
        /// The number of the server.
        server: Processor,
        /// The last error of the mailbox, if there was one.
        cause: Option<condor_mbox::MailboxError>,
    },
    /// The processor's own mailbox cannot send. If an operation was in progress, it is in doubt:
    /// whether it was done is not known.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
    /// The processor's own window cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// `Display` of a value that `write!` was to write returned an error; a part of the text may
    /// have been written.
    #[error("a value cannot be formatted: its `Display` returned an error")]
    Format,
}

impl FileError {
    /// Returns the number of a [`FileError::Errno`], and `None` for every other error.
    #[must_use]
    pub const fn errno(&self) -> Option<Errno> {
        match self {
            Self::Errno(errno) => Some(*errno),
            _ => None,
        }
    }
}

impl From<Errno> for FileError {
    fn from(errno: Errno) -> Self {
        Self::Errno(errno)
    }
}

/// The error of `write!` and `writeln!` to a file.
impl From<WriteFmtError<FileError>> for FileError {
    fn from(error: WriteFmtError<FileError>) -> Self {
        match error {
            WriteFmtError::Other(error) => error,
            WriteFmtError::FmtError => Self::Format,
        }
    }
}

impl embedded_io::Error for FileError {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self {
            Self::Errno(errno) => embedded_io::Error::kind(errno),
            Self::TimedOut { .. } | Self::NotBegun { .. } => embedded_io::ErrorKind::TimedOut,
            Self::Mailbox(_) => embedded_io::ErrorKind::NotConnected,
            Self::Access(_) | Self::Format => embedded_io::ErrorKind::Other,
        }
    }
}

struct Cause<'a>(&'a Option<condor_mbox::MailboxError>);

impl core::fmt::Display for Cause<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some(error) => write!(f, ": {error}"),
            None => Ok(()),
        }
    }
}
