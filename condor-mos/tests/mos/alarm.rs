//! The simulated processor's timer is an `Alarm`: what it pends comes as an interrupt without cause.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

use condor_mos::sim::SimPlatform;
use condor_mos::{Alarm, ClockSpec, EventTable, LoopId, Loops, Overrun, Rate, Scheduler, Timer};

const FREQUENCY: Rate = Rate::hz(1000);

#[test]
fn a_handler_runs_after_a_pend_and_once_after_several_in_itself() {
    let processor = SimPlatform::new(FREQUENCY);
    let (calls, depth) = (AtomicU32::new(0), AtomicU32::new(0));
    let handler = || {
        assert_eq!(
            depth.fetch_add(1, Relaxed),
            0,
            "it does not interrupt itself"
        );
        if calls.fetch_add(1, Relaxed) == 0 {
            Alarm::pend(&processor);
            Alarm::pend(&processor);
        }
        depth.fetch_sub(1, Relaxed);
    };
    processor.with_handler(handler, || {
        Alarm::pend(&processor);
        assert_eq!(calls.load(Relaxed), 2);
        Alarm::pend(&processor);
        assert_eq!(calls.load(Relaxed), 3);
    });
    assert_eq!(Timer::now(&processor), 0, "no time passed");
}

#[test]
fn a_schedule_is_not_disturbed_by_pends() {
    let processor = SimPlatform::new(FREQUENCY);
    let table = EventTable::<1, 1>::new(&[Rate::hz(100)], ClockSpec::of::<u64>(FREQUENCY));
    let scheduler = Scheduler::new(processor.clone(), table);
    let runs = AtomicU64::new(0);
    let mut body = |due: u64| {
        assert_eq!(due, 10 * runs.fetch_add(1, Relaxed));
        Alarm::pend(&processor);
    };
    scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut body).unwrap();
        processor.with_handler(
            || scheduler.on_timer(),
            || {
                scheduler.start().unwrap();
                for instant in 1..=100 {
                    processor.run_until(instant);
                    Alarm::pend(&&processor);
                }
            },
        );
    });
    assert_eq!(
        runs.load(Relaxed),
        11,
        "from 0 to 100 ticks, at the last of which one is due"
    );
    assert_eq!(scheduler.statistics(LoopId(0)).unwrap().worst_lateness, 0);
}
