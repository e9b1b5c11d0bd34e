//! [`Post`]: a mailbox in a `static` that is told things and sends none of them.

use core::cell::Cell;
use core::time::Duration;

use condor_mbox::{Error, Instant, Message, Messenger, Pending, Processor};
use critical_section::Mutex;

use crate::memory::HAND;

/// What a terminal of a device switch posts to: it stays in here, to be looked at.
pub(crate) struct Post(Mutex<Cell<Option<Message>>>);

impl Post {
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Cell::new(None)))
    }

    /// What was posted last, if it was not taken yet.
    pub(crate) fn take(&self) -> Option<Message> {
        critical_section::with(|token| self.0.borrow(token).take())
    }
}

const fn refused(message: Message) -> Error {
    let Message { to, vector, .. } = message;
    Error::NoHandler { to, vector }
}

/// Everything but posts is refused: who never waits asks for nothing else.
impl Messenger for Post {
    fn number(&self) -> Processor {
        HAND
    }

    fn send_before(&self, message: Message, _: Duration, _: Instant) -> Result<(), Error> {
        Err(refused(message))
    }

    fn open_before(
        &self,
        message: Message,
        _: Duration,
        _: Instant,
    ) -> Result<(Pending, Instant), Error> {
        Err(refused(message))
    }

    fn wait_before(&self, _: &Pending, _: Duration, _: Instant) -> Result<u32, Error> {
        Ok(0)
    }

    fn post(&self, message: Message) -> Result<(), Error> {
        critical_section::with(|token| self.0.borrow(token).set(Some(message)));
        Ok(())
    }

    fn open(&self, message: Message) -> Result<Pending, Error> {
        Err(refused(message))
    }

    fn look(&self, _: &Pending) -> Result<Option<u32>, Error> {
        Ok(None)
    }

    fn abandon(&self, _: &Pending) {}
}
