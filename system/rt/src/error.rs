//! [`ProgramError`]: why a program cannot run, or cannot go on.

use core::fmt;

use condor_dev::OpenError;
use condor_mbox::shared_log::SharedLogError;
use condor_mbox::{AccessError, Vector};
use condor_mos::{LoopError, RateError, StartError};
use condor_platform::FloatExceptions;
use condor_tty::TerminalError;
use condor_vars::CatalogError;
use embedded_io::WriteFmtError;

use crate::descriptors::StdioError;
use crate::numbers::MISTAKE;
use crate::objects::ObjectError;
use crate::text::ShortText;

/// The error with which a [`Program`](crate::Program) ends before it was told to stop: the error of
/// a part, such as the mailbox, a mistake in its setup, or an error of its own.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// The mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::MailboxError),
    /// An access to the memory of a processor failed.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The object table refused an object.
    #[error(transparent)]
    Objects(#[from] ObjectError),
    /// The terminal returned this error.
    #[error(transparent)]
    Terminal(#[from] TerminalError),
    /// The file service or its client returned this error.
    #[error(transparent)]
    Files(#[from] condor_fs::FileError),
    /// A call of the table of descriptors failed.
    #[error(transparent)]
    Stdio(#[from] StdioError),
    /// A board, a device on the bus, could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError<'static>),
    /// The rates of the loops cannot be scheduled.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// An operation on a loop failed.
    #[error(transparent)]
    Loop(#[from] LoopError),
    /// The loops could not be started.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The program set up more parts of one sort than a program may have.
    #[error("`{name}` is one too many: a program has at most {capacity} {what}")]
    Full {
        /// The sort of part, such as `loops`.
        what: &'static str,
        /// The greatest number of such parts.
        capacity: usize,
        /// The name of the first part for which there is no room.
        name: ShortText<32>,
    },
    /// The program set up a second part of a sort of which it can have only one, such as a
    /// terminal.
    #[error("a program can have only one {what}, and this one sets up a second")]
    Twice {
        /// The name of that part, such as `console`.
        what: &'static str,
    },
    /// The program uses a part that it did not set up.
    #[error("the program has no {what}: call `{what}` of `Setup` first")]
    Missing {
        /// The name of that part, such as `console`.
        what: &'static str,
    },
    /// The program set up a handler for a vector that is already in use.
    #[error("`{name}` cannot have {vector}, which belongs to {by}; choose another vector")]
    VectorTaken {
        /// The number of the vector that is in use.
        vector: Vector,
        /// The use that the vector already has.
        by: &'static str,
        /// The name of the refused handler.
        name: ShortText<32>,
    },
    /// A variable or parameter, or the bounds of a rate (`hz`), was added after the last loop, and belongs to none.
    #[error(
        "the variable or parameter `{name}` belongs to no servo loop, so nobody can see it: call `servo` after `watch`, `tune`, `rates` and `fixed`"
    )]
    LeftOver {
        /// The name of the variable or parameter.
        name: ShortText<32>,
    },
    /// The variables of a loop, or the fields of a cell, cannot be shown.
    #[error("cannot show the variables of `{name}`: {error}")]
    Variables {
        /// The name of the loop, or of the cell.
        name: ShortText<32>,
        /// The reason why they cannot be shown.
        error: CatalogError,
    },
    /// The processor's window, its shared memory, has no room for an object.
    #[error(
        "`{name}` needs {needed} bytes of the processor's window, but {left} are left: raise `window_bytes` by {}",
        .needed - .left
    )]
    Window {
        /// The name of the object that was to be placed.
        name: ShortText<32>,
        /// The length of that object in bytes.
        needed: u32,
        /// The number of free bytes.
        left: u32,
    },
    /// The system has too little memory that belongs to no processor.
    #[error(
        "the program needs {needed} bytes of the memory that belongs to no processor, and the system has {found}: set \
         `bytes` of `[shared_memory]` in its description"
    )]
    SharedMemory {
        /// The number of bytes that are needed.
        needed: u32,
        /// The number of bytes that are there.
        found: u32,
    },
    /// The log in the memory that belongs to no processor could not be appended to.
    #[error(transparent)]
    SharedLog(#[from] SharedLogError),
    /// The arithmetic of a servo loop has raised floating-point exceptions, and the machine takes them for
    /// [fatal](crate::Machine::is_float_exception_fatal).
    #[error("the servo loop `{name}` has raised a floating-point exception: {exceptions}")]
    FloatExceptions {
        /// The name of the loop.
        name: ShortText<32>,
        /// The exceptions of one run of the loop.
        exceptions: FloatExceptions,
    },
    /// An error that only this program knows, as text; [`ProgramError::program`] makes it.
    #[error("{0}")]
    Program(ShortText<112>),
}

/// The error of `write!` and `writeln!` to a file.
impl From<WriteFmtError<condor_fs::FileError>> for ProgramError {
    fn from(error: WriteFmtError<condor_fs::FileError>) -> Self {
        Self::Files(error.into())
    }
}

/// The error of `write!` and `writeln!` to a stream.
impl From<WriteFmtError<StdioError>> for ProgramError {
    fn from(error: WriteFmtError<StdioError>) -> Self {
        match error {
            WriteFmtError::Other(error) => Self::Stdio(error),
            WriteFmtError::FmtError => Self::Files(condor_fs::FileError::Format),
        }
    }
}

impl ProgramError {
    /// Makes a [`ProgramError::Program`] from the text of `error`, an error that only this program knows. Keeps the
    /// first 112 bytes of the text.
    #[must_use]
    pub fn program(error: &impl fmt::Display) -> Self {
        Self::Program(ShortText::of(error))
    }

    /// Returns the exit status of a process whose program ends with this error: [`MISTAKE`] for a mistake in the setup
    /// of the program, which a restart would only repeat; otherwise 1.
    #[must_use]
    pub const fn exit_status(&self) -> u8 {
        match self {
            Self::Rate(_)
            | Self::Full { .. }
            | Self::Twice { .. }
            | Self::Missing { .. }
            | Self::VectorTaken { .. }
            | Self::LeftOver { .. }
            | Self::Variables { .. }
            | Self::Window { .. }
            | Self::SharedMemory { .. } => MISTAKE,
            _ => 1,
        }
    }

    /// An object that could not be entered.
    pub(crate) fn not_entered(name: &str, error: ObjectError) -> Self {
        match error {
            ObjectError::Access(error) => Self::no_room(name, error),
            error => error.into(),
        }
    }

    /// An access for which the window is too small, if that is why it failed.
    pub(crate) fn no_room(name: &str, error: AccessError) -> Self {
        let (needed, left) = (error.len as u32, error.size.saturating_sub(error.offset));
        if needed <= left {
            return error.into();
        }
        Self::Window {
            name: ShortText::of(name),
            needed,
            left,
        }
    }
}
