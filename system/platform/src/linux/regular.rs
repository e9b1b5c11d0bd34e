//! [`open_regular`]: files that a user names, which may be something else.

use std::format;
use std::fs::{File, FileType, Metadata};
use std::io::{self, ErrorKind, Read as _};
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::Path;
use std::string::String;
use std::vec::Vec;

/// Opens the regular file `path` for reading, and refuses anything else.
///
/// Opening a FIFO waits until somebody writes to it, and opening a device can have an effect. So this function
/// opens only regular files.
///
/// # Errors
/// Returns an error of the kind [`InvalidInput`](ErrorKind::InvalidInput) that says what `path` is, if it is
/// not a regular file; the operating system's error if it cannot be opened.
pub fn open_regular(path: impl AsRef<Path>) -> io::Result<File> {
    let path = path.as_ref();
    check_regular(&path.metadata()?)?;
    // Something else may have its name by now.
    let mut options = File::options();
    let file = options
        .read(true)
        .custom_flags(libc::O_NONBLOCK)
        .open(path)?;
    check_regular(&file.metadata()?)?;
    Ok(file)
}

/// Reads the whole content of the regular file `path`.
///
/// # Errors
/// Returns an error if the file cannot be opened, as [`open_regular`] does; the operating system's error if it
/// cannot be read.
pub fn read_regular(path: impl AsRef<Path>) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_regular(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads the whole content of the regular file `path`, which must be a text in UTF-8.
///
/// # Errors
/// Returns an error if the file cannot be opened or read, as [`read_regular`] does; one of the kind
/// [`InvalidData`](ErrorKind::InvalidData) if it is not UTF-8.
pub fn read_text(path: impl AsRef<Path>) -> io::Result<String> {
    let mut text = String::new();
    open_regular(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Returns an error that says what a file is, unless it is a regular one.
pub(super) fn check_regular(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    let found = name(metadata.file_type());
    let text = format!("it is {found}, not a regular file");
    Err(io::Error::new(ErrorKind::InvalidInput, text))
}

fn name(kind: FileType) -> &'static str {
    match kind {
        kind if kind.is_dir() => "a directory",
        kind if kind.is_fifo() => "a FIFO",
        kind if kind.is_socket() => "a socket",
        _ => "a device",
    }
}
