//! The locks that two harts with atomic instructions and one memory can have.

use core::sync::atomic::{AtomicBool, Ordering};

use condor_mbox::spin_lock::{Bakery, HardwareSemaphore, NativeSwap, SemaphoreSwap};
use condor_mbox::{AccessError, CriticalSection, Region, SpinLock, StaticWindow};
use mbox_exercise::{LockKind, Locking, Locks, PROCESSORS};

/// All of them.
pub(crate) struct All;

/// The machine has no semaphore in hardware: an atomic swap stands in for one.
struct Semaphore;

static TAKEN: AtomicBool = AtomicBool::new(false);

impl HardwareSemaphore for Semaphore {
    fn try_take(&self) -> bool {
        // Pairs with the store in `give`.
        !TAKEN.swap(true, Ordering::Acquire)
    }

    fn give(&self) {
        // Pairs with the swap in `try_take`.
        TAKEN.store(false, Ordering::Release);
    }
}

impl<'a> Locks<StaticWindow<'a>> for All {
    const KINDS: &'static [LockKind] = &[LockKind::Bakery, LockKind::Semaphore, LockKind::Swap];

    fn with_lock(
        &self,
        kind: LockKind,
        ram: Region<&StaticWindow<'a>>,
        at: u32,
        body: &mut dyn FnMut(&dyn Locking),
    ) -> Result<(), AccessError> {
        match kind {
            LockKind::Bakery => {
                let memory = Bakery::new(ram, at, PROCESSORS as u8, CriticalSection)?;
                body(&SpinLock::new(memory));
            }
            LockKind::Semaphore => {
                let memory = SemaphoreSwap::new(ram, at, Semaphore, CriticalSection)?;
                body(&SpinLock::new(memory));
            }
            LockKind::Swap => body(&SpinLock::new(NativeSwap::new(ram, at)?)),
        }
        Ok(())
    }
}
