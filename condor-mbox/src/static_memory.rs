//! [`StaticMemory`]: a window onto memory at a fixed address, for bare metal.

use crate::sync::AtomicU32;
use crate::window::{
    AccessError, LoadOrder, MemoryWindow, StoreOrder, WindowErrorKind, WindowWords, check_access,
};

/// A block of `WORDS` words of 32 bits that several harts, or interrupts and background, share.
///
/// The block begins at a cache line. Put it in a `static`; where processors run separate programs,
/// let the linker place it at an address that they agree on, or use [`StaticWindow::from_raw`].
#[repr(C, align(64))]
#[derive(Debug)]
pub struct StaticMemory<const WORDS: usize> {
    words: [AtomicU32; WORDS],
}

impl<const WORDS: usize> StaticMemory<WORDS> {
    /// Makes a block that holds zeros.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            words: [const { AtomicU32::new(0) }; WORDS],
        }
    }

    /// Returns a window onto the whole block.
    #[must_use]
    pub const fn window(&self) -> StaticWindow<'_> {
        StaticWindow { words: &self.words }
    }
}

impl<const WORDS: usize> Default for StaticMemory<WORDS> {
    fn default() -> Self {
        Self::new()
    }
}

/// A window onto memory that stays at its address for `'a`, such as a [`StaticMemory`].
///
/// The window has [`CompareExchange`](crate::window::CompareExchange) if the target has it. The
/// user must know whether that is indivisible for *all* processors that share the memory.
#[derive(Clone, Copy, Debug)]
pub struct StaticWindow<'a> {
    words: &'a [AtomicU32],
}

impl StaticWindow<'_> {
    /// Makes a window onto the `bytes` bytes at `address`; an incomplete last word is left out.
    ///
    /// # Safety
    ///
    /// During `'a`, and for all `bytes`:
    ///
    /// * `address` is not null, is a multiple of four, and the range lies in one piece of
    ///   memory that can be read and written: RAM, not device registers, since the compiler
    ///   may repeat, merge or add loads;
    /// * every access by this program goes through such windows, or is otherwise a 32-bit
    ///   atomic access;
    /// * other processors access it by 32-bit words only, and caches that are not coherent
    ///   with theirs are off for it.
    #[must_use]
    pub const unsafe fn from_raw(address: *mut u32, bytes: u32) -> Self {
        // SAFETY: the caller vouches for `bytes` of readable and writable memory at an aligned
        // address that only atomics touch during `'a`; `AtomicU32` is laid out as `u32`.
        let words = unsafe {
            core::slice::from_raw_parts(address.cast::<AtomicU32>(), (bytes / 4) as usize)
        };
        Self { words }
    }

    #[inline(always)]
    fn word(&self, offset: u32) -> Result<&AtomicU32, AccessError> {
        match self.words.get((offset / 4) as usize) {
            Some(word) if offset.is_multiple_of(4) => Ok(word),
            _ => Err(self.refused(offset)),
        }
    }

    #[cold]
    fn refused(&self, offset: u32) -> AccessError {
        let kind = if offset.is_multiple_of(4) {
            WindowErrorKind::OutOfBounds
        } else {
            WindowErrorKind::Misaligned
        };
        self.error(offset, 4, kind)
    }

    fn error(&self, offset: u32, len: usize, kind: WindowErrorKind) -> AccessError {
        AccessError::new(offset, len, self.size(), kind)
    }
}

impl MemoryWindow for StaticWindow<'_> {
    type Error = AccessError;

    fn size(&self) -> u32 {
        // Offsets reach no further than the last whole word below 4 GiB.
        const MOST: usize = (u32::MAX / 4) as usize;
        (self.words.len().min(MOST) as u32) * 4
    }

    #[inline(always)]
    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        let word = self.word(offset)?;
        // Pairs with whichever `store` the user of the window names.
        Ok(u32::from_le(word.load(order.into())))
    }

    #[inline(always)]
    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        let word = self.word(offset)?;
        // Pairs with whichever `load` the user of the window names.
        word.store(value.to_le(), order.into());
        Ok(())
    }

    #[inline(always)]
    fn words(&self) -> Option<WindowWords<'_>> {
        // SAFETY: they are all, and never change.
        cfg!(target_endian = "little").then(|| unsafe { WindowWords::new(self.words) })
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        check_access(self.size(), offset, len).map_err(|kind| self.error(offset, len, kind))
    }
}

#[cfg(target_has_atomic = "32")]
impl crate::window::CompareExchange for StaticWindow<'_> {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, AccessError> {
        use crate::sync::Ordering;
        // Pairs with the same operation and with loads and stores of the word elsewhere.
        let (Ok(found) | Err(found)) = self.word(offset)?.compare_exchange(
            current.to_le(),
            new.to_le(),
            Ordering::AcqRel,
            Ordering::Acquire,
        );
        Ok(u32::from_le(found))
    }
}
