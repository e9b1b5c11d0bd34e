//! [`TerminalLog`]: a terminal's output with the time of each line.

use std::io::{self, Write};
use std::time::Duration;

use super::sink::{Piece, Sink};

/// A [`Sink`] around another sink that also writes a log. The log has the output that the other
/// sink takes, and before each line the time at which the first byte of the line came.
///
/// The time comes from a clock of your choice, for example one that counts from the epoch or from
/// the start of the program. It is printed in seconds with six decimals. Carriage returns before
/// newlines are left out. If the log cannot be written, no more output is taken.
///
/// ```
/// use std::time::Duration;
/// use condor_tty::linux::{TerminalLog, Sink};
///
/// let mut log = TerminalLog::new((), Vec::new(), || Duration::from_millis(12_500));
/// log.take(b"ready\r\n> ".into())?;
/// assert_eq!(log.into_inner()?.1, b"12.500000 ready\n12.500000 > ");
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct TerminalLog<S, T, C> {
    /// The sink that takes the output.
    pub sink: S,
    to: T,
    clock: C,
    /// The bytes that have been taken, and could not be written yet.
    pending: Vec<u8>,
    in_line: bool,
    /// A carriage return that may belong to a newline.
    returned: bool,
}

impl<S: Sink, T: Write, C: FnMut() -> Duration> TerminalLog<S, T, C> {
    /// Makes a sink that passes output on to `sink` and writes the log to `to`, such as a file.
    /// `clock` returns the present time.
    pub const fn new(sink: S, to: T, clock: C) -> Self {
        Self {
            sink,
            to,
            clock,
            pending: Vec::new(),
            in_line: false,
            returned: false,
        }
    }

    /// Writes what has not been written to the log yet, and returns the sink and the log's writer.
    ///
    /// # Errors
    /// Returns the writer's error if it fails.
    pub fn into_inner(mut self) -> io::Result<(S, T)> {
        self.write_pending()?;
        Ok((self.sink, self.to))
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

impl<S: Sink, T: Write, C: FnMut() -> Duration> Sink for TerminalLog<S, T, C> {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        self.write_pending()?;
        let taken = self.sink.take(piece)?;
        if piece.overwritten > 0 {
            let line = if self.in_line { "\n" } else { "" };
            let note = format!("{line}[{} bytes overwritten]\n", piece.overwritten);
            note.bytes().for_each(|byte| self.put(byte));
        }
        for byte in piece.bytes.iter().take(taken) {
            self.compose(*byte);
        }
        // Bytes that cannot be written now have been taken, and go first next time.
        let _ = self.write_pending();
        Ok(taken)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.sink.typed(into)
    }

    fn typing(&mut self, incarnation: u32, taken: u32, waiting: usize) -> io::Result<()> {
        self.sink.typing(incarnation, taken, waiting)
    }
}
