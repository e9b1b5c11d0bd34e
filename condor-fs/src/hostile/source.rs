//! [`Source`]: choices out of bytes.

/// The bytes of a run; zeros when they have run out.
pub(crate) struct Source<'b>(&'b [u8]);

/// Words that checks tend to get wrong.
const WORDS: [u32; 16] = [
    0,
    1,
    2,
    3,
    4,
    63,
    64,
    255,
    4095,
    4096,
    0x7fff_ffff,
    0x8000_0000,
    u32::MAX - 63,
    u32::MAX - 3,
    u32::MAX - 1,
    u32::MAX,
];

impl<'b> Source<'b> {
    pub(crate) const fn new(bytes: &'b [u8]) -> Self {
        Self(bytes)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else {
            return 0;
        };
        self.0 = rest;
        *first
    }

    /// Returns a number below `end`, which is at most 65536.
    pub(crate) fn below(&mut self, end: u32) -> u32 {
        (u32::from(self.byte()) << 8 | u32::from(self.byte())) % end
    }

    /// Returns one of `all`.
    pub(crate) fn one<T: Copy>(&mut self, all: &[T]) -> T {
        all[usize::from(self.byte()) % all.len()]
    }

    /// Returns any word, often one of [`WORDS`].
    pub(crate) fn word(&mut self) -> u32 {
        match self.byte() % 4 {
            0 => self.one(&WORDS),
            1 => u32::from(self.byte()),
            2 => self.below(8192),
            _ => u32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()]),
        }
    }
}
