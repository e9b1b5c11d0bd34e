//! [`ClaimCell`]: a value that one context at a time can claim, without waiting.

use core::cell::UnsafeCell;
use core::marker::PhantomData;
use core::ops::{Deref, DerefMut};
use core::sync::atomic::{AtomicBool, Ordering};

/// A value in a `static` that one context at a time claims, uses and releases. While it is claimed, a claim by another
/// context fails at once; nothing waits.
///
/// ```
/// use condor_dev::ClaimCell;
///
/// static COUNT: ClaimCell<u32> = ClaimCell::new(1);
///
/// let mut first = COUNT.claim().unwrap();
/// *first += 1;
/// assert!(COUNT.claim().is_none());
/// drop(first);
/// assert_eq!(*COUNT.claim().unwrap(), 2);
/// ```
pub struct ClaimCell<T> {
    claimed: AtomicBool,
    value: UnsafeCell<T>,
}

// SAFETY: a reference to the value is made by `ClaimGuard` alone, of which `claim` lets one exist.
unsafe impl<T: Send> Sync for ClaimCell<T> {}

impl<T> ClaimCell<T> {
    /// Makes a cell with `value` in it, which no context has claimed.
    #[must_use]
    pub const fn new(value: T) -> Self {
        Self {
            claimed: AtomicBool::new(false),
            value: UnsafeCell::new(value),
        }
    }

    /// Claims the value, until the result is dropped; returns `None` at once if another context has claimed it.
    pub fn claim(&self) -> Option<ClaimGuard<'_, T>> {
        let free = critical_section::with(|_| {
            // Acquire: pairs with the Release store of `ClaimGuard::drop`. In a critical section
            // nobody comes between load and store, on processors without compare-and-swap too.
            let free = !self.claimed.load(Ordering::Acquire);
            if free {
                self.claimed.store(true, Ordering::Relaxed);
            }
            free
        });
        // Made only if it is free: even one that is dropped at once releases the value.
        free.then(|| ClaimGuard {
            claim: self,
            value: PhantomData,
        })
    }
}

/// The claimed value of a [`ClaimCell`], used like a reference. Dropping it ends the claim.
///
/// ```compile_fail,E0277
/// use core::cell::Cell;
/// use condor_dev::ClaimCell;
///
/// static COUNT: ClaimCell<Cell<u32>> = ClaimCell::new(Cell::new(1));
///
/// let first = COUNT.claim().unwrap();
/// // Two threads would use the `Cell` at the same time.
/// std::thread::scope(|scope| scope.spawn(|| first.set(2)).join().unwrap());
/// ```
pub struct ClaimGuard<'c, T> {
    claim: &'c ClaimCell<T>,
    /// Shared with another context only if `T` may be.
    value: PhantomData<&'c mut T>,
}

impl<T> Deref for ClaimGuard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: `claim` made this the only `ClaimGuard` until it is dropped.
        unsafe { &*self.claim.value.get() }
    }
}

impl<T> DerefMut for ClaimGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above; and `self` is borrowed as long as the reference exists.
        unsafe { &mut *self.claim.value.get() }
    }
}

impl<T> Drop for ClaimGuard<'_, T> {
    fn drop(&mut self) {
        // Release: pairs with the Acquire load in `claim`.
        self.claim.claimed.store(false, Ordering::Release);
    }
}
