//! [`Post`]: a mailbox in a `static` that takes things and sends none of them.

use core::time::Duration;

use condor_mbox::{
    Instant, MailboxError, MessageTicket, Messenger, PendingReply, Processor, Vector,
};

use crate::memory::HAND;

/// The messenger to which a terminal of a device switch posts.
pub(crate) struct Post;

/// Refuses everything except messages that are sent without waiting: a terminal that never waits sends no
/// others.
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
        _: u32,
        timeout: Duration,
    ) -> Result<(), MailboxError> {
        if timeout.is_zero() {
            return Ok(());
        }
        Err(MailboxError::NoHandler { to, vector })
    }

    fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        _: u32,
        _: Duration,
    ) -> Result<u32, MailboxError> {
        Err(MailboxError::NoHandler { to, vector })
    }

    fn begin(
        &self,
        to: Processor,
        vector: Vector,
        _: u32,
        _: Duration,
    ) -> Result<MessageTicket<'_>, MailboxError> {
        Err(MailboxError::NoHandler { to, vector })
    }

    fn serve(&self, _: Duration) -> Result<usize, MailboxError> {
        Ok(0)
    }

    fn poll_pending(&self, _: &PendingReply) -> Result<Option<u32>, MailboxError> {
        Ok(None)
    }

    fn wait_pending(&self, _: &PendingReply, _: Duration) -> Result<u32, MailboxError> {
        Ok(0)
    }

    fn abandon(&self, _: &PendingReply) {}
}
