//! [`CeilingLock`]: data that loops of one processor share.

use crate::error::LockError;
use crate::masked::{Masked, section};
use crate::platform::Platform;
use crate::record::Keep;
use crate::scheduler::{LoopId, Scheduler};
use crate::sync::{UnsafeCell, const_unless_loom};

/// A value shared by some loops and the background: while one of them uses it, none of the others
/// starts. Faster loops, which do not use it, are not delayed.
///
/// This is the immediate priority ceiling protocol (L. Sha, R. Rajkumar, J. P. Lehoczky, "Priority
/// inheritance protocols", IEEE Transactions on Computers 39(9), 1990): nobody ever waits for
/// the lock, nothing deadlocks, and a loop is delayed by at most one slower user, before it starts.
pub struct CeilingLock<T> {
    /// A bit for each loop that may use it.
    users: u32,
    taken: Masked<bool>,
    value: UnsafeCell<T>,
}

// SAFETY: `value` is used by one context at a time, which has set `taken` in a critical section.
unsafe impl<T: Send> Sync for CeilingLock<T> {}

impl<T> CeilingLock<T> {
    const_unless_loom! {
        /// A lock for the loops of `users`, and the background.
        #[must_use]
        pub const fn new(users: &[LoopId], value: T) -> Self {
            let mut bits = 0;
            let mut at = 0;
            while at < users.len() {
                bits |= 1_u32.unbounded_shl(users[at].0 as u32);
                at += 1;
            }
            Self {
                users: bits,
                taken: Masked::new(false),
                value: UnsafeCell::new(value),
            }
        }
    }

    /// Uses the value; meanwhile no loop starts that is not faster than all users.
    ///
    /// # Errors
    /// [`LockError::Undeclared`] from a loop that is faster than all users;
    /// [`LockError::Taken`] if the lock is taken, which correct use does not meet.
    pub fn lock<P: Platform, const L: usize, const E: usize, K: Keep, R>(
        &self,
        scheduler: &Scheduler<P, L, E, K>,
        f: impl FnOnce(&mut T) -> R,
    ) -> Result<R, LockError> {
        let former = section(|section| {
            if self.taken.with(section, |taken| *taken) {
                return Err(LockError::Taken);
            }
            let former = scheduler
                .lock(section, self.users)
                .ok_or(LockError::Undeclared)?;
            self.taken.with(section, |taken| *taken = true);
            Ok(former)
        })?;
        let _unlock = Unlock {
            scheduler,
            taken: &self.taken,
            former,
        };
        // SAFETY: `taken` was false and is ours until `_unlock` goes.
        Ok(self.value.with_mut(|value| f(unsafe { &mut *value })))
    }

    /// The value, for whoever owns the lock.
    pub fn get_mut(&mut self) -> &mut T {
        // SAFETY: `&mut self`: nobody else has it.
        self.value.with_mut(|value| unsafe { &mut *value })
    }
}

/// Gives the lock back, also when its user unwinds.
struct Unlock<'l, P: Platform, const L: usize, const E: usize, K: Keep> {
    scheduler: &'l Scheduler<P, L, E, K>,
    taken: &'l Masked<bool>,
    former: u32,
}

impl<P: Platform, const L: usize, const E: usize, K: Keep> Drop for Unlock<'_, P, L, E, K> {
    fn drop(&mut self) {
        section(|section| self.taken.with(section, |taken| *taken = false));
        // Loops that became due meanwhile start here.
        self.scheduler.unlock(self.former);
    }
}
