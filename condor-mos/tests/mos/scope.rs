//! Closures that borrow are disarmed when their scope ends, however it ends.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_mos::sim::SimPlatform;
use condor_mos::{ClockSpec, LoopError, LoopId, Loops, Overrun, Rate, Scan, Scheduler, StartError};

const FREQUENCY: Rate = Rate::hz(1000);
const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);

type Two = Scheduler<SimPlatform, 2, 0>;

fn loops(processor: &SimPlatform) -> Two {
    let clock = ClockSpec::of::<u64>(FREQUENCY);
    Scheduler::new(
        processor.clone(),
        Scan::new(&[Rate::hz(10), Rate::hz(5)], clock),
    )
}

/// So many ticks more, with interrupts.
fn run(processor: &SimPlatform, scheduler: &Two, ticks: u64) {
    use condor_mos::Timer;
    let end = processor.now() + ticks;
    processor.with_handler(|| scheduler.on_timer(), || processor.run_until(end));
}

#[test]
fn a_loop_ends_with_its_scope_and_is_free_again() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops(&processor);
    for round in 1..=2_u32 {
        let mut runs = 0;
        let mut body = |_| runs += 1;
        scheduler.scope(|scope| {
            scope.assign(FAST, Overrun::Skip, &mut body).unwrap();
            let _ = processor.with_handler(|| scheduler.on_timer(), || scheduler.start());
            run(&processor, &scheduler, 1000);
        });
        assert!(runs >= 10);
        let after = scheduler.statistics(FAST).unwrap();
        assert!(!after.enabled);
        assert_eq!(
            scheduler.enable(FAST),
            Err(LoopError::Unassigned { id: FAST })
        );
        run(&processor, &scheduler, 1000);
        assert_eq!(
            scheduler.statistics(FAST).unwrap().released,
            after.released,
            "{round}"
        );
    }
}

#[test]
fn a_loop_is_assigned_once() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops(&processor);
    let (mut one, mut other, mut nobody) = (|_| {}, |_| {}, |_| {});
    let mut inner = |_| {};
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut one).unwrap();
        let taken = Err(LoopError::Taken { id: FAST });
        assert_eq!(scope.assign(FAST, Overrun::Skip, &mut other), taken);
        // An inner scope neither gets it nor takes it away.
        scheduler.scope(|scope| {
            assert_eq!(scope.assign(FAST, Overrun::Skip, &mut inner), taken);
        });
        assert!(scheduler.statistics(FAST).unwrap().enabled);
        let none = LoopId(2);
        let error = scope.assign(none, Overrun::Skip, &mut nobody);
        assert_eq!(error, Err(LoopError::NoSuchLoop { id: none, loops: 2 }));
    });
}

#[test]
fn a_scope_that_unwinds_disarms_its_loops() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops(&processor);
    let caught = catch_unwind(AssertUnwindSafe(|| {
        let mut runs = Box::new(0_u32);
        let mut body = |_| *runs += 1;
        scheduler.scope(|scope| {
            scope.assign(FAST, Overrun::Skip, &mut body).unwrap();
            processor.with_handler(|| scheduler.on_timer(), || scheduler.start().unwrap());
            resume_unwind(Box::new("the scope"));
        });
    }));
    assert!(caught.is_err());
    // What `body` borrowed is gone; Miri would tell if it were still called.
    run(&processor, &scheduler, 1000);
    let seen = scheduler.statistics(FAST).unwrap();
    assert_eq!((seen.enabled, seen.released, seen.run), (false, 1, 1));
}

#[test]
fn a_body_that_unwinds_ends_and_all_goes_on() {
    let processor = SimPlatform::new(FREQUENCY);
    let scheduler = loops(&processor);
    let calls = AtomicU32::new(0);
    let caught = catch_unwind(AssertUnwindSafe(|| {
        let mut fast = |_| {
            if calls.fetch_add(1, Relaxed) == 1 {
                resume_unwind(Box::new("the body"));
            }
        };
        // The second run of the fast loop interrupts it.
        let mut slow = |_| processor.work(150);
        scheduler.scope(|scope| {
            scope.assign(FAST, Overrun::Skip, &mut fast).unwrap();
            scope.assign(SLOW, Overrun::Skip, &mut slow).unwrap();
            processor.with_handler(|| scheduler.on_timer(), || scheduler.start().unwrap());
        });
    }));
    assert!(caught.is_err());
    for id in [FAST, SLOW] {
        let seen = scheduler.statistics(id).unwrap();
        assert_eq!((seen.running, seen.pending, seen.enabled), (0, 0, false));
        assert_eq!(seen.released, seen.run + seen.skipped);
    }
    // No level is left behind: both run again.
    let (mut fast, mut slow) = (0_u32, 0_u32);
    let (mut fast_loop, mut slow_loop) = (|_| fast += 1, |_| slow += 1);
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        scheduler.stop();
        processor.with_handler(|| scheduler.on_timer(), || scheduler.start().unwrap());
        run(&processor, &scheduler, 1000);
    });
    assert_eq!((fast, slow), (10, 5));
}

#[test]
fn a_handler_of_another_thread_is_not_called() {
    let processor = SimPlatform::new(FREQUENCY);
    let calls = AtomicU32::new(0);
    processor.with_handler(
        || {
            calls.fetch_add(1, Relaxed);
        },
        || {
            std::thread::scope(|scope| {
                scope.spawn(|| processor.interrupt());
            });
            assert_eq!(calls.load(Relaxed), 0);
            processor.interrupt();
        },
    );
    assert_eq!(calls.load(Relaxed), 1);
}

/// As that of two schedulers which are statics. This is about what compiles.
#[test]
fn a_platform_that_is_borrowed_for_ever_has_loops_that_borrow_for_less() {
    static PROCESSOR: std::sync::OnceLock<SimPlatform> = std::sync::OnceLock::new();
    let processor: &'static SimPlatform = PROCESSOR.get_or_init(|| SimPlatform::new(FREQUENCY));
    let schedule = Scan::<1>::new(&[Rate::hz(10)], ClockSpec::of::<u64>(FREQUENCY));
    let scheduler: Scheduler<&'static SimPlatform, 1, 0> = Scheduler::new(processor, schedule);
    let mut runs = 0;
    let mut body = |_| runs += 1;
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut body).unwrap();
        assert_eq!(scheduler.start(), Err(StartError::NoHandler));
        processor.with_handler(|| scheduler.on_timer(), || scheduler.start().unwrap());
    });
    assert_eq!(runs, 1);
}
