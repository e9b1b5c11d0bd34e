//! [`Error`] of a client.

use condor_mbox::{AccessError, Processor};

use crate::errno::Errno;

/// Why an operation gave no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The answer of the server, or of this end for what it need not ask: nothing was done, except
    /// for what the same error means on Unix.
    #[error("{0}")]
    Errno(Errno),
    /// The server has not answered in time. The operation of this call is in doubt: it stays in the
    /// slot, and the next call, or [`settle`](super::FileSystem::settle), first waits for its end.
    #[error("the file server, {server}, did not answer in time{}", Cause(.cause))]
    TimedOut {
        /// Who was asked.
        server: Processor,
        /// What the mailbox said last.
        cause: Option<condor_mbox::Error>,
    },
    /// The server has not answered in time what was asked before: an operation in doubt, or the
    /// closing of a file that was dropped. The operation of this call was not begun, and will not be.
    #[error("the file server, {server}, has not answered what was asked before in time{}", Cause(.cause))]
    NotBegun {
        /// Who was asked.
        server: Processor,
        /// What the mailbox said last.
        cause: Option<condor_mbox::Error>,
    },
    /// The own mailbox cannot send. If it was in the middle of an operation, that is in doubt.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::Error),
    /// The own window cannot be reached.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl Error {
    /// The error number, if that is what it is.
    #[must_use]
    pub const fn errno(&self) -> Option<Errno> {
        match self {
            Self::Errno(errno) => Some(*errno),
            _ => None,
        }
    }
}

impl From<Errno> for Error {
    fn from(errno: Errno) -> Self {
        Self::Errno(errno)
    }
}

impl embedded_io::Error for Error {
    fn kind(&self) -> embedded_io::ErrorKind {
        match self {
            Self::Errno(errno) => embedded_io::Error::kind(errno),
            Self::TimedOut { .. } | Self::NotBegun { .. } => embedded_io::ErrorKind::TimedOut,
            Self::Mailbox(_) => embedded_io::ErrorKind::NotConnected,
            Self::Access(_) => embedded_io::ErrorKind::Other,
        }
    }
}

struct Cause<'a>(&'a Option<condor_mbox::Error>);

impl core::fmt::Display for Cause<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            Some(error) => write!(f, ": {error}"),
            None => Ok(()),
        }
    }
}
