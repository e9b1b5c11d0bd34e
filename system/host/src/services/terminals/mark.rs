//! [`Mark`]: which byte of a terminal's output or input is where in a file.

use std::io;
use std::path::Path;

use crate::system::replace;

/// From `offset` on, a file holds the bytes of an incarnation from `position` on, without a gap.
///
/// So the length of the file tells which byte follows, or the number of bytes that were taken tells
/// where the next one is, even if the service was killed at any moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Mark {
    pub(super) incarnation: u32,
    pub(super) position: u32,
    pub(super) offset: u64,
    /// Bytes of all files before this one.
    pub(super) before: u64,
    /// The line that ends at `offset`.
    pub(super) line: String,
}

impl Mark {
    pub(super) fn read(path: &Path) -> Option<Self> {
        let text = std::fs::read_to_string(path).ok()?;
        let (numbers, line) = text.split_once('\n')?;
        let mut numbers = numbers.split(' ');
        Some(Self {
            incarnation: numbers.next()?.parse().ok()?,
            position: numbers.next()?.parse().ok()?,
            offset: numbers.next()?.parse().ok()?,
            before: numbers.next()?.parse().ok()?,
            line: line.into(),
        })
    }

    /// Replaces the previous mark in one step.
    pub(super) fn write(&self, path: &Path) -> io::Result<()> {
        let Self {
            incarnation,
            position,
            offset,
            before,
            line,
        } = self;
        let text = format!("{incarnation} {position} {offset} {before}\n{line}");
        replace(path, &text)
    }
}
