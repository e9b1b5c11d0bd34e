//! A schedule that begins at an instant.

use condor_mos::sim::SimPlatform;
use condor_mos::{
    ClockSpec, EventTable, LoopId, Loops, Overrun, Rate, Scheduler, StartError, Timer,
};

const MICROSECONDS: Rate = Rate::hz(1_000_000);

#[test]
fn loops_are_due_first_at_the_instant_that_was_given() {
    let processor = SimPlatform::new(MICROSECONDS);
    let table = EventTable::<1, 1>::new(&[Rate::hz(100)], ClockSpec::of::<u64>(MICROSECONDS));
    let scheduler = Scheduler::new(processor.clone(), table);
    let mut instants = Vec::new();
    let mut note = |_| instants.push(Timer::now(&processor));
    scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut note).unwrap();
        processor.with_handler(
            || scheduler.on_timer(),
            || {
                processor.run_until(1_000);
                scheduler.start_at(3_000).unwrap();
                assert_eq!(scheduler.start_at(4_000), Err(StartError::Started));
                processor.run_until(30_000);
            },
        );
    });
    assert_eq!(instants, [3_000, 13_000, 23_000]);
}
