//! Loops in threads.
#![cfg(target_os = "linux")]

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};

use condor_mos::linux::{RealTime, Threads};
use condor_mos::{
    LoopError, LoopId, LoopLock, LoopLockError, Loops, Overrun, Rate, RateError, StartError,
    Statistics,
};

const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);
const DEADLINE: Duration = Duration::from_secs(60);

fn threads(fast_hz: u32, slow_hz: u32) -> Threads {
    Threads::new(&[Rate::hz(fast_hz), Rate::hz(slow_hz)], RealTime::none()).unwrap()
}

fn until(event: impl Fn() -> bool) {
    let deadline = Instant::now() + DEADLINE;
    while !event() {
        assert!(Instant::now() < deadline, "the event never came");
        std::thread::yield_now();
    }
}

fn assert_sums_up(statistics: &Statistics) {
    let sum = statistics.run + statistics.skipped + statistics.running + statistics.pending;
    assert_eq!(statistics.released, sum, "{statistics:?}");
}

#[test]
fn loops_that_borrow_run_until_the_scope_ends() {
    let threads = threads(1000, 200);
    let (mut fast, slow) = (0, AtomicU32::new(0));
    let mut fast_loop = |_| fast += 1;
    let mut slow_loop = |_| {
        slow.fetch_add(1, Relaxed);
    };
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        threads.start().unwrap();
        assert_eq!(threads.start(), Err(StartError::Started));
        until(|| slow.load(Relaxed) >= 5);
    });
    let statistics = threads.statistics(FAST).unwrap();
    assert_eq!(statistics.run, fast);
    assert!(!statistics.enabled);
    assert_eq!((statistics.running, statistics.pending), (0, 0));
    assert_sums_up(&statistics);
}

#[test]
fn every_snapshot_sums_up_under_all_changes() {
    let threads = threads(4000, 1000);
    let runs = AtomicU32::new(0);
    let mut busy = |_| {
        let count = runs.fetch_add(1, Relaxed);
        if count.is_multiple_of(7) {
            // Longer than a period: an overrun.
            let end = Instant::now() + Duration::from_micros(600);
            while Instant::now() < end {}
        }
    };
    let mut slow = |_| ();
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::CatchUp(2), &mut busy).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow).unwrap();
        let mut round = 0_u32;
        until(|| {
            assert_sums_up(&threads.statistics(FAST).unwrap());
            assert_sums_up(&threads.statistics(SLOW).unwrap());
            runs.load(Relaxed) > 100 || threads.start() == Ok(())
        });
        while runs.load(Relaxed) < 1000 {
            round += 1;
            match round % 5 {
                0 => threads.stop(),
                1 => threads.disable(FAST).unwrap(),
                2 => threads.enable(FAST).unwrap(),
                3 => threads
                    .set_rate(FAST, Rate::hz(3000 + round % 1000))
                    .unwrap(),
                _ => drop(threads.start()),
            }
            let before = runs.load(Relaxed);
            let statistics = threads.statistics(FAST).unwrap();
            assert_sums_up(&statistics);
            if round % 5 == 4 {
                until(|| runs.load(Relaxed) > before);
            }
        }
        assert!(threads.statistics(FAST).unwrap().skipped > 0);
    });
    assert_sums_up(&threads.statistics(FAST).unwrap());
}

#[test]
fn a_loop_that_panics_is_faulted_and_others_go_on() {
    let threads = threads(500, 100);
    let slow = AtomicU32::new(0);
    let mut fails = |_| panic!("on purpose");
    let mut slow_loop = |_| {
        slow.fetch_add(1, Relaxed);
    };
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fails).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        threads.start().unwrap();
        until(|| threads.statistics(FAST).unwrap().faulted);
        let before = slow.load(Relaxed);
        until(|| slow.load(Relaxed) > before + 3);
        let statistics = threads.statistics(FAST).unwrap();
        assert_eq!(statistics.run, 1);
        assert_sums_up(&statistics);
        // Whoever enables it again gets it as it is.
        threads.enable(FAST).unwrap();
        until(|| threads.statistics(FAST).unwrap().run == 2);
    });
}

#[test]
fn an_overrun_can_fault() {
    let threads = threads(1000, 100);
    let late = AtomicBool::new(true);
    let mut long = |_| {
        if late.load(Relaxed) {
            let end = Instant::now() + Duration::from_millis(3);
            while Instant::now() < end {}
        }
    };
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Fault, &mut long).unwrap();
        threads.start().unwrap();
        until(|| threads.statistics(FAST).unwrap().faulted);
        assert_sums_up(&threads.statistics(FAST).unwrap());
    });
}

#[test]
fn an_unwinding_scope_ends_its_loops() {
    let threads = threads(500, 100);
    let runs = AtomicU32::new(0);
    let unwound = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let mut count = |_| {
            runs.fetch_add(1, Relaxed);
        };
        threads.scope(|scope| {
            scope.assign(FAST, Overrun::Skip, &mut count).unwrap();
            threads.start().unwrap();
            until(|| runs.load(Relaxed) > 2);
            panic!("on purpose");
        });
    }));
    assert!(unwound.is_err());
    assert!(!threads.statistics(FAST).unwrap().enabled);
    assert!(matches!(
        threads.enable(FAST),
        Err(LoopError::Unassigned { .. })
    ));
}

#[test]
fn what_makes_no_sense_is_refused() {
    let threads = threads(500, 100);
    let none = LoopId(2);
    let (mut one, mut other, mut third) = (|_| (), |_| (), |_| ());
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut one).unwrap();
        let taken = scope.assign(FAST, Overrun::Skip, &mut other);
        let taken = matches!(taken, Err(LoopError::Taken { .. }));
        assert!(taken);
        let none = scope.assign(none, Overrun::Skip, &mut third);
        let none = matches!(none, Err(LoopError::NoSuchLoop { .. }));
        assert!(none);
    });
    let too_fast = Rate::fraction(u32::MAX, 2);
    assert!(matches!(
        threads.set_rate(FAST, too_fast),
        Err(LoopError::Rate(RateError::TooFast { .. }))
    ));
    assert!(Threads::new(&[too_fast], RealTime::none()).is_err());
    assert!(threads.statistics(none).is_err());
}

#[test]
fn an_inheritance_lock_excludes() {
    let threads = threads(2000, 1000);
    let shared = LoopLock::new(&[FAST, SLOW], (0_u32, 0_u32));
    let add = |(one, other): &mut (u32, u32)| {
        assert_eq!(one, other);
        *one += 1;
        std::thread::yield_now();
        *other += 1;
        *one
    };
    let mut fast = |_| assert!(shared.lock(&threads, add).is_ok());
    let mut slow = |_| assert!(shared.lock(&threads, add).is_ok());
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow).unwrap();
        threads.start().unwrap();
        until(|| shared.lock(&threads, add).unwrap() > 1000);
        let again = shared.lock(&threads, |_| shared.lock(&threads, |_| ()));
        assert_eq!(again, Ok(Err(LoopLockError::Taken)));
    });
    let ran = |id| threads.statistics(id).unwrap();
    assert!(!ran(FAST).faulted && !ran(SLOW).faulted);
}

#[test]
fn every_wish_has_an_answer() {
    let wishes = RealTime::default().pinned_to(0);
    let threads = Threads::new(&[Rate::hz(400), Rate::hz(50)], wishes).unwrap();
    let (mut fast, mut slow) = (|_| (), |_| ());
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow).unwrap();
        // Now the second loop is the faster one.
        threads.set_rate(SLOW, Rate::hz(1000)).unwrap();
    });
    let privileges = threads.privileges();
    let text = privileges.to_string();
    assert_eq!(text.lines().count(), 2 * 3 + 2, "{text}");
    for line in [
        "SCHED_FIFO 80 for loop 0 (400 Hz)",
        "SCHED_FIFO 79 for loop 1 (50 Hz)",
        "SCHED_FIFO 79 for loop 0",
        "SCHED_FIFO 80 for loop 1",
    ] {
        assert!(text.contains(line), "{text}");
    }
    if privileges.refused().next().is_none() {
        assert!(!text.contains("refused"), "{text}");
    } else {
        println!("not granted here:\n{text}");
        assert!(text.contains("refused  "), "{text}");
    }
    let impossible = RealTime::none().pinned_to(1 << 20).request();
    assert!(impossible.refused().next().is_some());
    assert!(
        impossible
            .to_string()
            .starts_with("refused  the thread on core 1048576: ")
    );
}
