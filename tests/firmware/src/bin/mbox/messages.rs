//! Messages in each direction, and handlers in handlers.

use core::time::Duration;

use condor_mbox::{Call, MailboxError, Messenger as _, Vector};
use firmware::Checks;

use crate::map::MAP;
use crate::resident::{NEST, NOBODY, NOTE, READ, Resident};
use crate::{FOLLOWER, Mail, PATIENCE, served_until};

/// The most stack that a level of nesting takes.
const LEVEL_BYTES: usize = 1024;

/// Checks the leader's messages to a follower that serves. `ends` of the two processors use the leader's
/// stack.
pub(crate) fn messages(checks: &mut Checks, mailbox: &Mail<'_>, resident: &Resident, ends: usize) {
    let ask = |vector: Vector, data| mailbox.send_with_reply(FOLLOWER, vector, data, PATIENCE);
    let written = mailbox
        .region(FOLLOWER)
        .map(|ram| ram.set_word(MAP.word, 977));
    checks.same(written, Ok(Ok(())));
    checks.same(ask(READ, MAP.word), Ok(977));
    checks.same(mailbox.send(FOLLOWER, NOTE, 1, PATIENCE), Ok(()));
    let nobody = MailboxError::NoHandler {
        to: FOLLOWER,
        vector: NOBODY,
    };
    checks.same(ask(NOBODY, 0), Err(nobody));
    let mut reply = Ok(None);
    if let Ok(mut ticket) = mailbox.begin(FOLLOWER, READ, MAP.word, Duration::ZERO) {
        served_until(mailbox, || {
            reply = ticket.poll();
            reply != Ok(None)
        });
    }
    checks.same(reply, Ok(Some(977)));

    let all = (0..=Call::MAX_DEPTH).all(|depth| ask(NEST, depth) == Ok(depth));
    checks.that(all);
    checks.that(ask(NEST, 100).is_ok_and(|depth| depth > 1000 && depth < 1100));
    // Between two handlers of the leader the other end has one if it shares the stack.
    let bytes = resident.level();
    checks.that(bytes > 0 && bytes <= ends.saturating_mul(LEVEL_BYTES));
}
