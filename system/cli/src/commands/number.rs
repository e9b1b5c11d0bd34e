//! Times of the command line.

use std::time::Duration;

use jiff::SignedDuration;

/// A time of the command line.
pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let span: SignedDuration = text
        .parse()
        .map_err(|error| format!("{error}; write a time such as 10s or 500ms"))?;
    span.try_into()
        .map_err(|_| "a time must not be negative".into())
}
