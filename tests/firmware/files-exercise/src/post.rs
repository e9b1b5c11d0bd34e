//! [`Post`]: a mailbox in a `static` that takes things and sends none of them.

use core::time::Duration;

use condor_mbox::{Error, Instant, Messenger, Pending, Processor, Ticket, Vector};

use crate::memory::HAND;

/// What a terminal of a device switch posts to.
pub(crate) struct Post;

/// Everything is refused but what is sent without waiting: who never waits asks for nothing else.
impl Messenger for Post {
    fn number(&self) -> Processor {
        HAND
    }

    fn now(&self) -> Instant {
        Instant::from_ns(0)
    }

    fn send(&self, to: Processor, vector: Vector, _: u32, timeout: Duration) -> Result<(), Error> {
        if timeout.is_zero() {
            return Ok(());
        }
        Err(Error::NoHandler { to, vector })
    }

    fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        _: u32,
        _: Duration,
    ) -> Result<u32, Error> {
        Err(Error::NoHandler { to, vector })
    }

    fn begin(
        &self,
        to: Processor,
        vector: Vector,
        _: u32,
        _: Duration,
    ) -> Result<Ticket<'_>, Error> {
        Err(Error::NoHandler { to, vector })
    }

    fn serve(&self, _: Duration) -> Result<usize, Error> {
        Ok(0)
    }

    fn poll_pending(&self, _: &Pending) -> Result<Option<u32>, Error> {
        Ok(None)
    }

    fn wait_pending(&self, _: &Pending, _: Duration) -> Result<u32, Error> {
        Ok(0)
    }

    fn abandon(&self, _: &Pending) {}
}
