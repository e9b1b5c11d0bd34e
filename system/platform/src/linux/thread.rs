//! [`thread_number`]: the kernel's number of the calling thread.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

thread_local! {
    // Constant and without a destructor: reached without a call or an allocation, in handlers, too.
    static NUMBER: AtomicU32 = const { AtomicU32::new(0) };
}

/// Returns the kernel's number of the calling thread (its TID). Only the first call of a thread is a system call.
#[must_use]
#[inline]
pub fn thread_number() -> u32 {
    NUMBER.with(|number| match number.load(Ordering::Relaxed) {
        0 => ask(number),
        number => number,
    })
}

#[cold]
fn ask(known: &AtomicU32) -> u32 {
    static WATCHED: AtomicBool = AtomicBool::new(false);
    extern "C" fn forget() {
        NUMBER.with(|number| number.store(0, Ordering::Relaxed));
    }
    if !WATCHED.swap(true, Ordering::Relaxed) {
        // The thread that goes on in a forked process has another number there.
        // SAFETY: the function only stores to a word of its own thread.
        unsafe { libc::pthread_atfork(None, None, Some(forget)) };
    }
    let number = rustix::thread::gettid().as_raw_nonzero().get();
    let number = number.cast_unsigned();
    known.store(number, Ordering::Relaxed);
    number
}
