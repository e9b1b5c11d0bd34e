//! The room that ranges of a file take on the disk.

use condor_mbox::{MemoryWindow, Messenger};

use super::operation::After;
use super::ticket::{Ask, FileTicket};
use super::{File, FileError, request};
use crate::errno::Errno;
use crate::wire::{Operation, RequestSlot, allocate, find};

/// The change that [`File::allocate`] makes to a range of bytes of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AllocationMode {
    /// Takes room on the disk, so that later writes of the range find it. The file becomes as long as
    /// the range needs, with zeros.
    Extend,
    /// Takes room on the disk, also behind the end of the file, and keeps the length of the file.
    KeepSize,
    /// Releases the room on the disk, so that the range reads as zeros; keeps the length of the
    /// file.
    PunchHole,
    /// Makes the range read as zeros, and keeps its room on the disk. The file becomes as long as
    /// the range needs.
    Zero,
    /// Makes the range read as zeros, as [`Zero`](Self::Zero) does, but keeps the length of the
    /// file.
    ZeroKeepSize,
}

impl AllocationMode {
    const fn flags(self) -> u32 {
        match self {
            Self::Extend => 0,
            Self::KeepSize => allocate::KEEP_SIZE,
            Self::PunchHole => allocate::PUNCH_HOLE | allocate::KEEP_SIZE,
            Self::Zero => allocate::ZERO,
            Self::ZeroKeepSize => allocate::ZERO | allocate::KEEP_SIZE,
        }
    }
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'_, 'm, S, W, FILES> {
    /// Returns the first position at or after `position` that does not lie in a hole, in bytes from
    /// the beginning of the file; `None` if only holes follow. A hole is a range that takes no room
    /// on the disk and reads as zeros. The position of the file itself does not move.
    ///
    /// A filesystem that does not record holes reports data up to the end of the file.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot tell; another [`FileError`] if the
    /// server does not answer in time, or if the mailbox or the window fails.
    pub fn next_data(&self, position: u64) -> Result<Option<u64>, FileError> {
        self.find(position, find::DATA)
    }

    /// Returns the first position at or after `position` that lies in a hole, in bytes from the
    /// beginning of the file. A hole is a range that takes no room on the disk and reads as zeros;
    /// the end of the file counts as a hole. Returns `None` if `position` is at or after the end.
    /// The position of the file itself does not move.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot tell; another [`FileError`] if the
    /// server does not answer in time, or if the mailbox or the window fails.
    pub fn next_hole(&self, position: u64) -> Result<Option<u64>, FileError> {
        self.find(position, find::HOLE)
    }

    /// Changes the `len` bytes from `position` on as `what` says: takes room on the disk for them,
    /// releases this room, or fills the range with zeros. `position` is in bytes from the beginning
    /// of the file.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot do it, or if the range reaches
    /// past the end of the file, keeps its length, and the server limits the sizes of files;
    /// [`Errno::INVAL`] if `len` is 0; [`Errno::BADF`] if the file is not open for writing;
    /// [`Errno::FBIG`], [`Errno::NOSPC`] and [`Errno::DQUOT`] as for a write; another [`FileError`]
    /// if the server does not answer in time, or if the mailbox or the window fails.
    pub fn allocate(&self, what: AllocationMode, position: u64, len: u64) -> Result<(), FileError> {
        self.begin_allocate(what, position, len).done()
    }

    /// Returns a ticket that takes or releases room on the disk, or writes zeros, as
    /// [`allocate`](Self::allocate) does. The operation begins when the ticket is awaited, or when
    /// [`FileTicket::wait`] is called.
    pub fn begin_allocate(
        &self,
        what: AllocationMode,
        position: u64,
        len: u64,
    ) -> FileTicket<'_, '_, 'm, S, W, FILES, ()> {
        let request = RequestSlot {
            flags: what.flags(),
            position,
            ..request(Operation::Allocate)
        };
        self.ask(request.with_range_len(len))
    }

    fn find(&self, position: u64, flags: u32) -> Result<Option<u64>, FileError> {
        let request = RequestSlot {
            flags,
            position,
            ..request(Operation::Find)
        };
        let ask = Ask::File(request, self.index, After::Nothing);
        match FileTicket::new(self.system, ask, &mut [], |found| found.value).done() {
            Ok(value) => Ok(Some(value)),
            Err(FileError::Errno(Errno::NXIO)) => Ok(None),
            Err(error) => Err(error),
        }
    }
}
