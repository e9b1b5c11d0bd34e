//! Locks of one word, for memory with an indivisible read and write.

use core::ops::Deref;

use crate::exclusion::Exclusion;
use crate::sync::{Ordering, fence};
use crate::window::{
    AccessError, CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind,
};

use super::owner::{Incarnations, LockOwner};
use super::{Attempt, TestAndSet};

/// A lock that is one word of shared memory, and is taken by compare-and-swap.
#[derive(Clone, Copy, Debug)]
pub struct NativeSwap<W> {
    window: W,
    at: u32,
}

impl<W: CompareExchange> NativeSwap<W> {
    /// Makes a handle of the lock that is the word at `offset` bytes of `window`.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the word is not inside the window, of the kind
    /// `Misaligned` if `offset` is not a multiple of four, or of the kind `NotCoherent` if the
    /// memory needs a [`Bakery`](super::Bakery) or a [`SemaphoreSwap`].
    pub fn new(window: W, offset: u32) -> Result<Self, AccessError> {
        AccessError::check(&window, offset, 4)?;
        if !window.is_coherent() {
            let kind = WindowErrorKind::NotCoherent;
            return Err(AccessError::new(offset, 4, window.size(), kind));
        }
        Ok(Self { window, at: offset })
    }
}

impl<W: CompareExchange> TestAndSet for NativeSwap<W> {
    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        _: &dyn Incarnations,
    ) -> Result<Attempt, WindowErrorKind> {
        let from = LockOwner::to_word(from);
        // Pairs with the same operation in `release`, by whoever had the lock.
        let found = self
            .window
            .compare_exchange(self.at, from, LockOwner::to_word(Some(me)))
            .map_err(|error| error.kind())?;
        Ok(Attempt::of(found, from))
    }

    fn release(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        // Pairs with the same operation in `take`, by whoever gets the lock.
        self.window
            .compare_exchange(self.at, LockOwner::to_word(Some(me)), 0)
            .map(|_| ())
            .map_err(|error| error.kind())
    }
}

/// A hardware semaphore, which one processor can hold at a time.
///
/// # For implementers
///
/// The semaphore is held for a handful of instructions. A program that resets a processor must also free the
/// semaphores that the processor held (such hardware records the holder): until then, locks that
/// use the semaphore are busy.
pub trait HardwareSemaphore {
    /// Takes the semaphore if it is free; returns true if it was taken. If this processor holds it
    /// already, the result may be either.
    fn try_take(&self) -> bool;

    /// Frees the semaphore, which this processor holds.
    fn give(&self);
}

impl<T: Deref<Target: HardwareSemaphore>> HardwareSemaphore for T {
    fn try_take(&self) -> bool {
        (**self).try_take()
    }

    fn give(&self) {
        (**self).give();
    }
}

/// A lock that is one word of shared memory, and is read and written while a hardware semaphore is
/// held.
///
/// The semaphore is held for a few instructions only, so that one semaphore serves any number of
/// locks. The [`Exclusion`] keeps the other contexts of this processor out meanwhile.
#[derive(Clone, Copy, Debug)]
pub struct SemaphoreSwap<W, S, X> {
    window: W,
    at: u32,
    semaphore: S,
    exclusion: X,
}

/// The number of times that a busy semaphore is asked for before the lock counts as busy.
const SEMAPHORE_TRIES: u32 = 64;

impl<W: MemoryWindow, S: HardwareSemaphore, X: Exclusion> SemaphoreSwap<W, S, X> {
    /// Makes a handle of the lock that is the word at `offset` bytes of `window`. All processors
    /// must access the word under the same `semaphore`.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the word is not inside the window, or of the
    /// kind `Misaligned` if `offset` is not a multiple of four.
    pub fn new(window: W, offset: u32, semaphore: S, exclusion: X) -> Result<Self, AccessError> {
        AccessError::check(&window, offset, 4)?;
        Ok(Self {
            window,
            at: offset,
            semaphore,
            exclusion,
        })
    }

    /// Writes `new` if the word is `current`; returns the word that was there, or `None` if the semaphore
    /// stayed busy.
    fn swap(&self, current: u32, new: u32) -> Result<Option<u32>, W::Error> {
        self.exclusion.with(|| {
            for _ in 0..SEMAPHORE_TRIES {
                if self.semaphore.try_take() {
                    // The semaphore orders nothing by itself: the fences keep all that its
                    // holder does between taking and giving it.
                    fence(Ordering::SeqCst);
                    let found = self.swap_alone(current, new);
                    fence(Ordering::SeqCst);
                    self.semaphore.give();
                    return found.map(Some);
                }
                core::hint::spin_loop();
            }
            Ok(None)
        })
    }

    fn swap_alone(&self, current: u32, new: u32) -> Result<u32, W::Error> {
        // Pairs with the store below, by whoever held the semaphore before.
        let found = self.window.load(self.at, LoadOrder::Acquire)?;
        if found == current {
            // Pairs with the load above and with that of `release`.
            self.window.store(self.at, new, StoreOrder::Release)?;
        }
        Ok(found)
    }
}

impl<W: MemoryWindow, S: HardwareSemaphore, X: Exclusion> TestAndSet for SemaphoreSwap<W, S, X> {
    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        _: &dyn Incarnations,
    ) -> Result<Attempt, WindowErrorKind> {
        let from = LockOwner::to_word(from);
        match self.swap(from, LockOwner::to_word(Some(me))) {
            Ok(Some(found)) => Ok(Attempt::of(found, from)),
            Ok(None) => Ok(Attempt::Behind(None)),
            Err(error) => Err(error.kind()),
        }
    }

    fn release(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        // No semaphore: while a living owner's word is there, nobody else writes it.
        self.window
            .load(self.at, LoadOrder::Relaxed)
            .and_then(|found| {
                if found == LockOwner::to_word(Some(me)) {
                    // Pairs with the load of `swap_alone`, by whoever gets the lock.
                    self.window.store(self.at, 0, StoreOrder::Release)
                } else {
                    Ok(())
                }
            })
            .map_err(|error| error.kind())
    }
}
