//! The default methods of `embedded-io`, without their paths that panic.

use embedded_io::ReadExactError;

use super::FileError;
use crate::errno::Errno;

/// Calls `read` until `into` is full.
pub(super) fn read_exact(
    into: &mut [u8],
    mut read: impl FnMut(&mut [u8]) -> Result<usize, FileError>,
) -> Result<(), ReadExactError<FileError>> {
    let mut rest = into;
    while !rest.is_empty() {
        rest = match read(rest)? {
            0 => return Err(ReadExactError::UnexpectedEof),
            count => rest.get_mut(count..).unwrap_or_default(),
        };
    }
    Ok(())
}

/// Calls `write` until `from` is empty; [`Errno::IO`] if it takes nothing, and names no error.
pub(super) fn write_all(
    from: &[u8],
    mut write: impl FnMut(&[u8]) -> Result<usize, FileError>,
) -> Result<(), FileError> {
    let mut rest = from;
    while !rest.is_empty() {
        rest = match write(rest)? {
            0 => return Err(Errno::IO.into()),
            count => rest.get(count..).unwrap_or_default(),
        };
    }
    Ok(())
}
