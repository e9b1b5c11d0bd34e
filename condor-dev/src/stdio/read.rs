//! [`BufReader`], and [`ReadLine`]: lines and pieces into the caller's memory.

use core::fmt::Debug;
use core::str;

use embedded_io::{BufRead, ErrorKind, ErrorType, Read, ReadReady};

/// Reads from `R` in pieces of up to `N` bytes, and gives them out in any size.
///
/// An error of `R` is passed on as it is; what had been read before is still given out.
#[derive(Debug)]
pub struct BufReader<R, const N: usize> {
    reader: R,
    buffer: [u8; N],
    begin: usize,
    end: usize,
}

impl<R, const N: usize> BufReader<R, N> {
    /// A reader that has read nothing yet.
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

    /// What has been read and not been given out.
    #[must_use]
    pub fn held(&self) -> &[u8] {
        self.buffer.get(self.begin..self.end).unwrap_or_default()
    }

    /// What it reads from.
    #[must_use]
    pub const fn reader(&self) -> &R {
        &self.reader
    }

    /// What it reads from; who reads from it comes before what is [held](Self::held).
    pub const fn reader_mut(&mut self) -> &mut R {
        &mut self.reader
    }

    /// What it read from; what is [held](Self::held) is gone.
    pub fn into_inner(self) -> R {
        self.reader
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

/// What a read up to a delimiter read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// How many bytes, the delimiter among them.
    pub bytes: usize,
    /// Why no more.
    pub end: End,
}

/// Why a read up to a delimiter ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// With the delimiter.
    Delimiter,
    /// Without it, for the caller's memory is full: the rest can be read next.
    Full,
    /// Without it, for there is no more.
    Input,
}

/// A read up to a delimiter failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("after {read} bytes: {error}")]
pub struct UntilError<E> {
    /// The bytes read before, which are in the caller's memory: go on behind them.
    pub read: usize,
    /// The reader's error.
    pub error: E,
}

/// No line was read. The bytes read so far are in the caller's memory and nowhere else.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError<E> {
    /// The reader failed.
    #[error("after {read} bytes: {error}")]
    Reader {
        /// How many bytes were read before.
        read: usize,
        /// Its error.
        error: E,
    },
    /// The line is longer than the caller's memory; the rest can be read next.
    #[error("a line is longer than {read} bytes")]
    TooLong {
        /// How many bytes of it were read: all that there is room for.
        read: usize,
    },
    /// The line was read, but is not UTF-8.
    #[error("a line of {read} bytes is not UTF-8")]
    NotUtf8 {
        /// How many bytes it has.
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
            Self::Reader { error, .. } => error.kind(),
            Self::TooLong { .. } => ErrorKind::OutOfMemory,
            Self::NotUtf8 { .. } => ErrorKind::InvalidData,
        }
    }
}

/// Lines of any [`BufRead`].
pub trait ReadLine: BufRead {
    /// Reads up to and with `delimiter` into `into`, as far as there is room.
    ///
    /// # Errors
    /// The reader's, with what was read before.
    fn read_until(
        &mut self,
        delimiter: u8,
        into: &mut [u8],
    ) -> Result<Taken, UntilError<Self::Error>> {
        let mut bytes = 0;
        let end = loop {
            let Some(room) = into.get_mut(bytes..).filter(|room| !room.is_empty()) else {
                break End::Full;
            };
            let available = match self.fill_buf() {
                Ok([]) => break End::Input,
                Ok(available) => available,
                Err(error) => return Err(UntilError { read: bytes, error }),
            };
            let mut found = false;
            let mut count = 0;
            for (place, &byte) in room.iter_mut().zip(available) {
                *place = byte;
                count += 1;
                if byte == delimiter {
                    found = true;
                    break;
                }
            }
            self.consume(count);
            bytes += count;
            if found {
                break End::Delimiter;
            }
        };
        Ok(Taken { bytes, end })
    }

    /// Reads a line with its newline, which only the last one of an input may lack; the empty
    /// line is the end of the input.
    ///
    /// # Errors
    /// [`LineError`].
    fn read_line<'l>(&mut self, into: &'l mut [u8]) -> Result<&'l str, LineError<Self::Error>> {
        let taken = self.read_until(b'\n', into);
        line(taken, into)
    }
}

impl<R: BufRead + ?Sized> ReadLine for R {}

/// What was read up to a newline, as a line.
pub(super) fn line<E>(
    taken: Result<Taken, UntilError<E>>,
    into: &[u8],
) -> Result<&str, LineError<E>> {
    match taken {
        Err(UntilError { read, error }) => Err(LineError::Reader { read, error }),
        Ok(Taken {
            bytes: read,
            end: End::Full,
        }) => Err(LineError::TooLong { read }),
        Ok(Taken { bytes: read, .. }) => str::from_utf8(into.get(..read).unwrap_or_default())
            .map_err(|_| LineError::NotUtf8 { read }),
    }
}
