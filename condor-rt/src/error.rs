//! [`Error`]: why a program cannot be what it says.

use core::fmt::{self, Write as _};

use condor_dev::OpenError;
use condor_mbox::{AccessError, Vector};
use condor_mos::{LoopError, RateError, StartError};
use condor_tty::TerminalError;
use condor_vars::CatalogError;

use crate::objects::ObjectError;

/// Why a program ends before it was told to.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The mailbox.
    #[error(transparent)]
    Mailbox(#[from] condor_mbox::Error),
    /// The memory.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The object table.
    #[error(transparent)]
    Objects(#[from] ObjectError),
    /// The terminal.
    #[error(transparent)]
    Terminal(#[from] TerminalError),
    /// The file service.
    #[error(transparent)]
    Files(#[from] condor_fs::Error),
    /// A board that cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError<'static>),
    /// The rates of the loops.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// A loop.
    #[error(transparent)]
    Loop(#[from] LoopError),
    /// The start of the loops.
    #[error(transparent)]
    Start(#[from] StartError),
    /// More was set up than there is room for.
    #[error("`{name}` is one too many: a program has at most {capacity} {what}")]
    Full {
        /// Of what.
        what: &'static str,
        /// How many there may be.
        capacity: usize,
        /// The first that finds no room.
        name: Text<32>,
    },
    /// The program asks for something again that it can have once.
    #[error("a program has one {what}, and this one asked for another")]
    Twice {
        /// What.
        what: &'static str,
    },
    /// Something is used that was not set up.
    #[error("the program has no {what}: it asks `Setup` for {what} first")]
    Missing {
        /// What.
        what: &'static str,
    },
    /// A handler for a vector that has one.
    #[error("`{name}` is for {vector}, which is for {by}")]
    VectorTaken {
        /// The vector.
        vector: Vector,
        /// What it is for.
        by: &'static str,
        /// The handler's name.
        name: Text<32>,
    },
    /// A variable or parameter that no loop has.
    #[error("`{name}` is shown by no loop: add the servo after its variables and parameters")]
    LeftOver {
        /// Its name.
        name: Text<32>,
    },
    /// Variables that cannot be shown.
    #[error("the variables of `{name}`: {error}")]
    Variables {
        /// The name of the loop, or of the cell.
        name: Text<32>,
        /// Why not.
        error: CatalogError,
    },
    /// The window is too small.
    #[error("`{name}` needs {needed} bytes of the window, and {left} are left: raise `window_bytes` by {}", .needed - .left)]
    Window {
        /// What is to lie there.
        name: Text<32>,
        /// How long it is, in bytes.
        needed: u32,
        /// How many bytes are left.
        left: u32,
    },
    /// What a program says itself: the text of an error of its own.
    #[error("{0}")]
    Program(Text<112>),
}

impl Error {
    /// An error of the program's own, of which the text is kept, as far as it fits.
    #[must_use]
    pub fn program(error: &impl fmt::Display) -> Self {
        Self::Program(Text::of(error))
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
            name: Text::of(name),
            needed,
            left,
        }
    }
}

/// As much of a text as fits, without a heap.
#[derive(Clone, PartialEq, Eq)]
pub struct Text<const BYTES: usize>(heapless::String<BYTES, u8>);

impl<const BYTES: usize> Text<BYTES> {
    /// What something prints.
    #[must_use]
    pub fn of(printed: &(impl fmt::Display + ?Sized)) -> Self {
        let mut text = Cut(heapless::String::new());
        // What does not fit is cut off.
        let _ = write!(text, "{printed}");
        Self(text.0)
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<const BYTES: usize> fmt::Display for Text<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl<const BYTES: usize> fmt::Debug for Text<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.0.as_str(), f)
    }
}

struct Cut<const BYTES: usize>(heapless::String<BYTES, u8>);

impl<const BYTES: usize> fmt::Write for Cut<BYTES> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars()
            .try_for_each(|character| self.0.push(character))
            .map_err(|_| fmt::Error)
    }
}
