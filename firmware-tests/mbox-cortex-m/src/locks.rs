//! The locks that a core without compare-and-swap can have.

use core::sync::atomic::{AtomicBool, Ordering};

use condor_mbox::spin_lock::{Bakery, HardwareSemaphore, SemaphoreSwap};
use condor_mbox::{AccessError, CriticalSection, Region, SpinLock, StaticWindow};
use mbox_exercise::{LockKind, Locking, Locks, PROCESSORS};

/// All of them.
pub(crate) struct All;

/// The chip has no semaphore; in one core, masked interrupts are as good.
struct Semaphore;

static TAKEN: AtomicBool = AtomicBool::new(false);

impl HardwareSemaphore for Semaphore {
    fn try_take(&self) -> bool {
        critical_section::with(|_| {
            let free = !TAKEN.load(Ordering::Relaxed);
            TAKEN.store(true, Ordering::Relaxed);
            free
        })
    }

    fn give(&self) {
        TAKEN.store(false, Ordering::Relaxed);
    }
}

impl<'a> Locks<StaticWindow<'a>> for All {
    const KINDS: &'static [LockKind] = &[LockKind::Bakery, LockKind::Semaphore];

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
            LockKind::Swap => {}
        }
        Ok(())
    }
}
