//! [`Masked`]: memory that is reached only while nothing can interrupt.

use critical_section::CriticalSection;
#[cfg(all(test, not(condor_loom)))]
use interrupt_injector::{Access, Section};

use crate::platform::Platform;
use crate::sync::{UnsafeCell, const_unless_loom};

/// Runs `f` while nothing can interrupt. Every critical section of this crate is one of these.
#[inline(always)]
pub(crate) fn section<R>(f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
    #[cfg(all(test, not(condor_loom)))]
    let _masked = Section::enter();
    crate::sync::critical_section(f)
}

/// As [`section`], in the platform's own way.
#[inline(always)]
pub(crate) fn masked<P: Platform, R>(platform: &P, f: impl FnOnce(CriticalSection<'_>) -> R) -> R {
    #[cfg(all(test, not(condor_loom)))]
    let _masked = Section::enter();
    platform.masked(f)
}

/// A value that the contexts of one processor share: each use is part of a critical section.
pub(crate) struct Masked<T>(UnsafeCell<T>);

// SAFETY: the value is reached through `with` alone, one context at a time.
unsafe impl<T: Send> Sync for Masked<T> {}

impl<T> Masked<T> {
    const_unless_loom! {
        pub(crate) const fn new(value: T) -> Self {
            Self(UnsafeCell::new(value))
        }
    }

    /// Uses the value. `f` must not call a program's code, which could come back here.
    #[inline(always)]
    pub(crate) fn with<R>(&self, _section: CriticalSection<'_>, f: impl FnOnce(&mut T) -> R) -> R {
        #[cfg(all(test, not(condor_loom)))]
        let _access = Access::begin();
        // SAFETY: no other context is inside a critical section at the same time, and this one
        // is not here twice: the closures of this crate call nothing but this crate's own code,
        // with types that nobody else can implement.
        self.0.with_mut(|value| f(unsafe { &mut *value }))
    }
}
