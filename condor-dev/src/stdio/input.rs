//! [`Input`]: one buffered reader for all contexts of a program.

use embedded_io::{Error as _, ErrorKind, ErrorType, Read};

use super::claim::Claim;
use super::read::{BufReader, LineError, ReadLine, Taken, UntilError, line};

/// Why an input did not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InputError {
    /// It was not opened, or none is set.
    #[error("there is no input")]
    NotOpen,
    /// The context that this one interrupts, or another thread, is reading.
    #[error("the input is in use")]
    InUse,
    /// The reader failed.
    #[error("the input fails: {0}")]
    Reader(ErrorKind),
}

impl embedded_io::Error for InputError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NotOpen => ErrorKind::NotConnected,
            Self::InUse => ErrorKind::Other,
            Self::Reader(kind) => *kind,
        }
    }
}

/// An input that all contexts share, whatever its reader is; [`Input`] is the implementation.
///
/// Who reads while somebody else does is refused; nobody waits for anybody but the reader.
pub trait StandardInput: Sync {
    /// [`Read::read`].
    ///
    /// # Errors
    /// [`InputError`].
    fn read(&self, into: &mut [u8]) -> Result<usize, InputError>;

    /// [`ReadLine::read_until`].
    ///
    /// # Errors
    /// [`InputError`], with what was read before.
    fn read_until(&self, delimiter: u8, into: &mut [u8]) -> Result<Taken, UntilError<InputError>>;

    /// [`ReadLine::read_line`].
    ///
    /// # Errors
    /// [`LineError`].
    fn read_line<'l>(&self, into: &'l mut [u8]) -> Result<&'l str, LineError<InputError>> {
        let taken = self.read_until(b'\n', into);
        line(taken, into)
    }
}

/// A reader in a `static` for all contexts of a program, behind a buffer of `N` bytes.
pub struct Input<R, const N: usize>(Claim<Option<BufReader<R, N>>>);

impl<R, const N: usize> Input<R, N> {
    /// An input that has no reader yet.
    #[must_use]
    pub const fn new() -> Self {
        Self(Claim::new(None))
    }

    /// Gives it its reader, for good.
    ///
    /// # Errors
    /// The reader, if it has one.
    pub fn open(&self, reader: R) -> Result<(), R> {
        match self.0.claim() {
            Some(mut place) if place.is_none() => {
                *place = Some(BufReader::new(reader));
                Ok(())
            }
            _ => Err(reader),
        }
    }

    fn with<T>(&self, f: impl FnOnce(&mut BufReader<R, N>) -> T) -> Result<T, InputError> {
        let mut place = self.0.claim().ok_or(InputError::InUse)?;
        Ok(f(place.as_mut().ok_or(InputError::NotOpen)?))
    }
}

impl<R, const N: usize> Default for Input<R, N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<R: Read + Send, const N: usize> StandardInput for Input<R, N> {
    fn read(&self, into: &mut [u8]) -> Result<usize, InputError> {
        self.with(|reader| reader.read(into))?
            .map_err(|error| InputError::Reader(error.kind()))
    }

    fn read_until(&self, delimiter: u8, into: &mut [u8]) -> Result<Taken, UntilError<InputError>> {
        self.with(|reader| reader.read_until(delimiter, into))
            .map_err(|error| UntilError { read: 0, error })?
            .map_err(|UntilError { read, error }| UntilError {
                read,
                error: InputError::Reader(error.kind()),
            })
    }
}

impl<R, const N: usize> ErrorType for &Input<R, N> {
    type Error = InputError;
}

impl<R: Read + Send, const N: usize> Read for &Input<R, N> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, InputError> {
        StandardInput::read(*self, into)
    }
}
