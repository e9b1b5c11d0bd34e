//! Atomics that the interrupt's half of a driver shares with the other half, in one place, so that loom and the
//! tests' interrupts meet the shipped code.
//!
//! Under `--cfg condor_loom` the atomics are loom's; in unit tests an interrupt may come before and
//! behind each access; otherwise they are `core`'s. Only loads and stores are used: the crate runs on processors
//! without compare-and-swap.

#[cfg(not(any(condor_loom, test)))]
pub(crate) use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32};
#[cfg(all(test, not(condor_loom)))]
pub(crate) use interrupt_injector::{AtomicBool, AtomicU8, AtomicU32};
#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicBool, AtomicU8, AtomicU32};

pub(crate) use core::sync::atomic::Ordering;

/// Runs a few accesses that no other context comes between.
#[cfg(not(condor_loom))]
#[inline(always)]
pub(crate) fn masked<R>(body: impl FnOnce() -> R) -> R {
    #[cfg(test)]
    let _masked = interrupt_injector::Section::enter();
    critical_section::with(|_| body())
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
