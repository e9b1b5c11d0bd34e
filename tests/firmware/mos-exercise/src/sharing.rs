//! Data that loops and the background share.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{
    CounterReading, LoopId, LoopLock, LoopLockError, Loops, Overrun, Platform, Scheduler,
};

use crate::{LOOPS, await_until};

const ROUNDS: u32 = 2000;

pub(crate) fn sharing<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    let platform = scheduler.platform();
    let mut shared = LoopLock::new(&[LoopId(1), LoopId(2)], [0_u32; 2]);
    *shared.get_mut() = [1; 2];
    let shared = &shared;
    let (by_loops, refused, whole) = (AtomicU32::new(0), AtomicU32::new(0), AtomicBool::new(true));
    let count_up = || {
        shared.lock(scheduler, |[first, second]| {
            if first != second {
                whole.store(false, Relaxed);
            }
            *first = first.wrapping_add(1);
            // Time for others to come between.
            for turn in 0..20 {
                core::hint::black_box(turn);
            }
            *second = second.wrapping_add(1);
        })
    };
    let by_loop = || {
        if count_up().is_ok() {
            critical_section::with(|_| {
                by_loops.store(by_loops.load(Relaxed).wrapping_add(1), Relaxed);
            });
        }
    };
    let mut fastest = |_| {
        let error = shared.lock(scheduler, |_| ()).err();
        if matches!(
            error,
            Some(LoopLockError::Undeclared | LoopLockError::Taken)
        ) {
            refused.store(refused.load(Relaxed).wrapping_add(1), Relaxed);
        }
    };
    let (mut middle, mut slowest) = (|_| by_loop(), |_| by_loop());
    let mut by_background = 0_u32;
    scheduler.scope(|scope| {
        let assigned = scope
            .assign(LoopId(0), Overrun::Skip, &mut fastest)
            .and_then(|()| scope.assign(LoopId(1), Overrun::Skip, &mut middle))
            .and_then(|()| scope.assign(LoopId(2), Overrun::Skip, &mut slowest));
        checks.same(assigned, Ok(()));
        let frequency = platform.frequency();
        let tenth = frequency.numerator() / frequency.denominator().max(1) / 10;
        let at = platform.now().after(tenth);
        checks.same(scheduler.start_at(at), Ok(()));
        let in_time =
            await_until(platform, || by_loops.load(Relaxed) > 0) && platform.now().has_reached(at);
        checks.that(in_time);
        for _ in 0..ROUNDS {
            by_background += u32::from(count_up().is_ok());
        }
        checks.that(await_until(platform, || by_loops.load(Relaxed) >= 10));
        scheduler.stop();
    });
    checks.same(by_background, ROUNDS);
    checks.that(whole.load(Relaxed));
    checks.that(refused.load(Relaxed) > 0);
    let counted = shared.lock(scheduler, |value| *value);
    let expected = by_background
        .wrapping_add(by_loops.load(Relaxed))
        .wrapping_add(1);
    checks.same(counted, Ok([expected; 2]));
    let twice = shared.lock(scheduler, |_| shared.lock(scheduler, |_| ()));
    checks.same(twice, Ok(Err(LoopLockError::Taken)));
}
