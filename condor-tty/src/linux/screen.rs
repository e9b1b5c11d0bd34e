//! [`Screen`]: a terminal's output as a person sees it, for user interfaces.

use std::io;
use std::num::NonZero;

use super::sink::{Piece, Sink};

/// A bounded screen in memory, with the lines that have scrolled off it.
///
/// The crate `vt100` interprets the output; the user interface shows its [`screen`](Self::screen).
pub struct Screen {
    parser: vt100::Parser,
    overwritten: u64,
}

impl Screen {
    /// Makes an empty screen, which keeps up to `history` lines that have scrolled off it.
    #[must_use]
    pub fn new(rows: NonZero<u16>, columns: NonZero<u16>, history: usize) -> Self {
        Self {
            parser: vt100::Parser::new(rows, columns, history),
            overwritten: 0,
        }
    }

    /// Returns the screen's content: text, attributes and cursor.
    #[must_use]
    pub fn screen(&self) -> &vt100::Screen {
        self.parser.screen()
    }

    /// Returns the screen for changes: of its size, or of the part of the history that is shown.
    pub fn screen_mut(&mut self) -> &mut vt100::Screen {
        self.parser.screen_mut()
    }

    /// Returns the number of bytes that are missing, because they were overwritten before they were
    /// read.
    #[must_use]
    pub const fn overwritten_bytes(&self) -> u64 {
        self.overwritten
    }
}

impl std::fmt::Debug for Screen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Screen")
            .field("size", &self.screen().size())
            .field("overwritten", &self.overwritten)
            .finish_non_exhaustive()
    }
}

impl Sink for Screen {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        self.overwritten += u64::from(piece.overwritten);
        self.parser.process(piece.bytes);
        Ok(piece.bytes.len())
    }
}
