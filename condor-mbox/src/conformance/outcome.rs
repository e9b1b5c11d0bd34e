//! The outcome of an access to a window, against the expected one.

use core::fmt;
use core::sync::atomic::AtomicU32;

use crate::window::{LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind};

/// The result of an access to a window: the word that was read (zero if the access reads none), or
/// the kind of the error.
pub type AccessOutcome = Result<u32, WindowErrorKind>;

/// The error of the checks of a window: an access with a wrong result, and the result that is
/// required.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{check}: {len} bytes at offset {offset:#x} returned {}, expected {}",
    OutcomeText(.found),
    OutcomeText(.expected),
)]
pub struct WindowFailure {
    /// The rule that is broken.
    pub check: &'static str,
    /// The offset of the access, in bytes.
    pub offset: u32,
    /// The length of the access, in bytes.
    pub len: usize,
    /// The result of the access.
    pub found: AccessOutcome,
    /// The result that is required.
    pub expected: AccessOutcome,
}

/// An outcome in words.
struct OutcomeText<'o>(&'o AccessOutcome);

impl fmt::Display for OutcomeText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Ok(word) => write!(f, "the word {word:#x}"),
            Err(kind) => write!(f, "\"{kind}\""),
        }
    }
}

pub(super) fn load<W: MemoryWindow>(window: &W, offset: u32) -> AccessOutcome {
    window
        .load(offset, LoadOrder::Acquire)
        .map_err(|error| error.kind())
}

pub(super) fn store<W: MemoryWindow>(window: &W, offset: u32, word: u32) -> AccessOutcome {
    outcome(window.store(offset, word, StoreOrder::Release))
}

pub(super) fn write_words<W: MemoryWindow>(
    window: &W,
    offset: u32,
    len: usize,
    from: &[&[AtomicU32]],
) -> AccessOutcome {
    outcome(window.write_words(offset, len, from))
}

pub(super) fn read<W: MemoryWindow>(window: &W, offset: u32, into: &mut [u8]) -> AccessOutcome {
    outcome(window.read(offset, into))
}

pub(super) fn write<W: MemoryWindow>(window: &W, offset: u32, from: &[u8]) -> AccessOutcome {
    outcome(window.write(offset, from))
}

pub(super) fn check<W: MemoryWindow>(window: &W, offset: u32, len: usize) -> AccessOutcome {
    outcome(window.check(offset, len))
}

fn outcome<E: WindowError>(result: Result<(), E>) -> AccessOutcome {
    match result {
        Ok(()) => Ok(0),
        Err(error) => Err(error.kind()),
    }
}

pub(super) fn done(
    check: &'static str,
    offset: u32,
    len: usize,
    found: AccessOutcome,
) -> Result<(), WindowFailure> {
    expect(check, offset, len, found, Ok(0))
}

pub(super) fn expect(
    check: &'static str,
    offset: u32,
    len: usize,
    found: AccessOutcome,
    expected: AccessOutcome,
) -> Result<(), WindowFailure> {
    if found == expected {
        Ok(())
    } else {
        Err(WindowFailure {
            check,
            offset,
            len,
            found,
            expected,
        })
    }
}
