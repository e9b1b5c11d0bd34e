//! What the interrupt's half of a driver and the other half share, in one place, so that loom and
//! the tests' interrupts meet the shipped code.
//!
//! Under `--cfg condor_loom` the atomics are loom's; in unit tests an interrupt may come before each
//! access; otherwise they are `core`'s. Only loads and stores are used: the crate runs on processors
//! without compare-and-swap.

#[cfg(all(test, not(condor_loom)))]
pub(crate) mod interrupted;

#[cfg(not(any(condor_loom, test)))]
pub(crate) use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32};
#[cfg(all(test, not(condor_loom)))]
pub(crate) use interrupted::{AtomicBool, AtomicU8, AtomicU32};
#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicBool, AtomicU8, AtomicU32};

pub(crate) use core::sync::atomic::Ordering;

/// Runs a few accesses that no other context comes between.
#[cfg(not(any(condor_loom, test)))]
#[inline(always)]
pub(crate) fn masked<R>(body: impl FnOnce() -> R) -> R {
    critical_section::with(|_| body())
}

#[cfg(all(test, not(condor_loom)))]
pub(crate) fn masked<R>(body: impl FnOnce() -> R) -> R {
    interrupted::masked(body)
}

#[cfg(condor_loom)]
pub(crate) fn masked<R>(body: impl FnOnce() -> R) -> R {
    loom::lazy_static! {
        static ref SECTION: loom::sync::Mutex<()> = loom::sync::Mutex::new(());
    }
    // A model that failed has said so already.
    let _alone = SECTION.lock();
    body()
}
