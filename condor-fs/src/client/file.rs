//! [`File`]: an open file.

use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::{ErrorType, Read, ReadExactError, Seek, SeekFrom, Write};

use super::operation::After;
use super::{Buffer, Error, FileSystem, Kept, Lent, Open, SessionState, request, whole};
use crate::errno::Errno;
use crate::wire::{Operation, Request, Span, Status, Times, block, halves, open as flag};

/// The options of an open; they mean the same as in the standard library.
///
/// ```
/// use condor_fs::OpenOptions;
///
/// const LOG: OpenOptions = OpenOptions::new().append().create();
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OpenOptions {
    pub(super) flags: u32,
    mode: u32,
}

impl OpenOptions {
    /// Makes options without any access; add at least reading, writing or appending.
    #[must_use]
    pub const fn new() -> Self {
        Self { flags: 0, mode: 0 }
    }

    const fn with(self, flags: u32) -> Self {
        Self {
            flags: self.flags | flags,
            mode: self.mode,
        }
    }

    /// Opens for reading.
    #[must_use]
    pub const fn read(self) -> Self {
        self.with(flag::READ)
    }

    /// Opens for writing.
    #[must_use]
    pub const fn write(self) -> Self {
        self.with(flag::WRITE)
    }

    /// Opens for appending: each write is at the end that the file has at that time.
    #[must_use]
    pub const fn append(self) -> Self {
        self.with(flag::APPEND | flag::WRITE)
    }

    /// Creates the file if it does not exist.
    #[must_use]
    pub const fn create(self) -> Self {
        self.with(flag::CREATE)
    }

    /// Truncates the file to length 0.
    #[must_use]
    pub const fn truncate(self) -> Self {
        self.with(flag::TRUNCATE)
    }

    /// Creates the file, and fails with [`Errno::EXIST`] if it exists.
    #[must_use]
    pub const fn exclusive(self) -> Self {
        self.with(flag::CREATE | flag::EXCLUSIVE)
    }

    /// Gives a file that is created the permissions `mode`, less the umask of the server. Without
    /// it, the server's options have the permissions. Add [`create`](Self::create) or
    /// [`exclusive`](Self::exclusive).
    #[must_use]
    pub const fn mode(self, mode: u32) -> Self {
        Self {
            flags: self.flags | flag::MODE,
            mode,
        }
    }

    /// Opens a directory.
    pub(super) const fn directory() -> Self {
        Self::new().read().with(flag::DIRECTORY)
    }
}

/// An open file.
///
/// Dropping a file leaves closing it to the next [`open`](FileSystem::open); [`close`](Self::close)
/// returns an error if closing fails. A file that was unlinked while it was open takes room until
/// it is closed.
///
/// The traits of `embedded-io` and the methods of the same names copy once, through the file's
/// buffer in the window; [`read_buffer`](Self::read_buffer) and
/// [`write_buffer`](Self::write_buffer) do not copy.
///
/// Every call asks the server once. [`reader`](Self::reader) and [`writer`](Self::writer) combine
/// many small calls into few.
///
/// After [`Error::TimedOut`] the position moves by as many bytes as turn out to have been
/// transferred: see [`FileSystem::settle`].
pub struct File<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    pub(super) system: &'f FileSystem<'m, S, W, FILES>,
    pub(super) index: usize,
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Opens the file at `path`.
    ///
    /// # Errors
    /// [`Errno::MFILE`] if `FILES` files are open; [`Errno::OPNOTSUPP`] if the path leads to
    /// something that is neither file nor directory; [`Errno::ISDIR`] if it is a directory; other
    /// numbers as on Unix; otherwise another [`Error`].
    pub fn open(
        &self,
        path: impl AsRef<[u8]>,
        options: OpenOptions,
    ) -> Result<File<'_, 'm, S, W, FILES>, Error> {
        let index = self.open_block(path.as_ref(), options)?;
        Ok(File {
            system: self,
            index,
        })
    }

    /// Opens `path` in a free block, whose index it gives.
    pub(super) fn open_block(&self, path: &[u8], options: OpenOptions) -> Result<usize, Error> {
        let OpenOptions { flags, mode } = options;
        let alone = self.enter()?;
        for (index, cell) in self.files.iter().enumerate() {
            let deadline = self.clear()?;
            if cell.get().state == SessionState::Left {
                let after = After::Dropped { file: index };
                let request = self.about(Operation::Close, index)?;
                match self.perform_next(&alone, &request, after, deadline) {
                    Ok(_) | Err(Error::Errno(_)) => {}
                    Err(error) => return Err(self.not_begun(error)),
                }
            }
        }
        let deadline = self.clear()?;
        let free = |cell: &core::cell::Cell<Open>| cell.get().state == SessionState::Free;
        let index = self.files.iter().position(free).ok_or(Errno::MFILE)?;
        let path = self.put_path(index, path)?;
        let at = self.area.block(index);
        let [session, session_high] = halves(self.session.get());
        for (offset, word) in [
            // Its low word: without that there is none.
            (block::HANDLE, 0),
            (0, block::MAGIC),
            (block::SESSION, session),
            (block::SESSION + 4, session_high),
            (block::FLAGS, flags),
            (block::PATH, path.offset),
            (block::PATH + 4, path.len),
            (block::SILLY, 0),
        ] {
            self.own.set_word(at.wrapping_add(offset), word)?;
        }
        self.change(index, |open| {
            *open = Open {
                // Nobody else may take it while the operation is in doubt.
                state: SessionState::Held,
                flags,
                path_len: path.len,
                ..Open::NONE
            };
        });
        let request = Request {
            path,
            flags,
            file: index as u32,
            position: mode.into(),
            ..request(Operation::Open)
        };
        let after = After::Opened { file: index };
        self.perform_next(&alone, &request, after, deadline)?;
        self.change(index, |open| open.state = SessionState::Held);
        Ok(index)
    }

    /// A request about an open file.
    pub(super) fn about(&self, operation: Operation, index: usize) -> Result<Request, Errno> {
        Ok(Request {
            handle: self.file(index)?.get().handle,
            file: index as u32,
            ..request(operation)
        })
    }

    pub(super) fn leave(&self, index: usize) {
        self.change(index, |open| open.state = SessionState::Left);
    }

    pub(super) fn close_block(&self, index: usize) -> Result<(), Error> {
        self.leave(index);
        let alone = self.enter()?;
        let deadline = self.clear()?;
        let request = self.about(Operation::Close, index)?;
        let after = After::Closed { file: index };
        self.perform_next(&alone, &request, after, deadline)?;
        Ok(())
    }
}

#[cfg(feature = "dev")]
impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'f, 'm, S, W, FILES> {
    /// What is open in a block.
    pub(super) fn at(system: &'f FileSystem<'m, S, W, FILES>, index: usize) -> Self {
        Self { system, index }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'_, '_, S, W, FILES> {
    /// Reads from the position on into `into`, at most as many bytes as the file's buffer holds,
    /// and moves the position. Returns the number of bytes; 0 at the end of the file.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn read(&mut self, into: &mut [u8]) -> Result<usize, Error> {
        let buffer = self.buffer(into.len());
        let after = After::Moved { file: self.index };
        let done = self.transfer(Operation::Read, buffer, after)?;
        let done = done.min(into.len());
        if let Some(into) = into.get_mut(..done) {
            self.system.own.read(buffer.offset, into)?;
        }
        Ok(done)
    }

    /// Writes from `from` at the position (or at the end of a file that was opened for appending),
    /// at most as many bytes as the file's buffer holds, and moves the position. Returns the number
    /// of bytes.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn write(&mut self, from: &[u8]) -> Result<usize, Error> {
        let buffer = self.buffer(from.len());
        let alone = self.system.enter()?;
        // Before the buffer is touched: it may belong to a write in doubt.
        self.system.clear()?;
        if let Some(from) = from.get(..buffer.len as usize) {
            self.system.own.write(buffer.offset, from)?;
        }
        drop(alone);
        let after = After::Moved { file: self.index };
        self.transfer(self.writing()?, buffer, after)
    }

    /// Reads at most `len` bytes from the position on directly into `buffer`, and moves the
    /// position. Returns the number of bytes and the buffer.
    ///
    /// # Errors
    /// [`Kept`] with the buffer and an [`Error`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](FileSystem::take_buffer); otherwise that of the server or the mailbox.
    pub fn read_buffer(&mut self, buffer: Buffer<W>, len: u32) -> Lent<W> {
        self.lend(Ok(Operation::Read), buffer, len)
    }

    /// Writes at most the first `len` bytes of `buffer` at the position (or at the end of a file
    /// that was opened for appending), and moves the position. Returns the number of bytes and the
    /// buffer.
    ///
    /// # Errors
    /// [`Kept`] with the buffer and an [`Error`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](FileSystem::take_buffer); otherwise that of the server or the mailbox.
    pub fn write_buffer(&mut self, buffer: Buffer<W>, len: u32) -> Lent<W> {
        self.lend(self.writing(), buffer, len)
    }

    /// Moves the position, which may be after the end; returns it in bytes from the beginning.
    ///
    /// # Errors
    /// [`Errno::INVAL`] if it would be before the beginning or past 2⁶³ − 1. A position relative to
    /// the end needs the server, and can return another [`Error`].
    pub fn seek(&mut self, to: SeekFrom) -> Result<u64, Error> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(step) => self.position()?.checked_add_signed(step),
            SeekFrom::End(step) => self.look(After::Looked)?.size.checked_add_signed(step),
        };
        match position {
            Some(position) if i64::try_from(position).is_ok() => {
                self.system
                    .change(self.index, |open| open.position = position);
                Ok(position)
            }
            _ => Err(Errno::INVAL.into()),
        }
    }

    /// Returns the position of the next read or write, in bytes from the beginning.
    ///
    /// # Errors
    /// An open file has a position, so there is no error in practice.
    pub fn position(&self) -> Result<u64, Error> {
        Ok(self.system.file(self.index)?.get().position)
    }

    /// Returns the status of the file: its size, times, mode, and what else the host knows.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn status(&self) -> Result<Status, Error> {
        self.look(After::Nothing)
    }

    /// Sets the permissions of the file, as [`FileSystem::set_mode`] does.
    ///
    /// # Errors
    /// Those of [`FileSystem::set_mode`].
    pub fn set_mode(&self, mode: u32) -> Result<(), Error> {
        let request = Request {
            position: mode.into(),
            ..self.system.about(Operation::FileMode, self.index)?
        };
        self.system.perform(&request, After::Nothing).map(drop)
    }

    /// Sets the times of the file, as [`FileSystem::set_times`] does.
    ///
    /// # Errors
    /// Those of [`FileSystem::set_times`].
    pub fn set_times(&self, times: Times) -> Result<(), Error> {
        let request = self.system.about(Operation::FileTimes, self.index)?;
        self.system
            .perform(&request.with_times(times), After::Nothing)
            .map(drop)
    }

    fn look(&self, after: After) -> Result<Status, Error> {
        let system = self.system;
        let alone = system.enter()?;
        let deadline = system.clear()?;
        let request = system.about(Operation::FileStatus, self.index)?;
        system.perform_next(&alone, &request, after, deadline)?;
        Ok(Status::from_words(&system.status_words(&alone)?))
    }

    /// Sets the size of the file to `size` bytes; added bytes are zeros.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn truncate(&mut self, size: u64) -> Result<(), Error> {
        let request = Request {
            position: size,
            ..self.system.about(Operation::Truncate, self.index)?
        };
        self.system.perform(&request, After::Nothing).map(drop)
    }

    /// Waits until the contents of the file are on the disk of the host.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn sync(&mut self) -> Result<(), Error> {
        let request = self.system.about(Operation::Sync, self.index)?;
        self.system.perform(&request, After::Nothing).map(drop)
    }

    /// Closes the file. After an error that is not an [`Errno`], a later [`open`](FileSystem::open)
    /// closes it.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn close(self) -> Result<(), Error> {
        let file = core::mem::ManuallyDrop::new(self);
        file.system.close_block(file.index)
    }

    pub(super) fn writing(&self) -> Result<Operation, Error> {
        let flags = self.system.file(self.index)?.get().flags;
        Ok(if flags & flag::APPEND == 0 {
            Operation::Write
        } else {
            Operation::Append
        })
    }

    /// As much of the file's buffer as `len` bytes need.
    pub(super) fn buffer(&self, len: usize) -> Span {
        let most = self.system.area.buffer_bytes();
        Span {
            offset: self.system.area.buffer(self.index),
            len: u32::try_from(len).map_or(most, |len| len.min(most)),
        }
    }

    /// Moves data for a reader or writer.
    pub(super) fn transfer_ahead(
        &self,
        operation: Operation,
        buffer: Span,
    ) -> Result<usize, Error> {
        self.transfer(operation, buffer, After::Buffered { file: self.index })
    }

    fn transfer(&self, operation: Operation, buffer: Span, after: After) -> Result<usize, Error> {
        let system = self.system;
        let alone = system.enter()?;
        let deadline = system.clear()?;
        // Only now: what was in doubt may have moved the position.
        let request = Request {
            position: self.position()?,
            buffer,
            ..system.about(operation, self.index)?
        };
        let done = system.perform_next(&alone, &request, after, deadline)?;
        // Whatever the server says, no more than it was asked for.
        Ok(done.value.min(buffer.len.into()) as usize)
    }

    fn lend(&self, operation: Result<Operation, Error>, buffer: Buffer<W>, len: u32) -> Lent<W> {
        let kept = self.system.kept.take();
        let outcome = if kept.is_some() {
            Err(Errno::BUSY.into())
        } else if len > buffer.memory().size() {
            Err(Errno::FAULT.into())
        } else {
            let offset = buffer.offset();
            let before = self.system.sequence.get();
            let after = After::Moved { file: self.index };
            match operation.and_then(|it| self.transfer(it, Span { offset, len }, after)) {
                Ok(done) => Ok(done),
                // In doubt, and about this buffer: not if a former operation is.
                Err(error) if self.system.in_doubt() && self.system.sequence.get() != before => {
                    self.system.kept.set(Some(buffer));
                    return Err(Kept {
                        error,
                        buffer: None,
                    });
                }
                Err(error) => Err(error),
            }
        };
        if kept.is_some() {
            self.system.kept.set(kept);
        }
        match outcome {
            Ok(done) => Ok((done, buffer)),
            Err(error) => Err(Kept {
                error,
                buffer: Some(buffer),
            }),
        }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Drop
    for File<'_, '_, S, W, FILES>
{
    fn drop(&mut self) {
        self.system.leave(self.index);
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> ErrorType
    for File<'_, '_, S, W, FILES>
{
    type Error = Error;
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Read
    for File<'_, '_, S, W, FILES>
{
    fn read(&mut self, into: &mut [u8]) -> Result<usize, Error> {
        File::read(self, into)
    }

    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<Error>> {
        whole::read_exact(into, |rest| File::read(self, rest))
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Write
    for File<'_, '_, S, W, FILES>
{
    fn write(&mut self, from: &[u8]) -> Result<usize, Error> {
        File::write(self, from)
    }

    /// [`Errno::IO`] if the server writes nothing, and names no error.
    fn write_all(&mut self, from: &[u8]) -> Result<(), Error> {
        whole::write_all(from, |rest| File::write(self, rest))
    }

    fn flush(&mut self) -> Result<(), Error> {
        Ok(()) // Nothing is held back.
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Seek
    for File<'_, '_, S, W, FILES>
{
    fn seek(&mut self, to: SeekFrom) -> Result<u64, Error> {
        File::seek(self, to)
    }
}
