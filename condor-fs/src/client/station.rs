//! [`Station`]: what a client wants of its mailbox.

use core::time::Duration;

use condor_mbox::{Doorbell, Error, Exclusion, Instant, Mailbox, MemoryWindow, Messenger};

/// A mailbox that can send, tell the time and wait: every [`Mailbox`] is one.
pub trait Station: Messenger {
    /// The present instant.
    fn now(&self) -> Instant;

    /// Waits for at most `time`, serving meanwhile.
    ///
    /// # Errors
    /// As [`Mailbox::serve`].
    fn pause(&self, time: Duration) -> Result<(), Error>;
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Station
    for Mailbox<'_, W, D, X, N>
{
    fn now(&self) -> Instant {
        self.doorbell().now()
    }

    fn pause(&self, time: Duration) -> Result<(), Error> {
        self.serve(time).map(drop)
    }
}
