//! [`Screen`]: a terminal's output as a person sees it, for user interfaces.

use std::io;
use std::num::NonZero;

use super::sink::{Piece, Sink};

/// A [`Sink`] that keeps a screen in memory, for user interfaces: its rows and columns, and a
/// bounded number of the lines that have scrolled off it.
///
/// The crate `vt100` interprets the output; a user interface draws the result,
/// [`screen`](Self::screen).
pub struct Screen {
    parser: vt100::Parser,
    overwritten: u64,
}

impl Screen {
    /// Makes an empty screen of `rows` by `columns`, which keeps up to `history` lines that have
    /// scrolled off it.
    #[must_use]
    pub fn new(rows: NonZero<u16>, columns: NonZero<u16>, history: usize) -> Self {
        Self {
            parser: vt100::Parser::new(rows, columns, history),
            overwritten: 0,
        }
    }

    /// Returns the content of the screen, to be drawn: text, attributes and cursor.
    #[must_use]
    pub fn screen(&self) -> &vt100::Screen {
        self.parser.screen()
    }

    /// Returns the screen so that the caller can change its size, or the part of the history that
    /// is shown.
    pub fn screen_mut(&mut self) -> &mut vt100::Screen {
        self.parser.screen_mut()
    }

    /// Returns the number of bytes of output that are missing on the screen, because the processor
    /// overwrote them before they were read.
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
