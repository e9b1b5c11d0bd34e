//! [`Link`]: what a console needs of its processor's mailbox.

use core::time::Duration;

use condor_mbox::{Doorbell, Error, Exclusion, Instant, Mailbox, MemoryWindow, Messenger};

/// A mailbox that can be waited in, whatever its backend.
///
/// It is implemented for [`Mailbox`]; programs that keep theirs behind a type of their own
/// forward to it.
pub trait Link: Messenger {
    /// The present instant.
    fn now(&self) -> Instant;

    /// Waits until something has been served, for at most `timeout`.
    ///
    /// # Errors
    /// As [`Mailbox::serve`].
    fn pause(&self, timeout: Duration) -> Result<(), Error>;
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Link for Mailbox<'_, W, D, X, N> {
    fn now(&self) -> Instant {
        self.doorbell().now()
    }

    fn pause(&self, timeout: Duration) -> Result<(), Error> {
        self.serve(timeout).map(drop)
    }
}
