//! [`Exclusion`]: how the contexts of one processor keep out of each other's way.

use core::marker::PhantomData;

/// Makes a few instructions of one context indivisible for the other contexts of the processor.
///
/// A mailbox reserves and publishes a message inside one such section, so that background,
/// handlers and servo loops may each be in the middle of a send. Sections are short, bounded,
/// and never nested by the mailbox.
///
/// # For implementers
///
/// While `body` runs, no other context that shares the mailbox may enter a section: mask the
/// interrupts that use it, or take a lock that no interrupt of the holder can wait for. A wrong
/// implementation loses messages; it cannot make the program unsound.
///
/// Contexts that interrupt each other need no more. Where they run in parallel, as threads do, and several
/// serve, [`begin_serving`](Self::begin_serving) lets one at a time take messages and run their handlers:
/// then handlers start in the order in which their messages were sent.
pub trait Exclusion {
    /// Runs `body` alone.
    fn with<R>(&self, body: impl FnOnce() -> R) -> R;

    /// Returns whether the calling context may take messages. It may take more while it runs a handler,
    /// and calls [`end_serving`](Self::end_serving) as often as this returned true.
    fn begin_serving(&self) -> bool {
        true
    }

    /// Ends what [`begin_serving`](Self::begin_serving) began; returns whether another context was
    /// refused meanwhile. The mailbox rings its own doorbell then, so that this context looks again.
    fn end_serving(&self) -> bool {
        false
    }
}

/// Sections of the [`critical-section`](critical_section) crate: the right choice wherever
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

/// No section at all, for a mailbox that one thread alone uses, outside of signal handlers.
///
/// It is neither `Send` nor `Sync` in use: a mailbox with it cannot be shared.
#[derive(Clone, Copy, Debug, Default)]
pub struct SingleContext(PhantomData<*const ()>);

impl SingleContext {
    /// For a mailbox that stays in the present context.
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
