//! Files as a whole.

use condor_fs::{Errno, File, FileError, FileSystem, OpenOptions};
use condor_mbox::{MemoryWindow, Messenger};

/// Reads a file from its beginning, as much as there is and as fits; returns the number of bytes.
pub(crate) fn read<S: Messenger + ?Sized, W: MemoryWindow + Clone, const FILES: usize>(
    files: &FileSystem<'_, S, W, FILES>,
    name: &str,
    options: OpenOptions,
    into: &mut [u8],
) -> Result<usize, FileError> {
    let mut file = files.open(name, options)?;
    let mut len = 0;
    while let Some(rest) = into.get_mut(len..).filter(|rest| !rest.is_empty()) {
        match file.read(rest)? {
            0 => break,
            read => len += read,
        }
    }
    file.close()?;
    Ok(len)
}

/// Writes all bytes from a position on, and leaves that of the file.
pub(crate) fn write_all_at<S: Messenger + ?Sized, W: MemoryWindow + Clone, const FILES: usize>(
    file: &File<'_, '_, S, W, FILES>,
    bytes: &[u8],
    position: u64,
) -> Result<(), FileError> {
    let mut written = 0;
    while let Some(rest) = bytes.get(written..).filter(|rest| !rest.is_empty()) {
        match file.write_at(rest, position.saturating_add(written as u64))? {
            0 => return Err(Errno::IO.into()),
            count => written += count,
        }
    }
    Ok(())
}
