//! Atomics, cells and critical sections that contexts share, in one place, so that loom can check the shipped
//! code.
//!
//! Under `--cfg condor_loom` the atomics, the cells and the critical sections are loom's.

#[cfg(not(condor_loom))]
pub(crate) use portable_atomic::Ordering;
#[cfg(not(any(test, condor_loom)))]
pub(crate) use portable_atomic::{AtomicBool, AtomicU8};

// An interrupting context can come at each of their accesses.
#[cfg(all(test, not(condor_loom)))]
pub(crate) use interrupt_injector::{AtomicBool, AtomicU8};

#[cfg(condor_loom)]
pub(crate) use loom::{
    cell::UnsafeCell,
    sync::atomic::{AtomicBool, AtomicU8, Ordering},
};

#[cfg(not(condor_loom))]
pub(crate) use critical_section::with as critical_section;

/// A mutex that loom sees, for the critical section that it does not.
#[cfg(condor_loom)]
pub(crate) fn critical_section<R>(f: impl FnOnce(critical_section::CriticalSection<'_>) -> R) -> R {
    loom::lazy_static! {
        static ref SECTION: loom::sync::Mutex<()> = loom::sync::Mutex::new(());
    }
    let _section = SECTION.lock();
    // SAFETY: every section of this crate is entered here, one at a time.
    f(unsafe { critical_section::CriticalSection::new() })
}

/// `core`'s cell with loom's way to use it.
#[cfg(not(condor_loom))]
pub(crate) struct UnsafeCell<T>(core::cell::UnsafeCell<T>);

#[cfg(not(condor_loom))]
impl<T> UnsafeCell<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(core::cell::UnsafeCell::new(value))
    }

    #[inline]
    pub(crate) fn with<R>(&self, f: impl FnOnce(*const T) -> R) -> R {
        f(self.0.get())
    }

    #[inline]
    pub(crate) fn with_mut<R>(&self, f: impl FnOnce(*mut T) -> R) -> R {
        f(self.0.get())
    }
}

/// Functions that are `const`, except that loom's types cannot be made in constants.
macro_rules! const_unless_loom {
    ($(#[$attribute:meta])* $visibility:vis const fn $($rest:tt)*) => {
        #[cfg(not(condor_loom))]
        $(#[$attribute])*
        $visibility const fn $($rest)*

        // A function that is `const` elsewhere cannot convert by `From`.
        #[cfg(condor_loom)]
        #[allow(clippy::cast_lossless)]
        $(#[$attribute])*
        $visibility fn $($rest)*
    };
}
pub(crate) use const_unless_loom;
