//! What people are told when something fails.

use std::path::Path;

/// The error of a command, which is shown to people.
pub type AnyError = Box<dyn core::error::Error>;

/// How this program was called, for what people may type next.
pub(crate) fn me() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let name = Path::new(&called).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}
