//! [`BufferedInput`]: one buffered reader for all contexts of a program.

use embedded_io::{Error as _, ErrorType, Read};

use super::claim::ClaimCell;
use super::error::StdioError;
use super::read::{BufReader, LineError, ReadLine, UntilError, line};

/// A standard input that all contexts of a program share. [`BufferedInput`] implements it for any
/// reader.
///
/// A read while another context reads fails with [`StdioError::InUse`], so calls wait only for the
/// reader. For code that is generic over [`Read`], a reference to a standard input is a reader.
pub trait StandardInput: Sync {
    /// Reads at least one byte into `into`, and returns the number of bytes; 0 at the end of the
    /// input, or if `into` is empty. Waits as the reader does.
    ///
    /// # Errors
    /// [`StdioError`] if there is no reader, another context reads, or the reader fails.
    fn read(&self, into: &mut [u8]) -> Result<usize, StdioError>;

    /// Reads into `into` up to and including `delimiter`, and returns the number of bytes, as
    /// [`ReadLine::read_until`] does.
    ///
    /// # Errors
    /// [`UntilError`] with a [`StdioError`], and with the number of bytes read before.
    fn read_until(&self, delimiter: u8, into: &mut [u8]) -> Result<usize, UntilError<StdioError>>;

    /// Reads a line with its newline into `into`, as [`ReadLine::read_line`] does.
    ///
    /// # Errors
    /// [`LineError`] if the reader fails, the line is too long, or it is not UTF-8.
    fn read_line<'l>(&self, into: &'l mut [u8]) -> Result<&'l str, LineError<StdioError>> {
        let read = self.read_until(b'\n', into);
        line(read, into)
    }
}

/// A buffered reader in a `static`, which all contexts of a program share. `N` is the size of the
/// buffer in bytes. [`set_input`](super::set_input) makes it the program's standard input.
pub struct BufferedInput<R, const N: usize>(ClaimCell<Option<BufReader<R, N>>>);

impl<R, const N: usize> BufferedInput<R, N> {
    /// Makes an input without a reader: reads fail with [`StdioError::NotOpen`] until
    /// [`open`](Self::open) sets one.
    #[must_use]
    pub const fn new() -> Self {
        Self(ClaimCell::new(None))
    }

    /// Sets the reader from which the input reads. It cannot be changed afterwards.
    ///
    /// # Errors
    /// Returns `reader` if the input has one already, or if another context is using the input.
    pub fn open(&self, reader: R) -> Result<(), R> {
        match self.0.claim() {
            Some(mut place) if place.is_none() => {
                *place = Some(BufReader::new(reader));
                Ok(())
            }
            _ => Err(reader),
        }
    }

    fn with<T>(&self, f: impl FnOnce(&mut BufReader<R, N>) -> T) -> Result<T, StdioError> {
        let mut place = self.0.claim().ok_or(StdioError::InUse)?;
        Ok(f(place.as_mut().ok_or(StdioError::NotOpen)?))
    }
}

impl<R, const N: usize> Default for BufferedInput<R, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<R: Read + Send, const N: usize> StandardInput for BufferedInput<R, N> {
    fn read(&self, into: &mut [u8]) -> Result<usize, StdioError> {
        self.with(|reader| reader.read(into))?
            .map_err(|error| StdioError::Failed(error.kind()))
    }

    fn read_until(&self, delimiter: u8, into: &mut [u8]) -> Result<usize, UntilError<StdioError>> {
        self.with(|reader| reader.read_until(delimiter, into))
            .map_err(|error| UntilError { read: 0, error })?
            .map_err(|UntilError { read, error }| UntilError {
                read,
                error: StdioError::Failed(error.kind()),
            })
    }
}

impl ErrorType for &dyn StandardInput {
    type Error = StdioError;
}

impl Read for &dyn StandardInput {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, StdioError> {
        StandardInput::read(*self, into)
    }
}
