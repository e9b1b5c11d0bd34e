//! [`BufferedOutput`]: one writer for all contexts of a program.

use core::fmt;

use embedded_io::{ErrorKind, ErrorType, Write};

use super::claim::ClaimCell;
use super::error::StdioError;
use super::ring::Ring;
use super::write::Buffering;

/// Bytes that are written with one claim of the writer.
const WRITTEN_AT_ONCE: usize = 64;

/// A standard output that all contexts of a program share. [`BufferedOutput`] implements it for any
/// writer.
///
/// The [module](super) describes the effects in each context. For code that is generic over
/// [`Write`], a reference to a standard output is a writer.
pub trait StandardOutput: Sync {
    /// Writes text; may wait once, for as long as the writer does. Bytes that cannot be written are
    /// counted as [lost](Self::lost).
    fn print(&self, text: fmt::Arguments<'_>);

    /// Puts text into the ring for a later write; never waits. Bytes without room are counted as
    /// [lost](Self::lost).
    fn post(&self, text: fmt::Arguments<'_>);

    /// Takes at least one byte of `from` if it is not empty, and returns the number of bytes taken.
    /// Bytes that were not taken are left to the caller, so nothing is lost.
    ///
    /// # Errors
    /// [`StdioError`] if there is no room and none can be made.
    fn write(&self, from: &[u8]) -> Result<usize, StdioError>;

    /// Writes all bytes in the ring, and flushes the writer.
    ///
    /// # Errors
    /// [`StdioError`] if there is no writer, another context uses it, or it fails.
    fn flush(&self) -> Result<(), StdioError>;

    /// Returns the number of bytes in the ring that are still to be written.
    fn held(&self) -> usize;

    /// Returns the number of printed or posted bytes that were lost; wraps.
    fn lost(&self) -> u32;
}

/// A buffered writer in a `static`, which all contexts of a program share. `N` is the size of its
/// ring, which buffers the text, in bytes. [`set_output`](super::set_output) makes it the program's
/// standard output.
pub struct BufferedOutput<W, const N: usize> {
    ring: Ring<N>,
    writer: ClaimCell<Option<W>>,
    buffering: Buffering,
}

impl<W: Write, const N: usize> BufferedOutput<W, N> {
    /// Makes an output without a writer. Printed text stays in the ring until [`open`](Self::open)
    /// sets a writer.
    #[must_use]
    pub const fn new(buffering: Buffering) -> Self {
        const { assert!(N > 0, "what is printed needs some room") };
        Self {
            ring: Ring::new(),
            writer: ClaimCell::new(None),
            buffering,
        }
    }

    /// Sets the writer to which the output writes. It cannot be changed afterwards.
    ///
    /// # Errors
    /// Returns `writer` if the output has one already, or if another context is using it.
    pub fn open(&self, writer: W) -> Result<(), W> {
        match self.writer.claim() {
            Some(mut place) if place.is_none() => {
                *place = Some(writer);
                Ok(())
            }
            _ => Err(writer),
        }
    }

    const fn text(&self, may_wait: bool) -> Print<'_, W, N> {
        Print {
            output: self,
            may_wait,
            line: false,
        }
    }

    /// Writes some of what is held.
    fn write_some(&self) -> Result<(), StdioError> {
        let mut place = self.writer.claim().ok_or(StdioError::InUse)?;
        let writer = place.as_mut().ok_or(StdioError::NotOpen)?;
        let mut bytes = [0; WRITTEN_AT_ONCE];
        let peeked = self.ring.peek(&mut bytes);
        let bytes = bytes.get(..peeked).unwrap_or_default();
        if bytes.is_empty() {
            return Ok(());
        }
        let written = writer.write(bytes).map_err(failed)?.min(peeked);
        // The bytes leave the ring once they are written: an error loses nothing.
        self.ring.consume(written);
        if written == 0 {
            return Err(StdioError::Failed(ErrorKind::WriteZero));
        }
        Ok(())
    }

    /// Writes all that is held, and what is printed by others meanwhile.
    fn drain(&self) -> Result<(), StdioError> {
        // A context that interrupts between the last claim and the last look finds the writer free.
        while self.ring.held() != 0 {
            self.write_some()?;
        }
        Ok(())
    }
}

#[allow(clippy::needless_pass_by_value)]
fn failed(error: impl embedded_io::Error) -> StdioError {
    StdioError::Failed(error.kind())
}

impl<W: Write + Send, const N: usize> StandardOutput for BufferedOutput<W, N> {
    fn print(&self, text: fmt::Arguments<'_>) {
        let mut print = self.text(true);
        // The text in front of a value whose formatting fails is out.
        let _ = fmt::write(&mut print, text);
        if self.buffering.leaves(print.line) && print.may_wait {
            // Text that is not written now stays held, for the next print or flush.
            let _ = self.drain();
        }
    }

    fn post(&self, text: fmt::Arguments<'_>) {
        let _ = fmt::write(&mut self.text(false), text);
    }

    fn write(&self, from: &[u8]) -> Result<usize, StdioError> {
        if from.is_empty() {
            return Ok(0);
        }
        let taken = loop {
            match self.ring.push(from) {
                0 => self.write_some()?,
                taken => break taken,
            }
        };
        let written = from.get(..taken).unwrap_or_default();
        if self.buffering.leaves(written.contains(&b'\n')) {
            let _ = self.drain();
        }
        Ok(taken)
    }

    fn flush(&self) -> Result<(), StdioError> {
        self.drain()?;
        let mut place = self.writer.claim().ok_or(StdioError::InUse)?;
        let writer = place.as_mut().ok_or(StdioError::NotOpen)?;
        writer.flush().map_err(failed)
    }

    fn held(&self) -> usize {
        self.ring.held()
    }

    fn lost(&self) -> u32 {
        self.ring.lost()
    }
}

impl ErrorType for &dyn StandardOutput {
    type Error = StdioError;
}

impl Write for &dyn StandardOutput {
    fn write(&mut self, from: &[u8]) -> Result<usize, StdioError> {
        StandardOutput::write(*self, from)
    }

    fn flush(&mut self) -> Result<(), StdioError> {
        StandardOutput::flush(*self)
    }
}

/// One print, or post.
struct Print<'o, W, const N: usize> {
    output: &'o BufferedOutput<W, N>,
    /// Not after the writer has failed once: a deadline for each piece would be a long time.
    may_wait: bool,
    /// Whether there was a newline.
    line: bool,
}

impl<W: Write, const N: usize> fmt::Write for Print<'_, W, N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut rest = text.as_bytes();
        self.line |= rest.contains(&b'\n');
        while self.may_wait && !rest.is_empty() {
            let pushed = self.output.ring.push(rest);
            rest = rest.get(pushed..).unwrap_or_default();
            if !rest.is_empty() && self.output.write_some().is_err() {
                self.may_wait = false;
            }
        }
        self.output.ring.push_or_lose(rest);
        Ok(())
    }
}
