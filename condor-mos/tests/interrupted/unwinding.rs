//! A loop that unwinds, and is interrupted before its end is recorded.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use interrupt_injector::with_points;

use crate::clock::ClockSpec;
use crate::loops::Loops as _;
use crate::process::{LoopId, Overrun};
use crate::rate::Rate;
use crate::schedule::EventTable;
use crate::scheduler::Scheduler;
use crate::sim::SimPlatform;

const FREQUENCY: Rate = Rate::hz(12);
const SLOW: LoopId = LoopId(0);
const FAST: LoopId = LoopId(1);

#[test]
fn a_loop_that_unwinds_is_not_charged_for_loops_that_interrupt_its_end() {
    static UNWINDS: AtomicBool = AtomicBool::new(false);
    let processor = SimPlatform::new(FREQUENCY);
    let clock = ClockSpec::of::<u64>(FREQUENCY);
    let table = EventTable::<2, 4>::new(&[Rate::hz(1), Rate::hz(4)], clock);
    let scheduler = Scheduler::new(processor.clone(), table);
    let mut slow = |_| {
        UNWINDS.store(true, Relaxed);
        panic!("for the test");
    };
    let mut fast = |_| processor.work(1);
    let on_point = {
        let processor = processor.clone();
        Rc::new(move || {
            if UNWINDS.swap(false, Relaxed) {
                processor.skip_to(3);
                processor.interrupt();
            }
        })
    };
    scheduler.scope(|scope| {
        scope.assign(SLOW, Overrun::Skip, &mut slow).expect("free");
        scope.assign(FAST, Overrun::Skip, &mut fast).expect("free");
        with_points(on_point, || {
            processor.with_handler(
                || scheduler.on_timer(),
                || {
                    let unwound = catch_unwind(AssertUnwindSafe(|| scheduler.start()));
                    assert!(unwound.is_err());
                },
            );
        });
    });
    let fast = scheduler.statistics(FAST).expect("a loop");
    assert_eq!((fast.run, fast.total_run), (2, 2));
    // From tick 1, after the first run of the fast loop, to tick 4, less its second.
    let slow = scheduler.statistics(SLOW).expect("a loop");
    assert_eq!((slow.run, slow.worst_run), (1, 2), "{slow}");
}
