//! [`Stream`]: a connection of GDB.

use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::time::Duration;

use gdbstub::conn::{Connection, ConnectionExt};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;

/// Bytes that are read or written at once.
const CHUNK: usize = 1 << 16;
/// How long GDB may take to accept what it has asked for.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes with which a packet or an acknowledgement begins, or an interrupt.
const BEGINNINGS: [u8; 4] = [b'$', b'+', b'-', 3];

/// A connection, with a buffer for each direction.
#[derive(Debug)]
pub struct Stream {
    file: std::fs::File,
    read: Vec<u8>,
    at: usize,
    written: Vec<u8>,
}

impl Stream {
    /// Makes the stream of a connected socket.
    ///
    /// # Errors
    /// [`io::Error`] if the socket cannot be set up.
    pub fn new(socket: impl Into<OwnedFd>) -> io::Result<Self> {
        let socket: OwnedFd = socket.into();
        // Packets are small, and each waits for the one before. A Unix socket has no such option.
        let tcp = TcpStream::from(socket);
        let _ = tcp.set_nodelay(true);
        let socket = OwnedFd::from(tcp);
        rustix::net::sockopt::set_socket_timeout(
            &socket,
            rustix::net::sockopt::Timeout::Send,
            Some(PATIENCE),
        )?;
        Ok(Self {
            file: socket.into(),
            read: Vec::new(),
            at: 0,
            written: Vec::new(),
        })
    }

    /// Returns whether the first byte, for which it waits until `limit`, is one of GDB's: a connection
    /// that begins like HTTP is not GDB's.
    ///
    /// # Errors
    /// [`io::Error`] if the connection fails.
    pub fn begins(&mut self, limit: Duration) -> io::Result<bool> {
        if self.at == self.read.len() && self.is_readable(limit)? {
            self.fill()?;
        }
        let first = self.read.get(self.at);
        Ok(first.is_some_and(|first| BEGINNINGS.contains(first)))
    }

    /// Waits for bytes until `limit`.
    pub(crate) fn is_readable(&self, limit: Duration) -> io::Result<bool> {
        if self.at < self.read.len() {
            return Ok(true);
        }
        let limit = Timespec::try_from(limit).unwrap_or_default();
        let mut polled = [PollFd::new(&self.file, PollFlags::IN)];
        match rustix::event::poll(&mut polled, Some(&limit)) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    fn fill(&mut self) -> io::Result<()> {
        self.read.resize(CHUNK, 0);
        self.at = 0;
        let read = self.file.read(&mut self.read);
        self.read.truncate(*read.as_ref().unwrap_or(&0));
        match read? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            _ => Ok(()),
        }
    }
}

impl AsFd for Stream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl Connection for Stream {
    type Error = io::Error;

    fn write(&mut self, byte: u8) -> io::Result<()> {
        self.written.push(byte);
        Ok(())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.written.extend_from_slice(bytes);
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        let written = self.file.write_all(&self.written);
        self.written.clear();
        written
    }
}

impl ConnectionExt for Stream {
    fn read(&mut self) -> io::Result<u8> {
        loop {
            if let Some(byte) = self.read.get(self.at) {
                self.at += 1;
                return Ok(*byte);
            }
            match self.fill() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                other => other?,
            }
        }
    }

    fn peek(&mut self) -> io::Result<Option<u8>> {
        if self.at == self.read.len() && self.is_readable(Duration::ZERO)? {
            self.fill()?;
        }
        Ok(self.read.get(self.at).copied())
    }
}
