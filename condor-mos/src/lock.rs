//! [`LoopLock`]: data that loops and the background share.

#[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
use condor_platform::linux::PiLock;

use crate::error::LoopLockError;
use crate::loops::Loops;
use crate::process::LoopId;
use crate::runner::Gate;
use crate::sync::{AtomicBool, UnsafeCell, const_unless_loom};

/// A lock with a value that some loops and the background, its *users*, share; one of them uses it at a time.
///
/// With a [`Scheduler`](crate::Scheduler), on one stack, this is the immediate priority ceiling protocol: while one
/// user has the value, no other user starts. Loops that are faster than all users are not delayed. So no context ever
/// waits for the lock, nothing deadlocks, and a loop is delayed by at most one slower user, before it starts.
///
/// With threads of Linux, a loop waits while another thread uses the value. That thread runs with the priority of the
/// fastest loop that waits (priority inheritance), so only users of this value delay a loop.
///
/// Source of both: L. Sha, R. Rajkumar, J. P. Lehoczky, "Priority inheritance protocols", IEEE Transactions on
/// Computers 39(9), 1990.
pub struct LoopLock<T> {
    gate: Gate,
    value: UnsafeCell<T>,
}

// SAFETY: `value` is used by one context at a time, which has found `taken` false and set it.
unsafe impl<T: Send> Sync for LoopLock<T> {}

impl<T> LoopLock<T> {
    const_unless_loom! {
        /// Makes a lock with the value `value`, which the loops in `users` and the background may take.
        #[must_use]
        pub const fn new(users: &[LoopId], value: T) -> Self {
            let mut bits = 0;
            let mut at = 0;
            while at < users.len() {
                bits |= 1_u32.unbounded_shl(users[at].0 as u32);
                at += 1;
            }
            let gate = Gate {
                users: bits,
                taken: AtomicBool::new(false),
                #[cfg(all(feature = "linux", target_os = "linux", not(condor_loom)))]
                threads: PiLock::new(),
            };
            Self {
                gate,
                value: UnsafeCell::new(value),
            }
        }
    }

    /// Takes the lock, calls `f` with the value, and returns the result of `f`. No other user of the lock has the value
    /// during the call. `loops` are the loops that the users belong to.
    ///
    /// # Errors
    /// [`LoopLockError::Undeclared`], only on one stack, if the caller is a loop that is faster than all declared
    /// users; [`LoopLockError::Taken`] if the caller uses the value already, which is a mistake of the program.
    pub fn lock<L: Loops + ?Sized, R>(
        &self,
        loops: &L,
        f: impl FnOnce(&mut T) -> R,
    ) -> Result<R, LoopLockError> {
        let former = loops.enter(&self.gate)?;
        let _unlock = Unlock {
            loops,
            gate: &self.gate,
            former,
        };
        // SAFETY: `taken` was false and is ours until `_unlock` goes.
        Ok(self.value.with_mut(|value| f(unsafe { &mut *value })))
    }

    /// Returns the value without taking the lock: `&mut self` proves that no other context uses it.
    pub fn get_mut(&mut self) -> &mut T {
        // SAFETY: `&mut self`: nobody else has it.
        self.value.with_mut(|value| unsafe { &mut *value })
    }
}

/// Releases the lock when it is dropped, also when its user unwinds.
struct Unlock<'l, L: Loops + ?Sized> {
    loops: &'l L,
    gate: &'l Gate,
    former: u32,
}

impl<L: Loops + ?Sized> Drop for Unlock<'_, L> {
    fn drop(&mut self) {
        self.loops.leave(self.gate, self.former);
    }
}
