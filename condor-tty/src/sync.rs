//! The atomics of this crate, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` they are loom's, otherwise `core`'s. Only loads, stores and fences are
//! used: the crate runs on processors without compare-and-swap.

#[cfg(not(condor_loom))]
pub(crate) use core::sync::atomic::{AtomicU16, AtomicU32, Ordering, fence};

#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicU16, AtomicU32, Ordering, fence};

/// A word that several contexts of one processor have in common.
///
/// Relaxed: whatever depends on more than this word is done inside of an `Exclusion`.
#[derive(Debug)]
pub(crate) struct Word(AtomicU32);

impl Word {
    pub(crate) fn new(value: u32) -> Self {
        Self(AtomicU32::new(value))
    }

    pub(crate) fn get(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }

    pub(crate) fn set(&self, value: u32) {
        self.0.store(value, Ordering::Relaxed);
    }
}
