//! [`Region`] and [`Offset`]: long data in shared memory, named by checked offsets.

use core::fmt;
use core::marker::PhantomData;
use core::sync::atomic::AtomicU32;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::layout::{BELL_BYTES, LINE};
use crate::published::Published;
use crate::window::{
    AccessError, CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError,
    WindowErrorKind, WindowWords, check_access,
};

/// A part of a window, with offsets that count from its own beginning.
///
/// A region is itself a [`MemoryWindow`]: words by [`load`](MemoryWindow::load) and
/// [`store`](MemoryWindow::store), bytes by [`read`](MemoryWindow::read) and
/// [`write`](MemoryWindow::write). Long data is passed by writing it to a region and sending its
/// offset; both sides must count from the same beginning, usually that of [`Region::users`].
/// Nothing is locked: a copy that is made while a peer writes is a mixture, word by word, unless a
/// message, a [`Published`] cell or a [`SpinLock`](crate::SpinLock) orders the two.
///
/// Section 3.4 of A.I. Memo 977 maps the memory of every processor into every other one;
/// `processor3_ram[100] = value` in an array of words there is
/// `processor3_ram.set_word(4 * 100, value)?` here, where every offset is in bytes.
///
/// ```
/// # use condor_mbox::{AccessError, MemoryWindow, Offset, Allocator, Region, StaticMemory};
/// use zerocopy::{FromBytes, Immutable, IntoBytes};
///
/// #[derive(FromBytes, IntoBytes, Immutable)]
/// #[repr(C)]
/// struct Gains {
///     stiffness: [f32; 3],
///     damping: f32,
/// }
///
/// static MEMORY: StaticMemory<256> = StaticMemory::new();
///
/// # fn main() -> Result<(), AccessError> {
/// let processor3_ram = Region::users(MEMORY.window())?;
/// processor3_ram.set_word(4 * 100, 977)?;
///
/// let mut allocator = Allocator::new(processor3_ram.size());
/// allocator.bytes(4 * 101)?;
/// let gains: Offset<Gains> = allocator.place()?;
/// processor3_ram.set(gains, &Gains { stiffness: [1.0; 3], damping: 0.5 })?;
///
/// // The offset is what a message carries; its receiver need not trust it.
/// let message: u32 = gains.offset();
/// let received = processor3_ram.get(Offset::<Gains>::at(message))?;
/// assert_eq!(received.damping.to_bits(), 0.5_f32.to_bits());
/// assert!(processor3_ram.get(Offset::<Gains>::at(u32::MAX - 3)).is_err());
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Region<W> {
    window: W,
    start: u32,
    size: u32,
}

impl<W: MemoryWindow> Region<W> {
    /// Returns the *users' region* of a processor's `data`, the part that is for programs:
    /// everything after the first 64 bytes, which belong to the doorbell.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the window is smaller than 64 bytes.
    pub fn users(data: W) -> Result<Self, AccessError> {
        let size = data.size();
        let Some(rest) = size.checked_sub(BELL_BYTES) else {
            let kind = WindowErrorKind::OutOfBounds;
            return Err(AccessError::new(0, BELL_BYTES as usize, size, kind));
        };
        Ok(Self {
            window: data,
            start: BELL_BYTES,
            size: rest,
        })
    }

    /// Returns a region that is the whole of `window`. Use it for windows without a doorbell at
    /// their beginning.
    pub fn whole(window: W) -> Self {
        let size = window.size();
        Self {
            window,
            start: 0,
            size,
        }
    }

    /// Returns the `len` bytes from `offset` on as a region of their own; `len` must be a multiple
    /// of four.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `Misaligned` if `offset` or `len` is not a multiple of four, or
    /// `OutOfBounds` if the part is not inside.
    pub fn part(&self, offset: u32, len: u32) -> Result<Self, AccessError>
    where
        W: Clone,
    {
        self.inside(offset, len as usize)?;
        if !len.is_multiple_of(4) {
            return Err(self.error(offset, len as usize, WindowErrorKind::Misaligned));
        }
        Ok(Self {
            window: self.window.clone(),
            start: self.at(offset),
            size: len,
        })
    }

    /// Returns the word at `offset` bytes, with acquire order: if another processor wrote it by
    /// [`set_word`](Self::set_word), everything that it wrote before is visible, too.
    ///
    /// # Errors
    /// [`AccessError`] if the offset is misaligned or not inside the region, or if the memory is
    /// gone.
    pub fn word(&self, offset: u32) -> Result<u32, AccessError> {
        // Pairs with the store of `set_word`, by whichever processor.
        self.load(offset, LoadOrder::Acquire)
    }

    /// Writes `value` to the word at `offset` bytes, with release order: a processor that reads it
    /// by [`word`](Self::word) also sees everything that was written before.
    ///
    /// # Errors
    /// [`AccessError`] if the offset is misaligned or not inside the region, if the window is
    /// read-only, or if the memory is gone.
    pub fn set_word(&self, offset: u32, value: u32) -> Result<(), AccessError> {
        // Pairs with the load of `word`.
        self.store(offset, value, StoreOrder::Release)
    }

    /// Returns a copy of the value that lies at `place`.
    ///
    /// # Errors
    /// [`AccessError`] if the place is misaligned or not wholly inside the region (an offset that
    /// came in a message may be any number), or if the memory is gone.
    pub fn get<T: FromBytes + IntoBytes>(&self, offset: Offset<T>) -> Result<T, AccessError> {
        let mut value = T::new_zeroed();
        self.read(offset.offset, value.as_mut_bytes())?;
        Ok(value)
    }

    /// Copies `value` to `place` in the region.
    ///
    /// # Errors
    /// [`AccessError`] if the place is misaligned or not wholly inside the region, if the window is
    /// read-only, or if the memory is gone.
    pub fn set<T: IntoBytes + Immutable>(
        &self,
        offset: Offset<T>,
        value: &T,
    ) -> Result<(), AccessError> {
        self.write(offset.offset, value.as_bytes())
    }

    fn inside(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        check_access(self.size, offset, len).map_err(|kind| self.error(offset, len, kind))
    }

    /// The window's offset; it cannot wrap once `offset` is known to be inside.
    fn at(&self, offset: u32) -> u32 {
        self.start.wrapping_add(offset)
    }

    fn error(&self, offset: u32, len: usize, kind: WindowErrorKind) -> AccessError {
        AccessError::new(offset, len, self.size, kind)
    }
}

impl<W: MemoryWindow> MemoryWindow for Region<W> {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.size
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.inside(offset, 4)?;
        self.window
            .load(self.at(offset), order)
            .map_err(|error| self.error(offset, 4, error.kind()))
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.inside(offset, 4)?;
        self.window
            .store(self.at(offset), value, order)
            .map_err(|error| self.error(offset, 4, error.kind()))
    }

    #[inline(always)]
    fn words(&self) -> Option<WindowWords<'_>> {
        self.window.words()?.part(self.start, self.size)
    }

    fn is_coherent(&self) -> bool {
        self.window.is_coherent()
    }

    fn clean(&self, offset: u32, len: u32) {
        if self.inside(offset, len as usize).is_ok() {
            self.window.clean(self.at(offset), len);
        }
    }

    fn invalidate(&self, offset: u32, len: u32) {
        if self.inside(offset, len as usize).is_ok() {
            self.window.invalidate(self.at(offset), len);
        }
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.inside(offset, len)
    }

    fn read(&self, offset: u32, into: &mut [u8]) -> Result<(), AccessError> {
        self.inside(offset, into.len())?;
        self.window
            .read(self.at(offset), into)
            .map_err(|error| self.error(offset, into.len(), error.kind()))
    }

    fn write(&self, offset: u32, from: &[u8]) -> Result<(), AccessError> {
        self.inside(offset, from.len())?;
        self.window
            .write(self.at(offset), from)
            .map_err(|error| self.error(offset, from.len(), error.kind()))
    }

    fn write_words(
        &self,
        offset: u32,
        len: usize,
        from: &[&[AtomicU32]],
    ) -> Result<(), AccessError> {
        self.inside(offset, len)?;
        self.window
            .write_words(self.at(offset), len, from)
            .map_err(|error| self.error(offset, len, error.kind()))
    }
}

impl<W: CompareExchange> CompareExchange for Region<W> {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, AccessError> {
        self.inside(offset, 4)?;
        self.window
            .compare_exchange(self.at(offset), current, new)
            .map_err(|error| self.error(offset, 4, error.kind()))
    }
}

/// The offset of a value of type `T` in a region, in bytes.
///
/// An offset proves nothing: every access through it is checked. So it may be made from an offset
/// that came in a message, or be part of a table of addresses known at compile time. A `T` may have
/// any alignment in Rust; in a region it begins at a multiple of four bytes. `T`'s numbers are
/// stored as the processor stores them, that is little-endian on every target of this crate; use
/// the little-endian types of `zerocopy` on any other.
pub struct Offset<T> {
    offset: u32,
    of: PhantomData<fn() -> T>,
}

impl<T> Offset<T> {
    /// Makes the offset of a `T` that lies `offset` bytes after the beginning of a region.
    #[must_use]
    pub const fn at(offset: u32) -> Self {
        Self {
            offset,
            of: PhantomData,
        }
    }

    /// Returns the number of bytes from the beginning of the region. A message about the value
    /// carries this number.
    #[must_use]
    pub const fn offset(self) -> u32 {
        self.offset
    }
}

impl<T> Clone for Offset<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Offset<T> {}

impl<T> PartialEq for Offset<T> {
    fn eq(&self, other: &Self) -> bool {
        self.offset == other.offset
    }
}

impl<T> Eq for Offset<T> {}

impl<T> fmt::Debug for Offset<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Place").field(&self.offset).finish()
    }
}

/// Distributes a region's memory piece by piece (a *place* is the offset of such a piece); each
/// place begins at a cache line of its own.
///
/// A program has one allocator for its own memory, and lends it to every part that needs memory; so
/// these parts never overlap. On Linux a claim provides it (`linux::Claim::places`); on bare metal
/// the board does. Two programs that take the same places in the same order get the same offsets;
/// this also works at compile time.
///
/// ```
/// use condor_mbox::{Allocator, Offset};
///
/// let mut allocator = Allocator::new(4096);
/// let gains: Offset<[f32; 4]> = allocator.place()?;
/// let log = allocator.bytes(1024)?;
/// assert_eq!((gains.offset(), log), (0, 64));
/// assert!(allocator.bytes(4096).is_err());
/// # Ok::<_, condor_mbox::AccessError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Allocator {
    next: u32,
    size: u32,
}

impl Allocator {
    /// Makes an allocator for a region of `size` bytes, of which nothing has been taken.
    #[must_use]
    pub const fn new(size: u32) -> Self {
        Self { next: 0, size }
    }

    /// Returns the offset at which the next place will be taken, in bytes from the beginning of the
    /// region.
    #[must_use]
    pub const fn used(&self) -> u32 {
        self.next
    }

    /// Takes room for a value of type `T`, and returns its offset.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn place<T>(&mut self) -> Result<Offset<T>, AccessError> {
        match self.bytes(size_of::<T>()) {
            Ok(offset) => Ok(Offset::at(offset)),
            Err(error) => Err(error),
        }
    }

    /// Takes room for a latest-value cell of type `T`, and returns the cell.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn published<T>(&mut self) -> Result<Published<T>, AccessError> {
        match self.bytes(Published::<T>::BYTES as usize) {
            Ok(offset) => Ok(Published::at(offset)),
            Err(error) => Err(error),
        }
    }

    /// Takes room for `len` bytes, and returns the offset of the first one, in bytes from the
    /// beginning of the region.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn bytes(&mut self, len: usize) -> Result<u32, AccessError> {
        let offset = self.next;
        if let Err(kind) = check_access(self.size, offset, len) {
            return Err(AccessError::new(offset, len, self.size, kind));
        }
        // A block that does not fit in a `u32` has failed the check.
        let end = offset.wrapping_add(len as u32);
        self.next = match end.checked_next_multiple_of(LINE) {
            Some(next) if next < self.size => next,
            _ => self.size,
        };
        Ok(offset)
    }
}
