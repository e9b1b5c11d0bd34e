//! [`MemoryWindow`]: a range of a processor's memory, reached by checked offset.

use core::fmt::Debug;
use core::ops::Deref;
use core::sync::atomic::Ordering;

/// The order of a load relative to the accesses around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadOrder {
    /// No order; only the word itself is read whole.
    Relaxed,
    /// What the writer of the word stored before its `Release` store is seen after this load.
    Acquire,
}

/// The order of a store relative to the accesses around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreOrder {
    /// No order; only the word itself is written whole.
    Relaxed,
    /// Everything before this store is seen by whoever reads the word with `Acquire`.
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

/// One load of [`MemoryWindow::load_steps`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadStep {
    /// Which of the four words: 0 to 3, else modulo 4.
    pub word: u32,
    /// The order of the load.
    pub order: LoadOrder,
    /// What was found.
    pub value: u32,
}

/// One store of [`MemoryWindow::store_steps`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreStep {
    /// Which of the four words: 0 to 3, else modulo 4.
    pub word: u32,
    /// The order of the store.
    pub order: StoreOrder,
    /// What is stored.
    pub value: u32,
}

/// What is wrong with an access, for code that is generic over windows.
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
}

/// An error of a window; every backend brings its own.
pub trait WindowError: Debug {
    /// The kind that generic code can act on.
    fn kind(&self) -> WindowErrorKind;
}

/// A range of a processor's memory that others may read or write at any time.
///
/// # For users
///
/// Words are 32 bits, little-endian, at offsets that are multiples of four. There is never a
/// Rust reference into the memory: what is read is a copy, which the peer cannot change
/// afterwards. Two objects make up a processor: its `mail`, which only it writes, and its
/// `data`, which everybody writes.
///
/// | access | inside | partly or wholly outside | misaligned | mapped read-only | memory gone |
/// |---|---|---|---|---|---|
/// | `load` | the word | `OutOfBounds` | `Misaligned` | the word | `Lost` |
/// | `store` | done | `OutOfBounds` | `Misaligned` | `ReadOnly` | `Lost` |
/// | `read`, `write` of *n* > 0 bytes | all *n* | `OutOfBounds`, nothing copied | `Misaligned`, nothing copied | `write`: `ReadOnly` | `Lost`, a prefix may have been copied |
/// | `read`, `write` of 0 bytes at an aligned offset ≤ `size` | nothing | `OutOfBounds` | `Misaligned` | nothing | nothing |
///
/// # For implementers
///
/// `load` and `store` must be single 32-bit atomic accesses with the given order; all accesses
/// to the memory go through such words, because mixed-size atomic accesses are undefined
/// behaviour. The provided `read` and `write` do so; override them only to be faster. An
/// access to memory that has gone must return `Lost`, never a signal or a trap. `size` never
/// changes. Call [`conformance::window`](conformance/fn.window.html) from one test.
pub trait MemoryWindow {
    /// The backend's error.
    type Error: WindowError;

    /// Size in bytes, a multiple of four.
    fn size(&self) -> u32;

    /// Reads the word at `offset` bytes.
    ///
    /// # Errors
    /// See the table above.
    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Self::Error>;

    /// Writes the word at `offset` bytes.
    ///
    /// # Errors
    /// See the table above.
    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Self::Error>;

    /// Reads words of the four at `offset`, one after the other, each as [`load`](Self::load)
    /// would, and puts them into `steps`.
    ///
    /// For implementers: override it, and [`store_steps`](Self::store_steps), where one look at
    /// whether the memory is there will do for all of them. A message is a few of these.
    ///
    /// # Errors
    /// As `load` of all four words; the values in `steps` are then nothing to go by.
    #[inline(always)]
    fn load_steps(&self, offset: u32, steps: &mut [LoadStep]) -> Result<(), Self::Error> {
        self.check(offset, 16)?;
        for step in steps {
            step.value = self.load(nth_word(offset, step.word), step.order)?;
        }
        Ok(())
    }

    /// Writes words of the four at `offset`, one after the other, each as [`store`](Self::store)
    /// would.
    ///
    /// # Errors
    /// As `store` of all four words; after `Lost` some may have been written.
    #[inline(always)]
    fn store_steps(&self, offset: u32, steps: &[StoreStep]) -> Result<(), Self::Error> {
        self.check(offset, 16)?;
        for step in steps {
            self.store(nth_word(offset, step.word), step.value, step.order)?;
        }
        Ok(())
    }

    /// The error for an access of `len` bytes at `offset`, if it is misaligned or not inside.
    ///
    /// # Errors
    /// `Misaligned` or `OutOfBounds`.
    fn check(&self, offset: u32, len: usize) -> Result<(), Self::Error>;

    /// Copies bytes out of the window, word by word with `Relaxed` order.
    ///
    /// Bytes that a peer writes at the same time may be old or new, word by word.
    ///
    /// # Errors
    /// See the table above.
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
    /// See the table above.
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
}

/// A window whose memory has an indivisible compare-and-swap, across all its processors.
///
/// # For implementers
///
/// Implement it only where the operation is indivisible for *every* processor that maps the
/// memory; a core's own exclusive access over a bus without locking is not.
pub trait CompareExchange: MemoryWindow {
    /// Writes `new` at `offset` if the word there is `current`; with acquire and release order.
    ///
    /// Gives the word that was there: equal to `current` if and only if `new` was written.
    ///
    /// # Errors
    /// As [`MemoryWindow::store`].
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

    fn load_steps(&self, offset: u32, steps: &mut [LoadStep]) -> Result<(), Self::Error> {
        (**self).load_steps(offset, steps)
    }

    fn store_steps(&self, offset: u32, steps: &[StoreStep]) -> Result<(), Self::Error> {
        (**self).store_steps(offset, steps)
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
}

impl<T: Deref<Target: CompareExchange>> CompareExchange for T {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, Self::Error> {
        (**self).compare_exchange(offset, current, new)
    }
}

/// The offset of the word of a step.
const fn nth_word(offset: u32, word: u32) -> u32 {
    offset.wrapping_add(4 * (word % 4))
}

/// The kind of error for an access of `len` bytes at `offset` of a window of `size` bytes.
///
/// Backends build [`MemoryWindow::check`] on it.
///
/// # Errors
/// `Misaligned` or `OutOfBounds`.
pub const fn check_access(size: u32, offset: u32, len: usize) -> Result<(), WindowErrorKind> {
    if !offset.is_multiple_of(4) {
        Err(WindowErrorKind::Misaligned)
    } else if offset > size || ((size - offset) as usize) < len {
        Err(WindowErrorKind::OutOfBounds)
    } else {
        Ok(())
    }
}

/// The kind of error for an access to `words` words at `offset` of a window of `size` bytes, both
/// sizes multiples of four, and at least one word.
///
/// Says the same as [`check_access`] of so many bytes, in a single comparison.
///
/// # Errors
/// `Misaligned` or `OutOfBounds`.
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
