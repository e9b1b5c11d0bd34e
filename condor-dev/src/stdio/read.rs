//! [`BufReader`]: a buffered reader; and [`ReadLine`]: reads lines and pieces into the caller's
//! memory.

use core::fmt::Debug;
use core::str;

use embedded_io::{BufRead, ErrorKind, ErrorType, Read, ReadReady};

/// A buffered reader: it reads from `R` in pieces of up to `N` bytes, and passes the bytes on in
/// pieces of any size.
///
/// An error of `R` is returned unchanged; bytes that were read before it can still be read.
#[derive(Debug)]
pub struct BufReader<R, const N: usize> {
    reader: R,
    buffer: [u8; N],
    begin: usize,
    end: usize,
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
        }
    }

    /// Returns the bytes that were read from the reader behind the buffer and not yet passed on.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.buffer.get(self.begin..self.end).unwrap_or_default()
    }

    /// Returns the reader that this buffered reader reads from.
    #[must_use]
    pub const fn reader(&self) -> &R {
        &self.reader
    }
}

impl<R: ErrorType, const N: usize> ErrorType for BufReader<R, N> {
    type Error = R::Error;
}

impl<R: Read, const N: usize> Read for BufReader<R, N> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, R::Error> {
        if self.held().is_empty() && into.len() >= N {
            let read = self.reader.read(into)?;
            return Ok(read.min(into.len()));
        }
        let read = copy(self.fill_buf()?, into);
        self.consume(read);
        Ok(read)
    }
}

impl<R: Read, const N: usize> BufRead for BufReader<R, N> {
    fn fill_buf(&mut self) -> Result<&[u8], R::Error> {
        if self.begin >= self.end {
            let read = self.reader.read(&mut self.buffer)?;
            self.begin = 0;
            self.end = read.min(N);
        }
        Ok(self.held())
    }

    /// Drops the first `bytes` of what is held, all if there are less.
    fn consume(&mut self, bytes: usize) {
        self.begin = self.end.min(self.begin.saturating_add(bytes));
    }
}

impl<R: Read + ReadReady, const N: usize> ReadReady for BufReader<R, N> {
    fn read_ready(&mut self) -> Result<bool, R::Error> {
        Ok(!self.held().is_empty() || self.reader.read_ready()?)
    }
}

/// As many bytes as both have.
fn copy(from: &[u8], into: &mut [u8]) -> usize {
    let count = from.len().min(into.len());
    for (place, byte) in into.iter_mut().zip(from) {
        *place = *byte;
    }
    count
}

/// The error of [`ReadLine::read_until`]: the reader failed before the delimiter was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("reading failed after {read} bytes: {error}")]
pub struct UntilError<E> {
    /// The number of bytes read before, which are in the caller's memory; continue after them.
    pub read: usize,
    /// The reader's error.
    pub error: E,
}

/// The reason why [`ReadLine::read_line`] returned no line. The bytes that it read are in the
/// caller's memory; they are not read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError<E> {
    /// The reader failed.
    #[error("{0}")]
    Reader(UntilError<E>),
    /// The line is longer than the caller's memory; the next call reads the rest.
    #[error("a line is longer than the buffer of {read} bytes")]
    TooLong {
        /// The number of bytes that were read: as many as there is room for.
        read: usize,
    },
    /// The line was read, but is not UTF-8.
    #[error("a line of {read} bytes is not UTF-8")]
    NotUtf8 {
        /// The number of bytes of the line.
        read: usize,
    },
}

impl<E: embedded_io::Error> embedded_io::Error for UntilError<E> {
    fn kind(&self) -> ErrorKind {
        self.error.kind()
    }
}

impl<E: embedded_io::Error> embedded_io::Error for LineError<E> {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Reader(error) => error.kind(),
            Self::TooLong { .. } => ErrorKind::OutOfMemory,
            Self::NotUtf8 { .. } => ErrorKind::InvalidData,
        }
    }
}

/// Methods that read line by line. Every [`BufRead`] has them.
pub trait ReadLine: BufRead {
    /// Reads into `into` up to and including `delimiter`, and returns the number of bytes. If the
    /// last byte is not the delimiter, `into` is full or the input has ended.
    ///
    /// # Errors
    /// [`UntilError`] with the reader's error and the number of bytes read before.
    fn read_until(
        &mut self,
        delimiter: u8,
        into: &mut [u8],
    ) -> Result<usize, UntilError<Self::Error>> {
        let mut read = 0;
        while let Some(room @ [_, ..]) = into.get_mut(read..) {
            let available = match self.fill_buf() {
                Ok([]) => break,
                Ok(available) => available,
                Err(error) => return Err(UntilError { read, error }),
            };
            let mut fitting = available.iter().take(room.len());
            let found = fitting.position(|byte| *byte == delimiter);
            let wanted = found.and_then(|at| available.get(..=at));
            let count = copy(wanted.unwrap_or(available), room);
            self.consume(count);
            read += count;
            if found.is_some() {
                break;
            }
        }
        Ok(read)
    }

    /// Reads a line into `into`, and returns it with its newline; only the last line of an input
    /// may lack it. At the end of the input it returns an empty text.
    ///
    /// # Errors
    /// [`LineError`] if the reader fails, the line is too long, or it is not UTF-8.
    fn read_line<'l>(&mut self, into: &'l mut [u8]) -> Result<&'l str, LineError<Self::Error>> {
        let read = self.read_until(b'\n', into);
        line(read, into)
    }
}

impl<R: BufRead + ?Sized> ReadLine for R {}

/// The bytes that were read up to a newline, as a line.
pub(super) fn line<E>(
    read: Result<usize, UntilError<E>>,
    into: &[u8],
) -> Result<&str, LineError<E>> {
    let read = read.map_err(LineError::Reader)?;
    let line = into.get(..read).unwrap_or_default();
    if read == into.len() && line.last() != Some(&b'\n') {
        return Err(LineError::TooLong { read });
    }
    str::from_utf8(line).map_err(|_| LineError::NotUtf8 { read })
}
