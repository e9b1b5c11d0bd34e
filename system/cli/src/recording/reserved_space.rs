//! [`ReservedSpace`]: room on the disk for all that a recording needs to be completed.

use std::fs::File;
use std::io;

use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;

/// The number of bytes that are taken at a time.
const STEP: u64 = 8 << 20;

/// Room that is allocated to a file before it is written, so that a full disk is noticed while there is
/// enough room to complete it.
#[derive(Debug)]
pub(super) struct ReservedSpace {
    file: File,
    bytes: u64,
    /// Whether the filesystem can allocate in advance.
    is_possible: bool,
}

impl ReservedSpace {
    pub(super) const fn new(file: File) -> Self {
        Self {
            file,
            bytes: 0,
            is_possible: true,
        }
    }

    #[cfg(test)]
    pub(super) const fn file(&self) -> &File {
        &self.file
    }

    /// Makes sure that the file can have `bytes` bytes. Where a filesystem cannot allocate in advance, a full
    /// disk shows when the file is written.
    pub(super) fn ensure(&mut self, bytes: u64) -> Result<(), Errno> {
        if bytes <= self.bytes || !self.is_possible {
            return Ok(());
        }
        let found = match self.grow(bytes + STEP) {
            Err(Errno::NOSPC | Errno::DQUOT | Errno::FBIG) => self.grow(bytes),
            other => other,
        };
        match found {
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
                self.is_possible = false;
                Ok(())
            }
            other => other,
        }
    }

    fn grow(&mut self, bytes: u64) -> Result<(), Errno> {
        let more = bytes.saturating_sub(self.bytes);
        rustix::io::retry_on_intr(|| {
            fallocate(&self.file, FallocateFlags::KEEP_SIZE, self.bytes, more)
        })?;
        self.bytes = bytes;
        Ok(())
    }

    /// Releases the room that was allocated beyond the end of the file.
    pub(super) fn give_back(file: &File) -> io::Result<()> {
        file.set_len(file.metadata()?.len())
    }
}
