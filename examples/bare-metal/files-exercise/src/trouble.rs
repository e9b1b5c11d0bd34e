//! [`Trouble`]: what ends an exercise early.

use condor_mbox::AccessError;
use condor_tty::{ConsoleError, ReaderError, TerminalError};

/// A call that must succeed did not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Trouble {
    Access(AccessError),
    Console(ConsoleError),
    Files(condor_fs::Error),
    Mailbox(condor_mbox::Error),
    Reader(ReaderError),
    Terminal(TerminalError),
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
    Console ConsoleError,
    Files condor_fs::Error,
    Mailbox condor_mbox::Error,
    Reader ReaderError,
    Terminal TerminalError,
}
