//! [`SpinLock`]: a lock for structures that processors share in `data`.

mod bakery;
mod owner;
mod swap;

use core::fmt;
use core::ops::Deref;
use core::time::Duration;

use crate::time::{Clock, Instant};
use crate::window::WindowErrorKind;

pub use bakery::Bakery;
pub use owner::{Incarnations, LockOwner};
pub use swap::{HardwareSemaphore, NativeSwap, SemaphoreSwap};

/// A lock in shared memory that records its owner, and that others can recover if the owner dies.
///
/// The lock itself lies in shared memory, in one of three forms: [`NativeSwap`] if all its
/// processors have compare-and-swap, [`SemaphoreSwap`] if there is a hardware semaphore, and
/// [`Bakery`], which needs only loads and stores. All zeros is a free lock. Sections 2.1 and 3.3.1
/// of A.I. Memo 977 ask for a test-and-set that is indivisible across the bus, for the same
/// purpose.
///
/// A processor holds the lock in one of its incarnations. If that incarnation ends before it
/// releases the lock, the others get [`OwnerDead`](SpinLockError::OwnerDead), and one of them can
/// [`recover`](Self::recover) the lock and the structure. The lock is never taken from a living
/// owner, however long it holds it.
///
/// Servo loops, and handlers that may have interrupted the owner, must only call
/// [`try_lock`](Self::try_lock): if they waited for the context that they have interrupted, only
/// the deadline would end the wait. A guard that is forgotten keeps the lock until the processor's
/// incarnation ends.
///
/// ```
/// # #[cfg(target_has_atomic = "32")] {
/// use condor_mbox::spin_lock::{Incarnations, SpinLockError, NativeSwap, LockOwner};
/// use condor_mbox::{MemoryWindow, Allocator, Processor, Region, SpinLock};
/// # use condor_mbox::StaticMemory;
/// static MEMORY: StaticMemory<256> = StaticMemory::new();
///
/// /// Who lives, as the mailbox knows it: here everybody but processor 3.
/// struct Known;
///
/// impl Incarnations for Known {
///     fn is_current(&self, owner: LockOwner) -> bool {
///         owner.processor() != Some(Processor(3))
///     }
/// }
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let ram = Region::users(MEMORY.window())?;
/// let lock = SpinLock::new(NativeSwap::new(&ram, Allocator::new(ram.size()).bytes(4)?)?);
/// let (me, other) = (LockOwner::new(Processor(0), 1)?, LockOwner::new(Processor(1), 7)?);
///
/// let guard = lock.try_lock(me, &Known)?;
/// assert_eq!(
///     lock.try_lock(other, &Known).err(),
///     Some(SpinLockError::Busy { owner: Some(me) })
/// );
/// drop(guard);
/// assert!(lock.try_lock(other, &Known).is_ok());
/// # Ok(())
/// # }
/// # main().unwrap();
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SpinLock<L> {
    memory: L,
}

impl<L: TestAndSet> SpinLock<L> {
    /// Makes a handle of the lock in `memory`. The lock in shared memory stays as it is, free or
    /// held.
    pub const fn new(memory: L) -> Self {
        Self { memory }
    }

    /// Takes the lock for `me` if it is free, without waiting. `incarnations`, such as the mailbox,
    /// tells whether an owner's incarnation has ended.
    ///
    /// # Errors
    /// [`Busy`](SpinLockError::Busy) if a living owner holds the lock,
    /// [`OwnerDead`](SpinLockError::OwnerDead) if its owner has ended,
    /// [`NotCurrent`](SpinLockError::NotCurrent) if the incarnation of `me` is over,
    /// [`Memory`](SpinLockError::Memory) if the memory cannot be accessed.
    pub fn try_lock(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<SpinLockGuard<'_, L>, SpinLockError> {
        self.take(None, me, incarnations, || true)
            .map_err(|stopped| stopped.reason(|owner| SpinLockError::Busy { owner }))
    }

    /// Takes the lock for `me`, and spins until it is free or `timeout` has passed. `incarnations`,
    /// such as the mailbox, tells whether an owner's incarnation has ended.
    ///
    /// # Errors
    /// [`TimedOut`](SpinLockError::TimedOut) after `timeout`. As soon as it is known:
    /// [`OwnerDead`](SpinLockError::OwnerDead) if the owner has ended,
    /// [`NotCurrent`](SpinLockError::NotCurrent) if the incarnation of `me` is over,
    /// [`Memory`](SpinLockError::Memory) if the memory cannot be accessed.
    pub fn lock(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
        clock: &impl Clock,
        timeout: Duration,
    ) -> Result<SpinLockGuard<'_, L>, SpinLockError> {
        let deadline: Instant = clock.now().after(timeout);
        self.take(None, me, incarnations, || clock.now() >= deadline)
            .map_err(|stopped| stopped.reason(|owner| SpinLockError::TimedOut { owner }))
    }

    /// Takes the lock over for `me` from `dead`, the owner that
    /// [`OwnerDead`](SpinLockError::OwnerDead) named.
    ///
    /// If several processors try, one gets it. The protected structure may be half changed; the
    /// processor that gets the lock must repair it before it drops the guard.
    ///
    /// # Errors
    /// [`Busy`](SpinLockError::Busy) if another processor recovers or has recovered it, or if `dead` is
    /// alive after all; [`NotCurrent`](SpinLockError::NotCurrent) if the incarnation of `me` is over;
    /// [`Memory`](SpinLockError::Memory) if the memory cannot be accessed.
    pub fn recover(
        &self,
        dead: LockOwner,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<SpinLockGuard<'_, L>, SpinLockError> {
        if dead.is_alive(incarnations) {
            return Err(SpinLockError::Busy { owner: Some(dead) });
        }
        self.take(Some(dead), me, incarnations, || true)
            .map_err(|stopped| stopped.reason(|owner| SpinLockError::Busy { owner }))
    }

    /// Competes for the lock as left by `from`, and looks until `enough` says so.
    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        incarnations: &dyn Incarnations,
        mut enough: impl FnMut() -> bool,
    ) -> Result<SpinLockGuard<'_, L>, AttemptEnd> {
        if !me.is_alive(incarnations) {
            return Err(AttemptEnd::For(SpinLockError::NotCurrent { owner: me }));
        }
        let mut competing = false;
        let stopped = loop {
            let attempt = if competing {
                self.memory.take(from, me, incarnations)
            } else {
                match self.memory.compete(me, incarnations) {
                    Ok(true) => {
                        competing = true;
                        self.memory.take(from, me, incarnations)
                    }
                    Ok(false) => Ok(Attempt::Behind(Some(me))),
                    Err(kind) => Err(kind),
                }
            };
            match attempt {
                Ok(Attempt::Taken) => {
                    return Ok(SpinLockGuard {
                        memory: &self.memory,
                        me,
                        held: true,
                    });
                }
                Ok(Attempt::Held(owner)) if !owner.is_alive(incarnations) => {
                    break AttemptEnd::For(SpinLockError::OwnerDead { owner });
                }
                Ok(Attempt::Held(owner)) if enough() => break AttemptEnd::Enough(Some(owner)),
                Ok(Attempt::Behind(owner)) if enough() => break AttemptEnd::Enough(owner),
                Ok(Attempt::Held(_) | Attempt::Behind(_)) => {}
                Err(kind) => break AttemptEnd::For(SpinLockError::Memory { kind }),
            }
            core::hint::spin_loop();
        };
        if competing && let Err(kind) = self.memory.withdraw(me) {
            return Err(AttemptEnd::For(SpinLockError::Memory { kind }));
        }
        Err(stopped)
    }
}

/// The reason why an attempt ended without the lock.
enum AttemptEnd {
    Enough(Option<LockOwner>),
    For(SpinLockError),
}

impl AttemptEnd {
    fn reason(self, enough: impl FnOnce(Option<LockOwner>) -> SpinLockError) -> SpinLockError {
        match self {
            Self::Enough(owner) => enough(owner),
            Self::For(error) => error,
        }
    }
}

/// A held [`SpinLock`]; dropping it releases the lock.
#[must_use = "the lock is released at once if the guard is dropped"]
pub struct SpinLockGuard<'a, L: TestAndSet> {
    memory: &'a L,
    me: LockOwner,
    held: bool,
}

impl<L: TestAndSet> SpinLockGuard<'_, L> {
    /// Releases the lock. Unlike dropping the guard, this function returns an error if that fails.
    ///
    /// # Errors
    /// [`Memory`](SpinLockError::Memory) if the memory is gone, and the lock with it.
    pub fn release(mut self) -> Result<(), SpinLockError> {
        self.held = false;
        self.memory
            .release(self.me)
            .map_err(|kind| SpinLockError::Memory { kind })
    }
}

impl<L: TestAndSet> fmt::Debug for SpinLockGuard<'_, L> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Guard")
            .field("me", &self.me)
            .finish_non_exhaustive()
    }
}

impl<L: TestAndSet> Drop for SpinLockGuard<'_, L> {
    fn drop(&mut self) {
        if self.held {
            // The processor that wants the lock next meets the same lost memory, and gets the error.
            let _ = self.memory.release(self.me);
        }
    }
}

/// The reason why a [`SpinLock`] was not taken or not released.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SpinLockError {
    /// A living owner holds the lock.
    #[error("the lock is held by {}", OwnerName(.owner))]
    Busy {
        /// The owner; `None` if the lock was changing hands.
        owner: Option<LockOwner>,
    },
    /// Living owners held the lock until the deadline.
    #[error("the lock was held until the deadline, last by {}", OwnerName(.owner))]
    TimedOut {
        /// The last owner; `None` if the lock was changing hands.
        owner: Option<LockOwner>,
    },
    /// The owner's incarnation ended while it held the lock; see [`SpinLock::recover`].
    #[error("{owner} died while it held the lock")]
    OwnerDead {
        /// The dead owner, or garbage that was found in its place.
        owner: LockOwner,
    },
    /// The caller's own incarnation is over: it must join again before it takes a lock.
    #[error("{owner} may not lock: its incarnation has ended; join the system again first")]
    NotCurrent {
        /// The caller.
        owner: LockOwner,
    },
    /// The memory could not be accessed.
    #[error("cannot access the memory of the lock: {kind}")]
    Memory {
        /// The kind of error.
        kind: WindowErrorKind,
    },
}

struct OwnerName<'a>(&'a Option<LockOwner>);

impl fmt::Display for OwnerName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(owner) => owner.fmt(f),
            None => f.write_str("somebody"),
        }
    }
}

/// The result of one attempt to take a lock, as [`TestAndSet::take`] returns it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attempt {
    /// The lock had the expected owner, and is now the caller's.
    Taken,
    /// The lock has this other owner, dead or alive.
    Held(LockOwner),
    /// The caller must wait for this processor, which was alive just now and goes first; `None` if
    /// it is not known which processor goes first.
    Behind(Option<LockOwner>),
}

impl Attempt {
    /// Returns the meaning of finding one word where another was expected.
    fn of(found: u32, expected: u32) -> Self {
        if found == expected {
            return Self::Taken;
        }
        match LockOwner::from_word(found) {
            Some(owner) => Self::Held(owner),
            None => Self::Behind(None),
        }
    }
}

/// A form of lock in shared memory, which a [`SpinLock`] uses.
///
/// # For users
///
/// Choose one of [`NativeSwap`], [`SemaphoreSwap`] and [`Bakery`].
///
/// # For implementers
///
/// Every method must return after a bounded number of accesses. A processor may stop for ever
/// between any two of them; once its incarnation is over, this must not keep others from the lock.
/// All that an owner wrote before `release` must be visible after the next `take` that succeeds.
pub trait TestAndSet {
    /// Begins to compete; returns `false` if another context of this processor competes already.
    ///
    /// # Errors
    /// Returns the kind of the window's error if an access fails.
    fn compete(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<bool, WindowErrorKind> {
        let _ = (me, incarnations);
        Ok(true)
    }

    /// Makes `me` the owner if the present owner is `from` (`None` means that the lock is free), in
    /// one indivisible step. It is called after `compete`, and again until it succeeds or
    /// `withdraw` is called.
    ///
    /// # Errors
    /// Returns the kind of the window's error if an access fails.
    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<Attempt, WindowErrorKind>;

    /// Stops competing for `me`, which has not got the lock.
    ///
    /// # Errors
    /// Returns the kind of the window's error if an access fails.
    fn withdraw(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        let _ = me;
        Ok(())
    }

    /// Releases the lock if `me` is still its owner.
    ///
    /// # Errors
    /// Returns the kind of the window's error if an access fails.
    fn release(&self, me: LockOwner) -> Result<(), WindowErrorKind>;
}

impl<T: Deref<Target: TestAndSet>> TestAndSet for T {
    fn compete(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<bool, WindowErrorKind> {
        (**self).compete(me, incarnations)
    }

    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<Attempt, WindowErrorKind> {
        (**self).take(from, me, incarnations)
    }

    fn withdraw(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        (**self).withdraw(me)
    }

    fn release(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        (**self).release(me)
    }
}
