//! [`Output`]: one writer for all contexts of a program.

use core::fmt;

use embedded_io::{ErrorKind, ErrorType, Write};

use super::claim::Claim;
use super::ring::Ring;
use super::write::Buffering;

/// Bytes that are written with one claim of the writer.
const WRITTEN_AT_ONCE: usize = 64;

/// Why an output did not write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OutputError {
    /// It was not opened, or none is set.
    #[error("there is no output")]
    NotOpen,
    /// The context that this one interrupts, or another thread, is writing: it goes on with what
    /// is held.
    #[error("the output is in use")]
    InUse,
    /// The writer failed; what is held stays.
    #[error("the output fails: {0}")]
    Writer(ErrorKind),
}

impl embedded_io::Error for OutputError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NotOpen => ErrorKind::NotConnected,
            Self::InUse => ErrorKind::Other,
            Self::Writer(kind) => *kind,
        }
    }
}

/// An output that all contexts share, whatever its writer is; [`Output`] is the implementation.
///
/// What happens in which context is told in the [module](super).
pub trait StandardOutput: Sync {
    /// Writes text; may wait as long as the writer does, once. What cannot be written is counted
    /// as lost.
    fn print(&self, text: fmt::Arguments<'_>);

    /// Leaves text to be written later; never waits. What finds no room is counted as lost.
    fn post(&self, text: fmt::Arguments<'_>);

    /// Takes at least one byte of `from` if it is not empty, or fails: so nothing is lost.
    ///
    /// # Errors
    /// [`OutputError`], when there is no room and none can be made.
    fn write(&self, from: &[u8]) -> Result<usize, OutputError>;

    /// Writes all that is held, and flushes the writer.
    ///
    /// # Errors
    /// [`OutputError`].
    fn flush(&self) -> Result<(), OutputError>;

    /// Bytes that are still to be written.
    fn held(&self) -> usize;

    /// Bytes that were printed or posted, and lost; the count wraps.
    fn lost(&self) -> u32;
}

/// A writer in a `static` for all contexts of a program, behind a ring of `N` bytes.
pub struct Output<W, const N: usize> {
    ring: Ring<N>,
    writer: Claim<Option<W>>,
    buffering: Buffering,
}

impl<W: Write, const N: usize> Output<W, N> {
    /// An output that has no writer yet; what is printed is held.
    #[must_use]
    pub const fn new(buffering: Buffering) -> Self {
        const { assert!(N > 0, "what is printed needs some room") };
        Self {
            ring: Ring::new(),
            writer: Claim::new(None),
            buffering,
        }
    }

    /// Gives it its writer, for good.
    ///
    /// # Errors
    /// The writer, if it has one.
    pub fn open(&self, writer: W) -> Result<(), W> {
        match self.writer.claim() {
            Some(mut place) if place.is_none() => {
                *place = Some(writer);
                Ok(())
            }
            _ => Err(writer),
        }
    }

    /// Writes some of what is held.
    fn write_some(&self) -> Result<(), OutputError> {
        let mut place = self.writer.claim().ok_or(OutputError::InUse)?;
        let writer = place.as_mut().ok_or(OutputError::NotOpen)?;
        let mut bytes = [0; WRITTEN_AT_ONCE];
        let peeked = self.ring.peek(&mut bytes);
        let bytes = bytes.get(..peeked).unwrap_or_default();
        if bytes.is_empty() {
            return Ok(());
        }
        let written = writer.write(bytes).map_err(failed)?.min(peeked);
        // They leave the ring once they are written: an error loses nothing.
        self.ring.consume(written);
        if written == 0 {
            return Err(OutputError::Writer(ErrorKind::WriteZero));
        }
        Ok(())
    }

    /// Writes all that is held, and what is printed by others meanwhile.
    fn drain(&self) -> Result<(), OutputError> {
        // Who interrupts between the last claim and the last look finds the writer free.
        while self.ring.held() != 0 {
            self.write_some()?;
        }
        Ok(())
    }
}

#[allow(clippy::needless_pass_by_value)]
fn failed(error: impl embedded_io::Error) -> OutputError {
    OutputError::Writer(error.kind())
}

impl<W: Write + Send, const N: usize> StandardOutput for Output<W, N> {
    fn print(&self, text: fmt::Arguments<'_>) {
        let mut print = Print {
            output: self,
            may_wait: true,
            line: false,
        };
        // What is in front of a value whose formatting fails is out.
        let _ = fmt::write(&mut print, text);
        let leaves = match self.buffering {
            Buffering::None => true,
            Buffering::Line => print.line,
            Buffering::Block => false,
        };
        if leaves && print.may_wait {
            // What is not written now stays held, for the next print or flush.
            let _ = self.drain();
        }
    }

    fn post(&self, text: fmt::Arguments<'_>) {
        let _ = fmt::write(&mut Post(&self.ring), text);
    }

    fn write(&self, from: &[u8]) -> Result<usize, OutputError> {
        if from.is_empty() {
            return Ok(0);
        }
        let taken = loop {
            match self.ring.push(from) {
                0 => self.write_some()?,
                taken => break taken,
            }
        };
        let leaves = match self.buffering {
            Buffering::None => true,
            Buffering::Line => from.get(..taken).unwrap_or_default().contains(&b'\n'),
            Buffering::Block => false,
        };
        if leaves {
            let _ = self.drain();
        }
        Ok(taken)
    }

    fn flush(&self) -> Result<(), OutputError> {
        self.drain()?;
        let mut place = self.writer.claim().ok_or(OutputError::InUse)?;
        let writer = place.as_mut().ok_or(OutputError::NotOpen)?;
        writer.flush().map_err(failed)
    }

    fn held(&self) -> usize {
        self.ring.held()
    }

    fn lost(&self) -> u32 {
        self.ring.lost()
    }
}

impl<W, const N: usize> ErrorType for &Output<W, N> {
    type Error = OutputError;
}

impl<W: Write + Send, const N: usize> Write for &Output<W, N> {
    fn write(&mut self, from: &[u8]) -> Result<usize, OutputError> {
        StandardOutput::write(*self, from)
    }

    fn flush(&mut self) -> Result<(), OutputError> {
        StandardOutput::flush(*self)
    }
}

/// One print.
struct Print<'o, W, const N: usize> {
    output: &'o Output<W, N>,
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

/// One post.
struct Post<'o, const N: usize>(&'o Ring<N>);

impl<const N: usize> fmt::Write for Post<'_, N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.push_or_lose(text.as_bytes());
        Ok(())
    }
}
