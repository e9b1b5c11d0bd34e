//! Three loops in each other, each with arithmetic of its own, that share data with the background.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use condor_mos::{Latest, LoopId, LoopLock, Loops as _, Overrun, StartError};
use firmware::Checks;

use crate::trace::{Told, Trace};
use crate::{LOOPS, Loops, await_until};

/// The number of runs of the slowest loop.
const ROUNDS: u32 = 5;

pub(crate) fn nesting<const E: usize>(checks: &mut Checks, scheduler: &Loops<E>) {
    static TRACE: Trace = Trace::new();
    let trace = &TRACE;
    let runs = [const { AtomicU32::new(0) }; LOOPS];
    let [fastest, middle, slowest] = &runs;
    let right = AtomicBool::new(true);
    let require = |holds: bool| {
        if !holds {
            right.store(false, Relaxed);
        }
    };
    let expected = [1.0, 2.0, 3.0].map(compute);
    let is_right =
        |rank: u8, expected: f64| compute(f64::from(rank) + 1.0).to_bits() == expected.to_bits();
    let shared = LoopLock::new(&[LoopId(1), LoopId(2)], [0_u32; 2]);
    let count_up = || {
        let counted = shared.lock(scheduler, |[first, second]| {
            require(first == second);
            *first = first.wrapping_add(1);
            *second = core::hint::black_box(second.wrapping_add(1));
        });
        require(counted.is_ok());
    };
    // Each slower loop goes on until the next faster one has run in its middle, computing.
    let compute_until = |rank, expected, runs: &AtomicU32| {
        let before = runs.load(Relaxed);
        require(await_until(|| {
            require(is_right(rank, expected));
            runs.load(Relaxed) != before
        }));
        count_up();
    };
    let [one, two, three] = expected;
    let mut latest = Latest::new([0; 16]);
    let (mut writer, mut reader) = latest.split_mut();
    let mut run_fastest = |_| {
        trace.around(0, || require(is_right(0, one)));
        // Word by word: whoever is interrupted must not see that.
        let number = fastest.load(Relaxed).wrapping_add(1);
        for word in writer.buffer() {
            *word = core::hint::black_box(number);
        }
        writer.publish();
        count(fastest);
    };
    let mut run_middle = |_| {
        trace.around(1, || compute_until(1, two, fastest));
        count(middle);
    };
    let mut run_slowest = |_| {
        trace.around(2, || compute_until(2, three, middle));
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
        let half = compute(0.5);
        let done = await_until(|| {
            require(compute(0.5).to_bits() == half.to_bits());
            let [number, others @ ..] = reader.read();
            require(others.iter().all(|word| word == number));
            count_up();
            slowest.load(Relaxed) >= ROUNDS
        });
        scheduler.stop();
        checks.that(done);
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
    #[cfg(feature = "values")]
    show(scheduler);
}

/// Prints the table of statistics. `core` prints numbers with a fraction by code that can panic.
#[cfg(feature = "values")]
fn show<const E: usize>(scheduler: &Loops<E>) {
    use core::fmt::Write as _;

    use firmware::Console;

    for number in 0..LOOPS as u8 {
        if let Ok(counts) = scheduler.statistics(LoopId(number)) {
            // The console takes everything.
            let _ = writeln!(Console, "{counts}");
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
