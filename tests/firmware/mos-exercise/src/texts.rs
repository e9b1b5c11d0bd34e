//! The texts for people.

use core::fmt::Write as _;

use checks::Checks;
use condor_mos::{ClockSpec, LoopError, LoopId, LoopLockError, RateError, StartError};

/// Prints all that has a text without a fraction of a number in it: the console takes everything.
pub(crate) fn texts(checks: &mut Checks<'_>, clock: ClockSpec) {
    let id = core::hint::black_box(LoopId(0));
    let rate = clock.frequency();
    let many = RateError::TooManyEvents {
        needed: 9,
        capacity: 8,
    };
    let phase = RateError::Phase { rate, phase: 5 };
    let loops = RateError::Loops {
        loops: 4,
        capacity: 3,
    };
    let printed = writeln!(checks, "{rate}, {rate:>14}, {clock}")
        .and_then(|()| writeln!(checks, "{}", LoopError::NoSuchLoop { id, loops: 3 }))
        .and_then(|()| writeln!(checks, "{}", LoopError::Taken { id }))
        .and_then(|()| writeln!(checks, "{}", LoopError::Unassigned { id }))
        .and_then(|()| writeln!(checks, "{}", LoopError::from(many)))
        .and_then(|()| writeln!(checks, "{phase}, {loops}"))
        .and_then(|()| {
            let fast = RateError::TooFast {
                rate,
                frequency: rate,
            };
            writeln!(checks, "{fast}")
        })
        .and_then(|()| writeln!(checks, "{}", StartError::Started))
        .and_then(|()| {
            let other = StartError::Clock {
                timer: clock,
                schedule: clock,
            };
            writeln!(checks, "{other}")
        })
        .and_then(|()| writeln!(checks, "{}", LoopLockError::Undeclared))
        .and_then(|()| writeln!(checks, "{}", LoopLockError::Taken));
    checks.same(printed, Ok(()));
}
