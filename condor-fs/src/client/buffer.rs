//! [`Buffer`]: owned memory of the window, which can be lent to the server.

use condor_mbox::{AccessError, MemoryWindow, Places, Region};

use super::error::Error;

/// Memory of the processor's own window for calls without a copy, which take it and return it.
///
/// While the server may read or write it, the program does not have it: the server could still
/// write to a borrowed slice after the time-out of a call.
#[derive(Debug)]
pub struct Buffer<W> {
    memory: Region<W>,
    offset: u32,
}

impl<W: MemoryWindow + Clone> Buffer<W> {
    /// Takes `bytes` bytes, a multiple of four, from `places`. The memory lies in `own`, the users'
    /// region of the processor's own `data`.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room, `Misaligned` if `bytes` is
    /// not a multiple of four.
    pub fn new(own: &Region<W>, places: &mut Places, bytes: u32) -> Result<Self, AccessError> {
        let offset = places.bytes(bytes as usize)?;
        Ok(Self {
            memory: own.part(offset, bytes)?,
            offset,
        })
    }
}

impl<W: MemoryWindow> Buffer<W> {
    /// Returns the memory, with offsets from its own beginning.
    pub fn memory(&self) -> &Region<W> {
        &self.memory
    }

    pub(super) fn offset(&self) -> u32 {
        self.offset
    }
}

/// The result of a call without a copy: the number of bytes that were moved, and the buffer.
pub type Lent<W> = Result<(usize, Buffer<W>), Kept<W>>;

/// The error of a call without a copy, with the buffer.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct Kept<W> {
    /// The error.
    pub error: Error,
    /// The buffer; `None` if the operation is in doubt. Then
    /// [`FileSystem::take_buffer`](super::FileSystem::take_buffer) returns it when the operation
    /// has ended.
    pub buffer: Option<Buffer<W>>,
}
