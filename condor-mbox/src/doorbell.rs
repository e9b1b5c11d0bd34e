//! [`Doorbell`]: the mailbox interrupt of a processor.

use core::ops::Deref;

use crate::id::Processor;
use crate::time::{Clock, Instant};

/// What the platform knows for certain of the program behind a processor number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evidence {
    /// The platform cannot tell.
    Unknown,
    /// A program holds the number.
    Alive,
    /// Nobody holds the number: the program ended, however it ended.
    Dead,
}

/// Raises the mailbox interrupt of other processors, and waits for one's own.
///
/// # For users
///
/// A mailbox calls it; programs rarely do. A ring carries no data, and a doorbell may lose,
/// repeat or invent rings: a mailbox then is slower, never wrong.
///
/// # For implementers
///
/// * `ring` is called after the message was stored, and only if the receiver asked for it. It
///   may be called from any context that sends, interrupts included.
/// * A waiter calls `prepare`, looks for messages, and then calls `wait` with what `prepare`
///   gave. A ring between `prepare` and `wait` must make `wait` return at once: compare with
///   what was seen (a futex), or keep the ring until it is waited for (an eventfd, a pending
///   interrupt bit that `prepare` does not clear).
/// * `wait` may return early for any reason, and returns at `until` at the latest.
/// * Call [`conformance::doorbell`](conformance/fn.doorbell.html) from one test.
pub trait Doorbell: Clock {
    /// What `prepare` saw; `()` for a doorbell with memory.
    type Seen;

    /// Raises the mailbox interrupt of `processor`; a number that does not exist is ignored.
    fn ring(&self, processor: Processor);

    /// Begins a wait: rings from here on end it.
    fn prepare(&self) -> Self::Seen;

    /// Sleeps until a ring since `seen` was taken, or until `until`.
    ///
    /// `whom` is the processor whose answer is waited for, if it is one; who only waits for time to
    /// pass, or for anybody, names none.
    fn wait(&self, seen: Self::Seen, until: Instant, whom: Option<Processor>);

    /// What the platform knows of the program that holds `processor`.
    ///
    /// Called about every quarter of a millisecond while somebody waits for that processor.
    fn evidence(&self, processor: Processor) -> Evidence {
        let _ = processor;
        Evidence::Unknown
    }
}

impl<T: Deref<Target: Doorbell>> Doorbell for T {
    type Seen = <T::Target as Doorbell>::Seen;

    fn ring(&self, processor: Processor) {
        (**self).ring(processor);
    }

    fn prepare(&self) -> Self::Seen {
        (**self).prepare()
    }

    fn wait(&self, seen: Self::Seen, until: Instant, whom: Option<Processor>) {
        (**self).wait(seen, until, whom);
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        (**self).evidence(processor)
    }
}
