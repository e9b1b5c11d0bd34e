//! [`Link`]: a mailbox that can be waited in, whatever its backend.

use core::time::Duration;

use super::{Mailbox, Messenger};
use crate::doorbell::Doorbell;
use crate::error::Error;
use crate::exclusion::Exclusion;
use crate::time::Instant;
use crate::window::MemoryWindow;

/// A mailbox that can be waited in, whatever its backend: what a service's client in the background
/// of a processor needs of it.
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
