//! Errors that are shown to people.

use std::path::{Path, PathBuf};

/// The error of a command, which is shown to people.
pub type AnyError = Box<dyn core::error::Error>;

/// The operating system refused an operation on a file.
#[derive(Debug, thiserror::Error)]
#[error("cannot {doing} {path:?}: {source}")]
pub struct NamedFileError {
    /// The operation, such as `open`.
    pub doing: &'static str,
    /// The path of the file.
    pub path: PathBuf,
    /// The error of the operating system.
    pub source: std::io::Error,
}

impl NamedFileError {
    /// Returns a function that makes the error of the refused operation `doing` on the file at `path`.
    pub fn at(doing: &'static str, path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_owned();
        move |source| Self {
            doing,
            path,
            source,
        }
    }
}

/// Returns the name by which this program was called, for hints that tell people what to type next.
#[must_use]
pub fn me() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let name = Path::new(&called).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
