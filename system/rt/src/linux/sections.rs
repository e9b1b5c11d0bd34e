//! [`ProcessSections`]: mutual exclusion between the threads of a process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use condor_mbox::{CriticalSection, Exclusion};
use condor_platform::linux::thread_number;

use super::clock::ProcessClock;
use crate::simulated::SimulatedSection;

/// The critical sections of a [`LinuxProcess`](super::LinuxProcess), which keep its background, handlers and loops
/// apart. With the real clock they are those of the `critical-section` crate; if the loops run in threads, only one
/// thread at a time serves messages. In simulated time, no time passes inside of a section, so nothing interrupts it.
/// All clones are the same sections.
#[derive(Clone, Debug)]
pub struct ProcessSections(pub(super) Sections);

#[derive(Clone, Debug)]
pub(super) enum Sections {
    OneThread,
    Threads(Arc<Server>),
    Simulated(SimulatedSection<ProcessClock>),
}

/// Which thread serves.
#[derive(Debug, Default)]
pub(super) struct Server {
    /// The thread's number, 0 if none does.
    holder: AtomicU32,
    /// The nesting depth of the holder's sections; only the holder uses it.
    depth: AtomicU32,
    /// Another thread was refused.
    refused: AtomicBool,
}

impl Server {
    fn begin(&self) -> bool {
        let me = thread_number();
        if self.holder.load(Ordering::Relaxed) != me && !self.take(me) {
            // SeqCst, as the two accesses of `end` are: either the holder finds that somebody was refused,
            // or the second attempt finds that it has gone.
            self.refused.store(true, Ordering::SeqCst);
            if !self.take(me) {
                return false;
            }
        }
        self.depth.fetch_add(1, Ordering::Relaxed);
        true
    }

    fn take(&self, me: u32) -> bool {
        // Acquire: pairs with the store in `end`, so that handlers find what former ones have done.
        self.holder
            .compare_exchange(0, me, Ordering::SeqCst, Ordering::SeqCst)
            .is_ok()
    }

    fn end(&self) -> bool {
        if self.depth.fetch_sub(1, Ordering::Relaxed) > 1 {
            return false;
        }
        // Release: pairs with the exchange in `take`.
        self.holder.store(0, Ordering::SeqCst);
        self.refused.swap(false, Ordering::SeqCst)
    }
}

impl Exclusion for ProcessSections {
    #[inline]
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        match &self.0 {
            Sections::Simulated(sections) => sections.with(body),
            Sections::OneThread | Sections::Threads(_) => CriticalSection.with(body),
        }
    }

    #[inline]
    fn begin_serving(&self) -> bool {
        match &self.0 {
            Sections::Threads(server) => server.begin(),
            Sections::OneThread | Sections::Simulated(_) => true,
        }
    }

    #[inline]
    fn end_serving(&self) -> bool {
        matches!(&self.0, Sections::Threads(server) if server.end())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thread_serves_and_the_other_is_told_when_it_ends() {
        let sections = ProcessSections(Sections::Threads(Arc::default()));
        let elsewhere = || {
            let other = sections.clone();
            let serve = move || other.begin_serving().then(|| other.end_serving());
            std::thread::spawn(serve).join().unwrap()
        };
        assert_eq!(elsewhere(), Some(false));
        assert!(sections.begin_serving());
        // In a handler that waits.
        assert!(sections.begin_serving());
        assert_eq!(elsewhere(), None);
        assert!(!sections.end_serving());
        assert_eq!(elsewhere(), None);
        assert!(sections.end_serving());
        assert_eq!(elsewhere(), Some(false));
        assert!(sections.begin_serving());
        assert!(!sections.end_serving());
    }
}
