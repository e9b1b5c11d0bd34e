//! Loops that are enabled, disabled, changed and stopped while others run.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{LoopError, LoopId, Loops, Overrun, Platform, Rate, Scheduler};

use crate::{LOOPS, RATES, await_until};

/// A loop that there is not.
const NONE: LoopId = LoopId(LOOPS as u8);

pub(crate) fn changes<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    let platform = scheduler.platform();
    let runs = AtomicU32::new(0);
    let waits = AtomicBool::new(false);
    let count = || runs.store(runs.load(Relaxed).wrapping_add(1), Relaxed);
    let has_run = |times: u32| {
        let before = runs.load(Relaxed);
        await_until(platform, || {
            runs.load(Relaxed).wrapping_sub(before) >= times
        })
    };
    let mut body = |_| count();
    let mut second = |_| {};
    let faulted = || {
        let counts = scheduler.statistics(LoopId(2));
        counts.is_ok_and(|counts| counts.faulted && !counts.enabled)
    };
    let mut faulty = |_| {
        if waits.load(Relaxed) {
            // Longer than its period.
            let _ = await_until(platform, faulted);
            waits.store(false, Relaxed);
        }
    };
    let missing = Err(LoopError::NoSuchLoop {
        id: NONE,
        loops: LOOPS as u8,
    });
    scheduler.scope(|scope| {
        checks.same(
            "a loop without a body is not enabled",
            scheduler.enable(LoopId(0)),
            Err(LoopError::Unassigned { id: LoopId(0) }),
        );
        let assigned = scope.assign(LoopId(0), Overrun::Skip, &mut body);
        checks.same("a loop gets a body", assigned, Ok(()));
        let again = scope.assign(LoopId(0), Overrun::Skip, &mut second);
        let taken = Err(LoopError::Taken { id: LoopId(0) });
        checks.same("and no second one", again, taken);
        let fault = scope.assign(LoopId(2), Overrun::Fault, &mut faulty);
        checks.same("another is to stop when it is late", fault, Ok(()));
        checks.same(
            "the other loops cannot be disabled",
            scheduler.disable(NONE),
            missing,
        );
        checks.same("they start", scheduler.start(), Ok(()));
        checks.that("the loop runs", has_run(3));
        checks.same("it is disabled", scheduler.disable(LoopId(0)), Ok(()));
        let before = runs.load(Relaxed);
        let other = || {
            let counts = scheduler.statistics(LoopId(2));
            counts.map_or(0, |counts| counts.run)
        };
        let then = other();
        let passed = await_until(platform, || other().wrapping_sub(then) >= 2);
        checks.that(
            "it does not run while others do",
            passed && runs.load(Relaxed) == before,
        );
        checks.same("it is enabled", scheduler.enable(LoopId(0)), Ok(()));
        checks.that("it runs again", has_run(3));
        let changed = scheduler.set_rate(LoopId(0), Rate::hz(100));
        checks.same("it gets another rate", changed, Ok(()));
        let effective = await_until(platform, || !scheduler.is_changing());
        checks.that("that takes effect", effective);
        let rate = scheduler.statistics(LoopId(0)).map(|counts| counts.rate);
        checks.same("and is told", rate, Ok(Rate::hz(100)));
        checks.that("it runs at that, too", has_run(3));
        let refused = scheduler.set_rate(LoopId(0), Rate::hz(u32::MAX));
        checks.that(
            "what cannot be is refused",
            matches!(refused, Err(LoopError::Rate(_))),
        );
        let [fastest, ..] = RATES;
        let restored = scheduler.set_rate(LoopId(0), fastest);
        checks.same("it gets its own rate again", restored, Ok(()));
        checks.that(
            "that takes effect",
            await_until(platform, || !scheduler.is_changing()),
        );
        waits.store(true, Relaxed);
        let stopped = await_until(platform, || !waits.load(Relaxed)) && faulted();
        checks.that("the loop that is late is stopped", stopped);
        checks.same("it is enabled again", scheduler.enable(LoopId(2)), Ok(()));
        checks.that("its fault is over", !faulted());
        scheduler.stop();
    });
    checks.that(
        "there are no counts of a loop that is not there",
        scheduler.statistics(NONE).is_err(),
    );
}
