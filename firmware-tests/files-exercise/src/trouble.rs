//! [`Trouble`]: what ends an exercise early.

use condor_dev::{BusErrorKind, IoError};
use condor_fs::dev::TransferError;
use condor_mbox::AccessError;
use condor_tty::{ConsoleError, ReaderError, TerminalError};

/// A call that must succeed did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    Access(AccessError),
    Board(IoError<BusErrorKind>),
    Console(ConsoleError),
    File(IoError<TransferError<BusErrorKind>>),
    Files(condor_fs::Error),
    Mailbox(condor_mbox::Error),
    Open(condor_dev::OpenError<'static>),
    OpenFile(condor_fs::dev::OpenError<'static>),
    Reader(ReaderError),
    Terminal(TerminalError),
    /// What is made once in a program was made before.
    Twice,
}

macro_rules! from {
    ($($variant:ident $error:ty,)*) => {
        $(impl From<$error> for Trouble {
            fn from(error: $error) -> Self {
                Self::$variant(error)
            }
        })*
    };
}

from! {
    Access AccessError,
    Board IoError<BusErrorKind>,
    Console ConsoleError,
    File IoError<TransferError<BusErrorKind>>,
    Files condor_fs::Error,
    Mailbox condor_mbox::Error,
    Open condor_dev::OpenError<'static>,
    OpenFile condor_fs::dev::OpenError<'static>,
    Reader ReaderError,
    Terminal TerminalError,
}
