//! [`Screen`]: a terminal's output as a person sees it, for user interfaces.

use std::io;
use std::num::NonZero;

use super::sink::Sink;

/// A bounded screen in memory, with the lines that have left it.
///
/// What is written is interpreted by the crate `vt100`, whose screen
/// [`contents`](Self::screen) are for the user interface to show.
pub struct Screen {
    parser: vt100::Parser,
    overwritten: u64,
}

impl Screen {
    /// An empty screen, which keeps `history` lines that have left it.
    #[must_use]
    pub fn new(rows: NonZero<u16>, columns: NonZero<u16>, history: usize) -> Self {
        Self {
            parser: vt100::Parser::new(rows, columns, history),
            overwritten: 0,
        }
    }

    /// What is on it: text, attributes and cursor.
    #[must_use]
    pub fn screen(&self) -> &vt100::Screen {
        self.parser.screen()
    }

    /// To change its size, or which part of the history is shown.
    pub fn screen_mut(&mut self) -> &mut vt100::Screen {
        self.parser.screen_mut()
    }

    /// Bytes that are missing on it, because they were overwritten before they could be read.
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
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.parser.process(bytes);
        Ok(bytes.len())
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        self.overwritten += u64::from(bytes);
        Ok(())
    }
}
