//! [`PiMutex`], and [`InheritanceLock`], which is made of it.

use core::cell::UnsafeCell;
use core::ops::{Deref, DerefMut};

use condor_platform::linux::PiLock;

use super::threads::Threads;
use crate::error::LockError;
use crate::scheduler::LoopId;

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

/// A value shared by loops of [`Threads`] and others; reads as a
/// [`CeilingLock`](crate::CeilingLock), which is for loops on one stack.
///
/// A loop waits while another thread uses the value. Whoever uses it runs with the priority of the
/// fastest loop that waits (priority inheritance), so only users of this value delay a loop.
///
/// ```
/// use condor_mos::linux::{InheritanceLock, RealTime, Threads};
/// use condor_mos::{LoopId, Rate};
///
/// const SERVO: LoopId = LoopId(0);
/// static TARGET: InheritanceLock<i32> = InheritanceLock::new(&[SERVO], 0);
///
/// let threads = Threads::new([Rate::hz(400)], RealTime::none())?;
/// TARGET.lock(&threads, |target| *target = 7)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct InheritanceLock<T>(PiMutex<T>);

impl<T> InheritanceLock<T> {
    /// A lock. The users need not be known between threads; who names them can run the same loops
    /// on one stack.
    #[must_use]
    pub const fn new(_users: &[LoopId], value: T) -> Self {
        Self(PiMutex::new(value))
    }

    /// Uses the value, once no other thread does.
    ///
    /// # Errors
    /// [`LockError::Taken`] if the calling thread uses it already.
    pub fn lock<const L: usize, R>(
        &self,
        _threads: &Threads<L>,
        f: impl FnOnce(&mut T) -> R,
    ) -> Result<R, LockError> {
        if self.0.lock.is_mine() {
            return Err(LockError::Taken);
        }
        Ok(f(&mut self.0.lock()))
    }

    /// The value, for whoever owns the lock.
    pub fn get_mut(&mut self) -> &mut T {
        self.0.value.get_mut()
    }
}
