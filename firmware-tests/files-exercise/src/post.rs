//! [`Post`]: a mailbox in a `static` that is told things and sends none of them.

use core::cell::Cell;
use core::time::Duration;

use condor_mbox::{Error, Instant, Messenger, Pending, Processor, Ticket, Vector};
use critical_section::Mutex;

use crate::memory::HAND;

/// A message: to whom, to which vector, and its word.
pub(crate) type Told = (Processor, Vector, u32);

/// What a terminal of a device switch posts to: it stays in here, to be looked at.
pub(crate) struct Post(Mutex<Cell<Option<Told>>>);

impl Post {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Cell::new(None)))
    }

    /// What was posted last, if it was not taken yet.
    pub(crate) fn take(&self) -> Option<Told> {
        critical_section::with(|token| self.0.borrow(token).take())
    }
}

/// Everything is refused but what is sent without waiting: who never waits asks for nothing else.
impl Messenger for Post {
    fn number(&self) -> Processor {
        HAND
    }

    fn now(&self) -> Instant {
        Instant::from_ns(0)
    }

    fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), Error> {
        if !timeout.is_zero() {
            return Err(Error::NoHandler { to, vector });
        }
        critical_section::with(|token| self.0.borrow(token).set(Some((to, vector, data))));
        Ok(())
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
