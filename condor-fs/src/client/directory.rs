//! [`Directory`]: an iterator over the entries of a directory.

use condor_mbox::{MemoryWindow, Messenger};

use super::operation::After;
use super::ticket::{Ask, FileTicket};
use super::{File, FileError, FileSystem, OpenOptions, request};
use crate::errno::Errno;
use crate::wire::{FileStatus, Operation, RequestSlot, Span, whole};

/// Bytes of an entry before its name.
const HEAD: u32 = 16;
/// Entries that a directory has and that are left out: `.` and `..`.
const LEFT_OUT: u32 = 2;

/// An open directory of the host. Each call of [`next`](Self::next) returns one of its entries.
///
/// A directory that is dropped is closed by the next [`FileSystem::open`].
pub struct Directory<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    file: File<'f, 'm, S, W, FILES>,
    /// The place at which the server continues.
    cookie: u64,
    /// The offset of the next entry in the buffer, in bytes.
    next: u32,
    /// The number of bytes of the buffer that hold entries.
    filled: u32,
}

/// An entry of a directory: a name, and the type of the file that has this name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DirectoryEntry<'n> {
    /// The name, which need not be UTF-8.
    pub name: &'n [u8],
    /// The type of the file, as the type bits of `st_mode` shifted right by 12: 4 for a directory,
    /// 8 for a regular file, 10 for a symbolic link; 0 if the filesystem of the host does not tell.
    pub kind: u32,
}

impl DirectoryEntry<'_> {
    /// Returns true if the entry is a directory.
    #[must_use]
    pub const fn is_directory(&self) -> bool {
        self.kind == 4
    }

    /// Returns true if the entry is a regular file.
    #[must_use]
    pub const fn is_file(&self) -> bool {
        self.kind == 8
    }
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Opens the directory at `path`, relative to the top of the server's tree; "." is the top
    /// itself.
    ///
    /// # Errors
    /// [`Errno::NOTDIR`] if `path` is not a directory; [`Errno::MFILE`] if `FILES` files and
    /// directories are open; other numbers as on Unix if the host refuses; another [`FileError`] if
    /// the server does not answer in time, or if the mailbox or the window fails.
    pub fn open_directory(
        &self,
        path: impl AsRef<[u8]>,
    ) -> Result<Directory<'_, 'm, S, W, FILES>, FileError> {
        self.begin_open_directory(path.as_ref()).done()
    }

    /// Returns a ticket that opens a directory, as [`open_directory`](Self::open_directory) does.
    /// The operation begins when the ticket is awaited, or when [`FileTicket::wait`] is called.
    pub fn begin_open_directory<'f: 't, 't>(
        &'f self,
        path: &'t (impl AsRef<[u8]> + ?Sized),
    ) -> FileTicket<'t, 'f, 'm, S, W, FILES, Directory<'f, 'm, S, W, FILES>> {
        let ask = OpenOptions::directory().ask(path.as_ref());
        FileTicket::new(self, ask, &mut [], |found| Directory::of(found.file()))
    }
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize>
    Directory<'f, 'm, S, W, FILES>
{
    /// Makes the directory of a block that is open like a file.
    pub(super) const fn of(file: File<'f, 'm, S, W, FILES>) -> Self {
        Self {
            file,
            cookie: 0,
            next: 0,
            filled: 0,
        }
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Directory<'_, '_, S, W, FILES> {
    /// Returns the next entry, and copies its name into `name`; returns `None` after the last
    /// entry. The entries `.` and `..` are left out.
    ///
    /// Entries that are made or removed while the directory is being read may be returned or not;
    /// every other entry is returned once.
    ///
    /// # Errors
    /// [`Errno::NAMETOOLONG`] if `name` is shorter than the entry's name; the next call then goes
    /// on with the entry after it. [`Errno::INVAL`] if the buffer in the [`Area`](super::Area) is
    /// too short for an entry; another [`FileError`] if the server does not answer in time, or if
    /// the mailbox or the window fails.
    pub fn next<'n>(
        &mut self,
        name: &'n mut [u8],
    ) -> Result<Option<DirectoryEntry<'n>>, FileError> {
        for _ in 0..=LEFT_OUT {
            if self.next >= self.filled && !self.fill()? {
                return Ok(None);
            }
            let system = self.file.system;
            let at = system.area.buffer(self.file.index).wrapping_add(self.next);
            let word = |n: u32| system.own.word(at.wrapping_add(4 * n));
            let (kind, len) = (word(2)?, word(3)?);
            let cookie = whole(word(0)?, word(1)?);
            let room = self.filled.wrapping_sub(self.next).saturating_sub(HEAD);
            if len > room {
                return Err(Errno::IO.into());
            }
            self.cookie = cookie;
            self.next = (self.next.wrapping_add(HEAD)).saturating_add(len.next_multiple_of(4));
            let Some(into) = name.get_mut(..len as usize) else {
                return Err(Errno::NAMETOOLONG.into());
            };
            system.own.read(at.wrapping_add(HEAD), into)?;
            if into != b"." && into != b".." {
                return Ok(name
                    .get(..len as usize)
                    .map(|name| DirectoryEntry { name, kind }));
            }
        }
        Err(Errno::IO.into()) // A server could go on like this for ever.
    }

    /// Goes back to the first entry. From then on, entries that were made since the directory was
    /// opened are returned, too.
    pub fn rewind(&mut self) {
        self.cookie = 0;
        self.next = 0;
        self.filled = 0;
    }

    /// Waits until the names in the directory are on the disk of the host. From then on, files that
    /// were made, renamed or removed in it remain so even after a loss of power.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in
    /// time, or if the mailbox or the window fails.
    pub fn sync(&self) -> Result<(), FileError> {
        self.file.sync()
    }

    /// Returns the status of the directory: its times, its permissions, and the other facts that
    /// `stat` of Unix tells.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn status(&self) -> Result<FileStatus, FileError> {
        self.file.status()
    }

    /// Closes the directory, as [`File::close`](super::File::close) does.
    ///
    /// # Errors
    /// [`FileError::Errno`] if the server refuses; another [`FileError`] if it does not answer in time, or
    /// if the mailbox or the window fails.
    pub fn close(self) -> Result<(), FileError> {
        self.file.close()
    }

    /// Asks for more entries; whether there are.
    fn fill(&mut self) -> Result<bool, FileError> {
        let (system, index) = (self.file.system, self.file.index);
        let buffer = Span {
            offset: system.area.buffer(index),
            len: system.area.buffer_bytes(),
        };
        let request = RequestSlot {
            position: self.cookie,
            buffer,
            ..request(Operation::ReadDirectory)
        };
        self.next = 0;
        self.filled = 0;
        let ask = Ask::File(request, index, After::Nothing);
        let value = FileTicket::new(system, ask, &mut [], |found| found.value).done()?;
        self.filled = u32::try_from(value).map_or(buffer.len, |len| len.min(buffer.len));
        Ok(self.filled > 0)
    }
}
