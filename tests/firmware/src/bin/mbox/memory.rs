//! Shared memory without messages: a published value, and a lock.

use core::time::Duration;

#[cfg(not(target_has_atomic = "32"))]
use condor_mbox::spin_lock::Bakery;
#[cfg(target_has_atomic = "32")]
use condor_mbox::spin_lock::NativeSwap;
use condor_mbox::spin_lock::TestAndSet;
use condor_mbox::{AccessError, Offset, Region, SpinLock};
use firmware::Checks;

use crate::map::MAP;
use crate::{FOLLOWER, Mail, PATIENCE, Window, served_until};

/// The number of times that the leader counts up.
const ROUNDS: u32 = 300;

/// Checks the memory that the leader shares with a follower that takes its [turns](crate::follower::turn).
pub(crate) fn memory(checks: &mut Checks, mailbox: &Mail<'_>) {
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that(false);
    };
    checks.same(published(mailbox, ram), Ok(true));
    checks.same(shared_count(mailbox, ram), Ok(true));
}

/// Reads many values while they change; returns true if each was of one piece.
fn published(mailbox: &Mail<'_>, ram: Region<&Window>) -> Result<bool, AccessError> {
    let subscriber = MAP.sample.subscriber(ram)?;
    let (mut last, mut seen, mut whole) = (0, 0_u32, true);
    let changed = served_until(mailbox, || {
        // Another attempt follows one that was in vain.
        if let Ok(latest) = subscriber.read() {
            let [first, rest @ ..] = latest.value;
            whole &= rest.iter().all(|word| *word == first);
            seen += u32::from(latest.sequence != last);
            last = latest.sequence;
        }
        seen >= 20
    });
    Ok(changed && whole)
}

/// Counts both words up, as the follower does; returns true if they were equal whenever the lock was taken.
fn shared_count(mailbox: &Mail<'_>, ram: Region<&Window>) -> Result<bool, AccessError> {
    let before = ram.word(MAP.counted)?;
    let (mut taken, mut right) = (0, true);
    for _ in 0..ROUNDS {
        let equal = count_up(mailbox, ram, PATIENCE)?;
        taken += u32::from(equal.is_some());
        right &= equal != Some(false);
    }
    let done = served_until(mailbox, || {
        let both = ram.word(MAP.counted).unwrap_or(before);
        both.wrapping_sub(before) > ROUNDS
    });
    Ok(done && right && taken == ROUNDS)
}

/// Counts both words up under the lock; returns whether they were equal, or `None` if the lock was taken for
/// all the `timeout`.
pub(crate) fn count_up(
    mailbox: &Mail<'_>,
    ram: Region<&Window>,
    timeout: Duration,
) -> Result<Option<bool>, AccessError> {
    #[cfg(target_has_atomic = "32")]
    let memory = NativeSwap::new(ram, MAP.lock)?;
    #[cfg(not(target_has_atomic = "32"))]
    let memory = Bakery::new(
        ram,
        MAP.lock,
        crate::PROCESSORS as u8,
        condor_mbox::CriticalSection,
    )?;
    let lock = SpinLock::new(&memory as &dyn TestAndSet);
    let Ok(me) = mailbox.owner() else {
        return Ok(None);
    };
    let guard = if timeout.is_zero() {
        lock.try_lock(me, mailbox)
    } else {
        lock.lock(me, mailbox, mailbox.doorbell(), timeout)
    };
    let Ok(_guard) = guard else {
        return Ok(None);
    };
    let place = Offset::<[u32; 2]>::at(MAP.counted);
    let [first, second] = ram.get(place)?;
    ram.set_word(MAP.counted, first.wrapping_add(1))?;
    ram.set_word(MAP.counted.wrapping_add(4), second.wrapping_add(1))?;
    Ok(Some(first == second))
}
