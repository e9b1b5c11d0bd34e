//! [`Masked`]: memory that is reached only while nothing can interrupt.

use core::cell::UnsafeCell;

use critical_section::CriticalSection;

/// A value that the contexts of one processor share: each use is part of a critical section.
#[derive(Debug)]
pub(crate) struct Masked<T>(UnsafeCell<T>);

// SAFETY: the value is reached through `with` alone, one context at a time.
unsafe impl<T: Send> Sync for Masked<T> {}

impl<T> Masked<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(UnsafeCell::new(value))
    }

    /// Uses the value. `f` must not call a program's code, which could come back here.
    #[inline]
    pub(crate) fn with<R>(&self, _section: CriticalSection<'_>, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: no other context is inside a critical section at the same time, and this one
        // is not here twice: the closures of this crate call nothing but this crate's own code.
        f(unsafe { &mut *self.0.get() })
    }
}
