//! [`File`]: an open file.

use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::{ErrorType, Read, ReadExactError, Seek, SeekFrom, Write};

use super::operation::After;
use super::ticket::{Ask, FileTicket, TicketResult};
use super::{Alone, FileError, FileSystem, request, whole};
use crate::errno::Errno;
use crate::wire::{FileStatus, Operation, RequestSlot, Span, Times};

/// An open file of the host, which [`FileSystem::open`] returns. It has a position, at which reads
/// and writes continue.
///
/// A file that is dropped is closed by the next [`open`](FileSystem::open). [`close`](Self::close)
/// closes it at once, and returns an error if that fails. A file that was unlinked while it was
/// open takes room until it is closed.
///
/// The traits of `embedded-io` and the methods of the same names copy the bytes once, through the
/// file's buffer in shared memory; [`read_buffer`](Self::read_buffer) and
/// [`write_buffer`](Self::write_buffer) do not copy.
///
/// Every call asks the server once. Buffers over a file, such as those of `condor-dev`, combine many
/// small calls into few.
///
/// After [`FileError::TimedOut`] the position moves by as many bytes as turn out to have been
/// transferred: see [`FileSystem::settle`].
pub struct File<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    pub(super) system: &'f FileSystem<'m, S, W, FILES>,
    pub(super) index: usize,
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'f, 'm, S, W, FILES> {
    /// The block, which stays open.
    pub(super) fn into_index(self) -> usize {
        core::mem::ManuallyDrop::new(self).index
    }

    /// Reads from the file's position on into `into`, at most as many bytes as the file's buffer in
    /// the [`Area`](super::Area) holds. Moves the position by the number of bytes that were read,
    /// and returns this number. It is 0 at the end of the file.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn read(&mut self, into: &mut [u8]) -> Result<usize, FileError> {
        self.read_from(into, None)
    }

    /// Reads from `position` on into `into`, at most as many bytes as the file's buffer in the
    /// [`Area`](super::Area) holds. The file's own position stays. Returns the number of bytes that
    /// were read; it is 0 at the end of the file.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn read_at(&self, into: &mut [u8], position: u64) -> Result<usize, FileError> {
        self.read_from(into, Some(position))
    }

    /// Writes the beginning of `from` at the file's position, or at the end of a file that was
    /// opened for appending: at most as many bytes as the file's buffer in the
    /// [`Area`](super::Area) holds. Moves the position by the number of bytes that were written,
    /// and returns this number.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn write(&mut self, from: &[u8]) -> Result<usize, FileError> {
        self.write_to(from, None)
    }

    /// Writes the beginning of `from` at `position`: at most as many bytes as the file's buffer in
    /// the [`Area`](super::Area) holds. The file's own position stays. Returns the number of bytes
    /// that were written.
    ///
    /// # Errors
    /// [`Errno::INVAL`] if the file was opened for appending; [`FileError::Errno`] if the server refuses;
    /// another [`FileError`] if it does not answer in time, or if the mailbox or the window fails.
    pub fn write_at(&self, from: &[u8], position: u64) -> Result<usize, FileError> {
        self.write_to(from, Some(position))
    }

    fn read_from(&self, into: &mut [u8], at: Option<u64>) -> Result<usize, FileError> {
        let system = self.system;
        let buffer = system.own_buffer(self.index, into.len());
        let alone = system.enter()?;
        let done = self
            .transfer(&alone, Operation::Read, buffer, at)?
            .min(into.len());
        if let Some(into) = into.get_mut(..done) {
            system.own.read(buffer.offset, into)?;
        }
        Ok(done)
    }

    fn write_to(&self, from: &[u8], at: Option<u64>) -> Result<usize, FileError> {
        let system = self.system;
        let buffer = system.own_buffer(self.index, from.len());
        let alone = system.enter()?;
        let operation = alone.writing(self.index, at)?;
        // Before the buffer is touched: it may belong to a write in doubt.
        let deadline = system.clear(&alone)?;
        system.fill_buffer(&alone, self.index, buffer, from)?;
        let (request, after) = alone.prepare_transfer(operation, self.index, buffer, at)?;
        let done = system.perform_next(&alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }

    /// Returns a ticket that reads at the position of the file, as [`read`](Self::read) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called. The
    /// position moves only when the operation has ended.
    pub fn begin_read<'t>(
        &'t mut self,
        into: &'t mut [u8],
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Read(self.index, None);
        FileTicket::new(self.system, ask, into, |found| found.value as usize)
    }

    /// Returns a ticket that reads at `position`, as [`read_at`](Self::read_at) does. The operation
    /// begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_read_at<'t>(
        &'t self,
        into: &'t mut [u8],
        position: u64,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Read(self.index, Some(position));
        FileTicket::new(self.system, ask, into, |found| found.value as usize)
    }

    /// Returns a ticket that writes at the position of the file, as [`write`](Self::write) does.
    /// The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_write<'t>(
        &'t mut self,
        from: &'t [u8],
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Write(self.index, None, from);
        FileTicket::new(self.system, ask, &mut [], |found| found.value as usize)
    }

    /// Returns a ticket that writes at `position`, as [`write_at`](Self::write_at) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_write_at<'t>(
        &'t self,
        from: &'t [u8],
        position: u64,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Write(self.index, Some(position), from);
        FileTicket::new(self.system, ask, &mut [], |found| found.value as usize)
    }

    /// Moves the file's position to `to`, which may be after the end of the file. Returns the new
    /// position in bytes from the beginning of the file.
    ///
    /// # Errors
    /// [`Errno::INVAL`] if the position would be before the beginning of the file or past 2⁶³ − 1;
    /// another [`FileError`] if `to` is relative to the end and the server does not tell the size
    /// of the file.
    pub fn seek(&mut self, to: SeekFrom) -> Result<u64, FileError> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(step) => self.position()?.checked_add_signed(step),
            SeekFrom::End(step) => {
                let looked = self.look(After::Looked).done()?;
                looked.size.checked_add_signed(step)
            }
        };
        match position {
            Some(position) if i64::try_from(position).is_ok() => {
                let alone = self.system.enter()?;
                alone.change(self.index, |open| open.position = position);
                Ok(position)
            }
            _ => Err(Errno::INVAL.into()),
        }
    }

    /// Returns the position of the next read or write, in bytes from the beginning of the file.
    ///
    /// # Errors
    /// [`Errno::BUSY`] if an operation of another context is in progress, because it may move the
    /// position.
    pub fn position(&self) -> Result<u64, FileError> {
        Ok(self.system.enter()?.position(self.index)?)
    }

    /// Returns the status of the file: its size, times and permissions, and the other facts that
    /// `stat` of Unix tells.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn status(&self) -> Result<FileStatus, FileError> {
        self.begin_status().done()
    }

    /// Returns a ticket that asks for the status of the file, as [`status`](Self::status) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_status(&self) -> FileTicket<'_, '_, 'm, S, W, FILES, FileStatus> {
        self.look(After::Status)
    }

    /// Sets the permissions of the file to `mode`, such as 0o644, as [`FileSystem::set_mode`] does.
    ///
    /// # Errors
    /// [`Errno::PERM`] if the file would get a set-user-ID or set-group-ID bit; [`Errno::INVAL`] if
    /// `mode` has more than the bits 0o7777; other numbers as on Unix if the host refuses; another
    /// [`FileError`] if the server does not answer in time, or if the mailbox or the window fails.
    pub fn set_mode(&self, mode: u32) -> Result<(), FileError> {
        self.begin_set_mode(mode).done()
    }

    /// Returns a ticket that sets the permissions of the file, as [`set_mode`](Self::set_mode)
    /// does. The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is
    /// called.
    pub fn begin_set_mode(&self, mode: u32) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(RequestSlot {
            position: mode.into(),
            ..request(Operation::FileMode)
        })
    }

    /// Sets the times of the last access and modification of the file, as [`FileSystem::set_times`]
    /// does.
    ///
    /// # Errors
    /// [`Errno::INVAL`] if a time has more than 999 999 999 nanoseconds; other numbers as on Unix
    /// if the host refuses; another [`FileError`] if the server does not answer in time, or if the
    /// mailbox or the window fails.
    pub fn set_times(&self, times: Times) -> Result<(), FileError> {
        self.begin_set_times(times).done()
    }

    /// Returns a ticket that sets the times of the file, as [`set_times`](Self::set_times) does.
    /// The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_set_times(&self, times: Times) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(request(Operation::FileTimes).with_times(times))
    }

    /// Sets the size of the file to `size` bytes; added bytes are zeros.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn truncate(&self, size: u64) -> Result<(), FileError> {
        self.begin_truncate(size).done()
    }

    /// Returns a ticket that sets the size of the file, as [`truncate`](Self::truncate) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_truncate(&self, size: u64) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(RequestSlot {
            position: size,
            ..request(Operation::Truncate)
        })
    }

    /// Waits until the contents of the file are on the disk of the host.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn sync(&self) -> Result<(), FileError> {
        self.begin_sync().done()
    }

    /// Returns a ticket that waits until the file is on the disk of the host, as
    /// [`sync`](Self::sync) does. The operation begins when the ticket is awaited, or when
    /// [`FileTicket::wait`] is called.
    pub fn begin_sync(&self) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(request(Operation::Sync))
    }

    /// Closes the file. If this fails with an error that is not an [`Errno`], the next
    /// [`open`](FileSystem::open) closes the file.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn close(self) -> Result<(), FileError> {
        self.begin_close().done()
    }

    /// Returns a ticket that closes the file, as [`close`](Self::close) does. The operation begins
    /// when the ticket is awaited, or when [`FileTicket::wait`] is called. If the ticket is dropped
    /// before that, the next [`open`](FileSystem::open) closes the file.
    pub fn begin_close(self) -> FileTicket<'f, 'f, 'm, S, W, FILES, ()> {
        let system = self.system;
        FileTicket::new(system, Ask::Close(self.into_index()), &mut [], drop)
    }

    pub(super) fn ask(&self, request: RequestSlot) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        let ask = Ask::File(request, self.index, After::Nothing);
        FileTicket::new(self.system, ask, &mut [], drop)
    }

    fn look(&self, after: After) -> FileTicket<'_, '_, 'm, S, W, FILES, FileStatus> {
        let ask = Ask::File(request(Operation::FileStatus), self.index, after);
        FileTicket::new(self.system, ask, &mut [], TicketResult::status)
    }

    /// Moves data by way of the file's own buffer.
    fn transfer(
        &self,
        alone: &Alone<'_, W, FILES>,
        operation: Operation,
        buffer: Span,
        at: Option<u64>,
    ) -> Result<usize, FileError> {
        let system = self.system;
        let deadline = system.clear(alone)?;
        let (request, after) = alone.prepare_transfer(operation, self.index, buffer, at)?;
        let done = system.perform_next(alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }
}

/// Returns the number of moved bytes that the server reports, but no more than it was asked for.
pub(super) fn moved(value: u64, buffer: Span) -> usize {
    value.min(buffer.len.into()) as usize
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Drop
    for File<'_, '_, S, W, FILES>
{
    fn drop(&mut self) {
        self.system.set_left(self.index, true);
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> ErrorType
    for File<'_, '_, S, W, FILES>
{
    type Error = FileError;
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Read
    for File<'_, '_, S, W, FILES>
{
    fn read(&mut self, into: &mut [u8]) -> Result<usize, FileError> {
        File::read(self, into)
    }

    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<FileError>> {
        whole::read_exact(into, |rest| File::read(self, rest))
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Write
    for File<'_, '_, S, W, FILES>
{
    fn write(&mut self, from: &[u8]) -> Result<usize, FileError> {
        File::write(self, from)
    }

    /// [`Errno::IO`] if the server writes nothing, and names no error.
    fn write_all(&mut self, from: &[u8]) -> Result<(), FileError> {
        whole::write_all(from, |rest| File::write(self, rest))
    }

    fn flush(&mut self) -> Result<(), FileError> {
        Ok(()) // Nothing is held back.
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Seek
    for File<'_, '_, S, W, FILES>
{
    fn seek(&mut self, to: SeekFrom) -> Result<u64, FileError> {
        File::seek(self, to)
    }
}
