//! [`BufReader`]: a buffered reader.

use core::str;

use embedded_io::{ErrorType, Read, ReadExactError, Write};

use super::to_front;

/// A buffered reader: it reads from `R` in pieces of up to `N` bytes, and passes the bytes on in pieces of any size, or
/// by lines. Bytes that are written to it go to `R` unchanged.
///
/// An error of `R` is returned unchanged; bytes that were read before it can still be read.
#[derive(Debug)]
pub struct BufReader<R, const N: usize> {
    reader: R,
    buffer: [u8; N],
    begin: usize,
    end: usize,
    /// True if the bytes up to the end of the line belong to a line that was refused.
    skips: bool,
}

/// The reason why [`BufReader::read_line`] returned no line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError<E> {
    /// The reader failed. The beginning of the line is kept, and the next call continues it.
    #[error("{0}")]
    Reader(E),
    /// The line is longer than the caller's memory or the buffer, and is skipped. For a line of more than `N` bytes,
    /// this error can come several times.
    #[error("a line is longer than {room} bytes, and is skipped")]
    TooLong {
        /// The longest line that there is room for, in bytes.
        room: usize,
    },
    /// The line is not UTF-8, and is skipped.
    #[error("a line of {bytes} bytes is not UTF-8, and is skipped")]
    NotUtf8 {
        /// The length of the line in bytes.
        bytes: usize,
    },
}

impl<R, const N: usize> BufReader<R, N> {
    /// Makes a buffered reader over `reader`, with an empty buffer.
    #[must_use]
    pub const fn new(reader: R) -> Self {
        const { assert!(N > 0, "an empty buffer reads as the end of the input") };
        Self {
            reader,
            buffer: [0; N],
            begin: 0,
            end: 0,
            skips: false,
        }
    }

    /// Returns the reader behind the buffer.
    pub const fn inner_mut(&mut self) -> &mut R {
        &mut self.reader
    }

    /// Drops the buffer with all bytes that were not passed on, and returns the reader.
    pub fn into_inner(self) -> R {
        self.reader
    }

    fn held(&self) -> &[u8] {
        self.buffer.get(self.begin..self.end).unwrap_or_default()
    }

    fn consume(&mut self, bytes: usize) {
        self.begin = self.end.min(self.begin.saturating_add(bytes));
    }
}

impl<R: Read, const N: usize> BufReader<R, N> {
    /// Reads a line into `into`, and returns it with the byte that ends it; only the last line of an input may lack
    /// that. Returns an empty text at the end of the input. `ends` returns true for a byte that ends a line.
    ///
    /// # Errors
    /// [`LineError`] if the reader fails, the line is too long, or it is not UTF-8.
    pub fn read_line<'l>(
        &mut self,
        ends: impl Fn(u8) -> bool,
        into: &'l mut [u8],
    ) -> Result<&'l str, LineError<R::Error>> {
        let mut looked = 0;
        loop {
            let end = self.held().iter().skip(looked).position(|&byte| ends(byte));
            let end = end.map(|at| looked + at + 1);
            looked = self.held().len();
            let bytes = match end {
                Some(bytes) => bytes,
                None if looked == N => {
                    self.consume(N);
                    self.skips = true;
                    return Err(LineError::TooLong { room: N });
                }
                None if self.fill().map_err(LineError::Reader)? > 0 => continue,
                None => looked,
            };
            if core::mem::take(&mut self.skips) {
                self.consume(bytes);
                looked = 0;
                continue;
            }
            let room = into.len();
            let Some(line) = into.get_mut(..bytes) else {
                self.consume(bytes);
                return Err(LineError::TooLong { room });
            };
            self.take(line);
            return str::from_utf8(line).map_err(|_| LineError::NotUtf8 { bytes });
        }
    }

    /// Reads more bytes behind those that are held; returns their number, which is 0 at the end of the input.
    fn fill(&mut self) -> Result<usize, R::Error> {
        to_front(&mut self.buffer, self.begin, self.end);
        (self.begin, self.end) = (0, self.held().len());
        let room = self.buffer.get_mut(self.end..).unwrap_or_default();
        let read = self.reader.read(room)?.min(room.len());
        self.end += read;
        Ok(read)
    }

    /// Takes as many bytes as are held and have room; returns their number.
    fn take(&mut self, into: &mut [u8]) -> usize {
        let mut taken = 0;
        for (place, byte) in into.iter_mut().zip(self.held()) {
            *place = *byte;
            taken += 1;
        }
        self.consume(taken);
        taken
    }
}

impl<R: ErrorType, const N: usize> ErrorType for BufReader<R, N> {
    type Error = R::Error;
}

impl<R: Read, const N: usize> Read for BufReader<R, N> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, R::Error> {
        if self.held().is_empty() && !into.is_empty() {
            self.fill()?;
        }
        Ok(self.take(into))
    }

    // The default of `embedded-io`, without its path that panics.
    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<R::Error>> {
        let mut rest = into;
        while !rest.is_empty() {
            rest = match self.read(rest)? {
                0 => return Err(ReadExactError::UnexpectedEof),
                count => rest.get_mut(count..).unwrap_or_default(),
            };
        }
        Ok(())
    }
}

impl<R: Write, const N: usize> Write for BufReader<R, N> {
    fn write(&mut self, from: &[u8]) -> Result<usize, R::Error> {
        self.reader.write(from)
    }

    fn flush(&mut self) -> Result<(), R::Error> {
        self.reader.flush()
    }
}
