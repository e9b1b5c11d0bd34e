//! [`File`]: an open file.

use core::sync::atomic::Ordering;

use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::{ErrorType, Read, ReadExactError, Seek, SeekFrom, Write};

use super::operation::After;
use super::ticket::{Ask, Found, Ticket};
use super::{
    Alone, Buffer, Error, FileSystem, Kept, Lent, Open, SessionState, State, request, whole,
};
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
        self.begin_open(path.as_ref(), options).done()
    }

    /// Returns a ticket that [opens](Self::open) a file.
    pub fn begin_open<'f: 't, 't>(
        &'f self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
        options: OpenOptions,
    ) -> Ticket<'t, 'f, 'm, S, W, FILES, File<'f, 'm, S, W, FILES>> {
        Ticket::new(
            self,
            Ask::Open(path.as_ref(), options),
            &mut [],
            Found::file,
        )
    }

    /// Opens `path` in a free block, whose index it gives.
    #[cfg(feature = "dev")]
    pub(super) fn open_block(&self, path: &[u8], options: OpenOptions) -> Result<usize, Error> {
        self.begin_open(path, options).done().map(File::into_index)
    }

    /// Takes a free block for what is to be opened, and writes to the window what the server needs.
    pub(super) fn prepare_open(
        &self,
        alone: &Alone<'_, W, FILES>,
        path: &[u8],
        options: OpenOptions,
    ) -> Result<(Request, After), Error> {
        let OpenOptions { flags, mode } = options;
        let free = |cell: &core::cell::Cell<Open>| cell.get().state == SessionState::Free;
        let index = alone.files.iter().position(free).ok_or(Errno::MFILE)?;
        let path = self.put_path(index, path)?;
        let at = self.area.block(index);
        let [session, session_high] = halves(alone.session.get());
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
        self.set_left(index, false);
        alone.change(index, |open| {
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
        let directory = flags & flag::DIRECTORY != 0;
        let file = index;
        Ok((request, After::Opened { file, directory }))
    }

    /// A request about an open file.
    pub(super) fn about(
        &self,
        alone: &Alone<'_, W, FILES>,
        operation: Operation,
        index: usize,
    ) -> Result<Request, Errno> {
        Ok(Request {
            handle: alone.file(index)?.get().handle,
            file: index as u32,
            ..request(operation)
        })
    }

    /// Says whether nobody has a file any more that is open.
    pub(super) fn set_left(&self, index: usize, left: bool) {
        if let Some(flag) = self.left.get(index) {
            // Release: pairs with the Acquire load in `is_left`.
            flag.store(left, Ordering::Release);
        }
    }

    pub(super) fn is_left(&self, index: usize) -> bool {
        // Acquire: what was done with the file was done before it is closed.
        (self.left.get(index)).is_some_and(|flag| flag.load(Ordering::Acquire))
    }

    #[cfg(feature = "dev")]
    pub(super) fn close_block(&self, index: usize) -> Result<(), Error> {
        Ticket::new(self, Ask::Close(index), &mut [], drop).done()
    }

    /// As much of a file's own buffer as `len` bytes need.
    pub(super) fn own_buffer(&self, index: usize, len: usize) -> Span {
        let most = self.area.buffer_bytes();
        Span {
            offset: self.area.buffer(index),
            len: u32::try_from(len).map_or(most, |len| len.min(most)),
        }
    }

    /// Puts the beginning of `from` into a file's own buffer.
    pub(super) fn fill_buffer(
        &self,
        alone: &Alone<'_, W, FILES>,
        index: usize,
        buffer: Span,
        from: &[u8],
    ) -> Result<(), Error> {
        alone.use_buffer(index);
        if let Some(from) = from.get(..buffer.len as usize) {
            self.own.write(buffer.offset, from)?;
        }
        Ok(())
    }

    /// The request of a transfer by way of the file's own buffer.
    pub(super) fn prepare_transfer(
        &self,
        alone: &Alone<'_, W, FILES>,
        operation: Operation,
        file: usize,
        buffer: Span,
        at: Option<u64>,
    ) -> Result<(Request, After), Error> {
        alone.use_buffer(file);
        let after = match (operation, at) {
            (Operation::Read, None) => After::Read { file },
            (Operation::Read, Some(_)) => After::ReadAt { file },
            (_, None) => After::Moved { file },
            (_, Some(_)) => After::Nothing,
        };
        let request = Request {
            // Only now: what was in doubt may have moved the position.
            position: at.map_or_else(|| alone.position(file), Ok)?,
            buffer,
            ..self.about(alone, operation, file)?
        };
        Ok((request, after))
    }
}

impl<W: MemoryWindow, const FILES: usize> State<W, FILES> {
    pub(super) fn position(&self, index: usize) -> Result<u64, Errno> {
        Ok(self.file(index)?.get().position)
    }

    /// The operation that writes: at the end of a file that was opened for appending, which has no
    /// other positions.
    pub(super) fn writing(&self, index: usize, at: Option<u64>) -> Result<Operation, Errno> {
        let appends = self.file(index)?.get().flags & flag::APPEND != 0;
        match at {
            None if appends => Ok(Operation::Append),
            Some(_) if appends => Err(Errno::INVAL),
            _ => Ok(Operation::Write),
        }
    }

    /// A file's own buffer is used: bytes of a read that timed out, and that nobody has asked for, are
    /// there no more.
    pub(super) fn use_buffer(&self, index: usize) {
        if let Some(ended) = self.ended.get()
            && let After::Read { file } | After::ReadAt { file } = ended.after
            && file == index
        {
            self.ended.set(None);
        }
    }
}

#[cfg(feature = "dev")]
impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'f, 'm, S, W, FILES> {
    /// What is open in a block.
    pub(super) fn at(system: &'f FileSystem<'m, S, W, FILES>, index: usize) -> Self {
        Self { system, index }
    }
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'f, 'm, S, W, FILES> {
    /// The block, which stays open.
    pub(super) fn into_index(self) -> usize {
        core::mem::ManuallyDrop::new(self).index
    }

    /// Reads from the position on into `into`, at most as many bytes as the file's buffer holds,
    /// and moves the position. Returns the number of bytes; 0 at the end of the file.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn read(&mut self, into: &mut [u8]) -> Result<usize, Error> {
        self.read_from(into, None)
    }

    /// Reads from `position` on into `into`, at most as many bytes as the file's buffer holds. The
    /// file's own position stays. Returns the number of bytes; 0 at the end of the file.
    ///
    /// # Errors
    /// Those of [`read`](Self::read).
    pub fn read_at(&self, into: &mut [u8], position: u64) -> Result<usize, Error> {
        self.read_from(into, Some(position))
    }

    /// Writes from `from` at the position (or at the end of a file that was opened for appending),
    /// at most as many bytes as the file's buffer holds, and moves the position. Returns the number
    /// of bytes.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn write(&mut self, from: &[u8]) -> Result<usize, Error> {
        self.write_to(from, None)
    }

    /// Writes from `from` at `position`, at most as many bytes as the file's buffer holds. The
    /// file's own position stays. Returns the number of bytes.
    ///
    /// # Errors
    /// [`Errno::INVAL`] for a file that was opened for appending; otherwise those of
    /// [`write`](Self::write).
    pub fn write_at(&self, from: &[u8], position: u64) -> Result<usize, Error> {
        self.write_to(from, Some(position))
    }

    fn read_from(&self, into: &mut [u8], at: Option<u64>) -> Result<usize, Error> {
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

    fn write_to(&self, from: &[u8], at: Option<u64>) -> Result<usize, Error> {
        let system = self.system;
        let buffer = system.own_buffer(self.index, from.len());
        let alone = system.enter()?;
        let operation = alone.writing(self.index, at)?;
        // Before the buffer is touched: it may belong to a write in doubt.
        let deadline = system.clear(&alone)?;
        system.fill_buffer(&alone, self.index, buffer, from)?;
        let (request, after) =
            system.prepare_transfer(&alone, operation, self.index, buffer, at)?;
        let done = system.perform_next(&alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }

    /// Returns a ticket that [reads](Self::read). Only one that ends moves the position.
    pub fn begin_read<'t>(
        &'t mut self,
        into: &'t mut [u8],
    ) -> Ticket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Read(self.index, None);
        Ticket::new(self.system, ask, into, |found| found.value as usize)
    }

    /// Returns a ticket that [reads at a position](Self::read_at).
    pub fn begin_read_at<'t>(
        &'t self,
        into: &'t mut [u8],
        position: u64,
    ) -> Ticket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Read(self.index, Some(position));
        Ticket::new(self.system, ask, into, |found| found.value as usize)
    }

    /// Returns a ticket that [writes](Self::write).
    pub fn begin_write<'t>(&'t mut self, from: &'t [u8]) -> Ticket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Write(self.index, None, from);
        Ticket::new(self.system, ask, &mut [], |found| found.value as usize)
    }

    /// Returns a ticket that [writes at a position](Self::write_at).
    pub fn begin_write_at<'t>(
        &'t self,
        from: &'t [u8],
        position: u64,
    ) -> Ticket<'t, 't, 'm, S, W, FILES, usize> {
        let ask = Ask::Write(self.index, Some(position), from);
        Ticket::new(self.system, ask, &mut [], |found| found.value as usize)
    }

    /// Reads at most `len` bytes from the position on directly into `buffer`, and moves the
    /// position. Returns the number of bytes and the buffer.
    ///
    /// # Errors
    /// [`Kept`] with the buffer and an [`Error`]: [`Errno::FAULT`] if the buffer is
    /// shorter than `len`; [`Errno::BUSY`] if an earlier buffer has not been [taken
    /// back](FileSystem::take_buffer); otherwise that of the server or the mailbox.
    pub fn read_buffer(&mut self, buffer: Buffer<W>, len: u32) -> Lent<W> {
        self.lend(true, buffer, len, None)
    }

    /// Reads as [`read_buffer`](Self::read_buffer) does, from `position` on; the file's own position
    /// stays.
    ///
    /// # Errors
    /// Those of [`read_buffer`](Self::read_buffer).
    pub fn read_buffer_at(&self, buffer: Buffer<W>, len: u32, position: u64) -> Lent<W> {
        self.lend(true, buffer, len, Some(position))
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
        self.lend(false, buffer, len, None)
    }

    /// Writes as [`write_buffer`](Self::write_buffer) does, at `position`; the file's own position
    /// stays.
    ///
    /// # Errors
    /// [`Errno::INVAL`] for a file that was opened for appending; otherwise those of
    /// [`write_buffer`](Self::write_buffer).
    pub fn write_buffer_at(&self, buffer: Buffer<W>, len: u32, position: u64) -> Lent<W> {
        self.lend(false, buffer, len, Some(position))
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

    /// Returns the position of the next read or write, in bytes from the beginning.
    ///
    /// # Errors
    /// [`Errno::BUSY`] if another context's operation is in progress, which may move it.
    pub fn position(&self) -> Result<u64, Error> {
        Ok(self.system.enter()?.position(self.index)?)
    }

    /// Returns the status of the file: its size, times, mode, and what else the host knows.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn status(&self) -> Result<Status, Error> {
        self.begin_status().done()
    }

    /// Returns a ticket for the [status](Self::status).
    pub fn begin_status(&self) -> Ticket<'_, '_, 'm, S, W, FILES, Status> {
        self.look(After::Status)
    }

    /// Sets the permissions of the file, as [`FileSystem::set_mode`] does.
    ///
    /// # Errors
    /// Those of [`FileSystem::set_mode`].
    pub fn set_mode(&self, mode: u32) -> Result<(), Error> {
        self.begin_set_mode(mode).done()
    }

    /// Returns a ticket that [sets the permissions](Self::set_mode).
    pub fn begin_set_mode(&self, mode: u32) -> Ticket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(Request {
            position: mode.into(),
            ..request(Operation::FileMode)
        })
    }

    /// Sets the times of the file, as [`FileSystem::set_times`] does.
    ///
    /// # Errors
    /// Those of [`FileSystem::set_times`].
    pub fn set_times(&self, times: Times) -> Result<(), Error> {
        self.begin_set_times(times).done()
    }

    /// Returns a ticket that [sets the times](Self::set_times).
    pub fn begin_set_times(&self, times: Times) -> Ticket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(request(Operation::FileTimes).with_times(times))
    }

    /// Sets the size of the file to `size` bytes; added bytes are zeros.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn truncate(&self, size: u64) -> Result<(), Error> {
        self.begin_truncate(size).done()
    }

    /// Returns a ticket that [sets the size](Self::truncate).
    pub fn begin_truncate(&self, size: u64) -> Ticket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(Request {
            position: size,
            ..request(Operation::Truncate)
        })
    }

    /// Waits until the contents of the file are on the disk of the host.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn sync(&self) -> Result<(), Error> {
        self.begin_sync().done()
    }

    /// Returns a ticket that [waits for the disk](Self::sync).
    pub fn begin_sync(&self) -> Ticket<'_, '_, 'm, S, W, FILES, ()> {
        self.ask(request(Operation::Sync))
    }

    /// Closes the file. After an error that is not an [`Errno`], a later [`open`](FileSystem::open)
    /// closes it.
    ///
    /// # Errors
    /// [`Error::Errno`] if the server refuses; another [`Error`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn close(self) -> Result<(), Error> {
        self.begin_close().done()
    }

    /// Returns a ticket that [closes](Self::close) the file. If it is dropped, a later
    /// [`open`](FileSystem::open) closes it.
    pub fn begin_close(self) -> Ticket<'f, 'f, 'm, S, W, FILES, ()> {
        let system = self.system;
        Ticket::new(system, Ask::Close(self.into_index()), &mut [], drop)
    }

    pub(super) fn ask(&self, request: Request) -> Ticket<'_, '_, 'm, S, W, FILES, ()> {
        let ask = Ask::File(request, self.index, After::Nothing);
        Ticket::new(self.system, ask, &mut [], drop)
    }

    fn look(&self, after: After) -> Ticket<'_, '_, 'm, S, W, FILES, Status> {
        let ask = Ask::File(request(Operation::FileStatus), self.index, after);
        Ticket::new(self.system, ask, &mut [], Found::status)
    }

    /// Moves data by way of the file's own buffer.
    fn transfer(
        &self,
        alone: &Alone<'_, W, FILES>,
        operation: Operation,
        buffer: Span,
        at: Option<u64>,
    ) -> Result<usize, Error> {
        let system = self.system;
        let deadline = system.clear(alone)?;
        let (request, after) = system.prepare_transfer(alone, operation, self.index, buffer, at)?;
        let done = system.perform_next(alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }

    /// Moves data for a reader or writer.
    pub(super) fn transfer_ahead(&self, reads: bool, buffer: Span) -> Result<usize, Error> {
        let system = self.system;
        let alone = system.enter()?;
        let operation = if reads {
            Operation::Read
        } else {
            alone.writing(self.index, None)?
        };
        let deadline = system.clear(&alone)?;
        let (request, _) = system.prepare_transfer(&alone, operation, self.index, buffer, None)?;
        let after = After::Buffered { file: self.index };
        let done = system.perform_next(&alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }

    fn lend(&self, reads: bool, buffer: Buffer<W>, len: u32, at: Option<u64>) -> Lent<W> {
        let system = self.system;
        let refuse = |error: Error, buffer| Err(Kept { error, buffer });
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
    ) -> Result<usize, Error> {
        let (system, file) = (self.system, self.index);
        let operation = if reads {
            Operation::Read
        } else {
            alone.writing(file, at)?
        };
        let deadline = system.clear(alone)?;
        let request = Request {
            // Only now: what was in doubt may have moved the position.
            position: at.map_or_else(|| alone.position(file), Ok)?,
            buffer,
            ..system.about(alone, operation, file)?
        };
        let after = at.map_or(After::Moved { file }, |_| After::Nothing);
        let done = system.perform_next(alone, &request, after, deadline)?;
        Ok(moved(done.value, buffer))
    }
}

/// Whatever the server says, no more than it was asked for.
fn moved(value: u64, buffer: Span) -> usize {
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
