//! The states of a mailbox and of its peer, from the first incarnation to the last order.

use core::sync::atomic::Ordering::Relaxed;
use core::time::Duration;

use condor_mbox::{
    CriticalSection, Doorbell, MailboxError, Messenger, PeerState, Processor, SendProgress, Vector,
    Waiting,
};

use crate::follower::Order;
use crate::map::MAP;
use crate::messages::{ask, served_until};
use crate::resident::{NOBODY, NOTE, READ, Resident};
use crate::{Checks, FOLLOWER, LEADER, Mbox, PATIENCE, PROCESSORS, windows};

/// Checks the states of the leader's mailbox before and while it joins for the first time.
pub fn first_incarnation<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>, bell: D) {
    let number = Processor(PROCESSORS as u8);
    checks.same(
        Mbox::<D>::new(number, windows(), bell, CriticalSection).err(),
        Some(MailboxError::NoSuchProcessor {
            number,
            processors: number.0,
        }),
    );
    checks.same(mailbox.number(), LEADER);
    vectors(checks, mailbox);
    let early = MailboxError::NotJoined { number: LEADER };
    checks.same(mailbox.send(FOLLOWER, NOTE, 0, PATIENCE), Err(early));
    checks.same(mailbox.serve(PATIENCE), Err(early));
    checks.same(mailbox.owner(), Err(early));
    checks.same(mailbox.join(), Ok(()));
    checks.same(mailbox.send(FOLLOWER, NOTE, 0, PATIENCE), Ok(()));
    checks.that(mailbox.wait_for_peer(FOLLOWER, None, PATIENCE).is_ok());
    checks.that(matches!(
        mailbox.peer_state(FOLLOWER),
        Ok(PeerState::Up {
            connected: true,
            ..
        })
    ));
}

fn vectors<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>) {
    let vector = Vector(Vector::COUNT as u8);
    checks.same(
        mailbox.set_vector(vector, &|_| 0, "none"),
        Err(MailboxError::NoSuchVector { vector }),
    );
    checks.same(
        mailbox.set_vector(READ, &|_| 0, "again"),
        Err(MailboxError::VectorTaken { vector: READ }),
    );
    checks.same(
        mailbox.set_vector(NOBODY, &|_| 0, "a name of more than thirty-two bytes"),
        Err(MailboxError::NameTooLong {
            vector: NOBODY,
            len: 36,
        }),
    );
    checks.same(mailbox.set_vector(NOBODY, &|_| 0, "spare"), Ok(()));
    checks.same(mailbox.clear_vector(NOBODY), Ok(()));
    checks.that(
        mailbox
            .vector_statistics(LEADER, NOBODY)
            .is_ok_and(|statistics| statistics.name().is_empty()),
    );
}

/// Checks a follower that holds, the counts, listening, and an incarnation after leaving.
pub fn second_incarnation<D: Doorbell>(
    checks: &mut Checks<'_>,
    mailbox: &mut Mbox<'_, D>,
    resident: &Resident,
) {
    held(checks, mailbox);
    counted(checks, mailbox);
    listening(checks, mailbox, resident);
    checks.same(mailbox.leave(), Ok(()));
    checks.same(mailbox.peer_state(LEADER), Ok(PeerState::Absent));
    checks.same(mailbox.join(), Ok(()));
    checks.same(ask(mailbox, READ, MAP.words + 400), Ok(977));
    checks.that(matches!(
        mailbox.peer_state(LEADER),
        Ok(PeerState::Up { incarnation: 2, .. })
    ));
}

fn held<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>) {
    give(checks, mailbox, Order::Hold);
    for waiting in [
        Waiting::Sleep,
        Waiting::Spin,
        Waiting::SpinThenSleep {
            spin: Duration::from_micros(100),
        },
    ] {
        mailbox.set_waiting(waiting);
        let ended = mailbox.send_with_reply(FOLLOWER, READ, 0, Duration::from_millis(5));
        let waiting = SendProgress::MayRun;
        checks.that(
            matches!(ended, Err(MailboxError::TimedOut { progress, .. } | MailboxError::Stalled { progress, .. })
                if progress == waiting),
        );
    }
    checks.that((0..=condor_mbox::layout::SLOTS).any(|data| {
        mailbox.send(FOLLOWER, NOTE, data, Duration::ZERO)
            == Err(MailboxError::NoSlot { to: FOLLOWER })
    }));
    give(checks, mailbox, Order::Serve);
    for waiting in [Waiting::Spin, Waiting::Sleep, Waiting::default()] {
        mailbox.set_waiting(waiting);
        checks.same(ask(mailbox, READ, MAP.words + 400), Ok(977));
    }
    for always in [true, false] {
        checks.same(mailbox.ring_always(always), Ok(()));
        checks.same(ask(mailbox, READ, MAP.words + 400), Ok(977));
    }
}

fn counted<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    match (
        mailbox.vector_statistics(LEADER, READ),
        mailbox.vector_statistics(FOLLOWER, READ),
    ) {
        (Ok(ours), Ok(theirs)) => {
            checks.same(theirs.name(), "read a word");
            checks.that(ours.sent > 0);
            checks.that(ours.failed > 0);
            checks.that(theirs.handled > 0);
            checks.that(theirs.worst_ns < u32::MAX);
        }
        (ours, theirs) => checks.same((ours, theirs).0, theirs),
    }
}

/// Checks that the leader can listen to the follower, and so to its own messages there.
fn listening<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>, resident: &Resident) {
    checks.same(mailbox.listens_to(), None);
    checks.same(mailbox.listen(Some(FOLLOWER), PATIENCE), Ok(()));
    checks.same(mailbox.listens_to(), Some(FOLLOWER));
    let all = (0..20).all(|_| ask(mailbox, READ, MAP.words + 400) == Ok(977));
    checks.that(all);
    checks.that(served_until(mailbox, || resident.heard.load(Relaxed) == 20));
    checks.same(mailbox.missed(LEADER), Ok(0));
    checks.same(mailbox.listen(None, PATIENCE), Ok(()));
}

/// Ends the follower, and says so on its behalf, as a host does that has reset a processor.
pub fn last_order<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    give(checks, mailbox, Order::Stop);
    let declared = match mailbox.windows(FOLLOWER) {
        Ok(windows) => Mbox::<D>::declare_stopped(FOLLOWER, windows),
        Err(error) => Err(error),
    };
    checks.same(declared, Ok(()));
    checks.same(mailbox.peer_state(FOLLOWER), Ok(PeerState::Absent));
    checks.that(matches!(
        mailbox.send(FOLLOWER, NOTE, 0, Duration::ZERO),
        Err(MailboxError::NotConnected { .. } | MailboxError::PeerLeft { .. })
    ));
}

/// Sends an order and waits until it is obeyed.
pub fn give<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, order: Order) {
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that(false);
    };
    checks.same(ram.set_word(MAP.order, order as u32), Ok(()));
    // A follower that waits for messages looks for orders after each; one that does not take
    // this one now looks anyway.
    let _ = mailbox.send(FOLLOWER, NOTE, 0, Duration::ZERO);
    let obeyed = served_until(mailbox, || ram.word(MAP.obeyed) == Ok(order as u32));
    checks.that(obeyed);
}
