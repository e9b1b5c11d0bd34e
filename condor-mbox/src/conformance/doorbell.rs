//! The checks of [`Doorbell`].

use core::time::Duration;

use crate::doorbell::{Doorbell, Evidence};
use crate::id::Processor;
use crate::time::Instant;

/// The error of [`doorbell()`]: a rule that the checked doorbell breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the doorbell breaks a rule: {check}; its clock was at {} ns; the wait's deadline, or the clock's earlier reading, \
     was {} ns",
    .now.as_ns(),
    .until.as_ns()
)]
pub struct DoorbellFailure {
    /// The rule that is broken.
    pub check: &'static str,
    /// The time at which the fault was found.
    pub now: Instant,
    /// The deadline of the wait, or the time that `now` should not precede.
    pub until: Instant,
}

/// The longest time in which a ring must end a wait; only a lost ring takes as long.
const LOST: Duration = Duration::from_secs(20);
/// The duration of a wait that no ring ends.
const UNDISTURBED: Duration = Duration::from_millis(2);
const ROUNDS: u32 = 50;

/// Checks that the doorbell `mine` of processor `me` keeps the rules of [`Doorbell`]. No other
/// processor may ring it during the check.
///
/// `ring_me` must ring `mine` as another processor does, and return after the ring. No check
/// depends on the speed of the machine, but a lost ring is found only after 20 seconds of the
/// doorbell's clock. If a wait does not return at its deadline, this function never returns.
///
/// # Errors
/// [`DoorbellFailure`] for the first check that fails.
pub fn doorbell<D: Doorbell>(
    mine: &D,
    me: Processor,
    ring_me: impl Fn(),
) -> Result<(), DoorbellFailure> {
    clock(mine)?;
    undisturbed(mine)?;
    for _ in 0..ROUNDS {
        ended_by("a ring after `prepare` ends the wait", mine, &ring_me)?;
    }
    ended_by("many rings after `prepare` end the wait", mine, || {
        for _ in 0..ROUNDS {
            ring_me();
        }
    })?;
    // A ring before `prepare` may end the wait or not; it must not spoil what follows.
    ring_me();
    undisturbed(mine)?;
    ended_by(
        "a ring after rings that no wait consumed ends the wait",
        mine,
        &ring_me,
    )?;
    ended_by(
        "a ring by the waiting processor itself ends the wait",
        mine,
        || mine.ring(me),
    )?;
    nobody(mine)?;
    ended_by(
        "a ring after rings to numbers that do not exist ends the wait",
        mine,
        &ring_me,
    )?;
    // Preparing again, as a wait does that found work, forgets no later ring.
    let _ = mine.prepare();
    ended_by(
        "a ring after the second `prepare` ends the wait",
        mine,
        &ring_me,
    )
}

fn clock<D: Doorbell>(mine: &D) -> Result<(), DoorbellFailure> {
    let mut last = mine.now();
    for _ in 0..1000 {
        let now = mine.now();
        if now < last {
            return Err(DoorbellFailure {
                check: "the clock never runs backwards",
                now,
                until: last,
            });
        }
        last = now;
    }
    Ok(())
}

/// Checks waits that no ring ends: each returns at its deadline, or at once if that has passed.
fn undisturbed<D: Doorbell>(mine: &D) -> Result<(), DoorbellFailure> {
    let start = mine.now();
    for until in [Instant::from_ns(0), start, start.after(UNDISTURBED)] {
        mine.wait(mine.prepare(), until, None);
    }
    let now = mine.now();
    if now < start {
        return Err(DoorbellFailure {
            check: "the clock never runs backwards",
            now,
            until: start,
        });
    }
    Ok(())
}

/// A wait with `ring` between `prepare` and `wait`, which must not last until its deadline.
fn ended_by<D: Doorbell>(
    check: &'static str,
    mine: &D,
    ring: impl Fn(),
) -> Result<(), DoorbellFailure> {
    let seen = mine.prepare();
    ring();
    let until = mine.now().after(LOST);
    mine.wait(seen, until, None);
    let now = mine.now();
    if now < until {
        Ok(())
    } else {
        Err(DoorbellFailure { check, now, until })
    }
}

/// Numbers that do not exist are ignored, and no program is alive under them.
fn nobody<D: Doorbell>(mine: &D) -> Result<(), DoorbellFailure> {
    for number in [Processor(Processor::MAX_COUNT as u8), Processor(u8::MAX)] {
        mine.ring(number);
        if mine.evidence(number) == Evidence::Alive {
            let now = mine.now();
            return Err(DoorbellFailure {
                check: "no program is alive under a number that does not exist",
                now,
                until: now,
            });
        }
    }
    Ok(())
}
