//! A viewer of a terminal, which reads the log at its own pace.

use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{RecvFlags, recv};

use super::record::Record;

/// Bytes that are moved at once.
const PIECE: usize = 16 * 1024;

/// A place in the log.
#[derive(Debug)]
pub(super) struct Cursor(pub(super) u64);

impl Cursor {
    /// Passes the bytes that follow to `write`, until that takes no more; returns true if all were
    /// taken.
    pub(super) fn advance(
        &mut self,
        log: &Record,
        mut write: impl FnMut(&[u8]) -> std::io::Result<usize>,
    ) -> std::io::Result<bool> {
        let mut piece = [0; PIECE];
        loop {
            // Output that is not in any log any more has been missed.
            let (offset, count) = log.read_at(&mut piece, self.0)?;
            self.0 = offset;
            if count == 0 {
                return Ok(true);
            }
            let taken = write(piece.get(..count).unwrap_or_default())?;
            self.0 += taken as u64;
            if taken == 0 {
                return Ok(false);
            }
        }
    }
}

/// A connection to the socket.
pub(super) struct Viewer {
    stream: UnixStream,
    cursor: Cursor,
    behind: bool,
    /// The viewer takes no more output; characters that it has typed before must still be read.
    deaf: bool,
    pub(super) gone: bool,
}

impl Viewer {
    /// Begins at a place of the log.
    pub(super) fn new(stream: UnixStream, from: u64) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            cursor: Cursor(from),
            behind: true,
            deaf: false,
            gone: false,
        })
    }

    /// Returns the descriptor and the events to wait for, if any. If there is no room for typed characters, the
    /// end of the stream would wake the service again and again.
    pub(super) fn descriptor(&self, has_room: bool) -> Option<(BorrowedFd<'_>, PollFlags)> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::IN, has_room);
        flags.set(PollFlags::OUT, self.behind);
        (!flags.is_empty()).then(|| (self.stream.as_fd(), flags))
    }

    pub(super) fn show(&mut self, log: &Record) {
        if self.deaf {
            return;
        }
        let stream = &mut self.stream;
        let advanced = self.cursor.advance(log, |bytes| moved(stream.write(bytes)));
        self.behind = advanced.as_ref().is_ok_and(|all| !all);
        self.deaf |= advanced.is_err();
    }

    /// Notes whether the viewer has gone, without taking what it has typed: for the time in which the terminal has no
    /// room for that.
    pub(super) fn look(&mut self) {
        let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT;
        let read = recv(&self.stream, &mut [0], flags).map(|(_, count)| count);
        self.gone |= !matches!(read, Ok(1..) | Err(Errno::AGAIN | Errno::INTR));
    }

    /// Reads the characters that were typed there; returns their number.
    pub(super) fn typed(&mut self, into: &mut [u8]) -> usize {
        let read = match self.stream.read(into) {
            // The connection has ended.
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            read => moved(read),
        };
        self.gone |= read.is_err();
        read.unwrap_or(0)
    }
}

/// The number of bytes; none if it is not possible now.
fn moved(outcome: std::io::Result<usize>) -> std::io::Result<usize> {
    match outcome {
        Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
            Ok(0)
        }
        outcome => outcome,
    }
}
