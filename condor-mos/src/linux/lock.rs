//! [`PiLock`]: a mutex of one word, with priority inheritance.

use core::sync::atomic::{AtomicU32, Ordering};

use rustix::io::Errno;
use rustix::thread::futex;

use super::context;

/// How often a thread looks for the end of the holder's section before it asks the kernel to wait: most
/// sections are shorter than a system call.
const LOOKS: u32 = 100;

/// A lock that a thread holds by its number, so that the kernel lends it the priority of who waits.
///
/// Async-signal-safe, provided that no handler asks for it on the thread that holds it.
#[derive(Debug)]
pub(super) struct PiLock(AtomicU32);

impl PiLock {
    pub(super) const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    #[inline]
    pub(super) fn lock(&self) {
        let me = context::thread_number();
        if !self.take(me) {
            self.wait(me);
        }
    }

    #[inline]
    fn take(&self, me: u32) -> bool {
        // Acquire pairs with the Release exchange in `unlock`.
        self.0
            .compare_exchange(0, me, Ordering::Acquire, Ordering::Relaxed)
            .is_ok()
    }

    #[cold]
    fn wait(&self, me: u32) {
        for _ in 0..LOOKS {
            core::hint::spin_loop();
            // Relaxed: `take` orders.
            match self.0.load(Ordering::Relaxed) {
                0 if self.take(me) => return,
                // Who waits in the kernel comes first.
                holder if holder & libc::FUTEX_WAITERS != 0 => break,
                _ => {}
            }
        }
        loop {
            match futex::lock_pi(&self.0, futex::Flags::PRIVATE, None) {
                // The kernel has stored `me`; its own locks order it after the former holder.
                Ok(()) => return,
                Err(Errno::AGAIN | Errno::INTR) => {}
                // A kernel without inheritance.
                Err(_) => rustix::thread::sched_yield(),
            }
            if self.take(me) {
                return;
            }
        }
    }

    /// Gives the lock back; the calling thread holds it.
    #[inline]
    pub(super) fn unlock(&self) {
        let me = context::thread_number();
        // Release pairs with the Acquire exchanges of the next holder.
        let given = self
            .0
            .compare_exchange(me, 0, Ordering::Release, Ordering::Relaxed);
        if given.is_err() {
            // Somebody waits: the kernel hands it over.
            let _ = futex::unlock_pi(&self.0, futex::Flags::PRIVATE);
        }
    }

    /// Whether the calling thread holds it.
    pub(super) fn is_mine(&self) -> bool {
        // Relaxed: a thread finds its own number if it has stored it, and nobody else stores it.
        self.0.load(Ordering::Relaxed) & libc::FUTEX_TID_MASK == context::thread_number()
    }
}
