//! [`Failure`]: why a drill ends before its time.

use condor_host::directory::DirectoryError;
use condor_mbox::AccessError;
use condor_mos::{LoopError, RateError, StartError};
use condor_tty::TerminalError;

/// Why a drill ends before its time, or has not gone well.
#[derive(Debug)]
#[non_exhaustive]
pub enum Failure {
    /// An argument that is missing or wrong.
    Argument {
        /// What is expected.
        expected: &'static str,
    },
    /// The memory.
    Access(AccessError),
    /// The directory.
    Directory(DirectoryError),
    /// The terminal.
    Terminal(TerminalError),
    /// The mailbox.
    Mailbox(condor_mbox::Error),
    /// The loops.
    Loop(LoopError),
    /// Their rates.
    Rate(RateError),
    /// Their start.
    Start(StartError),
    /// The timer.
    Timer,
    /// Somebody is not ready in time.
    Late {
        /// Whose part is missing.
        processor: u8,
    },
    /// Something was counted that must not be.
    Wrong,
}

impl core::fmt::Display for Failure {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Argument { expected } => write!(f, "an argument is missing or wrong: {expected}"),
            Self::Access(error) => error.fmt(f),
            Self::Directory(error) => error.fmt(f),
            Self::Terminal(error) => error.fmt(f),
            Self::Mailbox(error) => error.fmt(f),
            Self::Loop(error) => error.fmt(f),
            Self::Rate(error) => error.fmt(f),
            Self::Start(error) => error.fmt(f),
            Self::Timer => f.write_str("the timer cannot be had"),
            Self::Late { processor } => write!(f, "processor {processor} is not ready in time"),
            Self::Wrong => f.write_str("something is wrong; see the counts"),
        }
    }
}

macro_rules! from {
    ($($variant:ident($error:ty),)*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::$variant(error)
            }
        })*
    };
}

from! {
    Access(AccessError),
    Directory(DirectoryError),
    Terminal(TerminalError),
    Mailbox(condor_mbox::Error),
    Loop(LoopError),
    Rate(RateError),
    Start(StartError),
}
