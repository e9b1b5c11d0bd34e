//! Shared memory without messages: regions, published values, locks.

use condor_mbox::published::PublishedReadError;
use condor_mbox::spin_lock::{Incarnations, LockOwner, SpinLockError, SpinLockGuard};
use condor_mbox::{AccessError, Doorbell, MemoryWindow as _, Messenger, Offset, Published, Region};

use crate::locks::{Lock, LockKind, with_lock};
use crate::map::{MAP, Sample};
use crate::messages::served_until;
use crate::{Checks, FOLLOWER, Mbox, PATIENCE, Window};

/// The number of times that each of the two counts up under a lock.
const ROUNDS: u32 = 300;

/// Incarnations of which all are current.
struct Everybody;

impl Incarnations for Everybody {
    fn is_current(&self, _: LockOwner) -> bool {
        true
    }
}

/// Checks the memory that the leader shares with a follower that takes its [turns](crate::turn).
pub fn memory<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>) {
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that(false);
    };
    regions(checks, ram);
    published(checks, mailbox, ram);
    for &kind in LockKind::ALL {
        match kind {
            LockKind::Bakery => checks.group(" a lock of loads and stores"),
            LockKind::Semaphore => checks.group(" a lock beside a hardware semaphore"),
            #[cfg(target_has_atomic = "32")]
            LockKind::Swap => checks.group(" a lock of compare-and-swap"),
        }
        shared_count(checks, mailbox, ram, kind);
        let made = with_lock(kind, ram, |lock| dead_owner(checks, mailbox, lock));
        checks.same(made, Ok(()));
    }
}

fn regions(checks: &mut Checks<'_>, ram: Region<&Window>) {
    let mut bytes = [0; 6];
    let copied = ram
        .write(MAP.words, b"condor")
        .and_then(|()| ram.read(MAP.words, &mut bytes));
    checks.same(copied, Ok(()));
    checks.same(&bytes, b"condor");
    let part = ram.part(MAP.words, 8);
    checks.that(part.and_then(|part| part.word(0)) == ram.word(MAP.words));
    checks.same(Region::whole(ram).size(), ram.size());
}

fn published<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, ram: Region<&Window>) {
    let Ok(subscriber) = MAP.sample.subscriber(ram) else {
        return checks.that(false);
    };
    let subscriber = subscriber.with_attempts(8);
    let again = Published::<Sample>::at(MAP.sample.offset()).subscriber(ram);
    checks.that(again.is_ok());
    let (mut last, mut seen, mut whole) = (0, 0_u32, true);
    let changed = served_until(mailbox, || {
        match subscriber.read() {
            Ok(latest) => {
                let [first, rest @ ..] = latest.value;
                whole &= rest.iter().all(|word| *word == first);
                if latest.sequence != last {
                    last = latest.sequence;
                    seen += 1;
                }
            }
            Err(PublishedReadError::Unpublished | PublishedReadError::Contended { .. }) => {}
            Err(_) => whole = false,
        }
        seen >= 20
    });
    checks.that(changed);
    checks.that(whole);
}

/// Checks that both count up the same two words, under the lock.
fn shared_count<D: Doorbell>(
    checks: &mut Checks<'_>,
    mailbox: &Mbox<'_, D>,
    ram: Region<&Window>,
    kind: LockKind,
) {
    let Ok(me) = mailbox.owner() else {
        return checks.that(false);
    };
    let begun = ram
        .set(Offset::at(MAP.counted), &[0_u32; 2])
        .and_then(|()| ram.set_word(MAP.to_count, kind.word() | ROUNDS));
    checks.same(begun, Ok(()));
    let mut right = true;
    let mut taken = 0;
    let made = with_lock(kind, ram, |lock| {
        for _ in 0..ROUNDS {
            if let Ok(_guard) = lock.lock(me, mailbox, mailbox.doorbell(), PATIENCE) {
                right &= count_up(ram) == Ok(true);
                taken += 1;
            }
        }
    });
    checks.same(made, Ok(()));
    checks.same(taken, ROUNDS);
    let done = served_until(mailbox, || {
        ram.word(MAP.to_count).is_ok_and(|word| word == kind.word())
    });
    checks.that(done);
    checks.that(right);
    checks.same(ram.get(Offset::at(MAP.counted)), Ok([2 * ROUNDS; 2]));
}

/// Counts up as the follower: never waits for the lock.
pub(crate) fn count_some<D: Doorbell>(mailbox: &Mbox<'_, D>) -> Result<(), AccessError> {
    let (Ok(ram), Ok(me)) = (mailbox.region(mailbox.number()), mailbox.owner()) else {
        return Ok(());
    };
    let word = ram.word(MAP.to_count)?;
    let Some(kind) = LockKind::from_word(word) else {
        return Ok(());
    };
    let mut left = word & 0xffff;
    with_lock(kind, ram, |lock| {
        for _ in 0..left.min(16) {
            let Ok(guard) = lock.try_lock(me, mailbox) else {
                continue;
            };
            let right = count_up(ram) == Ok(true);
            // A count that was not right does not count as done, and the leader waits in vain.
            left -= u32::from(guard.release().is_ok() && right);
        }
    })?;
    if left == word & 0xffff {
        return Ok(());
    }
    ram.set_word(MAP.to_count, kind.word() | left)
}

/// Counts both words up; whether they were equal.
fn count_up(ram: Region<&Window>) -> Result<bool, AccessError> {
    let place = Offset::<[u32; 2]>::at(MAP.counted);
    let [first, second] = ram.get(place)?;
    ram.set_word(MAP.counted, first.wrapping_add(1))?;
    ram.set_word(MAP.counted.wrapping_add(4), second.wrapping_add(1))?;
    Ok(first == second)
}

fn dead_owner<D: Doorbell>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, D>, lock: &Lock<'_>) {
    let (Ok(me), Ok(dead)) = (mailbox.owner(), LockOwner::new(FOLLOWER, 0xdead)) else {
        return checks.that(false);
    };
    let try_lock = |owner| lock.try_lock(owner, mailbox).map(drop);
    checks.same(
        try_lock(dead),
        Err(SpinLockError::NotCurrent { owner: dead }),
    );
    checks.same(
        lock.try_lock(dead, &Everybody).map(core::mem::forget),
        Ok(()),
    );
    checks.same(try_lock(me), Err(SpinLockError::OwnerDead { owner: dead }));
    let recovered = lock.recover(dead, me, mailbox);
    checks.same(recovered.and_then(SpinLockGuard::release), Ok(()));
    checks.same(try_lock(me), Ok(()));
}
