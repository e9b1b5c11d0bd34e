//! Events as a scheduler takes them, and what a platform does for it.

use checks::Checks;
use condor_mos::{ClockSpec, EventTable, Platform, Rate, RateError, Scan, ScheduleEvent, entries};

use crate::{EVENTS, LOOPS, RATES};

/// Ticks that all periods are multiples of.
const CLOCK: ClockSpec = ClockSpec::of::<u64>(Rate::hz(2_000));
const SCAN: Scan<LOOPS> = Scan::new(&RATES, CLOCK);
const TABLE: EventTable<LOOPS, EVENTS> = EventTable::new(&RATES, CLOCK);
/// Entries of a hyperperiod of 100 ms.
const NEEDED: usize = entries(&RATES, CLOCK);

pub(crate) fn schedules(checks: &mut Checks<'_>) {
    checks.same(TABLE.clock(), CLOCK);
    checks.same(TABLE.rates(), &RATES);
    checks.same(TABLE.events().len(), NEEDED);
    checks.that(!TABLE.is_scan() && SCAN.is_scan());
    checks.that(SCAN.events().is_empty());
    let mut releases = [0; LOOPS];
    for ScheduleEvent { ranks, .. } in TABLE.events() {
        for (rank, count) in releases.iter_mut().enumerate() {
            *count += ranks >> rank & 1;
        }
    }
    checks.same(releases, [20, 5, 1]);
    let [fastest, ..] = RATES;
    let room = EventTable::<8, 2>::or_scan(&RATES, &[], CLOCK);
    checks.that(room.is_ok_and(|table| table.is_scan()));
    let phased = EventTable::<2, 2>::phased(&[fastest; 2], &[0, 3], CLOCK);
    checks.that(
        phased.is_ok_and(|table| matches!(table.events(), [ScheduleEvent { gap: 3, .. }, _])),
    );
    let late = Scan::<1>::phased(&[fastest], &[10], CLOCK).err();
    let phase = RateError::Phase {
        rate: fastest,
        phase: 10,
    };
    checks.same(late, Some(phase));
}

/// Checks the calls by which a scheduler uses its platform, from the background.
pub(crate) fn platform<P: Platform + Sync>(checks: &mut Checks<'_>, platform: &P) {
    checks.that(platform.is_loops_stack());
    checks.same(platform.masked(|_| 5), 5);
    let mut ran = false;
    platform.interruptible(0, || ran = true);
    checks.that(ran);
    if P::VECTORS {
        // Nothing is started, so they find nothing to run.
        platform.pend(0b111);
    }
}
