//! [`MemoryWindow`]: a range of a processor's memory, accessed at checked offsets.

use core::fmt::{self, Debug};
use core::ops::Deref;
use core::sync::atomic::{AtomicU32, Ordering};

/// The order of a load relative to the accesses around it, as in `core::sync::atomic::Ordering`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadOrder {
    /// No order; only the word itself is read as a whole.
    Relaxed,
    /// Everything that the writer of the word stored before its `Release` store is visible after
    /// this load.
    Acquire,
}

/// The order of a store relative to the accesses around it, as in `core::sync::atomic::Ordering`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreOrder {
    /// No order; only the word itself is written as a whole.
    Relaxed,
    /// Everything stored before is visible to a reader that loads the word with `Acquire`.
    Release,
}

impl From<LoadOrder> for Ordering {
    #[inline]
    fn from(order: LoadOrder) -> Self {
        match order {
            LoadOrder::Relaxed => Self::Relaxed,
            LoadOrder::Acquire => Self::Acquire,
        }
    }
}

impl From<StoreOrder> for Ordering {
    #[inline]
    fn from(order: StoreOrder) -> Self {
        match order {
            StoreOrder::Relaxed => Self::Relaxed,
            StoreOrder::Release => Self::Release,
        }
    }
}

/// The reason why a window refused an access, for code that works with any window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum WindowErrorKind {
    /// The access does not lie wholly inside the window.
    OutOfBounds,
    /// The offset is not a multiple of four.
    Misaligned,
    /// The window is mapped for reading only.
    ReadOnly,
    /// The memory behind the window is gone: a truncated file, a vanished device.
    Lost,
    /// The memory is not coherent: a compare-and-swap would act on this processor's cache only.
    NotCoherent,
}

impl fmt::Display for WindowErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OutOfBounds => "the range is not wholly inside the window",
            Self::Misaligned => "the offset is not a multiple of four",
            Self::ReadOnly => "the window is for reading only",
            Self::Lost => "the memory behind the window is gone",
            Self::NotCoherent => "the memory is not coherent",
        })
    }
}

/// The error of an access to a window. Each backend has its own type of error.
pub trait WindowError: Debug {
    /// Returns the reason of the error, which code for any window can handle.
    fn kind(&self) -> WindowErrorKind;
}

/// The error of an access to a [`Region`](crate::Region) or another window, with the offending
/// values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot access {len} bytes at offset {offset:#x} of a memory of {size:#x} bytes: {kind}")]
pub struct AccessError {
    /// The offset of the access in bytes, from the beginning of the region or window.
    pub offset: u32,
    /// The length of the access, in bytes.
    pub len: usize,
    /// The size of the region or window in bytes.
    pub size: u32,
    /// The reason why the access was refused.
    pub kind: WindowErrorKind,
}

impl AccessError {
    pub(crate) const fn new(offset: u32, len: usize, size: u32, kind: WindowErrorKind) -> Self {
        Self {
            offset,
            len,
            size,
            kind,
        }
    }

    /// [`MemoryWindow::check`], with the values that failed it.
    pub(crate) fn check<W: MemoryWindow>(window: &W, offset: u32, len: usize) -> Result<(), Self> {
        let checked = window.check(offset, len);
        checked.map_err(|error| Self::new(offset, len, window.size(), error.kind()))
    }
}

impl WindowError for AccessError {
    fn kind(&self) -> WindowErrorKind {
        self.kind
    }
}

/// A range of a processor's memory that others may read or write at any time.
///
/// # For users
///
/// Words are 32 bits, little-endian, at offsets that are multiples of four. There is never a Rust
/// reference into the memory: a read returns a copy, which the peer cannot change afterwards. A
/// processor has two objects: its `mail`, which only it writes, and its `data`, which every
/// processor writes.
///
/// | access | inside | partly or wholly outside | misaligned | mapped read-only | memory gone |
/// |---|---|---|---|---|---|
/// | `load` | the word | `OutOfBounds` | `Misaligned` | the word | `Lost` |
/// | `store` | done | `OutOfBounds` | `Misaligned` | `ReadOnly` | `Lost` |
/// | `read`, `write`, `write_words` of *n* > 0 bytes | all *n* | `OutOfBounds`, nothing copied | `Misaligned`, nothing copied | `write`: `ReadOnly` | `Lost`, a prefix may have been copied |
/// | `read`, `write`, `write_words` of 0 bytes at an aligned offset ≤ `size` | nothing | `OutOfBounds` | `Misaligned` | nothing | nothing |
///
/// # For implementers
///
/// `load` and `store` must be single 32-bit atomic accesses with the given order; all accesses
/// to the memory go through such words, because mixed-size atomic accesses are undefined
/// behaviour. The provided `read`, `write` and `write_words` do so; override them only to be faster. An
/// access to memory that has gone must return `Lost`, never a signal or a trap. `size` never
/// changes. Call [`conformance::window`](conformance/fn.window.html) from one test.
///
/// If the caches of the processors are not coherent, `is_coherent` is `false`, and every access
/// maintains the cache: a load or read invalidates its lines first; a store or write invalidates
/// them first and cleans them afterwards. `clean` and `invalidate` are for programs that access the
/// memory in another way. The window begins at a cache line, has whole lines of at most
/// [`LINE`](crate::layout::LINE) bytes, and shares them with no other memory. No two processors
/// write the same line at the same time; lines that they write in turn are handed over by messages.
pub trait MemoryWindow {
    /// The backend's error.
    type Error: WindowError;

    /// Returns the size in bytes, a multiple of four.
    fn size(&self) -> u32;

    /// Reads the word at `offset` bytes.
    ///
    /// # Errors
    /// Returns the window's error if the access fails: `OutOfBounds`, `Misaligned` or `Lost`, see the table
    /// above.
    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Self::Error>;

    /// Writes the word at `offset` bytes.
    ///
    /// # Errors
    /// Returns the window's error if the access fails: any kind in the table above.
    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Self::Error>;

    /// Returns all of the memory as little-endian words, if plain loads and stores can access it
    /// and it is coherent; otherwise `None`. A mailbox then reads its rings without a call for each
    /// word.
    ///
    /// Memory that has vanished must read as 0 for ever. Words of a window that is mapped read-only
    /// must not be stored to.
    #[inline(always)]
    fn words(&self) -> Option<WindowWords<'_>> {
        None
    }

    /// Returns true if all processors see the same memory without [`clean`](Self::clean) and
    /// [`invalidate`](Self::invalidate). The answer never changes.
    fn is_coherent(&self) -> bool {
        true
    }

    /// Writes the `len` bytes at `offset` back from this processor's cache to the memory, and
    /// returns when they are there. Does nothing for a range outside of the window.
    #[inline(always)]
    fn clean(&self, offset: u32, len: u32) {
        let _ = (offset, len);
    }

    /// Discards the `len` bytes at `offset` from this processor's cache, so that later reads come
    /// from the memory. Does nothing for a range outside of the window.
    #[inline(always)]
    fn invalidate(&self, offset: u32, len: u32) {
        let _ = (offset, len);
    }

    /// Checks an access of `len` bytes at `offset`.
    ///
    /// # Errors
    /// An error of the kind `Misaligned` or `OutOfBounds` if it is misaligned or not inside.
    fn check(&self, offset: u32, len: usize) -> Result<(), Self::Error>;

    /// Copies bytes out of the window, word by word with `Relaxed` order.
    ///
    /// Bytes that a peer writes at the same time may be old or new, word by word.
    ///
    /// # Errors
    /// Returns the window's error if an access fails: `OutOfBounds`, `Misaligned` or `Lost`, see the table
    /// above.
    fn read(&self, offset: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        self.check(offset, into.len())?;
        let mut at = offset;
        for bytes in into.chunks_mut(4) {
            let word = self.load(at, LoadOrder::Relaxed)?.to_le_bytes();
            for (byte, value) in bytes.iter_mut().zip(word) {
                *byte = value;
            }
            at = at.wrapping_add(4);
        }
        Ok(())
    }

    /// Copies bytes into the window, word by word with `Relaxed` order.
    ///
    /// The last word, if only partly covered, is read and written back whole: two writers must
    /// not share a word.
    ///
    /// # Errors
    /// Returns the window's error if an access fails: any kind in the table above.
    fn write(&self, offset: u32, from: &[u8]) -> Result<(), Self::Error> {
        self.check(offset, from.len())?;
        let mut at = offset;
        for bytes in from.chunks(4) {
            let mut word = [0; 4];
            if bytes.len() < 4 {
                word = self.load(at, LoadOrder::Relaxed)?.to_le_bytes();
            }
            for (byte, value) in word.iter_mut().zip(bytes) {
                *byte = *value;
            }
            self.store(at, u32::from_le_bytes(word), StoreOrder::Relaxed)?;
            at = at.wrapping_add(4);
        }
        Ok(())
    }

    /// Copies the first `len` bytes of words of the program's own memory into the window, slice
    /// after slice, each word with `Relaxed` order.
    ///
    /// Other contexts of the program may write these words meanwhile; each word is then old or new.
    /// If there are fewer words than `len` bytes, the rest of the window stays as it is.
    ///
    /// # Errors
    /// Returns the window's error if an access of that many bytes fails: any kind in the table above.
    fn write_words(
        &self,
        offset: u32,
        len: usize,
        from: &[&[AtomicU32]],
    ) -> Result<(), Self::Error> {
        self.check(offset, len)?;
        let count = len / 4;
        let plain = self.words().and_then(|all| {
            let (_, rest) = all.get().split_at_checked((offset / 4) as usize)?;
            rest.get(..count)
        });
        if let Some(mut to) = plain.map(<[_]>::iter) {
            for slice in from {
                for (word, to) in slice.iter().zip(&mut to) {
                    to.store(word.load(Ordering::Relaxed), Ordering::Relaxed);
                }
            }
            return Ok(());
        }
        let from = from.iter().copied().flatten();
        for (at, word) in (offset..).step_by(4).take(count).zip(from) {
            self.store(at, word.load(Ordering::Relaxed), StoreOrder::Relaxed)?;
        }
        Ok(())
    }
}

/// All words of a window as atomics, as [`MemoryWindow::words`] returns them. It is for windows
/// whose memory plain loads and stores can access.
#[derive(Clone, Copy, Debug)]
pub struct WindowWords<'w>(&'w [AtomicU32]);

impl<'w> WindowWords<'w> {
    /// Wraps all words of a window.
    ///
    /// # Safety
    /// The words are all of the memory of the window that returns them, and the window returns the
    /// same number of words each time: a caller that has once checked the number does not check it
    /// again.
    #[must_use]
    #[inline(always)]
    pub const unsafe fn new(words: &'w [AtomicU32]) -> Self {
        Self(words)
    }

    /// Returns the words of the window, in the order of their offsets.
    #[must_use]
    #[inline(always)]
    pub const fn get(self) -> &'w [AtomicU32] {
        self.0
    }

    /// Those of the `len` bytes at `offset`, as all words of a part of the window.
    #[inline(always)]
    pub(crate) fn part(self, offset: u32, len: u32) -> Option<Self> {
        let first = (offset / 4) as usize;
        let words = self.0.get(first..first.checked_add((len / 4) as usize)?)?;
        Some(Self(words))
    }
}

/// A window whose memory has an indivisible compare-and-swap, across all its processors.
///
/// # For implementers
///
/// Implement it only if the operation is indivisible for *every* processor that maps the memory. A
/// core's own exclusive access over a bus without locking is not.
pub trait CompareExchange: MemoryWindow {
    /// Writes `new` at `offset` bytes if the word there is `current`, with acquire and release
    /// order.
    ///
    /// Returns the word that was there; it equals `current` if and only if `new` was written.
    ///
    /// # Errors
    /// An error of the kind `OutOfBounds`, `Misaligned`, `ReadOnly` or `Lost`, as a store has;
    /// `NotCoherent` if the operation would act on this processor's cache only.
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, Self::Error>;
}

impl<T: Deref<Target: MemoryWindow>> MemoryWindow for T {
    type Error = <T::Target as MemoryWindow>::Error;

    fn size(&self) -> u32 {
        (**self).size()
    }

    #[inline(always)]
    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Self::Error> {
        (**self).load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Self::Error> {
        (**self).store(offset, value, order)
    }

    #[inline(always)]
    fn words(&self) -> Option<WindowWords<'_>> {
        (**self).words()
    }

    fn is_coherent(&self) -> bool {
        (**self).is_coherent()
    }

    #[inline(always)]
    fn clean(&self, offset: u32, len: u32) {
        (**self).clean(offset, len);
    }

    #[inline(always)]
    fn invalidate(&self, offset: u32, len: u32) {
        (**self).invalidate(offset, len);
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), Self::Error> {
        (**self).check(offset, len)
    }

    fn read(&self, offset: u32, into: &mut [u8]) -> Result<(), Self::Error> {
        (**self).read(offset, into)
    }

    fn write(&self, offset: u32, from: &[u8]) -> Result<(), Self::Error> {
        (**self).write(offset, from)
    }

    fn write_words(
        &self,
        offset: u32,
        len: usize,
        from: &[&[AtomicU32]],
    ) -> Result<(), Self::Error> {
        (**self).write_words(offset, len, from)
    }
}

impl<T: Deref<Target: CompareExchange>> CompareExchange for T {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, Self::Error> {
        (**self).compare_exchange(offset, current, new)
    }
}

/// Checks an access of `len` bytes at `offset` of a window of `size` bytes.
///
/// An implementation of [`MemoryWindow::check`] calls this function.
///
/// # Errors
/// [`WindowErrorKind::Misaligned`] if `offset` is not a multiple of four; [`WindowErrorKind::OutOfBounds`] if
/// the access reaches past the end of the window.
pub const fn check_access(size: u32, offset: u32, len: usize) -> Result<(), WindowErrorKind> {
    if !offset.is_multiple_of(4) {
        Err(WindowErrorKind::Misaligned)
    } else if offset > size || ((size - offset) as usize) < len {
        Err(WindowErrorKind::OutOfBounds)
    } else {
        Ok(())
    }
}

/// Checks an access to `words` words (at least one) at `offset` bytes of a window of `size` bytes;
/// `size` must be a multiple of four.
///
/// The result is that of [`check_access`] for as many bytes, in a single comparison.
///
/// # Errors
/// [`WindowErrorKind::Misaligned`] if `offset` is not a multiple of four; [`WindowErrorKind::OutOfBounds`] if
/// the access reaches past the end of the window.
#[inline(always)]
pub const fn check_words(size: u32, offset: u32, words: u32) -> Result<(), WindowErrorKind> {
    // Rotated, a misaligned offset is larger than the number of words of any window.
    if offset.rotate_right(2) as u64 + words as u64 <= (size / 4) as u64 {
        Ok(())
    } else {
        refused_words(offset)
    }
}

#[cold]
const fn refused_words(offset: u32) -> Result<(), WindowErrorKind> {
    Err(if offset.is_multiple_of(4) {
        WindowErrorKind::OutOfBounds
    } else {
        WindowErrorKind::Misaligned
    })
}

#[cfg(test)]
mod tests {
    use super::{check_access, check_words};

    #[test]
    fn a_word_is_four_bytes() {
        let near = |at: u32| (0..9).map(move |step| at.wrapping_add(step).wrapping_sub(4));
        for size in [0, 4, 8, 64, 0x8000_0000, u32::MAX - 3] {
            for offset in near(0)
                .chain(near(size))
                .chain(near(1 << 30))
                .chain(near(1 << 31))
            {
                for words in [1, 2, 4] {
                    assert_eq!(
                        check_words(size, offset, words),
                        check_access(size, offset, 4 * words as usize),
                        "{words} at {offset:#x} of {size:#x}"
                    );
                }
            }
        }
    }
}
