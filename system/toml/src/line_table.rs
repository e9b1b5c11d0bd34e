//! [`LineTable`]: the lines and columns of a text.

/// After so many bytes the characters before them are known.
const STEP: usize = 64;

/// A table by which the line and column of a byte are found without reading the text before it.
#[derive(Debug)]
pub(crate) struct LineTable {
    /// The byte at which each line begins.
    lines: Vec<usize>,
    /// The number of characters before every [`STEP`]th byte.
    chars: Vec<usize>,
}

impl LineTable {
    pub(crate) fn of(content: &str) -> Self {
        let ends = content.match_indices('\n').map(|(end, _)| end + 1);
        let mut before = 0;
        let steps = content.as_bytes().chunks(STEP).map(|step| {
            before += chars(step);
            before
        });
        Self {
            lines: core::iter::once(0).chain(ends).collect(),
            chars: core::iter::once(0).chain(steps).collect(),
        }
    }

    /// Returns the line and the column of a byte of `content`, from 1.
    pub(crate) fn place(&self, content: &str, byte: usize) -> (usize, usize) {
        let byte = byte.min(content.len());
        let line = self.lines.partition_point(|begin| *begin <= byte);
        let begin = self.lines.get(line.saturating_sub(1));
        let begin = begin.map_or(0, |begin| self.chars_before(content, *begin));
        let column = self.chars_before(content, byte).saturating_sub(begin);
        (line, column + 1)
    }

    fn chars_before(&self, content: &str, byte: usize) -> usize {
        let step = byte / STEP;
        let rest = content.as_bytes().get(step * STEP..byte);
        self.chars.get(step).copied().unwrap_or(0) + chars(rest.unwrap_or_default())
    }
}

/// The number of characters that begin in these bytes.
fn chars(bytes: &[u8]) -> usize {
    // The bytes of a character but its first one are 0b10xx_xxxx.
    bytes.iter().filter(|byte| **byte & 0xc0 != 0x80).count()
}
