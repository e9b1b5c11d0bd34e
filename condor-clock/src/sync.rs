//! The atomics of the page, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` they are loom's, otherwise `core`'s.

#[cfg(not(condor_loom))]
pub use core::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

#[cfg(condor_loom)]
pub use loom::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};
