//! Ways to read and write a file, and the client's end of each.

use std::fmt;

use condor_fs::{Buffer, File};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::SeekFrom;

use crate::Result;

/// The operation of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operation {
    /// Reads the file's beginning.
    Read,
    /// Writes over the file's beginning.
    Write,
}

impl Operation {
    /// Both operations.
    pub(super) const ALL: [Self; 2] = [Self::Read, Self::Write];
}

impl fmt::Display for Operation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Read => "read",
            Self::Write => "write",
        })
    }
}

/// pread and pwrite, by the client itself.
pub(super) const NATIVE: &str = "pread, pwrite";
/// A word to the other core and one back, and nothing else.
pub(super) const RAW: &str = "raw exchange of two cache lines";
/// Nothing else than a message.
pub(super) const ROUND_TRIP: &str = "a message with a reply, without any file";
/// The calls of condor-fs that do not copy.
pub(super) const OURS: &str = "condor-fs, no copy";

/// The names of all ways in the tables.
pub(super) const WAYS: [&str; 7] = [
    NATIVE,
    "  the same once more (control)",
    RAW,
    ROUND_TRIP,
    OURS,
    "Unix socket, 9P's shape",
    "200-byte chunks, rpmsgfs's shape",
];

/// The client's end of a way.
pub(super) trait Client {
    /// Does it once, with the first `len` bytes.
    fn call(&mut self, operation: Operation, len: usize) -> Result<()>;

    /// Puts bytes where writes come from and reads go to.
    fn fill(&mut self, bytes: &[u8]) -> Result<()>;

    /// Copies the bytes of the buffer into `into`.
    fn held(&self, into: &mut [u8]) -> Result<()>;
}

/// Checks that a call moved all bytes.
fn all(moved: usize, len: usize) -> Result<()> {
    if moved == len {
        Ok(())
    } else {
        Err(format!("{moved} bytes of {len} were moved").into())
    }
}

/// A way to move bytes of the client's own memory: a function that says how many it has moved.
pub(super) struct Owning<F> {
    pub(super) transfer: F,
    pub(super) data: Vec<u8>,
}

impl<F: FnMut(Operation, &mut [u8]) -> Result<usize>> Client for Owning<F> {
    fn call(&mut self, operation: Operation, len: usize) -> Result<()> {
        all((self.transfer)(operation, &mut self.data[..len])?, len)
    }

    fn fill(&mut self, bytes: &[u8]) -> Result<()> {
        self.data[..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }

    fn held(&self, into: &mut [u8]) -> Result<()> {
        into.copy_from_slice(&self.data[..into.len()]);
        Ok(())
    }
}

/// The calls of condor-fs that do not copy.
pub(super) struct Lending<'f, 's, S: Messenger> {
    pub(super) file: File<'f, 's, S, LinuxWindow, 1>,
    pub(super) buffer: Option<Buffer<LinuxWindow>>,
}

impl<S: Messenger> Lending<'_, '_, S> {
    fn memory(&self) -> Result<&Buffer<LinuxWindow>> {
        Ok(self.buffer.as_ref().ok_or("the buffer is in doubt")?)
    }
}

impl<S: Messenger> Client for Lending<'_, '_, S> {
    fn call(&mut self, operation: Operation, len: usize) -> Result<()> {
        let buffer = self.buffer.take().ok_or("the buffer is in doubt")?;
        let file = &mut self.file;
        file.seek(SeekFrom::Start(0))?;
        let lent = match operation {
            Operation::Read => file.read_buffer(buffer, len as u32),
            Operation::Write => file.write_buffer(buffer, len as u32),
        };
        let (moved, buffer) = lent.map_err(|kept| kept.error)?;
        self.buffer = Some(buffer);
        all(moved, len)
    }

    fn fill(&mut self, bytes: &[u8]) -> Result<()> {
        Ok(self.memory()?.memory().write(0, bytes)?)
    }

    fn held(&self, into: &mut [u8]) -> Result<()> {
        Ok(self.memory()?.memory().read(0, into)?)
    }
}
