//! One text for every way to run loops.
#![cfg(target_os = "linux")]

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::{Duration, Instant};

use condor_mos::linux::{CLOCK, RealTime, SignalPlatform, Threads};
use condor_mos::sim::SimPlatform;
use condor_mos::{
    EventTable, Histograms, LoopError, LoopId, LoopLock, LoopLockError, Loops, NoStatistics,
    Overrun, Rate, RateError, Scheduler, StartError,
};

const FAST: LoopId = LoopId(0);
const SLOW: LoopId = LoopId(1);
const RATES: [Rate; 2] = [Rate::hz(1000), Rate::hz(200)];
const DEADLINE: Duration = Duration::from_secs(60);

/// Two loops count in one lock, until `background` finds that both have; and how often each did.
fn count<L: Loops>(loops: &L, background: impl FnOnce(&dyn Fn() -> bool)) -> [u32; 2] {
    let shared = LoopLock::new(&[FAST, SLOW], [0_u32; 2]);
    let add = |of: LoopId| shared.lock(loops, |counts| counts[usize::from(of.0)] += 1);
    let (mut fast, mut slow) = (|_| add(FAST).unwrap(), |_| add(SLOW).unwrap());
    let both = || shared.lock(loops, |counts| counts.iter().all(|&count| count >= 3));
    loops.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast).unwrap();
        scope.assign(SLOW, Overrun::CatchUp(1), &mut slow).unwrap();
        let again = || assert_eq!(loops.start(), Err(StartError::Started));
        let run = || {
            again();
            background(&|| both().unwrap());
        };
        loops.run(run).unwrap();
        // It can begin anew.
        loops.run(again).unwrap();
    });
    assert_eq!(loops.enable(FAST), Err(LoopError::Unassigned { id: FAST }));
    let nested = shared.lock(loops, |_| shared.lock(loops, |_| ()));
    assert_eq!(nested, Ok(Err(LoopLockError::Taken)));
    shared.lock(loops, |counts| *counts).unwrap()
}

fn until(event: impl Fn() -> bool) {
    let deadline = Instant::now() + DEADLINE;
    while !event() {
        assert!(Instant::now() < deadline, "the event never came");
    }
}

#[test]
fn loops_are_the_same_in_virtual_time_in_signals_and_in_threads() {
    let processor = SimPlatform::new(Rate::hz(1_000_000));
    let scheduler = Scheduler::<_, 2, 0>::with_rates(processor.clone(), &RATES).unwrap();
    // 0 to 19 ms, and the first instant of the second run.
    let virtual_time = |both: &dyn Fn() -> bool| {
        processor.run_until(20_000);
        assert!(both());
    };
    assert_eq!(count(&scheduler, virtual_time), [21, 5]);
    assert_eq!(scheduler.statistics(FAST).unwrap().run, 21);

    // SAFETY: the loops use a lock of this crate, and compute.
    let signals = unsafe { SignalPlatform::new() };
    let table = EventTable::<2, 8>::new(&RATES, CLOCK);
    let scheduler = Scheduler::<_, 2, 8, NoStatistics>::keeping(signals, table);
    count(&scheduler, |both| until(both));
    let none = LoopError::NoStatistics { id: FAST };
    assert_eq!(scheduler.statistics(FAST), Err(none));

    let threads = Threads::new(&RATES, RealTime::none()).unwrap();
    let [fast, _] = count(&threads, |both| until(both));
    assert_eq!(threads.statistics(FAST).unwrap().run, u64::from(fast));
}

#[test]
fn a_lock_is_of_one_who_runs_loops_at_a_time() {
    let hertz = Rate::hz(1000);
    let scheduler = Scheduler::<_, 1, 0>::with_rates(SimPlatform::new(hertz), &[hertz]).unwrap();
    let threads = Threads::new(&[hertz], RealTime::none()).unwrap();
    let shared = LoopLock::new(&[FAST], ());
    let inner = shared.lock(&scheduler, |()| shared.lock(&threads, |()| ()));
    assert_eq!(inner, Ok(Err(LoopLockError::Taken)));
    let inner = shared.lock(&threads, |()| shared.lock(&scheduler, |()| ()));
    assert_eq!(inner, Ok(Err(LoopLockError::Taken)));
    assert_eq!(shared.lock(&threads, |()| ()), Ok(()));
}

#[test]
fn threads_have_phases_and_histograms() {
    let hundred = [Rate::hz(100); 2];
    let phases = [0, 5_000_000];
    let threads = Threads::<Histograms>::keeping(&hundred, &phases, RealTime::none()).unwrap();
    let dues = [const { AtomicU32::new(0) }; 2];
    let due = |number: usize| {
        let dues = &dues;
        // Of the nanoseconds of a period.
        move |due: u64| dues[number].store((due % 10_000_000) as u32, Relaxed)
    };
    let (mut first, mut second) = (due(0), due(1));
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut first).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut second).unwrap();
        threads.start_at(threads_begin()).unwrap();
        until(|| [FAST, SLOW].map(|id| threads.statistics(id).unwrap().run >= 5) == [true; 2]);
    });
    let [first, second] = dues.map(AtomicU32::into_inner);
    assert_eq!((second + 10_000_000 - first) % 10_000_000, 5_000_000);
    assert!(threads.histograms(FAST).unwrap().lateness().total() >= 5);
    let late = Threads::<Histograms>::keeping(&hundred, &[10_000_000], RealTime::none());
    assert!(matches!(late, Err(RateError::Phase { .. })), "{late:?}");
    let none = Threads::new(&[], RealTime::none());
    assert!(matches!(none, Err(RateError::Loops { loops: 0, .. })));
}

/// An instant that is soon.
fn threads_begin() -> u64 {
    // SAFETY: nothing is connected.
    let clock = unsafe { SignalPlatform::new() };
    condor_mos::Timer::now(&clock) + 1_000_000
}

#[test]
fn a_loop_that_never_keeps_up_can_be_slowed_down() {
    let threads = Threads::new(&[Rate::hz(10_000)], RealTime::none()).unwrap();
    let runs = AtomicU32::new(0);
    let mut busy = |_| {
        runs.fetch_add(1, Relaxed);
        let end = Instant::now() + Duration::from_micros(300);
        while Instant::now() < end {}
    };
    threads.scope(|scope| {
        scope.assign(FAST, Overrun::CatchUp(5), &mut busy).unwrap();
        let slow_down = || {
            until(|| threads.statistics(FAST).unwrap().skipped > 10);
            threads.set_rate(FAST, Rate::hz(100)).unwrap();
            until(|| threads.statistics(FAST).unwrap().rate == Rate::hz(100));
        };
        threads.run(slow_down).unwrap();
    });
}

#[test]
fn loops_for_good_end_with_their_threads() {
    static RUNS: AtomicU32 = AtomicU32::new(0);
    fn body(runs: &mut &'static AtomicU32, _: u64) {
        runs.fetch_add(1, Relaxed);
    }
    let threads = Threads::new(&[Rate::hz(1000)], RealTime::none()).unwrap();
    let context = Box::leak(Box::new(&RUNS));
    threads.assign(FAST, Overrun::Skip, body, context).unwrap();
    threads.run(|| until(|| RUNS.load(Relaxed) >= 3)).unwrap();
    drop(threads);
    let after = RUNS.load(Relaxed);
    std::thread::yield_now();
    assert_eq!(RUNS.load(Relaxed), after);
}

#[test]
fn rates_from_outside_have_a_table_or_a_scan_or_an_error() -> Result<(), LoopError> {
    let hertz = Rate::hz(1_000_000);
    let rates = [Rate::hz(400), Rate::hz(60)];
    // 22 entries.
    let tabled = Scheduler::<_, 4, 22>::with_rates(SimPlatform::new(hertz), &rates);
    let scanned = Scheduler::<_, 4, 21>::with_rates(SimPlatform::new(hertz), &rates);
    // A table that is too small for other rates computes them.
    let seldom = Rate::fraction(1, 7);
    tabled.unwrap().set_rate(SLOW, seldom)?;
    scanned.unwrap().set_rate(SLOW, seldom)?;
    let none = Scheduler::<_, 1, 0>::with_rates(SimPlatform::new(Rate::hz(10)), &rates[..1]);
    assert!(matches!(none.err(), Some(RateError::TooFast { .. })));
    Ok(())
}

#[test]
fn a_table_becomes_a_scan_when_other_rates_do_not_fit() {
    let processor = SimPlatform::new(Rate::hz(1_000_000));
    let rates = [Rate::hz(400), Rate::hz(50)];
    let scheduler = Scheduler::<_, 2, 8>::with_rates(processor.clone(), &rates).unwrap();
    let (mut fast_dues, mut slow_dues) = (Vec::new(), Vec::new());
    let (mut fast, mut slow) = (|due| fast_dues.push(due), |due| slow_dues.push(due));
    scheduler.scope(|scope| {
        scope.assign(FAST, Overrun::Skip, &mut fast).unwrap();
        scope.assign(SLOW, Overrun::Skip, &mut slow).unwrap();
        let background = || {
            processor.run_until(30_000);
            assert!(!scheduler.statistics(SLOW).unwrap().computed);
            scheduler.set_rate(SLOW, Rate::hz(60)).unwrap();
            processor.run_until(141_000);
            assert!(scheduler.statistics(SLOW).unwrap().computed);
        };
        scheduler.run(background).unwrap();
    });
    let in_time: Vec<u64> = (0..=56).map(|number| 2500 * number).collect();
    assert_eq!(fast_dues, in_time);
    let after = [56_667, 73_333, 90_000, 106_667, 123_333, 140_000];
    assert_eq!(slow_dues, [&[0, 20_000, 40_000], &after[..]].concat());
}
