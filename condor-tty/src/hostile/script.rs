//! [`Script`]: decisions out of bytes.

use std::cell::Cell;

/// Bytes that are read as decisions; past the end all are zero.
pub(crate) struct Script<'b> {
    bytes: &'b [u8],
    at: Cell<usize>,
}

impl<'b> Script<'b> {
    pub(crate) const fn new(bytes: &'b [u8]) -> Self {
        Self {
            bytes,
            at: Cell::new(0),
        }
    }

    pub(crate) fn is_over(&self) -> bool {
        self.at.get() >= self.bytes.len()
    }

    pub(crate) fn byte(&self) -> u8 {
        let at = self.at.get();
        self.at.set(at + 1);
        self.bytes.get(at).copied().unwrap_or(0)
    }

    /// Returns a number below `count`, which is not zero and at most 256.
    pub(crate) fn below(&self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    pub(crate) fn word(&self) -> u32 {
        u32::from_le_bytes(std::array::from_fn(|_| self.byte()))
    }

    /// Returns a number that is near to `present`, to zero or to a power of two, or any number.
    pub(crate) fn near(&self, present: u32) -> u32 {
        let small = |byte: u8| i32::from(byte.cast_signed()).cast_unsigned();
        match self.below(6) {
            0 => self.word(),
            1 => small(self.byte()),
            2 => 1 << self.below(32),
            3 => 0x8000_0000_u32.wrapping_add(small(self.byte())),
            _ => present.wrapping_add(small(self.byte())),
        }
    }
}
