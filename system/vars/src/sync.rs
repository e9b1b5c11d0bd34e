//! The atomics that contexts share, in one place, so that loom can check the shipped code.
//!
//! Under `--cfg condor_loom` they are loom's, otherwise `core`'s. Only loads, stores and fences are
//! used: the crate runs on processors without compare-and-swap.

#[cfg(not(condor_loom))]
pub(crate) use core::sync::atomic::{AtomicU32, Ordering, fence};

#[cfg(condor_loom)]
pub(crate) use loom::sync::atomic::{AtomicU32, Ordering, fence};

/// An array of values that are made alike; constant, unless loom makes the atomics in them.
#[cfg(not(condor_loom))]
macro_rules! array_of {
    ($value:expr; $count:expr) => {
        [const { $value }; $count]
    };
}
#[cfg(condor_loom)]
macro_rules! array_of {
    ($value:expr; $count:expr) => {
        core::array::from_fn::<_, { $count }, _>(|_| $value)
    };
}
pub(crate) use array_of;

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
