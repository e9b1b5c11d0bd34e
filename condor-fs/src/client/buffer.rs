//! [`Buffer`]: window memory that is owned, so that it can be lent to the server whole.

use condor_mbox::{AccessError, MemoryWindow, Places, Region};

use super::error::Error;

/// Memory of the own window for the calls without a copy, which take it and give it back.
///
/// While the server may read or write it, nobody else has it: a borrowed slice could still be
/// written after the time-out of the call.
#[derive(Debug)]
pub struct Buffer<W> {
    memory: Region<W>,
    offset: u32,
}

impl<W: MemoryWindow + Clone> Buffer<W> {
    /// The next `bytes` bytes, a multiple of four, of `places` in `own`, the users' region of the
    /// processor's own `data`.
    ///
    /// # Errors
    /// `OutOfBounds` if there is no room; `Misaligned` for part of a word.
    pub fn new(own: &Region<W>, places: &mut Places, bytes: u32) -> Result<Self, AccessError> {
        let offset = places.bytes(bytes as usize)?;
        Ok(Self {
            memory: own.part(offset, bytes)?,
            offset,
        })
    }
}

impl<W: MemoryWindow> Buffer<W> {
    /// The memory, with offsets from its own beginning.
    pub fn memory(&self) -> &Region<W> {
        &self.memory
    }

    pub(super) fn offset(&self) -> u32 {
        self.offset
    }
}

/// What a call without a copy gives back: how many bytes were moved, and the buffer.
pub type Lent<W> = Result<(usize, Buffer<W>), Kept<W>>;

/// A call without a copy that failed.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct Kept<W> {
    /// Why.
    pub error: Error,
    /// The buffer; `None` if the operation is in doubt: then
    /// [`FileSystem::take_buffer`](super::FileSystem::take_buffer) gives it once it no longer is.
    pub buffer: Option<Buffer<W>>,
}
