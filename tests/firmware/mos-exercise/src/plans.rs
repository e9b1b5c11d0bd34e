//! Rates, tables and schedulers before anything runs.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{
    ClockSpec, CounterReading, EventTable, LoopError, LoopId, Loops, Overrun, Platform, Rate,
    RateError, Scan, Scheduler, StartError, Wrapping,
};

use crate::{LOOPS, RATES, Tabled, await_until};

pub(crate) fn plans<P: Platform + Sync>(checks: &mut Checks<'_>, platform: &P) {
    let clock = ClockSpec::of::<P::Instant>(platform.frequency());
    checks.that(Rate::new(core::hint::black_box(0), 1).is_none());
    let [fastest, middle, _] = RATES;
    checks.that(
        fastest.is_faster_than(middle) && fastest > middle && fastest.as_hz() > middle.as_hz(),
    );
    let video = Rate::fraction(60_000, 1001);
    checks.same((video.numerator(), video.denominator()), (60_000, 1001));
    checks
        .that(Rate::every_seconds(10) < Rate::every_seconds(5) && !middle.is_faster_than(fastest));
    let end = Wrapping::<16>::new(u32::MAX);
    checks.same(
        (end.count(), end.after(1), end.after(3).since(end)),
        (0xffff, Wrapping::ZERO, 3),
    );
    checks.same(
        (clock.frequency(), clock.bits()),
        (platform.frequency(), P::Instant::BITS),
    );
    let table = EventTable::<LOOPS, 20>::try_new(&RATES, clock);
    #[cfg(feature = "values")]
    if let Ok(table) = &table {
        use core::fmt::Write as _;

        // The console takes everything.
        let _ = writeln!(checks, "{table}");
    }
    let events = table.map(|table| {
        table
            .events()
            .iter()
            .map(|event| event.ranks.count_ones())
            .sum()
    });
    checks.same(events, Ok(26_u32));
    let small = EventTable::<LOOPS, 19>::try_new(&RATES, clock).err();
    checks.that(matches!(
        small,
        Some(RateError::TooManyEvents { capacity: 19, .. })
    ));
    let fast = Scan::<LOOPS>::try_new(&[Rate::hz(u32::MAX); LOOPS], clock).err();
    checks.that(matches!(fast, Some(RateError::TooFast { .. })));
    let other = ClockSpec::of::<Wrapping<16>>(Rate::fraction(12_345, 7));
    checks.same(other.longest_gap(), 0x7fff);
    if let Ok(scan) = Scan::<LOOPS>::try_new(&[Rate::hz(1); LOOPS], other) {
        let error = Scheduler::new(platform, scan).start();
        checks.same(
            error,
            Err(StartError::Clock {
                timer: clock,
                schedule: other,
            }),
        );
    }
}

/// The context of a loop that has none.
pub(crate) type Nothing = [u8; 0];

pub(crate) fn for_good<P: Platform + Sync>(checks: &mut Checks<'_>, scheduler: &Tabled<P>) {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    let body: fn(&mut Nothing, P::Instant) =
        |_, _| RUNS.store(RUNS.load(Relaxed).wrapping_add(1), Relaxed);
    let assigned = scheduler.assign(LoopId(0), Overrun::default(), body, &mut []);
    checks.same(assigned, Ok(()));
    let again = scheduler.assign(LoopId(0), Overrun::Skip, body, &mut []);
    checks.same(again, Err(LoopError::Taken { id: LoopId(0) }));
    checks.same(scheduler.start(), Ok(()));
    let ran = await_until(scheduler.platform(), || RUNS.load(Relaxed) >= 5);
    scheduler.stop();
    checks.that(ran);
}
