//! The data of a thread and its signal handlers on the thread's critical section.

use core::cell::Cell;
#[cfg(all(feature = "critical-section", not(miri)))]
use core::sync::atomic::compiler_fence;
use core::sync::atomic::{AtomicBool, Ordering};

/// The words of one thread. Its handlers are the only other contexts that see them, so all accesses
/// are relaxed, kept in order by compiler fences.
struct ThreadWords {
    held: AtomicBool,
    hook: Cell<Option<fn()>>,
}

thread_local! {
    // Constant and without a destructor: reached without a call or an allocation, in handlers, too.
    static HELD: ThreadWords = const {
        ThreadWords {
            held: AtomicBool::new(false),
            hook: Cell::new(None),
        }
    };
}

/// Returns true if the calling thread is in a critical section of this crate's implementation of
/// `critical-section`.
///
/// A signal handler that finds the section held must not enter it. It records its work instead, and
/// the function that was given to [`on_leaving`] does that work later.
#[must_use]
#[inline]
pub fn is_held() -> bool {
    HELD.with(|held| held.held.load(Ordering::Relaxed))
}

/// Sets the function that the calling thread calls whenever it has left its outermost critical
/// section. With `None` the thread calls nothing.
///
/// Call it only while no signal handler of the thread enters sections.
pub fn on_leaving(hook: Option<fn()>) {
    HELD.with(|held| held.hook.set(hook));
}

/// Enters a critical section; false if the thread is in one.
#[cfg(all(feature = "critical-section", not(miri)))]
#[inline]
pub(crate) fn hold() -> bool {
    HELD.with(|held| {
        if held.held.load(Ordering::Relaxed) {
            return false;
        }
        held.held.store(true, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        true
    })
}

/// Leaves the outermost critical section.
#[cfg(all(feature = "critical-section", not(miri)))]
#[inline]
pub(crate) fn let_go() {
    HELD.with(|held| {
        compiler_fence(Ordering::SeqCst);
        held.held.store(false, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
        if let Some(hook) = held.hook.get() {
            hook();
        }
    });
}
