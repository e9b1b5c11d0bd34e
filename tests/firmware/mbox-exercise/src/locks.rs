//! The locks that a machine can have.

use core::sync::atomic::{AtomicBool, Ordering};

#[cfg(target_has_atomic = "32")]
use condor_mbox::spin_lock::NativeSwap;
use condor_mbox::spin_lock::{Bakery, HardwareSemaphore, SemaphoreSwap, TestAndSet};
use condor_mbox::{AccessError, CriticalSection, Region, SpinLock};

use crate::map::MAP;
use crate::{PROCESSORS, Window};

/// A lock of any kind.
pub(crate) type Lock<'l> = SpinLock<&'l dyn TestAndSet>;

/// The means of which a lock is made.
#[derive(Clone, Copy)]
pub(crate) enum LockKind {
    /// Loads and stores.
    Bakery,
    /// A hardware semaphore.
    Semaphore,
    /// Compare-and-swap.
    #[cfg(target_has_atomic = "32")]
    Swap,
}

impl LockKind {
    pub(crate) const ALL: &[Self] = &[
        Self::Bakery,
        Self::Semaphore,
        #[cfg(target_has_atomic = "32")]
        Self::Swap,
    ];

    /// Returns the word of the kind, which leaves 16 bits for a number.
    pub(crate) const fn word(self) -> u32 {
        (self as u32 + 1) << 16
    }

    pub(crate) fn from_word(word: u32) -> Option<Self> {
        let kind = |kind: &Self| kind.word() == word & 0xffff_0000;
        Self::ALL.iter().copied().find(kind)
    }
}

/// Lets `body` have the lock in the follower's memory.
pub(crate) fn with_lock(
    kind: LockKind,
    ram: Region<&Window>,
    body: impl FnOnce(&Lock<'_>),
) -> Result<(), AccessError> {
    let with = |lock: &dyn TestAndSet| body(&SpinLock::new(lock));
    match kind {
        LockKind::Bakery => with(&Bakery::new(
            ram,
            MAP.lock,
            PROCESSORS as u8,
            CriticalSection,
        )?),
        LockKind::Semaphore => with(&SemaphoreSwap::new(
            ram,
            MAP.lock,
            Semaphore,
            CriticalSection,
        )?),
        #[cfg(target_has_atomic = "32")]
        LockKind::Swap => with(&NativeSwap::new(ram, MAP.lock)?),
    }
    Ok(())
}

/// No machine here has a semaphore in hardware: an atomic swap stands in for one, or masked
/// interrupts of the only core.
struct Semaphore;

static TAKEN: AtomicBool = AtomicBool::new(false);

impl HardwareSemaphore for Semaphore {
    fn try_take(&self) -> bool {
        // Pairs with the store in `give`.
        #[cfg(target_has_atomic = "8")]
        let taken = TAKEN.swap(true, Ordering::Acquire);
        #[cfg(not(target_has_atomic = "8"))]
        let taken = condor_mbox::Exclusion::with(&CriticalSection, || {
            let taken = TAKEN.load(Ordering::Acquire);
            TAKEN.store(true, Ordering::Relaxed);
            taken
        });
        !taken
    }

    fn give(&self) {
        // Pairs with the swap in `try_take`.
        TAKEN.store(false, Ordering::Release);
    }
}
