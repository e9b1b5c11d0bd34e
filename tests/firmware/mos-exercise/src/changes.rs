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
            scheduler.enable(LoopId(0)),
            Err(LoopError::Unassigned { id: LoopId(0) }),
        );
        checks.same(scope.assign(LoopId(0), Overrun::Skip, &mut body), Ok(()));
        let again = scope.assign(LoopId(0), Overrun::Skip, &mut second);
        checks.same(again, Err(LoopError::Taken { id: LoopId(0) }));
        checks.same(scope.assign(LoopId(2), Overrun::Fault, &mut faulty), Ok(()));
        checks.same(scheduler.disable(NONE), missing);
        checks.same(scheduler.start(), Ok(()));
        checks.that(has_run(3));
        checks.same(scheduler.disable(LoopId(0)), Ok(()));
        let before = runs.load(Relaxed);
        let other = || {
            let counts = scheduler.statistics(LoopId(2));
            counts.map_or(0, |counts| counts.run)
        };
        let then = other();
        let passed = await_until(platform, || other().wrapping_sub(then) >= 2);
        checks.that(passed && runs.load(Relaxed) == before);
        checks.same(scheduler.enable(LoopId(0)), Ok(()));
        checks.that(has_run(3));
        checks.same(scheduler.set_rate(LoopId(0), Rate::hz(100)), Ok(()));
        checks.that(await_until(platform, || !scheduler.is_changing()));
        let rate = scheduler.statistics(LoopId(0)).map(|counts| counts.rate);
        checks.same(rate, Ok(Rate::hz(100)));
        checks.that(has_run(3));
        let refused = scheduler.set_rate(LoopId(0), Rate::hz(u32::MAX));
        checks.that(matches!(refused, Err(LoopError::Rate(_))));
        let [fastest, ..] = RATES;
        checks.same(scheduler.set_rate(LoopId(0), fastest), Ok(()));
        checks.that(await_until(platform, || !scheduler.is_changing()));
        waits.store(true, Relaxed);
        checks.that(await_until(platform, || !waits.load(Relaxed)) && faulted());
        checks.same(scheduler.enable(LoopId(2)), Ok(()));
        checks.that(!faulted());
        scheduler.stop();
    });
    checks.that(scheduler.statistics(NONE).is_err());
}
