//! Events as a scheduler takes them, and what a platform does for it.

use checks::Checks;
use condor_mos::{Clock, Event, EventTable, Platform, Rate, Scan, Schedule};

use crate::{EVENTS, LOOPS, RATES};

/// Ticks that all periods are multiples of.
const CLOCK: Clock = Clock::of::<u64>(Rate::hz(2_000));
const SCAN: Scan<LOOPS> = Scan::new(RATES, CLOCK);
const TABLE: EventTable<LOOPS, EVENTS> = EventTable::new(RATES, CLOCK);
const SECOND: u32 = 2_000;
const OTHER: Rate = Rate::hz(100);

pub(crate) fn schedules(checks: &mut Checks<'_>) {
    walk(checks, SCAN);
    walk(checks, TABLE);
}

fn walk<S: Schedule<LOOPS>>(checks: &mut Checks<'_>, mut schedule: S) {
    checks.same("a schedule is of a clock", schedule.clock(), CLOCK);
    checks.same("it has rates", *schedule.rates(), RATES);
    checks.same("the fastest is first", *schedule.ranks(), [0, 1, 2]);
    schedule.restart();
    checks.same(
        "each loop is due at its rate",
        releases(&mut schedule),
        [200, 50, 10],
    );
    let begun = schedule.begin_change(0, OTHER);
    checks.same("another rate is asked for", begun, Ok(()));
    checks.that("it has no effect yet", schedule.is_changing());
    // A piece for each entry of a table, and some more.
    let ready = (0..10 * EVENTS).any(|_| schedule.continue_change() == Ok(true));
    checks.that("it is prepared", ready);
    checks.that("a second has a turn", releases(&mut schedule) != [0; LOOPS]);
    checks.that("it has taken effect", !schedule.is_changing());
    schedule.restart();
    checks.same("at its new rate", releases(&mut schedule), [100, 50, 10]);
}

/// How often each loop is due in a second.
fn releases<S: Schedule<LOOPS>>(schedule: &mut S) -> [u32; LOOPS] {
    let mut releases = [0; LOOPS];
    let mut at = 0_u32;
    while at < SECOND {
        if schedule.is_at_turn() {
            let _ = schedule.turn(true);
        }
        let Event { ranks, gap } = schedule.next_event();
        for (rank, count) in releases.iter_mut().enumerate() {
            *count += ranks >> rank & 1;
        }
        at = at.saturating_add(gap.max(1));
    }
    releases
}

/// What a platform does for its scheduler, by the background.
pub(crate) fn platform<P: Platform>(checks: &mut Checks<'_>, platform: &P) {
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
