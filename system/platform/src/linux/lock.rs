//! [`PiLock`]: a mutex of one word, with priority inheritance.

use core::sync::atomic::{AtomicU32, Ordering};

use rustix::io::Errno;
use rustix::thread::futex;

use super::thread_number;

/// The number of times that a thread looks for the end of the holder's section before it asks the kernel to
/// wait: most sections are shorter than a system call.
const LOOKS: u32 = 100;

/// A mutex with priority inheritance for the threads of a process: while threads wait for the lock,
/// the kernel lends the most urgent one's priority to the thread that holds it. For this, the lock
/// stores the kernel's number of the thread that holds it.
///
/// The lock is async-signal-safe, provided that no signal handler takes it on the thread that
/// already holds it.
#[derive(Debug)]
pub struct PiLock(AtomicU32);

impl PiLock {
    /// Makes a lock that no thread holds.
    #[must_use]
    pub const fn new() -> Self {
        Self(AtomicU32::new(0))
    }

    /// Waits until the lock is free, and takes it. The calling thread must not hold the lock
    /// already: it would wait for ever.
    #[inline]
    pub fn lock(&self) {
        let me = thread_number();
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
                // A thread that waits in the kernel comes first.
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

    /// Releases the lock. The calling thread must hold it.
    #[inline]
    pub fn unlock(&self) {
        let me = thread_number();
        // Release pairs with the Acquire exchanges of the next holder.
        let given = self
            .0
            .compare_exchange(me, 0, Ordering::Release, Ordering::Relaxed);
        if given.is_err() {
            // Somebody waits: the kernel hands it over.
            let _ = futex::unlock_pi(&self.0, futex::Flags::PRIVATE);
        }
    }

    /// Returns true if the calling thread holds the lock.
    #[must_use]
    pub fn is_mine(&self) -> bool {
        // Relaxed: a thread finds its own number if it has stored it, and nobody else stores it.
        self.0.load(Ordering::Relaxed) & libc::FUTEX_TID_MASK == thread_number()
    }
}

impl Default for PiLock {
    fn default() -> Self {
        Self::new()
    }
}
