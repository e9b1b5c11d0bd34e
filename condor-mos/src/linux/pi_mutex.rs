//! [`PiMutex`]: a value and its lock.

use core::cell::UnsafeCell;
use core::ops::{Deref, DerefMut};

use condor_platform::linux::PiLock;

/// A value that one thread at a time uses, with priority inheritance.
#[derive(Debug)]
pub(super) struct PiMutex<T> {
    lock: PiLock,
    value: UnsafeCell<T>,
}

// SAFETY: the value is reached by whoever holds `lock` alone.
unsafe impl<T: Send> Sync for PiMutex<T> {}

impl<T> PiMutex<T> {
    pub(super) const fn new(value: T) -> Self {
        Self {
            lock: PiLock::new(),
            value: UnsafeCell::new(value),
        }
    }

    /// Waits for the value. The calling thread must not have it: it would wait for itself.
    #[inline]
    pub(super) fn lock(&self) -> PiGuard<'_, T> {
        self.lock.lock();
        PiGuard { mutex: self }
    }
}

#[derive(Debug)]
pub(super) struct PiGuard<'m, T> {
    mutex: &'m PiMutex<T>,
}

impl<T> Deref for PiGuard<'_, T> {
    type Target = T;

    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: the guard's thread holds the lock.
        unsafe { &*self.mutex.value.get() }
    }
}

impl<T> DerefMut for PiGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: the guard's thread holds the lock, and the guard is borrowed alone.
        unsafe { &mut *self.mutex.value.get() }
    }
}

impl<T> Drop for PiGuard<'_, T> {
    #[inline]
    fn drop(&mut self) {
        self.mutex.lock.unlock();
    }
}
