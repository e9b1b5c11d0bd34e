//! The atomics of this crate, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` every atomic access of the crate is loom's; otherwise it is
//! `core`'s. Only loads, stores and fences are used: the crate runs on processors without
//! compare-and-swap.

#[cfg(not(condor_loom))]
pub(crate) use core::sync::atomic::{AtomicU32, Ordering, fence};

#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicU32, Ordering, fence};
