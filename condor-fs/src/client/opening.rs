//! [`OpenOptions`], and what is known of files that are open.

use core::sync::atomic::Ordering;

use condor_mbox::{MemoryWindow, Messenger};

use super::operation::After;
use super::ticket::{Ask, FileTicket, TicketResult};
use super::{Alone, BlockState, File, FileError, FileSystem, SessionState, State, request};
use crate::errno::Errno;
use crate::wire::{Operation, RequestSlot, Span, block, halves, open as flag};

/// Options for [`FileSystem::open`], which mean the same as those of `std::fs::OpenOptions`.
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
    /// Makes options that allow nothing yet. Add at least one of [`read`](Self::read),
    /// [`write`](Self::write) and [`append`](Self::append).
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

    /// Allows reading from the file.
    #[must_use]
    pub const fn read(self) -> Self {
        self.with(flag::READ)
    }

    /// Allows writing to the file, at its position.
    #[must_use]
    pub const fn write(self) -> Self {
        self.with(flag::WRITE)
    }

    /// Allows writing at the end of the file only: each write begins at the end that the file has
    /// at that time.
    #[must_use]
    pub const fn append(self) -> Self {
        self.with(flag::APPEND | flag::WRITE)
    }

    /// Makes the open create the file if it does not exist.
    #[must_use]
    pub const fn create(self) -> Self {
        self.with(flag::CREATE)
    }

    /// Makes the open truncate the file to length 0.
    #[must_use]
    pub const fn truncate(self) -> Self {
        self.with(flag::TRUNCATE)
    }

    /// Makes the open create the file, and fail with [`Errno::EXIST`] if the file exists already.
    #[must_use]
    pub const fn exclusive(self) -> Self {
        self.with(flag::CREATE | flag::EXCLUSIVE)
    }

    /// Sets the permissions that the file has if the open creates it: `mode`, such as 0o644, less
    /// the umask of the server. Without this call, the file gets the permissions in the server's
    /// options. Add [`create`](Self::create) or [`exclusive`](Self::exclusive).
    #[must_use]
    pub const fn mode(self, mode: u32) -> Self {
        Self {
            flags: self.flags | flag::MODE,
            mode,
        }
    }

    /// Returns true if these options allow reading.
    #[must_use]
    pub const fn reads(self) -> bool {
        self.flags & flag::READ != 0
    }

    /// Returns true if these options allow writing.
    #[must_use]
    pub const fn writes(self) -> bool {
        self.flags & flag::WRITE != 0
    }

    /// Returns the request of a ticket that opens `path`.
    pub(super) const fn ask(self, path: &[u8]) -> Ask<'_> {
        Ask::Open {
            path,
            flags: self.flags,
            mode: self.mode,
        }
    }

    /// Opens a directory.
    pub(super) const fn directory() -> Self {
        Self::new().read().with(flag::DIRECTORY)
    }
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Opens the file at `path`, relative to the top of the server's directory tree.
    ///
    /// # Errors
    /// [`Errno::MFILE`] if `FILES` files and directories are open; [`Errno::OPNOTSUPP`] if `path`
    /// leads to something that is neither a file nor a directory; [`Errno::ISDIR`] if it leads to a
    /// directory; other numbers as on Unix if the host refuses; another [`FileError`] if the server
    /// does not answer in time, or if the mailbox or the window fails.
    pub fn open(
        &self,
        path: impl AsRef<[u8]>,
        options: OpenOptions,
    ) -> Result<File<'_, 'm, S, W, FILES>, FileError> {
        self.begin_open(path.as_ref(), options).done()
    }

    /// Returns a ticket that opens a file, as [`open`](Self::open) does. The operation begins when
    /// the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_open<'f: 't, 't>(
        &'f self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
        options: OpenOptions,
    ) -> FileTicket<'t, 'f, 'm, S, W, FILES, File<'f, 'm, S, W, FILES>> {
        FileTicket::new(
            self,
            options.ask(path.as_ref()),
            &mut [],
            TicketResult::file,
        )
    }

    /// Takes a free block for the file to open, and writes to the window what the server needs.
    pub(super) fn prepare_open(
        &self,
        alone: &Alone<'_, W, FILES>,
        path: &[u8],
        flags: u32,
        mode: u32,
    ) -> Result<(RequestSlot, After), FileError> {
        let free = |cell: &core::cell::Cell<BlockState>| cell.get().state == SessionState::Free;
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
            *open = BlockState {
                // Nobody else may take it while the operation is in doubt.
                state: SessionState::Held,
                flags,
                path_len: path.len,
                ..BlockState::NONE
            };
        });
        let request = RequestSlot {
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
    ) -> Result<(), FileError> {
        alone.use_buffer(index);
        if let Some(from) = from.get(..buffer.len as usize) {
            self.own.write(buffer.offset, from)?;
        }
        Ok(())
    }
}

impl<W: MemoryWindow, const FILES: usize> State<W, FILES> {
    /// A request about an open file.
    pub(super) fn about(&self, operation: Operation, index: usize) -> Result<RequestSlot, Errno> {
        Ok(RequestSlot {
            handle: self.file(index)?.get().handle,
            file: index as u32,
            ..request(operation)
        })
    }

    /// The request of a transfer by way of the file's own buffer.
    pub(super) fn prepare_transfer(
        &self,
        operation: Operation,
        file: usize,
        buffer: Span,
        at: Option<u64>,
    ) -> Result<(RequestSlot, After), FileError> {
        self.use_buffer(file);
        let after = match (operation, at) {
            (Operation::Read, None) => After::Read { file },
            (Operation::Read, Some(_)) => After::ReadAt { file },
            (_, None) => After::Moved { file },
            (_, Some(_)) => After::Nothing,
        };
        let request = RequestSlot {
            // Only now: what was in doubt may have moved the position.
            position: at.map_or_else(|| self.position(file), Ok)?,
            buffer,
            ..self.about(operation, file)?
        };
        Ok((request, after))
    }

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
