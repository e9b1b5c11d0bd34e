//! [`BufWriter`]: a buffered writer.

use embedded_io::{Error, ErrorKind, ErrorType, Write};

use super::to_front;

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

/// The reason why a call of a [`BufWriter`] failed. Bytes of earlier calls are still [held](BufWriter::held).
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WriteError<E> {
    /// The writer failed.
    #[error("{0}")]
    Writer(E),
    /// The writer took nothing and returned no error, which `embedded-io` forbids.
    #[error("the writer accepted no byte")]
    Zero,
}

impl<E: Error> Error for WriteError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Writer(error) => error.kind(),
            Self::Zero => ErrorKind::WriteZero,
        }
    }
}

/// A buffered writer: it collects bytes, and writes them to `W` in pieces of up to `N` bytes. [`Buffering`] decides
/// when.
///
/// Nothing is lost on an error. A call of `write` that fails has taken nothing. Bytes that were taken and that `W` has
/// not accepted stay in the buffer, in order, until a later call writes them. A call that has taken bytes, but cannot
/// pass them on, succeeds; the next call first tries again, and returns the error if that fails. So `W` is always
/// offered the same bytes again, perhaps with more behind them.
///
/// Dropping the writer drops the bytes that it [holds](Self::held), since writing could fail or wait; so flush before.
#[derive(Debug)]
pub struct BufWriter<W, const N: usize> {
    writer: W,
    buffer: [u8; N],
    held: usize,
    buffering: Buffering,
    /// True if the held bytes must be passed on before others are taken.
    owes: bool,
}

impl<W, const N: usize> BufWriter<W, N> {
    /// Makes a buffered writer over `writer`, with an empty buffer.
    #[must_use]
    pub const fn new(writer: W, buffering: Buffering) -> Self {
        const { assert!(N > 0, "bytes go through the buffer") };
        Self {
            writer,
            buffer: [0; N],
            held: 0,
            buffering,
            owes: false,
        }
    }

    /// Returns the bytes that callers wrote and that were not yet passed on to the writer behind the buffer.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.buffer.get(..self.held).unwrap_or_default()
    }

    /// Returns the writer behind the buffer. Write to it only if nothing is held.
    pub const fn inner_mut(&mut self) -> &mut W {
        &mut self.writer
    }

    /// Drops the buffer with all bytes that are held, and returns the writer.
    pub fn into_inner(self) -> W {
        self.writer
    }
}

impl<W: Write, const N: usize> BufWriter<W, N> {
    /// Passes on all bytes that are held, without flushing the writer behind the buffer.
    ///
    /// # Errors
    /// [`WriteError`] if the writer fails or takes nothing; the rest of the bytes is still held.
    pub fn drain(&mut self) -> Result<(), WriteError<W::Error>> {
        let mut written = 0;
        let outcome = loop {
            let rest = self.buffer.get(written..self.held).unwrap_or_default();
            if rest.is_empty() {
                break Ok(());
            }
            match self.writer.write(rest) {
                Ok(0) => break Err(WriteError::Zero),
                Ok(some) => written += some.min(rest.len()),
                Err(error) => break Err(WriteError::Writer(error)),
            }
        };
        to_front(&mut self.buffer, written, self.held);
        self.held -= written;
        self.owes &= self.held > 0;
        outcome
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
        if self.owes || self.held >= N {
            self.drain()?;
        }
        let (mut taken, mut ends_line) = (0, false);
        for (place, byte) in self.buffer.iter_mut().skip(self.held).zip(from) {
            *place = *byte;
            taken += 1;
            ends_line |= *byte == b'\n';
        }
        self.held += taken;
        self.owes = match self.buffering {
            Buffering::None => true,
            Buffering::Line => ends_line,
            Buffering::Block => false,
        };
        if self.owes {
            // All of it is taken: the next call meets whatever goes wrong.
            let _ = self.drain();
        }
        Ok(taken)
    }

    // The default of `embedded-io`, without its path that panics. After an error, some of `from` may be taken.
    fn write_all(&mut self, from: &[u8]) -> Result<(), Self::Error> {
        let mut rest = from;
        while !rest.is_empty() {
            rest = match self.write(rest)? {
                0 => return Err(WriteError::Zero),
                count => rest.get(count..).unwrap_or_default(),
            };
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        self.drain()?;
        self.writer.flush().map_err(WriteError::Writer)
    }
}
