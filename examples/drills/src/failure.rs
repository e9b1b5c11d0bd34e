//! [`Failure`]: why a drill ends before its time.

use condor_mbox::AccessError;
use condor_mos::{LoopError, RateError, StartError};
use condor_rt::directory::DirectoryError;
use condor_tty::TerminalError;

/// Why a drill ends before its time, or has not gone well.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// An argument that is missing or wrong.
    #[error("an argument is missing or wrong: {expected}")]
    Argument {
        /// What is expected.
        expected: &'static str,
    },
    /// The memory.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The directory.
    #[error(transparent)]
    Directory(#[from] DirectoryError),
    /// The terminal.
    #[error(transparent)]
    Terminal(#[from] TerminalError),
    /// The mailbox.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::Error),
    /// The loops.
    #[error(transparent)]
    Loop(#[from] LoopError),
    /// Their rates.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// Their start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// Somebody is not ready in time.
    #[error("processor {processor} is not ready in time")]
    Late {
        /// Whose part is missing.
        processor: u8,
    },
    /// Something was counted that must not be.
    #[error("something is wrong; see the counts")]
    Wrong,
}
