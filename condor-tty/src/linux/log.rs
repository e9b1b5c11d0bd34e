//! [`Log`]: a terminal's output with the time of each line.

use std::io::{self, Write};
use std::time::Duration;

use super::sink::Sink;

/// Writes a terminal's output, each line with the time at which its first byte came.
///
/// The time is that of the given clock, printed in seconds with six decimals: for example since the
/// epoch, or since the program began. Carriage returns before newlines are left out.
///
/// ```
/// use std::time::Duration;
/// use condor_tty::linux::{Log, Sink};
///
/// let mut log = Log::new(Vec::new(), || Duration::from_millis(12_500));
/// log.take(b"ready\r\n> ")?;
/// assert_eq!(log.into_inner()?, b"12.500000 ready\n12.500000 > ");
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Log<T, C> {
    to: T,
    clock: C,
    /// What has been taken, and could not be written yet.
    pending: Vec<u8>,
    in_line: bool,
    /// A carriage return that may belong to a newline.
    returned: bool,
}

/// Bytes that are taken at once.
const PIECE: usize = 4096;

impl<T: Write, C: FnMut() -> Duration> Log<T, C> {
    /// Makes a log that writes to `to`, such as a file.
    pub const fn new(to: T, clock: C) -> Self {
        Self {
            to,
            clock,
            pending: Vec::new(),
            in_line: false,
            returned: false,
        }
    }

    /// Writes everything, and returns the writer.
    ///
    /// # Errors
    /// The writer's error if it fails.
    pub fn into_inner(mut self) -> io::Result<T> {
        while !self.pending.is_empty() {
            self.write_pending()?;
        }
        Ok(self.to)
    }

    fn write_pending(&mut self) -> io::Result<()> {
        while !self.pending.is_empty() {
            match self.to.write(&self.pending) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => drop(self.pending.drain(..count)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn compose(&mut self, byte: u8) {
        if self.returned && byte != b'\n' {
            self.put(b'\r');
        }
        self.returned = byte == b'\r';
        if !self.returned {
            self.put(byte);
        }
    }

    fn put(&mut self, byte: u8) {
        if !self.in_line {
            let stamp = (self.clock)();
            let text = format!("{}.{:06} ", stamp.as_secs(), stamp.subsec_micros());
            self.pending.extend_from_slice(text.as_bytes());
        }
        self.pending.push(byte);
        self.in_line = byte != b'\n';
    }
}

impl<T: Write, C: FnMut() -> Duration> Sink for Log<T, C> {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut taken = 0;
        for piece in bytes.chunks(PIECE) {
            match self.write_pending() {
                Ok(()) => {}
                Err(error) if taken == 0 && error.kind() != io::ErrorKind::WouldBlock => {
                    return Err(error);
                }
                Err(_) => return Ok(taken),
            }
            for byte in piece {
                self.compose(*byte);
            }
            taken += piece.len();
        }
        // What cannot be written now has been taken, and goes first next time.
        let _ = self.write_pending();
        Ok(taken)
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        if self.in_line {
            self.put(b'\n');
        }
        for byte in format!("[{bytes} bytes overwritten]\n").bytes() {
            self.put(byte);
        }
        Ok(())
    }
}
