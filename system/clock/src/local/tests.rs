use std::sync::Mutex;

use super::*;
use crate::sync;

/// A processor alone in its time.
#[derive(Default)]
struct Alone {
    is_elsewhere: AtomicBool,
    faults: Mutex<Vec<ClockFault>>,
    slept: AtomicU32,
}

impl Handover for Alone {
    fn sleep(&self, _: &sync::AtomicU32, _: u32, _: u64) {
        self.slept.fetch_add(1, Relaxed);
    }

    fn wake(&self, _: u8, _: &sync::AtomicU32) {}

    fn is_own_context(&self) -> bool {
        !self.is_elsewhere.load(Relaxed)
    }

    fn is_closed(&self) -> bool {
        true
    }

    fn fault(&self, fault: ClockFault) {
        self.faults.lock().unwrap().push(fault);
    }
}

impl Alone {
    fn take_faults(&self) -> Vec<ClockFault> {
        std::mem::take(&mut self.faults.lock().unwrap())
    }
}

type Clock<'p> = LocalClock<&'p Page<2>, Alone>;

/// Makes the clock of a processor that has the turn; its loops take 3 and 20 ns.
fn begun(page: &Page<2>) -> Clock<'_> {
    let mut work = [0; LOOPS];
    work[..2].copy_from_slice(&[3, 20]);
    let clock = LocalClock::new(0, page, Alone::default(), work);
    clock.announce(0);
    clock.begin();
    clock
}

type Log = Mutex<Vec<(u64, &'static str)>>;

fn note(log: &Log, clock: &Clock<'_>, what: &'static str) {
    log.lock().unwrap().push((clock.now(), what));
}

#[test]
fn interrupts_add_their_time_to_what_computes() {
    let page = Page::new();
    let clock = &begun(&page);
    let log = Log::default();
    let handler = || {
        note(&log, clock, "interrupt");
        clock.run_loop(0, || note(&log, clock, "loop"));
    };
    let program = || {
        assert!(clock.arm(4));
        clock.pass(10);
        note(&log, clock, "passed");
        // It is not armed any more.
        clock.pass(10);
        note(&log, clock, "passed");
        assert!(!clock.arm(23));
        clock.wait(0, 30, None);
        note(&log, clock, "waited");
        clock.arm(31);
        clock.disarm();
        clock.pass(5);
    };
    clock.with_handler(&handler, program).unwrap();
    let events = [
        (4, "interrupt"),
        (4, "loop"),
        (13, "passed"),
        (23, "passed"),
        (23, "interrupt"),
        (23, "loop"),
        (30, "waited"),
    ];
    assert_eq!(*log.lock().unwrap(), events);
    assert_eq!(clock.now(), 35);
}

#[test]
fn a_loop_is_interrupted_while_it_computes_and_not_in_its_body() {
    let page = Page::new();
    let clock = &begun(&page);
    let log = Log::default();
    let handler = || {
        if clock.now() == 1 {
            clock.run_loop(1, || {
                note(&log, clock, "slow");
                clock.arm(2);
                // No time passes in a wait for which it is late.
                clock.wait(0, 1, None);
            });
            note(&log, clock, "slow ends");
        } else {
            clock.run_loop(0, || note(&log, clock, "fast"));
        }
    };
    let program = || {
        clock.arm(1);
        clock.pass(5);
    };
    clock.with_handler(&handler, program).unwrap();
    let events = [(1, "slow"), (2, "fast"), (24, "slow ends")];
    assert_eq!(*log.lock().unwrap(), events);
    assert_eq!(clock.now(), 5 + 20 + 3);
}

#[test]
fn there_is_one_handler_until_it_unwinds() {
    let page = Page::new();
    let clock = &begun(&page);
    let other = || ();
    let taken = clock.with_handler(&other, || clock.with_handler(&other, || ()));
    assert_eq!(taken, Some(None));
    let program = || clock.with_handler(&other, || panic!("on purpose"));
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(program)).unwrap_err();
    clock.arm(1);
    clock.pass(2);
    assert_eq!(clock.with_handler(&other, || 5), Some(5));
}

#[test]
fn a_background_that_polls_comes_to_an_end() {
    let page = Page::new();
    let clock = begun(&page);
    let mut readings = 0;
    while clock.read() == 0 {
        readings += 1;
    }
    assert_eq!((readings, clock.now()), (999, 100_000));
    for _ in 0..1000 {
        clock.read_timer();
    }
    assert_eq!(clock.now(), 200_000);
    clock.standing_still(|| {
        for _ in 0..2000 {
            clock.read();
            clock.read_timer();
        }
    });
    assert_eq!(clock.now(), 200_000);
    // A wait is no poll.
    clock.wait(0, 0, None);
    for _ in 0..999 {
        clock.read();
    }
    assert_eq!(
        (clock.now(), clock.handover().take_faults()),
        (200_000, vec![])
    );
}

#[test]
#[cfg_attr(miri, ignore = "a million readings")]
fn a_loop_that_polls_is_told_so() {
    let page = Page::new();
    let clock = begun(&page);
    clock.run_loop(2, || {
        for _ in 0..TOO_MANY_READINGS {
            clock.read();
        }
    });
    assert_eq!(clock.handover().take_faults(), [ClockFault::Polls]);
}

#[test]
fn rings_and_stops_end_waits() {
    let page = Page::new();
    let clock = begun(&page);
    clock.wait(0, 10, None);
    assert_eq!(clock.now(), 10);
    clock.ring(0);
    clock.wait(0, 20, None);
    assert_eq!((clock.now(), clock.rings()), (10, 1));
    page.set_stop_at(15);
    assert!(!clock.is_stopping());
    clock.wait(1, 20, None);
    assert_eq!((clock.now(), clock.is_stopping()), (15, true));
    clock.wait(1, 20, None);
    assert_eq!(clock.now(), 20);
}

#[test]
fn no_time_passes_while_a_service_is_asked() {
    let page = Page::new();
    let clock = begun(&page);
    page.serve(1);
    clock.wait(0, 10, Some(1));
    assert_eq!((clock.now(), clock.handover().slept.load(Relaxed)), (0, 1));
    // Its supervisor gives it up: it is waited for as anybody is.
    page.give_up(1, clock.handover());
    clock.wait(0, 10, Some(1));
    assert_eq!((clock.now(), clock.handover().slept.load(Relaxed)), (10, 1));
}

#[test]
fn other_threads_ring_and_doze_without_the_turn() {
    let page = Page::new();
    let clock = begun(&page);
    clock.handover().is_elsewhere.store(true, Relaxed);
    clock.ring(0);
    clock.wait(1, 10, None);
    clock.wait(1, 10, Some(1));
    for _ in 0..3000 {
        clock.read();
    }
    assert_eq!((clock.now(), clock.rings()), (0, 1));
    assert_eq!(clock.handover().slept.load(Relaxed), 2);
    assert!(page.has_turn(0));
}

#[test]
fn a_program_is_told_that_it_waits_for_ever_or_does_not_stop() {
    let page = Page::new();
    let clock = begun(&page);
    // It may unwind; here it goes on, and is rung by itself.
    page.count_ring(0);
    clock.wait(0, NEVER, None);
    assert_eq!(clock.handover().take_faults(), []);
    clock.turn(NEVER, Until::Ring { seen: 1 });
    assert_eq!(clock.handover().take_faults(), [ClockFault::WaitsForever]);
    page.set_stop_at(5);
    clock.pass(5 + PATIENCE_NS);
    assert_eq!(clock.handover().take_faults(), []);
    clock.pass(1);
    assert_eq!(clock.handover().take_faults(), [ClockFault::NotStopping]);
}
