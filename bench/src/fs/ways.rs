//! [`Way`]s to read and write a file, and the client's end of each.

use std::cell::RefCell;
use std::fmt;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::os::unix::net::UnixStream;

use condor_fs::Buffer;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Messenger, Region};
use embedded_io::{Read, Seek, SeekFrom, Write};

use super::serving::{ECHO, Mail, SERVER, TIMEOUT};
use super::{chunks, socket};
use crate::Result;

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operation {
    /// Of the file's beginning.
    Read,
    /// Over the file's beginning.
    Write,
}

impl Operation {
    /// Both.
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

/// A way to do it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    /// pread and pwrite, by the client itself.
    Native,
    /// The same.
    Control,
    /// A message with a reply, and nothing else.
    RoundTrip,
    /// The calls of condor-fs that do not copy.
    Ours,
    /// The same with a server that sleeps between requests.
    OursSleeping,
    /// Those of embedded-io.
    OursCopied,
    /// See [`socket`].
    Socket,
    /// See [`chunks`].
    Chunked,
}

impl Way {
    /// All of them.
    pub(super) const ALL: [Self; 8] = [
        Self::Native,
        Self::Control,
        Self::RoundTrip,
        Self::Ours,
        Self::OursSleeping,
        Self::OursCopied,
        Self::Socket,
        Self::Chunked,
    ];

    /// What the table calls it.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Native => "pread, pwrite",
            Self::Control => "  the same once more (control)",
            Self::RoundTrip => "a message with a reply, without any file",
            Self::Ours => "condor-fs, no copy, server spins",
            Self::OursSleeping => "condor-fs, no copy, server sleeps",
            Self::OursCopied => "condor-fs, embedded-io (one copy), spins",
            Self::Socket => "Unix socket, 9P's shape",
            Self::Chunked => "200-byte chunks, rpmsgfs's shape",
        }
    }
}

/// The client's end of a way.
pub(super) trait Client {
    /// Does it once, with the first `len` bytes.
    fn call(&mut self, operation: Operation, len: usize) -> Result<()>;

    /// Puts bytes where writes come from and reads go to; `false` if there are none.
    fn fill(&mut self, bytes: &[u8]) -> Result<bool>;

    /// What is there.
    fn held(&self, into: &mut [u8]) -> Result<()>;
}

/// That a call moved what it should.
fn all(moved: usize, len: usize) -> Result<()> {
    if moved == len {
        Ok(())
    } else {
        Err(format!("{moved} bytes of {len} were moved").into())
    }
}

/// A way to move bytes of a process's own memory.
pub(super) trait Transfer {
    /// Does it once, with all of `data`.
    fn transfer(&mut self, operation: Operation, data: &mut [u8]) -> Result<()>;
}

/// A way, and the memory that it moves from and to.
pub(super) struct Owning<T> {
    pub(super) way: T,
    pub(super) data: Vec<u8>,
}

impl<T: Transfer> Client for Owning<T> {
    fn call(&mut self, operation: Operation, len: usize) -> Result<()> {
        self.way.transfer(operation, &mut self.data[..len])
    }

    fn fill(&mut self, bytes: &[u8]) -> Result<bool> {
        self.data[..bytes.len()].copy_from_slice(bytes);
        Ok(true)
    }

    fn held(&self, into: &mut [u8]) -> Result<()> {
        into.copy_from_slice(&self.data[..into.len()]);
        Ok(())
    }
}

/// pread and pwrite.
pub(super) struct Native<'c> {
    pub(super) file: &'c File,
}

impl Transfer for Native<'_> {
    fn transfer(&mut self, operation: Operation, data: &mut [u8]) -> Result<()> {
        let moved = match operation {
            Operation::Read => self.file.read_at(data, 0)?,
            Operation::Write => self.file.write_at(data, 0)?,
        };
        all(moved, data.len())
    }
}

/// A message.
pub(super) struct RoundTrip<'c> {
    pub(super) mailbox: &'c Mail<'c>,
}

impl Client for RoundTrip<'_> {
    fn call(&mut self, _: Operation, len: usize) -> Result<()> {
        let answer = self
            .mailbox
            .send_with_reply(SERVER, ECHO, len as u32, TIMEOUT)?;
        all(answer as usize, len)
    }

    fn fill(&mut self, _: &[u8]) -> Result<bool> {
        Ok(false)
    }

    fn held(&self, _: &mut [u8]) -> Result<()> {
        Ok(())
    }
}

/// A file of condor-fs that lends a buffer.
pub(super) trait Lender {
    /// Moves the first bytes of the buffer from or to the file's beginning.
    fn lend(
        &mut self,
        operation: Operation,
        buffer: Buffer<LinuxWindow>,
        len: u32,
    ) -> Result<(usize, Buffer<LinuxWindow>)>;
}

/// The calls that do not copy.
pub(super) struct Lending<'c, F> {
    pub(super) file: &'c RefCell<F>,
    pub(super) buffer: Option<Buffer<LinuxWindow>>,
}

impl<F: Lender> Client for Lending<'_, F> {
    fn call(&mut self, operation: Operation, len: usize) -> Result<()> {
        let buffer = self.buffer.take().ok_or("the buffer is in doubt")?;
        let mut file = self.file.borrow_mut();
        let (moved, buffer) = file.lend(operation, buffer, len as u32)?;
        self.buffer = Some(buffer);
        all(moved, len)
    }

    fn fill(&mut self, bytes: &[u8]) -> Result<bool> {
        let buffer = self.buffer.as_ref().ok_or("the buffer is in doubt")?;
        buffer.memory().write(0, bytes)?;
        Ok(true)
    }

    fn held(&self, into: &mut [u8]) -> Result<()> {
        let buffer = self.buffer.as_ref().ok_or("the buffer is in doubt")?;
        Ok(buffer.memory().read(0, into)?)
    }
}

/// The calls of embedded-io.
pub(super) struct Copying<'c, F> {
    pub(super) file: &'c RefCell<F>,
}

impl<F> Transfer for Copying<'_, F>
where
    F: Read + Write + Seek,
    F::Error: 'static,
{
    fn transfer(&mut self, operation: Operation, data: &mut [u8]) -> Result<()> {
        let mut file = self.file.borrow_mut();
        file.seek(SeekFrom::Start(0))?;
        let moved = match operation {
            Operation::Read => file.read(data)?,
            Operation::Write => file.write(data)?,
        };
        all(moved, data.len())
    }
}

/// The protocol of [`socket`].
pub(super) struct Socket<'c> {
    pub(super) stream: &'c UnixStream,
}

impl Transfer for Socket<'_> {
    fn transfer(&mut self, operation: Operation, data: &mut [u8]) -> Result<()> {
        socket::transfer(self.stream, operation, data)
    }
}

/// The protocol of [`chunks`].
pub(super) struct Chunked<'c> {
    pub(super) mailbox: &'c Mail<'c>,
    pub(super) own: &'c Region<LinuxWindow>,
    pub(super) block: u32,
}

impl Transfer for Chunked<'_> {
    fn transfer(&mut self, operation: Operation, data: &mut [u8]) -> Result<()> {
        chunks::transfer(self.mailbox, self.own, self.block, operation, data)
    }
}
