//! [`Exclusion`]: mutual exclusion between the contexts of one processor.

use core::marker::PhantomData;

/// Runs a few instructions as a critical section: until they end, no other context of the processor
/// runs such a section.
///
/// A mailbox reserves and publishes a message inside one critical section, so background, handlers
/// and servo loops may interrupt each other in the middle of a send. Sections are short and
/// bounded, and the mailbox never nests them.
///
/// # For implementers
///
/// While `body` runs, no other context that shares the mailbox may enter a section: mask the
/// interrupts that use it, or take a lock for which no interrupt of the holder can wait. A wrong
/// implementation loses messages; it cannot make the program unsound.
///
/// Contexts that interrupt each other need no more. If contexts run in parallel, as threads do, and
/// several of them serve, [`begin_serving`](Self::begin_serving) must let only one at a time take
/// messages and run their handlers; then handlers start in the order in which their messages were
/// sent.
pub trait Exclusion {
    /// Runs `body` as a critical section.
    fn with<R>(&self, body: impl FnOnce() -> R) -> R;

    /// Returns true if the calling context may take messages. While it runs a handler, it may call
    /// this again; it calls [`end_serving`](Self::end_serving) once for each time that this
    /// returned true.
    fn begin_serving(&self) -> bool {
        true
    }

    /// Ends one call of [`begin_serving`](Self::begin_serving); returns true if another context was
    /// refused meanwhile. If so, the mailbox rings its own doorbell, so that the refused context
    /// looks again.
    fn end_serving(&self) -> bool {
        false
    }
}

/// Critical sections by the [`critical-section`](critical_section) crate: the right choice wherever
/// interrupts, signals or threads share a mailbox.
///
/// The program chooses the implementation: its processor's own crate on bare metal, and
/// `condor-platform` with the feature `critical-section` in a hosted program.
#[derive(Clone, Copy, Debug, Default)]
pub struct CriticalSection;

impl Exclusion for CriticalSection {
    #[inline(always)]
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        critical_section::with(|_| body())
    }
}

/// No critical section at all, for a mailbox that only one thread uses, outside of signal handlers.
///
/// A `SingleContext` is neither `Send` nor `Sync`, so a mailbox that uses it cannot be shared.
#[derive(Clone, Copy, Debug, Default)]
pub struct SingleContext(PhantomData<*const ()>);

impl SingleContext {
    /// Makes an exclusion that excludes nothing, for a mailbox that stays in the present thread.
    #[must_use]
    pub const fn new() -> Self {
        Self(PhantomData)
    }
}

impl Exclusion for SingleContext {
    #[inline(always)]
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        body()
    }
}
