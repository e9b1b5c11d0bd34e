//! The turn between threads and processes of Linux, by futex.

use core::time::Duration;

use condor_platform::linux::thread_number;
use rustix::thread::futex;
use rustix::time::{ClockId, Timespec, clock_gettime};

use crate::handover::Handover;
use crate::sync::AtomicU32;

/// The [`Handover`] between processes of Linux, and between threads of one process, by futex.
#[derive(Debug)]
pub struct Futex {
    /// The thread of the program.
    thread: u32,
}

impl Futex {
    /// Makes the handover for a participant whose program runs in the calling thread. Other threads
    /// of that program may ring, but never wait for the turn.
    #[must_use]
    pub fn new() -> Self {
        Self {
            thread: thread_number(),
        }
    }
}

impl Default for Futex {
    fn default() -> Self {
        Self::new()
    }
}

impl Handover for Futex {
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64) {
        let most = Timespec::try_from(Duration::from_nanos(most_ns)).ok();
        // Woken, too late, or interrupted: the caller looks again in each case.
        let _ = futex::wait(word, futex::Flags::empty(), seen, most.as_ref());
    }

    fn wake(&self, _: u8, word: &AtomicU32) {
        // Errors mean that the memory is gone.
        let _ = futex::wake(word, futex::Flags::empty(), i32::MAX as u32);
    }

    fn wall_ns(&self) -> Option<u64> {
        let time = clock_gettime(ClockId::Monotonic);
        Duration::try_from(time)
            .ok()
            .and_then(|time| u64::try_from(time.as_nanos()).ok())
    }

    fn is_own_context(&self) -> bool {
        thread_number() == self.thread
    }
}
