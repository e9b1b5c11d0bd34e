//! Operations on paths.

use condor_mbox::{LoadOrder, MemoryWindow, Messenger, StoreOrder};

use super::operation::After;
use super::ticket::{Ask, FileTicket, TicketResult};
use super::{Alone, FileError, FileSystem, SessionState, request};
use crate::errno::Errno;
use crate::wire::{self, FileStatus, Operation, RequestSlot, Space, Span, Times, make_directory};

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Returns the status of the file or directory at `path`: size, times, permissions and the
    /// like. For a symbolic link, it is the status of the link itself.
    ///
    /// # Errors
    /// [`Errno::NOENT`] if nothing has this path; other numbers as on Unix if the host refuses;
    /// another [`FileError`] if the server does not answer in time, or if the mailbox or the window
    /// fails.
    pub fn status(&self, path: impl AsRef<[u8]>) -> Result<FileStatus, FileError> {
        self.begin_status(path.as_ref()).done()
    }

    /// Returns a ticket that asks for the status of `path`, as [`status`](Self::status) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_status<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, FileStatus> {
        let ask = Ask::Path(request(Operation::PathStatus), path.as_ref(), After::Status);
        FileTicket::new(self, ask, &mut [], TicketResult::status)
    }

    /// Returns the capacity of the filesystem that holds the server's tree: the numbers of its
    /// blocks and inodes, and of those that are free.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn space(&self) -> Result<Space, FileError> {
        self.begin_space().done()
    }

    /// Returns a ticket that asks for the capacity of the filesystem, as [`space`](Self::space)
    /// does. The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is
    /// called.
    pub fn begin_space(&self) -> FileTicket<'_, '_, 'm, S, W, FILES, Space> {
        let ask = Ask::Plain(Operation::Space, After::Space);
        FileTicket::new(self, ask, &mut [], TicketResult::space)
    }

    /// Sets the permissions of the file or directory at `path` to `mode`, such as 0o644. The
    /// server's umask does not reduce them, as it does for new files and directories.
    ///
    /// # Errors
    /// [`Errno::PERM`] if a file would get a set-user-ID or set-group-ID bit, with which programs
    /// of the host would run with the server's rights; [`Errno::INVAL`] if `mode` has more than the
    /// bits 0o7777; [`Errno::LOOP`] for a symbolic link; other numbers as on Unix if the host
    /// refuses; another [`FileError`] if the server does not answer in time, or if the mailbox or
    /// the window fails.
    pub fn set_mode(&self, path: impl AsRef<[u8]>, mode: u32) -> Result<(), FileError> {
        self.begin_set_mode(path.as_ref(), mode).done()
    }

    /// Returns a ticket that sets the permissions of `path`, as [`set_mode`](Self::set_mode) does.
    /// The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_set_mode<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
        mode: u32,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        let request = RequestSlot {
            position: mode.into(),
            ..request(Operation::PathMode)
        };
        self.on_path(request, path.as_ref())
    }

    /// Sets the times of the last access and modification of the file or directory at `path`.
    ///
    /// # Errors
    /// [`Errno::INVAL`] if a time has more than 999 999 999 nanoseconds; [`Errno::LOOP`] for a
    /// symbolic link; other numbers as on Unix if the host refuses; another [`FileError`] if the
    /// server does not answer in time, or if the mailbox or the window fails.
    pub fn set_times(&self, path: impl AsRef<[u8]>, times: Times) -> Result<(), FileError> {
        self.begin_set_times(path.as_ref(), times).done()
    }

    /// Returns a ticket that sets the times of `path`, as [`set_times`](Self::set_times) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_set_times<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
        times: Times,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.on_path(
            request(Operation::PathTimes).with_times(times),
            path.as_ref(),
        )
    }

    /// Makes a directory at `path`, with the permissions for new directories in the server's
    /// options.
    ///
    /// # Errors
    /// [`Errno::EXIST`] if `path` exists; other numbers as on Unix if the host refuses; another
    /// [`FileError`] if the server does not answer in time, or if the mailbox or the window fails.
    pub fn make_directory(&self, path: impl AsRef<[u8]>) -> Result<(), FileError> {
        self.begin_make_directory(path.as_ref(), None).done()
    }

    /// Makes a directory at `path` with the permissions `mode`, less the umask of the server.
    ///
    /// # Errors
    /// [`Errno::EXIST`] if `path` exists; [`Errno::INVAL`] if `mode` has more than the bits 0o7777;
    /// other numbers as on Unix if the host refuses; another [`FileError`] if the server does not
    /// answer in time, or if the mailbox or the window fails.
    pub fn make_directory_with(&self, path: impl AsRef<[u8]>, mode: u32) -> Result<(), FileError> {
        self.begin_make_directory(path.as_ref(), Some(mode)).done()
    }

    /// Returns a ticket that makes a directory at `path`. With `Some(mode)` it does so as
    /// [`make_directory_with`](Self::make_directory_with) does, and with `None` as
    /// [`make_directory`](Self::make_directory) does. The operation begins when the ticket is
    /// awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_make_directory<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
        mode: Option<u32>,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        let plain = request(Operation::MakeDirectory);
        let request = match mode {
            Some(mode) => RequestSlot {
                flags: make_directory::MODE,
                position: mode.into(),
                ..plain
            },
            None => plain,
        };
        self.on_path(request, path.as_ref())
    }

    /// Removes the directory at `path`, which must be empty.
    ///
    /// # Errors
    /// [`Errno::NOTEMPTY`] if the directory is not empty; other numbers as on Unix if the host
    /// refuses; another [`FileError`] if the server does not answer in time, or if the mailbox or
    /// the window fails.
    pub fn remove_directory(&self, path: impl AsRef<[u8]>) -> Result<(), FileError> {
        self.begin_remove_directory(path.as_ref()).done()
    }

    /// Returns a ticket that removes an empty directory, as
    /// [`remove_directory`](Self::remove_directory) does. The operation begins when the ticket is
    /// awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_remove_directory<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.on_path(request(Operation::RemoveDirectory), path.as_ref())
    }

    /// Removes the name `path` of a file, and with the last name the file itself. If this processor
    /// has the file open, its contents stay until it is closed; other processors that have it open
    /// get [`Errno::STALE`].
    ///
    /// # Errors
    /// [`Errno::NOENT`] if nothing has this path; other numbers as on Unix if the host refuses;
    /// another [`FileError`] if the server does not answer in time, or if the mailbox or the window
    /// fails.
    pub fn unlink(&self, path: impl AsRef<[u8]>) -> Result<(), FileError> {
        self.begin_unlink(path.as_ref()).done()
    }

    /// Returns a ticket that removes the name of a file, as [`unlink`](Self::unlink) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_unlink<'t>(
        &'t self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.on_path(request(Operation::Unlink), path.as_ref())
    }

    /// Renames the file or directory `from` to `to`; if `to` exists, it is replaced, as on Unix.
    ///
    /// Files that this processor opened by the path `from`, or in a directory of that path, stay
    /// usable. If they were opened by another spelling of the path, calls for them return
    /// [`Errno::STALE`] after the server's next restart.
    ///
    /// # Errors
    /// [`Errno::NOENT`] if nothing has the path `from`; other numbers as on Unix if the host
    /// refuses; another [`FileError`] if the server does not answer in time, or if the mailbox or
    /// the window fails.
    pub fn rename(&self, from: impl AsRef<[u8]>, to: impl AsRef<[u8]>) -> Result<(), FileError> {
        self.begin_rename(from.as_ref(), to.as_ref()).done()
    }

    /// Returns a ticket that renames `from` to `to`, as [`rename`](Self::rename) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_rename<'t>(
        &'t self,
        from: &'t (impl AsRef<[u8]> + ?Sized),
        to: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.rename_with(from.as_ref(), to.as_ref(), 0)
    }

    /// Renames as [`rename`](Self::rename) does, but fails if `to` exists.
    ///
    /// # Errors
    /// [`Errno::EXIST`] if `to` exists; [`Errno::NOENT`] if nothing has the path `from`; other
    /// numbers as on Unix if the host refuses; another [`FileError`] if the server does not answer
    /// in time, or if the mailbox or the window fails.
    pub fn rename_new(
        &self,
        from: impl AsRef<[u8]>,
        to: impl AsRef<[u8]>,
    ) -> Result<(), FileError> {
        self.begin_rename_new(from.as_ref(), to.as_ref()).done()
    }

    /// Returns a ticket that renames `from` to `to` if `to` does not exist, as
    /// [`rename_new`](Self::rename_new) does. The operation begins when the ticket is awaited, or
    /// when [`FileTicket::wait`] is called.
    pub fn begin_rename_new<'t>(
        &'t self,
        from: &'t (impl AsRef<[u8]> + ?Sized),
        to: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.rename_with(from.as_ref(), to.as_ref(), wire::rename::NO_REPLACE)
    }

    /// Swaps the files or directories at the paths `one` and `other`, in one step: at no instant is
    /// one of the names without a file. One may be a file and the other a directory.
    ///
    /// Files that this processor has open keep their contents, as with [`rename`](Self::rename).
    ///
    /// # Errors
    /// [`Errno::NOENT`] if nothing has one of the paths; [`Errno::INVAL`] if one path is a
    /// directory that contains the other; [`Errno::OPNOTSUPP`] if the filesystem of the host cannot
    /// exchange the names of files; other numbers as on Unix if the host refuses; another
    /// [`FileError`] if the server does not answer in time, or if the mailbox or the window fails.
    pub fn exchange(
        &self,
        one: impl AsRef<[u8]>,
        other: impl AsRef<[u8]>,
    ) -> Result<(), FileError> {
        self.begin_exchange(one.as_ref(), other.as_ref()).done()
    }

    /// Returns a ticket that swaps `one` and `other`, as [`exchange`](Self::exchange) does. The
    /// operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_exchange<'t>(
        &'t self,
        one: &'t (impl AsRef<[u8]> + ?Sized),
        other: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        self.rename_with(one.as_ref(), other.as_ref(), wire::rename::EXCHANGE)
    }

    fn rename_with<'t>(
        &'t self,
        from: &'t [u8],
        to: &'t [u8],
        flags: u32,
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        FileTicket::new(self, Ask::Rename { flags, from, to }, &mut [], drop)
    }

    fn on_path<'t>(
        &'t self,
        request: RequestSlot,
        path: &'t [u8],
    ) -> FileTicket<'t, 't, 'm, S, W, FILES, ()> {
        FileTicket::new(
            self,
            Ask::Path(request, path, After::Nothing),
            &mut [],
            drop,
        )
    }

    /// Writes a path to the window; `place` is that of a file, or one of the two after those.
    pub(super) fn put_path(&self, place: usize, path: &[u8]) -> Result<Span, FileError> {
        let offset = self.area.path(place);
        match u32::try_from(path.len()) {
            Ok(0) => Err(Errno::NOENT.into()),
            Ok(len) if len <= self.area.path_bytes() => {
                self.own.write(offset, path)?;
                Ok(Span { offset, len })
            }
            _ => Err(Errno::NAMETOOLONG.into()),
        }
    }

    /// After a rename, whose paths of these lengths are still in the window. With `both`, it has also
    /// moved the second path to the first.
    pub(super) fn rewrite_paths(
        &self,
        alone: &Alone<'_, W, FILES>,
        from_len: u32,
        to_len: u32,
        both: bool,
    ) -> Result<(), FileError> {
        let from = (self.area.path(FILES), from_len);
        let to = (self.area.path(FILES.wrapping_add(1)), to_len);
        for file in 0..FILES {
            // One of a file's names at most: none of two that are exchanged is inside of the other.
            if !self.rewrite_path(alone, file, from, to)? && both {
                self.rewrite_path(alone, file, to, from)?;
            }
        }
        Ok(())
    }

    /// Changes the beginning of a file's path, if it is `from`; returns true if it is. A name is its
    /// offset and length.
    fn rewrite_path(
        &self,
        alone: &Alone<'_, W, FILES>,
        file: usize,
        from: (u32, u32),
        to: (u32, u32),
    ) -> Result<bool, FileError> {
        let (from, from_len) = from;
        let (to, to_len) = to;
        let Ok(cell) = alone.file(file) else {
            return Ok(false);
        };
        let mut open = cell.get();
        let path = self.area.path(file);
        if open.state == SessionState::Free
            || open.path_len < from_len
            || !self.equal(path, from, from_len)?
            || (open.path_len > from_len && self.byte(path.saturating_add(from_len))? != b'/')
        {
            return Ok(false);
        }
        let rest = open.path_len.wrapping_sub(from_len);
        let len = to_len.saturating_add(rest);
        if len > self.area.path_bytes() {
            return Ok(true); // Stale after the next restart.
        }
        let (old, new) = (path.wrapping_add(from_len), path.wrapping_add(to_len));
        for n in 0..rest {
            // The end first if it moves up, so that nothing is overwritten before it is read.
            let n = if to_len > from_len {
                rest.wrapping_sub(1).wrapping_sub(n)
            } else {
                n
            };
            self.put_byte(new.wrapping_add(n), self.byte(old.wrapping_add(n))?)?;
        }
        for n in 0..to_len {
            self.put_byte(path.wrapping_add(n), self.byte(to.wrapping_add(n))?)?;
        }
        open.path_len = len;
        cell.set(open);
        let at = self.area.block(file).wrapping_add(wire::block::PATH);
        self.own.set_word(at.wrapping_add(4), len)?;
        Ok(true)
    }

    fn equal(&self, one: u32, other: u32, len: u32) -> Result<bool, FileError> {
        for n in 0..len {
            if self.byte(one.wrapping_add(n))? != self.byte(other.wrapping_add(n))? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    pub(super) fn byte(&self, offset: u32) -> Result<u8, FileError> {
        let word = self.own.load(offset & !3, LoadOrder::Relaxed)?;
        Ok((word >> (8 * (offset & 3))) as u8)
    }

    pub(super) fn put_byte(&self, offset: u32, byte: u8) -> Result<(), FileError> {
        let shift = 8 * (offset & 3);
        let word = self.own.load(offset & !3, LoadOrder::Relaxed)?;
        let word = word & !(0xff << shift) | u32::from(byte) << shift;
        self.own.store(offset & !3, word, StoreOrder::Relaxed)?;
        Ok(())
    }
}
