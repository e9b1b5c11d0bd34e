//! Messages in every way that there is.

use core::fmt::Write as _;
use core::sync::atomic::Ordering::Relaxed;
use core::time::Duration;

use condor_mbox::{
    Allocator, Call, Doorbell, Exchange, MailboxError, MemoryWindow as _, MessageTicket, Messenger,
    Vector,
};

use crate::map::{MAP, WORDS_BYTES};
use crate::resident::{ANSWER, IN_ORDER, NEST, NOBODY, NOTE, READ, REFUSE, Resident, SUM, Terms};
use crate::{Checks, FOLLOWER, LEADER, Mbox, PATIENCE};

/// The most stack that a level of nesting takes.
const LEVEL_BYTES: usize = 1024;

/// Checks the leader's messages to a follower that serves. `ends` of the two processors use the leader's
/// stack.
pub fn messages<D: Doorbell>(
    checks: &mut Checks<'_>,
    mailbox: &Mbox<'_, D>,
    resident: &Resident,
    ends: usize,
) {
    flat(checks, mailbox);
    order(checks, mailbox);
    nested(checks, mailbox, resident);
    stack(checks, resident, ends);
    to_oneself(checks, mailbox, resident);
    tickets(checks, mailbox);
    refused(checks, mailbox);
    typed(checks, mailbox);
    kept(checks, mailbox);
}

fn flat<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    let at = MAP.words + 400;
    checks.that(
        mailbox
            .region(FOLLOWER)
            .is_ok_and(|ram| ram.set_word(at, 977).is_ok()),
    );
    checks.same(ask(mailbox, READ, at), Ok(977));
    checks.same(mailbox.send(FOLLOWER, NOTE, 1, PATIENCE), Ok(()));
    checks.that((0..u32::MAX).any(|_| mailbox.send(FOLLOWER, NOTE, 2, Duration::ZERO).is_ok()));
}

fn order<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    const COUNT: u32 = 200;
    let sent = (0..COUNT).all(|data| mailbox.send(FOLLOWER, IN_ORDER, data, PATIENCE).is_ok());
    checks.that(sent);
    checks.same(ask(mailbox, IN_ORDER, COUNT), Ok(0));
}

fn nested<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, resident: &Resident) {
    let all = (0..=Call::MAX_DEPTH).all(|depth| ask(mailbox, NEST, depth) == Ok(depth));
    checks.that(all);
    checks.that(ask(mailbox, NEST, 100).is_ok_and(|depth| depth > 1000 && depth < 1100));
    resident.notes.store(0, Relaxed);
    checks.same(ask(mailbox, ANSWER, 10), Ok(4));
    checks.that(served_until(mailbox, || resident.notes.load(Relaxed) >= 3));
}

/// Checks the stack between two handlers of the leader: the other end has one in between if it shares the
/// stack.
fn stack(checks: &mut Checks<'_>, resident: &Resident, ends: usize) {
    let bytes = resident.level.load(Relaxed);
    checks.that(bytes > 0 && bytes <= ends.saturating_mul(LEVEL_BYTES));
}

fn to_oneself<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, resident: &Resident) {
    checks.same(resident.ram.set_word(MAP.words, 42), Ok(()));
    checks.same(
        mailbox.send_with_reply(LEADER, READ, MAP.words, PATIENCE),
        Ok(42),
    );
    resident.noted.store(0, Relaxed);
    checks.same(mailbox.send(LEADER, NOTE, 5, PATIENCE), Ok(()));
    let served = mailbox.serve(Duration::ZERO);
    checks.that(served.is_ok());
    checks.that(served_until(mailbox, || resident.noted.load(Relaxed) == 5));
}

fn tickets<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    let at = MAP.words + 400;
    let begin = || mailbox.begin(FOLLOWER, READ, at, Duration::ZERO);
    let Ok(mut ticket) = begin() else {
        return checks.that(false);
    };
    let mut reply = Ok(None);
    served_until(mailbox, || {
        reply = ticket.poll();
        reply != Ok(None)
    });
    checks.same(reply, Ok(Some(977)));
    checks.same(ticket.poll(), Ok(None));
    checks.same(ticket.wait(PATIENCE), Ok(None));
    let waited = begin().and_then(|mut ticket| ticket.wait(PATIENCE));
    checks.same(waited, Ok(Some(977)));
    let mut given_up = 0;
    served_until(mailbox, || {
        // As many as there are slots, and more: each is free again when its reply has come.
        given_up += u32::from(begin().is_ok());
        given_up >= 20
    });
    checks.same(given_up, 20);
}

fn refused<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    let nobody = MailboxError::NoHandler {
        to: FOLLOWER,
        vector: NOBODY,
    };
    checks.same(ask(mailbox, NOBODY, 0), Err(nobody));
    let code = 0xffff_0001;
    checks.same(
        ask(mailbox, REFUSE, code),
        Err(MailboxError::Refused {
            to: FOLLOWER,
            vector: REFUSE,
            code,
        }),
    );
    // The compiler is not to know which error it is.
    let written = writeln!(checks, "{}", core::hint::black_box(nobody));
    checks.that(written.is_ok());
}

fn typed<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    let Ok(own) = mailbox.region(LEADER) else {
        return checks.that(false);
    };
    let mut allocator = Allocator::new(own.size());
    // The first bytes of this memory have other uses.
    let exchange = allocator
        .bytes(WORDS_BYTES)
        .and_then(|_| Exchange::<_, _, Terms, u32>::new(mailbox, own, &mut allocator));
    match exchange {
        Ok(mut exchange) => checks.same(
            exchange.call(FOLLOWER, SUM, &[1, 20, 300, u32::MAX], PATIENCE),
            Ok(320),
        ),
        Err(error) => checks.same(Some(error), None),
    }
    checks.same(ask(mailbox, SUM, u32::MAX - 3), Ok(0));
}

/// Requests that are kept without their tickets, by what forgets the type of the mailbox.
fn kept(checks: &mut Checks<'_>, messenger: &dyn Messenger) {
    let now = messenger.now();
    checks.that(messenger.now() >= now);
    let at = MAP.words + 400;
    let begin = || {
        let ticket = messenger.begin(FOLLOWER, READ, at, PATIENCE);
        ticket.map(MessageTicket::detach)
    };
    let (Ok(Some(first)), Ok(Some(second)), Ok(Some(third))) = (begin(), begin(), begin()) else {
        return checks.that(false);
    };
    checks.that(messenger.poll_pending(&third).is_ok());
    messenger.abandon(&third);
    checks.same(messenger.wait_pending(&first, PATIENCE), Ok(977));
    let mut again = MessageTicket::attach(messenger, second);
    checks.same(again.wait(PATIENCE), Ok(Some(977)));
}

/// Sends a message to the follower, and returns its reply.
pub(crate) fn ask<D: Doorbell>(
    mailbox: &Mbox<'_, D>,
    vector: Vector,
    data: u32,
) -> Result<u32, MailboxError> {
    mailbox.send_with_reply(FOLLOWER, vector, data, PATIENCE)
}

/// Serves until `done`, or for too long; whether it is done.
pub(crate) fn served_until<D: Doorbell>(
    mailbox: &Mbox<'_, D>,
    mut done: impl FnMut() -> bool,
) -> bool {
    let deadline = mailbox.doorbell().now().after(PATIENCE);
    while !done() {
        if mailbox.doorbell().now() >= deadline || mailbox.serve(Duration::from_millis(1)).is_err()
        {
            return done();
        }
    }
    true
}
