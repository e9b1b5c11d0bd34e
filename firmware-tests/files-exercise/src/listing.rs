//! [`Listing`]: the entries of a directory, as condor-fs's WIRE.md lays them out.

use condor_fs::wire::{Span, halves};
use condor_mbox::{AccessError, MemoryWindow as _, Region, StaticWindow};

/// Bytes of an entry before its name.
const HEAD: u32 = 16;

/// Entries that are put into a buffer of the client.
pub(crate) struct Listing<'l, 's> {
    theirs: &'l Region<StaticWindow<'s>>,
    buffer: Span,
    filled: u32,
}

impl<'l, 's> Listing<'l, 's> {
    pub(crate) const fn new(theirs: &'l Region<StaticWindow<'s>>, buffer: Span) -> Self {
        Self {
            theirs,
            buffer,
            filled: 0,
        }
    }

    pub(crate) const fn bytes(&self) -> u32 {
        self.filled
    }

    /// Whether there is room for an entry, which then is there.
    pub(crate) fn put(&mut self, cookie: u64, kind: u32, name: &[u8]) -> Result<bool, AccessError> {
        let len = name.len() as u32;
        let end = self.filled.saturating_add(HEAD);
        let end = end.saturating_add(len.div_ceil(4).saturating_mul(4));
        if end > self.buffer.len {
            return Ok(false);
        }
        let [low, high] = halves(cookie);
        let begin = self.buffer.offset.wrapping_add(self.filled);
        for (word, at) in [low, high, kind, len].iter().zip((begin..).step_by(4)) {
            self.theirs.set_word(at, *word)?;
        }
        let at = begin.wrapping_add(HEAD);
        if len > 0 {
            // The padding.
            self.theirs.set_word(at.wrapping_add(len - 1) & !3, 0)?;
        }
        self.theirs.write(at, name)?;
        self.filled = end;
        Ok(true)
    }
}
