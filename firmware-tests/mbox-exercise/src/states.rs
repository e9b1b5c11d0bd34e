//! The states of a mailbox and of its peer, from the first life to the last order.

use core::sync::atomic::Ordering::Relaxed;
use core::time::Duration;

use condor_mbox::{
    CriticalSection, Doorbell, Error, Messenger, PeerState, Processor, Progress, Vector, Waiting,
};

use crate::follower::Order;
use crate::map::MAP;
use crate::messages::served_until;
use crate::resident::{NOBODY, NOTE, READ, Resident};
use crate::{Checks, FOLLOWER, LEADER, Mbox, PATIENCE, PROCESSORS, windows};

/// Before and while the leader joins for the first time.
pub fn first_life<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>, bell: D) {
    let number = Processor(PROCESSORS as u8);
    checks.same(
        "a number beyond the system is refused",
        Mbox::<D>::new(number, windows(), bell, CriticalSection).err(),
        Some(Error::NoSuchProcessor {
            number,
            processors: number.0,
        }),
    );
    checks.same("a mailbox knows its number", mailbox.number(), LEADER);
    vectors(checks, mailbox);
    checks.same(
        "nothing is sent before joining",
        mailbox.send(FOLLOWER, NOTE, 0, PATIENCE),
        Err(Error::NotJoined { number: LEADER }),
    );
    checks.same(
        "nothing is served before joining",
        mailbox.serve(PATIENCE),
        Err(Error::NotJoined { number: LEADER }),
    );
    checks.same(
        "nobody is an owner before joining",
        mailbox.owner(),
        Err(Error::NotJoined { number: LEADER }),
    );
    checks.same("the leader joins", mailbox.join(), Ok(()));
    checks.same(
        "a message waits until the follower is there",
        mailbox.send(FOLLOWER, NOTE, 0, PATIENCE),
        Ok(()),
    );
    checks.that(
        "the follower is waited for",
        mailbox.wait_for_peer(FOLLOWER, None, PATIENCE).is_ok(),
    );
    checks.that(
        "the follower is connected",
        matches!(
            mailbox.peer_state(FOLLOWER),
            Ok(PeerState::Up {
                connected: true,
                ..
            })
        ),
    );
}

fn vectors<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>) {
    let vector = Vector(Vector::COUNT as u8);
    checks.same(
        "a vector that does not exist cannot be set",
        mailbox.set_vector(vector, &|_| 0, "none"),
        Err(Error::NoSuchVector { vector }),
    );
    checks.same(
        "a vector is set once",
        mailbox.set_vector(READ, &|_| 0, "again"),
        Err(Error::VectorTaken { vector: READ }),
    );
    checks.same(
        "a name must fit",
        mailbox.set_vector(NOBODY, &|_| 0, "a name of more than thirty-two bytes"),
        Err(Error::NameTooLong {
            vector: NOBODY,
            len: 36,
        }),
    );
    checks.same(
        "a vector is set",
        mailbox.set_vector(NOBODY, &|_| 0, "spare"),
        Ok(()),
    );
    checks.same("a vector is cleared", mailbox.clear_vector(NOBODY), Ok(()));
    checks.that(
        "its name is gone",
        mailbox
            .vector_statistics(LEADER, NOBODY)
            .is_ok_and(|statistics| statistics.name().is_empty()),
    );
}

/// What happens while the follower holds, what was counted, listening, and a life after leaving.
pub fn second_life<D: Doorbell>(
    checks: &mut Checks<'_>,
    mailbox: &mut Mbox<'_, D>,
    resident: &Resident,
) {
    held(checks, mailbox);
    counted(checks, mailbox);
    listening(checks, mailbox, resident);
    checks.same("the leader leaves", mailbox.leave(), Ok(()));
    checks.same(
        "and is absent",
        mailbox.peer_state(LEADER),
        Ok(PeerState::Absent),
    );
    checks.same("it joins again", mailbox.join(), Ok(()));
    checks.same(
        "the follower notices by itself",
        mailbox.send_with_reply(FOLLOWER, READ, MAP.words + 400, PATIENCE),
        Ok(977),
    );
    checks.that(
        "the life is another one",
        matches!(
            mailbox.peer_state(LEADER),
            Ok(PeerState::Up { incarnation: 2, .. })
        ),
    );
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
        let waiting = Progress::MayRun;
        checks.that(
            "a call that nobody serves ends at its deadline",
            matches!(ended, Err(Error::TimedOut { progress, .. } | Error::Stalled { progress, .. })
                if progress == waiting),
        );
    }
    checks.that(
        "a ring without room is an error",
        (0..=condor_mbox::layout::SLOTS).any(|data| {
            mailbox.send(FOLLOWER, NOTE, data, Duration::ZERO)
                == Err(Error::NoSlot { to: FOLLOWER })
        }),
    );
    give(checks, mailbox, Order::Serve);
    for waiting in [Waiting::Spin, Waiting::Sleep, Waiting::default()] {
        mailbox.set_waiting(waiting);
        checks.same(
            "calls go on with every way to wait",
            mailbox.send_with_reply(FOLLOWER, READ, MAP.words + 400, PATIENCE),
            Ok(977),
        );
    }
    for always in [true, false] {
        let set = mailbox.ring_always(always);
        checks.same("rings are asked for", set, Ok(()));
        checks.same(
            "calls go on with and without",
            mailbox.send_with_reply(FOLLOWER, READ, MAP.words + 400, PATIENCE),
            Ok(977),
        );
    }
}

fn counted<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    match (
        mailbox.vector_statistics(LEADER, READ),
        mailbox.vector_statistics(FOLLOWER, READ),
    ) {
        (Ok(ours), Ok(theirs)) => {
            checks.same("a peer's vector has a name", theirs.name(), "read a word");
            checks.that("what was sent is counted", ours.sent > 0);
            checks.that("what failed is counted", ours.failed > 0);
            checks.that("what was handled is counted", theirs.handled > 0);
            checks.that(
                "and the worst time of the handler",
                theirs.worst_ns < u32::MAX,
            );
        }
        (ours, theirs) => checks.same("vectors have statistics", (ours, theirs).0, theirs),
    }
}

/// The leader listens to the follower, and so to its own messages there.
fn listening<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &mut Mbox<'_, D>, resident: &Resident) {
    checks.same("nobody is listened to", mailbox.listens_to(), None);
    checks.same(
        "the leader listens to the follower",
        mailbox.listen(Some(FOLLOWER), PATIENCE),
        Ok(()),
    );
    checks.same("and knows it", mailbox.listens_to(), Some(FOLLOWER));
    let all = (0..20)
        .all(|_| mailbox.send_with_reply(FOLLOWER, READ, MAP.words + 400, PATIENCE) == Ok(977));
    checks.that("the holder replies", all);
    let heard = served_until(mailbox, || resident.heard.load(Relaxed) == 20);
    checks.that("the listener hears every message", heard);
    checks.same("it missed none", mailbox.missed(LEADER), Ok(0));
    checks.same("it listens no more", mailbox.listen(None, PATIENCE), Ok(()));
}

/// Ends the follower, and says so on its behalf, as a host does that has reset a processor.
pub fn last_order<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    give(checks, mailbox, Order::Stop);
    let declared = match mailbox.windows(FOLLOWER) {
        Ok(windows) => Mbox::<D>::declare_stopped(FOLLOWER, windows),
        Err(error) => Err(error),
    };
    checks.same("the follower is declared stopped", declared, Ok(()));
    checks.same(
        "it is absent",
        mailbox.peer_state(FOLLOWER),
        Ok(PeerState::Absent),
    );
    checks.that(
        "nothing is sent to it",
        matches!(
            mailbox.send(FOLLOWER, NOTE, 0, Duration::ZERO),
            Err(Error::NotConnected { .. } | Error::PeerLeft { .. })
        ),
    );
}

/// Gives an order and waits until it is obeyed.
pub fn give<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, order: Order) {
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that("the follower has memory", false);
    };
    let given = ram.set_word(MAP.order, order as u32);
    checks.same("an order is given", given, Ok(()));
    // A follower that waits for messages looks for orders after each; one that does not take
    // this one now looks anyway.
    let _ = mailbox.send(FOLLOWER, NOTE, 0, Duration::ZERO);
    let obeyed = served_until(mailbox, || ram.word(MAP.obeyed) == Ok(order as u32));
    checks.that("it is obeyed", obeyed);
}
