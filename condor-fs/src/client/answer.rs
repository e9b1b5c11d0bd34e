//! [`OperationResult`]: what is asked for by a receipt.

use condor_mbox::{MemoryWindow, Messenger};

use super::error::Receipt;
use super::operation::After;
use super::ticket::{Ask, FileTicket, TicketResult};
use super::{Directory, File, FileSystem};
use crate::wire::{FileStatus, Space};

/// The result of an operation that timed out at first: [`FileSystem::ticket`] asks for it by the
/// [`Receipt`] in the error.
#[non_exhaustive]
pub enum OperationResult<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    /// The number of bytes that were read or written, the position that was found, or, for a
    /// directory, the number of bytes of entries that were read. It is 0 for an operation that has
    /// no result.
    Number(u64),
    /// The status of a file or directory.
    Status(FileStatus),
    /// The capacity of the filesystem.
    Space(Space),
    /// The file that was opened.
    File(File<'f, 'm, S, W, FILES>),
    /// The directory that was opened.
    Directory(Directory<'f, 'm, S, W, FILES>),
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize>
    TicketResult<'f, 'm, S, W, FILES>
{
    /// Of what was opened.
    pub(super) fn file(self) -> File<'f, 'm, S, W, FILES> {
        let index = match self.after {
            After::Opened { file, .. } => file,
            // Of no file: every call of it is refused.
            _ => FILES,
        };
        File {
            system: self.system,
            index,
        }
    }

    fn answer(self) -> OperationResult<'f, 'm, S, W, FILES> {
        match self.after {
            After::Status => OperationResult::Status(self.status()),
            After::Space => OperationResult::Space(self.space()),
            After::Opened {
                directory: true, ..
            } => OperationResult::Directory(Directory::of(self.file())),
            After::Opened { .. } => OperationResult::File(self.file()),
            _ => OperationResult::Number(self.value),
        }
    }
}

impl<'m, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> FileSystem<'m, S, W, FILES> {
    /// Returns a ticket for the result of an earlier call, which ended with
    /// [`FileError::TimedOut`](super::FileError::TimedOut) and this `receipt`.
    ///
    /// If that call read through the file's own buffer, as [`File::read`] does, the bytes are
    /// copied to `into`, which must have room for all of them. For every other call `into` may be
    /// empty.
    ///
    /// Only the result of the last operation that was in doubt is kept, even if other calls have
    /// waited for its end since. A file or directory that was opened is kept until another open
    /// needs its place. Bytes that were read are kept until the same file is read or written again.
    /// [`settle`](Self::settle) does not use the result up.
    ///
    /// There is no result to ask for if the operation was only a part of a call: see
    /// [`settle`](Self::settle).
    ///
    /// ```
    /// # use core::time::Duration;
    /// # use condor_fs::{OperationResult, FileError, File, FileSystem, OpenOptions};
    /// # use condor_mbox::{MemoryWindow, Messenger};
    /// # fn open<'f, 'm, S: Messenger, W: MemoryWindow, const FILES: usize>(
    /// #     files: &'f FileSystem<'m, S, W, FILES>,
    /// # ) -> Result<Option<File<'f, 'm, S, W, FILES>>, FileError> {
    /// Ok(match files.open("log", OpenOptions::new().append().create()) {
    ///     // Later, and not another open.
    ///     Err(FileError::TimedOut { receipt, .. }) => {
    ///         match files.ticket(receipt, &mut []).wait(Duration::from_secs(60))? {
    ///             OperationResult::File(file) => Some(file),
    ///             _ => None,
    ///         }
    ///     }
    ///     outcome => Some(outcome?),
    /// })
    /// # }
    /// ```
    pub fn ticket<'f: 't, 't>(
        &'f self,
        receipt: Receipt,
        into: &'t mut [u8],
    ) -> FileTicket<'t, 'f, 'm, S, W, FILES, OperationResult<'f, 'm, S, W, FILES>> {
        FileTicket::new(self, Ask::Begun(receipt.0), into, TicketResult::answer)
    }
}
