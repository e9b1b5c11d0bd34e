//! Errors of a server.

use std::io;
use std::path::{Path, PathBuf};

use condor_mbox::AccessError;

use crate::errno::Errno;

/// The reason why a [`FileServer`](super::FileServer) could not start, or could not go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServerError {
    /// Another running server serves the tree.
    #[error("{root:?} is being served already")]
    Served {
        /// The path of the tree.
        root: PathBuf,
    },
    /// The journal cannot be read, or a full disk has no room for it.
    #[error("cannot keep the journal {path:?}: {source}")]
    Journal {
        /// The path of the journal.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The operating system refused an operation.
    #[error("cannot serve {root:?}: {source}")]
    System {
        /// The path of the tree.
        root: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A file that is made with the `file_mode` of the options could not be made, or could not be
    /// opened again by the server itself.
    #[error("cannot serve {root:?} with mode {mode:o} for new files: {source}")]
    FileMode {
        /// The path of the tree.
        root: PathBuf,
        /// The permissions for new files in the options.
        mode: u32,
        /// The reason why such a file cannot be made, or be opened again for reading and writing.
        source: io::Error,
    },
    /// The mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
}

impl ServerError {
    pub(super) fn at<E: Into<io::Error>>(root: &Path) -> impl FnOnce(E) -> Self {
        let root = root.to_owned();
        |source| Self::System {
            root,
            source: source.into(),
        }
    }
}

/// The reason why an operation stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    /// Its result.
    Errno(Errno),
    /// Nothing was done: the client has yet to say where its table is, or a program of the host to
    /// give up its lease.
    Again,
}

impl From<Errno> for Stop {
    fn from(errno: Errno) -> Self {
        // Calls that never wait get this where others of Linux would wait.
        if errno == Errno::AGAIN {
            Self::Again
        } else {
            Self::Errno(errno)
        }
    }
}

impl From<rustix::io::Errno> for Stop {
    fn from(errno: rustix::io::Errno) -> Self {
        Errno::from(errno).into()
    }
}

impl From<rustix::io::Errno> for Errno {
    fn from(errno: rustix::io::Errno) -> Self {
        Self(u16::try_from(errno.raw_os_error()).unwrap_or(Self::IO.0))
    }
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        let code = error.raw_os_error().and_then(|code| code.try_into().ok());
        Self::Errno(code.map_or(Errno::IO, Errno))
    }
}

/// An offset or a length in a request is not inside of the client's window.
impl From<AccessError> for Stop {
    fn from(_: AccessError) -> Self {
        Self::Errno(Errno::FAULT)
    }
}
