//! [`BufWriter`]: a buffered writer.

use core::fmt::Debug;

use embedded_io::{ErrorKind, ErrorType, Write, WriteReady};

/// The time at which a buffered writer passes on the bytes in its buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Buffering {
    /// At once.
    None,
    /// At every newline, and when the buffer is full.
    #[default]
    Line,
    /// When the buffer is full.
    Block,
}

impl Buffering {
    /// Returns true if the written text leaves the buffer before it is full; `line` is whether there is a newline
    /// in it.
    pub(super) const fn leaves(self, line: bool) -> bool {
        match self {
            Self::None => true,
            Self::Line => line,
            Self::Block => false,
        }
    }
}

/// The reason why a call of a [`BufWriter`] failed. Bytes of earlier calls are still
/// [held](BufWriter::held); none of the failing call's bytes were taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WriteError<E> {
    /// The writer failed.
    #[error("{0}")]
    Writer(E),
    /// The writer took nothing and returned no error, which `embedded-io` forbids.
    #[error("the writer accepted no byte")]
    Zero,
}

impl<E: embedded_io::Error> embedded_io::Error for WriteError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Writer(error) => error.kind(),
            Self::Zero => ErrorKind::WriteZero,
        }
    }
}

/// A buffered writer: it collects bytes, and writes them to `W` in pieces of up to `N` bytes.
/// [`Buffering`] decides when.
///
/// Nothing is lost on an error. A call that fails has taken nothing; bytes of earlier calls that
/// `W` has not taken stay in the buffer, in order, until a later call writes them. A call that has
/// taken the end of a line, but cannot pass the line on, succeeds; the next call first tries again,
/// and returns the error if that fails.
///
/// Dropping the writer drops the bytes that it [holds](Self::held), since writing could fail or
/// wait; so flush before.
#[derive(Debug)]
pub struct BufWriter<W, const N: usize> {
    writer: W,
    buffer: [u8; N],
    held: usize,
    /// Bytes that it holds at most.
    limit: usize,
    /// Up to where [`put`](Self::put) fills the buffer by itself: not at all if a line is owed.
    quick: usize,
    /// The byte that `put` does not take by itself, or none.
    newline: u16,
}

const NO_BYTE: u16 = 0x100;

impl<W, const N: usize> BufWriter<W, N> {
    /// Makes a buffered writer over `writer`, with an empty buffer.
    #[must_use]
    pub const fn new(writer: W, buffering: Buffering) -> Self {
        let (limit, newline) = match buffering {
            Buffering::None => (0, NO_BYTE),
            Buffering::Line => (N, b'\n' as u16),
            Buffering::Block => (N, NO_BYTE),
        };
        Self {
            writer,
            buffer: [0; N],
            held: 0,
            limit,
            quick: limit,
            newline,
        }
    }

    /// Returns the bytes that callers wrote and that were not yet passed on to the writer behind
    /// the buffer.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.buffer.get(..self.held).unwrap_or_default()
    }

    /// Returns the writer that this buffered writer writes to.
    #[must_use]
    pub const fn writer(&self) -> &W {
        &self.writer
    }
}

impl<W: Write, const N: usize> BufWriter<W, N> {
    /// Writes one byte, like `putc` of C. It usually only goes into the buffer.
    ///
    /// # Errors
    /// [`WriteError`] if the buffer had to be written first and the writer failed or took nothing;
    /// the byte is not taken then.
    #[inline]
    pub fn put(&mut self, byte: u8) -> Result<(), WriteError<W::Error>> {
        if self.held < self.quick
            && u16::from(byte) != self.newline
            && let Some(place) = self.buffer.get_mut(self.held)
        {
            *place = byte;
            self.held += 1;
            return Ok(());
        }
        self.put_slowly(byte)
    }

    #[cold]
    #[inline(never)]
    fn put_slowly(&mut self, byte: u8) -> Result<(), WriteError<W::Error>> {
        self.write(&[byte]).map(|_| ())
    }

    /// Passes on all that is held.
    fn drain(&mut self) -> Result<(), WriteError<W::Error>> {
        let mut written = 0;
        let error = loop {
            let rest = self.buffer.get(written..self.held).unwrap_or_default();
            if rest.is_empty() {
                self.held = 0;
                self.quick = self.limit;
                return Ok(());
            }
            match write_some(&mut self.writer, rest) {
                Ok(some) => written += some,
                Err(error) => break error,
            }
        };
        // The remaining bytes move to the front.
        for at in written..self.held {
            let byte = self.buffer.get(at).copied().unwrap_or_default();
            if let Some(place) = self.buffer.get_mut(at - written) {
                *place = byte;
            }
        }
        self.held -= written;
        Err(error)
    }
}

/// Writes at least one byte of `from`, which is not empty.
#[inline]
fn write_some<W: Write>(writer: &mut W, from: &[u8]) -> Result<usize, WriteError<W::Error>> {
    match writer.write(from) {
        Ok(0) => Err(WriteError::Zero),
        Ok(some) => Ok(some.min(from.len())),
        Err(error) => Err(WriteError::Writer(error)),
    }
}

impl<W: ErrorType, const N: usize> ErrorType for BufWriter<W, N> {
    type Error = WriteError<W::Error>;
}

impl<W: Write, const N: usize> Write for BufWriter<W, N> {
    fn write(&mut self, from: &[u8]) -> Result<usize, Self::Error> {
        if from.is_empty() {
            return Ok(0);
        }
        let owes_a_line = self.quick < self.limit;
        if owes_a_line || from.len() > self.limit.saturating_sub(self.held) {
            self.drain()?;
        }
        if from.len() >= self.limit {
            return write_some(&mut self.writer, from);
        }
        for (place, byte) in self.buffer.iter_mut().skip(self.held).zip(from) {
            *place = *byte;
        }
        self.held += from.len();
        if from.iter().any(|&byte| u16::from(byte) == self.newline) {
            self.quick = 0;
            // All of `from` is taken: whatever goes wrong, the next call meets again.
            let _ = self.drain();
        }
        Ok(from.len())
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        self.drain()?;
        self.writer.flush().map_err(WriteError::Writer)
    }
}

impl<W: Write + WriteReady, const N: usize> WriteReady for BufWriter<W, N> {
    fn write_ready(&mut self) -> Result<bool, Self::Error> {
        if self.held < self.quick {
            return Ok(true);
        }
        self.writer.write_ready().map_err(WriteError::Writer)
    }
}
