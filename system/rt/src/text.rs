//! [`ShortText`]: what is printed, without a heap.

use core::fmt::{self, Write as _};

/// A text of at most `BYTES` bytes, which needs no heap. A longer text is cut off after its last
/// character that fits.
///
/// ```
/// use condor_rt::ShortText;
///
/// assert_eq!(ShortText::<8>::of(&format_args!("joint {}", 12)).as_str(), "joint 12");
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct ShortText<const BYTES: usize>(heapless::String<BYTES, u8>);

impl<const BYTES: usize> ShortText<BYTES> {
    /// Makes a text of all that `printed` prints, cut off after the last character that fits into
    /// `BYTES` bytes.
    #[must_use]
    pub fn of(printed: &(impl fmt::Display + ?Sized)) -> Self {
        let mut text = Cut(heapless::String::new());
        // A text that does not fit is cut off.
        let _ = write!(text, "{printed}");
        Self(text.0)
    }

    /// Returns the stored text as a string slice.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<const BYTES: usize> fmt::Display for ShortText<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl<const BYTES: usize> fmt::Debug for ShortText<BYTES> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.0.as_str(), f)
    }
}

struct Cut<const BYTES: usize>(heapless::String<BYTES, u8>);

impl<const BYTES: usize> fmt::Write for Cut<BYTES> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars()
            .try_for_each(|character| self.0.push(character))
            .map_err(|_| fmt::Error)
    }
}
