//! [`Text`]: what is printed, to be compared.

use core::fmt::{self, Display, Write as _};

/// A text of at most `N` bytes; more are dropped.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Text<const N: usize> {
    bytes: [u8; N],
    len: usize,
}

impl<const N: usize> Text<N> {
    pub(crate) const fn new() -> Self {
        Self {
            bytes: [0; N],
            len: 0,
        }
    }

    /// Returns `value` as a text for people.
    pub(crate) fn of(value: &dyn Display) -> Self {
        let mut text = Self::new();
        // The text takes everything.
        let _ = write!(text, "{value}");
        text
    }

    pub(crate) fn push(&mut self, bytes: &[u8]) {
        let free = self.bytes.iter_mut().skip(self.len);
        self.len += free.zip(bytes).map(|(place, byte)| *place = *byte).count();
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }
}

impl<const N: usize> fmt::Write for Text<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.push(text.as_bytes());
        Ok(())
    }
}
