//! [`Doorbell`]: the mailbox interrupt of a processor.

use core::ops::Deref;

use crate::id::Processor;
use crate::time::{Clock, Instant};

/// The answer of the platform to the question whether a program holds a processor's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Evidence {
    /// The platform cannot tell.
    Unknown,
    /// A program holds the number.
    Alive,
    /// No program holds the number: the program that held it has ended in some way.
    Dead,
}

/// Raises the mailbox interrupt of other processors, and waits for that of this processor.
///
/// # For users
///
/// The mailbox calls these methods; programs rarely do. A ring carries no data, and a doorbell may lose,
/// repeat or invent rings: a mailbox then is slower, never wrong.
///
/// # For implementers
///
/// * `ring` is called after the message was stored, and only if the receiver asked for rings. It
///   may be called from any context that sends, including interrupts.
/// * A waiter calls `prepare`, looks for messages, and then calls `wait` with the result of
///   `prepare`. A ring between `prepare` and `wait` must make `wait` return at once. To ensure
///   this, compare with the value seen (a futex), or keep the ring until a wait takes it (an
///   eventfd, or a pending interrupt bit that `prepare` does not clear).
/// * `wait` may return early for any reason, and must return at `until` at the latest.
/// * Call [`conformance::doorbell`](conformance/fn.doorbell.html) from one test.
pub trait Doorbell: Clock {
    /// The result of `prepare`; `()` for a doorbell that keeps rings until a wait takes them.
    type Seen;

    /// Raises the mailbox interrupt of `processor`; a number that does not exist is ignored.
    fn ring(&self, processor: Processor);

    /// Prepares a wait: a ring that comes after this call ends the [`wait`](Self::wait) that
    /// follows.
    fn prepare(&self) -> Self::Seen;

    /// Sleeps until a ring comes that is later than `seen`, or until the instant `until`.
    ///
    /// `whom` is the processor whose answer the caller needs. It is `None` if the caller waits for
    /// time to pass, or for any processor.
    fn wait(&self, seen: Self::Seen, until: Instant, whom: Option<Processor>);

    /// Returns true if rings can be relied upon: every message rings, no ring is lost, and the end of
    /// a program rings the processors that may wait for it. The result never changes.
    ///
    /// A mailbox then rings for every message, whether its receiver waits or not, and sleeps until
    /// its deadline instead of polling at intervals. Choose it where a poll costs more than a ring.
    fn rings_always(&self) -> bool {
        false
    }

    /// Returns true if a message of `sender` ends [`Messenger::serve`](crate::Messenger::serve).
    ///
    /// Return false where a program must run alike whenever `sender` sends: the message is then served,
    /// and the wait goes on.
    fn ends_serving(&self, sender: Processor) -> bool {
        let _ = sender;
        true
    }

    /// Returns true if a sender waits for `listener` while it [listens](crate::Mailbox::listen) and has not taken
    /// earlier messages.
    ///
    /// Return false if a run must not depend on how fast `listener` is, such as in simulated time: a slow listener then
    /// misses messages.
    fn waits_for_listener(&self, listener: Processor) -> bool {
        let _ = listener;
        true
    }

    /// Returns the state, as far as the platform knows it, of the program that holds `processor`.
    ///
    /// A mailbox calls it about every 250 µs while it waits for that processor.
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

    fn rings_always(&self) -> bool {
        (**self).rings_always()
    }

    fn ends_serving(&self, sender: Processor) -> bool {
        (**self).ends_serving(sender)
    }

    fn waits_for_listener(&self, listener: Processor) -> bool {
        (**self).waits_for_listener(listener)
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        (**self).evidence(processor)
    }
}
