//! The implementation of `critical-section` for hosted programs.
//!
//! The one that `critical-section` has for std takes a signal handler for its own thread, and lets it
//! walk into the section that it has interrupted. On Linux this one is a lock for other threads, and
//! a word that a handler of the same thread respects. It never keeps a handler waiting either: the
//! handler records that it was there, and its work is done when the section is left.

struct Hosted;
critical_section::set_impl!(Hosted);

#[cfg(all(target_os = "linux", not(miri)))]
mod lock {
    use crate::linux::{self, PiLock};

    static LOCK: PiLock = PiLock::new();

    /// False if the thread is in a section.
    pub(super) fn enter() -> bool {
        let outermost = linux::hold();
        if outermost {
            LOCK.lock();
        }
        outermost
    }

    /// The calling thread is in its outermost section.
    pub(super) fn leave() {
        LOCK.unlock();
        linux::let_go();
    }
}

/// For systems, and for Miri, without a lock that inherits priorities. Handlers must not enter.
#[cfg(any(not(target_os = "linux"), miri))]
mod lock {
    use std::cell::RefCell;
    use std::sync::{Mutex, MutexGuard, PoisonError};

    static LOCK: Mutex<()> = Mutex::new(());

    thread_local! {
        static HELD: RefCell<Option<MutexGuard<'static, ()>>> = const { RefCell::new(None) };
    }

    pub(super) fn enter() -> bool {
        HELD.with_borrow_mut(|held| {
            let outermost = held.is_none();
            if outermost {
                *held = Some(LOCK.lock().unwrap_or_else(PoisonError::into_inner));
            }
            outermost
        })
    }

    pub(super) fn leave() {
        HELD.with_borrow_mut(|held| *held = None);
    }
}

// SAFETY: between an outermost `acquire` and its `release` the calling thread holds the lock, which
// excludes other threads and orders sections by Acquire and Release, and on Linux the word that keeps
// its signal handlers out.
unsafe impl critical_section::Impl for Hosted {
    unsafe fn acquire() -> bool {
        !lock::enter()
    }

    unsafe fn release(nested: bool) {
        if !nested {
            lock::leave();
        }
    }
}
