//! [`Script`]: decisions out of bytes.

/// Bytes that are read as decisions; past the end all are zero.
pub(super) struct Script<'b> {
    bytes: &'b [u8],
    at: usize,
}

impl<'b> Script<'b> {
    pub(super) const fn new(bytes: &'b [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) const fn is_over(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Returns the number of bytes that have been read.
    pub(super) const fn position(&self) -> usize {
        self.at
    }

    pub(super) fn byte(&mut self) -> u8 {
        let byte = self.bytes.get(self.at).copied().unwrap_or(0);
        self.at += 1;
        byte
    }

    /// Returns a number below `count`, which is not zero and at most 256.
    pub(super) fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    pub(super) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    pub(super) fn word(&mut self) -> u32 {
        u32::from_le_bytes(core::array::from_fn(|_| self.byte()))
    }

    /// Returns a number between -128 and 127 as a difference modulo 2³², mostly a small one.
    pub(super) fn difference(&mut self) -> u32 {
        let byte = self.byte().cast_signed();
        let near = if byte & 1 == 0 { 0 } else { byte >> 4 };
        let chosen = if byte & 3 == 3 { byte >> 1 } else { near };
        i32::from(chosen).cast_unsigned()
    }
}
