//! Times of the command line.

use std::time::Duration;

use jiff::SignedDuration;

/// A number of lines of the command line.
pub(crate) fn lines(text: &str) -> Result<usize, String> {
    let count = text.parse();
    count.map_err(|_| format!("`{text}` is not a number of lines: write one such as 100"))
}

/// A time of the command line.
pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let wrong = |_| format!("`{text}` is not a time: write one such as 500ms, 10s or 2m");
    let span: SignedDuration = text.parse().map_err(wrong)?;
    span.try_into()
        .map_err(|_| format!("`{text}` is a negative time: write one such as 500ms, 10s or 2m"))
}
