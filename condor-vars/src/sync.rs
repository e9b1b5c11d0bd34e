//! The atomics that contexts share, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` they are loom's, otherwise `core`'s. Only loads, stores and fences are
//! used: the crate runs on processors without compare-and-swap.

#[cfg(not(condor_loom))]
pub(crate) use core::sync::atomic::{AtomicU32, Ordering, fence};

#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicU32, Ordering, fence};

/// `N` words of zero.
#[cfg(not(condor_loom))]
pub(crate) const fn zeros<const N: usize>() -> [AtomicU32; N] {
    [const { AtomicU32::new(0) }; N]
}

/// `N` words of zero.
#[cfg(condor_loom)]
pub(crate) fn zeros<const N: usize>() -> [AtomicU32; N] {
    core::array::from_fn(|_| AtomicU32::new(0))
}

/// Functions that are `const` unless loom makes the atomics, which it cannot in constants.
macro_rules! const_unless_loom {
    ($(#[$attribute:meta])* $visibility:vis fn $($rest:tt)*) => {
        #[cfg(not(condor_loom))]
        $(#[$attribute])* $visibility const fn $($rest)*
        #[cfg(condor_loom)]
        $(#[$attribute])* $visibility fn $($rest)*
    };
}
pub(crate) use const_unless_loom;
