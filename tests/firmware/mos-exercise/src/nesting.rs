//! Three loops in each other, each with arithmetic of its own.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{LoopId, Loops, Overrun, Platform, Scheduler, StartError, Statistics};

use crate::trace::{Told, Trace};
use crate::{LOOPS, await_until};

/// The number of runs of the slowest loop.
const ROUNDS: u32 = 5;

pub(crate) fn nesting<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    static TRACE: Trace = Trace::new();
    let trace = &TRACE;
    let platform = scheduler.platform();
    let runs = [const { AtomicU32::new(0) }; LOOPS];
    let [fastest, middle, slowest] = &runs;
    let right = AtomicBool::new(true);
    let expected = [1.0, 2.0, 3.0].map(compute);
    let [one, two, three] = expected;
    // Each slower loop goes on until the next faster one has run in its middle, computing.
    let compute_until = |seed, expected: f64, runs: &AtomicU32| {
        let before = runs.load(Relaxed);
        let interrupted = await_until(platform, || {
            if compute(seed).to_bits() != expected.to_bits() {
                right.store(false, Relaxed);
            }
            runs.load(Relaxed) != before
        });
        if !interrupted {
            right.store(false, Relaxed);
        }
    };
    let mut run_fastest = |_| {
        trace.around(0, || {
            if compute(1.0).to_bits() != one.to_bits() {
                right.store(false, Relaxed);
            }
        });
        count(fastest);
    };
    let mut run_middle = |_| {
        trace.around(1, || compute_until(2.0, two, fastest));
        count(middle);
    };
    let mut run_slowest = |_| {
        trace.around(2, || compute_until(3.0, three, middle));
        count(slowest);
    };
    scheduler.scope(|scope| {
        let assigned = scope
            .assign(LoopId(0), Overrun::Skip, &mut run_fastest)
            .and_then(|()| scope.assign(LoopId(1), Overrun::CatchUp(2), &mut run_middle))
            .and_then(|()| scope.assign(LoopId(2), Overrun::Skip, &mut run_slowest));
        checks.same(assigned, Ok(()));
        checks.same(scheduler.start(), Ok(()));
        checks.same(scheduler.start(), Err(StartError::Started));
        let mut own = true;
        let mut balanced = true;
        let done = await_until(platform, || slowest.load(Relaxed) >= ROUNDS);
        for _ in 0..200 {
            own &= compute(0.5).to_bits() == compute(core::hint::black_box(0.5)).to_bits();
            balanced &= (0..LOOPS as u8).all(|number| {
                scheduler
                    .statistics(LoopId(number))
                    .is_ok_and(|counts| is_balanced(&counts))
            });
        }
        scheduler.stop();
        checks.that(done);
        checks.that(balanced);
        checks.that(own);
    });
    checks.that(right.load(Relaxed));
    checks.same(
        trace.told(),
        Told {
            strict: true,
            deepest: LOOPS,
            closed: true,
        },
    );
    if let Ok(counts) = scheduler.statistics(LoopId(2)) {
        checks.that(counts.worst_run >= counts.mean_run());
        checks.that(counts.utilisation() > 0.0);
        checks.that(counts.microseconds(counts.worst_run) >= 0.0);
    }
    #[cfg(feature = "values")]
    show(checks, scheduler);
}

/// Returns true if no release is lost or doubled.
fn is_balanced(counts: &Statistics) -> bool {
    let Statistics {
        released,
        run,
        skipped,
        running,
        pending,
        ..
    } = *counts;
    released
        == run
            .wrapping_add(skipped)
            .wrapping_add(running)
            .wrapping_add(pending)
}

/// Prints the table of statistics. `core` prints numbers with a fraction by code that can panic.
#[cfg(feature = "values")]
fn show<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    use core::fmt::Write as _;

    for number in 0..LOOPS as u8 {
        if let Ok(counts) = scheduler.statistics(LoopId(number)) {
            if number == 0 {
                // The console takes everything.
                let _ = writeln!(checks, "{counts:#}");
            }
            let _ = writeln!(checks, "{counts}");
        }
    }
}

fn count(runs: &AtomicU32) {
    // Written by one loop alone.
    runs.store(runs.load(Relaxed).wrapping_add(1), Relaxed);
}

/// Computes in floating-point registers for a while.
fn compute(seed: f64) -> f64 {
    let (mut even, mut odd) = (core::hint::black_box(seed), core::hint::black_box(0.5));
    for _ in 0..50 {
        even = even * 0.75 + odd;
        odd = odd * 0.5 + even * 0.125;
    }
    even + odd
}
