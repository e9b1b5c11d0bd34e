//! Loops in signal handlers, and the critical section that keeps them out.
#![cfg(target_os = "linux")]

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use condor_mos::linux::{CLOCK, SignalPlatform};
use condor_mos::{
    ConnectError, EventTable, LoopId, LoopLock, Loops, Overrun, Platform as _, Rate, Scheduler,
    Statistics,
};

const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);
const DEADLINE: Duration = Duration::from_secs(60);

type TwoLoops = Scheduler<SignalPlatform, 2, 32>;

fn scheduler(fast_hz: u32, slow_hz: u32) -> TwoLoops {
    let rates = [Rate::hz(fast_hz), Rate::hz(slow_hz)];
    // SAFETY: the loops of these tests compute and use atomics and the scheduler's calls.
    let signals = unsafe { SignalPlatform::new() };
    Scheduler::new(signals, EventTable::new(&rates, CLOCK))
}

/// Has the background wait for an event.
fn until(event: impl Fn() -> bool) {
    let deadline = Instant::now() + DEADLINE;
    while !event() {
        assert!(Instant::now() < deadline, "the event never came");
    }
}

fn assert_sums_up(statistics: &Statistics) {
    let sum = statistics.run + statistics.skipped + statistics.running + statistics.pending;
    assert_eq!(statistics.released, sum, "{statistics:?}");
}

#[test]
fn a_slow_loop_waits_for_the_fast_one_that_interrupts_it() {
    let scheduler = scheduler(1000, 50);
    let (fast, nested, slow) = (AtomicU32::new(0), AtomicU32::new(0), AtomicU32::new(0));
    let inside = AtomicBool::new(false);
    let mut fast_loop = |_| {
        fast.fetch_add(1, Relaxed);
        if inside.load(Relaxed) {
            nested.fetch_add(1, Relaxed);
        }
    };
    let mut slow_loop = |_| {
        inside.store(true, Relaxed);
        let before = fast.load(Relaxed);
        // Ends only because the other loop interrupts it.
        until(|| fast.load(Relaxed) > before + 1);
        inside.store(false, Relaxed);
        slow.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        scheduler.run(|| until(|| slow.load(Relaxed) >= 3)).unwrap();
    });
    assert!(nested.load(Relaxed) >= 6);
    for id in [FAST, SLOW] {
        assert_sums_up(&scheduler.statistics(id).unwrap());
    }
}

#[test]
fn a_loop_never_sees_the_inside_of_a_critical_section() {
    let scheduler = scheduler(4000, 2000);
    let (one, other, runs) = (AtomicU64::new(0), AtomicU64::new(0), AtomicU32::new(0));
    let mut look = |_| {
        critical_section::with(|_| assert_eq!(one.load(Relaxed), other.load(Relaxed)));
        runs.fetch_add(1, Relaxed);
    };
    let mut change = |_| {
        critical_section::with(|_| {
            one.fetch_add(1, Relaxed);
            other.fetch_add(1, Relaxed);
        });
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut look).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut change).unwrap();
        scheduler
            .run(|| {
                until(|| {
                    critical_section::with(|_| {
                        one.fetch_add(1, Relaxed);
                        // Long, and nested: signals come here.
                        (0..1000).for_each(|number| {
                            black_box(number);
                        });
                        critical_section::with(|_| other.fetch_add(1, Relaxed));
                    });
                    runs.load(Relaxed) > 500
                });
            })
            .unwrap();
    });
}

#[test]
fn what_came_in_a_section_is_done_when_it_is_left() {
    let scheduler = scheduler(1000, 100);
    let runs = AtomicU32::new(0);
    let mut count = |_| {
        runs.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut count).unwrap();
        scheduler
            .run(|| {
                until(|| runs.load(Relaxed) > 3);
                let inside = critical_section::with(|_| {
                    let before = runs.load(Relaxed);
                    let end = Instant::now() + Duration::from_millis(5);
                    while Instant::now() < end {}
                    assert_eq!(runs.load(Relaxed), before);
                    before
                });
                // No time for another event: what was recorded has run at the end of the section.
                assert!(runs.load(Relaxed) > inside);
            })
            .unwrap();
    });
}

#[test]
fn threads_and_loops_exclude_each_other() {
    let scheduler = scheduler(2000, 1000);
    let shared = AtomicU64::new(0);
    // A load and a store, so that what is not excluded is lost.
    let add = || {
        critical_section::with(|_| {
            let value = shared.load(Relaxed);
            shared.store(black_box(value + 1), Relaxed);
        });
    };
    let (by_loop, by_others, done) = (AtomicU64::new(0), AtomicU64::new(0), AtomicBool::new(false));
    let mut in_loop = |_| {
        add();
        by_loop.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut in_loop).unwrap();
        std::thread::scope(|threads| {
            for _ in 0..2 {
                threads.spawn(|| {
                    while !done.load(Relaxed) {
                        add();
                        by_others.fetch_add(1, Relaxed);
                        assert_sums_up(&scheduler.statistics(FAST).unwrap());
                    }
                });
            }
            scheduler
                .run(|| until(|| by_loop.load(Relaxed) > 200))
                .unwrap();
            done.store(true, Relaxed);
        });
    });
    assert_eq!(
        shared.load(Relaxed),
        by_loop.load(Relaxed) + by_others.load(Relaxed)
    );
}

#[test]
fn other_threads_start_stop_and_change_loops() {
    let scheduler = scheduler(500, 100);
    let (fast, slow) = (AtomicU32::new(0), AtomicU32::new(0));
    let mut fast_loop = |_| {
        fast.fetch_add(1, Relaxed);
    };
    let mut slow_loop = |_| {
        slow.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        let done = AtomicBool::new(false);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                until(|| scheduler.platform().has_handler());
                scheduler.start().unwrap();
                until(|| slow.load(Relaxed) > 2);
                scheduler.set_rate(SLOW, Rate::hz(250)).unwrap();
                until(|| !scheduler.is_changing());
                scheduler.disable(FAST).unwrap();
                let before = slow.load(Relaxed);
                until(|| slow.load(Relaxed) > before + 2);
                assert!(!scheduler.statistics(FAST).unwrap().enabled);
                scheduler.stop();
                scheduler.enable(FAST).unwrap();
                let before = fast.load(Relaxed);
                scheduler.start().unwrap();
                until(|| fast.load(Relaxed) > before + 2);
                scheduler.stop();
                done.store(true, Relaxed);
            });
            let wait = || until(|| done.load(Relaxed));
            let signals = scheduler.platform();
            signals.connect(|| scheduler.on_timer(), wait).unwrap();
        });
    });
    for id in [FAST, SLOW] {
        assert_sums_up(&scheduler.statistics(id).unwrap());
    }
}

#[test]
fn an_overrun_of_the_fastest_loop_skips_what_it_missed() {
    let scheduler = scheduler(1000, 100);
    let runs = AtomicU32::new(0);
    let mut long = |_| {
        let end = Instant::now() + Duration::from_micros(3500);
        while Instant::now() < end {}
        runs.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut long).unwrap();
        scheduler.run(|| until(|| runs.load(Relaxed) > 10)).unwrap();
    });
    let statistics = scheduler.statistics(FAST).unwrap();
    assert_sums_up(&statistics);
    // Each run takes three and a half periods at least.
    assert!(
        statistics.skipped >= 3 * (statistics.run - 1),
        "{statistics:?}"
    );
}

#[test]
fn a_ceiling_lock_delays_its_users_and_nobody_else() {
    let scheduler = scheduler(1000, 500);
    let shared = LoopLock::new(&[SLOW], (0_u32, 0_u32));
    let (fast, slow) = (AtomicU32::new(0), AtomicU32::new(0));
    let mut fast_loop = |_| {
        fast.fetch_add(1, Relaxed);
    };
    let mut slow_loop = |_| {
        shared
            .lock(&scheduler, |(one, other)| {
                assert_eq!(one, other);
                *one += 1;
                *other += 1;
            })
            .unwrap();
        slow.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast_loop).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow_loop).unwrap();
        scheduler
            .run(|| {
                for _ in 0..10 {
                    shared
                        .lock(&scheduler, |(one, other)| {
                            *one += 1;
                            let before = (fast.load(Relaxed), slow.load(Relaxed));
                            until(|| fast.load(Relaxed) > before.0 + 4);
                            assert_eq!(slow.load(Relaxed), before.1);
                            *other += 1;
                        })
                        .unwrap();
                }
                until(|| slow.load(Relaxed) > 3);
            })
            .unwrap();
    });
}

#[test]
fn errno_is_as_before_a_loop() {
    let scheduler = scheduler(2000, 100);
    let runs = AtomicU32::new(0);
    let mut spoil = |_| {
        // SAFETY: closing no descriptor has no effect but an error.
        unsafe { libc::close(-1) };
        runs.fetch_add(1, Relaxed);
    };
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut spoil).unwrap();
        scheduler
            .run(|| {
                // SAFETY: the address of this thread's `errno`.
                let errno = unsafe { libc::__errno_location() };
                // SAFETY: as above.
                unsafe { errno.write_volatile(libc::ENOTTY) };
                let before = runs.load(Relaxed);
                until(|| runs.load(Relaxed) > before + 20);
                // SAFETY: as above.
                assert_eq!(unsafe { errno.read_volatile() }, libc::ENOTTY);
            })
            .unwrap();
    });
}

#[test]
fn one_thread_has_one_platform_at_a_time() {
    // SAFETY: the handlers do nothing.
    let [one, other, none] = unsafe {
        [
            SignalPlatform::new(),
            SignalPlatform::new(),
            SignalPlatform::with_signal(200),
        ]
    };
    let connect = |signals: &SignalPlatform| signals.connect(|| (), || ());
    for _ in 0..2 {
        let inner = one.connect(|| (), || connect(&other));
        assert_eq!(inner, Ok(Err(ConnectError::Connected)));
    }
    let none = connect(&none);
    assert!(
        matches!(none, Err(ConnectError::NoSuchSignal { .. })),
        "{none:?}"
    );
}

#[test]
fn a_handler_of_the_program_is_not_replaced() {
    extern "C" fn handler(_: libc::c_int) {}
    let handler: extern "C" fn(libc::c_int) = handler;
    // SAFETY: the handler does nothing, and no other test uses this signal.
    unsafe { libc::signal(libc::SIGRTMIN() + 3, handler as libc::sighandler_t) };
    // SAFETY: its handler does nothing.
    let signals = unsafe { SignalPlatform::with_signal(3) };
    let result = signals.connect(|| (), || ());
    assert!(
        matches!(result, Err(ConnectError::SignalTaken { .. })),
        "{result:?}"
    );
}
