//! Events as a scheduler takes them, and what a platform does for it.

use checks::Checks;
use condor_mos::{Clock, Event, EventTable, Platform, Rate, RateError, Scan, entries};

use crate::{EVENTS, LOOPS, RATES};

/// Ticks that all periods are multiples of.
const CLOCK: Clock = Clock::of::<u64>(Rate::hz(2_000));
const SCAN: Scan<LOOPS> = Scan::new(&RATES, CLOCK);
const TABLE: EventTable<LOOPS, EVENTS> = EventTable::new(&RATES, CLOCK);
/// Entries of a hyperperiod of 100 ms.
const NEEDED: usize = entries(&RATES, CLOCK);

pub(crate) fn schedules(checks: &mut Checks<'_>) {
    checks.same("a table is of a clock", TABLE.clock(), CLOCK);
    checks.same("it has rates", TABLE.rates(), &RATES);
    checks.same("its entries can be counted", TABLE.events().len(), NEEDED);
    checks.that("it is no scan", !TABLE.is_scan() && SCAN.is_scan());
    checks.that("a scan has no entries", SCAN.events().is_empty());
    let mut releases = [0; LOOPS];
    for Event { ranks, .. } in TABLE.events() {
        for (rank, count) in releases.iter_mut().enumerate() {
            *count += ranks >> rank & 1;
        }
    }
    checks.same("each loop is due at its rate", releases, [20, 5, 1]);
    let [fastest, ..] = RATES;
    let room = EventTable::<8, 2>::or_scan(&RATES, &[], CLOCK);
    checks.that(
        "what does not fit is scanned",
        room.is_ok_and(|table| table.is_scan()),
    );
    let phased = EventTable::<2, 2>::phased(&[fastest; 2], &[0, 3], CLOCK);
    checks.that(
        "loops of one rate take turns",
        phased.is_ok_and(|table| matches!(table.events(), [Event { gap: 3, .. }, _])),
    );
    let late = Scan::<1>::phased(&[fastest], &[10], CLOCK).err();
    let phase = RateError::Phase {
        rate: fastest,
        phase: 10,
    };
    checks.same("within a period", late, Some(phase));
}

/// What a platform does for its scheduler, by the background.
pub(crate) fn platform<P: Platform + Sync>(checks: &mut Checks<'_>, platform: &P) {
    checks.that("loops run on this stack", platform.is_loops_stack());
    checks.same("a section gives what it finds", platform.masked(|_| 5), 5);
    let mut ran = false;
    platform.interruptible(0, || ran = true);
    checks.that("a body is called", ran);
    if P::VECTORS {
        // Nothing is started, so they find nothing to run.
        platform.pend(0b111);
    }
}
