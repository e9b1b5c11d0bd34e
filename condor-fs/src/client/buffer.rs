//! [`Buffer`]: owned memory of the window, which can be lent to the server.

use condor_mbox::{AccessError, Allocator, MemoryWindow, Messenger, Region};

use super::error::FileError;
use super::file::moved;
use super::operation::After;
use super::{Alone, File};
use crate::errno::Errno;
use crate::wire::{Operation, RequestSlot, Span};

/// A piece of the processor's own shared memory for reads and writes without a copy, such as
/// [`File::read_buffer`]. The call takes the buffer, and returns it with the result.
///
/// While the server may read or write the buffer, the program does not have it. A borrowed slice
/// would not do: the server could still write to it after the call has timed out.
#[derive(Debug)]
pub struct Buffer<W> {
    memory: Region<W>,
    offset: u32,
}

impl<W: MemoryWindow + Clone> Buffer<W> {
    /// Takes `bytes` bytes, a multiple of four, from `allocator`, that of `own`. `own` is the
    /// part of the processor's shared memory that is for programs: [`Region::users`] of its own
    /// `data`.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room, `Misaligned` if `bytes` is
    /// not a multiple of four.
    pub fn new(
        own: &Region<W>,
        allocator: &mut Allocator,
        bytes: u32,
    ) -> Result<Self, AccessError> {
        let offset = allocator.bytes(bytes as usize)?;
        Ok(Self {
            memory: own.part(offset, bytes)?,
            offset,
        })
    }
}

impl<W: MemoryWindow> Buffer<W> {
    /// Returns the buffer's memory, through which the program reads and writes its bytes. Offsets
    /// count from the beginning of the buffer.
    pub fn memory(&self) -> &Region<W> {
        &self.memory
    }

    pub(super) fn offset(&self) -> u32 {
        self.offset
    }
}

/// The result of a read or write without a copy: the number of bytes that were moved and the
/// buffer, or an error with the buffer.
pub type BufferResult<W> = Result<(usize, Buffer<W>), BufferError<W>>;

/// The error of a read or write without a copy, with the buffer.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct BufferError<W> {
    /// The reason why the call failed.
    pub error: FileError,
    /// The buffer. It is `None` if the operation is in doubt, because the server may still use the
    /// buffer: [`FileSystem::take_buffer`](super::FileSystem::take_buffer) returns it once the
    /// operation has ended.
    pub buffer: Option<Buffer<W>>,
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'_, '_, S, W, FILES> {
    /// Reads at most `len` bytes from the file's position on directly into `buffer`, and moves the
    /// position by the number of bytes that were read. Returns this number, which is 0 at the end
    /// of the file, and the buffer.
    ///
    /// # Errors
    /// [`BufferError`] with the buffer and a [`FileError`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](super::FileSystem::take_buffer); [`FileError::Errno`] if the server refuses; another
    /// [`FileError`] if it does not answer in time, or if the mailbox or the window fails.
    pub fn read_buffer(&mut self, buffer: Buffer<W>, len: u32) -> BufferResult<W> {
        self.lend(true, buffer, len, None)
    }

    /// Reads as [`read_buffer`](Self::read_buffer) does, but from `position` on, in bytes from the
    /// beginning of the file. The file's own position stays.
    ///
    /// # Errors
    /// [`BufferError`] with the buffer and a [`FileError`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](super::FileSystem::take_buffer); [`FileError::Errno`] if the server refuses; another
    /// [`FileError`] if it does not answer in time, or if the mailbox or the window fails.
    pub fn read_buffer_at(&self, buffer: Buffer<W>, len: u32, position: u64) -> BufferResult<W> {
        self.lend(true, buffer, len, Some(position))
    }

    /// Writes at most the first `len` bytes of `buffer` at the file's position, or at the end of a
    /// file that was opened for appending. Moves the position by the number of bytes that were
    /// written, and returns this number and the buffer.
    ///
    /// # Errors
    /// [`BufferError`] with the buffer and a [`FileError`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](super::FileSystem::take_buffer); [`FileError::Errno`] if the server refuses; another
    /// [`FileError`] if it does not answer in time, or if the mailbox or the window fails.
    pub fn write_buffer(&mut self, buffer: Buffer<W>, len: u32) -> BufferResult<W> {
        self.lend(false, buffer, len, None)
    }

    /// Writes as [`write_buffer`](Self::write_buffer) does, but at `position`, in bytes from the
    /// beginning of the file. The file's own position stays.
    ///
    /// # Errors
    /// [`BufferError`] with the buffer and a [`FileError`]: [`Errno::INVAL`] if the file was opened
    /// for appending; [`Errno::FAULT`] if the buffer is shorter than `len`; [`Errno::BUSY`] if an
    /// earlier buffer has not been [taken back](super::FileSystem::take_buffer);
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in
    /// time, or if the mailbox or the window fails.
    pub fn write_buffer_at(&self, buffer: Buffer<W>, len: u32, position: u64) -> BufferResult<W> {
        self.lend(false, buffer, len, Some(position))
    }

    fn lend(&self, reads: bool, buffer: Buffer<W>, len: u32, at: Option<u64>) -> BufferResult<W> {
        let system = self.system;
        let refuse = |error: FileError, buffer| Err(BufferError { error, buffer });
        let alone = match system.enter() {
            Ok(alone) => alone,
            Err(errno) => return refuse(errno.into(), Some(buffer)),
        };
        if let Some(kept) = alone.kept.take() {
            alone.kept.set(Some(kept));
            return refuse(Errno::BUSY.into(), Some(buffer));
        }
        if len > buffer.memory().size() {
            return refuse(Errno::FAULT.into(), Some(buffer));
        }
        let offset = buffer.offset();
        let before = alone.sequence.get();
        match self.transfer_lent(&alone, reads, Span { offset, len }, at) {
            Ok(done) => Ok((done, buffer)),
            // In doubt, and about this buffer: not if a former operation is.
            Err(error) if alone.doubt.get().is_some() && alone.sequence.get() != before => {
                alone.kept.set(Some(buffer));
                refuse(error, None)
            }
            Err(error) => refuse(error, Some(buffer)),
        }
    }

    fn transfer_lent(
        &self,
        alone: &Alone<'_, W, FILES>,
        reads: bool,
        buffer: Span,
        at: Option<u64>,
    ) -> Result<usize, FileError> {
        let (system, file) = (self.system, self.index);
        let operation = if reads {
            Operation::Read
        } else {
            alone.writing(file, at)?
        };
        let deadline = system.clear(alone)?;
        let request = RequestSlot {
            // Only now: what was in doubt may have moved the position.
            position: at.map_or_else(|| alone.position(file), Ok)?,
            buffer,
            ..alone.about(operation, file)?
        };
        let after = at.map_or(After::Moved { file }, |_| After::Nothing);
        let done = system.perform_next(alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }
}
