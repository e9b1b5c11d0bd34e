//! Errors that are shown to people.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// An error of any type. Its text is for people; callers do not distinguish its causes.
pub type AnyError = Box<dyn core::error::Error>;

/// The error that the operating system refused an operation on a file. Its text names the operation and the file.
#[derive(Debug, thiserror::Error)]
#[error("cannot {doing} {path:?}: {source}{}", remedy(.source))]
pub struct NamedFileError {
    /// The operation, such as `open`.
    pub doing: &'static str,
    /// The path of the file.
    pub path: PathBuf,
    /// The error of the operating system.
    pub source: std::io::Error,
}

/// Returns the remedy for an error of the operating system, after a semicolon; empty for those without.
pub(crate) fn remedy(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::NotFound | ErrorKind::NotADirectory => "; check the path",
        ErrorKind::AlreadyExists => "; choose another path",
        ErrorKind::PermissionDenied => "; check the permissions",
        _ => "",
    }
}

impl NamedFileError {
    /// Returns a function for [`Result::map_err`], which adds the operation `doing`, such as `open`, and the `path` of
    /// the file to an error of the operating system.
    pub fn at(doing: &'static str, path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_owned();
        move |source| Self {
            doing,
            path,
            source,
        }
    }
}

/// Prints a line on standard error that begins with the name of this program, such as a warning.
pub fn tell(text: impl core::fmt::Display) {
    eprintln!("{}: {text}", me());
}

/// Returns the name by which this program was called, without its directory. Hints use it to tell people what to type.
#[must_use]
pub fn me() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let name = Path::new(&called).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
