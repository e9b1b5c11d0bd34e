//! The room that ranges of a file take on the disk.

use condor_mbox::{MemoryWindow, Messenger};

use super::operation::After;
use super::ticket::{Ask, FileTicket};
use super::{File, FileError, request};
use crate::errno::Errno;
use crate::wire::{Operation, RequestSlot, allocate, find};

/// The change that [`File::allocate`] makes to a range of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AllocationMode {
    /// Takes room on the disk, so that later writes of the range find it. The file becomes as long as
    /// the range needs, with zeros.
    Extend,
    /// Takes room on the disk, also behind the end of the file, and keeps the length.
    KeepSize,
    /// Releases the room, so that the range reads as zeros; keeps the length.
    PunchHole,
    /// Lets the range read as zeros and keeps its room. The file becomes as long as the range needs.
    Zero,
    /// As [`Zero`](Self::Zero), and keeps the length.
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
    /// Returns the place where the first data at or after `position` begin, in bytes from the beginning of
    /// the file; `None` if only holes follow. The position of the file stays where it is.
    ///
    /// A filesystem that keeps no account of holes reports data up to the end of the file.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot tell; otherwise another [`FileError`].
    pub fn next_data(&self, position: u64) -> Result<Option<u64>, FileError> {
        self.find(position, find::DATA)
    }

    /// Returns the place where the first hole at or after `position` begins, in bytes from the beginning of
    /// the file. The end of the file counts as a hole; `None` if `position` is not before it.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot tell; otherwise another [`FileError`].
    pub fn next_hole(&self, position: u64) -> Result<Option<u64>, FileError> {
        self.find(position, find::HOLE)
    }

    /// Takes room on the disk for the `len` bytes from `position` on, releases it, or zeroes the bytes:
    /// `what` chooses.
    ///
    /// # Errors
    /// [`Errno::OPNOTSUPP`] if the filesystem of the host cannot do it, or if it would take room
    /// behind the end of a file of a server that limits sizes; [`Errno::INVAL`] if `len` is 0;
    /// [`Errno::BADF`] if the file is not open for writing; [`Errno::FBIG`], [`Errno::NOSPC`] and
    /// [`Errno::DQUOT`] as for a write; otherwise another [`FileError`].
    pub fn allocate(&self, what: AllocationMode, position: u64, len: u64) -> Result<(), FileError> {
        self.begin_allocate(what, position, len).done()
    }

    /// Returns a ticket that [takes room, releases it or zeroes bytes](Self::allocate).
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
