//! The implementation of `critical-section`: a lock for other threads, and a word that a signal
//! handler of the same thread respects.
//!
//! The one that `critical-section` has for std takes a handler for its own thread, and lets it walk
//! into the section that it has interrupted. This one never keeps a handler waiting either: the
//! handler records that it was there, and its work is done when the section is left.

use super::context;
use super::lock::PiLock;

static LOCK: PiLock = PiLock::new();

struct LinuxSection;
critical_section::set_impl!(LinuxSection);

// SAFETY: between an outermost `acquire` and its `release` the calling thread holds `LOCK`, which
// excludes other threads and orders sections by Acquire and Release, and `held`, which keeps this
// crate's handlers out.
unsafe impl critical_section::Impl for LinuxSection {
    unsafe fn acquire() -> bool {
        let outermost = context::with(context::Context::hold);
        if outermost {
            LOCK.lock();
        }
        !outermost
    }

    unsafe fn release(nested: bool) {
        if !nested {
            LOCK.unlock();
            context::with(context::Context::let_go);
        }
    }
}
